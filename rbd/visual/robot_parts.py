"""What the robot looks like: its meshes as triangles, or a skeleton where its file has none."""

from __future__ import annotations

import warnings
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import coal
import numpy as np
import pinocchio as pin

from rbd.cones import Array
from rbd.errors import ModelWarning
from rbd.visual import shapes
from rbd.visual.collada import read_collada
from rbd.visual.colors import SKELETON_COLOR
from rbd.visual.shapes import Mesh

if TYPE_CHECKING:
    from rbd.robot import Robot


@dataclass(frozen=True, eq=False, slots=True)
class RobotPart:
    """A rigid piece of the robot.

    Attributes:
        name: Name of the geometry in the robot's file, or of the skeleton's joint.
        joint: Number of the joint that carries it; 0 is the world.
        placement: X_JG, pose of the piece in its joint's frame.
        mesh: Its triangles in its own frame [m].
        color: '#rrggbb'.
        opacity: 1 is solid.
    """

    name: str
    joint: int
    placement: pin.SE3
    mesh: Mesh
    color: str
    opacity: float


def robot_parts(robot: Robot) -> list[RobotPart]:
    """The pieces to draw: the visual geometry, or the collision geometry, or else a skeleton.

    Meshes come as the triangles that Coal loaded, and those of Collada files as `read_collada` gives them, in the
    colour of the URDF, or else of the Collada file. Textures are not used. Infinite planes are left out.
    """
    for geometry in (robot.visual_model, robot.collision_model):
        parts = [part for obj in geometry.geometryObjects for part in _parts_of(obj)]
        if parts:
            return parts
    return skeleton(robot.model)


def _parts_of(obj: pin.GeometryObject) -> list[RobotPart]:
    if isinstance(obj.geometry, coal.Plane | coal.Halfspace):
        return []
    given = np.asarray(obj.meshColor, float)
    pieces = _collada_pieces(obj)
    if not pieces:
        mesh = triangles(obj.geometry)
        pieces = [] if mesh is None or len(mesh.faces) == 0 else [(mesh, given)]
    if not pieces:
        kind = type(obj.geometry).__name__
        warnings.warn(ModelWarning(f"geometry {obj.name!r} ({kind}) has no triangles and is not drawn."), stacklevel=2)
    return [
        RobotPart(obj.name, obj.parentJoint, obj.placement, mesh, _hexadecimal(rgba), float(np.clip(rgba[3], 0.0, 1.0)))
        for mesh, rgba in pieces
    ]


def _hexadecimal(rgba: Array) -> str:
    # Pure black shows no shape under any light, so it is lifted to a dark grey.
    red, green, blue = (int(round(255 * c)) for c in np.clip(rgba[:3], 0.12, 1.0))
    return f"#{red:02x}{green:02x}{blue:02x}"


def _collada_pieces(obj: pin.GeometryObject) -> list[tuple[Mesh, Array]]:
    """Pieces of a Collada mesh with their colours; nothing for other files, and for those that cannot be read."""
    if Path(obj.meshPath).suffix.lower() != ".dae":
        return []
    try:
        read = read_collada(obj.meshPath)
    except (ValueError, KeyError, IndexError, StopIteration, OSError, ElementTree.ParseError):
        return []
    given = np.asarray(obj.meshColor, float)
    pieces = []
    for piece in read:
        sized = Mesh(piece.mesh.vertices * np.asarray(obj.meshScale), piece.mesh.faces)
        # A colour in the URDF goes before those in the mesh file.
        own = given if piece.rgba is None or (obj.overrideMaterial and given[:3].any()) else np.array(piece.rgba)
        if len(sized.faces):
            pieces.append((shapes.creased(sized), own))
    return pieces


def triangles(geometry: coal.CollisionGeometry) -> Mesh | None:
    """Triangles of a Coal geometry in its own frame [m]; None for kinds that have none (planes, octrees)."""
    match geometry:
        case coal.BVHModelBase():
            # A coal.Triangle has no iterator: it must be read entry by entry (0.7 us each).
            rows = map(geometry.tri_indices, range(geometry.num_tris))
            faces = np.array([(t[0], t[1], t[2]) for t in rows], int).reshape(-1, 3)
            return shapes.creased(Mesh(np.array(geometry.vertices()), faces))
        case coal.Box():
            return shapes.box(np.asarray(geometry.halfSide))
        case coal.Sphere():
            return shapes.ball(geometry.radius)
        case coal.Ellipsoid():
            unit = shapes.ball(1.0)
            return Mesh(unit.vertices * np.asarray(geometry.radii), unit.faces)
        case coal.Cylinder():
            return shapes.cylinder(geometry.radius, 2.0 * geometry.halfLength)
        case coal.Capsule():
            return shapes.capsule(geometry.radius, 2.0 * geometry.halfLength)
        case coal.Cone():
            h = geometry.halfLength
            return shapes.revolved([(0.0, -h), (geometry.radius, -h), (0.0, h)])
        case coal.ConvexBase():
            return _hull_mesh(np.array([geometry.point(i) for i in range(geometry.num_points)]))
    return None


def _hull_mesh(points: Array) -> Mesh | None:
    from scipy.spatial import ConvexHull, QhullError

    try:
        return shapes.creased(Mesh(points, ConvexHull(points).simplices))
    except QhullError:
        return None


def skeleton(model: pin.Model) -> list[RobotPart]:
    """Bones from each joint to its children and to its farthest frame, with a ball on every joint.

    Lengths are the model's; thickness is not, it is a fiftieth of the longest bone.
    """
    bones: dict[int, list[Array]] = {i: [] for i in range(model.njoints)}
    for child in range(1, model.njoints):
        if model.parents[child] > 0:
            bones[model.parents[child]].append(np.array(model.jointPlacements[child].translation))
    for joint in range(1, model.njoints):
        ends = [np.array(f.placement.translation) for f in model.frames if f.parentJoint == joint]
        ends += [np.array(model.inertias[joint].lever)] if not bones[joint] else []
        if not bones[joint] and ends:
            bones[joint].append(max(ends, key=lambda p: float(np.linalg.norm(p))))
    longest = max((float(np.linalg.norm(b)) for each in bones.values() for b in each), default=0.0) or 1.0
    radius = longest / 50.0
    parts = []
    for joint in range(1, model.njoints):
        pieces = [shapes.ball(1.8 * radius)]
        pieces += [shapes.tube(np.array([np.zeros(3), end]), radius=radius) for end in bones[joint]]
        parts.append(
            RobotPart(model.names[joint], joint, pin.SE3.Identity(), shapes.joined(pieces), SKELETON_COLOR, 1.0)
        )
    return parts
