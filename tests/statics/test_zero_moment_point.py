"""The zero-moment point against centres of pressure of solved motions; its regions on flat ground and with a hand."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import linprog

import rbd
from rbd.statics import support_region, wrench_cone, zmp, zmp_region

BOX = rbd.load_robot(Path(__file__).parents[2] / "urdf" / "box.urdf")


def hand(facets: int = 4) -> rbd.PointContact:
    return rbd.PointContact(
        "hand", "gripper_left_base_link", on=rbd.Ground(normal=(0.0, -1.0, 0.0)), friction=0.5, facets=facets
    )


def test_at_rest_it_is_below_the_centre_of_mass(talos):
    """Nothing moves: the weight's line meets the plane, whatever the plane."""
    state, still = talos.standing(), np.zeros(talos.nv)
    for height in (0.0, 0.3):
        assert np.abs(zmp(state, still, on=height) - [*state.com[:2], height]).max() < 1e-9
    slope = rbd.Ground(point=(0.0, 0.0, 0.0), normal=(0.6, 0.0, 0.8))
    found, n = zmp(state, still, on=slope), np.array([0.6, 0.0, 0.8])
    assert abs(n @ found) < 1e-12
    assert np.abs(np.cross(n, np.cross(state.com - found, [0, 0, 1.0]))).max() < 1e-9


@pytest.mark.parametrize("push", [0.0, 40.0, 80.0])
def test_on_flat_ground_it_is_the_centre_of_pressure(talos, push):
    """Of a solved motion: where the soles' forces have no level moment, computed from them alone."""
    rng = np.random.default_rng(3)
    state, soles = talos.standing(), talos.soles(0.7)
    force = rbd.ExternalForce("torso_2_link", (0.0, push, 0.0))
    solution = rbd.solve(state, rbd.hold(state, soles).tau + 0.1 * rng.normal(size=talos.nu), soles, external=force)
    total = sum(f[2] for f in solution.forces.values())
    level = np.zeros(2)
    for row in solution.problem.rows:
        wrench, p = solution.forces[row.name], row.patch.point
        moment = np.cross(p, wrench[:3]) + wrench[3:]
        level += np.array([-moment[1], moment[0]]) / total
    assert np.abs(zmp(state, solution.a, external=force)[:2] - level).max() < 1e-9


def test_a_moving_robot_counts_its_velocity(talos):
    """With v the rate of momentum has a part without acceleration: as a step of momentum over a little time shows."""
    rng = np.random.default_rng(5)
    import pinocchio as pin

    v, a, dt = 0.3 * rng.normal(size=talos.nv), rng.normal(size=talos.nv), 1e-5
    state = rbd.State(talos, talos.standing().q, v)
    before, after = (rbd.State(talos, pin.integrate(talos.model, state.q, s * dt * v), v + s * dt * a) for s in (-1.0, 1.0))
    rate = (rbd.dynamics.momentum(after) - rbd.dynamics.momentum(before)) / (2.0 * dt)
    F = rate[:3] + [0.0, 0.0, talos.mass * 9.81]
    moment = rate[3:] + np.cross(state.com, F)
    assert np.abs(zmp(state, a)[:2] - np.array([-moment[1], moment[0]]) / F[2]).max() < 1e-6


def test_in_free_fall_there_is_none(talos):
    """No vertical force, no point; and none of a robot that is pulled down faster than it falls."""
    state = talos.standing()
    fall = np.zeros(talos.nv)
    fall[:3] = state.base_pose().rotation.T @ [0.0, 0.0, -9.81]
    for a in (fall, 1.5 * fall):
        with pytest.raises(rbd.NoSolution, match="no zero-moment point"):
            zmp(state, a)


@pytest.mark.parametrize("pendular", [True, False])
@pytest.mark.parametrize("friction", ["cone", "inscribed"])
def test_on_flat_ground_the_region_is_the_hull_of_the_contacts(talos, friction, pendular):
    """With friction enough, all points of the soles' hull, and no other."""
    state, soles = talos.standing(), talos.soles(0.7)
    region = zmp_region(state, soles, friction=friction, pendular=pendular)
    corners = np.vstack([s.rows(state).patch.corners_W for s in soles])
    assert np.abs(region.vertices.min(axis=0) - corners.min(axis=0)).max() < 1e-7
    assert np.abs(region.vertices.max(axis=0) - corners.max(axis=0)).max() < 1e-7
    assert abs(region.area - np.prod(np.ptp(corners[:, :2], axis=0))) < 1e-7 and region.bounded
    assert region.distance(zmp(state, np.zeros(talos.nv))) > 0.08


def test_little_friction_keeps_the_pendulum_near_the_centre_of_mass():
    """A box: level forces at most mu m g, so the point is at most mu times the height from the centre of mass; a circle."""
    state = BOX.at(np.array([0.0, 0.0, 0.5, 0, 0, 0, 1]))
    placement = np.eye(4)
    placement[2, 3] = -0.5
    base = rbd.SurfaceContact("base", "box", half_lengths=(0.2, 0.2), placement=placement, friction=0.1)
    region = zmp_region(state, [base], area_gap=1e-6)
    assert abs(region.area - math.pi * 0.05**2) < 1e-6 and abs(region.distance((0.05, 0, 0))) < 1e-4
    assert abs(zmp_region(state, [base], friction="circumscribed").area - 0.1**2) < 1e-9


@pytest.mark.parametrize("height", [0.0, 0.5, 1.6])
def test_every_motion_of_the_pendulum_is_in_the_wrench_cone(talos, height):
    """With a hand on the wall: at each corner the pendulum's wrench is on the cone's edge, beyond it outside."""
    state, contacts = talos.standing(), [*talos.soles(0.7), hand()]
    cone = wrench_cone(state, contacts)
    region = zmp_region(state, contacts, friction="inscribed", on=height)
    weight = talos.mass * 9.81

    def wrench(point: np.ndarray) -> np.ndarray:
        level = weight * (state.com - point)[:2] / (state.com[2] - height)
        return np.concatenate([level, [weight, 0.0, 0.0, 0.0]])

    middle = region.vertices.mean(axis=0)
    for i, corner in enumerate(region.vertices):
        assert abs(cone.margin(wrench(corner))) < 1e-6
        assert cone.contains(wrench(middle + 0.999 * (corner - middle)))
        assert not cone.contains(wrench(middle + 1.001 * (corner - middle)))
        total = sum((f[:3] for f in region.forces(i).values()), np.zeros(3))
        assert np.abs(total - wrench(corner)[:3]).max() < 1e-6


def test_the_region_of_any_motion_is_that_of_an_independent_program(talos):
    """With a hand: z = n x M / F_n over all wrenches of the cone's rays; along directions in which it has an end."""
    state, contacts = talos.standing(), [*talos.soles(0.7), hand()]
    cone = wrench_cone(state, contacts, about=(0, 0, 0))
    region = zmp_region(state, contacts, friction="inscribed", pendular=False)
    assert not region.bounded and region.area == math.inf
    Z = np.array([-cone.rays[:, 4], cone.rays[:, 3]])
    ends = 0
    for angle in np.linspace(0.0, 2.0 * np.pi, 72, endpoint=False):
        d = np.array([math.cos(angle), math.sin(angle)])
        found = linprog(-(d @ Z), A_eq=cone.rays[:, 2:3].T, b_eq=[1.0], bounds=(0, None), method="highs")
        endless = bool((region.directions[:, :2] @ d > 1e-6).any())
        assert (found.status == 3) == endless
        if not endless:
            ends += 1
            assert abs(-found.fun - (region.vertices[:, :2] @ d).max()) < 1e-6
    assert ends > 5


def test_a_region_that_is_cut_says_so_beside_its_area_and_its_distance(talos):
    """A box on a base of 24 m by 0.4 m: 20 m of it are known. Beside its long edges distances are exact, at the cut bounds."""
    state, placement = BOX.at(np.array([0.0, 0.0, 0.5, 0, 0, 0, 1])), np.eye(4)
    placement[2, 3] = -0.5
    regions = {}
    for half in (9.0, 12.0):
        base = rbd.SurfaceContact("base", "box", half_lengths=(half, 0.2), placement=placement, friction=100.0)
        regions[half] = zmp_region(state, [base], friction="inscribed", pendular=False)
    whole, cut = regions.values()
    assert not whole.cut and "cut" not in str(whole) and abs(whole.area - 18.0 * 0.4) < 1e-6
    assert cut.cut and cut.bounded and "80000.00 cm2, cut at 10 m" in str(cut) and abs(cut.area - 20.0 * 0.4) < 1e-6
    for at, expected in (((0, 0.05, 0), 0.15), ((-9.0, 0.05, 0), 0.15), ((3.0, 0.3, 0), -0.1)):
        assert abs(cut.distance(at) - expected) < 1e-9  # warnings are errors here
    for at, least in (((9.9, 0.0, 0.0), 0.1), ((11.5, 0.0, 0.0), -1.5)):
        with pytest.warns(rbd.errors.InaccurateWarning, match="goes on where it is cut") as seen:
            assert abs(cut.distance(at) - least) < 1e-9
        assert seen[0].filename == __file__
    assert whole.distance((9.5, 0.0, 0.0)) == pytest.approx(-0.5)
    wall = rbd.PointContact("hand", "gripper_left_base_link", on=rbd.Ground(normal=(0.0, -1.0, 0.0)), friction=0.7)
    region = zmp_region(talos.standing(), [*talos.soles(0.7), wall], friction="inscribed")
    assert region.cut and region.bounded and "cut at 10 m" in str(region)


def test_at_rest_the_pendulum_over_every_place_is_the_support_region(talos):
    """The region of the zero-moment point below the centre of mass itself: it is inside the one if inside the other."""
    state, soles = talos.standing(), talos.soles(0.7)
    assert support_region(state, soles).distance() > 0.0
    assert zmp_region(state, soles).distance([*state.com[:2], 0.0]) > 0.0


def test_no_contact_force_no_region_and_bad_input(talos):
    """Without friction on a wall no weight is carried; planes that are not known, or level, or elsewhere, are refused."""
    state = talos.standing()
    wall = rbd.PointContact("hand", "gripper_left_base_link", on=rbd.Ground(normal=(0, -1, 0)), friction=0.0)
    region = zmp_region(state, [wall])
    assert region.empty and region.distance((0, 0, 0)) == -math.inf and "none" in str(region)
    slope = rbd.Ground(point=(0, 0, 0), normal=(0.6, 0.0, 0.8))
    for wrong in ({"on": slope}, {"on": float(state.com[2])}, {"on": None}, {"contacts": []}, {"pendular": 1}, {"margin": -1}):
        with pytest.raises(rbd.InputError):
            zmp_region(**{"state": state, "contacts": talos.soles()} | wrong)
    assert zmp_region(state, talos.soles(), on=slope, pendular=False).area > 0.0
    for a in (np.zeros(3), np.full(talos.nv, math.nan)):
        with pytest.raises(rbd.InputError):
            zmp(state, a)
