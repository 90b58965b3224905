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
from rbd.worlds.contact_kernel import FOUND
from rbd.worlds.layout import LEFT, MERITS, RESCUED
from rbd.worlds.rescue_kernel import left_problem, taken_from
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
    D, felt, offset, first, width, lower, upper, mu = left_problem(*sites, space, whole, n, of)
    if taken_from(*sites, space, whole, n, of, coulomb, np.zeros(len(offset)), False) <= FOUND:
        return
    if not (np.isfinite(D).all() and np.isfinite(offset).all()):
        return
    values, vectors = np.linalg.eigh(D)
    W = vectors * np.sqrt(np.maximum(values, 0.0))
    part = np.r_[np.arange(len(lower)), np.repeat(len(lower) + np.arange(len(mu)), 3)]
    J = np.array([x[: width[i]] @ W[first[i] : first[i] + width[i]] for x, i in zip(felt, part, strict=True)])
    rows = [Rows(f"single {i}", J[[i]], offset[[i]], Bounds(lower[[i]], upper[[i]])) for i in range(len(lower))]
    at = len(lower)
    rows += [
        Rows(f"point {i}", J[at + 3 * i : at + 3 * i + 3], offset[at + 3 * i : at + 3 * i + 3], FrictionCone(float(m)))
        for i, m in enumerate(mu)
    ]
    problem = GaussProblem(np.eye(len(D)), np.zeros(len(D)), rows)
    try:
        with np.errstate(all="ignore"):
            found = ConeSolver(law="coulomb" if coulomb else "convex").solve(problem)
    except RbdError:
        return
    guess = np.ascontiguousarray(found.multipliers, float)
    if taken_from(*sites, space, whole, n, of, coulomb, guess, False) <= FOUND:
        return
    if taken_from(*sites, space, whole, n, of, coulomb, guess, True) <= FOUND:
        taken_from(*sites, space, whole, n, of, coulomb, guess, False)
