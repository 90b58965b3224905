"""The convex set of all forces that give the same motion under the same law.

With a given, the equations of motion leave J^T f = M a - rhs, and the law admits at each point only forces compatible with
its acceleration y (of a column of `rbd.problem.force_set`):

    opens (y in the interior of K*)     no force
    sticks (y = 0)                      any force of its set
    slips (y on the boundary of K*)     the edge of the cone perpendicular to y
    an interval                         its bound: low where y > 0, high where y < 0

Up to `STILL`, over the terms of its row or point (`rbd.problem.residuals`), y counts as zero; and a weight is at its bound
only where its acceleration, so scaled, is larger than its distance from the bound, over the scale of that point's forces.
The set is {x : x = start + null z, D x >= d, cones}: x holds the corner forces of contacts and the row forces of all
other constraints. A bilateral contact too is given by corner forces, without bounds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array, block_diagonal, lazy, null_space, rank_of
from rbd.problem.answer import corner_map
from rbd.problem.cones import project_cones
from rbd.problem.conic import Conic, Unknowns
from rbd.problem.force_set import Element, at_rest
from rbd.problem.gauss_problem import GaussProblem, Law
from rbd.problem.residuals import SOLVED, Scales
from rbd.problem.rows import Rows

STILL = SOLVED
"""Accelerations below this, over the terms of their row or point, count as zero: the tolerance of `solved`."""
_FLAT = 1e-3
"""Below this friction, facets bound the normal force only up to rounding: its sign gets a separate inequality."""


@dataclass(frozen=True, eq=False)
class Admissible:
    """The forces that give the same motion under the same law; n columns in all.

    Attributes:
        problem: The problem.
        rows: f = rows x + rows_at, shapes (m, n) and (m,).
        rows_at: See there.
        corners: Corner forces of contacts and row forces of other constraints, stacked: corners x + corners_at, shapes (s, n)
            and (s,); world axes [N]; row forces in units of their rows.
        corners_at: See there.
        weights: The law's weights are weights x + weights_at, except of pyramids (`whole`), shapes (r, n) and (r,).
        weights_at: See there.
        spans: {constraint: its part of the stack}.
        has_corners: Names of the constraints that are contacts.
        D: D x >= d, shape (q, n): bounds and pyramids.
        d: See there, shape (q,).
        cone_at: First columns of circular cones (tangent, tangent, normal), shape (k,).
        mu: Their friction coefficients, shape (k,).
        whole: (columns, law's columns, mu, facets) of each pyramid that may use all its rays.
        start: The answer that was given, shape (n,).
        null: Directions that do not change the motion, orthonormal columns, shape (n, z).
        rank: Of J.
        active_rank: Rank of J^T over the forces that the law admits, not counting internal ones.
        size: Size of the forces [N], at least 1: the scale of tolerances.
    """

    problem: GaussProblem
    rows: Array
    rows_at: Array
    corners: Array
    corners_at: Array
    weights: Array
    weights_at: Array
    spans: dict[str, slice]
    has_corners: frozenset[str]
    D: Array
    d: Array
    cone_at: Array
    mu: Array
    whole: tuple[tuple[slice, slice, float, int], ...]
    start: Array
    null: Array
    rank: int
    active_rank: int
    size: float

    def forces(self, x: Array) -> Array:
        """Row forces, shape (m,)."""
        return self.rows @ x + self.rows_at

    def law_weights(self, x: Array) -> Array | None:
        """Weights under the law of the answer, or None where all rows are bilateral."""
        if self.problem.bilateral:
            return None
        w = self.weights @ x + self.weights_at
        for mine, law, mu, facets in self.whole:
            w[law] = ray_weights(x[mine], mu, facets)
        return w

    def corner_forces(self, x: Array) -> dict[str, Array]:
        """{contact: corner forces in world axes, shape (k, 3)} [N]."""
        stacked = self.corners @ x + self.corners_at
        return {name: stacked[span].reshape(-1, 3).copy() for name, span in self.spans.items() if name in self.has_corners}

    @property
    def cone_columns(self) -> Array:
        """Columns of the circular cones, shape (k, 3)."""
        return self.cone_at[:, None] + np.arange(3)

    def separable(self, squares: Array, linear: Array) -> Conic | None:
        """1/2 y . squares y + linear . y over the set, y = x / size, where bounds and weights are of single columns.

        Args:
            squares: Shape (n, n).
            linear: Shape (n,).

        Returns:
            The program; None where squares is not diagonal, or differs within a cone, or where pyramids bound several columns.
        """
        d = squares.diagonal()
        of_cones = d[self.cone_columns]
        alike = np.abs(of_cones - of_cones[:, :1]).max(initial=0.0) <= 1e-12 * d.max(initial=0.0)
        diagonal = np.abs(squares - np.diag(d)).max(initial=0.0) <= 1e-12 * d.max(initial=0.0)
        if self.whole or not (alike and diagonal and (d > 1e-12 * d.max(initial=0.0)).all()):
            return None
        lower, upper = self.bounds
        y, R = self.start / self.size, null_space(self.null.T).T
        block = Unknowns(len(y), d, linear, lower / self.size, upper / self.size, self.cone_columns, self.mu)
        return Conic.of({"y": block}, [({"y": R}, R @ y)])

    @lazy
    def bounds(self) -> tuple[Array, Array]:
        """(lower, upper) of single columns, shapes (n,); without the inequalities of pyramids, which couple three columns."""
        lower, upper = np.full(len(self.start), -math.inf), np.full(len(self.start), math.inf)
        for row, level in zip(self.D, self.d, strict=True):
            (at,) = np.nonzero(row)
            if len(at) == 1:
                j, bound = int(at[0]), level / row[at[0]]
                if row[j] > 0.0:
                    lower[j] = max(lower[j], bound)
                else:
                    upper[j] = min(upper[j], bound)
        return lower, upper

    def kept(self, x: Array) -> Array:
        """Project x onto bounds and cones that rounding violates, shape (n,)."""
        x = np.minimum(np.maximum(x, self.bounds[0]), self.bounds[1])
        if len(self.mu):
            x[self.cone_columns] = project_cones(x[self.cone_columns], self.mu)
        return x

    def outside(self, x: Array) -> float:
        """Largest violation of bounds and cones; not positive inside [N]."""
        c = x[self.cone_columns]
        beyond = np.hypot(c[:, 0], c[:, 1]) - self.mu * c[:, 2]
        return float(np.concatenate([self.d - self.D @ x, beyond]).max(initial=-math.inf))


def ray_weights(p: Array, mu: float, facets: int) -> Array:
    """Weights of a pyramid's rays that add up to the force p (tangent, tangent, normal); not negative inside it.

    The two rays next to p carry its tangential part; all rays share the remaining normal part equally.
    """
    w = np.zeros(facets)
    radius = mu / math.cos(math.pi / facets)
    if radius > 0.0:
        turn = 2.0 * math.pi / facets
        k = math.floor((math.atan2(p[1], p[0]) - 0.5 * turn) / turn)
        pair = [k % facets, (k + 1) % facets]
        angle = (np.array(pair) + 0.5) * turn
        w[pair] = np.linalg.solve(radius * np.array([np.cos(angle), np.sin(angle)]), p[:2])
    return w + (p[2] - w.sum()) / facets


def admissible(
    problem: GaussProblem, a: Array, f: Array, weights: Array | None, law: Law, *, tolerance: float = STILL
) -> Admissible:
    """The set around one answer.

    Args:
        problem: The problem.
        a: Acceleration, shape (nv,).
        f: Row forces, shape (m,).
        weights: As `Answer.weights`.
        law: As `Answer.law`.
        tolerance: Accelerations up to this, scaled, count as zero.
    """
    return _Collector(problem, a, f, weights, law, tolerance).collected()


class _Collector:
    """Builder of the set, one column or block at a time."""

    def __init__(self, problem: GaussProblem, a: Array, f: Array, weights: Array | None, law: Law, tolerance: float) -> None:
        P = problem
        self.P, self.tolerance, self.coulomb = P, tolerance, law.kind == "coulomb"
        self.T = T = P.force_set_of(law)
        self.y = T.accelerations(P.J @ a + P.offset)
        self.w = f if P.bilateral else T.weights_of(f) if weights is None else np.asarray(weights)
        self.along, self.push = Scales(P, a, f).of_columns(self.w, law)
        self.weights_at = np.zeros(T.size)
        self.columns: list[Array] = []
        self.start: list[float] = []
        self.bounds: list[tuple[float, float]] = []
        self.faces: list[tuple[int, Array]] = []
        self.cones: dict[int, float] = {}  # friction coefficient by the first column
        self.whole: list[tuple[slice, slice, float, int]] = []

    def collected(self) -> Admissible:
        P, T = self.P, self.T
        spans, maps, held, at = {}, [], [], 0
        kinds = {rows.name: corner_kind(rows, at_rest(rows.cone).bilateral) for rows in P.rows}
        for i, rows in enumerate(P.rows):
            maps.append(self._corner_map(i, rows, kinds[rows.name]))
            spans[rows.name] = slice(at, at + len(maps[-1]))
            if kinds[rows.name] == "expanded":
                held.append((at, len(self.start), rows))
                self._add_held_patch(rows, T.slices[i])
            else:
                for e in [e for e in T.elements if e.rows == i]:
                    self._add_element(e)
            at = spans[rows.name].stop
        n = len(self.start)
        weights, to_corners = np.array(self.columns).reshape(n, T.size).T, np.vstack([np.zeros((0, T.size)), *maps])
        corners, corners_at, start = to_corners @ weights, to_corners @ self.weights_at, np.array(self.start)
        for row, column, rows in held:
            assert rows.patch is not None
            k = len(rows.patch.corners)
            corners[row : row + 3 * k, column : column + 3 * k] = block_diagonal([rows.patch.axes] * k)
        D, d = self._inequalities(n)
        row_forces, rank = T.G @ weights, rank_of(P.J)
        null = null_space(row_forces if rank == P.m else P.J.T @ row_forces)
        size = max(1.0, float(np.abs(corners @ start + corners_at).max(initial=0.0)))
        cone_at, mu = np.array([*self.cones], int), np.array([*self.cones.values()])
        return Admissible(
            P, row_forces, T.G @ self.weights_at, corners, corners_at, weights, self.weights_at, spans,
            frozenset(name for name, kind in kinds.items() if kind != "none"), D, d, cone_at, mu, tuple(self.whole),
            start, null, rank, n - null.shape[1], size,
        )  # fmt: skip

    def _corner_map(self, i: int, rows: Rows, kind: str) -> Array:
        """Maps weights to a contact's corner forces, or to row forces without corners; zero for a bilateral patch."""
        T, G = self.T, self.T.G[self.P.slices[rows.name]]
        if kind == "none" or rows.patch is None or rows.resultant is None:
            return G
        if kind == "one":
            return np.asarray(rows.resultant[:3] @ G)
        out = np.zeros((3 * len(rows.patch.corners), T.size))
        if kind == "pieces":
            local = T.point_map(i)
            assert local is not None
            out = (rows.patch.corner_axes @ local.reshape(-1, 3, T.size)).reshape(-1, T.size)
        return out

    def _inequalities(self, n: int) -> tuple[Array, Array]:
        one, (low, high) = np.eye(n), np.array(self.bounds).reshape(n, 2).T
        below, above = np.isfinite(low), np.isfinite(high)
        faces = np.vstack([one[:0], *(normals @ one[j : j + 3] for j, normals in self.faces)])
        return np.vstack([one[below], -one[above], faces]), np.concatenate([low[below], -high[above], np.zeros(len(faces))])

    def _add_element(self, element: Element) -> None:
        if element.is_cone:
            self._add_circular(element)
            return
        at = range(element.columns.start, element.columns.stop)
        values = [self._decided(j) for j in at]
        if element.facets and all(value is None for value in values):
            self._add_pyramid(element)
            return
        for j, value in zip(at, values, strict=True):
            if value is not None:
                self.weights_at[j] = value
            else:
                self._put(slice(j, j + 1), np.ones(1), self.w[j], float(self.T.lower[j]), float(self.T.upper[j]))

    def _decided(self, j: int) -> float | None:
        """The value that the law prescribes for a weight, or None where it does not."""
        low, high, y = float(self.T.lower[j]), float(self.T.upper[j]), float(self.y[j] / self.along[j])
        if low == high:
            return low
        bound = low if y > 0.0 else high
        if not math.isfinite(bound) or abs(y) <= self.tolerance or abs(y) <= abs(self.w[j] - bound) / self.push[j]:
            return None
        return bound

    def _add_circular(self, element: Element) -> None:
        span, mu = element.columns, element.mu
        y, w = self.y[span], project_cones(self.w[span][None], np.array([mu]))[0]
        slip, at = math.hypot(y[0], y[1]), span.start
        of_slip, of_normal = float(self.along[at]), float(self.along[at + 2])
        size = max(slip / of_slip, abs(float(y[2])) / of_normal)
        opens = float(y[2]) / of_normal if self.coulomb else (float(y[2]) - mu * slip) / (of_normal + mu * of_slip)
        if size <= self.tolerance:
            self.cones[len(self.start)] = mu
            for axis, force in zip(np.eye(3), w, strict=True):
                self._put(span, axis, force)
        elif opens <= self.tolerance or w[2] / self.push[at] > size:
            edge = np.array([-mu * y[0] / slip, -mu * y[1] / slip, 1.0]) if slip > 0.0 else np.array([0.0, 0.0, 1.0])
            self._put(span, edge, w[2], 0.0)

    def _add_pyramid(self, element: Element) -> None:
        """Three columns: the force itself, within the facets."""
        span, first = element.columns, len(self.start)
        rays = self.T.push[span].T
        angle = 2.0 * math.pi * np.arange(element.facets) / element.facets
        inward = np.column_stack([-np.cos(angle), -np.sin(angle), np.full(element.facets, element.mu)])
        self.faces.append((first, inward / math.hypot(1.0, element.mu)))
        force = rays @ np.maximum(self.w[span], 0.0)
        for i, column in enumerate(np.linalg.pinv(rays).T):
            self._put(span, column, force[i], 0.0 if i == 2 and element.mu < _FLAT else -math.inf)
        self.whole.append((slice(first, first + 3), span, element.mu, element.facets))

    def _add_held_patch(self, rows: Rows, columns: slice) -> None:
        """A bilateral contact: forces at its corners, without bounds."""
        C, G = corner_map(rows), self.T.G[self.P.slices[rows.name], columns]  # G: identity, up to a selection of rows
        share = np.linalg.pinv(C) @ (G @ self.w[columns])
        for column, force in zip(np.linalg.solve(G, C).T, share, strict=True):
            self._put(columns, column, force)

    def _put(self, span: slice, column: Array, start: float, lower: float = -math.inf, upper: float = math.inf) -> None:
        """One more x: its contribution to the weights of a span of columns, its value in the answer, its bounds."""
        self.columns.append(np.zeros(self.T.size))
        self.columns[-1][span] = column
        self.start.append(float(min(max(start, lower), upper)))
        self.bounds.append((lower, upper))


def corner_kind(rows: Rows, held: bool) -> str:
    """How row forces depend on corner forces: "none", "one", "pieces" (each part is a corner) or "expanded" (bilateral)."""
    patch = rows.patch
    if patch is None or rows.resultant is None or not len(rows):
        return "none"
    if len(patch.corners) == 1:
        return "one"
    if rows.cone.at_points is not None:
        return "pieces"
    return "expanded" if held and len(rows) in (5, 6) else "none"
