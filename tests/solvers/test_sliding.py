"""Points that already slide: closed forms, Painleve's paradox, jamming, soles, and what is not decided."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import linprog, minimize_scalar

import rbd
from rbd.model.checked_model import CheckedModel
from rbd.problem.residuals import residuals_of
from rbd.solvers import qp, sliding
from rbd.solvers.complementarity import Mixed, all_solutions
from rbd.solvers.sliding import _Search, sliding_answers
from rbd.testing import box

G = 9.81
COULOMB = rbd.ConeSolver()


def rod_problem(mu, angle, rate=0.0, speed=-1.0, mass=1.0, half=1.0) -> rbd.GaussProblem:
    """Painleve's rod: coordinates x, z of its middle and its angle from the ground; the tip is the lower, left end.

    Speed -1: the tip goes ahead of the rod, to the left, as a pushed chalk does.
    """
    c, s = np.cos(angle), np.sin(angle)
    J = np.array([[1.0, 0.0, half * s], [0.0, 0.0, 0.0], [0.0, 1.0, -half * c]])
    bias = half * rate**2 * np.array([c, 0.0, s])
    tip = rbd.Rows("tip", J=J, bias=bias, cone=rbd.problem.FrictionCone(mu), velocity=[speed, 0.0, 0.0])
    return rbd.GaussProblem(np.diag([mass, mass, mass * half**2 / 3.0]), np.array([0.0, -mass * G, 0.0]), [tip])


def pressing(problem) -> float:
    """How pressing moves the point, n . J M^-1 J^T (n - mu t), of a problem's one sliding point, from its parts."""
    T = problem.force_set
    return float((T.H.T @ problem.delassus @ T.G)[0, 0])


def rod_pressing(mu, angle, mass=1.0) -> float:
    """The closed form: (1/m) (1 + 3 cos th (cos th - mu sin th))."""
    return (1.0 + 3.0 * np.cos(angle) * (np.cos(angle) - mu * np.sin(angle))) / mass


class TestPainlevesRod:
    """Uniform rod of mass m and length 2 l, its tip sliding on rough ground. Sources: [Painleve1895], [GenotBrogliato1999]."""

    @pytest.mark.parametrize("mass", [1.0, 7.0])
    def test_pressing_it_moves_the_tip_as_the_closed_form_says(self, mass):
        """That is n . D (n - mu t), at angles and frictions of both signs; its length does not matter."""
        for angle in np.linspace(0.05, 1.5, 9):
            for mu in (0.1, 0.8, 4.0 / 3.0, 3.0):
                P = rod_problem(mu, angle, mass=mass, half=0.7)
                assert pressing(P) == pytest.approx(rod_pressing(mu, angle, mass), rel=1e-12, abs=1e-13)

    def test_the_critical_friction_is_four_thirds_at_tan_two(self):
        """Below 4/3 no angle has the paradox; at 4/3 one touches it, tan th = 2."""

        def worst(mu: float) -> tuple[float, float]:
            least = minimize_scalar(
                lambda th: pressing(rod_problem(mu, th)), bounds=(0.3, 1.5), method="bounded", options={"xatol": 1e-10}
            )
            return float(least.x), float(least.fun)

        angle, least = worst(4.0 / 3.0)
        assert least == pytest.approx(0.0, abs=1e-14) and np.tan(angle) == pytest.approx(2.0, abs=1e-6)
        assert worst(4.0 / 3.0 - 1e-6)[1] > 0.0 > worst(4.0 / 3.0 + 1e-6)[1]

    @pytest.mark.parametrize("rate", [0.0, 3.0])
    @pytest.mark.parametrize("sign", [-1, 1])
    def test_the_verdict_changes_at_the_critical_friction(self, sign, rate):
        """A millionth below 4/3 the rod slides on with N = -b / D, a huge force; a millionth above no motion is left."""
        angle = np.arctan(2.0)
        P = rod_problem(4.0 / 3.0 * (1.0 + sign * 1e-6), angle, rate)
        answers = sliding_answers(P)
        assert answers.complete and len(answers.found) == (0 if sign > 0 else 1)
        if sign < 0:
            (_, f, _), b = answers.found[0], rate**2 * np.sin(angle) - G
            assert f[2] == pytest.approx(-b / rod_pressing(4.0 / 3.0 * (1 - 1e-6), angle), rel=1e-8) and f[2] > 1e5

    @pytest.mark.parametrize("angle", [0.35, np.arctan(2.0), 1.3])
    def test_none_one_and_two_motions_stand_where_the_closed_form_puts_them(self, angle):
        """Over friction and angular rate, with D and the free acceleration b = l w^2 sin th - g of the tip.

        D > 0: one motion, N = max(0, -b / D).   D < 0 < b: two, N = 0 and N = -b / D.   D, b < 0: none.
        """
        counts = {}
        for mu in np.linspace(0.05, 4.0, 12):
            for rate in np.linspace(0.0, 9.0, 10):
                answers = sliding_answers(rod_problem(mu, angle, rate))
                D, b = rod_pressing(mu, angle), rate**2 * np.sin(angle) - G
                if D > 0.0:
                    expected = [max(0.0, -b / D)]
                else:
                    expected = [0.0, -b / D] if b > 0.0 else []
                assert answers.complete
                assert [f[2] for _, f, _ in answers.found] == pytest.approx(expected, rel=1e-9)
                for a, f, _ in answers.found:
                    assert f == pytest.approx([mu * f[2], 0.0, f[2]], rel=1e-12)  # against the motion, to the left
                    torque = mu * f[2] * np.sin(angle) - f[2] * np.cos(angle)
                    assert a == pytest.approx([mu * f[2], f[2] - G, 3.0 * torque], rel=1e-12)
                counts[len(answers.found)] = counts.get(len(answers.found), 0) + 1
        assert counts[1] > 0 and (angle == 0.35 or counts[0] > 5 and counts[2] > 5)

    def test_the_tip_that_trails_has_no_paradox(self):
        """Drawn the other way, friction lifts the tip: D > 0 at any friction, one motion."""
        for angle in (0.3, 1.0, 1.4):
            for mu in (0.5, 2.0, 10.0):
                P = rod_problem(mu, angle, speed=2.0)
                assert pressing(P) == pytest.approx(rod_pressing(-mu, angle), rel=1e-12)
                assert len(sliding_answers(P).found) == 1

    def test_the_words_name_the_point_and_the_number(self):
        """No motion: 'tip', its friction, and the negative acceleration per newton."""
        P = rod_problem(2.0, np.arctan(2.0))
        reason = sliding_answers(P).reason
        assert "no motion: 'tip' slides" in reason and "Painleve" in reason
        assert f"{rod_pressing(2.0, np.arctan(2.0)):.3g} < 0 at mu = 2" in reason

    def test_the_solver_hands_on_what_is_found(self):
        """ConeSolver: `others` has the second motion, each with its certificate; without a motion it fails, and says why."""
        two = COULOMB.solve(rod_problem(2.0, np.arctan(2.0), 5.0))
        assert two.status == "solved" and two.law.kind == "coulomb" and [o.status for o in two.others] == ["solved"]
        assert two.gauss == 0.0 and two.others[0].gauss > 0.0  # leaving first
        assert "2 motions" in two.reason and "'tip' leaves" in two.reason and "'tip' carries" in two.reason
        none = COULOMB.solve(rod_problem(2.0, np.arctan(2.0)))
        assert none.status not in ("solved", "inaccurate") and "Painleve" in none.reason and not none.others

    def test_of_eight_motions_four_are_told_and_the_rest_counted(self):
        """Three rods apart from each other, each of which may leave or press with -b / D: 2^3 motions, all leaving first."""
        rate, angle = 5.0, np.arctan(2.0)
        one = rod_problem(2.0, angle, rate)
        (tip,) = one.rows
        J = [np.hstack([tip.J if i == j else np.zeros((3, 3)) for j in range(3)]) for i in range(3)]
        rows = [rbd.Rows(f"tip {i}", J[i], bias=tip.bias, cone=tip.cone, velocity=tip.velocity) for i in range(3)]
        P = rbd.GaussProblem(np.kron(np.eye(3), one.M), np.tile(one.rhs, 3), rows)
        answers = sliding_answers(P)
        presses = (G - rate**2 * np.sin(angle)) / rod_pressing(2.0, angle)
        normals = {tuple(np.round(f[2::3] / presses, 9)) for _, f, _ in answers.found}
        assert answers.complete and normals == {(a, b, c) for a in (0, 1) for b in (0, 1) for c in (0, 1)}
        head, *told = answers.reason.split(": ", 1)[1].split("; ")
        assert answers.reason.startswith("8 motions satisfy Coulomb's law: ")
        assert head == "(1) 'tip 0' leaves, 'tip 1' leaves, 'tip 2' leaves"
        assert [line[:3] for line in told] == ["(2)", "(3)", "(4)", "and"] and told[-1] == "and 4 more"

    def test_a_hand_that_holds_the_middle_moves_the_threshold(self):
        """The rod's middle held at its height (a row that holds): D = (l^2 cos th / I) (cos th - mu sin th), so mu = cot th.

        With the middle held, N presses only as far as the rod's turning asks: free b = l w^2 sin th, no gravity in it.
        """
        angle, rate = 1.1, 2.0
        for mu in (0.9 / np.tan(angle), 1.1 / np.tan(angle)):
            free = rod_problem(mu, angle, rate)
            hand = rbd.Rows("hand", J=[[0.0, 1.0, 0.0]], bias=[0.0], cone=rbd.problem.Free(1))
            answers = sliding_answers(rbd.GaussProblem(free.M, free.rhs, [hand, *free.rows]))
            D, b = 3.0 * np.cos(angle) * (np.cos(angle) - mu * np.sin(angle)), rate**2 * np.sin(angle)
            assert answers.complete and [f[3] for _, f, _ in answers.found] == pytest.approx([0.0] if D > 0 else [0.0, -b / D])
            for _, f, _ in answers.found:
                assert f[0] == pytest.approx(G - f[3])  # the hand carries the rest of the weight
        assert D < 0.0


def rod_robot(mass=2.0, half=0.5) -> CheckedModel:
    """A rod that moves in the plane x, z: two sliders and a hinge without motors. Lean 0 is along x; positive lowers +x."""
    model, joint = pin.Model(), 0
    for name, kind in (("x", pin.JointModelPX()), ("z", pin.JointModelPZ()), ("lean", pin.JointModelRY())):
        joint = model.addJoint(joint, kind, pin.SE3.Identity(), name)
    inertia = np.diag([0.01, mass * half**2 / 3.0, mass * half**2 / 3.0])
    model.appendBodyToJoint(joint, pin.Inertia(mass, np.zeros(3), inertia), pin.SE3.Identity())
    model.addFrame(pin.Frame("rod", joint, 0, pin.SE3.Identity(), pin.FrameType.BODY))
    return CheckedModel(model, name="rod", passive=["x", "z", "lean"])


class TestRodThroughTheDoor:
    """The same rod as a robot, by `rbd.solve`."""

    mass, half, angle, mu = 2.0, 0.5, float(np.arctan(2.0)), 2.0

    def ask(self, rate, mu=None):
        """Leaning at `angle`, its left end on the ground and going left, turning at `rate`."""
        robot, c, s = rod_robot(self.mass, self.half), np.cos(self.angle), np.sin(self.angle)
        q = np.array([0.0, self.half * s, -self.angle])
        v = np.array([-1.0 + rate * self.half * s, -rate * self.half * c, rate])  # the end itself goes at (-1, 0)
        tip = rbd.PointContact("tip", "rod", offset=(-self.half, 0.0, 0.0), friction=self.mu if mu is None else mu)
        assert tip.rows(rbd.State(robot, q, v)).velocity == pytest.approx([-1.0, 0.0, 0.0])
        return rbd.solve(rbd.State(robot, q, v), np.zeros(0), [tip], solver=COULOMB)

    def test_where_there_is_no_motion_it_says_so(self):
        """`NoSolution` with the words of the solver."""
        with pytest.raises(rbd.NoSolution, match=r"no motion: 'tip' slides.*Painleve's paradox.* at mu = 2"):
            self.ask(0.0)

    def test_where_there_are_two_it_warns_and_gives_both(self):
        """`NonUniqueMotionWarning` with what they are; the first leaves, the second presses with -b / D."""
        rate = 9.0
        b, D = self.half * rate**2 * np.sin(self.angle) - G, rod_pressing(self.mu, self.angle, self.mass)
        with pytest.warns(
            rbd.errors.NonUniqueMotionWarning, match=r"rod has no one motion: 2 motions .*'tip' leaves; .*'tip' carries"
        ):
            s = self.ask(rate)
        assert s.forces["tip"] == pytest.approx(np.zeros(3)) and s.accelerations["tip"][2] == pytest.approx(b)
        (other,) = s.others
        assert other.contacts["tip"].normal == pytest.approx(-b / D)
        assert other.accelerations["tip"][2] == pytest.approx(0.0, abs=1e-9)
        assert other.forces["tip"][0] == pytest.approx(self.mu * -b / D)

    def test_where_there_is_one_nothing_is_said(self):
        """Below the critical friction: N = -b / D, no warning (warnings are errors here)."""
        s = self.ask(1.0, mu=1.0)
        b, D = self.half * np.sin(self.angle) - G, rod_pressing(1.0, self.angle, self.mass)
        assert s.contacts["tip"].normal == pytest.approx(-b / D) and s.reason == "" and s.others == ()


def placed(robot, position, R=None, v=None) -> rbd.State:
    """A free body at `position` with axes R; v as (linear in W of its centre, angular in W)."""
    R = np.eye(3) if R is None else R
    local = None if v is None else np.concatenate([R.T @ np.asarray(v[0], float), R.T @ np.asarray(v[1], float)])
    return rbd.State(robot, pin.SE3ToXYZQUAT(pin.SE3(R, np.asarray(position, float))), local)


class TestSlidingBox:
    """Box 0.4 x 0.4 x 1 m, 20 kg, with corner forces at its lower face. Sources: closed form; the project's cases."""

    size, mass = np.array([0.4, 0.4, 1.0]), 20.0
    moment = 20.0 * (0.16 + 1.0) / 12.0  # about y, through the middle

    def state(self, v, w=(0.0, 0.0, 0.0)) -> rbd.State:
        """Standing, its middle moving at v and turning at w."""
        return placed(box(self.mass, tuple(self.size)), (0.0, 0.0, 0.5), v=(v, w))

    def sole(self, mu) -> rbd.SurfaceContact:
        """The lower face."""
        return rbd.SurfaceContact(
            "sole", "box", half_lengths=(0.2, 0.2), placement=pin.SE3(np.eye(3), np.array([0, 0, -0.5])), friction=mu
        )

    def ask(self, state, mu, push=(0.0, 0.0, 0.0)) -> rbd.Solution:
        """Pushed through its middle."""
        return rbd.solve(state, np.zeros(0), [self.sole(mu)], external=rbd.ExternalForce("box", push), solver=COULOMB)

    def test_its_corner_forces_while_it_slides_under_80_N(self):
        """With mu = .3: a = (80 - 58.86) / 20; front edge 171.675 N, back edge 24.525 N, halved by symmetry."""
        s = self.ask(self.state((1.0, 0.0, 0.0)), 0.3, (80.0, 0.0, 0.0))
        assert s.a == pytest.approx([1.057, 0.0, 0.0, 0.0, 0.0, 0.0], abs=1e-12)
        corners = s.corner_forces["sole"]
        assert corners[:, 2] == pytest.approx([171.675 / 2, 171.675 / 2, 24.525 / 2, 24.525 / 2])
        assert corners[:, 0] == pytest.approx(-0.3 * corners[:, 2])
        assert s.problem.force_set.sliding and s.others == ()

    @pytest.mark.parametrize("direction", [0.0, 0.4, 1.9, -2.5])
    def test_friction_is_against_the_motion_and_not_the_push(self, direction):
        """Sliding along d, pushed across: a = push / m - mu g d."""
        d = np.array([np.cos(direction), np.sin(direction), 0.0])
        s = self.ask(self.state(2.0 * d), 0.2, (0.0, 15.0, 0.0))
        assert s.a == pytest.approx(np.r_[np.array([0.0, 15.0 / 20.0, 0.0]) - 0.2 * G * d, np.zeros(3)], abs=1e-11)

    def test_beyond_b_over_h_it_trips_over_its_front_edge(self):
        """Sliding without a push at mu = 0.5 > b/h = .4, the front edge alone carries N and the box tips forward.

        Front edge at (x, -h) = (.2, -.5): z acceleration of the edge = N/m - g - x (mu h - x) N / I = 0.
        """
        mu, x, h = 0.5, 0.2, 0.5
        s = self.ask(self.state((1.0, 0.0, 0.0)), mu)
        D = 1.0 / self.mass - x * (mu * h - x) / self.moment
        N = G / D
        assert s.a[0] == pytest.approx(-mu * N / self.mass) and s.a[2] == pytest.approx(N / self.mass - G)
        assert s.a[4] == pytest.approx((mu * h - x) * N / self.moment) and s.a[4] > 0.0
        assert s.corner_forces["sole"][:, 2] == pytest.approx([N / 2, N / 2, 0.0, 0.0], abs=1e-9)

    def test_it_jams_beyond_the_friction_at_which_pressing_sinks(self):
        """D = 1/m - x (mu h - x) / I = 0 at mu = (I/(m x) + x) / h; above, the front edge has no answer."""
        critical = (self.moment / (self.mass * 0.2) + 0.2) / 0.5
        s = self.ask(self.state((1.0, 0.0, 0.0)), critical * (1 - 1e-4))
        assert s.status == "solved" and s.contacts["sole"].normal > 1e4
        with pytest.raises(rbd.NoSolution, match=r"corner 0 of 'sole' and corner 1 of 'sole' slide at 1 m/s"):
            self.ask(self.state((1.0, 0.0, 0.0)), critical * (1 + 1e-4))

    def test_spinning_about_its_middle_it_is_braked_by_mu_m_g_times_the_radius(self):
        """Four corners at radius r: torque -mu m g r; it does not travel."""
        s = self.ask(self.state((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)), 0.3)
        radius, moment = 0.2 * np.sqrt(2.0), 20.0 * 0.32 / 12.0
        assert s.a == pytest.approx([0, 0, 0, 0, 0, -0.3 * 20 * G * radius / moment], abs=1e-10)

    def test_sliding_and_turning_the_split_of_the_load_is_not_decided_nor_is_the_motion(self):
        """Each corner rubs in its own direction, so the friction depends on how a rigid sole shares its load.

        The first answer is the even one; the ends of the family unload a corner; everything between satisfies the law.
        """
        P = rbd.gauss_problem(self.state((0.5, 0.2, 0.0), (0.0, 0.0, 1.0)), np.zeros(0), [self.sole(0.3)])
        answers = sliding_answers(P)
        assert (
            not answers.complete and "rigid bodies do not determine how the points of 'sole' share the load" in answers.reason
        )
        (first, *ends), corners = answers.found, [w for _, _, w in answers.found]
        assert len(ends) == 2
        assert all(np.linalg.norm(first[2]) < np.linalg.norm(w) for _, _, w in ends)
        Y, V = P.force_set.H.T @ P.delassus @ P.force_set.G, P.solve_M(P.J.T @ P.force_set.G)
        u = np.linalg.svd(Y)[2][3]  # the change of split that leaves the sole down
        assert np.abs(Y @ u).max() < 1e-12 and first[2] @ u == pytest.approx(0.0, abs=1e-9)
        # Extremes of the last angular acceleration over all weights that keep the sole down: a linear program.
        b = P.force_set.H.T @ P.free_row_acceleration + P.force_set.offset
        turning = [linprog(s * V[5], A_eq=Y[:3], b_eq=-b[:3], bounds=(0, None)).fun * s + P.a_free[5] for s in (1, -1)]
        assert sorted(a[5] for a, _, _ in ends) == pytest.approx(sorted(turning), rel=1e-6)
        for share in (0.25, 0.5, 0.75):
            w = share * corners[1] + (1 - share) * corners[2]
            f = P.force_set.G @ w
            assert residuals_of(P, P.a_free + P.solve_M(P.J.T @ f), f, w, "coulomb").within(1e-9)

    def test_the_door_warns_of_an_undecided_split(self):
        """`NonUniqueMotionWarning`, with the ends in `others`."""
        with pytest.warns(rbd.errors.NonUniqueMotionWarning, match="a family of motions"):
            s = self.ask(self.state((0.5, 0.2, 0.0), (0.0, 0.0, 1.0)), 0.3)
        assert s.status == "solved" and len(s.others) == 2 and all(o.status == "solved" for o in s.others)

    @pytest.mark.parametrize(("mu", "slide"), [(0.5, 0.0), (0.2, 0.7)])
    def test_tipping_over_an_edge_only_the_edge_carries(self, mu, slide):
        """The edge x = .2 stands (or slides along x), the rest opens with w about y; two-point hand computation in the plane.

        Standing: about the edge I_e w' = -m g x. The middle's acceleration w' x r - w^2 r gives the force; the robot's a lacks
        w x v (it is spatial). Sliding: the edge's z acceleration is zero with its friction -mu N.
        """
        w, x, h, m, inertia = 0.5, 0.2, 0.5, self.mass, self.moment
        turn, edge = np.array([0.0, w, 0.0]), np.array([x, 0.0, -h])
        v = np.array([slide, 0.0, 0.0]) - np.cross(turn, edge)
        with pytest.warns(rbd.errors.OpeningContactWarning, match=r"'sole' \(points 3, 4 of 4\)"):
            s = self.ask(self.state(v, turn), mu)
        parts = s.problem.force_set
        assert {o.rows for o in parts.openings} == {"sole"} and len(parts.sliding) == (2 if slide else 0)
        if slide:
            # z of the edge: N/m - g - x w' - w^2 (-h), with I w' = (mu h - x) N
            N = (G - w**2 * h) / (1 / m - x * (mu * h - x) / inertia)
            turning, force = (mu * h - x) * N / inertia, np.array([-mu * N, 0.0, N])
        else:
            turning = -m * G * x / (inertia + m * (x**2 + h**2))
            middle = np.cross([0, turning, 0], -edge) + np.cross(turn, np.cross(turn, -edge))
            force = m * (middle + [0.0, 0.0, G])
            assert abs(force[0]) < mu * force[2]
        assert s.a[4] == pytest.approx(turning, abs=1e-11)
        assert s.a[:3] == pytest.approx(force / m - [0, 0, G] - np.cross(turn, v), abs=1e-10)
        corners = s.corner_forces["sole"]
        assert corners[[0, 1]] == pytest.approx(np.tile(force / 2, (2, 1)), abs=1e-9)
        assert not corners[[2, 3]].any()

    @pytest.mark.parametrize("law", ["up", "down", "across"])
    def test_a_block_on_an_incline_is_braked_by_weight_and_friction(self, law):
        """Up: g (sin a + mu cos a) down the slope; down: g (sin a - mu cos a); across: the two at right angles."""
        slope, mu = np.radians(25.0), 0.3
        R = pin.exp3(np.array([0.0, -slope, 0.0]))  # the body's x axis points up the slope
        d = {"up": [1.0, 0, 0], "down": [-1.0, 0, 0], "across": [0, 1.0, 0]}[law]
        state = placed(box(5.0, (0.4, 0.4, 0.1)), R @ [0, 0, 0.05], R, (R @ np.array(d), np.zeros(3)))
        X = pin.SE3(np.eye(3), np.array([0, 0, -0.05]))
        floor = rbd.SurfaceContact("slope", "box", half_lengths=(0.2, 0.2), placement=X, friction=mu)
        points = [
            rbd.PointContact(f"p{i}", "box", offset=(0.2 * x, 0.2 * y, -0.05), on=rbd.Ground(normal=R[:, 2]), friction=mu)
            for i, (x, y) in enumerate([(1, 1), (1, -1), (-1, -1), (-1, 1)])
        ]
        expected = np.array([-np.sin(slope), 0, 0]) * G - mu * G * np.cos(slope) * np.array(d)
        for contacts in ([floor], points):
            s = rbd.solve(state, np.zeros(0), contacts, solver=COULOMB)
            assert s.status == "solved" and s.a == pytest.approx(np.r_[expected, np.zeros(3)], abs=1e-10)
            assert sum(c.normal for c in s.contacts.values()) == pytest.approx(5.0 * G * np.cos(slope))

    def test_a_belt_takes_along_what_is_dropped_on_it(self):
        """At rest on a belt that runs at 2 m/s: +mu g along the belt. Running with it: nothing rubs."""
        X = pin.SE3(np.eye(3), np.array([0, 0, -0.5]))
        belt = rbd.SurfaceContact(
            "belt", "box", half_lengths=(0.2, 0.2), placement=X, friction=0.25, on=rbd.Ground(velocity=(2.0, 0.0, 0.0))
        )
        for v, expected in (((0.0, 0.0, 0.0), 0.25 * G), ((2.0, 0.0, 0.0), 0.0), ((5.0, 0.0, 0.0), -0.25 * G)):
            s = rbd.solve(self.state(v), np.zeros(0), [belt], solver=COULOMB)
            assert s.a == pytest.approx([expected, 0, 0, 0, 0, 0], abs=1e-11)


@pytest.mark.parametrize("mu", [0.3, 0.8])
def test_a_car_on_four_points_may_yaw_as_it_brakes(mu):
    """Four points carry a load in many ways; with the rear ones locked the car yaws if one side bears more: a family.

    The even split (least norm) goes straight, with the force of the three-wheeler; the ends yaw by mu N y / I either way.
    """
    m, l, y, h = 900.0, 1.2, 0.7, 0.5
    state = placed(box(m, (3.0, 1.4, 1.0)), (0.0, 0.0, h), v=((20.0, 0.0, 0.0), np.zeros(3)))
    wheels = [
        rbd.PointContact(f"{end} {side}", "box", offset=(x, s * y, -h), friction=friction)
        for end, x, friction in (("front", l, 0.0), ("rear", -l, mu))
        for side, s in (("left", 1), ("right", -1))
    ]
    with pytest.warns(
        rbd.errors.NonUniqueMotionWarning, match="points of 'front left', 'front right', 'rear left' and 'rear right' share"
    ):
        s = rbd.solve(state, np.zeros(0), wheels, solver=COULOMB)
    rear = m * G * l / (2 * l + mu * h)
    assert s.a == pytest.approx([-mu * rear / m, 0, 0, 0, 0, 0], abs=1e-10)
    yaw = mu * rear * y / (m * (3.0**2 + 1.4**2) / 12.0)  # all of the rear's load on one side
    assert sorted(o.a[5] for o in s.others) == pytest.approx([-yaw, yaw])


def test_locked_rear_wheels_brake_with_what_the_braking_leaves_them():
    """A three-wheeler, rear wheels locked, the front one rolling: N_r = m g l_f / (l_f + l_r + mu h), a = -mu N_r / m."""
    m, lf, lr, h, mu = 900.0, 1.1, 1.4, 0.5, 0.8
    state = placed(box(m, (3.0, 1.4, 1.0)), (0.0, 0.0, h), v=((20.0, 0.0, 0.0), np.zeros(3)))
    wheels = [
        rbd.PointContact(f"{end} {side}", "box", offset=(x, y, -h), friction=friction)
        for end, side, x, y, friction in (
            ("front", "middle", lf, 0.0, 0.0),
            ("rear", "left", -lr, 0.7, mu),
            ("rear", "right", -lr, -0.7, mu),
        )  # fmt: skip
    ]
    s = rbd.solve(state, np.zeros(0), wheels, solver=COULOMB)
    rear = m * G * lf / (lf + lr + mu * h)
    assert s.a == pytest.approx([-mu * rear / m, 0, 0, 0, 0, 0], abs=1e-10)
    assert [s.contacts[f"rear {side}"].normal for side in ("left", "right")] == pytest.approx([rear / 2, rear / 2])


class TestLadder:
    """Uniform ladder, 2 m, 10 kg, from the floor (end below, at the right) to a wall at the left; both ends slide."""

    mass, length = 10.0, 2.0

    def problem(self, angle, rate, mu_floor=0.0, mu_wall=0.0) -> rbd.GaussProblem:
        """Coordinates x, z of the middle and the angle from the floor, falling at `rate` < 0."""
        l, c, s = self.length / 2, np.cos(angle), np.sin(angle)
        # foot = middle + l (c, -s), top = middle + l (-c, s); their second derivatives at rest are -+ l w^2 (c, -s)
        foot, top = np.array([[1, 0, -l * s], [0, 0, 0], [0, 1, -l * c]]), np.array([[0, 1, l * c], [0, 0, 0], [1, 0, l * s]])
        out, down = l * rate**2 * np.array([-c, 0.0, s]), l * rate**2 * np.array([-s, 0.0, c])
        foot_speed, top_speed = -2 * l * s * rate, 2 * l * c * rate
        rows = [
            rbd.Rows("floor", foot, out, rbd.problem.FrictionCone(mu_floor), velocity=[foot_speed, 0, 0]),
            rbd.Rows("wall", top, down, rbd.problem.FrictionCone(mu_wall), velocity=[top_speed, 0, 0]),  # axes: up, along, out
        ]
        m = self.mass
        return rbd.GaussProblem(np.diag([m, m, m * l * l / 3]), np.array([0.0, -m * G, 0.0]), rows)

    def test_at_release_it_falls_as_energy_says(self):
        """Smooth floor and wall, from rest at 60 deg: th'' = -(3 g / 2 L) cos th; with th' = w the same."""
        for angle, rate in ((np.radians(60.0), 0.0), (np.radians(55.0), -0.5)):
            P = self.problem(angle, rate)
            s = COULOMB.solve(P)
            turning = -1.5 * G / self.length * np.cos(angle)
            l, c, sn = 1.0, np.cos(angle), np.sin(angle)
            middle = l * np.array([-sn * turning - c * rate**2, c * turning - sn * rate**2])
            assert s.status == "solved" and s.a == pytest.approx([*middle, turning], abs=1e-10)
            assert s.multipliers[5] == pytest.approx(self.mass * middle[0])  # the wall alone pushes sideways

    @pytest.mark.parametrize("sign", [-1, 1])
    def test_it_leaves_the_wall_at_two_thirds_of_its_height(self, sign):
        """At sin th = 2/3 sin th0 the wall's force is zero, the floor's m g / 4; above it presses, below it has left.

        From rest at th0 = 60 deg, th'^2 = (3 g / L) (sin th0 - sin th). Source: the project's cases.
        """
        s0 = np.sin(np.radians(60.0))
        angle = np.arcsin(2.0 / 3.0 * s0) - sign * 1e-5
        rate = -np.sqrt(3 * G / self.length * (s0 - np.sin(angle)))
        s = COULOMB.solve(self.problem(angle, rate))
        assert s.status == "solved" and s.multipliers[2] == pytest.approx(self.mass * G / 4, rel=1e-4)
        assert (s.multipliers[5] == 0.0) if sign > 0 else (0.0 < s.multipliers[5] < 1e-2)

    def test_rough_on_both_ends_it_falls_as_the_two_sliding_points_say(self):
        """With mu = .2 below, .15 at the wall, both ends sliding: floor N, wall W from two equations, by hand in the plane."""
        angle, rate, mu1, mu2 = np.radians(50.0), -0.8, 0.2, 0.15
        P = self.problem(angle, rate, mu1, mu2)
        assert len(P.force_set.sliding) == 2
        s = COULOMB.solve(P)
        m, l, c, sn = self.mass, 1.0, np.cos(angle), np.sin(angle)
        # m x'' = W - mu1 N; m z'' = N + mu2 W - m g; torque about the middle, counter-clockwise, th'' = 3 / (m l^2) times
        #   foot at l (c, -sn) with (-mu1 N, N), top at l (-c, sn) with (W, mu2 W).  Angle grows clockwise-up: foot goes in.
        # angle th: foot - middle = l (c, -sn): d/dth = l (-sn, -c), so th'' I = l (-sn, -c) . F_foot + l (sn, c) . F_top
        k = 3.0 / (m * l)
        turn = k * np.array([mu1 * sn - c, sn + mu2 * c])  # of N and W
        # contact: z'' - l c th'' + l w^2 sn = 0;  x'' + l sn th'' + l w^2 c = 0
        A = np.array([[1 / m, mu2 / m], [-mu1 / m, 1 / m]]) + np.outer([-l * c, l * sn], turn)
        N, W = np.linalg.solve(A, [G - l * rate**2 * sn, -l * rate**2 * c])
        assert N > 0 and W > 0 and s.status == "solved"
        assert s.multipliers == pytest.approx([-mu1 * N, 0, N, mu2 * W, 0, W])
        assert s.a[2] == pytest.approx(turn @ [N, W])


def null_velocity(state, held, moving, twist) -> np.ndarray:
    """Least-norm v with J_held v = 0 and J_moving v = twist."""
    J = np.vstack([held.rows(state).J, moving.rows(state).J])
    return np.linalg.lstsq(J, np.r_[np.zeros(6), twist], rcond=None)[0]


@pytest.fixture(scope="module")
def standing(talos):
    """Robot, state and torques of standing."""
    state = talos.standing()
    return talos, state, rbd.hold(state, talos.soles()).tau


class TestTalos:
    """One foot slides while the other stands, or both slide."""

    @pytest.mark.parametrize("mu", [0.2, 0.5, 0.8])
    def test_one_foot_slides_and_the_other_sticks(self, standing, mu):
        """The same motion as with the standing foot held, solved exactly; the sliding one is rubbed against its motion."""
        robot, state, tau = standing
        left, right = robot.soles(friction=mu)
        state = state.with_velocity(null_velocity(state, right, left, [0.3, 0.1, 0, 0, 0, 0]))
        s = rbd.solve(state, tau, [left, right], solver=COULOMB)
        assert s.status == "solved" and len(s.problem.force_set.sliding) == 4
        assert s.accelerations["right_sole"] == pytest.approx(np.zeros(6), abs=1e-8)
        used = s.contacts["left_sole"]
        direction = s.forces["left_sole"][:2] / used.normal
        assert used.normal > 100.0 and direction == pytest.approx(-mu * np.array([0.3, 0.1]) / np.hypot(0.3, 0.1), abs=1e-6)
        _, held = robot.soles(friction=None)
        exact = sliding_answers(rbd.gauss_problem(state, tau, [left, held]))
        assert exact.complete and len(exact.found) == 1 and s.a == pytest.approx(exact.found[0][0], rel=1e-7, abs=1e-8)

    def test_two_feet_that_slide_take_one_node_of_the_tree(self, standing):
        """Eight corner forces of rank six: the uniqueness of the motion is proved, not found by 256 trials."""
        robot, state, tau = standing
        left, right = robot.soles(friction=0.3)
        J = np.vstack([left.rows(state).J, right.rows(state).J])
        v = np.linalg.lstsq(J, np.r_[0.3, 0.1, 0, 0, 0, 0, 0.2, -0.1, 0, 0, 0, 0], rcond=None)[0]
        P = rbd.gauss_problem(state.with_velocity(v), tau, [left, right])
        T = P.force_set
        A, b = T.H.T @ P.delassus @ T.G, T.H.T @ P.free_row_acceleration + T.offset
        found = all_solutions(Mixed(A, b, P.whitened @ T.G, T.lower, T.upper, budget=1))
        assert found.complete and len(found.weights) == 1
        answers = sliding_answers(P)
        assert answers.complete and len(answers.found) == 1
        s = rbd.solve(state.with_velocity(v), tau, [left, right], solver=COULOMB)
        total = s.forces["left_sole"][:3] + s.forces["right_sole"][:3]
        used = [f[:2] / f[2] for f in (s.forces["left_sole"], s.forces["right_sole"])]
        assert np.linalg.norm(used, axis=1) == pytest.approx([0.3, 0.3]) and total[2] > 0.0

    def test_a_foot_that_lifts_carries_nothing(self, standing):
        """Left rises at 0.2 m/s, right slides."""
        robot, state, tau = standing
        left, right = robot.soles(friction=0.3)
        J = np.vstack([left.rows(state).J, right.rows(state).J])
        v = np.linalg.lstsq(J, np.r_[0, 0, 0.2, 0, 0, 0, 0.2, 0, 0, 0, 0, 0], rcond=None)[0]
        with pytest.warns(rbd.errors.OpeningContactWarning, match="'left_sole' at up to 0.2 m/s"):
            s = rbd.solve(state.with_velocity(v), tau, [left, right], solver=COULOMB)
        assert s.forces["left_sole"] == pytest.approx(np.zeros(6)) and s.status == "solved"
        assert s.contacts["right_sole"].friction_used == pytest.approx(1.0)

    def test_a_foot_that_turns_as_it_slides_leaves_the_motion_open(self, standing):
        """Beside a foot that sticks: the answers found all keep it still, and the words say that they belong together."""
        robot, state, tau = standing
        left, right = robot.soles(friction=0.4)
        state = state.with_velocity(null_velocity(state, right, left, [0.3, 0.1, 0, 0, 0, 0.5]))
        P = rbd.gauss_problem(state, tau, [left, right])
        answers = sliding_answers(P)
        assert len(answers.found) > 1 and not answers.complete
        assert "rigid bodies do not determine how the points of 'left_sole' and 'right_sole' share the load" in answers.reason
        for a, f, w in answers.found:
            assert residuals_of(P, a, f, w, "coulomb").within(1e-9)
            assert P.rows[1].J @ a + P.rows[1].bias == pytest.approx(np.zeros(6), abs=1e-8)


def test_an_approaching_point_is_an_impact_and_no_paradox():
    """By hand, as `rbd.solve` refuses it at the door: no motion, in the words of `Parts.impact`."""
    P = rod_problem(0.5, 1.0)
    tip = P.rows[0]
    down = rbd.Rows("tip", tip.J, tip.bias, tip.cone, velocity=[1.0, 0.0, -0.1])
    answers = sliding_answers(rbd.GaussProblem(P.M, P.rhs, [down]))
    assert answers.found == () and "approaches at 0.1 m/s" in answers.reason


def test_held_rows_that_contradict_each_other_leave_no_motion():
    """Two rows that hold, the same but for their J_dot v, beside a sliding point: none, and the words blame no friction."""
    P = rod_problem(0.3, 1.0)
    hands = [rbd.Rows(name, [[1.0, 0.0, 0.0]], [bias], rbd.problem.Free(1)) for name, bias in (("one", 0.0), ("two", 1.0))]
    answers = sliding_answers(rbd.GaussProblem(P.M, P.rhs, [*hands, *P.rows]))
    assert answers.found == () and answers.complete and "bilateral rows contradict each other" in answers.reason


def test_of_many_rows_that_contradict_each_other_four_are_named():
    """Six that hold one coordinate still at different rates, beside a sliding point."""
    P = rod_problem(0.3, 1.0)
    hands = [rbd.Rows(f"hand {i}", [[1.0, 0.0, 0.0]], [float(i)], rbd.problem.Free(1)) for i in range(6)]
    reason = sliding_answers(rbd.GaussProblem(P.M, P.rhs, [*hands, *P.rows])).reason
    assert reason.endswith("among 'hand 0', 'hand 1', 'hand 2', 'hand 3' and 2 more")


def test_a_rod_held_in_its_turn_has_no_paradox_and_a_rod_held_in_its_height_has_another():
    """What holds changes how pressing moves the tip: without a turn by 1/m; with the middle's height held by its turn alone."""
    mu, angle = 2.0, np.arctan(2.0)
    P = rod_problem(mu, angle)
    turn = rbd.Rows("turn", [[0.0, 0.0, 1.0]], [0.0], rbd.problem.Free(1))
    slides = sliding_answers(rbd.GaussProblem(P.M, P.rhs, [turn, *P.rows]))
    assert slides.complete and len(slides.found) == 1 and slides.found[0][1][3] == pytest.approx(G)  # N = m g
    # The middle held at its height, and a torque that drives the tip down: M^-1 of the turn is 3 / (m l^2).
    height = rbd.Rows("height", [[0.0, 1.0, 0.0]], [0.0], rbd.problem.Free(1))
    none = sliding_answers(rbd.GaussProblem(P.M, np.array([0.0, -G, 1.0]), [height, *P.rows]))
    c, s = np.cos(angle), np.sin(angle)
    D = 3.0 * c * (c - mu * s)
    assert none.found == () and none.complete and f"n . J M^-1 J^T (n - mu t) = {D:.3g} < 0 at mu = 2" in none.reason


def test_points_at_rest_beside_one_that_slides_each_follow_their_law():
    """Three beads of 1 kg that do not touch each other: one slides, one starts to slip, one lifts off. Closed forms."""
    mu, push = 0.5, 8.0
    J = np.eye(9)
    moving = rbd.Rows("moving", J[:3], np.zeros(3), rbd.problem.FrictionCone(mu), velocity=[0.0, 1.0, 0.0])
    rows = [moving, *(rbd.Rows(f"rest {i}", J[3 * i : 3 * i + 3], np.zeros(3), rbd.problem.FrictionCone(mu)) for i in (1, 2))]
    P = rbd.GaussProblem(np.eye(9), np.array([0.0, 0.0, -G, push, 0.0, -G, 0.0, 0.0, 3.0]), rows)
    answers = sliding_answers(P)
    assert len(answers.found) == 1 and not answers.complete  # Newton's search, where cones at rest rub
    a, f, _ = answers.found[0]
    assert a == pytest.approx([0.0, -mu * G, 0.0, push - mu * G, 0.0, 0.0, 0.0, 0.0, 3.0], abs=1e-9)
    assert f == pytest.approx([0.0, -mu * G, G, -mu * G, 0.0, G, 0.0, 0.0, 0.0], abs=1e-9)


@pytest.mark.parametrize(("mu", "other"), [(0.3, 0.3), (0.3, 0.1), (0.1, 0.3)])
def test_two_feet_of_a_sled_share_its_load_as_they_like_and_only_unequal_frictions_tell(mu, other):
    """10 kg that cannot turn, pushed with 60 N beside a bead that slides: a is (60 - mu 100) / 10 with some mean friction."""
    bead = rbd.Rows("bead", np.eye(3, 6, 3), np.zeros(3), rbd.problem.FrictionCone(0.5), velocity=[0.0, 1.0, 0.0])
    feet = [
        rbd.Rows(name, np.eye(3, 6), np.zeros(3), rbd.problem.FrictionCone(friction))
        for name, friction in (("left", mu), ("right", other))
    ]
    P = rbd.GaussProblem(np.diag([10.0] * 3 + [1.0] * 3), np.array([60.0, 0.0, -100.0, 0.0, 0.0, -10.0]), [bead, *feet])
    answers = sliding_answers(P)
    for a, _, _ in answers.found:
        assert 6.0 - 10.0 * max(mu, other) - 1e-9 < a[0] < 6.0 - 10.0 * min(mu, other) + 1e-9
        assert a[1:] == pytest.approx([0.0, 0.0, 0.0, -5.0, 0.0], abs=1e-9)
    if mu == other:
        assert len(answers.found) == 1 and answers.reason == ""
    else:
        assert "a family of motions" in answers.reason and "'left' and 'right' share the load" in answers.reason


def test_weights_near_an_answer_are_brought_onto_it():
    """A ten-thousandth off: Newton's correction finds the closed form's force again; half off is no answer, and stays so."""
    P = rod_problem(0.3, 1.0)
    search = _Search(P)
    exact = sliding_answers(P).found[0][2]
    near, far = search._certified(1.0001 * exact), search._certified(1.5 * exact)
    assert near.status == "solved" and near.weights == pytest.approx(exact, rel=1e-9)
    assert far.status != "solved" and far.weights == pytest.approx(1.5 * exact)


def test_joints_with_dry_friction_beside_a_sliding_point_are_solved_exactly():
    """A chain of unit masses pushed along a line, each with an interval of dry friction at rest, the last rubbing on top."""
    rng = np.random.default_rng(5)
    for _ in range(20):
        n = 14
        B = rng.normal(size=(n, n))
        M, rhs = B @ B.T + n * np.eye(n), 20.0 * rng.normal(size=n)
        rub = rbd.Rows(
            "joints", np.eye(n - 2, n), np.zeros(n - 2), rbd.problem.Bounds(np.full(n - 2, -5.0), np.full(n - 2, 5.0))
        )
        rhs[-1] = -30.0
        J = np.zeros((3, n))
        J[0, n - 2] = J[2, n - 1] = 1.0
        point = rbd.Rows("point", J, np.zeros(3), rbd.problem.FrictionCone(0.4), velocity=[1.0, 0.0, 0.0])
        P = rbd.GaussProblem(M, rhs, [rub, point])
        answers = sliding_answers(P)
        assert answers.complete and len(answers.found) == 1
        a, f, _ = answers.found[0]
        c = P.J @ a
        for i in range(n - 2):  # at its bound where it moves, against the motion to come
            assert abs(f[i]) <= 5.0 + 1e-9 and (abs(c[i]) < 1e-9 or f[i] == pytest.approx(-5.0 * np.sign(c[i])))
        assert f[n - 2] == pytest.approx(-0.4 * f[n]) and min(f[n], c[n]) >= -1e-9 and abs(f[n] * c[n]) < 1e-8


@pytest.mark.parametrize("seed", range(4))
def test_random_sliding_points_have_the_motions_of_brute_force(seed):
    """Up to five sliding points on a random body: as many motions as brute force over pressing and leaving finds."""
    rng = np.random.default_rng(seed)
    counts = set()
    for _ in range(40):
        k, nv = int(rng.integers(1, 6)), 18
        B = rng.normal(size=(nv, nv))
        J = [rng.normal(size=(3, nv)) for _ in range(k)]
        rows = [
            rbd.Rows(f"p{i}", J[i], rng.normal(size=3), rbd.problem.FrictionCone(float(rng.uniform(0.2, 4.0))),
                     velocity=[*rng.normal(size=2), 0.0])
            for i in range(k)
        ]  # fmt: skip
        P = rbd.GaussProblem(B @ B.T + np.eye(nv), 5.0 * rng.normal(size=nv), rows)
        expected, Minv = 0, np.linalg.inv(P.M)
        n = np.array([r.J[2] for r in rows])
        force = np.array([r.J[2] - r.cone.mu * (r.velocity / np.linalg.norm(r.velocity)) @ r.J for r in rows])
        D, b = n @ Minv @ force.T, n @ Minv @ P.rhs + [r.bias[2] for r in rows]
        for code in range(2**k):
            on = np.array([code >> i & 1 == 1 for i in range(k)])
            N = np.zeros(k)
            N[on] = np.linalg.solve(D[np.ix_(on, on)], -b[on])
            expected += bool((N >= 0).all() and (D @ N + b >= -1e-9).all())
        answers = sliding_answers(P)
        assert answers.complete and len(answers.found) == expected
        gauss = [float((a - P.a_free) @ P.M @ (a - P.a_free)) for a, _, _ in answers.found]
        assert gauss == sorted(gauss)
        counts.add(min(expected, 2))
    assert counts == {0, 1, 2}


class TestAHundred:
    """Points of one body that slide together: more than its motion can tell apart."""

    @staticmethod
    def problem() -> rbd.GaussProblem:
        """A body of 2 kg on points at all heights, friction 0.3."""
        rng, rows = np.random.default_rng(0), []
        for k in range(100):
            x, y, z = rng.normal(size=3) * [0.1, 0.1, 0.05]
            J = np.hstack([np.eye(3), -np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])])
            rows.append(rbd.Rows(f"p{k}", J, np.zeros(3), rbd.problem.FrictionCone(0.3), np.array([0.2, 0.1, 0.0])))
        M = np.diag([2.0, 2.0, 2.0, 0.01, 0.02, 0.015])
        return rbd.GaussProblem(M, np.array([1.0, 2.0, -2.0 * G, 0.1, 0.2, 0.1]), rows)

    def test_the_search_ends_by_its_work(self, monkeypatch):
        """5000 nodes of the tree took 40 s: now it ends after some linear programs, with a motion, and not as complete."""
        programs = []

        def counted(*given):
            programs.append(1)
            return least_violation(*given)

        least_violation = qp.least_violation
        monkeypatch.setattr(qp, "least_violation", counted)
        answers = sliding_answers(self.problem())
        assert answers.found and not answers.complete and len(programs) <= 50
        a, f, w = answers.found[0]
        assert residuals_of(self.problem(), a, f, w, "coulomb").worst < 1e-9

    def test_where_the_tree_finds_nothing_points_that_yield_lead_to_a_motion(self, monkeypatch):
        """Cut at its root, it leaves the search to Newton's method on points that yield less and less; the reason says so."""
        monkeypatch.setattr(sliding, "all_solutions", lambda problem: all_solutions(replace(problem, work=0.0)))
        problem = self.problem()
        answers = sliding_answers(problem)
        assert len(answers.found) == 1 and not answers.complete and "not all motions were searched" in answers.reason
        a, f, w = answers.found[0]
        assert residuals_of(problem, a, f, w, "coulomb").worst < 1e-9
        assert (w >= 0.0).all() and (problem.J @ a)[2::3].min() > -1e-9
