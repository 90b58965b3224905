"""Ranges of linear functions over the set of admissible forces.

First by proximal steps, y_next = argmin |y - y_now|^2 / (2 t) - function, each a small dual problem of
`rbd.problem.conic` [Rockafellar1976]; a dual bound proves when they are within `EXACT` of the maximum. Where they do
not converge (sets without an interior, unbounded functions), by linear programs, and where cones are circular by an
interior-point method. Extreme values are attained.

The total cost is limited to a number of multiplications; ranges not found within it are reported as such.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array, hstack, identity

from rbd.answers.analysis.admissible_forces import Admissible
from rbd.arrays import Array, lazy, max_abs, null_space
from rbd.problem.cones import pyramid
from rbd.problem.conic import ConeSet, Separable, least_squares
from rbd.problem.programs import LinearAnswer, Work, linear_program
from rbd.solvers.conic_newton import interior_point, settled

EXACT = 1e-10
"""Accuracy of an extreme value, over the size of the forces."""
_TOUCHING = 8
_FAR = 1e4
_THIN = ((1e8, "highs"), (1e8, "highs-ipm"), (1e6, "highs"))
"""(scale, method) tried in turn: widths below one part in the scale count as zero, and programs are hard at that scale."""
_TIGHT = 1e-10
_PROVED = 1e-9
"""Largest excess of what Clarabel finds, by its multipliers, over the size of the forces."""
_NO_INTERIOR = 1e-8
"""Circular cones that leave a ball thinner than this, over the size of the forces, are widened."""
_INTERIOR_STEPS = 20.0
"""Steps of an interior-point method, for the count of the work."""
_PROXIMAL = (1.0, 30.0, 1e3, 3e4, 1e6, 1e6, 1e6, 1e6)
"""Lengths t of the proximal steps, over the size of the forces."""


@dataclass(frozen=True, eq=False)
class End:
    """The maximum of a function over the set.

    Attributes:
        value: Its largest value; inf where there is none, NaN where it was not found.
        x: Where it is attained, shape (n,), or None.
        found: Whether it was found within the work allowed.
    """

    value: float
    x: Array | None = None
    found: bool = True


NOT_FOUND = End(math.nan, None, False)


class Reach:
    """The admissible set in coordinates along the directions that do not change the motion, in units of its size.

    x = start + size * basis @ z, D z >= d, cones.

    Args:
        adm: The set.
        work: Budget of all its programs.
    """

    def __init__(self, adm: Admissible, work: Work) -> None:
        self.adm, self.work = adm, work
        self.basis = adm.null
        self.start = adm.start / adm.size
        self.known = True
        """Whether the dimension of the set was found; else all directions of `adm.null` are used."""
        self.thin = False
        """Whether circular cones leave the set no interior, so that they were widened by `EXACT`."""
        self.normals, self.offsets = self._planes()
        self.shut = self._shut()
        self.basis = self.basis @ null_space((self.normals @ self.basis)[self.shut])
        loose = null_space(np.vstack([self.normals, self._cone_rows()]) @ self.basis)
        self.loose = self.basis @ loose
        """Directions in which no bound and no cone is limiting, shape (n, .)."""
        self.basis = self.basis @ null_space(loose.T) if loose.size else self.basis
        self.open_cones = ~self.shut[len(adm.d) :].reshape(len(adm.mu), _TOUCHING).all(axis=1)

    @property
    def dimension(self) -> int:
        """Dimension of the set."""
        return self.basis.shape[1] + self.loose.shape[1]

    @property
    def directions(self) -> Array:
        """All directions within the set, shape (n, dimension)."""
        return np.hstack([self.basis, self.loose])

    def is_unique(self, functions: Array) -> bool:
        """Whether linear functions of x, shape (k, n), are constant over the set."""
        change = functions @ self.directions
        return bool(np.abs(change).max(initial=0.0) <= 1e-9 * max(1.0, float(np.abs(functions).max(initial=0.0))))

    def largest(self, function: Array) -> End:
        """The maximum of function . x."""
        x0 = self.adm.start
        if self.is_unique(function[None]):
            return End(float(function @ x0), x0.copy())
        if np.abs(function @ self.loose).max(initial=0.0) > 1e-9 * np.abs(function).max():
            return End(math.inf)
        if self.work.left < 0.0:
            return NOT_FOUND
        x = self._by_proximal_steps(function)
        if x is not None:
            return End(float(function @ x), x)
        endless = False if self.closed else self._endless(function)
        if endless:
            return End(math.inf)
        z = None if endless is None else self._farthest(function @ self.basis)
        if z is None or self.work.left < 0.0:
            return NOT_FOUND
        x = self.adm.kept(self.adm.size * (self.start + self.basis @ z))
        return End(float(function @ x), x)

    @lazy
    def closed(self) -> bool:
        """Whether the set was shown to be bounded."""
        found = self._along(self.normals.sum(axis=0))
        return found.solved and -found.value < 1e-7

    @lazy
    def _across(self) -> Array:
        """Orthonormal rows that are zero along the bounded directions, shape (., n)."""
        return null_space(self.basis.T).T

    def _count(self, found: LinearAnswer) -> None:
        self.work.spend(1e6 + 10.0 * found.pivots * (len(self.normals) + len(self.start)) * max(1, len(self._across)))

    @lazy
    def _rays(self) -> tuple[Array, Separable]:
        """(T, problem): the set as x = T y with y between bounds or in circular cones, pyramids by their rays."""
        adm, n = self.adm, len(self.start)
        columns: list[Array] = []
        lower: list[float] = []
        upper: list[float] = []
        y: list[float] = []
        low, high = adm.bounds
        pyramids = {mine.start: (mu, facets) for mine, _, mu, facets in adm.whole}
        j, place = 0, {}
        while j < n:
            place[j] = len(lower)
            mu, facets = pyramids.get(j, (0.0, 0))
            if not facets:
                columns.append(np.eye(n)[j][:, None])
                lower, upper, y = [*lower, low[j]], [*upper, high[j]], [*y, self.start[j]]
                j += 1
                continue
            block = np.zeros((n, facets))
            block[j : j + 3] = pyramid(mu, facets)
            columns.append(block)
            lower, upper = lower + [0.0] * facets, upper + [math.inf] * facets
            y += np.linalg.pinv(block[j : j + 3]).dot(self.start[j : j + 3]).tolist()
            j += 3
        T = np.hstack(columns) if columns else np.zeros((n, 0))
        across = null_space(adm.null.T).T
        cones = np.array([place[int(at)] for at in adm.cone_at], int)[:, None] + np.arange(3)
        R, none = across @ T, np.zeros(len(lower))
        return T, Separable(
            none + 1.0, np.array(y), R, across @ self.start, np.array(lower) / adm.size, np.array(upper) / adm.size,
            cones.reshape(-1, 3), adm.mu,
        )  # fmt: skip

    def _by_proximal_steps(self, function: Array) -> Array | None:
        """Where the function is largest; None where a dual bound does not prove convergence."""
        T, P = self._rays
        q = function @ T
        scale = max_abs(q)
        q = q / scale
        y, lam = P.c, np.zeros(len(P.b))
        for t in _PROXIMAL:
            step = replace(P, d=np.full(len(q), 1.0 / t), c=-q - y / t)
            found = least_squares(step, lam, self.work)
            if found is None or not max_abs(found[0]) <= _FAR:
                return None
            moved, (y, lam) = found[0] - y, found
            # q - moved / t + R^T lam is normal to the sets at y: a point at distance s is better by at most s |moved| / t.
            if _FAR * float(np.linalg.norm(moved)) / t <= EXACT:
                return self.adm.kept(self.adm.size * (T @ y))
        return None

    def _planes(self) -> tuple[Array, Array]:
        """(normals, offsets): normals @ x >= offsets in units of size; tangent planes in place of the cones."""
        adm, n = self.adm, len(self.start)
        angle = 2.0 * math.pi * np.arange(_TOUCHING) / _TOUCHING
        touching = np.zeros((len(adm.mu), _TOUCHING, n))
        for i, (at, mu) in enumerate(zip(adm.cone_at, adm.mu, strict=True)):
            inward = np.column_stack([-np.cos(angle), -np.sin(angle), np.full(_TOUCHING, mu)])
            touching[i, :, at : at + 3] = inward / math.hypot(1.0, mu)
        flat = touching.reshape(len(adm.mu) * _TOUCHING, n)
        return np.vstack([adm.D, flat]), np.concatenate([adm.d / adm.size, np.zeros(len(flat))])

    def _cone_rows(self) -> Array:
        rows = np.zeros((3 * len(self.adm.mu), len(self.start)))
        rows[np.arange(len(rows)), self.adm.cone_columns.ravel()] = 1.0
        return rows

    def _shut(self) -> Array:
        """Planes that contain the whole set, by the point of the widened set off the most planes.

        x / theta is in the set; theta >= 1 scales the relative interior away from the planes.
        """
        q, n = self.normals.shape
        if not q or not self.basis.shape[1]:
            return np.zeros(q, bool)
        # variables: x, theta, t <= 1: normals x - offsets theta - t >= 0, and across (x - theta start) = 0.
        # The planes have three entries each: in x the program is sparse, and in z it is not.
        across = null_space(self.basis.T).T
        A = hstack([csr_array(self.normals), csr_array(-self.offsets[:, None]), -identity(q)], format="csr")
        A_eq = np.hstack([across, -(across @ self.start)[:, None], np.zeros((len(across), q))])
        cost = np.concatenate([np.zeros(n + 1), -np.ones(q)])
        for scale, method in _THIN:
            limits = np.array([(-math.inf, math.inf)] * n + [(1.0, scale)] + [(0.0, 1.0)] * q)
            found = linear_program(cost, csr_array(-A), np.zeros(q), csr_array(A_eq), np.zeros(len(across)), bounds=limits,
                                   method=method)  # fmt: skip
            if found.solved:
                return np.asarray(found.x[n + 1 :] < 0.5)
        self.known = False
        return np.zeros(q, bool)

    def _along(self, function: Array) -> LinearAnswer:
        """The direction |x_i| <= 1 of the set along which a function grows most."""
        n, across = len(self.start), self._across
        found = linear_program(
            -function, csr_array(-self.normals), np.zeros(len(self.normals)), csr_array(across), np.zeros(len(across)),
            bounds=np.array([(-1.0, 1.0)] * n), tolerance=_TIGHT,
        )  # fmt: skip
        self._count(found)
        return found

    def _endless(self, function: Array) -> bool | None:
        """Whether the function is unbounded over the set; None where that was not found."""
        q = function @ self.basis
        scale = max_abs(q)
        if not len(self.adm.mu):
            found = self._along(self.basis @ q / scale)
            return -found.value > 1e-9 if found.solved else None
        on = self._cone_set
        away = ConeSet(on.A, np.zeros_like(on.b), on.C, np.zeros_like(on.at), on.mu).boxed(1.0).widened(EXACT)
        far = least(np.zeros((len(q), len(q))), -q / scale, away, self.work, 1e-6)
        return None if far is None else float(q @ far) > 1e-4 * scale

    def _farthest(self, q: Array) -> Array | None:
        """Where q . z is largest, shape (z,); None where it was not found."""
        scale = max_abs(q)
        if len(self.adm.mu):
            inside = self._cone_set if self.closed else self._cone_set.boxed(_FAR)
            return least(np.zeros((len(q), len(q))), -q / scale, inside, self.work)
        across = self._across
        found = linear_program(
            -self.basis @ (q / scale), csr_array(-self.normals), -self.offsets, csr_array(across), across @ self.start,
            tolerance=_TIGHT,
        )  # fmt: skip
        self._count(found)
        if not found.solved:
            return None
        A, b = self.normals @ self.basis, self.offsets - self.normals @ self.start
        return _on_planes(A, b, self.basis.T @ (found.x - self.start))

    @lazy
    def _cone_set(self) -> ConeSet:
        """The set with its circular cones; widened by `EXACT` where it has no interior."""
        adm, B = self.adm, self.basis
        kept, D = self.open_cones, adm.D[~self.shut[: len(adm.d)]]
        d = adm.d[~self.shut[: len(adm.d)]] / adm.size
        felt = np.abs(D @ B).max(axis=1, initial=0.0) > 1e-9
        C, at = B[adm.cone_columns[kept]], self.start[adm.cone_columns[kept]]
        on = ConeSet(D[felt] @ B, (d - D @ self.start)[felt], C, at, adm.mu[kept])
        # The largest margin tau <= 1: A z - tau >= b, |u_t| <= mu u_2 - tau.
        n = B.shape[1]
        with_margin = np.concatenate([on.C, np.zeros((len(on.mu), 3, 1))], axis=2)
        with_margin[:, 2, n] = -1.0 / on.mu
        rows = np.hstack([on.A, -np.ones((len(on.b), 1))])
        cap = np.append(np.zeros(n), -1.0)
        inner = ConeSet(np.vstack([rows, cap]), np.append(on.b, -1.0), with_margin, on.at, on.mu)
        deep = least(np.zeros((n + 1, n + 1)), cap, inner.boxed(_FAR), self.work)
        self.thin = deep is None or bool(deep[n] <= _NO_INTERIOR)
        return on.widened(EXACT) if self.thin else on

    @property
    def cone_set(self) -> ConeSet:
        """`_cone_set` over all `directions`, the unbounded ones last."""
        on, loose = self._cone_set, self.loose.shape[1]
        A = np.hstack([on.A, np.zeros((len(on.b), loose))])
        C = np.concatenate([on.C, np.zeros((len(on.mu), 3, loose))], axis=2)
        return replace(on, A=A, C=C)


def least(P: Array, q: Array, inside: ConeSet, work: Work, gap: float = _PROVED) -> Array | None:
    """Where 1/2 z . P z + q . z is least over a set, by Clarabel; None where that was not found, or no work is left.

    Args:
        P: Positive semidefinite, shape (z, z).
        q: Shape (z,).
        inside: The set.
        work: Limit of the cost.
        gap: Largest excess of the value, by the multipliers, and largest distance from the set.
    """
    program = inside.program(P, q)
    if not work.spend(_INTERIOR_STEPS * len(program.g) ** 2 * (len(program.g) / 3.0 + len(program.low)) + 1e5):
        return None
    found = interior_point(program)  # the set is not empty: no proof of that need be looked for
    found = settled(program, found, EXACT) or found
    met = found.solved or (program.outside(found.x) <= gap and program.excess(found.x, found.y, found.z) <= gap)
    return found.x[: len(q)] if met else None


def _on_planes(A: Array, b: Array, z: Array) -> Array:
    """The point projected onto its active planes: corrects the digits below the program's tolerance."""
    touched = np.abs(A @ z - b) <= 1e-8
    return np.asarray(z + np.linalg.lstsq(A[touched], b[touched] - A[touched] @ z, rcond=1e-12)[0])
