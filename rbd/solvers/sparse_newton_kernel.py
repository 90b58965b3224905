"""Compiled sweeps over the contacts of a sparse problem: Gauss-Seidel by `rbd.solvers.sparse_newton`'s projection."""

from __future__ import annotations

import math

import numpy as np

from rbd.arrays import Array
from rbd.kernels import COUNT, NUMBER, array, compiled, signature

_SMALL = 1e-200
_INNER = 5
"""Fixed-point steps at one contact before the next one."""


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
    y, new, block, change = np.zeros(5), np.zeros(5), np.zeros((5, 5)), 0.0
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
            rate = rates[part]
            for _ in range(_INNER):
                moved = 0.0
                for e in range(d - 1, -1, -1):  # the normal first
                    c = y[e]
                    for s in range(d):
                        c += block[e, s] * new[s]
                    p = new[e] - rate * c
                    if e == d - 1:
                        p = min(max(p, lower[part]), upper[part]) if part < n else max(p, 0.0)
                    moved = max(moved, abs(p - new[e]))
                    new[e] = p
                if part >= n:
                    for disc in range(0, d - 1, 2):
                        stop, t = min(disc + 2, d - 1), 0.0
                        for e in range(disc, stop):
                            t += new[e] * new[e]
                        share = min(1.0, mu[part - n, disc // 2] * new[d - 1] / max(math.sqrt(t), _SMALL))
                        for e in range(disc, stop):
                            new[e] *= share
                if moved == 0.0:
                    break
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
