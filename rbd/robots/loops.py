"""A loop file or an MJCF's <equality> applied to a robot: frames added to its model, constraints, postures."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.constraints.constraint import Constraint, check_on, member
from rbd.constraints.driven import DrivenJoint
from rbd.constraints.joint import JointCoupling, JointLock
from rbd.constraints.loop import LoopClosure
from rbd.errors import ModelError, nearest
from rbd.model.checked_model import CheckedModel
from rbd.model.mjcf.loops_and_motors import WORLD, Equality
from rbd.model.mjcf.pinocchio_model import pose
from rbd.model.state import State
from rbd.robots import catalogue
from rbd.robots.loop_file import LoopFile, NamedFrame, beside, read_loop_file
from rbd.robots.number_checks import in_file
from rbd.robots.posture import configuration, semantic_postures

Kind = TypeVar("Kind", bound=Constraint)
_MARKED = (pin.FrameType.BODY, pin.FrameType.FIXED_JOINT, pin.FrameType.OP_FRAME)


@dataclass(frozen=True)
class Mechanism:
    """Loop closures of a robot by names; their frames are already in the model.

    Attributes:
        file: The loop file, or an empty one.
        equalities: Of an MJCF file.
        file_name: Which file messages are about.
    """

    file: LoopFile = LoopFile()
    equalities: tuple[Constraint, ...] = ()
    file_name: str = ""

    def loops(self, robot: CheckedModel, postures: Mapping[str, Array]) -> tuple[Constraint, ...]:
        """Closures, joint couplings and locks that close this robot's tree; rods without length as in posture "assembled".

        Args:
            robot: The robot.
            postures: Its postures; the neutral one stands for "assembled" where that is not among them.

        Raises:
            ModelError: an unknown frame or joint, with the nearest names; two frames of one body; a coupling of a
                joint with several degrees of freedom.
        """
        out = self._checked("loop", robot, (*self.file.loops, *self.equalities))
        if not any(member(loop, "is_measured") for loop in out):
            return out
        state = State(robot, postures.get("assembled", pin.neutral(robot.model)))
        with in_file(f"{self.file_name}: its loops in posture 'assembled'"):
            return tuple(member(loop, "anchored")(state) if member(loop, "is_measured") else loop for loop in out)

    def wheels(self, robot: CheckedModel) -> tuple[Constraint, ...]:
        """Wheels, balls and knife edges of this robot.

        Raises:
            ModelError: an unknown frame, with the nearest names.
        """
        return self._checked("wheel", robot, self.file.wheels)

    def drives(self, robot: CheckedModel) -> tuple[DrivenJoint, ...]:
        """Drives of this robot's joints.

        Raises:
            ModelError: an unknown joint, with the nearest names, or one with several degrees of freedom.
        """
        return self._checked("drive", robot, self.file.drives)

    def _checked(self, what: str, robot: CheckedModel, constraints: tuple[Kind, ...]) -> tuple[Kind, ...]:
        for constraint in constraints:
            with in_file(f"{self.file_name}: {what} {constraint.name!r:.80}"):
                check_on(constraint, robot)
        return constraints

    def postures(self, robot: CheckedModel) -> dict[str, Array]:
        """{name: q}, joints not named at zero.

        Raises:
            ModelError: an unknown joint, with the nearest names, or numbers that are not its part of q.
        """
        out = {}
        for name, angles in self.file.postures.items():
            out[name] = q = pin.neutral(robot.model)
            with in_file(f"{self.file_name}: posture {name!r:.80}"):
                for joint, numbers in angles.items():
                    q[robot.joints[joint].q] = robot.joints[joint].target(joint, np.array(numbers))
        return out


def mechanism(model: pin.Model, name: str, file: LoopFile, equalities: Iterable[Equality] = ()) -> Mechanism:
    """The loop closures of a loop file and an MJCF's equalities; their frames are added to the model.

    Args:
        model: The model; it is changed.
        name: Of the robot's file.
        file: The loop file, if there is one.
        equalities: Of an MJCF file.

    Raises:
        ModelError: a link or a joint that is not there, a frame under a name that is taken, two constraints under one.
    """
    file_name = file.name or name
    for named in file.frames:
        _add_named(model, file_name, named)
    joints = list(model.names)[1:]
    for what, names in (("passive", file.passive), ("order", file.order)):
        for joint in names:
            if joint not in joints:
                raise ModelError(f"{file_name}: {what} names a joint {joint!r:.80}; {nearest(joint, joints)}.")
    read = tuple(_read(model, name, equality) for equality in equalities)
    own = {constraint.name for constraint in (*file.loops, *file.wheels, *file.drives)}
    if twice := [entry.name for entry in read if entry.name in own]:
        raise ModelError(f"{file_name}: {twice[0]!r:.80} is the name of an equality of {name} too; give it another one.")
    return Mechanism(file, read, file_name)


def loop_file_of(source: catalogue.RobotSource, loops: str | os.PathLike[str] | LoopFile | bool | None) -> LoopFile:
    """The loop file that is named or given; if `loops` is true, that beside the robot's file; empty if there is none."""
    if isinstance(loops, LoopFile):
        return loops
    if not (loops is None or isinstance(loops, bool)):
        return read_loop_file(catalogue.file_path(loops, "loops"))
    found = beside(source.urdf) if loops and not source.in_memory else None
    return LoopFile() if found is None else read_loop_file(found)


def read_postures(robot: CheckedModel, source: catalogue.RobotSource, mechanism: Mechanism) -> dict[str, Array]:
    """{name: q} of the SRDF, of an MJCF's keyframes, of the catalogue and of the loop file; of one name the last counts."""
    found = {} if source.srdf is None else semantic_postures(robot, source.srdf)
    keyframes = robot.model.referenceConfigurations  # of an MJCF file
    found |= {keyframe.key(): pin.normalize(robot.model, keyframe.data()) for keyframe in keyframes}
    found |= {name: configuration(robot, angles) for name, angles in source.postures.items()}
    return found | mechanism.postures(robot)


def _read(model: pin.Model, file: str, equality: Equality) -> Constraint:
    """An equality as a closure, its two frames added to the model; as a joint coupling or a lock."""
    rest = _reference(model)
    if equality.kind == "joint":
        return _coupling(model, file, equality, rest)
    kind = pin.FrameType.OP_FRAME if equality.sites else pin.FrameType.BODY
    at = {f.name: i for i, f in enumerate(model.frames) if f.type == kind}
    one, other = (0 if name == WORLD and not equality.sites else at[name] for name in equality.ends)
    X_one, X_other = pin.SE3.Identity(), pin.SE3.Identity()
    if not equality.sites:
        X_12 = _pose_between(model, one, other, rest)
        X_anchor = pin.SE3(np.eye(3), np.array(equality.anchor))
        X_one, X_other = (X_anchor, X_12.inverse() * X_anchor) if equality.kind == "connect" else (X_12 * X_anchor, X_anchor)
        if equality.pose is not None:
            quaternion = np.array(equality.pose[3:])  # w, x, y, z of any length
            # Position of the anchor in the first body, not the second body's origin.
            X_one = pose(np.array(equality.pose[:3]), quaternion / np.linalg.norm(quaternion))
    names = f"{equality.name}_a", f"{equality.name}_b"
    for name, frame, placement in zip(names, (one, other), (X_one, X_other), strict=True):
        if model.existFrame(name):
            raise ModelError(f"{file}: equality {equality.name!r:.80} wants a frame {name!r:.80}, which is there. Rename it.")
        _add(model, name, frame, placement)
    return LoopClosure(equality.name, *names, kind="point" if equality.kind == "connect" else "rigid")


_OPEN = "load_robot(..., loops=None) leaves all loops open."


def _coupling(model: pin.Model, file: str, equality: Equality, rest: Array) -> JointCoupling | JointLock:
    """MuJoCo's y - y0 = c + s (x - x0), with y0 and x0 the angles in which the file draws its bodies."""
    angles = []
    for name in equality.ends:
        if not model.existJointName(name) or model.joints[model.getJointId(name)].nv != 1:
            raise ModelError(
                f"{file}: equality {equality.name!r:.80} ties joint {name!r:.80}, which has several degrees of freedom; "
                f"expected a hinge or a slide. {_OPEN}"
            )
        angles.append(float(rest[model.joints[model.getJointId(name)].idx_q]))
    constant, slope = equality.polynomial
    if len(angles) == 1:
        return JointLock(equality.name, equality.ends[0], position=angles[0] + constant)
    joint, to = equality.ends
    return JointCoupling(equality.name, joint, to, ratio=slope, offset=angles[0] + constant - slope * angles[1])


def _reference(model: pin.Model) -> Array:
    """The configuration in which an MJCF file draws its bodies, shape (nq,)."""
    keyed = {key.key(): key.data() for key in model.referenceConfigurations}
    return pin.normalize(model, keyed["qpos0"]) if "qpos0" in keyed else pin.neutral(model)


def _pose_between(model: pin.Model, one: int, other: int, q: Array) -> pin.SE3:
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    return data.oMf[one].actInv(data.oMf[other])


def _add_named(model: pin.Model, file: str, named: NamedFrame) -> None:
    marked = ((i, f) for kind in _MARKED for i, f in enumerate(model.frames) if f.type == kind)
    link = next((i for i, f in marked if f.name == named.link), None)
    if link is None:
        links = [f.name for f in model.frames if f.type == pin.FrameType.BODY]
        raise ModelError(f"{file}: frame {named.name!r:.80} is on a link {named.link!r:.80}; {nearest(named.link, links)}.")
    if model.existFrame(named.name):
        raise ModelError(f"{file}: the robot has a frame {named.name!r:.80} already; give the new one another name.")
    _add(model, named.name, link, pin.SE3(pin.rpy.rpyToMatrix(np.array(named.rpy)), np.array(named.xyz)))


def _add(model: pin.Model, name: str, parent: int, placement: pin.SE3) -> None:
    on = model.frames[parent]
    model.addFrame(pin.Frame(name, on.parentJoint, parent, on.placement * placement, pin.FrameType.OP_FRAME))
