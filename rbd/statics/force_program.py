"""The farthest point along a direction over contact forces and parameters that a program allows, with its certificate.

With pyramids a program is linear, and HiGHS ends at a corner. With circular cones it is conic.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from rbd.arrays import Array
from rbd.problem.conic import Certificate, Conic, ConicAnswer
from rbd.problem.programs import Outcome, linear_program
from rbd.solvers.conic_newton import solve_conic

SAME = 1e-9
"""Nothing is farther by less than this, over the size of p."""
_TOLERANCE = 1e-10
_CONIC = 1e-7
_OUTSIDE = 1e-9
"""Forces of a program are this near to balance and to their cones, over the weight."""
_BEYOND = 1e-6
"""The bound by the multipliers of a conic program is this near to what its forces reach."""


@dataclass(frozen=True, eq=False)
class Support:
    """The farthest x along a direction.

    Attributes:
        answer: Of the program whose g is the direction, negative; its x and value are meaningless unless it is solved.
        value: What gain . x does not exceed, by the multipliers.
    """

    answer: ConicAnswer
    value: float

    @property
    def point(self) -> Array:
        """The last two unknowns, shape (2,)."""
        return self.answer.x[-2:]

    @property
    def direction(self) -> Array:
        """The direction in the plane, shape (2,)."""
        return -self.answer.program.g[-2:]


def farthest(program: Conic, gain: Array) -> Support:
    """The x with the largest gain . x, and the certificate that there is no larger one; of a program with H = 0 and g = 0.

    Args:
        program: What x must meet.
        gain: Shape (n,).
    """
    posed = replace(program, g=-gain)
    found = solve_conic(posed, newton=False, tolerance=_CONIC) if len(program.mu) else _at_a_corner(posed)
    if found.outcome is Outcome.INFEASIBLE and not len(program.mu):
        found = replace(found, certificate=_contradiction(program))
    if found.outcome in (Outcome.INFEASIBLE, Outcome.UNBOUNDED) or len(found.x) < len(gain):
        return Support(found, math.nan)
    # What counts is that forces exist, and that nothing is farther than their multipliers say: not how the method ended.
    value = bound(program, gain, found.y, found.z)
    met = program.outside(found.x) <= _OUTSIDE and value - float(gain @ found.x) <= _BEYOND
    return Support(replace(found, outcome=Outcome.SOLVED if met else Outcome.NOT_FOUND), value)


def _at_a_corner(program: Conic) -> ConicAnswer:
    """By HiGHS, of a program with H = 0 and without cones."""
    up, down = np.isfinite(program.high), np.isfinite(program.low)
    rows = np.vstack([program.C[up], -program.C[down]])
    sides = np.concatenate([program.high[up], -program.low[down]])
    bounds, z = np.column_stack([program.lower, program.upper]), np.zeros(len(program.low))
    for tolerance in (_TOLERANCE, None):  # so near to rounding HiGHS does not always end
        found = linear_program(program.g, rows, sides, program.A, program.b, bounds=bounds, tolerance=tolerance)
        if found.outcome is not Outcome.NOT_FOUND:
            break
    if found.solved:
        z[up] += found.lower[: int(up.sum())]
        z[down] -= found.lower[int(up.sum()) :]
    return ConicAnswer(program, found.outcome, found.x, found.equal, z, "HiGHS", found.pivots)


def _contradiction(program: Conic) -> Certificate | None:
    """The multipliers that show that no x meets the program, by the least sum of what is missed; None if it is nothing."""
    found = _at_a_corner(program.missed())
    lower, upper = np.split(found.z, 2)
    made = Certificate.of(program, found.y, lower + upper) if found.solved else None
    return made if made is not None and made.gap > SAME else None


def bound(program: Conic, gain: Array, y: Array, z: Array) -> float:
    """What gain . x does not exceed, by multipliers, whatever x is."""
    return -program.least(-gain - y @ program.A - z @ program.C, y, z)[0]


def around(program: Conic, middle: Array, within: float) -> Conic:
    """The same, with the last two unknowns so near to a point."""
    lower, upper = program.lower.copy(), program.upper.copy()
    lower[-2:], upper[-2:] = middle - within, middle + within
    return replace(program, lower=lower, upper=upper)
