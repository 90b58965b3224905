"""An MJCF file, read: bodies, joints and motors as MuJoCo understands them, everything else refused or reported by name.

Pinocchio's own reader weighs a mesh by its bounding box, knows no actuators, no gravity and no settotalmass, and passes over
shapes that touch nothing; so it is not used. What cannot be part of M a + h = S^T tau + J^T lam is refused unless `leave_out`
names it: springs, gravity compensation, tendons with inertia or springs.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rbd.arrays import Array
from rbd.model.mjcf.attributes import check_attributes, check_elements
from rbd.model.mjcf.bodies import Body, BodyReader, moving_mass
from rbd.model.mjcf.defaults import Defaults
from rbd.model.mjcf.include import carry_out_includes
from rbd.model.mjcf.joints import FREEDOMS, Joint
from rbd.model.mjcf.meshes import Meshes
from rbd.model.mjcf.motors import Motor, Remark, read_motors
from rbd.model.mjcf.names import check_names
from rbd.model.mjcf.settings import Settings, numbers, read_settings
from rbd.model.urdf import LARGEST, Complaints
from rbd.model.xml import FileLimits

Element = ElementTree.Element

LEAVABLE = ("actuators", "springs", "gravcomp", "tendons")
"""What `load_robot(..., leave_out=...)` may name."""


@dataclass(frozen=True, eq=False)
class Mjcf:
    """An MJCF file whose names and numbers are in order.

    Attributes:
        name: Of the model.
        settings: Of the whole file.
        bodies: The world, and each body after its parent.
        motors: In the order of the file; None where the actuators are left out.
        keys: {name: qpos in MuJoCo's order, shape (nq,)}.
        remarks: (kind, where, text) of what is left out.
        mass: Of the moving bodies [kg].
        meshes: For those who draw.
        root: Its first element, includes carried out.
    """

    name: str
    settings: Settings
    bodies: tuple[Body, ...]
    motors: tuple[Motor, ...] | None
    keys: Mapping[str, Array]
    remarks: tuple[Remark, ...]
    mass: float
    meshes: Meshes
    root: Element

    @property
    def joints(self) -> Iterator[Joint]:
        """All joints, in the order of q."""
        return (joint for body in self.bodies for joint in body.joints)


def read_mjcf(
    path: Path, root: Element, limits: FileLimits, folders: tuple[Path, ...] = (), leave_out: Collection[str] = ()
) -> Mjcf:
    """An MJCF file.

    Args:
        path: Where it is.
        root: Its first element, <mujoco>; its includes are carried out in place.
        limits: For included files.
        folders: Where included files and meshes may lie, beside the file's own folder.
        leave_out: Of `LEAVABLE`.

    Raises:
        ModelError: naming the first element that is wrong or not read.
    """
    wrong = Complaints(path.name)
    carry_out_includes(path, root, limits, folders)
    check_elements(wrong, root)
    check_names(wrong, root)
    wrong.refuse()
    settings, defaults = read_settings(wrong, root), Defaults(wrong, root)
    meshes = Meshes(wrong, root, defaults, settings, path.parent, folders)
    bodies = BodyReader(wrong, defaults, settings, meshes).read(root)
    joints = {joint.name: joint for body in bodies for joint in body.joints}
    if len(joints) < sum(len(body.joints) for body in bodies):
        names = [joint.name for body in bodies for joint in body.joints]
        twice = next(name for name in names if names.count(name) > 1)
        wrong.stop(f"two joints are called {twice!r:.80}, one of them by its body; name them.")
    motors: tuple[Motor, ...] | None = None
    remarks: list[Remark] = []
    if "actuators" not in leave_out:
        motors, more = read_motors(wrong, root, defaults, settings, joints)
        remarks += more
    remarks += _springs(wrong, bodies, leave_out)
    remarks += _tendons(wrong, root, defaults, leave_out)
    if settings.fluid:
        remarks.append(("fluid", "<option>", "density and viscosity: the forces of a fluid are in no term of the dynamics"))
    keys = _keys(wrong, root, [joint for body in bodies for joint in body.joints])
    name = root.get("model") or "MuJoCo Model"
    return Mjcf(name, settings, tuple(bodies), motors, keys, tuple(remarks), moving_mass(bodies), meshes, root)


def _springs(wrong: Complaints, bodies: list[Body], leave_out: Collection[str]) -> Iterator[Remark]:
    for body in bodies:
        if body.gravcomp != 0.0:
            told = f"gravcomp {body.gravcomp:g}: its weight is taken off it in the file, and is in full in the dynamics here"
            if "gravcomp" not in leave_out:
                wrong.stop(f"body {body.name!r:.80} has {told}. If that is meant: load_robot(..., leave_out=['gravcomp']).")
            yield "gravcomp", body.name, told
        for joint in body.joints:
            if joint.stiffness != 0.0:
                told = f"a spring (stiffness {joint.stiffness:g}), which is in no term of the dynamics"
                if "springs" not in leave_out:
                    remedy = "If that is meant: load_robot(..., leave_out=['springs'])"
                    wrong.stop(f"joint {joint.name!r:.80} has {told}. {remedy}.")
                yield "spring", joint.name, told
            if joint.kind == "ball" and joint.range is not None:
                yield "limit", joint.name, "is a ball joint with a limit, which is left out"


def _tendons(wrong: Complaints, root: Element, defaults: Defaults, leave_out: Collection[str]) -> Iterator[Remark]:
    for i, raw in enumerate(root.findall("tendon/*")):
        name = raw.get("name") or f"number {i + 1}"
        element = ElementTree.Element(raw.tag, {**defaults.given(raw, None, "tendon"), **raw.attrib})
        words = {key: element.get(key, "").split() for key in ("stiffness", "armature", "damping", "frictionloss")}
        acting = [key for key, given in words.items() if any(word.strip("+-0.") for word in given)]
        inner = [key for key in acting if key in ("stiffness", "armature")]
        if inner and "tendons" not in leave_out:
            wrong.stop(
                f"tendon {name!r:.80} has {' and '.join(inner)}, which is in no term of the dynamics. If that is meant: "
                "load_robot(..., leave_out=['tendons'])."
            )
        if acting or element.get("limited") == "true" or element.get("range") is not None:
            yield "tendon", name, f"is left out, with its {', '.join(acting) or 'limit'}"


def _keys(wrong: Complaints, root: Element, joints: list[Joint]) -> dict[str, Array]:
    """{name: qpos} of the keyframes."""
    found: dict[str, Array] = {}
    sizes = [{"free": 7, "ball": 4}.get(joint.kind, FREEDOMS[joint.kind]) for joint in joints]
    for i, element in enumerate(root.findall("keyframe/key")):
        name = element.get("name") or f"key_{i}"
        check_attributes(wrong, f"<key> {name!r:.80}", element)
        if element.get("qpos") is None:
            continue
        q = np.array(numbers(wrong, f"<key> {name!r:.80}", element, "qpos", sum(sizes), (), most=LARGEST))
        at = 0
        for joint, size in zip(joints, sizes, strict=True):
            if size > 3 and not np.linalg.norm(q[at + size - 4 : at + size]) > 1e-10:
                wrong.stop(f"<key> {name!r:.80} has a zero quaternion for joint {joint.name!r:.80}.")
            at += size
        if name in found:
            wrong.stop(f"two keyframes are called {name!r:.80}; expected different names.")
        found[name] = q
    return found
