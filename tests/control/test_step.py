"""A step of whole-body control: equal to a dense program, its equations met, its violation the least, the same bits again."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np
import pinocchio as pin
import pytest
from dense_step import dense_step
from moving_states import NAMES, drawn, robot

import rbd
from rbd.arrays import Array
from rbd.constraints.constraint import Constraint
from rbd.control import ComTask, FrameTask, Limits, MomentumTask, PostureTask, Task, step
from rbd.control.step_problem import StepProblem
from rbd.errors import RelaxedLimitsWarning

G = 9.81
ONLY_TORQUES = Limits(position=False, velocity=False)
TORSO = {"talos": "torso_2_link", "g1": "torso_link", "solo12": "base_link"}


def relative(found: Array, expected: Array) -> float:
    return float(np.abs(found - expected).max() / max(1.0, np.abs(expected).max()))


def tasks_of(state: rbd.State, rng: np.random.Generator) -> list[Task]:
    """Those of a walking robot, their targets a little off."""
    one = state.robot
    posture = PostureTask(pin.integrate(one.model, state.q, 0.1 * rng.normal(size=one.nv)), cost=0.5, gain=40.0)
    if not one.floating:
        return [posture]
    torso = FrameTask(TORSO[one.name], np.eye(3), orientation_cost=10.0, gain=80.0)
    com = ComTask(state.com + 0.02 * rng.normal(size=3), cost=100.0, gain=60.0)
    return [com, MomentumTask(angular_cost=0.02 * one.mass**2, gain=3.0), torso, posture]


def problem_of(state: rbd.State, tasks: Sequence[Task], contacts: Sequence[Constraint], **given: object) -> StepProblem:
    """What `step` solves."""
    asked = {"limits": Limits(), "external": None, "normal_force": None} | given
    return StepProblem.of(
        state, tasks, contacts, 0.0, asked["limits"], asked["external"], asked["normal_force"], 50.0, stacklevel=2
    )  # type: ignore[arg-type]


# ------------------------------------------------------------------------------------------------ another program


@pytest.mark.parametrize("name", NAMES)
def test_a_step_equals_a_dense_program_with_nothing_eliminated(name: str) -> None:
    """50 random moving states of each robot, on all feet or one fewer, with few or many torques: a and tau to 1e-8."""
    one, rng = robot(name), np.random.default_rng(1)
    limited, unloaded, count = 0, 0, 0
    for i in range(50):
        moving = drawn(one, rng)
        state, contacts = moving.state, list(moving.contacts)
        if one.floating and i % 2:
            contacts = contacts[1:]
        tasks, share = tasks_of(state, rng), (1.0, 0.3, 0.15)[i % 3]
        limits = Limits(torque=share, position=False, velocity=i % 5 == 1, horizon=0.5)
        normal = {contacts[-1].name: (0.0, 0.3 * one.mass * G)} if one.floating and i % 4 == 3 else None
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RelaxedLimitsWarning)
            found = step(state, tasks, contacts, limits=limits, normal_force=normal)
        if found.violation is not None:
            continue
        count += 1
        bounds = limits.accelerations(state)
        a, tau, miss = dense_step(state, tasks, contacts, share=share, normal_force=normal, bounds=bounds)
        assert miss < 1e-11
        assert relative(found.a, a) < 1e-8 and relative(found.tau, tau) < 1e-8, i
        assert found.status == "solved" and found.residuals.worst < 1e-9
        limited += "torque" in found.at_limit
        unloaded += bool((found.weights[found.loads.sets.lower == 0.0] == 0.0).any())
    assert count >= 40
    least = {"talos": (20, 30), "g1": (20, 30), "solo12": (0, 30), "leg": (0, 0)}[
        name
    ]  # solo12's limits are far, the leg has no cones
    assert limited >= least[0] and unloaded >= least[1]
