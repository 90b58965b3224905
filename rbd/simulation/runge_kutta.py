"""The classical Runge-Kutta method of order 4 on the manifold, at a fixed step."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

from rbd.model.state import State
from rbd.simulation.moment import Moment
from rbd.simulation.motion import Motion
from rbd.simulation.smooth import SmoothMotion, Stage, reason_not_smooth


@dataclass(frozen=True)
class RungeKutta4:
    """Smooth motion at a fixed step, with an error of h^4; for constraints that hold.

    Every step has a chart of its own, q = q0 (+) xi, in which Kutta's method of 1901 is applied to (xi, v); controllers and
    external forces are asked at all four stages. Constraints are kept as `stabilisation` says. The error is not watched:
    compare two steps, or `rbd.Adaptive`. A step wants to be short against the fastest oscillation: unstable beyond 2.8 / w.

    >>> trajectory = rbd.simulate(state, robot.loops, duration=10.0, step=1e-3, integrator=rbd.RungeKutta4())
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
            stage = _step(smooth, stage, t, end)
            yield smooth.moment(stage)


def _step(smooth: SmoothMotion, first: Stage, t: float, end: float) -> Stage:
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
