"""Compiled: Newton's method on the equations of `rbd.problem.conic`.

    d off = [(I - V) + V H, -V A^T, -V C^T; A, 0, 0; (I - D) C, 0, D]

with V and D the slopes of the projections on X and on the rows' bounds. Where a row is between its bounds, z becomes 0, and its
equation is left out. And Newton's method on the dual, of `rbd.solvers.conic_newton.by_dual`.
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


DUAL_STEPS = 60
_DONE = 1e-13
"""Largest |A x - b|, over its terms, at a solution of `by_dual`."""
_LARGEST = 1e4
"""Largest terms of A^T y, over those of the objective's gradient, at a solution: rounding then stays below 1e-12."""
_DAMPED = 1e-14
"""Added to the derivative's diagonal, over its largest entry."""


@compiled
def _dual_at(
    A: Array, b: Array, d: Array, c: Array, lower: Array, upper: Array, cones: Array, mu: Array, y: Array, x: Array,
    single: Array, V: Array,
) -> tuple[Array, float]:  # fmt: skip
    """(A x - b, the dual value, which is maximised) of multipliers; x and the slopes are written."""
    p = -c
    add_transposed(A, y, p)
    projected(p / d, lower, upper, cones, mu, x, single, V)
    over, value = -b, 0.0
    add_product(A, x, over)
    for j in range(len(x)):
        value += (0.5 * d[j] * x[j] + c[j]) * x[j]
    for r in range(len(y)):
        value -= y[r] * over[r]
    return over, value


def _by_dual(
    A: Array, b: Array, d: Array, c: Array, lower: Array, upper: Array, cones: Array, mu: Array, most: int, x: Array, y: Array
) -> int:
    """Steps from y to the multipliers of the minimiser x, which are written; -1 where they do not end.

    Args:
        A: Of `Conic`, as are b and the bounds and cones.
        b: As there.
        d: Diagonal of H, above zero and equal within a cone.
        c: The g there.
        lower: As there.
        upper: As there.
        cones: As there.
        mu: As there.
        most: Largest number of steps.
        x: Shape (n,).
        y: Shape (e,).
    """
    e, n = A.shape
    magnitude, W, top, largest = np.abs(A), np.empty((e, n)), 0.0, 1.0 + most_of(b)
    for r in range(e):
        top = max(top, (A[r] * A[r] / d).sum())
    if not top < 1e150:
        return -1
    single, V, next_x, next_single, next_V = (
        np.empty(n),
        np.zeros((len(mu), 3, 3)),
        np.empty(n),
        np.empty(n),
        np.zeros((len(mu), 3, 3)),
    )
    over, value = _dual_at(A, b, d, c, lower, upper, cones, mu, y, x, single, V)
    for count in range(most + 1):
        miss, terms = most_of(over), np.zeros(e)
        add_product(magnitude, np.abs(x), terms)
        if miss <= _DONE * max(most_of(terms), most_of(b)):
            # In a set without an interior y diverges, and rounding of y A dominates what is projected.
            terms = np.zeros(n)
            add_transposed(magnitude, np.abs(y), terms)
            return count if most_of(terms) <= _LARGEST * max(most_of(c), most_of(d * x)) else -1
        W[:] = A * (single / d)
        for k in range(len(mu)):
            i = cones[k]
            for r in range(e):
                for s in range(3):
                    W[r, i[s]] = (A[r, i[0]] * V[k, 0, s] + A[r, i[1]] * V[k, 1, s] + A[r, i[2]] * V[k, 2, s]) / d[i[s]]
        J, step, slope = W @ A.T, -over, 0.0
        # Where many bounds are active the derivative is singular, or zero: the damping then gives an ascent step.
        for r in range(e):
            J[r, r] += max(_DAMPED, min(1e-3, 1e-3 * miss / largest)) * top
        if count == most or not eliminate(J, step, e):
            return -1
        for r in range(e):
            slope -= over[r] * step[r]
        t = 1.0
        while True:
            over, found = _dual_at(A, b, d, c, lower, upper, cones, mu, y + t * step, next_x, next_single, next_V)
            # Near convergence the value's change is rounding; then the residual of the equations decides.
            if found >= value + 1e-4 * t * slope or most_of(over) <= 0.5 * miss:
                break
            t *= 0.5
            if t < 1e-9:
                return -1
        y += t * step
        value, x[:], single[:], V[:] = found, next_x, next_single, next_V
    return -1


by_dual = compiled(
    _by_dual,
    signature(
        COUNT, array(2), *[array(1)] * 5, array(2, COUNT), array(1), COUNT, array(1, written=True), array(1, written=True)
    ),
)  # fmt: skip
