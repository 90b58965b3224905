"""A controller that follows a motion: as near as the step and the motors allow."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.control import TrackingController, ZeroOrderHold
from rbd.control.schedules import AcceptedStep, SteppedController
from rbd.errors import CannotMove, InputError
from rbd.model.sampled_motion import interpolated_q
from rbd.motion import minimum_jerk


@pytest.fixture(scope="module")
def reach() -> rbd.Motion:
    """A Panda reaches out and comes back, in 1.2 s."""
    panda = rbd.load_robot("panda", root="fixed")
    rest = panda.at().q
    far = rest.copy()
    far[:7] += [0.8, -0.5, 0.6, 0.7, -0.5, 0.6, 0.9]
    return minimum_jerk(panda, [rest, far, rest], [0.0, 0.6, 1.2])


def crouch(robot: rbd.Robot, bend: float, duration: float) -> rbd.Motion:
    """Talos bends its knees by twice an angle and straightens them, the soles where they are."""
    stands = robot.standing().q
    sole = robot.standing().frame("left_sole_link").X_WF

    def way(u: float) -> float:
        u = min(max(u, 0.0), 1.0)
        return u**3 * (10.0 - 15.0 * u + 6.0 * u**2)

    def q(t: float) -> np.ndarray:
        angle, out = bend * (way(2.0 * t / duration) - way(2.0 * t / duration - 1.0)), stands.copy()
        for side in ("left", "right"):
            for number, share in ((3, -1.0), (4, 2.0), (5, -1.0)):
                out[robot.joints[f"leg_{side}_{number}_joint"].q] += share * angle
        moved = rbd.State(robot, out).frame("left_sole_link").X_WF
        out[:7] = pin.SE3ToXYZQUAT(sole * moved.inverse() * pin.XYZQUATToSE3(out[:7]))
        return out

    return rbd.Motion.from_function(robot, q, np.linspace(0.0, duration, round(60 * duration) + 1))


def farthest(motion: rbd.Motion, moved: rbd.Trajectory) -> np.ndarray:
    """Largest distance of each coordinate from the motion, shape (nv,)."""
    wanted = interpolated_q(motion.robot, motion.t, motion.q, motion.v, moved.t)
    off = [pin.difference(motion.robot.model, a, b) for a, b in zip(wanted, moved.q, strict=True)]
    return np.abs(off).max(axis=0)


def test_an_arm_follows_a_fast_motion_with_an_error_of_the_order_of_the_step(reach: rbd.Motion) -> None:
    """Torques held for a step lag by half of it; halving the step halves the error."""
    off = []
    for step in (4e-3, 2e-3, 1e-3):
        follow = ZeroOrderHold(TrackingController(reach, every=2e-3), step)
        off.append(
            farthest(reach, rbd.simulate(reach.state(0), duration=1.2, step=step, controller=follow, progress=False)).max()
        )
    assert np.abs(reach.v).max() > 2.0  # rad/s
    assert off[2] < 3e-3  # rad
    assert off[1] / off[0] == pytest.approx(0.5, abs=0.02)
    assert off[2] / off[1] == pytest.approx(0.5, abs=0.02)


def test_torques_between_frames_are_those_of_the_motion(reach: rbd.Motion) -> None:
    """What remains with torques at all times is their linear interpolation between thirds and fifths of a frame."""
    off = [
        farthest(
            reach,
            rbd.simulate(
                reach.state(0), duration=1.2, step=2e-3, controller=TrackingController(reach, every=every), progress=False
            ),
        ).max()
        for every in (8e-3, 4e-3)
    ]
    assert off[1] < 1e-4
    assert off[0] / off[1] == pytest.approx((5.0 / 3.0) ** 2, rel=0.05)


def test_feed_forward_makes_the_difference(reach: rbd.Motion) -> None:
    """Torques that hold the weight alone leave the arm a radian behind where inverse dynamics leaves 1e-4."""
    off = {}
    for torques in ("exact", "weight", "none"):
        follow = TrackingController(reach, torques=torques)
        run = rbd.simulate(reach.state(0), duration=1.2, step=2e-3, controller=follow, progress=False)
        off[torques] = farthest(reach, run).max()
    assert off["exact"] < 2e-4
    assert off["weight"] > 0.5
    assert off["none"] > 0.5


def test_a_simulation_counts_its_steps_and_clipped_torques(reach: rbd.Motion) -> None:
    """A motion too fast for the motors, with its nearest torques: each step counts once, and those at a limit are named."""
    panda, rest = reach.robot, reach.q[0]
    quick = minimum_jerk(panda, [rest, rest + 2.5 * (np.arange(panda.nq) == 0), rest], [0.0, 0.15, 0.3])
    follow = TrackingController(quick, torques="nearest")
    for _ in range(2):  # the second run starts from zero
        rbd.simulate(quick.state(0), duration=0.3, step=1e-3, controller=follow, progress=False)
        assert follow.steps == 301
        assert 0 < follow.clipped["panda_joint5"] < 301


def test_joint_gains_take_the_place_of_a_frequency(reach: rbd.Motion) -> None:
    """Torques beyond those of the motion: K (q_ref - q) + D (v_ref - v), joint by joint."""
    robot, stiffness = reach.robot, np.arange(1.0, 1.0 + reach.robot.nu)
    follow = TrackingController(reach, stiffness=stiffness, damping=0.5)
    t = float(reach.t[20])
    bent = reach.state(20).with_joints({"panda_joint2": reach.q[20, 1] + 0.1})
    slow = bent.with_velocity(np.zeros(robot.nv))
    i = int(np.argmin(np.abs(follow.reference.t - t)))
    expected = follow.reference.tau[i] + 0.5 * reach.v[20]
    expected[1] -= 0.1 * stiffness[1]
    assert follow(slow, t) == pytest.approx(expected, abs=1e-9)


def test_talos_crouches_and_rises_on_its_soles() -> None:
    """14 cm down and up within a second: a millimetre of error, where weight alone gives twenty."""
    talos = rbd.load_robot("talos")
    motion, soles = crouch(talos, 0.35, 1.0), talos.soles(friction=0.7)
    off = {}
    for torques in ("exact", "weight"):
        follow = TrackingController(motion, soles, torques=torques)
        run = rbd.simulate(motion.state(0), soles, duration=1.0, step=4e-3, controller=follow, progress=False)
        off[torques] = farthest(motion, run)
        assert set(np.unique([run.modes[sole.name] for sole in soles])) == {"sticks"}
    assert np.ptp(motion.q[:, 2]) > 0.13
    assert off["exact"][:3].max() < 1e-3  # m
    assert off["exact"].max() < 3e-3
    assert off["weight"][:3].max() > 1e-2


def test_contacts_of_the_motion_hold_when_it_says_so() -> None:
    """With lanes, no contacts need be given: they are the same as those found by their gaps."""
    solo = rbd.load_robot("solo12")
    motion = minimum_jerk(solo, [solo.standing().q] * 2, [0.0, 0.1])
    lanes = rbd.motion.find_contacts(motion)
    by_lanes, by_gaps = TrackingController(motion.with_contacts(lanes)), TrackingController(motion, lanes.contacts)
    assert [c.name for c in by_lanes.contacts] == [c.name for c in solo.feet()]
    assert np.array_equal(by_lanes.reference.tau, by_gaps.reference.tau)
    lifted = motion.with_contacts(lanes.with_touch("front_left", 0.05, 0.1, touches=False))
    after = TrackingController(lifted, torques="nearest").reference
    assert np.abs(after.tau[after.t < 0.049] - by_gaps.reference.tau[0]).max() < 1e-9
    assert np.abs(after.tau[-1] - by_gaps.reference.tau[0]).max() > 0.1  # N m


def test_a_motion_that_is_not_possible_is_named_with_its_times() -> None:
    """A hop lifts the trunk while the feet are down to stay: times and cause are told, or the nearest torques are taken."""
    solo = rbd.load_robot("solo12")
    low = solo.standing().q
    hop = minimum_jerk(solo, [low, low + 0.05 * np.eye(solo.nq)[2], low], [0.0, 0.15, 0.3])
    feet = solo.feet(friction=0.7)
    with pytest.raises(CannotMove, match=r"no torques and contact forces give solo12 this motion at 0\.") as caught:
        TrackingController(hop, feet)
    assert "torques='nearest'" in str(caught.value)
    near = TrackingController(hop, feet, torques="nearest")
    assert len(near.reference.changed) > 0
    assert "nearest possible motion" in str(near)
    assert np.isfinite(near.reference.tau).all()
    assert (np.abs(near.reference.tau) <= solo.effort_limit * (1.0 + 1e-6)).all()


def test_nearest_torques_are_20_ms_apart_and_linear_between() -> None:
    """Each is what the error of inverse dynamics gives at its sample, though found from the one before it."""
    talos = rbd.load_robot("talos")
    motion, soles = crouch(talos, 0.5, 0.6), talos.soles(friction=0.7)
    own, found = (TrackingController(motion, soles, torques=torques).reference for torques in ("none", "nearest"))
    refused = np.flatnonzero(np.isin(found.t, found.changed))
    bent = np.abs(np.diff(found.a, 2, axis=0)).max(axis=1) > 1e-9
    asked = [i for i in refused if 0 < i < len(bent) and bent[i - 1]]
    assert 10 < len(asked) <= len(refused) / 2
    for i in asked[::5]:
        with pytest.raises(CannotMove) as caught:
            rbd.inverse_dynamics(rbd.State(talos, own.q[i], own.v[i]), own.a[i], soles)
        assert np.abs(caught.value.nearest().a - found.a[i]).max() < 1e-6


def test_clipped_torques_are_counted_in_steps_that_are_taken(reach: rbd.Motion) -> None:
    """A state far away asks for more than the motors have; a reset forgets it."""
    robot = reach.robot
    follow = TrackingController(reach, frequency=60.0)
    assert isinstance(follow, SteppedController)
    far = reach.state(0).with_joints({"panda_joint2": reach.q[0, 1] + 1.0})
    follow.accepted(AcceptedStep(reach.state(0), 0.0, 1e-3, {}))
    assert follow.steps == 1
    assert follow.clipped == {}
    follow.accepted(AcceptedStep(far, 1e-3, 1e-3, {}))
    assert follow.clipped["panda_joint2"] == 1
    assert "panda_joint2: 1" in str(follow)
    assert (np.abs(follow(far, 1e-3)) <= robot.effort_limit).all()
    follow.reset()
    assert follow.steps == 0
    assert follow.clipped == {}


def test_after_its_end_the_last_pose_is_held(reach: rbd.Motion) -> None:
    """Torques at the end and later are the same at the last pose, and pull back to it from elsewhere."""
    follow = TrackingController(reach)
    last = reach.state(-1)
    assert follow(last, 1.2) == pytest.approx(follow.reference.tau[-1], abs=1e-9)
    assert follow(last, 5.0) == pytest.approx(follow.reference.tau[-1], abs=1e-9)
    assert follow(reach.state(0), -1.0) == pytest.approx(follow.reference.tau[0], abs=1e-9)
    beyond = last.with_joints({"panda_joint2": reach.q[-1, 1] + 0.1})
    assert follow(beyond, 5.0)[1] < follow(last, 5.0)[1]


def test_gains_are_the_same_in_whatever_order_they_are_asked_for(reach: rbd.Motion) -> None:
    """A controller that was used before gives the same bits as a fresh one."""
    one, other = TrackingController(reach), TrackingController(reach)
    state = reach.state(3)
    for t in (1.0, 0.4, 0.7):
        one(state, t)
    assert np.array_equal(one(state, 0.33), other(state, 0.33))


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"motion": 3}, "expected an rbd.Motion"),
        ({"frequency": 0.0}, "frequency"),
        ({"damping_ratio": -1.0}, "damping_ratio"),
        ({"stiffness": 1.0}, "go together"),
        ({"stiffness": -1.0, "damping": 1.0}, "stiffness"),
        ({"stiffness": [1.0, 2.0], "damping": 1.0}, "stiffness"),
        ({"torques": "some"}, "exact, nearest"),
        ({"every": 0.0}, "every"),
        ({"contacts": [3]}, "constraint"),
    ],
)
def test_bad_input_is_named(reach: rbd.Motion, given: dict[str, object], words: str) -> None:
    """What came, and what is expected."""
    with pytest.raises(InputError, match=words):
        TrackingController(**{"motion": reach} | given)  # type: ignore[arg-type]


def test_a_state_of_another_robot_is_refused(reach: rbd.Motion) -> None:
    """It was made for one robot."""
    with pytest.raises(InputError, match="made for"):
        TrackingController(reach)(rbd.load_robot("solo12").standing(), 0.0)
