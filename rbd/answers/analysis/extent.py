"""Ranges of linear functions over the set of admissible forces.

First by proximal steps, y_next = argmin |y - y_now|^2 / (2 t) - function, each a small dual problem of
`rbd.solvers.conic_newton` [Rockafellar1976]; a dual bound shows when they are within `EXACT` of the maximum. Where they do
not converge (sets without an interior, unbounded functions), by Clarabel and Newton's method from its point. Extreme values are
attained.

The total cost is limited to a number of multiplications; ranges not found within it are reported as such.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from rbd.answers.analysis.admissible_forces import Admissible
from rbd.arrays import Array, block_diagonal, lazy, max_abs, null_space
from rbd.problem.cones import pyramid
from rbd.problem.conic import Conic, Unknowns
from rbd.problem.programs import Outcome, Work, linear_program
from rbd.solvers.conic_newton import by_dual, interior_point, settled

EXACT = 1e-10
"""Accuracy of an extreme value, over the size of the forces."""
_TOUCHING = 8
_FAR = 1e4
_THIN = ((1e8, "highs"), (1e8, "highs-ipm"), (1e6, "highs"))
"""(scale, method) tried in turn: widths below one part in the scale count as zero, and programs are hard at that scale."""
_EXCESS = 1e-9
"""Largest excess of what Clarabel finds, by its multipliers, over the size of the forces."""
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
        """Whether bounds and cones were widened by `EXACT`, as they leave the set no interior."""
        self.normals, self.offsets = self._planes()
        self.basis = self.basis @ null_space((self.normals @ self.basis)[self._shut()])
        of_cones = np.eye(len(self.start))[adm.cone_columns.ravel()]
        loose = null_space(np.vstack([self.normals, of_cones]) @ self.basis)
        self.loose = self.basis @ loose
        """Directions in which no bound and no cone is limiting, shape (n, .)."""
        self.basis = self.basis @ null_space(loose.T) if loose.size else self.basis

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
        if (x := self._by_proximal_steps(function)) is None:
            q = function @ self.rays[0]
            outcome, x = self.least(np.zeros((len(q), len(q))), -q / max_abs(q))
            if outcome is Outcome.UNBOUNDED:
                return End(math.inf)
        return NOT_FOUND if x is None else End(float(function @ x), x)

    @lazy
    def rays(self) -> tuple[Array, Array, Conic]:
        """(T, start, program): the set as x = T y with y between bounds or in circular cones, pyramids by their rays."""
        adm, n = self.adm, len(self.start)
        pyramids = {mine.start: pyramid(mu, facets) for mine, _, mu, facets in adm.whole}
        inside = {at + k for at in pyramids for k in (1, 2)}
        blocks = {j: pyramids.get(j, np.eye(1)) for j in range(n) if j not in inside}
        free = {j: np.tile([[0.0], [math.inf]], R.shape[1]) for j, R in pyramids.items()}  # each ray
        single = np.array(adm.bounds) / adm.size
        low, high = np.hstack([np.zeros((2, 0)), *(free.get(j, single[:, j : j + 1]) for j in blocks)])
        places = dict(zip(blocks, np.cumsum([0, *(R.shape[1] for R in blocks.values())]), strict=False))
        cones = np.array([places[int(at)] for at in adm.cone_at], int)[:, None] + np.arange(3)
        T, across = block_diagonal(list(blocks.values())), null_space(adm.null.T).T
        y = np.concatenate([np.zeros(0), *(np.linalg.pinv(R) @ self.start[j : j + len(R)] for j, R in blocks.items())])
        rays = Unknowns(len(y), 1.0, 0.0, low, high, cones.reshape(-1, 3), adm.mu)
        return T, y, Conic.of({"rays": rays}, [({"rays": across @ T}, across @ self.start)])

    def _by_proximal_steps(self, function: Array) -> Array | None:
        """Where the function is largest; None where a dual bound does not show convergence."""
        T, y, program = self.rays
        q = function @ T
        scale = max_abs(q)
        q = q / scale
        lam = np.zeros(len(program.b))
        for t in _PROXIMAL:
            found = by_dual(replace(program, H=np.eye(len(q)) / t, g=-q - y / t), lam, self.work)
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

    def _shut(self) -> Array:
        """Planes that contain the whole set, by the point of the widened set off the most planes.

        x / theta is in the set; theta >= 1 scales the relative interior away from the planes.
        """
        q, n = self.normals.shape
        if not q or not self.basis.shape[1]:
            return np.zeros(q, bool)
        from scipy.sparse import csr_array, hstack, identity

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

    def least(self, H: Array, g: Array) -> tuple[Outcome, Array | None]:
        """(how it ended, x where 1/2 y . H y + g . y is least over the set x = T y of `rays`, by Clarabel and Newton's method).

        Without multipliers, as where the set has no interior, over bounds and cones wider by `EXACT`: then `thin` is set.

        Args:
            H: Positive semidefinite; sizes as T has columns.
            g: Likewise.
        """
        T, _, program = self.rays
        for by in (0.0, EXACT):
            if not self.work.spend(_INTERIOR_STEPS * len(g) ** 2 * (len(g) / 3.0 + len(program.b)) + 1e5):
                break
            out = np.zeros(len(g))
            out[program.cones[:, 2]] = by / program.mu  # of each normal force
            wider = replace(
                program, H=H, g=g - H @ out, b=program.b + program.A @ out, lower=program.lower - by, upper=program.upper + by
            )
            found = interior_point(wider)  # the set is not empty: no certificate that it is need be looked for
            if found.outcome is Outcome.UNBOUNDED:
                return Outcome.UNBOUNDED, None
            found = settled(wider, found, EXACT) or found
            near = found.solved or wider.outside(found.x) <= _EXCESS
            if near and (found.solved or wider.excess(found.x, found.y, found.z) <= _EXCESS):
                self.thin = self.thin or by > 0.0
                return Outcome.SOLVED, self.adm.kept(self.adm.size * (T @ (found.x - out)))
        return Outcome.NOT_FOUND, None
