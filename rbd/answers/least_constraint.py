"""`solve`: the acceleration and contact forces of a robot at one state, with their residuals."""

from __future__ import annotations

import time
import warnings
from collections.abc import Sequence
from functools import partial

import numpy as np

from rbd.answers.analysis.sensitivity import StateOrigin
from rbd.answers.prepared.constraint_dynamics import ConstraintDynamics, FoundForces, prepared
from rbd.answers.solution import Solution, nearest_motion, solution_of
from rbd.arrays import Array, max_abs
from rbd.constraints.constraint import Constraint, is_open, rows_of, with_loops
from rbd.constraints.distance_warnings import moves, warn_of_distant, warn_of_limits, warn_of_moving, warn_of_opening
from rbd.constraints.round_feet import warn_of_balls
from rbd.errors import (
    ContactMoves,
    EffortLimitWarning,
    InaccurateWarning,
    InputError,
    LoopNotClosedWarning,
    NonUniqueMotionWarning,
    NoSolution,
    Reason,
    Unsupported,
)
from rbd.model.checked_model import beyond_limit
from rbd.model.dynamics import free_force
from rbd.model.external import External, acting, generalised as generalised_force
from rbd.model.state import State
from rbd.problem.answer import Status
from rbd.problem.contact_motion import REST_SPEED
from rbd.problem.gauss_problem import BILATERAL, COULOMB, GaussProblem, Law, MomentumBalance, checked
from rbd.problem.ground import TOUCHES
from rbd.problem.residuals import SOLVED
from rbd.problem.rows import Rows
from rbd.solvers import Solver
from rbd.solvers.default import slip_law, solver_of


def solve(
    state: State,
    tau: Array | None,
    constraints: Sequence[Constraint] = (),
    *,
    law: Law | str | None = None,
    external: External = None,
    solver: Solver | None = None,
    check: bool = True,
    rest_speed: float = REST_SPEED,
    loops: bool = True,
) -> Solution:
    """Acceleration and constraint forces of a robot: M a + h = S^T tau + tau_ext + J^T f, forces f under a contact law.

    Under Coulomb's law, the default, Gauss's problem of least constraint is solved first, a QP with a unique answer::

        a = argmin 1/2 |a - a_free|_M^2 subject to J a + J_dot v in K*, forces in K as multipliers

    It is Coulomb's too if every point with friction is unloaded or sticks, with forces in the circular cones. If
    not, a solver with circular cones continues from it: friction opposes the slip of a point, which stays on the ground.
    Under the convex law the problem above is the law, with circular cones. `solution.law` and `solution.method` name law and
    method.

    Contacts on ground at rest, limits, locks, couplings and dry friction of joints, and motion without any, are prepared on
    first use and kept with the robot: their answers come from the few rows of the bodies and joints that they touch ("closed
    form" where all stick, else "cones: Newton") and are certified by inverse dynamics; `solution.problem` and
    `solution.residuals` are computed when they are first asked for, and so are the forces where they are not unique. All other
    problems are solved as above, and so are those whose certificate fails, or where points slide and may have several motions.

    Args:
        state: The robot at (q, v).
        tau: Motor torques, shape (nu,) [N, N m], None for zero; a warning is given beyond the effort limits.
        constraints: Contacts and other constraints, each with a different name.
        law: "coulomb", which is the default, or "convex" (Gauss's principle with circular cones): the law of contacts that can
            slip.
        external: Other forces of the world: generalised (nv,), or `ExternalForce` objects and springs
            (`rbd.constraints.forces`).
        solver: In place of the above: `ProxQP()`, only pyramids; `KKT()`, for bilateral constraints;
            `ConeSolver(law=...)`, circular cones alone; or your own. It has its law; if `law` is given too, it must be
            the same.
        check: Raise where there is no answer within 1e-7, scaled. False returns the best that was found.
        rest_speed: A contact that can break or slip is at rest up to this speed [m/s, rad/s]. One that moves away faster
            is inactive; friction opposes the motion of one that slides faster.
        loops: Whether the robot's own loops hold; one that is given counts once.

    Returns:
        The answer with its certificate, `solution.residuals`. Where several motions satisfy Coulomb's law a warning
        `NonUniqueMotionWarning` describes them; the others are in `solution.others`. If a contact separates
        its force is zero: an `OpeningContactWarning` names it, and so does `solution.opening`. A contact whose
        plane is known (`on=`, the feet of a robot) and that is more than a millimetre off it is solved as if it
        touched, with a `DistantContactWarning`. Bilateral constraints that move faster than `rest_speed` move on: a
        `MovingConstraintWarning` names them. A `JointLimitWarning` names joints beyond their limits, once a state.

    Raises:
        InputError: wrong sizes, NaN, unknown frames, two constraints of one name; a law that is not the solver's.
        ContactMoves: a contact approaches faster than `rest_speed`; under the convex law also one that slides faster.
            `rbd.mechanism.project_velocity` puts a velocity onto the contacts.
        Unsupported: the solver cannot take the problem.
        NoSolution: no answer within tolerance; names the constraints that contradict each other, or the worst row, carries
            problem, result and certificate, and gives the nearest motion: `error.contradiction`, `error.nearest()`.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> state, feet = solo.standing(), solo.feet(friction=0.7)
        >>> solution = rbd.solve(state, np.zeros(solo.nu), feet)  # no torques: the legs give way
        >>> print(solution.status, solution.law, f"{solution.a[2]:.3f} m/s2")
        solved coulomb -10.050 m/s2
        >>> solution.forces["front_left"].round(3)
        array([-0.342, -0.03 ,  0.575])
    """
    _check_is_bool(check)
    plain = solver is None and isinstance(loops, bool) and type(rest_speed) is float and 0.0 <= rest_speed < 1e100
    if plain and isinstance(constraints, list | tuple) and type(state) is State:
        robot = state.robot
        given = with_loops(robot, constraints, loops) if robot.loops() else tuple(constraints)
        form = prepared(robot, given)
        found = None if form is None else _prepared_answer(form, state, tau, given, law, external, rest_speed)
        if found is not None:
            return found
    chosen = solver_of(law, solver)
    return answered(assembled(state, tau, constraints, external, rest_speed, loops), chosen, check=check)


def _prepared_answer(
    constraints: ConstraintDynamics,
    state: State,
    tau: Array | None,
    given: tuple[Constraint, ...],
    law: Law | str | None,
    external: External,
    rest_speed: float,
) -> Solution | None:
    """The answer by the contacts' prepared form; None where it has none that is certified."""
    robot = state.robot
    torques = robot.check_tau(tau)
    asked = COULOMB if law is None else slip_law(law)
    answer = prepared_solution(constraints, state, torques, given, asked, external, rest_speed)
    if answer is None:
        return None
    solution, found = answer
    _warn_of_effort(state, torques)
    warn_of_balls(state, given, stacklevel=4)
    if not state.limits_checked:
        warn_of_limits(state, given, stacklevel=4)
    if found.moving:
        warn_of_moving(robot, [(given[i].name, speed) for i, speed in found.moving], stacklevel=3)
    warn_of_opening(robot, found.openings, rest_speed, stacklevel=3)
    return solution


def prepared_solution(
    constraints: ConstraintDynamics, state: State, torques: Array, given: tuple[Constraint, ...], law: Law,
    external: External, rest_speed: float, *, within: float = TOUCHES, mu: Array | None = None,
) -> tuple[Solution, FoundForces] | None:  # fmt: skip
    """The answer by the prepared form of constraints, without warnings; arguments as of `solve` and of `Plan.answer`."""
    start, generalised = time.perf_counter(), np.zeros(state.robot.nv)
    generalised[state.robot.motors] = torques
    external = tuple(external) if type(external) is list else external
    force, pushes, elements = acting(external)
    if force is not None or elements:
        generalised += generalised_force(state, elements if force is None else external)[0]
    plan = constraints.plan(state.q)
    found = plan.answer(
        state.q, state.v, generalised, pushes, coulomb=law == COULOMB, rest_speed=rest_speed, within=within, mu=mu, t=state.t
    )  # fmt: skip
    if found is None:
        return None
    problem = partial(posed, state, torques, given, external, rest_speed)
    told = BILATERAL if plan.bilateral else law
    solution = Solution.prepared(problem, found, told, time.perf_counter() - start)
    return (solution, found) if found.worst <= SOLVED or solution.residuals.within(SOLVED) else None


def solve_problem(
    problem: GaussProblem,
    *,
    law: Law | str | None = None,
    solver: Solver | None = None,
    check: bool = True,
) -> Solution:
    """Acceleration and constraint forces of a problem in arrays: built by hand, or by `gauss_problem`.

    Args:
        problem: The arrays; no robot is needed.
        law: As in `solve`.
        solver: As in `solve`.
        check: As in `solve`.

    Returns:
        The answer with its certificate, `solution.residuals`; warnings as `solve`.

    Raises:
        InputError: if it is no problem, or no solver; a law that is not the solver's.
        ContactMoves: as `solve`.
        Unsupported: as `solve`.
        NoSolution: as `solve`.

    Example:
        >>> wall = rbd.Rows("wall", J=np.array([[-1.0, 0.0]]), bias=np.zeros(1), cone=rbd.problem.NonNegative(1))
        >>> problem = rbd.GaussProblem(M=np.diag([2.0, 1.0]), rhs=np.array([6.0, 1.0]), rows=[wall])
        >>> solution = rbd.solve_problem(problem)
        >>> solution.a, solution.forces["wall"]
        (array([0., 1.]), array([6.]))
    """
    return answered(checked(problem), solver_of(law, solver), check=check)


def answered(problem: GaussProblem, solver: Solver, *, check: bool = True) -> Solution:
    """The checked answer to a problem; errors and warnings as `solve`, which calls it."""
    _check_is_bool(check)
    refuse_moving(problem, solver)
    reason = solver.reason_unsupported(problem)
    if reason is not None:
        raise Unsupported(reason)
    solution = solution_of(problem, solver)
    if solution.status is not Status.SOLVED and check:
        _complain(solution, solver)
    if solution.others:
        warnings.warn(
            f"{_name(problem)} has no one motion: {solution.reason or f'{1 + len(solution.others)} were found'}. "
            "`solution.others` has all but the first.",
            NonUniqueMotionWarning,
            stacklevel=3,
        )
    return solution


def _check_is_bool(check: object) -> None:
    if not isinstance(check, bool):
        raise InputError(f"check is {check!r:.80}; expected True or False.")


def _name(problem: GaussProblem) -> str:
    return problem.origin.state.robot.name if isinstance(problem.origin, StateOrigin) else "the problem"


def gauss_problem(
    state: State,
    tau: Array | None,
    constraints: Sequence[Constraint] = (),
    *,
    external: External = None,
    rest_speed: float = REST_SPEED,
    loops: bool = True,
) -> GaussProblem:
    """The arrays of the least-constraint problem that `solve` poses: M, rhs and the rows of all constraints.

    Args:
        state: The robot at (q, v).
        tau: Motor torques, shape (nu,) [N, N m]; None: zero.
        constraints: Contacts and other constraints, each with a different name.
        external: Other forces of the world: generalised (nv,), or `ExternalForce` objects and springs
            (`rbd.constraints.forces`).
        rest_speed: As in `solve`.
        loops: Whether the robot's own loops hold; one that is given counts once.

    Raises:
        InputError: as `solve`.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> problem = rbd.gauss_problem(solo.standing(), np.zeros(solo.nu), solo.feet())
        >>> problem.M.shape, problem.J.shape, [rows.name for rows in problem.rows]
        ((18, 18), (12, 18), ['front_left', 'front_right', 'hind_left', 'hind_right'])
    """
    return assembled(state, tau, constraints, external, rest_speed, loops)


def assembled(
    state: State,
    tau: Array | None,
    constraints: Sequence[Constraint],
    external: External,
    rest_speed: float,
    loops: bool,
) -> GaussProblem:
    """As `gauss_problem`; its warnings name the line that called the caller."""
    if not isinstance(state, State):
        raise InputError(f"solve wants a State first, got {type(state).__name__}. Make one: rbd.State(robot, q, v).")
    rhs, wrench = free_force(state, tau, external)
    _warn_of_effort(state, state.robot.check_tau(tau))
    given = with_loops(state.robot, constraints, loops)
    rows = rows_of(state, given)
    _warn_of_open(given, rows)
    warn_of_limits(state, given, stacklevel=4)
    warn_of_distant(state, given, rows, stacklevel=4)
    external = tuple(external) if type(external) is list else external
    problem = _of_rows(state, rhs, wrench, rows, StateOrigin(state, given, external), rest_speed)
    warn_of_moving(state.robot, [(r.name, r.speed) for r in rows if moves(r, rest_speed)], stacklevel=3)
    warn_of_opening(state.robot, problem.openings, rest_speed, stacklevel=3)
    return problem


def _of_rows(state: State, rhs: Array, wrench: Array, rows: list[Rows], origin: StateOrigin, rest_speed: float) -> GaussProblem:
    loose = any([r.resultant is None or r.patch is None for r in rows])
    balance = momentum_balance(state, wrench, with_base=loose)
    return GaussProblem(state.M, rhs, rows, balance, origin, rest_speed, from_state=state.robot.sound)


def posed(state: State, tau: Array, constraints: tuple[Constraint, ...], external: External, rest_speed: float) -> GaussProblem:
    """As `assembled`, of what has been checked, without warnings."""
    rhs, wrench = free_force(state, tau, external)
    return _of_rows(state, rhs, wrench, rows_of(state, constraints), StateOrigin(state, constraints, external), rest_speed)


def momentum_balance(state: State, wrench: Array, *, with_base: bool = True) -> MomentumBalance | None:
    """The data of the centroidal residual; None unless all bodies are on floating bases.

    Of two robots in one model it is that of both together.

    Args:
        state: The robot at (q, v).
        wrench: External wrench about the centre of mass, world axes, shape (6,); the weight is added here.
        with_base: Give the base's pose too: some rows have no resultant. With two bases the result is then None.
    """
    robot = state.robot
    if not robot.bases or (with_base and not robot.floating):
        return None
    A_g, rate_bias, mass = state.centroidal()
    total = wrench.copy()
    total[:3] += mass * robot.model.gravity.linear  # the mass is at hand: robot.weight sums all bodies' again
    base = None
    if with_base:
        X_WB = state.base_pose()
        base = X_WB.translation, X_WB.rotation
    return MomentumBalance(A_g, rate_bias, total, state.com, base)


def _warn_of_open(constraints: tuple[Constraint, ...], rows: Sequence[Rows]) -> None:
    for constraint, r in zip(constraints, rows, strict=True):
        if is_open(constraint, r):
            assert r.error is not None
            warnings.warn(
                f"loop {r.name!r} is open by {max_abs(r.error):.3g} (m, or rad) at this state, and is solved as it stands. "
                "rbd.mechanism.assemble(state) closes it; rbd.constraints.Baumgarte reduces the error over time; loops=False "
                "leaves a robot's own loops out.",
                LoopNotClosedWarning,
                stacklevel=4,
            )


def _warn_of_effort(state: State, tau: Array) -> None:
    robot = state.robot
    used = robot.torque_use(tau, state.v) if robot.torque_lines else tau / robot.effort_limit
    if max_abs(used) > 1.0:
        used = np.abs(used)
        worst, beyond = int(np.argmax(used)), int((used > 1.0).sum())
        warnings.warn(
            f"tau of {robot.actuated_names[worst]} is {beyond_limit(robot, worst, float(tau[worst]), state.v)}; "
            f"{beyond} of {robot.nu} motors are beyond theirs.",
            EffortLimitWarning,
            stacklevel=4,  # the line that called `solve` or `gauss_problem`
        )


def refuse_moving(problem: GaussProblem, solver: Solver) -> None:
    """Refuse impacts; and, under the convex law, sliding contacts."""
    T, rest = problem.force_set, problem.rest_speed
    if T.impact:
        raise ContactMoves(
            f"contact {T.impact} (at rest is up to rest_speed = {rest:g} m/s). Put the velocity onto the contacts, "
            "rbd.mechanism.project_velocity(state, contacts), give a larger rest_speed=, or simulate the impact, rbd.simulate.",
            reason=Reason.CONTACT_MOVES_IMPACT,
        )
    if not T.slipping or (law := Law.of(solver.law)) == COULOMB:  # separating contacts have no force, under any law
        return
    r = problem.rows[T.slipping[0]]
    raise ContactMoves(
        f"contact {r.name!r} moves at {r.speed:.3g} m/s (at rest is up to rest_speed = {rest:g}), and it can slip or break: "
        f"under the {law} law only contacts at rest are solved. Under Coulomb's, the default, friction follows the motion: "
        "leave out law= and solver=. Or take friction=None for a bilateral contact; a larger rest_speed=; or put the velocity "
        "onto the contacts: "
        "rbd.mechanism.project_velocity(state, contacts).",
        reason=Reason.CONTACT_MOVES_SLIDES,
    )


def _complain(solution: Solution, solver: Solver) -> None:
    res = solution.residuals
    scaled = ", ".join(f"{name} {value:.1e}" for name, value in res.scaled.items())
    if solution.status is Status.INACCURATE:
        warnings.warn(
            f"{solution.solver} is inaccurate on {_name(solution.problem)}: scaled residuals {scaled} (solved is 1e-9).",
            InaccurateWarning,
            stacklevel=4,
        )
        return
    raise NoSolution(
        f"{_why(solution)} ({solution.solver}, law {solution.law}; scaled residuals {scaled}).{_what_to_do(solution)}",
        problem=solution.problem,
        result=solution,
        contradiction=solution.contradiction,
        nearest=partial(nearest_motion, solution.problem, solver=solver),
        reason=solution.status.reason,
    )


def _why(solution: Solution) -> str:
    found = solution.contradiction
    if found is not None:
        return f"{solution.worst}: no acceleration satisfies the constraints together, as {found.claim}"
    return solution.reason or f"{solution.worst}: no answer within tolerance"


def _what_to_do(solution: Solution) -> str:
    found = solution.contradiction
    if found is None:
        return ""
    out = " The certificate is `error.contradiction`, the motion that violates them least `error.nearest()`."
    if found.unmet_most:
        out += f" {found.unmet_most}"
    points = [r.patch for r in solution.problem.rows if r.name in found.rows and r.patch is not None]
    if found.unmet_most and sum(p.friction is None and len(p.corners) == 1 for p in points) > 1:
        out += " Bilateral points of a body contradict each other when it turns: a sole is one SurfaceContact, not four points."
    return out
