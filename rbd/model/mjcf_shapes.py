"""The shapes of an MJCF file as a Pinocchio geometry, with small boxes in place of what cannot be had."""

from __future__ import annotations

from collections.abc import Callable

import coal
import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.errors import ModelError
from rbd.model.mjcf import Mjcf, Shape, Surface, convex_hull
from rbd.model.mjcf.bodies import WORLD

HIDDEN = 2
"""Shapes of groups above this are not drawn, as in MuJoCo's viewer."""
_PRIMITIVES: dict[str, Callable[..., coal.CollisionGeometry]] = {
    "sphere": lambda r: coal.Sphere(r),
    "capsule": lambda r, half: coal.Capsule(r, 2.0 * half),
    "cylinder": lambda r, half: coal.Cylinder(r, 2.0 * half),
    "ellipsoid": lambda x, y, z: coal.Ellipsoid(x, y, z),
    "box": lambda x, y, z: coal.Box(2.0 * x, 2.0 * y, 2.0 * z),
}


def mjcf_geometry(
    model: pin.Model, mjcf: Mjcf, kind: pin.GeometryType, usable: Callable[[str, str], None], stand_in_m: float
) -> tuple[pin.GeometryModel, frozenset[str], dict[str, str]]:
    """(geometry, names in it of boxes that stand in for meshes, {file or mesh: why it cannot be had}).

    Drawn is what MuJoCo's viewer shows at first, and what touches nothing; in contact is what can touch anything.

    Args:
        model: With the bodies of the file as frames.
        mjcf: The file.
        kind: pin.GeometryType.VISUAL or COLLISION.
        usable: Raises a ModelError for a mesh file that may not be opened, of its name and where it is.
        stand_in_m: Side of the boxes [m].
    """
    found = pin.GeometryModel()
    stand_ins: set[str] = set()
    refused: dict[str, str] = {}
    made: dict[str, coal.CollisionGeometry | None] = {}
    for body in mjcf.bodies:
        frame = 0 if body.name == WORLD else model.getFrameId(body.name, pin.FrameType.BODY)
        carrier = model.frames[frame]
        for i, shape in enumerate(body.shapes):
            shown = shape.group <= HIDDEN or not shape.touches
            if shape.kind == "hfield" or not (shape.touches if kind == pin.GeometryType.COLLISION else shown):
                continue
            name = shape.name or f"{body.name}Geom_{i}"
            while found.existGeometryName(name):
                name = f"{body.name}_{name}_{i}"
            geometry = _geometry(mjcf, shape, made, refused, usable)
            if geometry is None:
                geometry = coal.Box(stand_in_m, stand_in_m, stand_in_m)
                stand_ins.add(name)
            placement = carrier.placement * pin.SE3(shape.X.R, shape.X.p)
            colour = np.array(_colour(mjcf, shape))
            found.addGeometryObject(
                pin.GeometryObject(name, carrier.parentJoint, frame, placement, geometry, "", np.ones(3), False, colour)
            )
    return found, frozenset(stand_ins), refused


def _geometry(
    mjcf: Mjcf,
    shape: Shape,
    made: dict[str, coal.CollisionGeometry | None],
    refused: dict[str, str],
    usable: Callable[[str, str], None],
) -> coal.CollisionGeometry | None:
    """The shape itself; None where it cannot be had."""
    if shape.kind == "plane":
        return coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0)
    if not shape.mesh:
        return _PRIMITIVES[shape.kind](*(float(x) for x in shape.size))
    if shape.kind != "mesh":
        refused.setdefault(shape.mesh, f"is to be fitted by a {shape.kind}, which is not read")
        return None
    if shape.mesh not in made:
        file = mjcf.meshes.file(shape.mesh)
        made[shape.mesh] = None
        try:
            if file:
                usable(*file)
            made[shape.mesh] = _triangles(mjcf.meshes.load(shape.mesh))
        except (ModelError, ValueError) as error:
            refused[file[0] if file else shape.mesh] = str(error)
    return made[shape.mesh]


def _triangles(surface: Surface) -> coal.CollisionGeometry:
    faces = surface.faces if len(surface.faces) else convex_hull(surface.vertices)
    mesh = coal.BVHModelOBBRSS()
    mesh.beginModel(len(faces), len(surface.vertices))
    mesh.addVertices(np.ascontiguousarray(surface.vertices))
    mesh.addTriangles(np.ascontiguousarray(faces))
    mesh.endModel()
    return mesh


def _colour(mjcf: Mjcf, shape: Shape) -> Array | tuple[float, ...]:
    """Its own, its material's, or MuJoCo's grey."""
    name = shape.element.get("material")
    if shape.element.get("rgba") is not None or not name:
        return shape.rgba
    for material in mjcf.root.iterfind("asset/material"):
        if material.get("name") == name:
            words = material.get("rgba", "1 1 1 1").split()
            try:
                found = np.array([float(word) for word in words])
            except ValueError:
                return shape.rgba
            return found if found.shape == (4,) and np.isfinite(found).all() else shape.rgba
    return shape.rgba
