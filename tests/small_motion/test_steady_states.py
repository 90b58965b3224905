"""Equilibria and steady motions that are found: against closed forms; and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
import pytest
from bicycle_benchmark import REAR, tyres, upright, whipple
from flat_bodies import pendulum

import rbd


def test_a_pendulum_that_is_pushed_hangs_at_the_angle_of_its_balance():
    """It hangs at tan = F / (m g), whatever the start on its side; upside down it is an equilibrium too, and unstable."""
    bob = pendulum(2.0, 0.7)
    push = rbd.ExternalForce("bob", (5.0, 0.0, 0.0))
    found = rbd.find_equilibrium(rbd.State(bob, [0.3], [9.0]), [], external=[push])
    assert abs(found.state.q[0] + math.atan2(5.0, 2.0 * 9.81)) < 1e-11 and not found.state.v.any()
    assert (found.freedoms, found.stable) == (0, None) and found.residual < 1e-9
    over = rbd.find_equilibrium(rbd.State(bob, [3.0]), [])
    assert abs(over.state.q[0] - math.pi) < 1e-11 and over.stable is False
    assert "Unstable: 1 mode grows" in str(over)


@pytest.mark.parametrize("name", ["four_bar", "slider_crank", "five_bar", "six_bar"])
def test_small_mechanisms_far_from_an_equilibrium_find_one(name: str):
    """Links of centimetres accelerate by 500 rad/s2: Newton stays on the loops, and goes downhill first where it is stuck."""
    robot = rbd.load_robot(name)
    for posture in robot.postures:
        found = rbd.find_equilibrium(robot.at(posture))
        assert found.acceleration < 1e-9 and found.linearised.difference < 1e-8
    start = robot.at(rbd.mechanism.assemble(robot.at()).q)
    assert rbd.find_equilibrium(start).acceleration < 1e-9


def test_torques_that_hold_are_found_for_the_nearest_pose_that_some_hold():
    """Talos stays where it stands; an acrobot with a motor at its elbow moves its centre of mass over the shoulder."""
    talos = rbd.load_robot("talos")
    found = rbd.find_equilibrium(talos.standing(), talos.soles(friction=0.7), tau="free")
    assert found.moved < 1e-8 and found.acceleration < 1e-8 and found.freedoms == 26
    assert np.abs(found.tau - rbd.hold(found.state, talos.soles(friction=0.7)).tau).max() < 1e-6
    chain = rbd.planar.Chain(2, lengths=[1.0, 1.0])
    arm = rbd.planar.to_robot(chain, bodies="points", masses=[1.0, 1.0])
    acrobot = rbd.model.checked_model.CheckedModel(arm.model, passive=(arm.actuated_names[0],), name="acrobot")
    found = rbd.find_equilibrium(rbd.State(acrobot, [1.3, 0.8]), [], tau="free")
    assert abs(found.state.com[0]) < 1e-9 and found.freedoms == 1
    assert abs(found.tau[0] - 9.81 * math.cos(found.state.q.sum())) < 1e-9


def test_values_that_are_fixed_are_kept():
    """A double pendulum with its second joint held by torques at 0.5 rad."""
    chain = rbd.planar.Chain(2, lengths=[1.0, 1.0])
    arm = rbd.planar.to_robot(chain, bodies="points", masses=[1.0, 1.0])
    first, second = arm.actuated_names
    acrobot = rbd.model.checked_model.CheckedModel(arm.model, passive=(first,), name="acrobot")
    found = rbd.find_equilibrium(rbd.State(acrobot, [-1.3, 0.0]), [], tau="free", fixed={second: 0.5})
    assert found.state.q[1] == 0.5 and abs(found.state.com[0]) < 1e-10 and found.state.com[2] < 0.0


def test_a_bicycle_turns_without_hands_at_the_speed_that_its_lean_wants():
    """No torque at the bars: from 5 and from 6 m/s the search ends at one turn; it is a motion of the true simulation."""
    bicycle = whipple(passive=("steer", "rear_hub", "front_hub"))
    speeds = []
    for speed in (5.0, 6.0):
        found = rbd.find_steady_motion(upright(bicycle, speed), tyres(), fixed={"steer": 0.05})
        speeds.append(found.state.v[bicycle.joints["rear_hub"].v][0] * REAR)
        assert found.residual < 1e-9 and found.acceleration < 1e-9
        assert found.linearised.variation < 1e-9 and found.linearised.difference < 1e-8
    assert abs(speeds[0] - speeds[1]) < 1e-8 and 4.292 < speeds[0] < 6.024
    small = found.linearised
    assert small.symmetries.shape[1] == 5 and small.stable is False  # slowly: as capsize at 6.1 m/s does
    way = rbd.simulate(found.state, tyres(), duration=0.5, step=0.02, integrator=rbd.DormandPrince8(), progress=False)
    assert np.abs(way.v[-1] - found.state.v).max() < 1e-6
    radius = found.state.v[0] / found.state.v[5]
    lean = 2.0 * math.asin(abs(found.state.q[3]))
    assert abs(math.tan(lean) / (found.state.v[0] ** 2 / (9.81 * radius)) - 1.0) < 0.05  # but for gyroscopic moments


def test_a_bicycle_with_hands_turns_at_a_given_speed():
    """With torques free, speed and steer may be given."""
    bicycle = whipple()
    found = rbd.find_steady_motion(
        upright(bicycle, 5.0), tyres(), fixed={"steer": 0.05}, speeds={"rear_hub": 5.0 / REAR}, tau="free"
    )
    assert found.state.v[bicycle.joints["rear_hub"].v][0] == 5.0 / REAR
    assert abs(found.tau[0]) < 1e-8 and 0.01 < abs(found.tau[1]) < 1.0  # no drive is needed, a hand at the bars is
    assert found.linearised.stable


def test_a_coin_precesses_as_the_closed_form_says():
    """(C + m r^2) w3 W sin - A W^2 sin cos + m g r cos = 0 of a thin disk; a given lean, by a condition."""
    coin = rbd.load_robot("rolling_disk")
    m, r = 2.0, coin.wheels()[0].radius
    A, C = 0.25 * m * r * r, 0.5 * m * r * r

    def leans(state: rbd.State) -> float:
        return float(state.base_pose().rotation[2, 1]) + math.sin(0.3)

    start = rbd.State(coin, [0, 0, r, math.sin(-0.1), 0, 0, math.cos(0.1)], [2.0, 0, 0, 0, 2.0 / r, 0.5])
    found = rbd.find_steady_motion(start, conditions=[leans])
    R = found.state.base_pose().rotation
    axis, up = R[:, 1], np.array([0.0, 0.0, 1.0]) - R[2, 1] * R[:, 1]
    up /= np.linalg.norm(up)
    omega = R @ found.state.v[3:]
    sin, cos = float(up[2]), float(axis[2])
    W, w3 = float(omega @ up) / sin, float(omega @ axis)
    terms = np.array([(C + m * r * r) * w3 * W * sin, -A * W * W * sin * cos, m * 9.81 * r * cos])
    assert abs(terms.sum()) < 1e-9 * np.abs(terms).max() and abs(cos + math.sin(0.3)) < 1e-10
    assert abs(W) > 0.1 and found.linearised.symmetries.shape[1] == 4
    assert found.linearised.difference < 1e-9 and found.linearised.variation < 1e-9


def test_a_sleigh_cruises_straight_from_a_turning_start():
    """Chaplygin's sleigh has no steady turn: what is near is a straight line."""
    sleigh = rbd.load_robot("chaplygin_sleigh")
    found = rbd.find_steady_motion(sleigh.at(None, [2.0, 0.1, 0.3]), speeds={"root_joint.vx": 2.0})
    assert np.abs(found.state.v[1:]).max() < 1e-9 and found.state.v[0] == 2.0 and found.stable


def test_what_has_no_steady_state_is_refused_with_the_nearest():
    """A box in the air; a box on a slope that slips; values that contradict the motion; bad names and numbers."""
    box = rbd.testing.box(mass=2.0)
    at = rbd.State(box, [0, 0, 0, 0, 0, 0, 1])
    with pytest.raises(
        rbd.errors.NoSteadyState, match=r"no equilibrium of box .* 'root_joint.vz' accelerates by -9.81"
    ) as error:
        rbd.find_equilibrium(at)
    assert error.value.acceleration == pytest.approx(9.81) and error.value.reason == rbd.errors.Reason.NO_STEADY_STATE
    slope = rbd.Ground(point=(0, 0, 0), normal=(0.6, 0.0, 0.8))
    sole = rbd.SurfaceContact("sole", "box", half_lengths=(0.1, 0.1), friction=0.5, on=slope)
    turned = rbd.State(box, [0, 0, 0, *pin.Quaternion(np.array([0, 0, 1.0]), np.array([0.6, 0, 0.8])).coeffs()])
    with pytest.raises(rbd.errors.NoSteadyState, match="slip or open"):
        rbd.find_equilibrium(turned, [sole])
    held = rbd.find_equilibrium(turned, [rbd.SurfaceContact("sole", "box", half_lengths=(0.1, 0.1), friction=0.8, on=slope)])
    assert held.acceleration < 1e-9 and held.linearised.n == 0
    bicycle = whipple(passive=("steer", "rear_hub", "front_hub"))
    with pytest.raises(rbd.errors.NoSteadyState, match="no steady motion of whipple"):
        rbd.find_steady_motion(upright(bicycle, 5.0), tyres(), fixed={"steer": 0.05}, speeds={"rear_hub": 5.0 / REAR})
    with pytest.raises(rbd.errors.JointNotFound, match="'steer'"):
        rbd.find_steady_motion(upright(bicycle, 5.0), tyres(), fixed={"stear": 0.05})
    with pytest.raises(rbd.InputError, match="one finite number, of one of 'root_joint.vx'"):
        rbd.find_steady_motion(upright(bicycle, 5.0), tyres(), speeds={"root_joint": 1.0})
    with pytest.raises(rbd.InputError, match="'free'"):
        rbd.find_equilibrium(at, tau="any")
    with pytest.raises(rbd.InputError, match="conditions"):
        rbd.find_steady_motion(upright(bicycle, 5.0), tyres(), conditions=[3.0])
