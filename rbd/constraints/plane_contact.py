"""Contact points of convex shapes with a fixed plane, and how they move.

Let V = (v_0, w) and A = (a_0, alpha) be spatial velocity and J_dot v of a joint's body at W's origin, P a contact point on it,
which moves over the body at c, and d one of the plane's axes:

    J = (d, P x d) J_W over the joints that carry the body        velocity = J v
    bias = d . (a_0 + alpha x P + w x (v_0 + w x P + c))

For a corner c is zero, and the last term makes the acceleration classical; of round parts see `rbd.constraints.convex.rounds`.

The arithmetic is in `rbd.constraints.plane_kernel`, or in array operations here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from types import ModuleType

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, cross_matrix, rows_from
from rbd.compiled import in_use
from rbd.constraints.contact_kinematics import Touching
from rbd.constraints.convex.low_points import LowPoints
from rbd.constraints.convex.solids import ConvexShape
from rbd.model.checked_model import CheckedModel

_CROSS = np.array([cross_matrix(e) for e in np.eye(3)]).reshape(3, 9)
"""Maps w in a row to [w]_x, row by row."""


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
        self._turn = np.hstack([cross_matrix(e) for e in axes.T])  # maps P to P x e of the three axes
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
        placements = [self._data.oMi[joint] for joint in self.joints]
        # Views, which follow the data.
        every = [self._data.oMi[j] for j in range(self.model.njoints)]
        self._places = rows_from([(X.rotation, X.translation) for X in every], 12)
        self._rotations = [X.rotation for X in placements]
        self._translations = [X.translation for X in placements]

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
            here = self._here = (self._near_compiled if in_use() else self._near)(q, margin, nv)
        numbers, body, P = here.numbers, here.body, here.P
        k = len(numbers)
        if not k:
            return None
        velocity, bias = np.zeros(3 * k), np.zeros(3 * k)
        if moves and in_use():
            parts = self.points.parts
            velocity, bias = _kernel().motion(
                P, body, self.points.part_of.take(numbers), self._places, self._joints, self.axes, here.up, self._carries,
                data.J.reshape(6, nv).T, data.dJ.reshape(6, nv).T, v, parts.kind, parts.radius, parts.form,
            )  # fmt: skip
        elif moves:
            rates, turning = self._rates(data.J.reshape(6, nv), data.dJ.reshape(6, nv), v)
            both = np.vecdot(rates[:, :, :3].take(body, axis=0), P[:, None, :]) + rates[:, :, 3].take(body, axis=0)
            velocity, bias = both[:, :3].reshape(3 * k), both[:, 3:].reshape(3 * k)
            if self.points.has_rounds:
                w, R = turning @ self.axes[:, 2], self._turned()  # w x n of each body
                at, over = self.points.wander(numbers, here.up, np.matmul(-w[:, None, :], R)[:, 0])
                of = body.take(at)
                spin = self.axes.T @ (turning.take(of, axis=0) @ R.take(of, axis=0))
                bias.reshape(k, 3)[at] += np.vecdot(spin, over.T[:, None, :])
        return Touching(numbers, self.label, P, self.axes, here.gaps, here.J, velocity, bias)

    def _near_compiled(self, q: Array, margin: float, nv: int) -> _Near:
        kernel = _kernel()
        up, height = kernel.normals(self._places, self._joints, self._normal, self.height)
        now, near, gaps = self.points.near(up, height, margin)
        numbers, body, P, J = kernel.rows(
            now.points, near, now.index, now.body, self._places, self._joints, self.axes, self._carries,
            self._data.J.reshape(6, nv).T,
        )  # fmt: skip
        return _Near(q.copy(), margin, up, numbers, body, *_shared(P, gaps, J))

    def _near(self, q: Array, margin: float, nv: int) -> _Near:
        """The points near the plane at the configuration of the data."""
        R = self._turned()
        p = np.concatenate(self._translations).reshape(-1, 3)
        n = self.axes[:, 2]
        up = n @ R
        numbers, local, gaps = self.points.at(up, p @ n - self.height, margin)
        k, body = len(numbers), self.points.body.take(numbers)
        P = np.vecdot(R.take(body, axis=0), local.T[:, None, :]) + p.take(body, axis=0)
        A = np.empty((k, 3, 6))
        A[:, :, :3] = self.axes.T
        A[:, :, 3:] = (P @ self._turn).reshape(k, 3, 3)
        J = A.reshape(3 * k, 6) @ self._data.J.reshape(6, nv)
        by_point = J.reshape(k, 3, nv)
        by_point *= self._carries.take(body, axis=0)[:, None, :]
        return _Near(q.copy(), margin, up, numbers, body, *_shared(P, gaps, J))

    def _turned(self) -> Array:
        """R_WJ of the bodies, shape (bodies, 3, 3)."""
        return np.concatenate(self._rotations).reshape(-1, 3, 3)

    def _rates(self, J_W: Array, dJ_W: Array, v: Array) -> tuple[Array, Array]:
        """(velocity and J_dot v of points fixed to each body, (bodies, 6, 4); [w]_x of each, (bodies, 3, 3)).

        Both are linear in the point: columns 0 to 2 are multiplied by P, column 3 is added.
        """
        moves = self._carries * v
        V, dV = moves @ J_W.T, moves @ dJ_W.T
        turning, rates = (V[:, 3:] @ _CROSS).reshape(-1, 3, 3), np.empty((len(V), 2, 3, 4))
        rates[:, 0, :, :3], rates[:, 0, :, 3] = turning, V[:, :3]
        rates[:, 1] = turning @ rates[:, 0]
        rates[:, 1, :, :3] += (dV[:, 3:] @ _CROSS).reshape(-1, 3, 3)
        rates[:, 1, :, 3] += dV[:, :3]
        return (self.axes.T @ rates).reshape(-1, 6, 4), turning

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
