"""Compiled sweeps over the contacts of a sparse problem: Gauss-Seidel, each contact's own problem solved by Newton's method."""

from __future__ import annotations

import math

import numpy as np

from rbd.arrays import Array
from rbd.kernels import COUNT, NUMBER, array, compiled, signature
from rbd.solvers.small_systems import eliminate

_SMALL = 1e-200
_STEPS = 12
_FIXED_POINT_STEPS = 5
_EXACT = 1e-15


@compiled
def _project(p: Array, d: int, mu: Array, out: Array, slopes: Array) -> None:
    """The projection of a cone's d weights, the normal last, and its slopes."""
    n = d - 1
    out[n] = max(p[n], 0.0)
    slopes[:d, :d] = 0.0
    if p[n] <= 0.0:
        out[:n] = 0.0
        return
    slopes[n, n] = 1.0
    for disc in range(0, n, 2):
        stop, t, u = min(disc + 2, n), 0.0, mu[disc // 2]
        for e in range(disc, stop):
            t += p[e] * p[e]
        t = max(math.sqrt(t), _SMALL)
        factor = min(1.0, u * out[n] / t)
        for e in range(disc, stop):
            out[e], slopes[e, e] = factor * p[e], factor
            if factor < 1.0:
                slopes[e, n] = u * p[e] / t
                for s in range(disc, stop):
                    slopes[e, s] -= factor * p[e] * p[s] / (t * t)


@compiled
def _alone(block: Array, y: Array, rate: float, d: int, mu: Array, w: Array, room: Array) -> None:
    """Weights of one cone for the accelerations y without them: by Newton's steps, else some steps to the fixed point."""
    p, out, new, gap, slopes, A = room[0], room[1], room[2], room[3], room[4:9], room[9:14]
    new[:d] = w[:d]
    solved = False
    for _ in range(_STEPS):
        miss, size = 0.0, 0.0
        for e in range(d):
            p[e] = new[e] - rate * y[e]
            for s in range(d):
                p[e] -= rate * block[e, s] * new[s]
        _project(p, d, mu, out, slopes)
        for e in range(d):
            gap[e] = out[e] - new[e]
            miss, size = max(miss, abs(gap[e])), max(size, abs(new[e]), abs(out[e]))
        if miss <= _EXACT * size:
            solved = True
            break
        for e in range(d):  # I + V (rate D - I)
            for s in range(d):
                A[e, s] = (1.0 if e == s else 0.0) - slopes[e, s]
                for k in range(d):
                    A[e, s] += rate * slopes[e, k] * block[k, s]
        if not eliminate(A, gap, d):
            break
        for e in range(d):
            new[e] += gap[e]
    if not solved:
        new[:d] = w[:d]
        for _ in range(_FIXED_POINT_STEPS):
            for e in range(d):
                p[e] = new[e] - rate * y[e]
                for s in range(d):
                    p[e] -= rate * block[e, s] * new[s]
            _project(p, d, mu, out, slopes)
            new[:d] = out[:d]
    w[:d] = new[:d]


def _sweeps(
    pointers: Array, columns: Array, entries: Array, q: Array, rates: Array, lower: Array, upper: Array, mu: Array,
    w: Array, count: int,
) -> float:  # fmt: skip
    """Gauss-Seidel sweeps; the largest change of a weight in the last one.

    Args:
        pointers: Of the rows of D, a compressed sparse row matrix, shape (p + 1,).
        columns: Its column numbers.
        entries: Its entries.
        q: Free accelerations, shape (p,).
        rates: 1 over a bound of the largest eigenvalue of each part's block, shape (n + k,).
        lower: Bounds of the n single columns.
        upper: Their upper bounds.
        mu: Frictions of the discs of the k cones, shape (k, 2).
        w: Weights; written.
        count: How many sweeps.
    """
    n, k = len(lower), len(mu)
    wide = (len(q) - n) // k if k else 1
    y, new, block, change, room = np.zeros(5), np.zeros(5), np.zeros((5, 5)), 0.0, np.zeros((14, 5))
    for _ in range(count):
        change = 0.0
        for part in range(n + k):
            at, d = (part, 1) if part < n else (n + (part - n) * wide, wide)
            for e in range(d):
                y[e], new[e] = q[at + e], w[at + e]
                block[e, :d] = 0.0
                for s in range(pointers[at + e], pointers[at + e + 1]):
                    inside = columns[s] - at
                    if 0 <= inside < d:
                        block[e, inside] += entries[s]
                    else:
                        y[e] += entries[s] * w[columns[s]]
            if part < n:
                new[0] = min(max(new[0] - rates[part] * (y[0] + block[0, 0] * new[0]), lower[part]), upper[part])
            else:
                _alone(block, y, rates[part], d, mu[part - n], new, room)
            for e in range(d):
                change = max(change, abs(new[e] - w[at + e]))
                w[at + e] = new[e]
    return change


sweeps = compiled(
    _sweeps,
    signature(
        NUMBER, array(1, COUNT), array(1, COUNT), *[array(1)] * 5, array(2), array(1, written=True), COUNT,
    ),
)  # fmt: skip
