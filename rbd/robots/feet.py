"""Feet of a robot as contacts: by frames, as a user registers them, or from the flat undersides of collision shapes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import coal
import numpy as np
import pinocchio as pin

from rbd.arrays import Array, largest_first
from rbd.constraints.contact import Contact, PointContact, SurfaceContact
from rbd.constraints.convex.convex_shapes import parts_of
from rbd.constraints.convex.polygons import RIM_CORNERS, area_of, convex_hull
from rbd.constraints.round_feet import Ball, with_ball
from rbd.constraints.surface import UP, On, Surface, surfaces_of
from rbd.errors import DuplicateName, InputError, ModelError
from rbd.errors.inputs import listed_items
from rbd.model.checked_model import CheckedModel
from rbd.model.meshes import Geometry, solid_hull
from rbd.model.state import State
from rbd.problem.cones import Cone
from rbd.problem.ground import TOUCHES
from rbd.robots.catalogue import Foot


def contacts_of(
    feet: Sequence[Foot], friction: float | Cone | None, facets: int, on: On | Mapping[str, On], at: State | None = None
) -> list[SurfaceContact | PointContact]:
    """Feet as contacts; see `rbd.Robot.feet`."""
    planes = surfaces_of([foot.name for foot in feet], on)
    return [_contact(foot, friction, facets, planes[foot.name], at) for foot in feet]


def _contact(
    foot: Foot, friction: float | Cone | None, facets: int, on: Surface, at: State | None
) -> SurfaceContact | PointContact:
    name, frame = foot.name, foot.frame
    if foot.kind == "point":
        point = PointContact(name, frame, offset=foot.translation, friction=friction, facets=facets, on=on)
        if foot.ball is None:
            return point
        if at is not None:
            lowest = foot.ball.lowest(at.frame(frame).X_WF.rotation, np.asarray(point.normal))
            point = PointContact(name, frame, offset=lowest, friction=friction, facets=facets, on=on)
        return with_ball(point, foot.ball)
    X_FP = pin.SE3(foot.rotation, np.array(foot.translation))
    return SurfaceContact(name, frame, corners=foot.corners, placement=X_FP, friction=friction, facets=facets, on=on)


def soles_at(robot: CheckedModel, collision: Geometry, frames: Sequence[str], at: State) -> tuple[Foot, ...]:
    """The flat undersides of some frames' bodies; see `rbd.Robot.soles_from_collision`.

    Raises:
        InputError: not a list of names.
        FrameNotFound: with the nearest names.
        ModelError: a foot without collision shapes, or with fewer than three points of contact.
    """
    given = listed_items("frames", frames, "a list of frames' names, one a foot")
    soles = {frame: sole_of(robot, collision, frame, at) for frame in given}
    return tuple(_foot(frame, frame, sole.X_FP, sole.corners) for frame, sole in soles.items())


def registered(robot: CheckedModel, collision: Geometry, feet: Sequence[str | Contact], at: State) -> tuple[Foot, ...]:
    """Feet as frames or contacts, checked; see `rbd.load_robot`.

    Args:
        robot: The robot.
        collision: Its collision geometry.
        feet: Frames, or contacts at one point or at three or more.
        at: A state in which the feet are down.

    Raises:
        InputError: other objects, an empty list, edges.
        DuplicateName: two feet have one name.
        FrameNotFound: with the nearest names.
        ModelError: a frame's body has no collision shapes, or stands on an edge.
    """
    if isinstance(feet, str | Mapping) or hasattr(feet, "rows") or not np.iterable(feet) or not len(found := list(feet)):
        raise InputError(
            f"feet is {feet!r:.80}; expected a list of frames' names, ['left_ankle', 'right_ankle'], or of contacts, "
            "rbd.SurfaceContact(name, frame, ...)."
        )
    out: list[Foot] = []
    for each in found:
        if isinstance(each, str):
            foot = _of_frame(robot, collision, each, at)
        elif isinstance(each, Contact):
            foot = _of_contact(robot, each)
        else:
            raise InputError(f"feet has {each!r:.80}; expected a frame's name or a contact, rbd.SurfaceContact(...).")
        if any(foot.name == other.name for other in out):
            raise DuplicateName(f"two feet are called {foot.name!r:.80}; give each its own name.")
        out.append(foot)
    return tuple(out)


def _of_frame(robot: CheckedModel, collision: Geometry, frame: str, at: State) -> Foot:
    found = underside_of(robot, collision, frame, at)
    if len(found.corners) == 2:
        raise ModelError(
            f"the body of frame {frame!r:.80} of {robot.name} stands on an edge. Give its foot as a contact: "
            "rbd.SurfaceContact(name, frame, corners=..., placement=...)."
        )
    foot = _foot(frame, frame, found.X_FP, found.corners)
    return foot if foot.kind == "sole" else _rounded(foot, _shapes(robot, collision, frame), at)


def _rounded(foot: Foot, shapes: Sequence[tuple[coal.CollisionGeometry, pin.SE3]], at: State) -> Foot:
    """The foot with the ball whose lowest points have the heights of the shapes' along directions near to down, at its point.

    That is u c + r = max u p over the shapes' points p, for unit vectors u: exact of balls and of the ends of capsules, by
    least squares of meshes and ellipsoids. The same foot where it misses a height by a millimetre, or is that of a corner.
    """
    R_WF = at.frame(foot.frame).X_WF.rotation
    down = -R_WF[2]
    u = down + np.tan(_CAP) * _DISK @ np.linalg.svd(down[None])[2][1:]
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    heights = np.array([(_points(shapes, each) @ each).max() for each in u])
    *centre, r = np.linalg.lstsq(np.column_stack([u, np.ones(len(u))]), heights)[0]
    ball = Ball((float(centre[0]), float(centre[1]), float(centre[2])), float(r))
    if r < TOUCHES or np.abs(u @ centre + r - heights).max() > TOUCHES:
        return foot
    x, y, z = ball.lowest(R_WF, UP).tolist()
    return replace(foot, translation=(x, y, z), ball=ball)


def _of_contact(robot: CheckedModel, contact: Contact) -> Foot:
    robot.site(contact.frame)
    if len(contact.corners) == 2:
        raise InputError(f"foot {contact.name!r:.80} is an edge; expected rbd.SurfaceContact or rbd.PointContact.")
    return _foot(contact.name, contact.frame, contact.placement, contact.corners)


def _foot(name: str, frame: str, X_FP: pin.SE3, corners: Array) -> Foot:
    """A foot of some corners in the axes of its patch, shape (k, 2) or (k, 3): a point, or a sole."""
    if len(corners) == 1:
        x, y, z = X_FP.act(np.pad(corners[0], (0, 3 - corners.shape[1]))).tolist()
        return Foot(name, frame, "point", (x, y, z))
    x, y, z = X_FP.translation.tolist()
    roll, pitch, yaw = pin.rpy.matrixToRpy(X_FP.rotation).tolist()
    return Foot(name, frame, "sole", (x, y, z), (roll, pitch, yaw), tuple(tuple(corner) for corner in corners.tolist()))


MOST_LEAN = float(np.cos(np.radians(20.0)))
"""An underside inclined more than this to the horizontal is not one."""
MOST_CORNERS = 8
AREA_LOST = 0.02
"""Corners are left out until this share of the area would go, and further while there are more than `MOST_CORNERS`."""
LEAST_WIDTH_M = 1e-3
ROUND_WIDTH_M = 0.03
ROUND_SHARE = 0.5
"""A narrow patch that has less than this share of its area in its lowest quarter of height is the bottom of a ball."""
_CAP = np.radians(30.0)
"""A ball is fitted to directions up to this from down."""
_DISK = np.array([(0.0, 0.0), *((x * np.cos(a), x * np.sin(a)) for x in (0.5, 1.0) for a in np.arange(12) * np.pi / 6.0)])
"""Places in a disk of radius 1, shape (25, 2)."""


@dataclass(frozen=True, eq=False, slots=True)
class Underside:
    """The flat underside of a foot.

    Attributes:
        X_FP: From the foot's frame to the patch: z out of the ground, x along the frame's axis that points most along
            world x, origin at the middle of the rectangle around the corners.
        corners: (x, y) in the patch, counterclockwise, shape (k, 2) [m]; fewer than three where it is a point or an edge.
    """

    X_FP: pin.SE3
    corners: Array


def sole_of(robot: CheckedModel, collision: Geometry, frame: str, state: State) -> Underside:
    """The underside of the body that carries a frame, with at least three corners. Arguments as for `underside_of`.

    Raises:
        FrameNotFound: with the nearest names.
        ModelError: no collision shapes there, or none that are flat below.
    """
    found = underside_of(robot, collision, frame, state)
    if len(found.corners) < 3:
        points = [found.X_FP.act(np.array([x, y, 0.0])) for x, y in found.corners]
        offsets = " and ".join("(" + ", ".join(f"{x:.4g}" for x in np.round(point, 6) + 0.0) + ")" for point in points)
        what = "an edge" if len(points) > 1 else "a point"
        raise ModelError(
            f"the body of frame {frame!r} of {robot.name} touches level ground with {what}, no area. Use "
            f"rbd.PointContact(name, {frame!r}, offset=...) at {offsets}, or give a State in which its sole is down: "
            "soles_from_collision(frames, at=state)."
        )
    return found


def underside_of(robot: CheckedModel, collision: Geometry, frame: str, state: State) -> Underside:
    """The underside of the body that carries a frame: an area, or an edge or a point, with fewer than three corners.

    Args:
        robot: The robot.
        collision: Its collision geometry; boxes that replace meshes do not count.
        frame: Name of the frame.
        state: The standing robot, which gives the vertical.

    Raises:
        FrameNotFound: with the nearest names.
        ModelError: no collision shapes there.
    """
    shapes = _shapes(robot, collision, frame)
    try:
        return flat_underside(shapes, state.frame(frame).X_WF.rotation)
    except ModelError as error:
        raise ModelError(f"no sole for frame {frame!r} of {robot.name}: {error}. {_by_hand(frame)}.") from None


def _shapes(robot: CheckedModel, collision: Geometry, frame: str) -> list[tuple[coal.CollisionGeometry, pin.SE3]]:
    """Collision shapes of the body that carries a frame, with their poses in it; boxes that replace meshes do not count."""
    joint, X_JF = robot.site(frame)
    body = [obj for obj in collision.model.geometryObjects if obj.parentJoint == joint]
    shapes = [(obj.geometry, X_JF.actInv(obj.placement)) for obj in body if obj.name not in collision.stand_ins]
    if not shapes:
        why = "its collision meshes cannot be had" if body else "its file gives no collision shape to that body"
        raise ModelError(f"no sole for frame {frame!r} of {robot.name}: {why}. {_by_hand(frame)}.")
    return shapes


def _by_hand(frame: str) -> str:
    return f"Give the corners: rbd.SurfaceContact(name, {frame!r}, corners=..., placement=...)"


def flat_underside(
    shapes: Iterable[tuple[coal.CollisionGeometry, pin.SE3]], R_WF: Array, *, tolerance: float = 2e-3
) -> Underside:
    """The flat part of some shapes that faces the ground.

    It is the convex hull of all points within `tolerance` of the lowest plane. That plane is level; but if the shapes are
    flat along another within 20 degrees of it, with a tenth more area, the foot is taken to lean and that one is meant. The
    polygon is inscribed: corners that add little are left out, round edges become chords.

    Args:
        shapes: Geometries with their poses in the foot's frame F.
        R_WF: Orientation of F, shape (3, 3): gives the vertical.
        tolerance: Height above the lowest point that still counts as flat [m].

    Raises:
        ModelError: none of the shapes has points (planes, height fields).
    """
    shapes = list(shapes)
    level = -R_WF[2]
    points = _points(shapes, level)
    if len(points) == 0:
        raise ModelError("no collision shape that has points")
    best, most = level, 0.0
    for i, down in enumerate([level, *_facets(points, level)]):
        area = area_of(_lowest(_points(shapes, down), _axes(down, R_WF), tolerance)[0])
        if area > most * (1.0 if i == 0 else 1.1):
            best, most = down, area
    axes = _axes(best, R_WF)
    points = _points(shapes, best)
    hull, height = _lowest(points, axes, tolerance)
    if len(hull) > 2 and _width(hull) < ROUND_WIDTH_M:
        bottom, _ = _lowest(points, axes, tolerance / 4.0)
        if area_of(bottom) < ROUND_SHARE * area_of(hull):
            hull = bottom[:1] if len(bottom) < 3 else bottom.mean(axis=0)[None]
    hull = _simplified(hull)
    if len(hull) > 2 and _width(hull) < LEAST_WIDTH_M:
        along = np.linalg.svd(hull - hull.mean(axis=0))[2][0]
        hull = hull[[(hull @ along).argmin(), (hull @ along).argmax()]]
    middle = (hull.min(axis=0) + hull.max(axis=0)) / 2.0
    return Underside(pin.SE3(axes, axes @ [*middle, height]), hull - middle)


def _axes(down: Array, R_WF: Array) -> Array:
    """R_FP: z against `down`, x along the axis of F that points most along world x."""
    z = -down / np.linalg.norm(down)
    forward = R_WF[0]  # world x in F
    forward = forward - (forward @ z) * z
    flat = np.eye(3) - np.outer(z, z)
    candidates = [sign * flat[i] for i in range(3) for sign in (1.0, -1.0) if np.linalg.norm(flat[i]) > 0.5]
    x = max(candidates, key=lambda axis: float(axis @ forward) / float(np.linalg.norm(axis)))
    x = x / np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def _lowest(points: Array, axes: Array, tolerance: float) -> tuple[Array, float]:
    """Hull (k, 2) of the points near the lowest plane, in patch axes, and that plane's height along z."""
    local = points @ axes
    height = float(local[:, 2].min())
    return convex_hull(local[local[:, 2] <= height + tolerance, :2]), height


def _facets(points: Array, level: Array) -> list[Array]:
    """Outward normals of the larger facets of the points' hull that face down."""
    try:
        hull = solid_hull(points)
    except ValueError:  # too few points, or all in one plane, as the lowest points of four balls are
        normal = np.linalg.svd(points - points.mean(axis=0))[2][-1] if len(points) > 2 else level
        normal = normal if normal @ level > 0.0 else -normal
        return [normal] if normal @ level > MOST_LEAN else []
    normals = hull.equations[:, :3]
    a, b, c = (points[hull.simplices[:, i]] for i in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    facing = np.flatnonzero(normals @ level > MOST_LEAN)
    return [normals[i] for i in facing[largest_first(area[facing])][:30]]


def _width(hull: Array) -> float:
    """The smallest width of a convex polygon."""
    edges = np.roll(hull, -1, axis=0) - hull
    across = np.column_stack([-edges[:, 1], edges[:, 0]]) / np.linalg.norm(edges, axis=1, keepdims=True)
    return float(np.ptp(hull @ across.T, axis=0).min())


def _simplified(hull: Array) -> Array:
    """The hull without the corners that contribute least area."""
    whole = area_of(hull)
    while len(hull) > 3:
        without = [np.delete(hull, i, axis=0) for i in range(len(hull))]
        best = max(without, key=area_of)
        if len(hull) <= MOST_CORNERS and area_of(best) < (1.0 - AREA_LOST) * whole:
            break
        hull = best
    return hull


def _points(shapes: Sequence[tuple[coal.CollisionGeometry, pin.SE3]], down: Array) -> Array:
    """Points in F that can be lowest, shape (n, 3) [m]: corners and vertices, and the lowest points of round shapes."""
    turned = ((_of_shape(geometry, X.rotation.T @ down) @ X.rotation.T + X.translation) for geometry, X in shapes)
    return np.concatenate([np.zeros((0, 3)), *turned])


def _of_shape(geometry: coal.CollisionGeometry, down: Array) -> Array:
    """Vertices, and the lowest points of round parts; of rims in place of their polygons 32 points, the lowest among them."""
    vertices, rounds, _ = parts_of(geometry)
    rims = [r.rim + i for r in rounds if r.rim >= 0 for i in range(RIM_CORNERS)]
    found = [np.delete(vertices, rims, axis=0)]
    angles = np.arctan2(down[1], down[0]) + 2.0 * np.pi * np.arange(32) / 32
    circle = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(32)])
    for r in rounds:
        far = r.root @ down
        found.append(r.centre + (r.reach * circle if r.rim >= 0 else (r.root @ far / np.linalg.norm(far))[None]))
    return np.concatenate(found)
