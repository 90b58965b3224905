"""Outlines over boxes of poses, and of torques that are shared: closed forms, members drawn at random, bad input."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import rbd
from rbd.errors import DistantContactWarning
from rbd.robots import Box, PointMass
from rbd.robust import PushSet, hold, push_limits, region
from rbd.robust.poses import posed

G = 9.81
BOX = rbd.testing.box(mass=10.0)
AT_REST = rbd.State(BOX, [0, 0, 0, 0, 0, 0, 1])


def with_slider(axis: tuple[float, float, float], effort: float = 60.0) -> rbd.Robot:
    """A base of 10 kg that carries 5 kg on a slide with a motor."""
    b = rbd.RobotBuilder("carrier")
    b.body("base", Box((0.4, 0.2, 0.1), mass=10.0))
    b.body("load", PointMass(5.0))
    b.joint("slide", "base", "load", kind="prismatic", axis=axis, motor=True, effort=effort, limits=(-1.0, 1.0))
    return b.robot()


def sole(frame: str, friction: float = 0.5) -> list[rbd.SurfaceContact]:
    """A base of 0.4 x 0.2 m at the height of the frame."""
    return [rbd.SurfaceContact("base", frame, half_lengths=(0.2, 0.1), friction=friction)]


def test_a_load_that_slides_anywhere_tips_the_carrier_at_the_nearer_end():
    """M g 0.2 - 5 g s over 0.3 m: of all places s within 5 cm of the middle the outermost decides, either way."""
    robot = with_slider((1, 0, 0))
    found = push_limits(
        robot.at(), sole("base", 5.0), "base", [(1, 0, 0), (-1, 0, 0)], offset=(0, 0, 0.3), joints={"slide": (-0.05, 0.05)}
    )
    expected = G * (15.0 * 0.2 - 5.0 * 0.05) / 0.3
    assert (found.inner <= expected).all() and (found.outer >= expected).all()
    assert (found.outer - found.inner).max() < 1e-5 * expected
    assert all(proof.verify() for proof in found.holds) and all(against.verify() for against in found.counterexamples)
    assert [against.members[0].joints["slide"] for against in found.counterexamples] == [0.05, -0.05]  # none beyond the box


def test_the_region_asks_for_the_highest_push_of_a_box_of_poses():
    """Pushed by up to 5 N at a point 0.2 to 0.3 m above the base: 5 x 0.3 / (15 g) are lost at both ends, as of the highest.

    The poses themselves do not move the centre of mass: it is where it is asked about.
    """
    robot, lost = with_slider((0, 0, 1)), 5.0 * 0.3 / (15.0 * G)
    push, joints = PushSet.box("load", (-5, 0, 0), (5, 0, 0)), {"slide": (0.2, 0.3)}
    found = region(robot.at(), sole("base"), pushes=push, joints=joints)
    assert np.abs(found.outer).max(axis=0) == pytest.approx([0.2 - lost, 0.1], abs=1e-6)
    assert found.area <= found.outer_area and found.area == pytest.approx(found.outer_area, rel=1e-4)
    assert all(proof.verify() for proof in found.holds) and all(against.verify() for against in found.counterexamples)
    ends = [against for against in found.counterexamples if abs(against.velocities[0] @ np.eye(7)[4]) > 0.1]  # tips about y
    assert ends and all(against.members[0].joints["slide"] == pytest.approx(0.3) for against in ends)
    with pytest.raises(rbd.CannotHold, match="held nowhere"):  # 5 g is more than the motor can bear
        region(with_slider((0, 0, 1), effort=49.0).at(), sole("base"), joints=joints)


def test_poses_drawn_at_random_withstand_the_inner_push():
    """Of a box of poses with uncertain masses: each pose by itself, with a mass of its own; the outer end is beyond."""
    solo, feet, rng = rbd.load_robot("solo12"), rbd.load_robot("solo12").feet(friction=0.7), np.random.default_rng(8)
    state = solo.standing()
    joints = {n: (q - 0.03, q + 0.03) for n, q in (("FL_HFE", 0.8), ("FL_KFE", -1.6), ("HR_HAA", -0.1))}
    found = push_limits(state, feet, "base_link", (1, 0, 0), joints=joints, mass={"base_link": 0.05})
    alone = push_limits(state, feet, "base_link", (1, 0, 0), mass={"base_link": 0.05})
    assert found.inner[0] < alone.inner[0] and found.inner[0] < found.outer[0] <= alone.outer[0] + 1e-4
    assert found.outer[0] - found.inner[0] < 0.05 * alone.inner[0] and found.holds[0].verify()
    assert found.counterexamples[0].verify()
    mass = found.counterexamples[0].members[0].mass["base_link"]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DistantContactWarning)  # planes stay
        for _ in range(3):
            pose = posed(state, {n: rng.uniform(*ends) for n, ends in joints.items()})
            one = {"base_link": rng.choice([mass, 1.05 / 0.95 * mass])}
            push = {"base_link": [(found.inner[0] * rng.uniform(0.9, 1.0), 0, 0)]}
            assert hold(pose, feet, pushes=push, mass={n: (m, m) for n, m in one.items()}).proved


def test_an_empty_box_of_poses_changes_nothing():
    """`joints={}` says the same as no joints."""
    without, empty = (region(AT_REST, sole("box"), mass=0.1, joints=joints) for joints in (None, {}))
    assert np.array_equal(without.vertices, empty.vertices) and np.array_equal(without.outer, empty.outer)
    limits = [push_limits(AT_REST, sole("box"), "box", (1, 0, 0), mass=0.1, joints=joints) for joints in (None, {})]
    assert limits[0].inner == limits[1].inner and limits[0].outer == limits[1].outer


def test_places_of_a_box_of_poses_are_proved_and_refuted(exhaustive):
    """It is smaller than that of one pose, its inner end within two per cent of the outer one; Solo, two joints."""
    if not exhaustive:
        pytest.skip("the region of a carrier is the same code; Solo's in the exhaustive run")
    solo = rbd.load_robot("solo12")
    state, feet, box = solo.standing(), solo.feet(friction=0.7), {"FL_HFE": (0.79, 0.81), "FL_KFE": (-1.61, -1.59)}
    found, alone = (region(state, feet, joints=joints, mass={"base_link": 0.05}) for joints in (box, None))
    assert 0.98 * found.outer_area < found.area <= found.outer_area < alone.outer_area
    assert all(proof.verify() for proof in found.holds) and all(against.verify() for against in found.counterexamples)


def test_parts_bring_the_inner_end_nearer():
    """Of a centre of mass within half the base corner forces are no affine function: it tips at m g (0.1 - 0.05) / 0.3."""
    given = {"offset": (0, 0, 0.3), "com": {"box": (0.098, 0.05, 0.0)}}
    whole, parts = (push_limits(AT_REST, sole("box", 2.0), "box", (0, 1, 0), **given, most_parts=n) for n in (1, 4))
    expected = BOX.mass * G * 0.05 / 0.3
    assert whole.inner[0] < 0.5 * expected and parts.holds[0].parts > 1 and parts.holds[0].verify()
    assert 0.99 * expected < parts.inner[0] <= expected <= parts.outer[0] < expected * (1.0 + 1e-5)


def test_parts_prove_places_where_one_proof_finds_none():
    """With a centre of mass within 0.15 x 0.07 m of where it is said to be, 0.1 x 0.06 m are left of a base of 0.4 x 0.2 m."""
    none, parts = (region(AT_REST, sole("box"), com={"box": (0.15, 0.07, 0.0)}, most_parts=n) for n in (1, 4))
    assert none.empty and none.outer_area == pytest.approx(parts.outer_area) == pytest.approx(0.1 * 0.06, rel=1e-4)
    assert 0.99 * 0.1 * 0.06 < parts.area <= 0.1 * 0.06 and all(proof.parts > 1 and proof.verify() for proof in parts.holds)


def test_torques_that_are_shared_have_outlines_too():
    """A box has no torques: one for all is as good as one for each; of Solo one torque withstands no push, a law of it does."""
    expected = 0.3 * 9.0 * G
    one = push_limits(AT_REST, sole("box"), "box", (1, 0, 0), mass=0.1, friction=0.3, torques="one")
    assert one.inner[0] <= expected <= one.outer[0] and one.outer[0] - one.inner[0] < 1e-5 * expected
    base = region(AT_REST, sole("box"), mass=0.1, torques="one")
    assert base.area <= 0.4 * 0.2 <= base.outer_area and base.outer_area - base.area < 1e-5
    solo = rbd.load_robot("solo12")
    state, feet = solo.standing(), solo.feet(friction=0.7)
    ends = [push_limits(state, feet, "base_link", (1, 0, 0), torques=torques) for torques in ("one", "affine", "each")]
    assert [e.outer[0] - e.inner[0] < 1e-4 for e in ends] == [True] * 3 and ends[0].outer[0] < 1e-4
    assert ends[1].inner[0] == pytest.approx(ends[2].inner[0], rel=1e-4) and ends[1].holds[0].gain.shape == (12, 3)
    assert ends[1].holds[0].balance < 1e-6 * solo.mass * G
    assert all(e.holds[0].verify() and e.counterexamples[0].verify() for e in ends)


def test_places_of_one_torque_are_those_of_one_robot():
    """Where only friction is uncertain there is one load at each place, so that nothing is shared.

    With uncertain masses nothing is left of the region of a robot with joints.
    """
    solo = rbd.load_robot("solo12")
    state, feet = solo.standing(), solo.feet(friction=0.7)
    one, each = (region(state, feet, friction=0.5, torques=torques, most_directions=8) for torques in ("one", "each"))
    assert one.area == pytest.approx(each.area, rel=1e-4) and one.area <= one.outer_area
    assert one.outer_area == pytest.approx(each.outer_area, rel=1e-4)
    with pytest.raises(rbd.CannotHold, match="torques='one'.*Try torques='each'"):
        region(state, feet, mass=0.05, torques="one")


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"torques": "all"}, "torques is 'all'.*Expected one of each, one, affine"),
        ({"joints": [("slide", 0.0, 0.1)]}, "lowest, highest"),
        ({"joints": {"slide": (0.1, 0.0)}}, "lowest and highest"),
        ({"joints": {"slid": (0.0, 0.1)}}, "nearest: 'slide'"),
        ({"most_parts": 0}, "most_parts"),
    ],
)
def test_outlines_of_sets_that_are_none_are_refused(given, words):
    """Of both, with the same words as `hold` has."""
    robot = with_slider((1, 0, 0))
    for answer in (lambda: region(robot.at(), sole("base"), **given), lambda: hold(robot.at(), sole("base"), **given)):
        with pytest.raises(rbd.RbdError, match=words):
            answer()
    with pytest.raises(rbd.RbdError, match=words):
        push_limits(robot.at(), sole("base"), "base", (1, 0, 0), **given)
