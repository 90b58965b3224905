"""Convex polygons in the plane: support regions and soles. One and two points, and points on a line, are fine."""

from __future__ import annotations

import math

import numpy as np

from rbd.arrays import Array


def convex_hull(points: Array) -> Array:
    """Corners of the convex hull, counterclockwise, shape (h, 2); two points for points on a line, one for one point.

    Args:
        points: Shape (k, 2).
    """
    order = np.unique(np.round(np.asarray(points, float), 12), axis=0)
    if len(order) < 3:
        return order

    def chain(run: Array) -> list[Array]:
        out: list[Array] = []
        for p in run:
            while len(out) > 1 and _turn(out[-2], out[-1], p) <= 1e-14:
                out.pop()
            out.append(p)
        return out

    return np.array(chain(order)[:-1] + chain(order[::-1])[:-1])


def inside_distance(point: Array, hull: Array) -> float:
    """Signed distance from a point to the edge of a convex hull: positive inside, negative outside.

    Args:
        point: Shape (2,).
        hull: As `convex_hull` gives it; of fewer than three corners every point is outside, or on it; of none, -inf.
    """
    if len(hull) == 0:
        return -math.inf
    p = np.asarray(point, float)[:2]
    if len(hull) == 1:
        return -float(np.linalg.norm(p - hull[0]))
    ends = np.roll(hull, -1, axis=0)
    along = ends - hull
    t = np.clip(((p - hull) * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), 1e-300), 0.0, 1.0)
    distance = float(np.linalg.norm(p - hull - t[:, None] * along, axis=1).min())
    inside = len(hull) > 2 and all(_turn(a, b, p) >= 0.0 for a, b in zip(hull, ends, strict=True))
    return distance if inside else -distance


def _turn(a: Array, b: Array, c: Array) -> float:
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
