"""The closed form for bilateral constraints, and for contacts that stick if their force sets allow it."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace

import numpy as np

from rbd.arrays import RANK, Array, blas, lapack, max_abs
from rbd.displayed import Displayed
from rbd.problem.answer import Answer
from rbd.problem.force_set import ForceSet, at_rest
from rbd.problem.gauss_problem import BILATERAL, GaussProblem, Law, checked
from rbd.problem.residuals import SOLVED
from rbd.solvers.refinement import refined

_DAMPING = 1e-7
"""Regularisation for redundant rows, over the largest diagonal entry of D; each round reduces the residual to this share."""
_TO_AND_FRO = 4
"""Alternating projections tried; where contacts slip, more of them do not help."""
_ROUNDS = 6


@dataclass(frozen=True)
class KKT(Displayed):
    """Solver of bilateral constraints in closed form: f = -(J M^-1 J^T)^+ (J a_free + offset), a = a_free + M^-1 J^T f.

    For bilateral constraints. Where rows are redundant f has minimum norm, and where they contradict each other a is
    the least-squares one, with residuals that show it.

    Source: Lagrange's stationarity M (a - a_free) - J^T f = 0 with J a + J_dot v = 0;
    `docs/courses/least_constraint/multipliers.md`.

    Example:
        >>> robot = rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0)
        >>> solution = rbd.solve(robot.at("assembled"), [5.0], robot.loops(), solver=rbd.KKT())
        >>> print(solution.status, solution.method, solution.a.round(3))
        solved closed form [ 4.13  -4.917  1.045]
    """

    law: Law = BILATERAL

    def reason_unsupported(self, problem: GaussProblem) -> str | None:
        """Names the first constraint that can break or slip."""
        if checked(problem).bilateral:
            return None
        bad = next(r for r in problem.rows if not at_rest(r.cone).bilateral)
        return (
            f"KKT takes bilateral constraints, and {bad.name!r} has forces in a {type(bad.cone).__name__}. "
            "Leave out solver=, or take friction=None for a bilateral contact."
        )

    def solve(self, problem: GaussProblem) -> Answer:
        """The closed form; by Cholesky where the rows are independent, else by singular values."""
        start = time.perf_counter()
        P = checked(problem)
        infeasible = repeats = False
        if not P.m:
            a, f = P.a_free.copy(), np.zeros(0)
        else:
            c = P.free_row_acceleration
            R = independent_factor(P.delassus)
            if R is not None:
                f = -lapack.dpotrs(R, c)[0]
            else:
                repeats = True
                f, missed = _minimum_norm(P.whitened, c)
                infeasible = missed > 1e-6 * max(1.0, float(np.abs(c).max()))
            a = constrained(P, f)
        seconds = time.perf_counter() - start
        found = Answer(P, a, f, None, BILATERAL, "KKT", 1, seconds, infeasible, redundant=repeats, method="closed form")
        if not (infeasible or found.residuals.within(SOLVED)):
            found = replace(held_refined(found), seconds=time.perf_counter() - start)
        return found


def held_refined(found: Answer) -> Answer:
    """`refined` for bilateral rows, scaled to equal size, so that rows of light bodies count like those of heavy ones."""
    P = found.problem
    size = np.sqrt(np.maximum(P.delassus.diagonal(), 1e-300))
    W = P.whitened / size

    def correct(c: Array, f: Array) -> Array:
        return np.asarray(_minimum_norm(W, c / size)[0] / size)

    return refined(found, correct)


def independent_factor(delassus: Array) -> Array | None:
    """Upper R with R^T R = delassus, or None where its pivots show that rows depend on each other."""
    R, info = lapack.dpotrf(delassus, lower=0, clean=1)
    if info != 0:
        return None
    # Pivots are bounded below by the least singular value of W; 1e-5 leaves ten digits to f, else the SVD takes over.
    pivots = R.diagonal().tolist()
    if min(pivots) > 1e-5 * max(pivots):
        return R
    # For rows of very different size (light and heavy bodies): the sine of each row's angle to those before it.
    return R if (R.diagonal() > 1e-5 * np.sqrt(delassus.diagonal())).all() else None


def _minimum_norm(W: Array, c: Array) -> tuple[Array, float]:
    """(f, missed): minimum-norm least-squares f of W^T W f = -c, and the residual."""
    if not len(c):
        return np.zeros(0), 0.0
    _, s, Vt = np.linalg.svd(W, full_matrices=False)
    kept = s > RANK * s[0]
    Vt, s = Vt[kept], s[kept]
    along = Vt @ c
    return -Vt.T @ (along / s**2), float(np.abs(c - Vt.T @ along).max())


def constrained(P: GaussProblem, f: Array) -> Array:
    """A = a_free + M^-1 J^T f."""
    return P.a_free + blas.dtrsv(P.factor, P.whitened @ f, lower=1, trans=1)


class StickingSolver:
    """Force sets whose weights are the row impulses: can they bring every row to rest?

    Args:
        parts: The sets; G is the identity.
    """

    def __init__(self, parts: ForceSet) -> None:
        self._bounded = np.flatnonzero(np.isfinite(parts.lower) | np.isfinite(parts.upper))
        self._lower, self._upper = parts.lower[self._bounded], parts.upper[self._bounded]
        self._cones = parts.cone_columns.ravel()
        self._all_cones = np.array_equal(self._cones, np.arange(parts.size))
        self._mu = parts.mu

    def shortest_or_near(self, D: Array, u: Array, guess: Array, exact: float) -> tuple[Array, float, bool] | None:
        """(impulses, error, whether they are of least norm): those of `impulses` from zero, else those from the guess."""
        factor = self._damped_factor(D)
        if factor is None:
            return None
        found = self.impulses(D, u, np.zeros(len(u)), exact, others=False, factor=factor)
        if found is not None:
            return *found, True
        found = self.impulses(D, u, guess, exact, factor=factor)
        return None if found is None else (*found, False)

    def _damped_factor(self, D: Array) -> tuple[Array, float] | None:
        """(upper factor of D + k 1, root of the largest diagonal entry of D over the least); None where there is none."""
        sizes = [size for size in D.diagonal().tolist() if size > 0.0]  # a row with D_ii = 0, as in a plane, is at rest
        if not sizes:
            return None
        top, damped = max(sizes), D.copy()
        damped.ravel()[:: len(D) + 1] += _DAMPING * top
        R, info = lapack.dpotrf(damped, lower=0, clean=0)
        return None if info != 0 else (R, math.sqrt(top / min(sizes)))

    def impulses(
        self, D: Array, u: Array, guess: Array, exact: float, *, others: bool = True, factor: tuple[Array, float] | None = None
    ) -> tuple[Array, float] | None:
        """(impulses w, how far D w + u is from zero, scaled), or None if no row impulses near the guess bring all rows to rest.

        With redundant rows it is the answer nearest to the guess, in the Euclidean norm: by Newton's steps with
        D + k 1, k small, in place of D.

        Args:
            D: Row velocities of unit impulses, shape (m, m).
            u: Row velocities without impulses, shape (m,).
            guess: Where to start, shape (m,).
            exact: Tolerance of an answer, over the largest of u, in units where each diagonal entry of D is one.
            others: Whether to search farther from the guess where the nearest answer is outside the sets.
            factor: That of D, if it is known.
        """
        rate, factor = max_abs(u), factor or self._damped_factor(D)
        if factor is None or rate == 0.0:
            return None
        (R, ratio), w, missed = factor, guess, D @ guess + u
        unit = ratio / rate  # an upper bound: of the scaled error, over the largest entry of `missed`
        last = False
        for i in range(_ROUNDS):
            w = w - lapack.dpotrs(R, missed)[0]
            if i == 0 and not self._allow(w):  # near enough to decide
                other = self._allowed(w, R, D, u) if others else None
                if other is None:
                    return None
                w = other
            missed = D @ w + u
            merit = unit * max_abs(missed)
            if merit <= exact and (others or last):  # from zero one more round, to rounding: a body at rest must not creep
                return (w, merit) if i == 0 or self._allow(w) else None
            last = merit <= exact
        return None

    def _allowed(self, w: Array, R: Array, D: Array, u: Array) -> Array | None:
        """Other impulses in their sets that bring all rows to rest, by alternating projections; None if not found soon.

        Four corners share a load redundantly: if the nearest distribution pulls at one corner, another does not.
        """
        if not self._all_cones:
            return None
        for _ in range(_TO_AND_FRO):
            x, y, n = w.reshape(-1, 3).T
            pushes = np.maximum(n, 0.01 * (np.add.reduce(np.abs(n)) / len(n)))
            shrink = np.minimum(0.99 * self._mu * pushes / np.maximum(np.hypot(x, y), 1e-300), 1.0)
            inside = np.empty(len(w))
            inside[0::3], inside[1::3], inside[2::3] = shrink * x, shrink * y, pushes
            w = inside - lapack.dpotrs(R, D @ inside + u)[0]
            if self._allow(w):
                return w
        return None

    def _allow(self, w: Array) -> bool:
        """Whether impulses are in their sets."""
        if self._cones.size:
            x, y, n = (w if self._all_cones else w[self._cones]).reshape(-1, 3).T
            # Where n is negative the comparison is false, as it must be.
            if not (np.hypot(x, y) <= self._mu * n).all():
                return False
        if self._bounded.size:
            some = w[self._bounded]
            return bool(((self._lower <= some) & (some <= self._upper)).all())
        return True
