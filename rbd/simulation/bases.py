"""Floating bases over a step: their poses, and their velocities transformed from one pose to the next.

Pinocchio has the velocity of a floating base in the base's axes: that of a body that spins and flies turns with it, and has
w x v in its accelerations. Integrated directly, the path of a step is an arc, with error O(h^2) from the straight line. Here
a step's velocities are those in axes frozen where the step looks at them, at its beginning or in its middle: a free
body follows its parabola at any step. Other joints are not affected.

The arithmetic is in `rbd.simulation.step_kernel`, or in plain floats here: a third of the time of small arrays.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from types import ModuleType
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.compiled import in_use
from rbd.model.checked_model import CheckedModel


def compiled_steps() -> ModuleType | None:
    """`rbd.simulation.step_kernel`, or None where compiled code is not in use."""
    return _kernel() if in_use() else None


@cache
def _kernel() -> ModuleType:
    from rbd.simulation import step_kernel  # imports Numba

    return step_kernel


class Middle(NamedTuple):
    """The middle of a step, velocities in its axes.

    Attributes:
        q: Configuration.
        v: Velocity at the step's beginning.
        v_h: Velocity in the middle.
        end: v + h W x v_h, to which h a is added.
        mean: v + h/2 W x v_h.
    """

    q: Array
    v: Array
    v_h: Array
    end: Array
    mean: Array


class Bases:
    """The floating bases of a robot, or none."""

    def __init__(self, robot: CheckedModel) -> None:
        model = robot.model
        self.model = model
        self.places = [(model.joints[j].idx_q, model.joints[j].idx_v) for j in robot.bases]
        self._indices = np.array(self.places, int).reshape(-1, 2)
        self._kernel = compiled_steps()

    def turned(self, start: Array, v: Array, h: float) -> Array:
        """The velocity start + h W x v: W x v is a of the frozen axes less a of the base's, in its linear part, shape (nv,)."""
        if self._kernel is not None:
            turned: Array = self._kernel.turned(start, v, h, self._indices)
            return turned
        out = start.copy()
        for _, i in self.places:
            x, y, z, a, b, c = v[i : i + 6].tolist()
            out[i] += h * (b * z - c * y)
            out[i + 1] += h * (c * x - a * z)
            out[i + 2] += h * (a * y - b * x)
        return out

    def middle(self, q: Array, v: Array, v_h: Array, h: float) -> Middle:
        """The middle of a step of length h from q, with v and v_h in the axes of q."""
        if self._kernel is not None:
            out: Array = pin.integrate(self.model, q, (0.5 * h) * v)
            return Middle(out, *self._kernel.middle(q, out, v, v_h, h, self._indices))
        out, (v, v_h) = self._moved(q, v, 0.5 * h, (v, v_h))
        return Middle(out, v, v_h, self.turned(v, v_h, h), self.turned(v, v_h, 0.5 * h))

    def moved(self, q: Array, v: Array, h: float) -> tuple[Array, Array]:
        """Where v, frozen at q, leads in a time h, shape (nq,); and v in the axes of that place."""
        if self._kernel is not None:
            out: Array = pin.integrate(self.model, q, h * v)
            return out, self._kernel.moved(q, out, v, h, self._indices)
        out, (v,) = self._moved(q, v, h, (v,))
        return out, v

    def _moved(self, q: Array, v: Array, h: float, velocities: Sequence[Array]) -> tuple[Array, list[Array]]:
        out: Array = pin.integrate(self.model, q, h * v)
        carried = list(velocities)
        for at, i in self.places:
            p, R = q[at : at + 3].tolist(), _rotation(q, at)
            x, y, z = _turned(R, v[i : i + 3].tolist())
            out[at : at + 3] = p[0] + h * x, p[1] + h * y, p[2] + h * z
            a, b, c, d, e, f, g, k, m = _rotation(out, at)
            for n, one in enumerate(carried):
                x, y, z = _turned(R, one[i : i + 3].tolist())
                carried[n] = one = one.copy()
                one[i : i + 3] = a * x + d * y + g * z, b * x + e * y + k * z, c * x + f * y + m * z
        return out, carried


def _rotation(q: Array, at: int) -> tuple[float, ...]:
    """R_WB of the base whose part of q begins at `at`, row by row."""
    x, y, z, w = q[at + 3 : at + 7].tolist()
    xx, yy, zz, xy, xz, yz, wx, wy, wz = x * x, y * y, z * z, x * y, x * z, y * z, w * x, w * y, w * z
    return (
        1.0 - 2.0 * (yy + zz), 2.0 * (xy - wz), 2.0 * (xz + wy),
        2.0 * (xy + wz), 1.0 - 2.0 * (xx + zz), 2.0 * (yz - wx),
        2.0 * (xz - wy), 2.0 * (yz + wx), 1.0 - 2.0 * (xx + yy),
    )  # fmt: skip


def _turned(R: tuple[float, ...], v: Sequence[float]) -> tuple[float, float, float]:
    """The vector R v."""
    (a, b, c, d, e, f, g, h, i), (x, y, z) = R, v
    return a * x + b * y + c * z, d * x + e * y + f * z, g * x + h * y + i * z
