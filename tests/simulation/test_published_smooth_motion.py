"""Published smooth motions: pendulum (IFToMM A01), torque-free cylinder, heavy top, a four-bar at rest."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from scipy.special import ellipk
from smooth_models import body, chain

import rbd

EITHER = pytest.mark.parametrize(("integrator", "step"), [(rbd.RungeKutta4(), 1e-3), (rbd.DormandPrince8(), 0.1)])


@EITHER
def test_the_pendulum_of_the_benchmark(integrator, step):
    """A01: point mass 1 kg at 1 m, released level: where it is after 10 s; energy."""
    found = rbd.simulate(
        rbd.State(chain(1), np.array([np.pi])), duration=10.0, step=step, integrator=integrator, record_every=10, progress=False
    )
    end = found.q[-1, 0]
    assert np.abs(np.array([np.cos(end), np.sin(end)]) - [-0.275087463, -0.961419205]).max() < 1e-8
    assert np.abs(found.energy - found.energy[0]).max() < 1e-8


def test_the_period_of_the_pendulum_is_the_elliptic_integral():
    """T = 4 sqrt(L / g) K(sin^2 45 deg) = 2.367841947576 s: it is back where it began, at rest."""
    period = 4.0 * np.sqrt(1.0 / 9.81) * ellipk(0.5)
    assert abs(period - 2.367841947576) < 1e-11
    start = rbd.State(chain(1), np.zeros(1))
    found = rbd.simulate(start, duration=period, step=0.1, integrator=rbd.DormandPrince8(1e-12, 1e-13), progress=False)
    assert abs(found.q[-1, 0]) < 1e-10
    assert abs(found.v[-1, 0]) < 1e-9


@EITHER
@pytest.mark.parametrize("joint", [pin.JointModelSpherical(), pin.JointModelFreeFlyer()], ids=["spherical", "free flyer"])
def test_a_cylinder_without_torque_precesses(joint, integrator, step):
    """Kane, Likins and Levinson 1983, I = .04, J = .02, in body axes, with s = (I - J)/I w_z; momentum stays."""
    robot = body(joint, pin.Inertia(2.0, np.zeros(3), np.diag([0.04, 0.04, 0.02])), (0.0, 0.0, 0.0))
    w = np.array([1.0, -2.0, 7.0])
    v = w if robot.nv == 3 else np.r_[0.3, 0.1, -0.2, w]
    start = rbd.State(robot, pin.neutral(robot.model), v)
    found = rbd.simulate(start, duration=2.0, step=step, integrator=integrator, record_every=20, progress=False)
    s, t = 0.5 * w[2], found.t
    c, d = np.cos(s * t), np.sin(s * t)
    true = np.column_stack([w[0] * c + w[1] * d, -w[0] * d + w[1] * c, np.full(len(t), w[2])])
    assert np.abs(found.v[:, -3:] - true).max() < 1e-8
    assert np.abs(found.momentum - found.momentum[0]).max() < 1e-8
    assert np.abs(np.linalg.norm(found.q[:, -4:], axis=1) - 1.0).max() < 1e-14


@pytest.mark.parametrize(("integrator", "step"), [(rbd.RungeKutta4(), 1e-4), (rbd.DormandPrince8(), 0.02)])
def test_the_heavy_top(integrator, step):
    """Bruls and Cardona's top at 0.2 s: its quaternion."""
    robot = body(
        pin.JointModelSpherical(),
        pin.Inertia(15.0, np.array([0.0, 1.0, 0.0]), np.diag([0.234375, 0.46875, 0.234375])),
        (0.0, 0.0, -9.81),
    )
    start = rbd.State(robot, pin.neutral(robot.model), np.array([0.0, 150.0, -4.61538]))
    found = rbd.simulate(start, duration=0.2, step=step, integrator=integrator, record_every=100, progress=False)
    true = np.array([0.43878, 0.54573, 0.08940, -0.70828])  # x, y, z, w
    q = found.q[-1]
    assert min(np.abs(q - true).max(), np.abs(q + true).max()) < 1e-5
    assert np.abs(found.energy - found.energy[0]).max() < 1e-6 * found.kinetic.max()


def test_a_four_bar_hangs_at_rest_where_drake_says():
    """Ground 2 m, three links of 4 m and 20 kg: at 75.5225 and 104.4775 deg below the ground nothing moves."""
    robot = rbd.mechanism.four_bar(4.0, 4.0, 4.0, 2.0, masses=[20.0] * 3, crank_angle=-np.arccos(0.25))
    # The coupler level, 4 m for 2 m of ground: the links lean outwards, cos = (4 - 2) / 2 / 4.
    q = robot.at("assembled").q.copy()
    wide, narrow = np.arccos(-0.25), np.arccos(0.25)
    for joint, angle in (("crank_joint", -wide), ("coupler_joint", wide), ("rocker_joint", -narrow)):
        at = robot.model.joints[robot.joint_id(joint)].idx_q
        q[at : at + 2] = np.cos(angle), np.sin(angle)
    assert abs(np.degrees(np.arccos(0.25)) - 75.5225) < 1e-4
    found = rbd.simulate(rbd.State(robot, q), robot.loops(), duration=1.0, step=1e-2, progress=False)
    assert np.abs(found.v).max() < 1e-9
    assert found.residuals["drift"].max() < 1e-12
