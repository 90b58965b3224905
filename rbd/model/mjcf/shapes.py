"""The shapes of an MJCF's bodies: kind, sizes, place, and what they weigh."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array
from rbd.model.mjcf.attributes import check_attributes
from rbd.model.mjcf.meshes import Meshes
from rbd.model.mjcf.poses import Pose, pose, z_along
from rbd.model.mjcf.settings import Settings, keyword, numbers, truth
from rbd.model.mjcf.solids import Solid, shape_solid
from rbd.model.urdf import FARTHEST, Complaints

Element = ElementTree.Element

SIZES = {"sphere": 1, "capsule": 2, "cylinder": 2, "ellipsoid": 3, "box": 3}
"""How many sizes a shape has."""
SMALLEST = 1e-9
"""Smallest size of a shape [m]."""
_FROM_TO = ("capsule", "cylinder", "ellipsoid", "box")


@dataclass(frozen=True, eq=False)
class Shape:
    """A shape on a body.

    Attributes:
        name: Its own; empty if it has none.
        kind: "sphere", "capsule", "cylinder", "ellipsoid", "box", "plane", "mesh" or "hfield".
        size: Radius; radius and half length; half lengths [m].
        X: Where it is on its body.
        mesh: Name of its mesh; empty if it has none.
        touches: Whether it takes part in contacts.
        group: Which group it is in.
        rgba: Its colour.
        element: With what its class says for it.
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
