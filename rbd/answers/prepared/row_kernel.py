"""Compiled: factors of the inertia, rows of bodies in contact, their mobility, and the motion that holds them, at one state.

    M = L^T L                      L has no fill beyond a dof's ancestors [Featherstone2008] section 6.5
    W = L^-T J^T,   J M^-1 J^T = W^T W
    c = J M^-1 (generalised - h) + J_dot v       the rows' acceleration without forces on them
    f = -(W^T W)^-1 c,   a = L^-1 (L^-T (generalised - h) + W f)          held: J a + J_dot v = 0

J and J_dot v come from Pinocchio's world Jacobians and from the bodies' spatial accelerations at a = 0.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from rbd.arrays import Array
from rbd.kernels import compiled

DEPENDENT = 1e-9
"""Squared pivots of the mobility below this, over its diagonal entry: a row that depends on those before it."""
JOINT, LAST, ROW, SIZE, WORLD = range(5)
"""Columns of a site's integers: its joint, the last dof that moves it, its first row, number of rows (three of a point, then
up to three of the body's turning), whether in world axes."""


class Terms(NamedTuple):
    """What `row_terms` writes, for n dofs and m rows: views of one array.

    Attributes:
        L: The factor, shape (n, n), its entries at a dof's ancestors.
        W: L^-T J^T, shape (n, m).
        mobility: J M^-1 J^T, shape (m, m).
        C: Its lower Cholesky factor, shape (m, m).
        free: Accelerations of the rows without forces on them, shape (m,).
        velocity: Of the rows, shape (m,).
        z: L^-T (generalised - h), shape (n,).
    """

    L: Array
    W: Array
    mobility: Array
    C: Array
    free: Array
    velocity: Array
    z: Array


def size_of(n: int, m: int) -> int:
    """Entries of the array behind `Terms`."""
    return n * n + m * n + 2 * m * m + 2 * m + n


@compiled
def terms_in(space: Array, n: int, m: int) -> Terms:
    """The views."""
    a = n * n
    b = a + m * n
    c = b + m * m
    d = c + m * m
    return Terms(
        space[:a].reshape((n, n)), space[a:b].reshape((n, m)), space[b:c].reshape((m, m)), space[c:d].reshape((m, m)),
        space[d : d + m], space[d + m : d + 2 * m], space[d + 2 * m : d + 2 * m + n],
    )  # fmt: skip


@compiled
def factor(M: Array, parent: Array, L: Array) -> None:
    """L of the upper triangle of M."""
    n = len(parent)
    for i in range(n):
        p = i
        while p >= 0:
            L[i, p] = M[p, i]
            p = parent[p]
    for i in range(n - 1, -1, -1):
        L[i, i] = math.sqrt(L[i, i])
        inverse, p = 1.0 / L[i, i], parent[i]
        while p >= 0:
            L[i, p] *= inverse
            p = parent[p]
        p = parent[i]
        while p >= 0:
            k, x = p, L[i, p]
            while k >= 0:
                L[p, k] -= x * L[i, k]
                k = parent[k]
            p = parent[p]


@compiled
def body_rows(
    site: Array, place: Array, X: Array, twist: Array, rate: Array, fall: Array, J: Array, parent: Array, terms: Terms
) -> None:
    """J^T, J_dot v and J v of a site's rows, into W, `free` and `velocity`.

    Args:
        site: Its integers.
        place: Its pose in the joint's axes: R by rows, then p.
        X: The joint's pose: R by columns, then p.
        twist: The joint's velocity in its axes.
        rate: Its spatial acceleration at a = 0, less gravity.
        fall: Gravity, world axes.
        J: Pinocchio's world Jacobian.
        parent: Of each dof.
        terms: Written.
    """
    at, size, r = site[ROW], site[SIZE], place[9:12]
    axes, own, motion = np.empty((3, 3)), np.empty((3, 3)), np.empty((4, 3))
    for k in range(3):  # columns of `axes` are the rows' directions in the world, those of `own` in the joint's axes
        for j in range(3):
            own[k, j] = X[3 * k + j] if site[WORLD] else place[3 * k + j]
    for k in range(3):
        for j in range(3):
            if site[WORLD]:
                axes[k, j] = 1.0 if k == j else 0.0
            else:
                axes[k, j] = X[k] * own[0, j] + X[3 + k] * own[1, j] + X[6 + k] * own[2, j]
    v, w, a, g = motion[0], motion[1], motion[2], motion[3]
    for k in range(3):
        g[k] = X[3 * k] * fall[0] + X[3 * k + 1] * fall[1] + X[3 * k + 2] * fall[2]
    w[0], w[1], w[2] = twist[3], twist[4], twist[5]
    v[0] = twist[0] + w[1] * r[2] - w[2] * r[1]
    v[1] = twist[1] + w[2] * r[0] - w[0] * r[2]
    v[2] = twist[2] + w[0] * r[1] - w[1] * r[0]
    a[0] = rate[0] + g[0] + rate[4] * r[2] - rate[5] * r[1] + w[1] * v[2] - w[2] * v[1]
    a[1] = rate[1] + g[1] + rate[5] * r[0] - rate[3] * r[2] + w[2] * v[0] - w[0] * v[2]
    a[2] = rate[2] + g[2] + rate[3] * r[1] - rate[4] * r[0] + w[0] * v[1] - w[1] * v[0]
    for j in range(3):
        terms.velocity[at + j] = own[0, j] * v[0] + own[1, j] * v[1] + own[2, j] * v[2]
        terms.free[at + j] = own[0, j] * a[0] + own[1, j] * a[1] + own[2, j] * a[2]
        if j < size - 3:
            terms.velocity[at + 3 + j] = own[0, j] * w[0] + own[1, j] * w[1] + own[2, j] * w[2]
            terms.free[at + 3 + j] = own[0, j] * rate[3] + own[1, j] * rate[4] + own[2, j] * rate[5]
    px = X[9] + X[0] * r[0] + X[3] * r[1] + X[6] * r[2]
    py = X[10] + X[1] * r[0] + X[4] * r[1] + X[7] * r[2]
    pz = X[11] + X[2] * r[0] + X[5] * r[1] + X[8] * r[2]
    i = site[LAST]
    while i >= 0:
        wx, wy, wz = J[3, i], J[4, i], J[5, i]
        vx, vy, vz = J[0, i] + wy * pz - wz * py, J[1, i] + wz * px - wx * pz, J[2, i] + wx * py - wy * px
        for j in range(3):
            terms.W[i, at + j] = axes[0, j] * vx + axes[1, j] * vy + axes[2, j] * vz
            if j < size - 3:
                terms.W[i, at + 3 + j] = axes[0, j] * wx + axes[1, j] * wy + axes[2, j] * wz
        i = parent[i]


@compiled
def _divided(site: Array, L: Array, parent: Array, W: Array) -> None:
    """L^-T W of a site's columns, in place."""
    at, size, i = site[ROW], site[SIZE], site[LAST]
    while i >= 0:
        inverse = 1.0 / L[i, i]
        for r in range(at, at + size):
            W[i, r] *= inverse
        p = parent[i]
        while p >= 0:
            x = L[i, p]
            for r in range(at, at + size):
                W[p, r] -= x * W[i, r]
            p = parent[p]
        i = parent[i]


@compiled
def _cholesky(A: Array, C: Array) -> int:
    """Lower factor C of A; the number of the first row that depends on those before it, len(A) of none; -1: not finite.

    Rows that depend on others are left out, with an infinite pivot.
    """
    found = len(A)
    for r in range(len(A)):
        for s in range(r):
            x = A[r, s]
            for k in range(s):
                x -= C[r, k] * C[s, k]
            C[r, s] = x / C[s, s]
        x = A[r, r]
        for k in range(r):
            x -= C[r, k] * C[r, k]
        if not math.isfinite(x):
            return -1
        if x > DEPENDENT * A[r, r]:
            C[r, r] = math.sqrt(x)
        else:
            C[r, r], found = math.inf, min(found, r)
    return found


@compiled
def _rows_solved(C: Array, x: Array) -> None:
    """(C C^T)^-1 x, in place."""
    for r in range(len(x)):
        t = x[r]
        for k in range(r):
            t -= C[r, k] * x[k]
        x[r] = t / C[r, r]
    for r in range(len(x) - 1, -1, -1):
        t = x[r]
        for k in range(r + 1, len(x)):
            t -= C[k, r] * x[k]
        x[r] = t / C[r, r]


@compiled
def accelerated(terms: Terms, z: Array, parent: Array, f: Array, a: Array) -> None:
    """Write a, L^-1 (z + W f)."""
    L, W = terms.L, terms.W
    for i in range(len(a)):
        x = z[i]
        for r in range(len(f)):
            x += W[i, r] * f[r]
        p = parent[i]
        while p >= 0:
            x -= L[i, p] * a[p]
            p = parent[p]
        a[i] = x / L[i, i]


@compiled
def joint_rows(units: Array, gear: Array, v: Array, parent: Array, terms: Terms) -> None:
    """Rows of joints: L^-T J^T and J v, of J with the entries `gear` at (row, dof) `units`; J_dot v is zero."""
    L, W, last = terms.L, terms.W, -1
    for e in range(len(units)):
        r = units[e, 0]
        if r != last:
            terms.velocity[r] = terms.free[r] = 0.0
            last = r
        W[units[e, 1], r] += gear[e]
        terms.velocity[r] += gear[e] * v[units[e, 1]]
    for e in range(len(units)):
        r = units[e, 0]
        if e + 1 < len(units) and units[e + 1, 0] == r:
            continue
        for i in range(len(parent) - 1, -1, -1):
            if W[i, r] != 0.0:
                W[i, r] /= L[i, i]
                p = parent[i]
                while p >= 0:
                    W[p, r] -= L[i, p] * W[i, r]
                    p = parent[p]


@compiled
def all_rows(
    M: Array, J: Array, h: Array, X: Array, twists: Array, rates: Array, parent: Array, sites: Array, places: Array,
    units: Array, gear: Array, fall: Array, v: Array, generalised: Array, terms: Terms,
) -> None:  # fmt: skip
    """Write all terms but C; arguments as of `row_terms`."""
    n, m = len(parent), len(terms.free)
    L, W, z = terms.L, terms.W, terms.z
    factor(M, parent, L)
    W[:] = 0.0
    for i in range(n):
        z[i] = generalised[i] - h[i]
    for i in range(n - 1, -1, -1):
        x, p = z[i] / L[i, i], parent[i]
        z[i] = x
        while p >= 0:
            z[p] -= L[i, p] * x
            p = parent[p]
    for k in range(len(sites)):
        joint = sites[k, JOINT]
        body_rows(sites[k], places[k], X[joint], twists[joint], rates[joint], fall, J, parent, terms)
        _divided(sites[k], L, parent, W)
    joint_rows(units, gear, v, parent, terms)
    A, c = terms.mobility, terms.free
    A[:] = 0.0
    for i in range(n):
        for r in range(m):
            x = W[i, r]
            if x != 0.0:
                c[r] += x * z[i]
                for s in range(m):
                    A[r, s] += x * W[i, s]


@compiled
def row_terms(
    M: Array, J: Array, h: Array, X: Array, twists: Array, rates: Array, parent: Array, sites: Array, places: Array,
    units: Array, gear: Array, fall: Array, v: Array, generalised: Array, space: Array, a: Array, f: Array,
) -> bool:  # fmt: skip
    """Write all terms into `space`, and a and f that hold every row; False where a row depends on others, or M is not positive.

    Args:
        M: Inertia, upper triangle, of `pin.crba`.
        J: World Jacobian, of `pin.crba` in the world's convention.
        h: C v + g, of `pin.nonLinearEffects`.
        X: Poses of the joints, R by columns, then p, shape (joints, 12).
        twists: Their velocities, shape (joints, 6).
        rates: Their spatial accelerations less gravity, as `pin.nonLinearEffects` leaves them, shape (joints, 6).
        parent: Of each dof, -1 of the first.
        sites: Integers, shape (k, 5).
        places: Poses on their joints, R by rows, then p, shape (k, 12).
        units: Row and dof of the entries of rows of joints, in the order of the rows, shape (u, 2).
        gear: The entries, shape (u,).
        fall: Gravity [m/s2].
        v: Velocity, shape (n,).
        generalised: S^T tau + tau_ext, shape (n,).
        space: Written.
        a: Written.
        f: Written.
    """
    terms = terms_in(space, len(parent), len(f))
    all_rows(M, J, h, X, twists, rates, parent, sites, places, units, gear, fall, v, generalised, terms)
    firm = holding_forces(terms, f) == len(f)
    if firm:
        accelerated(terms, terms.z, parent, f, a)
    return firm


@compiled
def holding_forces(terms: Terms, f: Array) -> int:
    """Write C and forces f that hold every row, none on rows that depend on those before them; returns as `_cholesky`."""
    found = _cholesky(terms.mobility, terms.C)
    for r in range(len(f)):
        f[r] = -terms.free[r]
    if found >= 0:
        _rows_solved(terms.C, f)
    return found


@compiled
def row_change(s: Array, parent: Array, space: Array, a: Array, f: Array) -> None:
    """F = (J M^-1 J^T)^-1 s and a = M^-1 J^T f, by what `row_terms` left."""
    terms = terms_in(space, len(a), len(f))
    for r in range(len(f)):
        f[r] = s[r]
    _rows_solved(terms.C, f)
    accelerated(terms, np.zeros(len(a)), parent, f, a)
