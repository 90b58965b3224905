"""Robots in contact: Gauss's least-constraint problem on Pinocchio and ProxSuite, every answer with its certificate.

`import rbd` loads almost no module: a name, or a sub-package, is loaded on first use.
"""

from typing import TYPE_CHECKING as _TYPE_CHECKING

from rbd.displayed import drawn_by as _drawn_by
from rbd.installation import VERSION as _VERSION, check_place as _check_place
from rbd.modules import named as _named, submodule as _submodule

_check_place()  # a wrong Pinocchio is reported before it causes errors
_drawn_by(lambda: _submodule(__name__, "visual"))

if _TYPE_CHECKING:
    from rbd.answers.least_constraint import (
        gauss_problem as gauss_problem,
        solve as solve,
        solve_problem as solve_problem,
    )
    from rbd.answers.many.solving import (
        solve_many as solve_many,
    )
    from rbd.answers.solution import (
        Solution as Solution,
    )
    from rbd.audits.auditing import audit as audit
    from rbd.constraints import (
        CollisionContacts as CollisionContacts,
        DrivenJoint as DrivenJoint,
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
        Terrain as Terrain,
        VelocityConstraint as VelocityConstraint,
    )
    from rbd.constraints.forces import (
        Bushing as Bushing,
        Damper as Damper,
        JointDamping as JointDamping,
        JointSpring as JointSpring,
        Spring as Spring,
    )
    from rbd.control.torques import (
        inverse_dynamics as inverse_dynamics,
    )
    from rbd.errors import (
        CannotHold as CannotHold,
        CannotMove as CannotMove,
        InputError as InputError,
        NoSolution as NoSolution,
        RbdError as RbdError,
    )
    from rbd.mechanism.pose_search import (
        find_pose as find_pose,
    )
    from rbd.mechanism.small_motion.finding import (
        find_equilibrium as find_equilibrium,
        find_steady_motion as find_steady_motion,
    )
    from rbd.mechanism.small_motion.linearisation import (
        linearise as linearise,
    )
    from rbd.model import dynamics as dynamics
    from rbd.model.external import (
        ExternalForce as ExternalForce,
    )
    from rbd.model.motors import (
        Motor as Motor,
    )
    from rbd.model.state import (
        State as State,
    )
    from rbd.motion.checking import (
        check_motion as check_motion,
    )
    from rbd.motion.identification import (
        identify as identify,
    )
    from rbd.motion.measured import (
        estimate_forces as estimate_forces,
    )
    from rbd.motion.reference_motion import Motion as Motion
    from rbd.planning.planned_motion import plan as plan
    from rbd.problem.gauss_problem import GaussProblem as GaussProblem
    from rbd.problem.ground import (
        Body as Body,
        Ground as Ground,
    )
    from rbd.problem.motions import (
        Speed as Speed,
    )
    from rbd.problem.rows import (
        Rows as Rows,
    )
    from rbd.robots.building.builder import (
        RobotBuilder as RobotBuilder,
    )
    from rbd.robots.carried import Carried as Carried
    from rbd.robots.loading import (
        doctor as doctor,
        load_robot as load_robot,
    )
    from rbd.robots.loop_file import (
        register_constraint as register_constraint,
    )
    from rbd.robots.robot import (
        Robot as Robot,
    )
    from rbd.simulation import (
        DormandPrince8 as DormandPrince8,
        RungeKutta4 as RungeKutta4,
        TimeStepping as TimeStepping,
        Trajectory as Trajectory,
        impact as impact,
        simulate as simulate,
    )
    from rbd.solvers.admm import (
        ConeSolver as ConeSolver,
    )
    from rbd.solvers.kkt import (
        KKT as KKT,
    )
    from rbd.solvers.proxqp import (
        ProxQP as ProxQP,
    )
    from rbd.statics.actuation import (
        Actuation as Actuation,
    )
    from rbd.statics.equilibrium import (
        hold as hold,
    )
    from rbd.studies.draws import (
        sample as sample,
    )
    from rbd.studies.running import (
        study as study,
    )
    from rbd.studies.samples import (
        grid as grid,
    )
    from rbd.worlds.simulating import simulate_many as simulate_many

__version__ = _VERSION

_NAMES = {
    "rbd.audits.auditing": "audit",
    "rbd.constraints": """
        CollisionContacts DrivenJoint FunctionConstraint JointCoupling JointFriction JointLimit JointLock KnifeEdge LineContact
        LoopClosure PointContact RollingBall RollingDisk RollingWheel SurfaceContact Terrain
        VelocityConstraint
    """,
    "rbd.control.torques": "inverse_dynamics",
    "rbd.errors": "CannotHold CannotMove InputError NoSolution RbdError",
    "rbd.constraints.forces": "Bushing Damper JointDamping JointSpring Spring",
    "rbd.motion.identification": "identify",
    "rbd.answers.least_constraint": "gauss_problem solve solve_problem",
    "rbd.answers.many.solving": "solve_many",
    "rbd.mechanism.pose_search": "find_pose",
    "rbd.model": "dynamics",
    "rbd.model.external": "ExternalForce",
    "rbd.model.motors": "Motor",
    "rbd.model.state": "State",
    "rbd.motion.checking": "check_motion",
    "rbd.motion.measured": "estimate_forces",
    "rbd.motion.reference_motion": "Motion",
    "rbd.planning.planned_motion": "plan",
    "rbd.problem.ground": "Body Ground",
    "rbd.problem.gauss_problem": "GaussProblem",
    "rbd.problem.motions": "Speed",
    "rbd.problem.rows": "Rows",
    "rbd.robots.building.builder": "RobotBuilder",
    "rbd.robots.carried": "Carried",
    "rbd.robots.loop_file": "register_constraint",
    "rbd.robots.loading": "doctor load_robot",
    "rbd.robots.robot": "Robot",
    "rbd.simulation": "DormandPrince8 RungeKutta4 TimeStepping Trajectory impact simulate",
    "rbd.mechanism.small_motion.finding": "find_equilibrium find_steady_motion",
    "rbd.mechanism.small_motion.linearisation": "linearise",
    "rbd.answers.solution": "Solution",
    "rbd.solvers.admm": "ConeSolver",
    "rbd.solvers.kkt": "KKT",
    "rbd.solvers.proxqp": "ProxQP",
    "rbd.statics.actuation": "Actuation",
    "rbd.statics.equilibrium": "hold",
    "rbd.studies.draws": "sample",
    "rbd.studies.running": "study",
    "rbd.studies.samples": "grid",
    "rbd.worlds.simulating": "simulate_many",
}
"""Top-level names by module; the imports above are the same for type checkers."""
_HOME = {name: module for module, names in _NAMES.items() for name in names.split()}

__all__ = sorted(_HOME)  # noqa: PLE0605


def __getattr__(name: str) -> object:
    """A name from its module, or a module of the package, on first use."""
    globals()[name] = found = _named(__name__, _HOME, name)
    return found


def __dir__() -> list[str]:
    from pkgutil import iter_modules

    return sorted(
        {*globals(), *__all__, *(module.name for module in iter_modules(__path__) if not module.name.startswith("_"))}
    )
