"""Compiled: contact points of flat plates with convex pieces of terrain.

A plate is a point, an edge, or a convex polygon with the direction `up` out of the ground; a piece is a set of faces
N x <= d, with its corners and edges, or a half-space. The normal n, out of the piece, is the one along which they are farthest
apart,

    s(n) = (lowest p . n of the plate) - (highest p . n of the piece)

among the piece's faces, the plate's `up`, and the cross products of edges of both: the signed distance of what overlaps, and
of what does not a lower bound of it. Along a face the points are the corners of the part of the plate that is over that face;
along `up` those of the part of the piece that is under the plate; else the nearest pair. A plate has no upper side.

`P` are the plate's corners, in W, in order. Of a plate with a radius, one corner is a ball, two are a capsule without its ends.
"""

from __future__ import annotations

import math

import numpy as np

from rbd.arrays import Array
from rbd.constraints.convex.polygons import SAME_M
from rbd.constraints.terrain.pieces import (
    CORNER,
    CROSSING,
    EDGES,
    ON_FACE,
    ON_PLATE,
    OTHER,
    UNDER,
    Plates,
    Polytopes,
    Spots,
)
from rbd.constraints.terrain.seam_kernel import ALIKE, LEAN, SEAM_M, dot, joined, within
from rbd.kernels import COUNT, NUMBER, array, compiled, record, signature

UPPER = -0.2
"""A normal with less than this along `up` is against the plate's upper side, which touches nothing."""
RELAXED = 0.1
"""Sine by which a direction from a piece to a capsule's axis may be off the piece's normals."""
ALONG = 1e-3
"""An axis and an edge whose directions have less than this sine do not cross."""


@compiled
def cross(a: Array, b: Array) -> Array:
    """The vector product."""
    out = np.empty(3)
    out[0], out[1], out[2] = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
    return out


@compiled
def _lowest(P: Array, n: Array) -> float:
    least = np.inf
    for p in P:
        least = min(least, p[0] * n[0] + p[1] * n[1] + p[2] * n[2])
    return least


@compiled
def _extent(P: Array, x: float, y: float, z: float) -> tuple[float, float]:
    least, most = np.inf, -np.inf
    for p in P:
        along = p[0] * x + p[1] * y + p[2] * z
        least, most = min(least, along), max(most, along)
    return least, most


@compiled
def wall(n: Array, a: Array, b: Array) -> Array:
    """Unit vector across an edge from a to b of a face with normal n, into the face."""
    x, y, z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    m = np.empty(3)
    m[0], m[1], m[2] = n[1] * z - n[2] * y, n[2] * x - n[0] * z, n[0] * y - n[1] * x
    size = math.sqrt(max(dot(m, m), 1e-300))
    m[0], m[1], m[2] = m[0] / size, m[1] / size, m[2] / size
    return m


@compiled
def walls_of(n: Array, loop: Array, vertices: Array) -> Array:
    """(m, level) of each edge of a face with a normal n, m . x >= level over the face, shape (edges, 4)."""
    out = np.empty((len(loop), 4))
    for j in range(len(loop)):
        a = vertices[loop[j]]
        out[j, :3] = wall(n, a, vertices[loop[(j + 1) % len(loop)]])
        out[j, 3] = dot(out[j], a)
    return out


@compiled
def over(x: Array, walls: Array) -> bool:
    """Whether a point is over a face; a half-space has no edges."""
    for m in walls:
        if m[0] * x[0] + m[1] * x[1] + m[2] * x[2] < m[3] - SAME_M:
            return False
    return True


@compiled
def _covers(face: Array, loop: Array, vertices: Array, P: Array) -> bool:
    """Whether all corners of a plate are over a face."""
    for j in range(len(loop)):
        a, b = vertices[loop[j]], vertices[loop[(j + 1) % len(loop)]]
        x, y, z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        u, v, w = face[1] * z - face[2] * y, face[2] * x - face[0] * z, face[0] * y - face[1] * x
        least = -SAME_M * math.sqrt(u * u + v * v + w * w)
        for p in P:
            if u * (p[0] - a[0]) + v * (p[1] - a[1]) + w * (p[2] - a[2]) < least:
                return False
    return True


@compiled
def _faced(P: Array, up: Array, piece: tuple[Array, ...], margin: float, normal: Array) -> tuple[float, int, bool]:
    """(separation along faces, number of the face, whether the plate is over it); writes its normal."""
    faces, vertices, _, loops, starts = piece[:5]
    best, carrier = -np.inf, -3
    for f in range(len(faces)):
        s = _lowest(P, faces[f]) - faces[f, 3]
        # Of faces that are as far, at their edge, the one that looks up.
        if carrier == -3 or s > best + SAME_M or (s > best - SEAM_M and dot(faces[f], up) > dot(normal, up) + ALIKE):
            best, carrier = s, f
            normal[:] = faces[f, :3]
    covered = best <= margin and _covers(normal, loops[starts[carrier] : starts[carrier + 1]], vertices, P)
    return best, carrier, covered


@compiled
def _parted(P: Array, up: Array, piece: tuple[Array, ...], best: float, carrier: int, normal: Array) -> tuple[float, int]:
    """(separation, number of the face that gives the normal; -1: `up`, -2: edges that cross), from `_faced`; the normal."""
    vertices, dirs, k = piece[1], piece[5], len(P)
    if k > 2:
        s = _lowest(P, up) + _lowest(vertices, -up)
        if s > best + SAME_M:
            best, carrier = s, -1
            normal[:] = up
    for i in range(1 if k == 2 else k):
        a, b = P[i], P[(i + 1) % k]
        x, y, z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        for d in dirs:
            u, v, w = y * d[2] - z * d[1], z * d[0] - x * d[2], x * d[1] - y * d[0]
            size = math.sqrt(u * u + v * v + w * w)
            if size < 1e-6 * math.sqrt(x * x + y * y + z * z):
                continue
            u, v, w = u / size, v / size, w / size
            (low, high), (bottom, top) = _extent(P, u, v, w), _extent(vertices, u, v, w)
            if low - top > best + SAME_M:
                best, carrier = low - top, -2
                normal[0], normal[1], normal[2] = u, v, w
            if bottom - high > best + SAME_M:
                best, carrier = bottom - high, -2
                normal[0], normal[1], normal[2] = -u, -v, -w
    return best, carrier


@compiled
def put(k: int, x: Array, n: Array, gap: float, label: tuple[int, int, int], way: Array, out: Spots) -> int:
    """Adds a point to those of this piece, unless it is among them; the new number of points.

    The piece's own points begin at `which[k, 4]`.
    """
    places, normals, gaps, which, ways = out
    kind, i, j = label
    first = which[k, 4]
    for m in range(first, k):
        if which[m, 0] == kind and which[m, 1] == i and which[m, 2] == j:
            return k
    if k + 1 >= len(gaps):
        return k
    places[k], normals[k], gaps[k], ways[k] = x, n, gap, way
    which[k, 0], which[k, 1], which[k, 2] = kind, i, j
    which[k + 1, 3], which[k + 1, 4] = which[k, 3], first
    return k + 1


@compiled
def _clipped(x: Array, own: Array, count: int, m: Array, y: Array, of: Array) -> int:
    """The part of a polygon of `count` corners x with m . x >= level, m = (m, level), in place; their number.

    y and `of` are room for it, two rows more than x has.
    """
    inside, kept = 0, 0
    for i in range(count):
        y[i, 0] = dot(m, x[i]) - m[3]
        inside += y[i, 0] >= -SAME_M
    if inside == count:
        return count
    levels = y[:count, 0].copy()
    for i in range(count):
        h = (i + 1) % count
        s, t = levels[i], levels[h]
        if s >= -SAME_M:
            for c in range(3):
                y[kept, c] = x[i, c]
            of[kept] = own[i]
            kept += 1
        if count > 1 and ((s > SAME_M and t < -SAME_M) or (s < -SAME_M and t > SAME_M)):
            for c in range(3):
                y[kept, c] = x[i, c] + (s / (s - t)) * (x[h, c] - x[i, c])
            of[kept] = -1
            kept += 1
    kept = min(kept, len(x))
    for i in range(kept):
        own[i] = of[i]
        for c in range(3):
            x[i, c] = y[i, c]
    return kept


@compiled
def _edge_of(x: Array, P: Array) -> int:
    """The edge of an outline that is nearest to a point."""
    best, found, k = np.inf, 0, len(P)
    for i in range(k):
        a, b = P[i], P[(i + 1) % k]
        u, v, w = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        r, s, q = x[0] - a[0], x[1] - a[1], x[2] - a[2]
        t = min(max((u * r + v * s + w * q) / max(u * u + v * v + w * w, 1e-300), 0.0), 1.0)
        away = (r - t * u) ** 2 + (s - t * v) ** 2 + (q - t * w) ** 2
        if away < best:
            best, found = away, i
    return found


@compiled
def edge_number(a: int, b: int, corners: int) -> int:
    """The number of an edge between two of a piece's corners."""
    return min(a, b) + corners * max(a, b)


@compiled
def entry(x: Array, up: Array, faces: Array, most: float) -> tuple[float, int]:
    """(length down from x against `up` to where that line enters a solid, face there); infinite if it does not by `most`."""
    enters, leaves, at = -np.inf, np.inf, -1
    for f in range(len(faces)):
        lean, s = dot(up, faces[f]), dot(faces[f], x) - faces[f, 3]
        if lean > LEAN:
            if s > enters * lean:
                enters, at = s / lean, f
        elif lean < -LEAN:
            leaves = min(leaves, s / lean)
        elif s > SAME_M:
            return np.inf, -1
        if enters > leaves or enters > most:
            return np.inf, -1
    return enters, at


@compiled
def _over(
    k: int, P: Array, number: int, face: Array, loop: Array, vertices: Array, margin: float, out: Spots
) -> int:
    """The part of a plate over a face: its corners, crossings of its outline with the face's edges, corners of the face."""
    n, edges, walls, count = face[:3].copy(), len(loop), walls_of(face, loop, vertices), len(P)
    most = count + edges
    x, own, y, of = np.empty((most, 3)), np.empty(most, np.int64), np.empty((most + 2, 3)), np.empty(most + 2, np.int64)
    for i in range(count):
        x[i], own[i] = P[i], i
    for m in walls:
        count = _clipped(x, own, count, m, y, of)
    for i in range(count):
        gap = dot(n, x[i]) - face[3]
        if gap > margin:
            continue
        if own[i] >= 0:
            k = put(k, x[i], n, gap, (CORNER, own[i], number), n, out)
            continue
        one, two, way = -1, -1, n
        for j in range(edges):
            if abs(dot(walls[j], x[i]) - walls[j, 3]) < 10.0 * SAME_M:
                one, two, way = j, one, walls[j, :3].copy()
        if two >= 0:  # on two of its edges; the corner is the first of the later one, or of the first
            at = one if one - two == 1 else 0
            k = put(k, x[i], n, gap, (UNDER, 0, loop[at]), n, out)
        else:
            j = max(one, 0)
            edge = edge_number(loop[j], loop[(j + 1) % edges], len(vertices))
            k = put(k, x[i], n, gap, (CROSSING, _edge_of(x[i], P), edge), way, out)
    return k


@compiled
def under(
    k: int,
    P: Array,
    up: Array,
    faces: Array,
    vertices: Array,
    edges: Array,
    margin: float,
    out: Spots,
) -> int:
    """The part of a piece under a plate: its corners, its edges under the plate's outline; and corners of the plate over it."""
    size, level, middle = len(P), dot(up, P[0]), np.zeros(3)
    for p in P:
        middle = middle + p / size
    for e in range(len(edges)):
        if max(dot(up, faces[edges[e, 2]]), dot(up, faces[edges[e, 3]])) < LEAN:
            continue
        a, b = vertices[edges[e, 0]], vertices[edges[e, 1]]
        low, high, first, last = 0.0, 1.0, -1, -1
        for i in range(size):
            m = wall(up, P[i], P[(i + 1) % size])
            if dot(m, middle - P[i]) < 0.0:
                m = -m
            s, t = dot(m, a - P[i]), dot(m, b - P[i])
            if s < -SAME_M and t < -SAME_M:
                low = 2.0
                break
            if s < -SAME_M and t > SAME_M and s / (s - t) > low:
                low, first = s / (s - t), i
            elif s > SAME_M and t < -SAME_M and s / (s - t) < high:
                high, last = s / (s - t), i
        if low > high:
            continue
        for share, outline, end in ((low, first, edges[e, 0]), (high, last, edges[e, 1])):
            x = a + share * (b - a)
            gap = level - dot(up, x)
            if gap <= margin:
                edge = edge_number(edges[e, 0], edges[e, 1], len(vertices))
                label = (UNDER, 0, end) if outline < 0 else (CROSSING, outline, edge)
                k = put(k, x + gap * up, up, gap, label, b - a, out)
    for i in range(size):  # where the line down from a corner enters the piece
        enters, _ = entry(P[i], up, faces, margin)
        if enters <= margin:
            k = put(k, P[i], up, enters, (CORNER, i, -1), up, out)
    return k


@compiled
def ends(a: Array, b: Array, c: Array, d: Array) -> tuple[float, float]:
    """Shares along a to b and along c to d of the points that are nearest to each other; an end may be both of one."""
    u, v, r = b - a, d - c, a - c
    uu, vv, uv, ur, vr = dot(u, u), dot(v, v), dot(u, v), dot(u, r), dot(v, r)
    det = uu * vv - uv * uv
    s = min(max((uv * vr - vv * ur) / det, 0.0), 1.0) if det > 1e-12 * uu * vv and det > 0.0 else 0.0
    t = (uv * s + vr) / vv if vv > 0.0 else 0.0
    if t < 0.0 or t > 1.0:
        t = min(max(t, 0.0), 1.0)
        s = min(max((uv * t - ur) / uu, 0.0), 1.0) if uu > 0.0 else 0.0
    return s, t


@compiled
def _nearest(
    k: int, P: Array, vertices: Array, edges: Array, best: float, n: Array, margin: float, out: Spots
) -> int:
    """The nearest points of an outline and a piece's edges: apart, or crossing along a normal n with a distance `best`."""
    size, least = len(P), np.inf
    one, other, i_at, e_at, t_at = np.zeros(3), np.zeros(3), 0, 0, 0.5
    for i in range(1 if size < 3 else size):
        a, b = P[i], P[(i + 1) % size]
        for e in range(len(edges)):
            c, d = vertices[edges[e, 0]], vertices[edges[e, 1]]
            s, t = ends(a, b, c, d)
            p, q = a + s * (b - a), c + t * (d - c)
            away = dot(p - q, p - q)
            if away < least:
                least, one, other, i_at, e_at, t_at = away, p, q, i, e, t
    gap, label = best, (OTHER, i_at, edge_number(edges[e_at, 0], edges[e_at, 1], len(vertices)))
    if best > SAME_M:
        gap = math.sqrt(least)
        n = (one - other) / gap
    way = vertices[edges[e_at, 1]] - vertices[edges[e_at, 0]]
    if size == 1 and (t_at <= 0.0 or t_at >= 1.0):  # at a corner
        way = np.zeros(3)
    return put(k, one, n, gap, label, way, out) if gap <= margin else k


@compiled
def _on_piece(k: int, P: Array, up: Array, piece: tuple[Array, ...], margin: float, out: Spots) -> int:
    """Adds the points of a plate with one piece; their number.

    Where a plate is over one face, or level with one that it is partly over, and not below it, no other direction parts them
    further: none is tried, nor where they are farther apart than the margin. A plate that is farthest from a face that another
    piece covers is over that piece, whose points are nearer.
    """
    faces, vertices, edges, loops, starts, _, inner = piece
    n, size = np.empty(3), len(P)
    best, carrier, covered = _faced(P, up, piece, margin, n)
    if best > margin or inner[carrier]:
        return k
    before, how, loop = k, ON_FACE, loops[starts[carrier] : starts[carrier + 1]]
    known = len(vertices) == 0 or size == 1 or (covered and best > -SAME_M)
    if not known and size > 2 and best > -SAME_M and -_lowest(P, -n) - faces[carrier, 3] < best + 0.25 * SAME_M:
        k = _over(k, P, carrier, faces[carrier], loop, vertices, margin, out)
        known = k > before
    if not known:
        best, carrier = _parted(P, up, piece, best, carrier, n)
        if best > margin:
            return k
    if size > 2 and dot(n, up) < UPPER:
        return before
    if carrier >= 0 and k == before and covered:
        for i in range(size):
            gap = dot(n, P[i]) - faces[carrier, 3]
            if gap <= margin:
                k = put(k, P[i], n, gap, (CORNER, i, carrier), n, out)
    elif carrier >= 0 and k == before:
        k = _over(k, P, carrier, faces[carrier], loops[starts[carrier] : starts[carrier + 1]], vertices, margin, out)
    elif carrier == -1:
        how = ON_PLATE
        k = under(k, P, up, faces, vertices, edges, margin, out)
    if k == before and len(edges):
        how = EDGES
        k = _nearest(k, P, vertices, edges, best, n, margin, out)
        if k > before and size > 2 and dot(out[1][k - 1], up) < UPPER:
            k = before
    for m in range(before, k):
        out[3][m, 4] = how
    return k


@compiled
def _pierced(k: int, P: Array, up: Array, piece: tuple[Array, ...], out: Spots) -> int:
    """Adds both ends of what is inside a piece of a capsule's axis whose own ends are outside, with the nearest way out."""
    faces, vertices, n, e = piece[0], piece[1], np.empty(3), P[1] - P[0]
    if min(within(P[0], faces), within(P[1], faces)) <= 0.0:
        return k
    best, carrier, _ = _faced(P, up, piece, np.inf, n)
    if _parted(P, up, piece, best, carrier, n)[0] >= SAME_M:
        return k
    low, high, level, first = 0.0, 1.0, -_lowest(vertices, -n), k
    for f in faces:
        s, t = dot(f, P[0]) - f[3], dot(f, P[1]) - f[3]
        if s > 0.0 >= t:
            low = max(low, s / (s - t))
        elif t > 0.0 >= s:
            high = min(high, s / (s - t))
    for i, share in enumerate((low, high)):
        x = P[0] + share * e
        k = put(k, x, n, dot(n, x) - level, (CORNER, i, i), n, out)
    for m in range(first, k):
        out[3][m, 4] = ON_FACE
    return k


@compiled
def _shaft(k: int, P: Array, up: Array, piece: tuple[Array, ...], margin: float, out: Spots) -> int:
    """Adds the points of a capsule's axis between its ends: nearest to edges that it crosses, and to corners beside it.

    Each is as far as two points of axis and piece are, so that none is nearer than the piece. Those count whose directions are
    normals of the piece there, or nearly: an axis that rocks on an edge has one at either side of the piece's face.
    """
    vertices, edges, first = piece[1], piece[2], k
    k = _pierced(k, P, up, piece, out)
    if k > first:
        return k
    e, clear = P[1] - P[0], np.ones(len(vertices), np.bool_)
    for c in range(len(edges)):
        i, j = edges[c, 0], edges[c, 1]
        a, w = vertices[i], vertices[j] - vertices[i]
        both, length = cross(e, w), math.sqrt(dot(w, w))
        for end in (i, j):  # beside a corner no edge goes towards the axis
            x = vertices[end]
            t = dot(x - P[0], e) / dot(e, e)
            r = P[0] + t * e - x
            back = (w if end == i else -w) / length
            if t <= 0.0 or t >= 1.0 or dot(r, back) > RELAXED * math.sqrt(dot(r, r)):
                clear[end] = False
        if dot(both, both) < ALONG * ALONG * dot(e, e) * length * length:
            continue
        s, t = ends(P[0], P[1], a, vertices[j])
        r = P[0] + s * e - a - t * w
        far = math.sqrt(dot(r, r))
        if s <= 0.0 or s >= 1.0 or t <= 0.0 or t >= 1.0 or far > margin or far < SAME_M:
            continue
        n, m_1, m_2 = r / far, piece[0][edges[c, 2]], piece[0][edges[c, 3]]
        across = m_1 - dot(m_1, m_2) * m_2  # n = x m_1 + y m_2 with x and y not below zero
        other = m_2 - dot(m_1, m_2) * m_1
        if min(dot(n, across), dot(n, other)) > -RELAXED * math.sqrt(dot(across, across)):
            k = put(k, P[0] + s * e, n, far, (OTHER, 0, edge_number(i, j, len(vertices))), w, out)
    for i in range(len(vertices)):
        x = vertices[i]
        r = P[0] + (dot(x - P[0], e) / dot(e, e)) * e - x
        far = math.sqrt(dot(r, r))
        if clear[i] and SAME_M < far <= margin:
            k = put(k, x + r, r / far, far, (UNDER, 0, i), r, out)
    for m in range(first, k):
        out[3][m, 4] = EDGES
    return k


@compiled
def clear_of(box: Array, low: Array, high: Array) -> bool:
    """Whether a piece's box and another one have no common point."""
    return bool(
        box[0] > high[0] or box[1] > high[1] or box[2] > high[2] or box[3] < low[0] or box[4] < low[1] or box[5] < low[2]
    )


def _touching(plates: Plates, margin: float, pieces: Polytopes, out: Spots) -> int:
    """The points of plates with all pieces that are nearer than a margin; how many, or -1 if there is no room for them.

    Args:
        plates: The plates.
        margin: [m].
        pieces: The pieces.
        out: Written: the points.
    """
    corners, at, ups, radii = plates
    boxes, faces, vertices, edges, loops, loop_at, dirs, begins, kinds, inner, _ = pieces
    places, normals, gaps, which, _ = out
    k = 0
    low, high = np.empty(3), np.empty(3)
    for plate in range(len(ups)):
        P, up, begin, radius = corners[at[plate] : at[plate + 1]], ups[plate], k, radii[plate]
        far = margin + radius
        for c in range(3):
            low[c], high[c] = np.inf, -np.inf
            for p in P:
                low[c], high[c] = min(low[c], p[c] - far), max(high[c], p[c] + far)
        for i in range(len(boxes)):
            if clear_of(boxes[i], low, high):
                continue
            f, v, e, d = begins[i]
            f_end, v_end, e_end, d_end = begins[i + 1]
            piece = (
                faces[f:f_end], vertices[v:v_end], edges[e:e_end], loops, loop_at[f : f_end + 1], dirs[d:d_end], inner[f:f_end]
            )  # fmt: skip
            which[k, 3], which[k, 4] = i, k
            k = _shaft(k, P, up, piece, far, out) if radius > 0.0 and len(P) == 2 else _on_piece(k, P, up, piece, far, out)
            if k + 1 >= len(gaps):
                return -1
        if radius > 0.0:
            for m in range(begin, k):
                gaps[m] -= radius
                places[m] -= radius * normals[m]
        k = joined(begin, k, up, len(P), boxes, faces, begins, kinds, out)
        for m in range(begin, k):
            which[m, 5] = plate
    return k


_ROWS, _LIST = array(2, written=True), array(1, written=True)
_TABLE, _NUMBERS = array(2, COUNT, written=True), array(1, COUNT, written=True)
PLATES = record(Plates, _ROWS, _NUMBERS, _ROWS, _LIST)
POLYTOPES = record(Polytopes, _ROWS, _ROWS, _ROWS, _TABLE, _NUMBERS, _NUMBERS, _ROWS, _TABLE, _NUMBERS, _NUMBERS, _ROWS)
SPOTS = record(Spots, _ROWS, _ROWS, _LIST, _TABLE, _ROWS)
touching = compiled(_touching, signature(COUNT, PLATES, NUMBER, POLYTOPES, SPOTS))
