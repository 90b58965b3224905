"""Floating bases over a step: their poses, and their velocities transformed from one pose to the next.

Pinocchio has the velocity of a floating base in the base's axes: that of a body that spins and flies turns with it, and has
w x v in its accelerations. Integrated directly, the path of a step is an arc, with error O(h^2) from the straight line. Here
a step's velocities are those in axes frozen where the step looks at them, at its beginning or in its middle: a free
body follows its parabola at any step. Other joints are not affected.

The arithmetic is in `rbd.simulation.step_kernel`.
"""

from __future__ import annotations

from functools import cache
from types import ModuleType

import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.kernels import compile_from_now_on
from rbd.model.checked_model import CheckedModel


@cache
def step_kernel() -> ModuleType:
    """`rbd.simulation.step_kernel`, imported with the first step; from then on kernels are compiled: there will be many."""
    from rbd.simulation import step_kernel

    compile_from_now_on()
    return step_kernel


class Bases:
    """The floating bases of a robot, or none."""

    def __init__(self, robot: CheckedModel) -> None:
        model = robot.model
        self.model = model
        self.places = [(model.joints[j].idx_q, model.joints[j].idx_v) for j in robot.bases]
        self._indices = np.array(self.places, int).reshape(-1, 2)
        self._kernel = step_kernel()

    def turned(self, start: Array, v: Array, h: float) -> Array:
        """The velocity start + h W x v: W x v is a of the frozen axes less a of the base's, in its linear part, shape (nv,)."""
        out = np.empty(len(v))
        self._kernel.turned(start, v, h, self._indices, out)
        return out

    def middle(self, q: Array, v: Array, v_h: Array, h: float) -> tuple[Array, Array, Array, Array, Array]:
        """The middle of a step of length h from q, with v and v_h in the axes of q: its q, and velocities in its own axes.

        These are v, v_h, v + h W x v_h, to which h a is added, and v + h/2 W x v_h.
        """
        out: Array = pin.integrate(self.model, q, (0.5 * h) * v)
        moves = np.empty((4, len(v)))
        self._kernel.middle(q, out, v, v_h, h, self._indices, moves)
        return (out, *moves)

    def moved(self, q: Array, v: Array, h: float) -> tuple[Array, Array]:
        """Where v, frozen at q, leads in a time h, shape (nq,); and v in the axes of that place."""
        out: Array = pin.integrate(self.model, q, h * v)
        carried = np.empty(len(v))
        self._kernel.moved(q, out, v, h, self._indices, carried)
        return out, carried
