"""Robots in contact: Gauss's least-constraint problem on Pinocchio and ProxSuite, every answer with its proof."""

from importlib import import_module as _import_module

from rbd.model import installation as _engine  # noqa: F401  first: another Pinocchio than ours is named before anything breaks

# isort: split
from rbd import errors, mechanism
from rbd.analysis.contradiction import Contradiction, contradiction
from rbd.analysis.nearest import NearestMotion, nearest_motion
from rbd.analysis.sensitivity import Derivatives
from rbd.analysis.uniqueness import Uniqueness
from rbd.constraints import (
    Baumgarte,
    CollisionContacts,
    ContactPoints,
    FunctionConstraint,
    JointCoupling,
    JointFriction,
    JointLimit,
    JointLock,
    KnifeEdge,
    LineContact,
    LoopClosure,
    PointContact,
    RollingBall,
    RollingDisk,
    RollingWheel,
    SurfaceContact,
    VelocityConstraint,
    joint_frictions,
    joint_limits,
    mimics,
)
from rbd.control import HoldPosture, Push, Pushes, Sampled, TorqueScript
from rbd.errors import (
    CannotAssemble,
    CannotHold,
    ContactMoves,
    DistantContactWarning,
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
    NotDifferentiable,
    OpeningContactWarning,
    OpenLoop,
    RbdError,
    RbdWarning,
    SeveralMotions,
    SimulationStopped,
    SingularInertia,
    SingularPose,
    UnknownName,
    UnknownRobot,
    Unsupported,
    WrongPinocchio,
)
from rbd.least_constraint import gauss_problem, solve
from rbd.model import dynamics
from rbd.model.external_force import ExternalForce
from rbd.model.state import State
from rbd.model.xml import FileLimits
from rbd.problem.cones import Box, Free, FrictionCone, LineCone, NonNegative, Product, WrenchCone
from rbd.problem.ground import Ground
from rbd.problem.problem import GaussProblem
from rbd.problem.rows import Rows
from rbd.robots.diagnosis import Finding, Report, doctor
from rbd.robots.merge import Pair, combine
from rbd.robots.robot import Robot, load_robot
from rbd.simulation import Adaptive, Event, Projection, RungeKutta4, TimeStepping, Trajectory, simulate
from rbd.solution import Solution, Status
from rbd.solvers.admm import ADMM
from rbd.solvers.kkt import KKT
from rbd.solvers.proxqp import ProxQP
from rbd.statics.equilibrium import Hold, hold
from rbd.studies.agreement import Agreement, agree
from rbd.studies.laws import LawComparison, compare_laws

__version__ = "0.1.0"

__all__ = [
    "ADMM",
    "Adaptive",
    "Agreement",
    "Baumgarte",
    "Box",
    "CannotAssemble",
    "CannotHold",
    "CollisionContacts",
    "ContactMoves",
    "ContactPoints",
    "Contradiction",
    "Derivatives",
    "DistantContactWarning",
    "DuplicateName",
    "EffortLimitWarning",
    "Event",
    "ExternalForce",
    "FileLimits",
    "Finding",
    "FrameNotFound",
    "Free",
    "FrictionCone",
    "FunctionConstraint",
    "GaussProblem",
    "Ground",
    "Hold",
    "HoldPosture",
    "InaccurateWarning",
    "InputError",
    "JointCoupling",
    "JointFriction",
    "JointLimit",
    "JointLock",
    "JointNotFound",
    "KKT",
    "KnifeEdge",
    "LawComparison",
    "LineCone",
    "LineContact",
    "LoopClosure",
    "ModelError",
    "ModelWarning",
    "NearestMotion",
    "NoSolution",
    "NonNegative",
    "NotAtRest",
    "NotDifferentiable",
    "OpenLoop",
    "OpeningContactWarning",
    "Pair",
    "PointContact",
    "Product",
    "Projection",
    "ProxQP",
    "Push",
    "Pushes",
    "RbdError",
    "RbdWarning",
    "Report",
    "Robot",
    "RollingBall",
    "RollingDisk",
    "RollingWheel",
    "Rows",
    "RungeKutta4",
    "Sampled",
    "SeveralMotions",
    "SimulationStopped",
    "SingularInertia",
    "SingularPose",
    "Solution",
    "State",
    "Status",
    "SurfaceContact",
    "TimeStepping",
    "TorqueScript",
    "Trajectory",
    "Uniqueness",
    "UnknownName",
    "UnknownRobot",
    "Unsupported",
    "VelocityConstraint",
    "WrenchCone",
    "WrongPinocchio",
    "__version__",
    "agree",
    "combine",
    "compare_laws",
    "contradiction",
    "doctor",
    "dynamics",
    "errors",
    "gauss_problem",
    "hold",
    "joint_frictions",
    "joint_limits",
    "load_robot",
    "mechanism",
    "mimics",
    "nearest_motion",
    "simulate",
    "solve",
]


def __getattr__(name: str) -> object:
    """`rbd.planar` when it is first asked for: it needs SymPy, an extra."""
    if name == "planar":
        return _import_module("rbd.planar")
    raise AttributeError(f"module 'rbd' has no attribute {name!r}")
