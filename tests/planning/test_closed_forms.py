"""Plans of a load on a slide over a plate, whose motions have closed forms: friction, a lift, the edge of the plate."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import rbd
from rbd.errors import CannotPlan, ModelError
from rbd.planning.planned_motion import _Settings

G, MASS, PLATE = 9.81, 10.0, 0.01
MU, T = 0.5, 1.0
SETTINGS = _Settings(MU, 0.0, None, True, False, None, lambda v: (v, v), False, None)


def cart(axis: tuple[float, float, float]) -> rbd.Robot:
    """A load that slides on a plate, half a metre above the ground."""
    b = rbd.RobotBuilder("cart")
    b.body("plate", mass=PLATE, inertia=(1e-3, 1e-3, 1e-3))
    b.body("load", mass=MASS, inertia=(0.1, 0.1, 0.1))
    b.joint("slide", "plate", "load", "prismatic", axis=axis, at=(0, 0, 0.5), motor=True, effort=1e4, limits=(-3, 3))
    return b.robot()


def sole(x: float, y: float) -> rbd.SurfaceContact:
    """The plate on the ground."""
    return rbd.SurfaceContact("sole", "plate", half_lengths=(x, y), friction=MU, on=rbd.Ground())


def planned(robot: rbd.Robot, contact: Any, to: float, duration: float = T, **given: Any) -> rbd.planning.Plan:
    """From zero to a place of the slide."""
    q = robot.neutral()
    keys = {0.0: q, duration: q + to * np.eye(robot.nq)[-1]}
    return rbd.plan(robot, keys, {contact: True}, progress=False, self_collision=False, **given)


@pytest.mark.parametrize("rate", [50.0, 100.0, 400.0])
def test_a_load_is_moved_as_far_as_so_many_knots_allow(rate: float):
    """Rest to rest at one height takes mu g T^2 / 4 at most, of which n pieces of a cubic spline allow (1 - 3 / n)^2.

    The accelerations at the first two and the last two knots are zero; the others forwards, then backwards. 99 % of that, with
    the share of friction that is used, are found, and one percent more is not.
    """
    shares = replace(SETTINGS, rate=rate).tries(False)[-1]
    most = 0.25 * shares[1] * MU * G * T**2 * (1.0 - 3.0 / (rate * T)) ** 2 * (MASS + PLATE) / MASS
    assert shares[1] >= 1.0 - 0.03 * (100.0 / rate) ** 2 and (rate < 400.0 or most > 0.98 * 0.25 * MU * G * T**2)
    robot, contact = cart((1, 0, 0)), sole(3.0, 3.0)
    plan = planned(robot, contact, 0.99 * most, rate=rate)
    assert plan.certified and len(plan.curve.t) == round(rate * T) + 1
    with pytest.raises(CannotPlan, match="rate=") as caught:
        planned(robot, contact, 1.01 * most, rate=rate)
    assert caught.value.momentum is None


def test_friction_of_a_load_whose_height_is_given():
    """What it may rise and fall for, twice as much, is refused with the certificate of the momentum."""
    robot, contact, most = cart((1, 0, 0)), sole(3.0, 3.0), 0.25 * MU * G * T**2
    share = MASS / (MASS + PLATE)
    with pytest.raises(CannotPlan) as caught:
        planned(robot, contact, 2.01 * most / share)
    assert caught.value.plan is None and {limit.kind for limit in caught.value.momentum.limits} == {"friction", "keyframe"}
    assert caught.value.momentum.helps["friction"] == pytest.approx(1.005, abs=1.5e-3)


def test_acceleration_is_friction(rng: np.random.Generator):
    """At any time of a plan the sum of forces is m (g + a), and |a| at most mu g."""
    plan = planned(cart((1, 0, 0)), sole(3.0, 3.0), 0.7 * 0.25 * MU * G * T**2)
    d = 1e-4
    for t in rng.uniform(0.02, T - 0.02, 20):
        a = (plan.state(t + d).com - 2.0 * plan.state(t).com + plan.state(t - d).com) / d**2
        total = plan.forces(t)["sole"].sum(axis=0)
        assert total == pytest.approx(plan.robot.mass * (a + [0.0, 0.0, G]), abs=0.01)
        assert abs(a[0]) <= MU * G * (1.0 + 1e-6)


def test_a_lifted_load_presses_with_its_weight_and_its_acceleration(rng: np.random.Generator):
    """One contact: m (g + a) in sum, and the motor's force m_load (g + a)."""
    plan, d = planned(cart((0, 0, 1)), sole(0.3, 0.3), 0.4), 1e-4
    assert plan.certified
    for t in rng.uniform(0.02, T - 0.02, 20):
        z = [plan.state(x).com[2] for x in (t - d, t, t + d)]
        a = (z[2] - 2.0 * z[1] + z[0]) / d**2
        assert plan.forces(t)["sole"].sum(axis=0) == pytest.approx([0.0, 0.0, plan.robot.mass * (G + a)], abs=0.01)
        load = a * plan.robot.mass / MASS  # the plate does not move
        assert plan.torques(t) == pytest.approx([MASS * (G + load)], abs=0.01)


def test_it_rests_where_the_support_region_says():
    """The load is moved to 0.7 and 0.994 of the way to the plate's edge; beyond it is refused before it is planned."""
    robot, contact, edge = cart((1, 0, 0)), sole(0.3, 0.2), 0.3 * (MASS + PLATE) / MASS
    for share in (0.7, 0.994, 1.01):
        end = rbd.State(robot, robot.neutral() + share * edge * np.eye(robot.nq)[-1])
        assert rbd.statics.support_region(end, [contact]).distance() == pytest.approx(0.3 * (1.0 - share), abs=1e-9)
        if share < 1.0:
            plan = planned(robot, contact, share * edge, 3.0)
            assert plan.certified
            total = plan.forces(3.0)["sole"].sum(axis=0)
            A, bias, _ = plan.state(3.0).centroidal()
            rate = A[:3] @ plan.acceleration(3.0) + bias[:3]  # nearly at rest: what the spline leaves
            assert total == pytest.approx(rate + [0.0, 0.0, robot.mass * G], abs=1e-6)
            assert np.abs(rate).max() < 0.01 * MASS * G
            continue
        with pytest.raises(CannotPlan, match="at rest at 3 s") as caught:
            planned(robot, contact, share * edge, 3.0)
        assert "edge" in {limit.kind for limit in caught.value.limits} and caught.value.plan is None


def test_where_it_stands_still_it_is_the_pose_that_was_found():
    """Targets of a keyframe at which it rests are met as by `find_pose`."""
    solo = rbd.load_robot("solo12")
    stand, feet = solo.standing(), {foot.name: True for foot in solo.feet()}
    com = stand.com + [0.02, 0.01, -0.03]
    places = {foot.name: foot.points(stand).positions[0] for foot in solo.feet()}
    found = rbd.find_pose(solo, places, com=com).state
    plan = rbd.plan(solo, {0.0: stand, 0.8: {"com": com}}, feet, progress=False)
    assert plan.certified and plan.state(0.8).com == pytest.approx(com, abs=1e-9)
    assert plan.state(0.8).q == pytest.approx(found.q, abs=1e-6)


def test_a_robot_without_feet():
    """Has contacts of one's own; names of feet are refused in words."""
    robot = cart((1, 0, 0))
    with pytest.raises(ModelError, match="no feet are known for cart"):
        rbd.plan(robot, {0.0: robot.neutral(), 1.0: robot.neutral()}, {"sole": True}, progress=False)
