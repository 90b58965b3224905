"""Faults put into simulated motions are found, each under its name, where it was put in, and nothing else."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from second_check import Frame
from test_motions_possible import apart, file_of, switches

import rbd
from rbd.motion import CAUSES, MotionReport
from rbd.motion.contact_lanes import SLOPE_S

FEET = ("squat", "crouch")
CLEAR = 1e-3
"""The two checks may differ where a frame is nearer than this to what is just possible: cones against pyramids."""


def only(report: MotionReport, *causes: str) -> bool:
    """Whether no frame has another cause than these."""
    return not any(report.of_cause(cause).any() for cause in CAUSES if cause not in causes)


def frames(report: MotionReport) -> list[Frame]:
    """The frames of a report for the second check."""
    m = report.motion
    return [Frame.of(m.robot, m.q[i], m.v[i], m.a[i], report.lanes.touches[i]) for i in range(m.n)]


@pytest.fixture(params=FEET)
def on_both(request: pytest.FixtureRequest) -> rbd.Motion:
    """A motion on both soles, at 60 Hz."""
    return rbd.Motion.of_trajectory(request.getfixturevalue(request.param)[::5])


@pytest.fixture(scope="module")
def walk(four_steps: rbd.Trajectory) -> rbd.Motion:
    """Four steps, at 60 Hz."""
    return rbd.Motion.of_trajectory(four_steps[::5])


def test_lifted_by_5_cm_over_a_given_ground_it_floats(on_both: rbd.Motion) -> None:
    report = rbd.check_motion(on_both, ground=-0.05, self_collision=False)
    assert report.of_cause("floats").all()
    assert only(report, "floats")


def test_four_steps_lifted_by_5_cm_float(walk: rbd.Motion) -> None:
    report = rbd.check_motion(walk, ground=-0.05, self_collision=False)
    assert report.of_cause("floats").all()
    assert only(report, "floats")


def test_pushed_down_by_5_cm_it_sinks(on_both: rbd.Motion) -> None:
    report = rbd.check_motion(on_both, ground=0.05, self_collision=False)
    assert report.of_cause("sinks").all()
    assert only(report, "sinks")


def slid(motion: rbd.Motion, speed: float) -> rbd.Motion:
    """A copy that is carried along x of the world at a speed [m/s]."""
    q, v = motion.q.copy(), motion.v.copy()
    q[:, 0] += speed * (motion.t - motion.t[0])
    a = motion.a.copy()
    for i in range(motion.n):
        R = rbd.State(motion.robot, motion.q[i]).base_pose().rotation
        v[i, :3] += R.T @ [speed, 0.0, 0.0]
        # In the axes of the base, which turns, a constant velocity of the world changes.
        a[i, :3] -= np.cross(motion.v[i, 3:6], R.T @ [speed, 0.0, 0.0])
    return rbd.Motion.of_arrays(motion.robot, motion.t, q, v, a)


def test_slid_by_5_cm_a_second_it_slides(on_both: rbd.Motion) -> None:
    report = rbd.check_motion(slid(on_both, 0.05), self_collision=False)
    assert report.of_cause("slides").all()
    assert only(report, "slides")
    assert report.missing_scaled.max() < 1e-9  # the same forces
    still = rbd.check_motion(slid(on_both, 0.002), self_collision=False)
    assert still.possible.all()


def test_four_steps_that_slide_are_found_in_every_frame(walk: rbd.Motion) -> None:
    report = rbd.check_motion(slid(walk, 0.05), self_collision=False)
    assert report.of_cause("slides").all()
    assert only(report, "slides")


def test_limits_of_60_percent_of_what_it_uses_break_motors(walk: rbd.Motion) -> None:
    free = rbd.check_motion(walk, self_collision=False)
    all_frames = frames(free)
    least = np.array([f.most_used_torque(0.7) for f in all_frames])
    share = 0.6 * least.max()
    report = rbd.check_motion(walk, torque_limits=float(share), self_collision=False)
    broken = report.of_cause("motor")
    over = np.flatnonzero(least > share)
    assert 5 < len(over) < 0.5 * walk.n
    assert not (broken & (least < share * (1.0 - CLEAR))).any()
    surely = np.array([all_frames[i].most_used_torque(0.7, outside=True) for i in over]) / share
    assert broken[over[surely > 1.012]].all()  # a hundredth over the limit is left to the tolerance
    assert (report.excess[over].max(axis=1) > surely - 1.012).all()
    assert only(report, "motor", "slides")
    assert np.array_equal(report.of_cause("slides"), free.of_cause("slides"))  # of feet that are being lifted


def test_the_knees_of_a_squat_break_first(squat: rbd.Trajectory) -> None:
    motion = rbd.Motion.of_trajectory(squat[::5])
    free = rbd.check_motion(motion, self_collision=False)
    least = np.array([f.most_used_torque(0.7) for f in frames(free)])
    report = rbd.check_motion(motion, torque_limits=float(0.6 * least.max()), self_collision=False)
    assert np.array_equal(report.of_cause("motor"), least > 0.6 * least.max() * 1.01)
    assert report.of_cause("motor").any()


def test_on_friction_of_a_tenth_it_slips_where_it_must(walk: rbd.Motion) -> None:
    report = rbd.check_motion(walk, friction=0.1, self_collision=False)
    missing = np.array([f.missing(0.1) for f in frames(report)])
    assert np.abs(missing - report.missing_scaled).max() < 1e-5
    bad = report.missing_scaled > 0.02
    assert 10 < bad.sum() < 0.5 * walk.n
    assert np.array_equal(report.of_cause("friction") | report.of_cause("tips"), bad)
    assert report.of_cause("friction")[bad].all()
    assert only(report, "friction", "tips", "slides")


def faster(motion: rbd.Motion, times: float) -> rbd.Motion:
    """A copy in less time."""
    m = motion
    return rbd.Motion.of_arrays(m.robot, m.t / times, m.q, m.v * times, m.a * times**2)


def test_twice_as_fast_it_mostly_tips(walk: rbd.Motion) -> None:
    report = rbd.check_motion(faster(walk, 2.0), self_collision=False)
    bad = report.missing_scaled > 0.02
    tips = report.of_cause("tips")
    assert bad.sum() > 0.3 * walk.n
    assert tips[bad].mean() > 0.8
    assert not tips[~bad].any()


FAULTS: dict[str, tuple[dict[str, float], set[str]]] = {
    "none": ({}, set()),
    "lifted": ({"ground": -0.05}, {"floats"}),
    "weak": ({"torque_limits": 0.48}, {"motor"}),
    "ice": ({"friction": 0.1}, {"friction", "tips"}),
    "slid": ({}, {"slides"}),
    "fast": ({}, {"tips", "friction", "motor"}),
}
"""What is done to four steps, the arguments of the check, and which causes that may have."""


@pytest.mark.parametrize("rate", [30, 60])
@pytest.mark.parametrize("fault", FAULTS)
def test_in_files_a_fault_is_found_but_half_a_window_from_switches(
    four_steps: rbd.Trajectory, fault: str, rate: int, tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    """Against the recorded velocities and accelerations; frames that are nearly possible, or nearly not, may go either way."""
    path = file_of(four_steps, rate, tmp_path / "motion.csv")
    recorded = rbd.Motion.of_trajectory(four_steps[:: 300 // rate])
    read = rbd.Motion.read(path, robot=four_steps.robot, rate=rate, progress=False)
    assert read.derivation is not None
    window = read.derivation.window
    times = switches(four_steps)
    if fault == "slid":
        recorded, read = slid(recorded, 0.05), slid(read, 0.05)
    elif fault == "fast":
        recorded, read, times, window = faster(recorded, 2.0), faster(read, 2.0), 0.5 * times, 0.5 * window
    given, expected = FAULTS[fault]
    true, found = (rbd.check_motion(motion, self_collision=False, **given) for motion in (recorded, read))
    doubtful = {
        "motor": np.abs(true.used_torque.max(axis=1) - 1.0) < 0.1,
        "friction": np.abs(true.missing_scaled - 0.02) < 0.012,
        "tips": np.abs(true.missing_scaled - 0.02) < 0.012,
    }
    near, seen = [], False
    for cause in CAUSES:
        far = apart(read, times, 0.5 * (SLOPE_S if cause == "slides" else window))
        sure = far & ~doubtful.get(cause, np.zeros(read.n, bool))
        off = true.of_cause(cause) != found.of_cause(cause)
        assert not off[sure].any(), cause
        assert sure.sum() > 0.75 * far.sum()
        assert cause in expected or not found.of_cause(cause)[far].any(), cause
        seen |= cause in expected and bool(found.of_cause(cause)[sure].any())
        if off.any() or true.of_cause(cause).any():
            near.append(f"{cause} {off.sum()} of {true.of_cause(cause).sum()}")
    assert seen == bool(expected)
    record_property("counted", f"four steps, {fault}, {rate} Hz: frames told otherwise near switches: {', '.join(near)}")
