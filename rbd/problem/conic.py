"""Quadratic programs over bounds and circular cones, in arrays: the program, its answer, and its certificates.

    minimise 1/2 x . H x + g . x     subject to     A x = b,   low <= C x <= high,   x in X

X is a product of intervals [lower, upper] and of circular cones |x_t| <= mu x_n on triples of columns (tangent, tangent,
normal). One sign: r = H x + g - A^T y - C^T z is what X answers with. x is the minimiser where

    x = P_X(x - r),     A x = b,     C x = P_[low, high](C x - z)

with P the projection: `Conic.miss` measures how far that is from true, and judges every answer. Where there is no x, (y, z)
with r = -A^T y - C^T z, H and g left out, is a certificate if

    y . b + least of z . s over s in [low, high] + least of r . x over x in X  >  0 :

y . A x + z . C x + r . x is zero for every x, and an x that meets the program would make it larger than zero.
Programs are put together from named blocks of unknowns, `Conic.of`; `rbd.solvers.conic_newton` solves them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Self

import numpy as np

from rbd.arrays import Array, is_finite, lazy
from rbd.problem.cones import project_cones
from rbd.problem.programs import Outcome

_NO_CONES, _NO_MU = np.zeros((0, 3), int), np.zeros(0)
"""Nobody writes to them."""


class Unknowns(NamedTuple):
    """Unknowns of a program that belong together.

    Attributes:
        size: How many, n.
        squares: Their part of H: shape (n, n), or its diagonal, a number or shape (n,).
        linear: Their part of g, a number or shape (n,).
        lower: A number or shape (n,); -inf where there is none, and for the columns of cones.
        upper: Likewise, inf.
        cones: Columns (tangent, tangent, normal) of the cones within the block, shape (k, 3).
        mu: Their coefficients, above zero, shape (k,).
    """

    size: int
    squares: Array | float = 0.0
    linear: Array | float = 0.0
    lower: Array | float = -math.inf
    upper: Array | float = math.inf
    cones: Array = _NO_CONES
    mu: Array = _NO_MU


@dataclass(frozen=True, eq=False)
class Conic:
    """A program; its numbers should be around one.

    Attributes:
        H: Positive semidefinite, shape (n, n).
        g: Shape (n,).
        A: Shape (e, n).
        b: Shape (e,).
        C: Shape (q, n).
        low: Shape (q,); -inf where there is none.
        high: Shape (q,); inf where there is none.
        lower: Shape (n,); -inf where there is none, and for the columns of cones.
        upper: Likewise, inf.
        cones: Columns (tangent, tangent, normal) of the cones, shape (k, 3).
        mu: Their coefficients, above zero, shape (k,).
        spans: {block: its columns}, of a program of named blocks.
    """

    H: Array
    g: Array
    A: Array
    b: Array
    C: Array
    low: Array
    high: Array
    lower: Array
    upper: Array
    cones: Array
    mu: Array
    spans: Mapping[str, slice] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        blocks: Mapping[str, Unknowns],
        equations: Sequence[tuple[Mapping[str, Array], Array]] = (),
        between: Sequence[tuple[Mapping[str, Array], Array | float, Array | float]] = (),
    ) -> Self:
        """A program of named blocks of unknowns.

        Args:
            blocks: {name: unknowns}, in the order of their columns.
            equations: ({block: matrix}, b): the sum of matrices times blocks is b, row by row.
            between: ({block: matrix}, low, high): rows between bounds, likewise.
        """
        spans, n = dict[str, slice](), 0
        for name, block in blocks.items():
            spans[name] = slice(n, n + block.size)
            n += block.size
        H, (g, lower, upper) = np.zeros((n, n)), np.empty((3, n))
        cones, mu = _NO_CONES, _NO_MU
        for block, span in zip(blocks.values(), spans.values(), strict=True):
            if isinstance(block.squares, np.ndarray) and block.squares.ndim == 2:
                H[span, span] = block.squares
            else:
                H.flat[span.start * (n + 1) : span.stop * (n + 1) : n + 1] = block.squares
            g[span], lower[span], upper[span] = block.linear, block.lower, block.upper
            if len(block.mu):
                cones, mu = np.concatenate([cones, span.start + block.cones]), np.concatenate([mu, block.mu])

        def stacked(given: Sequence[tuple[Any, ...]], ends: int) -> tuple[Array, Array]:
            """(matrix, sides): (parts, side, ...) below each other, `ends` sides each."""
            sizes = [len(next(iter(parts.values()))) for parts, *_ in given]
            out, bounds, at = np.zeros((sum(sizes), n)), np.empty((ends, sum(sizes))), 0
            for (parts, *sides), size in zip(given, sizes, strict=True):
                rows = slice(at, at + size)
                for name, matrix in parts.items():
                    out[rows, spans[name]] = matrix
                for k, side in enumerate(sides):
                    bounds[k, rows] = side
                at += size
            return out, bounds

        (A, (b,)), (C, (low, high)) = stacked(equations, 1), stacked(between, 2)
        return cls(H, g, A, b, C, low, high, lower, upper, cones, mu, spans)

    @property
    def arrays(self) -> tuple[Array, ...]:
        """All that `rbd.solvers.conic_kernel` reads."""
        return (
            self.H, self.g, self.A, self.b, self.C, self.low, self.high, self.lower, self.upper, self.cones, self.mu
        )  # fmt: skip

    def missed(self) -> Conic:
        """The program of the least sum of what equations and rows miss: any x in X is possible, and none misses less.

        Its first unknowns are x; its rows between bounds are the lower, then the upper bounds of this one's.
        """
        (e, n), q = self.A.shape, len(self.low)
        I, over, some = np.eye(e), np.eye(q), Unknowns(e, linear=1.0, lower=0.0)
        x = Unknowns(n, 0.0, 0.0, self.lower, self.upper, self.cones, self.mu)
        return Conic.of(
            {"x": x, "less": some, "more": some, "passed": Unknowns(q, linear=1.0, lower=0.0)},
            [({"x": self.A, "less": I, "more": -I}, self.b)],
            [({"x": self.C, "passed": over}, self.low, math.inf), ({"x": self.C, "passed": -over}, -math.inf, self.high)],
        )

    def project(self, x: Array) -> Array:
        """The nearest point of X."""
        out = np.minimum(np.maximum(x, self.lower), self.upper)
        if len(self.mu):
            out[self.cones] = project_cones(x[self.cones], self.mu)
        return out

    def answer_of_X(self, x: Array, y: Array, z: Array) -> Array:
        """R = H x + g - A^T y - C^T z, shape (n,)."""
        return np.asarray(self.H @ x + self.g - y @ self.A - z @ self.C)

    def equations(self, x: Array, y: Array, z: Array) -> tuple[Array, Array, Array]:
        """What is left of the three equations, shapes (n,), (e,), (q,)."""
        s = self.C @ x
        return (
            x - self.project(x - self.answer_of_X(x, y, z)),
            self.A @ x - self.b,
            s - np.minimum(np.maximum(s - z, self.low), self.high),
        )

    def miss(self, x: Array, y: Array, z: Array) -> float:
        """Largest entry of what is left of the equations; infinite of NaN."""
        if not (is_finite(x) and is_finite(y) and is_finite(z)):
            return math.inf
        return max(float(np.abs(part).max(initial=0.0)) for part in self.equations(x, y, z))

    def allows(self, x: Array) -> bool:
        """Whether x is in X, and the rows are between their bounds; A x = b is not asked."""
        if len(self.mu):
            cones = x[self.cones]
            if not (np.hypot(cones[:, 0], cones[:, 1]) <= self.mu * cones[:, 2]).all():
                return False
        s = self.C @ x
        between = (s >= self.low).all() and (s <= self.high).all()
        return bool(between and (3 * len(self.mu) == len(x) or ((x >= self.lower) & (x <= self.upper)).all()))

    def outside(self, x: Array) -> float:
        """Largest violation of A x = b, of the rows' bounds and of X; infinite of NaN."""
        if not is_finite(x):
            return math.inf
        s = self.C @ x
        parts = (x - self.project(x), self.A @ x - self.b, np.maximum(self.low - s, s - self.high))
        return max(float(part.max(initial=0.0)) for part in (np.abs(parts[0]), np.abs(parts[1]), parts[2]))

    def excess(self, x: Array, y: Array, z: Array) -> float:
        """What the value of an x that meets the program exceeds the least one by, at most, by multipliers.

        Valid for all x whose entries are no larger than those of this one, where R is outside the dual cones.
        """
        value, out = self.least(self.answer_of_X(x, y, z), y, z)
        return float(x @ (self.H @ x + self.g) - value + out @ np.abs(x))

    def least(self, r: Array, y: Array, z: Array) -> tuple[float, Array]:
        """(value, out): x . (r + A^T y + C^T z) >= value - out . |x| for every x that meets the program.

        Value is -inf where z pushes at a bound that is not there.
        """
        end = np.where(r > 0.0, self.lower, self.upper)
        free = ~np.isfinite(end)
        out, end = np.where(free, np.abs(r), 0.0), np.where(free, 0.0, end)
        if len(self.mu):
            out[self.cones], end[self.cones] = np.abs(project_cones(-r[self.cones], self.mu)), 0.0
        side = np.where(z > 0.0, self.low, np.where(z < 0.0, self.high, 0.0))
        return float(y @ self.b + z @ side + r @ end), out

    def value(self, x: Array) -> float:
        """1/2 x . H x + g . x."""
        return float(0.5 * x @ self.H @ x + self.g @ x)


@dataclass(frozen=True, eq=False)
class Certificate:
    """Why there is no x: a combination of the equations and bounds that no x meets.

    Attributes:
        y: Multipliers of A x = b, shape (e,), the largest of all multipliers being one.
        z: Multipliers of the rows between bounds, shape (q,).
        gap: What is left between the two sides; positive.
        reach: The combination is valid for all x whose entries add up to less than this, in absolute value: infinite where
            rounding leaves nothing outside.
    """

    y: Array
    z: Array
    gap: float
    reach: float

    @classmethod
    def of(cls, program: Conic, y: Array, z: Array) -> Certificate | None:
        """Checked; None where it shows nothing."""
        z = np.where((z > 0.0) & ~np.isfinite(program.low) | (z < 0.0) & ~np.isfinite(program.high), 0.0, z)
        r = -(y @ program.A) - z @ program.C
        size = max(float(np.abs(part).max(initial=0.0)) for part in (y, z, r))
        if not (is_finite(r) and size > 0.0):
            return None
        y, z, r = y / size, z / size, r / size
        gap, out = program.least(r, y, z)
        left = float(out.max(initial=0.0))
        return cls(y, z, gap, gap / left if left > 0.0 else math.inf) if gap > 0.0 else None


@dataclass(frozen=True, eq=False)
class ConicAnswer:
    """What was found.

    Attributes:
        program: What was solved.
        outcome: How it ended; x, y, z are the best that was found where that is NOT_FOUND.
        x: Shape (n,), inside X to rounding.
        y: Multipliers of A x = b, shape (e,).
        z: Multipliers of the rows between bounds, shape (q,): positive where the lower bound holds.
        method: "Newton" or "Clarabel".
        iterations: Of that method.
        certificate: Where there is no x, the certificate, or None where rounding spoils it.
    """

    program: Conic
    outcome: Outcome
    x: Array
    y: Array
    z: Array
    method: str
    iterations: int
    certificate: Certificate | None = None

    def __getitem__(self, block: str) -> Array:
        """The unknowns of a block, at x."""
        return self.x[self.program.spans[block]]

    @property
    def solved(self) -> bool:
        """Whether x is the minimiser."""
        return self.outcome is Outcome.SOLVED

    @lazy
    def miss(self) -> float:
        """`Conic.miss` of it."""
        return self.program.miss(self.x, self.y, self.z)
