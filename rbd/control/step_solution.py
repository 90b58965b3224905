"""The minimiser of a `StepProgram`, with its multipliers.

DAQP solves the program in x = (w, a): first without limits of torques and with few of joints, then with all, if that answer
passes one. Every answer is judged by `StepProgram.optimality`; where it is none, equations
that depend on others are left out, and the optimality conditions are solved on DAQP's active set; then ProxSuite likewise.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from rbd.arrays import Array, max_abs
from rbd.control.step_program import StepPoint, StepProgram
from rbd.problem.residuals import SOLVED
from rbd.solvers.qp import POLICY, attempts
from rbd.solvers.strict_qp import independent_rows, solve_strict

_NEAR = 20.0
"""Accelerations of joints are bounded from the beginning where a bound is nearer to zero [rad/s2, m/s2]."""
_PASSED = 1e-11
"""A row that is passed by more binds."""
_FAR = 1e-6
"""What is farther from the optimality conditions has most likely no answer."""
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
    few = _near(program)
    first, found = few.by_daqp()
    if found:
        yield first
    if found and not few.complete:
        first, found = WholeProgram(program).by_daqp()
        if found:
            yield first
    whole = WholeProgram(program, independent=True)
    second, solved = whole.by_daqp()
    if solved:
        yield second
    if not possible and program.optimality(second) > _FAR:
        return  # there is none, or DAQP left a contradicting equation out
    yield whole.on_active_set(second)
    for third in whole.by_proxsuite():
        yield third
        yield whole.on_active_set(third)


def _near(program: StepProgram) -> WholeProgram:
    """With the rows between bounds that are likely to bind: bounds near zero; others are judged when it is solved."""
    near = np.minimum(-program.low, program.high) < _NEAR
    near[: program.of_forces.start] = False  # torques
    near[program.of_forces] = True
    return WholeProgram(program, between=near.nonzero()[0])


class WholeProgram:
    """A program in x = (w, a), with some of its equations and of its rows between bounds; weights that are fixed are left out.

    DAQP takes fixed weights for equations, and where these and the others determine everything it may find no answer.

    Args:
        program: The program.
        independent: Leave out equations that depend on others.
        between: Which rows between bounds; all if not given.
    """

    def __init__(self, program: StepProgram, *, independent: bool = False, between: Array | None = None) -> None:
        P, nv, m = program, len(program.g), len(program.e)
        self.program = P
        self.between: Array | slice = slice(None) if between is None else between
        self.low, self.high = P.low[self.between], P.high[self.between]
        self.complete = len(self.low) == len(P.low)
        self.lower, self.upper, K, k, F, W, e = P.lower, P.upper, P.K, P.k, P.F, P.W, P.e
        fixed = P.lower == P.upper
        self.w, self.free = np.where(fixed, P.lower, 0.0), slice(None) if not fixed.any() else np.flatnonzero(~fixed)
        if not isinstance(self.free, slice):
            free, away = self.free, (W @ self.w)[self.between]
            self.lower, self.upper, self.low, self.high = P.lower[free], P.upper[free], self.low - away, self.high - away
            K, k, F, W, e = K[free][:, free], (k + K @ self.w)[free], F[:, free], W[:, free], e - F @ self.w
        p = self.p = len(k)
        self.H, self.g = np.zeros((p + nv, p + nv)), np.concatenate([k, P.g])
        self.H[:p, :p], self.H[p:, p:] = K, P.H
        rows = np.empty((m + len(self.low), p + nv))
        rows[:m, :p], rows[:m, p:] = F, P.E
        rows[m:, :p], rows[m:, p:] = W[self.between], P.T[self.between]
        self.kept: Array | slice = slice(None)
        if independent:
            self.kept = independent_rows(rows[:m])
            rows = np.concatenate([rows[self.kept], rows[m:]])
        self.rows, self.b = rows, e[self.kept]
        self.A, self.C = rows[: len(self.b)], rows[len(self.b) :]

    def by_daqp(self) -> tuple[StepPoint, bool]:
        """(where DAQP ends, whether that is an answer)."""
        low, high = np.concatenate([self.b, self.low]), np.concatenate([self.b, self.high])
        found = solve_strict(self.H, self.g, self.lower, self.upper, self.rows, low, high)
        return self._point(found.x, found.z, found.y, found.iterations, "DAQP"), found.solved

    def by_proxsuite(self) -> Iterator[StepPoint]:
        """One point a setting."""
        C = np.concatenate([np.eye(self.p, len(self.g)), self.C])
        low, high = np.concatenate([self.lower, self.low]), np.concatenate([self.upper, self.high])
        for found in attempts(self.H, self.g, self.A, self.b, C, low, high, policy=POLICY[:_SETTINGS]):
            y = np.concatenate([found.y, found.z[self.p :]])
            yield self._point(found.x, found.z[: self.p], y, found.iterations, "ProxSuite")

    def on_active_set(self, point: StepPoint) -> StepPoint:
        """The solution of the optimality conditions with the active set of a point, which is corrected where it is wrong."""
        p, m, n = self.p, len(self.b), len(self.g)
        rows = np.concatenate([np.eye(p, n), self.C])
        low, high = np.concatenate([self.lower, self.low]), np.concatenate([self.upper, self.high])
        pushes = np.concatenate([point.z[self.free], point.t[self.between]])
        side = np.where(low == high, 1.0, np.sign(pushes))
        x, y = np.concatenate([point.w[self.free], point.a]), np.zeros(m + len(side))
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
        P, p, m = self.program, self.p, len(self.b)
        of_equations, t = np.zeros(len(P.e)), np.zeros(len(P.low))
        of_equations[self.kept], t[self.between] = y[:m], y[m:]
        if isinstance(self.free, slice):
            return StepPoint(x[p:], x[:p], of_equations, t, z, iterations, method)
        w = self.w.copy()
        w[self.free] = x[:p]
        pull = P.K @ w + P.k - of_equations @ P.F - t @ P.W  # what holds the fixed weights
        pull[self.free] = z
        return StepPoint(x[p:], w, of_equations, t, pull, iterations, method)
