"""Certificates of worlds: the samples are met to the last bit, steps are right by Pinocchio, planted faults are found."""

from __future__ import annotations

import numpy as np
import pytest
from drawn_worlds import drawn, standing

import rbd

pytestmark = pytest.mark.filterwarnings("ignore::rbd.errors.InaccurateWarning")


@pytest.mark.parametrize("name", ["solo12", "go2", "g1", "talos", "leg"])
def test_steps_of_random_worlds_are_right(name, exhaustive, record_property):
    """The equation of motion to rounding; the law, point by point, to what the kernels tell, or to rounding of the gaps."""
    n = 500 if exhaustive else 2
    robot, contacts, q, v, tau, mu = drawn(name, n, 17)
    worlds = rbd.simulate_many((robot, q, v), contacts, duration=0.04, step=1e-3, tau=tau, friction=mu, record=10)
    some = np.flatnonzero(worlds.stopped < 0)[:: 10 if exhaustive else 1]
    found = [worlds.certify(int(i)) for i in some]
    equation, law, path, depth, turning = (
        max(getattr(c, what).max() for c in found) for what in ("equation", "law", "path", "depth", "turning")
    )
    record_property(
        "counted", f"{name}: {len(found)} certificates, equation {equation:.1e}, law {law:.1e}, path {path:.1e}, "
        f"depth {depth:.1e} m, turning {turning:.1e} m/s",
    )  # fmt: skip
    assert equation < 1e-9 and path < 1e-9
    rounding = 4.0 * np.finfo(float).eps / 1e-3**2  # of the gap of a point 1 m from the origin, as an acceleration
    for i, c in zip(some, found, strict=True):
        assert c.law.max() <= max(worlds.residual[i].max(), rounding) and (c.law.max() < 1e-8 or i in worlds.flagged)
    assert abs(depth - worlds.depth[some].max()) < 1e-9


def test_a_certificate_is_of_the_world_with_its_own_arguments():
    """Mass, gravity, ground, pushes, gains, damping and a function of all worlds: the equation of each holds to rounding."""
    state, contacts, tau = standing("solo12")
    servo = rbd.worlds.Servo(np.array([[3.0], [4.0], [5.0]]) * np.ones(12), 0.05, target=state.q[7:], torque=tau)
    push = rbd.worlds.WorldPushes(
        "base_link", [[5.0, 0, 0], [0, 9, 0], [0, 0, 3]], start=0.0013, duration=0.011, moment=(0, 0, 1)
    )
    own = dict(
        mass=[1.0, 1.2, 0.9], gravity=[[0, 0, -9.81], [0.3, 0, -9.0], [0, 0, -3.0]], ground=[0.0, -0.001, 0.0], pushes=push,
        friction=[0.3, 0.5, 0.9], damping={"FL_HAA": [0.0, 0.1, 0.2]},
    )  # fmt: skip
    worlds = rbd.simulate_many(state, contacts, duration=0.03, step=1e-3, controller=servo, record=7, **own)
    for i in range(3):
        certificate = worlds.certify(i, every=3)
        assert certificate.equation.max() < 1e-10 and certificate.law.max() < 1e-8
        assert len(certificate.steps) == 10 and str(i) in str(certificate)

    def pulls(t, q, v):
        return -3.0 * (q[:, 7:] - q[:, 7:].mean(axis=0)) - 0.05 * v[:, 6:] + tau  # towards the mean of all worlds

    worlds = rbd.simulate_many(state, contacts, duration=0.02, step=1e-3, controller=pulls, every=2, record=5, **own)
    assert worlds.certify(1, every=4).worst < 1e-8


def test_a_controller_with_memory_is_refused():
    """Its torques are others when it is asked again: the motion is another, and the message says so."""
    state, contacts, tau = standing("solo12")
    calls = []

    def grows(t, q, v):
        calls.append(t)
        return tau * (1.0 + 1e-3 * len(calls)) * np.ones((len(q), 1))

    worlds = rbd.simulate_many([state] * 2, contacts, duration=0.01, step=1e-3, controller=grows)
    with pytest.raises(rbd.InputError, match="simulated again, is off by .* keeps memory"):
        worlds.certify(1)


def test_a_wrong_mass_in_one_lane_is_flagged():
    """The mass of the base in world 2 is 1 % more in the dynamics than in what checks it: the residual of this world tells."""
    state, contacts, tau = standing("solo12")
    worlds = rbd.worlds.Worlds(state.robot, contacts, np.tile(state.q, (4, 1)), step=1e-3)
    worlds.drive(tau=tau)
    worlds._given["inertia"] = worlds._given["inertia"].copy()
    worlds._given["inertia"][0, 0, 2] *= 1.01
    worlds.advance(5)
    assert worlds.residual[2] > 1e-4
    assert np.delete(worlds.residual, 2).max() < 1e-8


def test_numbers_of_worlds_are_checked():
    """World 3 of 2, and a world whose state was no input."""
    box = rbd.testing.box()
    q = np.array([[0, 0, 1.0, 0, 0, 0, 1], [0, 0, np.nan, 0, 0, 0, 1]])
    worlds = rbd.simulate_many((box, q, np.zeros((2, 6))), [], duration=0.01, step=1e-3)
    with pytest.raises(rbd.InputError, match="world 3 of 2"):
        worlds.certify(3)
    with pytest.raises(rbd.InputError, match="world 1 has no steps: .*not finite"):
        worlds.certify(-1)
    assert worlds.certify(0).worst < 1e-10
