"""Levenberg-Marquardt steps onto the constraint manifold, and stationary points of the distance to it.

The distance is 1/2 |e(q)|^2. A step is

    z = - sum_i  v_i  s_i / (s_i^2 + mu |e|^2)  u_i . e              J = sum_i u_i s_i v_i^T

Its damping goes with the square of the error: quadratic convergence where the errors grow with the distance, also with rows
that repeat each other [YamashitaFukushima2001]; far away no direction gets more than 1 / (2 sqrt(mu)) (rad), so that the
way stays near to that of the steepest descent. Where the errors only grow with the square of the distance (a singular pose)
each step quarters them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array
from rbd.errors import InputError
from rbd.mechanism.closure import Closure, Misfit, rank_of

_START = 0.5
_LEAST, _MOST = 1e-3, 1e8
_DIFFERENCE = 1e-5
"""Step of the Hessian's central differences: their own error goes with its square."""


@dataclass(frozen=True, eq=False)
class Descent:
    """How far down the steps came.

    Attributes:
        misfit: What is left, at the end.
        steps: How many steps were taken.
        closed: Whether the constraints are met.
        stuck: Whether it ended because no step makes the errors less.
    """

    misfit: Misfit
    steps: int
    closed: bool
    stuck: bool


def descend(closure: Closure, start: Misfit, *, tolerance: float, most: int) -> Descent:
    """Steps from a configuration towards the constraints.

    Args:
        closure: The constraints.
        start: Where to begin.
        tolerance: Largest entry of the error that is left [m, rad].
        most: Most evaluations.
    """
    at, mu, steps, tries = start, _START, 0, 0
    size2 = float(at.error @ at.error)
    sliding = ~closure.robot.joints.angular[closure.free]
    slides = bool(sliding.any())
    while at.residual > tolerance:
        # From far away what slides may go as far as the error is; angles may not.
        far = np.where(sliding, max(1.0, math.sqrt(size2) / closure.length), 1.0) if slides else 1.0
        U, s, Vt = np.linalg.svd(at.J * far if slides else at.J, full_matrices=False)
        if not len(s) or not s[0] > 0.0:
            return Descent(at, steps, False, True)
        along = at.error @ U
        s2 = s * s
        kept = s > 1e-13 * s[0]
        while True:
            if tries >= most:
                return Descent(at, steps, False, False)
            tries += 1
            shrink = s2 / (s2 + mu * size2)
            expected = float(((along * along) * (1.0 - (1.0 - shrink) ** 2)).sum())
            if not expected > 1e-16 * size2:
                return Descent(at, steps, False, True)
            z = -((shrink[kept] * along[kept] / s[kept]) @ Vt[kept]) * far
            try:
                there = closure.at(closure.move(at.q, z))
                left2 = float(there.error @ there.error)
            except InputError:  # out of where a constraint is defined
                left2 = np.inf
            gain = (size2 - left2) / expected
            if gain > 1e-3:
                break
            if mu > _MOST:
                return Descent(at, steps, False, True)
            mu = max(4.0 * mu, _START)
        mu = min(_MOST, 4.0 * mu) if gain < 0.25 else max(_LEAST, 0.25 * mu) if gain > 0.75 else mu
        at, size2, steps = there, left2, steps + 1
    return Descent(at, steps, True, False)


@dataclass(frozen=True, eq=False)
class Bottom:
    """Where the distance to the constraints does not become less.

    Attributes:
        misfit: What is left there.
        slope: |J^T e| over |J| |e|: zero at a minimum.
        curvature: Least eigenvalue of the Hessian of 1/2 |e|^2 over its largest.
    """

    misfit: Misfit
    slope: float
    curvature: float

    @property
    def minimum(self) -> bool:
        """Whether no small motion makes the distance less, to second order."""
        return self.slope < 1e-7 and self.curvature > -1e-6


def settle(closure: Closure, start: Misfit, *, most: int = 40) -> Bottom:
    """Newton's steps on 1/2 |e|^2, its Hessian from differences of J^T e on the manifold; downhill out of saddles."""
    at = start
    if not len(closure.free) or not len(at.error):
        return Bottom(at, 0.0, 0.0)
    slope, curvature = np.inf, 0.0
    for _ in range(most):
        g = at.J.T @ at.error
        scale = float(np.linalg.norm(at.J) * np.linalg.norm(at.error))
        slope = float(np.linalg.norm(g)) / scale if scale > 0.0 else 0.0
        values, V = np.linalg.eigh(_hessian(closure, at))
        large = float(np.abs(values).max()) or 1.0
        curvature = float(values[0]) / large
        if slope < 1e-12 and curvature > -1e-6:
            break
        along = V.T @ g
        z = -V @ (along / np.maximum(np.abs(values), 1e-6 * large))
        if slope < 1e-9 and curvature <= -1e-6:  # a saddle: off it, along its steepest way down
            z = 0.1 * V[:, 0]
        z *= min(1.0, 0.5 / max(1e-300, float(np.linalg.norm(z))))
        there = _lower(closure, at, z)
        if there is None:
            break
        at = there
    return Bottom(at, slope, curvature)


def _hessian(closure: Closure, at: Misfit) -> Array:
    n = len(closure.free)
    H = np.empty((n, n))
    for i, unit in enumerate(np.eye(n) * _DIFFERENCE):
        ahead, back = (closure.at(closure.move(at.q, z)) for z in (unit, -unit))
        H[i] = (ahead.J.T @ ahead.error - back.J.T @ back.error) / (2.0 * _DIFFERENCE)
    return 0.5 * (H + H.T)


def _lower(closure: Closure, at: Misfit, z: Array) -> Misfit | None:
    """The first of halved steps that is not higher; None if there is none."""
    size2 = float(at.error @ at.error)
    for _ in range(30):
        try:
            there = closure.at(closure.move(at.q, z))
            if float(there.error @ there.error) < size2:
                return there
        except InputError:
            pass
        z = 0.5 * z
    return None


def branches_meet(closure: Closure, at: Misfit) -> bool:
    """Whether the constraints have a higher rank on what is found a step away in the directions that J allows."""
    n = len(closure.free)
    _, s, Vt = np.linalg.svd(at.J if len(at.J) else np.zeros((1, n)))
    rank = rank_of(s)
    for z in (sign * 0.02 * row for row in Vt[rank:] for sign in (1.0, -1.0)):
        there = descend(closure, closure.at(closure.move(at.q, z)), tolerance=1e-11, most=60)
        if there.closed and len(there.misfit.J) and rank_of(np.linalg.svd(there.misfit.J, compute_uv=False)) > rank:
            return True
    return False
