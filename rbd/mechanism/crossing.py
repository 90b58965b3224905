"""Through a singular pose: what the rows no longer say there, their derivatives do.

Along a motion on constraints c(q) = 0, J a + J_dot v = 0 at every time. At a singular pose some combination u of rows has
u . J = 0, and says nothing of a; just beside it u . J = O(t), and its equation holds divided by t. That limit is the
derivative along the motion,

    u . [J_dot a + (d/dt J_dot v)(a)] = 0,        d/dt J_dot v = dq (J_dot v) . v + dv (J_dot v) . a ,

linear in a (it is c''' with u . J = 0, so that the unknown jerk drops out). The force that these rows make lies along the
limit of u . J / t, which is u . J_dot: a finite force on the motion, of multipliers that grow without bound.

Directly, near the pose, rounding e leaves the place known to e / s, the velocity across the branch to e / s^2, and a to e /
s^3, s the least singular value over the largest. So below s = 2e-3 (`held_rows.NEAR`: 1e-7 of a at the edge) neither places
nor velocities are brought back along what is small, and a is the limit above, which is wrong by O(s). That is a first
guess: with it neighbours on the branch are found at 3, 6 and 9 times that distance, ahead and behind, where a is known
well, and a here is theirs interpolated to order 6 (`SmoothMotion._across`). Measured on an antiparallelogram, a kite and
N-four-bars, wherever steps fall: energy changes by 1e-8 to 1e-13 a crossing at 1 ms, 16 times less or better at half the
step. A cut of the singular values alone, from 1e-8 to 1e-5, leaves the branch or changes it by 1e-6 to 1e-3.

Constraints that only nearly cross (s does not reach zero) turn the motion away: rows then ask for more than s |a|, or
neighbours lie off the way, and the rows are used as they are. With v = 0 at the pose, or where the derivatives depend on
each other too, the branches are not told apart and Gauss's principle without those rows is all there is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin
from scipy.linalg import blas

from rbd.arrays import Array, largest

if TYPE_CHECKING:
    from rbd.mechanism.held_rows import HeldRows

ASIDE = 1e-4
"""How far rows are compared on both sides of the pose, in the largest entry of v times the time [rad, m]."""
COUNTS = 1e-4
"""Singular values of u . J_dot below this, over |J_dot|, count as zero: rows that repeat each other everywhere."""

ROUNDED = 1e-11
"""Of the largest singular value, over the time between the two sides: what a difference of rounded rows may be."""


@dataclass(frozen=True, eq=False)
class Crossing:
    """Conditions on y = L^T a beyond those of the rows, and the directions of their forces.

    Attributes:
        held: The rows.
        u: Combinations of scaled rows that say nothing of a here, shape (rank, m).
        J_dot: Of all scaled rows, shape (m, nv).
        turning: Rates of the scaled rows' J_dot v along the motion while v stays, shape (m,).
        F: Orthonormal directions of y that the forces push along, across all that the rows still say, shape (nv, rank).
        norms: What rows are divided by, shape (m,).
        rate: How fast the least of the singular values changes, over the largest [1/s].
    """

    held: HeldRows
    u: Array
    J_dot: Array
    turning: Array
    F: Array
    norms: Array
    rate: float

    @property
    def rank(self) -> int:
        """How many conditions."""
        return len(self.u)

    @classmethod
    def of(cls, held: HeldRows, U: Array, Vt: Array, first: float, k: int, norms: Array) -> Crossing | None:
        """What the derivatives say, or None where they say nothing.

        Args:
            held: The rows.
            U: Singular vectors of the scaled W, shape (nv, nv).
            Vt: Likewise, shape (m, m).
            first: The largest singular value.
            k: How many of them the rows still say.
            norms: What rows are divided by.
        """
        q, v, model = held.state.q, held.state.v, held.state.robot.model
        speed = largest(v)
        if speed == 0.0 or k == len(Vt) or k == len(v):
            return None
        e = ASIDE / speed
        ahead, behind = (held.elsewhere(pin.integrate(model, q, side * v), v) for side in (e, -e))
        J_dot = (ahead.J - behind.J) / (2.0 * e * norms[:, None])
        W_dot = blas.dtrsm(1.0, held.L, J_dot.T, lower=1)
        Q, s, Pt = np.linalg.svd(U[:, k:].T @ (W_dot @ Vt[k:].T))
        rank = int((s > max(COUNTS * float(np.linalg.norm(W_dot, 2)), ROUNDED * first / e)).sum())
        if not rank:
            return None
        turning = (ahead.offset - behind.offset) / (2.0 * e * norms)
        return cls(held, Pt[:rank] @ Vt[k:], J_dot, turning, U[:, k:] @ Q[:, :rank], norms, float(s[rank - 1]) / first)

    def through(self, y: Array) -> Array:
        """The y of the branch that the motion is on, from the one that the rows alone allow."""
        told = np.column_stack([self._rate(column) for column in self.F.T])
        return y - self.F @ np.linalg.solve(told, self._rate(y) + self.u @ self.turning)

    def _rate(self, y: Array) -> Array:
        """What is linear in a of the conditions: u . [J_dot a + dv (J_dot v) . a], shape (rank,)."""
        held, v = self.held, self.held.state.v
        a = blas.dtrsv(held.L, y, lower=1, trans=1)
        size = largest(a)
        if size == 0.0:
            return np.zeros(self.rank)
        # The bias is quadratic in v: central differences of any width are exact, the wider the less rounding.
        w = a * (largest(v) / size)
        q = held.state.q
        bias = (held.elsewhere(q, v + w).offset - held.elsewhere(q, v - w).offset) * (size / (2.0 * largest(v)))
        return self.u @ (self.J_dot @ a + bias / self.norms)
