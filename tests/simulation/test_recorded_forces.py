"""Of all forces with the same motion the record has the shortest, as `rbd.solve` does: at each recorded moment."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
import pytest
from contact_cases import sole
from flat_bodies import flat_body, flat_state, floor_point, free_body, free_state

import rbd
from rbd.constraints.contact_points import sources_of
from rbd.simulation.recording import _inside, _settled
from rbd.simulation.stacked_points import Points, point_kernel

G = 9.81
STEPPING = pytest.mark.parametrize("integrator", [rbd.TimeStepping(), rbd.TimeStepping(extrapolate=True)])
BOX_KG, HALF, DEPTH = 10.0, (0.1, 0.1), 0.05


def _box():
    return free_body(BOX_KG, [0.1, 0.1, 0.15])


def _shortest(G, g):
    y, z = np.zeros(len(G)), np.zeros(len(g))
    return y if point_kernel().spanned(G, len(G), g, y, z, np.empty(len(g), int)) >= 0 else None


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
        proved = rbd.solve(still, np.zeros(0), [contact], external=[force], solver=rbd.ConeSolver())
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
        proved = rbd.solve(found.state(i), held.tau, soles, solver=rbd.ConeSolver())
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


@STEPPING
@pytest.mark.parametrize(("speed", "turn", "steps", "rest"), [(0.3, 3, 10, 1e-4), (2e-3, 3, 10, 1e-4), (5e-6, 0, 1, 1e-5)])
def test_a_recorded_acceleration_is_that_of_its_state(integrator, speed, turn, steps, rest):
    """A body that turns on a corner, which slides along a curve: in each frame friction opposes the slide of that frame.

    By the velocities of the step, which are J v to O(h^2), accelerations were off by 1e-3 to 1e-2 rad/s2. A corner that creeps
    is at rest: brought there in half a step accelerations were off by up to 7e-3 rad/s2.
    """
    corner = rbd.PointContact("corner", "body", offset=(0.1, 0.08, -DEPTH), friction=0.4 if turn else 3.0, on=0.0)
    turned = free_state(_box(), (0.0, 0.0, 0.0), (0.3, 0.6, 0.2))
    low = float(corner.points(turned).gaps[0])
    start = free_state(_box(), (0.0, 0.0, -low), (0.3, 0.6, 0.2), (speed, 0.3 * speed, 0.0))
    start = start.with_velocity(start.v + [0.0, 0.0, 0.0, turn / 6.0, 0.0, turn])
    start = rbd.mechanism.project_velocity(start, [corner.with_friction(0.0)])
    found = rbd.simulate(start, [corner], duration=steps * 5e-3, step=5e-3, integrator=integrator, progress=False)
    for i in range(steps):
        again = rbd.solve(found.state(i), None, [corner], rest_speed=rest)
        assert again.a == pytest.approx(found.a[i], abs=1e-7)
        assert again.forces["corner"] == pytest.approx(found.forces["corner"][i], abs=1e-7)
    assert set(found.modes["corner"][:steps]) == {"slips" if speed > rest else "sticks"}


def test_a_face_that_falls_touches_at_its_edge_and_is_certified_there():
    """Tilted by 1 mrad, its other corners are 0.2 mm above the ground: taken whole, `rbd.solve` lays it flat."""
    below, tilt = pin.SE3(np.eye(3), np.array([0.0, 0.0, -DEPTH])), 1e-3
    face = rbd.SurfaceContact("sole", "body", half_lengths=HALF, placement=below, friction=0.5, on=0.0)
    level = free_state(_box(), (0.0, 0.0, 0.0), (0.0, tilt, 0.0))
    start = free_state(_box(), (0.0, 0.0, -float(face.points(level).gaps.min())), (0.0, tilt, 0.0))
    found = rbd.simulate(start, [face], duration=4e-3, step=1e-3, progress=False)
    for i in (0, 3, -1):
        (edge,) = found.touching(i, [face])
        again, flat = (rbd.solve(found.state(i), None, [c], rest_speed=rest) for c, rest in ((edge, 1e-4), (face, 1.0)))
        assert len(edge.corners) == 2 and again.a == pytest.approx(found.a[i], abs=1e-8)
        assert np.abs(flat.a).max() < 1e-2 < 1.0 < np.abs(found.a[i]).max()
    thrown = free_state(_box(), (0.0, 0.0, 1.0))
    assert rbd.simulate(thrown, [face], duration=1e-2, step=1e-3, progress=False).touching(2, [face]) == ()
    with pytest.raises(rbd.errors.InputError, match="a constraint of Trajectory.touching is 'other'; there are 'sole'"):
        found.touching(0, [face, rbd.PointContact("other", "body", on=0.0)])


@STEPPING
@pytest.mark.parametrize("push_N", [3.0, 9.0], ids=["each holds", "the joint's is at its bound"])
def test_dry_friction_of_a_joint_shares_with_that_of_the_feet(integrator, push_N):
    """A body on two rough edges, its slider rubbing with 2 N at most, pushed: the shortest forces with that sum, by hand.

    Feet at -h below the push: their normals take its moment, so each newton of theirs along x costs h / b more of them.
    """
    m, half, depth, bound = 2.0, 0.4, 0.1, 2.0
    edges = [floor_point(f"edge{i}", (x, -depth), friction=0.5) for i, x in enumerate((-half, half))]
    start = flat_state(flat_body(m, 0.02), (0.0, depth, 0.0))
    found = rbd.simulate(
        start, [*edges, rbd.JointFriction("rub", "x", bound)], duration=0.02, step=5e-3, integrator=integrator, progress=False,
        external=lambda state, t: np.array([push_N, 0.0, 0.0]),
    )  # fmt: skip
    # Unknowns: x and z of both feet, the joint's; sums along x and z, and the moment about the middle.
    J = np.array([[1.0, 0.0, 1.0, 0.0, 1.0], [0.0, 1.0, 0.0, 1.0, 0.0], [-depth, half, -depth, -half, 0.0]])
    expected = np.linalg.pinv(J) @ [-push_N, m * G, 0.0]
    if abs(expected[4]) > bound:
        expected = np.append(np.linalg.pinv(J[:, :4]) @ [-push_N + bound, m * G, 0.0], -bound)
    for i in range(len(found)):
        forces = [*found.forces["edge0"][i][[0, 2]], *found.forces["edge1"][i][[0, 2]], *found.forces["rub"][i]]
        assert forces == pytest.approx(expected, abs=1e-8)


@STEPPING
def test_dry_friction_of_a_joint_that_slides_is_at_its_bound_beside_that_of_the_feet(integrator):
    """Sliding at 1 m/s: 2 N of the joint and mu times the load of the feet, which carry the weight."""
    m, mu = 2.0, 0.4
    edges = [floor_point(f"edge{i}", (x, -0.1), friction=mu) for i, x in enumerate((-0.4, 0.4))]
    start = flat_state(flat_body(m, 0.02), (0.0, 0.1, 0.0), (1.0, 0.0, 0.0))
    given = [*edges, rbd.JointFriction("rub", "x", 2.0)]
    found = rbd.simulate(start, given, duration=0.02, step=5e-3, integrator=integrator, progress=False)
    for i in range(len(found)):
        one, other = found.forces["edge0"][i], found.forces["edge1"][i]
        assert found.forces["rub"][i] == pytest.approx([-2.0], abs=1e-9)
        assert one[2] + other[2] == pytest.approx(m * G, abs=1e-8)
        assert [one[0], other[0]] == pytest.approx([-mu * one[2], -mu * other[2]], abs=1e-8)
        assert 0.4 * (other[2] - one[2]) == pytest.approx(-0.1 * (one[0] + other[0]), abs=1e-8)


@pytest.mark.parametrize(
    ("G", "g"),
    [([[1.0, 0.0]], [0.0, 1.0]), ([[1.0, 1.0], [2.0, 2.0]], [1.0, 1.0 + 1e-9]), ([[0.0, 0.0]], [1.0, 0.0])],
    ids=["another direction", "nearly the same one", "rows that move nothing"],
)
def test_what_no_forces_make_has_no_shortest(G, g):
    """G^T y = g has no solution to twelve digits."""
    assert _shortest(np.array(G), np.array(g)) is None


def test_the_shortest_of_rows_that_repeat_each_other_is_the_pseudoinverses():
    """Eight rows of rank three."""
    rng = np.random.default_rng(4)
    rows = rng.normal(size=(8, 3)) @ rng.normal(size=(3, 5))
    g = rows.T @ rng.normal(size=8)
    found = _shortest(rows, g)
    assert found is not None
    assert np.abs(found - np.linalg.pinv(rows.T) @ g).max() < 1e-11


@pytest.mark.parametrize("used", [1.0, 0.5])
def test_a_slide_with_less_friction_than_its_own_is_left_to_the_long_way(used):
    """Of four corners that slide the short way knows rays of mu N alone: half of that is none of their sums."""
    start = free_state(_box(), (0.0, 0.0, DEPTH), v=(1.0, 0.0, 0.0))
    at = Points(sources_of([sole("body", HALF, DEPTH, 0.4)], start)).at(start, 0.0)
    force = np.tile([-0.4 * used, 0.0, 1.0], 4) * BOX_KG * G / 4.0
    found = _inside(at, np.ones(4, bool), at.velocity, force, "coulomb")
    assert (found is None) == (used < 1.0)
    if found is not None:
        assert found == pytest.approx(force, abs=1e-9)  # alike at all corners: the shortest with that sum and moment


def test_of_rows_that_all_hold_the_long_way_finds_the_shortest_too():
    """A hinge that closes a four-bar, five rows of rank two: the pseudoinverse's forces, of any that do the same."""
    robot = rbd.mechanism.four_bar(0.4, 1.2, 0.8, 1.0, crank_angle=0.7)
    (loop,) = robot.loops()
    hinge = rbd.LoopClosure(loop.name, loop.frame_a, loop.frame_b, kind="revolute", axis=loop.axis)
    state = robot.at("assembled")
    at = Points(sources_of([hinge], state)).at(state, 0.0)
    given = np.random.default_rng(1).normal(size=5)
    found = _settled(at, np.ones(1, bool), state.v, at.velocity, given, "coulomb")
    assert np.linalg.matrix_rank(at.J) == 2
    assert np.abs(found - np.linalg.pinv(at.J.T) @ (at.J.T @ given)).max() < 1e-9
    assert np.linalg.norm(found) < 0.99 * np.linalg.norm(given)
