"""The contact problem in numbers of order one, for `rbd.solvers.contact_kernel`."""

from __future__ import annotations

import math
from typing import NamedTuple

from rbd.arrays import Array
from rbd.kernels import compiled

MOBILITY = 10.0
"""Of each scaled point, which balances weights and accelerations: fewest steps, of 1 to 30 tried."""


class Bodies(NamedTuple):
    """The scaled problem: each point's block of Q' D Q has the largest diagonal `MOBILITY`, c is of order one.

    Attributes:
        D: Inverse inertia of the bodies' rows, shape (nw, nw).
        L: Its inverse.
        c: Free acceleration, shape (nw,).
        columns: Columns of Q, P scaled, shape (3 k, d).
        first: First row of each point, shape (k,).
        mu: Frictions.
    """

    D: Array
    L: Array
    c: Array
    columns: Array
    first: Array
    mu: Array


@compiled
def scale(bodies: Bodies, P: Array, c: Array, unit: Array) -> float:
    """Fill columns and c of the scaled problem, and the points' `unit`: the rate by which c was divided."""
    most, d = 0.0, P.shape[1]
    for i in range(len(unit)):
        at, size = bodies.first[i], 0.0
        for j in range(3 * i, 3 * i + 3):
            total = 0.0
            for r in range(d):
                part = 0.0
                for s in range(d):
                    part += bodies.D[at + r, at + s] * P[j, s]
                total += part * P[j, r]
            size = max(size, total)
        unit[i] = size
        most = max(most, size)
    rate = 0.0
    for i in range(len(unit)):
        at = bodies.first[i]
        unit[i] = math.sqrt(MOBILITY / max(unit[i], 1e-12 * most if most > 0.0 else 1.0))
        for j in range(3 * i, 3 * i + 3):
            total = 0.0
            for r in range(d):
                bodies.columns[j, r] = P[j, r] * unit[i]
                total += bodies.columns[j, r] * c[at + r]
            rate = max(rate, abs(total))
    rate = rate if rate > 0.0 else 1.0
    for r in range(len(c)):
        bodies.c[r] = c[r] / rate
    return rate
