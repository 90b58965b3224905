"""Motor torques and pushes over time: controllers, schedules and pushes; tasks, and the torques that meet them best."""

from functools import partial as _partial

from rbd.control.capture import CaptureRegion, capture_region
from rbd.control.contact_schedule import ContactSchedule
from rbd.control.control_log import ControlLog
from rbd.control.following import follow
from rbd.control.force_tasks import ForceTask, MomentumTask
from rbd.control.motion_limits import Limits
from rbd.control.posture_control import HoldPosture
from rbd.control.schedules import AcceptedStep, ContactTouch, Push, Pushes, SteppedController, TorqueSchedule, ZeroOrderHold
from rbd.control.step_problem import StepCertificate, TaskActuation, Violation
from rbd.control.task_terms import Reference, Task, TaskTerms
from rbd.control.tasks import ComTask, FrameTask, PostureTask
from rbd.control.torques import inverse_dynamics_many
from rbd.control.tracking import TrackingController
from rbd.control.walking.balance import Balance
from rbd.control.walking.footsteps import Footstep
from rbd.control.walking.gaits import Gait
from rbd.control.walking.plan import WalkPlan
from rbd.control.walking.walk import Walk
from rbd.control.whole_body import WholeBodyController
from rbd.control.whole_body_step import step
from rbd.modules import submodule as _submodule

__all__ = [
    "AcceptedStep",
    "Balance",
    "CaptureRegion",
    "ComTask",
    "ContactSchedule",
    "ContactTouch",
    "ControlLog",
    "Footstep",
    "ForceTask",
    "FrameTask",
    "Gait",
    "HoldPosture",
    "Limits",
    "MomentumTask",
    "PostureTask",
    "Push",
    "Pushes",
    "Reference",
    "StepCertificate",
    "SteppedController",
    "Task",
    "TaskActuation",
    "TaskTerms",
    "TorqueSchedule",
    "TrackingController",
    "Violation",
    "Walk",
    "WalkPlan",
    "WholeBodyController",
    "ZeroOrderHold",
    "capture_region",
    "follow",
    "inverse_dynamics_many",
    "step",
]


__getattr__ = _partial(_submodule, __name__)
