"""Residual of a contact law at points in circular cones, from row accelerations and weights alone.

It estimates from above the scaled residuals of `rbd.problem.residuals`: how fast points sink, and their distance to the law
(`rbd.problem.law_distance`), both over lower bounds of their scales. The distance is Euclidean: of projections that norm, over
the scale, does not grow with the scale.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from types import ModuleType

import numpy as np

from rbd.arrays import Array
from rbd.problem.cones import projection

LEAST_PUSH = 1e-3
"""Lower bound of the scale of a point's force [N]: what accelerates a gram at 1 m/s2."""
_TINY = 1e-300


@cache
def contact_kernel() -> ModuleType:
    """`rbd.solvers.contact_kernel`, imported with the first contact that needs it: it imports Numba."""
    from rbd.solvers import contact_kernel

    return contact_kernel


def law_residual(pull: Array, c: Array, w: Array, mu: Array, *, coulomb: bool) -> float:
    """The residual: the largest of all points; NaN or infinite where a number is not finite.

    Args:
        pull: Accelerations of the points (tangent, tangent, normal) by row accelerations, shape (3k, m).
        c: Row accelerations, shape (m,).
        w: Weights in their cones, shape (3k,).
        mu: Friction coefficients, shape (k,).
        coulomb: Coulomb's law; else the convex one.
    """
    residual: float = contact_kernel().law_residual(pull.dot(c), w, mu, LEAST_PUSH, coulomb)
    return residual


def of_points(
    y: Sequence[Array] | Array, p: Sequence[Array] | Array, mu: Array, *, coulomb: bool
) -> tuple[Array, Array, Array]:
    """(how far points' accelerations are from those allowed, their distance to the law, the scale of their forces).

    Args:
        y: Accelerations: tangent, tangent, normal, each of shape (k, ...).
        p: Weights in their cones, likewise.
        mu: Friction coefficients, shape (k, ...).
        coulomb: Coulomb's law; else the convex one.
    """
    (y_1, y_2, y_n), (p_1, p_2, p_n) = y, p
    sinks = -y_n
    if not coulomb:
        sinks = np.maximum(sinks, (mu * np.hypot(y_1, y_2) - np.maximum(y_n, 0.0)) / (1.0 + mu))
    push = np.maximum(np.sqrt(p_1 * p_1 + p_2 * p_2 + p_n * p_n), LEAST_PUSH)
    x_1, x_2, x_n = p_1 - push * y_1, p_2 - push * y_2, p_n - push * y_n
    found = projection((x_1, x_2, x_n), mu, coulomb=coulomb)
    cut, normal = found.factor, found.normal
    far = np.sqrt((cut * x_1 - p_1) ** 2 + (cut * x_2 - p_2) ** 2 + (normal - p_n) ** 2)
    return sinks, far / push, push
