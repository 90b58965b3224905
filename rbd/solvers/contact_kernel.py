"""Compiled arithmetic of `rbd.solvers.contact_newton`: points of bodies, a few at a time; the residual of their law."""

from __future__ import annotations

import math

import numpy as np

from rbd.arrays import Array
from rbd.kernels import COUNT, FLAG, NUMBER, array, compiled, signature
from rbd.solvers.newton_kernel import (
    EXACT,
    FOUND,
    PROXIMAL,
    Compliance,
    Problem,
    damped_steps,
    evaluate,
    limit,
    project,
    room_of,
    settle,
)

MOBILITY = 10.0
"""Of each scaled point of a body, which balances weights and accelerations: fewest steps, of 1 to 30 tried."""
_ROUGH, _CLOSE = 1e-4, 1e-4
"""Merits at which further points are looked for, and below which not before this merit is `EXACT`."""
_NEARLY = 1e-12
"""Merit at which no further points are taken into account."""
_EARLY = 6
"""First steps in which the sum of squares may grow."""


@compiled
def _scale_bodies(problem: Problem, P: Array, c: Array, unit: Array) -> float:
    """Fill columns and c of the scaled problem of bodies, and the points' `unit`: the rate by which c was divided.

    Each point's block of Q' D Q has the largest diagonal `MOBILITY`; Q' c is of order one.
    """
    most, d = 0.0, P.shape[1]
    for i in range(len(unit)):
        at, size = problem.first[i], 0.0
        for j in range(3 * i, 3 * i + 3):
            total = 0.0
            for r in range(d):
                for s in range(d):
                    total += P[j, r] * problem.D[at + r, at + s] * P[j, s]
            size = max(size, total)
        unit[i] = size
        most = max(most, size)
    rate = 0.0
    for i in range(len(unit)):
        unit[i] = math.sqrt(MOBILITY / max(unit[i], 1e-12 * most if most > 0.0 else 1.0))
        for j in range(3 * i, 3 * i + 3):
            total = 0.0
            for r in range(d):
                problem.columns[j, r] = P[j, r] * unit[i]
                total += problem.columns[j, r] * c[problem.first[i] + r]
            rate = max(rate, abs(total))
    rate = rate if rate > 0.0 else 1.0
    for r in range(len(c)):
        problem.c[r] = c[r] / rate
    return rate


@compiled
def _enlarge(chosen: Array, count: int, first: Array, gap: Array, worst: Array) -> int:
    """Append to the points in use the one of each body that violates the law most: their new number."""
    worst[:] = 0.0
    for i in range(len(first)):
        worst[first[i]] = max(worst[first[i]], abs(gap[3 * i]), abs(gap[3 * i + 1]), abs(gap[3 * i + 2]))
    for i in range(len(first)):
        size = max(abs(gap[3 * i]), abs(gap[3 * i + 1]), abs(gap[3 * i + 2]))
        if size > 1e-13 and size == worst[first[i]] and not (chosen[:count] == i).any():
            chosen[count] = i
            count += 1
            worst[first[i]] = -1.0
    return count


def _body_forces(
    D: Array, c: Array, start: Array, coulomb: bool, P: Array, first: Array, mu: Array, seeds: Array, out: Array
) -> tuple[float, int, bool]:
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
        out: Weights, then the wrench.
    """
    n, nw, k = len(P), len(c), len(mu)
    none, unit, everything, chosen = np.empty(0), np.empty(k), np.arange(k), np.empty(k, np.int64)
    problem = Problem(D, np.empty(nw), np.empty(P.shape), first, none, none, mu)
    for j in range(n + nw):
        out[j] = 0.0
    rate = _scale_bodies(problem, P, c, unit)
    if not (rate < math.inf and math.isfinite(D.sum())):
        return math.inf, 0, False
    w, room, firm, count = np.zeros(n), room_of(problem), Compliance(np.zeros(k), np.zeros(n), PROXIMAL, _EARLY), len(seeds)
    for e in range(count):
        i = chosen[e] = seeds[e]
        j, size = 3 * i, 1.0 / (unit[i] * rate)
        x, y, z = start[3 * e] * size, start[3 * e + 1] * size, start[3 * e + 2] * size
        if math.isfinite(x + y + z):
            w[j], w[j + 1], w[j + 2] = x, y, z
    merit, steps, opened = math.inf, 0, False
    for attempt in range(2):
        if attempt > 0:  # from all contacts open
            w[:] = 0.0
        rough = count < k
        while True:
            enough = _ROUGH if rough else FOUND
            merit, more = damped_steps(problem, chosen[:count], w, firm, coulomb, 50, _ROUGH if rough else EXACT, room)
            steps += more
            if not merit <= enough or count == k:
                break
            merit, _ = evaluate(problem, everything, w, firm, coulomb, room)
            if merit <= _NEARLY:
                break
            if rough and merit <= _CLOSE:  # before further points, the last digits of these
                rough = False
                continue
            used, count = count, _enlarge(chosen, count, first, room.gap, room.z)
            if count == used:
                break
            rough = count < k
        if merit <= FOUND:
            break
    if not merit <= FOUND:  # many points close to each other: compliant ones first, whose answer is unique
        merit, more = settle(problem, w, unit, MOBILITY, merit, coulomb, firm, room)
        steps += more
    if coulomb and merit <= FOUND:
        merit, more, opened = limit(problem, w, unit, MOBILITY, merit, firm, room)
        steps += more
    for i in range(k):
        size, j = unit[i] * rate, 3 * i
        x, y, normal = w[j] * size, w[j + 1] * size, max(w[j + 2] * size, 0.0)
        t = math.sqrt(x * x + y * y)
        factor = mu[i] * normal / t if t > mu[i] * normal else 1.0
        out[j], out[j + 1], out[j + 2] = factor * x, factor * y, normal
        for e in range(j, j + 3):
            for r in range(P.shape[1]):
                out[n + first[i] + r] += P[e, r] * out[e]
    return merit, steps, opened


body_forces = compiled(
    _body_forces,
    signature(
        (NUMBER, COUNT, FLAG), array(2), array(1), array(1), FLAG,
        array(2), array(1, COUNT), array(1), array(1, COUNT), array(1, written=True),
    ),
)  # fmt: skip


def _point_misses(y: Array, w: Array, mu: Array, least: float, coulomb: bool, out: Array) -> float:
    """`contact_newton.point_misses`, in `out`, shape (n, 3): the largest of all; NaN where a number is not finite."""
    worst = 0.0
    for s in range(len(y)):
        sinks, outside, far = 0.0, 0.0, 0.0
        for i in range(mu.shape[1]):
            m, a, b, c = mu[s, i], w[s, 3 * i], w[s, 3 * i + 1], w[s, 3 * i + 2]
            u, v, normal = y[s, 3 * i], y[s, 3 * i + 1], y[s, 3 * i + 2]
            sinks = max(sinks, -normal)
            if not coulomb:
                sinks = max(sinks, (m * math.hypot(u, v) - max(normal, 0.0)) / (1.0 + m))
            push = max(math.sqrt(a * a + b * b + c * c), least)
            outside = max(outside, (math.hypot(a, b) - m * c) / push, -c / push)
            p, q, r = a - push * u, b - push * v, c - push * normal
            nearest, share, _ = project(p, q, r, m, coulomb)
            away = math.sqrt((share * p - a) ** 2 + (share * q - b) ** 2 + (nearest - c) ** 2) / push
            if not away <= math.inf:
                far = worst = math.nan
                break
            far = max(far, away)
        out[s, 0], out[s, 1], out[s, 2] = sinks, outside, far
        if worst <= math.inf:
            worst = max(worst, sinks, outside, far)
    return worst


point_misses = compiled(_point_misses, signature(NUMBER, array(2), array(2), array(2), NUMBER, FLAG, array(2, written=True)))
