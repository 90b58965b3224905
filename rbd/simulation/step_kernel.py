"""The compiled arithmetic of a step: floating bases, points of bodies in contact."""

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
def turned(start: Array, v: Array, h: float, bases: Array) -> Array:
    """`Bases.turned`."""
    out = start.copy()
    for n in range(len(bases)):
        _turn(out, v, h, bases[n, 1])
    return out


@compiled
def _place(q: Array, out: Array, v: Array, h: float, at: int, i: int, R: Array) -> None:
    """Put the base's origin into `out`; R is left at R_WB of q."""
    _rotation(q, at, R)
    for k in range(3):
        out[at + k] = q[at + k] + h * (R[k, 0] * v[i] + R[k, 1] * v[i + 1] + R[k, 2] * v[i + 2])


@compiled
def middle(q: Array, out: Array, v: Array, v_h: Array, h: float, bases: Array) -> tuple[Array, Array, Array, Array]:
    """(v, v_h, end, mean) of `Bases.middle`; the bases' origins are put into `out`."""
    one, two, R, S = v.copy(), v_h.copy(), np.empty((3, 3)), np.empty((3, 3))
    for n in range(len(bases)):
        at, i = bases[n, 0], bases[n, 1]
        _place(q, out, v, 0.5 * h, at, i, R)
        _rotation(out, at, S)
        _carried(one, i, R, S)
        _carried(two, i, R, S)
    end, mean = one.copy(), one.copy()
    for n in range(len(bases)):
        _turn(end, two, h, bases[n, 1])
        _turn(mean, two, 0.5 * h, bases[n, 1])
    return one, two, end, mean


@compiled
def moved(q: Array, out: Array, v: Array, h: float, bases: Array) -> Array:
    """The velocity of `Bases.moved`; the bases' origins are put into `out`."""
    carried, R, S = v.copy(), np.empty((3, 3)), np.empty((3, 3))
    for n in range(len(bases)):
        at, i = bases[n, 0], bases[n, 1]
        _place(q, out, v, h, at, i, R)
        _rotation(out, at, S)
        _carried(carried, i, R, S)
    return carried


@compiled
def _mapped(matrix: Array, X: Array, x: Array, one: Array, other: Array) -> Array:
    """`rbd.answers.prepared.contact_bodies.BilinearMap`."""
    products, out = np.empty(len(one)), np.empty(len(matrix))
    for c in range(len(one)):
        products[c] = X[one[c]] * x[other[c]]
    product(matrix, products, out)
    return out


@compiled
def points(X: Array, V: Array, gaps: Array, height: Array, matrix: Array, one: Array, other: Array) -> tuple[Array, Array]:
    """(gap, velocity) of all points."""
    gap = np.empty(len(height))
    for i in range(len(height)):
        total = -height[i]
        for c in range(len(X)):
            total += gaps[i, c] * X[c]
        gap[i] = total
    return gap, _mapped(matrix, X, V, one, other)


@compiled
def target(V: Array, row_rates: Array, h: float) -> Array:
    """Accelerations of the bodies' rows that bring them to rest within h."""
    out = np.empty(len(row_rates))
    product(row_rates, V, out)
    for r in range(len(out)):
        out[r] = -out[r] / h
    return out


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
) -> tuple[bool, Array, Array]:
    """(whether all forces are in their cones, impulses, velocity) of points that stick.

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
    """
    f, v, inside = _mapped(matrix, X, F, one, other), np.empty(len(a)), True
    for i in range(len(a)):
        v[i] = start[i] + h * a[i]
    for i in range(len(mu)):
        if not math.hypot(f[3 * i], f[3 * i + 1]) <= mu[i] * f[3 * i + 2]:
            inside = False
    for i in range(len(f)):
        f[i] *= h
    return inside, f, v
