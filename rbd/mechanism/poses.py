"""Poses of a mechanism: equality, distance, joint limits, random draws."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, max_abs
from rbd.constraints.descent import displacement
from rbd.model.checked_model import CheckedModel
from rbd.model.joints import ANGLE, Piece


@dataclass(frozen=True)
class LimitViolation:
    """A joint outside the limits of its file.

    Attributes:
        joint: Its name.
        value: Angle [rad] or displacement [m].
        lower: Lower limit.
        upper: Upper limit.
        unit: Of the three: "rad" or "m".
    """

    joint: str
    value: float
    lower: float
    upper: float
    unit: str = ANGLE

    def __str__(self) -> str:
        value, lower, upper = (measured(x, self.unit) for x in (self.value, self.lower, self.upper))
        return f"{self.joint} at {value}, limits {lower} to {upper}"


def measured(value: float, unit: str) -> str:
    """A joint's coordinate as text: an angle of `unit` "rad" in degrees, else the number with its unit."""
    # Rounding before adding zero turns -0.00 into 0.00
    return f"{round(math.degrees(value), 2) + 0.0:.2f} deg" if unit == ANGLE else f"{value + 0.0:.5g} {unit}"


def moved_in_words(robot: CheckedModel, moved: float) -> str:
    """How far a pose is from the start, the norm of the joints' displacements, with its unit."""
    units = " and ".join(dict.fromkeys(c.unit for c in robot.joints.velocities))
    return f"{moved:.4g} {units} from the start, over all joints (root of the sum of squares)"


def joints_in_words(robot: CheckedModel, q: Array, without: Collection[str] = ()) -> tuple[str, ...]:
    """Each joint with its angle in degrees or its displacement, such as "coupler_joint -19.70 deg".

    A joint with several degrees of freedom is told by the position and the rotation vector of its body.

    Args:
        robot: The robot.
        q: Configuration, shape (nq,).
        without: Joints that are left out.
    """
    out = []
    for joint in robot.joints.values():
        if joint.name in without:
            continue
        if joint.nv == 1:
            out.append(f"{joint.name} {measured(joint.coordinate(q), joint.unit)}")
            continue
        model = robot.model.joints[joint.id]
        data = model.createData()
        model.calc(data, np.asarray(q[joint.q], float))
        turn = np.degrees(pin.log3(data.M.rotation))
        place, turned = (", ".join(f"{x:.4g}" for x in np.round(each, 6) + 0.0) for each in (data.M.translation, turn))
        out.append(f"{joint.name} at ({place}) m, turned by ({turned}) deg")
    return tuple(out)


def distance(robot: CheckedModel, q: Array, to: Array) -> float:
    """Largest entry of `displacement`: zero for two representations of one pose [rad, m]."""
    return max_abs(displacement(robot, q, to))


def canonical(robot: CheckedModel, q: Array, keep: Array) -> Array:
    """The same pose with its plain angles in (-pi, pi], or a turn off where only that is within the limits.

    Args:
        robot: The robot.
        q: Configuration, shape (nq,).
        keep: Velocities whose coordinates are not changed, shape (nv,), bool.
    """
    out, low, high = q.copy(), robot.model.lowerPositionLimit, robot.model.upperPositionLimit
    for piece in robot.joints.pieces:
        if not piece.periodic or keep[piece.v]:
            continue
        at = piece.q
        angle = math.remainder(out[at], 2.0 * math.pi)
        angle = angle + 2.0 * math.pi if angle < -math.pi + 1e-9 else angle
        turns = [angle, angle - 2.0 * math.pi, angle + 2.0 * math.pi]
        out[at] = next((x for x in turns if low[at] - 1e-9 <= x <= high[at] + 1e-9), angle)
    return out


def beyond_limits(robot: CheckedModel, q: Array) -> tuple[LimitViolation, ...]:
    """The joints with one degree of freedom that are outside their file's limits."""
    limits = [(j, j.lower, j.upper) for j in robot.joints.values() if not (j.lower == -math.inf and j.upper == math.inf)]
    found = [(j, j.coordinate(q), low, high) for j, low, high in limits]
    return tuple(LimitViolation(j.name, x, a, b, j.unit) for j, x, a, b in found if not a - 1e-9 <= x <= b + 1e-9)


def draw(robot: CheckedModel, rng: np.random.Generator) -> Array:
    """A configuration at random, shape (nq,): angles over their limits or one turn, displacements over theirs or the reach."""
    q = np.asarray(pin.neutral(robot.model))
    for piece in robot.joints.pieces:
        q[piece.q : piece.q + piece.nq] = _drawn(robot, piece, rng)
    return q


def _drawn(robot: CheckedModel, piece: Piece, rng: np.random.Generator) -> Array:
    reach = robot.joints.reach
    unit = rng.normal(size=4)
    unit /= np.linalg.norm(unit)
    angle = rng.uniform(-math.pi, math.pi)
    circle = np.array([math.cos(angle), math.sin(angle)])
    ways = rng.uniform(-reach, reach, size=3)
    if piece.kind == "number":
        low = float(robot.model.lowerPositionLimit[piece.q])
        high = float(robot.model.upperPositionLimit[piece.q])
        if not robot.joints.angular[piece.v] and low < reach and high > -reach:
            low, high = max(low, -reach), min(high, reach)  # files write kilometres for unlimited
        if not (math.isfinite(high - low) and high - low < 1e100):
            return np.array([angle])
        return np.array([rng.uniform(low, high)])
    if piece.kind == "circle":
        return circle
    if piece.kind == "sphere":
        return unit
    return np.r_[ways[:2], circle] if piece.kind == "plane" else np.r_[ways, unit]
