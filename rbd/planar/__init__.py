"""Planar chains of n links, in symbols: kinematics, constraints, dynamics and motion, tied to URDF and Pinocchio.

Needs the extra `symbolic`: pip install "rbd-contact[symbolic]".
"""

from functools import partial as _partial

from rbd.modules import submodule as _submodule

try:
    import sympy as _sympy  # noqa: F401
except ImportError:
    raise ImportError(
        'rbd.planar works with symbols, and SymPy is not installed. Install the extra: pip install "rbd-contact[symbolic]".'
    ) from None

# isort: split
from rbd.planar.angles import AngleMap
from rbd.planar.bodies import LinkBodies
from rbd.planar.chain import Chain
from rbd.planar.classification import ChainClass, classify
from rbd.planar.constrained_chain import ConstrainedChain, constrained
from rbd.planar.equations_of_motion import Dynamics, LinearisedChain, PlanarModes, dynamics
from rbd.planar.inverse_kinematics import Inverse, inverse, inverse_formulas
from rbd.planar.joint_derivatives import joint_rates
from rbd.planar.kinematics import Split, jacobian
from rbd.planar.numeric import Ellipse
from rbd.planar.path_following import InversePath, MinimumJerk, Peaks, inverse_path, minimum_jerk
from rbd.planar.planned_motion import PlanarMotion, endpoint_motion, joint_motion
from rbd.planar.robot_file import robot_coordinates, to_robot, to_urdf

__all__ = [
    "AngleMap",
    "LinkBodies",
    "Chain",
    "ChainClass",
    "ConstrainedChain",
    "Dynamics",
    "Ellipse",
    "Inverse",
    "InversePath",
    "LinearisedChain",
    "MinimumJerk",
    "PlanarModes",
    "Peaks",
    "PlanarMotion",
    "Split",
    "classify",
    "constrained",
    "dynamics",
    "endpoint_motion",
    "inverse",
    "inverse_formulas",
    "inverse_path",
    "jacobian",
    "joint_motion",
    "joint_rates",
    "minimum_jerk",
    "robot_coordinates",
    "to_robot",
    "to_urdf",
]


__getattr__ = _partial(_submodule, __name__)
