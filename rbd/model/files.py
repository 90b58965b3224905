"""A robot's file, URDF or MJCF: read and checked once, and Pinocchio's model of it, with ball joints where it has them.

Pinocchio is given ball joints, the type "spherical" of a URDF, as floating ones. It numbers the joints on one body by their
names in the alphabet.
"""

from __future__ import annotations

import os.path
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin

from rbd.errors import InputError, ModelError
from rbd.model.input_files import FileLimits, file_bytes, parse_xml
from rbd.model.mjcf import Mjcf, build, carry_out_includes, read_mjcf
from rbd.model.urdf import BASE_JOINT, Complaints, UrdfFile, check_shapes, check_urdf, depth_first, grouped
from rbd.model.world import Plane, turn_base

MOST_MESHES = 5_000
"""So many names of meshes are looked up; no robot has more."""
_ROTORS = ("motorInertia", "rotorInertia", "rotor_inertia")
"""Elements in which some URDFs state their motors' rotor inertias; see `rbd.robots.rotors`."""


@dataclass(frozen=True, eq=False)
class RobotFile:
    """A URDF or MJCF file whose names and numbers are in order.

    Attributes:
        path: Where it is.
        element: Its first element, includes of an MJCF carried out.
        content: Its links and joints; bodies, joints and motors of an MJCF.
        remarks: (kind, where, text) of contents of the file that the model ignores.
        meshes: (as named, where it may be relative to a folder) of each mesh, once.
    """

    path: Path
    element: ElementTree.Element
    content: UrdfFile | Mjcf
    remarks: tuple[tuple[str, str, str], ...]
    meshes: tuple[tuple[str, str], ...]

    def collision_meshes(self) -> tuple[tuple[str, str], ...]:
        """Those of `meshes` that the collision shapes of a URDF use; all of an MJCF, whose masses need them too."""
        if isinstance(self.content, Mjcf):
            return self.meshes
        used = {mesh.get("filename", "") for mesh in self.element.iterfind("link/collision/geometry/mesh")}
        return tuple((name, place) for name, place in self.meshes if name in used)

    def missing_meshes(self, package_dirs: Sequence[Path]) -> Iterator[str]:
        """Names of the meshes that are in none of the folders; none is opened."""
        folders = [str(folder) for folder in (self.path.parent, *package_dirs)]
        places = {name: [os.path.join(folder, relative) for folder in folders] for name, relative in self.meshes}
        return (name for name, paths in places.items() if not any(map(os.path.isfile, paths)))


def read(
    path: Path,
    limits: FileLimits | None = None,
    *,
    base: int = 6,
    known: bool = False,
    folders: tuple[Path, ...] = (),
    leave_out: Collection[str] = (),
    data: bytes | None = None,
) -> RobotFile:
    """A robot's file, checked: its bytes before it is parsed, its names, tree and numbers before Pinocchio sees it.

    Args:
        path: A URDF or MJCF file; of a text in memory a name for messages.
        limits: How large it may be.
        base: Degrees of freedom of the URDF's root joint: 6 for a floating base, 3 for one that slides and turns
            on the ground, 0 where it is welded to the world.
        known: A file of the robot data: a mimic of an unknown joint is ignored, as the dynamics use no mimics.
        folders: Folders of an MJCF's meshes and included files, besides its own.
        leave_out: Of `rbd.model.mjcf.LEAVABLE`: parts of an MJCF that the dynamics may ignore.
        data: The text of the file; None to read it from the path.

    Raises:
        ModelError: naming the fault.
    """
    limits = FileLimits() if limits is None else limits
    data = file_bytes(path, limits.max_bytes) if data is None else data
    element = parse_xml(path.name, data, limits)
    if not known and b"xacro" in data:
        _refuse_macros(path.name, element)
    if element.tag == "mujoco":
        text = None if element.find(".//include") is not None else data.decode()
        carry_out_includes(path, element, limits, folders)
        mjcf = read_mjcf(path, element, limits, folders, leave_out, text=text)
        return RobotFile(path, element, mjcf, mjcf.remarks, tuple(mjcf.meshes.items())[:MOST_MESHES])
    if element.tag != "robot":
        raise ModelError(f"{path.name} is no robot: its first element is <{element.tag:.80}>; expected <robot> or <mujoco>.")
    urdf = check_urdf(path, element, floating=base > 0, known=known)
    shapes = Complaints(path.name)
    check_shapes(shapes, element)
    shapes.refuse()
    check_freedoms(path, urdf.freedoms + base, limits)
    return RobotFile(path, element, urdf, tuple(_remarks(urdf, element)), _urdf_meshes(element))


def _refuse_macros(file: str, element: ElementTree.Element) -> None:
    """Refuse a xacro, whose macros and expressions would be passed over.

    Raises:
        ModelError: with the command that expands it.
    """
    # An expanded file still has the namespace, and macros in comments.
    macro = next((e.tag for e in element.iter() if e.tag.startswith("{") and "xacro" in e.tag.partition("}")[0]), None)
    if macro is not None:
        out = re.sub(r"(\.urdf)?\.xacro$", "", file) + ".urdf"
        out = out if out != file else f"expanded_{file}"
        raise ModelError(
            f"{file} is a xacro: its <xacro:{macro.partition('}')[2]:.40}> stands for XML that is not written yet; expected a "
            f"URDF. Expand it: xacro {file} > {out}, with its arguments as name:=value (pip install xacro, where there is no "
            f"ROS), then load {out}."
        )


def check_freedoms(path: Path, nv: int, limits: FileLimits) -> None:
    """Refuse what would fill the memory.

    Raises:
        ModelError: more degrees of freedom than the limits allow.
    """
    if nv > limits.max_dof:
        raise ModelError(
            f"{path.name} has {nv} degrees of freedom; at most {limits.max_dof} are taken: Pinocchio's data would fill "
            f"{32e-9 * nv**3:.1f} GB. Weld joints that do not move, or load_robot(..., "
            f"limits=rbd.model.FileLimits(max_dof={nv}))."
        )


def _remarks(urdf: UrdfFile, robot: ElementTree.Element) -> Iterator[tuple[str, str, str]]:
    for joint in urdf.joints.values():
        if joint.kind == "planar" and (joint.axis is None or any(joint.axis[:2])):
            yield "planar", joint.name, "moves in the x-y plane of its frame, whatever its axis"
        if joint.mimics is not None and joint.kind != "fixed":
            yield "mimic", joint.name, f"follows {joint.mimics!r} in the file; here it moves by itself, and has a motor"
    for part in (*robot.findall("transmission"), *robot.findall("joint")):
        driven = part.find("joint") if part.tag == "transmission" else part
        for element in part.iter():
            if element.tag.rpartition("}")[2].rpartition(":")[2] in _ROTORS and not _is_zero(element):
                name = (part if driven is None else driven).get("name", "")
                told = f"<{element.tag.rpartition('}')[2]:.40}> states a rotor inertia, which is not in M"
                yield "armature", name, f"{told}; load_robot(..., rotors=True), or robot.with_motors, adds it"


def _is_zero(element: ElementTree.Element) -> bool:
    try:
        return float(element.get("value") or element.text or "0") == 0.0
    except ValueError:
        return False


def _urdf_meshes(robot: ElementTree.Element) -> tuple[tuple[str, str], ...]:
    meshes = (mesh for part in ("visual", "collision") for mesh in robot.iterfind(f"link/{part}/geometry/mesh"))
    found = list(dict.fromkeys(mesh.get("filename", "") for mesh in meshes))[:MOST_MESHES]
    return tuple((name, _without_scheme(name)) for name in found)


def _without_scheme(name: str) -> str:
    scheme, separator, rest = name.partition("://")
    if not separator:
        return name
    return rest.lstrip("/") if scheme == "package" else rest


def build_model(file: RobotFile, root: str, plane: Plane = "xy", order: Sequence[str] = ()) -> pin.Model:
    """Pinocchio's model of a checked file, with the rotor inertias that Pinocchio's own reader of URDF drops.

    Args:
        file: As `rbd.model.files.read` gives it.
        root: "free_flyer", "planar" or "fixed".
        plane: That of a planar root.
        order: Of joints on one body, by name, of a URDF; by the alphabet those that are not named.

    Raises:
        InputError: a root that this file does not take.
        ModelError: Pinocchio cannot build it.
    """
    path, content, own = file.path, file.content, isinstance(file.content, Mjcf)
    if own and root == "planar":
        raise InputError(
            f"root='planar' is for URDF files; {path.name} says itself how it moves: give its body two slides and a hinge."
        )
    if own and order:
        raise InputError(f"a loop file's order is for URDF files; the joints of {path.name} are in the order of that file.")
    try:
        model = build(content) if isinstance(content, Mjcf) else _of_urdf(content, root, plane, order)
    except (ValueError, RuntimeError, IndexError) as error:
        reason = str(error).strip().split("\n")[0].rstrip(".")
        raise ModelError(
            f"Pinocchio cannot build {path.name}: {reason:.400}. What its parser printed on stderr says more."
        ) from None
    if own and root == "fixed" and any(j.shortname() == "JointModelFreeFlyer" for j in model.joints):
        raise InputError(f"root='fixed' cannot weld {path.name}, whose own freejoint lets it float. Remove it from the file.")
    return model


def _of_urdf(urdf: UrdfFile, root: str, plane: Plane, order: Sequence[str]) -> pin.Model:
    base = {"planar": pin.JointModelPlanar, "free_flyer": pin.JointModelFreeFlyer}.get(root)
    model = pin.buildModelFromXML(urdf.text, *((base(), BASE_JOINT) if base else ()))
    model = remade(model, [joint.name for joint in urdf.joints.values() if joint.kind == "spherical"], order)
    _add_rotors(model, urdf)
    if root == "planar":
        turn_base(model, plane)
    return model


def _add_rotors(model: pin.Model, urdf: UrdfFile) -> None:
    """The rotor inertias of the file's <dynamics armature>, on the diagonal of M; Pinocchio's reader drops them."""
    armature = np.array(model.armature)
    for joint in urdf.joints.values():
        if joint.armature and model.existJointName(joint.name):
            made = model.joints[model.getJointId(joint.name)]
            armature[made.idx_v : made.idx_v + made.nv] = joint.armature
    model.armature = armature


PER_POSITION = ("lowerPositionLimit", "upperPositionLimit")
PER_VELOCITY = (
    *("armature", "damping", "rotorInertia", "rotorGearRatio", "lowerEffortLimit", "upperEffortLimit"),
    *("lowerVelocityLimit", "upperVelocityLimit", "lowerDryFrictionLimit", "upperDryFrictionLimit"),
)
"""Vectors of a Pinocchio model with an entry for each entry of q, and of v."""


def remade(model: pin.Model, balls: Collection[str], order: Sequence[str] = ()) -> pin.Model:
    """The same model with ball joints in place of floating ones, and the joints on each body in a given order.

    q of a ball joint is the quaternion x, y, z, w of its child's axes in its own, v the angular velocity in the child's axes.

    Args:
        model: As Pinocchio's reader of URDF made it.
        balls: Names of the ball joints.
        order: Names of joints. Those on one body come in this order, each with all that hang on it; others after them.

    Returns:
        The model itself where there is nothing to change.
    """
    if not balls and not order:
        return model
    made, numbers = pin.Model(), {0: 0}
    made.name, made.gravity = model.name, model.gravity
    for i in _depth_first(model, {name: k for k, name in enumerate(order)}):
        name = model.names[i]
        kind = pin.JointModelSpherical() if name in balls else model.joints[i]
        numbers[i] = made.addJoint(numbers[model.parents[i]], kind, model.jointPlacements[i], name)
        made.inertias[numbers[i]] = model.inertias[i]
    for frame in list(model.frames)[1:]:
        moved = pin.Frame(frame)
        moved.parentJoint = numbers[frame.parentJoint]
        made.addFrame(moved, False)
    for keys, start, size in ((PER_POSITION, "idx_q", "nq"), (PER_VELOCITY, "idx_v", "nv")):
        for key in keys:
            values = getattr(made, key).copy()
            for i in range(1, model.njoints):
                if model.names[i] not in balls:
                    joint, other = model.joints[i], made.joints[numbers[i]]
                    old, new, n = getattr(joint, start), getattr(other, start), getattr(joint, size)
                    values[new : new + n] = getattr(model, key)[old : old + n]
            setattr(made, key, values)
    return made


def _depth_first(model: pin.Model, rank: dict[str, int]) -> Iterator[int]:
    """Numbers of the joints, each followed by those beyond it."""
    in_order = sorted(range(1, model.njoints), key=lambda i: rank.get(model.names[i], len(rank)))
    return depth_first(0, grouped((model.parents[i], i) for i in in_order))
