"""The walks of the manual's table, each certified on every tenth frame by the general solver."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.control import Push, Walk
from rbd.errors import InputError
from rbd.model.checked_model import CheckedModel

FRICTION, STEP = 0.6, 2e-3
AT_REST = 4e-6
"""Feet that stand move by no more [m/s]."""
BIPEDS = ("talos", "talos_full", "talos_corrected", "talos_box", "talos_full_box", "g1", "g1_hands", "icub", "romeo", "human")
QUADRUPEDS = ("solo12", "go2", "go1", "a1", "anymal_b", "anymal_c", "hyq", "b1")
TASKS = ("turn", "aside", "backwards", "stairs", "up", "down", "across", "slippery", "heavy", "light")


def walk_of(label: str) -> Walk:
    """A walk by its label: robot and gait, or robot and task."""
    name, what = label.split()
    robot, steps, given = rbd.load_robot(name), 6, dict[str, Any]()
    velocity: tuple[float, float, float] | None = None
    stand = robot.standing()
    period = 3.35 * math.sqrt(float(stand.com[2]) / 9.81)
    if what in ("crawl", "trot", "pace", "bound"):
        given["gait"] = what
    elif what in ("turn", "aside", "backwards"):
        turn = math.pi / 12.0 / period
        velocity = {"turn": (0.0, 0.0, turn), "aside": (0.0, 0.08, 0.0), "backwards": (-0.15, 0.0, 0.0)}[what]
    elif what == "stairs":
        steps, start = 12, (float(stand.com[0]) + 0.25, 0.0, 0.0)
        given["terrain"] = rbd.Terrain.stairs(0.1, 0.3, 3, start=start, down=True)
    elif what in ("up", "down", "across"):
        a = math.radians(8.0)
        way = {"up": (-1.0, 0.0), "down": (1.0, 0.0), "across": (0.0, 1.0)}[what]
        given["terrain"] = rbd.Ground(point=(0.0, 0.0, 0.0), normal=(math.sin(a) * way[0], math.sin(a) * way[1], math.cos(a)))
    elif what in ("heavy", "light"):
        model, share = robot.model.copy(), 1.2 if what == "heavy" else 0.8
        for i in range(1, model.njoints):
            each = model.inertias[i]
            model.inertias[i] = pin.Inertia(share * each.mass, each.lever, share * each.inertia)
        given["model"] = CheckedModel(model, name=what)
    return Walk(robot, steps, velocity, friction=0.3 if what == "slippery" else FRICTION, **given)


def walked(walk: Walk, **given: Any) -> rbd.Trajectory:
    """The motion of a walk."""
    return rbd.simulate(walk.state, walk.contacts, duration=walk.duration, step=STEP, controller=walk, progress=False, **given)


def slip(walk: Walk, run: rbd.Trajectory) -> float:
    """How far a foot moves along the ground at most while its plan has it stand, and it touches [m]."""
    out = 0.0
    for foot in walk.contacts:
        offset = foot.placement.act(foot.corners.mean(axis=0))
        places = np.array([run.state(i).frame(foot.frame, offset).X_WF.translation[:2] for i in range(0, len(run.t), 5)])
        for _, first, last in walk.plan.stays(foot.name):
            some = places[(run.t[::5] > first + 0.1) & (run.t[::5] < last)]
            out = max(out, float(np.ptp(some, axis=0).max(initial=0.0)) if len(some) else 0.0)
    return out


def push_of(walk: Walk, link: str, force: float, angle: float) -> Push:
    """A level push of 0.1 s, 30 % into the third swing."""
    step, a = walk.plan.footsteps[2], math.radians(angle)
    start = step.start + 0.3 * (step.end - step.start)
    return Push(link, force * np.array([math.cos(a), math.sin(a), 0.0]), start=start, duration=0.1)


def speed(state: rbd.State, foot: Any) -> float:
    """The largest speed of a foot's corners [m/s]."""
    return max(float(np.linalg.norm(state.frame(foot.frame, foot.placement.act(p)).J[:3] @ state.v)) for p in foot.corners)


def certify(walk: Walk, run: rbd.Trajectory, push: Push | None = None) -> float:
    """Every tenth frame again by `rbd.solve`: its certificate, the same accelerations and forces of points; share of frames.

    Left out are frames in which a foot lands, leaves or slides: a corner touches, and it or others move.
    """
    weight, frames, done = walk.robot.mass * 9.81, range(0, len(run.t) - 1, 10), 0
    for i in frames:
        state, feet = run.state(i), [foot for foot in walk.contacts if run.modes[foot.name][i] != "open"]
        if any(speed(state, foot) > AT_REST for foot in feet):
            continue
        outside = () if push is None else push(state, float(run.t[i]))
        found = rbd.solve(state, tau=run.tau[i], constraints=feet, external=outside, rest_speed=1e-4)
        assert found.residuals.within(1e-9), (i, found.residuals)
        assert found.a == pytest.approx(run.a[i], abs=1e-6), i
        for foot in feet:
            if len(foot.corners) == 1:  # forces of soles need not be unique
                assert found.forces[foot.name] == pytest.approx(run.forces[foot.name][i], abs=1e-9 * weight)
        done += 1
    return done / len(frames)


TABLE = (
    *(f"{name} walk" for name in BIPEDS),
    *(f"{name} {gait}" for name in QUADRUPEDS for gait in ("crawl", "trot", "pace", "bound")),
    *(f"{name} {task}" for name in ("talos", "g1") for task in TASKS),
)
PUSHES = (("talos", "torso_2_link", 300.0), ("g1", "torso_link", 60.0))
REFUSED = {
    *(f"{name} pace" for name in ("solo12", "go1", "a1", "anymal_c", "hyq")),
    *(f"{name} bound" for name in ("anymal_c", "hyq", "b1")),
}
"""Before the first step, as the manual says."""


def test_walks_of_the_table_are_certified(exhaustive: bool) -> None:
    """No violated step, standing at the end, but after a pace; one by default."""
    for label in TABLE if exhaustive else ("solo12 bound",):
        if label in REFUSED:
            with pytest.raises(InputError):
                walk_of(label)
            continue
        walk = walk_of(label)
        run = walked(walk)
        assert walk.log.violations == 0, label
        assert label.endswith("pace") or np.abs(run.v[-1, :6]).max() < 0.02, label
        assert label.endswith("pace") or slip(walk, run) < 1e-4, label
        assert certify(walk, run) > 0.7, label


def test_pushed_walks_are_certified(exhaustive: bool) -> None:
    """With the push as a force of the world, in four directions; in exhaustive tests."""
    for name, link, force in PUSHES if exhaustive else ():
        for angle in (0.0, 90.0, 180.0, 270.0):
            walk = walk_of(f"{name} walk")
            push = push_of(walk, link, force, angle)
            run = walked(walk, external=push)
            assert walk.log.violations == 0 and np.abs(run.v[-1, :6]).max() < 0.02, (name, angle)
            assert certify(walk, run, push) > 0.7
