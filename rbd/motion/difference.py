"""How far a motion is from another one of the same robot: joints, base, centre of mass, and the points that touch the floor."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.errors.inputs import check_kind
from rbd.model.sampled_motion import SampledPoses, interpolated_q
from rbd.motion.frame_terms import placements
from rbd.motion.reference_motion import Motion
from rbd.simulation.trajectory import Trajectory

_TOLD = 6  # joints that the table names
_INSTANT = 1e-6  # s
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
        feet: {contact: distance of its farthest point from where the reference has it, shape (n,)} [m], of the contacts that a
            reference with contacts has.
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
    feet: dict[str, Array]
    left_out: float

    @classmethod
    def of(cls, motion: SampledPoses, reference: Motion) -> MotionDifference:
        """Frame by frame; times count from the start of each.

        Args:
            motion: A motion, or an `rbd.Trajectory`, as of a controller that follows the reference.
            reference: The motion that it is compared with, between its frames by cubics; it may go on after its end.

        Raises:
            InputError: motions of different robots, or one that is longer than its reference.
        """
        check_kind("motion", motion, Motion | Trajectory, "an rbd.Motion, or an rbd.Trajectory")
        check_kind("reference", reference, Motion, "an rbd.Motion")
        robot, n = reference.robot, len(motion.t)
        # A robot of other masses is as good: joints are compared.
        if not robot.is_like(motion.robot) and list(robot.joints) != list(motion.robot.joints):
            raise InputError(f"motion is of {motion.robot.name}, reference of {robot.name}; expected motions of one robot.")
        at = motion.t - (motion.t[0] - reference.t[0])
        left_out = float(reference.t[-1] - at[-1])
        if left_out < -_INSTANT:
            raise InputError(
                f"the motion goes on for {-left_out:.3f} s after the end of its reference; cut it: motion.cut(end=...), or "
                "simulate duration=reference.duration."
            )
        if np.array_equal(reference.t[:n], at):
            wanted = reference.q[:n]
        else:
            wanted = interpolated_q(robot, reference.t, reference.q, reference.v, np.minimum(at, reference.t[-1]))
        off = np.array([pin.difference(robot.model, a, b) for a, b in zip(wanted, motion.q, strict=True)])
        placed, placed0 = placements(robot, motion.q), placements(robot, wanted)
        places, turns, feet = np.zeros((n, 3)), np.zeros(n), dict[str, Array]()
        if robot.floating:
            (R, p), (R0, p0) = placed, placed0
            places = p[:, 1] - p0[:, 1]
            turns = np.array([np.linalg.norm(pin.log3(a.T @ b)) for a, b in zip(R0[:, 1], R[:, 1], strict=True)])
        if (lanes := reference.contacts) is not None:
            far = np.linalg.norm(lanes.points.places(*placed) - lanes.points.places(*placed0), axis=2)
            own = [lanes.points.group == g for g in range(len(lanes.contacts))]
            feet = {c.name: far[:, each].max(axis=1) for c, each in zip(lanes.contacts, own, strict=True) if each.any()}
        data = robot.model.createData()
        coms = [np.array([pin.centerOfMass(robot.model, data, q).copy() for q in each]) for each in (motion.q, wanted)]
        return cls(
            motion.t, robot.actuated_names, off[:, robot.actuated], places, turns, coms[0] - coms[1], feet, max(left_out, 0.0)
        )

    @property
    def joint_rms(self) -> float:
        """Root mean square of the joints' differences over all frames [rad, m]."""
        return float(np.sqrt(np.square(self.joints).mean())) if self.joints.size else 0.0

    def worst(self) -> list[tuple[str, float, float]]:
        """(what, largest difference [m, rad], time [s]) of the base, its turn, the centre of mass, each foot and each joint.

        Joints are in order of their differences, largest first.
        """
        sizes = {
            "base": np.linalg.norm(self.base, axis=1),
            "turn of the base": self.turn,
            "centre of mass": np.linalg.norm(self.com, axis=1),
            **self.feet,
        }
        whole = [_largest(name, size, self.t) for name, size in sizes.items()]
        joints = [_largest(name, np.abs(self.joints[:, j]), self.t) for j, name in enumerate(self.names)]
        return whole + sorted(joints, key=lambda each: -each[1])

    def __str__(self) -> str:
        rows = self.worst()
        k = 3 + len(self.feet)
        shown = rows[:k] + [row for row in rows[k:] if row[1] > _SMALL][:_TOLD]
        rms = math.degrees(self.joint_rms)
        lines = [f"{len(self.t)} frames beside their reference, joints {rms:.2f} deg rms; largest differences:"]
        for name, size, t in shown:
            length = name in ("base", "centre of mass", *self.feet)
            value = f"{1e3 * size:8.1f} mm" if length else f"{math.degrees(size):8.2f} deg"
            lines.append(f"  {name:<28}{value:>12}  at {t:.3f} s")
        more = sum(row[1] > _SMALL for row in rows[k:]) - _TOLD
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
