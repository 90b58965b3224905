"""What a page shows of a robot besides its meshes: names, frames, collision shapes; and where the camera stands."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import coal
import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_vector3
from rbd.constraints.terrain.terrain import Terrain
from rbd.errors import InputError, RbdError
from rbd.visual.kept_shapes import Piece, kept_pieces
from rbd.visual.marks.shown_force import ShownForce
from rbd.visual.robot_meshes import RobotPart, frame_name, part_of, piece_of, triangles
from rbd.visual.shapes import Mesh, joined, outermost, round_number
from rbd.visual.style import COLLISION_COLOR

if TYPE_CHECKING:
    from rbd.model.checked_model import CheckedModel
    from rbd.robots.robot import Robot

DIRECTIONS = 64
"""The hull that stands for the collision shape of a mesh begins with the outermost points in so many directions."""
CLOSE_M = 2e-3
"""Points farther outside than this are added to it, in so many rounds."""
ROUNDS = 3
HULL_OPACITY = 0.35
FRAME_LENGTH = 0.06
"""Length of the axes of a frame, over the robot's size."""
TURNS_DEG = (0, 30, -30, 60, -60, 90, -90, 120, -120, 150, -150, 180)
"""Where the camera may stand instead, about the vertical, when terrain hides a robot [degrees]."""
HIDDEN, LOOKED_AT = 0.05, 40
"""The share of a robot that terrain may hide, and how many of its points are looked at."""
_HULLS: WeakKeyDictionary[CheckedModel, tuple[CollisionPart, ...]] = WeakKeyDictionary()


@dataclass(frozen=True, eq=False, slots=True)
class CollisionPart:
    """A collision shape of the robot as it is drawn.

    Attributes:
        part: Its triangles.
        outside: How far points of the shape lie outside of what is drawn, at most [m].
        hull: Whether the convex hull of a mesh is drawn.
    """

    part: RobotPart
    outside: float
    hull: bool


def collision_parts(robot: Robot) -> tuple[CollisionPart, ...]:
    """The collision shapes to draw: boxes, cylinders, balls as they are, of meshes the convex hull of a few outermost points.

    Hulls are what contacts and self-collision are computed with. Those drawn have few corners, so that they add little to a
    page; `outside` tells what that costs. Shapes without triangles, and boxes that stand in for meshes that could not be
    loaded, are left out.
    """
    if robot not in _HULLS:
        made = kept_pieces(robot, "collision", lambda: [_piece(shape) for shape in _collision_parts(robot)])
        _HULLS[robot] = tuple(_shape(*piece) for piece in made)
    return _HULLS[robot]


def _piece(shape: CollisionPart) -> Piece:
    return piece_of(shape.part, outside=shape.outside, hull=shape.hull)


def _shape(told: Mapping[str, Any], mesh: Mesh, placement: pin.SE3) -> CollisionPart:
    return CollisionPart(part_of(told, mesh, placement), told["outside"], told["hull"])


def _collision_parts(robot: Robot) -> list[CollisionPart]:
    model = getattr(robot, "collision_model", None)
    stand_ins: frozenset[str] = getattr(robot, "collision_stand_ins", frozenset())
    found = []
    for shape in () if model is None else model.geometryObjects:
        if shape.name in stand_ins or isinstance(shape.geometry, coal.Plane | coal.Halfspace):
            continue
        outside, hull = 0.0, isinstance(shape.geometry, coal.BVHModelBase | coal.ConvexBase)
        if hull:
            mesh, outside = _small_hull(_points(shape.geometry))
        else:
            mesh = triangles(shape.geometry) or joined([])
        if len(mesh.faces):
            look = COLLISION_COLOR, HULL_OPACITY, frame_name(robot, shape.parentFrame)
            part = RobotPart(shape.name, shape.parentJoint, shape.placement, mesh, *look)
            found.append(CollisionPart(part, outside, hull))
    return found


def _points(geometry: coal.CollisionGeometry) -> Array:
    if isinstance(geometry, coal.BVHModelBase):
        return np.array(geometry.vertices(), float).reshape(-1, 3)
    return np.array([geometry.point(i) for i in range(geometry.num_points)], float).reshape(-1, 3)


def _small_hull(points: Array) -> tuple[Mesh, float]:
    """The hull of the outermost of some points, and how far others lie outside of it [m]; no triangles of a flat set."""
    from scipy.spatial import ConvexHull, QhullError  # import takes a tenth of a second

    corners = outermost(points, directions=DIRECTIONS) if len(points) else points
    for round_ in range(ROUNDS + 1):
        try:
            hull = ConvexHull(corners)
        except (QhullError, ValueError):
            return joined([]), 0.0
        planes = np.unique(np.round(hull.equations, 9), axis=0)
        far = points @ planes[:, :3].T + planes[:, 3]
        by = far.max(axis=0)
        if round_ == ROUNDS or by.max() < CLOSE_M:
            break
        corners = np.unique(np.vstack([corners, points[far.argmax(axis=0)[by > CLOSE_M]]]), axis=0)
    faces = np.array(hull.simplices)
    a, b, c = (corners[faces[:, i]] for i in range(3))
    inward = (np.cross(b - a, c - a) * hull.equations[:, :3]).sum(axis=1) < 0.0
    faces[inward] = faces[inward][:, ::-1]
    return Mesh(corners, faces), max(0.0, float(by.max()))


def bodies(robot: Robot, parts: Sequence[RobotPart]) -> str:
    """Names of what is drawn of a robot, for the page, as JSON: {link, joint, mass [kg]} of each part and collision shape."""
    told = [_body(robot, part.link or part.name, part.joint) for part in parts]
    for each, part in zip(told, parts, strict=True):
        each |= {"shape": "an outline: its mesh is missing"} if part.missing else {}
    shapes = []
    for shape in collision_parts(robot):
        what = f"convex hull of its collision mesh, to {1e3 * shape.outside:.2g} mm" if shape.hull else "its collision shape"
        shapes.append({**_body(robot, shape.part.link, shape.part.joint), "shape": what})
    return json.dumps({"bodies": told, "shapes": shapes})


def _body(robot: Robot, link: str, joint: int) -> dict[str, object]:
    mass = float(robot.model.inertias[joint].mass) if joint else 0.0
    return {"link": link, "joint": robot.model.names[joint] if joint else "", "mass": float(f"{mass:.5g}")}


def frames(robot: CheckedModel, data: pin.Data, contacts: Iterable[ShownForce], size: float) -> str:
    """The frames of joints and of contacts, for the page, as JSON.

    Args:
        robot: The robot.
        data: With the joints' poses.
        contacts: Whose axes are drawn too, z along the normal.
        size: Of the robot [m].
    """
    listed = []
    for joint in robot.joints.values():
        lines = [f"frame of the joint ({joint.words})", "x red, y green, z blue"]
        listed.append({"name": joint.name, "lines": lines, "at": _pose(data.oMi[joint.id]), "joint": joint.id})
    lines = ["frame of the contact", "x red, y green, z (normal) blue"]
    patches = {contact.name: contact.patch for contact in contacts if contact.patch is not None}
    poses = {name: pin.SE3(np.array(patch.axes), np.array(patch.point)) for name, patch in patches.items()}
    listed += [{"name": name, "lines": lines, "at": _pose(X), "joint": 0} for name, X in poses.items()]
    return json.dumps({"frames": {"length": float(f"{FRAME_LENGTH * size:.4g}"), "listed": listed}})


def _pose(X: pin.SE3) -> list[float]:
    return [round(float(x), 6) for x in pin.SE3ToXYZQUAT(X)]


def front_of(robot: CheckedModel, data: pin.Data, contacts: Iterable[ShownForce]) -> list[float]:
    """Where the robot's face is: a horizontal unit vector in W, shape (2,).

    That of the x axes of the soles in touch, else of those that are known of the robot, else of its floating base, else W's x.
    """
    toes = toes_of(contacts) or _known_toes(robot, data)
    if not toes and robot.model.njoints > 1 and robot.model.joints[1].nq == 7:
        toes = [data.oMi[1].rotation[:2, 0]]
    return np.round(ahead_of(toes), 4).tolist()


def toes_of(contacts: Iterable[ShownForce]) -> list[Array]:
    """The x axes of the soles among some contacts, along the ground in W, each of shape (2,)."""
    return [c.patch.axes[:2, 0] for c in contacts if c.patch is not None and len(c.corners) > 2]


def ahead_of(toes: Sequence[Array]) -> Array:
    """The common direction of some feet, shape (2,), of length 1; W's x where there are none, or they cancel."""
    ahead = np.sum(toes, axis=0) if toes else np.zeros(2)
    length = float(np.linalg.norm(ahead))
    return ahead / length if length > 1e-3 else np.array([1.0, 0.0])


def _known_toes(robot: CheckedModel, data: pin.Data) -> list[Array]:
    """The x axes of the robot's soles in W, along the ground, each of shape (2,)."""
    try:
        soles = robot.soles()  # type: ignore[attr-defined]
    except (RbdError, AttributeError):
        return []
    toes = []
    for sole in soles:
        frame = robot.model.frames[robot.model.getFrameId(sole.frame)]
        X_WS = data.oMi[frame.parentJoint] * frame.placement * (sole.placement or pin.SE3.Identity())
        toes.append(X_WS.rotation[:2, 0])
    return toes


FRONT_LEFT = (1.0, 0.62, 0.34)
"""From the robot to the camera, where no direction is given: ahead, left, up."""


def a_direction(seen_from: Sequence[float] | Array | None) -> list[float] | None:
    """A direction from the robot to the camera; None for None.

    Raises:
        InputError: if it is no vector, or straight up or down.
    """
    if seen_from is None:
        return None
    seen = as_vector3("seen_from", seen_from)
    if not seen[:2].any():
        raise InputError(f"seen_from is {seen_from}; expected (x, y, z) from robot to camera, not straight up or down.")
    return list(seen.tolist())


def seen_from(contacts: Iterable[ShownForce]) -> list[float]:
    """From the robot to the camera, in W: in front, on the left, above; the front is where the x axes of the soles point."""
    ahead = ahead_of(toes_of(contacts))
    left = np.array([-ahead[1], ahead[0]])
    return np.round([*(FRONT_LEFT[0] * ahead + FRONT_LEFT[1] * left), FRONT_LEFT[2]], 4).tolist()


def normal_of(robot: CheckedModel, q: Array) -> Array | None:
    """The unit normal in W, shape (3,), of the vertical plane in which a mechanism with loops moves; None of other robots.

    It points to where one sees W's x run to the right, as in figures of the x-z plane; of a plane across x its y.
    """
    if getattr(robot, "floating", True) or not robot.loops():
        return None
    joints = [joint for joint in robot.joints.values() if joint.nv == 1]
    J = pin.computeJointJacobians(robot.model, robot.model.createData(), np.asarray(q, float))
    axes = np.array([J[3:, joint.v.start] for joint in joints if joint.is_angle]).reshape(-1, 3)
    ways = np.array([J[:3, joint.v.start] for joint in joints if not joint.is_angle]).reshape(-1, 3)
    if not len(axes):
        return None
    normal = axes[0] / np.linalg.norm(axes[0])
    across = max(np.abs(np.cross(axes, normal)).max(), np.abs(ways @ normal).max(initial=0.0))
    if across > 1e-6 or abs(normal[2]) > 0.5:
        return None
    right = _right_of(normal)
    return np.asarray(normal if right[np.abs(right).argmax()] > 0.0 else -normal)


def _right_of(normal: Array) -> Array:
    """What is to the right for who looks against a normal."""
    return np.cross([0.0, 0.0, 1.0], normal)


def facing(normal: Array) -> list[float]:
    """A direction to the camera that shows a plane nearly straight, and its bars' thickness: from the left, and from above."""
    return np.round(normal - 0.15 * _right_of(normal) + [0.0, 0.0, 0.1], 4).tolist()


def unhidden(direction: Sequence[float] | Array, terrains: Sequence[Terrain], points: Array) -> list[float]:
    """A direction to the camera, turned about the vertical, if need be, until terrain hides little of some points in W."""
    given = [float(x) for x in direction]
    if not terrains or not len(points):
        return given
    size, shares = float(np.ptp(points, axis=0).max()), list[float]()
    P = points[np.unique(np.linspace(0, len(points) - 1, LOOKED_AT).astype(int))]
    turned = [pin.utils.rotate("z", float(np.radians(turn))) @ given for turn in TURNS_DEG]
    for way in turned:
        along = P[:, None] + np.outer(np.linspace(0.05, 4.0, 24) * size, way / np.linalg.norm(way))
        xy = along[..., :2].reshape(-1, 2)
        tops = np.max([solid.tops(xy) for terrain in terrains for solid in terrain.solids], axis=0).reshape(along.shape[:2])
        shares.append(float((along[..., 2] < tops - 1e-3 * size).any(axis=1).mean()))
        if shares[-1] <= HIDDEN:
            break
    return np.round(turned[int(np.argmin(shares))], 4).tolist()


def camera_and_ground(
    clouds: Sequence[Array], direction: Sequence[float], front: Sequence[float], *, opens: str, body: float, ground: bool
) -> str:
    """Camera, light and ground for a scene, in the page's format, as JSON.

    Args:
        clouds: Points in W that the camera is to see, each of shape (n, 3) [m].
        direction: From the robot to the camera, in W, shape (3,).
        front: The direction of the robot's front, in W.
        opens: The view in which the page opens, as the page names it.
        body: Size of the robot [m].
        ground: Whether the ground z = 0 is drawn.
    """
    fit = outermost(np.vstack(list(clouds)))
    low, high = fit.min(axis=0), fit.max(axis=0)
    across = float(np.linalg.norm(high - low))
    view = {
        "direction": list(direction),
        "front": list(front),
        "opens": opens,
        "fov": 30.0,
        "points": np.round(fit, 4).tolist(),
        "centre": np.round((low + high) / 2.0, 4).tolist(),
        "radius": round(across / 2.0, 4),
        # A motion over a long way has a coarser grid: no more than some hundred lines.
        "cell": round_number(max(0.2 * body, across / 60.0)) if ground else 0.0,
    }
    return json.dumps({"view": view})
