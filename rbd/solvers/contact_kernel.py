"""Compiled arithmetic of `rbd.solvers.contact_newton`.

It is the code of `rbd.solvers.newton` in loops over few numbers. A point touches one body only: `columns` (3 k, d) holds the
entries of each column of P that may differ from zero, and `first` (k,) the row in which those of a point begin.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from rbd.arrays import Array
from rbd.kernels import COUNT, FLAG, NUMBER, array, compiled, signature
from rbd.solvers.contact_families import MOBILITY, ScaledBodies, eliminate, inverse, leaves_motion_open, scale

_SMALL = 1e-200
_MOST_STEPS = 50
_FOUND = 1e-10
"""Merit of an answer."""
_EXACT = 1e-14
"""Newton stops at this merit."""
_ROUGH, _CLOSE = 1e-4, 1e-4
"""Merits at which further points are looked for, and below which not before this merit is `_EXACT`."""
_NEARLY = 1e-12
"""Merit at which no further points are taken into account."""
_GROWS, _EARLY = 4.0, 6
"""The first steps, in which points change between open, sticking and slipping, may make the sum of squares grow so much."""
OPEN, STICKS, SLIPS = 0.0, 1.0, 2.0
UNKNOWN, STICK, MOVE = 0, 1, 2


class Compliance(NamedTuple):
    """y = Q' (D Q w + c) + soft (w - about); `proximal` is added in Newton's matrix only."""

    soft: Array
    about: Array
    proximal: float


class Room(NamedTuple):
    """Working arrays: (3 k,), (nw,), the modes (k, 4) of the points (mode, factor, direction) and a matrix (nw, nw)."""

    p: Array
    gap: Array
    move: Array
    new: Array
    best: Array
    f: Array
    a: Array
    z: Array
    modes: Array
    A: Array


@compiled
def project(x: float, y: float, z: float, mu: float, coulomb: bool) -> tuple[float, float, float]:
    """(normal weight, factor of the tangential ones, their length) of the weights in a cone that a position maps to."""
    t = math.sqrt(x * x + y * y)
    if coulomb:
        normal = max(z, 0.0)
    elif t <= mu * z:
        normal = z
    else:
        normal = max((mu * t + z) / (1.0 + mu * mu), 0.0)
    t = max(t, _SMALL)
    return normal, min(mu * normal / t, 1.0), t


@compiled
def evaluate(
    bodies: ScaledBodies, points: Array, w: Array, compliance: Compliance, coulomb: bool, room: Room
) -> tuple[float, float]:
    """(largest entry, sum of squares) of gap = P(p) - w at p = w - y."""
    columns, c, f, a, p, gap, modes = bodies.columns, bodies.c, room.f, room.a, room.p, room.gap, room.modes
    nw, d = len(c), columns.shape[1]
    for r in range(nw):
        f[r] = 0.0
    for i in points:
        at = bodies.first[i]
        for j in range(3 * i, 3 * i + 3):
            if w[j] != 0.0:
                for r in range(d):
                    f[at + r] += columns[j, r] * w[j]
    for r in range(nw):
        total = c[r]
        for s in range(nw):
            total += bodies.D[r, s] * f[s]
        a[r] = total
    top, square = 0.0, 0.0
    for i in points:
        at, j = bodies.first[i], 3 * i
        for e in range(j, j + 3):
            y = compliance.soft[i] * (w[e] - compliance.about[e])
            for r in range(d):
                y += columns[e, r] * a[at + r]
            p[e] = w[e] - y
        normal, factor, t = project(p[j], p[j + 1], p[j + 2], bodies.mu[i], coulomb)
        if normal > 0.0:
            modes[i, 0] = SLIPS if factor < 1.0 else STICKS
        else:
            modes[i, 0] = OPEN
        modes[i, 1], modes[i, 2], modes[i, 3] = factor, p[j] / t, p[j + 1] / t
        gap[j], gap[j + 1], gap[j + 2] = factor * p[j] - w[j], factor * p[j + 1] - w[j + 1], normal - w[j + 2]
        for e in range(j, j + 3):
            top = max(top, abs(gap[e]))
            square += gap[e] * gap[e]
    return (top, square) if square < math.inf else (math.inf, math.inf)  # NaN is infinite


@compiled
def newton_step(bodies: ScaledBodies, points: Array, compliance: Compliance, coulomb: bool, room: Room) -> bool:
    """Newton's step in `room.move`, by a linear system of the bodies' rows; False where that is singular.

    (I - V + V (Q' D Q + k)) dw = gap, with V the slope of the projection. With B = I - (1 - k) V, M = B^-1 V and
    h = B^-1 gap, point by point: dw = h - M Q' z, where (L + Q M Q') z = Q h.
    """
    columns, gap, modes, move, A, z = bodies.columns, room.gap, room.modes, room.move, room.A, room.z
    nw, d = len(z), columns.shape[1]
    for r in range(nw):
        z[r] = 0.0
        for s in range(nw):
            A[r, s] = bodies.L[r, s]
    for i in points:
        at, j, mode, factor, ex, ey = bodies.first[i], 3 * i, modes[i, 0], modes[i, 1], modes[i, 2], modes[i, 3]
        g0, g1, g2 = gap[j], gap[j + 1], gap[j + 2]
        k = compliance.proximal + compliance.soft[i]
        if mode == STICKS:
            g0, g1, g2 = g0 / k, g1 / k, g2 / k
            for r in range(d):
                x0, x1, x2 = columns[j, r] / k, columns[j + 1, r] / k, columns[j + 2, r] / k
                for s in range(d):
                    A[at + r, at + s] += x0 * columns[j, s] + x1 * columns[j + 1, s] + x2 * columns[j + 2, s]
        elif mode == SLIPS:
            u, along, turned = bodies.mu[i], ex * g0 + ey * g1, factor / (1.0 - (1.0 - k) * factor)
            side = (ex * g1 - ey * g0) / (1.0 - (1.0 - k) * factor)
            share, push = 1.0, g2  # V is (u e + n) share (n or u e + n)' + factor side side'
            if not coulomb:
                share = 1.0 / (1.0 + u * u)
                push = share * (u * along + g2)
            along, g2 = along + u * push * (1.0 - k) / k, g2 + push * (1.0 - k) / k
            g0, g1 = ex * along - ey * side, ey * along + ex * side
            for r in range(d):
                x0, x1, x2 = columns[j, r], columns[j + 1, r], columns[j + 2, r]
                edge, turn = share * (u * (ex * x0 + ey * x1) + x2) / k, turned * (ex * x1 - ey * x0)
                for s in range(d):
                    felt = columns[j + 2, s]
                    if not coulomb:
                        felt += u * (ex * columns[j, s] + ey * columns[j + 1, s])
                    A[at + r, at + s] += edge * felt + turn * (ex * columns[j + 1, s] - ey * columns[j, s])
        move[j], move[j + 1], move[j + 2] = g0, g1, g2
        for e in range(j, j + 3):
            if move[e] != 0.0:
                for r in range(d):
                    z[at + r] += columns[e, r] * move[e]
    if not eliminate(A, z, nw):
        return False
    square = 0.0
    for i in points:
        at, j, mode, factor, ex, ey = bodies.first[i], 3 * i, modes[i, 0], modes[i, 1], modes[i, 2], modes[i, 3]
        if mode != OPEN:
            y0, y1, y2 = 0.0, 0.0, 0.0
            for r in range(d):
                y0 += columns[j, r] * z[at + r]
                y1 += columns[j + 1, r] * z[at + r]
                y2 += columns[j + 2, r] * z[at + r]
            k = compliance.proximal + compliance.soft[i]
            if mode == STICKS:
                y0, y1, y2 = y0 / k, y1 / k, y2 / k
            else:
                u, side = bodies.mu[i], factor / (1.0 - (1.0 - k) * factor) * (ex * y1 - ey * y0)
                if not coulomb:
                    y2 = (y2 + u * (ex * y0 + ey * y1)) / (1.0 + u * u)
                y2 /= k
                y0, y1 = ex * u * y2 - ey * side, ey * u * y2 + ex * side
            move[j] -= y0
            move[j + 1] -= y1
            move[j + 2] -= y2
        square += move[j] * move[j] + move[j + 1] * move[j + 1] + move[j + 2] * move[j + 2]
    return math.isfinite(square)


@compiled
def steps_from(
    bodies: ScaledBodies, points: Array, w: Array, compliance: Compliance, coulomb: bool, exact: float, room: Room
) -> tuple[float, int]:
    """Damped semismooth Newton steps from w, which becomes the best weights found: (merit, steps)."""
    new, best, move = room.new, room.best, room.move
    merit, square = evaluate(bodies, points, w, compliance, coulomb, room)
    least, step = merit, 0
    for j in range(len(w)):
        best[j] = w[j]
    while step < _MOST_STEPS and least > exact and square < math.inf:
        if not newton_step(bodies, points, compliance, coulomb, room):
            break
        before, t = square, 1.0
        for _ in range(7):
            for i in points:
                for j in range(3 * i, 3 * i + 3):
                    new[j] = w[j] + t * move[j]
            merit, square = evaluate(bodies, points, new, compliance, coulomb, room)
            if square <= before * (_GROWS if step < _EARLY else 1.0 - 1e-4 * t):
                break
            t *= 0.5
        for i in points:
            for j in range(3 * i, 3 * i + 3):
                w[j] = new[j]
        step += 1
        if merit < least:
            least = merit
            for i in points:
                for j in range(3 * i, 3 * i + 3):
                    best[j] = w[j]
        if before < 1e-22 and square > 0.1 * before:  # rounding
            break
    for j in range(len(w)):
        w[j] = best[j]
    return least, step


def _body_forces(
    D: Array, c: Array, start: Array, coulomb: bool,
    P: Array, first: Array, mu: Array, seeds: Array, memory: Array, points: Array, out: Array,
) -> tuple[float, int, bool]:  # fmt: skip
    """`ContactNewton.forces`: (merit, steps, whether a family of motions was met); weights and wrench in `out`.

    Args:
        D: As there.
        c: As there.
        start: Weights of the `seeds`.
        coulomb: As there.
        P: Entries of its columns, shape (3 k, d).
        first: Their first rows, shape (k,).
        mu: Frictions.
        seeds: The points with which the search begins.
        memory: Working memory, as `ContactNewton` makes it.
        points: Working memory, shape (2, k).
        out: Weights, then the wrench.
    """
    n, d, nw, k = P.shape[0], P.shape[1], len(c), len(mu)
    m, s = memory[: 9 * n].reshape(9, n), memory[9 * n : 9 * n + 4 * nw].reshape(4, nw)
    at = 9 * n + 4 * nw
    squares = memory[at : at + 2 * nw * nw].reshape(2, nw, nw)
    at += 2 * nw * nw
    columns, modes, units = memory[at : at + n * d].reshape(n, d), memory[at + n * d : at + n * d + 4 * k].reshape(k, 4), m[8]
    at += n * d + 4 * k
    w, zero, kept, unit, soft = m[5], m[6], m[7], units[:k], units[k : 2 * k]
    room = Room(m[0], m[1], m[2], m[3], m[4], s[0], s[1], s[2], modes, squares[0])
    bodies = ScaledBodies(D, squares[1], s[3], columns, first, mu)
    for j in range(n + nw):
        out[j] = 0.0
    if not inverse(D, bodies.L, room.A):
        return math.inf, 0, False
    rate = scale(bodies, P, c, unit)
    if not rate < math.inf:
        return math.inf, 0, False
    for j in range(n):
        zero[j] = w[j] = 0.0
    for i in range(k):
        soft[i] = 0.0
        points[0, i] = i
    firm = Compliance(soft, zero, 1e-7)
    count = len(seeds)
    for e in range(count):
        i = points[1, e] = seeds[e]
        j, size = 3 * i, 1.0 / (unit[i] * rate)
        x, y, z = start[3 * e] * size, start[3 * e + 1] * size, start[3 * e + 2] * size
        if math.isfinite(x + y + z):
            w[j], w[j + 1], w[j + 2] = x, y, z
    merit, steps, opened = math.inf, 0, False
    for attempt in range(2):
        if attempt > 0:  # from all contacts open
            for j in range(n):
                w[j] = 0.0
        rough = count < k
        while True:
            merit, more = steps_from(bodies, points[1, :count], w, firm, coulomb, _ROUGH if rough else _EXACT, room)
            steps += more
            if not merit <= (_ROUGH if rough else _FOUND) or count == k:
                break
            merit, _ = evaluate(bodies, points[0], w, firm, coulomb, room)
            if merit <= _NEARLY:
                break
            if rough and merit <= _CLOSE:  # before further points, the last digits of these
                rough = False
                continue
            used, count = count, enlarge(points, count, first, room.gap, room.z)
            if count == used:
                break
            rough = count < k
        if merit <= _FOUND:
            break
    if not merit <= _FOUND:  # many points close to each other: compliant ones first, whose answer is unique
        for j in range(n):
            kept[j] = w[j]
        merit, more = settle(bodies, points[0], w, kept, unit, merit, coulomb, firm, room)
        steps += more
    if coulomb and merit <= _FOUND:
        evaluate(bodies, points[0], w, firm, coulomb, room)
        opened = leaves_motion_open(bodies, w, room.p, memory[at:])
        if opened:
            for j in range(n):
                kept[j] = w[j]
            merit, more = settle(bodies, points[0], w, kept, unit, merit, coulomb, firm, room)
            steps += more
    for i in range(k):
        size, j = unit[i] * rate, 3 * i
        x, y, normal = w[j] * size, w[j + 1] * size, max(w[j + 2] * size, 0.0)
        t = math.sqrt(x * x + y * y)
        factor = mu[i] * normal / t if t > mu[i] * normal else 1.0
        out[j], out[j + 1], out[j + 2] = factor * x, factor * y, normal
        for e in range(j, j + 3):
            for r in range(d):
                out[n + first[i] + r] += P[e, r] * out[e]
    return merit, steps, opened


@compiled
def enlarge(points: Array, count: int, first: Array, gap: Array, worst: Array) -> int:
    """Append to the points in use, `points[1]`, the one of each body that violates the law most: their new number."""
    for r in range(len(worst)):
        worst[r] = 0.0
    for i in range(len(first)):
        worst[first[i]] = max(worst[first[i]], abs(gap[3 * i]), abs(gap[3 * i + 1]), abs(gap[3 * i + 2]))
    for i in range(len(first)):
        size = max(abs(gap[3 * i]), abs(gap[3 * i + 1]), abs(gap[3 * i + 2]))
        used = False
        for e in range(count):
            used = used or points[1, e] == i
        if not used and size > 1e-13 and size == worst[first[i]]:
            points[1, count] = i
            count += 1
            worst[first[i]] = -1.0
    return count


@compiled
def settle(
    bodies: ScaledBodies,
    points: Array,
    w: Array,
    kept: Array,
    unit: Array,
    merit: float,
    coulomb: bool,
    firm: Compliance,
    room: Room,
) -> tuple[float, int]:
    """The limit of the answers of equally compliant points near w: (merit, steps); w stays where it is not reached."""
    most, steps, soft = 0.0, 0, firm.soft
    for i in range(len(soft)):
        most = max(most, unit[i])
    reached, compliance, found = math.inf, 1e-2, False
    while compliance > 1e-5:
        for i in range(len(soft)):
            soft[i] = MOBILITY * compliance * max((unit[i] / most) ** 2, 1e-3)
        reached, more = steps_from(bodies, points, w, Compliance(soft, firm.about, 0.0), coulomb, 1e-8 * compliance, room)
        steps += more
        # A merit m leaves the shares uncertain by m / compliance.
        if not reached <= 1e-5 * compliance:
            break
        found = True
        compliance *= 1e-2
    for i in range(len(soft)):
        soft[i] = 0.0
    if found:
        reached, more = steps_from(bodies, points, w, firm, coulomb, _EXACT, room)
        steps += more
        if reached <= _FOUND:
            return reached, steps
    for j in range(len(w)):
        w[j] = kept[j]
    return merit, steps


body_forces = compiled(
    _body_forces,
    signature(
        (NUMBER, COUNT, FLAG),
        array(2), array(1), array(1), FLAG,
        array(2), array(1, COUNT), array(1), array(1, COUNT), array(1, written=True), array(2, COUNT, written=True),
        array(1, written=True),
    ),
)  # fmt: skip


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
        P: As of `body_forces`, like those after it.
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
    signature(
        COUNT, array(2), array(1, written=True), array(1, written=True), array(1, written=True), array(2), NUMBER,
        array(2), array(1, COUNT), array(1), array(1, COUNT), array(1, written=True), array(2, COUNT, written=True),
    ),
)  # fmt: skip


@compiled
def law_residual(y: Array, w: Array, mu: Array, least: float, coulomb: bool) -> float:
    """`rbd.solvers.contact_newton.law_residual` of the points' accelerations y; `least`: lower bound of a force's scale [N]."""
    worst = 0.0
    for i in range(len(mu)):
        a, b, c, m = w[3 * i], w[3 * i + 1], w[3 * i + 2], mu[i]
        u, v, sinks = y[3 * i], y[3 * i + 1], y[3 * i + 2]
        worst = max(worst, -sinks)
        if not coulomb:
            worst = max(worst, (m * math.hypot(u, v) - max(sinks, 0.0)) / (1.0 + m))
        push = max(math.sqrt(a * a + b * b + c * c), least)
        p, q, n = a - push * u, b - push * v, c - push * sinks
        normal, share, _ = project(p, q, n, m, coulomb)
        far = math.sqrt((share * p - a) ** 2 + (share * q - b) ** 2 + (normal - c) ** 2) / push
        if not far <= math.inf:
            return math.nan
        worst = max(worst, far)
    return worst
