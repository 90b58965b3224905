"""At the limit of friction, and at the limits of work: exact forces, or a word that they were not found.

Each limit of `rbd.problem.programs` is reached on purpose; what then comes back is an answer with its certificate, our own
error, or NaN that is printed as "?" and told by `found`.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from work import calls

import rbd
from rbd.answers.analysis import extent, force_choice
from rbd.answers.analysis.admissible_forces import admissible
from rbd.errors import CannotHold, InputError, NoSolution, RbdError
from rbd.model.checked_model import CheckedModel
from rbd.problem import programs
from rbd.solvers import conic_newton
from rbd.statics.least_effort import LeastEffort
from rbd.testing import box

URDF = Path(__file__).parents[2] / "urdf"
G = 9.81
MINIMUM_NORM = "minimum norm of the corner forces [N]"
LAWS = [rbd.ConeSolver(law="coulomb"), rbd.ConeSolver(law="convex"), rbd.ProxQP()]
IDS = ["coulomb", "convex", "pyramids"]


def at(robot, position, pitch=0.0) -> rbd.State:
    """A free body with its frame at `position`, its x axis raised by `pitch`."""
    R = pin.exp3(np.array([0.0, -pitch, 0.0]))
    return rbd.State(robot, pin.SE3ToXYZQUAT(pin.SE3(R, np.asarray(position, float))))


def chain(masses, joint=pin.JointModelRY) -> CheckedModel:
    """A free body and links that turn, 0.3 m long each."""
    model = pin.Model()
    j = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root_joint")
    model.appendBodyToJoint(j, pin.Inertia.FromBox(masses[0], 0.3, 0.2, 0.1), pin.SE3.Identity())
    model.addBodyFrame("l0", j, pin.SE3.Identity(), 0)
    for i, mass in enumerate(masses[1:], 1):
        j = model.addJoint(j, joint(), pin.SE3(np.eye(3), np.array([0.3, 0.0, 0.0])), f"j{i}")
        model.appendBodyToJoint(j, pin.Inertia.FromBox(mass, 0.3, 0.1, 0.1), pin.SE3(np.eye(3), np.array([0.15, 0.0, 0.0])))
        model.addBodyFrame(f"l{i}", j, pin.SE3.Identity(), 0)
    return CheckedModel(model, name="chain")


def points(offsets, friction, frames=("box",)) -> list[rbd.PointContact]:
    """Points of a body, or of several in turn."""
    return [
        rbd.PointContact(f"p{i}", frames[i % len(frames)], offset=tuple(map(float, x)), friction=friction)
        for i, x in enumerate(offsets)
    ]


class TestLadder:
    """Rough at both ends, at its limiting angle tan th = (1 - mu1 mu2) / (2 mu1): both forces stand at their cones' edges.

    Closed form: N1 = m g / (1 + mu1 mu2) on the floor, N2 = mu1 N1 at the wall. Source: statics of a uniform rod; cases of the
    project (47.7263 deg at 0.4 / 0.3).
    """

    @pytest.mark.parametrize(("floor", "wall"), [(0.4, 0.3), (0.2, 0.5), (0.25, 0.1), (0.6, 0.9)])
    @pytest.mark.parametrize("solver", LAWS, ids=IDS)
    @pytest.mark.parametrize("beyond", [0.0, 1e-12, 1e-10, 1e-9, 1e-8])
    def test_it_stands_at_its_limiting_angle(self, floor, wall, solver, beyond):
        """Up to 1e-8 rad steeper, the forces move by as much; the ladder stands, under each law."""
        th = math.atan((1.0 - floor * wall) / (2.0 * floor)) + beyond
        feet = [
            rbd.PointContact("floor", "ladder", offset=(-1.0, 0.0, 0.0), friction=floor),
            rbd.PointContact("wall", "ladder", offset=(1.0, 0.0, 0.0), on=rbd.Ground(normal=(-1.0, 0.0, 0.0)), friction=wall),
        ]
        state = at(rbd.load_robot(URDF / "ladder.urdf"), (-math.cos(th), 0.0, math.sin(th)), th)
        s = rbd.solve(state, np.zeros(0), feet, solver=solver)
        N1 = 10.0 * G / (1.0 + floor * wall)
        assert s.status == "solved" and np.abs(s.a).max() < 1e-9
        assert s.forces["floor"] == pytest.approx([floor * N1, 0.0, N1], abs=1e-5)
        assert s.forces["wall"] == pytest.approx([-floor * N1, 0.0, wall * floor * N1], abs=1e-5)
        u = s.uniqueness()
        assert u.found and u.contacts["floor"].normal.highest == pytest.approx(N1, abs=1e-4)


@pytest.mark.parametrize("solver", LAWS[:2], ids=IDS[:2])
@pytest.mark.parametrize("facing", [0.0, 0.4, 2.0])
def test_a_box_pushed_with_mu_m_g_rests(solver, facing):
    """10 kg, mu = 0.6, 58.86 N: at the limit of every cone both laws keep it at rest, with mu N at each corner."""
    push = 0.6 * 10.0 * G * np.array([math.cos(facing), math.sin(facing), 0.0])
    feet = points([(x, y, 0.0) for x in (0.2, -0.2) for y in (0.2, -0.2)], 0.6)
    s = rbd.solve(at(box(), (0.0, 0.0, 0.1)), np.zeros(0), feet, external=rbd.ExternalForce("box", tuple(push)), solver=solver)
    assert s.status == "solved" and np.abs(s.a).max() < 1e-7
    for force in s.forces.values():
        assert np.hypot(*force[:2]) == pytest.approx(0.6 * force[2], abs=1e-6)
    assert sum(s.forces.values()) == pytest.approx([*-push[:2], 98.1], abs=1e-7)


@pytest.mark.parametrize("solver", LAWS[:2], ids=IDS[:2])
@pytest.mark.parametrize("push", [(0.0, 0.0, 0.0), (80.0, 0.0, 0.0), (30.0, 20.0, 0.0)])
@pytest.mark.parametrize("friction", [2.0, 1e4, 1e6])
def test_five_points_share_a_push_whatever_their_friction(solver, push, friction):
    """The corners and the middle of a box: a fifth of the push each, loads of least norm; nothing presses against another."""
    feet = points([(0.2, 0.2, -0.1), (0.2, -0.2, -0.1), (-0.2, -0.2, -0.1), (-0.2, 0.2, -0.1), (0, 0, -0.1)], friction)
    s = rbd.solve(at(box(), (0.0, 0.0, 0.1)), np.zeros(0), feet, external=rbd.ExternalForce("box", push), solver=solver)
    tipping = 0.1 / (4.0 * 0.2)
    for contact, (sx, sy) in zip(feet, [(1, 1), (1, -1), (-1, -1), (-1, 1), (0, 0)], strict=True):
        load = 98.1 / 5.0 + tipping * (sx * push[0] + sy * push[1])
        assert s.forces[contact.name] == pytest.approx([-push[0] / 5, -push[1] / 5, load], abs=1e-6)
    assert s.status == "solved" and np.abs(s.a).max() < 1e-9


@pytest.mark.filterwarnings("ignore::rbd.errors.InaccurateWarning")
@pytest.mark.parametrize("solver", LAWS, ids=IDS)
def test_a_light_chain_is_answered(solver):
    """Links of 1 kg to 1e-8 kg on points that repeat each other: an answer or our own error, and what is asked of it too."""
    robot = chain([1.0, 1e-3, 1e-6, 1e-8])
    for friction in (0.3, 1e6):
        offsets = [(0.1, 0.05, -0.05), (-0.1, 0.05, -0.05), (0.1, -0.05, -0.05), (0.1, 0.05, -0.05)] * 3
        contacts = points(offsets, friction, ("l0", "l1", "l2", "l3"))
        try:
            s = rbd.solve(rbd.State(robot, pin.neutral(robot.model)), np.full(robot.nu, 1e-4), contacts, solver=solver)
            assert s.status in ("solved", "inaccurate")
            s.uniqueness()
        except NoSolution as error:
            assert error.result is not None


@pytest.mark.parametrize("solver", LAWS, ids=IDS)
def test_twenty_points_in_one_place_on_four_links(solver):
    """Ranges of all; five of one link in one place share its load as they like: each from 0 to all of it."""
    robot = chain([1.0, 1.0, 1.0, 1.0])
    contacts = points([(0.1, 0.05, -0.1)] * 20, 0.6, ("l0", "l1", "l2", "l3"))
    s = rbd.solve(rbd.State(robot, pin.neutral(robot.model)), np.zeros(robot.nu), contacts, solver=solver)
    found = []
    assert calls(lambda: found.append(s.uniqueness())) < 1_500_000  # counted: 173,000 to 442,000
    [u] = found
    assert u.found and s.status == "solved"
    one = [u.contacts[f"p{i}"].normal for i in (0, 4, 8, 12, 16)]
    assert [r.highest for r in one] == pytest.approx([one[0].highest] * 5, abs=1e-6)
    assert [r.lowest for r in one] == pytest.approx([0.0] * 5, abs=1e-6)


@pytest.mark.parametrize("solver", LAWS, ids=IDS)
def test_a_hundred_points_are_quick(solver, rng):
    """Of a box on a hundred points, pushed until it slips: some 10,000 calls, forces of least norm."""
    feet = points([(*rng.uniform(-0.2, 0.2, 2), -0.1) for _ in range(100)], 0.6)
    state = at(box(), (0, 0, 0.1))

    def answered() -> None:
        for push in (30.0, 80.0):
            s = rbd.solve(state, np.zeros(0), feet, external=rbd.ExternalForce("box", (push, 0, 0)), solver=solver)
            assert s.status == "solved" and s.force_choice == MINIMUM_NORM
        rbd.hold(state, feet)

    assert calls(answered) < 250_000  # counted: 35,000 to 65,000


def sole(push=(20.0, 10.0, 0.0), solver=LAWS[0]) -> rbd.Solution:
    """A box on one patch."""
    X = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.1]))
    patch = rbd.SurfaceContact("floor", "box", half_lengths=(0.2, 0.2), placement=X, friction=0.6)
    return rbd.solve(at(box(), (0, 0, 0.1)), np.zeros(0), [patch], external=rbd.ExternalForce("box", push), solver=solver)


class TestFallbacks:
    """The second ways give what the first give."""

    @pytest.mark.parametrize("solver", LAWS, ids=IDS)
    @pytest.mark.parametrize("push", [(20.0, 10.0, 0.0), (58.0, 0.0, 0.0)])
    def test_linear_programs_and_the_barrier_reach_as_far_as_proximal_steps(self, monkeypatch, solver, push):
        """Each corner's range, to 1e-6 N."""
        s = sole(push, solver)
        first = s.uniqueness()
        monkeypatch.setattr(extent, "_PROXIMAL", ())
        second = s.uniqueness()
        assert first.found and second.found
        for one, other in zip(first.contacts["floor"].corners, second.contacts["floor"].corners, strict=True):
            assert (one.lowest, one.highest) == pytest.approx((other.lowest, other.highest), abs=1e-6)

    @pytest.mark.parametrize("push", [(20.0, 10.0, 0.0), (58.0, 0.0, 0.0), (0.0, 0.0, 0.0)])
    def test_the_barriers_shortest_forces_are_the_duals(self, monkeypatch, push):
        """To 1e-7 N."""
        s = sole(push)
        first = s.with_forces()
        monkeypatch.setattr(force_choice, "by_dual", lambda *_: None)
        second = s.with_forces()
        assert first.force_choice == second.force_choice == MINIMUM_NORM
        assert first.corner_forces["floor"] == pytest.approx(second.corner_forces["floor"], abs=1e-7)

    @pytest.mark.parametrize("solver", LAWS, ids=IDS)
    @pytest.mark.parametrize("push", [(20.0, 10.0, 0.0), (58.0, 0.0, 0.0), (0.0, 0.0, 0.0)])
    def test_the_shortest_forces_are_the_same_from_wherever_they_start(self, solver, push):
        """From the end of each corner's range, to 1e-6 N."""
        s = sole(push, solver)
        expected = s.with_forces().corner_forces["floor"]
        for corner in s.uniqueness().contacts["floor"].corners:
            for end in (corner.at_lowest, corner.at_highest):
                assert end is not None
                start = replace(s, multipliers=end.multipliers, weights=end.weights, chosen_corners=None)
                chosen = start.with_forces()
                assert chosen.force_choice == MINIMUM_NORM
                assert chosen.corner_forces["floor"] == pytest.approx(expected, abs=1e-6)

    def test_a_weight_that_mixes_corners_goes_by_the_barrier(self, rng):
        """A full matrix: no other admissible forces have a smaller value."""
        s = sole((55.0, 0.0, 0.0))
        A = rng.normal(size=(12, 12))
        W = A @ A.T + np.eye(12)
        chosen, plain = s.with_forces({"floor": W}), s.with_forces()
        value = [x.corner_forces["floor"].ravel() @ W @ x.corner_forces["floor"].ravel() for x in (chosen, plain)]
        assert chosen.force_choice == "minimum of the given weight" and value[0] < value[1]
        assert chosen.status == "solved"

    def test_where_cones_have_no_inside_the_ends_are_those_of_proximal_steps(self, monkeypatch):
        """At mu m g each corner can only push along the edge of its cone."""
        s = sole((0.6 * 98.1, 0.0, 0.0))
        expected = s.uniqueness().contacts["floor"].corners
        monkeypatch.setattr(extent, "_PROXIMAL", ())
        for one, other in zip(s.uniqueness().contacts["floor"].corners, expected, strict=True):
            assert (one.lowest, one.highest) == pytest.approx((other.lowest, other.highest), abs=1e-8)

    def test_what_is_found_with_widened_cones_is_said_to_be_so(self, monkeypatch):
        """Where Clarabel finds nothing over the set itself, cones are widened by 1e-10, and the table says it."""
        s = sole()
        expected = s.uniqueness().contacts["floor"].corners
        monkeypatch.setattr(extent, "_PROXIMAL", ())
        asked = []

        def gives_up_once(program):
            asked.append(program)
            found = conic_newton.interior_point(program)
            return replace(found, x=np.full_like(found.x, 1e3)) if len(asked) % 2 else found

        monkeypatch.setattr(extent, "interior_point", gives_up_once)
        u = s.uniqueness()
        assert not u.exact and "no interior" in str(u)
        for one, other in zip(u.contacts["floor"].corners, expected, strict=True):
            assert (one.lowest, one.highest) == pytest.approx((other.lowest, other.highest), abs=1e-7)


class TestWork:
    """Limits that are reached are told."""

    @pytest.mark.parametrize("solver", LAWS, ids=IDS)
    def test_ranges_that_were_not_found_say_so(self, monkeypatch, solver):
        """NaN, "?", `found` False, and no forces that attain them; the value returned stays."""
        monkeypatch.setattr("rbd.answers.analysis.uniqueness.ENDS_WORK", -1.0)
        u = sole(solver=solver).uniqueness()
        r = u.contacts["floor"].corners[0]
        assert not u.found and not r.found and math.isnan(r.lowest) and math.isnan(r.highest)
        assert r.at_lowest is None and r.at_highest is None and math.isfinite(r.value)
        assert "? .. ?" in str(u) and "not found" in str(u) and "nan" not in str(u)

    def test_whatever_the_work_allowed_an_end_is_right_or_not_found(self, monkeypatch):
        """From too little for one end to enough for all, by Clarabel alone: what is printed is never a wrong number."""
        monkeypatch.setattr(extent, "_PROXIMAL", ())
        s = sole()
        expected = s.uniqueness().contacts["floor"].corners
        known = []
        for work in (1e5, 1e6, 1e8):
            monkeypatch.setattr("rbd.answers.analysis.uniqueness.ENDS_WORK", work)
            u = s.uniqueness()
            for one, full in zip(u.contacts["floor"].corners, expected, strict=True):
                for found, end in ((one.lowest, full.lowest), (one.highest, full.highest)):
                    assert math.isnan(found) or found == pytest.approx(end, abs=1e-9)
            known.append(sum(r.found for r in u.contacts["floor"].corners))
            assert u.found == (known[-1] == 4)
        assert known == sorted(known) and known[0] == 0 and 0 < known[-2] < 4 and known[-1] == 4

    def test_a_dimension_that_was_not_found_is_told(self, monkeypatch):
        """Without one pivot no linear program tells which planes hold all forces."""
        s = sole()
        monkeypatch.setattr(programs, "PROGRAM_SECONDS", 0.0)
        monkeypatch.setattr(programs, "PROGRAM_PIVOTS", 0)
        assert not s.uniqueness().found

    def test_forces_of_least_norm_that_were_not_found_stay_as_they_were(self, monkeypatch):
        """And say so."""
        s = sole((55.0, 0.0, 0.0))
        monkeypatch.setattr(force_choice, "by_dual", lambda *_: None)
        monkeypatch.setattr(force_choice, "FORCE_CHOICE_WORK", 0.0)
        assert s.with_forces().force_choice == "as ConeSolver left it"
        found = admissible(s.problem, s.a, s.multipliers, s.weights, s.law)
        assert force_choice.shortest(found) is None

    def test_whether_a_robot_can_be_held_may_not_be_found(self, monkeypatch, talos):
        """Not "cannot be held": nobody knows, so there is no proof and nothing is named."""
        push = rbd.ExternalForce("torso_2_link", (0.0, 115.0, 0.0))
        assert rbd.hold(talos.standing(), talos.soles(0.5), external=push).status == "solved"
        monkeypatch.setattr(conic_newton, "_by_newton", lambda program: None)
        monkeypatch.setattr(LeastEffort, "at", lambda *_, **__: None)
        for steps, seconds in ((1, conic_newton.CONIC_SECONDS), (conic_newton.CONIC_STEPS, 0.0)):
            monkeypatch.setattr(conic_newton, "CONIC_STEPS", steps)
            monkeypatch.setattr(conic_newton, "CONIC_SECONDS", seconds)
            with pytest.raises(CannotHold, match="was not found within") as caught:
                rbd.hold(talos.standing(), talos.soles(0.5), external=push)
            assert caught.value.certificate is None and caught.value.limits == ()

    def test_a_hold_that_newtons_method_does_not_find_is_found(self, monkeypatch, talos):
        """By the interior point alone, to the digits that it has."""
        expected = rbd.hold(talos.standing(), talos.soles(0.5))
        assert expected.method == "Newton"
        monkeypatch.setattr(conic_newton, "_by_newton", lambda program: None)
        monkeypatch.setattr(LeastEffort, "at", lambda *_, **__: None)
        monkeypatch.setattr(conic_newton, "newton_steps", lambda *_: None)
        found = rbd.hold(talos.standing(), talos.soles(0.5))
        assert found.method == "Clarabel" and np.abs(found.tau - expected.tau).max() < 1e-3
        assert found.status == "solved"

    def test_derivatives_without_a_program_are_refused(self, monkeypatch):
        """A box on four points: whether its forces have room takes a linear program."""
        s = sole((0.6 * 98.1 * (1.0 - 1e-8), 0.0, 0.0))
        monkeypatch.setattr(programs, "PROGRAM_PIVOTS", 0)
        monkeypatch.setattr(programs, "PROGRAM_SECONDS", 0.0)
        with pytest.raises(RbdError):
            s.derivatives()

    def test_the_wrench_nearest_in_a_cone_may_not_be_found(self, monkeypatch):
        """Our own error."""
        cone = rbd.problem.WrenchCone(np.array([[x, y, 0.0] for x in (0.1, -0.1) for y in (0.1, -0.1)]), 0.6)
        assert cone.project(np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])) == pytest.approx([0, 0, 1, 0, 0, 0])
        monkeypatch.setattr("rbd.problem.corner_cones.nonnegative", lambda *_: None)
        with pytest.raises(NoSolution):
            cone.project(np.array([1.0, 0.0, 1.0, 0.0, 0.0, 0.0]))

    def test_an_unlimited_weight_is_refused(self):
        """Not a mapping."""
        with pytest.raises(InputError):
            sole().with_forces(3.0)
