"""Floating bases over a step, their linear velocity kept in axes that do not turn.

Pinocchio has the velocity of a floating base in the base's axes: that of a body that spins and flies turns with it, and has
w x v in its accelerations. Integrated as it stands, the way of a step is an arc, off by O(h^2) of what is a straight line. Here
a step's velocities are those in axes frozen where the step looks at them, at its beginning or in its middle: a free body keeps
to its parabola at any step. For other joints nothing changes.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, zeros
from rbd.model.checked_model import CheckedModel


class Bases:
    """The floating bases of a robot, or none."""

    def __init__(self, robot: CheckedModel) -> None:
        model = robot.model
        self.model, self.nv = model, robot.nv
        self.places = [(model.joints[j].idx_q, model.joints[j].idx_v) for j in robot.bases]

    def spin(self, v: Array) -> Array:
        """W x v of each base in its linear part, zero elsewhere, shape (nv,): a of the frozen axes less a of the base's."""
        if not self.places:
            return zeros(self.nv)
        out = np.zeros(self.nv)
        for _, i in self.places:
            x, y, z, a, b, c = v[i : i + 6].tolist()
            out[i : i + 3] = b * z - c * y, c * x - a * z, a * y - b * x
        return out

    def moved(self, q: Array, v: Array, h: float) -> Array:
        """Where v, frozen at q, leads in a time h, shape (nq,)."""
        out: Array = pin.integrate(self.model, q, h * v)
        for at, i in self.places:
            out[at : at + 3] = q[at : at + 3] + h * (_rotation(q, at) @ v[i : i + 3])
        return out

    def carried(self, vs: tuple[Array, ...], start: Array, end: Array) -> tuple[Array, ...]:
        """Velocities in the axes of the configuration `start`, in those of `end`."""
        if not self.places:
            return vs
        out = tuple([v.copy() for v in vs])
        for at, i in self.places:
            R = _rotation(end, at).T @ _rotation(start, at)
            for v in out:
                v[i : i + 3] = R @ v[i : i + 3]
        return out


def _rotation(q: Array, at: int) -> Array:
    """R_WB of the base whose part of q begins at `at`."""
    R: Array = pin.Quaternion(q[at + 3 : at + 7]).toRotationMatrix()
    return R
