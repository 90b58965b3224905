"""Where a constraint force may live: projections, generators, pyramids, the wrench cone of a sole."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog, nnls

import rbd
from rbd.arrays import block_diagonal, cross_matrix
from rbd.problem.cones import HALF_LINE, LINE, Interval, Product, SecondOrderCone, check_friction, pyramid
from rbd.problem.force_set import at_rest

SOLE = np.array([[0.11, 0.05, 0.0], [0.11, -0.05, 0.0], [-0.11, -0.05, 0.0], [-0.11, 0.05, 0.0]])

CONES = {
    "free": rbd.problem.Free(3),
    "nonnegative": rbd.problem.NonNegative(3),
    "friction": rbd.problem.FrictionCone(0.6),
    "smooth": rbd.problem.FrictionCone(0.0),
    "box": rbd.problem.Bounds([-1.0, 0.0, -np.inf], [1.0, 0.5, 2.0]),
    "wrench": rbd.problem.WrenchCone(SOLE, 0.6),
    "product": rbd.problem.Product([rbd.problem.FrictionCone(0.3), rbd.problem.NonNegative(2), rbd.problem.Free(1)]),
}


MEMBERS = {
    "free": lambda f: True,
    "nonnegative": lambda f: f.min() >= 0.0,
    "friction": lambda f: np.hypot(f[0], f[1]) <= 0.6 * f[2] + 1e-15,
    "smooth": lambda f: f[0] == f[1] == 0.0 <= f[2],
    "box": lambda f: -1.0 <= f[0] <= 1.0 and 0.0 <= f[1] <= 0.5 and f[2] <= 2.0,
    "wrench": lambda f: caron(f, 0.11, 0.05, 0.6) >= -1e-12,
    "product": lambda f: np.hypot(f[0], f[1]) <= 0.3 * f[2] + 1e-15 and f[3:5].min() >= 0.0,
}
"""What each set is, in words of its own."""


@pytest.mark.parametrize("name", CONES)
def test_a_projection_keeps_members_and_makes_members(name, rng):
    """P(y) is in the set, and is y where y was in it."""
    cone, member = CONES[name], MEMBERS[name]
    for y in 2.0 * rng.normal(size=(100, cone.dim)):
        assert member(cone.project(y))
        if name != "wrench" and member(y):
            assert cone.project(y) == pytest.approx(y, abs=1e-14)


@pytest.mark.parametrize("name", CONES)
def test_a_projection_is_in_the_set_and_nearest(name, rng):
    """A point x = P(y) is nearest iff P(x) = x and (y - x) . (z - x) <= 0 for every z of the set."""
    cone = CONES[name]
    for y in rng.normal(size=(20, cone.dim)):
        x = cone.project(y)
        assert np.abs(cone.project(x) - x).max() < 1e-12
        others = [cone.project(z) for z in 2.0 * rng.normal(size=(20, cone.dim))]
        assert max((y - x) @ (z - x) for z in others) < 1e-12


@pytest.mark.parametrize("name", sorted(set(CONES) - {"box"}))
def test_a_projection_onto_a_cone_splits_by_moreau(name, rng):
    """Moreau: y = P(y) + n with P(y) . n = 0, n in the polar cone."""
    cone = CONES[name]
    for y in rng.normal(size=(20, cone.dim)):
        x = cone.project(y)
        assert abs(x @ (y - x)) < 1e-12


def test_the_friction_cone_is_coulombs(rng):
    """A force is its own projection exactly when |f_t| <= mu f_n."""
    for f in rng.normal(size=(200, 3)):
        inside = np.hypot(f[0], f[1]) <= 0.6 * f[2]
        assert inside == (np.abs(rbd.problem.FrictionCone(0.6).project(f) - f).max() == 0.0)


def test_projection_onto_the_friction_cone_agrees_with_a_general_minimiser(rng):
    """Closed form against nonnegative least squares on 1,024 rays of the cone."""
    cone = rbd.problem.FrictionCone(0.8)
    G = pyramid(0.8, 1024, inscribed=True)
    for y in rng.normal(size=(20, 3)):
        weights, distance = nnls(G, y)
        assert np.abs(G @ weights - cone.project(y)).max() < 1e-3
        gap = distance - np.linalg.norm(cone.project(y) - y)
        assert -1e-14 < gap < 2e-5 * np.linalg.norm(y)  # the pyramid lies 4e-6 inside


def test_generators_are_made_of_simple_parts():
    """K = G x product of parts: lines, half-lines, intervals, second-order cones; a smooth patch keeps its normals only."""
    kinds = {
        "free": [LINE] * 3,
        "nonnegative": [HALF_LINE] * 3,
        "friction": [SecondOrderCone],
        "box": [Interval] * 3,
        "wrench": [SecondOrderCone] * 4,
        "product": [SecondOrderCone, HALF_LINE, HALF_LINE, LINE],
    }
    for name, expected in kinds.items():
        G, parts = CONES[name].generators()
        assert [p if p in (LINE, HALF_LINE) else type(p) for p in parts] == expected
        assert G.shape == (CONES[name].dim, sum(p.dim for p in parts))
    G, parts = rbd.problem.WrenchCone(SOLE, 0.0).generators()
    assert list(parts) == [HALF_LINE] * 4 and G.shape == (6, 4)


@pytest.mark.parametrize("facets", [3, 4, 5, 8, 16])
def test_the_outer_pyramid_touches_the_cone_and_the_inner_one_is_inside(facets):
    """Rays at (2k + 1) pi / n with radius mu / cos(pi / n) outside, mu inside; facets touch the circle at 2 k pi / n."""
    mu = 0.7
    outer, inner = pyramid(mu, facets), pyramid(mu, facets, inscribed=True)
    angles = (2 * np.arange(facets) + 1) * np.pi / facets
    assert np.allclose(outer[:2], mu / np.cos(np.pi / facets) * np.array([np.cos(angles), np.sin(angles)]))
    middles = 0.5 * (outer + np.roll(outer, 1, axis=1))
    assert np.allclose(np.hypot(*middles[:2]), mu, rtol=1e-14)
    assert np.allclose(np.hypot(*inner[:2]), mu, rtol=1e-14)
    assert middles[:2, 0] == pytest.approx([mu, 0.0], abs=1e-14)  # the first facet is across the x axis


def test_four_facets_bound_each_tangent_by_itself(rng):
    """With n = 4 the pyramid reads |fx|, |fy| <= mu fz."""
    G = at_rest(rbd.problem.FrictionCone(0.6)).pyramids.G
    for f in rng.normal(size=(200, 3)):
        inside = max(abs(f[0]), abs(f[1])) <= 0.6 * f[2]
        assert inside == (nnls(G, f)[1] < 1e-9)


def test_rays_carry_bounds_and_facets():
    """Lines are free, rays nonnegative, intervals bounded; the facets that stand for circles are remembered."""
    R = at_rest(CONES["product"]).pyramids
    assert R.facets == (4,) and not R.bilateral and not R.has_intervals
    assert R.lower.tolist() == [0.0] * 6 + [-np.inf] and np.isposinf(R.upper).all()
    assert at_rest(rbd.problem.Free(2)).bilateral and at_rest(CONES["box"]).pyramids.has_intervals
    assert at_rest(rbd.problem.FrictionCone(0.6, facets=8)).pyramids.facets == (8,)
    assert not at_rest(rbd.problem.NonNegative(1)).pyramids.facets


def test_rays_of_a_cone_without_rows_are_none():
    """An inactive constraint has zero rows; its set has no rays."""
    assert at_rest(rbd.problem.Free(0)).pyramids.G.shape == (0, 0)
    assert at_rest(rbd.problem.NonNegative(0)).pyramids.G.shape == (0, 0)


def caron(w: np.ndarray, X: float, Y: float, mu: float) -> float:
    """Smallest slack of the published inequalities for a rectangular sole and square pyramids [N, N m].

    Source: S. Caron, Q.-C. Pham, Y. Nakamura, "Stability of Surface Contacts for Humanoid Robots: Closed-Form Formulae
    of the Contact Wrench Cone for Rectangular Support Areas", ICRA 2015.
    """
    fx, fy, fz, tx, ty, tz = w
    low = -mu * (X + Y) * fz + abs(Y * fx - mu * tx) + abs(X * fy - mu * ty)
    high = mu * (X + Y) * fz - abs(Y * fx + mu * tx) - abs(X * fy + mu * ty)
    return min(mu * fz - abs(fx), mu * fz - abs(fy), Y * fz - abs(tx), X * fz - abs(ty), tz - low, high - tz)


def test_the_wrench_cone_of_a_rectangular_sole_is_the_published_one(rng):
    """Membership by our rays equals the published inequalities on 600 random wrenches, and on their boundary."""
    X, Y, mu = 0.11, 0.05, 0.6
    cone = rbd.problem.WrenchCone(SOLE, mu)
    G = at_rest(cone).pyramids.G
    verdicts = []
    for _ in range(600):
        # Around the cone's middle, wide enough to be inside and outside about equally often.
        w = np.array([0.6, 0.6, 1.0, Y, X, mu * (X + Y)]) * np.r_[rng.uniform(-0.8, 0.8, 2), 1.0, rng.uniform(-0.8, 0.8, 3)]
        slack = caron(w, X, Y, mu)
        assert (nnls(G, w)[1] < 1e-12) == (slack >= 0.0)
        verdicts.append(slack >= 0.0)
        if slack >= 0.0:  # pushed along a random direction to the boundary: just inside is in, just outside is out
            d = rng.normal(size=6) * [1.0, 1.0, 0.0, Y, X, X + Y]
            low, high = 0.0, 10.0
            for _ in range(60):
                middle = 0.5 * (low + high)
                low, high = (middle, high) if caron(w + middle * d, X, Y, mu) >= 0.0 else (low, middle)
            assert nnls(G, w + low * (1 - 1e-3) * d)[1] < 1e-12
            assert nnls(G, w + low * (1 + 1e-3) * d)[1] > 1e-9
    assert 0.1 < np.mean(verdicts) < 0.9


def test_the_published_cone_bounds_every_ray_tightly():
    """Each of the 16 rays satisfies the published inequalities, and several of them with equality."""
    X, Y, mu = 0.11, 0.05, 0.6
    for ray in at_rest(rbd.problem.WrenchCone(SOLE, mu)).pyramids.G.T:
        assert abs(caron(ray, X, Y, mu)) < 1e-15


def test_a_smooth_patch_carries_what_its_normals_can(rng):
    """Without friction: no tangential force, no yaw moment, and the centre of pressure inside the corners' hull."""
    G = at_rest(rbd.problem.WrenchCone(SOLE, 0.0)).pyramids.G
    for cop in rng.uniform(-0.15, 0.15, size=(100, 2)):
        w = np.array([0.0, 0.0, 1.0, cop[1], -cop[0], 0.0])
        inside = abs(cop[0]) <= 0.11 and abs(cop[1]) <= 0.05
        assert inside == (nnls(G, w)[1] < 1e-12)
        assert nnls(G, w + [0.0, 0.0, 0.0, 0.0, 0.0, 1e-3])[1] > 1e-6


def test_the_inscribed_wrench_cone_satisfies_coulombs_law_at_the_corners(rng):
    """Any weights of the inscribed rays give corner forces in the true cones; the circumscribed ones may not."""
    inner, outer = pyramid(0.6, 4, inscribed=True), pyramid(0.6, 4)
    for w in rng.uniform(size=(50, 4)):
        f = inner @ w
        assert np.hypot(f[0], f[1]) <= 0.6 * f[2] * (1 + 1e-12)
    assert np.hypot(*outer[:2, 0]) == pytest.approx(0.6 * np.sqrt(2.0))  # 41 % beyond Coulomb on an edge


def test_a_wrench_is_the_sum_of_its_corner_forces(rng):
    """The corner map is p and c x p; its transpose takes an acceleration of the patch to those of the corners."""
    cone = rbd.problem.WrenchCone(SOLE, 0.6)
    p = rng.normal(size=(4, 3))
    wrench = cone.corner_map @ p.ravel()
    assert np.allclose(wrench, np.r_[p.sum(axis=0), np.cross(SOLE, p).sum(axis=0)])
    a, alpha = rng.normal(size=3), rng.normal(size=3)
    at_corners = (cone.corner_map.T @ np.r_[a, alpha]).reshape(4, 3)
    assert np.allclose(at_corners, a + np.cross(alpha, SOLE))


def test_membership_agrees_with_a_linear_program(rng):
    """Nonnegative least squares and HiGHS give one verdict on random wrenches."""
    G = at_rest(rbd.problem.WrenchCone(SOLE, 0.4)).pyramids.G
    for w in rng.normal(size=(60, 6)) * [0.3, 0.3, 1.0, 0.03, 0.06, 0.03] + [0, 0, 1.0, 0, 0, 0]:
        feasible = linprog(np.zeros(G.shape[1]), A_eq=G, b_eq=w, method="highs").status == 0
        assert feasible == (nnls(G, w)[1] < 1e-9)


def test_small_helpers_are_what_their_names_say(rng):
    """The cross matrix is the cross product; blocks go along the diagonal."""
    a, b = rng.normal(size=(2, 3))
    assert np.allclose(cross_matrix(a) @ b, np.cross(a, b))
    M = block_diagonal([np.ones((1, 2)), 2 * np.ones((2, 1))])
    assert M.tolist() == [[1, 1, 0], [0, 0, 2], [0, 0, 2]]


@pytest.mark.parametrize("mu", [-0.1, np.nan, np.inf, "0.5", True, [0.5]])
def test_a_friction_that_means_nothing_is_refused(mu):
    """Negative, not finite, not a number: an InputError that says what was expected."""
    with pytest.raises(rbd.InputError, match="friction"):
        check_friction(mu, 4)
    with pytest.raises(rbd.InputError, match="friction"):
        rbd.problem.FrictionCone(mu)


@pytest.mark.parametrize("facets", [2, 0, 4.0, True, "4"])
def test_a_pyramid_of_no_facets_is_refused(facets):
    """At least three, and whole."""
    with pytest.raises(rbd.InputError, match="facets"):
        rbd.problem.FrictionCone(0.5, facets)


def test_a_box_whose_bounds_cross_is_refused():
    """Bounds lo <= hi, of one length."""
    with pytest.raises(rbd.InputError, match="lo <= hi"):
        rbd.problem.Bounds([1.0], [0.0])
    with pytest.raises(rbd.InputError, match="lo <= hi"):
        rbd.problem.Bounds([0.0, 0.0], [1.0])
    with pytest.raises(rbd.InputError, match="lo <= hi"):
        rbd.problem.Bounds([np.nan], [1.0])


def test_a_set_of_no_forces_has_no_rays() -> None:
    """Zero components: no columns, and no normals among them."""
    found = at_rest(Product(())).pyramids
    assert found.G.shape == (0, 0) and found.normals.shape == (0, 0) and found.sums(np.zeros((3, 0))).shape == (3, 0)
