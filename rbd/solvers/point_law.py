"""Residual of a contact law at points in circular cones, from row accelerations and weights alone.

It estimates from above the scaled residuals of `rbd.problem.residuals`: how fast points sink, and their distance to the law
(`rbd.problem.law_distance`), both over lower bounds of their scales. The distance is Euclidean: of projections that norm, over
the scale, does not grow with the scale.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from rbd.arrays import Array
from rbd.solvers.compiled import in_use

LEAST_PUSH = 1e-3
"""Lower bound of the scale of a point's force [N]: what accelerates a gram at 1 m/s2."""
_TINY = 1e-300


def law_residual(pull: Array, c: Array, w: Array, mu: Array, *, coulomb: bool) -> float:
    """The residual: the largest of all points; NaN or infinite where a number is not finite.

    Args:
        pull: Accelerations of the points (tangent, tangent, normal) by row accelerations, shape (3k, m).
        c: Row accelerations, shape (m,).
        w: Weights in their cones, shape (3k,).
        mu: Friction coefficients, shape (k,).
        coulomb: Coulomb's law; else the convex one.
    """
    return _kernel()(pull.dot(c), w, mu, LEAST_PUSH, coulomb) if in_use() else plain(pull.dot(c), w, mu, coulomb)


def plain(accelerations: Array, w: Array, mu: Array, coulomb: bool) -> float:
    """`law_residual` in NumPy, of the points' accelerations, shape (3k,)."""
    y, p = accelerations.reshape(-1, 3), w.reshape(-1, 3)
    y_n = y[:, 2]
    worst = max(0.0, -float(y_n.min()))
    if not coulomb:
        slip = np.hypot(y[:, 0], y[:, 1])
        worst = max(worst, float(((mu * slip - np.maximum(y_n, 0.0)) / (1.0 + mu)).max()))
    push = np.maximum(np.sqrt(np.einsum("ij,ij->i", p, p)), LEAST_PUSH)
    x = p - push[:, None] * y
    t, n = np.hypot(x[:, 0], x[:, 1]), x[:, 2]
    if coulomb:
        normal = np.maximum(n, 0.0)
    else:
        normal = np.where(t <= mu * n, n, np.maximum((mu * t + n) / (1.0 + mu * mu), 0.0))
    x[:, :2] *= np.minimum(mu * normal / np.maximum(t, _TINY), 1.0)[:, None]
    x[:, 2] = normal
    x -= p
    far = float((np.sqrt(np.einsum("ij,ij->i", x, x)) / push).max())
    return far if far != far else max(worst, far)


@cache
def _kernel() -> Callable[[Array, Array, Array, float, bool], float]:
    from rbd.solvers.point_law_kernel import law_residual as compiled  # imports Numba

    return compiled
