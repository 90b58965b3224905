"""The order of joints in a file: the robot's own, breadth-first, or that of a known format; and joints that are missing."""

from __future__ import annotations

from collections import deque
from collections.abc import Container, Iterable, Mapping, Sequence

import pinocchio as pin

from rbd.arrays import Array
from rbd.errors import InputError, RbdError, nearest
from rbd.model.checked_model import CheckedModel
from rbd.robots.robot import Robot

_LEG = ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll")
_ARM = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow", "wrist_roll", "wrist_pitch", "wrist_yaw")
_WAIST = ("waist_yaw", "waist_roll", "waist_pitch")


def _g1(waist: Iterable[str], arm: Sequence[str]) -> tuple[str, ...]:
    legs = [f"{side}_{name}_joint" for side in ("left", "right") for name in _LEG]
    return (
        *legs,
        *(f"{name}_joint" for name in waist),
        *(f"{side}_{name}_joint" for side in ("left", "right") for name in arm),
    )


FORMATS: Mapping[str, tuple[str, ...]] = {
    "G1 with 29 joints": _g1(_WAIST, _ARM),
    "G1 with 23 joints (no waist roll and pitch, no wrist pitch and yaw)": _g1(_WAIST[:1], _ARM[:5]),
}
"""Joints of published motion files by format; of Unitree's own descriptions `g1_29dof` and `g1_23dof`."""


def single_joints(robot: CheckedModel) -> tuple[str, ...]:
    """Names of the joints with one degree of freedom, in the order of the model."""
    return tuple(joint.name for joint in robot.joints.values() if joint.nv == 1)


def standing_q(robot: CheckedModel) -> Array:
    """The configuration of joints that a file does not give: of the standing posture, if one is known, else neutral."""
    return robot.posture(name) if isinstance(robot, Robot) and (name := robot.source.posture) else pin.neutral(robot.model)


def left_still(robot: CheckedModel, given: Container[str]) -> list[str]:
    """A note of the joints that a file does not give."""
    missing = [j.name for j in robot.joints.values() if j.id not in robot.bases and j.name not in given]
    if not missing:
        return []
    posture = robot.source.posture if isinstance(robot, Robot) and robot.source.posture else "neutral"
    return [f"{len(missing)} joints are not in the file and stay as in the posture {posture!r}: {', '.join(missing)}."]


def file_order(robot: CheckedModel) -> tuple[str, ...]:
    """The same in the order in which the robot's file states them; the model's where it has no file."""
    known = single_joints(robot)
    if not isinstance(robot, Robot):
        return known
    try:
        element = robot.element
    except RbdError:
        return known
    stated = dict.fromkeys(str(e.get("name")) for e in element.iter("joint"))
    order = [name for name in stated if name in known]
    return tuple(order) if len(order) == len(known) else known


def breadth_first(robot: CheckedModel) -> tuple[str, ...]:
    """The same, joints nearer to the base first, siblings in the order of the robot's file: as Isaac's articulations."""
    rank = {name: i for i, name in enumerate(file_order(robot))}
    model = robot.model
    below: dict[int, list[int]] = {}
    for i in range(1, model.njoints):
        below.setdefault(model.parents[i], []).append(i)
    found, waiting = [], deque(sorted(below.get(0, []), key=lambda i: rank.get(model.names[i], -1)))
    while waiting:
        i = waiting.popleft()
        found.append(model.names[i])
        waiting.extend(sorted(below.get(i, []), key=lambda k: rank.get(model.names[k], -1)))
    return tuple(name for name in found if name in rank)


def formats(robot: CheckedModel) -> dict[str, tuple[str, ...]]:
    """{what it is: joints in order} of the formats that fit this robot; its own file's first."""
    own = file_order(robot)
    found = {f"all {len(own)} joints of {robot.name}": own}
    for name, joints in FORMATS.items():
        if set(joints) < set(own):
            found[name] = joints
    return found


def checked_joints(robot: CheckedModel, joints: Sequence[str]) -> tuple[str, ...]:
    """Names of joints that are given, each of which the robot has once, with one degree of freedom.

    Raises:
        InputError: an unknown name, with the nearest; one twice; no list.
    """
    if isinstance(joints, str | bytes) or not isinstance(joints, Sequence):
        raise InputError(f"joints is {joints!r:.80}; expected a list of names, in the order of the columns.")
    known = single_joints(robot)
    for name in joints:
        if name not in known:
            raise InputError(f"no joint {name!r:.80} with one degree of freedom in {robot.name}; {nearest(name, known)}.")
    if len(set(joints)) != len(joints):
        twice = next(name for name in joints if list(joints).count(name) > 1)
        raise InputError(f"joint {twice!r:.80} is named twice.")
    return tuple(joints)
