"""Compiled arithmetic of Newton's method on friction cones: the one source for dense problems and for bodies in contact.

    find w in its sets,   y = Q' (D Q w + c) + soft (w - about)   paired with it:   w = P(w - y)

Columns of w are those of *parts*: first lines, half-lines and intervals, one column each, then cones with three. Q has few
entries a column: those of a point of a body in the body's rows. Of a dense problem Q is the identity. A point that slides
already is a half-line whose force (with its friction) and whose acceleration (along the normal) have different columns, Q and
Q_y, and Q_y' stands for Q' above and below.

With V the slope of P, k = proximal + soft, B = I - (1 - k) V, M = B^-1 V and h = B^-1 gap, part by part (Woodbury's identity):

    (I - V + V (Q' D Q + k)) dw = gap       is       (I + Q M Q' D) f = Q h,     dw = h - M Q' D f

with one unknown for each row that a loaded part touches: six for a sole, whether it has 4 corners or 32. D may be nonsymmetric
and singular. Sources: `rbd.solvers.newton`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from rbd.arrays import Array
from rbd.kernels import COUNT, FLAG, NUMBER, array, compiled, signature
from rbd.solvers.small_systems import eliminate, independent, product, solved

EXACT, FOUND, PROXIMAL = 1e-14, 1e-10, 1e-7
"""Those of `rbd.solvers.newton`, which is imported without Numba."""
MOST_STEPS = 50
_SMALL = 1e-200
_GROWS = 4.0
"""The first steps, in which points change between open, sticking and slipping, may make the sum of squares grow so much."""
_TOUCHES = 1e-9
"""Scaled accelerations and weights below this are zero in an answer."""
_FIXED, _STICKS, _SLIPS = 0.0, 1.0, 2.0
"""Modes of a part: its weights are known (an open point, a bound), answer its acceleration, or follow its slip."""


class Problem(NamedTuple):
    """The scaled problem.

    Attributes:
        D: Accelerations of the rows by unit forces on them, shape (nw, nw).
        c: Their accelerations without weights, shape (nw,).
        columns: Entries of each column of Q that may differ from zero, shape (p, d).
        felt: Those of Q_y, shape (p, d).
        offset: Added to y, shape (p,).
        first: The row in which those of a part begin, shape (n + k,).
        width: How many of its d entries are rows, shape (n + k,).
        lower: Bounds of the n single columns.
        upper: Their upper bounds.
        mu: Frictions of the k cones.
    """

    D: Array
    c: Array
    columns: Array
    felt: Array
    offset: Array
    first: Array
    width: Array
    lower: Array
    upper: Array
    mu: Array


class Settings(NamedTuple):
    """What Newton's method is to do.

    Attributes:
        soft: Compliance of each part, added to D's diagonal about some weights, shape (n + k,).
        about: These weights, shape (p,).
        proximal: Compliance in Newton's matrix only.
        early: In how many first steps the sum of squares may grow by `_GROWS`.
        iterations: Most steps.
        coulomb: Coulomb's law; else the convex one.
    """

    soft: Array
    about: Array
    proximal: float
    early: int
    iterations: int
    coulomb: bool


class Room(NamedTuple):
    """Working arrays: (p,), (nw,), the modes (n + k, 4) of the parts (mode, factor, direction), rows in use, blocks of parts.

    Parts that begin in one row, one behind the other, share a block of Q M Q': their numbers, (first row, rows) of
    each, the blocks.
    """

    p: Array
    gap: Array
    move: Array
    new: Array
    best: Array
    f: Array
    a: Array
    z: Array
    modes: Array
    used: Array
    blocks: Array
    starts: Array
    B: Array
    A: Array


@compiled
def room_of(problem: Problem) -> Room:
    """Working arrays of a problem."""
    p, nw, parts, d = len(problem.columns), len(problem.c), len(problem.first), problem.columns.shape[1]
    of_columns, of_rows, blocks = np.zeros((5, p)), np.zeros((3, nw)), np.zeros(parts, np.int64)
    for i in range(1, parts):
        blocks[i] = blocks[i - 1] + (problem.first[i] != problem.first[i - 1])
    count = blocks[-1] + 1 if parts else 0
    starts = np.zeros((count, 2), np.int64)
    for i in range(parts):
        starts[blocks[i], 0] = problem.first[i]
        starts[blocks[i], 1] = max(starts[blocks[i], 1], problem.width[i])
    return Room(
        of_columns[0], of_columns[1], of_columns[2], of_columns[3], of_columns[4], of_rows[0], of_rows[1], of_rows[2],
        np.zeros((parts, 4)), np.zeros(nw, np.int64), blocks, starts, np.zeros((count, d, d)), np.zeros((nw, nw)),
    )  # fmt: skip


@compiled
def span(i: int, n: int) -> tuple[int, int]:
    """The columns of part i, of n single ones before the cones: from the first up to the second."""
    return (i, i + 1) if i < n else (3 * i - 2 * n, 3 * i - 2 * n + 3)


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
def loads(problem: Problem, parts: Array, w: Array, f: Array) -> None:
    """Q w of some parts in f."""
    columns, n = problem.columns, len(problem.lower)
    f[:] = 0.0
    for i in parts:
        at = problem.first[i]
        start, stop = span(i, n)
        for j in range(start, stop):
            if w[j] != 0.0:
                for r in range(problem.width[i]):
                    f[at + r] += columns[j, r] * w[j]


@compiled
def evaluate(problem: Problem, parts: Array, w: Array, settings: Settings, room: Room) -> tuple[float, float]:
    """(largest entry, sum of squares) of gap = P(p) - w at p = w - y."""
    D, felt, n, f, a, p, gap, modes = (
        problem.D, problem.felt, len(problem.lower), room.f, room.a, room.p, room.gap, room.modes
    )  # fmt: skip
    nw = len(f)
    loads(problem, parts, w, f)
    for r in range(nw):
        total = problem.c[r]
        for s in range(nw):
            total += D[r, s] * f[s]
        a[r] = total
    top, square = 0.0, 0.0
    for i in parts:
        at = problem.first[i]
        start, stop = span(i, n)
        for j in range(start, stop):
            y = problem.offset[j] + settings.soft[i] * (w[j] - settings.about[j])
            for r in range(problem.width[i]):
                y += felt[j, r] * a[at + r]
            p[j] = w[j] - y
        j = start
        if i < n:
            gap[j] = min(max(p[j], problem.lower[i]), problem.upper[i]) - w[j]
            modes[i, 0] = _STICKS if problem.lower[i] < p[j] < problem.upper[i] else _FIXED
        else:
            normal, factor, t = project(p[j], p[j + 1], p[j + 2], problem.mu[i - n], settings.coulomb)
            if normal > 0.0:
                modes[i, 0] = _SLIPS if factor < 1.0 else _STICKS
            else:
                modes[i, 0] = _FIXED
            modes[i, 1], modes[i, 2], modes[i, 3] = factor, p[j] / t, p[j + 1] / t
            gap[j], gap[j + 1], gap[j + 2] = factor * p[j] - w[j], factor * p[j + 1] - w[j + 1], normal - w[j + 2]
        for j in range(start, stop):
            top = max(top, abs(gap[j]))
            square += gap[j] * gap[j]
    return (top, square) if square < math.inf else (math.inf, math.inf)  # NaN is infinite


@compiled
def newton_step(problem: Problem, parts: Array, settings: Settings, room: Room) -> bool:
    """Newton's step in `room.move`; False where its linear system is singular."""
    D, columns, felt, gap, modes, move = problem.D, problem.columns, problem.felt, room.gap, room.modes, room.move
    n = len(problem.lower)
    z, used, A, B, f, a = room.z, room.used, room.A, room.B, room.f, room.a
    nw = len(z)
    used[:], B[:] = 0, 0.0
    for i in parts:  # move = h, B = Q M Q'
        at, mode, factor, ex, ey = problem.first[i], modes[i, 0], modes[i, 1], modes[i, 2], modes[i, 3]
        start, stop = span(i, n)
        d = problem.width[i]
        k, j, block = settings.proximal + settings.soft[i], start, B[room.blocks[i]]
        if mode != _SLIPS:
            for e in range(start, stop):
                move[e] = gap[e]
                if mode == _STICKS:
                    move[e] /= k
                    for r in range(d):
                        x = columns[e, r] / k
                        for s in range(d):
                            block[r, s] += x * felt[e, s]
        else:
            g0, g1, g2 = gap[j], gap[j + 1], gap[j + 2]
            u, along, turned = problem.mu[i - n], ex * g0 + ey * g1, factor / (1.0 - (1.0 - k) * factor)
            side = (ex * g1 - ey * g0) / (1.0 - (1.0 - k) * factor)
            share, push = 1.0, g2  # V is (u e + n) share (n or u e + n)' + factor side side'
            if not settings.coulomb:
                share = 1.0 / (1.0 + u * u)
                push = share * (u * along + g2)
            along, move[j + 2] = along + u * push * (1.0 - k) / k, g2 + push * (1.0 - k) / k
            move[j], move[j + 1] = ex * along - ey * side, ey * along + ex * side
            q, v, x = columns[j], columns[j + 1], columns[j + 2]
            for r in range(d):
                edge, turn = share * (u * (ex * q[r] + ey * v[r]) + x[r]) / k, turned * (ex * v[r] - ey * q[r])
                for s in range(d):
                    met = felt[j + 2, s]
                    if not settings.coulomb:
                        met += u * (ex * felt[j, s] + ey * felt[j + 1, s])
                    block[r, s] += edge * met + turn * (ex * felt[j + 1, s] - ey * felt[j, s])
        if mode != _FIXED:
            for e in range(start, stop):
                for r in range(d):
                    if columns[e, r] != 0.0:
                        used[at + r] = 1
    loads(problem, parts, move, f)
    for r in range(nw):  # what the forces do that no loaded part changes
        a[r] = 0.0
        for s in range(nw):
            if used[s] == 0:
                a[r] += D[r, s] * f[s]
            A[r, s] = 0.0
        A[r, r] = 1.0
    for b in range(len(B)):
        begin = room.starts[b, 0]
        d = min(room.starts[b, 1], nw - begin)
        for r in range(d):
            row = A[begin + r]
            for t in range(d):
                x, felt_by = B[b, r, t], D[begin + t]
                f[begin + r] -= x * a[begin + t]
                for s in range(nw if x != 0.0 else 0):
                    row[s] += x * felt_by[s]
    count = 0
    for r in range(nw):
        if used[r] == 1:
            used[count] = r
            count += 1
    for e in range(count):
        z[e] = f[used[e]]
        for s in range(count):
            A[e, s] = A[used[e], used[s]]
    if not eliminate(A, z, count):
        return False
    for e in range(count):
        f[used[e]] = z[e]
    product(D, f, a)
    square = 0.0
    for i in parts:
        at, mode, factor, ex, ey = problem.first[i], modes[i, 0], modes[i, 1], modes[i, 2], modes[i, 3]
        start, stop = span(i, n)
        k, j, d = settings.proximal + settings.soft[i], start, problem.width[i]
        if mode == _STICKS:
            for e in range(start, stop):
                for r in range(d):
                    move[e] -= felt[e, r] * a[at + r] / k
        elif mode == _SLIPS:
            y0, y1, y2 = 0.0, 0.0, 0.0
            for r in range(d):
                y0 += felt[j, r] * a[at + r]
                y1 += felt[j + 1, r] * a[at + r]
                y2 += felt[j + 2, r] * a[at + r]
            u, side = problem.mu[i - n], factor / (1.0 - (1.0 - k) * factor) * (ex * y1 - ey * y0)
            if not settings.coulomb:
                y2 = (y2 + u * (ex * y0 + ey * y1)) / (1.0 + u * u)
            move[j] -= ex * u * y2 / k - ey * side
            move[j + 1] -= ey * u * y2 / k + ex * side
            move[j + 2] -= y2 / k
        for e in range(start, stop):
            square += move[e] * move[e]
    return math.isfinite(square)


@compiled
def damped_steps(problem: Problem, parts: Array, w: Array, settings: Settings, exact: float, room: Room) -> tuple[float, int]:
    """Damped semismooth Newton steps from w, which becomes the best weights found: (merit, steps)."""
    n, new, best, move = len(problem.lower), room.new, room.best, room.move
    merit, square = evaluate(problem, parts, w, settings, room)
    least, step = merit, 0
    best[:], new[:] = w, w
    while step < settings.iterations and least > exact and square < math.inf:
        if not newton_step(problem, parts, settings, room):
            break
        before, t = square, 1.0
        for _ in range(7):
            for i in parts:
                start, stop = span(i, n)
                for j in range(start, stop):
                    new[j] = w[j] + t * move[j]
            merit, square = evaluate(problem, parts, new, settings, room)
            if square <= before * (_GROWS if step < settings.early else 1.0 - 1e-4 * t):
                break
            t *= 0.5
        w[:] = new
        step += 1
        if merit < least:
            least, best[:] = merit, w
        if before < 1e-22 and square > 0.1 * before:  # rounding
            break
    w[:] = best
    return least, step


@compiled
def settle(
    problem: Problem, w: Array, unit: Array, mobility: float, merit: float, firm: Settings, room: Room
) -> tuple[float, int]:
    """The limit of the answers of equally compliant points near w: (merit, steps); w stays where it is not reached.

    Args:
        problem: The problem.
        w: Weights; written.
        unit: Newtons of a scaled weight of each cone, over any one number, shape (k,).
        mobility: Largest diagonal entry of a scaled part.
        merit: That of w, returned where it stays.
        firm: Without compliance; its `soft` is written in between.
        room: Working arrays.
    """
    parts, n, steps, soft, near = np.arange(len(problem.first)), len(problem.lower), 0, firm.soft, w.copy()
    most = 0.0
    for x in unit:
        most = max(most, x)
    reached, compliance, found = math.inf, 1e-2, False
    while compliance > 1e-5:
        for i in range(len(soft)):  # the same compliance per newton
            soft[i] = mobility * compliance * (1.0 if i < n else max((unit[i - n] / most) ** 2, 1e-3))
        soften = Settings(soft, firm.about, 0.0, firm.early, firm.iterations, firm.coulomb)
        reached, more = damped_steps(problem, parts, near, soften, 1e-8 * compliance, room)
        steps += more
        # A merit m leaves the shares uncertain by m / compliance.
        if not reached <= 1e-5 * compliance:
            break
        found = True
        compliance *= 1e-2
    soft[:] = 0.0
    if found:
        reached, more = damped_steps(problem, parts, near, firm, EXACT, room)
        steps += more
        if reached <= FOUND:
            w[:] = near
            return reached, steps
    return merit, steps


@compiled
def _leaves_motion_open(problem: Problem, w: Array, p: Array) -> bool:
    """Whether the equations of the modes at an answer w of Coulomb's law leave a family of motions, not only of weights.

    Loads N of slipping points and forces g of sticking ones, as changes, move the rows by z:
    (I + D T) z = D (Q_edge N + Q g), T the turning of friction. The points' conditions are y_n = 0 of the ones and y = 0 of
    the others. There is a family where some z other than zero meets them.

    Args:
        problem: The problem.
        w: Weights, shape (p,).
        p: w - y.
    """
    D, columns, felt, first, n = problem.D, problem.columns, problem.felt, problem.first, len(problem.lower)
    nw, size = len(D), len(w)
    rows, conditions, A, T = np.zeros((size, nw)), np.zeros((size, nw)), np.eye(nw), np.zeros((nw, nw))
    count, slides = 0, False
    for i in range(n, len(first)):
        j = 3 * i - 2 * n
        if w[j + 2] - p[j + 2] < _TOUCHES:
            slides = slides or math.hypot(w[j] - p[j], w[j + 1] - p[j + 1]) > _TOUCHES
            for r in range(problem.width[i]):
                for s in range(nw):
                    rows[count, s] += D[first[i] + r, s] * columns[j + 2, r]
            count += 1
    if not slides or independent(rows, count, 1e-5) == count:
        return False  # independent normals determine their shares
    found = 0
    for i in range(len(first)):
        at, d, start, slips, factor, ex, ey = first[i], problem.width[i], i, False, 0.0, 0.0, 0.0
        if i < n:
            if not problem.lower[i] < p[i] < problem.upper[i]:
                continue
            stop = i + 1
        else:
            j = 3 * i - 2 * n
            normal = p[j + 2]
            if w[j + 2] - p[j + 2] < _TOUCHES:
                normal += max(_TOUCHES - w[j + 2], 0.0)  # a touching unloaded point may become loaded
            if not normal > 0.0:
                continue
            _, factor, t = project(p[j], p[j + 1], normal, problem.mu[i - n], True)
            slips, ex, ey = factor < 1.0, p[j] / t, p[j + 1] / t
            start, stop = j + 2 if slips else j, j + 3
        for e in range(start, stop):
            rows[found], conditions[found] = 0.0, 0.0
            for r in range(d):
                conditions[found, at + r], rows[found, at + r] = felt[e, r], columns[e, r]
                if slips:
                    rows[found, at + r] += problem.mu[i - n] * (ex * columns[e - 2, r] + ey * columns[e - 1, r])
            found += 1
        if slips:
            e = stop - 3
            for r in range(d):
                side = factor / (1.0 - (1.0 - PROXIMAL) * factor) * (ex * columns[e + 1, r] - ey * columns[e, r])
                for s in range(d):
                    T[at + r, at + s] += side * (ex * felt[e + 1, s] - ey * felt[e, s])
    A += D @ T
    motions = np.ascontiguousarray(solved(A, D @ np.ascontiguousarray(rows[:found].T)).T)
    rank = independent(motions, found, 1e-8)
    if rank == 0 or not np.isfinite(motions).all():
        return False
    missed = motions[:rank] @ np.ascontiguousarray(conditions[:found].T)
    return independent(missed, rank, 1e-8) < rank


@compiled
def limit(
    problem: Problem, w: Array, unit: Array, mobility: float, merit: float, firm: Settings, room: Room
) -> tuple[float, int, bool]:
    """(merit, steps, whether w of Coulomb's law leaves a family of motions): it becomes their limit then; see `settle`."""
    evaluate(problem, np.arange(len(problem.first)), w, firm, room)
    if not _leaves_motion_open(problem, w, room.p):
        return merit, 0, False
    merit, steps = settle(problem, w, unit, mobility, merit, firm, room)
    return merit, steps, True


_DENSE = (array(2), array(1), array(2), array(1, COUNT), array(1), array(1), array(1))
"""Types of a dense problem: D, q, and the rest of `Problem`."""


@compiled
def _dense(D: Array, q: Array, columns: Array, first: Array, lower: Array, upper: Array, mu: Array) -> Problem:
    """A problem whose parts are rows of their own."""
    own, width = columns.copy(), np.full(len(first), columns.shape[1])
    return Problem(
        D.copy(), q.copy(), own, own, np.zeros(len(q)), first.copy(), width, lower.copy(), upper.copy(), mu.copy()
    )  # fmt: skip


def _newton_steps(
    D: Array, q: Array, columns: Array, first: Array, lower: Array, upper: Array, mu: Array,
    w: Array, coulomb: bool, iterations: int, soft: float, about: Array, proximal: float, exact: float,
) -> tuple[float, int]:  # fmt: skip
    """`newton.steps_from`: (merit, steps); w becomes the best weights."""
    problem, parts = _dense(D, q, columns, first, lower, upper, mu), len(first)
    settings = Settings(np.full(parts, soft), about.copy(), proximal, 0, iterations, coulomb)
    return damped_steps(problem, np.arange(parts), w, settings, exact, room_of(problem))


newton_steps = compiled(
    _newton_steps,
    signature((NUMBER, COUNT), *_DENSE, array(1, written=True), FLAG, COUNT, NUMBER, array(1), NUMBER, NUMBER),
)


def _family_limit(
    D: Array, q: Array, columns: Array, first: Array, lower: Array, upper: Array, mu: Array, w: Array, unit: Array
) -> tuple[int, bool]:
    """`newton.family_limit`: (steps, whether there is a family); w becomes the limit."""
    problem, parts = _dense(D, q, columns, first, lower, upper, mu), len(first)
    firm = Settings(np.zeros(parts), np.zeros(len(q)), PROXIMAL, 0, MOST_STEPS, True)
    _, steps, opened = limit(problem, w, unit.copy(), 1.0, math.inf, firm, room_of(problem))
    return steps, opened


family_limit = compiled(_family_limit, signature((COUNT, FLAG), *_DENSE, array(1, written=True), array(1)))


def _scaled(D: Array, y: Array, lower: Array, upper: Array) -> tuple[Array, Array, Array, Array, Array, float]:
    """`newton.Scaled`: (D, q, lower, upper, unit, rate)."""
    size, n = len(y), len(lower)
    s, q, least, rate = np.empty(size), np.empty(size), 0.0, 0.0
    for i in range(size):
        s[i] = abs(D[i, i])
        least = max(least, 1e-12 * s[i])
    for i in range(n, size, 3):
        s[i] = s[i + 1] = s[i + 2] = max(s[i], s[i + 1], s[i + 2])
    # A row without mobility has a zero diagonal, a jammed one (Painleve) may be near it: neither is scaled up.
    least = least if least > 0.0 else 1.0
    for i in range(size):
        s[i] = 1.0 / math.sqrt(max(s[i], least))
        q[i] = s[i] * y[i]
        rate = max(rate, abs(q[i]))
    low, high = lower / s[:n], upper / s[:n]
    for i in range(n):
        rate = max(rate, low[i], -high[i])  # forces far from zero
    rate = rate if rate > 0.0 else 1.0
    return D * s * s.reshape((-1, 1)), q / rate, low / rate, high / rate, s * rate, rate


scaled = compiled(
    _scaled,
    signature((array(2, written=True), *[array(1, written=True)] * 4, NUMBER), array(2), array(1), array(1), array(1)),
)
