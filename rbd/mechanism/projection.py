"""Projection onto constraints: position, velocity and acceleration, by the least motion in the inertia metric.

What a motion has drifted off bilateral constraints is undone by

    q+ = q (+) d        d  = - M^-1 J^T (J M^-1 J^T)^+ error(q)        repeated: Newton's steps
    v+ = v + w          w  = - M^-1 J^T (J M^-1 J^T)^+ (J v - u)       u: the velocity of what is touched

Both are the least in |.|_M of all that close the rows. So the velocity's loses no energy beyond what the error carried: w is
perpendicular, in M, to all motions that the constraints leave free. Source: `docs/simulation.md`.

Rows may repeat each other, and rank may drop at singular poses. In W = L^-1 J^T (M = L L^T) the steps are those of least
squares, by Cholesky where the rows are well independent and by singular values s where not. There

    d = - L^-T U diag(s / (s^2 + (s_1 |error|)^2)) V^T error        over s > zero s_1

A pose that is off by `error` knows its singular values to s_1 |error| and no better (a redundant row shows that much, not
zero), hence the damping: it fades faster than Newton's steps converge [YamashitaFukushima2001].
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import pinocchio as pin
from scipy.linalg import blas, lapack

from rbd.arrays import Array, as_float, inertia_factor, max_abs
from rbd.constraints.constraint import Constraint, rows_of
from rbd.constraints.manifold import StackedRows, own_or
from rbd.errors import DuplicateName, InputError
from rbd.model.state import State, check_state
from rbd.problem.cones import Box
from rbd.solvers.kkt import independent_factor

ZERO = 1e-9
"""Singular values below this fraction of the largest count as zero."""
MET = 1e-9
"""How well the rows must be met by a projected velocity, over the largest sum of terms in a row."""
FARTHEST = 0.5
"""Longest entry of one step [m, rad]: farther away, the linearised rows tell nothing."""
HALVINGS = 4

Equations: TypeAlias = Callable[[State], tuple[Array, Array]]
"""(J (m, nv), error (m,)) at a state: the error's derivative along the motion is J v."""


@dataclass(frozen=True)
class Projection:
    """Constraints that hold are kept by projection after every step: q goes to the nearest configuration on them, v along them.

    Attributes:
        tolerance: Largest position error that is left [m, rad].
        iterations: Newton steps at most.

    Raises:
        InputError: a tolerance that is not in (0, 1e-3], iterations that are no whole number from 1.
    """

    tolerance: float = 1e-12
    iterations: int = 20

    def __post_init__(self) -> None:
        if not 0.0 < as_float(self.tolerance) <= 1e-3:
            raise InputError(f"tolerance of Projection is {self.tolerance!r:.80}; expected a number above 0, at most 1e-3.")
        n = self.iterations
        if isinstance(n, bool) or not isinstance(n, int) or not 1 <= n <= 1000:
            raise InputError(f"iterations of Projection is {n!r:.80}; expected a whole number from 1 to 1000.")


def project_position(state: State, equations: Equations, projection: Projection) -> State:
    """The state whose configuration is the nearest, in the inertia metric, that meets the equations; its v is kept.

    It stops where no step comes nearer; look at the errors of the state it returns. Rows may repeat each other.

    Args:
        state: Start.
        equations: J (m, nv) and error (m,) [m, rad] of a state; m may change from state to state.
        projection: How near, and how many steps.
    """
    robot = state.robot
    J, error = equations(state)
    for _ in range(projection.iterations):
        size = max_abs(error)
        if size <= projection.tolerance:
            break
        step = shortened(-correction(inertia_factor(state.M), J, error, damping=size))
        for _ in range(HALVINGS):
            nearer = State(robot, pin.integrate(robot.model, state.q, step), state.v)
            J_there, error_there = equations(nearer)
            if max_abs(error_there) < size:
                break
            step = 0.5 * step
        else:
            break  # rounding, or a true minimum of the distance
        state, J, error = nearer, J_there, error_there
    return state


def correction(L: Array, J: Array, error: Array, *, damping: float = 0.0, zero: float = ZERO) -> Array:
    """The least x in |.|_M with J x = error, as nearly as can be: M^-1 J^T (J M^-1 J^T)^+ error, shape (nv,).

    Args:
        L: Lower factor of M, shape (nv, nv).
        J: Shape (m, nv).
        error: Shape (m,).
        damping: How much of the largest singular value a small one may owe to the pose being off.
        zero: Singular values below this fraction of the largest are left out.
    """
    if not len(error) or not error.any():
        return np.zeros(len(L))
    W = blas.dtrsm(1.0, L, J.T, lower=1)
    R = independent_factor(W.T @ W)
    if R is not None:
        y = W @ lapack.dpotrs(R, error)[0]
    else:
        U, s, Vt = np.linalg.svd(W, full_matrices=False)
        kept = s > zero * s[0]
        s = s[kept]
        y = U[:, kept] @ (s / (s * s + (damping * s[0]) ** 2) * (Vt[kept] @ error)) if len(s) else np.zeros(len(L))
    return blas.dtrsv(L, y, lower=1, trans=1)


def shortened(step: Array) -> Array:
    """The step, no entry of it longer than `FARTHEST`."""
    longest = max_abs(step)
    return step if longest <= FARTHEST else step * (FARTHEST / longest)


def project_velocity(state: State, constraints: Sequence[Constraint] | None = None) -> State:
    """The same configuration with the nearest velocity, in the metric of inertia, under which constraints keep their places.

        minimise 1/2 |v+ - v|_M^2     subject to     J v+ = u ,       v+ = v - M^-1 J^T (J M^-1 J^T)^+ (J v - u)

    u is the velocity of what is touched, zero of a ground at rest. Contacts are taken as ones that hold, whatever their
    friction: they neither slip nor leave. Contacts without friction (and stops of joints) keep their normal velocity at zero
    and may slide. Leave out those that shall slide, open or strike. It is what a plastic impact on all of them does to v, with
    forces of either sign. Rows may repeat each other.

    Measured or recorded velocities are off the contacts by noise; above `rest_speed`, `rbd.solve` takes that for a contact
    that leaves or strikes.

    Args:
        state: The robot at (q, v).
        constraints: Contacts, loops, rolling wheels, locks; None for the loops and wheels of the robot's file. Dry friction in
            joints says nothing of velocities and is passed over.

    Returns:
        A state with the same q.

    Raises:
        DuplicateName: two constraints under one name.
        InputError: something is no constraint, or no velocity keeps all of them: two belts that pull apart.
        SingularInertia: M is not positive definite.

    >>> rbd.solve(rbd.mechanism.project_velocity(state, robot.soles()), tau, robot.soles())
    """
    stack = _stacked(check_state(state), constraints)
    if not stack.rows:
        return state
    return state.with_velocity(_nearest(stack, state.v, stack.J @ state.v - stack.velocity, "velocity", "m/s (rad/s)"))


@dataclass(frozen=True, eq=False)
class ProjectedAcceleration:
    """The acceleration nearest to a given one that constraints allow.

    Attributes:
        a: It, shape (nv,) [m/s2, rad/s2].
        forces: {constraint: forces of its rows}, the multipliers, of least norm where rows repeat each other [N, N m].
        residual: Largest entry of M (a - given) - J^T forces [N, N m].
        missed: Largest entry of J a + J_dot v [m/s2, rad/s2].
    """

    a: Array
    forces: dict[str, Array]
    residual: float
    missed: float


def project_acceleration(
    state: State, a: Sequence[float] | Array, constraints: Sequence[Constraint] | None = None
) -> ProjectedAcceleration:
    """The nearest acceleration, in the metric of inertia, under which constraints hold.

        minimise 1/2 |a+ - a|_M^2     subject to     J a+ + J_dot v = 0 ,       M (a+ - a) = J^T f

    It is what `rbd.solve` gives with constraints that hold and a in place of the free acceleration: for accelerations that are
    planned, recorded or filtered, before torques are asked for. Contacts are taken as ones that hold, whatever their friction,
    as in `project_velocity`; so is J_dot v at the state's own v, which is to keep them (project it first). Where what is
    touched accelerates, or a constraint is stabilised, J_dot v includes that.

    Args:
        state: The robot at (q, v).
        a: Acceleration to start from, shape (nv,).
        constraints: Contacts, loops, rolling wheels, locks; None for the loops and wheels of the robot's file. Dry friction in
            joints says nothing of accelerations and is passed over.

    Returns:
        The acceleration, with its multipliers and what is left of both equations.

    Raises:
        DuplicateName: two constraints under one name.
        InputError: something is no constraint, a has a wrong size or is not finite, or no acceleration keeps all constraints:
            four held corners of a foot that turns. Names the one that is missed most.
        SingularInertia: M is not positive definite.

    >>> rbd.mechanism.project_acceleration(state, a, robot.soles()).a
    """
    given = check_state(state).robot.check_v(a, "a")  # type: ignore[arg-type]
    stack = _stacked(state, constraints)
    if not stack.rows:
        return ProjectedAcceleration(given, {}, 0.0, 0.0)
    nearest = _nearest(stack, given, -stack.offset, "acceleration", "m/s2 (rad/s2)")
    pushed = state.M @ (nearest - given)
    f = np.linalg.lstsq(stack.W, blas.dtrsv(stack.L, pushed, lower=1), rcond=ZERO)[0]
    forces, at = {}, 0
    for r in stack.rows:
        forces[r.name] = f[at : at + len(r)]
        at += len(r)
    residual, missed = max_abs(pushed - stack.J.T @ f), max_abs(stack.J @ nearest + stack.offset)
    return ProjectedAcceleration(nearest, forces, residual, missed)


def _stacked(state: State, constraints: Sequence[Constraint] | None) -> StackedRows:
    """The rows of constraints that say how the robot may move."""
    rows = [r for r in rows_of(state, own_or(state.robot, constraints)) if len(r) and not isinstance(r.cone, Box)]
    for i, r in enumerate(rows):
        if any(r.name == other.name for other in rows[:i]):
            raise DuplicateName(f"two constraints are called {r.name!r:.80}; give each its own name.")
    return StackedRows(state, rows)


def _nearest(stack: StackedRows, x: Array, wanted: Array, what: str, unit: str) -> Array:
    """The x nearest to one in the metric of inertia with J x = wanted.

    Raises:
        InputError: there is none; names the constraint that is missed most.
        SingularInertia: M is not positive definite.
    """
    J, W, given, robot = stack.J, stack.W, x, stack.state.robot
    for _ in range(3):  # once is exact but for rounding, which an ill-conditioned M or J makes large
        y = np.linalg.lstsq(W.T, J @ x - wanted, rcond=ZERO)[0]  # of least norm: of least |x - given| in M
        x = x - blas.dtrsv(stack.L, y, lower=1, trans=1)
    size = max(1e-300, max_abs(np.abs(J) @ np.abs(x)), max_abs(np.abs(J) @ np.abs(given)), max_abs(wanted))
    off = np.abs(J @ x - wanted)
    if max_abs(off) > MET * size:
        worst = int(np.argmax(off))
        raise InputError(
            f"no {what} of {robot.name} keeps these constraints together: {stack.name_of(worst)!r:.80} is missed by "
            f"{float(off[worst]):.3g} {unit} at least. Leave out one of those that move against each other."
        )
    return x
