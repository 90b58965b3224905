"""The contact problem in numbers of order one, families of motions that leave forces unchanged, and small matrices in loops."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from rbd.arrays import Array
from rbd.kernels import compiled

MOBILITY = 10.0
"""Of each scaled point, which balances weights and accelerations: fewest steps, of 1 to 30 tried."""


class ScaledBodies(NamedTuple):
    """The scaled problem: each point's block of Q' D Q has the largest diagonal `MOBILITY`, c is of order one.

    Attributes:
        D: Inverse inertia of the bodies' rows, shape (nw, nw).
        L: Its inverse.
        c: Free acceleration, shape (nw,).
        columns: Columns of Q, P scaled, shape (3 k, d).
        first: First row of each point, shape (k,).
        mu: Frictions.
    """

    D: Array
    L: Array
    c: Array
    columns: Array
    first: Array
    mu: Array


@compiled
def scale(bodies: ScaledBodies, P: Array, c: Array, unit: Array) -> float:
    """Fill columns and c of the scaled problem, and the points' `unit`: the rate by which c was divided."""
    most, d = 0.0, P.shape[1]
    for i in range(len(unit)):
        at, size = bodies.first[i], 0.0
        for j in range(3 * i, 3 * i + 3):
            total = 0.0
            for r in range(d):
                part = 0.0
                for s in range(d):
                    part += bodies.D[at + r, at + s] * P[j, s]
                total += part * P[j, r]
            size = max(size, total)
        unit[i] = size
        most = max(most, size)
    rate = 0.0
    for i in range(len(unit)):
        at = bodies.first[i]
        unit[i] = math.sqrt(MOBILITY / max(unit[i], 1e-12 * most if most > 0.0 else 1.0))
        for j in range(3 * i, 3 * i + 3):
            total = 0.0
            for r in range(d):
                bodies.columns[j, r] = P[j, r] * unit[i]
                total += bodies.columns[j, r] * c[at + r]
            rate = max(rate, abs(total))
    rate = rate if rate > 0.0 else 1.0
    for r in range(len(c)):
        bodies.c[r] = c[r] / rate
    return rate


@compiled
def leaves_motion_open(bodies: ScaledBodies, w: Array, p: Array, memory: Array) -> bool:
    """Whether the equations of the modes at an answer w of Coulomb's law leave a family of motions, not only of weights.

    Loads N of slipping points and forces g of sticking ones, as changes, move the bodies by z:
    (L + the turning of friction) z = Q_edge N + Q g. The points' conditions are y_n = 0 of the ones and y = 0 of the others.
    There is a family where some Q_edge N + Q g other than zero meets them.

    Args:
        bodies: The scaled problem.
        w: Scaled weights, shape (3 k,).
        p: w - y.
        memory: Working memory, as `ContactNewton` makes it.
    """
    columns, first, mu, L = bodies.columns, bodies.first, bodies.mu, bodies.L
    n, d, nw = columns.shape[0], columns.shape[1], len(L)
    touching = memory[: n // 3]
    slides = False
    for i in range(n // 3):
        j = 3 * i
        touching[i] = 1.0 if w[j + 2] - p[j + 2] < 1e-9 else 0.0
        if touching[i] > 0.0 and math.hypot(w[j] - p[j], w[j + 1] - p[j + 1]) > 1e-9:
            slides = True
    if not slides:
        return False
    rows = memory[n : n + n * nw].reshape(n, nw)
    conditions = memory[n + n * nw : n + 2 * n * nw].reshape(n, nw)
    if _normals_are_independent(bodies, touching, rows, conditions):
        return False  # independent normals determine their shares
    squares = memory[n + 2 * n * nw : n + 2 * n * nw + 2 * nw * nw].reshape(2, nw, nw)
    H, inverse_factor = squares[0], squares[1]
    found = 0
    for r in range(nw):
        for s in range(nw):
            H[r, s] = L[r, s]
    for i in range(n // 3):
        j, at, normal = 3 * i, first[i], p[3 * i + 2]
        if touching[i] > 0.0:
            normal += max(1e-9 - w[j + 2], 0.0)  # a touching unloaded point may become loaded
        if not normal > 0.0:
            continue
        t = math.hypot(p[j], p[j + 1])
        slips = t > mu[i] * normal
        for e in range(j + 2 if slips else j, j + 3):
            for r in range(nw):
                rows[found, r] = conditions[found, r] = 0.0
            for r in range(d):
                conditions[found, at + r] = rows[found, at + r] = columns[e, r]
                if slips:
                    rows[found, at + r] += mu[i] * (p[j] * columns[j, r] + p[j + 1] * columns[j + 1, r]) / t
            found += 1
        if slips:
            turned = mu[i] * normal / (t - mu[i] * normal) / (t * t)
            for r in range(d):
                side = turned * (p[j] * columns[j + 1, r] - p[j + 1] * columns[j, r])
                for s in range(d):
                    H[at + r, at + s] += side * (p[j] * columns[j + 1, s] - p[j + 1] * columns[j, s])
    rank = independent(rows, found, 1e-8)
    if rank == 0 or not inverse(H, H, inverse_factor):
        return False
    at = n + 2 * n * nw + 2 * nw * nw
    answers = memory[at : at + rank * found].reshape(rank, found)
    z = inverse_factor[0]
    for b in range(rank):
        for r in range(nw):
            total = 0.0
            for s in range(nw):
                total += H[r, s] * rows[b, s]
            z[r] = total
        for i in range(found):
            total = 0.0
            for r in range(nw):
                total += conditions[i, r] * z[r]
            answers[b, i] = total
    return independent(answers, rank, 1e-8) < rank


@compiled
def _normals_are_independent(bodies: ScaledBodies, touching: Array, R: Array, felt: Array) -> bool:
    """Whether the normals of the touching points are independent: by the factor R of their block of Q' D Q, row by row."""
    columns, first, D = bodies.columns, bodies.first, bodies.D
    nw, d, found = len(D), columns.shape[1], 0
    least, most = math.inf, 0.0
    for i in range(len(touching)):
        if touching[i] == 0.0:
            continue
        if found == nw:
            return False
        at, j = first[i], 3 * i + 2
        for r in range(nw):
            felt[found, r] = 0.0
            for s in range(d):
                felt[found, r] += D[r, at + s] * columns[j, s]
        for e in range(found + 1):  # felt[e] belongs to the normal of row e
            total = 0.0
            for r in range(d):
                total += felt[e, at + r] * columns[j, r]
            for s in range(e):
                total -= R[found, s] * R[e, s]
            if e < found:
                R[found, e] = total / R[e, e]
            elif total > 0.0:
                R[e, e] = math.sqrt(total)
            else:
                return False
        least, most = min(least, R[found, found]), max(most, R[found, found])
        found += 1
        if not least > 1e-5 * most:
            return False
    return True


_MOST = 75
"""Rows up to which loops are no slower than LAPACK."""


@compiled
def _by_lapack(A: Array, b: Array, n: int) -> bool:
    try:
        b[:n] = np.linalg.solve(A[:n, :n].copy(), b[:n].copy())
    except Exception:  # the only kind that Numba knows
        return False
    return True


@compiled
def eliminate(A: Array, b: Array, n: int) -> bool:
    """Solve A x = b in place by Gauss's elimination with row pivots, x in b; False where A is singular or not finite."""
    if n > _MOST:
        return _by_lapack(A, b, n)
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
def inverse(D: Array, out: Array, R: Array) -> bool:
    """The inverse of a symmetric matrix in `out`; False where it is not positive definite. R: room of the same shape."""
    n = len(D)
    for i in range(n):
        for j in range(i + 1):
            total = D[i, j]
            for e in range(j):
                total -= R[i, e] * R[j, e]
            if i > j:
                R[i, j] = total * R[j, j]
            elif 0.0 < total < math.inf:
                R[i, i] = 1.0 / math.sqrt(total)  # of the factor's diagonal, the inverse
            else:
                return False
    for j in range(n):  # the factor's inverse in its place
        for i in range(j + 1, n):
            total = 0.0
            for e in range(j, i):
                total -= R[i, e] * R[e, j]
            R[i, j] = total * R[i, i]
    for i in range(n):
        for j in range(i + 1):
            total = 0.0
            for e in range(i, n):
                total += R[e, i] * R[e, j]
            out[i, j] = out[j, i] = total
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
