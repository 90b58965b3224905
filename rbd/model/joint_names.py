"""Names and units of a robot's coordinates, one each, for tables, files and plots."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import pinocchio as pin

from rbd.model.checked_model import CheckedModel

LENGTH, ANGLE, PURE = "m", "rad", "1"
FORCE_OF = {LENGTH: "N", ANGLE: "N m"}
"""Unit of the force that goes with a velocity."""

_BODY_V = [("vx", LENGTH), ("vy", LENGTH), ("vz", LENGTH), ("wx", ANGLE), ("wy", ANGLE), ("wz", ANGLE)]
_TURN = [("qx", PURE), ("qy", PURE), ("qz", PURE), ("qw", PURE)]
_CIRCLE = [("cos", PURE), ("sin", PURE)]
_PLACE = [("x", LENGTH), ("y", LENGTH), ("z", LENGTH)]


@dataclass(frozen=True)
class Coordinate:
    """One entry of q or of v.

    Attributes:
        name: The joint's name, with ".vx" or the like behind it where the joint has several; of no other entry.
        joint: The joint's name.
        unit: "m", "rad" or "1", of q; of v per second.
    """

    name: str
    joint: str
    unit: str


def positions(robot: CheckedModel) -> tuple[Coordinate, ...]:
    """The entries of q, in order: of a floating base x, y, z, then the quaternion."""
    return _coordinates(robot, 0)


def velocities(robot: CheckedModel) -> tuple[Coordinate, ...]:
    """The entries of v, in order, as they are of a, of h and of generalised forces."""
    return _coordinates(robot, 1)


def motors(robot: CheckedModel) -> tuple[Coordinate, ...]:
    """The entries of tau, in order; `FORCE_OF[unit]` is their unit."""
    every = velocities(robot)
    return tuple(every[i] for i in robot.actuated)


def _coordinates(robot: CheckedModel, which: int) -> tuple[Coordinate, ...]:
    out = []
    for name in robot.joints():
        parts = _parts(robot.model.joints[robot.joint_id(name)])[which]
        names = [name] if len(parts) == 1 else [f"{name}.{label}" for label, _ in parts]
        out += [Coordinate(label, name, unit) for label, (_, unit) in zip(names, parts, strict=True)]
    return tuple(out)


def _parts(joint: pin.JointModel) -> tuple[Sequence[tuple[str, str]], Sequence[tuple[str, str]]]:
    """(label, unit) of a joint's entries in q and in v."""
    kind = joint.shortname()
    if kind == "JointModelComposite":
        parts = [_parts(part) for part in joint.extract().joints]
        return tuple(
            [(f"{k}.{label}" if label else f"{k}", unit) for k, part in enumerate(parts) for label, unit in part[i]]
            for i in (0, 1)
        )  # type: ignore[return-value]  # of two
    if kind == "JointModelFreeFlyer":
        return _PLACE + _TURN, _BODY_V
    if kind == "JointModelSpherical":
        return _TURN, _BODY_V[3:]
    if kind == "JointModelPlanar":
        return _PLACE[:2] + _CIRCLE, _BODY_V[:2] + _BODY_V[5:]
    if kind == "JointModelTranslation":
        return _PLACE, _BODY_V[:3]
    if joint.nq == 2 and joint.nv == 1:
        return _CIRCLE, [("", ANGLE)]
    slides = kind.startswith("JointModelP") and joint.nv == 1
    unit = LENGTH if slides else ANGLE
    single = [("", unit)] if joint.nv == 1 else [(str(k), unit) for k in range(joint.nv)]
    return single, single
