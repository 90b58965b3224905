"""Of all forces with the same motion the record has the shortest, as `rbd.solve` does: at each recorded moment."""

from __future__ import annotations

import math

import numpy as np
import pytest
from contact_cases import sole
from flat_bodies import free_body, free_state

import rbd

G = 9.81
STEPPING = pytest.mark.parametrize("integrator", [rbd.TimeStepping(), rbd.TimeStepping(extrapolate=True)])
BOX_KG, HALF, DEPTH = 10.0, (0.1, 0.1), 0.05


def _box():
    return free_body(BOX_KG, [0.1, 0.1, 0.15])


def _corner_forces(found, i, name="sole"):
    return found.point_forces[name][i]


@STEPPING
def test_a_sole_that_came_to_rest_has_no_corner_that_pushes_another(integrator):
    """A box that slid and spun until friction stopped it: a quarter of its weight at each corner, and nothing sideways."""
    start = free_state(_box(), (0.0, 0.0, DEPTH), (0.0, 0.0, 0.0), (0.8, 0.3, 0.0), (0.0, 0.0, 6.0))
    contact = sole("body", HALF, DEPTH, 0.5)
    found = rbd.simulate(start, [contact], duration=1.0, step=2e-3, integrator=integrator, record_every=50, progress=False)
    assert np.abs(found.v[-1]).max() < 1e-6
    assert found.modes["sole"][0] == "slips"
    assert found.modes["sole"][-1] == "sticks"
    expected = np.tile([0.0, 0.0, BOX_KG * G / 4.0], (4, 1))
    assert np.abs(_corner_forces(found, -1) - expected).max() < 1e-5


@STEPPING
@pytest.mark.parametrize("push", [(0.0, 0.0), (20.0, 0.0), (-15.0, 25.0)], ids=["no push", "along x", "across"])
def test_corner_forces_of_a_record_are_those_of_solve(integrator, push):
    """A box on its sole under a push below friction: at each recorded moment the corners that `rbd.solve` gives."""
    robot, contact = _box(), sole("body", HALF, DEPTH, 0.5)
    start = free_state(robot, (0.0, 0.0, DEPTH), (0.0, 0.0, 0.3), (0.0, 0.0, 0.0), (0.0, 0.0, 2.0))
    force = rbd.ExternalForce("body", (*push, 0.0))
    found = rbd.simulate(
        start, [contact], duration=0.5, step=2e-3, integrator=integrator, external=[force], record_every=25, progress=False
    )
    compared = 0
    for i in range(len(found)):
        if np.abs(found.v[i]).max() > 1e-6:
            continue
        still = found.state(i).with_velocity(np.zeros(6))
        proved = rbd.solve(still, np.zeros(0), [contact], external=[force], solver=rbd.ADMM())
        assert proved.force_choice.startswith("minimum norm")
        assert np.abs(_corner_forces(found, i) - proved.corner_forces["sole"]).max() < 1e-4
        compared += 1
    assert compared >= 5


@STEPPING
def test_legs_of_a_table_share_its_weight_as_the_least_norm_does(integrator):
    """Legs at (+-.6, +-.4), 400 N, mass at (.15, -.1): 100, 150, 50 and 100 N; at (.45, .2) one leg carries nothing.

    In the second the least norm without cones would pull at one leg by 25 N; inside the cones the others share what is left.
    """
    legs = [(x, y) for x in (0.6, -0.6) for y in (0.4, -0.4)]
    for (x, y), expected in (((0.15, -0.1), [100.0, 150.0, 50.0, 100.0]), ((0.45, 0.2), [250.0, 100.0, 50.0, 0.0])):
        robot = free_body(400.0 / G, [5.0, 5.0, 8.0])
        feet = [
            rbd.PointContact(f"leg{i}", "body", offset=(a - x, b - y, -0.7), friction=0.6, anchor=(0.0, 0.0, 0.0))
            for i, (a, b) in enumerate(legs)
        ]
        start = free_state(robot, (0.0, 0.0, 0.7))
        found = rbd.simulate(start, feet, duration=0.1, step=1e-2, integrator=integrator, progress=False)
        for i in (0, 5, -1):
            forces = np.array([found.forces[foot.name][i] for foot in feet])
            assert np.abs(forces[:, 2] - expected).max() < 1e-4
            assert np.abs(forces[:, :2]).max() < 1e-4


@STEPPING
def test_a_robot_that_stands_has_the_corner_forces_of_solve(integrator, talos):
    """Talos on its soles under the torques that hold it: each recorded moment has the corners of `rbd.solve`."""
    standing, soles = talos.standing(), talos.soles()
    held = rbd.hold(standing, soles)
    found = rbd.simulate(
        standing, soles, duration=0.02, step=1e-3, integrator=integrator, controller=lambda s, t: held.tau, progress=False
    )
    for i in (0, 10, 20):
        proved = rbd.solve(found.state(i), held.tau, soles, solver=rbd.ADMM())
        for name, corners in proved.corner_forces.items():
            assert np.abs(found.point_forces[name][i] - corners).max() < 1e-4
        assert np.abs(proved.a - found.a[i]).max() < 1e-8


@STEPPING
def test_a_sliding_box_keeps_its_friction_and_its_motion(integrator):
    """All corners slide: each rubs against its own sliding by mu times its load, and the loads are the box's."""
    start = free_state(_box(), (0.0, 0.0, DEPTH), (0.0, 0.0, 0.0), (2.0, 0.0, 0.0))
    found = rbd.simulate(
        start, [sole("body", HALF, DEPTH, 0.4)], duration=0.2, step=2e-3, integrator=integrator, record_every=20, progress=False
    )
    for i in range(len(found)):
        forces = _corner_forces(found, i)
        assert np.abs(forces[:, 0] + 0.4 * forces[:, 2]).max() < 1e-6
        assert np.abs(forces[:, 1]).max() < 1e-6
        assert abs(forces[:, 2].sum() - BOX_KG * G) < 1e-6
        assert abs(found.a[i][0] + 0.4 * G) < 1e-6
        tips = forces[:, 2] @ (found.points["sole"][i][:, 0] - found.q[i, 0])  # the loads' moment balances the friction's
        assert abs(tips - 0.4 * BOX_KG * G * DEPTH) < 1e-6
        assert np.ptp(forces[:2, 2]) < 1e-6 or math.isclose(forces[0, 2], forces[1, 2], abs_tol=1e-6)
