"""The bodies of an MJCF file: the tree, what each weighs, its joints, shapes and sites."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from rbd.model.mjcf.attributes import check_attributes
from rbd.model.mjcf.defaults import ORIENTATIONS, Defaults
from rbd.model.mjcf.joints import Joint, check_joints, read_joint
from rbd.model.mjcf.meshes import Meshes
from rbd.model.mjcf.poses import Pose, at_rest, pose
from rbd.model.mjcf.settings import Settings, numbers, truth
from rbd.model.mjcf.shapes import Shape, read_shape, weight
from rbd.model.mjcf.solids import Solid, joined
from rbd.model.urdf import LIGHTEST, Complaints

Element = ElementTree.Element
WORLD = "world"


@dataclass(frozen=True, eq=False)
class Body:
    """A body, or the world.

    Attributes:
        name: Its own, or one made of its number.
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
    """What belongs to a body, frames carried out: (element, pose of what is around it, default class)."""

    bodies: list[tuple[Element, Pose, str | None]] = field(default_factory=list)
    others: dict[str, list[tuple[Element, Pose]]] = field(default_factory=dict)


@dataclass(frozen=True)
class BodyReader:
    """Reads the bodies of a file; what is wrong is said with the file's name."""

    wrong: Complaints
    defaults: Defaults
    settings: Settings
    meshes: Meshes

    def read(self, root: Element) -> list[Body]:
        """The world and all bodies, each after its parent, branch by branch in the order of the file.

        Raises:
            ModelError: naming what is wrong or not read.
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
        while stack:  # elements in their order: frames are opened where they stand
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
        """Its mass and moments not below the least ones of the file, and balanced if the file asks for it."""
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
