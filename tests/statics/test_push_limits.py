"""Largest pushes: closed forms, proofs from both sides, and what gives way."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import rbd
from rbd.statics import Limit, push_limits

BOX = rbd.load_robot(Path(__file__).parents[2] / "urdf" / "box.urdf")
AT = BOX.at(np.array([0.1, 0.2, 0.1, 0.0, 0.0, math.sin(0.3), math.cos(0.3)]))
WEIGHT = 98.1
HALF = 0.2


def base_of_box(friction: float) -> list[rbd.SurfaceContact]:
    """The box's underside, 0.4 x 0.4 m, 0.1 m below its centre."""
    placement = np.eye(4)
    placement[2, 3] = -0.1
    return [rbd.SurfaceContact("base", "box", half_lengths=(HALF, HALF), placement=placement, friction=friction)]


def level(count: int) -> np.ndarray:
    angle = np.arange(count) * (2.0 * np.pi / count)
    return np.column_stack([np.cos(angle), np.sin(angle), np.zeros(count)])


def test_talos_withstands_118_262_newtons_to_its_left(talos):
    """A rigid robot turns about its left sole's outer edge: push x height = weight x distance from the edge."""
    state, soles = talos.standing(), talos.soles(0.7)
    found = push_limits(state, soles, "torso_2_link", (0.0, 1.0, 0.0))
    edge = soles[0].rows(state).patch.corners_W[:, 1].max()
    expected = talos.mass * 9.81 * (edge - state.com[1]) / found.point[2]
    assert abs(found.forces[0] - expected) < 1e-6 and abs(expected - 118.262) < 1e-3
    assert found.gives_way == ((Limit("edge", "left_sole"),),)
    assert found.residual < 1e-6 and abs(found.bounds[0] - found.forces[0]) < 1e-6
    assert "edge of 'left_sole'" in str(found)


@pytest.mark.parametrize("friction", ["cone", "inscribed"])
def test_72_directions_are_those_asked_one_by_one(talos, friction, exhaustive):
    """Directions between two at one limit are not solved, and are right all the same; each is proven from both sides."""
    state, soles, ways = talos.standing(), talos.soles(0.7), level(72)
    found = push_limits(state, soles, "torso_2_link", ways, friction=friction)
    assert found.programs <= 36
    assert np.abs(found.bounds - found.forces).max() < 1e-5 and found.residual < 1e-5
    for i in range(0, 72, 1 if exhaustive else 5):
        one = push_limits(state, soles, "torso_2_link", ways[i], friction=friction)
        assert abs(one.forces[0] - found.forces[i]) < 1e-5
    for i in range(0, 72, 9):
        assert (np.abs(found.tau(i)) <= talos.effort_limit * (1.0 + 1e-7)).all()


def test_hold_agrees_below_a_limit_and_refuses_beyond(talos):
    """`rbd.hold` finds torques against 99.99 % of each push, and none against 100.01 %."""
    state, soles, ways = talos.standing(), talos.soles(0.3), level(12)
    found = push_limits(state, soles, "torso_2_link", ways)
    for way, force in zip(ways, found.forces, strict=True):
        rbd.hold(state, soles, external=rbd.ExternalForce("torso_2_link", 0.9999 * force * way))
        with pytest.raises(rbd.CannotHold):
            rbd.hold(state, soles, external=rbd.ExternalForce("torso_2_link", 1.0001 * force * way))


def test_torques_and_contact_forces_balance_the_push():
    """At rest h = S^T tau + J^T f + J_push^T F, at motors as at the base, with Jacobians of the frames themselves."""
    solo12 = rbd.load_robot("solo12")
    state, feet = solo12.standing(), solo12.feet(friction=0.7)
    found = push_limits(state, feet, "base_link", (3.0, 1.0, 0.0))
    total = solo12.actuation.T @ found.tau(0)
    total += state.frame("base_link").J[:3].T @ (found.forces[0] * found.directions[0])
    for foot in feet:
        total += state.frame(foot.frame, foot.offset).J[:3].T @ found.contact_forces(0)[foot.name]
    assert found.forces[0] > 10.0 and np.abs(total - rbd.dynamics.bias_force(state)).max() < 1e-6


def test_a_box_pushed_at_its_underside_slides():
    """At the ground nothing tips: the circular cone gives mu m g in every direction, and friction gives way."""
    for mu in (0.2, 0.7):
        found = push_limits(AT, base_of_box(mu), "box", level(16), offset=(0.0, 0.0, -0.1))
        assert np.abs(found.forces - mu * WEIGHT).max() < 1e-5
        assert all(limits == (Limit("friction", "base"),) for limits in found.gives_way)


def test_a_box_pushed_high_tips_over_the_edge_that_is_met_first():
    """At height z, over the edge at distance d across the push: F = m g d / z; friction would allow more."""
    angle = 0.6  # of the box
    ways = level(24)
    found = push_limits(AT, base_of_box(2.0), "box", ways, offset=(0.0, 0.0, 0.3))
    turned = ways[:, :2] @ np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    expected = WEIGHT * HALF / (0.4 * np.abs(turned).max(axis=1))  # as far as the edge, along the push
    assert np.abs(found.forces - expected).max() < 1e-5
    assert {limit.kind for limits in found.gives_way for limit in limits} == {"edge"}


def test_a_box_is_lifted_by_its_weight_and_pressed_without_end():
    """Upwards the weight holds it; downwards nothing gives way up to what was asked."""
    found = push_limits(AT, base_of_box(0.5), "box", [(0, 0, 2.0), (0, 0, -1.0)], at_most=5e3)
    assert np.abs(found.forces - [WEIGHT, 5e3]).max() < 1e-5
    assert found.gives_way == ((Limit("push", "base"),), ())


def test_oblique_directions_that_span_space():
    """Pushes in no one plane: at the underside, slipping where F_h = mu (m g - F_z)."""
    mu, ways = 0.4, np.array([[1, 0, 0.5], [0, 1, -0.5], [1, 1, 0], [-1, 0.3, 0.2], [0.2, -1, -0.1], [0, 0, 1.0]])
    found = push_limits(AT, base_of_box(mu), "box", ways, offset=(0.0, 0.0, -0.1))
    d = found.directions
    expected = mu * WEIGHT / (np.hypot(d[:, 0], d[:, 1]) + mu * d[:, 2])
    assert np.abs(found.forces - expected).max() < 1e-5


def test_a_motor_at_its_limit_is_named(talos):
    """Pressed down at the torso the knees yield first, at their limits."""
    found = push_limits(talos.standing(), talos.soles(0.7), "torso_2_link", (0, 0, -1))
    assert {limit.kind for limit in found.gives_way[0]} == {"motor"}
    used = np.abs(found.tau(0)) / talos.effort_limit
    for limit in found.gives_way[0]:
        assert abs(used[talos.actuated_names.index(limit.name)] - 1.0) < 1e-6
    assert {limit.name for limit in found.gives_way[0]} >= {"leg_left_4_joint"}


def test_smooth_ground_withstands_nothing():
    """Without friction the base slides against nothing, and that is what is named; upwards the weight holds."""
    found = push_limits(AT, base_of_box(0.0), "box", [(1, 0, 0), (0, 0, 1)])
    assert np.abs(found.forces - [0.0, WEIGHT]).max() < 1e-6
    assert found.gives_way == ((Limit("base", "box"),), (Limit("push", "base"),)) and "no motor drives" in str(found)


def test_a_joint_without_a_motor_withstands_nothing():
    """An arm whose upright first joint has no motor: gravity does not turn it, and any level push does."""
    arm = rbd.load_robot("panda", root="fixed", passive=["panda_joint1"])
    pushed = push_limits(arm.at(), [rbd.JointLock("wrist", "panda_joint7")], "panda_hand", [(0, 1, 0), (0, 0, 1)])
    assert abs(pushed.forces[0]) < 1e-9 and pushed.gives_way[0] == (Limit("passive", "panda_joint1"),)
    assert pushed.forces[1] > 10.0 and {limit.kind for limit in pushed.gives_way[1]} == {"motor"}


def test_on_one_sole_talos_is_held_by_pushes_in_an_interval(talos):
    """It would fall to its right: a push to its left turns it back over the sole, from the inner edge to the outer one."""
    state, sole = talos.standing(), talos.soles(0.7)[0]
    found = push_limits(state, [sole], "torso_2_link", (0.0, 1.0, 0.0))
    y, per_metre = sole.rows(state).patch.corners_W[:, 1], talos.mass * 9.81 / found.point[2]
    expected = per_metre * (np.array([y.min(), y.max()]) - state.com[1])  # 17.65 and 118.26 N
    assert expected[0] > 17.0 and abs(found.least[0] - expected[0]) < 1e-6 and abs(found.forces[0] - expected[1]) < 1e-6
    assert not found.held and found.residual < 1e-6 and abs(found.least_bounds[0] - found.least[0]) < 1e-6
    assert "cannot be held without a push; one of 17.65 to 118.3 N" in str(found)
    for push, holds in ((0.999 * expected[0], False), (1.001 * expected[0], True), (0.999 * expected[1], True)):
        external = [rbd.ExternalForce("torso_2_link", (0.0, push, 0.0))]
        if holds:
            rbd.hold(state, [sole], external=external, margin=0.0)
        else:
            with pytest.raises(rbd.CannotHold):
                rbd.hold(state, [sole], external=external, margin=0.0)


def test_of_a_robot_that_is_not_held_each_direction_has_its_interval_or_none(talos):
    """Eight level directions on one sole: three hold it; of the others, NaN, and no torques. Held on both: least is zero."""
    state, soles = talos.standing(), talos.soles(0.7)
    found = push_limits(state, soles[:1], "torso_2_link", level(8))
    some = np.isfinite(found.forces)
    assert np.flatnonzero(some).tolist() == [1, 2, 3] and "3 of 8 directions" in str(found)
    assert (found.least[some] > 1.0).all() and (found.least[some] < found.forces[some]).all()
    assert np.isnan(found.least[~some]).all() and not any(found.gives_way[i] for i in np.flatnonzero(~some))
    with pytest.raises(rbd.InputError, match="no push along this direction"):
        found.tau(0)
    both = push_limits(state, soles, "torso_2_link", level(8))
    assert both.held and not both.least.any() and both.residual < 1e-6


@pytest.mark.parametrize("mu", [0.25, 0.5])
def test_a_box_at_a_wall_is_held_by_any_push_from_its_weight_over_the_friction(mu):
    """Friction mu N carries it: pressed with W / mu or more, and no limit is met."""
    placement = np.eye(4)
    placement[:3, :3], placement[:3, 3] = [[0, 0, -1], [0, 1, 0], [1, 0, 0]], [0.2, 0.0, 0.0]  # z out of the wall: -x
    wall = rbd.SurfaceContact("wall", "box", half_lengths=(0.1, 0.1), placement=placement, friction=mu)
    upright = BOX.at(np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]))
    found = push_limits(upright, [wall], "box", (1.0, 0.0, 0.0), at_most=1e4)
    assert abs(found.least[0] - WEIGHT * max(1.0 / mu, 2.0)) < 1e-5 and found.forces[0] == 1e4
    assert "N or more along" in str(found) and "no limit met up to 1e+04 N" in str(found)


def test_what_cannot_stand_is_refused(talos):
    """On one sole beside which it falls nothing holds Talos unpushed, nor a push the same way."""
    with pytest.raises(rbd.CannotHold, match="without a push, nor by one along this direction"):
        push_limits(talos.standing(), talos.soles(0.001)[:1], "torso_2_link", (0, -1, 0))


def test_bad_input_is_refused(talos):
    """Directions of no length, frames that are none, numbers that are none."""
    given = {"state": AT, "contacts": base_of_box(0.5), "frame": "box", "directions": (0, 1, 0)}
    for wrong in (
        {"directions": (0, 0, 0)}, {"directions": []}, {"directions": (1, 0)}, {"directions": (math.nan, 0, 0)},
        {"at_most": -1.0}, {"frame": "boxes"}, {"offset": (0, 0)}, {"contacts": []}, {"friction": "some"},
    ):  # fmt: skip
        with pytest.raises(rbd.InputError):
            push_limits(**given | wrong)
    with pytest.raises(rbd.InputError, match="number"):
        push_limits(**given).tau(1)
