"""Contact cases with a published or closed-form answer; g = 9.81."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.testing import box

URDF = Path(__file__).parent.parent / "urdf"
G = 9.81
STILL = 1e-8
"""Accelerations below this [m/s2] are rest; the thresholds are approached to 1e-6 of their value."""


def _at(robot, position, pitch=0.0, v=None) -> rbd.State:
    """A free body with its frame at `position`, its x axis raised by `pitch`; v as (linear in W, angular in W)."""
    R = pin.exp3(np.array([0.0, -pitch, 0.0]))
    q = pin.SE3ToXYZQUAT(pin.SE3(R, np.asarray(position, float)))
    local = None if v is None else np.concatenate([R.T @ np.asarray(v[0], float), R.T @ np.asarray(v[1], float)])
    return rbd.State(robot, q, local)


def _patch(frame: str, half, depth: float, friction, facets=4) -> rbd.SurfaceContact:
    X = pin.SE3(np.eye(3), np.array([0.0, 0.0, -depth]))
    return rbd.SurfaceContact("floor", frame, half_lengths=half, placement=X, friction=friction, facets=facets)


@pytest.fixture(scope="module")
def crate_10kg() -> rbd.State:
    """The 10 kg box on the floor."""
    return _at(rbd.load_robot(URDF / "box.urdf"), (0.0, 0.0, 0.1))


def _push(state, force, friction=0.6, facets=4) -> rbd.Solution:
    floor = _patch("box", (0.2, 0.2), 0.1, friction, facets)
    return rbd.solve(state, np.zeros(0), [floor], external=rbd.ExternalForce("box", force), solver=rbd.ProxQP())


def test_slipping_box_lifts_off_under_the_convex_law(crate_10kg):
    """10 kg, mu = 0.6, 80 N: N = (m g + mu F) / (1 + mu^2) = 107.4 N, upwards at 0.933 m/s2; at 30 N it sticks.

    Source: closed form of the associated law along a facet; Coulomb's box would slide at 2.114 m/s2 with 98.1 N.
    """
    slips = _push(crate_10kg, (80.0, 0.0, 0.0))
    N = (10 * G + 0.6 * 80.0) / 1.36
    assert N == pytest.approx(107.4, abs=0.05) and slips.a[2] == pytest.approx(0.933, abs=5e-4)
    assert slips.forces["floor"][:3] == pytest.approx([-0.6 * N, 0.0, N], abs=1e-8)
    assert slips.a == pytest.approx([(80 - 0.6 * N) / 10, 0, (N - 10 * G) / 10, 0, 0, 0], abs=1e-9)
    assert "convex" in str(slips.law) and slips.contacts["floor"].friction_used == pytest.approx(1.0)
    sticks = _push(crate_10kg, (30.0, 0.0, 0.0))
    assert np.abs(sticks.a).max() < STILL
    assert sticks.forces["floor"][:3] == pytest.approx([-30.0, 0.0, 10 * G], abs=1e-8)


def test_four_facets_hold_a_diagonal_push_that_eight_do_not(crate_10kg):
    """80 N across the diagonal: |fx|, |fy| = 56.6 < 58.86 N hold with 4 facets; 8 have a facet there, at 58.86 N.

    Documented: a circumscribed pyramid admits up to mu / cos(pi / n), and `friction_used` says 136 %.
    """
    push = 80.0 / np.sqrt(2.0) * np.array([1.0, 1.0, 0.0])
    four, eight = _push(crate_10kg, push), _push(crate_10kg, push, facets=8)
    assert np.abs(four.a).max() < STILL and four.contacts["floor"].friction_used == pytest.approx(80 / 58.86)
    assert eight.a[0] > 0.1 and eight.a[2] > 0.1
    assert "4 facets" in str(four.law) and "8 facets" in str(eight.law)


@pytest.mark.parametrize("facets", [3, 4, 6, 8, 16])
def test_the_pyramids_verdict_is_exact_in_every_direction(crate_10kg, facets, rng):
    """Against phi a pyramid gives up to mu m g / max_k cos(phi + pi - 2 pi k / n), to a millionth."""
    for phi in rng.uniform(0.0, 2.0 * np.pi, 6):
        reach = np.cos(phi + np.pi - 2.0 * np.pi * np.arange(facets) / facets).max()
        threshold = 0.6 * 10 * G / reach
        along = np.array([np.cos(phi), np.sin(phi), 0.0])
        holds, slips = (_push(crate_10kg, f * threshold * along, facets=facets) for f in (1 - 1e-6, 1 + 1e-6))
        assert np.abs(holds.a).max() < STILL < 1e-6 < np.abs(slips.a).max()


def test_a_box_pulled_up_leaves_the_floor_without_a_force(crate_10kg):
    """200 N up: a_z = (200 - m g) / m, and nothing holds it back."""
    s = _push(crate_10kg, (0.0, 0.0, 200.0))
    assert not s.forces["floor"].any() and s.a[2] == pytest.approx(20 - G)
    assert s.contacts["floor"].centre_of_pressure is None


@pytest.mark.parametrize("sign", [-1, 1])
def test_a_block_stays_on_an_incline_up_to_the_friction_angle(sign):
    """It sticks while tan(alpha) <= mu, and slips beyond."""
    angle = np.arctan(0.6) * (1 + sign * 1e-6)
    state = _at(rbd.load_robot(URDF / "box.urdf"), (0.0, 0.0, 1.0), pitch=angle)
    a = rbd.solve(state, np.zeros(0), [_patch("box", (0.2, 0.2), 0.1, 0.6)]).a
    assert (np.abs(a).max() < STILL) == (sign < 0)


@pytest.fixture(scope="module")
def state() -> rbd.State:
    """The tall crate, standing."""
    return _at(rbd.load_robot(URDF / "crate.urdf"), (0.0, 0.0, 0.5))


class TestCrate:
    """A crate b = 0.4, h = 1, m = 20, pushed at height 0.5. Source: closed form, moments about the front edge."""

    def solve(self, state, push_N, friction, **law) -> rbd.Solution:
        """Push at the middle."""
        floor = _patch("crate", (0.2, 0.2), 0.5, friction)
        return rbd.solve(state, np.zeros(0), [floor], external=rbd.ExternalForce("crate", (push_N, 0.0, 0.0)), **law)

    def test_it_slides_at_mu_m_g(self, state):
        """At mu = 0.3: 58.86 N."""
        threshold = 0.3 * 20 * G
        assert threshold == pytest.approx(58.86)
        assert np.abs(self.solve(state, threshold * (1 - 1e-6), 0.3).a).max() < STILL
        slides = self.solve(state, threshold * (1 + 1e-6), 0.3).a
        assert slides[0] > 1e-6 and np.abs(slides[3:]).max() < STILL

    def test_it_topples_at_m_g_b_over_two_h(self, state):
        """On a rough floor: 78.48 N; the centre of pressure is then at the front edge."""
        threshold = 20 * G * 0.2 / 0.5
        assert threshold == pytest.approx(78.48)
        stands = self.solve(state, threshold * (1 - 1e-6), 0.8)
        assert np.abs(stands.a).max() < STILL
        assert stands.contacts["floor"].centre_of_pressure == pytest.approx([0.2, 0.0, 0.0], abs=1e-6)
        topples = self.solve(state, threshold * (1 + 1e-6), 0.8)
        assert topples.a[4] > 1e-7

    def test_its_corner_forces_when_it_slides_under_80_N(self, state):
        """Convex law: 176.77 N on the front edge, 25.25 N on the rear one (Coulomb's: 171.675 and 24.525)."""
        coulomb = self.solve(state, 80.0, 0.3).corner_forces["floor"]
        s = self.solve(state, 80.0, 0.3, solver=rbd.ProxQP())
        corners = s.corner_forces["floor"]
        at = rbd.SurfaceContact("x", "crate", half_lengths=(0.2, 0.2)).corners
        assert corners[at[:, 0] > 0, 2].sum() == pytest.approx(176.77, abs=0.01)
        assert corners[at[:, 0] < 0, 2].sum() == pytest.approx(25.25, abs=0.01)
        assert coulomb[at[:, 0] > 0, 2].sum() == pytest.approx(171.675) and coulomb[at[:, 0] < 0, 2].sum() == pytest.approx(
            24.525
        )
        N = (20 * G + 0.3 * 80) / 1.09
        front = 0.5 * N + 0.3 * N * 0.5 / 0.4
        assert corners[at[:, 0] > 0, 2].sum() == pytest.approx(front, rel=1e-9)
        assert corners.sum(axis=0) == pytest.approx(s.forces["floor"][:3], abs=1e-9)


class TestTable:
    """Legs at (+-0.6, +-0.4), weight 400 N, in the order (++, +-, -+, --). Source: cases of the project, by hand."""

    def legs(self, com, friction) -> list[rbd.PointContact]:
        """The four feet, 0.7 m below the centre of mass."""
        feet = [(0.6, 0.4), (0.6, -0.4), (-0.6, 0.4), (-0.6, -0.4)]
        return [
            rbd.PointContact(f"leg{i}", "box", offset=(x - com[0], y - com[1], -0.7), friction=friction)
            for i, (x, y) in enumerate(feet)
        ]

    def solve(self, com, friction, solver) -> rbd.Solution:
        """At rest, held or rubbing."""
        robot = box(400.0 / G, (1.2, 0.8, 0.1))
        return rbd.solve(_at(robot, (0.0, 0.0, 0.7)), np.zeros(0), self.legs(com, friction), solver=solver)

    def test_the_least_forces_are_the_published_ones(self):
        """Centre of mass at (0.15, -0.1): (100, 150, 50, 100) N, by KKT; 12 rows of rank 6."""
        s = self.solve((0.15, -0.1), None, rbd.KKT())
        forces = np.array([s.forces[f"leg{i}"] for i in range(4)])
        assert forces[:, 2] == pytest.approx([100, 150, 50, 100], abs=1e-9)
        assert np.abs(forces[:, :2]).max() < 1e-9 and np.abs(s.a).max() < STILL
        assert s.problem.m == 12 and s.rank == 6

    def test_a_minimum_norm_leg_may_pull_though_the_table_stands(self):
        """Centre of mass at (0.45, 0.2), inside the feet: the held leg -- takes -25 N; legs that only push stand too."""
        held = self.solve((0.45, 0.2), None, rbd.KKT())
        assert held.forces["leg3"][2] == pytest.approx(-25.0, abs=1e-9)
        for friction in (0.0, 0.5):
            pushed = self.solve((0.45, 0.2), friction, rbd.ProxQP())
            normal = np.array([pushed.forces[f"leg{i}"][2] for i in range(4)])
            assert np.abs(pushed.a).max() < STILL and normal.min() > -1e-13  # rounding of 250 N
            assert normal.sum() == pytest.approx(400.0) and normal @ [0.6, 0.6, -0.6, -0.6] == pytest.approx(180.0)

    def test_a_table_whose_mass_is_beyond_its_feet_falls(self):
        """Centre of mass at (0.65, 0): it turns about the front legs."""
        s = self.solve((0.65, 0.0), 0.5, rbd.ProxQP())
        assert s.a[4] > 0.1 and s.forces["leg2"][2] == s.forces["leg3"][2] == 0.0


@pytest.fixture(scope="module")
def ladder() -> rbd.Robot:
    """2 m, 10 kg."""
    return rbd.load_robot(URDF / "ladder.urdf")


class TestLadder:
    """A ladder leant against a wall. Source: statics of a uniform rod; the cases of the project."""

    def lean(self, ladder, angle, floor, wall, rate=0.0) -> rbd.Solution:
        """At `angle` from the floor, sliding down with `rate` (its foot out, its head down)."""
        c, s = np.cos(angle), np.sin(angle)
        v = (np.array([-s, 0.0, -c]) * rate, np.array([0.0, rate, 0.0]))
        feet = [
            rbd.PointContact("floor", "ladder", offset=(-1.0, 0.0, 0.0), friction=floor),
            rbd.PointContact("wall", "ladder", offset=(1.0, 0.0, 0.0), on=rbd.Ground(normal=(-1.0, 0.0, 0.0)), friction=wall),
        ]
        return rbd.solve(_at(ladder, (-c, 0.0, s), angle, v), np.zeros(0), feet)

    @pytest.mark.parametrize(
        ("floor", "wall", "expected_deg"),
        [(0.4, 0.0, 51.3402), (0.4, 0.3, 47.7263), (0.25, 0.0, 63.4349), (0.2, 0.5, 66.0375)],
    )
    def test_it_stands_down_to_the_friction_angle(self, ladder, floor, wall, expected_deg):
        """Floor mu1, wall mu2: tan(angle) = (1 - mu1 mu2) / (2 mu1), to a millionth of a radian."""
        angle = np.arctan((1 - floor * wall) / (2 * floor))
        assert np.rad2deg(angle) == pytest.approx(expected_deg, abs=5e-5)
        stands, falls = self.lean(ladder, angle + 1e-6, floor, wall), self.lean(ladder, angle - 1e-6, floor, wall)
        assert np.abs(stands.a).max() < STILL < 1e-7 < np.abs(falls.a).max()
        total = stands.forces["floor"] + stands.forces["wall"]
        assert total == pytest.approx([0.0, 0.0, 10 * G], abs=1e-7)
        assert stands.forces["wall"][0] < 0.0  # the wall pushes the ladder away from itself

    @pytest.mark.parametrize("sign", [-1, 1])
    def test_sliding_down_it_leaves_the_wall_at_two_thirds_of_its_height(self, ladder, sign):
        """Smooth floor and wall, from rest at 60 deg: it leaves at sin(th) = 2/3 sin(60 deg); the floor bears m g / 4.

        The rate comes from energy: rate^2 = m g L/2 (sin 60 - sin th) / (1/2 (I + m L^2/4)), L = 2. The angle is the same
        for any I; m g / 4 is that of a thin rod, and this one is 4 cm thick: I is 4e-4 above m L^2 / 12.
        """
        start = np.pi / 3
        leaves = np.arcsin(2.0 / 3.0 * np.sin(start))
        angle = leaves - sign * 1e-5
        inertia = 10.0 * (4.0 + 0.04**2) / 12.0
        rate = np.sqrt(2 * 10 * G * (np.sin(start) - np.sin(angle)) / (inertia + 10.0))
        s = self.lean(ladder, angle, 0.0, 0.0, rate)
        assert (s.forces["wall"][0] == 0.0) == (sign > 0)
        assert s.forces["floor"][2] == pytest.approx(10 * G / 4, rel=1e-3)


@pytest.mark.parametrize("angle_deg", [10.0, 48.18969, 60.0, 70.52878, 80.0])
def test_the_foot_force_of_a_falling_rod(angle_deg):
    """From upright, foot held: fx = 3/4 m g sin(3 cos - 2), fz = 1/4 m g (3 cos - 1)^2; signs change at 48.19, 70.53 deg.

    Source: energy and Newton for a thin rod of length L, th from the vertical: th'^2 = 3 g / L (1 - cos th). J_dot v is
    -th'^2 L/2 along the rod.
    """
    angle, L = np.deg2rad(angle_deg), 2.0
    rod = box(10.0, (L, 1e-5, 1e-5))
    rate = np.sqrt(3 * G / L * (1 - np.cos(angle)))
    out = np.array([np.sin(angle), 0.0, np.cos(angle)])
    across = np.array([np.cos(angle), 0.0, -np.sin(angle)])
    state = _at(rod, out, np.pi / 2 - angle, (across * rate, (0.0, rate, 0.0)))
    foot = rbd.PointContact("foot", "box", offset=(-1.0, 0.0, 0.0))
    c, s = np.cos(angle), np.sin(angle)
    expected = 10 * G * np.array([0.75 * s * (3 * c - 2), 0.0, 0.25 * (3 * c - 1) ** 2])
    for solver in (rbd.ProxQP(), rbd.KKT()):
        force = rbd.solve(state, np.zeros(0), [foot], solver=solver).forces["foot"]
        assert force == pytest.approx(expected, abs=1e-6)
