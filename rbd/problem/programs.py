"""Linear programs and least squares with bounds, by SciPy; limits of work, each with its reason.

This is the only file that calls SciPy's programs. Refusal, failure and an exceeded limit are reported by
`Outcome`, or as None; never by an exception or a number.

The limits are those of all programs and searches of the package. They count work (pivots, steps, multiplications), not seconds,
so that an answer repeats bit by bit on any machine. Where a library cannot count, or may hang within one step, a clock
limit is added, far above what the count allows on an idle machine, so that it acts only when something is wrong. What
was not found within a limit is reported as not found.

No call into a compiled library lasts much longer than `PROGRAM_SECONDS`, so Ctrl-C takes effect within that time.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, Any

import numpy as np

from rbd.arrays import Array, is_finite

if TYPE_CHECKING:
    from scipy.sparse import csr_array

PROGRAM_SECONDS = 2.0
"""Clock limit of one linear program [s]. Robots need milliseconds; HiGHS has been seen not to end at all."""
PROGRAM_PIVOTS = 20_000
"""Simplex pivots of one linear program. A hundred contacts need a few hundred."""
LEAST_SQUARES_PIVOTS = 10
"""Pivots of a nonnegative least-squares problem for each unknown. SciPy's own limit is 3; degenerate problems need 5."""
BOUNDED_STEPS = 200
"""Iterations of a least-squares problem between bounds. They need 10 to 30."""

CONIC_STEPS = 200
"""Iterations of Clarabel on one conic program. Robots need 8 to 30."""
CONIC_SECONDS = 2.0
"""Clock limit of one conic program [s]. Robots need milliseconds."""

LIMIT_PROGRAMS = 100
"""Conic programs on which limits stand in the way of one motion. Robots on their feet need 5 to 40."""

QP_STEPS = 300
"""Outer iterations of a quadratic program. Robots need 8 to 22, and a setting that needs 100 seldom converges."""
QP_STEPS_LAST = 1000
"""The same for the last settings that are tried."""
QP_INNER_STEPS = 100
"""Inner iterations. Robots need a few; with ProxSuite's own limit of 1500, hopeless programs take minutes."""
QP_WORK = 2e8
"""Iterations times (unknowns and rows) squared, of all settings of one quadratic program: 1 to 3 s. Robots need 1e6."""
QP_SETTING_WORK = 1e8
"""The same of one setting, were every inner iteration used."""
QP_FEWEST_STEPS = 30
"""Outer iterations that a setting has at least, however large the program."""

SEARCH_WORK = 3e9
"""Multiplications of all starts of one `rbd.ConeSolver`, about 3 s: steps times unknowns cubed. A hundred contacts need 1e8."""

ENDS_WORK = 1.2e10
"""Multiplications for all ranges of one `Solution.uniqueness()`, about 4 s on one core."""
FORCE_CHOICE_WORK = 4e9
"""Multiplications for the forces of minimum norm, about 1.5 s on one core. A hundred contacts need a hundredth of it."""

FRICTION_PROGRAMS = 400
"""Conic programs in the search for the least coefficient of friction for static equilibrium. Two soles need about ten."""

POLYGON_PROGRAMS = 400
"""Programs for one polygon of centres of mass. Two soles need eight; a hand on a wall, to a square centimetre, some fifty."""

CERTIFICATE_SETS = 1000
"""Sets of constraints, or of rows, that are tried in the search for a contradiction smaller than what was found."""
CERTIFICATE_PROGRAMS = 100
"""Programs that are solved in that search."""
CERTIFICATE_LEFT_OUT = 300
"""Programs that may be solved in all to see which members of a contradiction can be left out."""
MODE_NODES = 5000
"""Nodes of the tree of contact modes of points that already slide."""
MODE_WORK = 5e9
"""Multiplications of that tree, about 2 s: a hundred points reach it long before the nodes."""


class Work:
    """A budget of multiplications.

    Attributes:
        left: What is left; negative once more was spent than there was.
    """

    def __init__(self, limit: float) -> None:
        self.left = float(limit)

    def spend(self, amount: float) -> bool:
        """Spend an amount; whether it was available."""
        self.left -= amount
        return self.left >= 0.0


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
    """Result of a linear program.

    Attributes:
        outcome: How it ended. All other attributes are valid only if it is SOLVED.
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
        """Whether it was solved."""
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
        A_eq: Shape (p, n), dense or sparse, or None.
        b_eq: Shape (p,).
        bounds: As `scipy.optimize.linprog` takes them; none if not given.
        tolerance: Of feasibility, primal and dual; HiGHS's own 1e-7 if not given.
        method: "highs", "highs-ds" (dual simplex) or "highs-ipm".
    """
    from scipy.optimize import linprog  # 0.15 s to import, and most answers need no program

    given = [x if isinstance(x, np.ndarray) else x.data for x in (cost, A_ub, b_ub, A_eq, b_eq) if x is not None]
    if not all(is_finite(x) for x in given):
        return _nothing(Outcome.NOT_FOUND)
    options: dict[str, Any] = {"time_limit": PROGRAM_SECONDS, "maxiter": PROGRAM_PIVOTS}
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
    if not A.size:  # without rows SciPy returns uninitialised memory; without columns it ends the process
        return np.zeros(A.shape[1])
    if not (is_finite(A) and is_finite(b)):
        return None
    from scipy.optimize import nnls

    try:
        return np.asarray(nnls(A, b, maxiter=int(LEAST_SQUARES_PIVOTS * A.shape[1]))[0])
    except (RuntimeError, ValueError, np.linalg.LinAlgError):  # iteration limit, or singular columns
        return None


def least_distance(G: Array, h: Array, tolerance: float = 1e-12) -> tuple[Array, Array] | None:
    """(x, multipliers): the x of least norm with G x >= h, x = G^T multipliers and these >= 0; None where none is found.

    Least distance programming by nonnegative least squares [LawsonHanson1974], chapter 23.

    Args:
        G: Shape (k, n).
        h: Shape (k,).
        tolerance: Where an x exists, relative residual of the weighted h.
    """
    size = float(np.abs(h).max(initial=0.0)) or 1.0  # distant planes would leave the multipliers few digits
    y = nonnegative(np.vstack([G.T, h / size]), np.append(np.zeros(G.shape[1]), 1.0))
    if y is None:
        return None
    left = 1.0 - float(h @ y) / size
    if not left > tolerance:
        return None
    multipliers = y * (size / left)
    return G.T @ multipliers, multipliers


def within(A: Array, b: Array, lower: Array, upper: Array) -> Array:
    """The x within its bounds with the least |A x - b|, exactly on its active bounds [StarkParker1995], shape (n,).

    Equal bounds fix an unknown. If the steps run out, the last x, which is within the bounds; if SciPy refuses the problem,
    the x nearest to zero.
    """
    x, free = np.clip(np.zeros(A.shape[1]), lower, upper), upper > lower
    if free.any():
        from scipy.optimize import lsq_linear

        bounds, left = (lower[free], upper[free]), b - A[:, ~free] @ x[~free]
        try:
            found = lsq_linear(A[:, free], left, bounds, method="bvls", tol=1e-14, max_iter=BOUNDED_STEPS)
        except (ValueError, np.linalg.LinAlgError):
            return x
        held = found.active_mask  # -1, 0, 1; SciPy's x is on the bound to rounding
        x[free] = np.where(held < 0, bounds[0], np.where(held > 0, bounds[1], np.clip(found.x, *bounds)))
    return x
