"""What a record's numbers amount to: the forces that are missing in its equation of motion, and how its points move."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, cross_rows, rows_from
from rbd.audits.record import Record
from rbd.motion.frame_terms import carriers

BLOCK = 1024
"""Frames computed at once."""


@dataclass(frozen=True, eq=False)
class Balance:
    """A record's equation of motion, and the motion of its points; world axes.

    Attributes:
        missing: M a + h - tau - J^T f, shape (n, nv) [N, N m]: what must act besides what the record names.
        u: Velocity of each point's first body less that of its second, shape (k, 3) [m/s].
        w: The same of accelerations, shape (k, 3) [m/s2].
    """

    missing: Array
    u: Array
    w: Array


def balance_of(record: Record) -> Balance:
    """Evaluated frame by frame, with Pinocchio's recursive Newton-Euler algorithm: no mass matrix, no solver."""
    missing, k = np.empty((record.n, record.robot.nv)), len(record.contact_at)
    u, w = np.empty((k, 3)), np.empty((k, 3))
    carried = carriers(record.robot).astype(float)
    for begin in range(0, record.n, BLOCK):
        end = min(begin + BLOCK, record.n)
        motion = _Bodies.of(record, begin, end)
        points = slice(int(record.starts[begin]), int(record.starts[end]))
        at, bodies = record.contact_at[points] - begin, record.joints[record.contact_bodies[points]]
        first, second = (motion.at(at, bodies[:, side], record.points[points]) for side in (0, 1))
        u[points], w[points] = first[0] - second[0], first[1] - second[1]
        pushes = np.flatnonzero((record.push_at >= begin) & (record.push_at < end))
        wrench = np.zeros((end - begin, record.robot.model.njoints, 6))  # about the world's origin
        for which, sign in ((0, 1.0), (1, -1.0)):
            _add(wrench, at, bodies[:, which], record.points[points], sign * record.forces[points])
        where, on = record.push_at[pushes] - begin, record.joints[record.push_bodies[pushes]]
        _add(wrench, where, on, record.push_points[pushes], record.push_forces[pushes], record.push_moments[pushes])
        acting = np.einsum("jv,njs->nvs", carried, wrench, optimize=True)
        missing[begin:end] = motion.need - record.tau[begin:end] - np.einsum("nvs,nsv->nv", acting, motion.J)
    return Balance(missing, u, w)


def jacobians(record: Record, frame: int) -> Array:
    """Jacobians of the relative velocities at the points of a frame, shape (k, 3, nv); their transposes map the forces."""
    points = record.of_frame(frame)
    motion, carried = _Bodies.of(record, frame, frame + 1), carriers(record.robot).astype(float)
    first, second = record.joints[record.contact_bodies[points]].T
    linear, angular = motion.J[0, :3], motion.J[0, 3:]
    J = linear + np.cross(angular[None], record.points[points][:, :, None], axis=1)  # v + w x p
    return np.asarray(J * (carried[first] - carried[second])[:, None])


@dataclass(frozen=True, eq=False)
class _Bodies:
    """Of n frames: M a + h, Jacobians at the world's origin, and the motion of all joints' bodies in world axes.

    `place`, `speed`, `turn`, `rate` and `spin` are positions, velocities and classical accelerations of the joints' origins,
    angular velocities and accelerations, shapes (n, joints, 3).
    """

    need: Array
    J: Array
    place: Array
    speed: Array
    spin: Array
    rate: Array
    turn: Array

    @classmethod
    def of(cls, record: Record, begin: int, end: int) -> _Bodies:
        robot, n = record.robot, end - begin
        model, data = robot.model, robot.model.createData()
        # These follow the data; R is by columns.
        poses = rows_from([(X.rotation, X.translation) for X in data.oMi], 12)
        velocity, acceleration = (rows_from([(x.linear, x.angular) for x in of], 6) for of in (data.v, data.a_gf))
        need, J = np.empty((n, robot.nv)), np.empty((n, 6, robot.nv))
        place, moves = np.empty((n, *poses.shape)), np.zeros((n, model.njoints, 12))
        q, v, a = record.q, record.v, record.a
        for i in range(n):
            k = begin + i
            need[i] = pin.rnea(model, data, q[k], v[k], a[k])
            J[i] = pin.computeJointJacobians(model, data, q[k])
            place[i] = poses
            moves[i, :, :6] = velocity
            moves[i, :, 6:] = acceleration
        R = np.swapaxes(place[..., :9].reshape(n, -1, 3, 3), 2, 3)
        speed, spin, rate, turn = (np.einsum("njab,njb->nja", R, moves[..., 3 * part : 3 * part + 3]) for part in range(4))
        moves_up = rate + robot.gravity + cross_rows(spin.reshape(-1, 3), speed.reshape(-1, 3)).reshape(rate.shape)
        for x in (speed, spin, turn, moves_up):
            x[:, 0] = 0.0
        return cls(need, J, place[..., 9:], speed, spin, moves_up, turn)

    def at(self, frame: Array, joint: Array, p: Array) -> tuple[Array, Array]:
        """(velocities, classical accelerations) of points p of the joints' bodies, shapes (k, 3)."""
        arm, spin = p - self.place[frame, joint], self.spin[frame, joint]
        swing = np.cross(spin, arm)
        moved = self.rate[frame, joint] + np.cross(self.turn[frame, joint], arm) + np.cross(spin, swing)
        return self.speed[frame, joint] + swing, moved


def _add(wrench: Array, frame: Array, joint: Array, p: Array, force: Array, moment: Array | float = 0.0) -> None:
    np.add.at(wrench, (frame, joint), np.hstack([force, np.cross(p, force) + moment]))
