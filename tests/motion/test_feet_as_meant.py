"""Faults of retargeted feet, made one by one: tilt, hover, slip, another floor; each is named, and balance is as meant."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.arrays import Array
from rbd.motion import CAUSES, Motion, MotionReport, check_motion, find_contacts

RATE, SECONDS = 60.0, 1.0
SOLE = 0.17
"""Length of a sole of G1 [m]."""


@pytest.fixture(scope="module")
def g1() -> rbd.Robot:
    """A Unitree G1."""
    return rbd.load_robot("g1")


def standing(robot: rbd.Robot, **angles: float) -> Motion:
    """A pose at rest for a second, joints changed by some angles [rad]."""
    t = np.arange(round(RATE * SECONDS) + 1) / RATE
    q = robot.standing().q.copy()
    for name, angle in angles.items():
        q[robot.joints[name if name in robot.joints else f"{name}_joint"].q] += angle
    return Motion.of_arrays(robot, t, np.repeat(q[None], len(t), axis=0))


def moved(motion: Motion, q: Array) -> Motion:
    """The same times with other configurations."""
    return Motion.of_arrays(motion.robot, motion.t, q)


def causes(report: MotionReport) -> set[str]:
    """All causes of a report."""
    return {cause for cause in CAUSES if report.of_cause(cause).any()}


@pytest.mark.parametrize("degrees", [3.0, 5.0, 8.0])
def test_a_tilted_sole_is_named_and_carries_as_meant(g1: rbd.Robot, degrees: float) -> None:
    """Both ankles turned: heels are up by the sine, the whole soles touch as meant, and the edges alone do not carry."""
    tilt = np.deg2rad(degrees)
    report = check_motion(standing(g1, left_ankle_pitch=tilt, right_ankle_pitch=tilt))
    lanes = report.lanes
    assert causes(report) == {"tilted sole"} and report.of_cause("tilted sole").all()
    assert lanes.touches.all() and lanes.on_floor.sum(axis=1) == pytest.approx(4)
    assert lanes.points.tilts(lanes.heights) == pytest.approx(tilt, abs=1e-9)
    assert lanes.heights.max() == pytest.approx(SOLE * np.sin(tilt), abs=2e-4)
    strict = check_motion(report.motion, touch_height=0.006)
    assert causes(strict) == {"tips"} and report.missing_scaled.max() < 1e-9 < strict.missing_scaled.min()


def test_a_sole_on_its_toes_touches_with_its_edge(g1: rbd.Robot) -> None:
    """Beyond 17 degrees a sole is not meant to be flat."""
    report = check_motion(standing(g1, left_ankle_pitch=0.4, right_ankle_pitch=0.4), self_collision=False)
    assert (report.lanes.touches.sum(axis=1) == 4).all() and not report.lanes.raised.any()
    assert causes(report) == {"tips"}


def hovering(robot: rbd.Robot, height: float) -> Motion:
    """The right foot level, at a height over the left one [m]."""
    low, high = 0.0, 0.5
    for _ in range(50):
        bend = 0.5 * (low + high)
        motion = standing(robot, right_hip_pitch=-bend, right_knee=2.0 * bend, right_ankle_pitch=-bend)
        z = find_contacts(motion, ground=0.0).places[0, :, 2]
        low, high = (bend, high) if z[4:].mean() - z[:4].mean() < height else (low, bend)
    return motion


def test_a_hovering_foot_is_named_and_carries_as_meant(g1: rbd.Robot) -> None:
    """18 mm over the floor; the left foot alone would tip. At a touch height of 12 mm it is in the air."""
    motion = hovering(g1, 0.018)
    report = check_motion(motion)
    assert causes(report) == {"hovering foot"} and report.of_cause("hovering foot").all()
    assert report.lanes.of_contact("right_sole").all() and report.lanes.raised[:, 4:].all()
    assert (report.reach == 0.02).all()
    assert causes(check_motion(motion, touch_height=0.012)) == {"tips"}


def test_a_foot_that_the_robot_could_lift_may_hover(g1: rbd.Robot) -> None:
    """Leant about the ankles until the centre of mass is over the left sole, still level: the right one need not carry."""
    motion, roll = hovering(g1, 0.005), 0.14
    q = motion.q.copy()
    q[:, g1.joints["left_ankle_roll_joint"].q] += roll
    q[:, g1.joints["right_ankle_roll_joint"].q] += roll
    q[:, 3:7] = [-np.sin(0.5 * roll), 0.0, 0.0, np.cos(0.5 * roll)]
    report = check_motion(moved(motion, q), touch_height=0.05, self_collision=False)
    assert report.possible.all() and report.lanes.raised[:, 4:].all() and not report.forces[:, 4:].any()


def test_a_slip_of_2_cm_a_second_is_named(g1: rbd.Robot) -> None:
    """Along the floor."""
    motion = standing(g1)
    q = motion.q.copy()
    q[:, 1] += 0.02 * motion.t
    assert causes(check_motion(moved(motion, q))) == {"slides"}


@pytest.mark.parametrize("name", ["g1", "solo12"])
@pytest.mark.parametrize("height", [-0.04, 0.04])
def test_a_floor_4_cm_off_is_fitted_and_said(name: str, height: float) -> None:
    """Given, it floats or sinks; also of feet that are points."""
    motion = standing(rbd.load_robot(name)).lifted(height)
    report = check_motion(motion)
    assert report.possible.all() and report.lanes.ground == pytest.approx(height, abs=1e-4)
    assert any(f"fitted at z = {height:.4f} m" in note for note in report.lanes.notes)
    given = check_motion(motion, ground=0.0)
    assert causes(given) == {"sinks" if height < 0.0 else "floats"}


def test_noise_is_named(g1: rbd.Robot) -> None:
    """A millimetre and a milliradian of noise, unknown to the check: accelerations of many g."""
    motion = standing(g1)
    q = motion.q + 1e-3 * np.random.default_rng(3).standard_normal(motion.q.shape)
    q[:, 3:7] /= np.linalg.norm(q[:, 3:7], axis=1)[:, None]
    report = check_motion(moved(motion, q), self_collision=False)
    assert causes(report) & {"floats", "friction", "tips"} and report.share_possible < 0.5


def test_points_of_a_quadruped_hover(g1: rbd.Robot) -> None:
    """Solo12 with one foot 18 mm up: it carries as meant where the other three would tip."""
    solo = rbd.load_robot("solo12")
    motion = standing(solo, FL_HFE=0.08, FL_KFE=-0.16)
    lanes = find_contacts(motion)
    assert 0.006 < lanes.heights[0, 0] < 0.03 and lanes.raised[:, 0].all() and lanes.touches.all()
    assert not lanes.points.tilts(lanes.heights).any()


def test_nothing_touches_for_a_second(g1: rbd.Robot) -> None:
    """It is said when, and what may be the reason."""
    t = np.arange(181) / RATE
    q = np.repeat(g1.standing().q[None], len(t), axis=0)
    q[:, 2] += np.interp(t, [0.5, 0.7, 2.3, 2.5], [0.0, 0.3, 0.3, 0.0])
    (note,) = find_contacts(Motion.of_arrays(g1, t, q)).notes
    assert note.startswith("nothing touches the floor for 1.9") and "bodies=True" in note


def leaning(robot: rbd.Robot, speed: float = 1.0) -> Motion:
    """Arms up, then a bow, in 2.2 s over the speed."""
    stands = robot.standing().q
    raises, leans = stands.copy(), stands.copy()
    for side in ("left", "right"):
        raises[robot.joints[f"{side}_shoulder_pitch_joint"].q] = -1.5
    leans[robot.joints["waist_pitch_joint"].q] = 0.5
    return rbd.motion.minimum_jerk(robot, [stands, raises, leans, stands], [0.0, 0.8 / speed, 1.4 / speed, 2.2 / speed])


def with_noise(motion: Motion, size: float) -> Motion:
    """The same with normal noise in m and rad, from one seed."""
    shaken = motion.q + size * np.random.default_rng(1).standard_normal(motion.q.shape)
    shaken[:, 3:7] /= np.linalg.norm(shaken[:, 3:7], axis=1)[:, None]
    return moved(motion, shaken)


def with_tilt(motion: Motion, degrees: float) -> Motion:
    """The same with both ankles turned."""
    q = motion.q.copy()
    for side in ("left", "right"):
        q[:, motion.robot.joints[f"{side}_ankle_pitch_joint"].q] += np.deg2rad(degrees)
    return moved(motion, q)


def with_slip(motion: Motion, speed: float) -> Motion:
    """The same, drawn along the floor [m/s]."""
    q = motion.q.copy()
    q[:, 1] += speed * motion.t
    return moved(motion, q)


def with_hover(motion: Motion, height: float) -> Motion:
    """The same, with the right foot at a height [m]."""
    pose = hovering(motion.robot, height).q[0] - motion.robot.standing().q
    return moved(motion, motion.q + pose)


SCORED = {
    "noise": (with_noise, (0.0, 5e-4, 1e-3, 2e-3, 3e-3, 1e-2)),
    "tilt": (with_tilt, (0.0, 3.0, 5.0, 8.0, 12.0, 18.0)),
    "slip": (with_slip, (0.0, 0.01, 0.02, 0.05, 0.1, 0.3)),
    "hover": (with_hover, (0.0, 0.008, 0.012, 0.018, 0.025, 0.035)),
    "speed": (lambda motion, x: leaning(motion.robot, x), (0.5, 1.0, 1.3, 1.7, 2.5, 4.0)),
}


@pytest.mark.parametrize("fault", SCORED)
def test_the_score_falls_with_each_fault(g1: rbd.Robot, fault: str) -> None:
    """100 without any; each larger fault costs at least half a point more."""
    change, sizes = SCORED[fault]
    reports = [check_motion(change(leaning(g1, 0.5), x), self_collision=False) for x in sizes]
    scores = np.array([report.score for report in reports])
    assert scores[0] == pytest.approx(100.0) and reports[0].share_possible == 1.0
    assert (np.diff(scores) < -0.5).all(), scores.round(1)
    assert all(
        0.0 <= min(r.balance, r.feet, r.motors) and r.share_possible <= min(r.balance, r.feet, r.motors) for r in reports
    )


def test_sensitivity_to_heights(g1: rbd.Robot) -> None:
    """A foot that hovers 18 mm would do if 20 mm were on the floor; soles tilted by 5 degrees too, by 3 at 12 mm."""
    assert list(check_motion(hovering(g1, 0.018)).possible_at.values()) == [0.0, 0.0, 1.0, 1.0]
    for degrees, at in ((3.0, [0.0, 1.0, 1.0, 1.0]), (5.0, [0.0, 0.0, 1.0, 1.0]), (8.0, [0.0, 0.0, 0.0, 1.0])):
        report = check_motion(with_tilt(standing(g1), degrees))
        assert list(report.possible_at.values()) == at and report.feet == 0.0 and report.balance == report.motors == 1.0
    assert list(check_motion(standing(g1)).possible_at.values()) == [1.0, 1.0, 1.0, 1.0]


@pytest.mark.parametrize(
    ("name", "degrees", "cause"),
    [("talos", -5.0, "tilted sole"), ("romeo", 5.0, "tilted sole"), ("icub", 5.0, "tilted sole")]
    + [(name, 2.0, "hovering foot") for name in ("go2", "solo12", "anymal_c")],
)
def test_robots_that_lean_as_a_whole(name: str, degrees: float, cause: str) -> None:
    """Soles of other humanoids tilt with the trunk; of quadrupeds the hind feet rise, or the front ones."""
    robot = rbd.load_robot(name)
    q = robot.standing().q.copy()
    lean = pin.SE3(pin.rpy.rpyToMatrix(0.0, np.deg2rad(degrees), 0.0), np.zeros(3))
    q[:7] = pin.SE3ToXYZQUAT(lean * pin.XYZQUATToSE3(q[:7]))
    t = np.arange(31) / RATE
    report = check_motion(Motion.of_arrays(robot, t, np.tile(q, (len(t), 1))), self_collision=False, torque_limits=False)
    assert causes(report) == {cause} and report.of_cause(cause).all() and report.balance == 1.0
    assert report.lanes.touches.all() and report.possible_at[0.03] == 1.0
