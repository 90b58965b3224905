"""Steps of worlds whose impulses were not found together with others: one world after the other.

By `rbd.solvers.law_kernel`; then by `rbd.ConeSolver`, and the former from there. `ConeSolver` takes symmetric problems: there
forces act where points are at the end of the step. If its answer, made exact, does not lead to that of the problem with forces
in the middle of the step, it is taken as it is, and the residual of the step says so.
"""

from __future__ import annotations

import numpy as np

from rbd.arrays import Array
from rbd.errors import RbdError
from rbd.problem.cones import Bounds, FrictionCone
from rbd.problem.gauss_problem import GaussProblem
from rbd.problem.rows import Rows
from rbd.solvers.admm import ConeSolver
from rbd.solvers.law_kernel import forces
from rbd.solvers.newton_kernel import Problem
from rbd.worlds.contact_kernel import FOUND
from rbd.worlds.layout import LEFT, MERITS, RESCUED
from rbd.worlds.rescue_kernel import left_problem, take
from rbd.worlds.sites_kernel import Sites


def solve_left(sites: Sites, told: Array, space: Array, whole: Array, n: int, coulomb: bool) -> None:
    """Find the impulses of those worlds of a block that are left; they stay marked where they are not found.

    Args:
        sites: What touches.
        told: What is told of the block, shape (TOLD, lanes); written.
        space: Memory of the contact problem, shape (rows, lanes); written.
        whole: As of `advance_kernel.advance_blocks`.
        n: Number of bodies.
        coulomb: Coulomb's law; else the convex one.
    """
    for of in np.flatnonzero(space[LEFT - MERITS] > 0.5).tolist():
        told[RESCUED, of] += 1.0
        _solve(sites, space, whole, n, of, coulomb)


def _solve(sites: Sites, space: Array, whole: Array, n: int, of: int, coulomb: bool) -> None:
    """Find the impulses of one lane."""
    problem, axes, whose = left_problem(*sites, space, whole, n, of)
    merit, w = _found(problem, np.zeros(len(problem.offset)), coulomb)
    if not merit <= FOUND and np.isfinite(problem.D).all() and np.isfinite(problem.offset).all():
        try:
            with np.errstate(all="ignore"):
                guess = ConeSolver(law="coulomb" if coulomb else "convex").solve(_symmetric(problem)).multipliers
        except RbdError:
            return
        merit, w = _found(problem, guess, coulomb)
        if not merit <= FOUND:
            merit, w = _found(problem._replace(columns=problem.felt.copy()), guess, coulomb)
            if merit <= FOUND:
                better, last = _found(problem, w, coulomb)
                w = last if better <= FOUND else w
    if merit <= FOUND:
        take(*sites, space, n, of, axes, whose, w)


def _found(problem: Problem, guess: Array, coulomb: bool) -> tuple[float, Array]:
    """(merit, impulses) by Newton's steps from a guess."""
    w = np.zeros(len(guess))
    return forces(problem, np.array(guess, float), coulomb, np.arange(len(problem.first)), w)[0], w


def _symmetric(problem: Problem) -> GaussProblem:
    """The problem whose forces act where the points are at the end of the step."""
    _, _, _, felt, offset, first, width, lower, upper, mu = problem
    values, vectors = np.linalg.eigh(problem.D)
    W = vectors * np.sqrt(np.maximum(values, 0.0))
    part = np.r_[np.arange(len(lower)), np.repeat(len(lower) + np.arange(len(mu)), 3)]
    J = np.array([x[: width[i]] @ W[first[i] : first[i] + width[i]] for x, i in zip(felt, part, strict=True)])
    rows = [Rows(f"single {i}", J[[i]], offset[[i]], Bounds(lower[[i]], upper[[i]])) for i in range(len(lower))]
    at = len(lower)
    rows += [
        Rows(f"point {i}", J[at + 3 * i : at + 3 * i + 3], offset[at + 3 * i : at + 3 * i + 3], FrictionCone(float(m)))
        for i, m in enumerate(mu)
    ]
    return GaussProblem(np.eye(len(W)), np.zeros(len(W)), rows)
