"""Planar images of convex sets of forces: all (p, q) for which there are forces, as a polygon with its proof.

    p in S     where     there is w with     A (w, p) = b,   low <= C (w, p) <= high,   w in intervals and circular cones

S is convex, and the point of it that is farthest along a direction d is a linear program, or one with cones. Each gives a point
of S, with forces w, and by its multipliers a half-plane d . p <= value that holds S. The points span the inner polygon, the
half-planes cut out the outer one; the next direction is across the edge where the two differ most [Bretl2008]. Without circular
cones S is a polygon, and the inner one ends as S itself.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from rbd.arrays import Array
from rbd.constraints.convex.polygons import convex_hull
from rbd.problem.conic import Conic
from rbd.problem.programs import POLYGON_PROGRAMS, Outcome, linear_program
from rbd.solvers.conic import solve_conic
from rbd.statics.loads import Loads

WITHIN_M = 10.0
"""A region without end is shown so far around its contacts."""
FARTHEST_M = 1e4
"""No region that ends is looked for beyond."""
SAME = 1e-9
"""An edge is that of the set where nothing of the set is farther than this beyond it, over the size of p."""
_TOLERANCE = 1e-10
_CONIC = 1e-7
_OUTSIDE = 1e-9
"""Forces of a conic program are this near to balance and to their cones, over the weight."""
_BEYOND = 1e-6
"""What the multipliers of a conic program prove is this near to what its forces reach."""
_START = 0.1
"""Angle of the first direction: off the axes, along which many regions have edges, and an edge is no vertex."""


@dataclass(frozen=True, eq=False)
class Program:
    """What forces w and two parameters p must meet, x = (w, p); its numbers should be around one.

    Attributes:
        A: Shape (e, n).
        b: Shape (e,).
        C: Shape (q, n).
        low: Shape (q,); -inf where there is none.
        high: Shape (q,); inf where there is none.
        lower: Bounds of x, shape (n,); -inf where there is none, and for the columns of cones.
        upper: Likewise.
        cones: Columns (tangent, tangent, normal) of the circular cones, shape (k, 3).
        mu: Their coefficients, shape (k,).
    """

    A: Array
    b: Array
    C: Array
    low: Array
    high: Array
    lower: Array
    upper: Array
    cones: Array
    mu: Array

    @classmethod
    def of(cls, A: Array, b: Array, C: Array, low: Array, high: Array, loads: Loads) -> Program:
        """With forces as weights of the loads, over their unit, and parameters of any size."""
        free, sets = np.full(A.shape[1] - loads.sets.size, np.inf), loads.sets
        lower, upper = np.concatenate([loads.lower, -free]), np.concatenate([loads.upper, free])
        return cls(A, b, C, low, high, lower, upper, sets.cone_columns, sets.mu)

    def around(self, middle: Array, within: float) -> Program:
        """The same, with the two parameters so near to a point."""
        lower, upper = self.lower.copy(), self.upper.copy()
        lower[-2:], upper[-2:] = middle - within, middle + within
        return replace(self, lower=lower, upper=upper)

    def farthest(self, gain: Array) -> Support:
        """The x with the largest gain . x, and the proof that there is no larger one.

        Args:
            gain: Shape (n,).
        """
        if len(self.mu):
            return self._farthest_of_cones(gain)
        up, down = np.isfinite(self.high), np.isfinite(self.low)
        rows = np.vstack([self.C[up], -self.C[down]])
        sides = np.concatenate([self.high[up], -self.low[down]])
        found = linear_program(
            -gain, rows, sides, self.A, self.b, bounds=np.column_stack([self.lower, self.upper]), tolerance=_TOLERANCE
        )
        if not found.solved:
            return Support(found.outcome, gain, found.x, math.nan, found.equal, found.lower)
        z = np.zeros(len(self.low))
        z[up] += found.lower[: int(up.sum())]
        z[down] -= found.lower[int(up.sum()) :]
        return Support(found.outcome, gain, found.x, self.bound(gain, found.equal, z), found.equal, z)

    def _farthest_of_cones(self, gain: Array) -> Support:
        n = len(gain)
        conic = Conic.of(
            np.zeros((n, n)), -gain, self.A, self.b, self.lower, self.upper, self.cones, self.mu, self.C, self.low, self.high
        )
        found = solve_conic(conic, newton=False, tolerance=_CONIC)
        proof = found.certificate
        gap = 0.0 if proof is None else -self.bound(np.zeros(n), proof.y, proof.z)  # p within its bounds counted in
        contradiction = None if proof is None or not gap > 0.0 else Contradiction(proof.y, proof.z, gap)
        if found.outcome in (Outcome.INFEASIBLE, Outcome.UNBOUNDED) or not len(found.y):
            return Support(found.outcome, gain, found.x, math.nan, found.y, found.z, contradiction)
        # What counts is that forces exist, and that nothing is farther than their proof says: not how the method ended.
        value = self.bound(gain, found.y, found.z)
        met = conic.outside(found.x) <= _OUTSIDE and value - float(gain @ found.x) <= _BEYOND
        return Support(Outcome.SOLVED if met else Outcome.NOT_FOUND, gain, found.x, value, found.y, found.z)

    def bound(self, gain: Array, y: Array, z: Array) -> float:
        """What gain . x does not exceed, by multipliers, whatever x is."""
        r = -gain - y @ self.A - z @ self.C
        side = np.where(z > 0.0, self.low, self.high)
        end = np.where(r > 0.0, self.lower, self.upper)
        end = np.where(np.isfinite(end), end, 0.0)  # there r is zero, or answers in the dual cone
        return -float(y @ self.b + z @ np.where(np.isfinite(side), side, 0.0) + r @ end)

    def contradiction(self) -> Contradiction | None:
        """The multipliers that prove that no x meets the program, by the least sum of what is missed; None if it is nothing."""
        (e, n), q = self.A.shape, len(self.low)
        A = np.hstack([self.A, np.eye(e), -np.eye(e), np.zeros((e, q))])
        give = np.hstack([np.zeros((q, 2 * e)), -np.eye(q)])
        C, up, down = np.vstack([np.hstack([self.C, give]), np.hstack([-self.C, give])]), self.high, -self.low
        sides = np.concatenate([up, down])
        kept = np.isfinite(sides)
        cost = np.concatenate([np.zeros(n), np.ones(2 * e + q)])
        bounds = np.column_stack([self.lower, self.upper]).tolist() + [(0.0, None)] * (2 * e + q)
        found = linear_program(cost, C[kept], sides[kept], A, self.b, bounds=bounds, tolerance=_TOLERANCE)
        if not found.solved:
            return None
        lower = np.zeros(2 * q)
        lower[kept] = found.lower
        z = lower[:q] - lower[q:]
        gap = -self.bound(np.zeros(n), found.equal, z)
        return Contradiction(found.equal, z, gap) if gap > SAME else None

    @property
    def recession(self) -> Program:
        """The directions in which x may go on without end, cut at |p| <= 1."""

        def gone(bounds: Array) -> Array:
            return np.where(np.isfinite(bounds), 0.0, bounds)

        lower, upper = gone(self.lower), gone(self.upper)
        lower[-2:], upper[-2:] = -1.0, 1.0
        return replace(self, b=np.zeros(len(self.b)), low=gone(self.low), high=gone(self.high), lower=lower, upper=upper)


@dataclass(frozen=True, eq=False)
class Contradiction:
    """A combination of equations and bounds that no x meets.

    Attributes:
        y: Multipliers of A x = b, shape (e,).
        z: Multipliers of the rows between bounds, shape (q,).
        gap: With r = -A^T y - C^T z, y . b + z . s + r . x is at least this for all x and s within their bounds, and is zero
            for every x with A x = b and C x = s. Of circular cones r is in the dual cones to 1e-6.
    """

    y: Array
    z: Array
    gap: float


@dataclass(frozen=True, eq=False)
class Support:
    """The farthest x along a direction.

    Attributes:
        outcome: How the program ended; the rest is meaningless unless that is SOLVED.
        gain: The direction, shape (n,).
        x: Where it is farthest, shape (n,).
        value: What gain . x does not exceed, by the multipliers.
        y: Multipliers of A x = b: gain = -(A^T y + C^T z) - r, where r answers to the sets of x.
        z: Multipliers of the rows between bounds: positive where the lower one holds, negative where the upper one does.
        contradiction: Where there is no x, the proof, if one came with the answer.
    """

    outcome: Outcome
    gain: Array
    x: Array
    value: float
    y: Array
    z: Array
    contradiction: Contradiction | None = None

    @property
    def point(self) -> Array:
        """The two parameters, shape (2,)."""
        return self.x[-2:]

    @property
    def direction(self) -> Array:
        """The direction in the plane, shape (2,)."""
        return self.gain[-2:]


@dataclass(frozen=True, eq=False)
class PlanarSet:
    """An inner and an outer polygon of S.

    Attributes:
        outcome: SOLVED; INFEASIBLE where S is empty; NOT_FOUND where a program was not solved.
        inner: Corners of the inner polygon, counterclockwise, shape (k, 2); two of a segment, one of a point, none if empty.
        x: The forces and parameters at each corner, shape (k, n).
        outer: Corners of the outer polygon, shape (j, 2).
        supports: Farthest points, by the angle of their directions.
        programs: How many programs that took.
        contradiction: Of an empty S, the proof, if one came with the answer.
    """

    outcome: Outcome
    inner: Array
    x: Array
    outer: Array
    supports: tuple[Support, ...]
    programs: int
    contradiction: Contradiction | None = None

    @classmethod
    def none(cls, outcome: Outcome, programs: int = 1, contradiction: Contradiction | None = None) -> PlanarSet:
        """No polygon."""
        nothing = np.zeros((0, 2))
        return cls(outcome, nothing, nothing, nothing, (), programs, contradiction)


def planar_set(program: Program, *, area_gap: float = 0.0, size: float = 1.0) -> PlanarSet:
    """The polygon of a program whose p is bounded.

    Args:
        program: The program.
        area_gap: Outer less inner area that will do; with 0 edges are followed until each is proven.
        size: Of p: lengths below `SAME` times this are rounding.
    """
    n, most = program.A.shape[1], POLYGON_PROGRAMS
    around: list[Support] = []
    for angle in _START + np.arange(3) * (2.0 * np.pi / 3.0):
        found = program.farthest(np.concatenate([np.zeros(n - 2), [np.cos(angle), np.sin(angle)]]))
        if found.outcome is not Outcome.SOLVED:
            return PlanarSet.none(found.outcome, len(around) + 1, found.contradiction)
        around.append(found)
    open_ = [_between(around[i], around[(i + 1) % 3]) for i in range(3)]
    while sum(open_) > area_gap and len(around) < most:
        i = int(np.argmax(open_))
        a, b = around[i], around[(i + 1) % len(around)]
        along = b.point - a.point
        length = float(np.linalg.norm(along))
        if length <= SAME * size:
            open_[i] = 0.0
            continue
        found = program.farthest(np.concatenate([np.zeros(n - 2), [along[1] / length, -along[0] / length]]))
        if found.outcome is not Outcome.SOLVED:
            return PlanarSet.none(Outcome.NOT_FOUND, len(around) + 1)
        around.insert(i + 1, found)
        if found.direction @ (found.point - a.point) <= SAME * size:  # an edge of the set
            open_[i : i + 1] = [0.0, 0.0]
        else:
            open_[i : i + 1] = [_between(a, found), _between(found, b)]
    if sum(open_) > area_gap:
        return PlanarSet.none(Outcome.NOT_FOUND, len(around))
    return _polygons(tuple(around), size)


def planar_region(program: Program, area_gap: float = 0.0) -> tuple[PlanarSet, Array]:
    """The polygon of a program whose p is cut at `WITHIN_M`, and the directions in which it has no end, shape (r, 2).

    Args:
        program: Bounds of p `WITHIN_M` around some middle.
        area_gap: As of `planar_set`.
    """
    middle = 0.5 * (program.lower[-2:] + program.upper[-2:])
    found = planar_set(program, area_gap=area_gap)
    if not len(found.inner) or np.abs(found.inner - middle).max() < WITHIN_M * (1.0 - 1e-9):
        return found, np.zeros((0, 2))
    ends = planar_set(program.recession, area_gap=1e-4 if len(program.mu) else 0.0)
    if ends.outcome is not Outcome.SOLVED:
        return PlanarSet.none(Outcome.NOT_FOUND), np.zeros((0, 2))
    length = np.linalg.norm(ends.inner, axis=1)
    endless = length > 0.5  # cut at |p| <= 1: a direction without end reaches that
    if endless.any():
        return found, ends.inner[endless] / length[endless, None]
    return planar_set(program.around(middle, FARTHEST_M), area_gap=area_gap), np.zeros((0, 2))


def area_of(polygon: Array) -> float:
    """Of a polygon whose corners go counterclockwise [m2]; zero of fewer than three."""
    if len(polygon) < 3:
        return 0.0
    x, y = polygon.T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def _between(a: Support, b: Support) -> float:
    """Area that may be of the set beyond the line from one farthest point to the next."""
    corner = _corner(a, b)
    u, v = b.point - a.point, corner - a.point
    return 0.5 * abs(float(u[0] * v[1] - u[1] * v[0]))


def _corner(a: Support, b: Support) -> Array:
    """Where two half-planes' edges meet; of parallel ones the farthest point between."""
    D = np.array([a.direction, b.direction])
    determinant = D[0, 0] * D[1, 1] - D[0, 1] * D[1, 0]
    if abs(determinant) < 1e-12:
        return b.point
    return np.array([a.value * D[1, 1] - b.value * D[0, 1], b.value * D[0, 0] - a.value * D[1, 0]]) / determinant


def _polygons(around: tuple[Support, ...], size: float) -> PlanarSet:
    points = np.array([s.point for s in around])
    kept: list[int] = []
    for corner in convex_hull(_merged(points, 10.0 * SAME * size)):
        kept.append(int(np.argmin(np.abs(points - corner).sum(axis=1))))
    outer = convex_hull(np.array([_corner(s, around[(i + 1) % len(around)]) for i, s in enumerate(around)]))
    x = np.array([around[i].x for i in kept])
    return PlanarSet(Outcome.SOLVED, points[kept] + 0.0, x, outer + 0.0, around, len(around))


def _merged(points: Array, within: float) -> Array:
    """Points without those that repeat an earlier one."""
    out: list[Array] = []
    for p in points:
        if not any(np.abs(p - q).max() <= within for q in out):
            out.append(p)
    return np.array(out)
