"""Small motion on springs, dampers and bushings, with models in memory and other gravity: closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from flat_bodies import free_body, pendulum

import rbd


def test_a_bushings_six_modes():
    """w^2 = k / m and k / I in its six directions, where the body sags; about a preload or in free fall the same."""
    mass, moments = 4.0, np.array([0.2, 0.3, 0.4])
    body = free_body(mass, moments)
    stiffness = np.array([900.0, 1600.0, 2500.0, 8.0, 27.0, 64.0])
    mount = rbd.Bushing("body", to=(0.0, 0.0, 1.0), stiffness=stiffness)
    start = rbd.State(body, [0.01, -0.02, 1.0, 0.0, 0.0, 0.0, 1.0])
    found = rbd.find_equilibrium(start, [], external=mount)
    assert np.allclose(found.state.q[:3], [0.0, 0.0, 1.0 - mass * 9.81 / stiffness[2]], atol=1e-10)
    modes = found.linearised.modes()
    wanted = stiffness / np.concatenate([[mass] * 3, moments])
    assert np.allclose(sorted((2.0 * math.pi * m.frequency) ** 2 for m in modes), sorted(wanted), rtol=1e-9)
    assert sorted(m.title for m in modes) == sorted(f"root_joint.{name} 100 %" for name in ("vx", "vy", "vz", "wx", "wy", "wz"))
    floating = body.with_gravity((0.0, 0.0, 0.0))
    small = rbd.linearise(rbd.State(floating, [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]), [], external=[mount])
    assert np.allclose(np.sort(small.eigenvalues.imag), np.sort(found.linearised.eigenvalues.imag), atol=1e-8)


def test_a_mass_on_a_spring_and_a_damper_decays_at_the_closed_form():
    """Along the spring m x'' + d x' + k x = 0; across it swings as a pendulum of the stretched length."""
    body = free_body(2.0, [0.1, 0.1, 0.1])
    spring = rbd.Spring("body", (0.0, 0.0, 3.0), stiffness=200.0, rest=1.0)
    damper = rbd.Damper("body", (0.0, 0.0, 3.0), damping=6.0)
    upright = rbd.Spring("body", (0.0, 0.0, 3.0), stiffness=1.0, axis=(0.0, 0.0, 1.0), name="upright")
    found = rbd.find_equilibrium(rbd.State(body, [0.0, 0.0, 1.9, 0, 0, 0, 1]), [], external=[spring, damper, upright])
    length = 1.0 + 2.0 * 9.81 / 200.0
    assert abs(found.state.q[2] - (3.0 - length)) < 1e-10
    decay = 6.0 / (2.0 * 2.0)
    along = next(m for m in found.linearised.modes() if m.title == "root_joint.vz 100 %")
    assert abs(along.eigenvalue - complex(-decay, math.sqrt(200.0 / 2.0 - decay**2))) < 1e-9
    across = [m for m in found.linearised.modes() if m.title.startswith(("root_joint.vx", "root_joint.vy"))]
    assert all(abs((2.0 * math.pi * m.frequency) ** 2 - 9.81 / length) < 1e-8 for m in across) and len(across) == 2
    assert found.linearised.difference < 1e-8


@pytest.mark.parametrize("g", [9.81, 1.62])
def test_a_pendulum_with_a_horizontal_spring_on_two_worlds(g: float):
    """w^2 = g / L + k / m for a relaxed horizontal spring at the bob, on the Earth and on the Moon."""
    bob = pendulum(1.5, 0.8).with_gravity((0.0, 0.0, -g))
    spring = rbd.Spring("bob", (2.0, 0.0, -0.8), stiffness=30.0, rest=2.0)
    (mode,) = rbd.linearise(rbd.State(bob, [0.0]), [], external=spring).modes()
    assert abs((2.0 * math.pi * mode.frequency) ** 2 - (g / 0.8 + 30.0 / 1.5)) < 1e-9


def test_a_model_in_memory_with_a_passive_joint_hangs_and_swings():
    """A RobotBuilder's gate on a tilted hinge: w^2 = m g sin(tilt) c / I, and it hangs downhill."""
    tilt, mass, c = 0.3, 6.0, 0.5
    b = rbd.RobotBuilder("gate", root="fixed")
    b.body("leaf", mass=mass, com=(c, 0.0, 0.0), inertia=(0.1, 0.6, 0.7))
    b.joint("hinge", "ground", "leaf", "continuous", rpy=(0.0, tilt, 0.0), axis=(0.0, 0.0, 1.0))
    gate = b.robot()
    found = rbd.find_equilibrium(gate.at([math.cos(0.4), math.sin(0.4)]))
    (mode,) = found.linearised.modes()
    assert abs((2.0 * math.pi * mode.frequency) ** 2 - mass * 9.81 * math.sin(tilt) * c / (0.7 + mass * c * c)) < 1e-9
    assert abs(found.state.q[1]) < 1e-9 and found.stable is None
