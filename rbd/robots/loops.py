"""What a loop file or an MJCF's <equality> says, on a robot: frames added to its model, constraints, postures."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.constraints.joint import JointCoupling, JointLock
from rbd.constraints.loop import LoopClosure
from rbd.constraints.nonholonomic import KnifeEdge
from rbd.constraints.rolling import RollingBall, RollingDisk, RollingWheel
from rbd.errors import InputError, ModelError, nearest
from rbd.model.checked_model import CheckedModel
from rbd.model.mjcf.equality import WORLD, Equality
from rbd.robots.loop_file import Closure, Coupling, LoopFile, Mark, Wheel

Made = TypeVar("Made")
Loop = LoopClosure | JointCoupling | JointLock
Rolling = KnifeEdge | RollingBall | RollingDisk | RollingWheel

_WHEELS: dict[str, tuple[Callable[..., Rolling], tuple[str, ...]]] = {
    "knife_edge": (KnifeEdge, ("direction",)),
    "rolling_ball": (RollingBall, ("radius",)),
    "rolling_disk": (RollingDisk, ("radius", "axis")),
    "rolling_wheel": (RollingWheel, ("radius", "axis")),
}
"""What each kind of wheel is, and which keys it takes."""
_MARKED = (pin.FrameType.BODY, pin.FrameType.FIXED_JOINT, pin.FrameType.OP_FRAME)


@dataclass(frozen=True)
class Lock:
    """A joint that an MJCF file holds, at an angle [rad] or a displacement [m]."""

    name: str
    joint: str
    position: float


Entry = Closure | Coupling | Lock


@dataclass(frozen=True)
class Mechanism:
    """What closes a robot's tree, by names; its frames are in the model already.

    Attributes:
        file: The loop file, or one that says nothing.
        equalities: Of an MJCF file.
        told_as: Which file messages are about.
    """

    file: LoopFile = LoopFile()
    equalities: tuple[Entry, ...] = ()
    told_as: str = ""

    def loops(self, robot: CheckedModel) -> tuple[Loop, ...]:
        """Closures, gears and locks as constraints on this robot.

        Raises:
            ModelError: an unknown frame or joint, with the nearest names; an axis that is none; a gear or a lock on a joint
                with several freedoms.
        """
        entries: tuple[Entry, ...] = (*self.file.loops, *self.file.couplings, *self.equalities)
        return tuple(self._told(f"loop {entry.name!r:.80}", partial(_loop, robot, entry)) for entry in entries)

    def wheels(self, robot: CheckedModel) -> tuple[Rolling, ...]:
        """Wheels, balls and blades as constraints on this robot.

        Raises:
            ModelError: an unknown frame, with the nearest names; a key that the kind does not take; a radius or an axis that
                is none.
        """
        return tuple(self._told(f"wheel {wheel.name!r:.80}", partial(_wheel, robot, wheel)) for wheel in self.file.wheels)

    def postures(self, robot: CheckedModel) -> dict[str, Array]:
        """{name: q}, joints not named at zero.

        Raises:
            ModelError: an unknown joint, with the nearest names, or numbers that are not its part of q.
        """
        out = {}
        for name, angles in self.file.postures.items():
            out[name] = q = pin.neutral(robot.model)
            for joint, numbers in angles.items():
                at, part = self._told(f"posture {name!r:.80}", partial(_part, robot, joint, numbers))
                q[at : at + len(part)] = part
        return out

    def _told(self, what: str, make: Callable[[], Made]) -> Made:
        try:
            return make()
        except InputError as error:
            raise ModelError(f"{self.told_as}: {what}: {error}") from None


def mechanism(model: pin.Model, name: str, file: LoopFile | None, equalities: Iterable[Equality] = ()) -> Mechanism:
    """What a loop file and an MJCF's equalities say about a model, to which their frames are added.

    Args:
        model: The model; it is changed.
        name: Of the robot's file.
        file: The loop file, if there is one.
        equalities: Of an MJCF file.

    Raises:
        ModelError: a link or a joint that is not there, a frame under a name that is taken, two constraints under one.
    """
    file, told_as = (LoopFile(), name) if file is None else (file, file.name)
    for mark in file.frames:
        _add_mark(model, told_as, mark)
    joints = list(model.names)[1:]
    for joint in file.passive:
        if joint not in joints:
            raise ModelError(f"{told_as}: passive names a joint {joint!r:.80}; {nearest(joint, joints)}.")
    read = tuple(_read(model, name, equality) for equality in equalities)
    own = {*(x.name for x in file.loops), *(x.name for x in file.couplings), *(x.name for x in file.wheels)}
    if twice := [entry.name for entry in read if entry.name in own]:
        raise ModelError(f"{told_as}: {twice[0]!r:.80} is the name of an equality of {name} too; give it another one.")
    return Mechanism(file, read, told_as)


def _loop(robot: CheckedModel, entry: Entry) -> Loop:
    if isinstance(entry, Closure):
        if robot.site(entry.frame_a)[0] == robot.site(entry.frame_b)[0]:
            raise InputError(
                f"{entry.frame_a!r:.80} and {entry.frame_b!r:.80} are fixed to one body; expected frames of two bodies that "
                "move against each other."
            )
        return LoopClosure(entry.name, entry.frame_a, entry.frame_b, kind=entry.kind, axis=entry.axis)
    robot.joints.with_one_freedom(entry.joint, entry.name)
    if isinstance(entry, Lock):
        return JointLock(entry.name, entry.joint, position=entry.position)
    robot.joints.with_one_freedom(entry.to, entry.name)
    return JointCoupling(entry.name, entry.joint, entry.to, ratio=entry.ratio, offset=entry.offset)


def _wheel(robot: CheckedModel, wheel: Wheel) -> Rolling:
    given = {key: value for key in ("radius", "axis", "direction") if (value := getattr(wheel, key)) is not None}
    make, takes = _WHEELS[wheel.kind]
    if wrong := [key for key in given if key not in takes]:
        raise InputError(f"a {wheel.kind} takes {' and '.join(takes)}, not {wrong[0]!r}.")
    if "radius" in takes and "radius" not in given:
        raise InputError(f"a {wheel.kind} wants a radius [m].")
    robot.site(wheel.frame)
    return make(wheel.name, wheel.frame, **given)


def _part(robot: CheckedModel, joint: str, numbers: tuple[float, ...]) -> tuple[int, Array]:
    """(where a joint's part of q begins, the part)."""
    found = robot.joints[joint]
    return found.q.start, found.target(joint, np.array(numbers))


def _read(model: pin.Model, file: str, equality: Equality) -> Entry:
    """An equality as a closure, its two frames added to the model; as a gear or a lock."""
    rest = _reference(model)
    if equality.kind == "joint":
        return _gear(model, file, equality, rest)
    kind = pin.FrameType.OP_FRAME if equality.sites else pin.FrameType.BODY
    at = {f.name: i for i, f in enumerate(model.frames) if f.type == kind}
    one, other = (0 if name == WORLD and not equality.sites else at[name] for name in equality.ends)
    X_one, X_other = pin.SE3.Identity(), pin.SE3.Identity()
    if not equality.sites:
        X_12 = _pose_between(model, one, other, rest)
        X_anchor = pin.SE3(np.eye(3), np.array(equality.anchor))
        X_one, X_other = (X_anchor, X_12.inverse() * X_anchor) if equality.kind == "connect" else (X_12 * X_anchor, X_anchor)
        if equality.pose is not None:
            X_one = _pose(equality.pose)  # where the anchor comes to in the first body, not the second body's origin
    names = f"{equality.name}_a", f"{equality.name}_b"
    for name, frame, placement in zip(names, (one, other), (X_one, X_other), strict=True):
        if model.existFrame(name):
            raise ModelError(f"{file}: equality {equality.name!r:.80} wants a frame {name!r:.80}, which is there. Rename it.")
        _add(model, name, frame, placement)
    return Closure(equality.name, "point" if equality.kind == "connect" else "rigid", *names)


_OPEN = "load_robot(..., loops=None) leaves all loops open."


def _gear(model: pin.Model, file: str, equality: Equality, rest: Array) -> Coupling | Lock:
    """MuJoCo's y - y0 = c + s (x - x0), with y0 and x0 the angles in which the file draws its bodies."""
    angles = []
    for name in equality.ends:
        if not model.existJointName(name) or model.joints[model.getJointId(name)].nv != 1:
            raise ModelError(
                f"{file}: equality {equality.name!r:.80} ties joint {name!r:.80}, which has several freedoms; expected a hinge "
                f"or a slide. {_OPEN}"
            )
        angles.append(float(rest[model.joints[model.getJointId(name)].idx_q]))
    constant, slope = equality.polynomial
    if len(angles) == 1:
        return Lock(equality.name, equality.ends[0], angles[0] + constant)
    joint, to = equality.ends
    return Coupling(equality.name, joint, to, slope, angles[0] + constant - slope * angles[1])


def _reference(model: pin.Model) -> Array:
    """The configuration in which an MJCF file draws its bodies, shape (nq,)."""
    keyed = {key.key(): key.data() for key in model.referenceConfigurations}
    return pin.normalize(model, keyed["qpos0"]) if "qpos0" in keyed else pin.neutral(model)


def _pose_between(model: pin.Model, one: int, other: int, q: Array) -> pin.SE3:
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    return data.oMf[one].actInv(data.oMf[other])


def _pose(numbers: tuple[float, ...]) -> pin.SE3:
    """Of MuJoCo's seven: position, quaternion w, x, y, z of any length."""
    w, x, y, z = np.array(numbers[3:]) / np.linalg.norm(numbers[3:])
    return pin.XYZQUATToSE3(np.array([*numbers[:3], x, y, z, w]))


def _add_mark(model: pin.Model, file: str, mark: Mark) -> None:
    link = _frame_id(model, mark.link, _MARKED)
    if link is None:
        links = [f.name for f in model.frames if f.type == pin.FrameType.BODY]
        raise ModelError(f"{file}: frame {mark.name!r:.80} is on a link {mark.link!r:.80}; {nearest(mark.link, links)}.")
    if model.existFrame(mark.name):
        raise ModelError(f"{file}: the robot has a frame {mark.name!r:.80} already; give the new one another name.")
    _add(model, mark.name, link, pin.SE3(pin.rpy.rpyToMatrix(np.array(mark.rpy)), np.array(mark.xyz)))


def _frame_id(model: pin.Model, name: str, kinds: Iterable[pin.FrameType]) -> int | None:
    """Index of the frame of this name, of the first kind that there is."""
    return next((i for kind in kinds for i, f in enumerate(model.frames) if f.name == name and f.type == kind), None)


def _add(model: pin.Model, name: str, parent: int, placement: pin.SE3) -> None:
    on = model.frames[parent]
    model.addFrame(pin.Frame(name, on.parentJoint, parent, on.placement * placement, pin.FrameType.OP_FRAME))
