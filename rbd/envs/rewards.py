"""`Reference`: where a robot is to be, a posture or a motion over time, and the reward for being near it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rbd.arrays import Array, check_finite, check_positive
from rbd.constraints.constraint import Constraint
from rbd.errors import InputError
from rbd.errors.inputs import check_kind
from rbd.model.state import State
from rbd.motion.checking import check_motion
from rbd.motion.reference_motion import Motion
from rbd.robots.robot import Robot
from rbd.statics.equilibrium import hold
from rbd.worlds.stepping import Worlds

CARRIES = 0.01
"""Load of a foot that counts as a touch, over the robot's weight."""


class Reference:
    """Samples of base and joints at the control rate; a posture is one sample.

    Attributes:
        base: Position and quaternion, shape (T, 7).
        angles: Of the joints, in the order of v, shape (T, nv - 6).
        v: Velocities, shape (T, nv).
        tau: Torques that hold the posture, or produce the motion by `rbd.check_motion`, shape (T, nu) [N m].
        feet: {foot: (whether it touches, its normal load [N])}, each of shape (T,), of the motion by `rbd.check_motion`.
    """

    def __init__(
        self, robot: Robot, standing: State, contacts: Sequence[Constraint], motion: Motion | None, dt: float
    ) -> None:  # fmt: skip
        self.robot, self.motion = robot, motion
        self.height = check_positive("the height of the base over the feet", float(standing.q[2]), 1e3, "m")
        joints = robot.model.joints[2:]
        self._at, self._turns = np.array([j.idx_q for j in joints], int), np.array([j.nq == 2 for j in joints], bool)
        self.feet: dict[str, tuple[Array, Array]] = {}
        if motion is None:
            q, v, self.tau = standing.q[None], np.zeros((1, robot.nv)), hold(standing, contacts).tau[None]
        else:
            check_kind("motion", motion, Motion, "an rbd.Motion: rbd.Motion.read('dance.csv', robot='g1'), or None")
            if not motion.robot.is_like(robot):
                raise InputError(f"motion is of {motion.robot.name}, and the robot {robot.name}; expected one robot.")
            report = check_motion(motion.resample(1.0 / dt), self_collision=False, progress=False)
            q, v, self.tau, found = report.motion.q, report.motion.v, report.tau, report.lanes
            check_finite("the torques of the motion", self.tau)
            for i, contact in enumerate(found.contacts):
                own = found.points.group == i
                self.feet[contact.name] = np.asarray(found.touches[:, own].any(axis=1)), report.forces[:, own, 2].sum(axis=1)
        self.q, self.base, self.v, self.angles = q, q[:, :7], v, self.angles_of(q)
        self.posture = self.angles_of(standing.q[None])[0]
        self.gravity = gravity_in(self.base)

    @property
    def last(self) -> int:
        """Its last sample."""
        return len(self.base) - 1

    def angles_of(self, q: Array) -> Array:
        """Angles of the joints, shape (n, nv - 6)."""
        out = q[:, self._at]
        if self._turns.any():
            own = self._at[self._turns]
            out[:, self._turns] = np.arctan2(q[:, own + 1], q[:, own])
        return out

    def terms(self, at: Array, q: Array, v: Array, change: Array, worlds: Worlds, used: Array) -> dict[str, Array]:
        """What the reward is the mean of, each in [0, 1], shape (n,).

        Args:
            at: The sample of each world, shape (n,).
            q: Configurations.
            v: Velocities.
            change: Of the action since the last, shape (n, size).
            worlds: For the loads of the feet.
            used: Greatest share of its limit that a motor gives, shape (n,).
        """
        h, base, angles = self.height, self.base[at], self.angles[at]
        off = angles - self.angles_of(q)
        v_off = v - self.v[at]
        lean = 1.0 - (gravity_in(q) * self.gravity[at]).sum(axis=1)
        out = {
            "height": _near((q[:, 2] - base[:, 2]) / h, 0.1),
            "upright": np.exp(-10.0 * lean),
            "joints": np.exp(-(off**2).mean(axis=1) / 0.3**2),
            "still": _near(np.linalg.norm(v_off[:, :3], axis=1) / np.sqrt(9.81 * h), 0.3),
            "calm": np.exp(-(change**2).mean(axis=1)),
        }
        if self.motion is not None:
            turned = 1.0 - (q[:, 3:7] * base[:, 3:7]).sum(axis=1) ** 2  # sin^2 of half the angle between them
            out["place"] = _near(np.linalg.norm(q[:, :2] - base[:, :2], axis=1) / h, 0.3)
            out["heading"] = np.exp(-10.0 * turned)
            out["motors"] = np.exp(-5.0 * np.maximum(used - 0.8, 0.0))
            weight, forces = 9.81 * self.robot.mass, worlds.forces
            feet = [(forces[name], touches[at], load[at]) for name, (touches, load) in self.feet.items() if name in forces]
            if feet:
                out["touches"] = np.mean([(f[:, 2] > CARRIES * weight) == touches for f, touches, _ in feet], axis=0)
                out["loads"] = _near(np.sum([np.abs(f[:, 2] - load) for f, _, load in feet], axis=0) / weight, 1.0)
        return out


def gravity_in(q: Array) -> Array:
    """Direction of gravity (0, 0, -1) in the axes of the base, shape (n, 3)."""
    x, y, z, w = q[:, 3:7].T
    return -np.stack([2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)], axis=1)


def _near(x: Array, scale: float) -> Array:
    return np.asarray(np.exp(-((x / scale) ** 2)))
