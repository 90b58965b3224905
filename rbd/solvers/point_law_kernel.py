"""The compiled form of `rbd.solvers.point_law.plain`: imported only if Numba is installed and in use."""

from __future__ import annotations

import math

from rbd.arrays import Array
from rbd.kernels import compiled


@compiled
def law_residual(y: Array, w: Array, mu: Array, least: float, coulomb: bool) -> float:
    """The largest residual of all points; `least` is the lower bound of the scale of their forces [N]."""
    worst = 0.0
    for i in range(len(mu)):
        a, b, c, m = w[3 * i], w[3 * i + 1], w[3 * i + 2], mu[i]
        u, v, sinks = y[3 * i], y[3 * i + 1], y[3 * i + 2]
        worst = max(worst, -sinks)
        if not coulomb:
            worst = max(worst, (m * math.hypot(u, v) - max(sinks, 0.0)) / (1.0 + m))
        push = max(math.sqrt(a * a + b * b + c * c), least)
        p, q, n = a - push * u, b - push * v, c - push * sinks
        t = math.hypot(p, q)
        if coulomb or t <= m * n:
            normal = max(n, 0.0)
        else:
            normal = max((m * t + n) / (1.0 + m * m), 0.0)
        share = m * normal / t if t > m * normal else 1.0
        far = math.sqrt((share * p - a) ** 2 + (share * q - b) ** 2 + (normal - c) ** 2) / push
        if not far <= math.inf:
            return math.nan
        worst = max(worst, far)
    return worst
