"""Projection onto constraints: position, velocity and acceleration, by the least motion in the inertia metric.

Drift off bilateral constraints is corrected by

    q+ = q (+) d        d  = - M^-1 J^T (J M^-1 J^T)^+ error(q)        repeated: Newton's steps
    v+ = v + w          w  = - M^-1 J^T (J M^-1 J^T)^+ (J v - u)       u: the surfaces' velocity

Both are the least in |.|_M that satisfy the rows. So the correction removes only the error's energy: w is
perpendicular, in M, to all motions that the constraints allow. Source: `docs/reference/simulation.md`.

Rows may be redundant, and rank may drop at singular poses. In W = L^-1 J^T (M = L L^T) the steps are those of least
squares, by Cholesky where the rows are well independent and by singular values s where not. There

    d = - L^-T U diag(s / (s^2 + (s_1 |error|)^2)) V^T error        over s > zero s_1

A pose that is off by `error` has singular values uncertain by s_1 |error| (a redundant row has that, not
zero); therefore the damping, which vanishes faster than Newton's steps converge [YamashitaFukushima2001].
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, blas, check_positive, check_whole, inertia_factor, lapack, max_abs
from rbd.constraints.constraint import Constraint, rows_of
from rbd.constraints.manifold import ZERO, StackedRows, own_or
from rbd.displayed import Displayed
from rbd.errors import InputError, SingularInertia
from rbd.errors.inputs import check_different
from rbd.model.state import State, checked
from rbd.problem.cones import Bounds
from rbd.problem.rows import by_rows
from rbd.solvers.kkt import independent_factor

MET = 1e-9
"""Tolerance of the rows at a projected velocity, over the largest sum of terms in a row."""
FARTHEST = 0.5
"""Largest entry of one step [m, rad]: farther away the linearised rows are not valid."""
HALVINGS = 4

Equations: TypeAlias = Callable[[State], tuple[Array, Array]]
"""(J (m, nv), error (m,)) at a state: the error's derivative along the motion is J v."""


@dataclass(frozen=True)
class Projection(Displayed):
    """Stabilisation by projection after every step: q to the nearest configuration on the bilateral constraints, v likewise.

    Attributes:
        tolerance: Largest remaining position error [m, rad].
        iterations: Largest number of Newton steps.

    Raises:
        InputError: a tolerance that is not in (0, 1e-3], iterations that are not a whole number from 1.

    Example:
        >>> robot = rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0)
        >>> for kept in (rbd.simulation.Projection(), None):
        ...     swing = rbd.simulate(robot.at("assembled"), robot.loops(), duration=0.5, step=2e-2, stabilisation=kept)
        ...     print(f"{swing.residuals['drift'].max():.0e} m")
        1e-15 m
        8e-09 m
    """

    tolerance: float = 1e-12
    iterations: int = 20

    def __post_init__(self) -> None:
        check_positive("tolerance of Projection", self.tolerance, 1e-3)
        check_whole("iterations of Projection", self.iterations, 1000)


def project_position(
    state: State,
    equations: Equations,
    projection: Projection,
    corrected: Callable[[State, Array, Array], Array] | None = None,
    *,
    zero: float = ZERO,
) -> State:
    """The state whose configuration is the nearest, in the inertia metric, that satisfies the equations, with the same v.

    It stops when no step reduces the error; check the errors of the returned state. Rows may be redundant.

    Args:
        state: The initial state.
        equations: J (m, nv) and error (m,) [m, rad] of a state; m may change from state to state.
        projection: Tolerance and number of steps.
        corrected: Gives the correction of a state by what `equations` gives of it, J or another array; None: by `correction`.
        zero: As of `correction`.
    """
    robot = state.robot
    J, error = equations(state)
    for _ in range(projection.iterations):
        size = max_abs(error)
        if size <= projection.tolerance:
            break
        if corrected is None:
            back = -correction(inertia_factor(state.M), J, error, damping=size, zero=zero)
        else:
            back = corrected(state, J, error)
        step = shortened(back)
        for _ in range(HALVINGS):
            nearer = State(robot, pin.integrate(robot.model, state.q, step), state.v, t=state.t)
            J_there, error_there = equations(nearer)
            if max_abs(error_there) < size:
                break
            step = 0.5 * step
        else:
            break  # rounding, or a true minimum of the distance
        state, J, error = nearer, J_there, error_there
    return state


def correction(L: Array, J: Array, error: Array, *, damping: float = 0.0, zero: float = ZERO) -> Array:
    """The least x in |.|_M that solves J x = error by least squares: M^-1 J^T (J M^-1 J^T)^+ error, shape (nv,).

    Args:
        L: Lower Cholesky factor of M, shape (nv, nv).
        J: Shape (m, nv).
        error: Shape (m,).
        damping: Uncertainty of small singular values by the pose error, over the largest.
        zero: Singular values below this fraction of the largest are left out. Above `ZERO`, rows are taken with length one in
            the metric of M^-1, so that light bodies do not hide heavy ones.
    """
    if not len(error) or not error.any():
        return np.zeros(len(L))
    W = blas.dtrsm(1.0, L, J.T, lower=1)
    if zero > ZERO:
        lengths = np.maximum(np.linalg.norm(W, axis=0), 1e-300)
        W, error = W / lengths, error / lengths
    R = independent_factor(W.T @ W)
    if R is not None and (zero <= ZERO or R.diagonal().min() > zero):
        y = W @ lapack.dpotrs(R, error)[0]
    else:
        U, s, Vt = np.linalg.svd(W, full_matrices=False)
        kept = s > zero * s[0]
        s = s[kept]
        y = U[:, kept] @ (s / (s * s + (damping * s[0]) ** 2) * (Vt[kept] @ error)) if len(s) else np.zeros(len(L))
    return blas.dtrsv(L, y, lower=1, trans=1)


def shortened(step: Array) -> Array:
    """The step, no entry above `FARTHEST`."""
    longest = max_abs(step)
    return step if longest <= FARTHEST else step * (FARTHEST / longest)


def project_velocity(state: State, constraints: Sequence[Constraint] | None = None, *, loops: bool = True) -> State:
    """The same configuration with the nearest velocity, in the metric of inertia, that satisfies the constraints.

    The problem, and its solution::

        minimise 1/2 |v+ - v|_M^2     subject to     J v+ = u ,       v+ = v - M^-1 J^T (J M^-1 J^T)^+ (J v - u)

    u is the surfaces' velocity, zero for ground at rest. Contacts count as bilateral, whatever their
    friction: they neither slip nor separate. Frictionless contacts (and joint limits) have zero normal velocity
    and may slide. Leave out those that are to slide, open or impact. It is the effect of a plastic impact on all, with
    forces of either sign. Rows may be redundant.

    Measured or recorded velocities violate contacts by noise; above `rest_speed`, `rbd.solve` takes that for a contact
    that separates or impacts.

    Args:
        state: The robot at (q, v).
        constraints: Contacts, loops, rolling wheels, locks; None for the loops and wheels of the robot's file. Dry friction in
            joints does not restrict velocities and is ignored.
        loops: Whether the robot's own loops hold; one that is given counts once.

    Returns:
        A state with the same q.

    Raises:
        DuplicateName: two constraints have one name.
        InputError: an object is not a constraint, or no velocity satisfies all, e.g. on two belts that diverge.
        SingularInertia: M is not positive definite.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> state, feet = solo.standing(), solo.feet(friction=0.7)
        >>> noisy = state.with_velocity(np.random.default_rng(0).normal(scale=0.1, size=solo.nv))
        >>> clean = rbd.mechanism.project_velocity(noisy, feet)
        >>> print(max(np.abs(foot.rows(clean).velocity).max() for foot in feet) < 1e-12)
        True
    """
    stack = _stacked(checked(state), constraints, loops)
    if not stack.rows:
        return state
    return state.with_velocity(_nearest(stack, state.v, stack.J @ state.v - stack.velocity, "velocity", "m/s (rad/s)"))


@dataclass(frozen=True, eq=False)
class ProjectedAcceleration(Displayed):
    """The nearest acceleration that satisfies constraints, as `project_acceleration` finds it.

    Attributes:
        a: The acceleration, shape (nv,) [m/s2, rad/s2].
        forces: {constraint: forces of its rows}, the multipliers, of least norm for redundant rows [N, N m].
        residual: Largest entry of M (a - given) - J^T forces [N, N m].
        missed: Largest entry of J a + J_dot v [m/s2, rad/s2].

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> found = rbd.mechanism.project_acceleration(solo.standing(), np.eye(solo.nv)[2], solo.feet())
        >>> print(found.a[:3].round(3), found.missed < 1e-9, found.residual < 1e-9)
        [0.    0.    1.024] True True
    """

    a: Array
    forces: dict[str, Array]
    residual: float
    missed: float


def project_acceleration(
    state: State,
    a: Sequence[float] | Array,
    constraints: Sequence[Constraint] | None = None,
    *,
    loops: bool = True,
) -> ProjectedAcceleration:
    """The nearest acceleration, in the metric of inertia, that satisfies the constraints.

    The problem, and the condition of its solution::

        minimise 1/2 |a+ - a|_M^2     subject to     J a+ + J_dot v = 0 ,       M (a+ - a) = J^T f

    It is the solution of Gauss's least-constraint problem with a in place of the free acceleration. Use it for accelerations
    that were planned, recorded or filtered, before inverse dynamics. Contacts count as bilateral, whatever their friction, as
    in `project_velocity`. J_dot v is that of the state's v, which should satisfy the constraints (project it first); it
    includes accelerations of surfaces, and Baumgarte's feedback of stabilised constraints.

    Args:
        state: The robot at (q, v).
        a: The given acceleration, shape (nv,).
        constraints: Contacts, loops, rolling wheels, locks; None for the loops and wheels of the robot's file. Dry friction in
            joints does not restrict accelerations and is ignored.
        loops: Whether the robot's own loops hold; one that is given counts once.

    Returns:
        The acceleration, with its multipliers and the residuals of both equations.

    Raises:
        DuplicateName: two constraints have one name.
        InputError: an object is not a constraint, a has a wrong size or is not finite, or no acceleration satisfies all
            constraints, e.g. four bilateral corners of a foot that turns; names the one with the largest violation.
        SingularInertia: M is not positive definite.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> state, feet = solo.standing(), solo.feet(friction=0.7)
        >>> a = rbd.mechanism.project_acceleration(state, np.eye(solo.nv)[2], feet).a  # the trunk up, the feet still
        >>> print(a[:3].round(3), rbd.inverse_dynamics(state, a, feet).status)
        [0.    0.    1.024] solved
    """
    given = checked(state).robot.check_v(a, "a")  # type: ignore[arg-type]
    stack = _stacked(state, constraints, loops)
    if not stack.rows:
        return ProjectedAcceleration(given, {}, 0.0, 0.0)
    nearest = _nearest(stack, given, -stack.offset, "acceleration", "m/s2 (rad/s2)")
    pushed = state.M @ (nearest - given)
    f = stack.inverse @ blas.dtrsv(stack.L, pushed, lower=1)
    forces = {r.name: part for r, part in by_rows(stack.rows, f)}
    residual, missed = max_abs(pushed - stack.J.T @ f), max_abs(stack.J @ nearest + stack.offset)
    return ProjectedAcceleration(nearest, forces, residual, missed)


def _stacked(state: State, constraints: Sequence[Constraint] | None, loops: bool) -> StackedRows:
    """The rows of the constraints that restrict motion: all but joint friction."""
    rows = [r for r in rows_of(state, own_or(state.robot, constraints, loops)) if len(r) and not isinstance(r.cone, Bounds)]
    check_different([r.name for r in rows], "constraints")
    return StackedRows(state, rows)


def _nearest(stack: StackedRows, x: Array, wanted: Array, what: str, unit: str) -> Array:
    """The nearest vector to x, in the metric of inertia, with J x = wanted.

    Raises:
        InputError: there is none; names the constraint with the largest violation.
        SingularInertia: M is not positive definite.
    """
    given, robot = x, stack.state.robot
    try:
        J, inverse = stack.J, stack.inverse
    except SingularInertia as error:
        raise SingularInertia(f"M of {robot.name} is not positive definite at this state: {error}") from None
    for _ in range(3):  # once is exact except for rounding, which is large for ill-conditioned M or J
        y = (J @ x - wanted) @ inverse  # of least norm: of least |x - given| in M
        x = x - blas.dtrsv(stack.L, y, lower=1, trans=1)
    size = max(1e-300, max_abs(np.abs(J) @ np.abs(x)), max_abs(np.abs(J) @ np.abs(given)), max_abs(wanted))
    off = np.abs(J @ x - wanted)
    if max_abs(off) > MET * size:
        worst = int(np.argmax(off))
        raise InputError(
            f"no {what} of {robot.name} satisfies all constraints: {stack.name_of(worst)!r:.80} is missed by "
            f"{float(off[worst]):.3g} {unit} at least. Leave out one of those that move against each other."
        )
    return x
