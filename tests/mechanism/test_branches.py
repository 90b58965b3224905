"""Assembly modes: all that are known of published mechanisms, in an order, with no claim beyond."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from planar_models import absolute, checked, four_bar, four_bar_angles, six_bar, slider_crank
from states import at_neutral

import rbd
from rbd.errors import CannotAssemble
from rbd.mechanism import assemble, branches
from rbd.mechanism.poses import canonical, distance, draw

URDF = Path(__file__).parents[2] / "urdf"


def test_both_branches_of_nortons_four_bar():
    """Open (20.298, 57.325) and crossed (-60.98, -98.01) deg at a crank of 40 deg, and in closed form to 1e-10."""
    robot, loops = four_bar(40.0, 120.0, 80.0, 100.0)
    crank = math.radians(40.0)
    found = branches(at_neutral(robot), loops, fixed={"crank": crank})
    assert len(found) == 2
    degrees = [np.degrees(absolute(q))[1:] for q in found.q]
    assert np.abs(degrees[1] - [20.298, 57.325]).max() < 0.0075
    assert np.abs(degrees[0] - [-60.98, -98.01]).max() < 0.0075
    exact = four_bar_angles(40.0, 120.0, 80.0, 100.0, crank)
    assert np.abs(absolute(found.q[1])[1:] - exact[0]).max() < 1e-12
    assert np.abs(absolute(found.q[0])[1:] - exact[1]).max() < 1e-12


def test_both_branches_of_the_rhombus():
    """The text's rhombus at 30 deg: coupler and rocker open (0, 30), folded (210, 180) deg from the ground."""
    robot, loops = four_bar(1.0, 1.0, 1.0, 1.0)
    found = branches(at_neutral(robot), loops, fixed={"crank": math.radians(30.0)})
    assert len(found) == 2
    opened, folded = (np.exp(1j * np.array([q[0] + q[1], q[2]])) for q in found.q)
    assert np.abs(opened - np.exp(1j * np.radians([0.0, 30.0]))).max() < 1e-12
    assert np.abs(folded - np.exp(1j * np.radians([210.0, 180.0]))).max() < 1e-12


@pytest.mark.parametrize("continuous", [False, True])
def test_whole_turns_make_no_new_branches(continuous: bool):
    """Plain angles and (cos, sin) alike: two branches, each pose written once, its angles in (-pi, pi]."""
    robot, loops = four_bar(1.0, 3.0, 2.5, 3.0, continuous=continuous)
    if not continuous:
        robot.model.lowerPositionLimit = np.full(3, -7.0 * math.pi)
        robot.model.upperPositionLimit = np.full(3, 7.0 * math.pi)
    found = branches(at_neutral(robot), loops, fixed={"crank": 0.7})
    assert len(found) == 2
    if not continuous:
        assert (np.abs(found.q) <= math.pi).all()


def test_a_six_bar_has_four_branches():
    """Two circles' crossings twice: each mode of the four-bar carries both modes of the dyad, when it reaches."""
    robot = rbd.load_robot(URDF / "six_bar.urdf")
    crank = robot.posture("assembled")[:2]
    found = branches(at_neutral(robot), fixed={"crank_joint": crank})
    assert len(found) == 4
    cos, sin = range(robot.nq)[robot.joints["rocker_joint"].q]
    modes = {(round(math.atan2(q[sin], q[cos]), 6)) for q in found.q}  # the rocker: two angles, each with two of the dyad's
    assert len(modes) == 2


def test_a_branch_that_does_not_reach_is_not_found():
    """My six-bar's crossed four-bar leaves the dyad too far away: two branches, both on the open one."""
    robot, loops = six_bar()
    found = branches(at_neutral(robot), loops, fixed={"crank": 0.7})
    rocker = four_bar_angles(1.0, 3.0, 2.5, 3.0, 0.7)[0][1]
    assert len(found) == 2
    assert np.abs(found.q[:, 2] - rocker).max() < 1e-11
    assert found.closed < found.tries


def test_the_same_seed_finds_the_same_in_the_same_order():
    """Bit for bit; another seed finds the same branches, with other hits."""
    robot, loops = six_bar()
    one, again, other = (branches(at_neutral(robot), loops, fixed={"crank": 0.7}, seed=seed, tries=60) for seed in (1, 1, 2))
    assert np.array_equal(one.q, again.q) and [b.hits for b in one.found] == [b.hits for b in again.found]
    assert np.abs(one.q - other.q).max() < 1e-9
    assert [b.hits for b in one.found] != [b.hits for b in other.found]


def test_hits_and_tries_are_told_and_completeness_is_not_claimed():
    """Every start that closed is a hit of one branch; the words say that more are not excluded."""
    robot, loops = four_bar(1.0, 3.0, 2.5, 3.0)
    found = branches(at_neutral(robot), loops, fixed={"crank": 0.7}, tries=50)
    assert sum(b.hits for b in found.found) == found.closed == found.tries == 50
    assert 0 <= found.since_new < 50
    text = str(found)
    assert "2 branches in 50 tries" in text and "not proved" in text and f"one {found.since_new} tries before" in text


def test_a_slider_has_a_branch_to_each_side():
    """X = r cos t +- sqrt(l^2 - r^2 sin^2 t); a slide without limits is drawn over the mechanism's reach."""
    robot, loops = slider_crank(1.0, 3.0)
    found = branches(at_neutral(robot), loops, fixed={"crank": 0.4})
    root = math.sqrt(9.0 - math.sin(0.4) ** 2)
    assert np.abs(np.sort(found.q[:, 2]) - [math.cos(0.4) - root, math.cos(0.4) + root]).max() < 1e-11


def test_a_mechanism_that_can_still_move_is_refused_with_what_to_fix():
    """One degree of freedom left: a joint is named, and with it fixed there are branches."""
    robot, loops = four_bar(1.0, 3.0, 2.5, 3.0)
    with pytest.raises(
        rbd.InputError, match="can still move: 1 degree of freedom left, .* Fix as many joints, e.g. "
    ) as caught:
        branches(at_neutral(robot), loops)
    joint = str(caught.value).split("e.g. '")[1].split("'")[0]
    assert len(branches(at_neutral(robot), loops, fixed={joint: 0.9}, tries=40)) >= 1


def test_a_rhombus_at_zero_is_a_continuum_although_its_crank_is_fixed():
    """With the crank along the ground the rocker's tip is wherever the coupler's is: they turn together."""
    robot, loops = four_bar(1.0, 1.0, 1.0, 1.0)
    with pytest.raises(rbd.InputError, match="1 degree of freedom left with 'crank' fixed"):
        branches(at_neutral(robot), loops, fixed={"crank": 0.0})


def test_a_stretched_rhombus_is_one_singular_branch():
    """At 180 deg the linkage is a line: J allows a velocity that leads nowhere, so it is one pose, and is marked."""
    robot, loops = four_bar(1.0, 1.0, 1.0, 1.0)
    found = branches(at_neutral(robot), loops, fixed={"crank": math.pi}, tries=50)
    assert len(found) == 1 and found.found[0].singular
    assert "singular" in str(found)
    regular = branches(at_neutral(robot), loops, fixed={"crank": 1.0}, tries=50)
    assert not any(b.singular for b in regular.found)


def test_loops_that_cannot_close_are_told_with_the_least_gap():
    """1 + 1 + 1 on a ground of 5: 2 m are missing from every start."""
    robot, loops = four_bar(1.0, 1.0, 1.0, 5.0)
    with pytest.raises(CannotAssemble, match="'loop' 2 m .*true minimum") as caught:
        branches(at_neutral(robot), loops, tries=30)
    assert caught.value.distances["loop"] == pytest.approx(2.0, abs=1e-12)


def test_limits_mark_branches_or_exclude_them():
    """The crossed branch has the rocker below zero: marked, or with `within_limits` not there."""
    robot, loops = four_bar(1.0, 3.0, 2.5, 3.0)
    robot.model.lowerPositionLimit, robot.model.upperPositionLimit = np.array([-9.0, -9.0, 0.0]), np.array([9.0, 9.0, 3.0])
    marked = branches(at_neutral(robot), loops, fixed={"crank": 0.7}, tries=60)
    assert [[x.joint for x in b.beyond_limits] for b in marked.found] == [["rocker"], []]
    kept = branches(at_neutral(robot), loops, fixed={"crank": 0.7}, tries=60, within_limits=True)
    assert len(kept) == 1 and np.abs(kept.q[0] - marked.q[1]).max() < 1e-11


@pytest.mark.parametrize(
    ("more", "match"), [({"tries": 0}, "tries"), ({"tries": 2.5}, "tries"), ({"seed": -1}, "seed"), ({"tolerance": 1.0}, "tol")]
)
def test_bad_arguments_are_refused(more: dict, match: str):
    """In words."""
    robot, loops = four_bar(1.0, 3.0, 2.5, 3.0)
    with pytest.raises(rbd.InputError, match=match):
        branches(at_neutral(robot), loops, fixed={"crank": 0.7}, **more)


def test_what_is_given_wrong_is_not_taken_for_a_bad_draw():
    """An unknown frame is an error, not 200 starts that do not close."""
    robot, _ = four_bar(1.0, 3.0, 2.5, 3.0)
    with pytest.raises(rbd.errors.FrameNotFound, match="coupler_tip"):
        branches(at_neutral(robot), [rbd.LoopClosure("loop", "coupler_tib", "rocker_tip")])


def test_constraints_that_ask_for_no_place_are_refused_by_name_and_not_by_what_follows():
    """A contact that can slip, friction alone, one name twice: each is said, as `assemble` says it."""
    robot, loops = four_bar(1.0, 3.0, 2.5, 3.0)
    slips = rbd.PointContact("slips", "rocker_tip", friction=0.5, anchor=(0.0, 0.0, 0.0))
    for given, error, match in (
        ([*loops, slips], rbd.InputError, "'slips' can slip or break"),
        ([rbd.JointFriction("rubs", "crank", 1.0)], rbd.InputError, "determines a position .*'rubs' resists motion"),
        ([*loops, *loops], rbd.errors.DuplicateName, "two constraints are named 'loop'"),
    ):
        with pytest.raises(error, match=match):
            branches(at_neutral(robot), given, fixed={"crank": 0.7}, tries=20)
        with pytest.raises(error, match=match):
            assemble(rbd.State(robot, np.array([0.7, -0.03, 1.5])), given)


def every_joint() -> rbd.model.checked_model.CheckedModel:
    """One joint of every kind that poses are written in."""
    model, parent = pin.Model(), 0
    kinds = [pin.JointModelFreeFlyer(), pin.JointModelPlanar(), pin.JointModelSpherical(), pin.JointModelRUBY()]
    kinds += [pin.JointModelRX(), pin.JointModelPZ(), pin.JointModelSphericalZYX()]
    for i, kind in enumerate(kinds):
        parent = model.addJoint(parent, kind, pin.SE3(np.eye(3), np.full(3, 0.1)), f"j{i}")
        model.appendBodyToJoint(parent, pin.Inertia(1.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
    return checked(model, "every joint")


def test_draws_are_poses_and_the_same_pose_has_no_distance(rng: np.random.Generator):
    """Unit quaternions and circles; q with turned quaternion signs and whole turns is the same pose."""
    robot = every_joint()
    for _ in range(20):
        q = draw(robot, rng)
        assert np.array_equal(q, robot.check_q(q)) or np.abs(q - robot.check_q(q)).max() < 1e-15
        other = q.copy()
        other[3:7] *= -1.0
        plain = [robot.model.joints[robot.joint_id("j4")].idx_q, robot.model.joints[robot.joint_id("j6")].idx_q]
        other[plain] += [2.0 * math.pi, -4.0 * math.pi]
        assert distance(robot, q, other) < 1e-12
        slide = robot.model.joints[robot.joint_id("j5")].idx_q
        other[slide] += 2.0 * math.pi
        assert distance(robot, q, other) == pytest.approx(2.0 * math.pi)
        back = canonical(robot, other, np.zeros(robot.nv, bool))
        assert (np.abs(back[plain]) <= math.pi + 1e-12).all()
