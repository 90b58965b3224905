"""The convex set of all forces that give the same motion under the same law.

With a given, the equations of motion leave J^T f = M a - rhs, and the law leaves to each point only the forces that go with
its acceleration y (of a column of `rbd.problem.force_set`):

    opens (y in the interior of K*)     no force
    keeps still (y = 0)                 any force of its set
    slips (y on the boundary of K*)     the edge of the cone that y is perpendicular to
    an interval                         its bound: low where y > 0, high where y < 0

Up to `STILL`, over the terms of its own row or point (`rbd.problem.scales`), y counts as zero; and a weight is at its bound
only where its acceleration, so scaled, is larger than its distance from the bound, over the scale of that point's forces.
What is left is {x : x = start + null z, D x >= d, cones}: x holds the corner forces of contacts and the row forces of all
else. A contact that holds is split among its corners too, without bounds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rbd.analysis.cone_programs import Separable
from rbd.arrays import Array, lazy
from rbd.problem.cones import LineCone, NonNegative, Product, WrenchCone, project_cones
from rbd.problem.contact_force import corner_map
from rbd.problem.force_set import Element, at_rest
from rbd.problem.law import Law
from rbd.problem.problem import GaussProblem
from rbd.problem.residuals import SOLVED
from rbd.problem.rows import Rows
from rbd.problem.scales import Scales
from rbd.problem.subspaces import null_space, rank_of

STILL = SOLVED
"""Accelerations below this, over the terms of their own row or point, count as zero: it is what `solved` means."""
_AXES = np.eye(3)
_FLAT = 1e-3
"""Facets of less friction bound the normal force by their rounding over the friction: its sign is asked for itself."""


@dataclass(frozen=True, eq=False)
class Admissible:
    """The forces that give the same motion under the same law; n columns in all.

    Attributes:
        problem: What was solved.
        rows: f = rows x + rows_at, shapes (m, n) and (m,).
        rows_at: See there.
        corners: Corner forces of the contacts and row forces of the rest, stacked, are corners x + corners_at, shapes (s, n)
            and (s,); world axes [N]; the rest in units of their rows.
        corners_at: See there.
        weights: The law's weights are weights x + weights_at, pyramids (`whole`) apart, shapes (r, n) and (r,).
        weights_at: See there.
        spans: {constraint: its part of the stack}.
        has_corners: Names of the constraints that are contacts.
        D: D x >= d, shape (q, n): bounds and pyramids.
        d: See there, shape (q,).
        cone_at: First columns of circular cones (tangent, tangent, normal), shape (k,).
        mu: Their friction coefficients, shape (k,).
        whole: (columns, law's columns, mu, facets) of each pyramid that may use all its rays.
        start: The answer that was given, shape (n,).
        null: Directions that change no motion, orthonormal columns, shape (n, z).
        rank: Of J.
        active_rank: Rank of J^T over the forces that the law leaves, internal ones among them not counted.
        size: Size of the forces [N], at least 1: what small is measured against.
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
        """Weights as the law of the answer has them, or None where all rows hold."""
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

    def separable(self, squares: Array, linear: Array) -> Separable | None:
        """1/2 y . squares y + linear . y over the set, y = x / size, where bounds and weights are of single columns.

        Args:
            squares: Shape (n, n).
            linear: Shape (n,).

        Returns:
            The problem; None where squares is not diagonal, or differs within a cone, or where pyramids bound several columns.
        """
        d = squares.diagonal()
        of_cones = d[self.cone_columns]
        alike = np.abs(of_cones - of_cones[:, :1]).max(initial=0.0) <= 1e-12 * d.max(initial=0.0)
        diagonal = np.abs(squares - np.diag(d)).max(initial=0.0) <= 1e-12 * d.max(initial=0.0)
        if self.whole or not (alike and diagonal and (d > 1e-12 * d.max(initial=0.0)).all()):
            return None
        lower, upper = self.bounds
        y, R = self.start / self.size, null_space(self.null.T).T
        return Separable(d, linear, R, R @ y, lower / self.size, upper / self.size, self.cone_columns, self.mu)

    @lazy
    def bounds(self) -> tuple[Array, Array]:
        """(lower, upper) of single columns, shapes (n,); what pyramids ask of three together is left out."""
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
        """The same with what rounding took out of bounds and cones brought back, shape (n,)."""
        x = np.minimum(np.maximum(x, self.bounds[0]), self.bounds[1])
        if len(self.mu):
            x[self.cone_columns] = project_cones(x[self.cone_columns], self.mu)
        return x

    def outside(self, x: Array) -> float:
        """How far x is outside of bounds and cones, at most; not positive where it is inside [N]."""
        worst = float((self.d - self.D @ x).max(initial=-math.inf))
        if len(self.mu):
            c = x[self.cone_columns]
            worst = max(worst, float((np.hypot(c[:, 0], c[:, 1]) - self.mu * c[:, 2]).max()))
        return worst


def ray_weights(p: Array, mu: float, facets: int) -> Array:
    """Weights of a pyramid's rays that add up to the force p (tangent, tangent, normal); not negative inside it.

    The two rays beside p carry its tangential part, all rays evenly what is left of the normal one.
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
        problem: What was solved.
        a: Acceleration, shape (nv,).
        f: Row forces, shape (m,).
        weights: As `Answer.weights`.
        law: As `Answer.law`.
        tolerance: Accelerations up to this, scaled, count as zero.
    """
    return _Collector(problem, a, f, weights, law, tolerance).collected()


class _Collector:
    """Columns, collected one piece at a time."""

    def __init__(self, problem: GaussProblem, a: Array, f: Array, weights: Array | None, law: Law, tolerance: float) -> None:
        P = problem
        self.P, self.f, self.tolerance, self.coulomb = P, f, tolerance, law.kind == "coulomb"
        self.T = T = P.force_set_of(law)
        self.y = T.accelerations(P.J @ a + P.offset)
        self.w = f if P.bilateral else T.weights_of(f) if weights is None else np.asarray(weights)
        self.along, self.push = Scales(P, a, f).of_columns(self.w, law)
        self.weight_columns: list[Array] = []
        self.weights_at = np.zeros(T.size)
        self.corner_columns: list[tuple[int, Array]] = []
        self.start: list[float] = []
        self.bounds: list[tuple[float, float]] = []
        self.faces: list[tuple[int, Array]] = []
        self.cone_at: list[int] = []
        self.mu: list[float] = []
        self.whole: list[tuple[slice, slice, float, int]] = []
        self.spans: dict[str, slice] = {}
        self.with_corners: set[str] = set()
        self.corners_at: list[Array] = []
        self.at = 0

    def collected(self) -> Admissible:
        P = self.P
        for i, rows in enumerate(P.rows):
            self._add_rows(i, rows)
        n = len(self.start)
        weights = np.array(self.weight_columns).reshape(n, len(self.weights_at)).T
        corners = np.zeros((self.at, n))
        for j, (row, column) in enumerate(self.corner_columns):
            corners[row : row + len(column), j] = column
        D, d = self._inequalities(n)
        rows, start = self.T.G @ weights, np.array(self.start)
        rank = rank_of(P.J)
        null = null_space(rows if rank == P.m else P.J.T @ rows)
        corners_at = np.concatenate(self.corners_at) if self.corners_at else np.zeros(0)
        size = max(1.0, float(np.abs(corners @ start + corners_at).max(initial=0.0)))
        return Admissible(
            P, rows, self.T.G @ self.weights_at, corners, corners_at, weights, self.weights_at, self.spans,
            frozenset(self.with_corners), D, d, np.array(self.cone_at, int), np.array(self.mu), tuple(self.whole),
            start, null, rank, n - null.shape[1], size,
        )  # fmt: skip

    def _inequalities(self, n: int) -> tuple[Array, Array]:
        D, d = [], []
        for j, (low, high) in enumerate(self.bounds):
            for bound, sign in ((low, 1.0), (high, -1.0)):
                if math.isfinite(bound):
                    row = np.zeros(n)
                    row[j] = sign
                    D.append(row)
                    d.append(sign * bound)
        for j, normals in self.faces:
            for normal in normals:
                row = np.zeros(n)
                row[j : j + 3] = normal
                D.append(row)
                d.append(0.0)
        return np.array(D).reshape(len(d), n), np.array(d)

    def _add_rows(self, i: int, rows: Rows) -> None:
        kind = corner_kind(rows, at_rest(rows.cone).bilateral)
        if kind == "expanded":
            self._add_held_patch(rows, self.T.slices[i])
            return
        k = len(rows.patch.corners) if rows.patch is not None and kind != "none" else 0
        self.spans[rows.name] = slice(self.at, self.at + (3 * k if k else len(rows)))
        self.corners_at.append(np.zeros(3 * k if k else len(rows)))
        if k:
            self.with_corners.add(rows.name)
        for element in self.T.elements:
            if element.rows == i:
                self._add_element(rows, element, kind)
        self.at = self.spans[rows.name].stop

    def _add_element(self, rows: Rows, element: Element, kind: str) -> None:
        if element.is_cone:
            self._add_circular(rows, element, kind)
            return
        at = range(element.columns.start, element.columns.stop)
        values = [self._decided(j) for j in at]
        if element.facets and all(value is None for value in values):
            self._add_pyramid(rows, element, kind)
            return
        for j, value in zip(at, values, strict=True):
            if value is not None:
                self._add_constant(rows, element, kind, j, value)
            else:
                bounds = float(self.T.lower[j]), float(self.T.upper[j])
                self._put(rows, element, kind, self._unit(j), self.w[j], bounds, self.T.push[j])

    def _decided(self, j: int) -> float | None:
        """The value that the law leaves to a weight, or None where it has a choice."""
        low, high, y = float(self.T.lower[j]), float(self.T.upper[j]), float(self.y[j] / self.along[j])
        if low == high:
            return low
        bound = low if y > 0.0 else high
        if not math.isfinite(bound) or abs(y) <= self.tolerance or abs(y) <= abs(self.w[j] - bound) / self.push[j]:
            return None
        return bound

    def _add_circular(self, rows: Rows, element: Element, kind: str) -> None:
        span, mu = element.columns, element.mu
        y, w = self.y[span], project_cones(self.w[span][None], np.array([mu]))[0]
        slip, at = math.hypot(y[0], y[1]), span.start
        of_slip, of_normal = float(self.along[at]), float(self.along[at + 2])
        size = max(slip / of_slip, abs(float(y[2])) / of_normal)
        opens = float(y[2]) / of_normal if self.coulomb else (float(y[2]) - mu * slip) / (of_normal + mu * of_slip)
        if size <= self.tolerance:
            self.cone_at.append(len(self.start))
            self.mu.append(mu)
            for i in range(3):
                self._put(rows, element, kind, self._unit(at + i), w[i], (-math.inf, math.inf), self.T.push[at + i])
        elif opens <= self.tolerance or w[2] / self.push[at] > size:
            edge = np.array([-mu * y[0] / slip, -mu * y[1] / slip, 1.0]) if slip > 0.0 else np.array([0.0, 0.0, 1.0])
            column = np.zeros(len(self.weights_at))
            column[span] = edge
            self._put(rows, element, kind, column, w[2], (0.0, math.inf), edge @ self.T.push[span])

    def _add_pyramid(self, rows: Rows, element: Element, kind: str) -> None:
        """Three columns: the force itself, within the facets."""
        span, first = element.columns, len(self.start)
        rays = self.T.push[span].T
        force = rays @ np.maximum(self.w[span], 0.0)
        angle = 2.0 * math.pi * np.arange(element.facets) / element.facets
        inward = np.column_stack([-np.cos(angle), -np.sin(angle), np.full(element.facets, element.mu)])
        self.faces.append((first, inward / math.hypot(1.0, element.mu)))
        back = np.linalg.pinv(rays)
        for i in range(3):
            column = np.zeros(len(self.weights_at))
            column[span] = back[:, i]
            pushes = i == 2 and element.mu < _FLAT
            self._put(rows, element, kind, column, force[i], (0.0 if pushes else -math.inf, math.inf), _AXES[i])
        self.whole.append((slice(first, first + 3), span, element.mu, element.facets))

    def _add_constant(self, rows: Rows, element: Element, kind: str, j: int, value: float) -> None:
        self.weights_at[j] = value
        if value:
            self.corners_at[-1] += self._corner_column(rows, element, kind, self._unit(j), self.T.push[j])[1] * value

    def _unit(self, j: int) -> Array:
        column = np.zeros(len(self.weights_at))
        column[j] = 1.0
        return column

    def _put(
        self, rows: Rows, element: Element, kind: str, column: Array, start: float, bounds: tuple[float, float], push: Array
    ) -> None:
        low, high = bounds
        local, stacked = self._corner_column(rows, element, kind, column, push)
        self.corner_columns.append((self.spans[rows.name].start + local, stacked))
        self.weight_columns.append(column)
        self.start.append(float(min(max(start, low), high)))
        self.bounds.append(bounds)

    def _corner_column(self, rows: Rows, element: Element, kind: str, column: Array, push: Array) -> tuple[int, Array]:
        """(first row within the constraint's part of the stack, entries) of a column of weights that pushes so on its point."""
        span = self.P.slices[rows.name]
        if kind == "none":
            return 0, self.T.G[span] @ column
        assert rows.patch is not None
        if kind == "one":
            assert rows.resultant is not None
            return 0, (rows.resultant @ (self.T.G[span] @ column))[:3]
        return 3 * element.number, rows.patch.axes @ push

    def _add_held_patch(self, rows: Rows, columns: slice) -> None:
        """A contact that holds: forces at its corners, without bounds."""
        assert rows.patch is not None
        C, k = corner_map(rows), len(rows.patch.corners)
        G = self.T.G[self.P.slices[rows.name], columns]  # identity, up to the choice of rows
        share = np.linalg.pinv(C) @ (G @ self.w[columns])
        back = np.linalg.solve(G, C)
        self.spans[rows.name] = slice(self.at, self.at + 3 * k)
        self.with_corners.add(rows.name)
        self.corners_at.append(np.zeros(3 * k))
        for j in range(3 * k):
            column = np.zeros(len(self.weights_at))
            column[columns] = back[:, j]
            self.corner_columns.append((self.at + j - j % 3, rows.patch.axes[:, j % 3]))
            self.weight_columns.append(column)
            self.start.append(float(share[j]))
            self.bounds.append((-math.inf, math.inf))
        self.at += 3 * k


def corner_kind(rows: Rows, held: bool) -> str:
    """How row forces are made of corner forces: "none", "one", "pieces" (each part is a corner) or "expanded" (held)."""
    patch = rows.patch
    if patch is None or rows.resultant is None or not len(rows):
        return "none"
    if len(patch.corners) == 1:
        return "one"
    if isinstance(rows.cone, WrenchCone | LineCone | Product | NonNegative):
        return "pieces"
    return "expanded" if held and len(rows) in (5, 6) else "none"
