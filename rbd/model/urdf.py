"""URDF files: every number and every name is checked before Pinocchio reads the file.

urdfdom and Pinocchio read many broken files as another robot without a message, drop what they cannot read, and crash on
some. Here a file is read once, its faults are reported by name, and it is rewritten: the text that Pinocchio then parses
contains only the links' inertias and the joints, each number as it was read.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any, ClassVar, NoReturn

from rbd.errors import ModelError, nearest

BASE_JOINT = "root_joint"
"""What the joint of a floating base is called."""
FARTHEST = 1e4
"""Lengths [m] above this cost digits of M, which is computed about the world's origin: at 1e7 m nine of sixteen."""
LIGHTEST = 1e-12
"""Pinocchio adds inertias wrongly where masses sum to less than 2e-16 kg."""
LONGEST_CHAIN = 2_000
"""Links below each other; urdfdom and Pinocchio recurse, and at 4,000 the process ends, whatever the limits."""
LARGEST = 1e12
"""Masses, lengths and inertias above this are mistakes; their products would soon not be finite."""
LONGEST_NAME = 120
FREEDOMS = {"revolute": 1, "continuous": 1, "prismatic": 1, "fixed": 0, "floating": 6, "planar": 3, "spherical": 3}
PAIRS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")

_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII)
_SPACE = re.compile(r"[ \t\r\n]+")
_ORIGIN = ("xyz", "rpy")
_ESCAPED = str.maketrans({"&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;", "\n": "&#10;", "\r": "&#13;", "\t": "&#9;"})
_EFFECTLESS = ("lower", "upper")  # of continuous joints


def _quoted(name: str) -> str:
    """A name as the value of an attribute of XML; the library's `saxutils.quoteattr` imports readers of the web."""
    return f'"{name.translate(_ESCAPED)}"'


@dataclass(frozen=True)
class UrdfLink:
    """A link: mass [kg], inertia about its centre of mass (xx, xy, xz, yy, yz, zz) [kg m2]; zero where the file has none."""

    name: str
    mass: float = 0.0
    inertia: Sequence[float] = (0.0,) * 6
    text: str = ""


@dataclass(frozen=True)
class UrdfJoint:
    """A joint between two links; `axis` and `mimics` are None where the file has none; rotor inertia [kg m2, kg]."""

    name: str
    kind: str
    parent: str
    child: str
    axis: Sequence[float] | None
    mimics: str | None
    text: str
    armature: float = 0.0


@dataclass(frozen=True)
class UrdfFile:
    """A URDF file whose tree, names and numbers are in order.

    Attributes:
        links: {name: link}.
        joints: {name: joint}.
        mass: Of the links that move [kg]: a welded base takes those fixed to the root link out of the motion.
        text: What Pinocchio is to read.
    """

    links: dict[str, UrdfLink]
    joints: dict[str, UrdfJoint]
    mass: float
    text: str

    equalities = ()
    """It has no loops, no joints that are said to have no motor, and no springs, as an MJCF can have."""
    undriven = ()
    springs: ClassVar[Mapping[str, tuple[float, float]]] = {}

    @property
    def freedoms(self) -> int:
        """Degrees of freedom, without those of a floating base."""
        return sum(FREEDOMS[joint.kind] for joint in self.joints.values())


def check_urdf(path: Path, robot: ElementTree.Element, *, floating: bool, known: bool = False) -> UrdfFile:
    """A URDF's links and joints, in order.

    Args:
        path: For messages.
        robot: The first element, <robot>.
        floating: A floating base will be put under it, whose joint is `root_joint`.
        known: Pass over a mimic of a joint that is not there.

    Raises:
        ModelError: naming the first link or joint that is wrong, and how many more are.
    """
    wrong = Complaints(path.name)
    name = robot.get("name", "")
    if not name.strip():
        wrong.add("its <robot> has no name.")
    links = wrong.by_name("link", (_link(wrong, e) for e in robot.findall("link")))
    joints = wrong.by_name("joint", (_joint(wrong, e) for e in robot.findall("joint")))
    if floating and BASE_JOINT in joints:
        wrong.add(f"joint {BASE_JOINT!r} has the name of the floating base's own joint. Rename it, or load with root='fixed'.")
    if "universe" in joints:
        wrong.add("joint 'universe' has the name of Pinocchio's world. Rename it.")
    _check_tree(wrong, links, joints)
    _check_mimics(wrong, joints, known=known)
    wrong.refuse()
    text = "".join([f"<robot name={_quoted(name)}>", *(x.text for x in (*links.values(), *joints.values())), "</robot>"])
    fixed = set() if floating else _base(links, joints)
    return UrdfFile(links, joints, sum(link.mass for link in links.values() if link.name not in fixed), text)


@dataclass(frozen=True)
class Complaints:
    """Collects messages about the faults of a file."""

    file: str
    found: list[str] = field(default_factory=list)

    def add(self, text: str) -> None:
        """One more."""
        self.found.append(text)

    def refuse(self) -> None:
        """Raise if there are any: the first in full, the others counted."""
        if self.found:
            more = f" ({len(self.found) - 1} more of this file.)" if len(self.found) > 1 else ""
            raise ModelError(f"{self.file}: {self.found[0]}{more}")

    def stop(self, text: str) -> NoReturn:
        """Raise what makes further reading pointless."""
        self.found.insert(0, text)
        self.refuse()
        raise AssertionError("unreachable")

    def by_name(self, what: str, things: Iterable[UrdfLink] | Iterable[UrdfJoint]) -> dict:
        """{name: element}; missing and repeated names are reported."""
        found: dict = {}
        for thing in things:
            if not thing.name.strip():
                self.stop(f"{what} number {len(found) + 1} has no name.")
            elif thing.name in found:
                self.stop(f"two {what}s are called {thing.name!r}; expected different names.")
            elif len(thing.name) > LONGEST_NAME:
                self.stop(
                    f"{what} {thing.name[:40]!r}... has a name of {len(thing.name)} letters; expected {LONGEST_NAME} at most."
                )
            found[thing.name] = thing
        return found

    def numbers(
        self,
        what: str,
        element: ElementTree.Element | None,
        attribute: str,
        *,
        count: int = 1,
        default: float | None = None,
        most: float = LARGEST,
    ) -> list[float]:
        """The finite numbers of an attribute; the default where it is not given and there is one."""
        text = None if element is None else element.get(attribute)
        if text is None and default is not None:
            return [default] * count
        # urdfdom silently drops the whole inertial of a link for a blank next to a single number
        words = _words(text or "") if count > 1 else [text or ""]
        values = [float(word) for word in words if _NUMBER.fullmatch(word)]
        if len(values) == len(words) == count and all(-most <= x <= most for x in values):
            return values
        expected = "a finite number" if count == 1 else f"{count} finite numbers"
        expected += f", at most {most:g}" if all(_NUMBER.fullmatch(word) for word in words) and most < LARGEST else ""
        came = f"is {text!r:.80}" if text is not None else "is missing"
        if count == 1 and text is not None and _NUMBER.fullmatch(text.strip()):
            expected += ", no blanks around it" if text != text.strip() else ""
        self.add(f"{what}: {attribute} {came}; expected {expected}.")
        return [0.0] * count


def _words(text: str) -> list[str]:
    """Text split at XML's white space only, as other readers do; else numbers would be read differently."""
    return [word for word in _SPACE.split(text) if word]


def _link(wrong: Complaints, element: ElementTree.Element) -> UrdfLink:
    name = element.get("name", "")
    inertial = element.find("inertial")
    if inertial is None:
        return UrdfLink(name, text=f"<link name={_quoted(name)}/>")
    what = f"the inertial of link {name!r}"
    mass, inertia = inertial.find("mass"), inertial.find("inertia")
    kg = wrong.numbers(f"the mass of link {name!r}", mass, "value")[0]
    if kg < 0.0:
        wrong.add(f"link {name!r} has a mass of {kg:g} kg; no body weighs less than nothing.")
    elif 0.0 < kg < LIGHTEST:
        wrong.add(f"link {name!r} has a mass of {kg:g} kg; expected zero, or at least {LIGHTEST:g} kg.")
    moments = [wrong.numbers(f"the inertia of link {name!r}", inertia, pair)[0] for pair in PAIRS]
    text = (
        f"<link name={_quoted(name)}><inertial>{_origin(wrong, what, inertial)}<mass value='{kg!r}'/><inertia "
        + " ".join(f"{pair}='{x!r}'" for pair, x in zip(PAIRS, moments, strict=True))
        + "/></inertial></link>"
    )
    return UrdfLink(name, kg, moments, text)


def _joint(wrong: Complaints, element: ElementTree.Element) -> UrdfJoint:
    name, kind = element.get("name", ""), element.get("type", "")
    what = f"joint {name!r}"
    if kind not in FREEDOMS:
        wrong.add(f"{what} is of type {kind!r:.80}; expected one of {', '.join(FREEDOMS)}.")
    parent, child = (e.get("link", "") if (e := element.find(tag)) is not None else "" for tag in ("parent", "child"))
    axis, limits, dynamics = (element.find(tag) for tag in ("axis", "limit", "dynamics"))
    mimic = element.find("mimic")
    parts = [_origin(wrong, what, element)]
    direction, armature = None, 0.0
    if axis is not None and kind not in ("fixed", "floating", "spherical"):
        direction = wrong.numbers(f"the axis of {what}", axis, "xyz", count=3)
        length = sum(x * x for x in direction) ** 0.5
        if not 1e-6 <= length <= 1e6:
            told = f"{length:g} long; expected a unit vector" if length else "zero"
            wrong.add(f"{what} is {kind}, and its axis is {told}.")
        parts.append(f"<axis xyz='{_joined(direction)}'/>")
    if kind in ("revolute", "prismatic", "continuous", "planar"):
        parts.append(_limit(wrong, what, kind, limits))
    if dynamics is not None and kind != "fixed":
        damping, friction = (_positive(wrong, what, dynamics, key) for key in ("damping", "friction"))
        armature = _positive(wrong, what, dynamics, "armature")
        parts.append(f"<dynamics damping='{damping!r}' friction='{friction!r}'/>")
    if mimic is not None:
        for key in ("multiplier", "offset"):
            wrong.numbers(f"the mimic of {what}", mimic, key, default=0.0)
    told = "floating" if kind == "spherical" else kind  # see rbd.model.files
    text = (
        f"<joint name={_quoted(name)} type={_quoted(told)}><parent link={_quoted(parent)}/>"
        f"<child link={_quoted(child)}/>{''.join(parts)}</joint>"
    )
    return UrdfJoint(name, kind, parent, child, direction, None if mimic is None else mimic.get("joint", ""), text, armature)


def _limit(wrong: Complaints, what: str, kind: str, limit: ElementTree.Element | None) -> str:
    if limit is None:
        if kind in ("revolute", "prismatic"):
            wrong.add(f"{what} is {kind}, and has no <limit>.")
        return ""
    lower, upper = (wrong.numbers(f"the limit of {what}", limit, key, default=0.0, most=1e308)[0] for key in _EFFECTLESS)
    if lower > upper and kind in ("revolute", "prismatic"):
        wrong.add(f"{what} has its limits swapped: lower is {lower:g}, upper is {upper:g}.")
    effort, velocity = (_positive(wrong, what, limit, key) for key in ("effort", "velocity"))
    return f"<limit lower='{lower!r}' upper='{upper!r}' effort='{effort!r}' velocity='{velocity!r}'/>"


def _positive(wrong: Complaints, what: str, element: ElementTree.Element, key: str) -> float:
    default = None if element.tag == "limit" else 0.0
    value = wrong.numbers(f"the {element.tag} of {what}", element, key, default=default, most=1e308)[0]
    if value < 0.0:
        wrong.add(f"{what} has {key} {value:g}; expected zero or more.")
    return value


def _origin(wrong: Complaints, what: str, element: ElementTree.Element) -> str:
    origin = element.find("origin")
    if origin is None:
        return ""
    xyz, rpy = (wrong.numbers(f"the origin of {what}", origin, key, count=3, default=0.0, most=FARTHEST) for key in _ORIGIN)
    return f"<origin xyz='{_joined(xyz)}' rpy='{_joined(rpy)}'/>"


def _joined(values: Sequence[float]) -> str:
    return " ".join(map(repr, values))


def _check_tree(wrong: Complaints, links: dict[str, UrdfLink], joints: dict[str, UrdfJoint]) -> None:
    """One root, one parent a link, no circle, no link without a parent but the root."""
    above: dict[str, str] = {}
    for joint in joints.values():
        for end, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in links:
                told = f"names a {end} link {link!r:.120}" if link else f"has no {end} link"
                wrong.stop(f"joint {joint.name!r} {told}; {nearest(link, links)}.")
        if joint.child in above:
            wrong.stop(
                f"link {joint.child!r} has two parents, {above[joint.child]!r} and {joint.parent!r} (joint {joint.name!r}); "
                "expected a tree."
            )
        above[joint.child] = joint.parent
    roots = [link for link in links if link not in above]
    if len(roots) != 1:
        found = ", ".join(map(repr, roots[:4])) or "none"
        wrong.stop(f"expected a tree with one root link, found {len(roots)}: {found}.")
    levels = hanging(roots, grouped((joint.parent, joint.child) for joint in joints.values()))
    reached = set(chain.from_iterable(levels))
    if lost := [link for link in links if link not in reached]:
        link = _on_circle(lost[0], above)
        wrong.stop(f"link {link!r} does not hang from the root {roots[0]!r}: its parents make a circle.")
    if len(levels) > LONGEST_CHAIN:
        wrong.stop(
            f"{len(levels)} links hang below each other; at most {LONGEST_CHAIN} are taken: readers crash on long chains."
        )


def grouped(pairs: Iterable[tuple[Any, Any]]) -> dict[Any, list[Any]]:
    """{first: the seconds of all pairs with it}, in their order."""
    found: dict[Any, list[Any]] = {}
    for first, second in pairs:
        found.setdefault(first, []).append(second)
    return found


def depth_first(root: Any, below: Mapping[Any, Sequence[Any]]) -> Iterator[Any]:
    """What hangs on a root, each followed by what hangs on it, in the order of `below`."""
    waiting = [*reversed(below.get(root, ()))]
    while waiting:
        yield (each := waiting.pop())
        waiting += reversed(below.get(each, ()))


def hanging(roots: Iterable[str], below: Mapping[str, Sequence[str]]) -> list[list[str]]:
    """Names by levels: the roots, what hangs on them, what hangs on that, and so on; each once, also where they make a circle.

    Args:
        roots: Names to start from.
        below: {name: what hangs on it}.
    """
    levels = [list(roots)]
    seen = set(levels[0])
    while levels[-1]:
        level = [child for name in levels[-1] for child in below.get(name, ()) if child not in seen]
        levels.append(list(dict.fromkeys(level)))
        seen.update(level)
    return levels[:-1]


def _on_circle(link: str, above: dict[str, str]) -> str:
    seen = set()
    while link not in seen:
        seen.add(link)
        link = above[link]
    return link


def _check_mimics(wrong: Complaints, joints: dict[str, UrdfJoint], *, known: bool) -> None:
    for joint in [each for each in joints.values() if each.mimics is not None]:
        if joint.mimics not in joints and not known:
            told = f"mimics {joint.mimics!r:.120}, which is no joint" if joint.mimics else "mimics nothing"
            wrong.add(f"joint {joint.name!r} {told}; {nearest(joint.mimics, joints)}.")
        seen, other = {joint.name}, joint
        while other.mimics in joints:
            other = joints[other.mimics]
            if other.name in seen:
                who = "itself" if other is joint and len(seen) == 1 else f"{joint.mimics!r}, and that in a circle"
                wrong.add(f"joint {joint.name!r} mimics {who}.")
                break
            seen.add(other.name)


def _base(links: dict[str, UrdfLink], joints: dict[str, UrdfJoint]) -> set[str]:
    """Links fixed to the root link, itself included."""
    moved = {joint.child for joint in joints.values()}
    welded = grouped((joint.parent, joint.child) for joint in joints.values() if joint.kind == "fixed")
    return set(chain.from_iterable(hanging([link for link in links if link not in moved], welded)))


SMALLEST = 1e-9
"""Smallest size of a shape [m], and smallest scale of a mesh either way."""
_SIZES = {"sphere": ("radius",), "cylinder": ("radius", "length"), "capsule": ("radius", "length"), "box": ("size",)}


def check_shapes(wrong: Complaints, robot: ElementTree.Element) -> None:
    """Complain of sizes that are missing, no numbers, negative, zero or nearly so, and of scales that flatten a mesh.

    A negative scale mirrors a mesh, and is taken. urdfdom takes them all: a sphere of radius -1 rests on the ground at z = -1,
    one of radius nan nowhere.
    """
    for link in robot.findall("link"):
        for kind in ("collision", "visual"):
            for part in link.findall(kind):
                what = f"the {kind} shape of link {link.get('name', '')!r}"
                if (origin := part.find("origin")) is not None:
                    for key in ("xyz", "rpy"):
                        wrong.numbers(f"the origin of {what}", origin, key, count=3, default=0.0, most=FARTHEST)
                for shape in part.iterfind("geometry/*"):
                    _check_shape(wrong, what, shape)


def _check_shape(wrong: Complaints, what: str, shape: ElementTree.Element) -> None:
    found = len(wrong.found)
    if shape.tag == "mesh" and shape.get("scale") is not None:
        factors = wrong.numbers(f"the mesh in {what}", shape, "scale", count=3, most=LARGEST)
        if len(wrong.found) == found and not all(abs(factor) >= SMALLEST for factor in factors):
            wrong.add(
                f"the mesh in {what} has the scale {shape.get('scale')!r:.60}; expected factors of {SMALLEST:g} or more, "
                "negative ones for a mirror."
            )
    for key in _SIZES.get(shape.tag, ()):
        sizes = wrong.numbers(f"the {shape.tag} in {what}", shape, key, count=3 if key == "size" else 1, most=FARTHEST)
        if len(wrong.found) == found and not all(size >= SMALLEST for size in sizes):
            wrong.add(f"the {shape.tag} in {what} has {key} {shape.get(key)!r:.60}; expected {SMALLEST:g} m or more.")
