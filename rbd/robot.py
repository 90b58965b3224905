"""Robot and load_robot: a checked model with its postures, its feet and a way to stand."""

from __future__ import annotations

import os
import warnings
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterable, Sequence
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Literal

import numpy as np
import pinocchio as pin

from rbd import catalogue
from rbd.arrays import Array
from rbd.constraints.contact import PointContact, SurfaceContact
from rbd.errors import InputError, ModelError, ModelWarning, nearest
from rbd.model import CheckedModel
from rbd.posture import configuration, semantic_postures, stand
from rbd.state import State

Root = Literal["free_flyer", "fixed"]
MOST_COORDINATES = 400
"""A robot of more degrees of freedom is refused: one `pin.Data` of 400 takes 2 GB."""
MOST_LINKS = 1000
"""A URDF of more links is refused: the parsers recurse, and a chain of 4,000 ends the process."""


class Robot(CheckedModel):
    """A robot: its checked Pinocchio model, its postures and its feet.

    Made by `load_robot`. Beside what `CheckedModel` has:

    Attributes:
        urdf: The model file.
        root: "free_flyer" or "fixed".
        postures: {name: q, shape (nq,)}, from the SRDF and the catalogue.
    """

    def __init__(self, model: pin.Model, source: catalogue.Source, root: Root, passive: Iterable[str] = ()) -> None:
        super().__init__(model, passive=passive, name=source.name)
        self.source = source
        self.urdf = source.urdf
        self.root: Root = root
        found = {} if source.srdf is None else semantic_postures(self, source.srdf)
        for keyframe in model.referenceConfigurations:  # of an MJCF file
            found[keyframe.key()] = pin.normalize(model, keyframe.data())
        for name, angles in source.postures.items():
            found[name] = configuration(self, angles)
        for q in found.values():
            q.flags.writeable = False
        self.postures = MappingProxyType(found)

    def neutral(self) -> Array:
        """The configuration with every joint at zero, shape (nq,)."""
        return pin.neutral(self.model)

    def posture(self, name: str) -> Array:
        """A named configuration, copied, shape (nq,).

        Raises:
            InputError: with the nearest names.
        """
        if not isinstance(name, str) or name not in self.postures:
            raise InputError(f"no posture {name!r:.80} of {self.name}; {nearest(name, self.postures)}.")
        return self.postures[name].copy()

    def at(self, q: Array | str | None = None, v: Array | None = None) -> State:
        """The state at a configuration, a named posture, or the neutral one.

        Args:
            q: Configuration (nq,), the name of a posture, or None.
            v: Velocity (nv,); zero if not given.
        """
        return State(self, self.neutral() if q is None else self.posture(q) if isinstance(q, str) else q, v)

    def standing(self, posture: str | None = None) -> State:
        """At rest on its feet: soles (or points) on z = 0, the base turned so that they lie flat.

        A robot on point feet is then turned about them until its centre of mass is over its support. A fixed-base robot
        keeps its base.

        Args:
            posture: A name in `postures`; by default the one the catalogue names.

        Raises:
            InputError: an unknown posture.
            ModelError: neither a posture nor feet are known for this robot.
        """
        name = self.source.posture if posture is None else posture
        if name is None and len(self.postures) == 1:
            name = next(iter(self.postures))
        if not self.floating:
            return self.at() if name is None else self.at(self.posture(name))
        feet = self.feet(friction=None)
        if name is None:
            raise ModelError(
                f"no standing posture is known for {self.name}; {nearest('standing', self.postures)}. "
                "Name one, standing(posture), or build a State with your own q."
            )
        return State(self, stand(self, self.posture(name), feet))

    def soles(self, friction: float | None = 0.7, *, facets: int = 4) -> list[SurfaceContact]:
        """The soles of its feet as surface contacts, from the catalogue.

        Args:
            friction: Coulomb's coefficient; None for contacts that hold.
            facets: Facets of the corner pyramids in a QP.

        Raises:
            ModelError: no soles are known; a robot on point feet has `feet`.
        """
        feet = self.feet(friction, facets=facets)
        soles = [foot for foot in feet if isinstance(foot, SurfaceContact)]
        if len(soles) != len(feet):
            raise ModelError(f"{self.name} stands on points; use robot.feet() in place of soles().")
        return soles

    def feet(self, friction: float | None = 0.7, *, facets: int = 4) -> list[SurfaceContact | PointContact]:
        """Its feet as contacts: soles or points, from the catalogue. Arguments as `soles`.

        Raises:
            ModelError: no feet are known for this robot.
        """
        if not self.source.feet:
            raise ModelError(
                f"no feet are known for {self.name}: its file names none. Give your own: "
                "rbd.SurfaceContact(name, frame, half_lengths=(X, Y)) or rbd.PointContact(name, frame)."
            )
        out: list[SurfaceContact | PointContact] = []
        for foot in self.source.feet:
            if foot.kind == "point":
                point = PointContact(foot.name, foot.frame, offset=foot.translation, friction=friction, facets=facets)
                out.append(point)
                continue
            X_FP = pin.SE3(foot.rotation, np.array(foot.translation))
            out.append(
                SurfaceContact(
                    foot.name, foot.frame, corners=foot.corners, placement=X_FP, friction=friction, facets=facets
                )
            )
        return out

    @cached_property
    def visual_model(self) -> pin.GeometryModel:
        """Meshes and shapes to draw; empty, with a warning, where they cannot be read."""
        return self._geometry(pin.GeometryType.VISUAL)

    @cached_property
    def collision_model(self) -> pin.GeometryModel:
        """Collision shapes; empty, with a warning, where they cannot be read."""
        return self._geometry(pin.GeometryType.COLLISION)

    def _geometry(self, kind: pin.GeometryType) -> pin.GeometryModel:
        folders = [str(folder) for folder in self.source.package_dirs]
        try:
            if _element(self.urdf).tag == "mujoco":
                return pin.buildGeomFromMJCF(self.model, str(self.urdf), kind)
            return pin.buildGeomFromUrdf(self.model, str(self.urdf), kind, package_dirs=folders)
        except (ValueError, RuntimeError) as error:
            warnings.warn(
                f"the {kind.name.lower()} geometry of {self.name} is left out: {_first_line(error)} Give the folder "
                "above its packages: load_robot(..., package_dirs=[folder]).",
                ModelWarning,
                stacklevel=3,
            )
            return pin.GeometryModel()


def load_robot(
    name_or_path: str | os.PathLike[str],
    *,
    root: Root = "free_flyer",
    passive: Sequence[str] = (),
    package_dirs: Iterable[str | os.PathLike[str]] = (),
) -> Robot:
    """A robot by its short name, by the name of a file of example-robot-data, or by the path of a URDF or MJCF file.

    Args:
        name_or_path: "talos", "g1", "panda", "tiago_dual", "my/robot.urdf", ...
        root: "free_flyer" gives it six unactuated coordinates, position and quaternion; "fixed" welds its root link to the
            world (and so drops that link's mass). An MJCF file says itself whether it floats.
        passive: Joints that carry no motor.
        package_dirs: Folders that hold the packages of `package://` meshes.

    Raises:
        UnknownRobot: no such robot; the nearest names are in the message.
        JointNotFound: an unknown passive joint.
        ModelError: a missing or broken file.
        InputError: arguments of the wrong kind.
    """
    if root not in ("free_flyer", "fixed") or not isinstance(root, str):
        raise InputError(f"root is {root!r:.80}; expected 'free_flyer' or 'fixed'.")
    source = catalogue.find(name_or_path, package_dirs)
    element = _element(source.urdf)
    if element.tag == "mujoco":
        model = _mjcf_model(source.urdf, element, root)
        root = "free_flyer" if model.nv and model.joints[1].shortname() == "JointModelFreeFlyer" else "fixed"
    else:
        model = _urdf_model(source.urdf, element, root)
    if model.nv == 0:
        raise ModelError(f"nothing moves in {source.urdf.name}: it has no joints, and its root is fixed.")
    if model.nv > MOST_COORDINATES:
        raise ModelError(
            f"{source.urdf.name} has {model.nv} degrees of freedom; at most {MOST_COORDINATES} are taken: Pinocchio's data "
            f"would fill {32e-9 * model.nv**3:.0f} GB. Weld joints that do not move."
        )
    for name, inertia in zip(model.names, model.inertias, strict=True):
        if not np.isfinite(inertia.toDynamicParameters()).all() or inertia.mass < 0.0:
            raise ModelError(f"the bodies at joint {name!r} of {source.urdf.name} have a mass or inertia that is not physical.")
    return Robot(model, source, root, passive)


def _urdf_model(path: Path, element: ElementTree.Element, root: Root) -> pin.Model:
    _check_urdf(path.name, element)
    if root == "fixed":
        return _built(path, lambda: pin.buildModelFromUrdf(str(path)))
    name = "root_joint"
    while element.find(f"joint[@name='{name}']") is not None:  # Pinocchio would mix the two up
        name += "_"
    return _built(path, lambda: pin.buildModelFromUrdf(str(path), pin.JointModelFreeFlyer(), name))


def _mjcf_model(path: Path, element: ElementTree.Element, root: Root) -> pin.Model:
    model = _built(path, lambda: pin.buildModelFromMJCF(str(path)))
    if root == "fixed" and any(joint.shortname() == "JointModelFreeFlyer" for joint in model.joints):
        raise InputError(f"root='fixed' cannot weld {path.name}, whose own freejoint lets it float. Remove it from the file.")
    if element.find("equality/*") is not None:
        warnings.warn(f"the equality constraints of {path.name} are left out.", ModelWarning, stacklevel=4)
    return model


def _check_urdf(file: str, robot: ElementTree.Element) -> None:
    """Refuse what urdfdom and Pinocchio would crash on, or take without a word for another robot."""
    links = {link.get("name", ""): link for link in robot.findall("link")}
    if len(links) > MOST_LINKS:
        raise ModelError(f"{file} has {len(links)} links; at most {MOST_LINKS} are taken: its reader crashes on long chains.")
    above: dict[str, str] = {}
    for joint in robot.findall("joint"):
        name, kind = joint.get("name", ""), joint.get("type", "")
        parent, child = (e.get("link", "") if (e := joint.find(tag)) is not None else "" for tag in ("parent", "child"))
        for end in (parent, child):
            if end not in links:
                raise ModelError(f"{file}: joint {name!r} names a link {end!r}; {nearest(end, links)}.")
        if child in above:
            raise ModelError(f"{file}: link {child!r} has two parents, {above[child]!r} and {parent!r}; expected a tree.")
        above[child] = parent
        axis = joint.find("axis")
        if kind in ("revolute", "continuous", "prismatic", "planar") and axis is not None:
            if not any(_values(file, f"the axis of joint {name!r}", axis, "xyz")):
                raise ModelError(f"{file}: joint {name!r} is {kind}, and its axis is zero.")
    roots = [link for link in links if link not in above]
    if len(roots) != 1:
        found = ", ".join(map(repr, roots[:4])) or "none"
        raise ModelError(f"{file}: expected a tree with one root link, found {len(roots)}: {found}.")
    reached, last = set(roots), 0
    while len(reached) > last:
        last = len(reached)
        reached |= {child for child, parent in above.items() if parent in reached}
    if lost := [link for link in links if link not in reached]:
        raise ModelError(f"{file}: link {lost[0]!r} does not hang from the root {roots[0]!r}: its parents make a circle.")
    for name, element in links.items():
        _check_inertia(file, name, element)


def _check_inertia(file: str, link: str, element: ElementTree.Element) -> None:
    mass, inertia = element.find("inertial/mass"), element.find("inertial/inertia")
    if mass is not None and (kg := _values(file, f"the mass of link {link!r}", mass, "value")) and kg[0] < 0.0:
        raise ModelError(f"{file}: link {link!r} has a mass of {kg[0]:g} kg.")
    if inertia is None:
        return
    entry = [_values(file, f"the inertia of link {link!r}", inertia, "i" + ab) or [0.0] for ab in _PAIRS]
    xx, xy, xz, yy, yz, zz = (e[0] for e in entry)
    least = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])[0]
    if least < -1e-6:  # that of 1 g at 3 cm; rounded files are below it
        warnings.warn(
            f"{file}: link {link!r} has a principal moment of inertia of {least:.3g} kg m2; no body has. "
            "Forces and accelerations of what it belongs to are as wrong as that.",
            ModelWarning,
            stacklevel=5,
        )


_PAIRS = ("xx", "xy", "xz", "yy", "yz", "zz")


def _values(file: str, what: str, element: ElementTree.Element, attribute: str) -> list[float]:
    """The finite numbers of an attribute; none where it is not given."""
    text = element.get(attribute, "")
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        values = [np.nan]
    if not np.isfinite(values).all():
        raise ModelError(f"{file}: {what} is {text!r}; expected finite numbers.")
    return values


def _built(path: Path, build: Callable[[], pin.Model]) -> pin.Model:
    try:
        return build()
    except (ValueError, RuntimeError, IndexError) as error:
        raise ModelError(
            f"Pinocchio cannot build {path.name}: {_first_line(error)} What its parser printed on stderr says more."
        ) from None


def _element(path: Path) -> ElementTree.Element:
    """The first element of a robot's file."""
    try:
        element = ElementTree.parse(path).getroot()
    except (ElementTree.ParseError, UnicodeError, ValueError, LookupError, OSError) as error:
        raise ModelError(f"{path.name} cannot be read as XML: {error}.") from None
    if element.tag not in ("robot", "mujoco"):
        raise ModelError(f"{path.name} is no robot: its first element is <{element.tag}>; expected <robot> or <mujoco>.")
    return element


def _first_line(error: Exception) -> str:
    return str(error).strip().split("\n")[0].rstrip(".") + "."
