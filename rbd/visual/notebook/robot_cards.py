"""Cards of robots, states, joints, what the doctor found, and errors."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin

from rbd.arrays import max_abs
from rbd.errors import RbdError
from rbd.model.checked_model import CheckedModel
from rbd.model.joint_table import Joints
from rbd.model.joints import Joint
from rbd.model.state import State
from rbd.robots.diagnosis import ModelReport
from rbd.robots.robot import Robot
from rbd.visual.notebook.card import Card, CardTable, Fold, card_of, fixed, joined, number, vector

_JOINT_HEADS = ("joint", "lower limit", "upper limit", "unit", "motor's limit", "unit")


def _limits(robot: CheckedModel, joint: Joint) -> tuple[str, str, str]:
    """Lower and upper limit of a joint of one coordinate, in degrees or metres, and the unit."""
    if joint.nq != 1:
        return "-", "-", ""
    turns = joint.unit == "rad"
    scale = math.degrees(1.0) if turns else 1.0
    ends = [float(x[joint.q.start]) for x in (robot.model.lowerPositionLimit, robot.model.upperPositionLimit)]
    low, high = ("none" if not abs(x) < 1e100 else fixed(scale * x, 1 if turns else 4) for x in ends)
    return low, high, "deg" if turns else joint.unit


def joint_table(robot: CheckedModel) -> CardTable:
    """The joints with their limits in degrees or metres, and those of their motors."""
    effort = dict(zip(robot.actuated_names, robot.effort_limit, strict=True))
    rows = []
    for joint in robot.joints.values():
        if joint.id in robot.bases:
            continue
        force = effort.get(joint.name)
        most = "no motor" if force is None else "not stated" if math.isinf(force) else number(force, 4)
        rows.append((joint.name, *_limits(robot, joint), most, "" if force is None else "N m" if joint.unit == "rad" else "N"))
    return CardTable(rows, _JOINT_HEADS, rest="robot.joints")


@card_of.register
def _robot(record: CheckedModel) -> Card:
    base = "floating base" if record.floating else "fixed base" if not record.bases else "several bases"
    said = f"{record.name}: {record.nu} motors, {record.nv} degrees of freedom, {fixed(record.mass, 2)} kg, {base}"
    gravity = np.asarray(record.gravity)
    rows = [
        ("mass", fixed(record.mass, 3), "kg"),
        ("weight", fixed(record.mass * float(np.linalg.norm(gravity)), 2), "N"),
        ("numbers in q, in v", f"{record.nq}, {record.nv}", ""),
        ("motors", str(record.nu), ""),
        ("gravity", vector(gravity, 2), "m/s2"),
    ]
    notes, good = [], None
    if isinstance(record, Robot):
        feet = record.source.feet
        rows += [
            ("feet", joined(foot.name for foot in record.feet()) if feet else "none known", ""),
            ("postures", joined(record.postures) or "none", ""),
        ]
        rows += [("loops", joined(loop.name for loop in record.loops()), "")] if record.loops() else []
        rows += [("wheels", joined(wheel.name for wheel in record.wheels()), "")] if record.wheels() else []
        if record.report is not None:
            good = record.report.ok
            notes.append(f"Doctor: {str(record.report).split(chr(10), 1)[0].removesuffix('.')}.")
    folds = [Fold(f"Joints and their limits, {len(record.joints)}", [joint_table(record)])]
    return Card(said, good if good is False else None, [CardTable(rows, ("of the robot", "value", "unit"))], notes, folds)


@card_of.register
def _state(record: State) -> Card:
    robot = record.robot
    still = not record.v.any()
    how = "at rest" if still else f"moving, largest entry of v {number(max_abs(record.v), 3)} m/s, rad/s"
    beyond = _beyond(record)
    said = f"{robot.name} {how}; centre of mass at {vector(record.com)} m"
    rows = [("centre of mass", vector(record.com), "m")]
    if robot.bases:
        X = record.base_pose(robot.bases[0])
        roll, pitch, yaw = np.degrees(pin.rpy.matrixToRpy(X.rotation))
        rows += [("base, position", vector(X.translation), "m")]
        rows += [("base, roll, pitch, yaw", vector((roll, pitch, yaw), 1), "deg")]
    if not still:
        rows.append(("kinetic energy", number(0.5 * float(record.v @ record.M @ record.v), 4), "J"))
        momentum = record.centroidal()[0] @ record.v
        rows.append(("momentum", vector(momentum[:3]), "N s"))
    rows.append(("joints beyond their limits", joined(beyond) or "none", ""))
    folds = [Fold("Joint positions", [_positions(record)])]
    return Card(said, False if beyond else None, [CardTable(rows, ("of the state", "value", "unit"))], (), folds)


def _beyond(state: State) -> list[str]:
    model, q = state.robot.model, np.asarray(state.q)
    out = []
    for joint in state.robot.joints.values():
        i = joint.q.start
        if joint.nq == 1 and not model.lowerPositionLimit[i] - 1e-6 <= q[i] <= model.upperPositionLimit[i] + 1e-6:
            out.append(joint.name)
    return out


def _positions(state: State) -> CardTable:
    rows = []
    for joint in state.robot.joints.values():
        if joint.id in state.robot.bases:
            continue
        part, turns = state.q[joint.q], joint.unit == "rad"
        low, high, _ = _limits(state.robot, joint)
        if joint.nq == 1:
            value = fixed(math.degrees(part[0]), 2) if turns else fixed(part[0], 4)
            rows.append((joint.name, value, "deg" if turns else joint.unit, low, high))
        else:
            rows.append((joint.name, vector(part), "as in q", low, high))
    return CardTable(rows, ("joint", "position", "unit", "lower limit", "upper limit"), rest="state.q")


@card_of.register
def _joint(record: Joint) -> Card:
    rows = [
        ("numbers in q", f"{record.q.start} to {record.q.stop - 1}", ""),
        ("numbers in v", f"{record.v.start} to {record.v.stop - 1}", ""),
        ("moves by", record.unit, ""),
    ]
    return Card(f"joint {record.name} of kind {record.kind}", tables=[CardTable(rows)])


@card_of.register
def _joints(record: Joints) -> Card:
    rows = [(j.name, j.kind, f"{j.q.start}", f"{j.v.start}", j.unit) for j in record.values()]
    table = CardTable(rows, ("joint", "kind", "first number in q", "first number in v", "unit"), rest="the joint's name as key")
    return Card(f"{len(record)} joints", tables=[table])


@card_of.register
def _report(record: ModelReport) -> Card:
    said = str(record).split("\n", 1)[0]
    kinds = (("error", record.errors), ("warning", record.warnings), ("note", record.notes))
    rows = [(mark, issue.kind, issue.where, issue.text) for mark, issues in kinds for issue in issues]
    return Card(said, record.ok, [CardTable(rows, ("", "kind", "where", "what"), rest="print(report)")])


@card_of.register
def _error(record: RbdError) -> Card:
    limits = getattr(record, "limits", ())
    limits = limits if isinstance(limits, tuple | list) else ()
    rows = [(limit.kind, limit.name) for limit in limits if hasattr(limit, "kind")]
    said = f"{type(record).__name__}: {str(record).split(chr(10), 1)[0]}"
    folds = [Fold("The whole message", [str(record)])] if "\n" in str(record) or len(str(record)) > 300 else []
    return Card(said, False, [CardTable(rows, ("limit in the way", "of"))], (), folds)
