"""How far the centre of mass and contacts can be from contacts that stand: bounds of all poses, and plans that break them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from test_momentum import G, asked, check, sole, stay

import rbd
from rbd.errors import CannotPlan
from rbd.planning.distances import Near, apart, centre_of_mass_near, too_far_apart
from rbd.planning.momentum import Momentum
from rbd.planning.stays import Stay, centre_of, planned_contacts


@pytest.fixture(scope="module")
def solo() -> rbd.Robot:
    return rbd.load_robot("solo12")


@pytest.mark.parametrize("name", ["solo12", "talos"])
def test_no_pose_is_farther(name: str, rng: np.random.Generator):
    """At random joint angles, within limits or not, and orientations; some come near to the bounds."""
    robot = rbd.load_robot(name)
    one, other = robot.feet()[0], robot.feet()[-1]
    shares = []
    for _ in range(150):
        q = robot.standing().q.copy()
        q[3:7] = rng.normal(size=4)
        q[3:7] /= np.linalg.norm(q[3:7])
        q[7:] = rng.uniform(-np.pi, np.pi, robot.nq - 7)
        state = rbd.State(robot, q)
        X, Y = centre_of(state, one), centre_of(state, other)
        centre, radius = centre_of_mass_near(robot, one, X)
        far = apart(robot, (one, _stay(one, X)), (other, _stay(other, Y)))
        shares.append((np.linalg.norm(state.com - centre) / radius, far.distance / far.longest))
    most = np.max(shares, axis=0)
    assert (most <= 1.0).all() and (most > 0.7).all()


def _stay(contact: rbd.constraints.Contact, X: pin.SE3) -> Stay:
    """For a second."""
    return Stay(0.0, 1.0, X, X.rotation[:, 2], np.asarray(contact.corners))


def stick() -> rbd.Robot:
    """Two links of 1 m with their centres of mass in the middle, 1 kg and 3 kg, and a foot at the end of the first."""
    b = rbd.RobotBuilder("stick")
    b.body("shank", mass=1.0, com=(0.0, 0.0, 0.5), inertia=(0.1, 0.1, 0.1))
    b.body("thigh", mass=3.0, com=(0.0, 0.0, 0.5), inertia=(0.1, 0.1, 0.1))
    b.joint("knee", "shank", "thigh", "revolute", axis=(0, 1, 0), at=(0, 0, 1.0), motor=True, effort=100.0)
    return b.robot()


def test_a_straight_leg_is_as_long_as_the_bound():
    """(0.5 kg m + 3 kg 1.5 m) / 4 kg of a point; of a surface on the shank the knee is known, and the rest 3/4 of 0.5 m."""
    robot = stick()
    point = rbd.PointContact("toe", "shank", friction=0.5)
    centre, radius = centre_of_mass_near(robot, point, pin.SE3(np.eye(3), np.zeros(3)))
    assert radius == pytest.approx((0.5 + 3.0 * 1.5) / 4.0, rel=1e-8) and centre == pytest.approx(np.zeros(3))
    flat = rbd.SurfaceContact("sole", "shank", half_lengths=(0.1, 0.1), friction=0.5)
    centre, radius = centre_of_mass_near(robot, flat, pin.SE3.Identity())
    assert radius == pytest.approx(0.375, rel=1e-8) and centre == pytest.approx([0.0, 0.0, (0.5 + 3.0) / 4.0])


@pytest.mark.parametrize("share", [0.99, 1.01])
def test_there_and_back_within_reach_is_an_eighth_of_mu_g_T_squared(share: float, rng: np.random.Generator):
    """A mass at rest has to be near a place at half time, and at rest at home at the end: m g T / 4 pushes it at both ends."""
    mu, T, radius = 0.5, 0.8, 0.3
    most = mu * G * T**2 / 8.0
    m = replace(
        asked([stay(0.0, T, sole(50.0), mu)], T, [0.0, 0.0, 0.0]),
        near=(Near("floor", 0.5 * T, np.array([share * most + radius, 0.0, 0.0]), radius),),
    )
    why = m.certificate()
    assert (why is None) == (share < 1.0)
    if why is not None:
        assert {limit.kind for limit in why.limits} == {"friction", "reach", "keyframe"}
        check(why, rng)
        assert why.helps == pytest.approx(
            {"friction": share, "time": np.sqrt(share), "reach": 1.0 + (share - 1.0) * most / radius}, abs=2e-3
        )
        assert "the length of the limbs from 'floor'" in str(why) and f"{mu * share:.3g} instead of 0.5" in str(why)


def leaps(solo: rbd.Robot, by: float, front: Any, hind: Any, T: float = 2.0) -> tuple[dict[float, Any], dict[str, Any]]:
    """All feet are put down ahead, and the body is above them."""
    stand = solo.standing()
    keys = {0.0: stand, T: stand.q + by * np.eye(solo.nq)[0]}
    return keys, {foot.name: front if foot.name.startswith("front") else hind for foot in solo.feet()}


def test_feet_that_stand_too_far_apart_for_a_time(solo: rbd.Robot):
    """In no keyframe, but between: front feet land 90 cm ahead before the hind feet leave. Refused with the certificate."""
    keys, feet = leaps(solo, 0.9, [(0.0, 0.5), (0.9, 2.0)], [(0.0, 1.0), (1.5, 2.0)])
    with pytest.raises(CannotPlan, match="links between have a length of 1.1") as caught:
        rbd.plan(solo, keys, feet, progress=False)
    error, far = caught.value, caught.value.certificate
    assert {limit.kind for limit in error.limits} == {"reach"} and error.t == (0.9,) and far.distance > far.longest + 0.1
    near = planned_contacts(solo, *leaps(solo, 0.6, *list(feet.values())[1:3]), friction=0.6, ground=0.0)
    assert too_far_apart(near) is None


def test_a_leap_is_refused_by_friction_and_by_the_length_of_legs(solo: rbd.Robot, rng: np.random.Generator):
    """3 m in half a second of flight, after a second on a floor of 0.2: possible, if not within reach of its feet."""
    keys, feet = leaps(solo, 3.0, [(0.0, 1.0), (1.5, 2.5)], [(0.0, 1.0), (1.5, 2.5)], 2.5)
    m = Momentum.of(planned_contacts(solo, keys, feet, friction=0.2, ground=0.0))
    why = m.certificate()
    assert why is not None and {limit.kind for limit in why.limits} >= {"friction", "flight", "reach"}
    check(why, rng)
    assert replace(m, near=()).certificate() is None
