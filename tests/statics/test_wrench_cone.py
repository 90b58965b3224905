"""Wrench cones: Caron's inequalities of a rectangular sole, and membership by linear programs."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import linprog

import rbd
from rbd.statics import wrench_cone
from rbd.statics.wrench_cones import polyhedral_cone

BOX = rbd.load_robot(Path(__file__).parents[2] / "urdf" / "box.urdf")
AT = BOX.at(BOX.neutral())


def caron(mu: float, X: float, Y: float) -> np.ndarray:
    """The 16 inequalities of a sole of half lengths X and Y, a . wrench >= 0 about its centre [CaronPhamNakamura2015]."""
    out = []
    for s in (1.0, -1.0):
        out += [[s, 0, mu, 0, 0, 0], [0, s, mu, 0, 0, 0], [0, 0, Y, s, 0, 0], [0, 0, X, 0, s, 0]]
    for a, b in itertools.product((1.0, -1.0), repeat=2):
        out.append([-a * Y, -b * X, mu * (X + Y), a * mu, b * mu, 1])  # tz >= -mu (X + Y) fz + |Y fx - mu tx| + |X fy - mu ty|
        out.append([-a * Y, -b * X, mu * (X + Y), -a * mu, -b * mu, -1])  # tz <= mu (X + Y) fz - |Y fx + mu tx| - ...
    return np.array(out)


@pytest.mark.parametrize(("friction", "share"), [("inscribed", math.cos(math.pi / 4.0)), ("circumscribed", 1.0)])
@pytest.mark.parametrize(("X", "Y", "mu"), [(0.1, 0.06, 0.7), (0.05, 0.2, 0.3), (0.1, 0.1, 1.2)])
def test_the_cone_of_one_sole_is_carons(friction, share, X, Y, mu):
    """Each face is one of the 16 inequalities, and each of them is a face."""
    sole = rbd.SurfaceContact("sole", "box", half_lengths=(X, Y), friction=mu)
    cone = wrench_cone(AT, [sole], about=(0, 0, 0), friction=friction)
    expected = caron(mu * share, X, Y)
    expected /= np.linalg.norm(expected * np.append(np.ones(3), np.full(3, cone.length)), axis=1, keepdims=True)
    assert cone.faces.shape == (16, 6) and cone.rays.shape == (16, 6)
    assert not len(cone.lines) and not len(cone.equalities)
    for face in cone.faces:
        assert np.abs(expected - face).max(axis=1).min() < 1e-12 * 100


def wrenches(rng: np.random.Generator, rays: np.ndarray, count: int) -> np.ndarray:
    """Half of them sums of a few rays, a little off: near the faces, on both sides; the others anywhere about the middle."""
    weights = rng.exponential(size=(count, len(rays))) * (rng.random((count, len(rays))) < 4.0 / len(rays))
    near = weights @ rays + rng.normal(scale=0.02, size=(count, 6)) * np.abs(rays).max(axis=0)
    middle = rays.mean(axis=0)
    far = middle + rng.normal(size=(count, 6)) * 0.3 * np.abs(rays).max(axis=0)
    return np.where(rng.random((count, 1)) < 0.5, near, far)


def test_two_soles_against_linear_programs(talos, exhaustive):
    """10,000 wrenches (400 but in `make exhaustive`): in the cone by its faces where some corner forces make them."""
    state, rng = talos.standing(), np.random.default_rng(7)
    turned = np.array([0.3, -0.1, 0.1])  # a pose whose soles are neither level nor alike
    q = state.q.copy()
    for i, joint in enumerate(("leg_left_2_joint", "leg_left_6_joint", "leg_right_5_joint")):
        q[talos.joints[joint].q] += turned[i]
    tilted = rbd.State(talos, q)
    inside = 0
    for at, facets in ((state, 4), (tilted, 4), (tilted, 6)):
        soles = talos.soles(0.6, facets=facets, on=None)
        cone = wrench_cone(at, soles)
        rays = []
        for sole in soles:
            patch = sole.rows(at).patch
            for corner, angle in itertools.product(patch.corners_W, (2.0 * np.arange(facets) + 1.0) * np.pi / facets):
                f = patch.axes @ [0.6 * math.cos(angle), 0.6 * math.sin(angle), 1.0]
                rays.append(np.append(f, np.cross(corner - at.com, f)))
        rays = np.array(rays)
        for w in wrenches(rng, rays, (10_000 if exhaustive else 400) // 3 + 1):
            found = linprog(np.ones(len(rays)), A_eq=rays.T, b_eq=w, bounds=(0, None), method="highs")
            margin = cone.margin(w)
            if abs(margin) > 1e-6:  # nearer, HiGHS's own tolerance decides
                assert (found.status == 0) == (margin > 0.0) == cone.contains(w)
                inside += margin > 0.0
    assert 0.1 < inside / (10_000 if exhaustive else 400) < 0.9


def test_sums_of_rays_are_inside_and_on_faces(talos):
    """Every ray keeps all faces, and each face is touched by five independent rays: none is redundant."""
    cone = wrench_cone(talos.standing(), talos.soles(0.5, facets=8))
    scale = np.append(np.ones(3), np.full(3, cone.length))
    touch = (cone.rays @ cone.faces.T) / np.outer(
        np.linalg.norm(cone.rays / scale, axis=1), np.linalg.norm(cone.faces * scale, axis=1)
    )
    assert touch.min() > -1e-9
    for column in touch.T:
        assert np.linalg.matrix_rank((cone.rays / scale)[column < 1e-8], tol=1e-8) == 5


def test_a_point_contact_has_equalities_for_its_moments():
    """Three rays' worth of forces: about the point itself no moment at all, and four faces of the pyramid."""
    cone = wrench_cone(AT, [rbd.PointContact("tip", "box", friction=0.5)], about=(0, 0, 0))
    assert cone.faces.shape == (4, 6) and cone.equalities.shape == (3, 6) and not cone.equalities[:, :3].any()
    assert cone.contains((0, 0.3, 1, 0, 0, 0)) and not cone.contains((0, 0, 1, 0.01, 0, 0))
    assert not cone.contains((0.5, 0.5, 1, 0, 0, 0)) and not cone.contains((0, 0, -1, 0, 0, 0))


def test_hands_that_press_against_each_other_apply_some_wrenches_both_ways():
    """Two facing walls within friction: the line between the points is inside both cones, so all wrenches of the pair are."""
    pair = [
        rbd.PointContact(n, "box", offset=(0, s * 0.2, 0), friction=0.8, on=rbd.Ground(normal=(0, -s, 0)))
        for n, s in (("left", 1.0), ("right", -1.0))
    ]
    cone = wrench_cone(AT, pair)
    assert len(cone.lines) == 5 and not len(cone.faces) and len(cone.equalities) == 1
    assert abs(cone.equalities[0] @ [0, 0, 0, 0, 1, 0]) > 0.1 and cone.contains((3, -5, 2, 1, 0, 1))
    assert not cone.contains((0, 0, 0, 0, 1, 0))


def test_beside_a_held_point_others_press_one_way():
    """A ball joint at the origin and a point that pushes up at x = 1: any force, and about the joint moments along -y alone."""
    joint = rbd.PointContact("joint", "box", offset=(0.0, 0.0, 0.0), friction=None, on=None)
    toe = rbd.PointContact("toe", "box", offset=(1.0, 0.0, 0.0), friction=0.0, on=None)
    cone = wrench_cone(AT, [joint, toe], about=(0, 0, 0))
    assert len(cone.lines) == 3 and len(cone.rays) == 1 and len(cone.faces) == 1 and len(cone.equalities) == 2
    assert cone.contains((3, -5, -2, 0, -4, 0)) and not cone.contains((3, -5, -2, 0, 4, 0))
    assert not cone.contains((0, 0, 0, 1, 0, 0)) and not cone.contains((0, 0, 0, 0, 0, 1))


def test_a_held_sole_applies_any_wrench_and_one_without_friction_presses(talos):
    """Bilateral contacts are lines; without friction a sole is three rays' dimension: pressure within its rectangle."""
    held = wrench_cone(talos.standing(), talos.soles(None))
    assert len(held.lines) == 6 and held.contains((-9, 8, -7, 6, -5, 4)) and held.margin(np.ones(6)) == math.inf
    smooth = wrench_cone(AT, [rbd.SurfaceContact("ice", "box", half_lengths=(0.1, 0.2), friction=0.0)], about=(0, 0, 0))
    assert smooth.faces.shape == (4, 6) and smooth.equalities.shape == (3, 6)
    assert smooth.contains((0, 0, 1, 0.19, 0.09, 0)) and not smooth.contains((0, 0, 1, 0.21, 0, 0))


def test_the_weight_is_inside_while_the_robot_can_stand(talos):
    """Talos' soles can carry its weight; the one sole alone cannot, its centre of mass is not above it."""
    state = talos.standing()
    up = np.append([0, 0, talos.mass * 9.81], np.zeros(3))
    assert wrench_cone(state, talos.soles()).contains(up)
    assert not wrench_cone(state, talos.soles()[:1]).contains(up)
    assert "16 faces" in str(wrench_cone(state, talos.soles()))


def test_cones_of_two_and_one_dimension():
    """The angle between two rays in the plane, and a single ray."""
    rays, lines, faces, equalities = polyhedral_cone(np.array([[1.0, 0.0], [0.6, 0.8], [0.8, 0.6]]), np.zeros((0, 2)))
    assert len(rays) == 2 and len(faces) == 2 and not len(lines) and not len(equalities)
    assert ((faces @ np.array([0.9, 0.5])) > 0.0).all() and (faces @ np.array([0.5, -0.1])).min() < 0.0
    rays, _, faces, equalities = polyhedral_cone(np.array([[0.6, 0.8]]), np.zeros((0, 2)))
    assert len(faces) == 1 and len(equalities) == 1 and (faces @ np.array([0.6, 0.8]))[0] == pytest.approx(1.0)


def test_contacts_between_two_bodies_apply_nothing_from_outside(talos):
    """Hands that press each other: alone they make no wrench but zero, with the soles none that the soles do not."""
    state, soles = talos.standing(), talos.soles()
    fists = rbd.PointContact("fists", "gripper_left_base_link", on=rbd.Body("gripper_right_base_link"), friction=0.5)
    nothing = wrench_cone(state, [fists])
    assert nothing.contains(np.zeros(6)) and not nothing.contains((0, 0, 1, 0, 0, 0)) and len(nothing.equalities) == 6
    assert np.allclose(wrench_cone(state, [*soles, fists]).faces, wrench_cone(state, soles).faces)


def test_bad_input_is_refused(talos):
    """Circular cones have no faces; wrenches are six numbers."""
    state = talos.standing()
    with pytest.raises(rbd.InputError, match="no faces"):
        wrench_cone(state, talos.soles(), friction="cone")
    with pytest.raises(rbd.InputError, match="rays"):
        wrench_cone(state, talos.soles(0.5, facets=100))
    with pytest.raises(rbd.InputError):
        wrench_cone(state, [])
    with pytest.raises(rbd.InputError, match="six"):
        wrench_cone(state, talos.soles()).contains((1, 2, 3))
