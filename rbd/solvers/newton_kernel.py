"""Compiled steps of `rbd.solvers.newton`.

Rows that the projection makes zero leave the linear system: their weights are known.
"""

from __future__ import annotations

import math

import numpy as np

from rbd.arrays import Array
from rbd.kernels import COUNT, FLAG, NUMBER, array, compiled, signature
from rbd.solvers.contact_families import eliminate
from rbd.solvers.contact_kernel import project


@compiled
def gap_of(
    D: Array, q: Array, lower: Array, upper: Array, mu: Array, w: Array, coulomb: bool, p: Array, gap: Array
) -> tuple[float, float]:
    """(largest entry, sum of squares) of gap = P(p) - w at p = w - (D w + q)."""
    size, n = len(w), len(lower)
    for i in range(size):
        y = q[i]
        for j in range(size):
            y += D[i, j] * w[j]
        p[i] = w[i] - y
    for i in range(n):
        gap[i] = min(max(p[i], lower[i]), upper[i]) - w[i]
    for c in range(len(mu)):
        i = n + 3 * c
        normal, factor, _ = project(p[i], p[i + 1], p[i + 2], mu[c], coulomb)
        gap[i], gap[i + 1], gap[i + 2] = factor * p[i] - w[i], factor * p[i + 1] - w[i + 1], normal - w[i + 2]
    top, square = 0.0, 0.0
    for i in range(size):
        top = max(top, abs(gap[i]))
        square += gap[i] * gap[i]
    return (top, square) if square < math.inf else (math.inf, math.inf)  # NaN is infinite


@compiled
def _slope(x: float, y: float, z: float, mu: float, coulomb: bool, V: Array) -> None:
    """The slope of the projection on a loaded cone, at a position."""
    normal, factor, t = project(x, y, z, mu, coulomb)
    ex, ey = x / t, y / t
    if factor < 1.0:
        along, spread, last = mu, -factor, 1.0
        if not coulomb:
            last = 1.0 / (1.0 + mu * mu)
            along, spread = mu * last, 1.0 - last - factor
    else:
        along, spread, last = 0.0, 0.0, 1.0
    V[0, 0], V[0, 1], V[0, 2] = factor + spread * ex * ex, spread * ex * ey, along * ex
    V[1, 0], V[1, 1], V[1, 2] = spread * ex * ey, factor + spread * ey * ey, along * ey
    V[2, 0], V[2, 1], V[2, 2] = 0.0, 0.0, last
    if not coulomb:
        V[2, 0], V[2, 1] = along * ex, along * ey


@compiled
def _move(
    D: Array, lower: Array, upper: Array, mu: Array, coulomb: bool, proximal: float,
    p: Array, gap: Array, move: Array, used: Array, V: Array, A: Array, b: Array,
) -> bool:  # fmt: skip
    """Newton's step (I - V + V (D + proximal)) dw = gap; False where the matrix is singular."""
    size, n, count = len(p), len(lower), 0
    for i in range(n):
        move[i] = gap[i]
        if lower[i] < p[i] < upper[i]:
            used[count] = i
            count += 1
    singles = count
    for c in range(len(mu)):
        i = n + 3 * c
        normal, _, _ = project(p[i], p[i + 1], p[i + 2], mu[c], coulomb)
        for j in range(i, i + 3):
            move[j] = gap[j]
            if normal > 0.0:
                used[count] = j
                count += 1
    for e in range(count):  # gap - V D dw of the rows whose weights are known
        total = 0.0
        i, last = used[e], 0
        for j in range(size):
            if last < count and used[last] == j:
                last += 1
            elif move[j] != 0.0:
                total += D[i, j] * move[j]
        b[e] = total
    for e in range(singles):
        i = used[e]
        for s in range(count):
            A[e, s] = D[i, used[s]]
        A[e, e] += proximal
        b[e] = gap[i] - b[e]
    for e in range(singles, count, 3):
        i = used[e]
        _slope(p[i], p[i + 1], p[i + 2], mu[(i - n) // 3], coulomb, V)
        d0, d1, d2 = b[e], b[e + 1], b[e + 2]
        for r in range(3):
            b[e + r] = gap[i + r] - (V[r, 0] * d0 + V[r, 1] * d1 + V[r, 2] * d2)
        for s in range(count):
            j = used[s]
            d0, d1, d2 = D[i, j], D[i + 1, j], D[i + 2, j]
            if e <= s < e + 3:
                d0 += proximal - 1.0 if j == i else 0.0
                d1 += proximal - 1.0 if j == i + 1 else 0.0
                d2 += proximal - 1.0 if j == i + 2 else 0.0
            for r in range(3):
                A[e + r, s] = V[r, 0] * d0 + V[r, 1] * d1 + V[r, 2] * d2
        for r in range(3):
            A[e + r, e + r] += 1.0
    if not eliminate(A, b, count):
        return False
    square = 0.0
    for e in range(count):
        move[used[e]] = b[e]
        square += b[e] * b[e]
    return square < math.inf


def _newton_steps(
    D: Array, q: Array, lower: Array, upper: Array, mu: Array,
    w: Array, coulomb: bool, iterations: int, proximal: float, exact: float, best: Array,
) -> tuple[float, int]:  # fmt: skip
    """`newton.steps_from`: (merit, steps), and the best weights in `best`; w is overwritten."""
    size = len(w)
    rows, used, A, V = np.empty((5, size)), np.empty(size, np.int64), np.empty((size, size)), np.empty((3, 3))
    p, gap, move, new, b = rows[0], rows[1], rows[2], rows[3], rows[4]
    merit, square = gap_of(D, q, lower, upper, mu, w, coulomb, p, gap)
    least, step = merit, 0
    for j in range(size):
        best[j] = w[j]
    while step < iterations and least > exact and square < math.inf:
        if not _move(D, lower, upper, mu, coulomb, proximal, p, gap, move, used, V, A, b):
            break
        before, t = square, 1.0
        for _ in range(7):
            for j in range(size):
                new[j] = w[j] + t * move[j]
            merit, square = gap_of(D, q, lower, upper, mu, new, coulomb, p, gap)
            if square <= before * (1.0 - 1e-4 * t):
                break
            t *= 0.5
        for j in range(size):
            w[j] = new[j]
        step += 1
        if merit < least:
            least = merit
            for j in range(size):
                best[j] = w[j]
        if before < 1e-22 and square > 0.1 * before:  # rounding
            break
    return least, step


newton_steps = compiled(
    _newton_steps,
    signature(
        (NUMBER, COUNT), array(2), array(1), array(1), array(1), array(1),
        array(1, written=True), FLAG, COUNT, NUMBER, NUMBER, array(1, written=True),
    ),
)  # fmt: skip


def _solve(
    D: Array, y: Array, lower: Array, upper: Array, mu: Array, start: Array, coulomb: bool, iterations: int, proximal: float,
    exact: float, out: Array,
) -> tuple[float, float]:  # fmt: skip
    """`newton.scaled`, its steps and their weights in their sets: (merit, rate), with the weights in `out`."""
    size, n = len(y), len(lower)
    s, w, q, scaled, least = np.empty(size), np.empty(size), np.empty(size), np.empty((size, size)), 0.0
    for i in range(size):
        s[i] = abs(D[i, i])
        least = max(least, 1e-12 * s[i])
    for i in range(n, size, 3):
        s[i] = s[i + 1] = s[i + 2] = max(s[i], s[i + 1], s[i + 2])
    least = least if least > 0.0 else 1.0
    rate = 0.0
    for i in range(size):
        s[i] = 1.0 / math.sqrt(max(s[i], least))
        q[i] = s[i] * y[i]
        rate = max(rate, abs(q[i]))
    low, high = np.empty(n), np.empty(n)
    for i in range(n):
        low[i], high[i] = lower[i] / s[i], upper[i] / s[i]
        rate = max(rate, low[i], -high[i])
    rate = rate if rate > 0.0 else 1.0
    for i in range(n):
        low[i], high[i] = low[i] / rate, high[i] / rate
    for i in range(size):
        q[i] = q[i] / rate
        w[i] = start[i] / (s[i] * rate)
        for j in range(size):
            scaled[i, j] = D[i, j] * s[j] * s[i]
    merit, _ = newton_steps(scaled, q, low, high, mu, w, coulomb, iterations, proximal, exact, out)
    for i in range(size):
        out[i] *= s[i] * rate
    for i in range(n):
        out[i] = min(max(out[i], lower[i]), upper[i])
    for i in range(len(mu)):
        at, m = n + 3 * i, mu[i]
        x, z, push = out[at], out[at + 1], out[at + 2]
        t = math.hypot(x, z)
        if t <= m * push:
            continue
        along = (m * t + push) / (m * m + 1.0)
        factor = m * along / t if t > 0.0 else 0.0
        if m * t <= -push:
            factor = along = 0.0
        out[at], out[at + 1], out[at + 2] = factor * x, factor * z, along
    return merit, rate


weights = compiled(
    _solve,
    signature(
        (NUMBER, NUMBER),
        array(2), array(1), array(1), array(1), array(1), array(1), FLAG, COUNT, NUMBER, NUMBER, array(1, written=True),
    ),
)  # fmt: skip
