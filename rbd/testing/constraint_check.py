"""`check_constraint` and `check_task`: rows and J_dot v against the motion that they are about."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_array
from rbd.constraints.constraint import Constraint, is_timed
from rbd.control.task_terms import Task, TaskTerms
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.model.state import State, checked
from rbd.problem.rows import Patch, Rows
from rbd.testing.solver_check import ConstraintWrong, ContractBroken, TaskWrong, corner_rays

STEPS = (5e-3, 6e-4, 8e-5)
"""Time steps of the differences [s]. With speeds of order one, rounding and truncation both stay below 1e-9 at the first. The
others are tried if it finds a deviation: an error that jumps nearby (an angle at half a turn) is no fault of J, and a
wrong J is as wrong at any step."""

_AT = np.arange(-3, 4)
_FIRST = np.array([-1.0, 9.0, -45.0, 0.0, 45.0, -9.0, 1.0]) / 60.0  # sixth order, over the step
_SECOND = np.array([2.0, -27.0, 270.0, -490.0, 270.0, -27.0, 2.0]) / 180.0  # sixth order, over its square


def _first(values: Array, step: float) -> Array:
    """The derivative at the middle of seven values, a step apart, shape (m,)."""
    return np.asarray(_FIRST @ values) / step


def _second(values: Array, step: float) -> Array:
    """The second derivative there."""
    return np.asarray(_SECOND @ values) / step**2


def _curve(state: State, v: Array, a: Array, step: float) -> list[State]:
    """Seven configurations of q (+) (v t + a t^2 / 2), a step apart, that of the state in the middle."""
    robot, q, now = state.robot, state.q, state.t
    return [State(robot, pin.integrate(robot.model, q, v * t + 0.5 * a * t * t), t=now) for t in step * _AT]


Compared = dict[str, tuple[Array, Array]]
"""{what: (as the rows give it, as the motion has it), shapes (m,)}."""


def _agreeing(
    name: str, compare: Callable[[float], tuple[Compared, str]], tolerance: float, error: type[ContractBroken]
) -> tuple[dict[str, float], str]:
    """({what: largest deviation}, what the motion is of) at the first step at which all are within the tolerance.

    Args:
        name: Of the constraint or task.
        compare: Gives the values at a step of the differences [s], and what they are compared with, in words.
        tolerance: Largest deviation.
        error: What is raised.

    Raises:
        ContractBroken: `error`, with the first deviation at the first step.
    """
    wrong = ""
    for step in STEPS:
        compared, against = compare(step)
        found = {what: deviations(*pair) for what, pair in compared.items()}
        bad = [what for what, gap in found.items() if not gap.max() <= tolerance]
        if not bad:
            return {what: float(gap.max()) for what, gap in found.items()}, against
        given, seen = compared[bad[0]]
        i = int(np.argmax(found[bad[0]]))
        wrong = wrong or (
            f"{name!r}: {bad[0]} of row {i} is {given[i]:.9g}, and {against} says {seen[i]:.9g} (tolerance {tolerance:g}). "
            "Look for a wrong sign, frame or axis, or a term left out."
        )
    raise error(wrong)


@dataclass(frozen=True)
class ConstraintReport(Displayed):
    """What `check_constraint` compared, and the largest deviations found, scaled as the tolerance is.

    Attributes:
        name: The constraint's name.
        rows: Number of rows.
        against: Reference of J and J_dot v: "motion of the patch", "motion of the error", or "its own J",
            where the rows give neither patch nor error: then only J_dot v was checked, and a wrong J passes.
        jacobian: Deviation of J v from the motion; None if there was no reference for J.
        velocity: Deviation of the rows' `velocity` from J v.
        jdot_v: Deviation of J a + J_dot v from the motion.

    Example:
        >>> leaning = rbd.State(rbd.testing.box(), [0, 0, 0.3, 0.1, 0.7, 0.1, 0.7])
        >>> report = rbd.testing.check_constraint(rbd.PointContact("corner", "box", offset=(0.2, 0.2, -0.1)), leaning)
        >>> report.rows, report.against, report.jacobian < 1e-7, report.jdot_v < 1e-7
        (3, 'motion of the patch', True, True)
    """

    name: str
    rows: int
    against: str
    jacobian: float | None
    velocity: float
    jdot_v: float


def check_constraint(
    constraint: Constraint, state: State, *, seed: int = 0, draws: int = 5, tolerance: float = 1e-7, moving: bool = True
) -> ConstraintReport:
    """Deviations of a constraint's J, velocity and J_dot v from motion along curves of the robot; raises if large.

    Along q(t) = q (+) (v t + a t^2 / 2) the velocity is v + a t up to t^2, on a floating base too (there v and a are in
    the base's axes). The contact's point and axes are differenced in t, to sixth order, without any Jacobian; an error that
    is known up to a `period` is followed past its jumps. Rows that
    have `patch` and `resultant` must give::

        J v            = resultant^T (p', w)
        J a + J_dot v  = resultant^T (p'', w')      with the patch's axes fixed, as in `bias`,

    p the patch's point and w the angular velocity of its axes (which turn with the body where the resultant is a
    wrench; where that has no moment about x, of the x axis only); for a contact with another body, relative to that
    body's frame. Rays of the force cone must push along the patch's normal. Rows with an `error` and no patch must give
    J v = error' and `J a + J_dot v = error''`. A patch with an error must give them too where its error is zero, the second
    where J v = 0. For rows with neither only J_dot v is checked, against the change of J; see the report's `against`.

    Of a contact with a surface whose motion is given, what its rows give at v = 0 is the surface's own, and is taken out of
    them first, together with what changes its sign with v: the Coriolis term of a surface that turns, which is not checked.
    Of a constraint that depends on time (`jump`), at v = 0 the velocity must be the rate of the error by time, and the bias
    that of the velocity.

    Args:
        constraint: The constraint to check.
        state: Where; a generic posture sees more than a symmetric one.
        seed: Of the drawn velocities and accelerations.
        draws: How many.
        tolerance: Largest deviation, over max(1, largest term).
        moving: False draws velocities with J v = 0 only: for rows in axes that turn, whose J_dot v is right only
            while the constraint is met.

    Raises:
        ConstraintWrong: with the row and the numbers.
        InputError: if the constraint has no rows at this state: no check is possible.

    Example:
        >>> state = rbd.State(rbd.testing.box(), [0.5, 0, 0, 0, 0, 0, 1])
        >>> wrong = rbd.FunctionConstraint("wrong", lambda q: q[0] ** 2, jacobian=lambda q: np.eye(6)[0] * q[0])  # 2 is missing
        >>> rbd.testing.check_constraint(wrong, state)
        Traceback (most recent call last):
            ...
        rbd.testing.solver_check.ConstraintWrong: ...
    """
    rng, nv = np.random.default_rng(seed), state.robot.nv
    rows = constraint.rows(state.with_velocity(np.zeros(nv)))
    if rows.name != constraint.name:
        raise ConstraintWrong(f"constraint {constraint.name!r} gave rows named {rows.name!r}; forces go by the rows' name.")
    if not len(rows):
        raise InputError(f"constraint {constraint.name!r} has no rows at this state; choose one where it acts.")
    _check_normal(rows)
    worst = {"J v": 0.0, "velocity": 0.0, "J a + J_dot v": 0.0}
    for _ in range(draws):
        v, a = rng.normal(size=nv), rng.normal(size=nv)
        if not moving:
            v -= np.linalg.pinv(rows.J) @ (rows.J @ v)
        at, bias = constraint.rows(state.with_velocity(v)), np.zeros(len(rows))
        if rows.velocity.any() or rows.bias.any():  # a surface has prescribed motion: J_dot v is the part quadratic in v
            bias = 0.5 * (constraint.rows(state.with_velocity(-v)).bias - at.bias) - rows.bias
        found, against = _agreeing(
            constraint.name, partial(_compared, constraint, state, rows, at, bias, v, a, moving), tolerance, ConstraintWrong
        )
        for what, gap in found.items():
            worst[what] = max(worst.get(what, 0.0), gap)
    jacobian = None if against == "its own J" else worst["J v"]
    return ConstraintReport(constraint.name, len(rows), against, jacobian, worst["velocity"], worst["J a + J_dot v"])


def _compared(
    constraint: Constraint, state: State, rows: Rows, at: Rows, bias: Array, v: Array, a: Array, moving: bool, step: float
) -> tuple[Compared, str]:
    """(What the rows give and the motion has, what the motion is of)."""
    t = step * _AT
    curve = np.outer(t, rows.J @ v) + np.outer(0.5 * t**2, rows.J @ a + (at.bias + bias))
    first, second, against, errors = _motion(constraint, state, rows, v, a, step, curve)
    out = {"J v": (rows.J @ v, first), "J a + J_dot v": (rows.J @ a + (at.bias + bias), second)}
    if at.velocity.any() or rows.velocity.any():  # else the rows do not give it
        out["velocity"] = (at.velocity - rows.velocity, rows.J @ v)
    if is_timed(constraint):
        along = [constraint.rows(state.with_velocity(state.robot.zero_v).at_time(state.t + x)) for x in t]
        out["bias, by time,"] = (rows.bias, _first(np.array([r.velocity for r in along]), step))
        if rows.error is not None:
            held = True if rows.holonomic is None else rows.holonomic
            seen = _first(_errors(along, rows, np.outer(t, rows.velocity)), step)
            out["velocity, by time,"] = (rows.velocity, np.where(held, seen, rows.velocity))
    if errors is not None:
        out["error' against J v:"] = (_first(errors, step), rows.J @ v)
        if not moving:
            out["error'' against J a + J_dot v:"] = (_second(errors, step), rows.J @ a + (at.bias + bias))
    return out, against


def deviations(given: Array, found: Array) -> Array:
    """Differences of two vectors, over max(1, the largest entry), shape (m,)."""
    return np.abs(given - found) / max(1.0, float(np.abs(found).max()), float(np.abs(given).max()))


def _errors(along: list[Rows], rows: Rows, curve: Array) -> Array:
    """The errors along the curve, shape (7, m); those known up to a period without their jumps.

    Of the values that an error may have, the one nearest to what the rows expect is taken, error + J v t + ... . With a wrong
    J its derivative is that of the motion if periods are long against the path, and not smooth if they are short.
    """
    errors = np.array([r.error for r in along])
    period = rows.period
    if period is None or not period.any():
        return errors
    expected = errors[3] + curve
    whole = np.where(period > 0.0, period, 1.0)
    return np.asarray(errors - np.where(period > 0.0, whole * np.round((errors - expected) / whole), 0.0))


def _motion(
    constraint: Constraint, state: State, rows: Rows, v: Array, a: Array, step: float, curve: Array
) -> tuple[Array, Array, str, Array | None]:
    """(J v, J a + J_dot v, reference, the errors of a patch that is at its anchor) as the motion along the curve has them."""
    states = _curve(state, v, a, step)
    along = [constraint.rows(s) for s in states]
    own = np.array([r.J @ (v + a * t) for r, t in zip(along, step * _AT, strict=True)])
    if rows.holonomic is not None and rows.error is not None:
        held, errors = rows.holonomic, _errors(along, rows, curve)
        first = np.where(held, _first(errors, step), rows.J @ v)
        second = np.where(held, _second(errors, step), _first(own, step))
        return first, second, "motion of the error where there is one, its own J elsewhere,", None
    if rows.patch is not None and rows.resultant is not None:
        about = rows.resultant[3:]
        of_line = len(about) == 3 and not np.abs(rows.patch.axes[:, 0] @ about).max(initial=0.0) > 1e-12  # no moment about x
        y, anchored = _patch_motion(states, along, state, rows.patch, of_line), None
        if rows.error is not None and np.abs(rows.error).max(initial=0.0) < 1e-9:
            anchored = np.array([r.error for r in along])
        y = y[:, : len(rows.resultant)]
        first, second = rows.resultant.T @ _first(y, step), rows.resultant.T @ _second(y, step)
        return first, second, "motion of the patch", anchored
    if rows.error is not None:
        errors = _errors(along, rows, curve)
        return _first(errors, step), _second(errors, step), "motion of the error", None
    return rows.J @ v, _first(own, step), "its own J", None


def _patch_motion(states: list[State], along: list[Rows], state: State, patch: Patch, of_line: bool) -> Array:
    """Displacement and rotation vector of a patch from where it is at `state`, shape (nodes, 6), in world axes.

    Against another body: relative to its frame, with its axes at `state`. For a line, the rotation of its
    direction x alone, x at `state` cross x.
    """
    y = np.zeros((len(along), 6))
    X_WB0 = _body(state, patch)
    for i, (moved, r) in enumerate(zip(states, along, strict=True)):
        assert r.patch is not None
        back = X_WB0 * _body(moved, patch).inverse()  # moves the other body to where it was
        y[i, :3] = back.act(r.patch.point) - patch.point
        # The second derivative of the rotation vector at zero is the angular acceleration.
        turned = back.rotation @ r.patch.axes
        y[i, 3:] = np.cross(patch.axes[:, 0], turned[:, 0]) if of_line else pin.log3(turned @ patch.axes.T)
    return y


def _body(state: State, patch: Patch) -> pin.SE3:
    return pin.SE3.Identity() if patch.against is None else state.frame(patch.against).X_WF


def _check_normal(rows: Rows) -> None:
    """Unilateral forces must act along the patch's normal, out of the ground."""
    if rows.patch is None or rows.resultant is None:
        return
    G = corner_rays(rows.cone)
    if G is not None and (rows.patch.axes[:, 2] @ (rows.resultant @ G)[:3]).min() <= 0.0:
        raise ConstraintWrong(f"{rows.name!r}: a force of its cone pulls along the patch's normal; one of them is upside down.")


@dataclass(frozen=True)
class TaskReport(Displayed):
    """What `check_task` compared, and the largest deviations found, scaled as the tolerance is.

    Attributes:
        name: The task's name.
        rows: Number of rows.
        jacobian: Deviation of A v from the value's rate.
        jdot_v: Deviation of A a + J_dot v from the value's second derivative.

    Example:
        >>> talos = rbd.load_robot("talos")
        >>> report = rbd.testing.check_task(rbd.control.ComTask([0.0, 0.0, 0.9]), lambda state: state.com, talos.standing())
        >>> report.rows, report.jacobian < 1e-8, report.jdot_v < 1e-8
        (3, True, True)
    """

    name: str
    rows: int
    jacobian: float
    jdot_v: float


def check_task(
    task: Task,
    value: Callable[[State], Array | float],
    state: State,
    *,
    t: float = 0.0,
    seed: int = 0,
    draws: int = 5,
    tolerance: float = 1e-7,
) -> TaskReport:
    """Deviations of a task's A and J_dot v from the differences of its value along curves of the robot; raises if large.

    Along q(t) = q (+) (v t + a t^2 / 2), for drawn v and a, the rows of a task about a value y(q) must give::

        A v  =  y'        A a + J_dot v  =  y''

    to sixth order in the step. J_dot v is found from `wanted` at v, at -v and at rest, as what is even in
    v and zero at rest. Feedback on the error and its rate, and feed-forward, cancel there: they are not checked.

    Args:
        task: A task of accelerations.
        value: What it is about, y of shape (m,), or a number; for angular velocities in world axes, the rotation vector from
            the orientation at `state`.
        state: Where; a generic posture sees more than a symmetric one.
        t: The time at which the task is asked [s].
        seed: Of the drawn velocities and accelerations.
        draws: How many.
        tolerance: Largest deviation, over max(1, largest term).

    Raises:
        TaskWrong: with the row and the numbers.
        InputError: a task of a contact's force, one without rows here, or a value of another size.

    Example:
        >>> class Apart:
        ...     name = "apart"
        ...     def terms(self, state, t):  # two feet, along x in the world
        ...         one, other = state.frame("FL_FOOT"), state.frame("FR_FOOT")
        ...         return rbd.control.TaskTerms("apart", (one.J - other.J)[:1], (other.bias - one.bias)[:1], [1.0])
        >>> def apart(state):
        ...     return (state.frame("FL_FOOT").X_WF.translation - state.frame("FR_FOOT").X_WF.translation)[0]
        >>> report = rbd.testing.check_task(Apart(), apart, rbd.load_robot("solo12").standing())
        >>> report.rows, report.jacobian < 1e-8, report.jdot_v < 1e-8
        (1, True, True)
    """
    rng, robot = np.random.default_rng(seed), checked(state).robot
    still = _terms(task, state.with_velocity(robot.zero_v), t)
    worst = {"A v": 0.0, "A a + J_dot v": 0.0}
    for _ in range(draws):
        v, a = rng.normal(size=robot.nv), rng.normal(size=robot.nv)
        there, back = (_terms(task, state.with_velocity(each), t) for each in (v, -v))
        bias = still.wanted - 0.5 * (there.wanted + back.wanted)
        given = {"A v": still.A @ v, "A a + J_dot v": still.A @ a + bias}
        found, _ = _agreeing(task.name, partial(_of_value, task, value, state, v, a, given), tolerance, TaskWrong)
        worst = {what: max(most, found[what]) for what, most in worst.items()}
    return TaskReport(task.name, len(still.A), worst["A v"], worst["A a + J_dot v"])


def _of_value(
    task: Task, value: Callable[[State], Array | float], state: State, v: Array, a: Array, given: dict[str, Array], step: float
) -> tuple[Compared, str]:
    """(What is given and the differences of a task's value have, what these are)."""
    along = np.array([np.atleast_1d(as_array(f"value of task {task.name!r:.80}", value(x))) for x in _curve(state, v, a, step)])
    rows = len(given["A v"])
    if along.shape[1:] != (rows,):
        raise InputError(f"the value of task {task.name!r:.80} has shape {along.shape[1:]}; its rows are {rows}.")
    seen = {"A v": _first(along, step), "A a + J_dot v": _second(along, step)}
    return {what: (given[what], seen[what]) for what in given}, "motion of the value"


def _terms(task: Task, state: State, t: float) -> TaskTerms:
    terms = task.terms(state, t)
    if terms.contact or not len(terms.A):
        raise InputError(f"task {task.name!r:.80} has no rows of accelerations here; a value has no differences to compare.")
    return terms
