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
from rbd.constraints.loop import SHORTEST
from rbd.kernels import COUNT, FLAG, array, compiled, record, signature

IMMOVABLE = 1e-26
"""Mobilities of a body's rows up to this, over what joints of any axes would give them, are rounding: squares of 1e-13."""
DEPENDENT = 1e-9
"""Squared pivots of the mobility below this, over its diagonal entry: a row that depends on those before it."""
JOINT, LAST, ROW, SIZE, AXES, BASE, BASE_LAST = range(7)
"""Columns of a site's integers: its joint, the last dof that moves it, its first row, number of rows (up to three of a point,
then up to three of the body's turning), in which axes; the joint of the surface that it is on, 0 of ground that moves, -1 of
ground at rest, and the last dof that moves that."""
OF_BODY, OF_WORLD, OF_BASE, OF_BASE_TWO, OF_LINK = range(5)
"""Axes of rows: given in the joint's axes; the world's; given in those of the surface; one row, along a rod or rope."""


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


def _terms_in(space: Array, n: int, m: int) -> Terms:
    """The views."""
    a = n * n
    b = a + m * n
    c = b + m * m
    d = c + m * m
    return Terms(
        space[:a].reshape((n, n)), space[a:b].reshape((n, m)), space[b:c].reshape((m, m)), space[c:d].reshape((m, m)),
        space[d : d + m], space[d + m : d + 2 * m], space[d + 2 * m : d + 2 * m + n],
    )  # fmt: skip


_WRITTEN, _WHOLE, _TABLE, _SQUARE = array(1, written=True), array(1, COUNT), array(2, COUNT), array(2, written=True)
terms_in = compiled(_terms_in, signature(record(Terms, *[_SQUARE] * 4, *[_WRITTEN] * 3), _WRITTEN, COUNT, COUNT))


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
def _motion(X: Array, twist: Array, rate: Array, fall: Array, r: Array, out: Array) -> None:
    """Write v and w of a body at its point r, the acceleration there and w', in its axes: rows of `out`."""
    v, w, a = out[0], out[1], out[2]
    for k in range(3):
        w[k], out[3, k] = twist[3 + k], rate[3 + k]
    v[0] = twist[0] + w[1] * r[2] - w[2] * r[1]
    v[1] = twist[1] + w[2] * r[0] - w[0] * r[2]
    v[2] = twist[2] + w[0] * r[1] - w[1] * r[0]
    for k in range(3):
        a[k] = rate[k] + (X[3 * k] * fall[0] + X[3 * k + 1] * fall[1] + X[3 * k + 2] * fall[2])
    a[0] = a[0] + rate[4] * r[2] - rate[5] * r[1] + w[1] * v[2] - w[2] * v[1]
    a[1] = a[1] + rate[5] * r[0] - rate[3] * r[2] + w[2] * v[0] - w[0] * v[2]
    a[2] = a[2] + rate[3] * r[1] - rate[4] * r[0] + w[0] * v[1] - w[1] * v[0]


@compiled
def _ground_motion(given: Array, Y: Array, p: Array, out: Array) -> None:
    """The same of ground at a point of the world, in the world's axes: of its motion, and of the point where that is given.

    That is in the world; or, where that is NaN, on the body with the pose Y.
    """
    r, u, s = np.zeros(3), given[:6], given[6:12]
    for k in range(3):
        r[k] = p[k] - given[12 + k]
        if math.isnan(given[12 + k]):
            r[k] = p[k] - Y[9 + k] - Y[k] * given[15] - Y[3 + k] * given[16] - Y[6 + k] * given[17]
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        out[0, k] = u[k] + u[3 + i] * r[j] - u[3 + j] * r[i]
        out[1, k], out[3, k] = u[3 + k], s[3 + k]
        out[2, k] = s[k] + s[3 + i] * r[j] - s[3 + j] * r[i]
        for n in range(3):
            out[2, k] += u[3 + k] * u[3 + n] * r[n] - u[3 + n] * u[3 + n] * r[k]


@compiled
def _take_away(R: Array, surface: Array, motion: Array) -> None:
    """Motion relative to a surface, of that of a body and of the surface at one point; R of the surface's axes in the body's.

    v - u,   w - W,   a - s - 2 W x (v - u),   w' - W' - W x (w - W)
    """
    u = np.empty((4, 3))
    for n in range(4):
        for k in range(3):
            u[n, k] = R[k, 0] * surface[n, 0] + R[k, 1] * surface[n, 1] + R[k, 2] * surface[n, 2]
    for n in range(2):
        for k in range(3):
            motion[n, k] -= u[n, k]
    for n in range(2):
        for k in range(3):
            i, j = (k + 1) % 3, (k + 2) % 3
            motion[2 + n, k] -= u[2 + n, k] + (2.0 - n) * (u[1, i] * motion[n, j] - u[1, j] * motion[n, i])


@compiled
def _jacobian(
    J: Array, i: int, parent: Array, axes: Array, p: Array, at: int, size: int, slides: int, sign: float, W: Array
) -> None:
    """Add the columns of J^T of the dofs from i on that move a point of the world, in the rows' directions.

    Args:
        J: Pinocchio's world Jacobian.
        i: The last of these dofs.
        parent: Of each dof.
        axes: The rows' directions, and those of turning, as columns.
        p: The point.
        at: The first row.
        size: How many.
        slides: How many of these are directions of a point; the others are of turning.
        sign: Of what is added.
        W: Written.
    """
    while i >= 0:
        wx, wy, wz = J[3, i], J[4, i], J[5, i]
        vx, vy, vz = J[0, i] + wy * p[2] - wz * p[1], J[1, i] + wz * p[0] - wx * p[2], J[2, i] + wx * p[1] - wy * p[0]
        for j in range(3):
            if j < min(size, slides):
                W[i, at + j] += sign * (axes[0, j] * vx + axes[1, j] * vy + axes[2, j] * vz)
            if j < size - slides:
                W[i, at + slides + j] += sign * (axes[0, 3 + j] * wx + axes[1, 3 + j] * wy + axes[2, 3 + j] * wz)
        i = parent[i]


@compiled
def loop_turn(R: Array, axes: Array, w: Array, E: Array, extra: Array, error: Array) -> None:
    """Write error, E and extra with error' = E w and error'' = E w' + extra: of R_ab, turning with w, in axes of frame_a.

    As of `rbd.constraints.loop.LoopClosure`: of a hinge about the last of `axes`, two rows; of a weld, where these are zero; of
    a cross, where the middle one is zero: one row, of the last and the first, which is the pin of frame_b in its axes.
    NaN where a weld is turned by 90 degrees or more.
    """
    if axes[2, 2] == 0.0 and axes[0, 2] == 0.0 and axes[1, 2] == 0.0:
        trace = R[0, 0] + R[1, 1] + R[2, 2]
        s = 0.5 * math.sqrt(1.0 + trace) if trace > 1.0 else math.nan
        square = w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
        for k in range(3):
            i, j = (k + 1) % 3, (k + 2) % 3
            x = (R[j, i] - R[i, j]) / (4.0 * s)
            error[k], extra[k], E[k, k], E[i, j], E[j, i] = 2.0 * x, -0.5 * square * x, s, x, -x
        return
    if axes[0, 1] == 0.0 and axes[1, 1] == 0.0 and axes[2, 1] == 0.0:
        c = R @ axes[:, 0].copy()
        along, square = w @ c, w @ w
        error[0] = extra[0] = 0.0
        for k in range(3):
            i, j = (k + 1) % 3, (k + 2) % 3
            error[0] += axes[k, 2] * c[k]
            E[0, k] = c[i] * axes[j, 2] - c[j] * axes[i, 2]
            extra[0] += axes[k, 2] * (along * w[k] - square * c[k])
        return
    u, y, dz, ddz, turned = axes[:, 2].copy(), np.empty(3), np.empty(3), np.empty(3), np.empty((2, 3))
    z = R @ u
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        y[k], dz[k] = u[i] * z[j] - u[j] * z[i], w[i] * z[j] - w[j] * z[i]
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        ddz[k] = w[i] * dz[j] - w[j] * dz[i]
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        turned[0, k], turned[1, k] = u[i] * dz[j] - u[j] * dz[i], u[i] * ddz[j] - u[j] * ddz[i]
    s, ds, dds = u @ z, u @ dz, u @ ddz
    k0 = math.sqrt(2.0 / (1.0 + s))
    k1, k2 = -0.5 * k0 / (1.0 + s), 0.75 * k0 / (1.0 + s) ** 2  # its derivatives by s
    for r in range(2):
        t = axes[:, r].copy()
        along, across = t @ z, t @ y
        error[r] = k0 * across
        extra[r] = (k2 * ds * ds + k1 * dds) * across + 2.0 * k1 * ds * (t @ turned[0]) + k0 * (t @ turned[1])
        for k in range(3):
            E[r, k] = k0 * (s * t[k] - along * u[k]) - k1 * across * y[k]


@compiled
def along_link(end: Array, X: Array, p: Array, d: Array) -> float:
    """Write the direction of a rod in the world, to its end p there from the one at `end` of the pose X; its length.

    NaN where the ends coincide.
    """
    square = 0.0
    for k in range(3):
        d[k] = p[k] - (X[9 + k] + X[k] * end[0] + X[3 + k] * end[1] + X[6 + k] * end[2])
        square += d[k] * d[k]
    far = math.sqrt(square)
    for k in range(3):
        d[k] = d[k] / far if far > SHORTEST else math.nan
    return far


@compiled
def body_rows(
    site: Array, place: Array, X: Array, twists: Array, rates: Array, fall: Array, J: Array, parent: Array, terms: Terms
) -> None:
    """J^T, J_dot v and J v of a site's rows, into W, `free` and `velocity`.

    Args:
        site: Its integers.
        place: Its pose in the joint's axes: R by rows, then p; then as `Site.motion` and `Site.turn`.
        X: Poses of the joints: R by columns, then p.
        twists: Their velocities in their axes.
        rates: Their spatial accelerations at a = 0, less gravity.
        fall: Gravity, world axes.
        J: Pinocchio's world Jacobian.
        parent: Of each dof.
        terms: Written.
    """
    at, size, base, r, Y = site[ROW], site[SIZE], site[BASE], place[9:12], X[site[JOINT]]
    axes, own, motion, p, turn = np.empty((3, 6)), np.empty((3, 6)), np.empty((4, 3)), np.empty(3), np.empty((3, 3))
    Z = X[max(base, 0)]
    for k in range(3):
        p[k] = Y[9 + k] + Y[k] * r[0] + Y[3 + k] * r[1] + Y[6 + k] * r[2]
        for j in range(3):  # the surface's axes in the body's
            turn[k, j] = Y[3 * k] * Z[3 * j] + Y[3 * k + 1] * Z[3 * j + 1] + Y[3 * k + 2] * Z[3 * j + 2]
    for k in range(3):  # columns of `axes` are the rows' directions in the world, those of `own` in the joint's axes
        for j in range(3):
            own[k, j] = Y[3 * k + j] if site[AXES] == OF_WORLD else place[3 * k + j]
            if site[AXES] >= OF_BASE:
                own[k, j] = turn[k, 0] * place[j] + turn[k, 1] * place[3 + j] + turn[k, 2] * place[6 + j]
            own[k, 3 + j] = own[k, j]
    extra, d, far = np.zeros(3), np.empty(3), 1.0
    if site[AXES] == OF_LINK:
        far = along_link(place[30:33], Z, p, d)
        for k in range(3):
            own[k, 0] = place[34] * (Y[3 * k] * d[0] + Y[3 * k + 1] * d[1] + Y[3 * k + 2] * d[2])
    _motion(Y, twists[site[JOINT]], rates[site[JOINT]], fall, r, motion)
    if base >= 0:
        surface = np.empty((4, 3))
        if base > 0:
            for k in range(3):
                d[k] = Z[3 * k] * (p[0] - Z[9]) + Z[3 * k + 1] * (p[1] - Z[10]) + Z[3 * k + 2] * (p[2] - Z[11])
            _motion(Z, twists[base], rates[base], fall, d, surface)
        else:
            _ground_motion(place[12:], Y, p, surface)
        _take_away(turn, surface, motion)
    slides = 2 if site[AXES] == OF_BASE_TWO else 3
    if size > slides and site[AXES] >= OF_BASE:
        R, E, spin, error = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(3), np.zeros(3)
        for k in range(3):
            for j in range(3):
                spin[k] += own[j, k] * motion[1, j]
                for c in range(3):
                    R[k, j] += own[c, k] * place[30 + 3 * c + j]
        loop_turn(R, place[39:48].reshape((3, 3)), spin, E, extra, error)
        for k in range(3):
            for j in range(3):
                own[k, 3 + j] = own[k, 0] * E[j, 0] + own[k, 1] * E[j, 1] + own[k, 2] * E[j, 2]
    for k in range(3):
        for j in range(6):
            if site[AXES] == OF_WORLD:
                axes[k, j] = 1.0 if k == j % 3 else 0.0
            else:
                axes[k, j] = Y[k] * own[0, j] + Y[3 + k] * own[1, j] + Y[6 + k] * own[2, j]
    _jacobian(J, site[LAST], parent, axes, p, at, size, slides, 1.0, terms.W)
    if base >= 0:
        _jacobian(J, site[BASE_LAST], parent, axes, p, at, size, slides, -1.0, terms.W)
    v, w, a, dw = motion[0], motion[1], motion[2], motion[3]
    for j in range(3):
        if j < min(size, slides):
            terms.velocity[at + j] = own[0, j] * v[0] + own[1, j] * v[1] + own[2, j] * v[2]
            terms.free[at + j] = own[0, j] * a[0] + own[1, j] * a[1] + own[2, j] * a[2]
        if j < size - slides:
            r = at + slides + j
            terms.velocity[r] = own[0, 3 + j] * w[0] + own[1, 3 + j] * w[1] + own[2, 3 + j] * w[2]
            terms.free[r] = own[0, 3 + j] * dw[0] + own[1, 3 + j] * dw[1] + own[2, 3 + j] * dw[2] + extra[j]
    if site[AXES] == OF_LINK:  # its direction turns
        square = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
        terms.free[at] += place[34] * (square - terms.velocity[at] * terms.velocity[at]) / far


@compiled
def _divided(L: Array, parent: Array, W: Array, at: int, size: int) -> None:
    """L^-T W of some columns, in place."""
    for i in range(len(parent) - 1, -1, -1):
        moves = False
        for r in range(at, at + size):
            moves = moves or W[i, r] != 0.0
        if not moves:
            continue
        inverse = 1.0 / L[i, i]
        for r in range(at, at + size):
            W[i, r] *= inverse
        p = parent[i]
        while p >= 0:
            x = L[i, p]
            for r in range(at, at + size):
                W[p, r] -= x * W[i, r]
            p = parent[p]


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
        if e + 1 == len(units) or units[e + 1, 0] != units[e, 0]:
            _divided(L, parent, W, units[e, 0], 1)


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
        body_rows(sites[k], places[k], X, twists, rates, fall, J, parent, terms)
        _divided(L, parent, W, sites[k, ROW], sites[k, SIZE])
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
    for k in range(len(sites)):
        _forget_immovable(sites[k], X[sites[k, JOINT]], J, parent, L, A)


@compiled
def _forget_immovable(site: Array, X: Array, J: Array, parent: Array, L: Array, A: Array) -> None:
    """Zeros in the mobility of a site's rows that nothing moves, as across the plane of a planar mechanism: it has rounding."""
    p, scale = X[9] * X[9] + X[10] * X[10] + X[11] * X[11], np.zeros(2)
    for i in (site[LAST], site[BASE_LAST]):
        while i >= 0:
            w = (J[3, i] * J[3, i] + J[4, i] * J[4, i] + J[5, i] * J[5, i]) / (L[i, i] * L[i, i])
            v = (J[0, i] * J[0, i] + J[1, i] * J[1, i] + J[2, i] * J[2, i]) / (L[i, i] * L[i, i])
            scale[0], scale[1] = scale[0] + v + p * w, scale[1] + w
            i = parent[i]
    for j in range(site[SIZE]):
        r = site[ROW] + j
        if A[r, r] <= IMMOVABLE * scale[int(j >= 3)]:
            A[r, :], A[:, r] = 0.0, 0.0


def _row_terms(
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
        sites: Integers, shape (k, 7).
        places: As of `body_rows`, shape (k, 48).
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


TERM_TYPES = (
    array(2, layout="A"), array(2, layout="A"), array(1), array(2), array(2), array(2), _WHOLE,
    _TABLE, array(2), _TABLE, array(1), array(1), array(1), array(1), _WRITTEN,
)  # fmt: skip
"""The arguments of `row_terms` but the last two."""
row_terms = compiled(_row_terms, signature(FLAG, *TERM_TYPES, _WRITTEN, _WRITTEN))


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
def row_forces(terms: Terms, s: Array, scale: float, f: Array) -> None:
    """Add (J M^-1 J^T)^-1 s times a scale to f, by the factors of `holding_forces`; s becomes what is added."""
    for r in range(len(f)):
        s[r] *= scale
    _rows_solved(terms.C, s)
    for r in range(len(f)):
        f[r] += s[r]
