"""Convex shapes of a robot's bodies, their round parts, and the points with which they can touch a surface.

A shape is its corners, its round parts, and its flat faces, all in the axes of its joint. A mesh counts as its
convex hull.

A round part (ball, rim of a cylinder, ellipsoid) gives its lowest point. Many points are reduced to a few.

A round part gives its lowest point. `up` is the unit normal of the surface below, in the body's axes; as the body turns, `up`
turns the other way at a rate that the caller gives, and the lowest point moves over the body at

    ball:       p = c - r up                                   p' = -r up'
    rim:        p = c - r e,  e = u / |u|,  u = up - (up . a) a    p' = -r e'
    ellipsoid:  p = c - Q up / s,  s = sqrt(up . Q up)         p' = -Q up' / s + Q up (up . Q up') / s^3
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Protocol

import coal
import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.constraints.convex.reduced_points import DIRECTIONS, MOST_POINTS, across, farthest, spread
from rbd.errors import ModelError

RIM_CORNERS = 8
"""Corners that replace a flat rim: a regular polygon in it, its edges up to 8 % of the radius inside."""
FLAT_M = 1e-5
"""Corners of a mesh this near to a face are on the face; of more than eight, eight are used."""
_BLOCK = 64
"""Faces whose distances to all corners are computed at once: for thousands the matrix would have 200 MB."""


@dataclass(frozen=True, eq=False)
class ConvexShape:
    """A convex shape fixed to a body.

    Its points are numbered: first the vertices, then the round parts.

    Attributes:
        name: Name of the shape in Pinocchio's geometry.
        joint: Index of its joint; 0 if fixed to the world.
        vertices: Corners, shape (n, 3) [m].
        rounds: Round parts.
        faces: Flat faces (N, d), N x <= d inside, shape (f, 4) [1, m].
        coal: The same for Coal's distances.
        X_JC: Pose of `coal` in the joint's axes.
        centre: Centre of a bounding ball, shape (3,) [m].
        reach: Radius of that ball [m].
    """

    name: str
    joint: int
    vertices: Array
    rounds: tuple[Round, ...]
    faces: Array
    coal: coal.CollisionGeometry
    X_JC: pin.SE3
    centre: Array = field(init=False)
    reach: float = field(init=False)

    def __post_init__(self) -> None:
        directions = np.vstack([np.eye(3), -np.eye(3)])
        ends = np.array([r.lowest(d) for d in directions for r in self.rounds]).reshape(-1, 3)
        points = np.vstack([self.vertices, ends[~np.isnan(ends[:, 0])]])
        centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
        balls = [float(np.linalg.norm(r.centre - centre)) + r.radius for r in self.rounds if isinstance(r, Ball | Rim)]
        ovals = [
            float(np.linalg.norm(r.centre - centre)) + float(np.sqrt(np.linalg.eigvalsh(r.Q)[-1]))
            for r in self.rounds
            if isinstance(r, Oval)
        ]
        away = np.linalg.norm(self.vertices - centre, axis=1).max(initial=0.0)
        object.__setattr__(self, "centre", centre)
        object.__setattr__(self, "reach", max([float(away), *balls, *ovals]))

    def low(self, up: Array, limit: float) -> tuple[list[int], Array]:
        """(numbers, points (k, 3) [m]) of the points not above `limit` [m] along `up`: those that can touch, see `spread`.

        Args:
            up: Unit vector in the body's axes, shape (3,).
            limit: p . up of the highest points that count.
        """
        numbers: list[int] = []
        points = self.vertices
        if len(points):
            height = points.dot(up)
            for r in self.rounds:
                if isinstance(r, Rim) and r.stands(up):
                    height[r.first : r.first + RIM_CORNERS] = np.inf
            at = (height <= limit).nonzero()[0]
            if len(at) > MOST_POINTS:
                at = at[spread(points[at], height[at], up)]
            numbers, points = at.tolist(), points[at]
        lowest = [(len(self.vertices) + i, r.lowest(up)) for i, r in enumerate(self.rounds)]
        more = [(i, p) for i, p in lowest if p.dot(up) <= limit]
        if not more:
            return numbers, points
        return numbers + [i for i, _ in more], np.array([*points, *(p for _, p in more)])

    def lowest(self, up: Array) -> float:
        """The smallest p . up of its points [m]."""
        rounds = np.array([r.lowest(up) @ up for r in self.rounds])
        return float(np.fmin.reduce(rounds, initial=(self.vertices @ up).min(initial=np.inf)))

    def wander(self, number: int, up: Array, rate: Array) -> Array:
        """How fast a point moves over the body while `up` changes at `rate` [1/s]: zero for a vertex, shape (3,) [m/s]."""
        i = number - len(self.vertices)
        return self.rounds[i].wander(up, rate) if i >= 0 else np.zeros(3)


def convex_shape(shape: pin.GeometryObject) -> ConvexShape:
    """The shape of a geometry object.

    Raises:
        ModelError: it is unbounded (a plane, a half-space), or no vertices.
    """
    X, geometry = pin.SE3(shape.placement), shape.geometry
    name, joint = str(shape.name), int(shape.parentJoint)

    def made(vertices: Array, rounds: Sequence[Round] = (), faces: Array | None = None) -> ConvexShape:
        placed = np.asarray(vertices, float).reshape(-1, 3) @ X.rotation.T + X.translation
        flat = np.zeros((0, 4)) if faces is None else faces
        N = flat[:, :3] @ X.rotation.T
        placed_faces = np.column_stack([N, flat[:, 3] + N @ X.translation])
        return ConvexShape(name, joint, placed, tuple(rounds), placed_faces, geometry, X)

    match geometry:
        case coal.BVHModelBase():
            return _hull(name, joint, np.array(geometry.vertices(), float).reshape(-1, 3) @ X.rotation.T + X.translation)
        case coal.ConvexBase():
            points = np.array([geometry.point(i) for i in range(geometry.num_points)], float).reshape(-1, 3)
            return _hull(name, joint, points @ X.rotation.T + X.translation)
        case coal.Box():
            half = np.asarray(geometry.halfSide, float)
            signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
            faces = np.column_stack([np.vstack([np.eye(3), -np.eye(3)]), np.tile(half, 2)])
            return made(signs * half, (), faces)
        case coal.Sphere():
            return made(np.zeros((0, 3)), [Ball(X.translation.copy(), float(geometry.radius))])
        case coal.Ellipsoid():
            Q = X.rotation @ np.diag(np.asarray(geometry.radii, float) ** 2) @ X.rotation.T
            return made(np.zeros((0, 3)), [Oval(X.translation.copy(), Q)])
        case coal.Capsule():
            ends = [X.act(np.array([0.0, 0.0, z])) for z in (-geometry.halfLength, geometry.halfLength)]
            return made(np.zeros((0, 3)), [Ball(end, float(geometry.radius)) for end in ends])
        case coal.Cylinder():
            h = float(geometry.halfLength)
            rims = [_rim(X, float(geometry.radius), z, i) for i, z in enumerate((-h, h))]
            caps = np.array([[0.0, 0.0, -1.0, h], [0.0, 0.0, 1.0, h]])
            return made(np.vstack([_polygon(float(geometry.radius), z) for z in (-h, h)]), rims, caps)
        case coal.Cone():
            h = float(geometry.halfLength)
            points = np.vstack([_polygon(float(geometry.radius), -h), [[0.0, 0.0, h]]])
            return made(points, [_rim(X, float(geometry.radius), -h, 0)], np.array([[0.0, 0.0, -1.0, h]]))
    raise ModelError(f"is a {type(geometry).__name__}, which has no points that could touch")


def _polygon(radius: float, z: float) -> Array:
    angles = 2.0 * np.pi * np.arange(RIM_CORNERS) / RIM_CORNERS
    return np.column_stack([radius * np.cos(angles), radius * np.sin(angles), np.full(RIM_CORNERS, z)])


def _rim(X: pin.SE3, radius: float, z: float, i: int) -> Rim:
    return Rim(X.act(np.array([0.0, 0.0, z])), X.rotation[:, 2].copy(), radius, i * RIM_CORNERS)


def _hull(name: str, joint: int, points: Array) -> ConvexShape:
    """The convex hull of a mesh, in the joint's axes; for a flat one all of its points, without faces."""
    if len(points) == 0:
        raise ModelError("is a mesh without vertices")
    corners, faces, solid = _solid(points.tobytes())
    return ConvexShape(name, joint, corners, (), faces, solid, pin.SE3.Identity())


@lru_cache(maxsize=64)
def _solid(data: bytes) -> tuple[Array, Array, coal.Convex]:
    """(corners, faces, hull) of points, cached for the next contacts of the same robot: a large mesh takes 50 ms."""
    from scipy.spatial import ConvexHull, QhullError  # import takes a tenth of a second

    points = np.frombuffer(data).reshape(-1, 3)
    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError):
        corners = np.unique(points, axis=0)
        return _frozen(corners), _frozen(np.zeros((0, 4))), coal.Convex(_vectors(corners), _triangles(np.zeros((0, 3), int)))
    number = np.full(len(points), -1)
    number[hull.vertices] = np.arange(len(hull.vertices))
    triangles = number[hull.simplices]
    corners = points[hull.vertices]
    # Coal wants corners counterclockwise as seen from outside; Qhull gives them in any order.
    a, b, c = (corners[triangles[:, i]] for i in range(3))
    inward = (np.cross(b - a, c - a) * hull.equations[:, :3]).sum(axis=1) < 0.0
    triangles[inward] = triangles[inward][:, ::-1]
    faces = np.unique(np.round(hull.equations, 9), axis=0, return_index=True)[1]
    equations = hull.equations[np.sort(faces)]
    faces = np.column_stack([equations[:, :3], -equations[:, 3]])
    solid = coal.Convex(_vectors(corners), _triangles(triangles))
    return _frozen(corners[_few(corners, faces)]), _frozen(faces), solid


def _frozen(array: Array) -> Array:
    """The array, which several shapes share."""
    array.flags.writeable = False
    return array


def _few(corners: Array, faces: Array) -> Array:
    """Indices of the corners, ascending; of large faces only the eight that represent them."""
    kept, dropped = set(), set()
    for block in np.split(faces, range(_BLOCK, len(faces), _BLOCK)):
        on_face = np.abs(corners @ block[:, :3].T - block[:, 3]) < FLAT_M
        for i in np.flatnonzero(np.count_nonzero(on_face, axis=0) > DIRECTIONS):
            own = np.flatnonzero(on_face[:, i])
            flat = across(block[i, :3]) @ corners[own].T
            few = own[farthest(flat - flat.mean(axis=1)[:, None], np.zeros(len(own)))]
            kept.update(few.tolist())
            dropped.update(own.tolist())
    return np.array([i for i in range(len(corners)) if i in kept or i not in dropped], int)


def _vectors(points: Array) -> coal.StdVec_Vec3s:
    out = coal.StdVec_Vec3s()
    out.extend(list(points))
    return out


def _triangles(triangles: Array) -> coal.StdVec_Triangle:
    out = coal.StdVec_Triangle()
    out.extend([coal.Triangle(int(i), int(j), int(k)) for i, j, k in triangles])
    return out


LEVEL_M = 1e-7
"""A rim whose lowest point is less than this below its centre is flat: all its points are equally low."""
STEEP = 0.1
"""A rim inclined by more than this (sine) touches only at its lowest point."""


class Round(Protocol):
    """A part of a shape that has one lowest point."""

    def lowest(self, up: Array) -> Array:
        """The lowest point, shape (3,) [m]; NaN where many are equally low."""

    def wander(self, up: Array, rate: Array) -> Array:
        """How fast the lowest point moves over the body while `up` changes at `rate` [1/s], shape (3,) [m/s]."""


@dataclass(frozen=True, eq=False)
class Ball:
    """A ball.

    Attributes:
        centre: Shape (3,) [m].
        radius: [m].
    """

    centre: Array
    radius: float

    def lowest(self, up: Array) -> Array:
        """Straight below the centre."""
        return self.centre - self.radius * up

    def wander(self, up: Array, rate: Array) -> Array:
        """Opposite to the rate of `up`."""
        return -self.radius * rate


@dataclass(frozen=True, eq=False)
class Rim:
    """The edge of a cylinder's or cone's flat end.

    Attributes:
        centre: Shape (3,) [m].
        axis: Unit vector, shape (3,).
        radius: [m].
        first: Number of the first of the shape's vertices that are on it.
    """

    centre: Array
    axis: Array
    radius: float
    first: int

    def lowest(self, up: Array) -> Array:
        """The lowest point in the rim's plane; NaN where the rim is flat."""
        u, length = self._towards(up)
        return self.centre - (self.radius / length) * u

    def wander(self, up: Array, rate: Array) -> Array:
        """Along the rim; fast where it is nearly flat, as for a coin that comes to rest; zero where it is flat."""
        u, length = self._towards(up)
        if np.isnan(length):
            return np.zeros(3)
        du, e = rate - (rate @ self.axis) * self.axis, u / length
        return np.asarray(-self.radius * (du - e * (e @ du)) / length)

    def _towards(self, up: Array) -> tuple[Array, float]:
        """(the part of `up` in the rim's plane, its length: NaN where the rim is flat)."""
        u = up - (up @ self.axis) * self.axis
        length = float(np.sqrt(u @ u))
        return u, np.nan if self.radius * length < LEVEL_M else length

    def stands(self, up: Array) -> bool:
        """Whether it is inclined so much that only its lowest point can touch."""
        return bool(1.0 - (up @ self.axis) ** 2 > STEEP**2)


@dataclass(frozen=True, eq=False)
class Oval:
    """An ellipsoid.

    Attributes:
        centre: Shape (3,) [m].
        Q: R diag(radii)^2 R^T, shape (3, 3) [m2].
    """

    centre: Array
    Q: Array

    def lowest(self, up: Array) -> Array:
        """The point with a horizontal tangent plane."""
        down, s = self._down(up)
        return self.centre - down / s

    def wander(self, up: Array, rate: Array) -> Array:
        """The derivative of `lowest`."""
        down, s = self._down(up)
        return np.asarray(-self.Q @ rate / s + down * (down @ rate) / s**3)

    def _down(self, up: Array) -> tuple[Array, float]:
        """(Q up, s)."""
        down = self.Q @ up
        return down, float(np.sqrt(up @ down))
