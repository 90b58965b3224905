"""Small motion about driven motions: at constant speed by `linearise`, over a period by `floquet`; against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp

import rbd
from rbd.errors import InputError
from rbd.model.checked_model import CheckedModel

G = 9.81


def on_a_shaft(length=0.5, mass=1.0):
    """A pendulum, a point mass, hinged across a vertical shaft at its axis; both without motors."""
    model, at = pin.Model(), pin.SE3.Identity()
    shaft = model.addJoint(0, pin.JointModelRZ(), at, "shaft")
    model.appendBodyToJoint(shaft, pin.Inertia(0.3, np.zeros(3), 1e-3 * np.eye(3)), at)
    swing = model.addJoint(shaft, pin.JointModelRY(), at, "swing")
    model.appendBodyToJoint(swing, pin.Inertia(mass, np.array([0.0, 0.0, -length]), np.zeros((3, 3))), at)
    return CheckedModel(model, passive=["shaft", "swing"], name="governor")


@pytest.mark.parametrize("differences", [False, True], ids=["derivatives", "differences"])
def test_a_pendulum_on_a_turning_shaft_swings_about_its_lean(differences):
    """At W it leans by th with cos th = g / (l W^2), found as a steady motion, and swings at W sin th."""
    length, speed, robot = 0.5, 8.0, on_a_shaft()
    lean = math.acos(G / (length * speed**2))
    drive = rbd.DrivenJoint("drive", "shaft", rbd.Speed(speed, start=0.3))
    start = rbd.State(robot, [0.3 + 8.0 * 0.25, lean + 0.05], [speed, 0.0], t=0.25)
    found = rbd.find_steady_motion(start, [drive])
    assert abs(abs(found.state.q[1]) - lean) <= 1e-9
    assert found.state.t == 0.25
    small = rbd.linearise(found.state, [drive], differences=differences)
    assert small.n == 2
    assert np.abs(np.sort(small.eigenvalues.imag) - speed * math.sin(lean) * np.array([-1.0, 1.0])).max() <= 1e-7
    assert np.abs(small.eigenvalues.real).max() <= 1e-7
    assert small.variation <= 1e-6
    assert small.modes()[0].at(0.1).t == pytest.approx(0.35)


def shaken(length=0.2):
    """An inverted pendulum on a pivot that moves along z."""
    model, at = pin.Model(), pin.SE3.Identity()
    pivot = model.addJoint(0, pin.JointModelPZ(), at, "pivot")
    model.appendBodyToJoint(pivot, pin.Inertia(0.5, np.zeros(3), 1e-3 * np.eye(3)), at)
    swing = model.addJoint(pivot, pin.JointModelRY(), at, "swing")
    model.appendBodyToJoint(swing, pin.Inertia(1.0, np.array([0.0, 0.0, length]), np.zeros((3, 3))), at)
    return CheckedModel(model, passive=["pivot", "swing"], name="kapitza")


@pytest.mark.parametrize(("w", "stands"), [(300.0, True), (100.0, False)])
def test_multipliers_of_kapitzas_pendulum_are_those_of_mathieus_equation(w, stands):
    """Upright on a shaking pivot: trace and product of the multipliers by SciPy at 1e-12; product one; stable or not."""
    a, length = 0.01, 0.2
    drive = rbd.DrivenJoint(
        "drive", "pivot", lambda t: (a * math.cos(w * t), -a * w * math.sin(w * t), -a * w * w * math.cos(w * t))
    )

    def rates(t, y):
        k = (G - a * w * w * math.cos(w * t)) / length
        return [y[1], k * y[0], y[3], k * y[2]]

    T = 2.0 * math.pi / w
    exact = solve_ivp(rates, (0.0, T), [1.0, 0.0, 0.0, 1.0], method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1].reshape(2, 2).T
    found = rbd.simulation.floquet(rbd.State(shaken(), [a, 0.0]), [drive], period=T)
    assert np.abs(found.monodromy - exact).max() <= 1e-7 * np.abs(exact).max()
    assert abs(np.prod(found.multipliers) - 1.0) <= 1e-8
    assert found.stable is stands
    assert found.off <= 1e-12


def test_a_motion_that_does_not_return_is_refused():
    """Half a period of the drive; a state off its drive."""
    drive = rbd.DrivenJoint("drive", "pivot", lambda t: 0.01 * math.cos(100.0 * t))
    with pytest.raises(InputError, match=r"kapitza is 0\.02 .* from its start after 0\.0314159 s; expected a periodic one"):
        rbd.simulation.floquet(rbd.State(shaken(), [0.01, 0.0]), [drive], period=math.pi / 100.0)
    with pytest.raises(InputError, match="row 0 of 'drive' is off by 0.01"):
        rbd.simulation.floquet(rbd.State(shaken(), [0.0, 0.0]), [drive], period=2.0 * math.pi / 100.0)
