"""The equations of motion along a whole path of poses, by differences of neighbours, with their derivatives by the poses.

    need[k] = M(q[k]) a[k] + h(q[k], v[k]) - sum_i J_i^T f_i[k] = S^T tau

Its first six entries are what is missing on the base, the others are the motors' torques.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, each_times, rows_from
from rbd.model.checked_model import CheckedModel


@dataclass(frozen=True, eq=False)
class Sweep:
    """n poses at equal times, their rates by differences, and M a + h there.

    v[k] = (d[k] + d[k-1]) / 2 dt and a[k] = (d[k] - d[k-1]) / dt^2 with d[k] from pose k to the next, in the robot's own
    axes; the first and the last frame have the accelerations of their neighbours.

    Attributes:
        robot: The robot.
        dt: Time between poses [s].
        q: Shape (n, nq).
        v: Shape (n, nv).
        a: Shape (n, nv).
        need: M a + h - J^T f, shape (n, nv) [N, N m].
        by_q, by_v, M: Its derivatives by q, v and a, shapes (n, nv, nv).
        J: Jacobian of all bodies' velocities at W's origin, linear first, world axes, shape (n, 6, nv).
        R: Orientations of joints, shape (n, joints, 3, 3).
        p: Their origins, shape (n, joints, 3) [m].
        com: Centre of mass, shape (n, 3) [m].
        J_com: Its Jacobian, shape (n, 3, nv).
    """

    robot: CheckedModel
    dt: float
    q: Array
    v: Array
    a: Array
    need: Array
    by_q: Array
    by_v: Array
    M: Array
    J: Array
    R: Array
    p: Array
    com: Array
    J_com: Array

    @classmethod
    def of(cls, robot: CheckedModel, q: Array, dt: float, joints: Sequence[int] = (), wrenches: Array | None = None) -> Sweep:
        """That of poses, n of 3 or more.

        Args:
            robot: The robot, with a floating base.
            q: Shape (n, nq).
            dt: Time between them [s].
            joints: Joints whose bodies are pushed; one may be named several times.
            wrenches: Forces on them and moments about their origins, in the joints' axes, shape (n, joints, 6) [N, N m].
        """
        model, n, nv = robot.model, len(q), robot.nv
        pushes = pin.StdVec_Force([pin.Force.Zero()] * model.njoints)
        different, which = np.unique(np.array(joints, int), return_inverse=True)
        pushed, given = [pushes[int(j)] for j in different], np.zeros((n, len(different), 6))
        if wrenches is not None:
            for f, j in enumerate(which):
                given[:, j] += wrenches[:, f]
        v, a = rates(robot, q, dt)
        data = model.createData()
        every = rows_from([(X.rotation, X.translation) for X in data.oMi], 12)
        need, J, rows = np.empty((n, nv)), np.empty((n, 6, nv)), np.empty((n, *every.shape))
        by_q, by_v, M = np.empty((3, n, nv, nv))
        for k in range(n):
            for f, push in enumerate(pushed):
                push.vector = given[k, f]
            by_q[k], by_v[k], M[k] = pin.computeRNEADerivatives(model, data, q[k], v[k], a[k], pushes)
            need[k], J[k], rows[k] = data.tau, data.J, every
        upper = np.triu(M, 1)
        M = np.triu(M) + upper.swapaxes(1, 2)
        R = np.ascontiguousarray(rows[..., :9].reshape(*rows.shape[:2], 3, 3).swapaxes(2, 3))
        p = rows[..., 9:]
        mass = M[:, 0, 0]
        lever = np.stack([M[:, 1, 5], M[:, 2, 3], M[:, 0, 4]], axis=1) / mass[:, None]  # m [c]x = -M[:3, 3:6]
        com = p[:, 1] + np.matmul(R[:, 1], lever[:, :, None])[..., 0]
        return cls(robot, dt, q, v, a, need, by_q, by_v, M, J, R, p, com, R[:, 1] @ M[:, :3] / mass[:, None, None])

    @property
    def turning(self) -> Array:
        """Of the angular momentum about the centre of mass, in W, over the mass: its map from velocities, shape (n, 3, nv)."""
        R, M = self.R[:, 1], self.M / self.M[:, :1, :1]
        return np.asarray(R @ M[:, 3:6] + np.cross((self.p[:, 1] - self.com)[:, :, None], R @ M[:, :3], axis=1))

    @property
    def moment(self) -> Array:
        """`need` about the centre of mass, in W, shape (n, 3) [N m]: where nothing pushes, the rate of angular momentum."""
        R = self.R[:, 1]
        force, about_base = each_times(R, self.need[:, :3]), each_times(R, self.need[:, 3:6])
        return about_base + np.cross(self.p[:, 1] - self.com, force)


def rates(robot: CheckedModel, q: Array, dt: float) -> tuple[Array, Array]:
    """(v, a) at n poses from the steps between them; a of the ends is that of their neighbours."""
    n = len(q)
    d = np.array([pin.difference(robot.model, q[k], q[k + 1]) for k in range(n - 1)])
    at = np.clip(np.arange(n), 1, n - 2)
    a = (d[at] - d[at - 1]) / dt**2
    v = (d[at] + d[at - 1]) / (2.0 * dt)
    v[0], v[-1] = d[0] / dt - 0.5 * dt * a[0], d[-1] / dt + 0.5 * dt * a[-1]
    return v, a
