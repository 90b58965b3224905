"""Planar chains of n links, in symbols: kinematics, constraints, dynamics and motion, tied to URDF and Pinocchio.

Needs the extra `symbolic`: pip install "rbd-contact[symbolic]".
"""

try:
    import sympy as _sympy  # noqa: F401
except ImportError:
    raise ImportError(
        'rbd.planar works with symbols, and SymPy is not installed. Install the extra: pip install "rbd-contact[symbolic]".'
    ) from None

# isort: split
from rbd.planar.angles import AngleMap
from rbd.planar.bodies import Bodies
from rbd.planar.chain import Chain
from rbd.planar.constrained import ConstrainedChain, constrained
from rbd.planar.dynamics import Dynamics, dynamics
from rbd.planar.ellipse import Ellipse
from rbd.planar.inverse import Inverse, inverse
from rbd.planar.inverse_path import InversePath, inverse_path
from rbd.planar.jacobian import jacobian
from rbd.planar.modes import Linearised, Modes
from rbd.planar.motion import PlanarMotion, endpoint_motion, joint_motion
from rbd.planar.quintic import MinimumJerk, Peaks, minimum_jerk
from rbd.planar.rates import joint_rates
from rbd.planar.split import Split
from rbd.planar.urdf import RobotCoordinates, robot_coordinates, to_urdf
from rbd.planar.words import PlanarWords, words

__all__ = [
    "AngleMap",
    "Bodies",
    "Chain",
    "ConstrainedChain",
    "Dynamics",
    "Ellipse",
    "Inverse",
    "InversePath",
    "Linearised",
    "MinimumJerk",
    "Modes",
    "Peaks",
    "PlanarMotion",
    "PlanarWords",
    "RobotCoordinates",
    "Split",
    "constrained",
    "dynamics",
    "endpoint_motion",
    "inverse",
    "inverse_path",
    "jacobian",
    "joint_motion",
    "joint_rates",
    "minimum_jerk",
    "robot_coordinates",
    "to_urdf",
    "words",
]
