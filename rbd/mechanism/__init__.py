"""Mechanisms: assembly, mobility, branches and singularities of closed loops and rolling."""

from functools import partial as _partial

from rbd.mechanism.assembly import Assembly, Branch, Branches, assemble, branches
from rbd.mechanism.branch_tracing import Trace, trace
from rbd.mechanism.degrees_of_freedom import Mobility, mobility
from rbd.mechanism.four_bar_class import FourBarClass
from rbd.mechanism.frobenius import Integrability, integrability
from rbd.mechanism.partition import (
    AccelerationPartition,
    VelocityPartition,
    acceleration_partition,
    independent_velocities,
    link_jacobians,
    link_rates,
    velocity_partition,
)
from rbd.mechanism.pins import pin_forces
from rbd.mechanism.pose_search import FoundPose, find_pose
from rbd.mechanism.projection import ProjectedAcceleration, project_acceleration, project_velocity
from rbd.mechanism.singular_configurations import Singularities, SingularitiesAlong, singularities, singularities_along
from rbd.mechanism.topology import MechanismClass, classify
from rbd.modules import submodule as _submodule
from rbd.robots.linkage import Link, Linkage, link_angles, with_link_angles
from rbd.robots.standard_linkages import four_bar, n_four_bar, slider_crank

__all__ = [
    "AccelerationPartition",
    "Assembly",
    "Branch",
    "Branches",
    "FoundPose",
    "FourBarClass",
    "Integrability",
    "Link",
    "Linkage",
    "Mobility",
    "ProjectedAcceleration",
    "Singularities",
    "SingularitiesAlong",
    "Trace",
    "VelocityPartition",
    "MechanismClass",
    "acceleration_partition",
    "assemble",
    "branches",
    "classify",
    "find_pose",
    "four_bar",
    "independent_velocities",
    "integrability",
    "link_angles",
    "link_jacobians",
    "link_rates",
    "mobility",
    "n_four_bar",
    "pin_forces",
    "project_acceleration",
    "project_velocity",
    "singularities",
    "singularities_along",
    "slider_crank",
    "trace",
    "velocity_partition",
    "with_link_angles",
]


__getattr__ = _partial(_submodule, __name__)
