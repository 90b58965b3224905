"""Compiled arithmetic of `rbd.constraints.plane_contact`.

`places` are the placements of all joints, R by columns and then p in a row; `carries` tells which coordinates move a body.
"""

from __future__ import annotations

import numpy as np

from rbd.arrays import Array
from rbd.constraints.convex.low_points_kernel import wander
from rbd.kernels import COUNT, NUMBER, array, compiled, signature


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
