"""The convex set of all forces that give the same motion under the same law.

With a given, the equations of motion leave J^T f = M a - rhs, and the law leaves to each point only the forces that go with
its acceleration (`rbd.analysis.complementary`). What is left is {x : x = start + null z, D x >= d, cones}: x holds the corner
forces of contacts and the row forces of all else. A contact that holds is split among its corners too, without bounds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array, lazy
from rbd.problem.cones import project_cones
from rbd.problem.problem import GaussProblem
from rbd.problem.separable import Separable

NULL = 1e-9
"""Singular values below this, times the largest, count as zero; as in `Answer.rank`."""


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
        y, R = self.start / self.size, null_space(self.null.T)[0].T
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


def null_space(A: Array) -> tuple[Array, int]:
    """(orthonormal columns that A takes to zero, rank of A)."""
    if not A.size:
        return np.eye(A.shape[1]), 0
    _, s, Vt = np.linalg.svd(A)
    rank = int((s > NULL * s[0]).sum()) if s[0] > 0.0 else 0
    return Vt[rank:].T, rank
