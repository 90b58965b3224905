"""Motions under rolling and blades against closed forms: sleigh, skate, ball on a turntable, disk."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from smooth_models import URDF, along, body

import rbd

EITHER = pytest.mark.parametrize(("integrator", "step"), [(rbd.RungeKutta4(), 5e-3), (rbd.DormandPrince8(), 0.1)])


@EITHER
def test_chaplygins_sleigh_turns_to_go_straight(integrator, step):
    """V = V tanh(k V t + c), w = sqrt(k / a) V sech(k V t + c), k = m a / (I + m a^2) [Bloch2003]; the file's mass and a."""
    robot = rbd.load_robot(URDF / "chaplygin_sleigh.urdf")
    m, a, inertia = 5.0, 0.3, 0.4
    k = m * a / (inertia + m * a * a)
    v0, w0 = -1.0, 2.0
    V = np.sqrt(v0 * v0 + a / k * w0 * w0)
    c = np.arctanh(v0 / V)
    start = rbd.State(robot, robot.at().q, np.array([v0, 0.0, w0]))
    found = rbd.simulate(start, robot.wheels(), duration=2.0, step=step, integrator=integrator, progress=False)
    s = k * V * found.t + c
    assert np.abs(found.v[:, 0] - V * np.tanh(s)).max() < 1e-8
    assert np.abs(found.v[:, 2] - np.sqrt(k / a) * V / np.cosh(s)).max() < 1e-8
    assert np.abs(found.v[:, 1]).max() < 1e-11
    assert np.abs(found.energy - found.energy[0]).max() < 1e-7


def test_the_sleigh_turns_by_its_angle_in_all():
    """From almost straight backwards to almost straight ahead it turns by pi sqrt(1 + I / (m a^2))."""
    robot = rbd.load_robot(URDF / "chaplygin_sleigh.urdf")
    start = rbd.State(robot, robot.at().q, np.array([-1.0, 0.0, 1e-4]))
    found = rbd.simulate(
        start, robot.wheels(), duration=14.0, step=0.1, integrator=rbd.DormandPrince8(longest=1.0), progress=False
    )
    heading = np.unwrap(np.arctan2(found.q[:, 3], found.q[:, 2]))
    left = found.v[-1, 2]  # what is still to turn, w / (k V), and as much before the start
    k = 5.0 * 0.3 / (0.4 + 5.0 * 0.09)
    total = heading[-1] - heading[0] + (left + 1e-4) / k
    assert abs(total - np.pi * np.sqrt(1.0 + 0.4 / (5.0 * 0.09))) < 1e-6


@EITHER
def test_a_skate_on_an_incline_drifts_sideways(integrator, step):
    """X = (g sin a / 2 w^2) sin^2 wt downhill, y = (g sin a / 2 w^2)(wt - sin(2 wt) / 2) across."""
    slope, w = 0.3, 2.0
    down = 9.81 * np.sin(slope)
    skate = pin.Inertia(3.0, np.zeros(3), np.diag([0.1, 0.1, 0.2]))
    robot = body(pin.JointModelPlanar(), skate, (down, 0.0, -9.81 * np.cos(slope)))
    start = rbd.State(robot, pin.neutral(robot.model), np.array([0.0, 0.0, w]))
    blade = rbd.KnifeEdge("skate", "body")
    found = rbd.simulate(start, [blade], duration=4.0, step=step, integrator=integrator, progress=False)
    t, size = found.t, down / (2.0 * w * w)
    assert np.abs(found.q[:, 0] - size * np.sin(w * t) ** 2).max() < 1e-8
    assert np.abs(found.q[:, 1] - size * (w * t - 0.5 * np.sin(2.0 * w * t))).max() < 1e-8


@EITHER
def test_a_ball_on_a_turntable_goes_round_at_two_sevenths_of_its_rate(integrator, step):
    """The centre's velocity turns at 2/7 W: a circle, wherever it was set off; it stays on the table."""
    robot = rbd.load_robot(URDF / "ball.urdf", root="free_flyer")
    W, R = 3.0, 0.1
    table = rbd.RollingBall(
        "ball", "ball", radius=R, on=rbd.Ground(point=(0.0, 0.0, 0.0), velocity=(0.0, 0.0, 0.0, 0.0, 0.0, W))
    )
    x, y, u, v = 0.5, 0.2, 0.3, -0.1
    q = np.array([x, y, R, 0.0, 0.0, 0.0, 1.0])
    start = rbd.State(robot, q, np.array([u, v, 0.0, (W * x - v) / R, (u + W * y) / R, 0.0]))
    assert np.abs(table.rows(start).velocity).max() < 1e-12
    found = rbd.simulate(start, [table], duration=1.5, step=0.2 * step, integrator=integrator, progress=False)
    rate = 2.0 / 7.0 * W
    c, s = np.cos(rate * found.t), np.sin(rate * found.t)
    true = np.column_stack([x + (u * s - v * (1.0 - c)) / rate, y + (u * (1.0 - c) + v * s) / rate, np.full(len(c), R)])
    assert np.abs(found.q[:, :3] - true).max() < 1e-8
    assert found.residuals["drift"].max() < 1e-11
    assert found.residuals["drift_rate"].max() < 1e-10


@EITHER
def test_a_disk_wobbles_on_its_rim_at_eulers_rate(integrator, step):
    """A thin disk whose centre rests, at an angle al to the floor: its contact runs round at W^2 = 4 g / (a sin al)."""
    robot = rbd.load_robot(URDF / "rolling_disk.urdf")
    a, al = 0.25, 0.6
    W = np.sqrt(4.0 * 9.81 / (a * np.sin(al)))
    axis = np.array([np.sin(al), 0.0, np.cos(al)])  # the disk's y
    R = np.column_stack([np.cross(axis, [0.0, 1.0, 0.0]), axis, [0.0, 1.0, 0.0]])
    q = np.r_[0.0, 0.0, a * np.sin(al), pin.Quaternion(R).coeffs()]
    turning = -W * np.sin(al) * np.array([np.cos(al), 0.0, -np.sin(al)])  # along the diameter through the contact
    start = rbd.State(robot, q, np.r_[np.zeros(3), R.T @ turning])
    assert np.abs(robot.wheels()[0].rows(start).velocity).max() < 1e-12
    found = rbd.simulate(start, robot.wheels(), duration=0.5, step=0.2 * step, integrator=integrator, progress=False)
    assert np.abs(found.q[:, :3] - q[:3]).max() < 1e-7
    for i in (len(found) // 2, -1):
        e = pin.Quaternion(found.q[i, 3:]).matrix()[:, 1]
        angle = W * found.t[i]
        assert np.abs(e - [np.sin(al) * np.cos(angle), np.sin(al) * np.sin(angle), np.cos(al)]).max() < 1e-6
    assert np.abs(found.energy - found.energy[0]).max() < 1e-7


def test_a_disk_that_rolls_and_leans_keeps_its_energy_and_its_floor():
    """Rolling does no work; the height of the rim stays zero."""
    robot = rbd.load_robot(URDF / "rolling_disk.urdf")
    q = pin.integrate(robot.model, robot.at("upright").q, np.array([0.0, 0.0, 0.0, 0.3, 0.0, 0.0]))
    q[2] = 0.25 * np.cos(0.3)
    start = along(rbd.State(robot, q), robot.wheels(), np.array([1.0, 0.0, 0.0, 0.0, 12.0, 3.0]))
    found = rbd.simulate(start, robot.wheels(), duration=2.0, step=2e-3, progress=False)
    assert np.abs(found.energy - found.energy[0]).max() < 1e-7
    assert found.residuals["drift"].max() < 1e-12
