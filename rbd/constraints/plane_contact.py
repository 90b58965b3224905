"""Contact points of convex shapes with a fixed plane, and how they move.

Let V = (v_0, w) and A = (a_0, alpha) be spatial velocity and J_dot v of a joint's body at W's origin, P a contact point on it,
which moves over the body at c, and d one of the plane's axes:

    J = (d, P x d) J_W over the joints that carry the body        velocity = J v
    bias = d . (a_0 + alpha x P + w x (v_0 + w x P + c))

For a corner c is zero, and the last term makes the acceleration classical; of round parts see `rbd.constraints.convex.rounds`.

The arithmetic is in `rbd.constraints.plane_kernel`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from types import ModuleType

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, rows_from
from rbd.constraints.contact_kinematics import Touching
from rbd.constraints.convex.low_points import LowPoints
from rbd.constraints.convex.solids import ConvexShape
from rbd.model.checked_model import CheckedModel


@dataclass(frozen=True, eq=False)
class _Near:
    """The points near the plane at a configuration: after an impact only velocities are others.

    Attributes:
        q: The configuration, shape (nq,).
        margin: Height up to which points are near [m].
        up: Normal of the plane in their axes, shape (bodies, 3).
        numbers: Of the points, shape (k,).
        body: Body of each, shape (k,).
        P: In W, shape (k, 3) [m].
        gaps: Shape (k,) [m].
        J: Shape (3k, nv).
    """

    q: Array
    margin: float
    up: Array
    numbers: Array
    body: Array
    P: Array
    gaps: Array
    J: Array


class OnPlane:
    """Contact points of shapes with a fixed plane. Not for two threads at once.

    Args:
        robot: The robot.
        shapes: Those that can touch, in the order of their joints.
        axes: R_WC, the plane's normal third, shape (3, 3).
        point: A point of the plane, in W, shape (3,) [m].
    """

    def __init__(self, robot: CheckedModel, shapes: Sequence[ConvexShape], axes: Array, point: Array) -> None:
        self.model, self.axes, self.height = robot.model, np.ascontiguousarray(axes), float(axes[:, 2] @ point)
        self._normal = axes[:, 2].copy()
        self.joints = sorted({shape.joint for shape in shapes})
        self._joints = np.array(self.joints)
        self.points = LowPoints(shapes, np.array([self.joints.index(shape.joint) for shape in shapes]))
        #: Which coordinates move each body, of zeros and ones, shape (bodies, nv).
        self._carries = np.zeros((len(self.joints), robot.nv))
        for i, joint in enumerate(self.joints):
            for above in list(self.model.supports[joint])[1:]:
                first = self.model.idx_vs[above]
                self._carries[i, first : first + self.model.nvs[above]] = 1.0
        self._prepare()

    def _prepare(self) -> None:
        self._data = self.model.createData()
        self._here: _Near | None = None
        every = [self._data.oMi[j] for j in range(self.model.njoints)]  # views, which follow the data
        self._places = rows_from([(X.rotation, X.translation) for X in every], 12)

    def another(self) -> OnPlane:
        """The same with data of its own."""
        out = object.__new__(OnPlane)
        out.__dict__.update(self.__dict__ | {"points": self.points.another()})
        out._prepare()
        return out

    def at(self, q: Array, v: Array, margin: float) -> Touching | None:
        """The points that are at most `margin` above the plane, in the order of their numbers; None if there are none.

        Args:
            q: Configuration, shape (nq,).
            v: Velocity, shape (nv,).
            margin: [m].
        """
        data, moves, nv = self._data, bool(v.any()), len(v)
        if moves:
            pin.computeJointJacobiansTimeVariation(self.model, data, q, v)
        else:
            pin.computeJointJacobians(self.model, data, q)
        here = self._here
        if here is None or here.margin != margin or not np.array_equal(here.q, q):
            here = self._here = self._near(q, margin, nv)
        numbers, body, P = here.numbers, here.body, here.P
        k = len(numbers)
        if not k:
            return None
        velocity, bias = np.zeros(3 * k), np.zeros(3 * k)
        if moves:
            parts = self.points.parts
            velocity, bias = _kernel().motion(
                P, body, self.points.part_of.take(numbers), self._places, self._joints, self.axes, here.up, self._carries,
                data.J.reshape(6, nv).T, data.dJ.reshape(6, nv).T, v, parts.kind, parts.radius, parts.form,
            )  # fmt: skip
        return Touching(numbers, self.label, P, self.axes, here.gaps, here.J, velocity, bias)

    def _near(self, q: Array, margin: float, nv: int) -> _Near:
        """The points near the plane at the configuration of the data."""
        kernel = _kernel()
        up, height = kernel.normals(self._places, self._joints, self._normal, self.height)
        now, near, gaps = self.points.near(up, height, margin)
        numbers, body, P, J = kernel.rows(
            now.points, near, now.index, now.body, self._places, self._joints, self.axes, self._carries,
            self._data.J.reshape(6, nv).T,
        )  # fmt: skip
        return _Near(q.copy(), margin, up, numbers, body, *_shared(P, gaps, J))

    def label(self, number: int) -> str:
        """The name of a point."""
        shape, point = self.points.label(number)
        return f"{shape}:{point}"


def _shared(P: Array, gaps: Array, J: Array) -> tuple[Array, Array, Array]:
    """The same arrays, read-only: all velocities at a configuration share them."""
    for array in (P, gaps, J):
        array.flags.writeable = False
    return P, gaps, J


@cache
def _kernel() -> ModuleType:
    from rbd.constraints import plane_kernel  # imports Numba

    return plane_kernel
