"""Small matrices in loops, compiled: products, Gauss's elimination, LAPACK above some size, and independent rows."""

from __future__ import annotations

import math

import numpy as np

from rbd.arrays import Array
from rbd.kernels import compiled

_MOST = 75
"""Rows up to which loops are no slower than LAPACK."""


@compiled
def product(A: Array, x: Array, out: Array) -> None:
    """Write A x, of some ten or hundred entries; out is neither of them."""
    for r in range(len(out)):
        total = 0.0
        for c in range(len(x)):
            total += A[r, c] * x[c]
        out[r] = total


@compiled
def add_product(A: Array, x: Array, out: Array) -> None:
    """Add A x to `out`."""
    for r in range(len(out)):
        total = 0.0
        for c in range(len(x)):
            total += A[r, c] * x[c]
        out[r] += total


@compiled
def add_transposed(A: Array, x: Array, out: Array) -> None:
    """Add A^T x, of an x that is often zero, to `out`."""
    for r in range(len(x)):
        if x[r] != 0.0:
            for c in range(len(out)):
                out[c] += A[r, c] * x[r]


@compiled
def solved(A: Array, b: Array) -> Array:
    """A^-1 b by LAPACK, of several columns b; NaN where A is singular."""
    try:
        x = np.ascontiguousarray(np.linalg.solve(A, b))
    except Exception:  # the only kind that Numba knows
        x = np.full(b.shape, np.nan)
    return x


@compiled
def eliminate(A: Array, b: Array, n: int) -> bool:
    """Solve A x = b in place by Gauss's elimination with row pivots, x in b; False where A is singular or not finite."""
    if n > _MOST:
        x = solved(A[:n, :n].copy(), b[:n].copy().reshape(n, 1))
        b[:n] = x[:, 0]
        return bool(np.isfinite(x).all())
    for k in range(n):
        pivot, most = k, abs(A[k, k])
        for i in range(k + 1, n):
            if abs(A[i, k]) > most:
                pivot, most = i, abs(A[i, k])
        if not 0.0 < most < math.inf:
            return False
        if pivot != k:
            for j in range(k, n):
                A[k, j], A[pivot, j] = A[pivot, j], A[k, j]
            b[k], b[pivot] = b[pivot], b[k]
        scale = 1.0 / A[k, k]
        for i in range(k + 1, n):
            factor = A[i, k] * scale
            if factor != 0.0:
                b[i] -= factor * b[k]
                for j in range(k + 1, n):
                    A[i, j] -= factor * A[k, j]
    for i in range(n - 1, -1, -1):
        total = b[i]
        for j in range(i + 1, n):
            total -= A[i, j] * b[j]
        b[i] = total / A[i, i]
    return True


@compiled
def independent(rows: Array, count: int, tolerance: float) -> int:
    """Number of linearly independent rows; an orthonormal basis of them comes first (Gram and Schmidt, with pivots)."""
    dim, greatest = rows.shape[1], 0.0
    for k in range(min(count, dim)):
        pivot, most = k, -1.0
        for i in range(k, count):
            size = 0.0
            for r in range(dim):
                size += rows[i, r] * rows[i, r]
            if size > most:
                pivot, most = i, size
        greatest = max(greatest, most)
        if not most > greatest * tolerance * tolerance:
            return k
        for r in range(dim):
            rows[pivot, r], rows[k, r] = rows[k, r], rows[pivot, r] / math.sqrt(most)
        for _ in range(2):  # again for the last digits
            for i in range(k + 1, count):
                along = 0.0
                for r in range(dim):
                    along += rows[i, r] * rows[k, r]
                for r in range(dim):
                    rows[i, r] -= along * rows[k, r]
    return min(count, dim)


@compiled
def pivoted_factor(A: Array, order: Array, tolerance: float) -> int:
    """The lower factor of a symmetric A without negative eigenvalues in the columns of its pivots, in place: their number.

    Args:
        A: Written.
        order: Written: its rows, those of the pivots first, in their order.
        tolerance: Smaller pivots are zero.
    """
    n = len(A)
    for r in range(n):
        order[r] = r
    for rank in range(n):
        best = rank
        for e in range(rank + 1, n):
            if A[order[e], order[e]] > A[order[best], order[best]]:
                best = e
        order[rank], order[best] = order[best], order[rank]
        i = order[rank]
        if not A[i, i] > tolerance:
            return rank
        A[i, i] = math.sqrt(A[i, i])
        for j in order[rank + 1 :]:
            A[j, i] /= A[i, i]
        for j in order[rank + 1 :]:
            for c in order[rank + 1 :]:
                A[j, c] -= A[j, i] * A[c, i]
    return n


@compiled
def pivoted_solve(A: Array, order: Array, rank: int, x: Array) -> None:
    """A^-1 x in the rows of the pivots, in place, and zero in others: a solution where there is one."""
    for e in range(rank):
        i = order[e]
        for c in range(e):
            x[i] -= A[i, order[c]] * x[order[c]]
        x[i] /= A[i, i]
    for e in range(rank - 1, -1, -1):
        i = order[e]
        for c in range(e + 1, rank):
            x[i] -= A[order[c], i] * x[order[c]]
        x[i] /= A[i, i]
    for i in order[rank:]:
        x[i] = 0.0
