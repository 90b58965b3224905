"""Convex pieces of terrain, at rest or moving: corners, faces, edges, as arrays; grids of heights, in prisms where needed."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import coal
import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_array, as_finite, as_vector3, check_number, locked, zeros
from rbd.constraints.convex.convex_shapes import parts_of
from rbd.constraints.convex.polygons import across
from rbd.errors import InputError
from rbd.model.meshes import flat_faces, solid_hull
from rbd.model.placement import rigid_placement
from rbd.model.state import FrameKinematics, State
from rbd.problem.ground import Ground
from rbd.problem.motions import Motion, Prescribed

SAME_PLANE = 1e-9
"""Corners this near to a face, relative to the piece's size, are on it."""
SIDES = 48
"""Sides of the prism in place of a cylinder: its corners are on the cylinder, its faces up to 0.2 % of the radius inside."""
LEAST_M = 1e-6
"""Treads, and cells of a grid of heights, are at least this wide [m]."""
OVERLAPS_M = 1e-6
"""Pieces that are deeper in each other overlap; less is rounding [m]."""
AT_EDGE_M = 1e-3
"""A point this near to two faces is at their edge [m]."""
BELOW_M = 1.0
"""The base of prisms of a grid of heights is this far below its lowest point [m]."""
CORNER, CROSSING, UNDER, OTHER = 0, 1, 2, 3
"""Kinds of points: a corner of the plate; its outline over an edge; a corner of the piece under it; the nearest pair.

The numbers of a point are those of the corner or edge of the plate, and of the face, edge or corner of the piece."""
ON_FACE, ON_PLATE, EDGES = 0, 1, 2
"""Whose the normal is: a face's, the plate's, or that of two edges, which cross or are the nearest pair."""


@dataclass(frozen=True, eq=False)
class Piece:
    """A convex piece, or a half-space, in W.

    Attributes:
        name: Its name in the terrain.
        faces: (N, d), N x <= d inside, shape (f, 4) [1, m].
        vertices: Corners, shape (v, 3) [m]; none of a half-space.
        loops: Of each face its corners in order, counterclockwise as seen from outside.
        moved: How far it has moved at a time; None: it stays.
        rates: Velocity, acceleration, and the velocity of its surface over it, shape (9,) [m/s, m/s2, m/s]; None: all zero.
        inner: Faces that another piece covers whole, from edge to edge: nothing touches them.
        edges: Of each edge two corners and two faces, shape (e, 4).
        box: Lowest and highest x, y, z, shape (6,) [m].
    """

    name: str
    faces: Array
    vertices: Array
    loops: tuple[tuple[int, ...], ...]
    moved: Prescribed | None = field(default=None, kw_only=True)
    rates: Array | None = field(default=None, kw_only=True)
    inner: tuple[int, ...] = field(default=(), kw_only=True)
    edges: Array = field(init=False, repr=False)
    box: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        found: dict[tuple[int, int], list[int]] = {}
        for face, loop in enumerate(self.loops):
            for a, b in zip(loop, (*loop[1:], *loop[:1]), strict=True):
                found.setdefault((min(a, b), max(a, b)), []).append(face)
        edges = np.array([(a, b, of[0], of[-1]) for (a, b), of in found.items()], int).reshape(-1, 4)
        ends = (-np.inf, np.inf) if not len(self.vertices) else (self.vertices.min(axis=0), self.vertices.max(axis=0))
        self.__dict__.update(edges=edges, box=np.concatenate([np.broadcast_to(end, 3) for end in ends]))

    def at(self, t: float) -> Piece:
        """Where it is at a time [s], with its rates then; itself without a motion."""
        if self.moved is None:
            return self
        s, velocity, acceleration = self.moved.at(t)
        faces = np.column_stack([self.faces[:, :3], self.faces[:, 3] + self.faces[:, :3] @ s])
        rates = np.concatenate([velocity, acceleration, np.zeros(3)])
        return Piece(self.name, faces, self.vertices + s, self.loops, rates=rates)

    def shift(self, t: float) -> Array:
        """How far it has moved at a time [s], in W, shape (3,) [m]."""
        return zeros(3) if self.moved is None else self.moved.at(t)[0]

    def motion(self, state: State) -> FrameKinematics:
        """Where it is and how it moves at the time of a state; a belt's surface excepted."""
        X, rates = pin.SE3(np.eye(3), self.shift(state.t)), np.zeros((2, 6))
        if self.moved is not None:
            rates[:, :3] = self.moved.at(state.t)[1:]
        return FrameKinematics(X, np.zeros((6, len(state.v))), *rates)

    def moving(self, motion: Motion | None, velocity: Sequence[float] | Array | None) -> Piece:
        """The same with a motion, or a velocity of its surface; one of the two is given.

        Raises:
            InputError: both or neither, or what is no motion and no velocity.
        """
        what = f"of piece {self.name!r:.80} of a terrain"
        if motion is not None and velocity is None:
            return replace(self, moved=Prescribed(f"motion {what}", motion, (3,)), rates=None)
        if motion is not None or velocity is None:
            raise InputError(f"the motion {what} wants motion= or velocity=, one of the two.")
        return replace(self, moved=None, rates=np.concatenate([np.zeros(6), as_vector3(f"velocity {what}", velocity)]))

    @property
    def directions(self) -> Array:
        """The different directions of its edges, shape (d, 3)."""
        d = self.vertices[self.edges[:, 1]] - self.vertices[self.edges[:, 0]]
        d = d / np.linalg.norm(d, axis=1)[:, None]
        kept: list[Array] = []
        for x in d:
            if not any(abs(abs(float(x @ y)) - 1.0) < 1e-14 for y in kept):
                kept.append(x)
        return np.reshape(kept, (-1, 3))

    @property
    def kind(self) -> Hashable:
        """The same for pieces that move alike; None at rest."""
        return id(self.moved) if self.moved is not None else None if self.rates is None else tuple(self.rates.tolist())

    def depths(self, points: Array) -> Array:
        """The largest N x - d of points (..., 3): minus the depth inside [m]; outside no more than the distance."""
        return np.asarray((points @ self.faces[:, :3].T - self.faces[:, 3]).max(axis=-1))

    def face_at(self, points: Array, along: Array) -> tuple[Array, Array]:
        """(distance of each point from the surface, or less outside, shape (k,) [m]; outward normal of its face there, (k, 3)).

        Of the faces within a millimetre of the nearest, as at an edge, the one whose normal goes best with a direction.

        Args:
            points: In W, shape (k, 3) [m].
            along: A direction for each, as the force there, shape (k, 3).
        """
        off = points @ self.faces[:, :3].T - self.faces[:, 3]
        depth = off.max(axis=1)
        fits = np.where(off >= depth[:, None] - AT_EDGE_M, along @ self.faces[:, :3].T, -np.inf)
        return np.abs(depth), self.faces[fits.argmax(axis=1), :3]

    def tops(self, xy: Array) -> Array:
        """Height of its upper side at places (..., 2) [m]; -inf beside it."""
        top, low, beside = np.full(xy.shape[:-1], np.inf), np.full(xy.shape[:-1], -np.inf), np.zeros(xy.shape[:-1], bool)
        for x, y, z, d in self.faces.tolist():
            level = d - x * xy[..., 0] - y * xy[..., 1]
            if z > 1e-9:
                top = np.minimum(top, level / z)
            elif z < -1e-9:
                low = np.maximum(low, level / z)
            else:
                beside |= level < -1e-9
        return np.where(beside | (low > top + 1e-9) | np.isposinf(top), -np.inf, top)


def overlaps_of(pieces: Sequence[Piece]) -> dict[tuple[str, str], float]:
    """{names of two pieces: how deep they are in each other [m]}, by more than `OVERLAPS_M`; not of two half-spaces.

    The depth is the shortest way along a face's normal, or across an edge of each, by which they come apart.
    """
    boxes, out = np.array([piece.box for piece in pieces]).reshape(-1, 6), dict[tuple[str, str], float]()
    for i, one in enumerate(pieces):
        apart = (boxes[i, :3] > boxes[i + 1 :, 3:]).any(axis=1) | (boxes[i, 3:] < boxes[i + 1 :, :3]).any(axis=1)
        for j in (np.flatnonzero(~apart) + i + 1).tolist():
            depth = _depth(one, pieces[j])
            if depth > OVERLAPS_M:
                out[one.name, pieces[j].name] = depth
    return out


def _depth(one: Piece, other: Piece) -> float:
    """How far one is in the other; negative apart, minus infinity of two half-spaces."""
    ways = []
    for a, b in ((one, other), (other, one)):
        if len(b.vertices):
            ways.append(a.faces[:, 3] - (a.faces[:, :3] @ b.vertices.T).min(axis=1))
    if len(one.vertices) and len(other.vertices):
        n = np.cross(one.directions[:, None], other.directions[None]).reshape(-1, 3)
        size = np.linalg.norm(n, axis=1)
        n = n[size > 1e-6] / size[size > 1e-6, None]
        a, b = n @ one.vertices.T, n @ other.vertices.T
        ways += [a.max(axis=1) - b.min(axis=1), b.max(axis=1) - a.min(axis=1)]
    return float(np.concatenate(ways).min()) if ways else -np.inf


def half_space(name: str, ground: Ground) -> Piece:
    """What is below a plane."""
    return Piece(name, np.array([[*np.asarray(ground.normal), ground.height]]), np.zeros((0, 3)), ((),))


def plane_at(point: Array, normal: Array, rates: Array | None) -> Ground:
    """The plane of a face through a point, with the velocity and acceleration that its material has there."""
    if rates is None:
        return Ground(point=point, normal=normal)
    belt = rates[6:] - float(rates[6:] @ normal) * normal
    return Ground(point=point, normal=normal, velocity=rates[:3] + belt, acceleration=rates[3:6])


def polytope(name: str, corners: Array, faces: Array | None = None) -> Piece:
    """The convex hull of some corners, shape (k, 3); its faces are given, or those of the hull.

    Raises:
        InputError: corners in a plane.
    """
    if faces is None:
        try:
            hull = solid_hull(corners)
        except ValueError as error:
            raise InputError(f"piece {name!r:.80} of a terrain {error}; expected a solid.") from None
        corners = corners[hull.vertices]
        faces = flat_faces(hull)
        faces[:, 3] = (corners @ faces[:, :3].T).max(axis=0)
    size = float(np.ptp(corners, axis=0).max())
    loops = []
    for face in faces:
        own = np.flatnonzero(np.abs(corners @ face[:3] - face[3]) <= SAME_PLANE * size)
        flat = across(face[:3]) @ (corners[own] - corners[own].mean(axis=0)).T
        loops.append(tuple(own[np.argsort(np.arctan2(flat[1], flat[0]))].tolist()))
    return Piece(name, faces, corners, tuple(loops))


def piece_of(name: str, given: object) -> Piece | Heights:
    """A piece as users give it: a ground, a piece or a grid of heights that was made, a shape, or a shape and its pose.

    Raises:
        InputError: another object, a moving ground, or a round shape.
    """
    if isinstance(given, Heights | Piece):
        return given if given.name == name else replace(given, name=name)
    if isinstance(given, Ground):
        if given.point is None or (given.moves and given.motion is None):
            raise InputError(
                f"piece {name!r:.80} of a terrain is {given!r:.80}; expected a plane with a point, at rest or with a motion "
                "(for a belt, terrain.with_motion(name, velocity=...))."
            )
        plane = half_space(name, given)
        return plane if given.motion is None else plane.moving(given.motion, None)
    shape, X = given if isinstance(given, tuple | list) and len(given) == 2 else (given, None)
    if isinstance(shape, pin.GeometryObject):
        shape, X = shape.geometry, shape.placement
    if not isinstance(shape, coal.CollisionGeometry):
        raise InputError(
            f"piece {name!r:.80} of a terrain is {given!r:.80}; expected rbd.Ground(point=..., normal=...), a shape such as "
            "coal.Box(x, y, z), or (shape, pin.SE3), in W."
        )
    X = pose_of(name, X)
    if isinstance(shape, coal.Plane | coal.Halfspace):
        n = X.rotation @ np.asarray(shape.n)
        return Piece(name, np.array([[*n, float(shape.d) + float(n @ X.translation)]]), np.zeros((0, 3)), ((),))
    if isinstance(shape, coal.Cylinder):
        angles = 2.0 * np.pi * np.arange(SIDES) / SIDES
        rim = float(shape.radius) * np.column_stack([np.cos(angles), np.sin(angles)])
        corners = np.vstack([np.column_stack([rim, np.full(SIDES, z)]) for z in (-shape.halfLength, shape.halfLength)])
        return polytope(name, corners @ X.rotation.T + X.translation)
    corners, rounds, faces = parts_of(shape)
    if rounds or not len(corners):
        raise InputError(
            f"piece {name!r:.80} of a terrain is a {type(shape).__name__}; expected a box, a cylinder, a convex mesh or a "
            "plane. Give a round piece as a mesh."
        )
    N = faces[:, :3] @ X.rotation.T
    placed = corners @ X.rotation.T + X.translation
    return polytope(name, placed, np.column_stack([N, faces[:, 3] + N @ X.translation]) if len(faces) else None)


def pose_of(name: str, X: Any) -> pin.SE3:
    """The pose of a piece, which may be given by its place alone.

    Raises:
        InputError: it is no rigid placement.
    """
    what = f"pose of piece {name!r:.80} of a terrain"
    given = X if X is None or isinstance(X, pin.SE3) else as_array(what, X)
    if isinstance(given, np.ndarray) and given.shape == (3,):
        return pin.SE3(np.eye(3), as_finite(what, given, (3,)))
    return rigid_placement(what, given)


@dataclass(frozen=True, eq=False)
class Heights:
    """A grid of heights: the surface is two triangles a cell, cut along the diagonal from (i, j) to (i + 1, j + 1).

    Attributes:
        name: Its name in the terrain.
        z: Height at (x, y) = origin + spacing (i, j), shape (n, m) [m].
        spacing: Along x and y, shape (2,) [m].
        origin: Place of z[0, 0], shape (2,) [m].
    """

    name: str
    z: Array
    spacing: Array
    origin: Array

    @classmethod
    def of(cls, name: str, z: object, spacing: object, origin: object) -> Heights:
        """Checked.

        Raises:
            InputError: heights that are not finite, fewer than two rows or columns, a spacing that is not positive.
        """
        heights = as_finite("z of a terrain's heights", z, ("n", "m"))
        if min(heights.shape) < 2:
            raise InputError(f"z of a terrain's heights has shape {heights.shape}; expected two rows and two columns or more.")
        steps = [
            check_number("spacing of a terrain's heights", s, LEAST_M, 1e6, expected="a length > 0 [m], or two")
            for s in np.broadcast_to(as_finite("spacing of a terrain's heights", spacing, (), (2,)), 2).tolist()
        ]
        return cls(name, locked(np.array(heights)), np.array(steps), as_finite("origin of a terrain's heights", origin, (2,)))

    @property
    def base(self) -> float:
        """Height of the prisms' lower ends [m]."""
        return float(self.z.min()) - BELOW_M

    def cells(self, low: Array, high: Array) -> tuple[range, range]:
        """The cells that reach into a box of x and y."""
        first, last = ((x[:2] - self.origin) / self.spacing for x in (low, high))
        ends = np.array(self.z.shape) - 1
        start, stop = np.clip(np.floor(first), 0, ends).astype(int), np.clip(np.floor(last) + 1, 0, ends).astype(int)
        i, j = (range(*ends) for ends in np.transpose([start, stop]).tolist())
        return i, j

    def prisms(self, i: int, j: int) -> list[Piece]:
        """The two prisms of a cell; one, where its corners are in one plane."""
        at = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
        P = np.array([[*(self.origin + self.spacing * (a, b)), self.z[a, b]] for a, b in at])
        n, m = (k - 1 for k in self.z.shape)
        south, east, north, west = j > 0, i + 1 < n, j + 1 < m, i > 0
        if abs(P[0, 2] - P[1, 2] + P[2, 2] - P[3, 2]) <= SAME_PLANE * self.spacing.min():
            return [self._prism(f"[{i},{j}]", P, (south, east, north, west))]
        halves = ("a", [0, 1, 2], (south, east, True)), ("b", [0, 2, 3], (True, north, west))
        return [self._prism(f"[{i},{j}]{half}", P[own], inner) for half, own, inner in halves]

    def _prism(self, name: str, corners: Array, inner: Sequence[bool]) -> Piece:
        """What is under corners of one plane; `inner`: whether other cells cover its sides."""
        k = len(corners)
        low = np.column_stack([corners[:, :2], np.full(k, self.base)])
        n = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        n /= np.linalg.norm(n)
        along = np.roll(corners, -1, axis=0) - corners
        sides = np.column_stack([along[:, 1], -along[:, 0], np.zeros(k)]) / np.linalg.norm(along[:, :2], axis=1)[:, None]
        N = np.vstack([n, [0.0, 0.0, -1.0], sides])
        d = np.concatenate([[n @ corners[0], -self.base], np.vecdot(sides, corners)])
        around = [(a, (a + 1) % k) for a in range(k)]
        loops = (tuple(range(k)), (k, *range(2 * k - 1, k, -1)), *((a, a + k, b + k, b) for a, b in around))
        covered = tuple([2 + side for side in range(k) if inner[side]])
        return Piece(self.name + name, np.column_stack([N, d]), np.vstack([corners, low]), loops, inner=covered)

    def tops(self, xy: Array) -> Array:
        """Height of the surface at places (..., 2) [m]; -inf beside the grid."""
        return self._slopes(xy)[0]

    def face_at(self, points: Array, along: Array) -> tuple[Array, Array]:
        """As of `Piece`: distances along z, inf beside the grid, and the normal of the triangle under or over each point."""
        tops, slopes = self._slopes(points[:, :2])
        normals = np.column_stack([-slopes / self.spacing, np.ones(len(along))])
        return np.abs(points[:, 2] - tops), normals / np.linalg.norm(normals, axis=1)[:, None]

    def _slopes(self, xy: Array) -> tuple[Array, Array]:
        """(heights at places (..., 2) [m], -inf beside the grid; how much they rise to the next row and column, (..., 2))."""
        at = (xy - self.origin) / self.spacing
        ends = np.array(self.z.shape) - 1
        beside = ((at < -1e-9) | (at > ends + 1e-9)).any(axis=-1) | ~np.isfinite(at).all(axis=-1)
        at = np.where(beside[..., None], 0.0, at)
        i, j = (np.clip(np.floor(at[..., c]).astype(int), 0, ends[c] - 1) for c in (0, 1))
        s, t = at[..., 0] - i, at[..., 1] - j
        a, b, c, d = self.z[i, j], self.z[i + 1, j], self.z[i + 1, j + 1], self.z[i, j + 1]
        ds, dt = np.where(s >= t, b - a, c - d), np.where(s >= t, c - b, d - a)
        return np.where(beside, -np.inf, a + s * ds + t * dt), np.stack([ds, dt], axis=-1)


class Polytopes(NamedTuple):
    """Pieces side by side, for compiled functions.

    Attributes:
        boxes: Lowest and highest x, y, z of each piece, shape (pieces, 6) [m].
        faces: (N, d) of all pieces, shape (f, 4).
        vertices: Their corners, shape (v, 3) [m].
        edges: Of each edge the two corners and the two faces, by numbers within the piece, shape (e, 4).
        loops: Corners of each face in order, seen from outside counterclockwise, by numbers within the piece.
        loop_at: Where those of each face begin, shape (f + 1,).
        dirs: The different directions of edges, shape (d, 3).
        begins: Where faces, corners, edges and directions of each piece begin, shape (pieces + 1, 4).
        kinds: A number that pieces of one motion and one velocity share, zero at rest, shape (pieces,).
        inner: One for faces that another piece covers whole, else zero, shape (f,).
        rates: Velocity, acceleration, and velocity of the surface over it, of each, shape (pieces, 9); no rows if all rest.
    """

    boxes: Array
    faces: Array
    vertices: Array
    edges: Array
    loops: Array
    loop_at: Array
    dirs: Array
    begins: Array
    kinds: Array
    inner: Array
    rates: Array

    @classmethod
    def of(cls, pieces: Sequence[Piece]) -> Polytopes:
        """The arrays of some pieces."""
        directions, kinds = [piece.directions for piece in pieces], dict[Hashable, int]({None: 0})
        loops = [loop for piece in pieces for loop in piece.loops]
        counts = [(len(p.faces), len(p.vertices), len(p.edges), len(d)) for p, d in zip(pieces, directions, strict=True)]
        return cls(
            np.array([piece.box for piece in pieces]).reshape(-1, 6),
            np.concatenate([np.zeros((0, 4)), *[piece.faces for piece in pieces]]),
            np.concatenate([np.zeros((0, 3)), *[piece.vertices for piece in pieces]]),
            np.concatenate([np.zeros((0, 4), int), *[piece.edges for piece in pieces]]),
            np.array([i for loop in loops for i in loop], int),
            np.concatenate([[0], np.cumsum([len(loop) for loop in loops])]).astype(int),
            np.concatenate([np.zeros((0, 3)), *directions]),
            np.vstack([np.zeros((1, 4), int), np.cumsum(np.reshape(counts, (-1, 4)), axis=0)]).astype(int),
            np.array([kinds.setdefault(piece.kind, len(kinds)) for piece in pieces], int),
            np.array([f in piece.inner for piece in pieces for f in range(len(piece.faces))], int),
            np.zeros((len(pieces) * (len(kinds) > 1), 9)),
        )

    def at(self, pieces: Sequence[Piece], t: float) -> Polytopes:
        """The arrays of pieces that move, at a time [s]; `self` are those of the same pieces, where they were given."""
        shifts, rates = np.zeros((len(pieces), 3)), np.zeros((len(pieces), 9))
        for i, piece in enumerate(pieces):
            if piece.moved is not None:
                found = piece.moved.at(t)
                shifts[i], rates[i, :6] = found[0], found[1:].ravel()
            elif piece.rates is not None:
                rates[i] = piece.rates
        of_faces, of_corners = (np.repeat(shifts, np.diff(self.begins[:, column]), axis=0) for column in (0, 1))
        faces = self.faces.copy()
        faces[:, 3] += np.vecdot(faces[:, :3], of_faces)
        boxes, vertices = self.boxes + np.tile(shifts, 2), self.vertices + of_corners
        return self._replace(boxes=boxes, faces=faces, vertices=vertices, rates=rates)


class Spots(NamedTuple):
    """k points at which something touches pieces, for compiled functions.

    Attributes:
        places: On what touches, in W, shape (k, 3) [m].
        normals: Out of the terrain, shape (k, 3).
        gaps: Along them, shape (k,) [m].
        which: Kind (`CORNER` to `OTHER`), two numbers, piece, `ON_FACE`, `ON_PLATE` or `EDGES`, plate or shape, shape (k, 6).
        ways: Of an outline over an edge, across that edge on a face, else along it, shape (k, 3).
    """

    places: Array
    normals: Array
    gaps: Array
    which: Array
    ways: Array


class Plates(NamedTuple):
    """Plates and balls at one state, for compiled functions.

    Attributes:
        corners: Of all, in W, shape (c, 3) [m].
        at: Where those of each begin, and c, shape (plates + 1,).
        ups: Out of the ground, shape (plates, 3).
        radii: Of a ball about a single corner, of a capsule without its ends about two [m], shape (plates,); zero of others.
    """

    corners: Array
    at: Array
    ups: Array
    radii: Array
