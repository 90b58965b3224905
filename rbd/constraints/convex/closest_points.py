"""Contact geometry of two convex shapes: normal, points and gaps, touching or near.

Coal gives the nearest points and their direction. Where a flat face of one shape is nearly across that direction, the face's
normal is used if it separates the shapes as far: the signed distance of convex shapes is the largest, over all normals n, of

    (lowest p . n of the first) - (highest p . n of the second)

so normals can be compared. Between faces, ends and edges the points are the corners of the intersection of the two,
seen along the normal, each with the gap between the two surfaces there. Else it is the nearest pair only.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import coal
import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.constraints.convex.convex_shapes import ConvexShape, spread
from rbd.constraints.convex.polygons import SAME_M, Point, across, inside, on_edge, outline, overlap, same
from rbd.errors import NoSolution

NEARLY_ACROSS = 0.99995
"""A face's normal is tried where its cosine with the nearest direction is above this: 0.6 degrees. Of shapes that overlap
all faces are tried, as Coal's direction can be that of another face, 0.7 m away."""
IN_TOUCH_M, RETREAT_M = 1e-7, 1e-5
"""For shapes nearer than the first, Coal's normal is off by up to 1e-5, and crossing edges seem to meet at an end: the second
shape is moved away by the other length, and the distance corrected."""
TOLERANCES = (1e-12, 1e-10, 1e-8, 1e-6)
"""Of Coal, the first that gives a distance: where shapes overlap by rounding, finer ones can end in -1.8e308 and NaN. The
last is Coal's default, by which normals of round shapes are wrong by 1e-3."""
NO_DISTANCE = 1e100
"""A distance above this is none [m]."""
LEVEL_M = 1e-4
"""Points that are less than this behind the nearest one belong to the same face or edge, touching or not."""
LEANING = 0.1
"""A face whose normal has a component below this along the contact's normal is a side face."""


class Crossing(NamedTuple):
    """A possible contact point of two shapes.

    Attributes:
        name: Names of the shapes, with the numbers of the corners or edges that meet.
        first: Number of the first shape's point; -1 where it is on an edge or a face.
        second: Number of the second shape's point, or -1.
        position: Halfway between the two, in W, shape (3,) [m].
        gap: Distance from the second to the first along the normal [m]; negative where they overlap.
    """

    name: str
    first: int
    second: int
    position: Array
    gap: float


class Nearest(NamedTuple):
    """The nearest points of two shapes.

    Attributes:
        gap: Their signed distance [m].
        normal: Unit vector from the second to the first, in W, shape (3,).
        first: Nearest point of the first shape, in W, shape (3,) [m].
        second: Nearest point of the second.
    """

    gap: float
    normal: Array
    first: Array
    second: Array


@dataclass(frozen=True, eq=False)
class Meeting:
    """Contact geometry of two shapes.

    Attributes:
        normal: From the second to the first, unit vector in W, shape (3,).
        carrier: 1 or 2: the shape whose face gives the normal, so that it turns with that body; 0: neither.
        crossings: Possible contact points within the margin.
    """

    normal: Array
    carrier: int
    crossings: tuple[Crossing, ...]


@dataclass(frozen=True, eq=False)
class _Placed:
    """A shape in W, with a normal that points out of the other shape (`sign` 1) or into it (-1)."""

    shape: ConvexShape
    X: pin.SE3
    n: Array
    sign: float

    @property
    def up(self) -> Array:
        return self.sign * (self.X.rotation.T @ self.n)

    def extreme(self) -> float:
        """Lowest p . n of the first shape, highest of the second."""
        return self.sign * self.shape.lowest(self.up) + float(self.n @ self.X.translation)

    def near(self, depth: float) -> tuple[list[int], Array]:
        """Points that are at most `depth` behind the extreme one, in W."""
        up = self.up
        numbers, points = self.shape.low(up, self.shape.lowest(up) + depth)
        return numbers, points @ self.X.rotation.T + self.X.translation

    def surface(self, base: Array) -> Array | None:
        """Heights q . n of the surface where some points are, shape (k,), of the faces across n; None if there are none."""
        N = self.shape.faces[:, :3] @ self.X.rotation.T
        lean = -self.sign * (N @ self.n)
        facing = lean > LEANING
        if not facing.any():
            return None
        N, d = N[facing], self.shape.faces[facing, 3] + N[facing] @ self.X.translation
        heights = (d - base @ N.T) / (N @ self.n) + (base @ self.n)[:, None]
        return np.asarray(heights.max(axis=1) if self.sign > 0.0 else heights.min(axis=1))


def meeting(first: ConvexShape, X_1: pin.SE3, second: ConvexShape, X_2: pin.SE3, margin: float) -> Meeting | None:
    """Contact geometry of two shapes; None where they are farther apart than `margin`.

    Args:
        first: A shape.
        X_1: Pose of its joint in W.
        second: Another shape.
        X_2: Pose of its joint in W.
        margin: Largest gap of points that are returned [m].
    """
    near = nearest_points(first, X_1, second, X_2)
    return None if near.gap > margin else meeting_at(near, first, X_1, second, X_2, margin)


def meeting_at(near: Nearest, first: ConvexShape, X_1: pin.SE3, second: ConvexShape, X_2: pin.SE3, margin: float) -> Meeting:
    """Contact geometry of two shapes whose nearest points are known; arguments as of `meeting`."""
    gap, n, p_1, p_2 = near
    n, carrier, gap = _squared(first, X_1, second, X_2, n, gap)
    A, B = _Placed(first, X_1, n, 1.0), _Placed(second, X_2, n, -1.0)
    crossings = [c for c in _common(A, B, max(margin - gap, 0.0) + LEVEL_M) if c.gap <= margin]
    if not crossings:
        crossings = [_nearest_crossing(A, B, p_1, p_2, gap)]
    return Meeting(n, carrier, tuple(crossings))


def nearest_points(first: ConvexShape, X_1: pin.SE3, second: ConvexShape, X_2: pin.SE3) -> Nearest:
    """The nearest points of two shapes; arguments as of `meeting`."""
    gap, n, p_1, p_2 = _by_coal(first, X_1, second, X_2)
    if abs(gap) < IN_TOUCH_M:
        away = RETREAT_M * n
        gap, n, p_1, p_2 = _by_coal(first, X_1, second, pin.SE3(X_2.rotation, X_2.translation - away))
        return Nearest(gap - RETREAT_M, n, p_1, p_2 + away)
    return Nearest(gap, n, p_1, p_2)


def _by_coal(first: ConvexShape, X_1: pin.SE3, second: ConvexShape, X_2: pin.SE3) -> tuple[float, Array, Array, Array]:
    request = coal.DistanceRequest()
    request.enable_signed_distance = True
    poses = [X * s.X_JC for X, s in ((X_1, first), (X_2, second))]
    placed = [coal.Transform3s(X.rotation, X.translation) for X in poses]
    for tolerance in TOLERANCES:
        request.gjk_tolerance = request.epa_tolerance = tolerance
        result = coal.DistanceResult()
        gap = float(coal.distance(first.coal, placed[0], second.coal, placed[1], request, result))
        n = -np.array(result.normal, float)
        if abs(gap) < NO_DISTANCE and 0.5 < float(n @ n) < 2.0:
            return gap, n / np.linalg.norm(n), np.array(result.getNearestPoint1()), np.array(result.getNearestPoint2())
    raise NoSolution(f"Coal finds no distance between {first.name!r:.80} and {second.name!r:.80} at this pose.")


def _squared(
    first: ConvexShape, X_1: pin.SE3, second: ConvexShape, X_2: pin.SE3, n: Array, gap: float
) -> tuple[Array, int, float]:
    """(normal, carrier, gap) with a face's normal where one separates the shapes as far."""

    def parted(along: Array) -> Array:
        """Of several normals, shape (k, 3)."""
        low, high = first.extremes(along @ X_1.rotation), second.extremes(-along @ X_2.rotation)
        return low + high + along @ (X_1.translation - X_2.translation)

    best, carrier, most = n, 0, float(parted(n[None])[0])
    for number, shape, X, sign in ((2, second, X_2, 1.0), (1, first, X_1, -1.0)):
        N = sign * (shape.faces[:, :3] @ X.rotation.T)
        if gap >= -IN_TOUCH_M:
            N = N[N @ n >= NEARLY_ACROSS]
        if len(N):
            apart = parted(N)
            i = int(np.argmax(apart))
            if apart[i] > (most + SAME_M if carrier else most - SAME_M):
                best, carrier, most = N[i], number, float(apart[i])
    return best, carrier, most if carrier else gap


def _common(A: _Placed, B: _Placed, depth: float) -> list[Crossing]:
    """Corners of the intersection of two faces, of a face and an edge, or of two parallel edges; none for other pairs."""
    plane = across(A.n)
    sides = [_Side(placed, plane, *placed.near(depth)) for placed in (A, B)]
    P, Q = (side.corners for side in sides)
    found = overlap(P, Q)
    if not found:
        return []
    # A corner within the other's outline can be lower than the corners around it.
    found += [x for x in sides[0].flat if inside(x, Q)] + [x for x in sides[1].flat if inside(x, P)]
    points = [x for i, x in enumerate(found) if not any(same(x, y) for y in found[:i])]
    xy = np.array(points)
    base = xy @ plane
    high, low = sides[0].heights(xy, base), sides[1].heights(xy, base)
    gaps = high - low
    kept = spread(base, gaps, A.n)
    positions = base + (0.5 * (high + low))[:, None] * A.n
    out = []
    for i in kept.tolist():
        (first, one), (second, other) = (side.place(points[i]) for side in sides)
        name = f"{A.shape.name}:{one}|{B.shape.name}:{other}"
        out.append(Crossing(name, first, second, positions[i], float(gaps[i])))
    return sorted(out, key=lambda c: c.name)  # the same order at the next state


class _Side:
    """Points of one shape that are near the other, as seen along the normal."""

    def __init__(self, placed: _Placed, plane: Array, numbers: list[int], points: Array) -> None:
        self.placed, self.numbers = placed, numbers
        self.flat: list[Point] = [(x, y) for x, y in (points @ plane.T).tolist()]
        self.height = points @ placed.n
        self.hull = outline(self.flat)
        self.corners = [self.flat[i] for i in self.hull]

    def place(self, x: Point) -> tuple[int, str]:
        """(number of the point at x, or -1; a label: that number, those of the edge's ends, or "face")."""
        for number, p in zip(self.numbers, self.flat, strict=True):
            if same(x, p):
                return number, str(number)
        i = on_edge(x, self.corners)
        if i < 0:
            return -1, "face"
        low, high = sorted(self.numbers[self.hull[j % len(self.hull)]] for j in (i, i + 1))
        return -1, f"{low}-{high}"

    def heights(self, xy: Array, base: Array) -> Array:
        """Height q . n of the surface above or below some points: on the shape's faces, or along an edge."""
        if len(self.hull) == 2:
            sign, h = self.placed.sign, self.height.tolist()
            a, b = self.corners
            # Where two points coincide in this view the nearer one counts.
            ends = [sign * min(sign * h[i] for i, p in enumerate(self.flat) if same(p, end)) for end in (a, b)]
            along = np.array([b[0] - a[0], b[1] - a[1]])
            return ends[0] + ((xy - a) @ along) * (ends[1] - ends[0]) / float(along @ along)
        found = self.placed.surface(base)
        if found is None:  # a sheet
            flat = np.column_stack([self.flat, np.ones(len(self.flat))])
            found = np.column_stack([xy, np.ones(len(xy))]) @ np.linalg.lstsq(flat, self.height, rcond=None)[0]
        return found


def _nearest_crossing(A: _Placed, B: _Placed, p_1: Array, p_2: Array, gap: float) -> Crossing:
    """The nearest pair only: a ball, a corner, or edges that cross."""
    one, other = A.near(1e-6), B.near(1e-6)
    i = one[0][0] if len(one[0]) == 1 else -1
    j = other[0][0] if len(other[0]) == 1 else -1
    p = one[1][0] - 0.5 * gap * A.n if i >= 0 else other[1][0] + 0.5 * gap * A.n if j >= 0 else 0.5 * (p_1 + p_2)
    words = [s.shape.name + (f":{number}" if number >= 0 else "") for s, number in ((A, i), (B, j))]
    return Crossing("|".join(words), i, j, p, gap)
