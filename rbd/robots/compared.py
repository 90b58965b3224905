"""Two files of one robot compared: joints, limits, efforts, masses and inertias, by name, at q = 0."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.model.checked_model import CheckedModel
from rbd.model.joints import Joint
from rbd.robots.diagnosis import ModelIssue

ROUNDED = 1e-3
"""Differences up to this are roundings of a file: a share of the larger number; of limits and axes [rad], of places [m]."""
_FILLER = re.compile(r"joint|[^a-z0-9]")


@dataclass(frozen=True, eq=False)
class Pair:
    """A joint in both robots: the one that is examined, and the other.

    Attributes:
        ours: In the robot that is examined.
        theirs: In the other.
    """

    ours: Joint
    theirs: Joint

    @property
    def name(self) -> str:
        """The name, with that in the other file where it differs."""
        return self.ours.name if self.ours.name == self.theirs.name else f"{self.ours.name} ({self.theirs.name})"


def differences(robot: CheckedModel, other: CheckedModel, file: str) -> Iterator[ModelIssue]:
    """What the file of another robot states otherwise, one issue a number.

    Joints are the same by name, else by name without case, punctuation and the word "joint", else where both are the floating
    base. Bodies are compared as joints carry them, with all that is welded to them; centres, axes and inertias in W at q = 0.

    Args:
        robot: The robot that is examined.
        other: The same robot by another file.
        file: Name of the other file.
    """
    pairs, alone, missing = matched(robot, other)
    yield from (ModelIssue("joint", name, f"is not in {file}") for name in alone)
    yield from (ModelIssue("joint", name, f"is in {file} alone") for name in missing)
    here, there = _World(robot), _World(other)
    for pair in pairs:
        one, two = pair.ours, pair.theirs
        if one.unit != two.unit or one.nv != two.nv:
            yield ModelIssue("joint", pair.name, f"moves by {_moves(one)} here, by {_moves(two)} in {file}")
            continue
        yield from _placed(pair, here, there, file)
        yield from _limits(pair, robot, other, file)
        yield from _bodies(pair, here, there, file)
    if not alone and not missing and (text := _number(robot.mass, other.mass, "kg", file)):
        yield ModelIssue("mass", robot.name, f"all moving bodies: {text}")


def matched(robot: CheckedModel, other: CheckedModel) -> tuple[list[Pair], list[str], list[str]]:
    """(joints of both, names of joints of the first alone, names of joints of the second alone)."""
    left = dict(other.joints)
    pairs, alone = [], []
    for joint in robot.joints.values():
        found = left.pop(joint.name, None)
        if found is None:
            alone.append(joint)
        else:
            pairs.append(Pair(joint, found))
    plain: dict[str, list[str]] = {}
    for name, joint in left.items():
        plain.setdefault(_plain(joint), []).append(name)
    ours = [_plain(joint) for joint in alone]
    still = []
    for joint, key in zip(alone, ours, strict=True):
        names = plain.get(key, [])
        if len(names) == 1 == ours.count(key):
            pairs.append(Pair(joint, left.pop(names[0])))
        else:
            still.append(joint.name)
    return sorted(pairs, key=lambda pair: pair.ours.id), still, list(left)


def _plain(joint: Joint) -> str:
    """The name without case, punctuation and "joint"; one for all floating bases, whose names are made up."""
    return "a floating base" if joint.id == 1 and joint.nv == 6 else _FILLER.sub("", joint.name.lower())


class _World:
    """A robot's joints and bodies in W at q = 0."""

    def __init__(self, robot: CheckedModel) -> None:
        self.model, self.data = robot.model, robot.model.createData()
        pin.computeJointJacobians(self.model, self.data, pin.neutral(self.model))

    def axes(self, joint: Joint) -> Array:
        """Columns of the joint's Jacobian in W, shape (6, nv): linear at the joint's origin, angular."""
        J = pin.getJointJacobian(self.model, self.data, joint.id, pin.LOCAL_WORLD_ALIGNED)
        return np.asarray(J[:, joint.v])

    def body(self, joint: Joint) -> tuple[float, Array, Array]:
        """(mass [kg], centre of mass in W [m], inertia about it in axes of W [kg m2]) of what the joint carries."""
        X, inertia = self.data.oMi[joint.id], self.model.inertias[joint.id]
        return inertia.mass, X.act(inertia.lever), X.rotation @ inertia.inertia @ X.rotation.T


def _placed(pair: Pair, here: _World, there: _World, file: str) -> Iterator[ModelIssue]:
    p, r = here.data.oMi[pair.ours.id].translation, there.data.oMi[pair.theirs.id].translation
    if np.abs(p - r).max() > ROUNDED:
        yield ModelIssue("place", pair.name, f"{_vector(p)} m here at q = 0, {_vector(r)} m in {file}")
    A, B = here.axes(pair.ours), there.axes(pair.theirs)
    if pair.ours.nv == 1 and np.abs(A - B).max() > ROUNDED:
        turns = bool(np.abs(A[3:]).any())
        a, b = (A[3:, 0], B[3:, 0]) if turns else (A[:3, 0], B[:3, 0])
        yield ModelIssue("axis", pair.name, f"{_vector(a)} here at q = 0, {_vector(b)} in {file}")


def _limits(pair: Pair, robot: CheckedModel, other: CheckedModel, file: str) -> Iterator[ModelIssue]:
    one, two = pair.ours, pair.theirs
    if one.nv != 1:
        return
    unit, force = one.unit, "N m" if one.unit == "rad" else "N"
    if any(_apart(x, y) for x, y in ((one.lower, two.lower), (one.upper, two.upper))):
        text = f"{_number_of(one.lower)} to {_number_of(one.upper)} {unit} here, "
        yield ModelIssue("limit", pair.name, f"{text}{_number_of(two.lower)} to {_number_of(two.upper)} {unit} in {file}")
    effort = [_at_motor(each, joint, each.effort_limit) for each, joint in ((robot, one), (other, two))]
    if None in effort:
        if effort[0] != effort[1]:
            driven, passive = ("here", f"in {file}") if effort[1] is None else (f"in {file}", "here")
            yield ModelIssue("effort", pair.name, f"has a motor {driven}, and none {passive}")
    elif text := _number(effort[0], effort[1], force, file):
        yield ModelIssue("effort", pair.name, text)
    both = np.isfinite([one.speed, two.speed]).all()  # an MJCF has no place for it
    if both and (text := _number(one.speed, two.speed, f"{unit}/s", file)):
        yield ModelIssue("speed", pair.name, text)
    inside = [float(each.model.armature[joint.v][0]) for each, joint in ((robot, one), (other, two))]
    if text := _number(inside[0], inside[1], "kg m2" if unit == "rad" else "kg", file):
        yield ModelIssue("armature", pair.name, f"rotor inertia in M: {text}")
    for kind, values, of in (("damping", _damping, f"{force} s/{unit}"), ("dry friction", _dry_friction, force)):
        if text := _number(values(robot, one), values(other, two), of, file):
            yield ModelIssue(kind, pair.name, text)


def _damping(robot: CheckedModel, joint: Joint) -> float:
    return float(robot.model.damping[joint.v][0])


def _dry_friction(robot: CheckedModel, joint: Joint) -> float:
    """Pinocchio's bound of what a file leaves out is infinite: none."""
    bound = float(robot.model.upperDryFrictionLimit[joint.v][0])
    return bound if np.isfinite(bound) else 0.0


def _bodies(pair: Pair, here: _World, there: _World, file: str) -> Iterator[ModelIssue]:
    (m, c, I), (n, d, K) = here.body(pair.ours), there.body(pair.theirs)  # noqa: N806
    if text := _number(m, n, "kg", file):
        yield ModelIssue("mass", pair.name, f"what it carries: {text}")
    if min(m, n) > 0.0 and np.abs(c - d).max() > ROUNDED:
        yield ModelIssue("centre", pair.name, f"centre of mass {_vector(c)} m here at q = 0, {_vector(d)} m in {file}")
    if np.abs(I - K).max() > ROUNDED * max(np.abs(I).max(), np.abs(K).max()):
        a, b = (", ".join(f"{x:.3g}" for x in np.linalg.eigvalsh(each)) for each in (I, K))
        turned = " in other axes" if a == b else ""
        yield ModelIssue("inertia", pair.name, f"principal moments {a} kg m2 here, {b}{turned} in {file}")


def _at_motor(robot: CheckedModel, joint: Joint, values: Array) -> float | None:
    """The entry of a joint with one degree of freedom; None where it has no motor."""
    at = np.flatnonzero(np.asarray(robot.actuated) == joint.v.start)
    return float(values[at[0]]) if len(at) else None


def _number(ours: float | None, theirs: float | None, unit: str, file: str) -> str:
    """What two numbers are, if they differ by more than a rounding."""
    assert ours is not None and theirs is not None
    most = max(abs(ours), abs(theirs))
    if ours == theirs or (np.isfinite(most) and abs(ours - theirs) <= ROUNDED * most):
        return ""
    one, two = (f"{_number_of(x)} {unit}" if np.isfinite(x) else "none" for x in (ours, theirs))
    return f"{one} here, {two} in {file}"


def _apart(x: float, y: float) -> bool:
    return not (x == y or abs(x - y) <= ROUNDED)


def _number_of(x: float) -> str:
    return f"{x:.6g}" if np.isfinite(x) else "no limit"


def _vector(x: Array) -> str:
    return "(" + ", ".join(f"{v + 0.0:.4g}" for v in np.round(x, 4)) + ")"


def _moves(joint: Joint) -> str:
    return f"{joint.unit} in {joint.nv} degree{'s' * (joint.nv != 1)} of freedom"
