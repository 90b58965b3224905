"""Springs and dampers in joints."""

import numpy as np
import pytest

import rbd


def pendulum():
    """A bar of 1 m and 1 kg."""
    return rbd.planar.to_robot(rbd.planar.Chain(1, lengths=[1.0]), masses=[1.0])


def test_a_spring_in_a_joint_pulls_back():
    """Torque -k q over the inertia m l^2 / 3, beside gravity."""
    arm = pendulum()
    state = arm.at([-np.pi / 2 + 0.2])
    spring = rbd.forces.JointSpring("joint_1", stiffness=20.0, rest=-np.pi / 2)
    a = rbd.solve(state, [0.0], external=[spring]).a
    assert a == pytest.approx([(-20.0 * 0.2 - 0.5 * 9.81 * np.sin(0.2)) * 3.0], rel=1e-12)


def test_derivatives_know_the_spring():
    """da/dq has -k / I beside that of gravity."""
    arm = pendulum()
    state = arm.at([-np.pi / 2], [0.3])
    spring = rbd.forces.JointSpring("joint_1", stiffness=20.0, rest=-np.pi / 2)
    damper = rbd.forces.JointDamping({"joint_1": 0.5})
    found = rbd.solve(state, [0.0], external=[spring, damper]).derivatives()
    assert found.da_dq[0, 0] == pytest.approx(-3.0 * (20.0 + 0.5 * 9.81), rel=1e-12)
    assert found.da_dv[0, 0] == pytest.approx(-1.5, rel=1e-12)
