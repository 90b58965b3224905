"""Compiled: Newton's method on the equations of `rbd.problem.conic`.

    d off = [(I - V) + V H, -V A^T, -V C^T; A, 0, 0; (I - D) C, 0, D]

with V and D the slopes of the projections on X and on the rows' bounds. Where a row is between its bounds, z becomes 0, and its
equation is left out.
"""

from __future__ import annotations

import math

import numpy as np

from rbd.arrays import Array
from rbd.kernels import COUNT, FLAG, array, compiled, signature
from rbd.solvers.newton_kernel import project
from rbd.solvers.small_systems import add_product, add_transposed, eliminate

NEWTON_STEPS = 12
"""Of Newton's method, before Clarabel is asked."""
MET = 1e-11
"""A miss up to this is rounding, of numbers around one; where H has larger entries, 1e-14 of these."""
_ROUNDING = 1e-13  # of numbers around one


@compiled
def most_of(x: Array) -> float:
    """Largest absolute entry, zero of none; infinite where one is not finite."""
    most = 0.0
    for each in x:
        most = max(most, abs(each)) if math.isfinite(each) else math.inf
    return most


@compiled
def projected(p: Array, lower: Array, upper: Array, cones: Array, mu: Array, inside: Array, single: Array, V: Array) -> bool:
    """Write the projection of p on X, the slope of each entry outside of cones, and those of cones; whether nothing holds p."""
    inside[:] = np.minimum(np.maximum(p, lower), upper)
    single[:] = np.where(inside == p, 1.0, 0.0)
    free = bool((inside == p).all())
    for k in range(len(mu)):
        i, j, l = cones[k]
        normal, factor, t = project(p[i], p[j], p[l], mu[k], False)
        inside[i], inside[j], inside[l] = factor * p[i], factor * p[j], normal
        x, y, share, along, spread = p[i] / t, p[j] / t, factor, 0.0, 0.0
        if factor < 1.0 and normal > 0.0:
            share = 1.0 / (1.0 + mu[k] * mu[k])
            along, spread = mu[k] * share, 1.0 - share - factor
        V[k, 0, 0], V[k, 1, 1], V[k, 2, 2] = factor + spread * x * x, factor + spread * y * y, share
        V[k, 0, 1] = V[k, 1, 0] = spread * x * y
        V[k, 0, 2] = V[k, 2, 0] = along * x
        V[k, 1, 2] = V[k, 2, 1] = along * y
        free = free and share == 1.0
    return free


@compiled
def _missed(
    H: Array, g: Array, A: Array, b: Array, C: Array, low: Array, high: Array, lower: Array, upper: Array, cones: Array,
    mu: Array, x: Array, y: Array, z: Array, off: Array, inside: Array, single: Array, V: Array, held: Array,
) -> tuple[float, bool]:  # fmt: skip
    """(largest of what the equations miss, whether nothing is held); it is written, with the slopes and which rows are held."""
    n, e = len(g), len(b)
    r, missed, s = off[:n], off[n : n + e], off[n + e :]
    r[:], missed[:], s[:] = g, -b, 0.0
    add_product(H, x, r)
    add_transposed(A, -y, r)
    add_transposed(C, -z, r)
    free = projected(x - r, lower, upper, cones, mu, inside, single, V)
    r[:] = x - inside
    add_product(A, x, missed)
    add_product(C, x, s)
    t = s - z
    held[:] = (t <= low) | (t >= high)
    s -= np.minimum(np.maximum(t, low), high)
    return most_of(off), free and not held.any()


@compiled
def _system(
    H: Array, A: Array, C: Array, cones: Array, single: Array, V: Array, rows: Array, off: Array, loose: Array
) -> tuple[Array, Array]:
    """Newton's matrix and right-hand side, of some held rows; `loose` is C^T of the z that become zero."""
    (e, n), E = A.shape, np.concatenate((A, C[rows]))
    m, own = n + len(E), single.reshape((-1, 1))
    K, right = np.zeros((m, m)), np.concatenate((-off[:n] - single * loose, -off[n : n + e], -off[n + e :][rows]))
    K[:n, :n], K[:n, n:], K[n:, :n] = H * own, -E.T * own, E
    for i in range(n):
        K[i, i] += 1.0 - single[i]
    for k in range(len(cones)):
        S = V[k]
        for c in range(m):
            x, y, z = (H[cones[k, 0], c], H[cones[k, 1], c], H[cones[k, 2], c]) if c < n else (
                -E[c - n, cones[k, 0]], -E[c - n, cones[k, 1]], -E[c - n, cones[k, 2]]
            )  # fmt: skip
            for a in range(3):
                K[cones[k, a], c] = S[a, 0] * x + S[a, 1] * y + S[a, 2] * z
        for a in range(3):
            i = cones[k, a]
            right[i] = -off[i]
            for d in range(3):
                K[i, cones[k, d]] += (1.0 if a == d else 0.0) - S[a, d]
                right[i] -= S[a, d] * loose[cones[k, d]]
    return K, right


@compiled
def _solved(K: Array, right: Array) -> Array:
    """K^-1 right; of least squares where K is singular, NaN where that is not found."""
    x, U = right.copy(), K.copy()
    if not eliminate(U, x, len(x)):
        try:
            x = np.ascontiguousarray(np.linalg.lstsq(K, right, 1e-14)[0])
        except Exception:  # the only kind that Numba knows
            x = np.full(right.shape, np.nan)
    return x


def _newton(
    H: Array, g: Array, A: Array, b: Array, C: Array, low: Array, high: Array, lower: Array, upper: Array, cones: Array,
    mu: Array, fresh: bool, x: Array, y: Array, z: Array,
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
        fresh: Begin at the minimiser of the equations alone.
        x: Shape (n,).
        y: Multipliers of the equations, shape (e,).
        z: Of the rows, shape (q,).
    """
    n, e, met = len(g), len(b), max(MET, 1e-14 * most_of(H.ravel()))
    inside, single, V, held = np.empty(n), np.ones(n), np.zeros((len(mu), 3, 3)), np.zeros(len(z), np.bool_)
    off = np.zeros(n + e + len(z))
    if fresh:
        V[:, 0, 0], V[:, 1, 1], V[:, 2, 2], off[:n], off[n : n + e] = 1.0, 1.0, 1.0, g, -b
        K, right = _system(H, A, C, cones, single, V, np.flatnonzero(held), off, np.zeros(n))
        if not eliminate(K, right, n + e):
            return -1
        x[:], y[:] = right[:n], right[n:]
    best_x, best_y, best_z, best, found = x.copy(), y.copy(), z.copy(), math.inf, 0
    for count in range(NEWTON_STEPS + 1):
        miss, free = _missed(H, g, A, b, C, low, high, lower, upper, cones, mu, x, y, z, off, inside, single, V, held)
        if miss <= _ROUNDING or (fresh and count == 0 and free and miss <= met):
            x[:] = inside
            return count
        if miss < best:
            best, found, best_x[:], best_y[:], best_z[:] = miss, count, x, y, z
        if not miss < 1e3 * max(best, 1.0) or (best <= met and count > found + 1):
            break
        rows, loose = np.flatnonzero(held), np.zeros(n)
        add_transposed(C, np.where(held, 0.0, z), loose)
        step = _solved(*_system(H, A, C, cones, single, V, rows, off, loose))
        x += step[:n]
        y += step[n : n + e]
        kept = z[rows] + step[n + e :]
        z[:] = 0.0
        z[rows] = kept
    y[:], z[:] = best_y, best_z
    projected(best_x, lower, upper, cones, mu, x, single, V)
    miss, _ = _missed(H, g, A, b, C, low, high, lower, upper, cones, mu, x, y, z, off, inside, single, V, held)
    return found if miss <= met else -1


newton = compiled(
    _newton,
    signature(
        COUNT, array(2), array(1), array(2), array(1), array(2), *[array(1)] * 4, array(2, COUNT), array(1), FLAG,
        *[array(1, written=True)] * 3,
    ),
)  # fmt: skip
