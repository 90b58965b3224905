"""Convex polygons in the plane: support regions and soles as arrays, and intersections of outlines; which corners count.

One or two points, and points on a line, are accepted. Outlines are Python floats: ten times as fast as NumPy at ten points.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rbd.arrays import Array

SAME_M = 1e-9
"""Points nearer to each other than this are the same [m]."""
Point = tuple[float, float]

RIM_CORNERS = 8
"""Corners that replace a flat rim: a regular polygon in it, its edges up to 8 % of the radius inside."""
LOWEST = 8
"""When contact points are reduced to a few, this many of the lowest are always included, so that none in contact is dropped."""
DIRECTIONS = 8
"""The farthest point in each of this many horizontal directions is included too."""
MOST_POINTS = LOWEST + DIRECTIONS
TIPS = 0.1
"""A point at height h counts as nearer by h over this [rad]: points that touch only after a large tilt."""
_angles = 2.0 * np.pi * (np.arange(DIRECTIONS) + 0.5) / DIRECTIONS
TOWARDS = np.column_stack([np.cos(_angles), np.sin(_angles)])
"""These directions, shape (DIRECTIONS, 2)."""


def convex_hull(points: Array) -> Array:
    """Corners of the convex hull, counterclockwise, shape (h, 2); two points for points on a line, one for one point.

    Args:
        points: Shape (k, 2).
    """
    order = np.unique(np.round(np.asarray(points, float), 12), axis=0)
    return order if len(order) < 3 else order[_around(order, range(len(order)))]


def area_of(polygon: Array) -> float:
    """Of a polygon whose corners go counterclockwise [m2]; zero of fewer than three."""
    if len(polygon) < 3:
        return 0.0
    x, y = polygon.T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def inside_distance(point: Array, hull: Array) -> float:
    """Signed distance from a point to the edge of a convex hull: positive inside, negative outside.

    Args:
        point: Shape (2,).
        hull: From `convex_hull`; with fewer than three corners every point is outside, or on it; with none, -inf.
    """
    if len(hull) == 0:
        return -math.inf
    p = np.asarray(point, float)[:2]
    distance = float(np.linalg.norm(p - nearest_on_edge(p, hull)))
    ends = np.roll(hull, -1, axis=0)
    inside = len(hull) > 2 and all(_turn(a, b, p) >= 0.0 for a, b in zip(hull, ends, strict=True))
    return distance if inside else -distance


def nearest_on_edge(point: Array, hull: Array) -> Array:
    """The point of the edge of a convex hull that is nearest to a point, shape (2,).

    Args:
        point: Shape (2,).
        hull: From `convex_hull`, of one corner or more.
    """
    along = np.roll(hull, -1, axis=0) - hull
    t = np.clip(((point - hull) * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), 1e-300), 0.0, 1.0)
    near = hull + t[:, None] * along
    return np.asarray(near[int(np.argmin(((point - near) ** 2).sum(axis=1)))])


def half_planes(hull: Array) -> tuple[Array, Array]:
    """(normals, offsets): the hull is where normals p >= offsets, shapes (h, 2) and (h,); normals point inward, of length one.

    Of two corners, a line, the two rows bound its ends and leave the direction across it free.

    Args:
        hull: As `convex_hull` gives it, of two corners or more.
    """
    along = np.roll(hull, -1, axis=0) - hull
    along /= np.linalg.norm(along, axis=1)[:, None]
    normals = along if len(hull) == 2 else np.column_stack([-along[:, 1], along[:, 0]])
    return normals, np.einsum("ij,ij->i", normals, hull)


def across(n: Array) -> Array:
    """Two unit vectors across n, shape (2, 3), in a right-handed order."""
    x, y, z = n.tolist()
    if abs(z) > 0.7:
        s = math.hypot(z, x)
        a, b, c = z / s, 0.0, -x / s
    else:
        s = math.hypot(x, y)
        a, b, c = -y / s, x / s, 0.0
    return np.array([[a, b, c], [y * c - z * b, z * a - x * c, x * b - y * a]])


def outline(points: Sequence[Point]) -> list[int]:
    """Indices of the corners of the convex hull, counterclockwise; two for points on a line, one where all are the same."""
    order = sorted(range(len(points)), key=lambda i: points[i])
    order = [i for n, i in enumerate(order) if not n or not same(points[i], points[order[n - 1]])]
    if len(order) < 3:
        return order
    return _around(points, order)


def _around(points: Sequence[Point] | Array, order: Sequence[int]) -> list[int]:
    """Indices of the corners of the convex hull, counterclockwise, of points in ascending order (Andrew's chains)."""

    def chain(run: Sequence[int]) -> list[int]:
        out: list[int] = []
        for i in run:
            while len(out) > 1 and _turn(points[out[-2]], points[out[-1]], points[i]) <= 1e-14:
                out.pop()
            out.append(i)
        return out

    return chain(order)[:-1] + chain(order[::-1])[:-1]


def overlap(P: Sequence[Point], Q: Sequence[Point]) -> list[Point]:
    """Corners of the intersection of two outlines; the ends of a segment where one is a line, or both coincide.

    Lines that cross have none.
    """
    if len(Q) < 2 or len(P) < 2:
        return []
    if len(Q) == 2:
        if len(P) == 2:
            return _stretch(P, Q)
        P, Q = Q, P
    out = list(P)
    for a, b in _edges(Q):
        length = math.hypot(b[0] - a[0], b[1] - a[1])
        x, y = (a[1] - b[1]) / length, (b[0] - a[0]) / length
        out = clipped(out, x, y, x * a[0] + y * a[1])
    return out


def inside(x: Point, corners: Sequence[Point]) -> bool:
    """Whether a point is inside an outline of three corners or more, and not on its edge."""
    return len(corners) > 2 and all(_turn(a, b, x) > SAME_M * math.hypot(b[0] - a[0], b[1] - a[1]) for a, b in _edges(corners))


def on_edge(x: Point, corners: Sequence[Point]) -> int:
    """Number of the edge that a point is on (its first corner's), or -1."""
    for i, (a, b) in enumerate(_edges(corners)):
        length = math.hypot(b[0] - a[0], b[1] - a[1])
        if abs(_turn(a, b, x)) < 100.0 * SAME_M * length:
            along = ((x[0] - a[0]) * (b[0] - a[0]) + (x[1] - a[1]) * (b[1] - a[1])) / length
            if -SAME_M <= along <= length + SAME_M:
                return i
    return -1


def same(a: Point, b: Point) -> bool:
    """Whether two points coincide, to 10 nm: intersections have rounding errors."""
    return abs(a[0] - b[0]) < 10.0 * SAME_M and abs(a[1] - b[1]) < 10.0 * SAME_M


def _edges(corners: Sequence[Point]) -> list[tuple[Point, Point]]:
    return list(zip(corners, [*corners[1:], corners[0]], strict=True))


def clipped(points: list[Point], x: float, y: float, least: float) -> list[Point]:
    """The part of a polygon with p . (x, y) >= least; (x, y) of unit length."""
    away = [x * p[0] + y * p[1] - least for p in points]
    out = []
    for i, (p, s) in enumerate(zip(points, away, strict=True)):
        if s >= -SAME_M:
            out.append(p)
        j = (i + 1) % len(points)
        q, t = points[j], away[j]
        if (s > SAME_M and t < -SAME_M) or (s < -SAME_M and t > SAME_M):
            share = s / (s - t)
            out.append((p[0] + share * (q[0] - p[0]), p[1] + share * (q[1] - p[1])))
    return out


def _stretch(P: Sequence[Point], Q: Sequence[Point]) -> list[Point]:
    """Overlap of two lines that are parallel to a degree, seen along the second."""
    u, v = (P[1][0] - P[0][0], P[1][1] - P[0][1]), (Q[1][0] - Q[0][0], Q[1][1] - Q[0][1])
    size, length = math.hypot(*u), math.hypot(*v)
    if abs(u[0] * v[1] - u[1] * v[0]) > 0.02 * size * length:
        return []
    x, y = v[0] / length, v[1] / length
    s = sorted((p[0] - Q[0][0]) * x + (p[1] - Q[0][1]) * y for p in P)
    low, high = max(s[0], 0.0), min(s[1], length)
    return [(Q[0][0] + t * x, Q[0][1] + t * y) for t in (low, high)] if high - low > SAME_M else []


def _turn(a: Point | Array, b: Point | Array, c: Point | Array) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
