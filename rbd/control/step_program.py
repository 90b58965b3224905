"""`StepProgram`: the quadratic program of a step of whole-body control.

    minimise    1/2 a^T H a + g^T a + 1/2 w^T K w + k^T w
    subject to  E a + F w = e                       equations of motion without motors; contacts, loops
                low <= T a + W w <= high            torques over their limits, normal forces, joint limits
                lower <= w <= upper                 weights of the contact forces

`rbd.control.step_solution` solves it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rbd.arrays import Array, max_abs


class StepPoint(NamedTuple):
    """A point of a `StepProgram`, with multipliers that are positive at lower bounds.

    Attributes:
        a: Accelerations, shape (nv,).
        w: Weights of forces, shape (p,).
        y: Of the equations, shape (m,).
        t: Of the rows between bounds, shape (q,).
        z: Of the bounds of w, shape (p,).
        iterations: Of the method.
        method: "DAQP" or "ProxSuite".
    """

    a: Array
    w: Array
    y: Array
    t: Array
    z: Array
    iterations: int
    method: str


@dataclass(frozen=True, eq=False)
class StepProgram:
    """The quadratic program of a step; numbers around one.

    Attributes:
        H: Shape (nv, nv), positive definite.
        g: Shape (nv,).
        K: Shape (p, p), positive definite.
        k: Shape (p,).
        E: Shape (m, nv).
        F: Shape (m, p).
        e: Shape (m,).
        T: Shape (q, nv).
        W: Shape (q, p).
        low: Shape (q,); -inf where there is none.
        high: Shape (q,); inf where there is none.
        lower: Shape (p,); -inf where there is none.
        upper: Shape (p,); inf where there is none.
        of_forces: Which of the rows between bounds are of w alone: they are kept always.
    """

    H: Array
    g: Array
    K: Array
    k: Array
    E: Array
    F: Array
    e: Array
    T: Array
    W: Array
    low: Array
    high: Array
    lower: Array
    upper: Array
    of_forces: slice

    def optimality(self, point: StepPoint) -> float:
        """How far a point is from the minimiser: the worst equation, bound, gradient and complementarity, scaled."""
        a, w, y, t, z, _, _ = point
        Ha, Kw, Ey, Fy = self.H @ a, self.K @ w, y @ self.E, y @ self.F
        size = max(1.0, max_abs(Ha), max_abs(self.g), max_abs(Kw), max_abs(Ey), max_abs(Fy))
        moving = max(1.0, max_abs(a), max_abs(self.e))
        gradient = np.concatenate([Ha + self.g - Ey - t @ self.T, Kw + self.k - Fy - t @ self.W - z])
        missed = self.E @ a + self.F @ w - self.e
        if not math.isfinite(np.vdot(gradient, gradient) + np.vdot(missed, missed)):
            return math.inf
        rows = self.T @ a + self.W @ w
        below, above = np.concatenate([rows - self.low, w - self.lower]), np.concatenate([self.high - rows, self.upper - w])
        multipliers = np.concatenate([t, z])
        held = multipliers.nonzero()[0]
        pushes = multipliers[held]
        room = np.where(pushes > 0.0, below[held], above[held])
        return max(
            max_abs(gradient) / size,
            max_abs(missed) / moving,
            -min(0.0, float(below.min(initial=0.0)), float(above.min(initial=0.0))) / moving,
            max_abs(pushes * room) / size,
        )
