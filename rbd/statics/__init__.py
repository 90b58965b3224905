"""Torques and contact forces of wanted motions and of robots at rest, their limits, and why there are none."""

from rbd.modules import submodule as _submodule
from rbd.statics.actuation import Actuation, ActuationUniqueness, Margins
from rbd.statics.effort import Effort
from rbd.statics.equilibrium import hold
from rbd.statics.limits import Limit
from rbd.statics.shortfall import Missing

__all__ = ["Actuation", "ActuationUniqueness", "Effort", "Limit", "Margins", "Missing", "hold"]


def __getattr__(name: str) -> object:
    return _submodule(__name__, name)
