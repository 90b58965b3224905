"""Semismooth Newton on sparse problems of contact: hundreds of contacts between many bodies, under Coulomb's law.

    find w in the product of the parts, y = D w + q paired with it:  w = P(w - y)

as in `rbd.solvers.newton`, with a D that has few entries: two contacts are coupled only where they share a body. First come
single columns between bounds, then cones of d columns each: discs of radius mu times the normal force, and the normal last.
(t, n) is a contact in the plane, (t, t, n) one in space, (t, t, m, m, n) one that resists rolling by a second disc.

Gauss-Seidel over the contacts finds which are open, stick and slip [Jourdan1998]; Newton's method then ends at rounding. Where
contacts are redundant D is singular, and Newton is applied to D + k 1 about the weights before (the proximal-point method),
whose answers tend to one of the problem itself.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from rbd.arrays import Array, max_abs
from rbd.solvers.newton import Scaled

EXACT = 1e-14
FOUND = 1e-13
"""Largest entry of |w - P(w - y)|, over the largest weight and 1, of an answer."""
_ROUNDS = 8
_SWEEPS = 200
_STARTS = 8
_MOST_SWEEPS = 4000
"""Of `_SMALL` columns or more: Newton's method is not called while 4,000 more sweeps, at their last rate, would do."""
_SMALL = 1000
_PROXIMAL = 1e-9
_PROXIMAL_ROUNDS = 20
_COMPLIANCE = 1e-3
_FAILURES = 3
_FOLLOWS = 1e-3
"""A step of the proximal-point method is taken where Newton's gap falls below this times the merit."""
_IDLE = 6
"""Newton's steps that do not reduce the gap, after which they stop."""


@dataclass(frozen=True, eq=False)
class SparseProblem:
    """The problem of y = D w + q, scaled so that each part's largest diagonal entry of D is one and max |q| is one.

    Attributes:
        D: Shape (p, p), scipy.sparse.csr_array.
        q: Shape (p,).
        lower: Bounds of the n single columns.
        upper: Their upper bounds.
        mu: Frictions of the discs of each cone, shape (k, 2); the second is unused where there is one disc.
        unit: Weights are `unit` times scaled weights, shape (p,).
    """

    D: Any
    q: Array
    lower: Array
    upper: Array
    mu: Array
    unit: Array

    @classmethod
    def of(cls, D: Any, q: Array, mu: Array, lower: Array | None = None, upper: Array | None = None) -> SparseProblem:
        """The scaled problem.

        Args:
            D: Accelerations of unit weights, sparse, shape (p, p).
            q: Accelerations without weights, shape (p,).
            mu: Shape (k, 2).
            lower: Bounds of the singles; None: there are none.
            upper: Upper bounds.
        """
        from scipy.sparse import csr_array, diags_array

        lower, upper = (np.zeros(0) if x is None else x for x in (lower, upper))
        n, k, size = len(lower), len(mu), np.abs(D.diagonal())
        size[n:] = np.repeat(size[n:].reshape(k, -1).max(axis=1, initial=0.0), (len(q) - n) // max(k, 1))
        s = 1.0 / np.sqrt(np.maximum(size, 1e-12 * max_abs(size) or 1.0))
        lower, upper = lower / s[:n], upper / s[:n]
        rate = max(max_abs(s * q), lower.max(initial=0.0), (-upper).max(initial=0.0)) or 1.0  # forces far from zero
        scaled = csr_array(diags_array(s) @ D @ diags_array(s))
        scaled.sort_indices()
        return cls(scaled, s * q / rate, lower / rate, upper / rate, mu, s * rate)

    @classmethod
    def of_scaled(cls, problem: Scaled) -> SparseProblem:
        """The same as a dense problem that is scaled already, in its order."""
        from scipy.sparse import csr_array

        mu = np.column_stack([problem.order.mu] * 2)
        return cls(csr_array(problem.D), problem.q, problem.lower, problem.upper, mu, problem.unit)

    def gap(self, w: Array, y: Array) -> tuple[Array, Array]:
        """(P(w - y) - w, slopes of P: 1 or 0 of each single and a block of each cone, shape (n + k d^2,))."""
        n, k, p = len(self.lower), len(self.mu), w - y
        out = np.minimum(np.maximum(p[:n], self.lower), self.upper)
        C = p[n:].reshape(k, -1)
        d = C.shape[1]
        N, O, V = np.maximum(C[:, -1], 0.0), np.empty_like(C), np.zeros((k, d, d))
        O[:, -1], V[:, -1, -1] = N, C[:, -1] > 0.0
        for at in range(0, d - 1, 2):
            disc = slice(at, min(at + 2, d - 1))
            T, mu = C[:, disc], self.mu[:, at // 2]
            t = np.maximum(np.sqrt((T * T).sum(axis=1)), 1e-200)
            e, factor = T / t[:, None], np.minimum(mu * N / t, 1.0)
            slips = factor < 1.0
            O[:, disc] = factor[:, None] * T
            V[:, disc, disc] = factor[:, None, None] * (np.eye(T.shape[1]) - slips[:, None, None] * e[:, :, None] * e[:, None])
            V[:, disc, -1] = (mu * slips * (N > 0.0))[:, None] * e
        inside = (p[:n] > self.lower) & (p[:n] < self.upper)
        return np.concatenate([out, O.ravel()]) - w, np.concatenate([inside, V.ravel()])

    def merit(self, w: Array) -> float:
        """Largest entry of |w - P(w - y)|, over the largest weight and 1."""
        return max_abs(self.gap(w, self.D @ w + self.q)[0]) / max(1.0, max_abs(w))

    def newton(
        self, w: Array, *, soft: float = 0.0, proximal: float = _PROXIMAL, iterations: int = 30
    ) -> tuple[Array, float, int]:
        """(weights, largest entry of their gap, steps) of damped steps, parts yielding by `soft` times what w changes by."""
        from scipy.sparse import block_array, bsr_array, csc_array, diags_array, eye_array
        from scipy.sparse.linalg import splu

        n, k, about = len(self.lower), len(self.mu), w
        d, identity = (len(w) - n) // max(k, 1), eye_array(len(w), format="csr")
        shifted = self.D + (soft + proximal - 1.0) * identity
        gap, slopes = self.gap(w, self.D @ w + self.q)
        best, least, step, idle = w, max_abs(gap), 0, 0
        while step < iterations and idle < _IDLE and least > EXACT * max(1.0, max_abs(w)):
            cones = bsr_array((slopes[n:].reshape(k, d, d), np.arange(k), np.arange(k + 1)), shape=(k * d, k * d))
            V = cones if not n else block_array([[diags_array(slopes[:n]), None], [None, cones]]) if k else diags_array(slopes)
            try:
                move = splu(csc_array(identity + V @ shifted)).solve(gap)
            except RuntimeError:  # singular
                break
            if not np.isfinite(move).all():
                break
            before, t = gap @ gap, 1.0
            for _ in range(7):
                new = w + t * move
                gap, slopes = self.gap(new, self.D @ new + self.q + soft * (new - about))
                if gap @ gap <= before * (1.0 - 1e-4 * t):
                    break
                t *= 0.5
            w, step, idle = new, step + 1, idle + 1
            if max_abs(gap) < least:
                best, least, idle = w, max_abs(gap), 0
            elif before < 1e-22:  # rounding
                break
        return best, least, step

    def sweeps(self, w: Array, count: int) -> Array:
        """Weights after Gauss-Seidel sweeps."""
        from rbd.solvers.sparse_newton_kernel import sweeps

        n, k, D = len(self.lower), len(self.mu), self.D
        d = (len(w) - n) // max(k, 1)
        row, column = np.repeat(np.arange(len(w)), np.diff(D.indptr)), D.indices
        own = np.where(row < n, row, (row - n) // d + n) == np.where(column < n, column, (column - n) // d + n)
        sums = np.bincount(row[own], np.abs(D.data[own]), len(w))  # Gershgorin
        rates = np.concatenate([sums[:n], sums[n:].reshape(k, -1).max(axis=1, initial=0.0)])
        out = w.copy()
        sweeps(
            D.indptr.astype(np.int64), D.indices.astype(np.int64), D.data, self.q, 1.0 / np.maximum(rates, 1e-12),
            self.lower, self.upper, np.ascontiguousarray(self.mu), out, count,
        )  # fmt: skip
        return out


def solve_sparse(problem: SparseProblem, w: Array | None = None) -> tuple[Array, float, int]:
    """(scaled weights, merit, Newton's steps): the best found from a guess, zero by default; of few columns from others, too.

    Args:
        problem: The scaled problem.
        w: Where to start, shape (p,).
    """
    best, least, steps = _from(problem, np.zeros(len(problem.q)) if w is None else w)
    rng = np.random.default_rng(0)
    for _ in range(_STARTS if len(best) < _SMALL else 0):
        if least <= FOUND:
            break
        found, merit, more = _from(problem, rng.normal(scale=max(1.0, max_abs(best)), size=len(best)))
        steps += more
        if merit < least:
            best, least = found, merit
    return best, least, steps


def _from(problem: SparseProblem, w: Array) -> tuple[Array, float, int]:
    """The same from one start: rounds of sweeps and steps, each with twice the sweeps of the one before."""
    best, least, steps = w, problem.merit(w), 0
    for i in range(_ROUNDS):
        count = _SWEEPS << i
        before, w = problem.merit(w), problem.sweeps(w, count)
        found = w, problem.merit(w), 0
        falls = math.log(max(before, FOUND) / max(found[1], FOUND)) / count  # a sweep
        if len(w) < _SMALL or math.log(max(found[1], FOUND) / FOUND) > _MOST_SWEEPS * falls:
            found = problem.newton(w)
            if problem.merit(found[0]) > FOUND:
                found = _by_proximal_points(problem, w)
        steps += found[2]
        merit = problem.merit(found[0])
        if merit < least:
            best, least = found[0], merit
            w = best
        if least <= FOUND:
            break
    return best, least, steps


def _by_proximal_points(problem: SparseProblem, w: Array) -> tuple[Array, float, int]:
    """(the best weights, merit, steps) of the proximal-point method: compliance falls where Newton follows, else it rises."""
    best, least, steps, compliance, failures = w, problem.merit(w), 0, _COMPLIANCE, 0
    for _ in range(_PROXIMAL_ROUNDS):
        new, gap, more = problem.newton(w, soft=compliance, proximal=0.0)
        steps += more
        if gap <= max(_FOLLOWS * problem.merit(w), 10.0 * FOUND) * max(1.0, max_abs(w)):
            w, compliance = new, max(0.1 * compliance, _PROXIMAL)
            merit = problem.merit(w)
            if merit < least:
                best, least = w, merit
            if least <= FOUND:
                break
        else:
            compliance, failures = 10.0 * compliance, failures + 1
            if failures > _FAILURES:
                break
    return best, least, steps
