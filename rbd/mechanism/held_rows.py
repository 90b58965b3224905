"""Rows that hold, stacked at one state, and the linear algebra of one run on them.

In y = L^T a, where M = L L^T, Gauss's principle is least squares: y nearest to L^-1 rhs with W^T y + offset = 0, W = L^-1 J^T.
Rows that are well independent are solved by Cholesky's factor of W^T W; its error is rounding over s^2, s the least singular
value of W over the largest, so below s = 1e-2 W itself is taken apart by singular values, whose error is rounding over s.

Rows are divided by the largest norm that they had in this run, in |.|_M^-1, so that ranks know no units. (By their norm at this
state would not do: at a singular pose rows may vanish, and divided by rounding they would count.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.linalg import blas, lapack

from rbd.arrays import Array, inertia_factor, largest, lazy, zeros
from rbd.constraints.constraint import Constraint, rows_of
from rbd.errors import InputError, NoSolution
from rbd.mechanism.crossing import Crossing
from rbd.mechanism.projection import ZERO, correction
from rbd.model.state import State
from rbd.problem.cones import Free, Line
from rbd.problem.rows import Rows

INDEPENDENT = 1e-2
"""Pivots of Cholesky's factor above this, over the rows' norms: well independent."""
NEAR = 2e-3
"""Singular values below this fraction of the largest: the rows depend on each other, or nearly so; see `crossing`."""
OWED = 30.0
"""What a pose that is off by 1 may add to the singular values of redundant rows, over the largest, at most."""
SILENT = 1e-11
"""Rows whose length, over the longest's, is at most this say nothing: they are rounding."""
CONTRADICTION = 1e-3
"""A part of J_dot v that no acceleration meets, over its size, above which there is no motion."""


class HeldRows:
    """The rows of constraints that hold, at one state.

    Args:
        state: Where.
        constraints: Those that hold.
        carried: Which of them are on a ground that moves, and so have no place to be.

    Attributes:
        state: Where.
        rows: Of each constraint.
        J: Shape (m, nv).
        offset: J_dot v, and feedback, shape (m,).
        velocity: J v less the velocity of what is touched, shape (m,).
        error: Position errors, shape (m,); zero in rows that have none.
        placed: Which rows have one, shape (m,), bool; None for all.
    """

    def __init__(self, state: State, constraints: Sequence[Constraint], carried: Sequence[bool]) -> None:
        self.state, self.constraints, self.carried = state, constraints, carried
        self.rows = rows = rows_of(state, constraints)
        if len(rows) == 1:
            self.J, self.offset, self.velocity = rows[0].J, rows[0].bias, velocity_of(rows[0], state)
        elif rows:
            self.J = np.concatenate([r.J for r in rows])
            self.offset = np.concatenate([r.bias for r in rows])
            self.velocity = np.concatenate([velocity_of(r, state) for r in rows])
        else:
            self.J, self.offset, self.velocity = np.zeros((0, len(state.v))), zeros(0), zeros(0)
        if any([r.stabilised for r in rows]):
            self.offset = self.offset + np.concatenate([r.feedback for r in rows])
        masks = [_placed(r, state, c) for r, c in zip(rows, carried, strict=True)]
        if all([mask is None for mask in masks]):
            self.placed = None
            self.error = np.concatenate([r.error for r in rows]) if rows else zeros(0)
        else:
            self.placed = np.concatenate([np.ones(len(r), bool) if p is None else p for r, p in zip(rows, masks, strict=True)])
            errors = np.concatenate([zeros(len(r)) if r.error is None else r.error for r in rows])
            self.error = np.where(self.placed, errors, 0.0)

    def elsewhere(self, q: Array, v: Array) -> HeldRows:
        """The same constraints at another state."""
        return HeldRows(State(self.state.robot, q, v), self.constraints, self.carried)

    @property
    def drift(self) -> float:
        """Largest position error [m, rad]."""
        return largest(self.error)

    @property
    def drift_rate(self) -> float:
        """Largest velocity error [m/s, rad/s]."""
        return largest(self.velocity)

    def name_of(self, row: int) -> str:
        """The constraint of a row of the stack."""
        ends = np.cumsum([len(r) for r in self.rows])
        return self.rows[int(np.searchsorted(ends, row, side="right"))].name

    @lazy
    def L(self) -> Array:
        """Lower factor of M."""
        return inertia_factor(self.state.M)

    @lazy
    def W(self) -> Array:
        """L^-1 J^T, shape (nv, m)."""
        return blas.dtrsm(1.0, self.L, self.J.T, lower=1)

    @lazy
    def delassus(self) -> Array:
        """W^T W, shape (m, m)."""
        return self.W.T @ self.W

    @lazy
    def cholesky(self) -> Array | None:
        """Upper R with R^T R = W^T W; None where it is not positive definite."""
        R, info = lapack.dpotrf(self.delassus, lower=0, clean=1)
        return R if info == 0 else None


@dataclass(frozen=True, eq=False)
class _Decomposed:
    """What rows look like beside the norms that they are divided by: of one `HeldRows` and one array of norms.

    Attributes:
        held: The rows.
        norms: What each row is divided by, shape (m,); never changed in place.
    """

    held: HeldRows
    norms: Array

    @lazy
    def factor(self) -> Array | None:
        """Upper R with R^T R = W^T W, or None where the rows are not well independent."""
        R = self.held.cholesky
        return R if R is not None and (R.diagonal() > INDEPENDENT * self.norms).all() else None

    @lazy
    def apart(self) -> tuple[Array, Array, Array]:
        """U (nv, nv), s, Vt of W with its rows divided by the norms."""
        return np.linalg.svd(self.held.W / self.norms)


@dataclass(frozen=True, eq=False)
class Answer:
    """An acceleration.

    Attributes:
        a: Shape (nv,).
        f: Row forces, shape (m,), where rows are well independent; else None.
        crossing: What took the place of rows that say nothing here, or None.
    """

    a: Array
    f: Array | None
    crossing: Crossing | None


class StageSolver:
    """Accelerations, forces and corrections on held rows; it remembers the rows' norms and their rank."""

    def __init__(self) -> None:
        self._norms = np.zeros(0)
        self._rank = -1  # not known yet
        self._last: _Decomposed | None = None

    def survey(self, held: HeldRows) -> None:
        """Look at the rows' norms at the start, and half a radian around it: it may be a singular pose itself."""
        self.learn(held)
        rng, state = np.random.default_rng(0), held.state
        for _ in range(3 if len(held.J) else 0):
            z = rng.normal(size=len(state.v))
            try:
                there = held.elsewhere(pin.integrate(state.robot.model, state.q, 0.5 * z / np.linalg.norm(z)), 0.0 * z)
            except InputError:  # a constraint that is not defined there
                continue
            if len(there.J) == len(held.J):
                self.learn(there)

    def learn(self, held: HeldRows) -> None:
        """Look at the rows' norms here."""
        if not len(held.J):
            return
        norms = np.sqrt(held.delassus.diagonal())
        if len(self._norms) == len(norms):
            norms = np.maximum(norms, self._norms)
        elif len(self._norms):
            self._rank = -1
        most = float(norms.max())
        if most == 0.0:
            self._norms = np.ones(len(norms))
        else:
            # Rows out of the plane of a planar loop are zero but for rounding: dividing by their length would make them count.
            # Rows that are zero exactly cannot; at 1e-6 a start at a singular pose is closer, 1e-13 rad in place of 1e-10.
            self._norms = np.where((norms > SILENT * most) | (norms == 0.0), np.maximum(norms, 1e-6 * most), most)

    def acceleration(self, held: HeldRows, rhs: Array, t: float, *, directly: bool = False) -> Answer:
        """The acceleration nearest to the free one that the rows allow.

        Where fewer singular values are above `NEAR` than there once were, the motion crosses a singular pose; what the rows no
        longer say there their derivatives do, see `rbd.mechanism.crossing`.

        Args:
            held: The rows.
            rhs: S^T tau + tau_ext - h, shape (nv,).
            t: For messages.
            directly: From the rows as they are, also near a singular pose.

        Raises:
            NoSolution: rows that contradict each other, by name.
        """
        y = blas.dtrsv(held.L, rhs, lower=1)
        if not len(held.J):
            return Answer(blas.dtrsv(held.L, y, lower=1, trans=1), np.zeros(0), None)
        R, f, crossing = self._factor(held), None, None
        if R is not None:
            self._rank = len(R)
            f = -lapack.dpotrs(R, held.W.T @ y + held.offset)[0]
            y = y + held.W @ f
        else:
            y, crossing = self._by_singular_values(held, y, t, directly=directly)
        return Answer(blas.dtrsv(held.L, y, lower=1, trans=1), f, crossing)

    def forces(self, held: HeldRows, a: Array, rhs: Array) -> tuple[Array, bool]:
        """(row forces (m,) that make a, whether they are the only ones); of minimum norm in scaled rows where not."""
        if not len(held.J):
            return np.zeros(0), True
        R = self._factor(held)
        y = blas.dtrsv(held.L, held.state.M @ a - rhs, lower=1)
        if R is not None:
            return lapack.dpotrs(R, held.W.T @ y)[0], True
        U, s, Vt = self._taken_apart(held)
        s = s[s > 1e-13 * s[0]]  # at a crossing forces are large: what there is of s carries them
        f = Vt[: len(s)].T @ ((U[:, : len(s)].T @ y) / s) / self._norms
        return f, bool(len(s) == len(f) and s[-1] > ZERO * s[0])

    def law(self, held: HeldRows, a: Array, rhs: Array, f: Array | None) -> float:
        """The largest residual of the equations of motion and of the rows, each over its own terms (`rbd.problem.scales`)."""
        if f is None:
            f, _ = self.forces(held, a, rhs)
        M, J = held.state.M, held.J
        own = np.maximum(np.maximum(np.abs(M) @ np.abs(a), np.abs(rhs)), np.minimum(M.diagonal(), 1.0))
        own = np.maximum(own, np.abs(J).T @ np.abs(f))
        rows = np.maximum(np.abs(J) @ np.abs(a) + np.abs(held.offset), 1.0)
        return max(largest((M @ a - rhs - J.T @ f) / own), largest((J @ a + held.offset) / rows))

    def back(self, held: HeldRows, error: Array, placed: Array | None, damping: float = 0.0) -> Array:
        """The least x in |.|_M with J x = error in the placed rows, shape (nv,); see `rbd.mechanism.projection`."""
        if placed is not None and not placed.all():
            return correction(held.L, held.J[placed], error[placed], damping=damping)
        R = self._factor(held)
        if R is not None:
            y = held.W @ lapack.dpotrs(R, error)[0]
        else:
            U, s, Vt = self._taken_apart(held)
            s = s[: self._kept(s, held)]
            y = U[:, : len(s)] @ (s / (s * s + (damping * s[0]) ** 2) * (Vt[: len(s)] @ (error / self._norms)))
        return blas.dtrsv(held.L, y, lower=1, trans=1)

    def spread(self, held: HeldRows) -> float:
        """Least of the singular values that count, over the largest; of independent rows an upper bound of it."""
        R = self._factor(held)
        if R is not None:
            return float((R.diagonal() / self._norms).min())
        _, s, _ = self._taken_apart(held)
        kept = s[: self._kept(s, held)]
        return float(kept[-1] / kept[0]) if len(kept) else 1.0

    def _factor(self, held: HeldRows) -> Array | None:
        """Upper R with R^T R = W^T W, or None where the rows are not well independent."""
        return self._decomposed(held).factor

    def _taken_apart(self, held: HeldRows) -> tuple[Array, Array, Array]:
        """U (nv, nv), s, Vt of W with its rows scaled."""
        return self._decomposed(held).apart

    def _decomposed(self, held: HeldRows) -> _Decomposed:
        """Made once for a state and the norms of now; made anew where the norms have changed since."""
        if len(self._norms) != len(held.J):
            self.learn(held)
        known = self._last
        if known is None or known.held is not held or known.norms is not self._norms:
            known = self._last = _Decomposed(held, self._norms)
        return known

    def _by_singular_values(self, held: HeldRows, free: Array, t: float, *, directly: bool) -> tuple[Array, Crossing | None]:
        """(y, what took the place of rows that say nothing)."""
        U, s, Vt = self._taken_apart(held)
        offset = held.offset / self._norms
        size, owed = max(1.0, largest(offset)), OWED * held.drift
        near = self._near(s, held)
        if (near < self._rank or self._rank < 0) and not directly:
            crossing = Crossing.of(held, U, Vt, float(s[0]), near, self._norms)
            y, missed = _nearest(U[:, :near], s[:near], Vt[:near], free, offset)
            # Rows of size s cannot ask for more than s |y| on the branch; where they do they turn it away, and do not cross.
            if crossing is not None and largest(missed) <= 3.0 * max(NEAR, owed) * max(size, float(s[0]) * largest(y)):
                self._rank = max(self._rank, near + crossing.rank)
                return crossing.through(y), crossing
        self._rank = max(self._rank, near)
        k = int((s > max(ZERO, owed) * s[0]).sum())
        y, missed = _nearest(U[:, :k], s[:k], Vt[:k], free, offset)
        if largest(missed) > max(CONTRADICTION, owed) * size:
            worst = int(np.argmax(np.abs(missed)))
            raise NoSolution(
                f"no acceleration satisfies the constraints together at t = {t:.6g} s: {held.name_of(worst)!r:.80} misses "
                f"{abs(float(missed[worst] * self._norms[worst])):.3g} m/s2 (or rad/s2)."
            )
        return y, None

    def _near(self, s: Array, held: HeldRows) -> int:
        """How many singular values say something, and not nearly nothing."""
        return int((s > max(NEAR, OWED * held.drift) * s[0]).sum()) if s[0] > 0.0 else 0

    def _kept(self, s: Array, held: HeldRows) -> int:
        """How many singular values count where positions and velocities are brought back; at a crossing not the small ones."""
        k = self._near(s, held)
        return k if k < self._rank else int((s > max(ZERO, OWED * held.drift) * s[0]).sum())


def _nearest(U: Array, s: Array, Vt: Array, free: Array, offset: Array) -> tuple[Array, Array]:
    """(the y nearest to the free one with s U^T y + Vt offset = 0, what of the offset is out of reach)."""
    told = Vt @ offset
    return free - U @ (U.T @ free + told / s), offset - Vt.T @ told


def velocity_of(rows: Rows, state: State) -> Array:
    """J v less the velocity of what is touched; rows that give none get J v."""
    silent = rows.velocity is zeros(len(rows))
    return rows.J @ state.v if silent else rows.velocity


def holds(rows: Rows) -> bool:
    """Whether all forces are allowed: none is bounded, and none comes and goes (a stop that is not reached has no rows)."""
    parts = rows.cone.generators()[1]
    return all(isinstance(part, Line) for part in parts) and (len(parts) > 0 or isinstance(rows.cone, Free))


def _placed(rows: Rows, state: State, carried: bool) -> Array | None:
    """Which rows have a place to be; None for all."""
    if rows.error is None:
        return np.zeros(len(rows), bool)
    if not carried:
        return rows.holonomic
    if rows.holonomic is None:
        return np.zeros(len(rows), bool)
    surface = rows.J @ state.v - rows.velocity
    return rows.holonomic & (np.abs(surface) <= 1e-12 * max(1.0, largest(surface)))
