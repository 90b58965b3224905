"""The least coefficient of friction with which contacts balance a robot, under circular cones: bracketed by certificates.

With coefficients mu equilibrium asks for weights w of simple sets and of cones |w_t| <= mu w_n with

    A w = b        |t - T w| <= 1        lower <= w <= upper ,

at unactuated coordinates, at motors, and for weights outside cones. A conic program minimises s = |A w - b|_1 + the torques'
excess over their limits. Either s reaches zero, and forces inside the circular cones balance; or its multipliers separate: none
does. Bisection in mu brackets the least one; where s is above zero Newton's step is shorter, as its multipliers also tell how s
falls with mu: by |r_t| w_n of each cone, r what the cone answers with.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from rbd.arrays import Array
from rbd.problem import programs
from rbd.problem.conic import Conic
from rbd.solvers.conic_newton import solve_conic

MOST = 10.0
"""Coefficients above this are not searched."""
BRACKET = 1e-6
"""Relative width of the final bracket."""
MET = 1e-8
"""An imbalance up to this, over the body weight, counts as zero."""


class LimitReached(Exception):  # noqa: N818  it becomes a message, not raised to a user
    """The search took more than `rbd.problem.programs.FRICTION_PROGRAMS` conic programs, or one of them was not solved."""


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
        program: Any weights that balance, of which the cones' `mu` are the given coefficients; H = 0 and g = 0.
        yields: Which of the cones may take a larger one, shape (k,), of truth values.
    """

    program: Conic
    yields: Array
    _left: int = field(default=programs.FRICTION_PROGRAMS, init=False)

    def least(self) -> float | None:
        """The least coefficient that balances, at all cones that take a larger one; None if none up to `MOST` does.

        The given coefficients are the lower bound: where they suffice, the smallest of them is returned.

        Raises:
            LimitReached: where it is not found within the limits.
        """
        self._left, given = programs.FRICTION_PROGRAMS, self.program.mu
        low = float(given[self.yields].min()) if self.yields.any() else 0.0  # below, the result is the same
        high = float(min(MOST, given.max(initial=1.0)))
        if self._missed(low)[0] <= MET:
            return low
        while self._missed(high)[0] > MET:
            if high >= MOST:
                return None
            low, high = high, min(MOST, 2.0 * high)
        guess, by_newton = 0.5 * (low + high), False
        while high - low > BRACKET * high and high > 1e-6:
            missed, slope = self._missed(guess)
            if missed <= MET:  # after Newton's step, a point slightly below shows that it is the least
                high, guess, by_newton = guess, guess * (1.0 - 0.9 * BRACKET) if by_newton else low, False
            else:  # slightly beyond Newton's step, as s falls with mu
                low, by_newton = guess, True
                guess += missed / slope + 0.4 * BRACKET * guess if slope > 0.0 else high
            if not low < guess < high:
                guess, by_newton = 0.5 * (low + high), False
        return high

    def holds(self) -> bool:
        """Whether the cones balance as they are.

        Raises:
            LimitReached: where it is not found within the limits.
        """
        self._left = programs.FRICTION_PROGRAMS
        return self._missed(0.0)[0] <= MET

    def _missed(self, mu: float) -> tuple[float, float]:
        """(the least s with this coefficient, its decrease per unit of the coefficient, to first order)."""
        self._left -= 1
        P, given = self.program, self.program.mu
        coefficients = np.where(self.yields, np.maximum(mu, given), given)
        rubs = coefficients > 0.0
        lower, upper = P.lower.copy(), P.upper.copy()
        smooth = P.cones[~rubs]
        lower[smooth], upper[smooth[:, :2]] = 0.0, 0.0
        program = replace(P, lower=lower, upper=upper, cones=P.cones[rubs], mu=coefficients[rubs]).missed()
        found = solve_conic(program, newton=False, tolerance=MET) if self._left >= 0 else None
        if found is None or program.outside(found.x) > MET or program.excess(found.x, found.y, found.z) > MET:
            raise LimitReached
        grows = P.cones[self.yields & (mu >= given) & rubs]  # those that a larger coefficient than mu would change
        r = program.answer_of_X(found.x, found.y, found.z)[grows]
        return program.value(found.x), float(np.hypot(r[:, 0], r[:, 1]) @ found.x[grows[:, 2]])
