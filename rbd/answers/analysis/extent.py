"""Ranges of linear functions over the set of admissible forces.

First by proximal steps, y_next = argmin |y - y_now|^2 / (2 t) - function, each a small dual problem of
`rbd.solvers.conic_newton` [Rockafellar1976]; a dual bound proves when they are within `EXACT` of the maximum. Where they do
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
from rbd.problem.conic import Conic, Unknowns
from rbd.problem.programs import LinearAnswer, Work, linear_program
from rbd.solvers.conic_newton import by_dual, interior_point, settled

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
    def _rays(self) -> tuple[Array, Array, Conic]:
        """(T, start, program): the set as x = T y with y between bounds or in circular cones, pyramids by their rays."""
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
        low, high = np.array(lower) / adm.size, np.array(upper) / adm.size
        rays = Unknowns(len(y), 1.0, 0.0, low, high, cones.reshape(-1, 3), adm.mu)
        return T, np.array(y), Conic.of({"rays": rays}, [({"rays": across @ T}, across @ self.start)])

    def _by_proximal_steps(self, function: Array) -> Array | None:
        """Where the function is largest; None where a dual bound does not prove convergence."""
        T, y, program = self._rays
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
        away = _boxed(widened(replace(on, b=np.zeros_like(on.b), low=np.zeros_like(on.low)), EXACT), 1.0)
        far = least(0.0, -q / scale, away, self.work, 1e-6)
        return None if far is None else float(q @ far) > 1e-4 * scale

    def _farthest(self, q: Array) -> Array | None:
        """Where q . z is largest, shape (z,); None where it was not found."""
        scale = max_abs(q)
        if len(self.adm.mu):
            inside = self._cone_set if self.closed else _boxed(self._cone_set, _FAR)
            return least(0.0, -q / scale, inside, self.work)
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
    def _cone_set(self) -> Conic:
        """The set with its circular cones; widened by `EXACT` where it has no interior."""
        on, n = self._within(self.basis), self.basis.shape[1]
        # The largest margin tau <= 1: A z - tau >= b, |u_t| <= mu u_2 - tau.
        margin = Unknowns(1, upper=1.0, lower=-_FAR)
        down = np.zeros((len(on.b), 1))
        down[2::3, 0] = -1.0 / on.mu
        blocks = {"z": Unknowns(n, lower=-_FAR, upper=_FAR), "margin": margin, "u": _cones(on.mu)}
        equations = [({"z": on.A[:, :n], "u": on.A[:, n:], "margin": down}, on.b)]
        rows = {"z": on.C[:, :n], "margin": -np.ones((len(on.low), 1))}
        inner = Conic.of(blocks, equations, [(rows, on.low, math.inf)])
        deep = least(0.0, np.append(np.zeros(n), -1.0), inner, self.work)
        self.thin = deep is None or bool(deep[n] <= _NO_INTERIOR)
        return widened(on, EXACT) if self.thin else on

    def _within(self, B: Array) -> Conic:
        """The set along directions B: z, and the forces u of its circular cones."""
        adm, open_rows, kept = self.adm, ~self.shut[: len(self.adm.d)], self.open_cones
        D, d = adm.D[open_rows], adm.d[open_rows] / adm.size
        felt = np.abs(D @ self.basis).max(axis=1, initial=0.0) > 1e-9
        at = adm.cone_columns[kept]
        return cone_program(D[felt] @ B, (d - D @ self.start)[felt], B[at], self.start[at], adm.mu[kept])

    @property
    def cone_set(self) -> Conic:
        """The set with its circular cones over all `directions`, the unbounded ones last; widened where it has no interior."""
        on = self._cone_set
        return replace(self._within(self.directions), b=on.b, low=on.low)


def cone_program(A: Array, b: Array, C: Array, at: Array, mu: Array) -> Conic:
    """Any z with A z >= b, and with u = C z + at in circular cones; the unknowns are z, then u.

    Args:
        A: Shape (q, z).
        b: Shape (q,).
        C: Shape (k, 3, z): tangent, tangent, normal.
        at: Shape (k, 3).
        mu: Shape (k,).
    """
    k, n = 3 * len(mu), A.shape[1]
    blocks = {"z": Unknowns(n), "u": _cones(mu)}
    return Conic.of(blocks, [({"z": C.reshape(k, n), "u": -np.eye(k)}, -at.ravel())], [({"z": A}, b, math.inf)])


def _cones(mu: Array) -> Unknowns:
    return Unknowns(3 * len(mu), cones=np.arange(3 * len(mu)).reshape(-1, 3), mu=mu)


def widened(inside: Conic, by: float) -> Conic:
    """A `cone_program` with every bound and cone moved out."""
    b = inside.b.copy()
    b[2::3] -= by / inside.mu
    return replace(inside, b=b, low=inside.low - by)


def _boxed(inside: Conic, side: float) -> Conic:
    """A `cone_program` within |z_i| <= side."""
    lower, upper, z = inside.lower.copy(), inside.upper.copy(), inside.spans["z"]
    lower[z], upper[z] = -side, side
    return replace(inside, lower=lower, upper=upper)


def least(P: Array | float, q: Array, inside: Conic, work: Work, gap: float = _PROVED) -> Array | None:
    """Where 1/2 z . P z + q . z is least over a set, by Clarabel; None where that was not found, or no work is left.

    Args:
        P: Positive semidefinite, shape (z, z), or zero.
        q: Shape (z,).
        inside: The set; its first unknowns are z.
        work: Limit of the cost.
        gap: Largest excess of the value, by the multipliers, and largest distance from the set.
    """
    program, n = replace(inside, H=np.zeros_like(inside.H), g=np.zeros_like(inside.g)), len(q)
    program.H[:n, :n], program.g[:n] = P, q
    if not work.spend(_INTERIOR_STEPS * len(program.g) ** 2 * (len(program.g) / 3.0 + len(program.low)) + 1e5):
        return None
    found = interior_point(program)  # the set is not empty: no proof of that need be looked for
    found = settled(program, found, EXACT) or found
    met = found.solved or (program.outside(found.x) <= gap and program.excess(found.x, found.y, found.z) <= gap)
    return found.x[:n] if met else None


def _on_planes(A: Array, b: Array, z: Array) -> Array:
    """The point projected onto its active planes: corrects the digits below the program's tolerance."""
    touched = np.abs(A @ z - b) <= 1e-8
    return np.asarray(z + np.linalg.lstsq(A[touched], b[touched] - A[touched] @ z, rcond=1e-12)[0])
