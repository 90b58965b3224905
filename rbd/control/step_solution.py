"""The minimiser of a `StepProgram`, with its multipliers.

For given w, and given values s of the few rows of T that bind, the best a is known in closed form: it minimises under
E a = e - F w and T a = s - W w. What is left is a program in (w, s), a fifth of the whole. Which rows bind is found by solving
without them, then with those that were passed. What rounding leaves of the equations and of the gradient, along weights inside
their bounds, is solved for once more. Every answer is judged by the whole program, `StepProgram.optimality`; where it is none,
or the equations depend on each other, DAQP solves the whole, then ProxSuite.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from scipy.linalg import blas, lapack

from rbd.arrays import Array, block_diagonal, max_abs
from rbd.control.step_program import StepPoint, StepProgram
from rbd.problem.residuals import SOLVED
from rbd.solvers.qp import POLICY, attempts
from rbd.solvers.strict_qp import independent_rows, solve_strict

_PASSED = 1e-11
"""A row that is passed by more binds."""
_PASSES = 6
"""How often rows are added to those that bind."""
_DEPENDENT = 1e-7
"""Rows whose distance from the span of the others is less, over their length, are left to the whole program."""
_REFINED = 1e-12
"""A gradient along weights inside their bounds is solved for once more if it is above this: weights cost 1e-2."""
_REFINEMENTS = 3
_SETTINGS = 3
"""How many of ProxSuite's settings are tried."""


def minimiser(program: StepProgram) -> tuple[StepPoint | None, float]:
    """(the minimiser, its `optimality`) by the first method within 1e-9, else by the best; None if none has one."""
    best, least = None, math.inf
    for point in _attempts(program):
        found = program.optimality(point)
        if found < least:
            best, least = point, found
        if found <= SOLVED:
            break
    return best, least


def _attempts(program: StepProgram) -> Iterator[StepPoint]:
    point = eliminated(program)
    if point is not None:
        yield point
    whole = _Whole(program)
    second = whole.by_daqp()
    if second is not None:
        yield second
    if point is not None or second is not None:  # else DAQP found twice that there is none
        yield from whole.by_proxsuite()


def eliminated(program: StepProgram) -> StepPoint | None:
    """By programs in w and the rows that bind; None where the equations are nearly dependent, or there is no answer."""
    P = program
    L, failed = lapack.dpotrf(P.H, lower=1, clean=0)
    if failed:
        return None
    binding, steps = np.zeros(0, int), 0
    for _ in range(_PASSES):
        found = _with_binding(P, L, binding)
        if found is None:
            return None
        a, x, y, z, of_forces, more = found
        steps += more
        p = len(P.k)
        w = x[:p]
        rows = P.T @ a + P.W @ w
        passed = (rows < P.low - _PASSED) | (rows > P.high + _PASSED)
        passed[binding] = False
        passed[P.of_forces] = False
        if not passed.any():
            break
        passed[binding] = True
        binding = np.flatnonzero(passed)
    m = len(P.e)
    t = np.zeros(len(P.low))
    t[binding] = z[p:]
    t[P.of_forces] = of_forces
    return StepPoint(a, w, y[:m], t, z[:p], steps, "DAQP")


def _with_binding(P: StepProgram, L: Array, binding: Array) -> tuple[Array, Array, Array, Array, Array, int] | None:
    """(a, x, y, z, t of `of_forces`, iterations), where x is w, then the values of these rows; y and z have theirs last."""
    E, F, e, K, k, lower, upper, N = P.E, P.F, P.e, P.K, P.k, P.lower, P.upper, P.W[P.of_forces]
    m, p, n = len(e), len(k), len(binding)
    if n:
        E = np.concatenate([E, P.T[binding]])
        F = np.concatenate([np.concatenate([F, P.W[binding]]), np.zeros((m + n, n))], axis=1)
        F[range(m, m + n), range(p, p + n)] = -1.0
        e, k = np.concatenate([e, np.zeros(n)]), np.concatenate([k, np.zeros(n)])
        K = block_diagonal([K, np.zeros((n, n))])
        lower, upper = np.concatenate([lower, P.low[binding]]), np.concatenate([upper, P.high[binding]])
        N = np.concatenate([N, np.zeros((len(N), n))], axis=1)
        m += n
    Y = blas.dtrsm(1.0, L, np.concatenate([E, P.g[None]]).T, lower=1)  # L^-1 (E^T, g)
    YE, yg = Y[:, :m], Y[:, m]
    S = YE.T @ YE
    D, failed = lapack.dpotrf(S, lower=1, clean=0)
    if failed or (D.diagonal() < _DEPENDENT * np.sqrt(S.diagonal())).any():
        return None
    X = blas.dtrsm(1.0, D, np.concatenate([F, (e + yg @ YE)[:, None]], axis=1), lower=1)  # D^-1 (F, e + YE^T yg)
    XF, xe = X[:, :-1], X[:, -1]
    Q, x, z, t, steps = K + XF.T @ XF, _NONE, _NONE, _NONE, 0
    if p + n:
        found = solve_strict(Q, k - xe @ XF, lower, upper, N, P.low[P.of_forces], P.high[P.of_forces])
        if not found.solved:
            return None
        x, z, t, steps = found.x, found.z, found.y, found.iterations
    y = _back(D, xe - XF @ x)
    a = _back(L, YE @ y - yg)
    inside, pushing = z == 0.0, t != 0.0
    for _ in range(_REFINEMENTS):
        if m:  # once more for what rounding left of the equations
            more = _back(D, blas.dtrsm(1.0, D, (e - F @ x - E @ a)[:, None], lower=1)[:, 0])
            y, a = y + more, a + _back(L, YE @ more)
        if not (p + n):
            break
        gradient = K @ x + k - y @ F - t @ N
        z = np.where(inside, 0.0, gradient)
        left = gradient[inside]
        if max_abs(left) <= _REFINED * max(1.0, max_abs(x)):
            break
        dx, dt = _newton(Q[np.ix_(inside, inside)], N[np.ix_(pushing, inside)], left)
        x = x.copy()
        x[inside] += dx
        t[pushing] += dt
        dy = _back(D, -XF[:, inside] @ dx)
        y, a = y + dy, a + _back(L, YE @ dy)
    return a, x, y, z, t, steps


def _newton(Q: Array, N: Array, gradient: Array) -> tuple[Array, Array]:
    """(dx, dt) that take a gradient Q x - N^T t away, N x unchanged."""
    if not len(N):
        L, _ = lapack.dpotrf(Q, lower=1, clean=0)
        return _back(L, blas.dtrsm(-1.0, L, gradient[:, None], lower=1)[:, 0]), _NONE
    zero = np.zeros((len(N), len(N)))
    both = np.linalg.solve(np.block([[Q, -N.T], [N, zero]]), np.concatenate([-gradient, np.zeros(len(N))]))
    return both[: len(Q)], both[len(Q) :]


class _Whole:
    """The whole program in x = (w, a), with equations that are independent of each other, beside the weights that are fixed."""

    def __init__(self, program: StepProgram) -> None:
        P = self.program = program
        self.H, self.g = block_diagonal([P.K, P.H]), np.concatenate([P.k, P.g])
        equations = np.concatenate([P.F, P.E], axis=1)
        fixed = np.concatenate([P.lower == P.upper, np.zeros(len(P.g), bool)])
        self.kept = independent_rows(equations[:, ~fixed])
        self.A, self.b = equations[self.kept], P.e[self.kept]
        self.C = np.concatenate([P.W, P.T], axis=1)

    def by_daqp(self) -> StepPoint | None:
        """None where DAQP finds none."""
        P = self.program
        low, high = np.concatenate([self.b, P.low]), np.concatenate([self.b, P.high])
        found = solve_strict(self.H, self.g, P.lower, P.upper, np.concatenate([self.A, self.C]), low, high)
        return self._point(found.x, found.z, found.y, found.iterations, "DAQP") if found.solved else None

    def by_proxsuite(self) -> Iterator[StepPoint]:
        """One point a setting."""
        P, p = self.program, len(self.program.k)
        C = np.concatenate([np.eye(p, len(self.g)), self.C])
        low, high = np.concatenate([P.lower, P.low]), np.concatenate([P.upper, P.high])
        for found in attempts(self.H, self.g, self.A, self.b, C, low, high, policy=POLICY[:_SETTINGS]):
            y = np.concatenate([found.y, found.z[p:]])
            yield self._point(found.x, found.z[:p], y, found.iterations, "ProxSuite")

    def _point(self, x: Array, z: Array, y: Array, iterations: int, method: str) -> StepPoint:
        P, p, m = self.program, len(self.program.k), len(self.kept)
        of_equations = np.zeros(len(P.e))
        of_equations[self.kept] = y[:m]
        return StepPoint(x[p:], x[:p], of_equations, y[m:], z, iterations, method)


def _back(L: Array, x: Array) -> Array:
    """L^-T x."""
    return np.asarray(blas.dtrsm(1.0, L, x[:, None], lower=1, trans_a=1)[:, 0])


_NONE = np.zeros(0)
