"""States of assemblies and branches, postures by absolute angles, planar joints upright, and how many branches are unseen."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import rbd
from rbd.errors import InputError
from rbd.mechanism import assemble, branches, four_bar, link_angles, with_link_angles

NORTON = four_bar(40, 120, 80, 100, crank_angle=math.radians(40))


def test_assemblies_and_branches_have_states():
    """Of their configuration, at rest."""
    found = assemble(NORTON.at("assembled"), fixed={"crank_joint": 0.8})
    assert np.array_equal(found.state.q, found.q) and not found.state.v.any()
    both = branches(NORTON.at(), fixed={"crank_joint": 0.8}, tries=20)
    assert all(np.array_equal(branch.state.q, branch.q) for branch in both.found)
    assert found.state.joint("crank_joint").position == pytest.approx(0.8)


def test_a_joint_of_a_state_is_its_coordinate_and_rate():
    """A number of one degree of freedom, the parts of q and v of several; an unknown one with the nearest names."""
    state = NORTON.at("assembled").with_joint_velocities({"rocker_joint": -2.0})
    assert state.joint("rocker_joint") == (NORTON.joints["rocker_joint"].coordinate(state.q), -2.0)
    box = rbd.State(rbd.testing.box(mass=1.0), [1, 2, 3, 0, 0, 0, 1], [1, 2, 3, 4, 5, 6])
    base = box.joint(next(iter(box.robot.joints)))
    assert np.array_equal(base.position, box.q) and np.array_equal(base.velocity, box.v)
    with pytest.raises(rbd.errors.JointNotFound, match="crank_joint"):
        state.joint("crnk_joint")


def test_a_posture_by_absolute_angles():
    """The angles asked for, a link that hangs on another too; others turn with what they hang on; read back by link_angles."""
    state = with_link_angles(NORTON.at(), {"coupler": -0.4, "crank": 1.1, "rocker": 2.9})
    found = link_angles(state)
    assert [found[link] for link in ("crank", "coupler", "rocker")] == pytest.approx([1.1, -0.4, 2.9], abs=1e-14)
    only = link_angles(with_link_angles(state, {"crank": 0.6}))
    assert only["coupler"] == pytest.approx(-0.9, abs=1e-14) and only["rocker"] == pytest.approx(2.9, abs=1e-14)
    same = with_link_angles(NORTON.at("crossed"), link_angles(NORTON.at("assembled")))
    assert np.abs(same.q - NORTON.at("assembled").q).max() < 1e-12


def test_absolute_angles_that_no_joint_sets_are_refused():
    """The ground, a slide, an unknown link, two frames of one link at different angles."""
    slider = rbd.mechanism.slider_crank(1.0, 3.0)
    for robot, angles, says in (
        (NORTON, {"ground": 0.1}, "'ground' stays at 0 rad"),
        (slider, {"slider": 0.1}, "'slider' is not turned by its joint"),
        (NORTON, {"crnk": 0.1}, "crank"),
        (NORTON, {"coupler": 0.1, "coupler_tip": 0.2}, "fixed to the ground or to another one"),
    ):
        with pytest.raises(InputError, match=says):
            with_link_angles(robot.at("assembled"), angles)


@pytest.mark.parametrize(("plane", "axis"), [("xy", (0, 0, 1)), ("xz", (0, -1, 0)), ("yz", (1, 0, 0))])
def test_a_planar_joint_slides_in_the_plane_named(plane, axis):
    """As two slides and a hinge: the same poses and accelerations, and the body's axes are parallel to its parent's at zero."""
    one, other = (rbd.RobotBuilder("sled", root="fixed") for _ in range(2))
    blade = rbd.robots.Box((0.3, 0.2, 0.1), mass=2.0, at=(0.1, 0.05, 0.02))
    one.body("sled", blade)
    one.joint("slide", "ground", "sled", "planar", at=(0.1, 0.2, 0.3), rpy=(0.2, 0.1, -0.3), plane=plane)
    ways = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1)}
    for name, parent, child, kind, way in (
        ("first", "ground", "a", "prismatic", ways[plane[0]]),
        ("second", "a", "b", "prismatic", ways[plane[1]]),
        ("turn", "b", "sled", "continuous", axis),
    ):
        more = {"at": (0.1, 0.2, 0.3), "rpy": (0.2, 0.1, -0.3)} if parent == "ground" else {}
        other.body(child, *([blade] if child == "sled" else []))
        other.joint(name, parent, child, kind, axis=way, **more)
    whole, parts = one.robot(), other.robot()
    angle, v = 0.7, np.array([0.3, -0.5, 1.1])
    turned = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    a = whole.at([0.4, -0.2, math.cos(angle), math.sin(angle)], np.r_[turned.T @ v[:2], v[2]])
    b = parts.at([0.4, -0.2, math.cos(angle), math.sin(angle)], v)
    X, Y = (state.frame("sled").X_WF for state in (a, b))
    assert np.abs(X.homogeneous - Y.homogeneous).max() < 1e-14
    assert np.abs(a.frame("sled").v - b.frame("sled").v).max() < 1e-14
    spins = [rbd.solve(state, []).a[2] for state in (a, b)]
    assert spins[0] == pytest.approx(spins[1], rel=1e-12)


def test_a_plane_of_another_joint_or_of_another_name_is_refused():
    """With what was expected."""
    b = rbd.RobotBuilder("sled", root="fixed")
    with pytest.raises(InputError, match="is revolute and has a plane, 'xz'; expected kind='planar'"):
        b.joint("slide", "ground", "sled", "revolute", plane="xz")
    with pytest.raises(InputError, match="plane of joint 'slide' is 'zx'"):
        b.joint("slide", "ground", "sled", "planar", plane="zx")


def test_how_many_branches_are_unseen_is_estimated_from_hits():
    """Chao's estimate: none where all were hit often; of a draw from many alike it comes near the number that is missing."""
    both = branches(NORTON.at(), fixed={"crank_joint": 0.8}, tries=50)
    assert both.unseen == 0.0 and "by their hits" not in str(both)
    rng, estimates = np.random.default_rng(0), []
    for _ in range(200):
        hits = np.bincount(rng.integers(0, 100, size=120), minlength=100)
        found = tuple(replace(both.found[0], hits=int(k)) for k in hits if k)
        estimates.append(replace(both, found=found).unseen + len(found))
    assert np.mean(estimates) == pytest.approx(100.0, rel=0.05)
