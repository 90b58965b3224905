"""Compiled: corners of convex hulls that are near the faces of pieces of terrain.

A hull and a piece are farthest apart along one of the piece's faces, or nearly: then corners of the hull over that face are its
points, as on a plane. Where it may touch across the face's edge it is a pair for the general way. Faces of several pieces in
one plane are one face.
"""

from __future__ import annotations

import numpy as np

from rbd.arrays import Array
from rbd.constraints.convex.polygons import SAME_M
from rbd.constraints.plane_kernel import spread
from rbd.constraints.terrain.pieces import Polytopes, Spots
from rbd.constraints.terrain.touching_kernel import (
    ALIKE,
    CORNER,
    ON_FACE,
    POLYTOPES,
    SEAM_M,
    SPOTS,
    clear_of,
    dot,
    joined,
    wall,
)
from rbd.kernels import COUNT, FLAG, NUMBER, array, compiled, signature


@compiled
def _inside(x: Array, n: Array, loop: Array, vertices: Array) -> bool:
    """Whether a point is over a face with a normal n; a half-space has no edges."""
    for j in range(len(loop)):
        a, b = vertices[loop[j]], vertices[loop[(j + 1) % len(loop)]]
        m = wall(n, a, b)
        if dot(m, x) < dot(m, a) - SAME_M:
            return False
    return True


@compiled
def _turned(Q: Array, n: Array, up: Array) -> None:
    """A direction in W in a body's axes, Q^T n."""
    for i in range(3):
        up[i] = Q[0, i] * n[0] + Q[1, i] * n[1] + Q[2, i] * n[2]


def _hulls(
    R: Array,
    p: Array,
    body: Array,
    centres: Array,
    reach: Array,
    rounds: Array,
    points: Array,
    at: Array,
    margin: float,
    near: float,
    pieces: Polytopes,
    out: Spots,
    pairs: Array,
) -> tuple[int, int]:
    """(points of hulls over faces of pieces, pairs for the general way); -1 if there is no room for them.

    Args:
        R: R_WJ of the bodies, shape (bodies, 3, 3).
        p: Their places, shape (bodies, 3) [m].
        body: Of each shape, shape (shapes,).
        centres: Of a bounding ball of each, in its body's axes, shape (shapes, 3) [m].
        reach: Radius of that ball, shape (shapes,) [m].
        rounds: Which have rims and other round parts: near a piece they are pairs, shape (shapes,).
        points: Corners of all, in their bodies' axes, shape (3, n) [m].
        at: Where those of each shape begin, and n.
        margin: Of points that are returned [m].
        near: Of pairs [m].
        pieces: The pieces.
        out: Written: the points; `which` has the corner, the face, the piece and the shape.
        pairs: Written: (shape, piece), shape (most, 2).
    """
    boxes, faces, vertices, _, loops, loop_at, _, begins, kinds, _ = pieces
    places, normals, gaps, which, ways = out
    k, found, total = 0, 0, points.shape[1]
    above, group = np.empty(total), np.empty(total, np.int64)
    near_ones, carriers, parted = np.empty(len(boxes), np.int64), np.empty(len(boxes), np.int64), np.empty(len(boxes))
    c, up, x, above_all = np.empty(3), np.empty(3), np.empty(3), np.zeros(3)
    above_all[2] = 1.0
    for s in range(len(body)):
        Q, o, far, begin = R[body[s]], p[body[s]], reach[s] + margin, k
        for i in range(3):
            c[i] = o[i] + dot(Q[i], centres[s])
        candidates = 0
        for piece in range(len(boxes)):
            if clear_of(boxes[piece], c - far, c + far):
                continue
            most = -np.inf
            for f in range(begins[piece, 0], begins[piece + 1, 0]):
                most = max(most, dot(faces[f], c) - faces[f, 3])
            if most > far:
                continue
            if rounds[s]:
                if most <= reach[s] + near:
                    if found >= len(pairs):
                        return -1, found
                    pairs[found, 0], pairs[found, 1] = s, piece
                    found += 1
                continue
            best, carrier = -np.inf, -1
            for f in range(begins[piece, 0], begins[piece + 1, 0]):
                _turned(Q, faces[f], up)
                level, least = dot(faces[f], o) - faces[f, 3], np.inf
                for i in range(at[s], at[s + 1]):
                    least = min(least, points[0, i] * up[0] + points[1, i] * up[1] + points[2, i] * up[2])
                s_f = least + level
                if carrier < 0 or s_f > best + SAME_M or (s_f > best - SEAM_M and faces[f, 2] > faces[carrier, 2] + ALIKE):
                    best, carrier = s_f, f
                if best > margin:
                    break
            if best <= margin:
                near_ones[candidates], carriers[candidates], parted[candidates] = piece, carrier, best
                candidates += 1
        for one in range(candidates):
            f, piece = carriers[one], near_ones[one]
            n = faces[f, :3].copy()
            _turned(Q, n, up)
            level, size = dot(n, o) - faces[f, 3], 0
            for i in range(at[s], at[s + 1]):
                above[i] = points[0, i] * up[0] + points[1, i] * up[1] + points[2, i] * up[2] + level
                if above[i] <= margin:
                    group[size] = i
                    size += 1
            over = False
            for i in spread(points, above, group[:size].copy(), up):
                for r in range(3):
                    x[r] = o[r] + Q[r, 0] * points[0, i] + Q[r, 1] * points[1, i] + Q[r, 2] * points[2, i]
                if _inside(x, n, loops[loop_at[f] : loop_at[f + 1]], vertices[begins[piece, 1] : begins[piece + 1, 1]]):
                    if k + 1 >= len(gaps):
                        return -1, found
                    places[k], normals[k], gaps[k], ways[k] = x, n, above[i], n
                    which[k, 0], which[k, 1], which[k, 2] = CORNER, i - at[s], f - begins[piece, 0]
                    which[k, 3], which[k, 4], which[k, 5] = piece, ON_FACE, s
                    k += 1
                elif above[i] <= near and not over:
                    over = True  # it hangs over the edge, unless another piece goes on there
                    for other in range(candidates):
                        g, there = carriers[other], near_ones[other]
                        away = faces[g] - faces[f]
                        if dot(away, away) >= ALIKE * ALIKE or abs(away[3]) >= SAME_M:
                            continue
                        corners = vertices[begins[there, 1] : begins[there + 1, 1]]
                        if _inside(x, n, loops[loop_at[g] : loop_at[g + 1]], corners):
                            over = False
                            break
            if over and parted[one] <= near:
                if found >= len(pairs):
                    return -1, found
                pairs[found, 0], pairs[found, 1] = s, piece
                found += 1
        k = joined(begin, k, above_all, 1, faces, begins, kinds, out)
    return k, found


hulls = compiled(
    _hulls,
    signature(
        (COUNT, COUNT), array(3), array(2), array(1, COUNT), array(2), array(1), array(1, FLAG), array(2), array(1, COUNT),
        NUMBER, NUMBER, POLYTOPES, SPOTS, array(2, COUNT, written=True),
    ),
)  # fmt: skip
