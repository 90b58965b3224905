"""The equations of motion in many frames: poses of bodies, inertial and known forces, and what contact forces must balance."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, rows_from
from rbd.errors import InputError
from rbd.model.checked_model import CheckedModel
from rbd.model.world import LEAST_FALL

LENGTH = 0.3
"""Moments on the base are measured in weights over this length [m]."""


def placements(robot: CheckedModel, q: Array) -> tuple[Array, Array]:
    """(R, p) of all joints' axes in W, shapes (n, joints, 3, 3) and (n, joints, 3)."""
    model = robot.model
    data = model.createData()
    every = rows_from([(X.rotation, X.translation) for X in data.oMi], 12)  # follows the data; R by columns, then p
    rows = np.empty((len(q), *every.shape))
    for i in range(len(q)):
        pin.forwardKinematics(model, data, q[i])
        rows[i] = every
    return np.ascontiguousarray(rows[..., :9].reshape(*rows.shape[:2], 3, 3).swapaxes(2, 3)), rows[..., 9:]


@dataclass(frozen=True, eq=False)
class FrameTerms:
    """Terms of the equations of motion in n frames of a robot with one floating base.

    Attributes:
        robot: The robot.
        need: M a + h, shape (n, nv) [N, N m].
        M_base: The rows of M of the base, shape (n, 6, nv).
        M_size: Root of the sum of squares of each row of M with a unit noise `sigma`, shape (n, nv): noise in `need`.
        R: Orientation of the base, shape (n, 3, 3).
        base: Its place, shape (n, 3) [m].
        com: The centre of mass, shape (n, 3) [m].
        J: Jacobian of all bodies' velocities at W's origin, world axes, shape (n, 6, nv).
        wrench: What must act on the robot from outside, gravity apart, about the centre of mass, world axes, shape (n, 6).
        wrench_noise: Its standard deviation by noise in a, over weight and weight times `LENGTH`, shape (n,).
    """

    robot: CheckedModel
    need: Array
    M_base: Array
    M_size: Array
    R: Array
    base: Array
    com: Array
    J: Array
    wrench: Array
    wrench_noise: Array

    @classmethod
    def of(cls, robot: CheckedModel, q: Array, v: Array, a: Array, sigma: Array | None) -> FrameTerms:
        """Evaluated frame by frame.

        Args:
            robot: The robot.
            q: Shape (n, nq).
            v: Shape (n, nv).
            a: Shape (n, nv).
            sigma: Standard deviation of a, shape (nv,); None: exact.
        """
        model, n, nv = robot.model, len(q), robot.nv
        data = model.createData()
        need, M_base, J = np.empty((n, nv)), np.empty((n, 6, nv)), np.empty((n, 6, nv))
        R, base = np.empty((n, 3, 3)), np.empty((n, 3))
        size = np.zeros((n, nv))
        X = data.oMi[1]
        turn, at = X.rotation, X.translation
        for i in range(n):
            need[i] = pin.rnea(model, data, q[i], v[i], a[i])
            M = pin.crba(model, data, q[i], pin.Convention.WORLD)
            M_base[i] = M[:6]
            J[i] = data.J
            R[i], base[i] = turn, at
            if sigma is not None:
                size[i] = np.square(M) @ np.square(sigma)
        mass = M_base[:, 0, 0]
        lever = np.stack([M_base[:, 2, 4], M_base[:, 0, 5], M_base[:, 1, 3]], axis=1) / mass[:, None]
        com = base + np.matmul(R, -lever[:, :, None])[..., 0]
        found = cls(robot, need, M_base, np.sqrt(size), R, base, com, J, need[:, :6], np.zeros(n))
        wrench = found.to_wrench(need[:, :6])
        noise = np.zeros(n)
        if sigma is not None:
            F, about_base = np.split(M_base * (sigma / wrench_scale(robot)[:, None]), 2, axis=1)
            about_com = about_base + np.cross(lever[:, :, None] / LENGTH, F, axis=1)  # in the base's axes: sizes are the same
            noise = np.sqrt(np.square(F).sum(axis=(1, 2)) + np.square(about_com).sum(axis=(1, 2)))
        return cls(robot, need, M_base, np.sqrt(size), R, base, com, J, wrench, noise)

    def some(self, which: Array) -> FrameTerms:
        """Those of some frames."""
        kept = {f.name: getattr(self, f.name)[which] for f in fields(self) if f.name != "robot"}
        return FrameTerms(self.robot, **kept)

    def to_wrench(self, rows: Array) -> Array:
        """Generalised forces on the base as wrenches about the centre of mass, world axes."""
        F = np.matmul(self.R, rows[:, :3, None])[..., 0]
        return np.hstack([F, np.matmul(self.R, rows[:, 3:, None])[..., 0] + np.cross(self.base - self.com, F)])

    def wrench_map(self, places: Array, touches: Array, axes: Array | None = None) -> Array:
        """Wrenches about the centre of mass of unit forces at points, shape (n, 6, k, 3); zero where none touch.

        Args:
            places: Shape (n, k, 3) [m].
            touches: Shape (n, k).
            axes: The forces' directions, as columns, shape (n, k, 3, 3); None: x, y and z.
        """
        n, k, _ = places.shape
        x, y, z = np.moveaxis(places - self.com[:, None], -1, 0)
        out = np.zeros((n, 6, k, 3))
        for i in range(3):
            out[:, i, :, i] = 1.0
        out[:, 3, :, 1], out[:, 3, :, 2] = -z, y
        out[:, 4, :, 0], out[:, 4, :, 2] = z, -x
        out[:, 5, :, 0], out[:, 5, :, 1] = -y, x
        return turned(np.where(touches[:, None, :, None], out, 0.0), axes)

    def joint_map(self, joint: Array, places: Array, touches: Array, rows: Array, axes: Array | None = None) -> Array:
        """Torques at coordinates `rows` that unit forces at points replace, shape (n, rows, k, 3); see `wrench_map`.

        Points are carried by joints `joint`, shape (k,).
        """
        n, k, _ = places.shape
        out = np.zeros((n, len(rows), k, 3))
        linear, angular = self.J[:, :3, rows].transpose(0, 2, 1), self.J[:, 3:, rows].transpose(0, 2, 1)
        carried = carriers(self.robot)[:, rows]
        for j in range(k):  # f . (v + w x p) = f . v + f . (w x p)
            on = np.flatnonzero(carried[joint[j]])
            moved = linear[:, on] + np.cross(angular[:, on], places[:, j, None])
            out[:, on, j] = np.where(touches[:, j, None, None], moved, 0.0)
        return turned(out, axes)


def turned(maps: Array, axes: Array | None) -> Array:
    """Maps of forces along x, y, z, shape (n, r, k, 3), as maps of forces along axes (n, k, 3, 3), their columns."""
    return maps if axes is None else np.einsum("nrki,nkij->nrkj", maps, axes)


def numbers_of(robot: CheckedModel) -> tuple[Array, Array]:
    """(indices in q, in v) of the coordinates that are single numbers: of sliding joints and hinges with limits."""
    q, v = np.array([(p.q, p.v) for p in robot.joints.pieces if p.kind == "number"], int).reshape(-1, 2).T
    return q, v


def carriers(robot: CheckedModel) -> Array:
    """Which coordinates move each joint's body, shape (joints, nv)."""
    return np.array([robot.joints.carrying(joint) for joint in range(robot.model.njoints)]) > 0.0


def wrench_scale(robot: CheckedModel) -> Array:
    """Weight, and weight times `LENGTH`, shape (6,) [N, N m]."""
    weight = robot.mass * float(np.linalg.norm(robot.gravity))
    return weight * np.array([1.0, 1.0, 1.0, LENGTH, LENGTH, LENGTH])


def check_robot(robot: CheckedModel) -> None:
    """Refuse robots that the check cannot treat.

    Raises:
        InputError: no floating base or several, passive joints, closed loops, or gravity that does not press on a level floor.
    """
    name = robot.name
    if not robot.floating:
        raise InputError(f"{name} has no floating base, or several: a motion is checked of one robot that stands free.")
    if robot.passive or robot.loops():
        raise InputError(f"{name} has passive joints or closed loops; a motion is checked of trees with a motor at each joint.")
    g = robot.gravity
    if not -g[2] > LEAST_FALL * np.linalg.norm(g):
        raise InputError(f"gravity of {name} is {g.tolist()}; expected one that presses it on a level floor, z below zero.")
