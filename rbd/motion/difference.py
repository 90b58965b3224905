"""How far a motion is from another one of the same robot: of each joint, of the base and of the centre of mass."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.errors.inputs import check_kind
from rbd.motion.frame_terms import placements
from rbd.motion.reference_motion import Motion

_TOLD = 6  # joints that the table names
_SMALL = 1e-6  # rad or m: no difference to tell


@dataclass(frozen=True, eq=False, repr=False)
class MotionDifference(Displayed):
    """How far a motion is from its reference, at the n times of the motion.

    Attributes:
        t: Times, shape (n,) [s].
        names: Names of the robot's motors.
        joints: By how much each is beyond the reference, shape (n, nu) [rad, m].
        base: Its place less the reference's, in W, shape (n, 3) [m]; zero of a fixed base.
        turn: Angle between both bases, shape (n,) [rad].
        com: The centre of mass less the reference's, in W, shape (n, 3) [m].
        left_out: Length of the reference after the end of the motion [s].

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> low = solo.standing().q
        >>> rise = rbd.motion.minimum_jerk(solo, [low, low + 0.02 * np.eye(solo.nq)[2]], [0.0, 0.5])
        >>> far = rbd.motion.MotionDifference.of(rise.lifted(0.01), rise)
        >>> round(float(far.base[:, 2].max()), 6), far.worst()[0]
        (0.01, ('base', 0.01, 0.0))
    """

    t: Array
    names: tuple[str, ...]
    joints: Array
    base: Array
    turn: Array
    com: Array
    left_out: float

    @classmethod
    def of(cls, motion: Motion, reference: Motion) -> MotionDifference:
        """Frame by frame.

        Args:
            motion: A motion.
            reference: The motion that it is compared with; it has the same times, and may go on after its end.

        Raises:
            InputError: motions of different robots, or times that differ.
        """
        for name, given in (("motion", motion), ("reference", reference)):
            check_kind(name, given, Motion, "an rbd.Motion")
        robot, n = motion.robot, motion.n
        if not robot.is_like(reference.robot):
            raise InputError(f"motion is of {robot.name}, reference of {reference.robot.name}; expected motions of one robot.")
        if reference.n < n or not np.array_equal(reference.t[:n], motion.t):
            raise InputError("the times of the motion are not those of the reference; resample one of them.")
        model = robot.model
        off = np.array([pin.difference(model, a, b) for a, b in zip(reference.q[:n], motion.q, strict=True)])
        places, turns = np.zeros((n, 3)), np.zeros(n)
        if robot.floating:
            (R, p), (R0, p0) = (placements(robot, q) for q in (motion.q, reference.q[:n]))
            places = p[:, 1] - p0[:, 1]
            turns = np.array([np.linalg.norm(pin.log3(a.T @ b)) for a, b in zip(R0[:, 1], R[:, 1], strict=True)])
        data = model.createData()
        coms = [np.array([pin.centerOfMass(model, data, q).copy() for q in each]) for each in (motion.q, reference.q[:n])]
        return cls(
            motion.t, robot.actuated_names, off[:, robot.actuated], places, turns, coms[0] - coms[1],
            float(reference.t[-1] - motion.t[-1]),
        )  # fmt: skip

    def worst(self) -> list[tuple[str, float, float]]:
        """(what, largest difference [m, rad], time [s]) of the base, its turn, the centre of mass and each joint.

        Joints are in order of their differences, largest first.
        """
        sizes = {
            "base": np.linalg.norm(self.base, axis=1),
            "turn of the base": self.turn,
            "centre of mass": np.linalg.norm(self.com, axis=1),
        }
        whole = [_largest(name, size, self.t) for name, size in sizes.items()]
        joints = [_largest(name, np.abs(self.joints[:, j]), self.t) for j, name in enumerate(self.names)]
        return whole + sorted(joints, key=lambda each: -each[1])

    def __str__(self) -> str:
        rows = self.worst()
        shown = rows[:3] + [row for row in rows[3:] if row[1] > _SMALL][:_TOLD]
        lines = [f"{len(self.t)} frames beside their reference; largest differences:"]
        for name, size, t in shown:
            length = name in ("base", "centre of mass")
            value = f"{1e3 * size:8.1f} mm" if length else f"{math.degrees(size):8.2f} deg"
            lines.append(f"  {name:<28}{value:>12}  at {t:.3f} s")
        more = sum(row[1] > _SMALL for row in rows[3:]) - _TOLD
        if more > 0:
            lines.append(f"  and {more} joints less")
        if self.left_out > 0.0:
            lines.append(f"  it ends {self.left_out:.3f} s before its reference")
        return "\n".join(lines)

    def __repr__(self) -> str:
        name, size, t = self.worst()[0]
        return f"MotionDifference({len(self.t)} frames, {name} up to {1e3 * size:.1f} mm at {t:.3f} s)"


def _largest(name: str, size: Array, t: Array) -> tuple[str, float, float]:
    i = int(np.argmax(size)) if len(size) else 0
    return name, round(float(size[i]), 12), float(t[i])
