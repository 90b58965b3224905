"""Derivatives of whole motions against closed forms, and their estimates of error."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from drawn_worlds import standing

import rbd
from rbd.worlds import motion_derivatives

G = 9.81


def test_where_a_block_on_a_slope_stops_by_friction_speed_and_gravity():
    """X = v^2 / (2 g (mu cos s - sin s)): its derivatives by mu, v and g's size, each within the error that is told."""
    s, v0, mu = 0.2, 1.0, 0.6
    R = pin.utils.rotate("y", s)
    box = rbd.testing.box(mass=10.0)
    face = rbd.SurfaceContact(
        "face", "box", half_lengths=(0.2, 0.2), friction=mu, on=rbd.Ground(normal=R[:, 2], point=np.zeros(3))
    )
    state = rbd.State(box, np.r_[np.zeros(3), pin.Quaternion(R).coeffs()], [v0, 0, 0, 0, 0, 0])
    found = motion_derivatives(state, [face], ["friction", "v", "gravity", "mass"], duration=0.5, step=5e-4, size=4e-3)
    pull = mu * np.cos(s) - np.sin(s)
    x = v0**2 / (2.0 * G * pull)
    exact = {"friction": -x * np.cos(s) / pull, found.names[1]: 2.0 * x / v0, "mass": 0.0}
    for name, value in exact.items():
        i = found.names.index(name)
        got, error = found.q[i, -1, 0], found.q_error[i, -1, 0]
        assert abs(got - value) < 3e-3 * max(1.0, abs(value)) and abs(got - value) < error + 2e-3
        assert np.abs(found.v[i, -1]).max() < 1e-6
    along = found.q[found.names.index("gravity z"), -1, 0]  # downwards is -z, along the normal and down the slope
    assert abs(along - x / G) < 3e-3
    assert not found.flagged and len(found.worlds) == 4 * len(found.names)


def test_a_falling_body_by_its_start_gravity_and_torque():
    """A box moves by v0 t + g t^2 / 2, a motor turns its joint by tau t^2 / 2 I: exact but for rounding."""
    box = rbd.testing.box(mass=3.0)
    state = rbd.State(box, [0, 0, 1, 0, 0, 0, 1], [0.2, 0, 0, 0, 0, 0])
    found = motion_derivatives(state, [], ["gravity", "v", "q", "mass"], duration=0.3, step=1e-2, record=10)
    t = found.t
    for i, axis in enumerate("xyz"):
        dq, dv = found[f"gravity {axis}"]
        assert np.abs(dq[:, i] - 0.5 * t * t).max() < 1e-9 and np.abs(dv[:, i] - t).max() < 1e-9
    v = found.names.index("v " + found.names[3].removeprefix("v "))
    assert np.abs(found.q[v, :, 0] - t).max() < 1e-9 and np.abs(found.q[v, :, 1:]).max() < 1e-9
    assert np.abs(found["mass"][0]).max() < 1e-9
    assert found.q_error.max() < 1e-3
    b = rbd.RobotBuilder("flywheel", root="fixed")
    b.body("wheel", mass=1.0, com=(0, 0, 0), inertia=np.diag([0.1, 0.1, 0.2]))
    b.joint("axle", "ground", "wheel", "revolute", axis=(0, 0, 1), motor=True, effort=10.0, limits=(-9, 9))
    wheel = b.robot()
    found = motion_derivatives(rbd.State(wheel, [0.0]), [], "tau", duration=0.4, step=1e-2)
    assert found.names == ("tau axle",)
    assert abs(found.q[0, -1, 0] - 0.4**2 / 2 / 0.2) < 1e-9 and abs(found.v[0, -1, 0] - 0.4 / 0.2) < 1e-9


def test_a_robot_that_lands_agrees_with_differences_of_simulate():
    """Solo12 lands: derivatives by the height of the ground and friction, against two runs of `rbd.simulate`."""
    state, contacts, tau = standing("solo12")
    size, step, T = 1e-3, 2.5e-4, 0.05
    found = motion_derivatives(state, contacts, ["ground"], duration=T, step=step, tau=tau, ground=-0.005, size=size)
    ends = []
    for d in (size, -size):
        feet = [c.with_ground(-0.005 + d) for c in contacts]
        ends.append(
            rbd.simulate(state, feet, duration=T, step=step, controller=lambda s, t: tau, progress=False, may_sink=True).q[-1]
        )
    expected = pin.difference(state.robot.model, ends[1], ends[0]) / (2.0 * size)
    assert np.abs(found.q[0, -1] - expected).max() < 0.05 * np.abs(expected).max()


def test_what_cannot_be_differentiated_is_named():
    """Unknown parameters, and perturbations beyond what has a meaning."""
    state, contacts, _ = standing("solo12")
    with pytest.raises(rbd.errors.UnknownName, match="no parameter of a motion 'fricton'; .*friction"):
        motion_derivatives(state, contacts, ["fricton"], duration=0.01, step=1e-3)
    with pytest.raises(rbd.InputError, match="perturbed by 0.5, the friction of .* becomes -"):
        motion_derivatives(state, contacts, "friction", duration=0.01, step=1e-3, size=0.5)
    with pytest.raises(rbd.InputError, match="state is None"):
        motion_derivatives(None, contacts, duration=0.01, step=1e-3)
    found = motion_derivatives(state, contacts, "mass", duration=0.01, step=1e-3)
    with pytest.raises(rbd.errors.UnknownName, match="no parameter 'v'"):
        found["v"]
    assert "mass" in str(found)
