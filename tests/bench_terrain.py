"""What ground that is not a plane costs: steps of `rbd.simulate` on it, in steps on the plane of its top, by turns.

Talos stands on its soles, Solo12 on its balls, on the middle one of three steps, and on a level grid of heights, held by the
same torques as on a plane; Talos with its toes 3 cm over an edge too. Talos falls with all its shapes onto seven boxes side by
side, and onto a plane. Run by `make bench`.
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
"""Of a step on terrain, in steps on a plane: of soles, and of feet that are balls."""
FALL_MARKS = (3.0,)
RISE, DEPTH, BOXES, BOX_M, CELL_M, OVER_M = 0.1, 0.6, 7, 0.3, 0.1, 0.03
FALL_SECONDS = 0.5


def terrain_rows(turn: int = TURN, fall: float = FALL_SECONDS, rounds: int = ROUNDS) -> list[Row]:
    """Steps on stairs and over boxes, in steps on a plane.

    Args:
        turn: Steps in a turn.
        fall: Length of a fall [s].
        rounds: Turns, of which the median counts; of falls half as many.
    """
    stairs = rbd.Terrain.stairs(RISE, DEPTH, 3, start=(-1.5 * DEPTH, 0.0, -2.0 * RISE))
    grid = rbd.Terrain.heights(np.zeros((21, 21)), CELL_M, origin=(-1.03, -1.02))
    tasks = [("on stairs, soles", "talos", stairs), ("on stairs, balls", "solo12", stairs)]
    tasks += [("on a grid of 10 cm, soles", "talos", grid), ("on a grid of 10 cm, balls", "solo12", grid)]
    tasks += [("toes 3 cm over an edge", "talos", _edge("talos"))]
    rows = [
        Row(f"a step of 1 ms {what}", {name: _steps(name, on, turn, rounds)}, "x a plane", MARKS[name])
        for what, name, on in tasks
    ]
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


def _edge(name: str) -> rbd.Terrain:
    """A level box that ends before the toes of a robot that stands."""
    state = rbd.load_robot(name).standing()
    corners = [state.frame(f.frame, f.placement.act(c)).X_WF.translation[0] for f in state.robot.soles() for c in f.corners]
    return rbd.Terrain.boxes(((-1.0, -1.0, -0.1), (max(corners) - OVER_M, 1.0, 0.0)))


def _steps(name: str, terrain: rbd.Terrain, turn: int, rounds: int) -> float:
    bench = Bench.of(name)
    grounds = [bench.swaying.robot.feet(FRICTION, on=on) for on in (terrain, 0.0)]

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
