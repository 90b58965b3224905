"""Faults put into a simulated walk, as from a file: found where they are, and no other half a window from the switches."""

from __future__ import annotations

import numpy as np
import pytest

import rbd
from rbd.arrays import Array
from rbd.motion import CAUSES, Motion, MotionReport, check_motion

RATE = 60
DECIMALS = 1e-6 / np.sqrt(12.0)


@pytest.fixture(scope="module")
def walk(four_steps: rbd.Trajectory) -> Motion:
    """Four steps of G1 at 60 Hz, six decimals."""
    every = round(1.0 / (RATE * float(four_steps.t[1] - four_steps.t[0])))
    q = np.round(four_steps.q[::every], 6)
    return Motion.of_arrays(four_steps.robot, np.arange(len(q)) / RATE, q, noise=DECIMALS)


@pytest.fixture(scope="module")
def far(four_steps: rbd.Trajectory, walk: Motion) -> Array:
    """Frames more than half a window from the ends and from where a sole begins or ends to carry."""
    every = round(1.0 / (RATE * float(four_steps.t[1] - four_steps.t[0])))
    carries = np.stack(
        [four_steps.point_forces[s][::every, :, 2].sum(axis=1) > 0.0 for s in ("left_sole", "right_sole")], axis=1
    )
    switched = np.flatnonzero((carries[1:] != carries[:-1]).any(axis=1))
    times = np.concatenate([walk.t[[0, -1]], walk.t[switched], walk.t[switched + 1]])
    assert walk.derivation is not None
    found = np.abs(walk.t[:, None] - times).min(axis=1) > 0.5 * walk.derivation.window + 1.0 / RATE
    assert found.sum() > 150
    return np.asarray(found)


def only(report: MotionReport, *causes: str) -> Array:
    """Frames with exactly these causes."""
    return np.asarray((report.causes == np.isin(CAUSES, causes)).all(axis=1))


def test_none(walk, far):
    """What was simulated is possible."""
    assert check_motion(walk).possible[far].all()


def test_lifted_pushed_down_and_drawn(walk, far):
    """5 cm up it floats, 3 cm down it sinks, at 5 cm/s along the floor it slides: each in every frame, and nothing else."""
    assert only(check_motion(walk.lifted(0.05), ground=0.0), "floats")[far].all()
    assert only(check_motion(walk.lifted(-0.03), ground=0.0), "sinks")[far].all()
    q = walk.q.copy()
    q[:, 0] += 0.05 * walk.t
    assert only(check_motion(Motion.of_arrays(walk.robot, walk.t, q, noise=DECIMALS)), "slides")[far].all()


def test_motors_at_sixty_percent(walk, far):
    """Some frames then need more than a motor has; the others stay possible."""
    report = check_motion(walk, torque_limits=0.6)
    weak = report.of_cause("motor")
    assert weak[far].any() and only(report, "motor")[far & weak].all()
    assert report.possible[far & ~weak].all()
    enough = check_motion(walk, self_collision=False)
    assert (enough.used_torque.max(axis=1)[far & weak] > 0.6).all()


def test_a_slippery_floor(walk, far):
    """At 0.1 part of the frames slip, at 0.02 most, and what slips there slips here."""
    some, most = check_motion(walk, friction=0.1), check_motion(walk, friction=0.02)
    assert some.of_cause("friction")[far].any()
    assert most.of_cause("friction")[far].mean() > 0.4
    assert (most.missing_scaled >= some.missing_scaled - 1e-9).all()
    assert not (some.causes[far] & ~np.isin(CAUSES, ("friction", "tips"))).any()


def test_twice_as_fast_it_mostly_tips(walk, far):
    """Four times the accelerations: the centre of pressure leaves the soles in more frames than anything else happens."""
    report = check_motion(Motion.of_arrays(walk.robot, 0.5 * walk.t, walk.q, noise=DECIMALS))
    count = {cause: report.of_cause(cause)[far].sum() for cause in CAUSES}
    assert count["tips"] > 0.4 * far.sum()
    assert max(count, key=lambda cause: count[cause]) == "tips"
    assert not report.of_cause("friction").any() and not report.of_cause("floats")[far].any()
