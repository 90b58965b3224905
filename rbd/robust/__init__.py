"""Statements about all members of a set, each with a certificate that is checked in exact arithmetic."""

from functools import partial as _partial

from rbd.modules import submodule as _submodule
from rbd.robust.holding import Counterexample, RobustHold, hold
from rbd.robust.places import RobustRegion, region
from rbd.robust.pushed import RobustPushLimits, push_limits
from rbd.robust.sets import Member, PushSet

__all__ = [
    "Counterexample",
    "Member",
    "PushSet",
    "RobustHold",
    "RobustPushLimits",
    "RobustRegion",
    "hold",
    "push_limits",
    "region",
]

__getattr__ = _partial(_submodule, __name__)
