"""The least sum of weighted squares over linear equations, bounds and circular cones, by Newton's method on its dual.

    minimise sum_i (1/2 d_i y_i^2 + c_i y_i)     subject to     R y = b ,  lower <= y <= upper ,  cones

With few equations and many unknowns (a hundred contacts on one robot) the dual is small: y follows from one multiplier an
equation, y = P(D^-1 (R^T lam - c)), P the projection on bounds and cones, and lam is where R y = b. The left side has
symmetric, positive semidefinite derivatives, so Newton's steps with a line search on the dual value end wherever the set has
an inside. What ends is exact: y is in the set to rounding, and no other point with R y = b has a smaller value.

Source: [Qi1993] for Newton's method on maps that have kinks.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import lapack

from rbd.arrays import Array, max_abs
from rbd.problem.limits import Work
from rbd.problem.parts import project_cones

_STEPS = 60
_DONE = 1e-13
"""Largest |R y - b|, over the terms that make it up, of an answer."""
_LARGEST = 1e4
"""Largest terms of R^T lam, over those of the objective's slope, of an answer: its rounding then stays below 1e-12."""
_DAMPED = 1e-14
"""Added to the derivative's diagonal, over its largest entry."""


@dataclass(frozen=True, eq=False)
class Separable:
    """The problem.

    Attributes:
        d: Weights > 0, shape (n,); alike within a cone.
        c: Shape (n,).
        R: Shape (r, n).
        b: Shape (r,).
        lower: Bounds, shape (n,); -inf where there is none, and for the columns of cones.
        upper: Likewise, inf.
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
        """The dual value, to be made largest."""
        return float(lam @ self.b + 0.5 * (self.d * y) @ y + self.c @ y - lam @ (self.R @ y))

    def derivative(self, p: Array) -> Array:
        """Of R y with respect to lam, shape (r, r)."""
        inside = (p > self.lower) & (p < self.upper)
        inside[self.cones.ravel()] = False
        J = (self.R[:, inside] / self.d[inside]) @ self.R[:, inside].T
        if not len(self.mu):
            return np.asarray(J)
        V = _slopes(p[self.cones], self.mu) / self.d[self.cones[:, :1], None]
        columns = self.R[:, self.cones]  # (r, k, 3)
        turned = np.einsum("rki,kij->rkj", columns, V).reshape(len(self.b), -1)
        return np.asarray(J + turned @ columns.reshape(len(self.b), -1).T)


def least_squares(problem: Separable, lam: Array | None = None, work: Work | None = None) -> tuple[Array, Array] | None:
    """(y, lam): the minimiser, shape (n,), and its multipliers, shape (r,).

    None where Newton's method does not end, or multipliers grow so large that rounding would decide: of a set without an
    inside, or an empty one; and where no work is left.

    Args:
        problem: The problem.
        lam: Multipliers to start from, shape (r,); zeros if not given.
        work: What it may cost; as many steps as it takes if not given.
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
            # Of a set without an inside lam runs off to infinity, and rounding of lam R decides what is projected.
            size = max(max_abs(P.c), max_abs(P.d * y))
            return (y, lam) if max_abs(np.abs(lam) @ magnitude) <= _LARGEST * size else None
        if work is not None and not work.spend(cost):
            return None
        J = P.derivative(p)
        # Where much is at its bound the derivative is singular, or zero: then the damping makes a step uphill of it.
        J.flat[:: len(J) + 1] += max(_DAMPED, min(1e-3, 1e-3 * max_abs(missed) / (1.0 + max_abs(P.b)))) * top
        _, step, info = lapack.dposv(J, missed)
        if info != 0:
            return None
        slope, t = float(missed @ step), 1.0
        for _ in range(30):
            ahead = lam + t * step
            new, q = P.at(ahead)
            found = P.value(ahead, new)
            # Near the end the value is rounding; then the equations decide.
            if found >= value + 1e-4 * t * slope or max_abs(P.b - P.R @ new) <= 0.5 * max_abs(missed):
                break
            t *= 0.5
        else:
            return None
        lam, y, p, value = ahead, new, q, found
    return None


def _slopes(p: Array, mu: Array) -> Array:
    """Derivatives of the projections on the cones |y_t| <= mu y_n, shape (k, 3, 3)."""
    t, n = np.hypot(p[:, 0], p[:, 1]), p[:, 2]
    inside, apex = t <= mu * n, mu * t <= -n
    edge = ~(inside | apex)
    out = np.zeros((len(p), 3, 3))
    out[inside] = np.eye(3)
    t, n, m = np.maximum(t[edge], 1e-300), n[edge], mu[edge]
    u = p[edge, :2] / t[:, None]
    share = 1.0 / (1.0 + m * m)
    shrunk = m * (m * t + n) * share / t  # tangents keep their direction: their size over what it was
    along = m * m * share
    block = np.zeros((len(t), 3, 3))
    block[:, :2, :2] = shrunk[:, None, None] * np.eye(2) + (along - shrunk)[:, None, None] * (u[:, :, None] * u[:, None, :])
    block[:, :2, 2] = block[:, 2, :2] = (m * share)[:, None] * u
    block[:, 2, 2] = share
    out[edge] = block
    return out
