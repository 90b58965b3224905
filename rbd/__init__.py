"""Robots in contact: Gauss's least-constraint problem on Pinocchio and ProxSuite, every answer with its proof."""

from rbd import engine as _engine  # noqa: F401  first: another Pinocchio than ours is named before anything breaks

# isort: split
from rbd import dynamics, errors
from rbd.cones import Box, Free, FrictionCone, LineCone, NonNegative, Product, WrenchCone
from rbd.constraints import PointContact, SurfaceContact
from rbd.doctor import Finding, Report, doctor
from rbd.equilibrium import Hold, hold
from rbd.errors import (
    CannotHold,
    ContactMoves,
    DuplicateName,
    EffortLimitWarning,
    FrameNotFound,
    InaccurateWarning,
    InputError,
    JointNotFound,
    ModelError,
    ModelWarning,
    NoSolution,
    NotAtRest,
    RbdError,
    RbdWarning,
    SingularInertia,
    UnknownName,
    UnknownRobot,
    Unsupported,
    WrongPinocchio,
)
from rbd.external import ExternalForce
from rbd.least_constraint import gauss_problem, solve
from rbd.problem import GaussProblem
from rbd.robot import Robot, load_robot
from rbd.rows import Rows
from rbd.solution import Solution, Status
from rbd.solvers.kkt import KKT
from rbd.solvers.proxqp import ProxQP
from rbd.state import State
from rbd.xml_file import FileLimits

__version__ = "0.1.0"

__all__ = [
    "KKT",
    "Box",
    "CannotHold",
    "ContactMoves",
    "DuplicateName",
    "EffortLimitWarning",
    "ExternalForce",
    "FileLimits",
    "Finding",
    "FrameNotFound",
    "Free",
    "FrictionCone",
    "GaussProblem",
    "Hold",
    "InaccurateWarning",
    "InputError",
    "JointNotFound",
    "LineCone",
    "ModelError",
    "ModelWarning",
    "NoSolution",
    "NonNegative",
    "NotAtRest",
    "PointContact",
    "Product",
    "ProxQP",
    "RbdError",
    "RbdWarning",
    "Report",
    "Robot",
    "Rows",
    "SingularInertia",
    "Solution",
    "State",
    "Status",
    "SurfaceContact",
    "UnknownName",
    "UnknownRobot",
    "Unsupported",
    "WrenchCone",
    "WrongPinocchio",
    "__version__",
    "doctor",
    "dynamics",
    "errors",
    "gauss_problem",
    "hold",
    "load_robot",
    "solve",
]
