"""Walks of quadrupeds, certified on every tenth frame by the general solver."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import rbd
from rbd.control import Walk

FRICTION, STEP = 0.6, 2e-3
AT_REST = 4e-6
"""Feet that stand move by no more [m/s]."""


def walk_of(label: str) -> Walk:
    """Six steps of a robot by a gait."""
    name, gait = label.split()
    return Walk(rbd.load_robot(name), 6, gait=gait, friction=FRICTION)


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


def speed(state: rbd.State, foot: Any) -> float:
    """The largest speed of a foot's corners [m/s]."""
    return max(float(np.linalg.norm(state.frame(foot.frame, foot.placement.act(p)).J[:3] @ state.v)) for p in foot.corners)


def certify(walk: Walk, run: rbd.Trajectory) -> float:
    """Every tenth frame again by `rbd.solve`: its certificate, the same accelerations and forces of points; share of frames.

    Left out are frames in which a foot lands, leaves or slides: a corner touches, and it or others move.
    """
    weight, frames, done = walk.robot.mass * 9.81, range(0, len(run.t) - 1, 10), 0
    for i in frames:
        state, feet = run.state(i), [foot for foot in walk.contacts if run.modes[foot.name][i] != "open"]
        if any(speed(state, foot) > AT_REST for foot in feet):
            continue
        found = rbd.solve(state, tau=run.tau[i], constraints=feet, rest_speed=1e-4)
        assert found.residuals.within(1e-9), (i, found.residuals)
        assert found.a == pytest.approx(run.a[i], abs=1e-6), i
        for foot in feet:
            if len(foot.corners) == 1:  # forces of soles need not be unique
                assert found.forces[foot.name] == pytest.approx(run.forces[foot.name][i], abs=1e-9 * weight)
        done += 1
    return done / len(frames)


TABLE = tuple(f"{name} {gait}" for name in ("solo12", "go2") for gait in ("trot", "crawl", "bound"))


def test_walks_of_the_table_are_certified(exhaustive: bool) -> None:
    """No violated step, standing at the end; one by default, all in exhaustive tests."""
    for label in TABLE if exhaustive else TABLE[:1]:
        walk = walk_of(label)
        run = walked(walk)
        assert walk.log.violations == 0, label
        assert np.abs(run.v[-1, :6]).max() < 0.025 and slip(walk, run) < 1e-4, label
        assert certify(walk, run) > (0.5 if walk.gait.flies else 0.9), label
