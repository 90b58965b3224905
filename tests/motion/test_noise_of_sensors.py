"""Noise of measurements carried to positions and forces: by draws, by differences, and in closed form."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.arrays import Array
from rbd.model.checked_model import CheckedModel
from rbd.motion import SensorNoise
from rbd.motion.contact_detection import place_noise
from rbd.motion.contact_timeline import FloorPoints
from rbd.motion.frame_terms import placements
from rbd.motion.sensor_noise import FLOOR, force_scale, whitening

AXIS = np.array([1.0, -2.0, 0.5])
"""Where the turntable's vertical axis stands [m]."""
GRAVITY = np.array([2.0, -1.0, -9.5])
"""Not along the axis: the weight depends on both angles [m/s2]."""


def turntable() -> CheckedModel:
    """A table on a vertical axis, and on it an arm that nods about y at 0.5 m from the axis."""
    model = pin.Model()
    table = model.addJoint(0, pin.JointModelRZ(), pin.SE3(np.eye(3), AXIS), "table")
    model.appendBodyToJoint(table, pin.Inertia(4.0, np.array([0.1, 0.0, 0.0]), np.diag([0.3, 0.3, 0.5])), pin.SE3.Identity())
    arm = model.addJoint(table, pin.JointModelRY(), pin.SE3(np.eye(3), np.array([0.5, 0.0, 0.0])), "arm")
    model.appendBodyToJoint(arm, pin.Inertia(2.0, np.array([0.0, 0.1, -0.3]), np.diag([0.1, 0.2, 0.1])), pin.SE3.Identity())
    model.effortLimit = np.array([30.0, 20.0])
    model.gravity.linear = GRAVITY
    return CheckedModel(model, name="turntable")


def points_on(robot: CheckedModel, joints: list[int], local: list[list[float]]) -> FloorPoints:
    """Points fixed to the bodies of joints."""
    k = len(joints)
    names = tuple(f"point {i + 1}" for i in range(k))
    return FloorPoints(robot, (), names, np.zeros(k, int), np.array(joints), np.array(local), np.zeros(k))


def test_a_turning_table_spreads_its_points_by_their_distance_from_its_axis() -> None:
    """A point at r from the axis moves by r sigma in one of two directions: r sigma / sqrt(2)."""
    robot, q = turntable(), np.array([0.7, 0.0])
    points = points_on(robot, [1, 1, 2], [[0.3, 0.4, 0.2], [0.0, 0.0, 0.1], [0.0, 0.0, -0.25]])
    frames, turned, nodded = np.array([q + 1.0, q, q - 1.0]), np.array([2e-3, 0.0]), np.array([0.0, 3e-3])
    half = np.sqrt(0.5)
    assert np.allclose(place_noise(robot, points, frames, turned), half * 2e-3 * np.array([0.5, 0.0, 0.5]), atol=1e-12)
    assert np.allclose(place_noise(robot, points, frames, nodded), half * 3e-3 * np.array([0.0, 0.0, 0.25]), atol=1e-12)
    assert not place_noise(robot, points, frames, None).any() and not place_noise(robot, points, frames, np.zeros(2)).any()


def test_the_spread_of_points_is_that_of_draws(g1: rbd.Robot) -> None:
    """Corners of G1's soles, from 4,000 configurations with noise: their mean square along the floor to 5 %."""
    rng, points = np.random.default_rng(3), FloorPoints.of(g1)
    q, sigma = g1.standing().q, np.full(g1.nv, 1e-4)
    sigma[3:6] = 1e-3
    drawn = np.array([pin.integrate(g1.model, q, sigma * rng.standard_normal(g1.nv)) for _ in range(4000)])
    off = points.places(*placements(g1, drawn))[..., :2] - points.places(*placements(g1, q[None]))[..., :2]
    seen = np.sqrt(0.5 * np.square(off).sum(axis=2).mean(axis=0))
    assert np.allclose(place_noise(g1, points, q[None], sigma), seen, rtol=0.05)


def moving(robot: CheckedModel) -> tuple[rbd.State, Array]:
    """A state of the turntable, and an acceleration."""
    return rbd.State(robot, np.array([0.7, 0.4]), np.array([1.5, -2.0])), np.array([3.0, -1.0])


def slopes(of: Callable[[Array], Array], x: Array) -> Array:
    """Derivative by central differences."""
    steps = 1e-6 * np.eye(len(x))
    return np.array([(of(x + d) - of(x - d)) / 2e-6 for d in steps]).T


@pytest.mark.parametrize("exact", [(), ("first",), ("second",)])
@pytest.mark.parametrize("what", ["q", "v", "a", "tau"])
def test_the_covariance_of_one_sensor(what: str, exact: tuple[str, ...]) -> None:
    """D s^2 D^T with the slope D of M a + h - tau by what is measured, also where one of the two joints is exact."""
    robot = turntable()
    state, a = moving(robot)
    s = np.array([2e-3, 5e-3]) * [name not in exact for name in ("first", "second")]
    data = robot.model.createData()
    needed: dict[str, Callable[[Array], Array]] = {
        "q": lambda x: pin.rnea(robot.model, data, x, state.v, a),
        "v": lambda x: pin.rnea(robot.model, data, state.q, x, a),
        "a": lambda x: pin.rnea(robot.model, data, state.q, state.v, x),
        "tau": lambda x: -x,
    }
    D = slopes(needed[what], {"q": state.q, "v": state.v, "a": a, "tau": np.zeros(2)}[what])
    found = SensorNoise(**{what: s}).covariance(state, a, None, torques=True)
    assert np.allclose(found, D * s**2 @ D.T, rtol=1e-6, atol=1e-12) and found.any()


def test_independent_sensors_add_and_torques_count_where_they_were_measured() -> None:
    """The covariance of all is the sum of those of each; without measured torques theirs is left out."""
    robot = turntable()
    state, a = moving(robot)
    given = {"q": 1e-3, "v": [0.0, 2e-2], "a": 0.3, "tau": [0.1, 0.2]}
    parts = [SensorNoise(**{what: value}).covariance(state, a, None, torques=True) for what, value in given.items()]
    noise = SensorNoise(**given)
    assert np.allclose(noise.covariance(state, a, None, torques=True), sum(parts), rtol=1e-12)
    assert np.allclose(noise.covariance(state, a, None, torques=False), sum(parts[:3]), rtol=1e-12)


def test_forces_that_turn_with_the_robot_count_by_their_slope() -> None:
    """Of noise in q the slope of tau_ext + J^T f is subtracted: an external torque k (q - 1) takes k off the weight's slope."""
    robot = turntable()
    state, a = moving(robot)
    k, s = np.array([7.0, 4.0]), np.array([2e-3, 0.0])
    data = robot.model.createData()
    D = slopes(lambda x: pin.rnea(robot.model, data, x, state.v, a) - k * (x - 1.0), state.q)
    found = SensorNoise(q=s).covariance(state, a, lambda near: k * (near.q - 1.0), torques=True)
    assert np.allclose(found, D * s**2 @ D.T, rtol=1e-6)


def test_the_scale_of_forces_is_the_effort_limit_or_the_weight_over_the_radius_of_gyration() -> None:
    """Limits of motors; else g sqrt(m M_ii): of a free ball its weight, and its weight times its radius of gyration."""
    robot = turntable()
    state, _ = moving(robot)
    assert np.allclose(force_scale(state), [30.0, 20.0])
    assert np.allclose(force_scale(state, motors=False), np.linalg.norm(GRAVITY) * np.sqrt(6.0 * state.M.diagonal()))
    model = pin.Model()
    at = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root_joint")
    model.appendBodyToJoint(at, pin.Inertia(2.0, np.zeros(3), 2.0 * 0.09 * np.eye(3)), pin.SE3.Identity())
    ball = CheckedModel(model, name="ball")
    assert np.allclose(force_scale(rbd.State(ball, pin.neutral(model))), 2.0 * 9.81 * np.array([1.0, 1.0, 1.0, 0.3, 0.3, 0.3]))
    floating = rbd.State(ball.with_gravity((0.0, 0.0, 0.0)), pin.neutral(model))
    assert np.allclose(force_scale(floating), 2.0 * np.array([1.0, 1.0, 1.0, 0.3, 0.3, 0.3]))


def test_whitened_errors_have_unit_covariance() -> None:
    """W C W^T = 1, but for the floor of a millionth of the scale where a measurement is exact."""
    scale, rng = np.array([30.0, 20.0, 5.0]), np.random.default_rng(1)
    A = rng.standard_normal((3, 3))
    C = A @ A.T
    W = whitening(C, scale)
    assert np.allclose(W @ C @ W.T, np.eye(3), atol=1e-6)
    assert np.allclose(whitening(None, scale), np.diag(1.0 / scale), rtol=1e-12)
    exact = whitening(np.zeros((3, 3)), scale)
    assert np.allclose(exact, np.diag(1.0 / (FLOOR * scale)), rtol=1e-12)
