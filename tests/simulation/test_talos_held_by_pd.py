"""Robots that are held by PD on frictional feet stay where they are, undisturbed and after a push."""

from __future__ import annotations

import numpy as np
import pytest

import rbd
from rbd.control.posture_control import HoldPosture
from rbd.control.schedules import Push

FEET_DRIFT = 1e-6
"""Over the last five of ten seconds [m]: the promise."""


def held(robot: rbd.Robot, duration: float, push: Push | None, record_every: int = 20) -> rbd.Trajectory:
    """The robot on frictional feet, at 1 ms."""
    state, feet = robot.standing(), robot.feet(0.7)
    pd = HoldPosture(state, feet)
    return rbd.simulate(
        state, feet, duration=duration, step=1e-3, controller=pd, external=push, record_every=record_every, progress=False
    )


def wandered(trajectory: rbd.Trajectory, since: float) -> float:
    """How far any point of the feet is, at any time, from where it was at a time [m]."""
    first = int(np.searchsorted(trajectory.t, since - 1e-9))
    return max(float(np.abs(x[first:] - x[first]).max()) for x in trajectory.points.values())


@pytest.mark.parametrize("force", [(0.0, 0.0, 0.0), (20.0, 0.0, 0.0)], ids=["undisturbed", "pushed"])
def test_talos_stands_for_ten_seconds(talos, force, exhaustive):
    """Its feet stay within 1e-6 m; it comes back to its posture, no contact breaks or slips, the torques are the motors'.

    Where not everything is run, undisturbed for two seconds only, and pushed for six, in which it has come to rest.
    """
    push = Push("torso_2_link", force, start=0.5, duration=0.1) if any(force) else None
    seconds = 10.0 if exhaustive else 6.0 if push is not None else 2.0
    trajectory = held(talos, seconds, push)
    assert trajectory.t[-1] == seconds and not trajectory.interrupted
    assert wandered(trajectory, 0.5 * seconds) <= FEET_DRIFT and wandered(trajectory, 0.0) <= FEET_DRIFT
    assert not trajectory.events
    assert all((modes == "sticks").all() for modes in trajectory.modes.values())
    assert (np.abs(trajectory.tau) <= talos.effort_limit).all()
    moved = np.abs(trajectory.v).max(axis=1)
    assert moved[-1] < 1e-9
    assert np.abs(trajectory.q[-1] - trajectory.q[0]).max() < 1e-8
    if push is not None:
        assert moved.max() > 0.05  # it was pushed
    else:
        assert np.abs(trajectory.energy - trajectory.energy[0]).max() < 1e-9
    for name, limit in {"law": 1e-9, "drift": 1e-9, "penetration": 1e-7}.items():
        assert trajectory.residuals[name].max() <= limit, name


def test_a_push_gives_its_impulse_and_the_feet_take_it_back(talos):
    """The momentum just after a push of 0.1 s is force times time less what friction took meanwhile; at the end it is zero."""
    push = Push("torso_2_link", (0.0, 20.0, 0.0), start=0.05, duration=0.1)
    trajectory = held(talos, 0.4, push, record_every=1)
    friction = sum(force[:, 1] for force in trajectory.forces.values())
    pushed = np.array([20.0 if push.acts(t) else 0.0 for t in trajectory.t])
    total = np.concatenate([[0.0], np.cumsum((friction + pushed)[:-1] * 1e-3)])
    assert np.abs(trajectory.momentum[:, 1] - total).max() < 0.02 * np.abs(total).max()  # a sum of left ends: order 1
    assert np.abs(total).max() > 1.0


@pytest.mark.parametrize(("name", "frame", "force"), [("g1", "torso_link", 8.0), ("solo12", "base_link", 2.0)])
def test_other_robots_stand_and_come_back_from_a_push(name, frame, force):
    """G1 on its soles and Solo12 on its four points, for two seconds."""
    robot = rbd.load_robot(name)
    trajectory = held(robot, 2.0, Push(frame, (force, 0.5 * force, 0.0), start=0.1, duration=0.1))
    speed = np.abs(trajectory.v).max(axis=1)
    assert wandered(trajectory, 0.0) <= FEET_DRIFT and not trajectory.events
    assert speed.max() > 1e-2 and speed[-1] < 2e-2 * speed.max()


def test_a_hard_push_tips_a_foot(talos):
    """220 N for 0.1 s to the side: a foot comes off the ground, which is an event, and the robot does not come back."""
    trajectory = held(talos, 0.6, Push("torso_2_link", (0.0, 220.0, 0.0), start=0.1, duration=0.1))
    assert any(e.kind == "leaves" for e in trajectory.events)
    assert min(e.t for e in trajectory.events) > 0.1
    assert trajectory.com[-1, 1] - trajectory.com[0, 1] > 0.05
    assert trajectory.residuals["penetration"].max() < 1e-6
