"""The same numbers in any order, company and number of threads; one world's trouble is its own; input that is refused."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from drawn_worlds import drawn, leg, standing

import rbd
from rbd.worlds import Servo, WorldPushes, Worlds

pytestmark = pytest.mark.filterwarnings("ignore::rbd.errors.InaccurateWarning")


def kicked(chosen, n=19, threads=1, seed=4):
    """Some of n random worlds of Solo12, with a push that begins on a step, 0.03 s long."""
    robot, contacts, q, v, tau, mu = drawn("solo12", n, seed)
    push = WorldPushes("base_link", np.outer(np.arange(n), [1.0, -0.5, 0.2])[chosen], start=0.007, duration=0.006)
    worlds = Worlds(
        robot, contacts, q[chosen], v[chosen], step=1e-3, friction=mu[chosen], pushes=push, threads=threads,
        mass=np.linspace(0.9, 1.1, n)[chosen],
    )  # fmt: skip
    worlds.drive(tau=tau[chosen])
    return worlds


def told(worlds, some=slice(None)):
    """All that a run tells of some worlds."""
    return [x[some].tobytes() for x in (worlds.q, worlds.v, worlds.point_forces, worlds.residual, worlds.depth)]


def test_bits_do_not_depend_on_threads_order_company_or_calls():
    """19 kicked worlds: on 1 and 2 threads, backwards, alone, and step by step."""
    every = np.arange(19)
    first = kicked(every)
    first.advance(30)
    second = kicked(every, threads=2)
    second.advance(30)
    assert told(first) == told(second)
    back = kicked(every[::-1])
    back.advance(30)
    assert told(first) == told(back, slice(None, None, -1))
    for i in (0, 7, 18):
        one = kicked(every[i : i + 1])
        for _ in range(30):
            one.advance()
        assert told(one) == told(first, slice(i, i + 1))
    some = kicked(every[5:14])
    for steps in (7, 1, 22):
        some.advance(steps)
    assert told(some) == told(first, slice(5, 14))
    assert first.v.std(axis=0).min() > 1e-3


def test_one_world_leaves_a_run_as_it_is():
    """A world taken out in the middle goes on as the others do."""
    worlds = kicked(np.arange(10))
    worlds.advance(11)
    one = worlds.only(9)
    worlds.advance(12)
    one.advance(12)
    assert one.q.tobytes() == worlds.q[9:].tobytes() and one.v.tobytes() == worlds.v[9:].tobytes()


def test_interpreted_scalar_and_compiled_worlds_agree_and_an_early_end_is_flagged():
    """The kernels as they are written give the same to rounding; impulses 1e-6 off in one lane are seen by both residuals."""
    here = Path(__file__).parent
    path = os.pathsep.join([str(here), str(here.parents[1]), os.environ.get("PYTHONPATH", "")])
    environment = dict(os.environ, RBD_COMPILED="0", PYTHONPATH=path)
    done = subprocess.run(
        [sys.executable, str(here / "interpreted_worlds.py")], env=environment, capture_output=True, text=True, check=True
    )
    found = json.loads(done.stdout)
    robot, contacts, q, v, tau, mu = drawn("leg", 3, 1)
    v[0] = 0.0
    worlds = Worlds(robot, contacts, q, v, step=2e-3, friction=mu)
    worlds.drive(tau=tau)
    worlds.advance(3)
    assert np.abs(worlds.q - found["q"]).max() < 1e-12 and np.abs(worlds.v - found["v"]).max() < 1e-9
    for i, (q_alone, v_alone) in enumerate(found["alone"]):
        assert np.abs(worlds.q[i] - q_alone).max() < 1e-12 and np.abs(worlds.v[i] - v_alone).max() < 1e-9
    assert max(found["residual"]) < 1e-8
    assert found["early"][1] > 1e-8 > max(found["early"][0], found["early"][2])
    assert found["flagged"] == [0, 1, 2] and found["law"] > 1e-7


def test_a_world_that_is_not_finite_stops_alone():
    """NaN in the start of world 2 and torques that are infinite in world 5 from 10 ms on: the others go on to the same bits."""
    robot, contacts, q, v, tau, _ = drawn("solo12", 9, 8)
    good = rbd.simulate_many((robot, q, v), contacts, duration=0.02, step=1e-3, tau=tau)
    bad = v.copy()
    bad[2, 4] = np.nan
    with pytest.warns(rbd.errors.InaccurateWarning, match="of 9 worlds of solo12 1 are not accurate: world 2"):
        worlds = rbd.simulate_many((robot, q, bad), contacts, duration=0.02, step=1e-3, tau=tau)
    assert worlds.flagged.tolist() == [2] and np.isnan(worlds.q[2, -1]).all() and "not finite" in worlds.refused[2]
    rest = np.delete(np.arange(9), 2)
    assert worlds.q[rest].tobytes() == good.q[rest].tobytes()
    with pytest.raises(rbd.InputError, match="world 2 stopped before step 1"):
        worlds.state(2)
    running = Worlds(robot, contacts, q, v, step=1e-3)
    running.drive(tau=tau)
    running.advance(10)
    running.drive(tau=np.where(np.arange(9)[:, None] == 5, 1e300, tau))
    running.advance(10)
    assert np.flatnonzero(running.stopped >= 0).tolist() == [5] and running.stopped[5] >= 10
    rest = np.delete(np.arange(9), 5)
    assert running.q[rest].tobytes() == good.q[rest, -1].tobytes()


def refused(match, error=rbd.InputError, state=None, contacts=(), **given):
    """That a call is refused with a message."""
    state = leg().at([0.6, 0.2, -0.5]) if state is None else state
    with pytest.raises(error, match=match):
        rbd.simulate_many(state, contacts, **{"duration": 0.01, "step": 1e-3, **given})


def test_bad_input_is_named():
    """Lengths, worlds, joints, constraints and steps: each message says which."""
    foot = [rbd.PointContact("foot", "foot", friction=0.8, on=0.0)]
    refused(
        r"mass of 'carriage' has 3 entries, and friction 2: world 2 has no entry in friction",
        contacts=foot, friction=[0.5, 0.6], mass={"carriage": [1, 2, 3]},
    )  # fmt: skip
    two, three = [leg().at([0.6, 0.2, -0.5])] * 2, [0.0, 0.0, 0.0]
    refused(r"ground has 3 entries, and the array of states 2: world 2 has no entry in the", state=two, ground=three)
    refused(r"ground has 3 entries, and gravity 2: world 2 has no entry in gravity", gravity=np.zeros((2, 3)), ground=three)
    refused(r"gravity has shape \(2,\)", gravity=[0.0, 1.0])
    refused(r"gravity is not finite in world 1", gravity=[[0, 0, -9.8], [0, np.inf, 0]])
    refused(r"tau have shape \(3,\); expected \(1, 2\)", tau=np.zeros(3))
    refused(r"tau are not finite in world 1", tau=np.array([[0.0, 0.0], [np.nan, 0.0]]))
    refused(
        r"torques of the controller at t = 0.004 s are not finite in world 0",
        controller=lambda t, q, v: np.full((1, 2), np.nan if t > 0.0035 else 0.0),
    )
    refused("controller is 3", controller=3)
    refused("ankle", rbd.errors.UnknownName, damping={"ankle": 1.0})
    refused("carriag", rbd.errors.UnknownName, mass={"carriag": 1.0})
    refused("multiplied by -1", mass=-1.0)
    refused("stiffness and damping are negative", controller=Servo(-1.0, 0.0, target=[0, 0]))
    refused(r"too long for the stiffness at '(hip|knee)'.* expected at most", controller=Servo(1e6, 0.0, target=[0, 0]))
    refused("0.01 s is 3.33333 steps", step=3e-3)
    refused("record is 0", record=0)
    refused("every is -1", every=-1)
    refused("'lock' is a JointLock; simulate_many takes", rbd.errors.Unsupported, contacts=[rbd.JointLock("lock", "hip")])
    held = [rbd.PointContact("held", "foot", on=0.0)]
    refused("'held' is a PointContact; simulate_many takes", rbd.errors.Unsupported, contacts=held)
    belt = [rbd.PointContact("foot", "foot", friction=0.5, on=rbd.Ground(velocity=(0.1, 0, 0)))]
    refused("ground of 'foot' moves", rbd.errors.Unsupported, contacts=belt)
    refused("acts on the world", pushes=WorldPushes("universe", (0, 0, 1.0), start=0.0, duration=1.0))
    ball = rbd.RobotBuilder("ball joint", root="fixed")
    ball.body("bob", mass=1.0, com=(0, 0, -1), inertia=np.eye(3))
    ball.joint("socket", "ground", "bob", "ball")
    robot = ball.robot()
    refused(
        "joint 'socket' of ball joint is a JointModelSpherical", rbd.errors.Unsupported, state=rbd.State(robot, [0, 0, 0, 1.0])
    )
    refused("state 1 is of solo12, the first of leg", state=[leg().at([0.6, 0.2, -0.5]), standing("solo12")[0]])
