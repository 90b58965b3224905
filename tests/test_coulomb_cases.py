"""Published and closed-form contact cases under Coulomb's law; g = 9.81."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.model.checked_model import CheckedModel
from rbd.testing import box

URDF = Path(__file__).parent.parent / "urdf"
G = 9.81
STILL = 1e-8
"""Accelerations below this [m/s2] are rest; the thresholds are approached to 1e-6 of their value."""
COULOMB = rbd.ConeSolver(law="coulomb")


def _at(robot, position=(0.0, 0.0, 0.0), pitch=0.0, v=None) -> rbd.State:
    """A free body with its frame at `position`, its x axis raised by `pitch`; v as (linear in W, angular in W)."""
    R = pin.exp3(np.array([0.0, -pitch, 0.0]))
    q = pin.SE3ToXYZQUAT(pin.SE3(R, np.asarray(position, float)))
    local = None if v is None else np.concatenate([R.T @ np.asarray(v[0], float), R.T @ np.asarray(v[1], float)])
    return rbd.State(robot, q, local)


def _sole(frame: str, half, depth: float, friction) -> rbd.SurfaceContact:
    X = pin.SE3(np.eye(3), np.array([0.0, 0.0, -depth]))
    return rbd.SurfaceContact("floor", frame, half_lengths=half, placement=X, friction=friction)


def _ball(radius=0.1, mass=2.0) -> CheckedModel:
    """A solid ball, free."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root_joint")
    model.appendBodyToJoint(joint, pin.Inertia.FromSphere(mass, radius), pin.SE3.Identity())
    model.addBodyFrame("ball", joint, pin.SE3.Identity(), 0)
    return CheckedModel(model, name="ball")


class TestSlippingBox:
    """10 kg, mu = 0.6, pushed along the floor through its middle. Source: closed form; the project's cases."""

    def push(self, force, contacts=None, law="coulomb") -> rbd.Solution:
        """On one patch, or on what is given."""
        state = _at(rbd.load_robot(URDF / "box.urdf"), (0.0, 0.0, 0.1))
        contacts = contacts or [_sole("box", (0.2, 0.2), 0.1, 0.6)]
        return rbd.solve(state, np.zeros(0), contacts, external=rbd.ExternalForce("box", force), solver=rbd.ConeSolver(law=law))

    def corners(self) -> list[rbd.PointContact]:
        """Four points in place of the patch."""
        at = [(1, 1), (1, -1), (-1, -1), (-1, 1)]
        return [
            rbd.PointContact(f"corner{i}", "box", offset=(0.2 * x, 0.2 * y, -0.1), friction=0.6) for i, (x, y) in enumerate(at)
        ]

    @pytest.mark.parametrize("direction", [0.0, 0.3, np.pi / 4, 2.0, -1.1])
    def test_it_slides_at_the_same_rate_in_every_direction(self, direction):
        """80 N: (80 - 0.6 m g) / m = 2.114 m/s2 on 98.1 N, along the push, whatever its direction: the cone is round."""
        along = np.array([np.cos(direction), np.sin(direction), 0.0])
        for contacts in (None, self.corners()):
            s = self.push(80.0 * along, contacts)
            expected = (80.0 - 0.6 * 10 * G) / 10.0
            assert expected == pytest.approx(2.114) and s.law.kind == "coulomb" and s.status == "solved"
            assert s.a == pytest.approx([*(expected * along), 0.0, 0.0, 0.0], abs=1e-9)
            assert sum(c.normal for c in s.contacts.values()) == pytest.approx(98.1, abs=1e-8)
            assert sum(f[:3] for f in s.forces.values()) == pytest.approx([*(-0.6 * 10 * G * along)[:2], 98.1], abs=1e-8)

    def test_under_the_convex_law_it_lifts_off(self):
        """The round cone gives what the pyramid gives along its facet: N = (m g + mu F) / (1 + mu^2) = 107.43 N."""
        N = (10 * G + 0.6 * 80.0) / 1.36
        for contacts in (None, self.corners()):
            s = self.push((0.0, 80.0, 0.0), contacts, law="convex")
            assert str(s.law) == "convex" and s.a == pytest.approx([0, (80 - 0.6 * N) / 10, (N - 98.1) / 10, 0, 0, 0], abs=1e-9)

    def test_at_30_newtons_both_laws_hold_it(self):
        """0.6 m g = 58.86 N."""
        for law in ("convex", "coulomb"):
            s = self.push((30.0, 0.0, 0.0), law=law)
            assert np.abs(s.a).max() < STILL and s.forces["floor"][:3] == pytest.approx([-30.0, 0.0, 98.1], abs=1e-8)

    @pytest.mark.parametrize("sign", [-1, 1])
    def test_it_slips_at_mu_m_g_along_the_diagonal_too(self, sign):
        """Where four facets hold 136 %, the round cone holds 100 %."""
        push = 0.6 * 10 * G * (1 + sign * 1e-6) / np.sqrt(2)
        moves = np.abs(self.push((push, push, 0.0)).a).max()
        assert (moves < STILL) == (sign < 0) and (moves > 1e-6) == (sign > 0)


class TestCrate:
    """A crate b = 0.4, h = 1, m = 20, pushed at height 0.5. Source: closed form, moments about the front edge."""

    def push(self, push_N, friction) -> rbd.Solution:
        """Push at the middle."""
        state = _at(rbd.load_robot(URDF / "crate.urdf"), (0.0, 0.0, 0.5))
        floor = _sole("crate", (0.2, 0.2), 0.5, friction)
        push = rbd.ExternalForce("crate", (push_N, 0.0, 0.0))
        return rbd.solve(state, np.zeros(0), [floor], external=push, solver=COULOMB)

    def test_its_corner_forces_when_it_slides_under_80_N(self):
        """Mu = 0.3: 171.675 N on the front edge, 24.525 N on the rear one, and (80 - 58.86) / 20 m/s2."""
        s = self.push(80.0, 0.3)
        corners = s.corner_forces["floor"]
        at = rbd.SurfaceContact("x", "crate", half_lengths=(0.2, 0.2)).corners
        assert corners[at[:, 0] > 0, 2].sum() == pytest.approx(171.675, abs=1e-7)
        assert corners[at[:, 0] < 0, 2].sum() == pytest.approx(24.525, abs=1e-7)
        assert s.a == pytest.approx([(80 - 58.86) / 20, 0, 0, 0, 0, 0], abs=1e-9)
        assert np.hypot(corners[:, 0], corners[:, 1]) == pytest.approx(0.3 * corners[:, 2], abs=1e-8)

    @pytest.mark.parametrize("sign", [-1, 1])
    def test_it_slides_at_mu_m_g_and_topples_at_m_g_b_over_two_h(self, sign):
        """58.86 N at mu = 0.3; 78.48 N on a rough floor."""
        near = 1 + sign * 1e-6
        slides, topples = self.push(58.86 * near, 0.3), self.push(78.48 * near, 0.8)
        if sign < 0:
            assert np.abs(slides.a).max() < STILL and np.abs(topples.a).max() < STILL
        else:
            assert slides.a[0] > 1e-6 and np.abs(slides.a[2:]).max() < STILL
            assert topples.a[4] > 1e-7

    def test_pushed_hard_on_a_rough_floor_it_turns_about_its_front_edge(self):
        """120 N at mu = 0.8: alpha = (F h/2 - m g b/2) / (I + m (b^2 + h^2) / 4), the front edge at rest."""
        s = self.push(120.0, 0.8)
        inertia = 20.0 * (0.4**2 + 1.0**2) / 12.0 + 20.0 * (0.2**2 + 0.5**2)
        assert s.a[4] == pytest.approx((120.0 * 0.5 - 20 * G * 0.2) / inertia, rel=1e-9)


class TestIncline:
    """A block and a ball on a slope. Source: Newton's law along the slope."""

    def block(self, angle, friction, speed=0.0) -> rbd.Solution:
        """A box lying on a slope that rises along x, moving along x with `speed`."""
        up = np.array([np.cos(angle), 0.0, np.sin(angle)])
        state = _at(rbd.load_robot(URDF / "box.urdf"), (0.0, 0.0, 1.0), angle, (speed * up, np.zeros(3)))
        return rbd.solve(state, np.zeros(0), [_sole("box", (0.2, 0.2), 0.1, friction)], solver=COULOMB)

    @pytest.mark.parametrize("sign", [-1, 1])
    def test_a_block_stays_up_to_the_friction_angle(self, sign):
        """tan(alpha) = mu."""
        a = self.block(np.arctan(0.6) * (1 + sign * 1e-6), 0.6).a
        assert (np.abs(a).max() < STILL) == (sign < 0)

    @pytest.mark.parametrize("friction", [0.3, 0.5])
    def test_a_block_thrown_up_is_braked_by_weight_and_friction(self, friction):
        """v0 = 3, 25 deg: -g (sin + mu cos); from there v0 / |a| = 0.3491895 s and v0^2 / 2|a| = 0.5237842 m at mu = 0.5."""
        angle = np.deg2rad(25.0)
        s = self.block(angle, friction, 3.0)
        assert s.a == pytest.approx([-G * (np.sin(angle) + friction * np.cos(angle)), 0, 0, 0, 0, 0], abs=1e-9)
        if friction == 0.5:
            assert 3.0 / -s.a[0] == pytest.approx(0.3491895, abs=5e-8) and 4.5 / -s.a[0] == pytest.approx(0.5237842, abs=5e-8)
            assert np.abs(self.block(angle, friction).a).max() < STILL  # and stays
        else:  # comes back: v^2 = 2 (g sin - mu g cos) times the way up
            back = self.block(angle, friction).a[0]
            assert np.sqrt(2 * -back * 4.5 / -s.a[0]) == pytest.approx(1.3975772, abs=5e-8)
            assert self.block(angle, friction, -1.0).a[0] == pytest.approx(back, rel=1e-9)

    @pytest.mark.parametrize("sign", [-1, 1])
    def test_a_ball_rolls_while_friction_is_two_sevenths_of_the_slope(self, sign):
        """0.494872 at 60 deg: below, it slips from rest; above, it rolls with 5/7 g sin."""
        angle, radius = np.deg2rad(60.0), 0.1
        threshold = 2.0 / 7.0 * np.tan(angle)
        assert threshold == pytest.approx(0.494872, abs=5e-7)
        normal = np.array([-np.sin(angle), 0.0, np.cos(angle)])
        touch = rbd.PointContact(
            "slope", "ball", offset=-radius * normal, on=rbd.Ground(normal=normal), friction=threshold * (1 + sign * 1e-6)
        )
        s = rbd.solve(_at(_ball(radius)), np.zeros(0), [touch], solver=COULOMB)
        slip = float(np.hypot(*s.accelerations["slope"][:2]))
        assert (slip < STILL) == (sign > 0) and (slip > 1e-6) == (sign < 0)
        if sign > 0:
            assert np.linalg.norm(s.a[:3]) == pytest.approx(5.0 / 7.0 * G * np.sin(angle), rel=1e-9)


def test_a_sliding_ball_is_braked_and_spun_up():
    """A = -mu g and alpha = 5 mu g / 2 r until 2 v0 / 7 mu g, when v = 5/7 v0 = w r. Source: closed form."""
    mu, radius, v0 = 0.3, 0.1, 2.0
    touch = rbd.PointContact("floor", "ball", offset=(0.0, 0.0, -radius), friction=mu)
    state = _at(_ball(radius), (0.0, 0.0, radius), v=((v0, 0.0, 0.0), np.zeros(3)))
    s = rbd.solve(state, np.zeros(0), [touch], solver=COULOMB)
    assert s.a == pytest.approx([-mu * G, 0.0, 0.0, 0.0, 2.5 * mu * G / radius, 0.0], abs=1e-9)
    t = 2 * v0 / (7 * mu * G)
    v, w = v0 + s.a[0] * t, s.a[4] * t
    assert v == pytest.approx(5 / 7 * v0) and v == pytest.approx(w * radius)


class TestTable:
    """Legs at (+-0.6, +-0.4), weight 400 N, in the order (++, +-, -+, --). Source: the project's cases, by hand."""

    def forces(self, com, friction=0.5) -> np.ndarray:
        """The legs' forces of a table that stands."""
        robot = box(400.0 / G, (1.2, 0.8, 0.1))
        feet = [(0.6, 0.4), (0.6, -0.4), (-0.6, 0.4), (-0.6, -0.4)]
        legs = [
            rbd.PointContact(f"leg{i}", "box", offset=(x - com[0], y - com[1], -0.7), friction=friction)
            for i, (x, y) in enumerate(feet)
        ]
        s = rbd.solve(_at(robot, (0.0, 0.0, 0.7)), np.zeros(0), legs, solver=COULOMB)
        assert np.abs(s.a).max() < STILL
        return np.array([s.forces[leg.name] for leg in legs])

    def test_the_forces_returned_are_those_of_least_norm(self):
        """Centre of mass at (0.15, -0.1): (100, 150, 50, 100) N."""
        f = self.forces((0.15, -0.1))
        assert f[:, 2] == pytest.approx([100, 150, 50, 100], abs=1e-6) and np.abs(f[:, :2]).max() < 1e-6

    def test_no_leg_pulls_where_least_norm_without_cones_would(self):
        """Centre of mass at (0.45, 0.2): without cones leg -- takes -25 N; with them it carries nothing.

        The other three are then given by statics: (++) 250, (+-) 100, (-+) 50 N.
        """
        f = self.forces((0.45, 0.2))
        assert f[:, 2] == pytest.approx([250.0, 100.0, 50.0, 0.0], abs=1e-6)


class TestLadder:
    """A ladder leant against a wall. Source: statics of a uniform rod; the project's cases."""

    @pytest.mark.parametrize(("floor", "wall", "expected_deg"), [(0.4, 0.0, 51.3402), (0.4, 0.3, 47.7263), (0.2, 0.5, 66.0375)])
    def test_it_stands_down_to_the_friction_angle(self, floor, wall, expected_deg):
        """Floor mu1, wall mu2: tan(angle) = (1 - mu1 mu2) / (2 mu1), to a millionth of a radian."""
        angle = np.arctan((1 - floor * wall) / (2 * floor))
        assert np.rad2deg(angle) == pytest.approx(expected_deg, abs=5e-5)
        ladder = rbd.load_robot(URDF / "ladder.urdf")
        feet = [
            rbd.PointContact("floor", "ladder", offset=(-1.0, 0.0, 0.0), friction=floor),
            rbd.PointContact("wall", "ladder", offset=(1.0, 0.0, 0.0), on=rbd.Ground(normal=(-1.0, 0.0, 0.0)), friction=wall),
        ]

        def lean(th) -> rbd.Solution:
            return rbd.solve(_at(ladder, (-np.cos(th), 0.0, np.sin(th)), th), np.zeros(0), feet, solver=COULOMB)

        stands, falls = lean(angle + 1e-6), lean(angle - 1e-6)
        assert np.abs(stands.a).max() < STILL < 1e-7 < np.abs(falls.a).max()
        assert stands.forces["floor"] + stands.forces["wall"] == pytest.approx([0.0, 0.0, 10 * G], abs=1e-7)
