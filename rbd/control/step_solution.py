"""The minimiser of a `StepProgram`, with its multipliers.

For given w, and given values s of the few rows of T that bind, the best a is known in closed form: it minimises under
E a = e - F w and T a = s - W w. What is left is a program in (w, s), a fifth of the whole. Which rows bind is found by solving
without them, then with those that were passed. What rounding leaves of the equations and of the gradient, along weights inside
their bounds, is solved for once more. Every answer is judged by the whole program, `StepProgram.optimality`; where it is none,
or the equations depend on each other, DAQP solves the whole, and the optimality conditions are solved on its active set; then
ProxSuite likewise.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

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
_DEPENDENT = 1e-14
"""Equations whose squared distance from the span of the others is less, over their square, are left to the whole program."""
_REFINED = 3e-12
"""A gradient along weights inside their bounds is solved for once more if it is above this: weights cost 1e-2."""
_REFINEMENTS = 2
_PUSHES = 1e-14
"""A multiplier of the wrong sign that is less, over the largest, is rounding."""
_CORRECTIONS = 10
_RANK = 1e-15
_SETTINGS = 3
"""How many of ProxSuite's settings are tried."""


def minimiser(program: StepProgram, *, possible: bool = False) -> tuple[StepPoint | None, float]:
    """(the minimiser, its `optimality`) by the first method within 1e-9, else by the best; None if none has one.

    Args:
        program: To be solved.
        possible: Whether it is known to have an answer: no method's verdict ends the search.
    """
    best, least = None, math.inf
    for point in _attempts(program, possible=possible):
        found = program.optimality(point)
        if found < least:
            best, least = point, found
        if found <= SOLVED:
            break
    return best, least


def _attempts(program: StepProgram, *, possible: bool) -> Iterator[StepPoint]:
    point = eliminated(program)
    if point is not None:
        yield point
    whole = WholeProgram(program)
    second, solved = whole.by_daqp()
    if solved:
        yield second
    if point is None and not solved and not possible:
        return  # DAQP found twice that there is none
    yield whole.on_active_set(second)
    for third in whole.by_proxsuite():
        yield third
        yield whole.on_active_set(third)


def eliminated(program: StepProgram) -> StepPoint | None:
    """By programs in w and the rows that bind; None where the equations are nearly dependent, or there is no answer."""
    P = program
    L, failed = lapack.dpotrf(P.H, lower=1, clean=0)
    if failed:
        return None
    binding, steps = np.zeros(0, int), 0
    for _ in range(_PASSES):
        reduced = _Reduced.of(P, L, binding)
        found = reduced.solved() if reduced is not None else None
        if reduced is None or found is None:
            return None
        steps += found.iterations
        rows = P.T @ found.a + P.W @ found.x[: len(P.k)]
        passed = (rows < P.low - _PASSED) | (rows > P.high + _PASSED)
        passed[binding] = False
        passed[P.of_forces] = False
        if not passed.any():
            break
        passed[binding] = True
        binding = passed.nonzero()[0]
    assert reduced is not None and found is not None
    a, x, y, z, of_forces, _ = reduced.refined(found)
    m, p = len(P.e), len(P.k)
    t = np.zeros(len(P.low))
    t[binding] = z[p:]
    t[P.of_forces] = of_forces
    return StepPoint(a, x[:p], y[:m], t, z[:p], steps, "DAQP")


class _Found(NamedTuple):
    """Accelerations; w, then the values of the rows that bind; multipliers of equations, of bounds of x, of rows of forces."""

    a: Array
    x: Array
    y: Array
    z: Array
    t: Array
    iterations: int


class _Reduced(NamedTuple):
    """The program in x: the weights w, then the values s of the rows that bind, with T a + W w - s = 0 among the equations.

    minimise 1/2 x^T Q x + q^T x   subject to   lower <= x <= upper, low <= N x <= high;   a = L^-T (YE y - yg)
    """

    E: Array
    F: Array
    e: Array
    K: Array
    k: Array
    lower: Array
    upper: Array
    N: Array
    low: Array
    high: Array
    L: Array
    YE: Array
    yg: Array
    D: Array
    XF: Array
    xe: Array

    @classmethod
    def of(cls, P: StepProgram, L: Array, binding: Array) -> _Reduced | None:
        """None where the equations are nearly dependent on each other in a."""
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
        if failed or (D.diagonal() ** 2 < _DEPENDENT * S.diagonal()).any():
            return None
        X = blas.dtrsm(1.0, D, np.concatenate([F, (e + yg @ YE)[:, None]], axis=1), lower=1)  # D^-1 (F, e + YE^T yg)
        only = P.of_forces
        return cls(E, F, e, K, k, lower, upper, N, P.low[only], P.high[only], L, YE, yg, D, X[:, :-1], X[:, -1])

    def solved(self) -> _Found | None:
        """To the accuracy of Q; None where there is no answer."""
        x, z, t, steps = _NONE, _NONE, _NONE, 0
        if len(self.k):
            Q = self.K + self.XF.T @ self.XF
            found = solve_strict(Q, self.k - self.xe @ self.XF, self.lower, self.upper, self.N, self.low, self.high)
            if not found.solved:
                return None
            x, z, t, steps = found.x, found.z, found.y, found.iterations
        y = _back(self.D, self.xe - self.XF @ x)
        return _Found(_back(self.L, self.YE @ y - self.yg), x, y, z, t, steps)

    def refined(self, found: _Found) -> _Found:
        """With what rounding left of the equations, and of the gradient along what is inside its bounds, solved for again."""
        a, x, y, z, t, steps = found
        inside, pushing = (z == 0.0) & (self.lower < self.upper), t != 0.0
        for left in range(_REFINEMENTS, -1, -1):
            if len(self.e):
                missing = self.e - self.F @ x - self.E @ a
                more = _back(self.D, blas.dtrsm(1.0, self.D, missing[:, None], lower=1)[:, 0])
                y, a = y + more, a + _back(self.L, self.YE @ more)
            if not len(x):
                break
            gradient = self.K @ x + self.k - y @ self.F - t @ self.N
            z = np.where(inside, 0.0, gradient)
            along = gradient[inside]
            if not left or max_abs(along) <= _REFINED * max(1.0, max_abs(x)):
                break
            XF = self.XF[:, inside]
            dx, dt = _newton(self.K[inside][:, inside] + XF.T @ XF, self.N[pushing][:, inside], along)
            x = x.copy()
            x[inside] += dx
            t = t.copy()
            t[pushing] += dt
            dy = _back(self.D, -XF @ dx)
            y, a = y + dy, a + _back(self.L, self.YE @ dy)
        return _Found(a, x, y, z, t, steps)


def _newton(Q: Array, N: Array, gradient: Array) -> tuple[Array, Array]:
    """(dx, dt) that take a gradient Q x - N^T t away, N x unchanged."""
    if not len(N):
        L, _ = lapack.dpotrf(Q, lower=1, clean=0)
        return _back(L, blas.dtrsm(-1.0, L, gradient[:, None], lower=1)[:, 0]), _NONE
    zero = np.zeros((len(N), len(N)))
    both = np.linalg.solve(np.block([[Q, -N.T], [N, zero]]), np.concatenate([-gradient, np.zeros(len(N))]))
    return both[: len(Q)], both[len(Q) :]


class WholeProgram:
    """The whole program in x = (w, a), with equations that are independent of each other, beside the weights that are fixed."""

    def __init__(self, program: StepProgram) -> None:
        P = self.program = program
        self.H, self.g = block_diagonal([P.K, P.H]), np.concatenate([P.k, P.g])
        equations = np.concatenate([P.F, P.E], axis=1)
        fixed = np.concatenate([P.lower == P.upper, np.zeros(len(P.g), bool)])
        self.kept = independent_rows(equations[:, ~fixed])
        self.A, self.b = equations[self.kept], P.e[self.kept]
        self.C = np.concatenate([P.W, P.T], axis=1)

    def by_daqp(self) -> tuple[StepPoint, bool]:
        """(where DAQP ends, whether that is an answer)."""
        P = self.program
        low, high = np.concatenate([self.b, P.low]), np.concatenate([self.b, P.high])
        found = solve_strict(self.H, self.g, P.lower, P.upper, np.concatenate([self.A, self.C]), low, high)
        return self._point(found.x, found.z, found.y, found.iterations, "DAQP"), found.solved

    def by_proxsuite(self) -> Iterator[StepPoint]:
        """One point a setting."""
        P, p = self.program, len(self.program.k)
        C = np.concatenate([np.eye(p, len(self.g)), self.C])
        low, high = np.concatenate([P.lower, P.low]), np.concatenate([P.upper, P.high])
        for found in attempts(self.H, self.g, self.A, self.b, C, low, high, policy=POLICY[:_SETTINGS]):
            y = np.concatenate([found.y, found.z[p:]])
            yield self._point(found.x, found.z[:p], y, found.iterations, "ProxSuite")

    def on_active_set(self, point: StepPoint) -> StepPoint:
        """The solution of the optimality conditions with the active set of a point, which is corrected where it is wrong."""
        P, p, m, n = self.program, len(self.program.k), len(self.kept), len(self.g)
        rows = np.concatenate([np.eye(p, n), self.C])
        low, high = np.concatenate([P.lower, P.low]), np.concatenate([P.upper, P.high])
        pushes = np.concatenate([point.z, point.t])
        side = np.where(low == high, 1.0, np.sign(pushes))
        x, y = np.concatenate([point.w, point.a]), np.zeros(m + len(side))
        for _ in range(_CORRECTIONS):
            held = side.nonzero()[0]
            B = np.concatenate([self.A, rows[held]])
            right = np.concatenate([-self.g, self.b, np.where(side > 0.0, low, high)[held]])
            system = np.block([[self.H, -B.T], [B, np.zeros((len(B), len(B)))]])
            both = np.linalg.lstsq(system, right, rcond=_RANK)[0]
            for _ in range(2):
                both += np.linalg.lstsq(system, right - system @ both, rcond=_RANK)[0]
            x, y = both[:n], np.zeros(m + len(side))
            y[:m], y[m + held] = both[n : n + m], both[n + m :]
            values, pushes = rows @ x, y[m:]
            wrong = (pushes * side < -_PUSHES * max_abs(pushes)) & (low < high)
            below, above = values < low - _PASSED, values > high + _PASSED
            if not (wrong | ((below | above) & (side == 0.0))).any():
                break
            side = np.where(wrong, 0.0, np.where(side == 0.0, 1.0 * below - 1.0 * above, side))
        y[m:][(y[m:] * side < 0.0) & (low < high)] = 0.0
        return self._point(x, y[m : m + p], np.concatenate([y[:m], y[m + p :]]), point.iterations, point.method)

    def _point(self, x: Array, z: Array, y: Array, iterations: int, method: str) -> StepPoint:
        P, p, m = self.program, len(self.program.k), len(self.kept)
        of_equations = np.zeros(len(P.e))
        of_equations[self.kept] = y[:m]
        return StepPoint(x[p:], x[:p], of_equations, y[m:], z, iterations, method)


def _back(L: Array, x: Array) -> Array:
    """L^-T x."""
    return np.asarray(blas.dtrsm(1.0, L, x[:, None], lower=1, trans_a=1)[:, 0])


_NONE = np.zeros(0)
