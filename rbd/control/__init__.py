"""Motor torques and pushes over time: controllers, schedules and pushes; tasks, and the torques that meet them best."""

from rbd.control.accepted_steps import AcceptedStep, ContactTouch, SteppedController
from rbd.control.contact_schedule import ContactSchedule
from rbd.control.control_log import ControlLog
from rbd.control.force_tasks import ForceTask, MomentumTask
from rbd.control.limits import Limits
from rbd.control.posture import HoldPosture
from rbd.control.posture_task import PostureTask
from rbd.control.schedules import Push, Pushes, TorqueSchedule, ZeroOrderHold
from rbd.control.stepping import step
from rbd.control.task_actuation import StepCertificate, TaskActuation, Violation
from rbd.control.task_terms import Reference, Task, TaskTerms
from rbd.control.tasks import ComTask, FrameTask
from rbd.control.torques import inverse_dynamics_many
from rbd.control.tracking import TrackingController
from rbd.control.whole_body import WholeBodyController
from rbd.modules import submodule as _submodule

__all__ = [
    "AcceptedStep",
    "ComTask",
    "ContactSchedule",
    "ContactTouch",
    "ControlLog",
    "ForceTask",
    "FrameTask",
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
    "WholeBodyController",
    "ZeroOrderHold",
    "inverse_dynamics_many",
    "step",
]


def __getattr__(name: str) -> object:
    return _submodule(__name__, name)
