"""Treads of terrain under stances: planes with outlines, onto which soles are put; how high a foot is over what it passes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from rbd.arrays import Array
from rbd.constraints.convex.polygons import area_of, clipped, convex_hull, half_planes, overlap
from rbd.constraints.terrain.pieces import Heights, Piece
from rbd.constraints.terrain.terrain import Terrain
from rbd.model.sampled_motion import minimum_jerk_way
from rbd.problem.programs import least_distance, linear_program

STEEPEST = np.cos(np.radians(50.0))
"""Faces that are steeper are no treads."""
FARTHEST = 0.5
"""A tread is at most so far from where a foot stands, up or down and along the floor [m]."""
STEP_M = 0.006
"""What rises by more over a tread is beside it, not a part of it [m]."""
OVERHEAD = 0.5
"""What begins this high over a tread is no obstacle on it [m]."""
BESIDE, INSIDE = 0.008, 0.004
"""Soles keep this far from what rises beside a tread; what carries of them is so far inside its edges [m]."""
NEAR = 0.6
"""Treads and obstacles this near to a sole count [m]."""
CLEAR_OVER, WIDER = 0.025, 0.005
"""In the middle of a step soles are so high over what they pass; and they count as this much wider, less than `BESIDE` [m]."""
MOST_RISE = 2.0
"""Steps are raised by at most this many times what is needed: what is passed right before a foot lands is hit."""
RISES_M = 2e-3
"""What is higher by more over the planes between two treads counts as passed [m]."""
AT_ENDS = 0.12
"""Share of a step over which that height is reached, from either end."""
RISES = (0.12, 0.16, 0.22, 0.3, 0.4, 0.5)
"""Shares of a step in which a foot may rise over what it passes, or come down."""
LOOK_UP = 0.4
"""Tops that are higher over a point are above it [m]."""


@dataclass(frozen=True, eq=False)
class Tread:
    """A plane on which a foot stands, with its outline.

    Attributes:
        plane: Its height is plane[0] + plane[1] x + plane[2] y, shape (3,) [m, 1, 1].
        edges: Rows (a, b, c), a x + b y <= c over it, shape (k, 3); none where it has no end.
        walls: Of what rises beside it: rows with a x + b y <= c where a sole does not meet it, shape (w, 3).
        name: Of its piece.
    """

    plane: Array
    edges: Array = field(default_factory=lambda: np.zeros((0, 3)))
    walls: Array = field(default_factory=lambda: np.zeros((0, 3)))
    name: str = ""

    @classmethod
    def level(cls, z: float) -> Tread:
        """A level one without end [m]."""
        return cls(np.array([z, 0.0, 0.0]))

    @classmethod
    def under(cls, terrain: Terrain, place: Array, sole: Array, inner: Array, z: float, otherwise: float) -> Tread:
        """That on which a sole is to stand: the one to which it is nearest, up or down and along the floor.

        Args:
            terrain: The terrain.
            place: x and y of the foot [m].
            sole: Corners of the sole from there, shape (k, 2) [m].
            inner: Those of what carries of it.
            z: Height at which it stands in the reference [m].
            otherwise: Height of a level tread where there is none [m].
        """
        outline = convex_hull(place + sole)
        middle, found = outline.mean(axis=0), list[tuple[float, Tread]]()
        tops = [top for solid in terrain.solids if isinstance(solid, Piece) for top in _tops_of(solid)]
        for top in _joined(tops, outline):
            if top.far(middle) > NEAR:
                continue
            walls = [wall for other in tops if (wall := other.wall(top.plane, middle, outline)) is not None]
            found.append((0.0, cls(top.plane, top.edges, np.reshape(walls, (-1, 3)), top.name)))
        found += [(0.0, tread) for tread in _uneven(terrain, outline)]
        for i, (_, tread) in enumerate(found):
            A, b = tread.rows(sole, inner)
            p = nearest_within(place, A, b)
            missed = float((A @ p - b).max(initial=0.0))
            found[i] = (abs(height_at(tread.plane, middle) - z) + float(np.linalg.norm(p - place)) + 10.0 * missed, tread)
        cost, best = min(found, key=lambda each: each[0], default=(np.inf, cls.level(otherwise)))
        return best if cost < FARTHEST else cls.level(otherwise)

    @property
    def normal(self) -> Array:
        """Upwards, in W, shape (3,)."""
        return normals_of(self.plane)

    def rows(self, sole: Array, inner: Array) -> tuple[Array, Array]:
        """(A, b), A p <= b for the place p of a foot whose sole is on it: inside of its edges, and beside its walls.

        Args:
            sole: Corners of the sole from that place, along x and y, shape (k, 2) [m].
            inner: Those of what carries of it.
        """
        sides = [(self.edges, inner, INSIDE), (self.walls, sole, BESIDE)]
        A = np.concatenate([rows[:, :2] for rows, _, _ in sides])
        return A, np.concatenate([rows[:, 2] - (rows[:, :2] @ x.T).max(axis=1, initial=-np.inf) - m for rows, x, m in sides])


@dataclass(frozen=True, eq=False)
class Top:
    """A face of a piece that looks up.

    Attributes:
        plane: As of `Tread`.
        corners: Its outline along x and y, counterclockwise, shape (k, 2) [m]; none of a half-space.
        edges: Rows (a, b, c), a x + b y <= c over it, shape (k, 3).
        low: Height of the lowest point of its piece [m].
        name: Of its piece.
        parts: Outlines that it was joined from, each (k, 2).
    """

    plane: Array
    corners: Array
    edges: Array
    low: float
    name: str
    parts: tuple[Array, ...] = ()

    def share(self, outline: Array) -> float:
        """Of a sole, its part over this top, 0 to 1."""
        if not len(self.corners):
            return 1.0
        whole = area_of(outline)
        if whole <= 0.0:
            return float(self.far(outline.mean(axis=0)) <= 0.0)
        cut = sum(area_of(convex_hull(np.reshape(overlap(_points(outline), _points(part)), (-1, 2)))) for part in self.parts)
        return min(float(cut) / whole, 1.0)

    def far(self, xy: Array) -> float:
        """How far a place is outside of it, negative inside [m]."""
        return float((self.edges[:, :2] @ xy - self.edges[:, 2]).max(initial=-np.inf)) if len(self.edges) else -np.inf

    def wall(self, plane: Array, middle: Array, outline: Array) -> Array | None:
        """The row (a, b, c), a x + b y <= c beside it, if it rises near a sole over the plane on which that stands."""
        rise = self.plane - plane
        if self.low > height_at(plane, middle) + OVERHEAD or self.far(middle) > NEAR:
            return None
        corners = self.corners if len(self.corners) else outline
        heights = rise[0] + corners @ rise[1:]
        if heights.max() <= STEP_M:
            return None
        rows = [np.array([-a, -b, -c]) for a, b, c in self.edges]
        slope = float(np.linalg.norm(rise[1:]))
        if heights.min() < 0.0 and slope > 1e-9:  # where it begins to rise over the plane
            rows.append(np.array([*rise[1:], -rise[0]]) / slope)
        if not rows:
            return None
        return min(rows, key=lambda row: float(row[:2] @ middle - row[2]))


def height_at(plane: Array, xy: Array) -> float:
    """Height of a plane at a place [m]."""
    return float(plane[0] + plane[1:] @ xy)


def normals_of(planes: Array) -> Array:
    """Upward normals of planes, shapes (..., 3)."""
    n = np.concatenate([-planes[..., 1:], np.ones_like(planes[..., :1])], axis=-1)
    return np.asarray(n / np.linalg.norm(n, axis=-1, keepdims=True))


def tilts_of(planes: Array) -> Array:
    """Rotations that take z to the normals of planes about level axes, shapes (..., 3, 3) and (..., 3)."""
    x, y, z = np.moveaxis(normals_of(planes), -1, 0)
    out = np.empty((*z.shape, 3, 3))
    out[..., 0, 0], out[..., 0, 1] = 1.0 - x * x / (1.0 + z), -x * y / (1.0 + z)
    out[..., 1, 0], out[..., 1, 1] = -x * y / (1.0 + z), 1.0 - y * y / (1.0 + z)
    out[..., 2, 0], out[..., 2, 1], out[..., 2, 2] = -x, -y, z
    out[..., 0, 2], out[..., 1, 2] = x, y
    return out


def nearest_within(p: Array, A: Array, b: Array) -> Array:
    """The point nearest to p, shape (2,), with A x <= b; where there is none, of those that miss the rows by least."""
    if (A @ p <= b).all():
        return p
    found = least_distance(-A, A @ p - b)
    if found is None:
        least = linear_program(np.array([0.0, 0.0, 1.0]), np.column_stack([A, -np.ones(len(A))]), b)
        found = least_distance(-A, A @ p - b - least.value - 1e-6) if least.x.size else None
    return np.asarray(p if found is None else p + found[0])


def part_on(tread: Tread, points: Array) -> Array:
    """The part of a polygon along x and y, shape (k, 2), that is over a tread, shape (j, 2); of a point it or nothing."""
    out = _points(points)
    if len(out) < 3:
        keep = (points @ tread.edges[:, :2].T <= tread.edges[:, 2] + 1e-9).all(axis=1)
        return points[keep]
    for a, b, c in tread.edges.tolist():
        out = clipped(out, -a, -b, -c)
    return np.reshape(out, (-1, 2))


def raise_of(need: Array, u: Array) -> Array:
    """A smooth rise, zero at both ends of a step, that is nowhere less than needed, shape (k,) [m].

    Of rises A s(u/a) s((1 - u)/b), s minimum-jerk from 0 to 1, the one with the least accelerations.

    Args:
        need: Of each frame, shape (k,) [m].
        u: Its share of the step, 0 to 1.
    """
    if (need <= 0.0).all():
        return np.zeros(len(u))
    best, least, most = np.zeros(len(u)), np.inf, MOST_RISE * float(need.max())
    for a in RISES:
        for b in RISES:
            shape = minimum_jerk_way(np.clip(u / a, 0.0, 1.0)) * minimum_jerk_way(np.clip((1.0 - u) / b, 0.0, 1.0))
            size = float((np.maximum(need, 0.0) / np.maximum(shape, 1e-9)).max())
            size, missed = min(size, most), max(size / most, 1.0)
            if (cost := missed * size * (a**-2 + b**-2)) < least:
                best, least = size * shape, cost
    return best


def needed_rise(terrain: Terrain, points: Array, planes: Array, u: Array) -> Array:
    """By how much a foot is too low over what it passes in a step, shape (k,) [m]; negative where it is high enough.

    Args:
        terrain: The terrain.
        points: Of its sole, in W, shape (k, j, 3) [m].
        planes: Planes between its treads, shape (k, 3): feet are over them anyway, what is above them is passed at a distance.
        u: Share of the step, shape (k,).
    """
    tops = np.stack([solid.tops(points[..., :2]) for solid in terrain.solids])
    top = np.where(tops <= points[..., 2] + LOOK_UP, tops, -np.inf).max(axis=0)
    level = planes[:, None, 0] + (planes[:, None, 1:] * points[..., :2]).sum(axis=2)
    clear = np.clip(top - level, 0.0, CLEAR_OVER) * np.clip(np.minimum(u, 1.0 - u) / AT_ENDS, 0.0, 1.0)[:, None]
    return np.asarray(np.where(top > level + RISES_M, top - points[..., 2] + clear, -np.inf).max(axis=1))


def sole_points(corners: Array) -> Array:
    """Points over a sole that is a little wider, up to 15 mm apart, in its own axes, shape (j, 3); of few corners those."""
    if len(corners) < 3:
        return corners
    low, high = corners.min(axis=0) - WIDER, corners.max(axis=0) + WIDER
    x, y = (np.linspace(low[i], high[i], 2 + int((high[i] - low[i]) / 0.015)) for i in (0, 1))
    grid = np.array(np.meshgrid(x, y)).reshape(2, -1).T
    return np.column_stack([grid, np.full(len(grid), corners[:, 2].min())])


def _tops_of(piece: Piece) -> list[Top]:
    out = []
    for face, loop in zip(piece.faces, piece.loops, strict=True):
        if face[2] <= STEEPEST:
            continue
        plane = np.array([face[3], -face[0], -face[1]]) / face[2]
        if not len(piece.vertices):
            out.append(Top(plane, np.zeros((0, 2)), np.zeros((0, 3)), -np.inf, piece.name))
            continue
        corners = convex_hull(piece.vertices[list(loop), :2])
        if len(corners) > 2:
            out.append(Top(plane, corners, _edges(corners), float(piece.box[2]), piece.name, (corners,)))
    return out


def _edges(corners: Array) -> Array:
    inward, offsets = half_planes(corners)
    return np.column_stack([-inward, -offsets])


def _points(polygon: Array) -> list[tuple[float, float]]:
    return [(float(x), float(y)) for x, y in polygon]


def _joined(tops: Sequence[Top], outline: Array) -> list[Top]:
    """Tops in one plane that make one convex outline near a sole count as one; of others each counts."""
    groups = dict[tuple[int, ...], list[Top]]()
    for top in tops:
        groups.setdefault(tuple(np.round(top.plane * 1e5).astype(int).tolist()), []).append(top)
    out = []
    for same in groups.values():
        near = [top for top in same if len(top.corners) and top.share(outline) > 0.0]
        if len(near) > 1:
            hull = convex_hull(np.concatenate([top.corners for top in near]))
            parts = tuple(top.corners for top in near)
            if area_of(hull) <= (1.0 + 1e-6) * sum(area_of(part) for part in parts):
                out.append(Top(near[0].plane, hull, _edges(hull), min(t.low for t in near), near[0].name, parts))
                continue
            if sum(top.share(outline) for top in near) > 1.0 - 1e-6:  # all of it is on them: no end is near
                out.append(Top(near[0].plane, np.zeros((0, 2)), np.zeros((0, 3)), near[0].low, near[0].name))
                continue
        out += same
    return out


def _uneven(terrain: Terrain, outline: Array) -> list[Tread]:
    """Planes on the highest places of grids of heights under a sole, with their mean slope."""
    low, high = outline.min(axis=0), outline.max(axis=0)
    grid, out = np.array(np.meshgrid(*(np.linspace(low[i], high[i], 5) for i in (0, 1)))).reshape(2, -1).T, list[Tread]()
    for solid in terrain.solids:
        tops = solid.tops(grid) if isinstance(solid, Heights) else np.zeros(0)
        some = np.isfinite(tops)
        if np.count_nonzero(some) > 0.6 * len(grid):
            places = np.column_stack([np.ones(len(grid)), grid])[some]
            plane = np.linalg.lstsq(places, tops[some], rcond=None)[0]
            plane[0] += float((tops[some] - places @ plane).max())
            out.append(Tread(plane, name=solid.name))
    return out
