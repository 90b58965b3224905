"""Contact points of convex shapes with a fixed plane, and how they move.

Let V = (v_0, w) and A = (a_0, alpha) be spatial velocity and J_dot v of a joint's body at W's origin, P a contact point on it,
which moves over the body at c, and d one of the plane's axes:

    J = (d, P x d) J_W over the joints that carry the body        velocity = J v
    bias = d . (a_0 + alpha x P + w x (v_0 + w x P + c))

For a corner c is zero, and the last term makes the acceleration classical; of round parts see `rbd.constraints.convex.rounds`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, cross_matrix
from rbd.constraints.contact_kinematics import Touching
from rbd.constraints.convex.low_points import LowPoints
from rbd.constraints.convex.solids import ConvexShape
from rbd.model.checked_model import CheckedModel

_CROSS = np.array([cross_matrix(e) for e in np.eye(3)]).reshape(3, 9)
"""Maps w in a row to [w]_x, row by row."""


class OnPlane:
    """Contact points of shapes with a fixed plane. Not for two threads at once.

    Args:
        robot: The robot.
        shapes: Those that can touch, in the order of their joints.
        axes: R_WC, the plane's normal third, shape (3, 3).
        point: A point of the plane, in W, shape (3,) [m].
    """

    def __init__(self, robot: CheckedModel, shapes: Sequence[ConvexShape], axes: Array, point: Array) -> None:
        self.model, self.axes, self.height = robot.model, axes, float(axes[:, 2] @ point)
        self.joints = sorted({shape.joint for shape in shapes})
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
        placements = [self._data.oMi[joint] for joint in self.joints]
        # Views, which follow the data.
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
        data, moves = self._data, bool(v.any())
        if moves:
            pin.computeJointJacobiansTimeVariation(self.model, data, q, v)
        else:
            pin.computeJointJacobians(self.model, data, q)
        R = np.concatenate(self._rotations).reshape(-1, 3, 3)
        p = np.concatenate(self._translations).reshape(-1, 3)
        n = self.axes[:, 2]
        up = n @ R
        numbers, local, gaps = self.points.at(up, p @ n - self.height, margin)
        k, nv = len(numbers), len(v)
        if not k:
            return None
        body = self.points.body.take(numbers)
        P = np.vecdot(R.take(body, axis=0), local.T[:, None, :]) + p.take(body, axis=0)
        A = np.empty((k, 3, 6))
        A[:, :, :3] = self.axes.T
        A[:, :, 3:] = (P @ self._turn).reshape(k, 3, 3)
        J_W = data.J.reshape(6, nv)
        J = A.reshape(3 * k, 6) @ J_W
        by_point = J.reshape(k, 3, nv)
        by_point *= self._carries.take(body, axis=0)[:, None, :]
        velocity, bias = np.zeros(3 * k), np.zeros(3 * k)
        if moves:
            rates, turning = self._rates(J_W, data.dJ.reshape(6, nv), v)
            both = np.vecdot(rates[:, :, :3].take(body, axis=0), P[:, None, :]) + rates[:, :, 3].take(body, axis=0)
            velocity, bias = both[:, :3].reshape(3 * k), both[:, 3:].reshape(3 * k)
            if self.points.has_rounds:
                w = turning @ n  # w x n of each body
                at, over = self.points.wander(numbers, up, np.matmul(-w[:, None, :], R)[:, 0])
                of = body.take(at)
                spin = self.axes.T @ (turning.take(of, axis=0) @ R.take(of, axis=0))
                bias.reshape(k, 3)[at] += np.vecdot(spin, over.T[:, None, :])
        return Touching(numbers, self.label, P, self.axes, gaps, J, velocity, bias)

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
