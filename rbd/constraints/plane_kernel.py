"""Compiled arithmetic of points near a plane, and of their motion.

`places` are the placements of all joints, R by columns and then p in a row; `carries` tells which coordinates move a body.

A round part is the set of points c + S x, |x| <= 1, with S symmetric: r 1 of a ball, r (1 - a a^T) of a rim about a,
R diag(radii) R^T of an ellipsoid. Its lowest point for a unit normal `up` of the plane below, and how it moves over the body as
`up` turns, are

    p = c - S y / s        y = S up        s = |y|
    p' = -S (z - y (y . z) / s^2) / s      z = S up'
"""

from __future__ import annotations

import math

import numpy as np

from rbd.arrays import Array
from rbd.constraints.convex.polygons import DIRECTIONS, LOWEST, MOST_POINTS, RIM_CORNERS, TIPS, TOWARDS
from rbd.kernels import COUNT, NUMBER, array, compiled, signature

_FLAT = TIPS * TIPS * (1.0 + 1e-9)
ROUNDING = 1e-9
"""Heights are right to this [m]."""


@compiled
def _times(S: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    return (
        S[0, 0] * x + S[0, 1] * y + S[0, 2] * z,
        S[1, 0] * x + S[1, 1] * y + S[1, 2] * z,
        S[2, 0] * x + S[2, 1] * y + S[2, 2] * z,
    )


def _lowest(root: Array, least: float, x: float, y: float, z: float) -> tuple[float, float, float, float]:
    """(lowest point of a round part from its centre, s) for up = (x, y, z); NaN where s < `least`: many are equally low."""
    a, b, c = _times(root, x, y, z)
    s = math.sqrt(a * a + b * b + c * c)
    if s < least:
        return math.nan, math.nan, math.nan, s
    a, b, c = _times(root, a, b, c)
    scale = -1.0 / max(s, 1e-300)  # a ball of no size is its centre
    return scale * a, scale * b, scale * c, s


def _wander(
    root: Array, least: float, x: float, y: float, z: float, dx: float, dy: float, dz: float
) -> tuple[float, float, float]:
    """How fast that point moves over the body while up changes at (dx, dy, dz); zero where many are equally low."""
    a, b, c = _times(root, x, y, z)
    s = max(math.sqrt(a * a + b * b + c * c), 1e-300)
    if s < least:
        return 0.0, 0.0, 0.0
    a, b, c = a / s, b / s, c / s
    dx, dy, dz = _times(root, dx, dy, dz)
    along = a * dx + b * dy + c * dz
    dx, dy, dz = _times(root, dx - a * along, dy - b * along, dz - c * along)
    return -dx / s, -dy / s, -dz / s


lowest = compiled(_lowest, signature((NUMBER,) * 4, array(2), *(NUMBER,) * 4))
wander = compiled(_wander, signature((NUMBER,) * 3, array(2), *(NUMBER,) * 7))


def _spread(points: Array, above: Array, group: Array, up: Array) -> Array:
    """The points of a group, ascending, that are among the lowest or the farthest in a direction; see `polygons.TIPS`.

    Args:
        points: Shape (3, n).
        above: Their heights, shape (n,).
        group: Numbers of those among which to choose, ascending, shape (k,), not empty.
        up: The direction of heights, in the axes of the points.
    """
    low = np.full(LOWEST, np.inf)  # the lowest heights, ascending
    first = group[0]
    for i in group:
        h = above[i]
        if h < above[first]:
            first = i
        if h < low[LOWEST - 1]:
            at = LOWEST - 1
            while at > 0 and low[at - 1] > h:
                low[at] = low[at - 1]
                at -= 1
            low[at] = h
    last, ties = low[LOWEST - 1], LOWEST
    for h in low:
        if h < last:
            ties -= 1
    x, y, z = up[0], up[1], up[2]
    if abs(z) > 0.7:
        s = np.hypot(z, x)
        a, b, c = z / s, 0.0, -x / s
    else:
        s = np.hypot(y, x)
        a, b, c = -y / s, x / s, 0.0
    d, e, f = y * c - z * b, z * a - x * c, x * b - y * a
    most, far = np.full(DIRECTIONS, -np.inf), np.full(DIRECTIONS, -1)
    chosen = np.zeros(len(group), np.bool_)
    for j in range(len(group)):
        i = group[j]
        h = above[i]
        if h < last:
            chosen[j] = True
        elif h == last and ties > 0:
            chosen[j] = True
            ties -= 1
        px, py, pz, rise = points[0, i], points[1, i], points[2, i], h - above[first]
        rx, ry, rz = px - points[0, first], py - points[1, first], pz - points[2, first]
        # A point steeper than `TIPS` above the lowest one is not the farthest in any direction: the lowest one is farther.
        if rise * rise <= _FLAT * (rx * rx + ry * ry + rz * rz):
            one, two = a * px + b * py + c * pz, d * px + e * py + f * pz
            for k in range(DIRECTIONS):
                away = TOWARDS[k, 0] * one + TOWARDS[k, 1] * two - rise / TIPS
                if away > most[k]:
                    most[k], far[k] = away, j
    for j in far:
        if j >= 0:
            chosen[j] = True
    return group[chosen]


spread = compiled(_spread, signature(array(1, COUNT, written=True), array(2), array(1), array(1, COUNT), array(1)))


def _near(
    points: Array, first: Array, corners: Array, parts: Array, bodies: Array, centres: Array, reach: Array,
    part_centres: Array, roots: Array, least: Array, steep: Array, rims: Array, up: Array, height: Array, margin: float,
) -> tuple[Array, Array]:  # fmt: skip
    """(numbers, heights) of the points of shapes that are near a plane, ascending; shapes whose ball is not near are skipped.

    Args:
        points: Corners of all shapes, then of each the lowest points of its round parts, written here, shape (3, n).
        first: Number of each shape's first point, shape (shapes,).
        corners: Number of its corners.
        parts: Its first round part, and at the end their number, shape (shapes + 1,).
        bodies: Its body.
        centres: Centre of the ball around it, shape (shapes, 3).
        reach: Radius of this ball.
        part_centres: Centres of the round parts, shape (parts, 3).
        roots: Their shapes, see `RoundPart`, shape (parts, 3, 3).
        least: Their lowest point is not unique where s is less, see `lowest`.
        steep: The corners on a rim do not touch where s is more.
        rims: Number of the first corner on a rim; -1 of other round parts.
        up: Normal of the plane in each body's axes, shape (bodies, 3).
        height: Height of each body's origin, shape (bodies,).
        margin: Height up to which points are near [m].
    """
    above, number, k = np.empty(points.shape[1]), np.empty(points.shape[1], np.int64), 0
    for s in range(len(bodies)):
        b, start = bodies[s], first[s]
        x, y, z = up[b, 0], up[b, 1], up[b, 2]
        if x * centres[s, 0] + y * centres[s, 1] + z * centres[s, 2] + height[b] - reach[s] > margin + ROUNDING:
            continue
        for i in range(start, start + corners[s]):
            above[i] = points[0, i] * x + points[1, i] * y + points[2, i] * z + height[b]
        for m in range(parts[s], parts[s + 1]):
            i = start + corners[s] + m - parts[s]
            u, v, w, stands = lowest(roots[m], least[m], x, y, z)
            points[0, i], points[1, i], points[2, i] = part_centres[m, 0] + u, part_centres[m, 1] + v, part_centres[m, 2] + w
            above[i] = points[0, i] * x + points[1, i] * y + points[2, i] * z + height[b]
            if rims[m] >= 0 and stands > steep[m]:
                above[rims[m] : rims[m] + RIM_CORNERS] = np.inf
        size = 0
        for i in range(start, start + corners[s]):
            if above[i] <= margin:
                number[k + size] = i
                size += 1
        if corners[s] > MOST_POINTS and size > LOWEST:
            chosen = spread(points, above, number[k : k + size], up[b])
            size = len(chosen)
            number[k : k + size] = chosen
        k += size
        for i in range(start + corners[s], start + corners[s] + parts[s + 1] - parts[s]):
            if above[i] <= margin:
                number[k] = i
                k += 1
    return number[:k].copy(), above[number[:k]]


_WRITTEN, _TABLE, _NUMBERS = array(1, written=True), array(2, written=True), array(1, COUNT, written=True)
near_points = compiled(
    _near,
    signature(
        (_NUMBERS, _WRITTEN),
        _TABLE, *(array(1, COUNT),) * 4, array(2), array(1), array(2), array(3), array(1), array(1), array(1, COUNT),
        array(2), array(1), NUMBER,
    ),
)  # fmt: skip


def _normals(places: Array, joints: Array, normal: Array, level: float) -> tuple[Array, Array]:
    """(normal of the plane in each body's axes (bodies, 3), height of each body's origin (bodies,))."""
    up, height = np.empty((len(joints), 3)), np.empty(len(joints))
    for b in range(len(joints)):
        X = places[joints[b]]
        for c in range(3):
            up[b, c] = normal[0] * X[3 * c] + normal[1] * X[3 * c + 1] + normal[2] * X[3 * c + 2]
        height[b] = X[9] * normal[0] + X[10] * normal[1] + X[11] * normal[2] - level
    return up, height


def _rows(
    points: Array, numbers: Array, body: Array, places: Array, joints: Array, axes: Array, carries: Array, J_W: Array
) -> tuple[Array, Array]:
    """(P (k, 3), J (3k, nv)) of some points.

    Args:
        points: All, in their bodies' axes, shape (3, n).
        numbers: Those that count, shape (k,).
        body: Their bodies, shape (k,).
        places: Placements of all joints, shape (joints, 12).
        joints: Joints of the bodies.
        axes: R_WC of the plane, shape (3, 3).
        carries: Shape (bodies, nv).
        J_W: Jacobian of all joints at W's origin, transposed, shape (nv, 6).
    """
    k, nv = len(numbers), len(J_W)
    P, J, arms = np.empty((k, 3)), np.zeros((3 * k, nv)), np.empty((3, 6))
    for i in range(k):
        b, at = body[i], numbers[i]
        X, x, y, z = places[joints[b]], points[0, at], points[1, at], points[2, at]
        for c in range(3):
            P[i, c] = X[c] * x + X[3 + c] * y + X[6 + c] * z + X[9 + c]
        for r in range(3):
            for c in range(3):
                arms[r, c] = axes[c, r]
            arms[r, 3] = P[i, 1] * axes[2, r] - P[i, 2] * axes[1, r]
            arms[r, 4] = P[i, 2] * axes[0, r] - P[i, 0] * axes[2, r]
            arms[r, 5] = P[i, 0] * axes[1, r] - P[i, 1] * axes[0, r]
        for j in range(nv):
            if carries[b, j] != 0.0:
                for r in range(3):
                    total = 0.0
                    for c in range(6):
                        total += arms[r, c] * J_W[j, c]
                    J[3 * i + r, j] = total
    return P, J


@compiled
def _of_bodies(carries: Array, J_W: Array, v: Array) -> Array:
    """J_W v over the coordinates that move each body, shape (bodies, 6)."""
    out = np.zeros((len(carries), 6))
    for b in range(len(carries)):
        for j in range(len(v)):
            if carries[b, j] != 0.0:
                for c in range(6):
                    out[b, c] += J_W[j, c] * v[j]
    return out


@compiled
def _cross(w: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    """The cross product of an angular velocity, the last three of six numbers, and a vector."""
    return w[4] * z - w[5] * y, w[5] * x - w[3] * z, w[3] * y - w[4] * x


def _motion(
    P: Array, body: Array, round_of: Array, places: Array, joints: Array, axes: Array, up: Array, carries: Array,
    J_W: Array, dJ_W: Array, v: Array, roots: Array, least: Array,
) -> tuple[Array, Array]:  # fmt: skip
    """(velocity (3k,), J_dot v (3k,)) of points.

    Args:
        P: In W, shape (k, 3).
        body: Their bodies, shape (k,).
        round_of: The round part that each is of, or -1, shape (k,).
        places: Placements of all joints, shape (joints, 12).
        joints: Joints of the bodies.
        axes: R_WC of the plane, shape (3, 3).
        up: Its normal in the bodies' axes, shape (bodies, 3).
        carries: Shape (bodies, nv).
        J_W: Jacobian of all joints at W's origin, transposed, shape (nv, 6).
        dJ_W: Its time derivative.
        v: Shape (nv,).
        roots: Shapes of the round parts, see `RoundPart`, shape (parts, 3, 3).
        least: Their lowest point is not unique where s is less, see `lowest`.
    """
    k = len(P)
    velocity, bias, V, dV = np.empty(3 * k), np.empty(3 * k), _of_bodies(carries, J_W, v), _of_bodies(carries, dJ_W, v)
    d = np.empty(3)
    for i in range(k):
        b = body[i]
        w, alpha, x, y, z = V[b], dV[b], P[i, 0], P[i, 1], P[i, 2]
        a, e, c = _cross(w, x, y, z)
        a, e, c = a + w[0], e + w[1], c + w[2]
        for r in range(3):
            velocity[3 * i + r] = axes[0, r] * a + axes[1, r] * e + axes[2, r] * c
        if round_of[i] >= 0:  # the contact point moves over the body
            m, X = round_of[i], places[joints[b]]
            d[0], d[1], d[2] = _cross(w, axes[0, 2], axes[1, 2], axes[2, 2])
            d0 = -(X[0] * d[0] + X[1] * d[1] + X[2] * d[2])
            d1 = -(X[3] * d[0] + X[4] * d[1] + X[5] * d[2])
            d2 = -(X[6] * d[0] + X[7] * d[1] + X[8] * d[2])
            d0, d1, d2 = wander(roots[m], least[m], up[b, 0], up[b, 1], up[b, 2], d0, d1, d2)
            a += X[0] * d0 + X[3] * d1 + X[6] * d2
            e += X[1] * d0 + X[4] * d1 + X[7] * d2
            c += X[2] * d0 + X[5] * d1 + X[8] * d2
        a, e, c = _cross(w, a, e, c)
        x, y, z = _cross(alpha, x, y, z)
        a, e, c = a + alpha[0] + x, e + alpha[1] + y, c + alpha[2] + z
        for r in range(3):
            bias[3 * i + r] = axes[0, r] * a + axes[1, r] * e + axes[2, r] * c
    return velocity, bias


_PLACES = array(2, layout="A")
normals = compiled(
    _normals,
    signature((_TABLE, _WRITTEN), _PLACES, array(1, COUNT), array(1), NUMBER),
)
rows = compiled(
    _rows,
    signature((_TABLE, _TABLE), array(2), *(array(1, COUNT),) * 2, _PLACES, array(1, COUNT), array(2), array(2), array(2)),
)
motion = compiled(
    _motion,
    signature(
        (_WRITTEN, _WRITTEN),
        array(2), array(1, COUNT), array(1, COUNT), _PLACES, array(1, COUNT), *(array(2),) * 5, array(1), array(3), array(1),
    ),
)  # fmt: skip
