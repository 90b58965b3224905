"""An MJCF file and what it includes: bodies, joints and motors as in MuJoCo; other elements are refused by name.

Pinocchio's own reader weighs a mesh by its bounding box, knows no actuators, no gravity and no settotalmass, and passes over
shapes that cannot touch; so it is not used. What cannot be part of M a + h = S^T tau + J^T lam is refused unless `leave_out`
names it: springs sized by the inertia, gravity compensation, tendons with inertia or springs.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from rbd.arrays import Array
from rbd.errors import InputError
from rbd.model.input_files import FileLimits, read_xml
from rbd.model.mjcf.bodies import Body, BodyReader, moving_mass
from rbd.model.mjcf.elements import Defaults, check_attributes, check_elements
from rbd.model.mjcf.joints import FREEDOMS, Joint, Motor, Remark, read_motors
from rbd.model.mjcf.meshes import Meshes
from rbd.model.mjcf.settings import Settings, numbers, read_settings
from rbd.model.urdf import LARGEST, LONGEST_NAME, Complaints

Element = ElementTree.Element

LEAVABLE = ("actuators", "springs", "gravcomp", "tendons")
"""What `load_robot(..., leave_out=...)` may name."""
MOST_FILES = 100
_KINDS = {"body": "bodies", "joint": "two joints", "freejoint": "two joints", "site": "two sites"}


@dataclass(frozen=True, eq=False)
class Mjcf:
    """An MJCF file whose names and numbers are in order.

    Attributes:
        name: Of the model.
        settings: Of the whole file.
        bodies: The world, and each body after its parent.
        motors: In the order of the file; None where the actuators are left out.
        keys: {name: qpos in MuJoCo's order, shape (nq,)}.
        remarks: (kind, where, text) of ignored contents.
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
        folders: Folders of included files and meshes, besides the file's folder.
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
            if joint.tuned or joint.stiffness != 0.0 and joint.kind == "free":
                told = f"a spring (stiffness {joint.stiffness:g}), which is in no term of the dynamics"
                if joint.tuned:
                    told = (
                        "a springdamper: MuJoCo finds its stiffness and damping from the inertia, and they are in no term here"
                    )
                if "springs" not in leave_out:
                    remedy = "If that is meant: load_robot(..., leave_out=['springs'])"
                    wrong.stop(f"joint {joint.name!r:.80} has {told}. {remedy}.")
                yield "spring", joint.name, told
            elif joint.stiffness != 0.0:
                told = f"a spring (stiffness {joint.stiffness:g})"
                if "springs" in leave_out:
                    yield "spring", joint.name, f"{told}, which is left out"
                else:
                    yield "joint spring", joint.name, f"{told}, which acts where external=robot.joint_springs() is given"
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


def carry_out_includes(path: Path, root: Element, limits: FileLimits, folders: tuple[Path, ...] = ()) -> None:
    """Replace the <include> elements by the contents of the included files.

    Args:
        path: The main file.
        root: Its first element, which is changed.
        limits: For each included file, and for all together.
        folders: Folders of included files, besides the main file's folder.

    Raises:
        ModelError: a file that is missing, outside the folders, included twice, or broken.
    """
    if root.find(".//include") is not None:
        inside = tuple(folder.resolve() for folder in (path.parent, *folders))
        _Includer(Complaints(path.name), path, limits, inside, {path.resolve()}).expand(root, path, 1)


@dataclass
class _Includer:
    wrong: Complaints
    main: Path
    limits: FileLimits
    inside: tuple[Path, ...]
    seen: set[Path] = field(default_factory=set)
    size: int = 0
    elements: int = 0

    def expand(self, element: Element, file: Path, depth: int) -> None:
        if depth > self.limits.max_depth:
            self.wrong.stop(f"its includes bring elements {depth} deep inside each other.")
        children: list[Element] = []
        for child in element:
            if child.tag == "include":
                found = self.find(child, file)
                top = self.read(found)
                self.expand(top, found, depth)
                children.extend(top)
            else:
                self.expand(child, file, depth + 1)
                children.append(child)
        element[:] = children

    def find(self, element: Element, file: Path) -> Path:
        """The included file; its name is relative to the including file's folder, else to the main file's."""
        name = element.get("file", "")
        for start in (file.parent, self.main.parent):
            try:
                place = (start / name).resolve()
                if not place.is_file():
                    continue
            except (OSError, ValueError, RuntimeError):
                continue
            if not any(place.is_relative_to(folder) for folder in self.inside):
                self.wrong.stop(
                    f"<include> names the file {name!r:.200}, outside the folder of {self.wrong.file}. Copy it "
                    "there, or give the folder above both: load_robot(..., package_dirs=[folder])."
                )
            return place
        self.wrong.stop(f"<include> is not read: its file {name!r:.200} is not there.")

    def read(self, found: Path) -> Element:
        if found in self.seen:
            self.wrong.stop(f"<include> brings {found.name!r:.200} a second time; expected each file once.")
        self.seen.add(found)
        self.size += found.stat().st_size
        top = read_xml(found, self.limits)
        self.elements += sum(1 for _ in top.iter())
        if len(self.seen) > MOST_FILES or self.size > self.limits.max_bytes or self.elements > self.limits.max_elements:
            self.wrong.stop(
                f"its includes bring more than {MOST_FILES} files, {self.limits.max_bytes / 1e6:g} MB or "
                f"{self.limits.max_elements} elements."
            )
        if top.tag not in ("mujoco", "mujocoinclude"):
            self.wrong.stop(f"<include> brings {found.name!r:.80}, whose first element is <{top.tag:.40}>; expected <mujoco>.")
        return top


def check_names(wrong: Complaints, root: ElementTree.Element) -> None:
    """Complain of names that come twice, are too long, or are the world's own."""
    seen: set[tuple[str, str]] = set()
    for element in root.iterfind("worldbody//*"):
        name = element.get("name")
        if name is None or element.tag not in _KINDS:
            continue
        kind = element.tag.removeprefix("free")
        if len(name) > LONGEST_NAME:
            wrong.stop(f"{kind} {name[:40]!r}... has a name of {len(name)} letters; expected {LONGEST_NAME} at most.")
        if name.strip() and (kind, name) in seen:
            wrong.add(f"{_KINDS[element.tag]} are called {name!r}; expected different names.")
        if (kind, name) in (("joint", "universe"), ("body", "universe"), ("body", "world")):
            wrong.add(f"{kind} {name!r} has the name of the world. Rename it.")
        seen.add((kind, name))


def check_leave_out(leave_out: Collection[str]) -> None:
    """Refuse parts of an MJCF that cannot be left out.

    Raises:
        InputError: naming the first of them, with those that can.
    """
    try:
        wrong = [each for each in leave_out if each not in LEAVABLE] if not isinstance(leave_out, str) else [leave_out]
    except TypeError:
        wrong = [leave_out]  # type: ignore[list-item]
    if wrong:
        raise InputError(f"leave_out has {wrong[0]!r:.80}; expected a list of some of {', '.join(map(repr, LEAVABLE))}.")
