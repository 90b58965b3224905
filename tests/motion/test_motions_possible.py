"""Motions that `rbd.simulate` made are possible, and the forces found are those of the simulation."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rbd
from rbd.arrays import Array
from rbd.motion import CAUSES, ContactTimeline, find_contacts

NAMES = ("squat", "crouch", "four_steps", "fall")
NET = 1e-9
"""Of the weight, and of 0.3 m times the weight."""
STEP = 1.0 / 300.0
"""Of the simulation [s]: a switch is somewhere within one."""


@pytest.fixture(params=NAMES)
def simulated(request: pytest.FixtureRequest) -> rbd.Trajectory:
    """Each of the motions, at 300 Hz."""
    found: rbd.Trajectory = request.getfixturevalue(request.param)
    return found


def true_forces(trajectory: rbd.Trajectory) -> Array:
    """At the corners of the left sole, then of the right one, shape (n, 8, 3) [N]."""
    return np.concatenate([trajectory.point_forces[name] for name in ("left_sole", "right_sole")], axis=1)


def switches(trajectory: rbd.Trajectory) -> Array:
    """Times at which a sole begins or ends to carry, and both ends of the motion, from its beginning [s]."""
    pushed = true_forces(trajectory)[:, :, 2] > 0.0
    carries = np.stack([pushed[:, :4].any(axis=1), pushed[:, 4:].any(axis=1)], axis=1)
    changed = np.flatnonzero((carries[1:] != carries[:-1]).any(axis=1)) + 1
    t = trajectory.t - trajectory.t[0]
    return np.concatenate([[0.0], t[changed], t[changed - 1], [t[-1]]])


def apart(motion: rbd.Motion, times: Array, half: float) -> Array:
    """Frames that are more than half a window from all of these times."""
    return np.asarray(np.abs((motion.t - motion.t[0])[:, None] - times).min(axis=1) > half + STEP)


def true_contacts(trajectory: rbd.Trajectory, motion: rbd.Motion) -> ContactTimeline:
    """The timeline in which exactly the corners with forces touch."""
    found = find_contacts(motion)
    lanes = found.of([], [])
    for j, name in enumerate(found.names):
        for i in np.flatnonzero(true_forces(trajectory)[:, j, 2] > 0.0):
            lanes = lanes.with_touch(name, motion.t[i], motion.t[i])
    return lanes


def file_of(trajectory: rbd.Trajectory, rate: int, path: Path) -> Path:
    """A table of six decimals without a header, at a rate that divides 300 Hz."""
    np.savetxt(path, trajectory.q[:: 300 // rate], fmt="%.6f", delimiter=",")
    return path


def test_the_motions_are_what_they_are_called(
    squat: rbd.Trajectory, crouch: rbd.Trajectory, four_steps: rbd.Trajectory, fall: rbd.Trajectory
) -> None:
    assert np.ptp(squat.com[:, 2]) == pytest.approx(0.06, abs=2e-3)
    assert abs(squat.com[-1, 2] - squat.com[0, 2]) < 2e-3
    assert crouch.com[-1, 2] - crouch.com[0, 2] == pytest.approx(-0.12, abs=2e-3)
    for name in ("left_sole", "right_sole"):
        feet = four_steps.points[name].mean(axis=1)
        assert feet[-1, 0] - feet[0, 0] == pytest.approx(0.45, abs=5e-3)
        lifted = (four_steps.point_forces[name][:, :, 2] <= 0.0).all(axis=1) & (feet[:, 2] > 0.02)
        assert np.count_nonzero(np.diff(lifted.astype(int)) == 1) == 2
    toes = max(fall.points[name][0, :, 0].max() for name in ("left_sole", "right_sole"))
    assert fall.com[-1, 0] > toes + 0.2  # nothing brings it back
    assert fall.com[-1, 2] < fall.com[0, 2] - 0.05


def test_with_recorded_velocities_and_accelerations_nothing_is_missing(simulated: rbd.Trajectory) -> None:
    report = rbd.check_motion(rbd.Motion.of_trajectory(simulated), self_collision=False)
    assert report.missing_scaled.max() < 1e-9


@pytest.mark.parametrize("name", ["squat", "crouch", "fall"])
def test_motions_on_both_soles_are_possible_in_every_frame(name: str, request: pytest.FixtureRequest) -> None:
    report = rbd.check_motion(rbd.Motion.of_trajectory(request.getfixturevalue(name)[::5]))
    told = {cause: report.of_cause(cause).sum() for cause in CAUSES}
    assert report.possible.all(), told


def test_the_contacts_found_are_those_that_carry(simulated: rbd.Trajectory) -> None:
    lanes = find_contacts(rbd.Motion.of_trajectory(simulated))
    carries = true_forces(simulated)[:, :, 2] > 0.0
    assert lanes.names[:4] == tuple(f"left_sole {i + 1}" for i in range(4))
    assert not (carries & ~lanes.touches).any()  # those within 10 mm of the floor touch as well


def test_one_sole_has_the_force_of_the_simulation(four_steps: rbd.Trajectory) -> None:
    steps = four_steps[::5]
    motion = rbd.Motion.of_trajectory(steps)
    report = rbd.check_motion(motion, contacts=true_contacts(steps, motion), self_collision=False)
    force, weight = true_forces(steps), motion.robot.mass * 9.81
    one = (force[:, :4, 2] > 0.0).any(axis=1) != (force[:, 4:, 2] > 0.0).any(axis=1)
    assert one.sum() > 100
    for sole in (slice(0, 4), slice(4, 8)):
        off = np.linalg.norm((report.forces - force)[one, sole].sum(axis=1), axis=1)
        assert off.max() < NET * weight


def test_the_net_wrench_is_that_of_the_simulation(simulated: rbd.Trajectory) -> None:
    trajectory = simulated[::5]
    report = rbd.check_motion(rbd.Motion.of_trajectory(trajectory), self_collision=False)
    weight, force = trajectory.robot.mass * 9.81, true_forces(trajectory)
    off = report.forces - force
    assert np.linalg.norm(off.sum(axis=1), axis=1).max() < NET * weight
    arms = report.lanes.places - trajectory.com[:, None]
    assert np.linalg.norm(np.cross(arms, off).sum(axis=1), axis=1).max() < NET * 0.3 * weight


@pytest.mark.parametrize("order", [3, None])
@pytest.mark.parametrize("rate", [30, 60])
def test_a_file_of_six_decimals_has_the_force_of_the_simulation(
    simulated: rbd.Trajectory, rate: int, order: int | None, tmp_path: Path
) -> None:
    """Polynomials of order 3 cut off more of fast changes: with them 3 % of the weight hold, and 0.5 % in fewer frames."""
    path = file_of(simulated, rate, tmp_path / "motion.csv")
    settings = {} if order is None else {"order": order}
    motion = rbd.Motion.read(path, robot=simulated.robot, rate=rate, progress=False, **settings)
    report = rbd.check_motion(motion, self_collision=False)
    assert motion.derivation is not None
    far = apart(motion, switches(simulated), 0.5 * motion.derivation.window)
    force = true_forces(simulated)[:: 300 // rate].sum(axis=1)
    off = np.linalg.norm(report.forces.sum(axis=1) - force, axis=1) / (motion.robot.mass * 9.81)
    assert off[far].max() < 0.03
    if order is None:
        assert (off[far] < 0.005).mean() >= 0.95
    assert far.sum() >= 0.5 * motion.n or simulated.t[-1] - simulated.t[0] < 1.0
    assert report.possible[far].all(), {cause: np.flatnonzero(report.of_cause(cause)) for cause in CAUSES}
