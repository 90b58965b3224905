"""Quadratic programs with circular cones, in arrays: the program, its answer, and the proof that it has none.

    minimise 1/2 x . H x + g . x     subject to     A x = b,   low <= C x <= high,   x in X

X is a product of intervals [lower, upper] and of circular cones |x_t| <= mu x_n on triples of columns (tangent, tangent,
normal). One sign: r = H x + g - A^T y - C^T z is what X answers with. x is the minimiser where

    x = P_X(x - r),     A x = b,     C x = P_[low, high](C x - z)

with P the projection: `Conic.miss` measures how far that is from true, and judges every answer. Where there is no x, (y, z)
with r = -A^T y - C^T z, H and g left out, is a certificate if

    y . b + least of z . s over s in [low, high] + least of r . x over x in X  >  0 :

for every x the three terms with A x, C x and x themselves add up to zero, so that no x meets all three. `rbd.solvers.conic`
solves it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array, is_finite, lazy
from rbd.problem.cones import project_cones
from rbd.problem.programs import Outcome


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

    @classmethod
    def of(
        cls, H: Array, g: Array, A: Array, b: Array, lower: Array, upper: Array, cones: Array, mu: Array,
        C: Array | None = None, low: Array | None = None, high: Array | None = None,
    ) -> Conic:  # fmt: skip
        """A program, perhaps without rows between bounds."""
        n = len(g)
        q = 0 if C is None else len(C)
        return cls(
            H, g, A, b, np.zeros((0, n)) if C is None else C,
            np.full(q, -math.inf) if low is None else low, np.full(q, math.inf) if high is None else high,
            lower, upper, cones, mu,
        )  # fmt: skip

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
        reach: The combination is a proof for all x whose entries add up to less than this, in absolute value: infinite where
            rounding leaves nothing outside.
    """

    y: Array
    z: Array
    gap: float
    reach: float

    @classmethod
    def of(cls, program: Conic, y: Array, z: Array) -> Certificate | None:
        """Checked; None where it proves nothing."""
        z = np.where((z > 0.0) & ~np.isfinite(program.low) | (z < 0.0) & ~np.isfinite(program.high), 0.0, z)
        r = -(y @ program.A) - z @ program.C
        size = max(float(np.abs(part).max(initial=0.0)) for part in (y, z, r))
        if not (is_finite(r) and size > 0.0):
            return None
        y, z, r = y / size, z / size, r / size
        bound = np.where(r > 0.0, program.lower, program.upper)
        free = ~np.isfinite(bound)
        bound = np.where(free, 0.0, bound)
        out = np.where(free, np.abs(r), 0.0)
        if len(program.mu):
            R = r[program.cones]
            out[program.cones] = np.abs(project_cones(-R, program.mu))
            bound[program.cones] = 0.0
        side = np.where(z > 0.0, program.low, program.high)
        gap = float(y @ program.b + z @ np.where(z == 0.0, 0.0, side) + r @ bound)
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
        certificate: Where there is no x, the proof, or None where rounding spoils it.
    """

    program: Conic
    outcome: Outcome
    x: Array
    y: Array
    z: Array
    method: str
    iterations: int
    certificate: Certificate | None = None

    @property
    def solved(self) -> bool:
        """Whether x is the minimiser."""
        return self.outcome is Outcome.SOLVED

    @lazy
    def miss(self) -> float:
        """`Conic.miss` of it."""
        return self.program.miss(self.x, self.y, self.z)
