"""Soles, edges and points that rest on planes of different normals: as points of their own on these planes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.arrays import Array

BOX = rbd.testing.box(mass=10.0)
TALOS = rbd.load_robot("talos")
WEIGHT = 98.1
X, Y = 0.2, 0.1
CORNERS = np.array([[X, Y, 0.0], [X, -Y, 0.0], [-X, -Y, 0.0], [-X, Y, 0.0]])


def leaning(tilts: Array) -> Array:
    """Normals with these slopes against x and y, shape (k, 3)."""
    n = np.column_stack([tilts, np.ones(len(tilts))])
    return n / np.linalg.norm(n, axis=1)[:, None]


def bowl(places: Array, normals: Array) -> rbd.Terrain:
    """A plane through each place; each place is above the planes of the others."""
    assert (np.einsum("ij,ikj->ik", normals, places - places[:, None]) > -1e-12).all()
    different = {tuple(n): rbd.Ground(point=p, normal=n) for p, n in zip(places, normals, strict=True)}
    return rbd.Terrain({f"plane {i}": ground for i, ground in enumerate(different.values())})


def valley(right: float = 0.2, left: float = 0.2) -> tuple[rbd.SurfaceContact, list[rbd.PointContact]]:
    """A sole with its front edge on a plane that leans against it, its rear edge on another; and its corners as points."""
    normals = leaning(np.array([[-right, 0.0]] * 2 + [[left, 0.0]] * 2))
    return sole_and_points(normals, 0.6)


def sole_and_points(normals: Array, mu: Any) -> tuple[rbd.SurfaceContact, list[rbd.PointContact]]:
    sole = rbd.SurfaceContact("sole", "box", corners=CORNERS, friction=mu, on=bowl(CORNERS, normals))
    return sole, [
        rbd.PointContact(f"{i}", "box", offset=c, friction=mu, on=rbd.Ground(point=c, normal=n))
        for i, (c, n) in enumerate(zip(CORNERS, normals, strict=True))
    ]


def box_at(v: Any = (0.0,) * 6) -> rbd.State:
    return rbd.State(BOX, [0, 0, 0, 0, 0, 0, 1], v)


def push(force: Any, height: float = 0.0) -> list[rbd.ExternalForce]:
    return [rbd.ExternalForce("box", force, offset=(0.0, 0.0, height))]


def test_a_frictionless_valley_holds_what_its_normals_do():
    """Pushed where the normals meet, N_right - N_left = F / sin a and N_right + N_left = W / cos a, up to F = W tan a."""
    a = np.arctan(0.2)
    sole = valley()[0].with_friction(0.0)
    for share in (0.0, 0.5, 0.99):
        F = -share * WEIGHT * np.tan(a)
        held = rbd.solve(box_at(), [], [sole], external=push((F, 0.0, 0.0), X / np.tan(a)))
        N = np.linalg.norm(held.corner_forces["sole"], axis=1)
        both, difference = WEIGHT / np.cos(a), F / np.sin(a)
        np.testing.assert_allclose([N[:2].sum(), N[2:].sum()], [(both + difference) / 2, (both - difference) / 2], atol=1e-9)
        assert np.abs(held.a).max() < 1e-12
    beyond = rbd.solve(box_at(), [], [sole], external=push((-1.01 * WEIGHT * np.tan(a), 0.0, 0.0), X / np.tan(a)))
    assert np.abs(beyond.a).max() > 1e-3


@pytest.mark.parametrize("law", ["convex", "coulomb"])
def test_a_sole_moves_as_its_corners_on_their_planes(law):
    """At rest, slipping, tipping, lifting, and in motion: the same accelerations, net forces and certificates, on any bowl."""
    rng, slipped = np.random.default_rng(0), 0
    for i in range(24):
        angles = -np.sign(CORNERS[:, :2]) * rng.uniform(0.05, 0.25, (4, 2))
        sole, points = valley(0.18, 0.1) if i % 3 == 0 else sole_and_points(leaning(angles), float(rng.uniform(0.1, 0.7)))
        force = rng.normal(size=3) * [60.0, 60.0, 40.0]
        state = box_at((0.0, 0.3, 0.0, 0.0, 0.0, 0.0) if law == "coulomb" and i % 6 == 3 else (0.0,) * 6)  # along the valley
        known = rbd.solve(state, [], points, external=push(force, 0.1), law=law)
        found = rbd.solve(state, [], [sole], external=push(force, 0.1), law=law)
        assert found.residuals.within(1e-9) and known.residuals.within(1e-9)
        np.testing.assert_allclose(found.a, known.a, atol=1e-9)
        np.testing.assert_allclose(found.forces["sole"][:3], np.sum([*known.forces.values()], axis=0), atol=1e-8)
        slipped += np.abs(found.a).max() > 1e-3
    assert 5 < slipped < 24


def test_pyramids_of_a_sole_are_those_of_its_corners():
    """With facets in place of cones, and under the check of solvers, which computes corners' rays by itself."""
    sole, points = valley(0.2, 0.1)
    for force in ((0.0, 0.0, 0.0), (90.0, 20.0, 0.0), (0.0, 80.0, 40.0)):
        ends = [rbd.solve(box_at(), [], c, external=push(force), solver=rbd.ProxQP()).a for c in ([sole], points)]
        np.testing.assert_allclose(ends[0], ends[1], atol=1e-9)
    found = rbd.solve(box_at(), [], points, external=push((90.0, 20.0, 0.0)), law="convex", solver=rbd.ProxQP())
    problem = rbd.solve(box_at(), [], [sole], external=push((90.0, 20.0, 0.0))).problem
    of_sole = rbd.testing.ReferenceProblem("a sole in a valley", problem, {"convex": found.a}, source="its corners as points")
    rbd.testing.check_solver(rbd.ProxQP(), problems=[of_sole])


def test_rows_are_those_of_a_rigid_sole():
    """J, velocity and J_dot v pass the check against motion; the sole's own axes and centre; each corner's normal."""
    sole, _ = valley(0.2, 0.1)
    rbd.testing.check_constraint(sole, box_at((0.3, -0.2, 0.1, 0.5, -0.4, 0.6)))
    rows = sole.rows(box_at())
    np.testing.assert_allclose(rows.patch.corner_axes[:, :, 2], leaning(np.array([[-0.2, 0]] * 2 + [[0.1, 0]] * 2)), atol=1e-15)
    np.testing.assert_allclose(rows.patch.corners_W, CORNERS, atol=1e-15)
    np.testing.assert_allclose(rows.patch.axes, np.eye(3), atol=1e-15)
    assert not rows.overlaps and rows.touches
    level = rbd.SurfaceContact("sole", "box", corners=CORNERS, friction=0.6, on=0.0).rows(box_at())
    for name in ("J", "bias", "velocity"):
        np.testing.assert_allclose(getattr(rows, name), getattr(level, name), atol=1e-15)


def test_hold_regions_and_pushes_of_talos():
    """On valleys under both soles: torques, margins, region and largest pushes are those of eight points."""
    state, plain = TALOS.standing(), TALOS.soles()
    at = [(s, (state.frame(s.frame).X_WF * s.placement).act(c)) for s in plain for c in s.corners]
    x = np.unique(np.round([p[0] for _, p in at], 9))
    for mu, slope in ((0.6, 0.18), (0.05, 0.12)):
        rear, front = (
            rbd.Ground(point=(e, 0, 0), normal=leaning(np.array([[s, 0]]))[0]) for e, s in ((x[0], slope), (x[-1], -slope))
        )
        feet = TALOS.soles(friction=mu, on=rbd.Terrain({"front": front, "rear": rear}))
        points = [
            rbd.PointContact(
                f"{s.name} {i}", s.frame, offset=s.placement.act(c), friction=mu, on=rear if p[0] < x.mean() else front
            )
            for i, ((s, p), c) in enumerate(zip(at, np.concatenate([s.corners for s in plain]), strict=True))
        ]  # fmt: skip
        ours, known = rbd.hold(state, feet), rbd.hold(state, points)
        np.testing.assert_allclose(ours.tau, known.tau, atol=1e-8)
        pressed = np.concatenate([*ours.corner_forces.values()])
        np.testing.assert_allclose(pressed, np.concatenate([*known.corner_forces.values()]), atol=1e-6)
        normals = np.array([rear.normal if p[0] < x.mean() else front.normal for _, p in at])
        along = np.einsum("ij,ij->i", pressed, normals)
        used = np.linalg.norm(pressed - along[:, None] * normals, axis=1) / (mu * along)
        np.testing.assert_allclose(np.concatenate([*ours.margins.corner_friction.values()]), 1.0 - used, atol=1e-12)
        assert not ours.margins.friction  # the net force of a sole on two planes has no coefficient
        areas = [rbd.statics.support_region(state, c).area for c in (feet, points)]
        assert areas[0] == pytest.approx(areas[1], abs=1e-9)
        ways = [(1, 0, 0), (0, 1, 0), (-1, 0.3, 0.2)]
        limits = [rbd.statics.push_limits(state, c, "torso_2_link", ways) for c in (feet, points)]
        np.testing.assert_allclose(limits[0].forces, limits[1].forces, rtol=1e-7)


def test_uniqueness_is_that_of_points():
    """The ranges of corner forces along each corner's own normal."""
    sole, points = valley(0.2, 0.1)
    ours, known = (rbd.solve(box_at(), [], c).uniqueness() for c in ([sole], points))
    for found, (name, other) in zip(ours.contacts["sole"].corners, known.contacts.items(), strict=True):
        assert name in "0123"
        assert (found.lowest, found.highest) == pytest.approx((other.normal.lowest, other.normal.highest), abs=1e-6)


def test_derivatives_while_it_sticks():
    """Those of the answer, by differences of answers at states near by; where a corner slips they are refused in words."""
    sole, _ = valley()
    state, external, h = box_at(), push((5.0, 8.0, 0.0), 0.1), 5e-7  # slower than what counts as at rest
    found = rbd.solve(state, [], [sole], external=external).derivatives()
    for by, make in (
        (found.da_dq, lambda d: rbd.State(BOX, pin.integrate(BOX.model, state.q, d), state.v)),
        (found.da_dv, lambda d: rbd.State(BOX, state.q, d)),
    ):
        ends = [[rbd.solve(make(s * h * e), [], [sole], external=external).a for s in (1, -1)] for e in np.eye(6)]
        np.testing.assert_allclose(by, np.array([(up - down) / (2 * h) for up, down in ends]).T, atol=1e-6)
    with pytest.raises(rbd.errors.NotDifferentiable, match="set of forces of 'sole' changes"):
        rbd.solve(state, [], [sole], external=push((150.0, 0.0, 0.0)), law="convex").derivatives()


@pytest.mark.parametrize("mu", [0.0, 0.3])
def test_edges_and_points_between_two_planes(mu):
    """An edge across a valley is its two ends; a point at its bottom is pushed by both planes."""
    planes = leaning(np.array([[-0.2, 0.0], [0.1, 0.0]]))
    ends = np.array([[X, 0.0, 0.0], [-X, 0.0, 0.0]])
    edge = rbd.LineContact("edge", "box", half_length=X, friction=mu, on=bowl(ends, planes))
    both = [
        rbd.PointContact(f"{i}", "box", offset=p, friction=mu, on=rbd.Ground(point=p, normal=n))
        for i, (p, n) in enumerate(zip(ends, planes, strict=True))
    ]
    low = (0.0, 0.0, -1e-4)
    bottom = rbd.Terrain({f"{i}": rbd.Ground(point=low, normal=n) for i, n in enumerate(planes)})
    toe = rbd.PointContact("toe", "box", friction=mu, on=bottom)
    two = [rbd.PointContact(f"{i}", "box", friction=mu, on=rbd.Ground(point=low, normal=n)) for i, n in enumerate(planes)]
    for force in ((0.0, 0.0, 0.0), (8.0, 3.0, 5.0), (70.0, -20.0, 0.0)):
        for one, several in ((edge, both), (toe, two)):
            found, known = (rbd.solve(box_at(), [], c, external=push(force)) for c in ([one], several))
            np.testing.assert_allclose(found.a, known.a, atol=1e-9)
            np.testing.assert_allclose(found.forces[one.name][:3], np.sum([*known.forces.values()], axis=0), atol=1e-8)
            assert found.residuals.within(1e-9)
    assert [len(one.rows(box_at())) for one in (edge, toe)] == [5, 3]


def test_held_soles_and_sets_of_their_own():
    """A bilateral sole has its six rows; a set for each corner is in its own axes."""
    sole, _ = valley()
    held = rbd.solve(box_at(), [], [sole.with_friction(None)], external=push((500.0, 0.0, 900.0)))
    assert np.abs(held.a).max() < 1e-12
    each = rbd.problem.EllipticCone(0.6, 0.6)
    ours, known = (rbd.solve(box_at(), [], [sole.with_friction(mu)], external=push((90.0, 20.0, 0.0))).a for mu in (each, 0.6))
    np.testing.assert_allclose(ours, known, atol=1e-9)


def test_simulation_begins_without_complaint():
    """A simulated sole in a valley stays, and nothing is said of its ground."""
    stood = rbd.simulate(box_at(), [valley()[0]], duration=0.02, step=2e-3, progress=False)
    assert np.abs(stood.q - stood.q[0]).max() < 1e-12 and not stood.events


def test_axes_that_are_no_rotations_are_refused():
    with pytest.raises(rbd.InputError, match="a rotation matrix of each"):
        rbd.problem.UnevenCone(CORNERS, np.ones((4, 3, 3)), 0.5)
    with pytest.raises(rbd.InputError, match="dim of an UnevenCone is 4"):
        rbd.problem.UnevenCone(CORNERS, np.tile(np.eye(3), (4, 1, 1)), 0.5, dim=4)
