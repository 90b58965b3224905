"""Baumgarte's stabilisation: what has drifted comes back, and the answer says how much of its motion that is."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.model.checked_model import CheckedModel
from rbd.problem.rows import Rows
from rbd.testing import box, check_constraint

G = 9.81


def wheel(kind: type = pin.JointModelRZ) -> CheckedModel:
    """A body of 0.5 kg m2 about its joint, which gravity does not move."""
    model = pin.Model()
    joint = model.addJoint(0, kind(), pin.SE3.Identity(), "axle")
    model.appendBodyToJoint(joint, pin.Inertia(1.0, np.zeros(3), 0.5 * np.eye(3)), pin.SE3.Identity())
    return CheckedModel(model, name="wheel")


def block_rows(feedback: float = 0.0, velocity: float = 0.0, error: float | None = None) -> Rows:
    """A point on the ground: (tangent, tangent, normal) are the block's own coordinates."""
    given = None if error is None else np.array([0.3, 0.0, error])
    fed = np.array([0.0, 0.0, feedback])
    return Rows("ground", np.eye(3), np.zeros(3), rbd.problem.FrictionCone(0.5), np.array([0.0, 0.0, velocity]), given, fed)


def integrated(robot: CheckedModel, constraints, q: np.ndarray, v: np.ndarray, seconds: float, step: float = 1e-3):
    """(q, v) after some time, by the classical Runge-Kutta scheme, without torques."""

    def slope(q, v):
        s = rbd.solve(rbd.State(robot, q, v), np.zeros(robot.nu), constraints, solver=rbd.KKT())
        return s.a

    for _ in range(round(seconds / step)):
        a1 = slope(q, v)
        v2 = v + 0.5 * step * a1
        a2 = slope(pin.integrate(robot.model, q, 0.5 * step * v), v2)
        v3 = v + 0.5 * step * a2
        a3 = slope(pin.integrate(robot.model, q, 0.5 * step * v2), v3)
        v4 = v + step * a3
        a4 = slope(pin.integrate(robot.model, q, step * v3), v4)
        q = pin.integrate(robot.model, q, step / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4))
        v = v + step / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
    return q, v


def oscillator(w: float, zeta: float, e0: float, u0: float, t: float) -> float:
    """e(t) of e'' + 2 zeta w e' + w^2 e = 0, closed form."""
    if zeta == 1.0:
        return math.exp(-w * t) * (e0 + (u0 + w * e0) * t)
    if zeta < 1.0:
        d = w * math.sqrt(1.0 - zeta**2)
        return math.exp(-zeta * w * t) * (e0 * math.cos(d * t) + (u0 + zeta * w * e0) / d * math.sin(d * t))
    d = w * math.sqrt(zeta**2 - 1.0)
    return math.exp(-zeta * w * t) * (e0 * math.cosh(d * t) + (u0 + zeta * w * e0) / d * math.sinh(d * t))


class TestHeldRows:
    """Rows that hold."""

    @pytest.mark.parametrize("zeta", [0.2, 1.0, 1.7, 0.0])
    def test_an_error_decays_as_a_damped_oscillator(self, zeta):
        """Integrated finely, 0.3 s at 12 rad/s: the closed form to nine digits."""
        lock = rbd.constraints.Baumgarte(12.0, zeta).of(rbd.JointLock("lock", "axle", position=0.4))
        q, _ = integrated(wheel(), [lock], np.array([0.55]), np.array([-0.3]), 0.3)
        assert q[0] - 0.4 == pytest.approx(oscillator(12.0, zeta, 0.15, -0.3, 0.3), abs=1e-9)

    def test_a_gear_that_has_slipped_comes_back(self):
        """The teeth's error, not the wheels' angles, is what decays; at 30 rad/s nothing is left after a second."""
        model = pin.Model()
        for name in ("one", "other"):
            joint = model.addJoint(0, pin.JointModelRUBZ(), pin.SE3.Identity(), name)
            model.appendBodyToJoint(joint, pin.Inertia(1.0, np.zeros(3), 0.5 * np.eye(3)), pin.SE3.Identity())
        robot, gear = CheckedModel(model, name="gears"), rbd.JointCoupling("gear", "one", "other", ratio=-2.0)
        q, v = np.r_[math.cos(0.2), math.sin(0.2), 1.0, 0.0], np.array([-20.0, 10.0])
        end, _ = integrated(robot, [rbd.constraints.Baumgarte(30.0).of(gear)], q, v, 1.0, 2e-3)
        assert abs(gear.rows(rbd.State(robot, end)).error[0]) < 1e-9
        drifted, _ = integrated(robot, [gear], q, v, 1.0, 2e-3)
        assert gear.rows(rbd.State(robot, drifted)).error == pytest.approx([0.2])

    def test_a_ball_joint_turns_back(self):
        """From 1 rad off, turning: the error obeys the linear equation, each component by itself."""
        robot, w = wheel(pin.JointModelSpherical), 8.0
        q0 = pin.Quaternion(pin.exp3(np.array([0.6, -0.7, 0.4]))).coeffs()
        lock, v0 = rbd.JointLock("lock", "axle", position=[0.0, 0.0, 0.0, 1.0]), np.array([0.5, 0.2, -0.8])
        rows = lock.rows(rbd.State(robot, q0, v0))
        q, v = integrated(robot, [rbd.constraints.Baumgarte(w, 0.7).of(lock)], q0, v0, 0.4)
        expected = [oscillator(w, 0.7, e, u, 0.4) for e, u in zip(rows.error, rows.velocity, strict=True)]
        # The scheme's stages do not commute on the sphere, so there it is of lower order: 6e-8 at this step.
        assert lock.rows(rbd.State(robot, q, v)).error == pytest.approx(expected, abs=2e-7)

    def test_without_an_error_the_velocity_alone_dies_out(self):
        """It says so, and what has drifted stays: e(t) = u0 (1 - exp(-2 zeta w t)) / (2 zeta w)."""
        damped = rbd.constraints.Baumgarte(12.0, 0.5).of(rbd.JointLock("lock", "axle"))
        robot = wheel()
        q, v = integrated(robot, [damped], np.array([0.0]), np.array([0.3]), 0.3)
        assert v[0] == pytest.approx(0.3 * math.exp(-12.0 * 0.3)) and q[0] == pytest.approx(0.3 * (1 - math.exp(-3.6)) / 12.0)
        assert damped.acts_on(rbd.State(robot, np.zeros(1))).startswith("velocity alone")

    def test_a_constraint_of_ones_own_is_taken(self, talos):
        """Two rows without `velocity`: J v stands in for it; the name stays, and so does the feedback's size."""

        class Mine:
            name = "mine"

            def rows(self, state):
                J = np.eye(talos.nv)[6:8]
                return Rows("mine", J, np.zeros(2), rbd.problem.Free(2), error=np.array([0.1, -0.2]))

        v = np.zeros(talos.nv)
        v[6:8] = 0.3, 0.7
        state = talos.standing().with_velocity(v)
        rows = rbd.constraints.Baumgarte(5.0, 0.5).of(Mine()).rows(state)
        assert rows.name == "mine" and rows.feedback == pytest.approx([5.0 * 0.3 + 2.5, 5.0 * 0.7 - 5.0])
        assert rbd.constraints.Baumgarte(5.0).of(Mine()).acts_on(state) == "position and velocity"

    def test_an_anchored_foot_comes_back_to_its_place(self):
        """A box held by its patch, 2 mm and half a degree off: after 8 / w nothing but a hundredth of it is left."""
        robot = box()
        place, w = pin.neutral(robot.model), 40.0
        floor = rbd.SurfaceContact("floor", "box", half_lengths=(0.2, 0.2)).anchored(rbd.State(robot, place))
        off = pin.integrate(robot.model, place, np.array([2e-3, -1e-3, 1e-3, 5e-3, -8e-3, 3e-3]))
        held = rbd.constraints.Baumgarte(w).of(floor)
        assert held.acts_on(rbd.State(robot, off)) == "position and velocity"
        end, _ = integrated(robot, [held], off, np.zeros(6), 8.0 / w)
        left = pin.difference(robot.model, place, end) / pin.difference(robot.model, place, off)
        assert left == pytest.approx(oscillator(w, 1.0, 1.0, 0.0, 8.0 / w), abs=1e-3)

    def test_it_passes_the_check_of_constraints(self, talos):
        """Feedback is kept apart: J, velocity and J_dot v are those of the constraint."""
        lock = rbd.constraints.Baumgarte(30.0).of(rbd.JointLock("lock", "root_joint", position=talos.standing().q[:7]))
        assert check_constraint(lock, talos.standing()).against == "motion of the error"


class TestRowsThatPush:
    """Limits and contacts: pushed out of what they have entered, and no more."""

    @pytest.mark.parametrize(
        ("error", "velocity", "feedback"),
        [
            (-0.02, 0.0, -0.02 * 100.0),  # sunk: out, with w^2 times the depth
            (-0.02, -0.3, -0.02 * 100.0 - 0.3 * 20.0),  # and sinking
            (-0.02, 0.05, -0.02 * 100.0 + 0.05 * 20.0),  # on its way out: less
            (-0.02, 0.5, 0.0),  # fast enough: not held back
            (0.01, 0.0, 0.0),  # a gap is not closed
            (0.01, -0.5, 0.0),  # nor is it braked for
            (0.0, 0.0, 0.0),
            (None, -0.3, -0.3 * 20.0),
            (None, 0.3, 0.0),
        ],
    )
    def test_of_limits_and_normals(self, error, velocity, feedback):
        """At w = 10, zeta = 1; a friction cone's tangents get none, whatever their error."""
        given = None if error is None else np.array([error])
        one = Rows("stop", np.eye(1), np.zeros(1), rbd.problem.NonNegative(1), np.array([velocity]), given)
        by = rbd.constraints.Baumgarte(10.0)
        assert by.feedback(one) == pytest.approx([feedback])
        assert by.feedback(block_rows(velocity=velocity, error=error)) == pytest.approx([0.0, 0.0, feedback])

    def test_a_joint_beyond_its_stop_is_pushed_back(self):
        """0.01 rad beyond at 10 rad/s: 1 rad/s2 outwards, by the stop alone; from inside nothing pulls."""
        stop, robot = rbd.constraints.Baumgarte(10.0).of(rbd.JointLimit("stop", "axle", lower=0.0, margin=0.05)), wheel()
        for solver in (rbd.ProxQP(), rbd.ConeSolver(law="convex"), rbd.ConeSolver(law="coulomb")):
            s = rbd.solve(rbd.State(robot, np.array([-0.01])), np.zeros(1), [stop], solver=solver)
            assert s.a == pytest.approx([1.0]) and s.forces["stop"] == pytest.approx([0.5])
            assert s.accelerations["stop"] == pytest.approx([1.0]) and s.feedback_acceleration == pytest.approx([1.0])
            for tau in (-0.4, 0.4):
                s = rbd.solve(rbd.State(robot, np.array([0.01])), np.array([tau]), [stop], solver=solver)
                assert s.a == pytest.approx([max(0.0, tau) / 0.5], abs=1e-9) and not s.feedback_acceleration.any()

    def test_of_a_patch_what_all_corners_agree_on(self):
        """A sole that sank flat rises by w^2 of its depth; tilted, by that of its shallowest corner; one corner up: not."""
        by, corners = rbd.constraints.Baumgarte(10.0), [[0.1, 0.05, 0], [-0.1, 0.05, 0], [-0.1, -0.05, 0], [0.1, -0.05, 0]]
        cone = rbd.problem.WrenchCone(corners, 0.5)
        for sunk, tilt, expected in ((-0.01, 0.0, -0.01), (-0.01, 0.04, -0.006), (-0.01, 0.2, 0.0), (0.01, 0.0, 0.0)):
            rows = Rows("sole", np.eye(6), np.zeros(6), cone, error=np.array([0.1, 0.1, sunk, 0.0, tilt, 0.1]))
            assert by.feedback(rows) == pytest.approx([0.0, 0.0, 100.0 * expected, 0.0, 0.0, 0.0])

    def test_dry_friction_has_no_place_to_go_back_to(self):
        """It gets no feedback, and says so; a product gets its members'."""
        rub = rbd.constraints.Baumgarte(10.0).of(rbd.JointFriction("rub", "axle", 1.0))
        state = rbd.State(wheel(), np.zeros(1), np.array([0.5]))
        assert not rub.rows(state).feedback.any() and rub.acts_on(state).startswith("nothing: 'rub'")
        both = rbd.problem.Product([rbd.problem.Free(1), rbd.problem.Bounds([-1.0], [1.0]), rbd.problem.NonNegative(1)])
        rows = Rows("mixed", np.eye(3), np.zeros(3), both, error=np.array([-0.1, -0.1, -0.1]))
        assert rbd.constraints.Baumgarte(2.0).feedback(rows) == pytest.approx([-0.4, 0.0, -0.4])

    def test_a_limit_that_is_not_reached_stays_without_rows(self):
        """Zero rows go through."""
        stop = rbd.constraints.Baumgarte(10.0).of(rbd.JointLimit("stop", "axle", lower=-1.0))
        state = rbd.State(wheel(), np.zeros(1))
        assert len(stop.rows(state)) == 0 and stop.acts_on(state).startswith("nothing")


class TestWhatItDoesToTheMotion:
    """`solution.feedback_acceleration`."""

    @pytest.mark.parametrize("solver", [rbd.KKT(), rbd.ProxQP(), rbd.ConeSolver(law="coulomb")])
    def test_of_held_rows_it_is_the_difference_without(self, talos, rng, solver):
        """Held soles that have drifted, one of them twice (12 rows more than needed): a less the one without feedback."""
        state = talos.at(pin.integrate(talos.model, talos.standing().q, 0.01 * rng.normal(size=talos.nv)))
        knees = [rbd.JointLock(j, j, position=0.5) for j in ("leg_left_4_joint", "leg_right_4_joint")]
        again = rbd.JointLock("again", "leg_left_4_joint", position=0.5)
        plain = [*talos.soles(None, on=None), *knees, again]
        tau = np.zeros(talos.nu)
        bare = rbd.solve(state, tau, plain, solver=solver)
        fed = rbd.solve(state, tau, [rbd.constraints.Baumgarte(20.0).of(c) for c in plain], solver=solver)
        size = np.abs(fed.a).max()
        assert np.abs(fed.feedback_acceleration).max() > 1.0
        assert np.abs(fed.a - fed.feedback_acceleration - bare.a).max() < 1e-9 * size
        assert not bare.feedback_acceleration.any()

    @pytest.mark.parametrize("solver", [rbd.ProxQP(), rbd.ConeSolver(law="convex"), rbd.ConeSolver(law="coulomb")])
    def test_with_feet_that_stick_too(self, talos, solver):
        """On rubbing soles that stick with and without it, a locked arm pulled back: the difference again."""
        state = talos.standing()
        tau, arm = rbd.hold(state, talos.soles(0.7)).tau, rbd.JointLock("arm", "arm_left_4_joint", position=-1.3)
        bare, fed = (
            rbd.solve(state, tau, [*talos.soles(0.7), c], solver=solver) for c in (arm, rbd.constraints.Baumgarte(1.0).of(arm))
        )
        assert np.abs(fed.feedback_acceleration).max() > 0.1
        assert np.abs(fed.a - fed.feedback_acceleration - bare.a).max() < 1e-8

    def test_of_a_block_that_slips(self):
        """2 kg pushed with 30 N, mu = 0.5, its normal pushed out with 0.8 m/s2: Coulomb's law gives the push and mu of it."""
        P = rbd.GaussProblem(2.0 * np.eye(3), np.array([30.0, 0.0, -2.0 * G]), [block_rows(-0.8)])
        s = rbd.solve_problem(P, solver=rbd.ConeSolver(law="coulomb"))
        assert s.a == pytest.approx([15.0 - 0.5 * (G + 0.8), 0.0, 0.8])
        assert s.feedback_acceleration == pytest.approx([-0.5 * 0.8, 0.0, 0.8])

    @pytest.mark.parametrize("solver", [rbd.ProxQP(), rbd.ConeSolver(law="convex")])
    def test_of_a_block_that_slips_under_the_convex_law(self, solver):
        """The same block: along (-mu, 0, 1) alone, da = 0.8 / (1 + mu^2) (-mu, 0, 1); the difference without it."""
        push = np.array([30.0, 0.0, -2.0 * G])
        fed, bare = (
            rbd.solve_problem(rbd.GaussProblem(2.0 * np.eye(3), push, [block_rows(x)]), solver=solver) for x in (-0.8, 0.0)
        )
        assert fed.feedback_acceleration == pytest.approx(0.8 / 1.25 * np.array([-0.5, 0.0, 1.0]))
        assert fed.a - fed.feedback_acceleration == pytest.approx(bare.a)

    def test_of_what_has_lifted_off_there_is_none(self):
        """No force, no feedback that could act."""
        P = rbd.GaussProblem(2.0 * np.eye(3), np.array([0.0, 0.0, 9.0]), [block_rows(-0.8)])
        for solver in (rbd.ProxQP(), rbd.ConeSolver(law="coulomb")):
            assert not rbd.solve_problem(P, solver=solver).feedback_acceleration.any()

    def test_rows_that_accelerate_leave_it_out(self):
        """`accelerations` are the motion's; the stabilised row's own is -feedback."""
        lock = rbd.constraints.Baumgarte(10.0).of(rbd.JointLock("lock", "axle", position=0.0))
        s = rbd.solve(rbd.State(wheel(), np.array([0.02])), np.array([3.0]), [lock], solver=rbd.KKT())
        assert s.accelerations["lock"] == pytest.approx([-2.0]) and s.feedback_acceleration == pytest.approx([-2.0])


@pytest.mark.parametrize(
    ("said", "make"),
    [
        ("frequency", lambda: rbd.constraints.Baumgarte(0.0)),
        ("frequency", lambda: rbd.constraints.Baumgarte(math.nan)),
        ("frequency", lambda: rbd.constraints.Baumgarte("10")),
        ("damping_ratio", lambda: rbd.constraints.Baumgarte(10.0, -0.1)),
        ("damping_ratio", lambda: rbd.constraints.Baumgarte(10.0, math.inf)),
        ("no constraint", lambda: rbd.constraints.Baumgarte(10.0).of("left_sole")),
        ("no constraint", lambda: rbd.constraints.Baumgarte(10.0).of(rbd.JointLock)),
        ("no constraint", lambda: rbd.constraints.Baumgarte(10.0).of(None)),
    ],
)
def test_what_means_nothing_is_refused(said, make):
    """With what was expected."""
    with pytest.raises(rbd.InputError, match=said):
        make()
