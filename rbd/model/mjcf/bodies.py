"""The bodies of an MJCF file: the tree, and the mass, joints, shapes and sites of each body."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from rbd.arrays import Array
from rbd.model.mjcf.elements import ORIENTATIONS, Defaults, check_attributes
from rbd.model.mjcf.joints import Joint, check_joints, read_joint
from rbd.model.mjcf.meshes import Meshes
from rbd.model.mjcf.poses import Pose, at_rest, pose, z_along
from rbd.model.mjcf.settings import Settings, keyword, numbers, truth
from rbd.model.mjcf.solids import Solid, joined, shape_solid
from rbd.model.urdf import FARTHEST, LIGHTEST, Complaints

Element = ElementTree.Element
WORLD = "world"
SIZES = {"sphere": 1, "capsule": 2, "cylinder": 2, "ellipsoid": 3, "box": 3}
"""How many sizes a shape has."""
SMALLEST = 1e-9
"""Smallest size of a shape [m]."""
_FROM_TO = ("capsule", "cylinder", "ellipsoid", "box")


@dataclass(frozen=True, eq=False)
class Body:
    """A body, or the world.

    Attributes:
        name: Its name, or one made from its number.
        parent: Index of the body it hangs from, -1 for the world.
        X: Where it is on its parent, in the posture that the file draws.
        joints: In the order in which they move it.
        solid: What it weighs, in its axes.
        shapes: On it.
        sites: (name, pose) of each that has a name.
        gravcomp: Share of its weight that is taken off it.
    """

    name: str
    parent: int
    X: Pose
    joints: tuple[Joint, ...] = ()
    solid: Solid = field(default_factory=lambda: joined([]))
    shapes: tuple[Shape, ...] = ()
    sites: tuple[tuple[str, Pose], ...] = ()
    gravcomp: float = 0.0


@dataclass
class _Parts:
    """The elements of a body, frames resolved: (element, pose of its parent, default class)."""

    bodies: list[tuple[Element, Pose, str | None]] = field(default_factory=list)
    others: dict[str, list[tuple[Element, Pose]]] = field(default_factory=dict)


@dataclass(frozen=True)
class BodyReader:
    """Reads the bodies of a file; faults are reported with the file's name."""

    wrong: Complaints
    defaults: Defaults
    settings: Settings
    meshes: Meshes

    def read(self, root: Element) -> list[Body]:
        """The world and all bodies, each after its parent, branch by branch in the order of the file.

        Raises:
            ModelError: naming the fault, or what is not read.
        """
        out: list[Body] = []
        taken = {body.get("name") for body in root.iterfind("worldbody//body")}
        world = ElementTree.Element("worldbody", name=WORLD)
        for each in root.findall("worldbody"):
            check_attributes(self.wrong, "<worldbody>", each)
            world.attrib.update({k: v for k, v in each.attrib.items() if k == "childclass"})
            world.extend(each)
        stack: list[tuple[Element, int, Pose, str | None]] = [(world, -1, at_rest(), None)]
        while stack:
            element, parent, around, childclass = stack.pop()
            name = element.get("name") or next(
                f"body_{len(out)}{'_' * k}" for k in range(len(taken) + 1) if f"body_{len(out)}{'_' * k}" not in taken
            )
            parts = self._parts(element, childclass)
            out.append(self._body(name, element, parent, around, parts))
            stack += [(child, len(out) - 1, X, inner) for child, X, inner in reversed(parts.bodies)]
        return self._to_total(out)

    def _parts(self, body: Element, childclass: str | None) -> _Parts:
        found = _Parts()
        stack = [(body, at_rest(), body.get("childclass", childclass))]
        while stack:  # elements in their order: frames are resolved in place
            element, X, inner = stack.pop()
            if element.tag == "frame" or element is body:
                if element.tag == "frame":
                    check_attributes(self.wrong, "<frame>", element)
                    X = X * pose(self.wrong, f"<frame> of body {body.get('name')!r:.80}", element, self.settings)
                    inner = element.get("childclass", inner)
                stack += [(child, X, inner) for child in reversed(element)]
            elif element.tag == "body":
                found.bodies.append((element, X, inner))
            elif element.tag in ("joint", "freejoint", "inertial", "geom", "site"):
                found.others.setdefault(element.tag.removeprefix("free"), []).append(
                    (self.defaults.resolved(element, inner), X)
                )
        return found

    def _body(self, name: str, element: Element, parent: int, around: Pose, parts: _Parts) -> Body:
        what = f"body {name!r:.80}"
        shapes = tuple(self._shapes(what, parts.others.get("geom", [])))
        sites = tuple(self._sites(what, parts.others.get("site", [])))
        if parent < 0:
            for tag in ("joint", "inertial"):
                if tag in parts.others:
                    self.wrong.stop(f"the world has a <{tag}>; expected it on a body.")
            return Body(WORLD, -1, at_rest(), shapes=shapes, sites=sites)
        check_attributes(self.wrong, what, element)
        joints = tuple(
            read_joint(self.wrong, name, i, joint, X, self.settings)
            for i, (joint, X) in enumerate(parts.others.get("joint", []))
        )
        check_joints(self.wrong, what, joints, top=parent == 0)
        if truth(self.wrong, what, element, "mocap") and (joints or parent):
            self.wrong.stop(f"{what} is mocap, and moves or hangs from another; expected it fixed to the world.")
        for shape in shapes if joints else ():
            if shape.kind in ("plane", "hfield"):
                self.wrong.stop(f"{what} moves, and has a {shape.kind}; expected that on a body that does not.")
        gravcomp = numbers(self.wrong, what, element, "gravcomp", 1, (0.0,))[0]
        solid = self._solid(what, parts.others.get("inertial", []), shapes)
        X = around * pose(self.wrong, what, element, self.settings)
        return Body(name, parent, X, joints, solid, shapes, sites, gravcomp)

    def _shapes(self, what: str, found: list[tuple[Element, Pose]]) -> Iterator[Shape]:
        for i, (element, X) in enumerate(found):
            told = f"geom {element.get('name')!r:.80} of {what}" if element.get("name") else f"<geom> {i + 1} of {what}"
            shape = read_shape(self.wrong, told, element, self.settings)
            if shape.mesh:
                self.meshes.scale(shape.mesh, self.meshes.element(told, shape.mesh))
            yield replace(shape, X=X * shape.X)

    def _sites(self, what: str, found: list[tuple[Element, Pose]]) -> Iterator[tuple[str, Pose]]:
        for element, X in found:
            told = f"site {element.get('name')!r:.80} of {what}"
            check_attributes(self.wrong, told, element)
            if element.get("fromto") is not None:
                given = ElementTree.Element("geom", {"type": "capsule", "size": "1", "fromto": element.get("fromto", "")})
                own = read_shape(self.wrong, told, given, self.settings).X
            else:
                own = pose(self.wrong, told, element, self.settings)
            if element.get("name"):
                yield element.get("name", ""), X * own

    def _solid(self, what: str, inertials: list[tuple[Element, Pose]], shapes: tuple[Shape, ...]) -> Solid:
        if len(inertials) > 1:
            self.wrong.stop(f"{what} has {len(inertials)} <inertial>; expected one.")
        rule = self.settings.inertiafromgeom
        own = self._inertial(what, *inertials[0]) if inertials else None
        low, high = self.settings.groups
        weighing = [(i, shape) for i, shape in enumerate(shapes) if low <= shape.group <= high]
        if rule == "true" and weighing or rule == "auto" and own is None:
            solids = []
            for i, shape in weighing:
                told = f"geom {shape.name!r:.80} of {what}" if shape.name else f"<geom> {i + 1} of {what}"
                solids.append(weight(self.wrong, told, shape, self.settings, self.meshes))
            own = joined(solids)
        own = joined([]) if own is None else own
        if own.mass == 0.0 and not inertials and self.settings.least_mass:
            self.wrong.stop(
                f"{what} has neither an <inertial> nor shapes that weigh, and boundmass gives it a mass at a place "
                "that the file does not say. Give it an <inertial>."
            )
        return self._bounded(what, own)

    def _inertial(self, what: str, element: Element, X: Pose) -> Solid:
        what = f"<inertial> of {what}"
        check_attributes(self.wrong, what, element)
        if element.get("pos") is None or element.get("mass") is None:
            self.wrong.stop(f"{what} has no {'pos' if element.get('pos') is None else 'mass'}; expected pos and mass.")
        mass = numbers(self.wrong, what, element, "mass", 1, (0.0,))[0]
        if mass < 0.0:
            self.wrong.stop(f"{what} has mass {mass:g}; expected zero or more.")
        place = X * pose(self.wrong, what, element, self.settings)
        if (full := element.get("fullinertia")) is not None:
            extra = [key for key in ("diaginertia", *ORIENTATIONS) if element.get(key) is not None]
            if extra:
                self.wrong.stop(f"{what} has fullinertia and {extra[0]}; expected one of them.")
            xx, yy, zz, xy, xz, yz = numbers(self.wrong, what, element, "fullinertia", 6, ())
            own = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        else:
            own = np.diag(numbers(self.wrong, what, element, "diaginertia", 3, (0.0, 0.0, 0.0)))
        if full is None and (np.diag(own) < 0.0).any():
            self.wrong.stop(f"{what} has diaginertia {element.get('diaginertia')!r:.80}; expected zero or more.")
        return Solid(mass, place.p, place.R @ own @ place.R.T)

    def _bounded(self, what: str, solid: Solid) -> Solid:
        """Its mass and moments of inertia, at least the file's minima, and balanced if the file requires it."""
        settings = self.settings
        if 0.0 < solid.mass < LIGHTEST:
            self.wrong.stop(f"{what} has a mass of {solid.mass:g} kg; expected zero, or at least {LIGHTEST:g} kg.")
        if not (settings.least_mass or settings.least_moment or settings.balance):
            return solid
        moments, axes = np.linalg.eigh(solid.inertia)
        moments = np.maximum(moments, settings.least_moment)
        if settings.balance and moments[0] + moments[1] < moments[2]:
            moments = np.repeat(moments.mean(), 3)
        return Solid(max(solid.mass, settings.least_mass), solid.centre, axes @ np.diag(moments) @ axes.T)

    def _to_total(self, bodies: list[Body]) -> list[Body]:
        wanted, total = self.settings.total_mass, sum(body.solid.mass for body in bodies)
        if wanted is None or total == 0.0:
            return bodies
        return [replace(body, solid=body.solid.scaled(wanted / total)) for body in bodies]


def moving_mass(bodies: list[Body]) -> float:
    """The mass of the bodies that hang from a joint [kg]."""
    moves = [False] * len(bodies)
    for i, body in enumerate(bodies[1:], 1):
        moves[i] = bool(body.joints) or moves[body.parent]
    return sum(body.solid.mass for body, moving in zip(bodies, moves, strict=True) if moving)


@dataclass(frozen=True, eq=False)
class Shape:
    """A shape on a body.

    Attributes:
        name: Its name; empty if it has none.
        kind: "sphere", "capsule", "cylinder", "ellipsoid", "box", "plane", "mesh" or "hfield".
        size: Radius; radius and half length; half lengths [m].
        X: Where it is on its body.
        mesh: Name of its mesh; empty if it has none.
        touches: Whether it takes part in contacts.
        group: Which group it is in.
        rgba: Its colour.
        element: The element with its class defaults.
    """

    name: str
    kind: str
    size: Array
    X: Pose
    mesh: str
    touches: bool
    group: float
    rgba: tuple[float, ...]
    element: Element


def read_shape(wrong: Complaints, what: str, element: Element, settings: Settings) -> Shape:
    """A <geom> or a <site> whose class is carried out.

    Raises:
        ModelError: sizes that are missing, negative or zero, and what else is wrong with it.
    """
    check_attributes(wrong, what, element)
    mesh = element.get("mesh", "")
    kind = keyword(wrong, what, element, "type", "sphere", (*SIZES, "plane", "mesh", "hfield"))
    words = element.get("size", "").split()
    size = np.array(numbers(wrong, what, element, "size", len(words), (), most=FARTHEST))
    X = pose(wrong, what, element, settings)
    if element.get("fromto") is not None:
        size, X = _from_to(wrong, what, element, kind, size)
    if kind == "mesh" and not mesh:
        wrong.stop(f"{what} is a mesh, and names none.")
    if kind in SIZES and not mesh:
        size = checked_size(wrong, what, kind, size)
    if kind == "plane" and ((size[:2] < 0.0).any() or not 0 < len(size) <= 3):
        wrong.stop(f"{what} is a plane of the size {element.get('size', '')!r:.60}; expected three numbers, none negative.")
    contact = [numbers(wrong, what, element, key, 1, (1.0,))[0] for key in ("contype", "conaffinity")]
    group = numbers(wrong, what, element, "group", 1, (0.0,))[0]
    rgba = tuple(numbers(wrong, what, element, "rgba", 4, (0.5, 0.5, 0.5, 1.0)))
    return Shape(element.get("name", ""), kind, size, X, mesh, any(contact), group, rgba, element)


def checked_size(wrong: Complaints, what: str, kind: str, size: Array) -> Array:
    """As many sizes as the shape has, all positive."""
    needed = SIZES[kind]
    if len(size) < needed or not (size[:needed] >= SMALLEST).all():
        came = " ".join(f"{x:g}" for x in size) or "no size"
        wrong.stop(f"{what} is a {kind} with {came}; expected {needed} size{'s' * (needed > 1)}, each {SMALLEST:g} m or more.")
    return size[:needed]


def weight(wrong: Complaints, what: str, shape: Shape, settings: Settings, meshes: Meshes) -> Solid:
    """Mass, centre of mass and inertia of a shape, in the axes of its body.

    Raises:
        ModelError: a negative mass or density, or a shape whose weight is not known.
    """
    element = shape.element
    defaults = {"mass": -1.0, "density": 1000.0}
    given = {key: numbers(wrong, what, element, key, 1, (default,))[0] for key, default in defaults.items()}
    has_mass = element.get("mass") is not None
    for key in ("mass", "density"):
        if given[key] < 0.0 and (key == "density" or has_mass):
            wrong.stop(f"{what} has {key} {given[key]:g}; expected zero or more.")
    if shape.kind in ("plane", "hfield") or (given["mass"] if has_mass else given["density"]) == 0.0:
        return Solid(0.0, shape.X.p, np.zeros((3, 3)))
    shell = truth(wrong, what, element, "shellinertia")
    if shape.mesh:
        if shape.kind != "mesh":
            wrong.stop(
                f"{what} is a {shape.kind} that is to be fitted to the mesh {shape.mesh!r:.80}, and not read. Give its "
                "size and place, or give the body an <inertial>."
            )
        if shell:
            wrong.stop(f"{what} is a mesh with shellinertia; expected inertia='shell' on the mesh itself.")
        solid = meshes.solid(what, shape.mesh)
    else:
        solid = shape_solid(shape.kind, shape.size, shell=shell)
    return solid.scaled(given["mass"] / solid.mass if has_mass else given["density"]).placed(shape.X.R, shape.X.p)


def _from_to(wrong: Complaints, what: str, element: Element, kind: str, size: Array) -> tuple[Array, Pose]:
    if kind not in _FROM_TO:
        wrong.stop(f"{what} is a {kind} with fromto; expected one of {', '.join(_FROM_TO)}.")
    if element.get("pos") is not None:
        wrong.stop(f"{what} has pos and fromto; expected one of them.")
    ends = np.array(numbers(wrong, what, element, "fromto", 6, (), most=FARTHEST)).reshape(2, 3)
    along = ends[0] - ends[1]
    length = float(np.linalg.norm(along))
    if not length >= SMALLEST:
        wrong.stop(f"{what} has a fromto whose ends are {length:g} m apart; expected {SMALLEST:g} m or more.")
    radius = size[:1] if len(size) else np.zeros(1)
    across = radius if SIZES[kind] == 2 else np.repeat(radius, 2)
    return np.append(across, length / 2.0), Pose(z_along(along / length), ends.mean(axis=0))
