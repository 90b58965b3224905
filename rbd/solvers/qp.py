"""Quadratic programs, by ProxSuite: the only file that imports it; strictly convex ones of control by DAQP [Arnstrom2022].

    minimise 1/2 x^T H x + g^T x   subject to   A x = b,   l <= C x

One sign: H x + g = A^T y + C^T z, so that z >= 0: a
multiplier is the force of its constraint. One retry policy: `attempts` yields one result a setting, most reliable first; its
caller decides by residuals when to stop; programs with H = 1 and g = 0 are also solved by nonnegative least squares.
ProxSuite's status is not used: it reports infeasible on feasible problems, and solved on NaN.

    minimise 1/2 x^T H x + g^T x   subject to   l <= x_1 <= u,   low <= C x <= high

with x_1 the first entries of x, as many as there are bounds. One sign: H x + g = (z, 0) + C^T y, so that a multiplier is
positive where a lower bound is active, and negative where an upper one is. Equal bounds are equations. DAQP's status is not
used to accept an answer: callers judge it by `rbd.control.step_program.StepProgram.optimality`.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import daqp
import numpy as np

from rbd.arrays import RANK, Array, check_finite, identity, is_finite, zeros
from rbd.errors import InputError
from rbd.problem import programs
from rbd.problem.programs import Work, least_distance, linear_program

# ProxSuite's AVX builds give one of two answers, last digits apart, depending on the alignment of buffers; the plain one always
# the same, for 12 us more a program (docs/design/repeatable.md). For its loader, None is a missing build.
for _build in ("proxsuite_pywrap_avx512", "proxsuite_pywrap_avx2"):
    sys.modules.setdefault(f"proxsuite.{_build}", None)  # type: ignore[arg-type]

_UNBOUNDED = 1e20  # ProxSuite's infinity


@dataclass(frozen=True)
class Setting:
    """One way to run ProxSuite. The preconditioner costs time and fails on near-singular H; off, others fail."""

    eps_abs: float = 1e-10
    precondition: bool = False
    rho: float = 1e-9
    mu_eq: float = 1e-8
    mu_in: float = 1e-1
    max_iter: int = programs.QP_STEPS


POLICY = (
    Setting(),
    Setting(precondition=True),
    Setting(mu_in=1e-2),
    Setting(precondition=True, rho=1e-6, mu_eq=1e-3),
    Setting(eps_abs=1e-12, precondition=True, rho=1e-7, mu_eq=1e-5, max_iter=programs.QP_STEPS_LAST),
    Setting(eps_abs=1e-11, rho=1e-8, mu_eq=1e-6, mu_in=1e-3, max_iter=programs.QP_STEPS_LAST),
)
"""Settings in the order in which they are tried."""


@dataclass(frozen=True, eq=False)
class QPResult:
    """One attempt: minimiser x, multipliers y (equalities) and z (bounds), signed as forces, and iterations so far."""

    x: Array
    y: Array
    z: Array
    iterations: int


def attempts(
    H: Array,
    g: Array,
    A: Array | None,
    b: Array | None,
    C: Array | None,
    l: Array | None,
    *,
    policy: tuple[Setting, ...] = POLICY,
    work: Work | None = None,
) -> Iterator[QPResult]:
    """One result a setting, until the caller stops or `rbd.problem.programs.QP_WORK` is spent.

    Args:
        H: Positive semidefinite, shape (n, n).
        g: Shape (n,).
        A: Equalities, shape (p, n), or None.
        b: Shape (p,).
        C: Inequalities, shape (k, n), or None.
        l: Their lower bounds, shape (k,).
        policy: Settings to try, in order.
        work: Remaining work for several programs together; `rbd.problem.programs.QP_WORK` for this one if not given.

    Raises:
        InputError: if an entry is NaN or infinite: ProxSuite would continue and report `solved`.
    """
    from proxsuite import proxqp  # with the first program

    n, p, k = len(g), 0 if A is None else len(A), 0 if C is None else len(C)
    unit = H is identity(n) and g is zeros(n)  # internal constants are not checked
    for what, value in zip("AbClHg", (A, b, C, l) if unit else (A, b, C, l, H, g), strict=False):
        if value is not None and not is_finite(value):
            check_finite(f"{what} of the QP", value)
    total, size = 0, float(n + p + k) ** 2
    work = Work(programs.QP_WORK) if work is None else work
    steps = max(programs.QP_FEWEST_STEPS, int(programs.QP_SETTING_WORK / (programs.QP_INNER_STEPS * max(size, 1.0))))
    for i, setting in enumerate(policy):
        if i == 1 and unit and (found := _nearest_to_zero(A, b, C, l, total)) is not None:
            yield found
        if work.left < 0.0:
            return
        qp = proxqp.dense.QP(n, p, k)
        s = qp.settings
        s.eps_abs, s.eps_rel, s.max_iter = setting.eps_abs, 0.0, min(setting.max_iter, steps)
        s.initial_guess = proxqp.InitialGuess.NO_INITIAL_GUESS
        s.max_iter_in = programs.QP_INNER_STEPS
        if k:
            # Else it accepts forces at bounds 1e-3 away. For an objective of 1e5, 1e-9 is below rounding: thus 1e-10.
            s.check_duality_gap, s.eps_duality_gap_abs, s.eps_duality_gap_rel = True, 10.0 * setting.eps_abs, 1e-10
        # A strictly convex program is never dual infeasible; at the default 1e-4 its test claims it for 81 in 100 states of
        # Talos full, in `a`. Its test for primal infeasibility stays: it ends infeasible runs.
        s.eps_dual_inf = 1e-16
        # After the bounds, in order: preconditioner, rho, mu_eq, mu_in. Keywords would cost a tenth of a small solve.
        qp.init(
            H, g, A if p else None, b if p else None, C if k else None, l if k else None, np.full(k, _UNBOUNDED) if k else None,
            setting.precondition, setting.rho, setting.mu_eq, setting.mu_in,
        )  # fmt: skip
        qp.solve()
        r = qp.results
        total += r.info.iter
        work.spend(r.info.iter * size)
        # ProxSuite: H x + g + A^T y + C^T z = 0; a force is minus its multiplier.
        yield QPResult(np.array(r.x), -r.y if p else zeros(0), -r.z if k else zeros(0), total)


def _nearest_to_zero(A: Array | None, b: Array | None, C: Array | None, l: Array | None, total: int) -> QPResult | None:
    """The point nearest to zero, by nonnegative least squares: an active-set method [LawsonHanson1974], chapter 23.

    With few unknowns and many rows (a hundred contacts on one body) it takes milliseconds where ProxSuite, whose systems have
    as many unknowns as there are rows, takes seconds; and redundant rows do no harm.
    """
    n = A.shape[1] if A is not None else C.shape[1] if C is not None else 0
    p, none = 0 if A is None else len(A), np.zeros((0, n))
    equal, right = (none, zeros(0)) if A is None or b is None else (A, b)
    rows, low = (none, zeros(0)) if C is None or l is None else (C, l)
    G, h = np.vstack([equal, -equal, rows]), np.concatenate([right, -right, low])
    length = np.hypot(np.linalg.norm(G, axis=1), h)
    felt = length > 0.0
    u = np.zeros(len(h))
    found = least_distance(G[felt] / length[felt, None], h[felt] / length[felt])
    if found is None:
        return None  # no point satisfies the rows
    u[felt] = found[1] / length[felt]
    y = u[:p] - u[p : 2 * p]
    return QPResult(G.T @ u, y, u[2 * p :], total)


def least_violation(A: Array, b: Array, C: Array, l: Array) -> float:
    """Smallest t such that some x has |A x - b| <= t and C x >= l - t, by a linear program (HiGHS); NaN if it fails.

    Zero, up to HiGHS's tolerance of about 1e-7, if and only if the constraints can be satisfied.
    """
    if not len(A) and not len(C):
        return 0.0
    n = A.shape[1] if len(A) else C.shape[1]
    one = np.ones
    rows = [M for M in (np.c_[A, -one(len(A))], np.c_[-A, -one(len(A))], np.c_[-C, -one(len(C))]) if len(M)]
    right = np.concatenate([b, -b, -l])
    cost = np.r_[np.zeros(n), 1.0]
    answer = linear_program(cost, np.vstack(rows), right, bounds=[(None, None)] * n + [(0, None)])
    return answer.value  # NaN where it is not solved


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
    x, multipliers, k = np.asarray(x), -np.asarray(info["lam"]), len(lower)
    if flag != 1 and not (is_finite(x) and is_finite(multipliers)):
        x, multipliers = np.zeros(len(g)), np.zeros(len(bottom))
    return StrictAnswer(x, multipliers[:k], multipliers[k:], int(info["iterations"]), flag == 1)


def independent_rows(E: Array) -> Array:
    """Indices of rows that span the others, ascending: as many as the rank."""
    from scipy.linalg import qr

    sizes = np.linalg.norm(E, axis=1)
    E = E / np.where(sizes > 0.0, sizes, 1.0)[:, None]
    R, order = qr(E.T, mode="r", pivoting=True)
    return np.sort(order[: int((np.abs(np.diagonal(R)) > RANK).sum())])  # of rows of length one the first entry is one
