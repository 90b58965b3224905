"""Compiled: weights of points and rows that obey a contact law, in the few rows that they touch.

    find w in its sets,   y = Q_y' (D Q w + c) + offset   paired with it by the law

as `rbd.solvers.newton_kernel`, whose steps these are, from several starts and a few points at a time.
"""

from __future__ import annotations

import math

import numpy as np

from rbd.arrays import Array
from rbd.kernels import COUNT, FLAG, NUMBER, array, compiled, record, signature
from rbd.solvers.newton_kernel import (
    EXACT,
    FOUND,
    MOST_STEPS,
    PROXIMAL,
    Problem,
    Settings,
    damped_steps,
    evaluate,
    limit,
    loads,
    project,
    room_of,
    settle,
    span,
)

MOBILITY, SINGLE = 10.0, 1.0
"""Of each scaled cone and single column, which balances weights and accelerations: fewest steps, of 0.1 to 30 tried."""
LEAST_PUSH = 1e-3
"""Lower bound of the scale of a point's force [N]: what accelerates a gram at 1 m/s2."""
STILL, NEARLY = 1e-12, 1e-6
"""Accelerations of loaded points that count as zero, over the largest of the bodies without forces; in between: undecided.

Near the last forces that hold a body Newton's method leaves 1e-9 m/s2 of nothing; beyond them the body may slide at 1 m/s2.
"""
_ROUGH, _CLOSE = 1e-4, 1e-4
"""Merits at which further points are looked for, and below which not before this merit is `EXACT`."""
_NEARLY = 1e-12
"""Merit at which no further points are taken into account."""
_FINE, _LAST = 1e-9, 6
"""Compliance in Newton's matrix in the last steps, and how many these are at most."""
_EARLY = 6
"""First steps in which the sum of squares may grow."""


@compiled
def _scaled(given: Problem, unit: Array) -> tuple[Problem, float]:
    """(the scaled problem, the rate by which accelerations were divided), and each part's `unit`.

    Each part's block of Q_y' D Q has the largest diagonal `MOBILITY`, or `SINGLE`; Q_y' c + offset is of order one.
    """
    n, most, rate = len(given.lower), 0.0, 0.0
    for i in range(len(unit)):
        at, d, size = given.first[i], given.width[i], 0.0
        start, stop = span(i, n)
        for j in range(start, stop):
            total = 0.0
            for r in range(d):
                x = given.felt[j, r]
                if x != 0.0:
                    for s in range(d):
                        total += x * given.D[at + r, at + s] * given.columns[j, s]
            size = max(size, abs(total))
        unit[i] = size
        most = max(most, size)
    columns, felt, offset = given.columns.copy(), given.felt.copy(), given.offset.copy()
    for i in range(len(unit)):
        unit[i] = math.sqrt((SINGLE if i < n else MOBILITY) / max(unit[i], 1e-12 * most if most > 0.0 else 1.0))
        start, stop = span(i, n)
        for j in range(start, stop):
            offset[j] *= unit[i]
            total = offset[j]
            for r in range(given.width[i]):
                columns[j, r] *= unit[i]
                felt[j, r] *= unit[i]
                total += felt[j, r] * given.c[given.first[i] + r]
            rate = max(rate, abs(total))
    lower, upper = given.lower / unit[:n], given.upper / unit[:n]
    for i in range(n):
        rate = max(rate, lower[i], -upper[i])  # forces far from zero
    rate = rate if rate > 0.0 else 1.0
    problem = Problem(
        given.D, given.c / rate, columns, felt, offset / rate, given.first, given.width, lower / rate, upper / rate, given.mu
    )
    return problem, rate


@compiled
def _enlarge(problem: Problem, chosen: Array, count: int, gap: Array, worst: Array) -> int:
    """Append to the parts in use the one of each body that violates the law most: their new number."""
    n, first = len(problem.lower), problem.first
    worst[:] = 0.0
    for i in range(len(first)):
        start, stop = span(i, n)
        for j in range(start, stop):
            worst[first[i]] = max(worst[first[i]], abs(gap[j]))
    for i in range(len(first)):
        size = 0.0
        start, stop = span(i, n)
        for j in range(start, stop):
            size = max(size, abs(gap[j]))
        if size > 1e-13 and size == worst[first[i]] and not (chosen[:count] == i).any():
            chosen[count] = i
            count += 1
            worst[first[i]] = -1.0
    return count


def _forces(given: Problem, start: Array, coulomb: bool, seeds: Array, out: Array) -> tuple[float, int, bool]:
    """(merit, steps, whether a family of motions was met) of the weights `out` that obey the law.

    The merit is the largest entry of |w - P(w - y)|, scaled, or the length of that vector, which is no less: an answer if
    below `FOUND`; infinite for numbers that are not finite.

    Args:
        given: The problem, not scaled.
        start: Weights to start from, shape (p,), finite or not.
        coulomb: Coulomb's law; else the convex one.
        seeds: The parts with which the search begins.
        out: Written, shape (p,).
    """
    n, parts = len(given.lower), len(given.first)
    unit, everything, chosen = np.empty(parts), np.arange(parts), np.empty(parts, np.int64)
    for j in range(len(out)):
        out[j] = 0.0
    problem, rate = _scaled(given, unit)
    if not (rate < math.inf and math.isfinite(given.D.sum())):
        return math.inf, 0, False
    w, room, count = np.zeros(len(out)), room_of(problem), len(seeds)
    firm = Settings(np.zeros(parts), np.zeros(len(out)), PROXIMAL, _EARLY, MOST_STEPS, coulomb)
    for e in range(count):
        i = chosen[e] = seeds[e]
        begin, stop = span(i, n)
        total = 0.0
        for j in range(begin, stop):
            total += start[j]
        if math.isfinite(total):
            for j in range(begin, stop):
                w[j] = start[j] / (unit[i] * rate)
    merit, steps, opened = math.inf, 0, False
    for attempt in range(2):
        if attempt > 0:  # from all contacts open
            w[:] = 0.0
        rough = count < parts
        while True:
            enough = _ROUGH if rough else FOUND
            merit, more = damped_steps(problem, chosen[:count], w, firm, _ROUGH if rough else EXACT, room)
            steps += more
            if not merit <= enough or count == parts:
                break
            merit, _ = evaluate(problem, everything, w, firm, room)
            if merit <= _NEARLY:
                break
            if rough and merit <= _CLOSE:  # before further points, the last digits of these
                rough = False
                continue
            used, count = count, _enlarge(problem, chosen, count, room.gap, room.z)
            if count == used:
                break
            rough = count < parts
        if merit <= FOUND:
            break
    if not merit <= FOUND:  # many points close to each other: compliant ones first, whose answer is unique
        merit, more = settle(problem, w, unit[n:], MOBILITY, merit, firm, room)
        steps += more
    if EXACT < merit <= FOUND:  # the steps' own regularisation stalls rows that are nearly dependent
        fine = Settings(firm.soft, firm.about, _FINE, 0, _LAST, coulomb)
        _, more = damped_steps(problem, chosen[:count], w, fine, EXACT, room)
        steps += more
    if coulomb and merit <= FOUND:
        merit, more, opened = limit(problem, w, unit[n:], MOBILITY, merit, firm, room)
        steps += more
    for i in range(parts):
        size = unit[i] * rate
        begin, stop = span(i, n)
        if i < n:
            out[i] = min(max(w[i] * size, given.lower[i]), given.upper[i])
            continue
        x, y, normal = w[begin] * size, w[begin + 1] * size, max(w[begin + 2] * size, 0.0)
        t, most = math.sqrt(x * x + y * y), given.mu[i - n] * normal
        factor = most / t if t > most else 1.0
        out[begin], out[begin + 1], out[begin + 2] = factor * x, factor * y, normal
    return merit, steps, opened


_VECTOR, _WHOLE = array(1, written=True), array(1, COUNT, written=True)
_MATRIX = array(2, written=True)
PROBLEM = record(Problem, _MATRIX, _VECTOR, _MATRIX, _MATRIX, _VECTOR, _WHOLE, _WHOLE, _VECTOR, _VECTOR, _VECTOR)
_FOUND = (NUMBER, COUNT, FLAG)
forces = compiled(_forces, signature(_FOUND, PROBLEM, _VECTOR, FLAG, _WHOLE, _VECTOR))


@compiled
def cone_miss(
    u: float, v: float, n: float, a: float, b: float, c: float, mu: float, coulomb: bool
) -> tuple[float, float, float]:
    """How far a point is from its law, scaled: (it sinks, its force is outside its cone, both from their law).

    Args:
        u: First tangential acceleration.
        v: Second one.
        n: Normal one.
        a: First tangential force.
        b: Second one.
        c: Normal one.
        mu: Friction coefficient.
        coulomb: Coulomb's law; else the convex one.
    """
    sinks = max(-n, 0.0)
    if not coulomb:
        sinks = max(sinks, (mu * np.hypot(u, v) - max(n, 0.0)) / (1.0 + mu))
    push = max(math.sqrt(a * a + b * b + c * c), LEAST_PUSH)
    outside = max((np.hypot(a, b) - mu * c) / push, -c / push, 0.0)
    p, q, r = a - push * u, b - push * v, c - push * n
    nearest, share, _ = project(p, q, r, mu, coulomb)
    return sinks, outside, math.sqrt((share * p - a) ** 2 + (share * q - b) ** 2 + (nearest - c) ** 2) / push


@compiled
def _from_coulomb(given: Problem, w: Array) -> float:
    """How far weights of the convex law are from Coulomb's: loaded points that do not keep still."""
    n, nw, rate, push, f = len(given.lower), len(given.c), 0.0, 0.0, np.empty(len(given.c))
    for r in range(nw):
        rate = max(rate, abs(given.c[r]))
    for j in range(len(w)):
        push = max(push, abs(w[j]))
    if not rate > 0.0 or not push > 0.0:
        return 0.0
    loads(given, np.arange(len(given.first)), w, f)
    a, far, y = given.D @ f + given.c, 0.0, np.empty(3)
    for i in range(n, len(given.first)):
        j, at = 3 * i - 2 * n, given.first[i]
        for k in range(3):
            total = given.offset[j + k]
            for r in range(given.width[i]):
                total += given.felt[j + k, r] * a[at + r]
            y[k] = total / rate
        missed = cone_miss(y[0], y[1], y[2], w[j] / push, w[j + 1] / push, w[j + 2] / push, given.mu[i - n], True)
        far = max(far, missed[0], missed[1], missed[2])
        if not missed[2] <= math.inf:
            return math.inf
    return far


_MARGIN = 1e-3
"""Share of the energy of a change that sliding points must at least take up, so that their motion is known to be unique."""


@compiled
def has_one_motion(given: Problem) -> bool:
    """Whether points that slide, and the other single columns, allow one motion at most, whatever the points at rest do.

    Two answers with weights that differ by x have x . (Q_y' D Q x) <= 0. If Q_y' D Q - `_MARGIN` Q' D Q has no negative
    direction, then Q' D Q x = 0: the same motion. That is sufficient, not necessary.
    """
    n, nw = len(given.lower), len(given.c)
    push, felt = np.zeros((n, nw)), np.zeros((n, nw))
    for i in range(n):
        for r in range(given.width[i]):
            push[i, given.first[i] + r], felt[i, given.first[i] + r] = given.columns[i, r], given.felt[i, r]
    moved = push @ given.D
    S = felt @ moved.T - _MARGIN * (push @ moved.T)
    C, count = np.zeros((n, min(n, nw))), 0
    for r in range(n):
        pivot, size = S[r, r], abs(S[r, r])
        for k in range(count):
            pivot -= C[r, k] * C[r, k]
            size += C[r, k] * C[r, k]
        small = 1e-9 * size
        if pivot < -small:
            return False
        scale = 1.0 / math.sqrt(pivot) if pivot > small else 0.0
        for s in range(r + 1, n):
            x = 0.5 * (S[r, s] + S[s, r])
            for k in range(count):
                x -= C[r, k] * C[s, k]
            if scale == 0.0 or count == C.shape[1]:
                if abs(x) > 1e-7 * math.sqrt(size * abs(S[s, s])):
                    return False
            else:
                C[s, count] = x * scale
        if scale > 0.0 and count < C.shape[1]:
            C[r, count] = math.sqrt(pivot)
            count += 1
    return True


def _search(
    given: Problem, start: Array, coulomb: bool, sliding: bool, seeds: Array, out: Array
) -> tuple[float, int, bool]:  # fmt: skip
    """(merit, steps, whether these are the forces of the convex law) of weights that obey the law, from several starts.

    Coulomb's law: the forces of the convex law where they obey it too: loaded points then keep still, though some could slip as
    well. Where that cannot be decided the merit is infinite, and where points slide already and may have several motions.

    Args:
        given: The problem, not scaled.
        start: Weights to start from, shape (p,).
        coulomb: Coulomb's law; else the convex one.
        sliding: Whether some points slide.
        seeds: The parts with which the search begins.
        out: Written, shape (p,).
    """
    first = start
    if sliding and not has_one_motion(given):
        return math.inf, 0, False
    if not sliding:
        merit, steps, _ = forces(given, start, False, seeds, out)
        if not coulomb:
            if not merit <= FOUND:  # most get there from Coulomb's forces, at a tenth of what the general way costs
                other = np.empty(len(out))
                _, more, _ = forces(given, start, True, seeds, other)
                merit, last, _ = forces(given, other, False, seeds, out)
                steps += more + last
            return merit, steps, True
        if merit <= FOUND:
            far = _from_coulomb(given, out)
            if far <= STILL:
                return merit, steps, True
            if far <= NEARLY:
                return math.inf, steps, True
        first = out.copy()
    else:
        steps = 0
    merit, more, _ = forces(given, first, True, seeds, out)
    steps += more
    if not merit <= FOUND:
        merit, more, _ = forces(given, start, True, seeds, out)
        steps += more
    return merit, steps, False


search = compiled(_search, signature(_FOUND, PROBLEM, _VECTOR, FLAG, FLAG, _WHOLE, _VECTOR))
