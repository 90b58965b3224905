"""Velocities and impulses of one step or one impact: Gauss's problem at the level of velocity.

    M v+ = M v + h (S^T tau + tau_ext - h(q, v)) + J^T p          (an impact: h = 0)
    u+ = J v+ + offset,        p in h K        u+ and p obey the contact law, as accelerations and forces do in `rbd.solve`

It is a `GaussProblem` whose unknown is v+, and whose multipliers are impulses; sets of bounded forces are scaled by h. With
M = L L^T, W = L^-1 J^T and y = L^-1 (M v + h (...)),

    u+ = W^T W p + W^T y + offset,        v+ = L^-T (y + W p)

It is solved by the first of these that succeeds: impulses of sticking contacts (the least-norm ones, then those nearest to the
guess); Newton's method; the solvers of `rbd.ConeSolver`, one after another. A `GaussProblem` is constructed only for the last.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import groupby
from typing import NamedTuple

import numpy as np

from rbd.answers.solution import Solution
from rbd.arrays import Array, blas, inertia_factor, is_finite, lapack, max_abs
from rbd.constraints.manifold import ZERO
from rbd.errors import NoSolution
from rbd.mechanism.redundant_accelerations import CONTRADICTION, INDEPENDENT, OWED
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State
from rbd.problem.cones import Bounds, Cone, Product
from rbd.problem.contact_motion import REST_SPEED
from rbd.problem.force_set import ForceSet, at_rest
from rbd.problem.gauss_problem import GaussProblem
from rbd.problem.rows import Rows
from rbd.simulation.stacked_points import PointLayout, PreparedPoints, Snapshot
from rbd.solvers.admm import ConeSolver, holding
from rbd.solvers.kkt import StickingSolver, independent_factor
from rbd.solvers.newton import Scaled, scaled, steps_from, yielding_steps
from rbd.solvers.pinocchio_admm import admm

EXACT = 1e-10
"""Scaled merit below which weights are accepted."""
STILL = 1e-13
"""Scaled velocity of sticking rows that counts as zero."""
ROUNDING = 1e-14
"""Tolerance of velocities, times the root of a point's effective mass [kg^1/2 m/s]."""
_MOST_CHOICES = 500
"""Number of cached sets of active points, and of step lengths if forces are bounded, for one layout."""
_NOTHING = 1e-100
"""Velocities below this are zero [m/s, rad/s]: divided by them, others would overflow."""
QUICK = 10
"""Iterations of Newton's method before another is tried; started from the step before it usually takes two."""
FINE = 1e-10
"""Proximal term of its second attempt: half of those that stall at a merit of 1e-10 to 1e-7 end here."""


class VelocityAnswer(NamedTuple):
    """Velocities and impulses of a step or an impact; a tuple, which is created in a third of a dataclass' time.

    Attributes:
        v: Velocity after it, shape (nv,).
        impulse: Row impulses, shape (p,) [N s, N m s]; zero of inactive points.
        velocity: u+ of all points, shape (p,) [m/s, rad/s].
        law: Residual of the contact law, scaled.
        least: Whether the impulses are known to be of least norm.
        norms: Largest norms so far of the columns of bilateral rows, for the next problem of the same layout; see
            `independent_rows`.
        redundant: Whether bilateral rows were linearly dependent.
    """

    v: Array
    impulse: Array
    velocity: Array
    law: float
    least: bool = False
    norms: Array | None = None
    redundant: bool = False


class StepEquations(NamedTuple):
    """The two halves of a time step in one form: v+ = start + h a, and the velocities of the points after it.

    Attributes:
        state: Where forces are computed, and at which velocity.
        t: Its time [s].
        at: Its points; None where they are measured only if they are needed.
        ground: The prepared form of the points, if it may answer; it measures them if `at` is None.
        active: Which points are active, shape (k,).
        start: Velocity to which h a is added, shape (nv,).
        h: Length of the (half) step [s].
        u: The points' velocities at the step's beginning, shape (p,).
        error: Their position errors there, shape (p,).
        mean: Velocity w for u+ = J w + h J a + h/2 J_dot v; None: u+ = u + h (J a + J_dot v).
    """

    state: State
    t: float
    at: Snapshot | None
    ground: PreparedPoints | None
    active: Array
    start: Array
    h: float
    u: Array
    error: Array
    mean: Array | None = None


@dataclass(frozen=True, eq=False)
class ActiveRows:
    """The rows of the active points.

    Attributes:
        index: Which rows.
        groups: (constraint, its rows among them, their set).
        sets: Their sets as weights, which are the row impulses themselves: each set belongs to one point.
        held: Which of the rows are bilateral; indices.
        sticking: Solver of their sticking impulses, if there are any rows.
    """

    index: Array | slice
    groups: tuple[tuple[str, slice, Cone], ...]
    sets: ForceSet
    held: Array
    sticking: StickingSolver | None

    @property
    def names(self) -> str:
        """Names of their constraints."""
        return ", ".join(name for name, _, _ in self.groups)


def active_rows(layout: PointLayout, active: Array, h: float) -> ActiveRows:
    """The rows of active points, bounds of forces multiplied by h; cached objects.

    Args:
        layout: All points.
        active: Which of them are active, shape (k,).
        h: Length of the step [s]; 1 for sets of forces.
    """
    known, key = layout.computed, (active.tobytes(), h if layout.boxed else 0.0)
    found: ActiveRows | None = known.get(key)
    if found is None:
        if len(known) > _MOST_CHOICES:
            known.clear()
        found = known[key] = _active_rows(layout, active, h)
    return found


def _active_rows(layout: PointLayout, active: Array, h: float) -> ActiveRows:
    index = slice(None) if active.all() else np.flatnonzero(np.repeat(active, layout.widths))
    groups: list[tuple[str, slice, Cone]] = []
    at = 0
    for owner, members in groupby(np.flatnonzero(active).tolist(), key=layout.owners.__getitem__):
        cones = [_impulses_over(layout.cones[i], h) for i in members]
        cone = cones[0] if len(cones) == 1 else Product(cones)
        groups.append((owner, slice(at, at + cone.dim), cone))
        at += cone.dim
    sets, held = at_rest(*[cone for _, _, cone in groups]), np.flatnonzero(layout.held[index])
    return ActiveRows(index, tuple(groups), sets, held, StickingSolver(sets) if sets.size else None)


def _impulses_over(cone: Cone, h: float) -> Cone:
    """Impulses over a time h of forces in a set; a cone is unchanged."""
    if not isinstance(cone, Bounds):
        return cone
    return Bounds(*(np.where(np.isfinite(bound), 0.0, bound) if h == 0.0 else h * bound for bound in (cone.lo, cone.hi)))


def solve_velocity(
    at: Snapshot,
    active: Array,
    rhs: Array,
    offset: Array,
    h: float,
    guess: Array,
    *,
    law: str,
    shift: Array | None = None,
    norms: Array | None = None,
    inertia: Array | None = None,
) -> VelocityAnswer:
    """Velocity and impulses of a step or an impact.

    Args:
        at: The points, and M.
        active: Which points are active, shape (k,).
        rhs: M v + h (...), shape (nv,).
        offset: The offset in u+ = J v+ + offset, shape (p,).
        h: Length of the step [s]; 0 for an impact, in which bounded forces have no impulse.
        guess: Impulses to start from, shape (p,).
        law: "coulomb" or "convex".
        shift: Added to u+ only in the contact law, shape (p,): friction opposes u+ + shift.
        norms: `norms` of the last answer for this layout.
        inertia: Takes the place of M, shape (nv, nv): with force elements that are taken implicitly.

    Raises:
        NoSolution: naming the active constraints, or the value that is not finite.
        SingularInertia: M is not positive definite.
    """
    rows = active_rows(at.layout, active, h)
    M, index, impulse = at.state.M if inertia is None else inertia, rows.index, np.zeros(len(offset))
    L = inertia_factor(M)
    y = blas.dtrsv(L, rhs, lower=1)
    if not is_finite(y):
        raise NoSolution(not_finite(at.state.robot))
    merit, least, redundant = 0.0, False, False
    if rows.sets.size:
        J, c, left_out = at.J[index], offset[index], 0.0
        W = blas.dtrsm(1.0, L, J.T, lower=1)
        if len(rows.held):
            W, c, left_out, norms, redundant = independent_rows(W, c, rows.held, at.drift, norms)
            if redundant:
                J = (np.tril(L) @ W).T
        D, u = W.T @ W, W.T @ y + c
        if not is_finite(u):
            raise NoSolution(f"the velocity of {rows.names} is not finite at this state.")
        if max_abs(u) < _NOTHING:
            u = np.zeros(len(u))

        def problem() -> GaussProblem:
            return GaussProblem(M, rhs, [Rows(name, J[s], c[s], cone) for name, s, cone in rows.groups], from_state=True)

        given = None if shift is None else shift[index]
        f, merit, least = point_impulses(rows, D, u, guess[index], given, h, law, problem)
        if left_out:
            merit = max(merit, _contradiction(rows, at, left_out / (max(h, max_abs(u)) or 1.0)))
        impulse[index] = f
        y = y + W @ f
    v = blas.dtrsv(L, y, lower=1, trans=1)
    return VelocityAnswer(v, impulse, at.J @ v + offset, merit, least, norms, redundant)


def not_finite(robot: CheckedModel) -> str:
    """Message: what has no velocity."""
    return f"the momentum of {robot.name}, or a force on it, is not finite at this state."


def _contradiction(rows: ActiveRows, at: Snapshot, missed: float) -> float:
    """Residual of bilateral rows, relative to the prescribed velocities, less that of position and velocity errors.

    Raises:
        NoSolution: the rows contradict each other.
    """
    if missed > max(CONTRADICTION, OWED * max(at.drift, at.drift_rate)):
        raise NoSolution(
            f"no velocity satisfies the constraints together: {rows.names} contradict each other, by {missed:.3g} "
            "of the velocities required."
        )
    return missed


def point_impulses(
    rows: ActiveRows,
    D: Array,
    u: Array,
    guess: Array,
    shift: Array | None,
    h: float,
    law: str,
    problem: Callable[[], GaussProblem],
) -> tuple[Array, float, bool]:
    """(row impulses, residual of the law, whether they are known to be of least norm).

    Args:
        rows: The active points.
        D: Row velocities of unit impulses, shape (m, m).
        u: Row velocities without impulses, shape (m,).
        guess: Impulses to start from, shape (m,).
        shift: Added to the velocities only in the contact law, shape (m,).
        h: Length of the step [s].
        law: "coulomb" or "convex".
        problem: Gives the whole problem, for the last methods.

    Raises:
        NoSolution: there are none.
    """
    if rows.sets.bilateral:
        return *_bilateral(D, u, max(h, max_abs(u)) or 1.0, problem), False
    if shift is None and rows.sticking is not None:
        held = rows.sticking.impulses(D, u, guess, STILL, shortest=True)
        if held is not None:
            return held
    T, coulomb = rows.sets, law == "coulomb"
    # It can happen that no friction opposes the velocity in the middle of the step, u + shift: then that at the end is used.
    for velocity in (u,) if shift is None else (u + shift, u):
        x, merit, S = _newton(D, velocity, T, guess, coulomb)
        exact = _least_merit(S.rate)
        if merit <= exact:
            return T.project(S.weights(x)), merit, False
    x, merit = yielding_steps(S, S.guess(T.project(holding(problem()))), coulomb=coulomb)
    if merit > exact:
        x, merit = yielding_steps(S, np.zeros(T.size), coulomb=coulomb)
    return (T.project(S.weights(x)), merit, False) if merit <= exact else (*_portfolio(problem(), law), False)


def _newton(D: Array, u: Array, T: ForceSet, guess: Array, coulomb: bool) -> tuple[Array, float, Scaled]:
    """(scaled weights, merit, the scaled problem) by Newton's method from a guess."""
    S = scaled(D, u, T)
    exact = _least_merit(S.rate)
    x, merit, _ = steps_from(S, S.guess(guess), coulomb=coulomb, iterations=QUICK)
    if merit > exact:  # rows that are nearly dependent: the steps' own regularisation stalls them
        finer, less, _ = steps_from(S, x, coulomb=coulomb, iterations=QUICK, proximal=FINE)
        if less <= exact:
            return finer, less, S
    if merit > exact:  # dependent rows: ADMM first, then exact
        near, _ = admm(S, x, coulomb=coulomb, iterations=200, tolerance=1e-6)
        x, merit, _ = steps_from(S, near, coulomb=coulomb, iterations=QUICK)
    if merit > exact:
        x, merit = yielding_steps(S, x, coulomb=coulomb)
    return x, merit, S


def _portfolio(P: GaussProblem, law: str) -> tuple[Array, float]:
    """(row impulses, residual) by the solvers of `rbd.ConeSolver`, one after another."""
    found = Solution.of(ConeSolver(law=law).solve_from(P, None, others=False))
    if not found.residuals.within(REST_SPEED):  # of which `simulate` warns where it is above USABLE
        names = ", ".join(r.name for r in P.rows)
        raise NoSolution(
            f"no velocity satisfies the contact law together with {names}: {found.reason or found.worst}.",
            problem=P,
            result=found,
        )
    return found.multipliers, found.residuals.worst


def independent_rows(
    W: Array, c: Array, held: Array, drift: float, norms: Array | None = None
) -> tuple[Array, Array, float, Array, bool]:
    """(W, c, largest part of c left out, norms, whether rows are dependent): the given W and c if they are independent.

    A hinge that closes a planar loop has five rows, two of them independent; in Bricard's
    mechanism four of five are. This is true only on the constraints. If the pose is off by `drift`, as in the middle of a
    step, the rows differ by as much, and all of them together would allow no motion. With W = L^-1 J^T and
    rows divided by their norms, singular values below `OWED` times drift, relative to the largest, are therefore left out,
    with the prescribed velocities there.

    Args:
        W: L^-1 J^T, shape (nv, m).
        c: Velocity of the rows less J v, shape (m,).
        held: Which rows are bilateral, indices.
        drift: Their position error [m, rad].
        norms: The norms that an earlier call for these rows returned: a row is scaled by its largest norm so far.
    """
    H = W[:, held]
    lengths = np.maximum(np.sqrt(np.einsum("ij,ij->j", H, H)), 0.0 if norms is None else norms)
    most = float(lengths.max())
    lengths = np.maximum(lengths, 1e-6 * most) if most > 0.0 else np.ones(len(lengths))
    R, info = lapack.dpotrf(H.T @ H, lower=0, clean=0)
    if info == 0 and (R.diagonal() > INDEPENDENT * lengths).all():
        return W, c, 0.0, lengths, False
    U, s, Vt = np.linalg.svd(H / lengths, full_matrices=False)
    kept = s > max(ZERO, OWED * drift) * s[0]
    if kept.all() and len(s) == len(held):
        return W, c, 0.0, lengths, False
    U, s, Vt = U[:, kept], s[kept], Vt[kept]
    given = c[held] / lengths
    within = Vt.T @ (Vt @ given)
    W, c = W.copy(), c.copy()
    W[:, held], c[held] = (U * s) @ Vt * lengths, within * lengths
    return W, c, max_abs((given - within) * lengths), lengths, True


def _least_merit(rate: float) -> float:
    """Largest merit of an answer: for tiny velocities rounding exceeds `EXACT`."""
    return max(EXACT, ROUNDING / rate)


def _bilateral(D: Array, u: Array, size: float, problem: Callable[[], GaussProblem]) -> tuple[Array, float]:
    """(impulses of bilateral rows, of least norm where rows are dependent; their residual, relative)."""
    R = independent_factor(D)
    if R is not None:
        f = -lapack.dpotrs(R, u)[0]
    else:
        W = problem().whitened
        f = np.linalg.lstsq(W, -np.linalg.lstsq(W.T, u, rcond=1e-10)[0], rcond=1e-10)[0]
    return f, max_abs(D @ f + u) / size
