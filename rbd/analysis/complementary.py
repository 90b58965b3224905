"""Which forces complementarity admits, given the accelerations of the contact points.

    opens (y in the interior of K*)     no force
    keeps still (y = 0)                 any force of its set
    slips (y on the boundary of K*)     the edge of the cone that y is perpendicular to
    an interval                         its bound: low where y > 0, high where y < 0

y is the acceleration that a weight answers to: along a ray, or of `rbd.problem.parts`. Up to `STILL`, over the terms of its
own row or point (`rbd.problem.scales`), it counts as zero; and a weight is at its bound only where its acceleration, so
scaled, is larger than its distance from the bound, over the scale of that point's forces.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rbd.analysis.admissible import Admissible, null_space
from rbd.arrays import Array
from rbd.problem.cones import LineCone, NonNegative, Product, SecondOrderCone, WrenchCone, pyramid
from rbd.problem.contact_force import corner_map
from rbd.problem.law import Law
from rbd.problem.parts import bounded_weights, project_cones
from rbd.problem.problem import GaussProblem
from rbd.problem.rays import rays_of
from rbd.problem.residuals import SOLVED, Scales
from rbd.problem.rows import Rows

STILL = SOLVED
"""Accelerations below this, over the terms of their own row or point, count as zero: it is what `solved` means."""

_FLAT = 1e-3
"""Facets of less friction bound the normal force by their rounding over the friction: its sign is asked for itself."""


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


@dataclass(frozen=True, eq=False)
class Piece:
    """One simple part of one constraint: its columns in the law's weights, and what decides about them.

    Attributes:
        columns: Of the law's weights (rays or parts).
        push: Force of unit weights on the point, in contact axes, shape (3, n); None where there is no point.
        point: Number of the corner.
        lower: Bounds, shape (n,).
        upper: Likewise.
        mu: Friction coefficient of a second-order cone, 0 of anything else.
        facets: Rays of its pyramid; 0 where the cone is circular.
    """

    columns: slice
    push: Array | None
    point: int
    lower: Array
    upper: Array
    mu: float = 0.0
    facets: int = 0


class _Collector:
    """Columns, collected one piece at a time."""

    def __init__(self, problem: GaussProblem, a: Array, f: Array, weights: Array | None, law: Law, tolerance: float) -> None:
        P = problem
        self.P, self.f, self.tolerance, self.coulomb = P, f, tolerance, law.kind == "coulomb"
        self.by_rays = bool(law.facets) or P.bilateral
        c = P.J @ a + P.offset
        if self.by_rays:
            R = P.rays
            self.G, y, lower, upper, self.slices = R.G, R.G.T @ c, R.lower, R.upper, list(P.ray_slices)
            w = f if P.bilateral else weights
            if w is None:
                w = bounded_weights(R.G, f, lower, upper)
        else:
            T = P.parts
            y = T.accelerations(c, coulomb=False)
            self.G, lower, upper, self.slices = T.G, T.lower, T.upper, list(T.slices)
            w = T.weights_of(f) if weights is None else weights
        self.y, self.w, self.lower, self.upper = y, np.asarray(w), lower, upper
        self.along, self.push = Scales(P, a, f).of_columns(self.w, law)
        r = self.G.shape[1]
        self.weight_columns: list[Array] = []
        self.weights_at = np.zeros(r)
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
            self._add_rows(rows, self.slices[i])
        n = len(self.start)
        weights = np.array(self.weight_columns).reshape(n, len(self.weights_at)).T
        corners = np.zeros((self.at, n))
        for j, (row, column) in enumerate(self.corner_columns):
            corners[row : row + len(column), j] = column
        D, d = self._inequalities(n)
        rows, start = self.G @ weights, np.array(self.start)
        rank = null_space(P.J)[1] if P.m else 0
        null, active_rank = null_space(rows if rank == P.m else P.J.T @ rows)
        corners_at = np.concatenate(self.corners_at) if self.corners_at else np.zeros(0)
        size = max(1.0, float(np.abs(corners @ start + corners_at).max(initial=0.0)))
        return Admissible(
            P, rows, self.G @ self.weights_at, corners, corners_at, weights, self.weights_at, self.spans,
            frozenset(self.with_corners), D, d, np.array(self.cone_at, int), np.array(self.mu), tuple(self.whole),
            start, null, rank, active_rank, size,
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

    def _add_rows(self, rows: Rows, columns: slice) -> None:
        held = rays_of(rows.cone).all_lines
        kind = corner_kind(rows, held)
        if kind == "expanded":
            self._add_held_patch(rows, columns)
            return
        k = len(rows.patch.corners) if rows.patch is not None and kind != "none" else 0
        self.spans[rows.name] = slice(self.at, self.at + (3 * k if k else len(rows)))
        self.corners_at.append(np.zeros(3 * k if k else len(rows)))
        if k:
            self.with_corners.add(rows.name)
        for piece in self._pieces(rows, columns):
            self._add_piece(rows, piece, kind)
        self.at = self.spans[rows.name].stop

    def _pieces(self, rows: Rows, columns: slice) -> Iterator[Piece]:
        """The parts of a constraint as the law's weights have them."""
        at, T = columns.start, None if self.by_rays else self.P.parts
        first = {} if T is None else dict(zip(T.cone_at.tolist(), T.mu.tolist(), strict=True))
        if T is not None:
            while at < columns.stop:
                n = 3 if at in first else 1
                span = slice(at, at + n)
                yield Piece(span, T.push[span].T, int(T.point[at]), self.lower[span], self.upper[span], first.get(at, 0.0))
                at += n
            return
        for i, part in enumerate(rows.cone.generators()[1]):
            cone = isinstance(part, SecondOrderCone)
            n = part.facets if isinstance(part, SecondOrderCone) else 1
            span = slice(at, at + n)
            push = pyramid(part.mu, n) if isinstance(part, SecondOrderCone) else np.array([[0.0], [0.0], [1.0]])
            mu = part.mu if isinstance(part, SecondOrderCone) else 0.0
            yield Piece(span, push, i, self.lower[span], self.upper[span], mu, n if cone else 0)
            at += n

    def _add_piece(self, rows: Rows, piece: Piece, kind: str) -> None:
        if piece.mu > 0.0 and not piece.facets:
            self._add_circular(rows, piece, kind)
            return
        span = piece.columns
        free = [self._decided(j) is None for j in range(span.start, span.stop)]
        if piece.mu > 0.0 and all(free):
            self._add_pyramid(rows, piece, kind)
            return
        if piece.facets and piece.mu == 0.0:  # rays of a pyramid without friction are all one
            self.w = self.w.copy()
            self.w[span.start] = self.w[span].sum()
            span, free = slice(span.start, span.start + 1), free[:1]
        for i, j in enumerate(range(span.start, span.stop)):
            value = self._decided(j)
            if value is not None:
                self._add_constant(rows, piece, kind, j, value)
            else:
                self._put(rows, piece, kind, self._unit(j), self.w[j], (self.lower[j], self.upper[j]), piece.push, i)

    def _decided(self, j: int) -> float | None:
        """The value that the law leaves to a weight, or None where it has a choice."""
        low, high, y = float(self.lower[j]), float(self.upper[j]), float(self.y[j] / self.along[j])
        if low == high:
            return low
        bound = low if y > 0.0 else high
        if not math.isfinite(bound) or abs(y) <= self.tolerance or abs(y) <= abs(self.w[j] - bound) / self.push[j]:
            return None
        return bound

    def _add_circular(self, rows: Rows, piece: Piece, kind: str) -> None:
        span, mu = piece.columns, piece.mu
        y, w = self.y[span], project_cones(self.w[span][None], np.array([mu]))[0]
        slip, at = math.hypot(y[0], y[1]), span.start
        of_slip, of_normal = float(self.along[at]), float(self.along[at + 2])
        size = max(slip / of_slip, abs(float(y[2])) / of_normal)
        opens = float(y[2]) / of_normal if self.coulomb else (float(y[2]) - mu * slip) / (of_normal + mu * of_slip)
        if size <= self.tolerance:
            self.cone_at.append(len(self.start))
            self.mu.append(mu)
            for i in range(3):
                self._put(rows, piece, kind, self._unit(at + i), w[i], (-math.inf, math.inf), piece.push, i)
        elif opens <= self.tolerance or w[2] / self.push[at] > size:
            edge = np.array([-mu * y[0] / slip, -mu * y[1] / slip, 1.0]) if slip > 0.0 else np.array([0.0, 0.0, 1.0])
            column = np.zeros(len(self.weights_at))
            column[span] = edge
            push = None if piece.push is None else (piece.push @ edge)[:, None]
            self._put(rows, piece, kind, column, w[2], (0.0, math.inf), push, 0)

    def _add_pyramid(self, rows: Rows, piece: Piece, kind: str) -> None:
        """Three columns: the force itself, within the facets."""
        span, first = piece.columns, len(self.start)
        rays_of = pyramid(piece.mu, piece.facets)
        force = rays_of @ np.maximum(self.w[span], 0.0)
        angle = 2.0 * math.pi * np.arange(piece.facets) / piece.facets
        inward = np.column_stack([-np.cos(angle), -np.sin(angle), np.full(piece.facets, piece.mu)])
        self.faces.append((first, inward / math.hypot(1.0, piece.mu)))
        back = np.linalg.pinv(rays_of)
        for i in range(3):
            column = np.zeros(len(self.weights_at))
            column[span] = back[:, i]
            pushes = i == 2 and piece.mu < _FLAT
            self._put(rows, piece, kind, column, force[i], (0.0 if pushes else -math.inf, math.inf), np.eye(3), i)
        self.whole.append((slice(first, first + 3), span, piece.mu, piece.facets))

    def _add_constant(self, rows: Rows, piece: Piece, kind: str, j: int, value: float) -> None:
        self.weights_at[j] = value
        if value:
            i = j - piece.columns.start
            self.corners_at[-1] += self._corner_column(rows, piece, kind, self._unit(j), piece.push, i)[1] * value

    def _unit(self, j: int) -> Array:
        column = np.zeros(len(self.weights_at))
        column[j] = 1.0
        return column

    def _put(
        self, rows: Rows, piece: Piece, kind: str, column: Array, start: float, bounds: tuple[float, float],
        push: Array | None, i: int,
    ) -> None:  # fmt: skip
        low, high = bounds
        local, stacked = self._corner_column(rows, piece, kind, column, push, i)
        self.corner_columns.append((self.spans[rows.name].start + local, stacked))
        self.weight_columns.append(column)
        self.start.append(float(min(max(start, low), high)))
        self.bounds.append((float(low), float(high)))

    def _corner_column(
        self, rows: Rows, piece: Piece, kind: str, column: Array, push: Array | None, i: int
    ) -> tuple[int, Array]:
        """(first row within the constraint's part of the stack, entries) of a column of weights."""
        span = self.P.slices[rows.name]
        if kind == "none":
            return 0, self.G[span] @ column
        assert rows.patch is not None
        if kind == "one":
            assert rows.resultant is not None
            return 0, (rows.resultant @ (self.G[span] @ column))[:3]
        assert push is not None
        return 3 * piece.point, rows.patch.axes @ push[:, i]

    def _add_held_patch(self, rows: Rows, columns: slice) -> None:
        """A contact that holds: forces at its corners, without bounds."""
        assert rows.patch is not None
        C, k = corner_map(rows), len(rows.patch.corners)
        G = self.G[self.P.slices[rows.name], columns]  # identity, up to the choice of rows
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
