"""Motor torques and pushes over time: controllers, schedules and pushes."""

from rbd.control.posture import HoldPosture
from rbd.control.schedules import Push, Pushes, TorqueSchedule, ZeroOrderHold
from rbd.control.torques import inverse_dynamics_many
from rbd.control.tracking import TrackingController
from rbd.modules import submodule as _submodule

__all__ = [
    "HoldPosture",
    "Push",
    "Pushes",
    "TorqueSchedule",
    "TrackingController",
    "ZeroOrderHold",
    "inverse_dynamics_many",
]


def __getattr__(name: str) -> object:
    return _submodule(__name__, name)
