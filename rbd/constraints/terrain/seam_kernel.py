"""Compiled: which points of one plate, or hull, are inside the surface that convex pieces of terrain have together."""

from __future__ import annotations

import numpy as np

from rbd.arrays import Array
from rbd.constraints.convex.polygons import SAME_M
from rbd.constraints.terrain.pieces import CORNER, Spots
from rbd.kernels import compiled

LEAN = 1e-3
"""Faces with less than this along `up` are not under the plate."""
SEAM_M, LIFT_M = 1e-6, 4e-6
"""Pieces that meet within the first length are joined; a step from one to the next that is lower than the second is none."""
ALIKE = 1e-6
"""Normals that differ by less are the same."""


@compiled
def dot(a: Array, b: Array) -> float:
    """The product of two vectors, of three components each."""
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


@compiled
def within(x: Array, faces: Array) -> float:
    """The largest N x - d: negative inside."""
    most = -np.inf
    for f in faces:
        most = max(most, f[0] * x[0] + f[1] * x[1] + f[2] * x[2] - f[3])
    return most


@compiled
def _beyond(x: Array, a: float, n: Array, b: float, m: Array, faces: Array) -> float:
    """`within` of x + a n + b m."""
    most = -np.inf
    for f in faces:
        u, v, w = x[0] + a * n[0] + b * m[0], x[1] + a * n[1] + b * m[1], x[2] + a * n[2] + b * m[2]
        most = max(most, f[0] * u + f[1] * v + f[2] * w - f[3])
    return most


@compiled
def _beside(x: Array, box: Array, faces: Array, first: int, last: int) -> bool:
    """Whether a point is outside of a piece in a box, by more than a seam."""
    for c in range(3):
        if x[c] < box[c] - SEAM_M or x[c] > box[3 + c] + SEAM_M:
            return True
    for f in range(first, last):
        if faces[f, 0] * x[0] + faces[f, 1] * x[1] + faces[f, 2] * x[2] - faces[f, 3] > SEAM_M:
            return True
    return False


@compiled
def _apart(a: Array, b: Array) -> float:
    """The square of the distance of two points."""
    return float((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


@compiled
def _is_there(x: Array, first: int, last: int, begin: int, places: Array, dropped: Array) -> bool:
    """Whether a point from `first` to `last` that is kept is at x."""
    for c in range(first, last):
        if not dropped[c - begin] and _apart(places[c], x) < SEAM_M * SEAM_M:
            return True
    return False


@compiled
def _is_face(n: Array, faces: Array) -> bool:
    for f in faces:
        if abs(f[0] - n[0]) + abs(f[1] - n[1]) + abs(f[2] - n[2]) < ALIKE:
            return True
    return False


@compiled
def joined(
    begin: int, end: int, up: Array, size: int, boxes: Array, faces: Array, begins: Array, kinds: Array, out: Spots
) -> int:
    """Drops points of one plate that are inside the surface that its pieces have together; their number.

    A point of a piece B at a place of another piece A is one of B's edges that A continues, unless B rises from A there. Where
    the two move differently, points of outlines over a level seam of them stay: on either side.
    """
    places, normals, gaps, which, ways = out
    dropped, firsts, pieces = np.zeros(end - begin, np.bool_), np.empty(end - begin + 1, np.int64), 0
    for m in range(begin, end):
        if m == begin or which[m, 3] != which[m - 1, 3]:
            firsts[pieces] = m
            pieces += 1
    firsts[pieces] = end
    for m in range(begin, end):
        b = which[m, 3]
        x, own = places[m] - gaps[m] * normals[m], faces[begins[b, 0] : begins[b + 1, 0]]
        for i in range(pieces):
            h = firsts[i]
            a = which[h, 3]
            if a == b:
                continue
            outside = _beside(x, boxes[a], faces, begins[a, 0], begins[a + 1, 0])
            if outside and which[m, 0] != CORNER:
                continue
            turned = _apart(normals[h], normals[m])
            alike = turned < ALIKE * ALIKE
            if alike and which[m, 0] == CORNER:  # one corner over two pieces that meet, or one above the other: the higher one
                for c in range(h, firsts[i + 1]):
                    if which[c, 0] == CORNER and which[c, 1] == which[m, 1] and not dropped[c - begin]:
                        level = gaps[c] - gaps[m]
                        dropped[m - begin] |= level < -SAME_M or (level < SAME_M and c < m)
            if dropped[m - begin]:
                break
            moves_apart = kinds[a] != kinds[b] and which[m, 0] != CORNER and turned < LEAN * LEAN
            if outside or (moves_apart and not alike):
                continue
            others = faces[begins[a, 0] : begins[a + 1, 0]]
            goes_on = _beyond(x, LIFT_M, normals[m], 0.0, up, others)
            for way in (normals[h], up):
                if goes_on <= SEAM_M:
                    goes_on = _beyond(x, LIFT_M, normals[m], LIFT_M, way, others)
            if goes_on <= SEAM_M:
                dropped[m - begin] = True  # A goes on where B ends
            elif not alike:
                dropped[m - begin] = _beyond(x, LIFT_M, normals[h], 0.0, up, own) > SEAM_M
                if dropped[m - begin] and which[m, 0] == CORNER and which[h, 0] == CORNER:  # a valley, where both rise
                    c, lift = dot(normals[h], normals[m]), LIFT_M / np.sqrt(0.5 * turned)
                    at = places[h] - gaps[h] * normals[h]
                    up_b, up_a = lift * (normals[h] - c * normals[m]), lift * (normals[m] - c * normals[h])
                    rise = max(within(x + up_b, own), within(x + up_a, others)) <= SEAM_M
                    meet = _is_face(normals[m], own) and _is_face(normals[h], others) and abs(dot(normals[h], x - at)) <= SEAM_M
                    dropped[m - begin] = not (rise and meet)
            elif which[m, 0] != CORNER and kinds[a] == kinds[b]:
                flat = size > 2 and _is_face(normals[m], own) and _is_face(normals[m], others)
                dropped[m - begin] = flat or _is_there(places[m], h, min(m, firsts[i + 1]), begin, places, dropped)
            if dropped[m - begin]:
                break
    kept = begin
    for m in range(begin, end):
        if not dropped[m - begin]:
            if kept != m:
                places[kept], normals[kept], gaps[kept] = places[m], normals[m], gaps[m]
                which[kept], ways[kept] = which[m], ways[m]
            kept += 1
    return kept
