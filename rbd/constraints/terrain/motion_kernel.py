"""Compiled: Jacobian, velocity and J_dot v of contact points on terrain, which wander over the plates they are on."""

from __future__ import annotations

import math

import numpy as np

from rbd.arrays import Array
from rbd.constraints.terrain.pieces import CROSSING, ON_PLATE, OTHER, UNDER, Plates, Spots
from rbd.constraints.terrain.seam_kernel import dot
from rbd.constraints.terrain.touching_kernel import PLATES, SPOTS, cross
from rbd.kernels import COUNT, array, compiled, signature

NEAR_X = 0.9
"""A normal with more than this along x has its tangents from y."""


@compiled
def _axes(n: Array, dn: Array, x: Array, R: Array, dR: Array) -> None:
    """Contact axes of a normal and a direction, as `rbd.constraints.surface.contact_axes`, and their rates for one of n, dn."""
    t = x - dot(x, n) * n
    if dot(t, t) < 0.01:
        x = np.zeros(3)
        x[0 if abs(n[0]) < NEAR_X else 1] = 1.0
    t = x - dot(x, n) * n
    size = math.sqrt(dot(t, t))
    t, dt = t / size, (-dot(x, dn) * n - dot(x, n) * dn) / size
    dt = dt - dot(t, dt) * t
    R[:, 0], R[:, 1], R[:, 2] = t, cross(n, t), n
    dR[:, 0], dR[:, 1], dR[:, 2] = dt, cross(dn, t) + cross(n, dt), dn


def _rows(
    found: Spots, plates: Plates, rates: Array, body: Array, carries: Array, J_W: Array, v: Array, alongs: Array,
    axes: Array, J: Array, velocity: Array, bias: Array,
) -> None:
    """Rows of k points, three each, in contact axes; their normal is still on a face and turns with a plate or its edge.

        J = (d, P x d) J_W        velocity = d . v_P        bias = d . (a_P + w x u) + d' . v_P

    v_P and a_P are relative to a piece that moves, whose axes do not turn: v_P = J_P v - p', a_P = J_dot_P v - p''. A belt's
    surface runs at b - (b . n) n over its piece, which is subtracted too.

    u is how fast the contact point moves over the plate: that over a corner of the piece stays over it; the crossing of an
    outline along e with an edge moves along both. The gap's rate is the normal velocity where plate and face are parallel, as
    they are where both touch; elsewhere it is off by their angle times the sliding speed. Of the nearest pair apart, u and d'
    are those of edges that cross.

    Args:
        found: The points, as `touching_kernel.touching` or `hull_kernel.hulls` left them.
        plates: What they are on; of hulls single corners.
        rates: Of the pieces, as of `Polytopes`.
        body: The body of each plate, shape (plates,).
        carries: Which coordinates move each body, shape (bodies, nv).
        J_W: The joints' Jacobian at W's origin over its rate, shape (12, nv).
        v: Shape (nv,).
        alongs: A direction in W for the first tangent of each plate, shape (plates, 3).
        axes: Written: R_WC, shape (k, 3, 3).
        J: Written: shape (3 k, nv).
        velocity: Written: relative to the pieces, shape (3 k,).
        bias: Written.
    """
    places, normals, gaps, which, ways = found
    corners, at, ups, radii = plates
    nv = len(v)
    moving, turning, piece = np.zeros((len(carries), 12)), np.empty((3, 3)), np.zeros(9)
    for b in range(len(carries)):
        for c in range(nv):
            if carries[b, c] and v[c] != 0.0:
                moving[b] += J_W[:, c] * v[c]
    for k in range(len(places)):
        plate, P, n = which[k, 5], places[k], normals[k]
        b = body[plate]
        w, A = moving[b, 3:6], moving[b, 6:]
        v_P = moving[b, :3] + cross(w, P)
        a = A[:3] + cross(A[3:], P) + cross(w, v_P)
        if len(rates):
            piece = rates[which[k, 3]]
            v_P, a = v_P - piece[:3], a - piece[3:6]
        u, dn, kind, first, size = np.zeros(3), np.zeros(3), which[k, 0], at[plate], at[plate + 1] - at[plate]
        i, way = which[k, 1], ways[k]
        e = corners[first + (i + 1) % size] - corners[first + i] if size > 1 else u
        radius, v_C = radii[plate], v_P + radii[plate] * cross(w, n)  # of the ball's centre, of the axis, or of the point
        if which[k, 4] == ON_PLATE:
            dn = cross(w, n)
        elif size == 1:
            if kind == OTHER:
                dn = v_C - dot(v_C, n) * n - (dot(v_C, way) / max(dot(way, way), 1e-300)) * way
                dn = dn / max(gaps[k] + radius, 1e-9)
            u = v_C - radius * dn - v_P
        if kind == UNDER and radius > 0.0:  # an axis beside a corner, which stays
            far, x = gaps[k] + radius, e / math.sqrt(dot(e, e))
            at_foot = v_C - (dot(x, v_C) + far * dot(n, cross(w, x))) * x
            dn = (at_foot - dot(at_foot, n) * n) / max(far, 1e-9)
            u = at_foot - radius * dn - v_P
        elif kind == UNDER:
            up = ups[plate]
            u = (dot(up, v_P) / dot(up, n)) * n + gaps[k] * dn - v_P
        elif kind == CROSSING and which[k, 4] == ON_PLATE:
            m = cross(n, e)
            rate = dot(m, v_P - gaps[k] * dn) / dot(m, way)
            u = rate * way + (dot(n, v_P) - rate * dot(n, way)) * n + gaps[k] * dn - v_P
        elif kind == CROSSING:
            u = (-dot(way, v_P) / dot(way, e)) * e
        elif kind == OTHER and size > 1:
            both = cross(e, way)
            sine = dot(both, n)
            if sine * sine > 1e-6 * dot(e, e) * dot(way, way):
                dn = cross(cross(w, e), way) / sine
                dn = dn - dot(dn, n) * n
                u = v_C - radius * dn - v_P - (dot(cross(v_C - radius * dn, way), n) / sine) * e
        a = a + cross(w, u)
        if len(rates):
            belt = piece[6:]
            a = a + dot(dn, belt) * n + dot(n, belt) * dn
            v_P = v_P - belt + dot(n, belt) * n
        _axes(n, dn, alongs[plate], axes[k], turning)
        for c in range(3):
            d = axes[k, :, c].copy()
            turn, row = cross(P, d), 3 * k + c
            for x in range(nv):
                J[row, x] = 0.0
                if carries[b, x]:
                    J[row, x] = (
                        d[0] * J_W[0, x] + d[1] * J_W[1, x] + d[2] * J_W[2, x]
                        + turn[0] * J_W[3, x] + turn[1] * J_W[4, x] + turn[2] * J_W[5, x]
                    )  # fmt: skip
            velocity[row], bias[row] = dot(d, v_P), dot(d, a) + dot(turning[:, c], v_P)


_READ, _LIST = array(2), array(1, written=True)
rows = compiled(
    _rows,
    signature(
        None, SPOTS, PLATES, array(2, written=True), array(1, COUNT), _READ, _READ, array(1), _READ,
        array(3, written=True), array(2, written=True), _LIST, _LIST,
    ),
)  # fmt: skip
