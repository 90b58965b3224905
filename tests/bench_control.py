"""What a step of whole-body control costs, from State on to its certificate: the tasks of a walking robot."""

from __future__ import annotations

import statistics
import warnings
from collections.abc import Sequence

import numpy as np
from bench_answers import CALLS, UNIT
from bench_draws import Draw, Draws
from bench_peers import ConstraintDynamics
from bench_timing import Column, Row, turns

import rbd
from rbd.constraints.constraint import Constraint
from rbd.control import ComTask, FrameTask, MomentumTask, PostureTask, Task
from rbd.errors import RbdWarning

TORSO = {"talos": "torso_2_link", "g1": "torso_link"}
SUPPORTS = ("both soles", "one sole")
MARKS = (20.0, 12.0)


def walking_tasks(robot: rbd.Robot, swinging: str = "") -> list[Task]:
    """Centre of mass, angular momentum, torso, posture; and a foot that swings."""
    state = robot.standing()
    tasks: list[Task] = [
        ComTask(state.com, cost=100.0, gain=60.0),
        MomentumTask(angular_cost=0.02 * robot.mass**2, gain=3.0),
        FrameTask(TORSO[robot.name], np.eye(3), orientation_cost=10.0, gain=80.0),
        PostureTask(state.q, cost=0.5, gain=40.0),
    ]
    if swinging:
        place = state.frame(swinging).X_WF
        place.translation[2] += 0.02
        tasks.append(FrameTask(swinging, place, position_cost=100.0, orientation_cost=20.0, gain=400.0))
    return tasks


def stepping(d: Draws, draws: Sequence[Draw], support: str) -> Column:
    """A step from (q, v); with one sole the other foot swings, left and right in turn."""
    soles = d.frictional
    kinds: list[tuple[list[Task], list[Constraint]]] = [(walking_tasks(d.robot), list(soles))]
    if support != SUPPORTS[0]:
        kinds = [(walking_tasks(d.robot, soles[1 - k].frame), [soles[k]]) for k in (0, 1)]

    def run(i: int) -> rbd.control.TaskActuation:
        q, v, _ = draws[i]
        tasks, contacts = kinds[i % len(kinds)]
        return rbd.control.step(rbd.State(d.robot, q, v), tasks, contacts)

    return run


def control_rows(everyone: Sequence[Draws]) -> list[Row]:
    """Median of all steps, the worst of them, and the median over one `constraintDynamics` call."""
    median: dict[str, dict[str, float]] = {support: {} for support in SUPPORTS}
    worst: dict[str, dict[str, float]] = {support: {} for support in SUPPORTS}
    over: dict[str, dict[str, float]] = {support: {} for support in SUPPORTS}
    for d in everyone:
        draws, name = d.sticking(), d.robot.name
        columns = {UNIT: ConstraintDynamics(d).column(draws)} | {each: stepping(d, draws, each) for each in SUPPORTS}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RbdWarning)
            times = turns(columns)
        unit = statistics.median(times[UNIT])
        for each in SUPPORTS:
            found = statistics.median(times[each])
            median[each][name], worst[each][name], over[each][name] = 1e6 * found, 1e6 * max(times[each]), found / unit
    what = "rbd.control.step, a walking robot's tasks"
    return [
        *(Row(f"{what}, {each}", median[each], "us") for each in SUPPORTS),
        *(Row(f"{what}, {each}, the slowest", worst[each], "us") for each in SUPPORTS),
        *(Row(f"{what}, {each}", over[each], CALLS, MARKS) for each in SUPPORTS),
    ]
