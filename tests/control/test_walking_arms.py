"""Arms of robots that walk: which joints they are, how they swing and are held; and where a robot faces."""

from __future__ import annotations

import math

import numpy as np
import pytest

import rbd
from rbd.control import Walk
from rbd.control.walking.arms import HeldArms, arms_of
from rbd.control.walking.gaits import heading_of
from rbd.control.walking.legs import turning_range
from rbd.errors import InputError, JointNotFound


@pytest.mark.parametrize(
    ("name", "swings"),
    [
        ("talos", ["arm_left_4_joint", "arm_right_4_joint"]),
        ("romeo", ["LShoulderPitch", "RShoulderPitch"]),
        ("icub", ["l_shoulder_pitch", "r_shoulder_pitch"]),
        ("human", ["left_shoulder_Z", "right_shoulder_Z"]),
        ("solo12", []),
    ],
)
def test_arms_are_found_in_the_model(name: str, swings: list[str]) -> None:
    """The left one, the right one; the joint that swings moves the hand forwards by what is said, as differences tell."""
    robot = rbd.load_robot(name)
    state, feet = robot.standing(), robot.feet()
    yaw = heading_of(state, feet)
    arms = arms_of(state, feet, yaw, float(state.com[2]))
    assert [arm.swing for arm in arms] == swings
    for arm in arms:
        turned = state.with_joints({arm.swing: robot.joints[arm.swing].coordinate(state.q) + 1e-6})
        moved = [(turned.joint_places([j])[1][0] - state.joint_places([j])[1][0]) / 1e-6 for j in sorted(arm.tree)]
        ahead = np.array(moved) @ [math.cos(yaw), math.sin(yaw), 0.0]
        assert np.abs(ahead - arm.rate).min() < 1e-4


def test_arms_swing_against_the_legs(talos: rbd.Robot) -> None:
    """In a step of the right foot the left hand goes forwards and the right one back; rates are those of the posture."""
    walk = Walk(talos, 1)
    (step,) = walk.plan.footsteps
    assert step.foot == "right_sole"
    places = []
    for t in (0.0, step.end + 0.1):
        state = rbd.State(talos, walk._posture(t).value)
        places.append([state.frame(f"gripper_{side}_joint").X_WF.translation[0] for side in ("left", "right")])
    left, right = np.diff(places, axis=0)[0]
    far = float(step.pose.translation[0] - walk.plan.poses["right_sole"].translation[0])
    assert left == pytest.approx(0.4 * far, rel=0.15) and right == pytest.approx(-0.4 * far, rel=0.15)
    t = 0.5 * (step.start + step.end)
    before, now, after = (walk._posture(t + by) for by in (-1e-4, 0.0, 1e-4))
    assert (after.value - before.value)[7:] / 2e-4 == pytest.approx(now.velocity[6:], abs=1e-4)
    assert (after.velocity - before.velocity) / 2e-4 == pytest.approx(now.acceleration, abs=2e-2)
    assert walk._arms is not None and Walk(talos, 1, arms=False)._arms is None


def test_arms_are_held_clear(talos: rbd.Robot) -> None:
    """From a posture with a hand at the hip they are held aside until they are 3 cm from everything; else not at all."""
    state, feet = talos.standing(), talos.feet()
    arms = HeldArms(talos, state.q, state.q, arms_of(state, feet, 0.0, float(state.com[2])))
    assert np.array_equal(arms.clear_in([state.q], [0.0]).q, state.q)
    near = state.with_joints({"arm_left_2_joint": 0.04, "arm_right_2_joint": -0.04}).q
    close = HeldArms(talos, near, near, arms.arms)
    pairs = close._pairs()
    gaps = close._gaps(near, pairs)
    assert 0.0 < gaps.min() < 0.03
    held = close.clear_in([near], [0.0])
    assert held._gaps(held.q, pairs).min() > 0.03
    moved = talos.joints["arm_left_2_joint"].q
    assert held.q[moved] > near[moved]


def test_arms_at_angles_of_ones_own(talos: rbd.Robot) -> None:
    """Held from the first step on; or by a function of time; simulated, they are there."""
    angle = {"arm_left_4_joint": -1.0, "head_1_joint": 0.1}
    walk = Walk(talos, 1, arms=angle)
    first = walk.plan.footsteps[0].start
    for name, value in angle.items():
        at = talos.joints[name].q
        assert walk._posture(0.0).value[at] == pytest.approx(walk.state.q[at])
        assert walk._posture(first).value[at] == pytest.approx([value])
    run = rbd.simulate(walk.state, walk.contacts, duration=walk.duration, step=2e-3, controller=walk, progress=False)
    assert walk.log.violations == 0
    assert run.q[-1, talos.joints["arm_left_4_joint"].q] == pytest.approx([-1.0], abs=0.03)
    waves = Walk(talos, 1, arms=lambda t: {"arm_right_4_joint": -1.0 + 0.2 * math.sin(3.0 * t)})
    at = talos.joints["arm_right_4_joint"]
    found = waves._posture(0.7)
    assert found.value[at.q] == pytest.approx([-1.0 + 0.2 * math.sin(2.1)])
    assert found.velocity[at.v] == pytest.approx([0.6 * math.cos(2.1)], abs=1e-5)


def test_arms_that_are_refused(talos: rbd.Robot) -> None:
    """What is no posture, joints of legs, angles beyond limits, names that are nearly right."""
    with pytest.raises(InputError, match="arms of Walk is .*expected True, False"):
        Walk(talos, 1, arms="swing")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="'leg_left_4_joint' carries a foot"):
        Walk(talos, 1, arms={"leg_left_4_joint": 0.5})
    with pytest.raises(InputError, match="within its limits, -2.3"):
        Walk(talos, 1, arms={"arm_left_4_joint": 1.0})
    with pytest.raises(JointNotFound, match="nearest: 'arm_left_4_joint'"):
        Walk(talos, 1, arms={"arm_left_4_join": -1.0})
    with pytest.raises(InputError, match="what arms of Walk gives at 0 s"):
        Walk(talos, 1, arms=lambda t: -1.0)  # type: ignore[arg-type, return-value]


def test_a_robot_faces_where_its_toes_point() -> None:
    """The base of iCub has its x backwards; it starts turned, its left foot on the left, and walks forwards."""
    icub, romeo = rbd.load_robot("icub"), rbd.load_robot("romeo")
    assert abs(heading_of(icub.standing(), icub.feet())) == pytest.approx(math.pi)
    assert heading_of(romeo.standing(), romeo.feet()) == pytest.approx(0.0, abs=1e-9)
    walk = Walk(icub, 2)
    assert heading_of(walk.state, walk.contacts) == pytest.approx(0.0, abs=1e-9)
    for foot in walk.contacts:
        joint = icub.model.frames[icub.model.getFrameId(foot.frame)].parentJoint
        X, ankle = walk.state.frame(foot.frame).X_WF, walk.state.joint_places([joint])[1][0]
        corners = np.array([X.act(foot.placement.act(p)) for p in foot.corners]) - ankle
        assert corners[:, 0].max() > 1.5 * -corners[:, 0].min()
        assert (X.translation[1] > 0.0) == (foot.name == "left_sole")
    assert walk.plan.centroid.com[-1, 0] > walk.plan.centroid.com[0, 0] + 0.03


def test_hips_bound_how_far_a_step_turns(exhaustive: bool) -> None:
    """Talos' hips turn by more than is asked; those of Romeo by 0.26 rad each, in exhaustive tests."""
    for name, widest in (("talos", 1.25), *((("romeo", 0.5236),) if exhaustive else ())):
        robot = rbd.load_robot(name)
        walk = Walk(robot, 1)
        found = turning_range(robot, walk.state, walk.plan.poses, "left_sole")
        assert widest - 0.05 <= found <= widest
        if found < 1.25:
            with pytest.raises(InputError, match=r"0\.2\d+ rad/s of romeo"):
                Walk(robot, 6, (0.0, 0.0, 0.35))
