"""Motions over time: reference motions, and measured ones with the contact forces that explain them."""

from rbd.modules import submodule as _submodule
from rbd.motion.derivation import Derivation, derivatives
from rbd.motion.force_estimate import ForceEstimate, OpenComponents
from rbd.motion.making import minimum_jerk
from rbd.motion.measured import ForceHistory, estimate_forces, estimate_forces_along
from rbd.motion.motion import Motion
from rbd.motion.observer import MomentumObserver
from rbd.motion.sensor_noise import SensorNoise

__all__ = [
    "Derivation",
    "ForceEstimate",
    "ForceHistory",
    "MomentumObserver",
    "Motion",
    "OpenComponents",
    "SensorNoise",
    "derivatives",
    "estimate_forces",
    "estimate_forces_along",
    "minimum_jerk",
]


def __getattr__(name: str) -> object:
    return _submodule(__name__, name)
