"""Linear programs and least squares with bounds, by SciPy, within `rbd.problem.limits`: the only file that calls them.

An answer, or None: what the library refuses, fails on or does not finish within the limit is told apart by `Outcome`, and is
never an exception nor a number.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np
from scipy.optimize import linprog, lsq_linear, nnls
from scipy.sparse import csr_array

from rbd.arrays import Array, is_finite
from rbd.problem import limits

NONE = np.zeros(0)


class Outcome(Enum):
    """How a linear program ended."""

    SOLVED = "solved"
    INFEASIBLE = "infeasible"
    UNBOUNDED = "unbounded"
    NOT_FOUND = "not found"
    """The limit was reached, or numbers defeated the method."""


@dataclass(frozen=True, eq=False)
class LinearAnswer:
    """What a linear program gave.

    Attributes:
        outcome: How it ended. The rest is meaningless unless that is SOLVED.
        x: The minimiser, shape (n,).
        value: The minimum.
        lower: Multipliers of A_ub x <= b_ub, not positive, shape (q,).
        equal: Multipliers of A_eq x = b_eq, shape (p,).
        pivots: Iterations.
    """

    outcome: Outcome
    x: Array
    value: float
    lower: Array
    equal: Array
    pivots: int

    @property
    def solved(self) -> bool:
        """Whether there is an answer."""
        return self.outcome is Outcome.SOLVED


_OUTCOMES = {0: Outcome.SOLVED, 2: Outcome.INFEASIBLE, 3: Outcome.UNBOUNDED}


def linear_program(
    cost: Array,
    A_ub: Array | csr_array | None = None,
    b_ub: Array | None = None,
    A_eq: Array | csr_array | None = None,
    b_eq: Array | None = None,
    *,
    bounds: Any = (None, None),
    tolerance: float | None = None,
    method: str = "highs",
) -> LinearAnswer:
    """Minimise cost . x over A_ub x <= b_ub, A_eq x = b_eq and bounds, by HiGHS.

    Args:
        cost: Shape (n,).
        A_ub: Shape (q, n), dense or sparse, or None.
        b_ub: Shape (q,).
        A_eq: Shape (p, n), likewise.
        b_eq: Shape (p,).
        bounds: As `scipy.optimize.linprog` takes them; none if not given.
        tolerance: Of feasibility, primal and dual; HiGHS's own 1e-7 if not given.
        method: "highs", "highs-ds" (dual simplex) or "highs-ipm".
    """
    given = [x if isinstance(x, np.ndarray) else x.data for x in (cost, A_ub, b_ub, A_eq, b_eq) if x is not None]
    if not all(is_finite(x) for x in given):
        return _nothing(Outcome.NOT_FOUND)
    options: dict[str, Any] = {"time_limit": limits.PROGRAM_SECONDS, "maxiter": limits.PROGRAM_PIVOTS}
    if tolerance is not None:
        options |= {"primal_feasibility_tolerance": tolerance, "dual_feasibility_tolerance": tolerance}
    try:
        r = linprog(cost, A_ub, b_ub, A_eq, b_eq, bounds=bounds, method=method, options=options)
    except ValueError:  # what SciPy will not pass on, e.g. crossed bounds
        return _nothing(Outcome.NOT_FOUND)
    if r.status != 0 or r.x is None or not is_finite(r.x):
        return _nothing(_OUTCOMES.get(r.status, Outcome.NOT_FOUND) if r.status else Outcome.NOT_FOUND, int(r.nit))
    lower, equal = np.asarray(r.ineqlin.marginals), np.asarray(r.eqlin.marginals)
    return LinearAnswer(Outcome.SOLVED, np.asarray(r.x), float(r.fun), lower, equal, int(r.nit))


def _nothing(outcome: Outcome, pivots: int = 0) -> LinearAnswer:
    return LinearAnswer(outcome, NONE, float("nan"), NONE, NONE, pivots)


def nonnegative(A: Array, b: Array) -> Array | None:
    """The x >= 0 with the least |A x - b| [LawsonHanson1974], shape (n,); None where it is not found."""
    if not A.size:  # of no rows SciPy returns what was in its memory, and no columns end the process
        return np.zeros(A.shape[1])
    if not (is_finite(A) and is_finite(b)):
        return None
    try:
        return np.asarray(nnls(A, b, maxiter=int(limits.LEAST_SQUARES_PIVOTS * A.shape[1]))[0])
    except (RuntimeError, ValueError, np.linalg.LinAlgError):  # the limit, or a singular set of columns
        return None


def least_distance(G: Array, h: Array, tolerance: float = 1e-12) -> tuple[Array, Array] | None:
    """(x, multipliers): the x of least norm with G x >= h, x = G^T multipliers and these >= 0; None where none is found.

    Least distance programming by nonnegative least squares [LawsonHanson1974], chapter 23.

    Args:
        G: Shape (k, n).
        h: Shape (k,).
        tolerance: What is left of one, of the weighted h, where there is an x.
    """
    size = float(np.abs(h).max(initial=0.0)) or 1.0  # planes far away would leave few digits to the multipliers
    y = nonnegative(np.vstack([G.T, h / size]), np.append(np.zeros(G.shape[1]), 1.0))
    if y is None:
        return None
    left = 1.0 - float(h @ y) / size
    if not left > tolerance:
        return None
    multipliers = y * (size / left)
    return G.T @ multipliers, multipliers


def between(A: Array, b: Array, lower: Array, upper: Array) -> Array:
    """The x within its bounds with about the least |A x - b|, shape (n,); as near as it was found: judge by its residual."""
    try:
        found = lsq_linear(A, b, (lower, upper), tol=1e-14, max_iter=limits.BOUNDED_STEPS).x
    except (ValueError, np.linalg.LinAlgError):
        found = np.linalg.lstsq(A, b, rcond=None)[0]
    return np.minimum(np.maximum(found, lower), upper)
