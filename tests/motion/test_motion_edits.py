"""Motions that are made and changed: minimum jerk, functions, other rates, left and right exchanged, smoothed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from test_derivation import flight

import rbd
from rbd.errors import InputError
from rbd.model.sampled_motion import exponential
from rbd.motion import Motion, derivatives, find_contacts, minimum_jerk
from rbd.motion.symmetry import ACROSS, other_side, symmetry_of


@pytest.fixture(scope="module")
def reach(g1) -> Motion:
    """G1 between three poses, its base turned and displaced, 2 s at 100 Hz."""
    rng = np.random.default_rng(7)
    start = g1.standing().q
    poses = [start, *(pin.integrate(g1.model, start, 0.4 * rng.uniform(-1.0, 1.0, g1.nv)) for _ in range(2))]
    return minimum_jerk(g1, poses, [0.0, 1.2, 2.0], rate=100.0)


class TestMinimumJerk:
    """Quintics from rest to rest."""

    def test_poses_are_reached_at_rest(self, g1, reach):
        """At the times given; v and a vanish there."""
        assert np.abs(reach.q[0] - g1.standing().q).max() < 1e-15
        for i in (0, 120, 200):
            assert reach.t[i] == pytest.approx([0.0, 1.2, 2.0][[0, 120, 200].index(i)])
            assert np.abs(reach.v[i]).max() < 1e-12 and np.abs(reach.a[i]).max() < 1e-9

    def test_the_largest_speed_is_that_of_the_quintic(self, g1):
        """15 / 8 of the mean speed, in the middle; 10 / sqrt(3) of distance over time squared is the largest acceleration."""
        start = g1.standing().q
        end = start.copy()
        end[10] += 0.5
        motion = minimum_jerk(g1, [start, end], [0.0, 2.0], rate=1000.0)
        assert np.abs(motion.v[:, 9]).max() == pytest.approx(15.0 / 8.0 * 0.25, rel=1e-9)
        assert np.abs(motion.a[:, 9]).max() == pytest.approx(10.0 / np.sqrt(3.0) * 0.5 / 4.0, rel=1e-5)
        assert np.abs(np.delete(motion.v, 9, axis=1)).max() == 0.0

    def test_v_and_a_are_derivatives_of_q(self, g1, reach):
        """On the manifold, by differences; a by those of v."""
        h = 0.01
        mid = np.array([pin.difference(g1.model, reach.q[i - 1], reach.q[i + 1]) / (2.0 * h) for i in range(1, reach.n - 1)])
        assert np.abs(mid - reach.v[1:-1]).max() < 5e-3
        wrong = np.abs((reach.v[2:] - reach.v[:-2]) / (2.0 * h) - reach.a[1:-1]).max(axis=1)
        assert np.delete(wrong, 119)[:-1].max() < 0.01 * np.abs(reach.a).max(), "but where the jerk jumps, at 1.2 s"

    def test_all_kinds_of_joints(self):
        """Sliding on a plane, turning without end, and the derivation agree."""
        robot = rbd.load_robot("tiago", root="planar")
        rng = np.random.default_rng(2)
        a = pin.neutral(robot.model)
        b = pin.integrate(robot.model, a, rng.uniform(-1.0, 1.0, robot.nv))
        motion = minimum_jerk(robot, [a, b], [0.0, 1.0], rate=200.0)
        assert {p.kind for p in robot.joints.pieces} >= {"plane", "number", "circle"}
        v, acceleration, _ = derivatives(robot, motion.t, motion.q, window=0.03)
        assert np.abs(v - motion.v)[6:-6].max() < 1e-3
        assert np.abs(acceleration - motion.a)[6:-6].max() < 0.02 * np.abs(motion.a).max()

    def test_what_is_no_pose_is_refused(self, g1):
        """Fewer times than poses, times that go back, another robot's q."""
        q = g1.standing().q
        for poses, times in (
            ([q], [0.0]),
            ([q, q], [0.0]),
            ([q, q], [1.0, 0.0]),
            ([q, q[:-1]], [0.0, 1.0]),
            ("ab", [0.0, 1.0]),
        ):
            with pytest.raises(InputError):
                minimum_jerk(g1, poses, times)


def test_a_function_of_time(g1):
    """Derivatives are those of the function, to 1e-9 in v and 1e-6 in a."""
    at = np.arange(50) / 25.0
    motion = Motion.from_function(g1, lambda t: flight(g1, np.array([t]))[0][0], at)
    _, v, a = flight(g1, at)
    assert np.abs(motion.v - v).max() < 1e-9 * 100
    assert np.abs(motion.a - a).max() < 1e-6 * 10
    with pytest.raises(InputError, match="apart"):
        Motion.from_function(g1, lambda t: g1.standing().q, np.arange(5) * 1e-3)
    with pytest.raises(InputError):
        Motion.from_function(g1, lambda t: np.zeros(3), at)


class TestOtherRates:
    """`resample` and `cut`."""

    def test_a_finer_rate_follows_the_motion(self, g1, reach):
        """Cubics through q and v: of the fourth order in the time step."""
        errors = []
        for every in (4, 2):
            rough = Motion.of_arrays(g1, reach.t[::every], reach.q[::every], reach.v[::every], reach.a[::every])
            fine = rough.resample(100.0)
            assert fine.n == reach.n and np.abs(fine.t - reach.t).max() < 1e-12
            off = np.array([pin.difference(g1.model, a, b) for a, b in zip(fine.q, reach.q, strict=True)])
            errors.append(np.abs(off).max())
            assert np.abs(fine.v - reach.v).max() < 0.05 * np.abs(reach.v).max()
        assert errors[1] < 2e-6 and 9.0 < errors[0] / errors[1] < 20.0

    def test_derived_motions_are_derived_again(self, g1, reach):
        """And every second frame of twice the rate is the frame itself."""
        motion = Motion.of_arrays(g1, reach.t, reach.q, window=0.1)
        twice = motion.resample(200.0)
        assert np.abs(twice.q[::2] - motion.q).max() < 1e-12
        assert twice.derivation.window == pytest.approx(0.1) and "resampled from 100 to 200 Hz" in twice.notes[-1]
        assert np.abs(twice.v[::2] - motion.v).max() < 5e-3

    def test_unequal_times_become_equal(self, g1, reach):
        """A motion with frames left out, at an equal rate again."""
        keep = np.sort(np.random.default_rng(0).permutation(np.arange(1, 200))[:150])
        keep = np.r_[0, keep, 200]
        rough = Motion.of_arrays(g1, reach.t[keep], reach.q[keep], reach.v[keep], reach.a[keep])
        assert np.abs(rough.resample(100.0).q - reach.q).max() < 1e-4

    def test_a_cut_keeps_frames_and_times(self, reach):
        """Both ends included."""
        part = reach.cut(0.5, 1.0)
        assert (part.t[0], part.t[-1], part.n) == (pytest.approx(0.5), pytest.approx(1.0), 51)
        assert (part.a == reach.a[50:101]).all() and "cut to 0.5 to 1 s" in part.notes[-1]
        lanes = find_contacts(reach)
        assert (reach.with_contacts(lanes).cut(0.5, 1.0).contacts.touches == lanes.touches[50:101]).all()
        with pytest.raises(InputError, match="expected ContactTimeline of this motion"):
            part.with_contacts(lanes)
        assert reach.cut().n == reach.n and reach.cut(start=1.0).n == 101
        with pytest.raises(InputError, match="from 0 to 2 s"):
            reach.cut(5.0)
        for bad in (0.0, -1.0, float("nan"), 1e9, "x"):
            with pytest.raises(InputError):
                reach.resample(bad)


class TestMirror:
    """Left and right exchanged."""

    @pytest.mark.parametrize("name", ["g1", "talos", "solo12", "bolt"])
    def test_twice_is_the_motion_itself(self, name):
        """To the last bit, v and a too."""
        robot = rbd.load_robot(name)
        rng = np.random.default_rng(4)
        start = robot.standing().q
        motion = minimum_jerk(
            robot, [start, pin.integrate(robot.model, start, 0.3 * rng.uniform(-1.0, 1.0, robot.nv))], [0.0, 1.0], rate=20.0
        )
        again = motion.mirror().mirror()
        for field in ("q", "v", "a"):
            assert (getattr(again, field) == getattr(motion, field)).all()
        assert (motion.mirror().q != motion.q).any()

    def test_kinematics_is_mirrored(self, g1, reach):
        """Each joint is where the mirror image of its partner was, with its velocity and acceleration."""
        image = reach.mirror()
        data, mirrored = g1.model.createData(), g1.model.createData()
        tolerance = 2.0 * symmetry_of(g1).error + 1e-9
        for i in (0, 60, 150):
            pin.forwardKinematics(g1.model, data, reach.q[i], reach.v[i], reach.a[i])
            pin.forwardKinematics(g1.model, mirrored, image.q[i], image.v[i], image.a[i])
            for joint in g1.joints.values():
                other = g1.joint_id(other_side(joint.name, g1.joints))
                assert np.abs(ACROSS * data.oMi[joint.id].translation - mirrored.oMi[other].translation).max() < tolerance
                ways = (pin.getVelocity, pin.getClassicalAcceleration)
                for way, scale in zip(ways, (10.0, 100.0), strict=True):
                    here = way(g1.model, data, joint.id, pin.LOCAL_WORLD_ALIGNED).linear
                    there = way(g1.model, mirrored, other, pin.LOCAL_WORLD_ALIGNED).linear
                    assert np.abs(ACROSS * here - there).max() < scale * tolerance

    def test_a_robot_with_one_arm_is_refused(self):
        """A joint without a partner that is its own image says so."""
        panda = rbd.load_robot("panda")
        motion = minimum_jerk(panda, [panda.neutral(), panda.neutral()], [0.0, 1.0])
        with pytest.raises(InputError, match="is not the mirror image of"):
            motion.mirror()
        fixed = rbd.load_robot("panda", root="fixed")
        with pytest.raises(InputError, match="no floating base"):
            minimum_jerk(fixed, [fixed.neutral(), fixed.neutral()], [0.0, 1.0]).mirror()

    def test_names_of_sides(self):
        """By words and letters between marks; a middle joint is its own."""
        known = ["left_hip", "right_hip", "waist", "arm_L_1", "arm_R_1", "FL_HAA", "FR_HAA", "l_knee", "r_knee"]
        pairs = {"left_hip": "right_hip", "arm_R_1": "arm_L_1", "FL_HAA": "FR_HAA", "r_knee": "l_knee", "waist": "waist"}
        for name, other in pairs.items():
            assert other_side(name, known) == other


class TestLiftedAndFiltered:
    """The first steps of repair."""

    def test_lifted_moves_the_base_alone(self, reach):
        """Up along z; v and a are those of before, and given contacts are left out, which is said."""
        up = reach.with_contacts(find_contacts(reach)).lifted(0.03)
        assert np.abs(up.q[:, 2] - reach.q[:, 2] - 0.03).max() < 1e-15
        assert (np.delete(up.q, 2, axis=1) == np.delete(reach.q, 2, axis=1)).all() and (up.a == reach.a).all()
        assert up.contacts is None and up.notes[-2:] == ("lifted by 0.03 m.", "contacts given before were left out.")
        with pytest.raises(InputError):
            reach.lifted(float("nan"))

    def test_filtered_takes_what_is_above_the_cutoff(self, g1):
        """A swing at three times the cut-off is left at 1 / (1 + 3^6) of its size, a slow one as it was."""
        t = np.arange(600) / 60.0
        q = np.tile(g1.standing().q, (600, 1))
        slow, fast = np.sin(2.0 * np.pi * 0.5 * t), np.sin(2.0 * np.pi * 15.0 * t + 0.3)
        q[:, 12] += 0.2 * slow + 0.01 * fast
        motion = Motion.of_arrays(g1, t, q)
        lanes = find_contacts(motion)
        smooth = motion.with_contacts(lanes).filtered(5.0)
        left = (smooth.q - g1.standing().q)[60:-60, 12]
        both = np.stack([slow, np.sin(2.0 * np.pi * 15.0 * t), np.cos(2.0 * np.pi * 15.0 * t)], axis=1)[60:-60]
        sizes = np.linalg.lstsq(both, left, rcond=None)[0]
        assert sizes[0] == pytest.approx(0.2, rel=1e-5)
        ratio = (np.sin(np.pi * 15.0 / 60.0) / np.sin(np.pi * 5.0 / 60.0)) ** 6  # of the discrete third differences
        assert np.hypot(*sizes[1:]) == pytest.approx(0.01 / (1.0 + ratio), rel=1e-3)
        assert smooth.contacts is lanes and smooth.derivation.cutoff == 5.0 and "smoothed" in smooth.notes[-1]
        for bad in (0.0, -1.0, 31.0, float("nan"), None):
            with pytest.raises(InputError, match="cutoff"):
                motion.filtered(bad)

    def test_quaternions_stay_unit_and_spins_are_kept(self, g1):
        """A spin that goes round several times, with signs of quaternions as they come."""
        t = np.arange(300) / 60.0
        q = np.tile(g1.standing().q, (300, 1))
        q[:, 3:7] = exponential(np.outer(t, [0.3, 0.0, 4.0]))
        q[::7, 3:7] *= -1.0
        smooth = Motion.of_arrays(g1, t, q).filtered(6.0)
        assert np.abs(np.linalg.norm(smooth.q[:, 3:7], axis=1) - 1.0).max() < 1e-15
        assert np.abs(smooth.v[40:-40, 3:6] - [0.3, 0.0, 4.0]).max() < 1e-4


def test_three_frames_are_too_few_for_a_low_pass(reach):
    """Nothing is smoothed silently by nothing."""
    with pytest.raises(InputError, match="four frames"):
        reach.cut(0.0, 0.02).filtered(10.0)


def test_arrays_cannot_be_changed(reach):
    """Read-only, also in copies that were changed; whoever gave an array may still write to his own."""
    t, q = np.array([0.0, 1.0]), np.array(reach.q[:2])
    rest = np.zeros((2, reach.robot.nv))
    Motion(reach.robot, t, q, rest, rest.copy())
    t[0] = -1.0
    for motion in (reach, reach.mirror(), reach.cut(0.5, 1.0)):
        with pytest.raises(ValueError, match="read-only"):
            motion.q[0, 0] = 1.0
    assert "Motion('g1', 201 frames, 0 to 2 s at 100 Hz" in repr(reach)
    assert Path(reach.source).name == "minimum jerk"


@pytest.mark.parametrize(("count", "more"), [(5, ""), (6, ""), (8, "and 2 joints less")])
def test_a_difference_names_six_joints(g1: rbd.Robot, count: int, more: str) -> None:
    """The largest first, and counts the rest."""
    t, q = np.arange(3) / 30.0, np.tile(g1.standing().q, (3, 1))
    other = q.copy()
    other[:, 7 : 7 + count] += 0.01 * np.arange(1, count + 1)
    told = str(rbd.motion.MotionDifference.of(*(rbd.Motion.of_arrays(g1, t, x) for x in (other, q)))).splitlines()
    assert told[-1].strip() == more if more else "less" not in told[-1]
    assert len(told) == 1 + 3 + min(count, 6) + bool(more)
    assert f"{np.degrees(0.01 * count):.2f} deg" in told[4]
