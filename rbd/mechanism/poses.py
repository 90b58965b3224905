"""Poses of a mechanism: equality, distance, joint limits, random draws."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, max_abs
from rbd.model.checked_model import CheckedModel
from rbd.model.joints import Piece


@dataclass(frozen=True)
class LimitViolation:
    """A joint outside the limits of its file.

    Attributes:
        joint: Its name.
        value: Angle [rad] or displacement [m].
        lower: Lower limit.
        upper: Upper limit.
    """

    joint: str
    value: float
    lower: float
    upper: float

    def __str__(self) -> str:
        return f"{self.joint} at {self.value:.6g}, limits {self.lower:.6g} to {self.upper:.6g}"


def displacement(robot: CheckedModel, q: Array, to: Array) -> Array:
    """The velocity that leads from one pose to another in unit time, by the shorter way round, shape (nv,)."""
    d = np.asarray(pin.difference(robot.model, q, to))
    periodic = robot.joints.periodic
    if periodic.any():
        d[periodic] = np.remainder(d[periodic] + math.pi, 2.0 * math.pi) - math.pi
    return d


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


def beyond_limits(robot: CheckedModel, q: Array, margin: float = 1e-9) -> tuple[LimitViolation, ...]:
    """The joints with one degree of freedom that are outside their file's limits."""
    out = []
    for joint in robot.joints.values():
        least, most = joint.lower, joint.upper
        if not (least == -math.inf and most == math.inf):
            x = joint.coordinate(q)
            if not least - margin <= x <= most + margin:
                out.append(LimitViolation(joint.name, x, least, most))
    return tuple(out)


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
