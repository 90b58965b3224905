"""What is plotted of a joint: its values over time, its limits, their unit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array
from rbd.errors import InputError, nearest
from rbd.model.checked_model import CheckedModel
from rbd.model.joints import ANGLE, FORCE_OF, PURE, Coordinate
from rbd.simulation.trajectory import Trajectory

WHATS = ("q", "v", "a", "tau")
_NONE = 1e100
"""Limits beyond it are how a file says that there are none."""


@dataclass(frozen=True, eq=False)
class Curve:
    """One line of a plot.

    Attributes:
        name: Of the joint, or of one of its coordinates.
        quantity: "angle", "position", "velocity", "acceleration", "torque", "force" or "coordinate".
        unit: Its unit, as it is printed.
        values: Shape (n,).
        limits: Those that the robot's file states, in order.
    """

    name: str
    quantity: str
    unit: str
    values: Array
    limits: tuple[float, ...]


def joint_curves(trajectory: Trajectory, joints: str | Sequence[str], what: str) -> list[Curve]:
    """The curves of joints, all of one unit.

    Raises:
        InputError: an unknown joint or quantity; a joint without a motor, if torques are asked; several units.
    """
    if not isinstance(what, str) or what not in WHATS:
        raise InputError(f"what is {what!r:.80}; expected one of {', '.join(map(repr, WHATS))}.")
    asked = [joints] if isinstance(joints, str) else joints
    if not np.iterable(asked) or not len(list(asked)):
        raise InputError(f"joint is {joints!r:.80}; expected a joint's name, or a list of them.")
    out = [curve for name in asked for curve in _curves(trajectory, name, what)]
    units = list(dict.fromkeys(curve.unit for curve in out))
    if len(units) > 1:
        raise InputError(
            f"{joints!r:.80} has values in {' and in '.join(units)}; expected one unit. Name one, e.g. {out[0].name!r}."
        )
    return out


def _curves(trajectory: Trajectory, name: str, what: str) -> list[Curve]:
    robot = trajectory.robot
    if not isinstance(name, str):
        raise InputError(f"no joint {name!r:.80}; expected the name of a joint, or a list of names.")
    joints = robot.joints
    if what == "q" and name in joints and joints[name].is_continuous:
        at = joints[name].q.start
        angle = np.unwrap(np.arctan2(trajectory.q[:, at + 1], trajectory.q[:, at]))
        return [Curve(name, "angle", ANGLE, angle, ())]
    labels = joints.positions if what == "q" else robot.motor_coordinates if what == "tau" else joints.velocities
    found = [i for i, c in enumerate(labels) if name in (c.name, c.joint)]
    if not found:
        if what == "tau" and any(name in (c.name, c.joint) for c in joints.velocities):
            raise InputError(f"{name!r:.80} carries no motor; {nearest(name, [c.name for c in labels])}.")
        known = [*joints, *(c.name for c in labels)]
        raise InputError(f"no joint {name!r:.80} in {robot.name}; {nearest(name, known)}.")
    values = getattr(trajectory, what)
    return [Curve(labels[i].name, *_told(labels[i], what), values[:, i], _limits(robot, i, what)) for i in found]


def _told(coordinate: Coordinate, what: str) -> tuple[str, str]:
    """(quantity, unit)."""
    unit = coordinate.unit
    if what == "q":
        return {ANGLE: "angle", PURE: "coordinate"}.get(unit, "position"), unit
    if what == "tau":
        return ("torque" if unit == ANGLE else "force"), FORCE_OF[unit]
    return ("velocity", f"{unit}/s") if what == "v" else ("acceleration", f"{unit}/s²")


def _limits(robot: CheckedModel, i: int, what: str) -> tuple[float, ...]:
    """Limits of entry i; none where the file states none."""
    model = robot.model
    if what == "q":
        low, high = float(model.lowerPositionLimit[i]), float(model.upperPositionLimit[i])
        both: tuple[float, ...] = (low, high) if low < high else ()
    elif what == "v":
        both = (-float(model.velocityLimit[i]), float(model.velocityLimit[i]))
    elif what == "tau":
        both = (-float(robot.effort_limit[i]), float(robot.effort_limit[i]))
    else:
        both = ()
    return tuple(x for x in both if math.isfinite(x) and 0.0 < abs(x) < _NONE or x == 0.0 and what == "q")
