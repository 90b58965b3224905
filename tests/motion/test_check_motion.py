"""`check_motion`: closed forms of what is missing, faults found where they were put in, and a second way to the answers."""

from __future__ import annotations

import copy
import json
import pickle

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import linprog

import rbd
from rbd.arrays import Array
from rbd.motion import CAUSES, Motion, check_motion, find_contacts
from rbd.motion.frame_terms import placements
from rbd.motion.self_collision import self_collisions

RATE = 60.0
DECIMALS = 1e-6 / np.sqrt(12.0)
"""Standard deviation of six decimals."""


def squats(
    g1: rbd.Robot, *, f: float = 0.5, swing: float = 0.0, seconds: float = 2.0, depth: float = 0.6
) -> tuple[Array, Array]:
    """(t, q) of G1 that bends its knees over still soles, and swings both arms."""
    t = np.arange(int(seconds * RATE) + 1) / RATE
    q = np.repeat(g1.standing().q[None], len(t), axis=0)
    bend = 0.5 * depth * (1.0 - np.cos(2.0 * np.pi * f * t))
    for side in ("left", "right"):
        for joint, share in (("hip_pitch", -0.5), ("knee", 1.0), ("ankle_pitch", -0.5)):
            q[:, g1.joints[f"{side}_{joint}_joint"].q] += (share * bend)[:, None]
        q[:, g1.joints[f"{side}_shoulder_pitch_joint"].q] += (swing * np.sin(2.0 * np.pi * f * t))[:, None]
    ankle = g1.joints["left_ankle_roll_joint"].id
    _, p = placements(g1, q)
    q[:, :3] -= p[:, ankle] - p[0, ankle]
    return t, np.round(q, 6)


@pytest.fixture(scope="module")
def squat(g1: rbd.Robot) -> Motion:
    """Slow enough for G1, as from a file of six decimals."""
    return Motion.of_arrays(g1, *squats(g1), noise=DECIMALS)


@pytest.fixture(scope="module")
def hard(g1: rbd.Robot) -> Motion:
    """Faster than soles and friction allow in most frames."""
    return Motion.of_arrays(g1, *squats(g1, f=1.5, swing=1.0, seconds=3.4), noise=DECIMALS)


def falling(g1: rbd.Robot, t: Array) -> Array:
    """G1 in the air: thrown up, its joints at rest, its axes not turning."""
    q = np.repeat(g1.standing().q[None], len(t), axis=0)
    q[:, 0] += 0.3 * t
    q[:, 2] += 1.0 + 2.0 * t - 0.5 * 9.81 * t**2
    return q


class TestClosedForms:
    """The least wrench that is missing, where it can be written down."""

    def test_flight_misses_nothing(self, g1):
        """Whatever falls is possible: with v and a given to rounding, from six decimals to a percent of the weight."""
        t = np.arange(25) / RATE
        q = falling(g1, t)
        v, a = np.zeros((len(t), g1.nv)), np.zeros((len(t), g1.nv))
        v[:, 0], v[:, 2], a[:, 2] = 0.3, 2.0 - 9.81 * t, -9.81
        exact = check_motion(Motion.of_arrays(g1, t, q, v, a), ground=0.0, self_collision=False)
        assert exact.missing_scaled.max() < 1e-12 and exact.possible.all()
        assert not exact.lanes.touches.any()
        read = check_motion(Motion.of_arrays(g1, t, np.round(q, 6), noise=DECIMALS), ground=0.0, self_collision=False)
        assert read.missing_scaled.max() < 0.01 and read.possible.all()

    def test_standing_misses_nothing(self, g1):
        """The soles carry the weight."""
        q = np.repeat(g1.standing().q[None], 12, axis=0)
        report = check_motion(Motion.of_arrays(g1, np.arange(12) / RATE, q))
        assert report.missing_scaled.max() < 1e-12
        assert report.possible.all() and report.score == pytest.approx(100.0)
        assert np.allclose(report.forces.sum(axis=1), [0.0, 0.0, g1.mass * 9.81], atol=1e-7)

    def test_a_pose_held_in_the_air_misses_its_weight(self, g1):
        """Upwards, and no moment about the centre of mass; the nearest possible acceleration is free fall."""
        q = np.repeat(g1.standing().q[None], 12, axis=0)
        q[:, 2] += 0.5
        report = check_motion(Motion.of_arrays(g1, np.arange(12) / RATE, q), ground=0.0)
        assert np.allclose(report.missing, [0.0, 0.0, g1.mass * 9.81, 0.0, 0.0, 0.0], atol=1e-9)
        assert report.of_cause("floats").all() and report.causes.sum() == report.n
        R = placements(g1, q)[0][:, 1]
        fall = np.einsum("nji,j->ni", R, [0.0, 0.0, -9.81])
        assert np.allclose(report.nearest_a[:, :3], fall, atol=1e-9) and np.abs(report.nearest_a[:, 3:]).max() < 1e-9

    def test_a_robot_that_is_pulled_down_floats(self, g1):
        """It stands, and falls at twice gravity: no floor pulls."""
        q = np.repeat(g1.standing().q[None], 6, axis=0)
        a = np.zeros((6, g1.nv))
        a[:, 2] = -2.0 * 9.81
        frames = Motion.of_arrays(g1, np.arange(6) / RATE, q, np.zeros((6, g1.nv)), a, trust=True)  # each by itself
        report = check_motion(frames, self_collision=False)
        assert np.allclose(report.missing[:, 2], -g1.mass * 9.81, rtol=1e-6)
        assert report.of_cause("floats").all() and not report.of_cause("friction").any() and not report.of_cause("tips").any()

    def test_a_push_along_the_floor_beyond_friction(self, g1):
        """At friction mu a weight W accelerates along the floor at mu g; what more is wanted is missing.

        The nearest force of the cone to (F, W) has normal part (W + mu F) / (1 + mu^2), so |mu W - F| / sqrt(1 + mu^2) is left,
        where the centre of pressure may be anywhere: a wide floor leaves no moment.
        """
        mu, pull = 0.1, 0.3
        q = np.repeat(g1.standing().q[None], 6, axis=0)
        a = np.zeros((6, g1.nv))
        a[:, 1] = pull * 9.81  # the base's y is W's
        report = check_motion(
            Motion.of_arrays(g1, np.arange(6) / RATE, q, np.zeros((6, g1.nv)), a, trust=True), friction=mu, self_collision=False
        )
        least = (pull - mu) / np.sqrt(1.0 + mu**2)
        assert (report.missing_scaled >= least - 1e-9).all()
        assert report.of_cause("friction").all()


class TestFaults:
    """A fault that is put in is found in all frames, and no other."""

    def only(self, report, *causes):
        """Frames that have exactly these causes."""
        return (report.causes == np.isin(CAUSES, causes)).all(axis=1)

    def test_none(self, squat):
        """Soles that hold, torques within limits."""
        report = check_motion(squat)
        assert report.possible.all()
        assert report.lanes.touches.all() and not report.lanes.slides.any()
        assert report.missing_scaled.max() < 1e-9
        assert (report.used_torque < 1.0).all() and (report.used_friction < 1.0).all() and (report.edge_margin > 0.0).all()

    def test_lifted_it_floats(self, squat):
        """By 5 cm over the floor; `lifted` puts it back."""
        report = check_motion(squat.lifted(0.05), ground=0.0)
        assert self.only(report, "floats").all()
        again = report.lifted()
        assert again.possible.all() and again.before is report
        assert again.motion.q[:, 2] == pytest.approx(squat.q[:, 2], abs=1e-5)
        assert "0.0 -> 100.0 % of the frames" in str(again)
        found = check_motion(squat.lifted(0.05))
        assert found.possible.all() and found.lanes.ground == pytest.approx(0.05, abs=1e-5)
        assert "fitted at z = 0.0500 m" in str(found)

    def test_pushed_down_it_sinks(self, squat):
        """By 3 cm; by less than one it does not."""
        assert self.only(check_motion(squat.lifted(-0.03), ground=0.0), "sinks").all()
        assert check_motion(squat.lifted(-0.005), ground=0.0).possible.all()

    def test_drawn_along_the_floor_it_slides(self, g1, squat):
        """At 5 cm/s, and at no more than the half of 5 mm/s it does not."""
        for speed, slides in ((0.05, True), (0.0025, False)):
            q = squat.q.copy()
            q[:, 0] += speed * squat.t
            report = check_motion(Motion.of_arrays(g1, squat.t, q, noise=DECIMALS))
            assert self.only(report, *["slides"] * slides).all()
            assert np.nanmax(np.abs(report.lanes.speeds - speed)) < 1e-4

    def test_weak_motors(self, squat):
        """A share of the torque limits below what is used at most breaks them, where it is used."""
        full = check_motion(squat)
        share = 0.8 * full.used_torque.max()
        report = check_motion(squat, torque_limits=share)
        assert report.of_cause("motor").any()
        assert not self.only(report, "motor")[full.used_torque.max(axis=1) < 0.99 * share].any()
        assert self.only(report, "motor")[report.excess.any(axis=1)].all()
        assert check_motion(squat, torque_limits=False).possible.all()

    def test_a_slippery_floor(self, hard):
        """What holds at 0.7 slips at 0.05; what tips there tips at any friction."""
        rough, smooth = check_motion(hard, self_collision=False), check_motion(hard, friction=0.05, self_collision=False)
        assert not rough.of_cause("friction").any() and rough.of_cause("tips").mean() > 0.5
        assert smooth.of_cause("friction").mean() > 0.5
        assert (smooth.missing_scaled >= rough.missing_scaled - 1e-9).all()

    def test_limits_of_joints_and_speeds(self, g1, squat):
        """A knee beyond its limit, a shoulder faster than its own, in those frames alone."""
        q, v = squat.q.copy(), squat.v.copy()
        knee = g1.joints["left_knee_joint"]
        q[40:50, knee.q] = knee.upper + 0.02
        v[60:70, g1.joints["left_shoulder_pitch_joint"].v] = g1.joints["left_shoulder_pitch_joint"].speed + 0.1
        report = check_motion(Motion.of_arrays(g1, squat.t, q, v, squat.a, trust=True), self_collision=False)
        assert np.flatnonzero(report.of_cause("joint limit")).tolist() == list(range(40, 50))
        assert np.flatnonzero(report.of_cause("speed limit")).tolist() == list(range(60, 70))

    def test_a_jump(self, g1, squat):
        """A step of 10 cm in one coordinate is found between its two frames."""
        q = squat.q.copy()
        q[70:, 1] += 0.1
        report = check_motion(Motion.of_arrays(g1, squat.t, q, noise=DECIMALS), self_collision=False)
        assert np.flatnonzero(report.of_cause("jump")).tolist() == [69, 70]

    def test_a_fast_motion_at_few_frames_is_no_jump(self, squat):
        """A wrist waves by 1.5 rad at 3 Hz, now and then, at 30 frames a second: its v and a explain the steps."""
        t, q = np.arange(90) / 30.0, np.tile(squat.q[0], (90, 1))
        q[:, -1] += 1.5 * np.sin(6.0 * np.pi * t) ** 5 * (np.sin(np.pi * t) > 0.9)
        assert not check_motion(Motion.of_arrays(squat.robot, t, q), self_collision=False).of_cause("jump").any()

    def test_torque_and_speed(self, squat):
        """Knees whose torque falls with their speed to less than is used; standing still they have all of it."""
        used = np.abs(check_motion(squat, self_collision=False).tau)
        i = squat.robot.actuated_names.index("left_knee_joint")
        rate = np.abs(squat.v[:, squat.robot.actuated[i]])
        curve = 2.0 * float(used[:, i].max()), 1.2 * float(rate.max())
        both = {"left_knee_joint": curve, "right_knee_joint": curve}
        report = check_motion(squat, torque_speed=both, self_collision=False)
        found = report.of_cause("torque-speed")
        assert found.any() and not found[rate < 0.2 * rate.max()].any() and not report.of_cause("motor").any()
        assert "_knee_joint" in str(report) and "rad/s, which leaves" in str(report)
        alone = check_motion(squat, torque_speed={"left_knee_joint": curve}, self_collision=False)
        least, most = alone.torque_bounds  # the right leg carries what the left knee cannot
        assert alone.possible.all() and (alone.tau[:, i] <= 1.01 * most[:, i]).all() and (alone.tau[:, i] >= least[:, i]).all()

    def test_the_lines_of_the_robot_are_those_of_the_argument(self, g1, squat):
        """`with_motors` and `torque_speed=` with the same line find the same frames; a share of the limits takes both."""
        plain = check_motion(squat, self_collision=False)
        i = g1.actuated_names.index("left_knee_joint")
        rate = np.abs(squat.v[:, g1.actuated[i]]).max()
        curve = 2.0 * float(np.abs(plain.tau[:, i]).max()), 1.2 * float(rate)
        knees = ("left_knee_joint", "right_knee_joint")
        line = rbd.Motor(torque_speed=[(0.0, curve[0]), (curve[1], 0.0)])
        slow = Motion.of_arrays(g1.with_motors(dict.fromkeys(knees, line)), squat.t, squat.q, squat.v, squat.a)
        report = check_motion(slow, self_collision=False)
        given = check_motion(squat, torque_speed=dict.fromkeys(knees, curve), self_collision=False)
        assert report.of_cause("torque-speed").any() and np.array_equal(report.causes, given.causes)
        assert np.abs(report.tau - given.tau).max() < 1e-9 and report.used_torque.max() > 1.0
        assert not report.of_cause("motor").any() and report.limit[i] == curve[0]
        assert check_motion(slow, torque_limits=False, self_collision=False).possible.all()
        less = check_motion(slow, torque_limits=0.9, self_collision=False)
        assert less.of_cause("torque-speed").sum() > report.of_cause("torque-speed").sum()

    def test_a_saved_motion_keeps_the_motors(self, g1, squat, tmp_path):
        """They are in the file, beside the robot's name; a robot that is given counts instead."""
        motors = {
            "left_knee_joint": rbd.Motor(torque_speed=[(0.0, 50.0), (5.0, 0.0)]),
            "right_knee_joint": rbd.Motor(limit=3.0),
        }
        slow = Motion.of_arrays(g1.with_motors(motors), squat.t, squat.q, squat.v, squat.a)
        slow.save(tmp_path / "slow.npz")
        assert Motion.read(tmp_path / "slow.npz").robot.is_like(slow.robot)
        assert not Motion.read(tmp_path / "slow.npz", robot=g1).robot.motor_data
        squat.save(tmp_path / "plain.npz")
        assert not Motion.read(tmp_path / "plain.npz").robot.motor_data

    def test_a_hand_in_the_trunk(self, g1, squat):
        """Arms bent through the body collide with it, in those frames alone."""
        q = squat.q.copy()
        roll, elbow = g1.joints["left_shoulder_roll_joint"], g1.joints["left_elbow_joint"]
        q[30:60, roll.q] = -1.2
        q[30:60, elbow.q] = 0.3
        report = check_motion(Motion.of_arrays(g1, squat.t, q, noise=DECIMALS))
        assert np.flatnonzero(report.of_cause("self-collision")).tolist() == list(range(30, 60))
        assert all("left" in " ".join(pair) for pair in report.collisions.pairs)

    def test_frames_that_are_not_measured_hold_no_overlap(self, g1, rng):
        """Arms and waist that swing through the trunk: the frames and pairs are those of each frame by itself."""
        at = [joint.q.start for name, joint in g1.joints.items() if any(x in name for x in ("shoulder", "elbow", "waist"))]
        low, high = g1.joints.limits
        q = np.repeat(g1.standing().q[None], 150, axis=0)
        t, f, phase = np.arange(150)[:, None] / RATE, rng.uniform(0.3, 2.0, len(at)), rng.uniform(0.0, 6.0, len(at))
        q[:, at] = np.clip(q[:, at] + np.sin(2.0 * np.pi * f * t + phase), low[at], high[at])
        R, p = placements(g1, q)
        whole = self_collisions(g1, q, R, p)
        alone = [self_collisions(g1, q[i : i + 1], R[i : i + 1], p[i : i + 1]) for i in range(len(q))]
        assert 10 < whole.inside.sum() < 140
        assert whole.inside.tolist() == [bool(one.inside[0]) for one in alone]
        for pair, frames in whole.pairs.items():
            assert frames.tolist() == [i for i, one in enumerate(alone) if pair in one.pairs]


class TestASecondWay:
    """The same questions as linear programs, of dynamics and Jacobians by other means."""

    FACETS = 48

    def feasible(self, report, i, *, radius, limits, slack=0.0):
        """Whether forces in pyramids of this radius, over the coefficient, bring the frame, by SciPy's HiGHS."""
        m, robot = report.motion, report.motion.robot
        state = m.state(i)
        need = state.M @ m.a[i] + state.h
        angles = 2.0 * np.pi * np.arange(self.FACETS) / self.FACETS
        mu = report.friction * radius
        rays = np.array([mu * np.cos(angles), mu * np.sin(angles), np.ones(self.FACETS)])
        columns = []
        for g, sole in enumerate(robot.soles()):
            X, J, _, _ = state.moving(sole.frame, sole.placement, pin.LOCAL_WORLD_ALIGNED)
            own = np.flatnonzero(report.lanes.points.group == g)
            for corner, touches in zip(sole.corners, report.lanes.touches[i, own], strict=True):
                if touches:
                    columns.append((J[:3] - pin.skew(X.rotation @ corner) @ J[3:]).T @ rays)
        G = np.hstack(columns) * 100.0  # hundreds of newtons
        if limits is not None:
            A = np.vstack([G[6:], -G[6:]])
            level = np.concatenate([limits + need[6:], limits - need[6:]])
        else:
            A, level = None, None
        return linprog(np.zeros(G.shape[1]), A, level, G[:6], need[:6], (0, None), method="highs").status == 0

    @pytest.mark.parametrize("mu", [0.7, 0.2])
    def test_what_friction_allows(self, hard, mu):
        """200 frames: what misses nothing has forces in slightly wider pyramids; what misses more has none in narrower ones."""
        report = check_motion(hard, friction=mu, self_collision=False)
        balanced = report.missing_scaled < 1e-9
        assert 10 < balanced[:200].sum() < 190
        for i in range(200):
            if balanced[i]:
                assert self.feasible(report, i, radius=1.0 / np.cos(np.pi / self.FACETS) + 1e-6, limits=None)
            else:
                assert not self.feasible(report, i, radius=1.0, limits=None)

    @pytest.mark.parametrize("share", [1.0, 0.4, 0.1])
    def test_forces_and_torques_are_those_of_the_motion(self, hard, share):
        """M a + h = S^T tau + J^T f and what is missing on the base, with forces in their cones, whether possible or not."""
        report = check_motion(hard, friction=0.3, torque_limits=share, self_collision=False)
        m, robot = hard, hard.robot
        f, weight = report.forces, hard.robot.mass * 9.81
        assert (np.hypot(f[..., 0], f[..., 1]) <= 0.3 * f[..., 2] + 1e-9 * weight).all()
        assert not f[~report.lanes.touches].any()
        for i in range(0, m.n, 4):
            state = m.state(i)
            left = state.M @ m.a[i] + state.h - robot.actuation.T @ report.tau[i]
            for g, sole in enumerate(robot.soles()):
                X, J, _, _ = state.moving(sole.frame, sole.placement, pin.LOCAL_WORLD_ALIGNED)
                for corner, force in zip(sole.corners, f[i, report.lanes.points.group == g], strict=True):
                    left -= (J[:3] - pin.skew(X.rotation @ corner) @ J[3:]).T @ force
            assert np.abs(left[6:]).max() < 1e-9 * weight
            R = pin.Quaternion(m.q[i, 3:7]).toRotationMatrix()
            F = R @ left[:3]
            wrench = np.concatenate([F, R @ left[3:6] + np.cross(m.q[i, :3] - state.com, F)])
            assert np.allclose(wrench, report.missing[i], atol=1e-5 * weight)

    def test_what_motors_allow(self, g1):
        """121 frames at a limit that breaks part of them: there is an excess where no torques are within limits."""
        deep = Motion.of_arrays(g1, *squats(g1, depth=1.6), noise=DECIMALS)
        share = 0.9 * float(check_motion(deep, self_collision=False).used_torque.max())
        limit = share * g1.effort_limit
        report = check_motion(deep, torque_limits=share, self_collision=False)
        breaks = report.of_cause("motor")
        for i in range(report.n):
            if breaks[i]:
                assert not self.feasible(report, i, radius=1.0, limits=limit)
            else:
                assert self.feasible(report, i, radius=1.0 / np.cos(np.pi / self.FACETS), limits=1.011 * limit)
        assert breaks.any() and not breaks.all()


class TestContacts:
    """Contact timelines: which points touch and slide; edited copies."""

    def test_hysteresis(self, g1):
        """A foot that rises touches up to 10 mm, one that comes down from 6 mm."""
        t = np.arange(61) / RATE
        q = np.repeat(g1.standing().q[None], len(t), axis=0)
        height = 0.02 * np.sin(np.pi * t) ** 2
        q[:, 2] += height
        touches = find_contacts(Motion.of_arrays(g1, t, q), touch_height=0.006, ground=0.0).touches
        up, down = height[:31], height[30:]
        assert (touches[:31] == (up <= 0.010)[:, None]).all()
        assert (touches[30:] == (down <= 0.006)[:, None]).all()

    def test_a_foot_that_goes_up_sideways_does_not_slide_before(self, g1):
        """At rest for 0.5 s, then up at 20 mm/s and sideways at 60 mm/s: what is lower than 6 mm slides then, not before."""
        t = np.arange(101) / 100.0
        q = np.repeat(g1.standing().q[None], len(t), axis=0)
        later = np.maximum(t - 0.5, 0.0)
        q[:, 1], q[:, 2] = 0.06 * later, q[:, 2] + 0.02 * later
        lanes = find_contacts(Motion.of_arrays(g1, t, q, noise=0.0), ground=0.0, touch_height=0.006)
        assert lanes.touches[t <= 0.5].all() and lanes.touches[:70].all()
        assert not lanes.slides[t < 0.5].any() and lanes.slides[(t > 0.5) & lanes.touches.all(axis=1)].all()

    def test_few_decimals_do_not_slide(self, g1, squat):
        """Three decimals shake soles at rest; the limit rises with the noise that is stated."""
        q = squat.q.copy()
        q[:, 7:] = np.round(q[:, 7:], 3)
        q[:, :3] = np.round(q[:, :3], 3)
        lanes = find_contacts(Motion.of_arrays(g1, squat.t, q, noise=1e-3 / np.sqrt(12.0)))
        assert not lanes.slides.any()
        assert (np.median(lanes.noise, axis=0) > 1e-4).all() and (np.median(lanes.noise, axis=0) < 5e-3).all()

    def test_edited(self, squat):
        """Contacts taken away in time: nothing carries the robot there."""
        lanes = find_contacts(squat)
        edited = lanes.with_touch("left_sole", 0.5, 1.0, False).with_touch("right_sole", 0.5, 1.0, False)
        report = check_motion(squat, contacts=edited)
        within = (squat.t >= 0.5) & (squat.t <= 1.0)
        assert (report.of_cause("floats") == within).all()
        assert edited.intervals("left_sole")[0] == (0.0, pytest.approx(0.5 - 1 / RATE))
        only = lanes.of(["left_sole"], [[(0.0, 0.5)]])
        assert only.of_contact("left_sole").sum() == (squat.t <= 0.5).sum() and not only.of_contact("right_sole").any()
        assert check_motion(squat.with_contacts(edited)).of_cause("floats").sum() == within.sum()
        with pytest.raises(rbd.errors.UnknownName, match="left_sole"):
            lanes.with_touch("left_sol", 0.0, 1.0)

    def test_other_bodies(self, g1):
        """G1 on its back is carried by its trunk where bodies may touch, and floats where only feet may."""
        q = np.repeat(g1.standing().q[None], 12, axis=0)
        q[:, 3:7] = [0.0, -np.sin(np.pi / 4), 0.0, np.cos(np.pi / 4)]
        motion = Motion.of_arrays(g1, np.arange(12) / RATE, q)
        report = check_motion(motion, bodies=True, ground="fit", self_collision=False)
        assert report.missing_scaled.max() < 1.0 and len(report.lanes.points) > 8
        assert report.lanes.touches[:, 8:].any()
        assert check_motion(motion, ground=-1.0, self_collision=False).of_cause("floats").all()


class TestReport:
    """What is told and kept of a check."""

    def test_table_and_summary(self, hard):
        """Causes with their worst frames, the curve over thresholds, the score; the summary is plain JSON."""
        report = check_motion(hard, self_collision=False)
        text = str(report)
        assert "tips" in text and "% of the weight" in text and "friction 0.7" in text
        worst = report.worst("tips", 3)
        assert (np.diff(report.missing_scaled[worst]) <= 0.0).all()
        told = json.loads(json.dumps(report.summary()))
        assert told["causes"]["tips"] == report.of_cause("tips").sum() and 0.0 <= told["score"] <= 100.0
        shares = report.share_over([0.0, 0.02, 10.0])
        assert shares[1] == (report.missing_scaled > 0.02).mean() and shares[2] == 0.0

    def test_a_lower_cutoff_misses_less(self, hard):
        """Accelerations that the low-pass takes away need no forces."""
        report = check_motion(hard, self_collision=False)
        m, shares = hard, []
        for cutoff in (0.6, 12.0):
            lower = rbd.Motion.of_arrays(m.robot, m.t, m.q, cutoff=cutoff, ground=m.ground, quaternion="xyzw", trust=True)
            found = report.check(lower, contacts=report.lanes, self_collision=False)
            shares.append((found.missing_scaled > report.settings.threshold).mean())
        assert shares[0] < shares[1]
        assert report.filtered(0.6).share_possible > report.share_possible

    @pytest.mark.parametrize("ending", [".npz", ".nc"])
    def test_files(self, ending, squat, tmp_path):
        """All arrays by name, numbers as they were."""
        report = check_motion(squat, self_collision=False)
        path = tmp_path / f"report{ending}"
        report.save(path)
        if ending == ".npz":
            with np.load(path) as file:
                found = {name: file[name] for name in file.files}
        else:
            import xarray

            found = {str(name): x.values for name, x in xarray.load_dataset(path, engine="scipy").variables.items()}
            found["t"] = found["time"]
        for name, x in report.arrays().items():
            assert np.array_equal(found[name].astype(x.dtype), x, equal_nan=x.dtype.kind == "f"), name
        assert [x.decode() if isinstance(x, bytes) else str(x) for x in found["cause"]] == list(CAUSES)
        with pytest.raises(rbd.InputError, match="npz"):
            report.save(tmp_path / "report.txt")

    def test_dataset(self, squat):
        """Dimensions have labels, quantities units."""
        found = check_motion(squat, self_collision=False).to_xarray()
        assert found["causes"].sel(cause="floats").sum() == 0
        assert found["forces"].attrs["units"] == "N" and found["tau"].dims == ("time", "motor")

    def test_copies(self, squat):
        """A report can be sent to another process."""
        report = check_motion(squat, self_collision=False)
        for other in (copy.deepcopy(report), pickle.loads(pickle.dumps(report))):
            assert np.array_equal(other.missing, report.missing) and other.possible.all()


class TestBadInput:
    """Errors that say what was expected."""

    def test_arguments(self, squat):
        """Numbers out of range, other things than motions."""
        for given, words in (
            ({"friction": -0.1}, "friction"),
            ({"friction": True}, "friction"),
            ({"threshold": np.nan}, "threshold"),
            ({"torque_limits": 0.0}, "share"),
            ({"ground": "flat"}, "fit"),
            ({"contacts": "feet"}, "ContactTimeline"),
            ({"rest_speed": -1.0}, "speed"),
            ({"self_collision": 1}, "self_collision"),
            ({"torque_speed": {"nose": (1.0, 1.0)}}, "nose"),
            ({"torque_speed": {"left_knee_joint": (1.0, 0.0)}}, "stall"),
            ({"torque_speed": 3}, "torque_speed"),
        ):
            with pytest.raises(rbd.InputError, match=words):
                check_motion(squat, **given)
        with pytest.raises(rbd.InputError, match=r"rbd\.Motion"):
            check_motion("dance.csv")
        report = check_motion(squat, self_collision=False)
        with pytest.raises(rbd.InputError, match="floats"):
            report.worst("flies")

    def test_contacts_of_another_motion(self, squat):
        """Their times tell."""
        with pytest.raises(rbd.InputError, match="another motion"):
            check_motion(squat, contacts=find_contacts(squat.cut(0.0, 0.5)))

    def test_a_robot_on_a_foundation(self):
        """It has no base that could miss anything."""
        arm = rbd.load_robot("g1", root="fixed")
        motion = Motion.of_arrays(arm, np.arange(5) / RATE, np.repeat(arm.neutral()[None], 5, axis=0))
        with pytest.raises(rbd.InputError, match="floating base"):
            check_motion(motion)
