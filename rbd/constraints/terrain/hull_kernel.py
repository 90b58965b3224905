"""Compiled: contact points of convex hulls with pieces of terrain.

Where all of a hull that is near a piece is over one face of it, or over faces of several pieces in one plane, its corners there
are its points, as on a plane. Else the normal n, out of the piece, is the one along which the two are farthest apart,

    s(n) = (lowest p . n of the hull) - (highest p . n of the piece)

among the piece's faces, the hull's, and the cross products of edges of both that can be extreme along the same n: where -n is
between the normals of the hull's two faces, n is between those of the piece's. The largest s is the signed distance of what
overlaps or touches; of what is apart it is no more than the distance, and zero only where they touch. The points are

- along a face of the piece: corners of the hull over it, edges of the hull over its edges, its corners under the hull;
- along a face of the hull: those of the piece under it, by `touching_kernel.under`;
- along two edges: where these are nearest to each other, and what is nearly as near along nearly the same normal: other edges
  of both where these cross, corners over a face. Of a face that rocks on an edge both ends are points, as on a plane;

and where there are none along the face of what is apart, the lowest corner of the hull, or the highest of the piece. Faces and
edges of the hull count that are not beyond one face of the piece by more than `near`: of what is farther apart s can be less
than the largest, even negative, but no point is said to be inside that is not.
"""

from __future__ import annotations

import math

import numpy as np

from rbd.arrays import Array
from rbd.constraints.convex.polygons import MOST_POINTS, SAME_M
from rbd.constraints.plane_kernel import spread
from rbd.constraints.terrain.facets import Facets
from rbd.constraints.terrain.pieces import (
    CORNER,
    CROSSING,
    EDGES,
    ON_FACE,
    ON_PLATE,
    OTHER,
    UNDER,
    Polytopes,
    Spots,
)
from rbd.constraints.terrain.seam_kernel import ALIKE, LEAN, SEAM_M, dot, joined
from rbd.constraints.terrain.touching_kernel import (
    POLYTOPES,
    SPOTS,
    clear_of,
    cross,
    edge_number,
    ends,
    entry,
    over,
    put,
    under,
    walls_of,
)
from rbd.kernels import COUNT, FLAG, NUMBER, array, compiled, record, signature

ALMOST = 0.99
"""Cosine of normals with that of two edges that touch: what else is near along these is a point besides."""
CROSSED = 1e-3
"""Edges whose directions have less than this sine do not cross."""
_BITS = 62
"""Faces of a piece that can mark a corner as beyond them."""


@compiled
def _turned(Q: Array, n: Array, up: Array) -> None:
    """A direction in W in a body's axes, Q^T n."""
    for i in range(3):
        up[i] = Q[0, i] * n[0] + Q[1, i] * n[1] + Q[2, i] * n[2]


@compiled
def _placed(Q: Array, o: Array, faces: Array, vertices: Array) -> tuple[Array, Array]:
    """Faces and corners in W in a body's axes."""
    F, V = np.empty((len(faces), 4)), np.empty((len(vertices), 3))
    for i in range(len(faces)):
        _turned(Q, faces[i], F[i])
        F[i, 3] = faces[i, 3] - dot(faces[i], o)
    for i in range(len(vertices)):
        _turned(Q, vertices[i] - o, V[i])
    return F, V


@compiled
def _corner(points: Array, i: int) -> Array:
    out = np.empty(3)
    out[0], out[1], out[2] = points[0, i], points[1, i], points[2, i]
    return out


@compiled
def _near_parts(hull: tuple[Array, ...], F: Array, near: float) -> tuple[Array, Array]:
    """(faces, edges) of a hull that are not beyond a face of the piece by more than `near`."""
    points, faces, loops, _, loop_at, hull_edges = hull
    beyond = np.zeros(points.shape[1], np.int64)
    for f in range(min(len(F), _BITS)):
        a, b, c, level, bit = F[f, 0], F[f, 1], F[f, 2], F[f, 3] + near, np.int64(1) << f
        for i in range(points.shape[1]):
            if a * points[0, i] + b * points[1, i] + c * points[2, i] > level:
                beyond[i] |= bit
    some, count = np.empty(len(faces), np.int64), 0
    for g in range(len(faces)):
        common = np.int64(-1)
        for j in range(loop_at[g], loop_at[g + 1]):
            common &= beyond[loops[j]]
        if common == 0:
            some[count] = g
            count += 1
    lines, number = np.empty(len(hull_edges), np.int64), 0
    for e in range(len(hull_edges)):
        if beyond[hull_edges[e, 0]] & beyond[hull_edges[e, 1]] == 0:
            lines[number] = e
            number += 1
    return some[:count], lines[:number]


@compiled
def _near_edges(V: Array, edges: Array, centre: Array, far: float) -> Array:
    """The edges of a piece that are in a ball."""
    out, count = np.empty((len(edges), 4), np.int64), 0
    for e in range(len(edges)):
        a, d = V[edges[e, 0]] - centre, V[edges[e, 1]] - V[edges[e, 0]]
        t = min(max(-dot(a, d) / max(dot(d, d), 1e-300), 0.0), 1.0)
        away = a + t * d
        if dot(away, away) <= far * far:
            out[count] = edges[e]
            count += 1
    return out[:count]


@compiled
def _crossing(
    hull: tuple[Array, ...], lines: Array, F: Array, V: Array, edges: Array, best: float, n: Array
) -> tuple[float, int, int]:
    """(separation along the best normal of two edges, the hull's, the piece's); -1 if none is better. Writes the normal."""
    points, faces, hull_edges, found, other = hull[0], hull[1], hull[5], -1, -1
    u = np.empty(3)
    for k in range(len(edges)):
        c, m_1, m_2 = V[edges[k, 0]], F[edges[k, 2]], F[edges[k, 3]]
        w = V[edges[k, 1]] - c
        w = w / math.sqrt(max(dot(w, w), 1e-300))
        for e in lines:
            N_1, N_2 = faces[hull_edges[e, 2]], faces[hull_edges[e, 3]]
            one, two = dot(N_1, w), dot(N_2, w)
            if one * two >= 0.0:
                continue
            a, b = hull_edges[e, 0], hull_edges[e, 1]
            for i in range(3):
                u[i] = points[i, b] - points[i, a]
            length = math.sqrt(dot(u, u))
            three, four = dot(m_1, u) / length, dot(m_2, u) / length
            if three * four >= 0.0:
                continue
            s_1, s_2 = abs(four), abs(three)
            x, y, z = s_1 * m_1[0] + s_2 * m_2[0], s_1 * m_1[1] + s_2 * m_2[1], s_1 * m_1[2] + s_2 * m_2[2]
            t_1, t_2 = abs(two), abs(one)
            back = x * (t_1 * N_1[0] + t_2 * N_2[0]) + y * (t_1 * N_1[1] + t_2 * N_2[1]) + z * (t_1 * N_1[2] + t_2 * N_2[2])
            size = math.sqrt(x * x + y * y + z * z)
            if back >= 0.0 or size < ALIKE:
                continue
            s = (x * (points[0, a] - c[0]) + y * (points[1, a] - c[1]) + z * (points[2, a] - c[2])) / size
            if s > best + SAME_M:
                best, found, other = s, e, k
                n[0], n[1], n[2] = x / size, y / size, z / size
    return best, found, other


@compiled
def _on_face(
    k: int, hull: tuple[Array, ...], lines: Array, f: int, F: Array, V: Array, loop: Array, lim: tuple[float, float], out: Spots
) -> int:
    """The part of a hull over a face: its corners, its edges over the face's edges, corners of the face under it."""
    points, faces, hull_edges = hull[0], hull[1], hull[5]
    n, walls, margin, near, first = F[f, :3].copy(), walls_of(F[f], loop, V), lim[0], lim[1], k
    size, lowest = 0, 0
    above, group = np.empty(points.shape[1]), np.empty(points.shape[1], np.int64)
    for i in range(points.shape[1]):
        above[i] = points[0, i] * n[0] + points[1, i] * n[1] + points[2, i] * n[2] - F[f, 3]
        if above[i] < above[lowest]:
            lowest = i
        if above[i] <= margin and over(_corner(points, i), walls):
            group[size] = i
            size += 1
    if size:
        for i in spread(points, above, group[:size].copy(), n):
            k = put(k, _corner(points, i), n, above[i], (CORNER, i, f), n, out)
    begin, x = k, np.empty(3)
    for e in lines:
        a, b = hull_edges[e, 0], hull_edges[e, 1]
        if min(above[a], above[b]) > near or min(dot(faces[hull_edges[e, 2]], n), dot(faces[hull_edges[e, 3]], n)) > -LEAN:
            continue
        p, q = _corner(points, a), _corner(points, b)
        for j in range(len(walls)):
            s, t = dot(walls[j], p) - walls[j, 3], dot(walls[j], q) - walls[j, 3]
            if not ((s > SAME_M and t < -SAME_M) or (s < -SAME_M and t > SAME_M)):
                continue
            share = s / (s - t)
            x[:] = p + share * (q - p)
            gap = above[a] + share * (above[b] - above[a])
            if gap <= near and over(x, walls):
                edge = edge_number(loop[j], loop[(j + 1) % len(loop)], len(V))
                k = put(k, x, n, gap, (CROSSING, e, edge), walls[j, :3].copy(), out)
    for at in loop:
        down, g = entry(V[at], -n, faces, near)
        if g >= 0:
            k = put(k, V[at] + down * n, n, down, (UNDER, g, at), n, out)
    if k - begin > MOST_POINTS:
        k = _fewer(begin, k, n, out)
    if k == first and above[lowest] > 0.0:
        k = put(k, _corner(points, lowest), n, above[lowest], (CORNER, lowest, f), n, out)
    return k


@compiled
def _beside(
    k: int, hull: tuple[Array, ...], lines: Array, n: Array, F: Array, V: Array, edges: Array, loops: Array, starts: Array,
    margin: float, out: Spots,
) -> int:  # fmt: skip
    """What is nearly as near as two edges that touch along n: further edges that cross, and corners over nearly parallel faces.

    Of these a hull's face that rocks on an edge of a piece has one at each side. None is deeper than the two edges are, but for
    the cosine of its normal and n.
    """
    points, faces, hull_edges, first = hull[0], hull[1], hull[5], k
    u, m = np.empty(3), np.empty(3)
    for c in range(len(edges)):
        a, b = V[edges[c, 0]], V[edges[c, 1]]
        m_1, m_2 = F[edges[c, 2]], F[edges[c, 3]]
        flat = max(dot(m_1, n), dot(m_2, n)) >= ALMOST
        w = b - a
        w = w / math.sqrt(max(dot(w, w), 1e-300))
        for e in lines:
            N_1, N_2 = faces[hull_edges[e, 2]], faces[hull_edges[e, 3]]
            if max(-dot(N_1, n), -dot(N_2, n)) < ALMOST and dot(N_1, w) * dot(N_2, w) >= 0.0:
                continue
            i, j = hull_edges[e, 0], hull_edges[e, 1]
            for r in range(3):
                u[r] = points[r, j] - points[r, i]
            if not flat and dot(m_1, u) * dot(m_2, u) >= 0.0:
                continue
            m[:] = cross(u, w)
            size = math.sqrt(dot(m, m))
            if size < CROSSED * math.sqrt(dot(u, u)):
                continue
            m = m / size if dot(m, n) > 0.0 else -m / size
            p = _corner(points, i)
            gap = dot(m, p - a)
            if dot(m, n) < ALMOST or gap > margin:
                continue
            s, t = ends(p, _corner(points, j), a, b)
            if 0.0 < s < 1.0 and 0.0 < t < 1.0:
                k = put(k, p + s * u, m, gap, (OTHER, e, edge_number(edges[c, 0], edges[c, 1], len(V))), b - a, out)
    for g in range(len(faces)):
        if -dot(faces[g], n) > ALMOST:
            N = faces[g, :3].copy()
            for i in range(len(V)):
                gap = dot(N, V[i]) - faces[g, 3]
                if gap <= margin:
                    _, at = entry(V[i], N, faces, margin)
                    if at == g:
                        k = put(k, V[i] - gap * N, -N, gap, (UNDER, g, i), -N, out)
    for f in range(len(F)):
        if dot(F[f], n) > ALMOST:
            N, walls = F[f, :3].copy(), walls_of(F[f], loops[starts[f] : starts[f + 1]], V)
            for i in range(points.shape[1]):
                p = _corner(points, i)
                gap = dot(N, p) - F[f, 3]
                if gap <= margin and over(p, walls):
                    k = put(k, p, N, gap, (CORNER, i, f), N, out)
    return _fewer(first, k, n, out) if k - first > MOST_POINTS else k


@compiled
def _fewer(begin: int, end: int, n: Array, out: Spots) -> int:
    """Of many points those chosen by `spread`."""
    places, normals, gaps, which, ways = out
    k, first = begin, which[begin, 4]
    places_T, group = np.ascontiguousarray(places[begin:end].T), np.arange(end - begin)
    for i in spread(places_T, gaps[begin:end].copy(), group, n):
        places[k], normals[k], gaps[k], ways[k] = places[begin + i], normals[begin + i], gaps[begin + i], ways[begin + i]
        which[k] = which[begin + i]
        k += 1
    which[k, 3], which[k, 4] = which[begin, 3], first
    return k


@compiled
def _on_hull(
    k: int, hull: tuple[Array, ...], g: int, F: Array, V: Array, edges: Array, lim: float, out: Spots
) -> int:
    """The part of a piece under a face of the hull."""
    points, faces, loops, sides, loop_at, _ = hull
    first, size, which = k, loop_at[g + 1] - loop_at[g], out[3]
    P, up = np.empty((size, 3)), -faces[g, :3]
    for j in range(size):
        P[j] = _corner(points, loops[loop_at[g] + j])
    k = under(k, P, up, F, V, edges, lim, out)
    for m in range(first, k):
        if which[m, 0] == UNDER:
            which[m, 1] = g
        else:
            at = loop_at[g] + which[m, 1]
            which[m, 1] = loops[at] if which[m, 0] == CORNER else sides[at]
    best, highest = -np.inf, 0
    for i in range(len(V)):
        if dot(up, V[i]) > best:
            best, highest = dot(up, V[i]), i
    gap = -faces[g, 3] - best
    if k == first and gap > 0.0:
        k = put(k, V[highest] + gap * up, up, gap, (UNDER, g, highest), up, out)
    return k


@compiled
def _across(
    k: int, hull: tuple[Array, ...], centre: Array, reach: float, f: int, best: float, piece: tuple[Array, ...],
    Q: Array, o: Array, lim: tuple[float, float], out: Spots,
) -> int:  # fmt: skip
    """The points of a hull with one piece, from the separation along the best of the piece's faces; their number."""
    places, normals, _, which, ways = out
    world_faces, world_vertices, all_edges, loops, starts = piece
    F, V = _placed(Q, o, world_faces, world_vertices)
    some, lines = _near_parts(hull, F, lim[1])
    edges = _near_edges(V, all_edges, centre, reach + lim[1])
    hull_faces, how, g, n = hull[1], ON_FACE, -1, np.empty(3)
    for i in some:
        s = np.inf
        for v in V:
            s = min(s, dot(hull_faces[i], v))
        s -= hull_faces[i, 3]
        if s > best + SAME_M:
            best, how, g = s, ON_PLATE, i
    s, e, c = _crossing(hull, lines, F, V, edges, best, n)
    if e >= 0:
        best, how = s, EDGES
    if best > lim[0]:
        return k
    first = k
    which[k, 4] = k
    if how == ON_FACE:
        k = _on_face(k, hull, lines, f, F, V, loops[starts[f] : starts[f + 1]], lim, out)
    elif how == ON_PLATE:
        k = _on_hull(k, hull, g, F, V, edges, lim[1], out)
    else:
        a, b = _corner(hull[0], hull[5][e, 0]), _corner(hull[0], hull[5][e, 1])
        share, _ = ends(a, b, V[edges[c, 0]], V[edges[c, 1]])
        label = (OTHER, e, edge_number(edges[c, 0], edges[c, 1], len(V)))
        k = put(k, a + share * (b - a), n, best, label, V[edges[c, 1]] - V[edges[c, 0]], out)
        k = _beside(k, hull, lines, n, F, V, edges, loops, starts, lim[1], out)
    for m in range(first, k):
        x, n, way = places[m].copy(), normals[m].copy(), ways[m].copy()
        kind = which[m, 0]
        which[m, 4] = how if how != EDGES or kind == OTHER else ON_PLATE if kind == UNDER else ON_FACE
        for i in range(3):
            places[m, i], normals[m, i], ways[m, i] = o[i] + dot(Q[i], x), dot(Q[i], n), dot(Q[i], way)
    return k


def _hulls(
    R: Array,
    p: Array,
    body: Array,
    centres: Array,
    reach: Array,
    general: Array,
    hulls: Facets,
    margin: float,
    near: float,
    pieces: Polytopes,
    out: Spots,
    lines: Array,
    ups: Array,
    pairs: Array,
) -> tuple[int, int]:
    """(points of hulls on pieces, pairs for the general way); -1 if there is no room for them.

    Args:
        R: R_WJ of the bodies, shape (bodies, 3, 3).
        p: Their places, shape (bodies, 3) [m].
        body: Of each shape, shape (shapes,).
        centres: Of a bounding ball of each, in its body's axes, shape (shapes, 3) [m].
        reach: Radius of that ball, shape (shapes,) [m].
        general: Which are flat, or have rims and other round parts: near a piece they are pairs, shape (shapes,).
        hulls: Their corners, edges and faces.
        margin: Of points that are returned [m].
        near: Of pairs, and of a hull that hangs over an edge [m].
        pieces: The pieces.
        out: Written: the points; `which` has the corner, edge or face of the hull, the face, edge or corner of the piece, the
            piece, and the shape.
        lines: Written: of edges of hulls their two ends, in W, shape (most, 2, 3) [m]; of other points zeros.
        ups: Written: of corners under a face of a hull its normal, into the hull, in W, shape (most, 3).
        pairs: Written: (shape, piece), shape (most, 2).
    """
    boxes, faces, vertices, edges, loops, loop_at, _, begins, kinds, _, _ = pieces
    points, hull_faces, hull_loops, sides, hull_loop_at, hull_edges, at = hulls
    places, normals, gaps, which, ways = out
    k, found, total = 0, 0, points.shape[1]
    above, group = np.empty(total), np.empty(total, np.int64)
    near_ones, carriers, parted = np.empty(len(boxes), np.int64), np.empty(len(boxes), np.int64), np.empty(len(boxes))
    c, up, x, above_all = np.empty(3), np.empty(3), np.empty(3), np.zeros(3)
    above_all[2] = 1.0
    for s in range(len(body)):
        Q, o, far, begin, i_0, i_1 = R[body[s]], p[body[s]], reach[s] + margin, k, at[s, 0], at[s + 1, 0]
        for i in range(3):
            c[i] = o[i] + dot(Q[i], centres[s])
        candidates = 0
        for piece in range(len(boxes)):
            if clear_of(boxes[piece], c - far, c + far):
                continue
            most, first = -np.inf, begins[piece, 0]
            for f in range(begins[piece, 0], begins[piece + 1, 0]):
                if dot(faces[f], c) - faces[f, 3] > most:
                    most, first = dot(faces[f], c) - faces[f, 3], f
            if most > far:
                continue
            if general[s]:
                if most <= reach[s] + near:
                    if found >= len(pairs):
                        return -1, found
                    pairs[found, 0], pairs[found, 1] = s, piece
                    found += 1
                continue
            best, carrier, count = -np.inf, -1, begins[piece + 1, 0] - begins[piece, 0]
            for j in range(count):
                f = begins[piece, 0] + (first - begins[piece, 0] + j) % count
                _turned(Q, faces[f], up)
                level, least = dot(faces[f], o) - faces[f, 3], np.inf
                if points[0, i_0] * up[0] + points[1, i_0] * up[1] + points[2, i_0] * up[2] + level < best - SEAM_M:
                    continue
                for i in range(i_0, i_1):
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
            f, piece, before = carriers[one], near_ones[one], k
            n = faces[f, :3].copy()
            _turned(Q, n, up)
            level, size = dot(n, o) - faces[f, 3], 0
            for i in range(i_0, i_1):
                above[i] = points[0, i] * up[0] + points[1, i] * up[1] + points[2, i] * up[2] + level
                if above[i] <= margin:
                    group[size] = i
                    size += 1
            v_0, v_1 = begins[piece, 1], begins[piece + 1, 1]
            walls, hangs = walls_of(n, loops[loop_at[f] : loop_at[f + 1]], vertices[v_0:v_1]), False
            for i in spread(points, above, group[:size].copy(), up):
                for r in range(3):
                    x[r] = o[r] + Q[r, 0] * points[0, i] + Q[r, 1] * points[1, i] + Q[r, 2] * points[2, i]
                if over(x, walls):
                    if k + 1 >= len(gaps):
                        return -1, found
                    places[k], normals[k], gaps[k], ways[k] = x, n, above[i], n
                    which[k, 0], which[k, 1], which[k, 2] = CORNER, i - i_0, f - begins[piece, 0]
                    which[k, 3], which[k, 4], which[k, 5] = piece, ON_FACE, s
                    k += 1
                elif above[i] <= near and not hangs:
                    hangs = True  # over the edge, unless another piece goes on there
                    for other in range(candidates):
                        g, there = carriers[other], near_ones[other]
                        away = faces[g] - faces[f]
                        if dot(away, away) >= ALIKE * ALIKE or abs(away[3]) >= SAME_M:
                            continue
                        corners = vertices[begins[there, 1] : begins[there + 1, 1]]
                        if over(x, walls_of(n, loops[loop_at[g] : loop_at[g + 1]], corners)):
                            hangs = False
                            break
            if hangs and parted[one] <= near:
                f_0, f_1, e_0, e_1 = begins[piece, 0], begins[piece + 1, 0], begins[piece, 2], begins[piece + 1, 2]
                g_0, g_1 = at[s, 1], at[s + 1, 1]
                hull = (
                    np.ascontiguousarray(points[:, i_0:i_1]), hull_faces[g_0:g_1], hull_loops, sides,
                    hull_loop_at[g_0 : g_1 + 1], hull_edges[at[s, 2] : at[s + 1, 2]],
                )  # fmt: skip
                solid = (faces[f_0:f_1], vertices[v_0:v_1], edges[e_0:e_1], loops, loop_at[f_0 : f_1 + 1])
                k = before
                which[k, 3] = piece
                k = _across(k, hull, centres[s], reach[s], f - f_0, parted[one], solid, Q, o, (margin, near), out)
                if k + 1 >= len(gaps):
                    return -1, found
                for m in range(before, k):
                    which[m, 3], which[m, 5] = piece, s
        k = joined(begin, k, above_all, 1, boxes, faces, begins, kinds, out)
        for m in range(begin, k):
            lines[m], ups[m] = 0.0, above_all
            kind, number = which[m, 0], which[m, 1]
            if kind == CROSSING or kind == OTHER:
                for i in range(2):
                    corner = _corner(points, i_0 + hull_edges[at[s, 2] + number, i])
                    for r in range(3):
                        lines[m, i, r] = o[r] + dot(Q[r], corner)
            elif kind == UNDER:
                for r in range(3):
                    ups[m, r] = -dot(Q[r], hull_faces[at[s, 1] + number])
    return k, found


_ROWS, _NUMBERS, _TABLE = array(2, written=True), array(1, COUNT, written=True), array(2, COUNT, written=True)
FACETS = record(Facets, _ROWS, _ROWS, _NUMBERS, _NUMBERS, _NUMBERS, _TABLE, _TABLE)
hulls = compiled(
    _hulls,
    signature(
        (COUNT, COUNT), array(3), array(2), array(1, COUNT), array(2), array(1), array(1, FLAG), FACETS,
        NUMBER, NUMBER, POLYTOPES, SPOTS, array(3, written=True), array(2, written=True), array(2, COUNT, written=True),
    ),
)  # fmt: skip
