"""Compiled arithmetic of points near a plane, and of their motion.

`places` are the placements of all joints, R by columns and then p in a row; `carries` tells which coordinates move a body.

Round parts are given in the arrays of `rbd.constraints.convex.points_near_plane.RoundParts`.
"""

from __future__ import annotations

import math

import numpy as np

from rbd.arrays import Array
from rbd.constraints.convex.convex_shapes import LEVEL_M, STEEP
from rbd.constraints.convex.reduced_points import DIRECTIONS, LOWEST, TIPS, TOWARDS
from rbd.kernels import COUNT, FLAG, NUMBER, array, compiled, signature

BALL, RIM, OVAL = 0, 1, 2
_FLAT = TIPS * TIPS * (1.0 + 1e-9)


def _lasts(
    up: Array, height: Array, bodies: Array, centres: Array, reach: Array,
    up_then: Array, above_then: Array, turn: Array, spare: Array, rounding: float,
) -> bool:  # fmt: skip
    """Whether no point outside of the list can have come near, see `LowPoints._current`."""
    for s in range(len(bodies)):
        b = bodies[s]
        x, y, z = up[b, 0], up[b, 1], up[b, 2]
        above = x * centres[s, 0] + y * centres[s, 1] + z * centres[s, 2] + height[b]
        x, y, z = x - up_then[s, 0], y - up_then[s, 1], z - up_then[s, 2]
        turned = math.sqrt(x * x + y * y + z * z)
        if not (turned <= turn[s] and above_then[s] - above + turned * reach[s] < spare[s] - rounding):
            return False
    return True


lasts = compiled(
    _lasts,
    signature(FLAG, array(2), array(1), array(1, COUNT), array(2), array(1), array(2), array(1), array(1), array(1), NUMBER),
)


@compiled
def _in_plane(form: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    """The part of a vector across a rim's axis."""
    along = x * form[0, 0] + y * form[0, 1] + z * form[0, 2]
    return x - along * form[0, 0], y - along * form[0, 1], z - along * form[0, 2]


@compiled
def _times(Q: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    return (
        Q[0, 0] * x + Q[0, 1] * y + Q[0, 2] * z,
        Q[1, 0] * x + Q[1, 1] * y + Q[1, 2] * z,
        Q[2, 0] * x + Q[2, 1] * y + Q[2, 2] * z,
    )


@compiled
def _lowest(kind: int, radius: float, form: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    """The lowest point of a round part from its centre, for up = (x, y, z); NaN where many are equally low."""
    if kind == BALL:
        return -radius * x, -radius * y, -radius * z
    if kind == RIM:
        a, b, c = _in_plane(form, x, y, z)
        length = math.sqrt(a * a + b * b + c * c)
        if radius * length < LEVEL_M:
            return math.nan, math.nan, math.nan
        scale = radius / length
        return -scale * a, -scale * b, -scale * c
    a, b, c = _times(form, x, y, z)
    s = math.sqrt(x * a + y * b + z * c)
    return -a / s, -b / s, -c / s


@compiled
def wander(
    kind: int, radius: float, form: Array, x: float, y: float, z: float, dx: float, dy: float, dz: float
) -> tuple[float, float, float]:
    """How fast the lowest point of a round part moves over the body, for up = (x, y, z) that changes at (dx, dy, dz)."""
    if kind == BALL:
        return -radius * dx, -radius * dy, -radius * dz
    if kind == RIM:
        a, b, c = _in_plane(form, x, y, z)
        length = math.sqrt(a * a + b * b + c * c)
        if radius * length < LEVEL_M:
            return 0.0, 0.0, 0.0
        a, b, c = a / length, b / length, c / length
        dx, dy, dz = _in_plane(form, dx, dy, dz)
        along = a * dx + b * dy + c * dz
        scale = -radius / length
        return scale * (dx - a * along), scale * (dy - b * along), scale * (dz - c * along)
    a, b, c = _times(form, x, y, z)
    s = math.sqrt(x * a + y * b + z * c)
    along = (a * dx + b * dy + c * dz) / (s * s * s)
    u, v, w = _times(form, dx, dy, dz)
    return a * along - u / s, b * along - v / s, c * along - w / s


@compiled
def _spread(points: Array, above: Array, group: Array, up: Array, chosen: Array) -> None:
    """Choose the points of one group as `few_points.spread_each` does."""
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
        s = math.hypot(z, x)
        a, b, c = z / s, 0.0, -x / s
    else:
        s = math.hypot(y, x)
        a, b, c = -y / s, x / s, 0.0
    d, e, f = y * c - z * b, z * a - x * c, x * b - y * a
    most, far = np.full(DIRECTIONS, -np.inf), np.full(DIRECTIONS, -1)
    for i in group:
        h = above[i]
        if h < last:
            chosen[i] = True
        elif h == last and ties > 0:
            chosen[i] = True
            ties -= 1
        px, py, pz, rise = points[0, i], points[1, i], points[2, i], h - above[first]
        rx, ry, rz = px - points[0, first], py - points[1, first], pz - points[2, first]
        if rise * rise <= _FLAT * (rx * rx + ry * ry + rz * rz):
            one, two = a * px + b * py + c * pz, d * px + e * py + f * pz
            for k in range(DIRECTIONS):
                away = TOWARDS[k, 0] * one + TOWARDS[k, 1] * two - rise / TIPS
                if away > most[k]:
                    most[k], far[k] = away, i
    for i in far:
        if i >= 0:
            chosen[i] = True


def _near(
    points: Array, body: Array, shape: Array, many: Array, rounds: Array, corners: Array, rims: Array,
    kind: Array, centre: Array, radius: Array, form: Array, round_body: Array,
    up: Array, height: Array, margin: float,
) -> tuple[Array, Array]:  # fmt: skip
    """(which points of a list are near, their heights): `LowPoints.near`. Round parts' lowest points are put into `points`.

    Args:
        points: As in `low_points._Listed`, like those up to `rims`.
        body: Body of each.
        shape: Shape of each, ascending.
        many: Which are corners of a shape with many.
        rounds: Where round parts are in the list.
        corners: Where corners of rims are.
        rims: Their rims.
        kind: Kinds of the round parts.
        centre: Their centres.
        radius: Their radii.
        form: Axes or Q.
        round_body: Bodies of the round parts.
        up: Normal of the plane in each body's axes, shape (bodies, 3).
        height: Height of each body's origin, shape (bodies,).
        margin: Height up to which points are near [m].
    """
    n = len(body)
    stands, count = np.zeros(len(kind), np.bool_), 0
    for i in range(len(kind)):
        b, at = round_body[i], rounds[i]
        x, y, z = up[b, 0], up[b, 1], up[b, 2]
        a, d, c = _lowest(kind[i], radius[i], form[i], x, y, z)
        points[0, at], points[1, at], points[2, at] = centre[i, 0] + a, centre[i, 1] + d, centre[i, 2] + c
        if kind[i] == RIM:
            along = x * form[i, 0, 0] + y * form[i, 0, 1] + z * form[i, 0, 2]
            stands[count] = 1.0 - along * along > STEEP * STEEP
            count += 1
    above, chosen = np.empty(n), np.zeros(n, np.bool_)
    for i in range(n):
        b = body[i]
        above[i] = points[0, i] * up[b, 0] + points[1, i] * up[b, 1] + points[2, i] * up[b, 2] + height[b]
    for i in range(len(corners)):
        if stands[rims[i]]:
            above[corners[i]] = np.inf
    group, i = np.empty(n, np.int64), 0
    while i < n:
        if not many[i]:
            chosen[i] = above[i] <= margin
            i += 1
            continue
        s, size, b = shape[i], 0, body[i]
        while i < n and shape[i] == s and many[i]:
            if above[i] <= margin:
                group[size] = i
                size += 1
            i += 1
        if size > LOWEST:
            _spread(points, above, group[:size], up[b], chosen)
        else:
            for e in range(size):
                chosen[group[e]] = True
    k = 0
    for i in range(n):
        if chosen[i]:
            group[k] = i
            k += 1
    return group[:k].copy(), above[group[:k]]


near_points = compiled(
    _near,
    signature(
        (array(1, COUNT, written=True), array(1, written=True)),
        array(2, written=True), array(1, COUNT), array(1, COUNT), array(1, FLAG), array(1, COUNT), array(1, COUNT),
        array(1, COUNT),
        array(1, COUNT), array(2), array(1), array(3), array(1, COUNT), array(2), array(1), NUMBER,
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
    points: Array, near: Array, index: Array, body: Array, places: Array, joints: Array, axes: Array, carries: Array, J_W: Array
) -> tuple[Array, Array, Array, Array]:
    """(numbers, bodies, P (k, 3), J (3k, nv)) of the near points of a list.

    Args:
        points: Of the list, in their bodies' axes, shape (3, n).
        near: Which are near, shape (k,).
        index: Numbers of the points of the list, shape (n,).
        body: Their bodies, shape (n,).
        places: Placements of all joints, shape (joints, 12).
        joints: Joints of the bodies.
        axes: R_WC of the plane, shape (3, 3).
        carries: Shape (bodies, nv).
        J_W: Jacobian of all joints at W's origin, transposed, shape (nv, 6).
    """
    k, nv = len(near), len(J_W)
    numbers, bodies = np.empty(k, np.int64), np.empty(k, np.int64)
    P, J, arms = np.empty((k, 3)), np.zeros((3 * k, nv)), np.empty((3, 6))
    for i in range(k):
        at = near[i]
        b = body[at]
        numbers[i], bodies[i] = index[at], b
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
    return numbers, bodies, P, J


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
    J_W: Array, dJ_W: Array, v: Array, kind: Array, radius: Array, form: Array,
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
        kind: Kinds of the round parts.
        radius: Their radii.
        form: Axes or Q.
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
            d0, d1, d2 = wander(kind[m], radius[m], form[m], up[b, 0], up[b, 1], up[b, 2], d0, d1, d2)
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
_WRITTEN, _TABLE, _NUMBERS = array(1, written=True), array(2, written=True), array(1, COUNT, written=True)
normals = compiled(
    _normals,
    signature((_TABLE, _WRITTEN), _PLACES, array(1, COUNT), array(1), NUMBER),
)
rows = compiled(
    _rows,
    signature(
        (_NUMBERS, _NUMBERS, _TABLE, _TABLE),
        array(2), array(1, COUNT), array(1, COUNT), array(1, COUNT), _PLACES, array(1, COUNT), array(2), array(2), array(2),
    ),
)  # fmt: skip
motion = compiled(
    _motion,
    signature(
        (_WRITTEN, _WRITTEN),
        array(2), array(1, COUNT), array(1, COUNT), _PLACES, array(1, COUNT), array(2), array(2), array(2),
        array(2), array(2), array(1), array(1, COUNT), array(1), array(3),
    ),
)  # fmt: skip
