"""Robots at rest: torques and contact forces in static equilibrium, and the least friction that they need."""

from rbd.modules import submodule as _submodule
from rbd.statics.equilibrium import Hold, hold

__all__ = ["Hold", "hold"]


def __getattr__(name: str) -> object:
    return _submodule(__name__, name)
