"""Compiled: Newton's method on the equations of `rbd.problem.conic`.

    d off = [(I - V) + V H, -V A^T, -V C^T; A, 0, 0; (I - D) C, 0, D]

with V and D the slopes of the projections on X and on the rows' bounds. Where a row is between its bounds, z becomes 0, and its
equation is left out.
"""

from __future__ import annotations

import math

import numpy as np

from rbd.arrays import Array
from rbd.kernels import COUNT, FLAG, NUMBER, array, compiled, signature
from rbd.solvers.newton_kernel import project
from rbd.solvers.small_systems import eliminate

NEWTON_STEPS = 12
"""Of Newton's method, before Clarabel is asked."""
_ROUNDING = 1e-13
"""A miss up to this ends the steps, of numbers around one."""


@compiled
def _projected(
    p: Array, lower: Array, upper: Array, cones: Array, mu: Array, inside: Array, single: Array, V: Array
) -> bool:  # fmt: skip
    """Write the projection of p on X, the slope of each entry outside of cones, and those of cones; whether nothing holds p."""
    free = True
    for i in range(len(p)):
        inside[i] = min(max(p[i], lower[i]), upper[i])
        single[i] = 1.0 if inside[i] == p[i] else 0.0
        free = free and inside[i] == p[i]
    for k in range(len(mu)):
        i, j, l = cones[k]
        normal, factor, t = project(p[i], p[j], p[l], mu[k], False)
        x, y, slips = p[i] / t, p[j] / t, factor < 1.0 and normal > 0.0
        inside[i], inside[j], inside[l] = factor * p[i], factor * p[j], normal
        share = 1.0 / (1.0 + mu[k] * mu[k])
        along, spread = (mu[k] * share, 1.0 - share - factor) if slips else (0.0, 0.0)
        V[k, 0, 0], V[k, 1, 1], V[k, 2, 2] = factor + spread * x * x, factor + spread * y * y, share if slips else factor
        V[k, 0, 1] = V[k, 1, 0] = spread * x * y
        V[k, 0, 2] = V[k, 2, 0] = along * x
        V[k, 1, 2] = V[k, 2, 1] = along * y
        free = free and normal > 0.0 and not slips
    return free


@compiled
def _answer_of_X(H: Array, g: Array, A: Array, C: Array, x: Array, y: Array, z: Array, r: Array) -> None:
    """Write H x + g - A^T y - C^T z."""
    for i in range(len(g)):
        total = g[i]
        for j in range(len(x)):
            total += H[i, j] * x[j]
        r[i] = total
    for k in range(len(y)):
        for i in range(len(g)):
            r[i] -= y[k] * A[k, i]
    for k in range(len(z)):
        if z[k] != 0.0:
            for i in range(len(g)):
                r[i] -= z[k] * C[k, i]


@compiled
def _system(
    H: Array, A: Array, C: Array, cones: Array, single: Array, V: Array, rows: Array, held: int, off: Array, loose: Array,
    K: Array, right: Array,
) -> int:  # fmt: skip
    """Write Newton's equations, of so many held rows; their number. `loose` is C^T of the z that become zero."""
    n, e = H.shape[0], A.shape[0]
    m = n + e + held
    for i in range(n):
        for j in range(n):
            K[i, j] = H[i, j] if single[i] != 0.0 else 0.0
        for k in range(e + held):
            x = A[k, i] if k < e else C[rows[k - e], i]
            K[i, n + k] = -x if single[i] != 0.0 else 0.0
            K[n + k, i] = x
        right[i] = -off[i]
        if single[i] != 0.0:
            right[i] -= loose[i]
        else:
            K[i, i] = 1.0
    for k in range(n, m):
        right[k] = -off[k] if k < n + e else -off[n + e + rows[k - n - e]]
        for j in range(n, m):
            K[k, j] = 0.0
    for k in range(len(cones)):
        i, j, l = cones[k]
        S = V[k]
        if S[0, 0] == 1.0 and S[1, 1] == 1.0 and S[2, 2] == 1.0:
            continue
        for c in range(m):
            x, y, z = K[i, c], K[j, c], K[l, c]
            K[i, c] = S[0, 0] * x + S[0, 1] * y + S[0, 2] * z
            K[j, c] = S[1, 0] * x + S[1, 1] * y + S[1, 2] * z
            K[l, c] = S[2, 0] * x + S[2, 1] * y + S[2, 2] * z
        for a in range(3):
            for b in range(3):
                K[cones[k, a], cones[k, b]] += (1.0 if a == b else 0.0) - S[a, b]
            right[cones[k, a]] += loose[cones[k, a]] - S[a, 0] * loose[i] - S[a, 1] * loose[j] - S[a, 2] * loose[l]
    return m


@compiled
def _least_squares(K: Array, right: Array) -> Array:
    """The x of least norm with the least |K x - right|; NaN where it is not found."""
    try:
        x = np.ascontiguousarray(np.linalg.lstsq(K, right, 1e-14)[0])
    except Exception:  # the only kind that Numba knows
        x = np.full(right.shape, np.nan)
    return x


@compiled
def _missed(
    H: Array, g: Array, A: Array, b: Array, C: Array, low: Array, high: Array, lower: Array, upper: Array, cones: Array,
    mu: Array, x: Array, y: Array, z: Array, off: Array, inside: Array, single: Array, V: Array, rows: Array, loose: Array,
) -> tuple[float, int, bool]:  # fmt: skip
    """(largest of what the equations miss, number of held rows, whether nothing is held); it is written, with the slopes."""
    n, e, held, miss = len(g), len(b), 0, 0.0
    _answer_of_X(H, g, A, C, x, y, z, off)
    free = _projected(x - off[:n], lower, upper, cones, mu, inside, single, V)
    loose[:] = 0.0
    for i in range(n):
        off[i] = x[i] - inside[i]
    for k in range(e):
        off[n + k] = -b[k]
        for i in range(n):
            off[n + k] += A[k, i] * x[i]
    for k in range(len(low)):
        s = 0.0
        for i in range(n):
            s += C[k, i] * x[i]
        t = s - z[k]
        off[n + e + k] = s - min(max(t, low[k]), high[k])
        if t <= low[k] or t >= high[k]:
            rows[held] = k
            held += 1
        elif z[k] != 0.0:
            for i in range(n):
                loose[i] += z[k] * C[k, i]
    for each in off:
        miss = max(miss, abs(each)) if math.isfinite(each) else math.inf
    return miss, held, free and held == 0


def _newton(
    H: Array, g: Array, A: Array, b: Array, C: Array, low: Array, high: Array, lower: Array, upper: Array, cones: Array,
    mu: Array, met: float, fresh: bool, x: Array, y: Array, z: Array,
) -> int:  # fmt: skip
    """Steps from (x, y, z) to the minimiser, which is written there; -1 where they do not end at a miss of rounding.

    Args:
        H: Of `Conic`, as are the next ten.
        g: As there.
        A: As there.
        b: As there.
        C: As there.
        low: As there.
        high: As there.
        lower: As there.
        upper: As there.
        cones: As there.
        mu: As there.
        met: A miss up to this is rounding.
        fresh: Begin at the minimiser of the equations alone.
        x: Shape (n,).
        y: Multipliers of the equations, shape (e,).
        z: Of the rows, shape (q,).
    """
    n, e, q = len(g), len(b), len(low)
    size = n + e + q
    K, right, off, loose = np.empty((size, size)), np.empty(size), np.zeros(size), np.zeros(n)
    inside, single, V, rows = np.empty(n), np.ones(n), np.zeros((len(mu), 3, 3)), np.zeros(q, np.int64)
    best_x, best_y, best_z, best, found = x.copy(), y.copy(), z.copy(), math.inf, 0
    if fresh:
        V[:, 0, 0], V[:, 1, 1], V[:, 2, 2] = 1.0, 1.0, 1.0
        off[:n], off[n : n + e] = g, -b
        m = _system(H, A, C, cones, single, V, rows, 0, off, loose, K, right)
        if not eliminate(K, right, m):
            return -1
        x[:], y[:] = right[:n], right[n:m]
    for count in range(NEWTON_STEPS + 1):
        miss, held, free = _missed(
            H, g, A, b, C, low, high, lower, upper, cones, mu, x, y, z, off, inside, single, V, rows, loose
        )  # fmt: skip
        if miss <= _ROUNDING or (fresh and count == 0 and free and miss <= met):
            x[:] = inside
            return count
        if miss < best or count == 0:
            best, found, best_x[:], best_y[:], best_z[:] = miss, count, x, y, z
        if count == NEWTON_STEPS or not miss < 1e3 * max(best, 1.0) or (best <= met and count > found + 1):
            break
        m = _system(H, A, C, cones, single, V, rows, held, off, loose, K, right)
        if not eliminate(K, right, m):
            _system(H, A, C, cones, single, V, rows, held, off, loose, K, right)
            right[:m] = _least_squares(K[:m, :m].copy(), right[:m].copy())
        x += right[:n]
        y += right[n : n + e]
        at = 0
        for k in range(q):
            if at < held and rows[at] == k:
                z[k] += right[n + e + at]
                at += 1
            else:
                z[k] = 0.0
    y[:], z[:] = best_y, best_z
    _projected(best_x, lower, upper, cones, mu, x, single, V)
    miss, _, _ = _missed(H, g, A, b, C, low, high, lower, upper, cones, mu, x, y, z, off, inside, single, V, rows, loose)
    return found if miss <= met else -1


newton = compiled(
    _newton,
    signature(
        COUNT, array(2), array(1), array(2), array(1), array(2), *[array(1)] * 4, array(2, COUNT), array(1), NUMBER, FLAG,
        *[array(1, written=True)] * 3,
    ),
)  # fmt: skip
