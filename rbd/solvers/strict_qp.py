"""Strictly convex quadratic programs of whole-body control, by DAQP [Arnstrom2022]: the only file that imports it.

    minimise 1/2 x^T H x + g^T x   subject to   l <= x_1 <= u,   low <= C x <= high

with x_1 the first entries of x, as many as there are bounds. One sign: H x + g = (z, 0) + C^T y, so that a multiplier is
positive where a lower bound is active, and negative where an upper one is. Equal bounds are equations. DAQP's status is not
used to accept an answer: callers judge it by `rbd.control.step_program.StepProgram.optimality`.
"""

from __future__ import annotations

from typing import NamedTuple

import daqp
import numpy as np
from scipy.linalg import qr

from rbd.arrays import RANK, Array, is_finite
from rbd.errors import InputError

_EQUAL, _INEQUAL = 5, 0
TOLERANCE = 1e-10
"""A row is missed by no more, over its length in the norm of H^-1."""


class StrictAnswer(NamedTuple):
    """What was found.

    Attributes:
        x: The minimiser, shape (n,).
        z: Multipliers of the bounds.
        y: Multipliers of the rows, shape (q,).
        iterations: Of DAQP.
        solved: Whether DAQP calls it solved.
    """

    x: Array
    z: Array
    y: Array
    iterations: int
    solved: bool


def solve_strict(
    H: Array, g: Array, lower: Array, upper: Array, C: Array, low: Array, high: Array, *, tolerance: float = TOLERANCE
) -> StrictAnswer:
    """The minimiser by DAQP; H positive definite, C with contiguous rows, equations independent of each other.

    Args:
        H: Shape (n, n).
        g: Shape (n,).
        lower: Of the first entries of x; -inf where there is none.
        upper: Likewise; inf where there is none.
        C: Shape (q, n).
        low: Shape (q,).
        high: Shape (q,).
        tolerance: See `TOLERANCE`.
    """
    bottom, top = np.concatenate([lower, low]), np.concatenate([upper, high])
    ordered = bool((bottom <= top).all())
    if not (is_finite(H) and is_finite(g) and is_finite(C)) or not ordered and np.isnan(bottom + top).any():
        raise InputError("a quadratic program has entries that are not finite: DAQP would call it solved.")
    if not ordered:
        return StrictAnswer(np.zeros(len(g)), np.zeros(len(lower)), np.zeros(len(low)), 0, False)
    sense = np.where(bottom == top, _EQUAL, _INEQUAL).astype(np.int32)
    x, _, flag, info = daqp.solve(H, g, C, top, bottom, sense, primal_tol=tolerance)
    multipliers = -np.asarray(info["lam"])
    k = len(lower)
    return StrictAnswer(np.asarray(x), multipliers[:k], multipliers[k:], int(info["iterations"]), flag == 1)


def independent_rows(E: Array) -> Array:
    """Indices of rows that span the others, ascending: as many as the rank."""
    sizes = np.linalg.norm(E, axis=1)
    E = E / np.where(sizes > 0.0, sizes, 1.0)[:, None]
    R, order = qr(E.T, mode="r", pivoting=True)
    diagonal = np.abs(np.diagonal(R))
    return np.sort(order[: int((diagonal > RANK * diagonal.max(initial=0.0)).sum())])
