"""The closed form for bilateral constraints."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import blas, lapack

from rbd.arrays import Array
from rbd.problem.answer import Answer
from rbd.problem.force_set import at_rest
from rbd.problem.law import BILATERAL, Law
from rbd.problem.problem import GaussProblem, checked
from rbd.problem.residuals import SOLVED
from rbd.problem.subspaces import RANK
from rbd.solvers.refinement import refined


@dataclass(frozen=True)
class KKT:
    """Lagrange's closed form: f = -(J M^-1 J^T)^+ (J a_free + offset), a = a_free + M^-1 J^T f.

    For bilateral constraints. Where rows are redundant f is the shortest, and where they contradict each other a is
    the least-squares one, whose residuals say so.

    Source: Lagrange's stationarity M (a - a_free) - J^T f = 0 with J a + J_dot v = 0; `docs/theory.md`.
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
    """`refined`, of bilateral rows, in rows of one size: those of light bodies are felt as those of heavy ones."""
    P = found.problem
    size = np.sqrt(np.maximum(P.delassus.diagonal(), 1e-300))
    W = P.whitened / size

    def correct(c: Array, f: Array) -> Array:
        return np.asarray(_minimum_norm(W, c / size)[0] / size)

    return refined(found, correct)


def independent_factor(delassus: Array) -> Array | None:
    """Upper R with R^T R = delassus, or None where its pivots tell that rows depend on each other."""
    R, info = lapack.dpotrf(delassus, lower=0, clean=1)
    if info != 0:
        return None
    # Pivots are bounded below by the least singular value of W; 1e-5 leaves ten digits to f, else the SVD takes over.
    pivots = R.diagonal().tolist()
    if min(pivots) > 1e-5 * max(pivots):
        return R
    # Of rows of many sizes, light bodies' beside heavy ones': the sine of each one's angle to those before it.
    return R if (R.diagonal() > 1e-5 * np.sqrt(delassus.diagonal())).all() else None


def _minimum_norm(W: Array, c: Array) -> tuple[Array, float]:
    """(f, missed): minimum-norm f with W^T W f = -c as nearly as can be, and how much of c no f reaches."""
    _, s, Vt = np.linalg.svd(W, full_matrices=False)
    kept = s > RANK * s[0]
    Vt, s = Vt[kept], s[kept]
    along = Vt @ c
    return -Vt.T @ (along / s**2), float(np.abs(c - Vt.T @ along).max())


def constrained(P: GaussProblem, f: Array) -> Array:
    """A = a_free + M^-1 J^T f."""
    return P.a_free + blas.dtrsv(P.factor, P.whitened @ f, lower=1, trans=1)
