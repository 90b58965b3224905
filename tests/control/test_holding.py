"""`HoldPosture`: its torques on mechanisms whose equations fit on one line, and in motion."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.arrays import Array
from rbd.control import HoldPosture
from rbd.model.checked_model import CheckedModel

W, ZETA, G = 6.0, 0.7, 9.81
MASS, LENGTH, LIMIT = 3.0, 0.4, 40.0


def lift(limit: float = LIMIT) -> CheckedModel:
    """A mass on a vertical slider with a motor."""
    model = pin.Model()
    at = model.addJoint(0, pin.JointModelPZ(), pin.SE3.Identity(), "lift")
    model.appendBodyToJoint(at, pin.Inertia(MASS, np.zeros(3), np.eye(3)), pin.SE3.Identity())
    model.effortLimit = np.array([limit])
    return CheckedModel(model, name="lift")


def two_links() -> CheckedModel:
    """Two point masses on bars, hinged about y, hanging down at zero; a motor in each hinge."""
    model, at = pin.Model(), 0
    for name, place in (("upper", np.zeros(3)), ("lower", np.array([0.0, 0.0, -LENGTH]))):
        at = model.addJoint(at, pin.JointModelRY(), pin.SE3(np.eye(3), place), name)
        mass = pin.Inertia(MASS, np.array([0.0, 0.0, -LENGTH]), np.zeros((3, 3)))
        model.appendBodyToJoint(at, mass, pin.SE3.Identity())
    return CheckedModel(model, name="two_links")


def double_pendulum(q: Array) -> tuple[Array, Array]:
    """(inertia, torque of the weight) of two equal masses on equal bars, in relative angles from hanging."""
    one, c = MASS * LENGTH**2, math.cos(q[1])
    inertia = one * np.array([[3.0 + 2.0 * c, 1.0 + c], [1.0 + c, 1.0]])
    upper, lower = math.sin(q[0]), math.sin(q[0] + q[1])
    return inertia, MASS * G * LENGTH * np.array([2.0 * upper + lower, lower])


@pytest.mark.parametrize(("away", "rate"), [(0.0, 0.0), (0.02, 0.0), (-0.03, 0.0), (0.0, 0.1), (0.01, -0.2)])
def test_a_lift_is_carried_and_drawn_back(away: float, rate: float) -> None:
    """It is m g - m w^2 (q - q*) - 2 zeta w m v: upwards against the weight, back against the distance and the velocity."""
    robot = lift()
    tau = HoldPosture(rbd.State(robot, [0.5]), frequency=W, damping_ratio=ZETA)(rbd.State(robot, [0.5 + away], [rate]), 0.0)
    assert tau == pytest.approx([MASS * (G - W**2 * away - 2.0 * ZETA * W * rate)], abs=1e-7)


@pytest.mark.parametrize(("away", "tau"), [(-1.0, LIMIT), (1.0, -LIMIT)])
def test_torques_end_at_the_effort_limit(away: float, tau: float) -> None:
    """With m g +- m w^2 1 m that is 137 N and -79 N: the motor gives 40 N, in the direction that leads back."""
    robot = lift()
    assert HoldPosture(rbd.State(robot, [0.0]), frequency=W)(rbd.State(robot, [away]), 0.0) == pytest.approx([tau], abs=1e-12)


def test_a_hanging_arm_feels_its_whole_inertia() -> None:
    """K = w^2 M and D = 2 zeta w M of both links, and torques that carry the weight."""
    robot, goal = two_links(), np.array([0.4, 0.5])
    inertia, weight = double_pendulum(goal)
    hold = HoldPosture(rbd.State(robot, goal), frequency=W, damping_ratio=ZETA)
    gains = hold.gains(rbd.State(robot, goal))
    assert np.allclose(gains.torque, weight, rtol=0.0, atol=1e-9)
    assert np.allclose(gains.stiffness, W**2 * inertia, rtol=1e-6) and np.allclose(gains.damping, 2.0 * ZETA * W * inertia)
    away, rate = np.array([0.03, -0.02]), np.array([0.2, 0.3])
    expected = weight - inertia @ (W**2 * away + 2.0 * ZETA * W * rate)
    assert np.allclose(hold(rbd.State(robot, goal + away, rate), 0.0), expected, rtol=0.0, atol=1e-5)


@pytest.mark.parametrize("damping_ratio", [0.3, 1.0])
def test_a_lift_comes_back_as_the_oscillator(damping_ratio: float) -> None:
    """From rest at 20 mm above the goal: exp(-zeta w t) (cos + zeta / sqrt(1 - zeta^2) sin), or (1 + w t) exp(-w t)."""
    robot = lift()
    hold = HoldPosture(rbd.State(robot, [0.0]), frequency=W, damping_ratio=damping_ratio)
    motion = rbd.simulate(rbd.State(robot, [0.02]), duration=0.4, step=1e-3, controller=hold, progress=False)
    t, root = motion.t, math.sqrt(1.0 - damping_ratio**2)
    turn = W * root * t
    shape = 1.0 + W * t if damping_ratio == 1.0 else np.cos(turn) + damping_ratio / root * np.sin(turn)
    assert np.allclose(motion.q[:, 0], 0.02 * np.exp(-damping_ratio * W * t) * shape, rtol=0.0, atol=1e-4)


@pytest.mark.parametrize(("count", "more"), [(6, ""), (7, " and 1 more"), (9, " and 3 more")])
def test_a_violation_names_six(count: int, more: str) -> None:
    """And counts the rest."""
    told = str(rbd.control.Violation({}, {f"joint {i}": 0.5 for i in range(count)}))
    assert told.endswith("beyond its limit" + more) and told.count("'joint") == 6
