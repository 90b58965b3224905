"""Integrators of smooth motion on the manifold: of order 4 at a fixed step, and of order 8 with a step chosen by its error."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.integrate import DOP853

from rbd.arrays import Array, as_float
from rbd.errors import InputError, NoSolution
from rbd.model.state import State
from rbd.simulation.events import Moment
from rbd.simulation.motion import Motion
from rbd.simulation.smooth import SmoothMotion, Stage, reason_not_smooth

SHORTEST = 1e-9
"""No step is tried below this [s]."""


@dataclass(frozen=True)
class RungeKutta4:
    """Smooth motion at a fixed step, with an error of h^4; for constraints that hold.

    Every step has a chart of its own, q = q0 (+) xi, in which Kutta's method of 1901 is applied to (xi, v); controllers and
    external forces are asked at all four stages. Constraints are kept as `stabilisation` says. The error is not watched:
    compare two steps, or `rbd.DormandPrince8`. A step must be short against the fastest oscillation w: beyond 2.8 / w it is
    unstable.

    >>> trajectory = rbd.simulate(state, robot.loops(), duration=10.0, step=1e-3, integrator=rbd.RungeKutta4())
    """

    def reason_unsupported(self, motion: Motion, state: State) -> str | None:
        """Names the first constraint that can break or slip, or that the start does not meet; None where it can run."""
        return reason_not_smooth(motion, state)

    def run(self, motion: Motion, state: State, times: Sequence[float]) -> Iterator[Moment]:
        """One moment at each of the times, the first at `state`.

        Raises:
            NoSolution: a step without an acceleration, or out of all bounds.
        """
        smooth = SmoothMotion(motion, state)
        stage = smooth.start(state, times[0])
        yield smooth.moment(stage)
        for t, end in pairwise(times):
            stage = _kutta_step(smooth, stage, t, end)
            yield smooth.moment(stage)


def _kutta_step(smooth: SmoothMotion, first: Stage, t: float, end: float) -> Stage:
    h, v, a = end - t, first.state.v, first.a
    chart = smooth.charts.at(first.state.q)
    rates, accelerations, rate = [v], [a], v
    for part in (0.5, 0.5, 1.0):
        xi, w = part * h * rate, v + part * h * a
        stage = smooth.at(chart.q(xi), w, t + part * h)
        a, rate = stage.a, chart.rate(xi, stage.state.v)
        rates.append(rate)
        accelerations.append(a)
    xi, dv = (h / 6.0 * (k[0] + 2.0 * k[1] + 2.0 * k[2] + k[3]) for k in (rates, accelerations))
    return smooth.landed(chart.q(xi), v + dv, end)


@dataclass(frozen=True)
class DormandPrince8:
    """Smooth motion to a tolerance: steps as long as their error allows, moments between them by dense output of order 7.

    SciPy's DOP853 [Hairer1993] on (xi, v) in a chart q = q0 (+) xi that is centred anew after each step, when the constraints
    are brought back as `stabilisation` says. For constraints that hold.

    Attributes:
        rtol: Error of a step, over the size of what moves in it.
        atol: Error of a step [m, rad, and per second].
        longest: Longest step [s]: a push that is shorter, at a time when nothing else moves, could be stepped over.

    Raises:
        InputError: tolerances that are not in [1e-13, 1e-2], a longest step that is not above zero.

    >>> trajectory = rbd.simulate(state, [], duration=10.0, step=1e-2, integrator=rbd.DormandPrince8(rtol=1e-12, atol=1e-12))
    """

    rtol: float = 1e-10
    atol: float = 1e-12
    longest: float = 0.05

    def __post_init__(self) -> None:
        if not 1e-13 <= as_float(self.rtol) <= 1e-2:
            raise InputError(f"rtol of DormandPrince8 is {self.rtol!r:.80}; expected a number from 1e-13 to 1e-2.")
        if not 1e-18 <= as_float(self.atol) <= 1e-2:
            raise InputError(f"atol of DormandPrince8 is {self.atol!r:.80}; expected a number from 1e-18 to 1e-2.")
        if not as_float(self.longest) > 0.0:
            raise InputError(f"longest of DormandPrince8 is {self.longest!r:.80}; expected a time above 0 [s], or inf.")

    def reason_unsupported(self, motion: Motion, state: State) -> str | None:
        """Names the first constraint that can break or slip, or that the start does not meet; None where it can run."""
        return reason_not_smooth(motion, state)

    def run(self, motion: Motion, state: State, times: Sequence[float]) -> Iterator[Moment]:
        """One moment at each of the times, the first at `state`.

        Raises:
            NoSolution: a step without an acceleration, out of all bounds, or shorter than rounding.
        """
        smooth = SmoothMotion(motion, state)
        stage = smooth.start(state, times[0])
        yield smooth.moment(stage)
        at, h = 1, None
        while at < len(times):
            step = _AdaptiveStep(smooth, stage, self, times[-1], h)
            while at < len(times) and times[at] < step.end.t:
                yield smooth.moment(step.at(times[at]))
                at += 1
            stage, h = step.end, step.next
            if at < len(times) and times[at] == stage.t:
                yield smooth.moment(stage)
                at += 1


class _AdaptiveStep:
    """One step.

    Args:
        smooth: What moves.
        start: Where from.
        by: Tolerances.
        last: Time that is not to be passed [s].
        h: First guess of the step [s]; None for SciPy's.

    Attributes:
        end: Where to, on the constraints.
        next: Guess of the next step [s].
    """

    def __init__(self, smooth: SmoothMotion, start: Stage, by: DormandPrince8, last: float, h: float | None) -> None:
        self._smooth, self._start = smooth, start
        self._chart, self._n = smooth.charts.at(start.state.q), len(start.state.v)
        y = np.concatenate([np.zeros(self._n), start.state.v])
        first = None if h is None else min(h, last - start.t)
        while True:
            self._code = DOP853(
                self._rates, start.t, y, last, rtol=by.rtol, atol=by.atol, first_step=first, max_step=by.longest
            )
            try:
                said = self._code.step()
            except NoSolution:  # a trial too far ahead can leave the constraints, or meet a singular pose beside its branch
                first = 0.25 * float(self._code.h_abs if first is None else first)
                if first < SHORTEST * max(1.0, abs(start.t)):
                    raise
                continue
            break
        if self._code.status == "failed":
            raise NoSolution(
                f"no step is short enough at t = {start.t:.6g} s for rtol {by.rtol:g} and atol {by.atol:g}: {said} Is there a "
                "jump in the torques, or a singular pose with several motions?"
            )
        self.next = float(self._code.h_abs)
        self._between: Callable[[float], Array] | None = None
        self.end = self._landed(float(self._code.t), self._code.y)

    def at(self, t: float) -> Stage:
        """A stage within the step, by dense output, on the constraints."""
        if self._between is None:
            self._between = self._code.dense_output()
        return self._landed(t, self._between(t))

    def _landed(self, t: float, y: Array) -> Stage:
        xi, v = np.split(y, 2)
        return self._smooth.landed(self._chart.q(xi), v, t)

    def _rates(self, t: float, y: Array) -> Array:
        xi, v = np.split(y, 2)
        start = self._start
        if t == start.t and not xi.any() and np.array_equal(v, start.state.v):
            return np.concatenate([v, start.a])  # known from the step before
        stage = self._smooth.at(self._chart.q(xi), v, t)
        return np.concatenate([self._chart.rate(xi, stage.state.v), stage.a])
