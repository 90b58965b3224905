"""Convex shapes of a robot's bodies, their round parts, and the points with which they can touch a surface.

A shape is its corners, its round parts, and its flat faces, all in the axes of its joint. A mesh counts as its
convex hull.

A round part (ball, rim of a cylinder, ellipsoid) gives its lowest point, which moves over the body as it turns: see
`rbd.constraints.plane_kernel`. Many points are reduced to a few.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache, lru_cache
from types import ModuleType

import coal
import numpy as np
import pinocchio as pin

from rbd.arrays import Array, locked
from rbd.constraints.convex.polygons import DIRECTIONS, MOST_POINTS, RIM_CORNERS, TOWARDS, across
from rbd.errors import ModelError
from rbd.model.meshes import flat_faces, solid_hull

LEVEL_M = 1e-7
"""A rim whose lowest point is less than this below its centre is flat: all its points are equally low."""
STEEP = 0.1
"""A rim inclined by more than this (sine) touches only at its lowest point."""
FLAT_M = 1e-5
"""Corners of a mesh this near to a face are on the face; of more than eight, eight are used."""
_UP = np.array([0.0, 0.0, 1.0])
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
    rounds: tuple[RoundPart, ...]
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
        away = [float(np.linalg.norm(self.vertices - centre, axis=1).max(initial=0.0))]
        away += [float(np.linalg.norm(r.centre - centre)) + r.reach for r in self.rounds]
        self.__dict__.update(centre=centre, reach=max(away))

    @property
    def corners(self) -> Array:
        """All corners, those too that stand for nothing among `vertices`, shape (k, 3) [m]."""
        return np.asarray(parts_of(self.coal)[0] @ self.X_JC.rotation.T + self.X_JC.translation)

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
                if r.rim >= 0 and r.stands(up):
                    height[r.rim : r.rim + RIM_CORNERS] = np.inf
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

    def extremes(self, ups: Array) -> Array:
        """`lowest` along several directions, shape (k, 3) [m]."""
        if self.rounds:
            return np.array([self.lowest(up) for up in ups])
        return np.asarray((self.vertices @ ups.T).min(axis=0))

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
    vertices, rounds, faces = parts_of(geometry)
    placed = vertices @ X.rotation.T + X.translation
    if isinstance(geometry, coal.BVHModelBase | coal.ConvexBase):
        if not len(vertices):
            raise ModelError("is a mesh without vertices")
        corners, faces, solid = _solid(placed.tobytes())
        return ConvexShape(str(shape.name), int(shape.parentJoint), corners, (), faces, solid, pin.SE3.Identity())
    if not len(vertices) and not rounds:
        raise ModelError(f"is a {type(geometry).__name__}, which has no points that could touch")
    N = faces[:, :3] @ X.rotation.T
    faces = np.column_stack([N, faces[:, 3] + N @ X.translation])
    turned = tuple([RoundPart(X.act(r.centre), X.rotation @ r.root @ X.rotation.T, r.rim) for r in rounds])
    return ConvexShape(str(shape.name), int(shape.parentJoint), placed, turned, faces, geometry, X)


def polyhedron(name: str, corners: Array) -> ConvexShape:
    """The convex hull of corners in W, shape (k, 3), fixed to the world."""
    kept, faces, solid = _solid(np.ascontiguousarray(corners).tobytes())
    return ConvexShape(name, 0, kept, (), faces, solid, pin.SE3.Identity())


def parts_of(geometry: coal.CollisionGeometry) -> tuple[Array, list[RoundPart], Array]:
    """(vertices (k, 3), round parts, faces (m, 4) as of `ConvexShape`) in a geometry's own axes; of others than these, nothing.

    A flat rim has vertices too, of a polygon in it. A mesh has its vertices alone, without faces.
    """
    faces, none = np.zeros((0, 4)), np.zeros((0, 3))
    match geometry:
        case coal.BVHModelBase():
            return np.array(geometry.vertices(), float).reshape(-1, 3), [], faces
        case coal.ConvexBase():
            return np.array([geometry.point(i) for i in range(geometry.num_points)], float).reshape(-1, 3), [], faces
        case coal.Box():
            half = np.asarray(geometry.halfSide, float)
            signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
            return signs * half, [], np.column_stack([np.vstack([np.eye(3), -np.eye(3)]), np.tile(half, 2)])
        case coal.Sphere():
            return none, [ball(np.zeros(3), geometry.radius)], faces
        case coal.Ellipsoid():
            return none, [RoundPart(np.zeros(3), np.diag(np.asarray(geometry.radii, float)))], faces
        case coal.Capsule():
            return none, [ball(z * _UP, geometry.radius) for z in (-geometry.halfLength, geometry.halfLength)], faces
        case coal.Cylinder():
            r, h = float(geometry.radius), float(geometry.halfLength)
            rims = [rim(z * _UP, _UP, r, i * RIM_CORNERS) for i, z in enumerate((-h, h))]
            return np.vstack([_polygon(r, z) for z in (-h, h)]), rims, np.array([[0.0, 0.0, -1.0, h], [0.0, 0.0, 1.0, h]])
        case coal.Cone():
            r, h = float(geometry.radius), float(geometry.halfLength)
            return np.vstack([_polygon(r, -h), [h * _UP]]), [rim(-h * _UP, _UP, r, 0)], np.array([[0.0, 0.0, -1.0, h]])
    return none, [], faces


def _polygon(radius: float, z: float) -> Array:
    angles = 2.0 * np.pi * np.arange(RIM_CORNERS) / RIM_CORNERS
    return np.column_stack([radius * np.cos(angles), radius * np.sin(angles), np.full(RIM_CORNERS, z)])


@lru_cache(maxsize=64)
def _solid(data: bytes) -> tuple[Array, Array, coal.Convex]:
    """(corners, faces, hull) of points, cached for the next contacts of the same robot: a large mesh takes 50 ms."""
    points = np.frombuffer(data).reshape(-1, 3)
    try:
        hull = solid_hull(points)
    except ValueError:
        corners = np.unique(points, axis=0)
        return locked(corners), locked(np.zeros((0, 4))), coal.Convex(_vectors(corners), _triangles(np.zeros((0, 3), int)))
    number = np.full(len(points), -1)
    number[hull.vertices] = np.arange(len(hull.vertices))
    triangles, corners = number[hull.simplices], points[hull.vertices]
    faces = flat_faces(hull)
    solid = coal.Convex(_vectors(corners), _triangles(triangles))
    return locked(corners[_few(corners, faces)]), locked(faces), solid


def _few(corners: Array, faces: Array) -> Array:
    """Indices of the corners, ascending; of large faces only the eight that represent them."""
    kept, dropped = set(), set()
    for block in np.split(faces, range(_BLOCK, len(faces), _BLOCK)):
        on_face = np.abs(corners @ block[:, :3].T - block[:, 3]) < FLAT_M
        for i in np.flatnonzero(np.count_nonzero(on_face, axis=0) > DIRECTIONS):
            own = np.flatnonzero(on_face[:, i])
            flat = across(block[i, :3]) @ corners[own].T
            few = own[(TOWARDS @ (flat - flat.mean(axis=1)[:, None])).argmax(axis=1)]
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


@dataclass(frozen=True, eq=False)
class RoundPart:
    """A part of a shape that has one lowest point: all c + S x with |x| <= 1, S symmetric; of a rim, its disk.

    Attributes:
        centre: c, shape (3,) [m].
        root: S, shape (3, 3) [m].
        rim: Of a rim, the number of the first of the shape's vertices that are on it; else -1.
        reach: Largest distance from the centre [m].
    """

    centre: Array
    root: Array
    rim: int = -1
    reach: float = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "reach", float(np.linalg.eigvalsh(self.root)[-1]))

    @property
    def least(self) -> float:
        """The lowest point is not unique where it is less than this below the centre [m]."""
        return LEVEL_M if self.rim >= 0 else 0.0

    @property
    def steep(self) -> float:
        """A rim whose lowest point is more than this below its centre touches nowhere else [m]."""
        return STEEP * self.reach

    @property
    def is_ball(self) -> bool:
        """Whether it is a ball."""
        return bool(np.abs(self.root - self.reach * np.eye(3)).max() <= 1e-12 * self.reach)

    def lowest(self, up: Array) -> Array:
        """The lowest point, shape (3,) [m]; NaN where many are equally low."""
        return self.centre + plane_kernel().lowest(self.root, self.least, *up)[:3]

    def wander(self, up: Array, rate: Array) -> Array:
        """How fast the lowest point moves over the body while `up` changes at `rate` [1/s], shape (3,) [m/s].

        Fast where a rim is nearly flat, as of a coin that comes to rest; zero where it is flat.
        """
        return np.array(plane_kernel().wander(self.root, self.least, *up, *rate))

    def stands(self, up: Array) -> bool:
        """Whether a rim is inclined so much that only its lowest point can touch."""
        return bool(plane_kernel().lowest(self.root, self.least, *up)[3] > self.steep)


def ball(centre: Array, radius: float) -> RoundPart:
    """A ball of a radius [m]."""
    return RoundPart(centre, radius * np.eye(3))


def rim(centre: Array, axis: Array, radius: float, first: int) -> RoundPart:
    """The edge of a cylinder's or cone's flat end, about a unit vector; `first` as `RoundPart.rim`."""
    return RoundPart(centre, radius * (np.eye(3) - np.outer(axis, axis)), first)


def spread(points: Array, height: Array, up: Array) -> Array:
    """Indices of the points chosen among many near a surface, in ascending order; at most `MOST_POINTS`.

    The loaded ones, and those over which the body would tip. The choice depends only on the present positions, and changes only
    far from where the body touches.

    Args:
        points: Shape (n, 3) [m].
        height: Height above the surface, shape (n,) [m].
        up: Unit vector away from the surface, shape (3,).
    """
    every = np.arange(len(points))
    if len(points) <= MOST_POINTS:
        return every
    places, heights, along = (np.ascontiguousarray(given) for given in (points.T, height, up))
    return plane_kernel().spread(places, heights, every, along)


@cache
def plane_kernel() -> ModuleType:
    """The compiled functions, which are compiled or read from the disk when they are first asked for."""
    from rbd.constraints import plane_kernel as compiled_functions

    return compiled_functions
