"""The compiled arithmetic of a step: floating bases, points of bodies in contact.

Arrays are written, not returned: to make one of Numba's into one of NumPy's takes a microsecond.
"""

from __future__ import annotations

import math

import numpy as np

from rbd.arrays import Array
from rbd.kernels import compiled
from rbd.solvers.small_systems import product


@compiled
def _rotation(q: Array, at: int, R: Array) -> None:
    x, y, z, w = q[at + 3], q[at + 4], q[at + 5], q[at + 6]
    R[0, 0], R[0, 1], R[0, 2] = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)
    R[1, 0], R[1, 1], R[1, 2] = 2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)
    R[2, 0], R[2, 1], R[2, 2] = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)


@compiled
def _carried(v: Array, i: int, R: Array, S: Array) -> tuple[float, float, float]:
    """Turn the linear part of v at i from the axes R to the axes S, in place; what it is in the world's."""
    x = R[0, 0] * v[i] + R[0, 1] * v[i + 1] + R[0, 2] * v[i + 2]
    y = R[1, 0] * v[i] + R[1, 1] * v[i + 1] + R[1, 2] * v[i + 2]
    z = R[2, 0] * v[i] + R[2, 1] * v[i + 1] + R[2, 2] * v[i + 2]
    for k in range(3):
        v[i + k] = S[0, k] * x + S[1, k] * y + S[2, k] * z
    return x, y, z


@compiled
def _turn(out: Array, v: Array, h: float, i: int) -> None:
    x, y, z, a, b, c = v[i], v[i + 1], v[i + 2], v[i + 3], v[i + 4], v[i + 5]
    out[i] += h * (b * z - c * y)
    out[i + 1] += h * (c * x - a * z)
    out[i + 2] += h * (a * y - b * x)


@compiled
def turned(start: Array, v: Array, h: float, bases: Array, out: Array) -> None:
    """Write `Bases.turned`."""
    out[:] = start
    for n in range(len(bases)):
        _turn(out, v, h, bases[n, 1])


@compiled
def _place(q: Array, out: Array, v: Array, h: float, at: int, i: int, R: Array) -> None:
    """Put the base's origin into `out`; R is left at R_WB of q."""
    _rotation(q, at, R)
    for k in range(3):
        out[at + k] = q[at + k] + h * (R[k, 0] * v[i] + R[k, 1] * v[i + 1] + R[k, 2] * v[i + 2])


@compiled
def middle(q: Array, out: Array, v: Array, v_h: Array, h: float, bases: Array, moves: Array) -> None:
    """Write (v, v_h, end, mean) of `Bases.middle` into `moves`; the bases' origins are put into `out`."""
    one, two, end, mean, R, S = moves[0], moves[1], moves[2], moves[3], np.empty((3, 3)), np.empty((3, 3))
    one[:], two[:] = v, v_h
    for n in range(len(bases)):
        at, i = bases[n, 0], bases[n, 1]
        _place(q, out, v, 0.5 * h, at, i, R)
        _rotation(out, at, S)
        _carried(one, i, R, S)
        _carried(two, i, R, S)
    end[:], mean[:] = one, one
    for n in range(len(bases)):
        _turn(end, two, h, bases[n, 1])
        _turn(mean, two, 0.5 * h, bases[n, 1])


@compiled
def moved(q: Array, out: Array, v: Array, h: float, bases: Array, carried: Array) -> None:
    """Write the velocity of `Bases.moved`; the bases' origins are put into `out`."""
    R, S = np.empty((3, 3)), np.empty((3, 3))
    carried[:] = v
    for n in range(len(bases)):
        at, i = bases[n, 0], bases[n, 1]
        _place(q, out, v, h, at, i, R)
        _rotation(out, at, S)
        _carried(carried, i, R, S)


@compiled
def _mapped(matrix: Array, X: Array, x: Array, one: Array, other: Array, out: Array) -> None:
    """`rbd.answers.prepared.contact_bodies.BilinearMap`."""
    products = np.empty(len(one))
    for c in range(len(one)):
        products[c] = X[one[c]] * x[other[c]]
    product(matrix, products, out)


@compiled
def points(
    X: Array, V: Array, gaps: Array, height: Array, matrix: Array, one: Array, other: Array, gap: Array, velocity: Array
) -> tuple[float, float, float]:
    """Write gap and velocity of all points; the least and the largest gap, and the least velocity along a normal."""
    for i in range(len(height)):
        total = -height[i]
        for c in range(len(X)):
            total += gaps[i, c] * X[c]
        gap[i] = total
    _mapped(matrix, X, V, one, other, velocity)
    lowest, highest, approach = math.inf, -math.inf, math.inf
    for i in range(len(gap)):
        lowest, highest, approach = min(lowest, gap[i]), max(highest, gap[i]), min(approach, velocity[3 * i + 2])
    return lowest, highest, approach


@compiled
def target(V: Array, row_rates: Array, h: float, out: Array) -> None:
    """Write the accelerations of the bodies' rows that bring them to rest within h."""
    product(row_rates, V, out)
    for r in range(len(out)):
        out[r] = -out[r] / h


@compiled
def sticking(
    X: Array,
    F: Array,
    a: Array,
    start: Array,
    h: float,
    mu: Array,
    matrix: Array,
    one: Array,
    other: Array,
    f: Array,
    v: Array,
) -> bool:
    """Write impulses and velocity of points that stick; whether all forces are in their cones.

    Args:
        X: Placements of the bodies.
        F: Forces on the bodies' rows.
        a: Acceleration.
        start: Velocity to which h a is added.
        h: Length of the step [s].
        mu: Friction coefficients.
        matrix: Of the map to forces of points.
        one: Of the same map.
        other: Of the same map.
        f: Is written: impulses of the points.
        v: Is written: the velocity.
    """
    inside = True
    _mapped(matrix, X, F, one, other, f)
    for i in range(len(a)):
        v[i] = start[i] + h * a[i]
    for i in range(len(mu)):
        if not np.hypot(f[3 * i], f[3 * i + 1]) <= mu[i] * f[3 * i + 2]:
            inside = False
    for i in range(len(f)):
        f[i] *= h
    return inside


@compiled
def _turned_to(X: Array, at: int, G: Array, x: float, y: float, z: float, out: Array) -> None:
    """G^T R (x, y, z) of the body whose placement begins at `at`."""
    for r in range(3):
        out[3 + r] = X[at + r] * x + X[at + 3 + r] * y + X[at + 6 + r] * z
    for r in range(3):
        out[r] = G[0, r] * out[3] + G[1, r] * out[4] + G[2, r] * out[5]


@compiled
def wrenches(X: Array, f: Array, of: Array, axes: Array, arms: Array, out: Array) -> None:
    """Write the wrenches on the bodies in their joints' axes of forces at their points in the points' own."""
    w = np.empty(3)
    out[:] = 0.0
    for i in range(len(of)):
        G, x, at, b = axes[i], arms[i], 12 * of[i], 6 * of[i]
        for r in range(3):
            w[r] = G[r, 0] * f[3 * i] + G[r, 1] * f[3 * i + 1] + G[r, 2] * f[3 * i + 2]
        fx = X[at] * w[0] + X[at + 1] * w[1] + X[at + 2] * w[2]
        fy = X[at + 3] * w[0] + X[at + 4] * w[1] + X[at + 5] * w[2]
        fz = X[at + 6] * w[0] + X[at + 7] * w[1] + X[at + 8] * w[2]
        out[b], out[b + 1], out[b + 2] = out[b] + fx, out[b + 1] + fy, out[b + 2] + fz
        out[b + 3] += x[1] * fz - x[2] * fy
        out[b + 4] += x[2] * fx - x[0] * fz
        out[b + 5] += x[0] * fy - x[1] * fx


@compiled
def residual(
    X: Array, V: Array, lifts: Array, gravity: Array, of: Array, axes: Array, arms: Array, mu: Array, taken: Array,
    applied: Array, a: Array, f: Array, u: Array, end: Array, h: float,
) -> float:  # fmt: skip
    """`GroundDynamics.residual`, from the generalised forces that the motion takes and the bodies' motion.

    Args:
        X: Placements of the bodies.
        V: Their velocities.
        lifts: Their spatial accelerations less that of gravity.
        gravity: In world axes.
        of: The body of each point.
        axes: R_WC of each point.
        arms: Where each point is in its body's axes.
        mu: Friction coefficients.
        taken: Generalised forces that the motion takes, less those of the contact forces.
        applied: Those given.
        a: Acceleration.
        f: Forces of the points.
        u: Velocities of the points at the beginning.
        end: The same at the end.
        h: Length of the half step [s].
    """
    largest, off, most = 1.0, 0.0, 1.0
    for i in range(len(f)):
        largest = max(largest, abs(f[i]))
    size = largest
    for i in range(len(a)):
        size, off, most = max(size, abs(applied[i])), max(off, abs(taken[i] - applied[i])), max(most, abs(a[i]))
    outside, moved, A, turned = 0.0, 0.0, np.empty(6), np.empty(6)
    for i in range(len(of)):
        outside = max(outside, np.hypot(f[3 * i], f[3 * i + 1]) - mu[i] * f[3 * i + 2])
        if f[3 * i] == 0.0 and f[3 * i + 1] == 0.0 and f[3 * i + 2] == 0.0:
            continue
        at, b, (x, y, z) = 12 * of[i], 6 * of[i], (arms[i, 0], arms[i, 1], arms[i, 2])
        for r in range(3):
            A[r], A[3 + r] = lifts[b + r], lifts[b + 3 + r]
            for c in range(3):
                A[r] += X[at + 3 * r + c] * gravity[c]
        p, q, s = V[b + 3], V[b + 4], V[b + 5]
        # of the point: v + w x r, and a + alpha x r + w x (v + w x r)
        vx, vy, vz = V[b] + q * z - s * y, V[b + 1] + s * x - p * z, V[b + 2] + p * y - q * x
        ax = A[0] + A[4] * z - A[5] * y + q * vz - s * vy
        ay = A[1] + A[5] * x - A[3] * z + s * vx - p * vz
        az = A[2] + A[3] * y - A[4] * x + p * vy - q * vx
        _turned_to(X, at, axes[i], ax, ay, az, turned)
        for r in range(3):
            moved = max(moved, abs(h * turned[r] + u[3 * i + r] - end[3 * i + r]))
    return max(off / size, moved / (h * most), outside / largest)
