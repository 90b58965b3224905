"""Many worlds of one robot, stepped together: eight in the lanes of the processor's vectors, each step with its residual."""

from functools import partial as _partial

from rbd.modules import submodule as _submodule
from rbd.worlds.certificates import WorldCertificate
from rbd.worlds.differences import MotionDerivatives, motion_derivatives
from rbd.worlds.simulating import simulate_many
from rbd.worlds.stepping import Servo, WorldPushes, Worlds
from rbd.worlds.trajectories import Trajectories

__all__ = [
    "MotionDerivatives",
    "Servo",
    "Trajectories",
    "WorldCertificate",
    "WorldPushes",
    "Worlds",
    "motion_derivatives",
    "simulate_many",
]


__getattr__ = _partial(_submodule, __name__)
