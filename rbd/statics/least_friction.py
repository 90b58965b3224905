"""The least coefficient of friction with which contacts balance a robot, under circular cones: bracketed by proofs.

With coefficients mu equilibrium asks for weights w of simple sets and of cones |w_t| <= mu w_n with

    A w = b        |t - T w| <= 1        lower <= w <= upper ,

at unactuated coordinates, at motors, and for weights outside cones. A linear program over some rays of each cone minimises
s = |A w - b|_1 + the torques' excess over their limits. Its multipliers price all other rays of the circular cone: the best
one, along the multiplier's tangent, is added where it would lower s. Either s reaches zero, and forces inside the
circular cones balance; or no ray lowers it, and the multipliers separate: none does. Bisection in mu brackets the least one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from rbd.arrays import Array
from rbd.problem import programs
from rbd.problem.programs import linear_program

MOST = 10.0
"""Coefficients above this are not searched."""
BRACKET = 1e-6
"""Relative width of the final bracket."""
MET = 1e-8
"""An imbalance up to this, over the body weight, counts as zero."""


class LimitReached(Exception):  # noqa: N818  it becomes a message, not raised to a user
    """The search took more than `rbd.problem.programs.FRICTION_PROGRAMS` linear programs, or one of them was not solved."""


@dataclass(frozen=True, eq=False)
class _Miss:
    """Least imbalance of the forces.

    Attributes:
        miss: The least sum s of violations.
        price: Decrease of s per unit of each weight, shape (p,).
        slope: Decrease of s per unit of the coefficient, to first order.
    """

    miss: float
    price: Array
    slope: float

    @property
    def met(self) -> bool:
        """Whether s is zero."""
        return self.miss <= MET


def rounded_up(mu: float) -> str:
    """A coefficient rounded up to four digits, still sufficient."""
    if mu <= 0.0:
        return "0"
    digit = 10.0 ** (math.floor(math.log10(mu)) - 3)
    return f"{math.ceil(mu * (1.0 - 2.0 * BRACKET) / digit) * digit:.4g}"


@dataclass(eq=False)
class Balance:
    """The equilibrium conditions on contact forces, in units of the body weight and of each motor's limit.

    Attributes:
        A: Generalised forces of unit weights on unactuated coordinates, shape (e, p).
        b: Their required sum, shape (e,).
        T: Generalised forces of unit weights at the motors, shape (n, p).
        t: Load of the motors without contact forces, shape (n,).
        lower: Bounds of the weights, shape (p,); ignored for cones' columns.
        upper: Upper bounds of the weights, shape (p,); ignored for cones' columns.
        cone_at: First columns of the cones (tangent, tangent, normal), shape (k,).
        mu: Their given coefficients, shape (k,).
        yields: Which of them may take a larger one, shape (k,), of truth values.
    """

    A: Array
    b: Array
    T: Array
    t: Array
    lower: Array
    upper: Array
    cone_at: Array
    mu: Array
    yields: Array
    _rays: list[tuple[int, Array]] = field(default_factory=list, init=False)
    _left: int = field(default=0, init=False)

    def least(self) -> float | None:
        """The least coefficient that balances, at all cones that take a larger one; None if none up to `MOST` does.

        The given coefficients are the lower bound: where they suffice, the smallest of them is returned.

        Raises:
            LimitReached: where it is not found within the limits.
        """
        self._left, self._rays = programs.FRICTION_PROGRAMS, self._first_rays()
        low = float(self.mu[self.yields].min()) if self.yields.any() else 0.0  # below, the result is the same
        high = float(min(MOST, self.mu.max(initial=1.0)))
        if self._balances(low).met:
            return low
        while not self._balances(high).met:
            if high >= MOST:
                return None
            low, high = high, min(MOST, 2.0 * high)
        guess, by_newton = 0.5 * (low + high), False
        while high - low > BRACKET * high and high > 1e-6:
            found = self._balances(guess)
            if found.met:  # after Newton's step, a point slightly below proves that it is the least
                high, guess, by_newton = guess, guess * (1.0 - 0.9 * BRACKET) if by_newton else low, False
            else:  # slightly beyond Newton's step, as s falls with mu
                low, by_newton = guess, True
                guess += found.miss / found.slope + 0.4 * BRACKET * guess if found.slope > 0.0 else high
            if not low < guess < high:
                guess, by_newton = 0.5 * (low + high), False
        return high

    def holds(self) -> bool:
        """Whether the cones balance as they are.

        Raises:
            LimitReached: where it is not found within the limits.
        """
        self._left, self._rays = programs.FRICTION_PROGRAMS, self._first_rays()
        return self._balances(0.0).met

    def _first_rays(self) -> list[tuple[int, Array]]:
        """Eight initial rays around each cone: (which cone, unit vector of the ray's tangent)."""
        return [(i, np.array([np.cos(x), np.sin(x)])) for i in range(len(self.mu)) for x in np.arange(8) * (np.pi / 4.0)]

    def _balances(self, mu: float) -> _Miss:
        """Least imbalance with this coefficient, under the circular cones."""
        coefficients = np.where(self.yields, np.maximum(mu, self.mu), self.mu)
        grows = self.yields & (mu >= self.mu)  # those that a larger coefficient than mu would change
        while self._left > 0:
            self._left -= 1
            found = self._program(coefficients, grows)
            if found.met:
                return found
            better = []
            for i, at in enumerate(self.cone_at.tolist()):
                q = found.price[at : at + 3]
                size = float(np.hypot(q[0], q[1]))
                # A newton along the best ray of the cone lowers the miss by this much.
                gain = coefficients[i] * size + float(q[2])
                if size > 0.0 and gain > max(1e-6 * found.miss, 1e-9):  # smaller gains are rounding of HiGHS
                    better.append((i, q[:2] / size))
            new = [(i, d) for i, d in better if not any(j == i and d @ e > 1.0 - 1e-14 for j, e in self._rays)]
            if not new:
                return found
            self._rays += new
        raise LimitReached

    def _program(self, mu: Array, grows: Array) -> _Miss:
        """Least imbalance over the rays in use."""
        p, e, n = len(self.lower), len(self.b), len(self.t)
        loose = np.ones(p, bool)
        for at in self.cone_at.tolist():
            loose[at : at + 3] = False
        rays = np.zeros((p, len(self._rays)))
        for k, (i, d) in enumerate(self._rays):
            at = int(self.cone_at[i])
            rays[at : at + 3, k] = mu[i] * d[0], mu[i] * d[1], 1.0
        C = np.hstack([np.eye(p)[:, loose], rays])
        A_eq = np.hstack([self.A @ C, np.eye(e), -np.eye(e), np.zeros((e, n))])
        TC, none, over = self.T @ C, np.zeros((n, 2 * e)), np.eye(n)
        A_ub = np.vstack([np.hstack([TC, none, -over]), np.hstack([-TC, none, -over])])
        positive = [(0.0, None)] * (len(self._rays) + 2 * e + n)
        bounds = [*zip(self.lower[loose], self.upper[loose], strict=True), *positive]
        cost = np.r_[np.zeros(C.shape[1]), np.ones(2 * e + n)]
        reach = np.r_[1.0 + self.t, 1.0 - self.t]
        answer = linear_program(cost, A_ub, reach, A_eq, self.b, bounds=bounds, tolerance=1e-10)
        if not answer.solved:
            raise LimitReached
        y, z = answer.equal, answer.lower
        price, loads = self.A.T @ y + self.T.T @ (z[:n] - z[n:]), answer.x[C.shape[1] - len(self._rays) : C.shape[1]]
        slope = 0.0
        for (i, d), load in zip(self._rays, loads.tolist(), strict=True):
            at = int(self.cone_at[i])
            slope += load * float(d @ price[at : at + 2]) * bool(grows[i])
        return _Miss(answer.value, price, slope)
