"""The minimiser of a `StepProgram`, with its multipliers.

DAQP solves the program in x = (w, a): first without limits of torques and with few of joints, then with all, if that answer
passes one. Every answer is judged by `StepProgram.optimality`; where it is none, equations
that depend on others are left out, and the optimality conditions are solved on DAQP's active set; then ProxSuite likewise.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

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
        first, found = WholeProgram(program, np.arange(len(program.e))).by_daqp()
        if found:
            yield first
    whole = WholeProgram(program)
    second, solved = whole.by_daqp()
    if solved:
        yield second
    if not (found or solved or possible):
        return  # DAQP found twice that there is none
    yield whole.on_active_set(second)
    for third in whole.by_proxsuite():
        yield third
        yield whole.on_active_set(third)


def _near(program: StepProgram) -> WholeProgram:
    """With the rows between bounds that are likely to bind: bounds near zero; others are judged when it is solved."""
    near = np.minimum(-program.low, program.high) < _NEAR
    near[: program.of_forces.start] = False  # torques
    near[program.of_forces] = True
    return WholeProgram(program, np.arange(len(program.e)), near.nonzero()[0])


class WholeProgram:
    """A program in x = (w, a), with some of its equations and of its rows between bounds.

    Args:
        program: The program.
        kept: Which equations; if not given, as many as are independent of each other, beside the weights that are fixed.
        between: Which rows between bounds; all if not given.
    """

    def __init__(self, program: StepProgram, kept: Array | None = None, between: Array | None = None) -> None:
        self.count = len(program.low)
        self.complete, self.between = between is None or len(between) == self.count, between
        if between is not None:
            program = replace(
                program, T=program.T[between], W=program.W[between], low=program.low[between], high=program.high[between]
            )
        P, p, nv = program, len(program.k), len(program.g)
        self.program = P
        self.H, self.g = np.zeros((p + nv, p + nv)), np.concatenate([P.k, P.g])
        self.H[:p, :p], self.H[p:, p:] = P.K, P.H
        m = len(P.e)
        rows = np.empty((m + len(P.low), p + nv))
        rows[:m, :p], rows[:m, p:], rows[m:, :p], rows[m:, p:] = P.F, P.E, P.W, P.T
        if kept is None:
            fixed = np.concatenate([P.lower == P.upper, np.zeros(nv, bool)])
            kept = independent_rows(rows[:m, ~fixed])
            rows = np.concatenate([rows[kept], rows[m:]])
        self.kept, self.rows, self.b = kept, rows, P.e[kept]
        self.A, self.C = rows[: len(kept)], rows[len(kept) :]

    def by_daqp(self) -> tuple[StepPoint, bool]:
        """(where DAQP ends, whether that is an answer)."""
        P = self.program
        low, high = np.concatenate([self.b, P.low]), np.concatenate([self.b, P.high])
        found = solve_strict(self.H, self.g, P.lower, P.upper, self.rows, low, high)
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
        t = y[m:]
        if self.between is not None:
            t = np.zeros(self.count)
            t[self.between] = y[m:]
        return StepPoint(x[p:], x[:p], of_equations, t, z, iterations, method)
