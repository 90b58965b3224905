"""Compiled: row impulses that bring rows to rest, the shortest ones or those near a guess.

    D w + u = 0,    w in its sets:    w <- w - (D + k 1)^-1 (D w + u),    k small

so that of redundant rows the answer nearest to the start, in the Euclidean norm, is found.
"""

from __future__ import annotations

import math

import numpy as np

from rbd.arrays import Array
from rbd.kernels import COUNT, FLAG, NUMBER, array, compiled, signature
from rbd.solvers.small_systems import product

_DAMPING = 1e-7
"""Regularisation for redundant rows, over the largest diagonal entry of D; each round reduces the residual to this share."""
_TO_AND_FRO = 4
"""Alternating projections tried; where contacts slip, more of them do not help."""
_ROUNDS = 6


@compiled
def _factor(D: Array, C: Array) -> float:
    """Write the lower factor of D + k 1; root of the largest diagonal entry of D over the least, zero where there is none."""
    top, least = 0.0, math.inf
    for i in range(len(D)):
        if D[i, i] > 0.0:  # a row with D_ii = 0, as in a plane, is at rest
            top, least = max(top, D[i, i]), min(least, D[i, i])
    for r in range(len(D)):
        row = C[r]
        for s in range(r + 1):
            x = D[r, s]
            for k in range(s):
                x -= row[k] * C[s, k]
            if s < r:
                row[s] = x / C[s, s]
                continue
            x += _DAMPING * top
            if not x > 0.0:
                return 0.0
            row[r] = math.sqrt(x)
    return math.sqrt(top / least)


@compiled
def _nearer(D: Array, C: Array, u: Array, w: Array, missed: Array) -> None:
    """Subtract (D + k 1)^-1 (D w + u) from w."""
    product(D, w, missed)
    for r in range(len(w)):
        t = missed[r] + u[r]
        for k in range(r):
            t -= C[r, k] * missed[k]
        missed[r] = t / C[r, r]
    for r in range(len(w) - 1, -1, -1):
        t = missed[r] / C[r, r]
        for k in range(r):
            missed[k] -= C[r, k] * t
        w[r] -= t


@compiled
def _allowed(w: Array, cones: Array, mu: Array, lower: Array, upper: Array) -> bool:
    """Whether impulses are in their sets."""
    for i in range(len(cones)):
        j = cones[i]
        # Where the normal one is negative the comparison is false, as it must be.
        if not np.hypot(w[j], w[j + 1]) <= mu[i] * w[j + 2]:
            return False
    for j in range(len(lower)):
        if not lower[j] <= w[j] <= upper[j]:
            return False
    return True


@compiled
def _other(
    D: Array, C: Array, u: Array, cones: Array, mu: Array, lower: Array, upper: Array, w: Array, missed: Array
) -> bool:  # fmt: skip
    """Other impulses in their sets that bring all rows to rest, by alternating projections; False if not found soon.

    Four corners share a load redundantly: if the nearest distribution pulls at one corner, another does not.
    """
    if 3 * len(cones) != len(w):
        return False
    for _ in range(_TO_AND_FRO):
        mean = 0.0
        for j in cones:
            mean += abs(w[j + 2]) / len(cones)
        for i in range(len(cones)):
            j = cones[i]
            push = max(w[j + 2], 0.01 * mean)
            shrink = min(0.99 * mu[i] * push / max(np.hypot(w[j], w[j + 1]), 1e-300), 1.0)
            w[j], w[j + 1], w[j + 2] = shrink * w[j], shrink * w[j + 1], push
        _nearer(D, C, u, w, missed)
        if _allowed(w, cones, mu, lower, upper):
            return True
    return False


@compiled
def _from(
    D: Array, C: Array, u: Array, ratio: float, exact: float, others: bool,
    cones: Array, mu: Array, lower: Array, upper: Array, w: Array, missed: Array,
) -> float:  # fmt: skip
    """How far D w + u is from zero, scaled, of impulses from those in w; infinite where none near them are an answer."""
    rate = np.abs(u).max()
    last = rate == 0.0
    for i in range(0 if last else _ROUNDS):
        _nearer(D, C, u, w, missed)
        if i == 0 and not _allowed(w, cones, mu, lower, upper):  # near enough to decide
            if not others or not _other(D, C, u, cones, mu, lower, upper, w, missed):
                return math.inf
        product(D, w, missed)
        merit = (
            ratio / rate * np.abs(missed + u).max()
        )  # an upper bound: of the scaled error, over the largest entry of `missed`
        if merit <= exact and (others or last):  # from zero one more round, to rounding: a body at rest must not creep
            return merit if i == 0 or _allowed(w, cones, mu, lower, upper) else math.inf
        last = merit <= exact
    return math.inf


def _holding(
    D: Array, u: Array, guess: Array, exact: float, shortest: bool, others: bool,
    cones: Array, mu: Array, lower: Array, upper: Array, w: Array,
) -> tuple[float, bool]:  # fmt: skip
    """(scaled error, whether they are the shortest) of impulses w that bring rows to rest; infinite where none are found.

    Args:
        D: Row velocities of unit impulses, shape (m, m).
        u: Row velocities without impulses, shape (m,).
        guess: Impulses to start from, shape (m,).
        exact: Tolerance of an answer, over the largest of u, in units where each diagonal entry of D is one.
        shortest: Whether to look for the shortest ones first.
        others: Whether to search farther from the guess where the nearest answer is outside the sets.
        cones: First rows of the cones, shape (k,).
        mu: Their frictions.
        lower: Bounds of all rows, shape (m,), or of none, shape (0,).
        upper: Upper bounds.
        w: Written, shape (m,).
    """
    C, missed = np.empty(D.shape), np.empty(len(u))
    ratio = _factor(D, C)
    if not 0.0 < ratio < math.inf:
        return math.inf, False
    if shortest:
        w[:] = 0.0
        merit = _from(D, C, u, ratio, exact, False, cones, mu, lower, upper, w, missed)
        if merit <= exact:
            return merit, True
    w[:] = guess
    return _from(D, C, u, ratio, exact, others, cones, mu, lower, upper, w, missed), False


_GIVEN = (array(1, COUNT), array(1), array(1), array(1), array(1, written=True))
holding = compiled(_holding, signature((NUMBER, FLAG), array(2), array(1), array(1), NUMBER, FLAG, FLAG, *_GIVEN))
