"""Accelerations, forces and corrections on bilateral rows, also through a singular pose.

In y = L^T a, where M = L L^T, Gauss's principle is least squares: y nearest to L^-1 rhs with W^T y + offset = 0, W = L^-1 J^T.
Well-conditioned rows are solved by Cholesky's factor of W^T W; its error is rounding over s^2, s the least singular
value of W over the largest, so below s = 1e-2 the SVD of W is used, whose error is rounding over s.

Rows are divided by the largest norm that they had in this run, in |.|_M^-1, so that ranks have no units. (Their norm at this
state is not suitable: at a singular pose rows can vanish, and normalised rounding would count.)

Along a motion on constraints c(q) = 0, J a + J_dot v = 0 at every time. At a singular pose some combination u of rows has
u . J = 0, which does not restrict a; close to it u . J = O(t), and its equation holds divided by t. That limit is the
derivative along the motion,

    u . [J_dot a + (d/dt J_dot v)(a)] = 0,        d/dt J_dot v = dq (J_dot v) . v + dv (J_dot v) . a ,

linear in a (it is c''' with u . J = 0, so that the unknown jerk drops out). The force of these rows is along the
limit of u . J / t, which is u . J_dot: a finite force on the motion, of multipliers that grow without bound.

Directly, near the pose, rounding e limits position to e / s, the velocity across the branch to e / s^2, and a to e /
s^3, s the least singular value over the largest. So below s = 2e-3 (`NEAR`: 1e-7 of a at the edge) neither positions
nor velocities are projected along small singular values, and a is the limit above, with error O(s). It is a first
guess: from it neighbours on the branch are computed at 3, 6 and 9 times that distance, ahead and behind, where a is
accurate, and a is interpolated from theirs to order 6 (`SmoothMotion._across`). Measured on an antiparallelogram, a kite and
N-four-bars, for any step times: energy changes by 1e-8 to 1e-13 a crossing at 1 ms, 16 times less or better at half the
step. A cut of the singular values alone, from 1e-8 to 1e-5, leaves the branch or changes it by 1e-6 to 1e-3.

Constraints that only nearly cross (s does not reach zero) deflect the motion: rows then require more than s |a|, or
neighbours are off the path, and the rows are used as given. With v = 0 at the pose, or linearly dependent
derivatives, the branches are not distinguished, and Gauss's principle without those rows is used.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, blas, lapack, lazy, max_abs
from rbd.constraints.manifold import ZERO, StackedRows, poses_nearby
from rbd.errors import InputError, NoSolution
from rbd.mechanism.projection import correction

INDEPENDENT = 1e-2
"""Pivots of Cholesky's factor above this, over the rows' norms: well conditioned."""
NEAR = 2e-3
"""Singular values below this fraction of the largest: dependent rows, or nearly so; see above."""
OWED = 30.0
"""Largest singular value of redundant rows, over the largest, for a pose error of 1."""
SILENT = 1e-11
"""Rows whose norm, over the largest, is at most this are rounding."""
CONTRADICTION = 1e-3
"""Relative infeasible part of J_dot v above which there is no motion."""
ASIDE = 1e-4
"""Distance at which rows are compared on both sides of the pose, in the largest entry of v times the time [rad, m]."""
COUNTS = 1e-4
"""Singular values of u . J_dot below this, over |J_dot|, count as zero: rows that are redundant everywhere."""

ROUNDED = 1e-11
"""Error of differences of rounded rows: this times the largest singular value, over the time between the two sides."""


@dataclass(frozen=True, eq=False)
class SingularCrossing:
    """Conditions on y = L^T a beyond those of the rows, and the directions of their forces.

    Attributes:
        held: The rows.
        u: Combinations of scaled rows that do not restrict a here, shape (rank, m).
        J_dot: Of all scaled rows, shape (m, nv).
        turning: Rates of the scaled rows' J_dot v along the motion at constant v, shape (m,).
        F: Orthonormal directions of the forces on y, orthogonal to the regular rows, shape (nv, rank).
        norms: Divisors of the rows, shape (m,).
        rate: Rate of the least singular value, over the largest [1/s].
    """

    held: StackedRows
    u: Array
    J_dot: Array
    turning: Array
    F: Array
    norms: Array
    rate: float

    @property
    def rank(self) -> int:
        """Number of conditions."""
        return len(self.u)

    @classmethod
    def of(cls, held: StackedRows, U: Array, Vt: Array, first: float, k: int, norms: Array) -> SingularCrossing | None:
        """The conditions from derivatives, or None if there are none.

        Args:
            held: The rows.
            U: Singular vectors of the scaled W, shape (nv, nv).
            Vt: Right singular vectors, shape (m, m).
            first: The largest singular value.
            k: Number of regular singular values.
            norms: Divisors of the rows.
        """
        q, v, model = held.state.q, held.state.v, held.state.robot.model
        speed = max_abs(v)
        if speed == 0.0 or k == len(Vt) or k == len(v):
            return None
        e = ASIDE / speed
        ahead, behind = (held.elsewhere(pin.integrate(model, q, side * v), v) for side in (e, -e))
        J_dot = (ahead.J - behind.J) / (2.0 * e * norms[:, None])
        W_dot = blas.dtrsm(1.0, held.L, J_dot.T, lower=1)
        Q, s, Pt = np.linalg.svd(U[:, k:].T @ (W_dot @ Vt[k:].T))
        rank = int((s > max(COUNTS * float(np.linalg.norm(W_dot, 2)), ROUNDED * first / e)).sum())
        if not rank:
            return None
        turning = (ahead.offset - behind.offset) / (2.0 * e * norms)
        return cls(held, Pt[:rank] @ Vt[k:], J_dot, turning, U[:, k:] @ Q[:, :rank], norms, float(s[rank - 1]) / first)

    def through(self, y: Array) -> Array:
        """The y on the motion's branch, from the y by the rows alone."""
        told = np.column_stack([self._rate(column) for column in self.F.T])
        return y - self.F @ np.linalg.solve(told, self._rate(y) + self.u @ self.turning)

    def _rate(self, y: Array) -> Array:
        """The conditions' terms linear in a: u . [J_dot a + dv (J_dot v) . a], shape (rank,)."""
        held, v = self.held, self.held.state.v
        a = blas.dtrsv(held.L, y, lower=1, trans=1)
        size = max_abs(a)
        if size == 0.0:
            return np.zeros(self.rank)
        # The bias is quadratic in v: central differences of any width are exact, the wider the less rounding.
        w = a * (max_abs(v) / size)
        q = held.state.q
        bias = (held.elsewhere(q, v + w).offset - held.elsewhere(q, v - w).offset) * (size / (2.0 * max_abs(v)))
        return self.u @ (self.J_dot @ a + bias / self.norms)


@dataclass(frozen=True, eq=False)
class _Decomposed:
    """Factorisations of rows divided by their norms: for one `StackedRows` and one array of norms.

    Attributes:
        held: The rows.
        norms: Divisor of each row, shape (m,); never changed in place.
    """

    held: StackedRows
    norms: Array

    @lazy
    def factor(self) -> Array | None:
        """Upper R with R^T R = W^T W, or None if the rows are not well conditioned."""
        R = self.held.cholesky
        return R if R is not None and (R.diagonal() > INDEPENDENT * self.norms).all() else None

    @lazy
    def apart(self) -> tuple[Array, Array, Array]:
        """U (nv, nv), s, Vt of W with its rows divided by the norms."""
        return np.linalg.svd(self.held.W / self.norms)


@dataclass(frozen=True, eq=False)
class StageAcceleration:
    """An acceleration.

    Attributes:
        a: Shape (nv,).
        f: Row forces, shape (m,), if rows are well conditioned; else None.
        crossing: Replacement of the rows that do not restrict a here, or None.
    """

    a: Array
    f: Array | None
    crossing: SingularCrossing | None


class StageSolver:
    """Accelerations, forces and corrections on bilateral rows; it stores the rows' norms and their rank."""

    def __init__(self) -> None:
        self._norms = np.zeros(0)
        self._rank = -1  # not known yet
        self._last: _Decomposed | None = None

    def survey(self, held: StackedRows) -> None:
        """Record the rows' norms at the start, and half a radian around it: the start can be singular."""
        self.learn(held)
        robot = held.state.robot
        for q in poses_nearby(robot, held.state.q) if len(held.J) else ():
            try:
                there = held.elsewhere(q, robot.zero_v)
            except InputError:  # a constraint may be undefined there
                continue
            if len(there.J) == len(held.J):
                self.learn(there)

    def learn(self, held: StackedRows) -> None:
        """Record the rows' norms here."""
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
            # Out-of-plane rows of a planar loop are zero except for rounding: normalised they would count.
            # Rows that are zero exactly cannot; at 1e-6 a start at a singular pose is closer, 1e-13 rad in place of 1e-10.
            self._norms = np.where((norms > SILENT * most) | (norms == 0.0), np.maximum(norms, 1e-6 * most), most)

    def acceleration(self, held: StackedRows, rhs: Array, t: float, *, directly: bool = False) -> StageAcceleration:
        """The acceleration nearest to the free one that the rows allow.

        If fewer singular values than before are above `NEAR`, the motion crosses a singular pose: derivatives replace
        the degenerate rows, see `SingularCrossing`.

        Args:
            held: The rows.
            rhs: S^T tau + tau_ext - h, shape (nv,).
            t: Time, for messages.
            directly: Use the rows as given, also near a singular pose.

        Raises:
            NoSolution: rows that contradict each other, by name.
        """
        y = blas.dtrsv(held.L, rhs, lower=1)
        R, f, crossing = self._decomposed(held).factor, None, None
        if R is not None:
            self._rank = len(R)
            f = -lapack.dpotrs(R, held.W.T @ y + held.offset)[0]
            y = y + held.W @ f
        else:
            y, crossing = self._by_singular_values(held, y, t, directly=directly)
        return StageAcceleration(blas.dtrsv(held.L, y, lower=1, trans=1), f, crossing)

    def forces(self, held: StackedRows, a: Array, rhs: Array) -> tuple[Array, bool]:
        """(row forces (m,) that cause a, whether they are unique); if not, of minimum norm in scaled rows."""
        if not len(held.J):
            return np.zeros(0), True
        R = self._decomposed(held).factor
        y = blas.dtrsv(held.L, held.state.M @ a - rhs, lower=1)
        if R is not None:
            return lapack.dpotrs(R, held.W.T @ y)[0], True
        U, s, Vt = self._decomposed(held).apart
        s = s[s > 1e-13 * s[0]]  # at a crossing forces are large and act through small s
        f = Vt[: len(s)].T @ ((U[:, : len(s)].T @ y) / s) / self._norms
        return f, bool(len(s) == len(f) and s[-1] > ZERO * s[0])

    def law(self, held: StackedRows, a: Array, rhs: Array, f: Array | None) -> float:
        """Largest residual of the equations of motion and of the rows, each over its terms: `rbd.problem.residuals`."""
        if f is None:
            f, _ = self.forces(held, a, rhs)
        M, J = held.state.M, held.J
        own = np.maximum(np.maximum(np.abs(M) @ np.abs(a), np.abs(rhs)), np.minimum(M.diagonal(), 1.0))
        own = np.maximum(own, np.abs(J).T @ np.abs(f))
        rows = np.maximum(np.abs(J) @ np.abs(a) + np.abs(held.offset), 1.0)
        return max(max_abs((M @ a - rhs - J.T @ f) / own), max_abs((J @ a + held.offset) / rows))

    def back(self, held: StackedRows, error: Array, placed: Array | None, damping: float = 0.0) -> Array:
        """The least x in |.|_M with J x = error in the placed rows, shape (nv,); see `rbd.mechanism.projection`."""
        if placed is not None and not placed.all():
            return correction(held.L, held.J[placed], error[placed], damping=damping)
        R = self._decomposed(held).factor
        if R is not None:
            y = held.W @ lapack.dpotrs(R, error)[0]
        else:
            U, s, Vt = self._decomposed(held).apart
            s = s[: self._kept(s, held)]
            y = U[:, : len(s)] @ (s / (s * s + (damping * s[0]) ** 2) * (Vt[: len(s)] @ (error / self._norms)))
        return blas.dtrsv(held.L, y, lower=1, trans=1)

    def spread(self, held: StackedRows) -> float:
        """Least nonzero singular value over the largest; for independent rows an upper bound."""
        R = self._decomposed(held).factor
        if R is not None:
            return float((R.diagonal() / self._norms).min())
        _, s, _ = self._decomposed(held).apart
        kept = s[: self._kept(s, held)]
        return float(kept[-1] / kept[0]) if len(kept) else 1.0

    def _decomposed(self, held: StackedRows) -> _Decomposed:
        """Cached for a state and the present norms; recomputed when the norms change."""
        if len(self._norms) != len(held.J):
            self.learn(held)
        known = self._last
        if known is None or known.held is not held or known.norms is not self._norms:
            known = self._last = _Decomposed(held, self._norms)
        return known

    def _by_singular_values(
        self, held: StackedRows, free: Array, t: float, *, directly: bool
    ) -> tuple[Array, SingularCrossing | None]:
        """(y, replacement of degenerate rows or None)."""
        U, s, Vt = self._decomposed(held).apart
        offset = held.offset / self._norms
        size, owed = max(1.0, max_abs(offset)), OWED * held.drift
        near = self._near(s, held)
        if (near < self._rank or self._rank < 0) and not directly:
            crossing = SingularCrossing.of(held, U, Vt, float(s[0]), near, self._norms)
            y, missed = _nearest(U[:, :near], s[:near], Vt[:near], free, offset)
            # Rows of size s require at most s |y| on the branch; if they require more, they deflect it and do not cross.
            if crossing is not None and max_abs(missed) <= 3.0 * max(NEAR, owed) * max(size, float(s[0]) * max_abs(y)):
                self._rank = max(self._rank, near + crossing.rank)
                return crossing.through(y), crossing
        self._rank = max(self._rank, near)
        k = int((s > max(ZERO, owed) * s[0]).sum())
        y, missed = _nearest(U[:, :k], s[:k], Vt[:k], free, offset)
        if max_abs(missed) > max(CONTRADICTION, owed) * size:
            worst = int(np.argmax(np.abs(missed)))
            raise NoSolution(
                f"no acceleration satisfies the constraints together at t = {t:.6g} s: {held.name_of(worst)!r:.80} misses "
                f"{abs(float(missed[worst] * self._norms[worst])):.3g} m/s2 (or rad/s2)."
            )
        return y, None

    def _near(self, s: Array, held: StackedRows) -> int:
        """Number of singular values that are not nearly zero."""
        return int((s > max(NEAR, OWED * held.drift) * s[0]).sum()) if s[0] > 0.0 else 0

    def _kept(self, s: Array, held: StackedRows) -> int:
        """Number of singular values used in projections; at a crossing without the small ones."""
        k = self._near(s, held)
        return k if k < self._rank else int((s > max(ZERO, OWED * held.drift) * s[0]).sum())


def _nearest(U: Array, s: Array, Vt: Array, free: Array, offset: Array) -> tuple[Array, Array]:
    """(the y nearest to the free one with s U^T y + Vt offset = 0, the infeasible part of the offset)."""
    told = Vt @ offset
    return free - U @ (U.T @ free + told / s), offset - Vt.T @ told
