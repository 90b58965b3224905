"""What ground that is not a plane costs: steps of `rbd.simulate` on it, in steps on the plane of its top, by turns.

Talos stands on its soles, Solo12 on its balls, on the middle one of three steps, held by the same torques as on a plane; Talos
falls with all its shapes onto seven boxes side by side, and onto a plane. Run by `make bench`.
"""

from __future__ import annotations

import statistics
import warnings
from collections.abc import Callable, Sequence

import numpy as np
from bench_simulation import FRICTION, ROUNDS, STEP, TURN, Bench
from bench_timing import Row, once

import rbd
from rbd.errors import RbdWarning

MARKS = {"talos": (2.0,), "solo12": (3.0,)}
"""Of a step on stairs, in steps on a plane: of soles, and of feet that are balls."""
FALL_MARKS = (3.0,)
RISE, DEPTH, BOXES, BOX_M = 0.1, 0.6, 7, 0.3
FALL_SECONDS = 0.5


def terrain_rows(turn: int = TURN, fall: float = FALL_SECONDS, rounds: int = ROUNDS) -> list[Row]:
    """Steps on stairs and over boxes, in steps on a plane.

    Args:
        turn: Steps in a turn.
        fall: Length of a fall [s].
        rounds: Turns, of which the median counts; of falls half as many.
    """
    rows = [Row(f"a step of 1 ms on stairs, {what}", {name: _stairs(name, turn, rounds)}, "x a plane", MARKS[name])
            for name, what in (("talos", "soles"), ("solo12", "balls"))]  # fmt: skip
    ratio = _falls(fall, max(rounds // 2, 1))
    return [*rows, Row(f"falling onto {BOXES} boxes, all shapes", {"talos": ratio}, "x a plane", FALL_MARKS)]


def _ratio(runs: Sequence[Callable[[], object]], rounds: int) -> float:
    """The median time of the first in those of the second, by turns."""
    times = list[list[float]]()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RbdWarning)
        for run in runs:  # what is compiled or prepared on first use
            run()
        for _ in range(rounds):
            times.append([once(run) for run in runs])
    one, other = np.array(times).T.tolist()
    return statistics.median(one) / statistics.median(other)


def _stairs(name: str, turn: int, rounds: int) -> float:
    bench = Bench.of(name)
    stairs = rbd.Terrain.stairs(RISE, DEPTH, 3, start=(-1.5 * DEPTH, 0.0, -2.0 * RISE))
    grounds = [bench.swaying.robot.feet(FRICTION, on=on) for on in (stairs, 0.0)]

    def stands(feet: Sequence[object]) -> object:
        return rbd.simulate(
            bench.swaying, feet, duration=turn * STEP, step=STEP, controller=bench.held, record_every=turn, progress=False
        )

    return _ratio([lambda feet=feet: stands(feet) for feet in grounds], rounds)


def _falls(duration: float, rounds: int) -> float:
    """A robot without torques, from its standing posture, turning forward."""
    robot = rbd.load_robot("talos")
    ends = [((BOX_M * (k - 2), -2.0, -0.5), (BOX_M * (k - 1), 2.0, 0.0)) for k in range(BOXES)]
    v = np.zeros(robot.nv)
    v[3:6] = 0.0, 2.0, 0.1
    start = robot.standing().with_velocity(v)

    def falls(on: rbd.Terrain | float) -> object:
        ground = rbd.CollisionContacts("ground", robot, friction=0.7, on=on)
        return rbd.simulate(start, [ground], duration=duration, step=STEP, record_every=10, progress=False)

    return _ratio([lambda on=on: falls(on) for on in (rbd.Terrain.boxes(*ends), 0.0)], rounds)
