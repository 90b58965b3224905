"""Quadratic programs over bounds and circular cones, in arrays: the program, its answer, and its certificates.

    minimise 1/2 x . H x + g . x     subject to     A x = b,   low <= C x <= high,   x in X

X is a product of intervals [lower, upper] and of circular cones |x_t| <= mu x_n on triples of columns (tangent, tangent,
normal). One sign: r = H x + g - A^T y - C^T z is what X answers with. x is the minimiser where

    x = P_X(x - r),     A x = b,     C x = P_[low, high](C x - z)

with P the projection: `Conic.miss` measures how far that is from true, and judges every answer. Where there is no x, (y, z)
with r = -A^T y - C^T z, H and g left out, is a certificate if

    y . b + least of z . s over s in [low, high] + least of r . x over x in X  >  0 :

y . A x + z . C x + r . x is zero for every x, and an x that meets the program would make it larger than zero.
`rbd.solvers.conic_newton` solves it.

Newton's method on the dual, where weights are diagonal (`least_squares`):

    minimise sum_i (1/2 d_i y_i^2 + c_i y_i)     subject to     R y = b ,  lower <= y <= upper ,  cones

With few equations and many unknowns (a hundred contacts on one robot) the dual is small: y follows from one multiplier an
equation, y = P(D^-1 (R^T lam - c)), P the projection on bounds and cones, and lam solves R y = b. The left side has
symmetric, positive semidefinite derivatives, so Newton's method with a line search on the dual value terminates wherever
the set has an interior. The result is exact: y is in the set to rounding, and no other point with R y = b is smaller. Source:
[Qi1993] for Newton's method on semismooth maps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import lapack

from rbd.arrays import Array, is_finite, lazy, max_abs
from rbd.problem.cones import project_cones, projection
from rbd.problem.programs import Outcome, Work


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

    def excess(self, x: Array, y: Array, z: Array) -> float:
        """What the value of an x that meets the program exceeds the least one by, at most, by multipliers.

        Proved against all x whose entries are no larger than those of this one, where R is outside the dual cones.
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


_STEPS = 60
_DONE = 1e-13
"""Largest |R y - b|, over its terms, at a solution."""
_LARGEST = 1e4
"""Largest terms of R^T lam, over those of the objective's gradient, at a solution: rounding then stays below 1e-12."""
_DAMPED = 1e-14
"""Added to the derivative's diagonal, over its largest entry."""


@dataclass(frozen=True, eq=False)
class Separable:
    """A quadratic program with diagonal weights, bounds and circular cones.

    Attributes:
        d: Weights > 0, shape (n,); equal within a cone.
        c: Shape (n,).
        R: Shape (r, n).
        b: Shape (r,).
        lower: Bounds, shape (n,); -inf where there is none, and for the columns of cones.
        upper: Upper bounds, shape (n,); inf where there is none, and for the columns of cones.
        cones: Columns (tangent, tangent, normal) of the cones, shape (k, 3).
        mu: Their friction coefficients > 0, shape (k,).
    """

    d: Array
    c: Array
    R: Array
    b: Array
    lower: Array
    upper: Array
    cones: Array
    mu: Array

    def at(self, lam: Array) -> tuple[Array, Array]:
        """(y, the point that is projected to it)."""
        p = (lam @ self.R - self.c) / self.d
        y = np.minimum(np.maximum(p, self.lower), self.upper)
        if len(self.mu):
            y[self.cones] = project_cones(p[self.cones], self.mu)
        return y, p

    def value(self, lam: Array, y: Array) -> float:
        """The dual value, which is maximised."""
        return float(lam @ self.b + 0.5 * (self.d * y) @ y + self.c @ y - lam @ (self.R @ y))

    def derivative(self, p: Array) -> Array:
        """Derivative of R y with respect to lam, shape (r, r)."""
        inside = (p > self.lower) & (p < self.upper)
        inside[self.cones.ravel()] = False
        J = (self.R[:, inside] / self.d[inside]) @ self.R[:, inside].T
        if not len(self.mu):
            return np.asarray(J)
        V = projection(p[self.cones].T, self.mu).slopes(self.mu) / self.d[self.cones[:, :1], None]
        columns = self.R[:, self.cones]  # (r, k, 3)
        turned = np.einsum("rki,kij->rkj", columns, V).reshape(len(self.b), -1)
        return np.asarray(J + turned @ columns.reshape(len(self.b), -1).T)


def least_squares(problem: Separable, lam: Array | None = None, work: Work | None = None) -> tuple[Array, Array] | None:
    """(y, lam): the minimiser, shape (n,), and its multipliers, shape (r,).

    None where Newton's method does not converge, or multipliers grow so large that rounding dominates: in a set without an
    interior, or an empty one; and where no work is left.

    Args:
        problem: The problem.
        lam: Multipliers to start from, shape (r,); zeros if not given.
        work: Limit of the cost; unlimited if not given.
    """
    P = problem
    lam = np.zeros(len(P.b)) if lam is None else lam
    y, p = P.at(lam)
    magnitude, top = np.abs(P.R), float((P.R**2 / P.d).sum(axis=1).max(initial=0.0))
    if not top < 1e150:
        return None
    value, cost = P.value(lam, y), float(len(P.b) + 3) * P.R.size + 1e5
    for _ in range(_STEPS):
        missed = P.b - P.R @ y
        if max_abs(missed) <= _DONE * max(max_abs(magnitude @ np.abs(y)), max_abs(P.b)):
            # In a set without an interior lam diverges, and rounding of lam R dominates what is projected.
            size = max(max_abs(P.c), max_abs(P.d * y))
            return (y, lam) if max_abs(np.abs(lam) @ magnitude) <= _LARGEST * size else None
        if work is not None and not work.spend(cost):
            return None
        J = P.derivative(p)
        # Where many bounds are active the derivative is singular, or zero: the damping then gives an ascent step.
        J.flat[:: len(J) + 1] += max(_DAMPED, min(1e-3, 1e-3 * max_abs(missed) / (1.0 + max_abs(P.b)))) * top
        _, step, info = lapack.dposv(J, missed)
        if info != 0:
            return None
        slope, t = float(missed @ step), 1.0
        for _ in range(30):
            ahead = lam + t * step
            new, q = P.at(ahead)
            found = P.value(ahead, new)
            # Near convergence the value's change is rounding; then the residual of the equations decides.
            if found >= value + 1e-4 * t * slope or max_abs(P.b - P.R @ new) <= 0.5 * max_abs(missed):
                break
            t *= 0.5
        else:
            return None
        lam, y, p, value = ahead, new, q, found
    return None


@dataclass(frozen=True, eq=False)
class ConeSet:
    """z with A z >= b, and u = C z + at of each cone with |(u_0, u_1)| <= mu (u_2 + widened).

    Attributes:
        A: Shape (q, z).
        b: Shape (q,).
        C: Shape (k, 3, z): tangent, tangent, normal.
        at: Shape (k, 3).
        mu: Shape (k,).
    """

    A: Array
    b: Array
    C: Array
    at: Array
    mu: Array

    def slack(self, z: Array) -> tuple[Array, Array, Array]:
        """(A z - b, u, mu u_2 - |u_t|)."""
        u = self.C @ z + self.at
        return self.A @ z - self.b, u, self.mu * u[:, 2] - np.hypot(u[:, 0], u[:, 1])

    def margin(self, z: Array) -> float:
        """The smallest slack of z; not positive outside."""
        s, _, cone = self.slack(z)
        return float(min(s.min(initial=math.inf), cone.min(initial=math.inf)))

    def widened(self, by: float) -> ConeSet:
        """The set with every bound and cone moved out."""
        at = self.at.copy()
        at[:, 2] += by / self.mu if len(self.mu) else 0.0
        return replace(self, b=self.b - by, at=at)

    def boxed(self, side: float) -> ConeSet:
        """The set within |z_i| <= side."""
        I = np.eye(self.A.shape[1])
        return replace(self, A=np.vstack([self.A, I, -I]), b=np.concatenate([self.b, np.full(2 * len(I), -side)]))

    def program(self, P: Array, q: Array) -> Conic:
        """Of 1/2 z . P z + q . z over the set, in x = (z, u)."""
        n, k = self.A.shape[1], 3 * len(self.mu)
        H, free = np.zeros((n + k, n + k)), np.full(n + k, math.inf)
        H[:n, :n] = P
        return Conic(
            H, np.concatenate([q, np.zeros(k)]), np.hstack([self.C.reshape(k, n), -np.eye(k)]), -self.at.ravel(),
            np.hstack([self.A, np.zeros((len(self.b), k))]), self.b, np.full(len(self.b), math.inf), -free, free,
            n + np.arange(k).reshape(-1, 3), self.mu,
        )  # fmt: skip
