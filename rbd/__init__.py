"""Robots in contact: Gauss's least-constraint problem on Pinocchio and ProxSuite, every answer with its proof.

`import rbd` loads next to nothing: a name, or a sub-package, is loaded when it is first asked for.
"""

from importlib import import_module as _import_module
from typing import TYPE_CHECKING as _TYPE_CHECKING

from rbd.installation import VERSION as _VERSION, check_place as _check_place
from rbd.modules import submodule as _submodule

_check_place()  # another Pinocchio than ours is named before anything breaks

if _TYPE_CHECKING:
    from rbd.analysis.infeasibility import Contradiction as Contradiction, contradiction as contradiction
    from rbd.analysis.sensitivity import Derivatives as Derivatives
    from rbd.analysis.uniqueness import Uniqueness as Uniqueness
    from rbd.constraints import (
        Baumgarte as Baumgarte,
        CollisionContacts as CollisionContacts,
        ContactPoints as ContactPoints,
        FunctionConstraint as FunctionConstraint,
        JointCoupling as JointCoupling,
        JointFriction as JointFriction,
        JointLimit as JointLimit,
        JointLock as JointLock,
        KnifeEdge as KnifeEdge,
        LineContact as LineContact,
        LoopClosure as LoopClosure,
        PointContact as PointContact,
        RollingBall as RollingBall,
        RollingDisk as RollingDisk,
        RollingWheel as RollingWheel,
        SurfaceContact as SurfaceContact,
        VelocityConstraint as VelocityConstraint,
        joint_frictions as joint_frictions,
        joint_limits as joint_limits,
        mimics as mimics,
    )
    from rbd.control import (
        HoldPosture as HoldPosture,
        Push as Push,
        Pushes as Pushes,
        Sampled as Sampled,
        TorqueScript as TorqueScript,
    )
    from rbd.errors import (
        CannotAssemble as CannotAssemble,
        CannotHold as CannotHold,
        ContactMoves as ContactMoves,
        DistantContactWarning as DistantContactWarning,
        DuplicateName as DuplicateName,
        EffortLimitWarning as EffortLimitWarning,
        FrameNotFound as FrameNotFound,
        InaccurateWarning as InaccurateWarning,
        InputError as InputError,
        JointNotFound as JointNotFound,
        LoopNotClosedWarning as LoopNotClosedWarning,
        ModelError as ModelError,
        ModelWarning as ModelWarning,
        NonUniqueMotionWarning as NonUniqueMotionWarning,
        NoSolution as NoSolution,
        NotAtRest as NotAtRest,
        NotDifferentiable as NotDifferentiable,
        OpeningContactWarning as OpeningContactWarning,
        RbdError as RbdError,
        RbdWarning as RbdWarning,
        SimulationStopped as SimulationStopped,
        SingularInertia as SingularInertia,
        SingularPose as SingularPose,
        UnknownName as UnknownName,
        UnknownRobot as UnknownRobot,
        Unsupported as Unsupported,
        WrongPinocchio as WrongPinocchio,
    )
    from rbd.least_constraint import gauss_problem as gauss_problem, solve as solve, solve_problem as solve_problem
    from rbd.model import dynamics as dynamics
    from rbd.model.external_force import ExternalForce as ExternalForce
    from rbd.model.state import State as State
    from rbd.model.xml import FileLimits as FileLimits
    from rbd.problem.answer import Answer as Answer, Status as Status
    from rbd.problem.cones import (
        Box as Box,
        Free as Free,
        FrictionCone as FrictionCone,
        LineCone as LineCone,
        NonNegative as NonNegative,
        Product as Product,
        WrenchCone as WrenchCone,
    )
    from rbd.problem.ground import Ground as Ground
    from rbd.problem.problem import GaussProblem as GaussProblem
    from rbd.problem.rows import Rows as Rows
    from rbd.robots.checkup import doctor as doctor
    from rbd.robots.diagnosis import Finding as Finding, Report as Report
    from rbd.robots.merge import Pair as Pair, combine as combine
    from rbd.robots.robot import Robot as Robot, load_robot as load_robot
    from rbd.simulation import (
        DormandPrince8 as DormandPrince8,
        Event as Event,
        Projection as Projection,
        RungeKutta4 as RungeKutta4,
        TimeStepping as TimeStepping,
        Trajectory as Trajectory,
        simulate as simulate,
    )
    from rbd.solution import NearestMotion as NearestMotion, Solution as Solution, nearest_motion as nearest_motion
    from rbd.solvers.admm import ConeSolver as ConeSolver
    from rbd.solvers.kkt import KKT as KKT
    from rbd.solvers.proxqp import ProxQP as ProxQP
    from rbd.statics.equilibrium import Hold as Hold, hold as hold
    from rbd.studies.agreement import Agreement as Agreement, agree as agree
    from rbd.studies.laws import LawComparison as LawComparison, compare_laws as compare_laws

__version__ = _VERSION

_NAMES = {
    "rbd.analysis.infeasibility": "Contradiction contradiction",
    "rbd.analysis.sensitivity": "Derivatives",
    "rbd.analysis.uniqueness": "Uniqueness",
    "rbd.constraints": """
        Baumgarte CollisionContacts ContactPoints FunctionConstraint JointCoupling JointFriction JointLimit JointLock
        KnifeEdge LineContact LoopClosure PointContact RollingBall RollingDisk RollingWheel SurfaceContact
        VelocityConstraint joint_frictions joint_limits mimics
    """,
    "rbd.control": "HoldPosture Push Pushes Sampled TorqueScript",
    "rbd.errors": """
        CannotAssemble CannotHold ContactMoves DistantContactWarning DuplicateName EffortLimitWarning FrameNotFound
        InaccurateWarning InputError JointNotFound ModelError ModelWarning NoSolution NotAtRest NotDifferentiable
        LoopNotClosedWarning OpeningContactWarning RbdError RbdWarning NonUniqueMotionWarning SimulationStopped
        SingularInertia SingularPose UnknownName UnknownRobot Unsupported WrongPinocchio
    """,
    "rbd.least_constraint": "gauss_problem solve solve_problem",
    "rbd.model.external_force": "ExternalForce",
    "rbd.model.state": "State",
    "rbd.model.xml": "FileLimits",
    "rbd.problem.answer": "Answer Status",
    "rbd.problem.cones": "Box Free FrictionCone LineCone NonNegative Product WrenchCone",
    "rbd.problem.ground": "Ground",
    "rbd.problem.problem": "GaussProblem",
    "rbd.problem.rows": "Rows",
    "rbd.robots.checkup": "doctor",
    "rbd.robots.diagnosis": "Finding Report",
    "rbd.robots.merge": "Pair combine",
    "rbd.robots.robot": "Robot load_robot",
    "rbd.simulation": "DormandPrince8 Event Projection RungeKutta4 TimeStepping Trajectory simulate",
    "rbd.solution": "NearestMotion Solution nearest_motion",
    "rbd.solvers.admm": "ConeSolver",
    "rbd.solvers.kkt": "KKT",
    "rbd.solvers.proxqp": "ProxQP",
    "rbd.statics.equilibrium": "Hold hold",
    "rbd.studies.agreement": "Agreement agree",
    "rbd.studies.laws": "LawComparison compare_laws",
}
"""What stands on top, by the module that it comes from; the imports above tell type checkers the same."""
_HOME = {name: module for module, names in _NAMES.items() for name in names.split()}

__all__ = sorted([*_HOME, "__version__", "dynamics", "errors"])  # noqa: PLE0605


def __getattr__(name: str) -> object:
    """A name from its module, or a module of the package, when it is first asked for."""
    if name in _HOME:
        found = getattr(_import_module(_HOME[name]), name)
    elif name == "dynamics":
        found = _submodule("rbd.model", "dynamics")
    else:
        return _submodule("rbd", name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    from pkgutil import iter_modules

    return sorted(
        {*globals(), *__all__, *(module.name for module in iter_modules(__path__) if not module.name.startswith("_"))}
    )
