"""Compiled: from forces that hold bodies at rest to those of the convex law, if not all points stick; needs Numba."""

from __future__ import annotations

import math

import numpy as np

from rbd.arrays import Array
from rbd.kernels import COUNT, NUMBER, array, compiled
from rbd.solvers.contact_kernel import body_forces

UNKNOWN, STICK, MOVE = 0, 1, 2


def _release(
    D: Array, f: Array, w: Array, change: Array, least_norm: Array, found: float,
    P: Array, first: Array, mu: Array, seeds: Array, memory: Array, points: Array,
) -> int:  # fmt: skip
    """`ContactNewton.release`: f, w and the beginning of `change` are written where the points do not all stick.

    Args:
        D: Inverse inertia of the bodies' rows, shape (nw, nw).
        f: Row forces that hold the bodies, shape (nw,).
        w: Weights of the points, shape (3 k,).
        change: Accelerations of the rows, in its first nw entries.
        least_norm: Weights of minimum norm for row forces, shape (3 k, nw).
        found: Largest merit of an answer.
        P: As of `contact_kernel.body_forces`, like those after it.
        first: First row of each point.
        mu: Frictions.
        seeds: Points with which the search begins.
        memory: Working memory.
        points: Working memory of numbers.
    """
    n, nw = len(w), len(f)
    c, start, out = np.empty(nw), np.empty(n), np.empty(n + nw)
    for r in range(nw):
        total = 0.0
        for s in range(nw):
            total -= D[r, s] * f[s]
        c[r] = total
    for j in range(n):
        total = 0.0
        for s in range(nw):
            total += least_norm[j, s] * f[s]
        start[j] = total
    sticks = True
    for i in range(len(mu)):
        sticks = sticks and math.hypot(start[3 * i], start[3 * i + 1]) <= mu[i] * start[3 * i + 2]
    if sticks:
        return STICK
    merit, _, _ = body_forces(D, c, start, False, P, first, mu, seeds, memory, points, out)
    if not merit <= found:
        return UNKNOWN
    for r in range(nw):
        total = c[r]
        for s in range(nw):
            total += D[r, s] * out[n + s]
        change[r] = total
    for j in range(n):
        w[j] = out[j]
    for r in range(nw):
        f[r] = out[n + r]
    return MOVE


release = compiled(
    _release,
    COUNT(
        array(2), array(1, written=True), array(1, written=True), array(1, written=True), array(2), NUMBER,
        array(2), array(1, COUNT), array(1), array(1, COUNT), array(1, written=True), array(2, COUNT, written=True),
    ),
)  # fmt: skip
