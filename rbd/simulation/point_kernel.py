"""Compiled arithmetic on stacked points: forces of least norm, and points that slide throughout a step or stop within it."""

from __future__ import annotations

import math

import numpy as np

from rbd.arrays import Array
from rbd.constraints.contact_points import SLIDES
from rbd.kernels import COUNT, FLAG, array, compiled, signature
from rbd.solvers.conic_kernel import DUAL_STEPS, by_dual, most_of, projected
from rbd.solvers.small_systems import add_transposed, pivoted_factor, pivoted_solve

_REPEATS, _ROUNDS, _SAME = 1e-11, 3, 1e-12
"""Pivots up to this are of linearly dependent columns; rounds of refinement; tolerance of forces, over their size."""
_SAME_WAY, _STILL = 1e-9, 1e-9
"""Angle between directions that are the same [rad]; speed of points at rest [m/s, rad/s]."""


def _spanned(G: Array, count: int, g: Array, y: Array, z: Array, order: Array) -> int:
    """Write the shortest y with G^T y = g, y = G z, and G's columns, independent ones first: their number, -1 if y is inexact.

    Args:
        G: Shape (count or more, n).
        count: How many of its rows are taken.
        g: Shape (n,).
        y: Written, shape (count or more,).
        z: Written, shape (n,).
        order: Written, shape (n,).
    """
    n, most = len(g), np.abs(g).max()
    S, scale, missed = np.zeros((n, n)), np.zeros(n), np.empty(n)
    for e in range(count):
        for r in range(n):
            if G[e, r] != 0.0:
                for s in range(n):
                    S[r, s] += G[e, r] * G[e, s]
    for r in range(n):
        scale[r] = 1.0 / math.sqrt(S[r, r]) if S[r, r] > 0.0 else 0.0
    for r in range(n):
        for s in range(n):
            S[r, s] *= scale[r] * scale[s]
    rank = pivoted_factor(S, order, _REPEATS)
    z[:] = 0.0
    for _ in range(_ROUNDS + 1):
        missed[:] = g
        for e in range(count):
            y[e] = 0.0
            for r in range(n):
                y[e] += G[e, r] * z[r]
            for r in range(n):
                missed[r] -= G[e, r] * y[e]
        if np.abs(missed).max() <= _SAME * most:
            return rank
        missed *= scale
        pivoted_solve(S, order, rank, missed)
        for r in range(n):
            z[r] += scale[r] * missed[r]
    return -1


_WRITTEN, _WHOLE, _FLAGS, _ROWS = array(1, written=True), array(1, COUNT), array(1, FLAG), array(1, layout="A")
spanned = compiled(_spanned, signature(COUNT, array(2), COUNT, array(1), _WRITTEN, _WRITTEN, array(1, COUNT, written=True)))


def _shortest(
    J: Array, widths: Array, normals: Array, pushes: Array, rubs: Array, slides: Array, mu: Array,
    active: Array, velocity: Array, force: Array, coulomb: bool, out: Array,
) -> bool:  # fmt: skip
    """`rbd.simulation.recording.least_forces` where points push, rub, or are held; False: not found.

    Without the edges of cones it is a linear system; else Newton's method on the dual.

    Args:
        J: Rows by which forces act, shape (p, n): their Jacobian, or what has the same J^T f = 0.
        widths: As of `PointLayout`, as are the next five.
        normals: As there.
        pushes: As there.
        rubs: As there.
        slides: As there.
        mu: As there.
        active: Which points are active.
        velocity: Velocities of the rows.
        force: Forces of the rows, which obey the law.
        coulomb: Coulomb's law; else the convex one.
        out: Written: the shortest forces with the same J^T f.
    """
    p, n = J.shape
    G, edge, at, ray = np.zeros((p, n)), np.zeros((p, 3)), np.empty(p, np.int64), np.zeros(p, np.bool_)
    lower, cones, slopes, holding = np.full(p, -math.inf), np.empty((p, 3), np.int64), np.empty(p), 0
    g, y, z, order, count = np.zeros(n), np.empty(p), np.empty(n), np.empty(n, np.int64), 0
    add_transposed(J, force, g)
    for i in range(len(active)):
        if not active[i]:
            continue
        j, speed = normals[i], 0.0
        if slides[i]:
            speed = np.hypot(velocity[j - 2], velocity[j - 1]) if rubs[i] else abs(velocity[j])
        if pushes[i] and velocity[j] > SLIDES + (0.0 if coulomb else mu[i] * speed):
            continue
        if speed > SLIDES:
            if not rubs[i]:
                return False  # a bound determines the force of dry friction
            x, along, size = edge[count], np.hypot(force[j - 2], force[j - 1]), 1.0 / math.sqrt(1.0 + mu[i] * mu[i])
            for e in range(2):
                x[e] = mu[i] * size * (force[j - 2 + e] / along if along > 0.0 else -velocity[j - 2 + e] / speed)
            x[2], at[count], ray[count], lower[count] = size, j, True, 0.0
            for r in range(n):
                G[count, r] = x[0] * J[j - 2, r] + x[1] * J[j - 1, r] + x[2] * J[j, r]
            count += 1
            continue
        for row in range(j + 1 - widths[i], j + 1):
            G[count], at[count] = J[row], row
            count += 1
        if rubs[i]:
            cones[holding], slopes[holding] = (count - 3, count - 2, count - 1), mu[i]
            holding += 1
        elif pushes[i]:
            lower[count - 1] = 0.0
    rank = spanned(G, count, g, y, z, order)
    if rank < 0:
        return False
    x, single, V, lower, upper = (
        np.empty(count),
        np.empty(count),
        np.zeros((holding, 3, 3)),
        lower[:count],
        np.full(count, math.inf),
    )
    y, cones, slopes = y[:count], cones[:holding], slopes[:holding]
    most = most_of(y)
    projected(y, lower, upper, cones, slopes, x, single, V)
    if most_of(x - y) > _SAME * max(most, 1.0):
        A, b, scaled = np.empty((rank, count)), np.empty(rank), np.empty(rank)
        for r in range(rank):
            column = np.ascontiguousarray(G[:count, order[r]])
            size = most_of(column)
            A[r], b[r], scaled[r] = column / size, g[order[r]] / (size * most), z[order[r]] * size / most
        if by_dual(A, b, np.ones(count), np.zeros(count), lower, upper, cones, slopes, DUAL_STEPS, x, scaled) < 0:
            return False
        y[:], missed = most * x, g.copy()
        add_transposed(G[:count], -y, missed)
        if most_of(missed) > _SAME * count * most_of(g):
            return False
    out[:] = 0.0
    for e in range(count):
        if ray[e]:
            for r in range(3):
                out[at[e] - 2 + r] = y[e] * edge[e, r]
        else:
            out[at[e]] = y[e]
    return True


shortest = compiled(
    _shortest,
    signature(
        FLAG, array(2), _WHOLE, _WHOLE, _FLAGS, _FLAGS, _FLAGS, array(1), _FLAGS, _ROWS, _ROWS, FLAG, _WRITTEN
    ),
)  # fmt: skip


def _turned_back(
    normals: Array, rubs: Array, active: Array, u: Array, change: Array, pushed: Array, out: Array
) -> bool:  # fmt: skip
    """Write `stacked_points.turned_back`; whether some point slides throughout."""
    found = False
    out[:] = 0.0
    for i in range(len(active)):
        n = normals[i]
        if rubs[i] and active[i] and pushed[n] > 0.0:
            speed = np.hypot(u[n - 2], u[n - 1])
            if speed > SLIDES and speed > 4.0 * np.hypot(change[n - 2], change[n - 1]):
                out[n - 2], out[n - 1], found = -change[n - 2], -change[n - 1], True
    return found


turned_back = compiled(_turned_back, signature(FLAG, _WHOLE, _FLAGS, _FLAGS, _ROWS, _ROWS, _ROWS, _WRITTEN))


def _stopping(
    normals: Array, rubs: Array, slides: Array, u: Array, end: Array, pushed: Array, out: Array
) -> bool:  # fmt: skip
    """Write `stacked_points.stopping`, for each of those that can slide; whether some point does."""
    found, s = False, 0
    for i in range(len(slides)):
        if not slides[i]:
            continue
        n = normals[i]
        x, y, p, q = u[n], 0.0, end[n], 0.0
        if rubs[i]:
            x, y, p, q = u[n - 2], u[n - 1], end[n - 2], end[n - 1]
        turns = np.hypot(p, q) <= SLIDES or x * p + y * q < 0.0
        out[s] = pushed[n] != 0.0 and turns and np.hypot(x, y) > 10.0 * SLIDES
        found, s = found or out[s], s + 1
    return found


stopping = compiled(_stopping, signature(FLAG, _WHOLE, _FLAGS, _FLAGS, _ROWS, _ROWS, _ROWS, array(1, FLAG, written=True)))


def _directed(
    normals: Array, pushes: Array, rubs: Array, slides: Array, velocity: Array, u: Array, end: Array, pushed: Array, out: Array
) -> bool:  # fmt: skip
    """Write `stacked_points.directed`; whether the forces of the half step are others."""
    found = False
    out[:] = u
    for i in range(len(slides)):
        n = normals[i]
        if pushed[n] == 0.0 or not (pushes[i] or slides[i]):
            continue
        if pushes[i]:
            found, out[n] = found or abs(u[n]) > _STILL, 0.0
        if not slides[i]:
            continue
        first, last = (n - 2, n - 1) if rubs[i] else (n, n)  # an interval has one row
        x, p, a = u[first], end[first], velocity[first]
        y, q, b = (u[last], end[last], velocity[last]) if rubs[i] else (0.0, 0.0, 0.0)
        speed, after, size = np.hypot(x, y), np.hypot(p, q), np.hypot(a, b)
        if speed <= 10.0 * SLIDES:
            found, out[first], out[last] = found or speed > _STILL, 0.0, 0.0
            continue
        if size <= SLIDES:
            a, b, size = x, y, speed
        out[last] = b / size
        out[first] = a / size
        off = max(abs(a * y - b * x) / speed, abs(a * q - b * p) / after if after > SLIDES else size)
        found = found or off > _SAME_WAY * size or a * x + b * y < 0.0 or a * p + b * q < 0.0
    return found


directed = compiled(_directed, signature(FLAG, _WHOLE, *[_FLAGS] * 3, *[_ROWS] * 4, _WRITTEN))


def _sliding(
    normals: Array, rubs: Array, slides: Array, velocity: Array, closed: Array, closed_before: Array, before: Array, out: Array
) -> bool:  # fmt: skip
    """Write which closed points slide; whether they, or those that are closed, are others than before."""
    changed = False
    for i in range(len(slides)):
        n, speed = normals[i], 0.0
        if slides[i]:
            speed = np.hypot(velocity[n - 2], velocity[n - 1]) if rubs[i] else abs(velocity[n])
        out[i] = closed[i] and speed > SLIDES
        changed = changed or out[i] != before[i] or closed[i] != closed_before[i]
    return changed


sliding = compiled(
    _sliding, signature(FLAG, _WHOLE, _FLAGS, _FLAGS, _ROWS, _FLAGS, _FLAGS, _FLAGS, array(1, FLAG, written=True))
)
