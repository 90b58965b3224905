"""Appearance of a robot: its meshes as triangles, or a skeleton if its file has none.

Collada files (.dae) are read here because the usual readers lose some: Meshcat drops parts of them silently, and Coal 3.0
joins the triangles of a part with several materials to the wrong vertices (ANYmal's trunk looks torn). The file's unit is
used, and its up axis too (iCub needs it), except of MeshLab: that writes Y_UP whatever the axes are, as on Go1, Borinot and
Hextilt.
"""

from __future__ import annotations

import warnings
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast
from weakref import WeakKeyDictionary

import coal
import numpy as np
import pinocchio as pin

from rbd.arrays import Array, cross_matrix
from rbd.errors import InputError, ModelWarning
from rbd.model.meshes import solid_hull
from rbd.model.urdf import grouped
from rbd.robots.carried import Carried, carried_by
from rbd.visual import shapes
from rbd.visual.kept_shapes import Piece, kept_pieces
from rbd.visual.shapes import Mesh, joined, outermost
from rbd.visual.style import COLLISION_COLOR, INERTIA_COLOR, SKELETON_COLOR, hexadecimal

if TYPE_CHECKING:
    from rbd.model.checked_model import CheckedModel
    from rbd.robots.robot import Robot

INERTIA_OPACITY = 0.55
COLLISION_OPACITY = 0.25
PLACEHOLDER = 5.0
"""Collision shapes wider than this many times the longest bone are omitted from a skeleton."""
EDGE = 0.015
"""Radius of an outline's bars, over its longest side."""
MOST_NAMED = 6
KEPT = ("name", "joint", "color", "opacity", "link", "missing")
"""Plain data of a piece."""
Element = ElementTree.Element
Rgba = tuple[float, float, float, float]


@dataclass(frozen=True, eq=False, slots=True)
class RobotPart:
    """A rigid piece of the robot.

    Attributes:
        name: Name of the geometry in the robot's file, or of the skeleton's joint.
        joint: Number of the joint that carries it; 0 is the world.
        placement: X_JG, pose of the piece in its joint's frame.
        mesh: Its triangles in its frame [m].
        color: '#rrggbb'.
        opacity: 1 is solid.
        link: Frame of the robot's file that carries it; empty of what is none of its shapes.
        missing: Whether it is an outline in place of a mesh that cannot be loaded.
    """

    name: str
    joint: int
    placement: pin.SE3
    mesh: Mesh
    color: str
    opacity: float
    link: str = ""
    missing: bool = False

    def looks_like(self, other: RobotPart) -> bool:
        """Whether another piece has the same place, look and mesh."""
        if (self.joint, self.color, self.opacity) != (other.joint, other.color, other.opacity):
            return False
        one, two = self.mesh, other.mesh
        same = one is two or (np.array_equal(one.vertices, two.vertices) and np.array_equal(one.faces, two.faces))
        return same and self.placement == other.placement


_DONE: WeakKeyDictionary[Robot, tuple[RobotPart, ...]] = WeakKeyDictionary()


def drawable(robot: CheckedModel) -> Robot:
    """The robot, which has shapes to draw.

    Raises:
        InputError: a bare model, which has none.
    """
    if not hasattr(type(robot), "visual_model") and not hasattr(robot, "visual_model"):  # the class first: it reads no mesh
        raise InputError(f"{robot.name!r} has no meshes: it is a bare model. Load the robot with rbd.load_robot.")
    return cast("Robot", robot)


def robot_parts(robot: Robot) -> tuple[RobotPart, ...]:
    """The pieces to draw: the visual geometry; without it a skeleton, inertia ellipsoids and the collision shapes.

    Meshes come as the triangles that Coal loaded, and those of Collada files as `read_collada` gives them, in the
    colour of the URDF, or else of the Collada file. Textures are not used. Infinite planes are left out.

    Raises:
        InputError: a bare model, which has no shapes.
    """
    if drawable(robot) not in _DONE:  # a second of work for Talos, and as many scenes as one likes
        pieces = kept_pieces(robot, "visual", lambda: [piece_of(part) for part in _made(robot)])
        held = [_box_of(thing, robot) for thing in carried_by(robot)]
        _DONE[robot] = (*(part_of(*piece) for piece in pieces), *held)
    return _DONE[robot]


def piece_of(part: RobotPart, **further: object) -> Piece:
    """A piece as it is kept, with further plain data."""
    told = {name: getattr(part, name) for name in KEPT}
    return told | further, part.mesh, part.placement


def part_of(told: Mapping[str, Any], mesh: Mesh, placement: pin.SE3) -> RobotPart:
    """The piece."""
    return RobotPart(placement=placement, mesh=mesh, **{name: told[name] for name in KEPT})


def frame_name(robot: CheckedModel, number: int) -> str:
    """Of a frame of its model by its number; empty if there is none."""
    return str(robot.model.frames[number].name) if number < len(robot.model.frames) else ""


def _made(robot: Robot) -> list[RobotPart]:
    drawn = robot.visual_model.geometryObjects
    lost: frozenset[str] = getattr(robot, "visual_stand_ins", frozenset())
    pieces = [(obj, _outlines(obj, robot) if obj.name in lost else _parts_of(obj)) for obj in drawn]
    if parts := [replace(part, link=frame_name(robot, obj.parentFrame)) for obj, some in pieces for part in some]:
        return parts
    shapes = [part for obj in robot.collision_model.geometryObjects for part in _parts_of(obj)]
    # A cylinder of 2 m about a humanoid's waist is a placeholder, and would hide the robot.
    widest = PLACEHOLDER * _longest(_bones(robot.model))
    glass = [
        replace(part, color=COLLISION_COLOR, opacity=COLLISION_OPACITY)
        for part in shapes
        if np.ptp(part.mesh.vertices, axis=0).max() < widest
    ]
    return skeleton(robot.model, _loop_ends(robot)) + inertia_ellipsoids(robot.model) + glass


def _box_of(thing: Carried, robot: Robot) -> RobotPart:
    """A carried object, fixed to the first hand."""
    joint, X_JH, _ = next(thing.parts(robot))
    return RobotPart(thing.name, joint, X_JH, shapes.box(0.5 * np.array(thing.size, float)), INERTIA_COLOR, 1.0)


def _loop_ends(robot: Robot) -> list[tuple[int, Array]]:
    """Where the loops of its file are closed: the joint of each body, and the point in its frame [m]."""
    named = [getattr(loop, end, None) for loop in robot.loops() for end in ("frame_a", "frame_b")]
    sites = [robot.site(frame) for frame in named if isinstance(frame, str)]
    return [(joint, np.array(X_JF.translation)) for joint, X_JF in sites]


def _outlines(obj: pin.GeometryObject, robot: Robot) -> list[RobotPart]:
    """Edges of boxes around the link's collision shapes; of the box in place of the mesh, where there is no such shape."""
    own = [shape for shape in robot.collision_model.geometryObjects if shape.parentFrame == obj.parentFrame]
    own = [shape for shape in own if shape.name not in robot.collision_stand_ins]
    made = [(shape, mesh) for shape in own or [obj] if (mesh := triangles(shape.geometry)) is not None and len(mesh.faces)]
    return [
        RobotPart(obj.name, shape.parentJoint, shape.placement, _box_edges(mesh.vertices), SKELETON_COLOR, 1.0, missing=True)
        for shape, mesh in made
    ]


def _box_edges(points: Array) -> Mesh:
    """Thin bars along the edges of the box around some points, shape (n, 3) [m]."""
    low, high = points.min(axis=0), points.max(axis=0)
    corners = np.where(np.array(list(np.ndindex(2, 2, 2)), bool), high, low)
    edges = [(i, i | bit) for i in range(8) for bit in (1, 2, 4) if not i & bit]
    radius = EDGE * float(np.max(high - low))
    return joined([shapes.tube(corners[[i, k]], radius) for i, k in edges])


def missing_note(parts: Sequence[RobotPart]) -> str:
    """Of which links the meshes are missing, for a legend; empty where none is."""
    links = list(dict.fromkeys(part.link for part in parts if part.missing))
    more = f" and {len(links) - MOST_NAMED} more" if len(links) > MOST_NAMED else ""
    return f"Outlines: the meshes of {', '.join(links[:MOST_NAMED])}{more} are missing." if links else ""


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
    # Pure black shows no shape under any light, so it is lifted to a dark grey.
    looks = [(mesh, hexadecimal(np.clip(rgba[:3], 0.12, 1.0)), float(np.clip(rgba[3], 0.0, 1.0))) for mesh, rgba in pieces]
    return [RobotPart(obj.name, obj.parentJoint, obj.placement, *look) for look in looks]


def _collada_pieces(obj: pin.GeometryObject) -> list[tuple[Mesh, Array]]:
    """Pieces of a Collada mesh with their colours; empty for other files, and for those that cannot be read."""
    if Path(obj.meshPath).suffix.lower() != ".dae":
        return []
    try:
        read = read_collada(obj.meshPath)
    except (ValueError, LookupError, StopIteration, RecursionError, OSError, ElementTree.ParseError):
        return []
    given = np.asarray(obj.meshColor, float)
    pieces = []
    for piece in read:
        sized = piece.mesh.scaled(np.asarray(obj.meshScale))
        # A colour in the URDF overrides those in the mesh file.
        own = given if piece.rgba is None or (obj.overrideMaterial and given[:3].any()) else np.array(piece.rgba)
        if len(sized.faces):
            pieces.append((shapes.creased(sized), own))
    return pieces


def triangles(geometry: coal.CollisionGeometry) -> Mesh | None:
    """Triangles of a Coal geometry in its frame [m]; None for kinds without (planes, octrees)."""
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
            return shapes.ball(1.0).scaled(np.asarray(geometry.radii))
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
    try:
        return shapes.creased(Mesh(points, solid_hull(points).simplices))
    except ValueError:
        return None


def inertia_ellipsoids(model: pin.Model) -> list[RobotPart]:
    """A uniform ellipsoid with the mass, centre and moments of inertia of each body; none for bodies without mass or inertia.

    Semi-axes a_i = sqrt(5 / (2 m) (I_1 + I_2 + I_3 - 2 I_i)). Unphysical moments of inertia make one of them imaginary: it is
    drawn as a twentieth of the longest. What an identity matrix in the file would make as large as the robot is cut: to
    0.7 times the body's own longest bone (a rod's is 0.65), or a third of the robot's longest.
    """
    bones = _bones(model)
    reach = _longest(bones)
    parts = []
    for joint in range(1, model.njoints):
        inertia = model.inertias[joint]
        moments = np.asarray(inertia.inertia)
        if not (0.0 < inertia.mass < np.inf and np.isfinite(moments).all()):
            continue
        I, R = np.linalg.eigh((moments + moments.T) / 2.0)
        squares = 2.5 / inertia.mass * (I.sum() - 2.0 * I)
        if squares.max() <= 0.0:
            continue
        most = 0.7 * max([reach / 3.0, *(float(np.linalg.norm(bone)) for bone in bones[joint])])
        axes = np.clip(np.sqrt(np.maximum(squares, squares.max() / 400.0)), 0.01 * reach, most)
        R[:, 0] *= np.linalg.det(R)  # right-handed
        name, placement = f"inertia of {model.names[joint]}", pin.SE3(R, np.array(inertia.lever))
        parts.append(RobotPart(name, joint, placement, shapes.ball(1.0).scaled(axes), INERTIA_COLOR, INERTIA_OPACITY))
    return parts


def skeleton(model: pin.Model, loop_ends: Sequence[tuple[int, Array]] = ()) -> list[RobotPart]:
    """Bones from each joint to its children, to its farthest frame and to where loops are closed; a ball on every joint.

    Lengths are the model's; thickness is not, it is a fiftieth of the longest bone. Two pivots or more on the ground are joined
    by a bar too.

    Args:
        model: The model.
        loop_ends: Joint, and point in its frame, where a loop is closed [m]; joint 0 is the ground.
    """
    bones = _bones(model)
    radius = _longest(bones) / 50.0
    parts = []
    for joint in range(1, model.njoints):
        pieces = [shapes.ball(1.8 * radius)]
        closed = [end for at, end in loop_ends if at == joint]
        pieces += [shapes.tube(np.array([np.zeros(3), end]), radius) for end in (*bones[joint], *closed)]
        parts.append(RobotPart(model.names[joint], joint, pin.SE3.Identity(), shapes.joined(pieces), SKELETON_COLOR, 1.0))
    rooted = [joint for joint in range(1, model.njoints) if model.parents[joint] == 0]
    pivots = [np.array(model.jointPlacements[joint].translation) for joint in rooted] + [p for at, p in loop_ends if at == 0]
    if len(pivots) > 1:
        bars = [shapes.tube(np.array([pivots[0], other]), radius) for other in pivots[1:]]
        parts.append(RobotPart("ground", 0, pin.SE3.Identity(), shapes.joined(bars), hexadecimal((0.6, 0.6, 0.6)), 1.0))
    return parts


def _bones(model: pin.Model) -> dict[int, list[Array]]:
    """From each joint, in its frame, to its children or to its farthest frame [m]."""
    bones: dict[int, list[Array]] = {i: [] for i in range(model.njoints)}
    for child in range(1, model.njoints):
        if model.parents[child] > 0:
            bones[model.parents[child]].append(np.array(model.jointPlacements[child].translation))
    for joint in range(1, model.njoints):
        if not bones[joint]:
            ends = [np.array(f.placement.translation) for f in model.frames if f.parentJoint == joint]
            ends.append(np.array(model.inertias[joint].lever))
            bones[joint].append(max(ends, key=lambda p: float(np.linalg.norm(p))))
    return bones


def _longest(bones: dict[int, list[Array]]) -> float:
    """Length of the longest bone [m]; 1 where all are points."""
    return max((float(np.linalg.norm(b)) for each in bones.values() for b in each), default=0.0) or 1.0


def hull_of(joint: int, parts: Sequence[RobotPart]) -> Array:
    """The outermost points of a joint's bodies, in its frame, shape (n, 3) [m]."""
    placed = [p.mesh.placed(p.placement.rotation, p.placement.translation).vertices for p in parts if p.joint == joint]
    return outermost(np.vstack(placed))


@dataclass(frozen=True, eq=False, slots=True)
class ColoredMesh:
    """Triangles of one colour; None where the file gives none, or a texture."""

    mesh: Mesh
    rgba: Rgba | None


def read_collada(path: str | Path) -> list[ColoredMesh]:
    """The pieces of a Collada file, z up [m], one a colour.

    Triangles, polygons without holes and lists of them are read, placed by the nodes' transforms. Skins, strips,
    library nodes, textures and transparency are not.

    Raises:
        ValueError, LookupError, StopIteration, RecursionError, OSError, ElementTree.ParseError: if the file is not what
            Collada says.
    """
    tree = ElementTree.parse(path).getroot()
    for element in tree.iter():
        element.tag = element.tag.rpartition("}")[2]
    named = {element.get("id", ""): element for element in tree.iter() if element.get("id")}
    nodes = [node for scene in tree.iter("visual_scene") for node in scene.findall("node")]
    found = [(rgba, mesh) for node in nodes for mesh, rgba in _of_node(node, _upright_metres(tree), named)]
    return [ColoredMesh(joined(meshes), rgba) for rgba, meshes in grouped(found).items()]


def _upright_metres(tree: Element) -> Array:
    """From the file's axes and unit to z up and metres, shape (4, 4)."""
    unit = tree.find("asset/unit")
    X = np.diag([1.0 if unit is None else float(unit.get("meter", 1.0))] * 3 + [1.0])
    by_meshlab = any("MeshLab" in (tool.text or "") for tool in tree.iter("authoring_tool"))
    if tree.findtext("asset/up_axis", "").strip() == "Y_UP" and not by_meshlab:
        X = np.array([[1.0, 0, 0, 0], [0, 0, -1.0, 0], [0, 1.0, 0, 0], [0, 0, 0, 1.0]]) @ X
    return X


def _of_node(node: Element, X: Array, named: dict[str, Element]) -> Iterator[tuple[Mesh, Rgba | None]]:
    for step in node:
        X = X @ _transform(step)
    for instance in node.findall("instance_geometry"):
        materials = {m.get("symbol"): m.get("target", "")[1:] for m in instance.iter("instance_material")}
        shape = named[instance.get("url", "")[1:]].find("mesh")
        for group in [] if shape is None else shape:
            if group.tag in ("triangles", "polylist", "polygons"):
                mesh = _triangles(group, named)
                placed = Mesh(mesh.vertices @ X[:3, :3].T + X[:3, 3], mesh.faces)
                yield placed, _color(materials.get(group.get("material")), named)
    for child in node.findall("node"):
        yield from _of_node(child, X, named)


def _transform(step: Element) -> Array:
    X = np.eye(4)
    if step.tag not in ("matrix", "translate", "rotate", "scale"):
        return X
    numbers = _numbers(step)
    if step.tag == "matrix":
        return numbers.reshape(4, 4)
    if step.tag == "translate":
        X[:3, 3] = numbers
    elif step.tag == "scale":
        X[:3, :3] = np.diag(numbers)
    else:
        K = cross_matrix(numbers[:3] / max(float(np.linalg.norm(numbers[:3])), 1e-300))
        c, s = np.cos(np.radians(numbers[3])), np.sin(np.radians(numbers[3]))
        X[:3, :3] = np.eye(3) + s * K + (1.0 - c) * K @ K
    return X


def _triangles(group: Element, named: dict[str, Element]) -> Mesh:
    inputs = [(i.get("semantic"), int(i.get("offset", 0)), i.get("source", "")[1:]) for i in group.findall("input")]
    stride = 1 + max(offset for _, offset, _ in inputs)
    at, source = next((offset, name) for semantic, offset, name in inputs if semantic == "VERTEX")
    position = next(i for i in named[source].findall("input") if i.get("semantic") == "POSITION")
    vertices = _numbers(_only(named[position.get("source", "")[1:]], "float_array")).reshape(-1, 3)
    runs = [_vertex_numbers(p, len(vertices), stride, at) for p in group.findall("p")]
    if group.tag != "polygons":
        numbers = np.concatenate([np.zeros(0, int), *runs])
        if group.tag == "triangles":
            return Mesh(vertices, numbers.reshape(-1, 3))
        runs = np.split(numbers, np.cumsum(_numbers(_only(group, "vcount")).astype(int))[:-1])
    fans = [(run[0], run[i], run[i + 1]) for run in runs for i in range(1, len(run) - 1)]
    return Mesh(vertices, np.array(fans, int).reshape(-1, 3))


def _vertex_numbers(p: Element, count: int, stride: int, at: int) -> Array:
    numbers = _numbers(p).reshape(-1, stride)[:, at]
    if not ((numbers >= 0) & (numbers < count)).all():
        raise ValueError(f"a <p> of a Collada file names vertices that are not among its {count}")
    return numbers.astype(int)


def _color(material: str | None, named: dict[str, Element]) -> Rgba | None:
    if material is None or material not in named:
        return None
    effect = named[material].find("instance_effect")
    color = None if effect is None else named[effect.get("url", "")[1:]].find(".//diffuse/color")
    if color is None:
        return None
    red, green, blue = (float(c) for c in _numbers(color)[:3])
    return red, green, blue, 1.0


def _only(element: Element, tag: str) -> Element:
    if (found := element.find(tag)) is None:
        raise ValueError(f"a <{element.tag}> of a Collada file has no <{tag}>")
    return found


def _numbers(element: Element) -> Array:
    return np.array((element.text or "").split(), float)
