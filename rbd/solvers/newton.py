"""Semismooth Newton on the complementarity problem of weights and accelerations, for both contact laws.

    find w in the product of the parts, y = D w + y_free paired with it:  w = P(w - y)

P is the projection on the parts for the convex law. For Coulomb's it is Alart and Curnier's: a normal weight N = max(p_n, 0),
and the tangential one cut to the disc of radius mu N, so that De Saxce's term need not be written. D may be
nonsymmetric (points that slide) and singular (corners of a sole); this module knows no robots.

Sources: [Alart1991] for the map of Coulomb's law; [Qi1993] for Newton on semismooth maps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, lru_cache
from types import ModuleType

import numpy as np

from rbd.arrays import Array, identity, zeros
from rbd.problem.cones import ConeProjection, projection
from rbd.problem.conic import Conic, Unknowns
from rbd.problem.force_set import ForceSet

PROXIMAL = 1e-7
"""Added to the diagonal of the scaled D in Newton's matrix only, so that redundant corners leave it regular."""
EXACT = 1e-14
"""Newton stops at this scaled merit; about a hundred times rounding."""
FOUND = 1e-10
"""Largest scaled merit of an answer."""


@dataclass(frozen=True, eq=False)
class Order:
    """Order of the columns of `ForceSet` in Newton's method: lines and intervals first, then cones, three columns each.

    Attributes:
        columns: Index in `ForceSet` of each column, shape (p,); None where the order is the same.
        singles: Number of lines, half-lines and intervals.
        lower: Their bounds, shape (singles,).
        upper: Upper bounds, shape (singles,).
        mu: Friction of the cones, shape (k,).
        share: 1 / (1 + mu^2).
        identity: Entries of the columns of the identity near its diagonal, from row `first` of each set on, shape (p, 1 or 3).
        first: First columns of the sets, in the new order, shape (singles + k,).
    """

    columns: Array | None
    singles: int
    lower: Array
    upper: Array
    mu: Array
    share: Array
    identity: Array
    first: Array


@lru_cache(maxsize=256)  # orders of parts at rest are cached by their rows' sets; those of moving rows change
def order_of(parts: ForceSet) -> Order:
    """The order of a problem's columns."""
    in_cones = parts.cone_columns.ravel()
    alone = np.setdiff1d(np.arange(parts.size), in_cones)
    mu, lower, upper = (np.asarray(x, dtype=float) for x in (parts.mu, parts.lower[alone], parts.upper[alone]))
    columns, singles, k = np.concatenate([alone, in_cones]).astype(int), len(alone), len(parts.mu)
    wide = 3 if k else 1
    first = np.minimum(np.r_[np.arange(singles), singles + 3 * np.arange(k)], max(parts.size - wide, 0))
    identity = np.zeros((parts.size, wide))
    at = np.arange(parts.size)
    identity[at, at - np.r_[first[:singles], np.repeat(first[singles:], 3)]] = 1.0
    moved = None if np.array_equal(columns, at) else columns
    return Order(moved, singles, lower, upper, mu, 1.0 / (1.0 + mu * mu), identity, first)


@dataclass(frozen=True, eq=False)
class Scaled:
    """The scaled problem: each part's diagonal of D is one, accelerations and bounds are of order one.

    Attributes:
        D: Shape (p, p), in the order of `order`.
        q: Free accelerations, shape (p,).
        order: The order of the columns.
        lower: Scaled bounds of the singles.
        upper: Scaled upper bounds of the singles.
        unit: Weights are `unit` times scaled weights, in the order of `order`, shape (p,).
        rate: Largest free acceleration of a scaled row: scaled accelerations are y unit / rate^2.
    """

    D: Array
    q: Array
    order: Order
    lower: Array
    upper: Array
    unit: Array
    rate: float

    def weights(self, w: Array) -> Array:
        """Weights in the order and units of `ForceSet`, from scaled ones."""
        out = self.unit * w
        if self.order.columns is None:
            return out
        back = np.empty_like(out)
        back[self.order.columns] = out
        return back

    @property
    def dense(self) -> tuple[Array, ...]:
        """What is `newton_kernel.Problem` of it."""
        order = self.order
        return (
            np.ascontiguousarray(self.D), np.ascontiguousarray(self.q), order.identity, order.first, self.lower, self.upper,
            order.mu,
        )  # fmt: skip

    def convex(self, extra: Array | float = 0.0) -> Conic:
        """The program of the convex law, 1/2 w^T D w + (q + extra)^T w, with D symmetric."""
        p, k = len(self.q), len(self.order.mu)
        lower, upper = np.full(p, -np.inf), np.full(p, np.inf)
        lower[: len(self.lower)], upper[: len(self.upper)] = self.lower, self.upper
        cones = p - 3 * k + np.arange(3 * k).reshape(k, 3)
        return Conic.of({"weights": Unknowns(p, self.D, self.q + extra, lower, upper, cones, self.order.mu)})

    def guess(self, weights: Array) -> Array:
        """Scaled weights, from those of `ForceSet`."""
        return (weights if self.order.columns is None else weights[self.order.columns]) / self.unit


def scaled(D: Array, y_free: Array, parts: ForceSet) -> Scaled:
    """The problem D, y_free, scaled."""
    order = order_of(parts)
    if order.columns is not None:
        D, y_free = D[np.ix_(order.columns, order.columns)], y_free[order.columns]
    D, q, lower, upper, unit, rate = newton_kernel().scaled(
        np.ascontiguousarray(D), np.ascontiguousarray(y_free), order.lower, order.upper
    )
    return Scaled(D, q, order, lower, upper, unit, rate)


def solve_newton(
    D: Array, y_free: Array, parts: ForceSet, w0: Array, *, coulomb: bool, iterations: int = 50
) -> tuple[Array, float, int]:
    """Weights that solve the problem of y = D w + y_free, by damped semismooth Newton steps from a guess.

    Args:
        D: Accelerations of unit weights, shape (p, p); nonsymmetric where points slide.
        y_free: Accelerations without weights, shape (p,).
        parts: The sets of the weights.
        w0: Where to start, shape (p,).
        coulomb: Coulomb's law; else the convex one.
        iterations: Largest number.

    Returns:
        (w, merit, iterations): the best weights found, in their sets to rounding; the largest entry of |w - P(w - y)| in
        the problem's units, where 1e-12 is exact for all purposes; steps taken.
    """
    problem = scaled(D, y_free, parts)
    w, merit, steps = steps_from(problem, problem.guess(w0), coulomb=coulomb, iterations=iterations)
    return parts.project(problem.weights(w)), merit, steps


def steps_from(
    problem: Scaled, w: Array, *, coulomb: bool, iterations: int = 50, proximal: float = PROXIMAL, exact: float = EXACT,
    soft: float = 0.0, about: Array | None = None,
) -> tuple[Array, float, int]:  # fmt: skip
    """`solve_newton` in the problem's units and order; points yield by `soft` times their weights less those of `about`."""
    best, about = np.array(w), zeros(len(w)) if about is None else about
    merit, step = newton_kernel().newton_steps(*problem.dense, best, coulomb, iterations, soft, about, proximal, exact)
    return best, merit, step


@cache
def newton_kernel() -> ModuleType:
    """`rbd.solvers.newton_kernel`, imported with the first problem that needs it: it imports Numba."""
    from rbd.solvers import newton_kernel

    return newton_kernel


def yielding_steps(
    problem: Scaled, w: Array, *, coulomb: bool, compliance: float = 1e-5, outer: int = 8, iterations: int = 15
) -> tuple[Array, float]:
    """Weights where rows are redundant and Newton's steps stall: (w, merit), in the problem's units and order.

    Newton on D + k 1, whose solution is unique, about the weights of the round before (the proximal-point method), so that
    the regularisation's effect falls from round to round and the limit solves the problem itself.

    Args:
        problem: The scaled problem.
        w: Where to start.
        coulomb: Coulomb's law; else the convex one.
        compliance: k, over the points' mobility: the larger, the surer each round and the more of them.
        outer: Rounds at most.
        iterations: Newton's steps in a round at most.
    """
    best, least = w, math.inf
    for _ in range(outer):
        w, reached, _ = steps_from(problem, w, coulomb=coulomb, iterations=iterations, proximal=0.0, soft=compliance, about=w)
        _, merit, _ = steps_from(problem, w, coulomb=coulomb, iterations=0)
        if not merit < least:
            break
        best, least = w, merit
        if merit <= _STALLS or reached > 1e-9:  # converged, or stalled
            break
    return best, least


def family_limit(problem: Scaled, w: Array) -> tuple[Array, int, bool]:
    """(weights, steps, whether there is a family): where an answer w of Coulomb's law leaves a family of motions, their limit.

    It does where more points slip together than determine the load: its distribution changes the friction. The limit is that of
    the answers of equally compliant points near w; w itself where Newton's method does not follow it.
    """
    limit = np.array(w)
    steps, opened = newton_kernel().family_limit(*problem.dense, limit, problem.unit[problem.order.singles :: 3].copy())
    return limit, steps, opened


def last_step(problem: Scaled, w: Array, y: Array, *, coulomb: bool) -> Array:
    """Correction of weights with the right modes, for recomputed accelerations y; not rounded to the weights.

    Newton's steps add to the weights and so stop at their last digit, and the last digit of a force of 10 N moves a
    milligram at 1e-9 m/s2. This is the change alone, of minimum norm where rows are redundant.
    """
    gap, p, edges = _gap(problem, w, y, coulomb)
    n = problem.order.singles
    gap[:n] = np.where((p[:n] > problem.lower) & (p[:n] < problem.upper), -y[:n], gap[:n])
    if len(problem.order.mu):
        x, z, _, _, pushes, slips = edges
        Y, O, mu = y[n:].reshape(-1, 3), gap[n:].reshape(-1, 3), problem.order.mu
        stuck, slip = pushes & ~slips, pushes & slips
        O[stuck] = -Y[stuck]
        if coulomb:
            O[slip, 2] = -Y[slip, 2]
        else:  # along the edge of the cone exactly; across it unchanged
            edge = np.column_stack([mu * x, mu * z, np.ones(len(mu))])[slip] * np.sqrt(problem.order.share[slip, None])
            O[slip] -= edge * (edge * (O[slip] + Y[slip])).sum(axis=1)[:, None]
    A = _matrix(problem, problem.D - identity(len(w)), p, edges, coulomb)
    from scipy.linalg import lstsq

    # Complete orthogonal factors rather than singular values: they always terminate.
    found, _, _, _ = lstsq(A, gap, cond=_RANK, lapack_driver="gelsy", check_finite=False)
    return np.asarray(found)


_RANK = 1e-13
"""Singular values of Newton's matrix below this, over the largest, are zero."""
_STALLS = 1e-11
"""Their merit does not fall much below this, of rounding."""


def _gap(problem: Scaled, w: Array, y: Array, coulomb: bool) -> tuple[Array, Array, ConeProjection]:
    """(P(p) - w, p, the projections on the cones) at p = w - y."""
    p = w - y
    n, mu = problem.order.singles, problem.order.mu
    out = np.empty(len(p))
    out[:n] = np.minimum(np.maximum(p[:n], problem.lower), problem.upper)
    x, z, pushed = p[n:].reshape(-1, 3).T
    edges = projection((x, z, pushed), mu, coulomb=coulomb)
    O = out[n:].reshape(-1, 3).T
    O[0], O[1], O[2] = edges.factor * x, edges.factor * z, edges.normal
    return out - w, p, edges


def _matrix(problem: Scaled, shifted: Array, p: Array, edges: ConeProjection, coulomb: bool) -> Array:
    """I + V (D - I), with V an element of P's generalised Jacobian."""
    n, mu, size = problem.order.singles, problem.order.mu, len(p)
    A = np.empty((size, size))
    if n:
        inside = (p[:n] > problem.lower) & (p[:n] < problem.upper)
        A[:n] = inside[:, None] * shifted[:n]
    if len(mu):
        V = edges.slopes(mu, coulomb=coulomb)
        np.matmul(V, shifted[n:].reshape(-1, 3, size), out=A[n:].reshape(-1, 3, size))
    A.flat[:: size + 1] += 1.0
    return A
