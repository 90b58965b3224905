"""Torques and contact forces for wanted motions and for robots at rest; support regions, wrench cones and largest pushes."""

from functools import partial as _partial

from rbd.modules import submodule as _submodule
from rbd.statics.actuation import Actuation, ActuationUniqueness, Margins
from rbd.statics.actuations import Actuations
from rbd.statics.effort import Effort
from rbd.statics.equilibrium import hold, hold_many
from rbd.statics.limits import Limit
from rbd.statics.nearest_possible_motion import Missing
from rbd.statics.pushes import PushLimits, push_limits
from rbd.statics.regions import SupportRegion, support_region
from rbd.statics.wrench_cones import ContactWrenchCone, wrench_cone
from rbd.statics.zero_moment_point import ZmpRegion, zmp, zmp_region

__all__ = [
    "Actuation",
    "ActuationUniqueness",
    "Actuations",
    "ContactWrenchCone",
    "Effort",
    "Limit",
    "Margins",
    "Missing",
    "PushLimits",
    "SupportRegion",
    "ZmpRegion",
    "hold",
    "hold_many",
    "push_limits",
    "support_region",
    "wrench_cone",
    "zmp",
    "zmp_region",
]


__getattr__ = _partial(_submodule, __name__)
