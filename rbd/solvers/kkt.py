"""The closed form for bilateral constraints, and for contacts that stick if their force sets allow it."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import cache
from types import ModuleType

import numpy as np

from rbd.arrays import RANK, Array, blas, lapack, zeros
from rbd.displayed import Displayed
from rbd.problem.answer import Answer
from rbd.problem.force_set import ForceSet, at_rest
from rbd.problem.gauss_problem import BILATERAL, GaussProblem, Law, checked
from rbd.problem.residuals import SOLVED
from rbd.solvers.refinement import refined


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
        bounds = (np.array(parts.lower), np.array(parts.upper)) if parts.mu.size * 3 < parts.size else (zeros(0), zeros(0))
        self.sets = (np.array(parts.cone_at, np.int64), np.array(parts.mu), *bounds)

    def impulses(
        self, D: Array, u: Array, guess: Array, exact: float, *, shortest: bool = False, others: bool = True
    ) -> tuple[Array, float, bool] | None:
        """(impulses w, how far D w + u is from zero, scaled, whether they are the shortest), or None if none are found.

        With redundant rows it is the answer nearest to the guess, in the Euclidean norm; arguments as of `kkt_kernel.holding`.
        """
        w = np.empty(len(u))
        D, u, guess = np.ascontiguousarray(D), np.ascontiguousarray(u), np.ascontiguousarray(guess)
        merit, least = kkt_kernel().holding(D, u, guess, exact, shortest, others, *self.sets, w)
        return (w, merit, least) if merit <= exact else None


@cache
def kkt_kernel() -> ModuleType:
    """`rbd.solvers.kkt_kernel`, imported with the first step that needs it: it imports Numba."""
    from rbd.solvers import kkt_kernel

    return kkt_kernel
