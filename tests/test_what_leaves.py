"""Contacts that move away carry nothing, and are named; what counts as at rest can be told; v can be put onto the contacts."""

from __future__ import annotations

import re
import warnings

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.constraints.contact import PointContact
from rbd.errors import OpeningContactWarning
from rbd.mechanism import project_velocity
from rbd.testing import box

G = 9.81
FAST, SLOW = 2e-6, 0.5e-6
SOLVERS = [rbd.ProxQP(), rbd.ConeSolver(), rbd.ConeSolver(law="convex")]
EACH_SOLVER = pytest.mark.parametrize("solver", SOLVERS, ids=["ProxQP", "ConeSolver coulomb", "ConeSolver convex"])
X, Y = 0.2, 0.1
"""Half lengths of the face that the box stands on [m]."""
FACE = {"half_lengths": (X, Y)}


def up(talos: rbd.Robot, speed: float) -> tuple[rbd.State, np.ndarray]:
    """Talos standing, the whole of it moving along z, and the torques that hold it."""
    state = talos.standing()
    v = np.zeros(talos.nv)
    v[2] = speed
    return state.with_velocity(v), rbd.hold(state, talos.soles()).tau


@EACH_SOLVER
class TestNames:
    """What leaves is named, of every kind of contact."""

    def test_talos_that_leaves_the_ground_names_both_soles(self, talos, solver):
        """Moving up faster than the limit it falls freely; the warning and the solution say which contacts were left out."""
        state, tau = up(talos, FAST)
        told = r"talos.*'left_sole' at up to 2e-06.*'right_sole'.*project_velocity"
        with pytest.warns(OpeningContactWarning, match=told) as seen:
            s = rbd.solve(state, tau, talos.soles(), solver=solver)
        assert seen[0].filename == __file__
        assert s.opening == ("left_sole", "right_sole") and not s.multipliers.any()
        assert "separate and carry no force: 'left_sole'" in str(s) and s.status is rbd.problem.Status.SOLVED

    def test_slower_it_is_at_rest(self, talos, solver):
        """Half the limit: it stands on its soles, and nothing is said."""
        state, tau = up(talos, SLOW)
        s = rbd.solve(state, tau, talos.soles(), solver=solver)
        assert s.opening == () and np.abs(s.a).max() < 1e-9 and "move away" not in str(s)

    def test_a_larger_limit_keeps_them(self, talos, solver):
        """The limit given is the limit that is used: at rest up to 1e-5 m/s, up and down."""
        for speed in (FAST, -FAST):
            state, tau = up(talos, speed)
            s = rbd.solve(state, tau, talos.soles(), solver=solver, rest_speed=1e-5)
            assert s.opening == () and np.abs(s.a).max() < 1e-9 and s.problem.rest_speed == 1e-5

    def test_a_smaller_limit_leaves_them(self, talos, solver):
        """At rest up to 1e-7 m/s, half a micrometre a second opens, or strikes."""
        state, tau = up(talos, SLOW)
        with pytest.warns(OpeningContactWarning, match="rest_speed = 1e-07"):
            assert rbd.solve(state, tau, talos.soles(), solver=solver, rest_speed=1e-7).opening
        state, tau = up(talos, -SLOW)
        told = r"approaches at 5e-07 m/s.*rest_speed = 1e-07.*rbd\.mechanism\.project_velocity"
        with pytest.raises(rbd.errors.ContactMoves, match=told):
            rbd.solve(state, tau, talos.soles(), solver=solver, rest_speed=1e-7)

    def test_a_face_that_tips_names_the_corners_that_open(self, solver):
        """Turning about one edge two corners stay and two open: these carry nothing, those carry the box."""
        robot = box(mass=3.0, size=(2 * X, 2 * Y, 0.2))
        w = 1e-4
        v = np.array([0.0, 0.0, w * X, 0.0, w, 0.0])  # the corners at x = -X go up
        state = rbd.State(robot, pin.neutral(robot.model), v)
        face = rbd.SurfaceContact("face", "box", **FACE, friction=0.0)
        with pytest.warns(OpeningContactWarning, match=r"'face' \(points 3, 4 of 4\) at up to 4e-05"):
            s = rbd.solve(state, np.zeros(0), [face], solver=solver)
        assert s.opening == ("face",)
        assert s.corner_forces["face"][:2, 2].sum() > 1.0 and np.abs(s.corner_forces["face"][2:]).max() == 0.0

    @pytest.mark.parametrize("friction", [0.0, 0.5])
    def test_every_kind_of_contact(self, solver, friction):
        """Points, edges, faces, balls, disks: all fall freely, all are named."""
        robot = box(mass=3.0, size=(2 * X, 2 * Y, 0.2))
        state = rbd.State(robot, pin.neutral(robot.model), np.array([0.0, 0.0, 3e-6, 0.0, 0.0, 0.0]))
        kinds = {
            "point": rbd.PointContact("point", "box", friction=friction),
            "edge": rbd.LineContact("edge", "box", half_length=0.1, friction=friction),
            "face": rbd.SurfaceContact("face", "box", **FACE, friction=friction),
            "ball": rbd.RollingBall("ball", "box", radius=0.1, on=rbd.Ground(point=(0, 0, -0.1)), friction=friction),
            "disk": rbd.RollingDisk("disk", "box", radius=0.1, on=rbd.Ground(point=(0, 0, -0.1)), friction=friction),
        }
        for name, contact in kinds.items():
            with pytest.warns(OpeningContactWarning, match=f"'{name}'"):
                s = rbd.solve(state, np.zeros(0), [contact], solver=solver)
            assert s.opening == (name,) and s.a[2] == pytest.approx(-G, abs=1e-9)

    def test_a_stop_that_is_left(self, solver):
        """A joint at its limit that already moves off it feels no stop."""
        robot = rbd.load_robot("ur5", root="fixed")
        limit = rbd.JointLimit("stop", "elbow_joint")
        q = robot.neutral()
        at = robot.model.joints[robot.model.getJointId("elbow_joint")]
        q[at.idx_q] = limit.bounds(robot)[0]
        v = np.zeros(robot.nv)
        v[at.idx_v] = 1e-3
        with pytest.warns(OpeningContactWarning, match="'stop' at 0.001"):
            s = rbd.solve(rbd.State(robot, q, v), np.zeros(robot.nu), [limit], solver=solver)
        assert s.opening == ("stop",) and np.abs(s.a - s.a_free).max() < 1e-9

    def test_shapes_that_leave(self, talos, solver):
        """Of collision contacts the points are told."""
        state, tau = up(talos, FAST)
        ground = rbd.CollisionContacts("ground", talos, ground=["leg_left_6_link", "leg_right_6_link"], friction=0.7)
        with pytest.warns(OpeningContactWarning, match="'ground' at up to 2e-06"):
            assert rbd.solve(state, tau, [ground], solver=solver).opening == ("ground",)


def test_one_foot_stays_and_one_leaves(talos):
    """Only the one that leaves is named; the other carries."""
    state = talos.standing()
    tau = rbd.hold(state, talos.soles()).tau
    left, right = talos.soles()
    J = right.rows(state).J
    held = left.rows(state).J
    stacked = np.vstack([J, held])
    v = np.linalg.pinv(stacked) @ np.r_[0.0, 0.0, 0.01, 0.0, 0.0, 0.0, np.zeros(6)]
    with pytest.warns(OpeningContactWarning, match="'right_sole' at up to 0.01"):
        s = rbd.solve(state.with_velocity(v), tau, [left, right])
    assert s.opening == ("right_sole",) and s.contacts["left_sole"].normal > 100.0 and s.contacts["right_sole"].normal == 0.0


class TestOtherDoors:
    """Whatever decides by velocities decides by the problem's own limit."""

    def test_compare_laws_warns_once_and_takes_the_limit(self, talos):
        """Both laws see the same problem."""
        state, tau = up(talos, FAST)
        with pytest.warns(OpeningContactWarning) as seen:
            both = rbd.studies.compare_laws(state, tau, talos.soles())
        assert len(seen) == 1 and seen[0].filename == __file__
        assert both.convex.opening == both.coulomb.opening == ("left_sole", "right_sole") and both.agree
        kept = rbd.studies.compare_laws(state, tau, talos.soles(), rest_speed=1e-5)
        assert kept.coulomb.opening == () and np.abs(kept.coulomb.a).max() < 1e-9

    def test_agree_leaves_out_what_leaves_everywhere(self, talos):
        """The solver on pyramids once took a foot that leaves as one at rest: all that must agree do."""
        state, tau = up(talos, FAST)
        with pytest.warns(OpeningContactWarning):
            found = rbd.studies.compare_solvers(state, tau, talos.soles())
        assert found.agree and "ConeSolver on pyramids" in [x.solver for x in found.answers]
        assert rbd.studies.compare_solvers(state, tau, talos.soles(), rest_speed=1e-5).agree

    def test_agree_does_not_put_pyramids_on_what_slides(self):
        """Of a point that slides only Coulomb's law speaks; what approaches, no solver takes."""
        robot = box(mass=1.0)
        toe = rbd.PointContact("toe", "box", friction=0.5)
        slides = rbd.State(robot, pin.neutral(robot.model), np.array([1.0, 0, 0, 0, 0, 0]))
        found = rbd.studies.compare_solvers(slides, np.zeros(0), [toe])
        assert [x.solver for x in found.answers] == ["ConeSolver, coulomb"]
        strikes = rbd.State(robot, pin.neutral(robot.model), np.array([0, 0, -1.0, 0, 0, 0]))
        with pytest.raises(rbd.NoSolution, match="an impact, which no acceleration answers"):
            rbd.studies.compare_solvers(strikes, np.zeros(0), [toe])

    def test_a_problem_by_hand_carries_the_limit(self):
        """Rays, parts, dry friction and derivatives decide by the problem's own limit."""
        one = np.eye(1)

        def problem(cone, v, rest):
            rows = rbd.Rows("it", one, np.zeros(1), cone, velocity=[v])
            return rbd.GaussProblem(2.0 * one, np.array([-6.0]), [rows], rest_speed=rest)

        for solver in SOLVERS:
            kept, left = (
                rbd.solve_problem(problem(rbd.problem.NonNegative(1), 1e-3, rest), solver=solver) for rest in (1e-2, 1e-4)
            )
            assert kept.multipliers == pytest.approx([6.0]) and kept.opening == ()
            assert left.multipliers == pytest.approx([0.0]) and left.opening == ("it",) and "'it' at 0.001" in str(left)
            sticks, rubs = (
                rbd.solve_problem(problem(rbd.problem.Bounds([-8.0], [8.0]), 1e-3, rest), solver=solver)
                for rest in (1e-2, 1e-4)
            )
            assert sticks.a == pytest.approx([0.0]) and rubs.a == pytest.approx([-7.0])
        assert rbd.answers.analysis.contradiction(problem(rbd.problem.NonNegative(1), 1e-3, 1e-4)) is None

    def test_a_problem_by_hand_with_an_impact_has_no_answer(self):
        """Solved directly, without `rbd.solve`, a contact that approaches is no answer either."""
        rows = rbd.Rows("toe", np.eye(3), np.zeros(3), rbd.problem.FrictionCone(0.5), velocity=[0.0, 0.0, -1.0])
        for solver in SOLVERS:
            s = rbd.Solution.of(solver.solve(rbd.GaussProblem(np.eye(3), [0.0, 0.0, -G], [rows])))
            assert s.status is rbd.problem.Status.FAILED and "'toe' approaches" in s.impact and "'toe' approaches" in str(s)

    def test_nearest_motion_and_derivatives_keep_the_limit(self, talos):
        """Both start from the problem that was solved."""
        state, tau = up(talos, FAST)
        P = rbd.gauss_problem(state, tau, talos.soles(), rest_speed=1e-5)
        near = rbd.answers.solution.nearest_motion(P)
        assert np.abs(near.a).max() < 1e-9 and near.solution.opening == ()
        words = rbd.solve_problem(P).derivatives().active
        assert set(words["left_sole"]) == {"sticks"}

    def test_at_rest_is_at_rest_in_any_company(self):
        """A turning patch below the limit has no centripetal part, whether or not another contact moves."""
        patch = rbd.problem.WrenchCone(np.array([[X, Y, 0], [X, -Y, 0], [-X, 0, 0.0]]), 0.5)
        turning = rbd.Rows("sole", np.eye(6), np.zeros(6), patch, velocity=[0, 0, 0, 0, 0, 0.01])
        slides = rbd.Rows("toe", np.eye(6)[:3], np.zeros(3), rbd.problem.FrictionCone(0.5), velocity=[1.0, 0, 0])
        P = rbd.GaussProblem(np.eye(6), np.zeros(6), [turning, slides], rest_speed=0.1)
        assert not P.force_set.offset.any() and [P.rows[i].name for i in P.force_set.slipping] == ["toe"]

    def test_a_corner_whose_speed_is_above_it_and_components_are_below_slides(self):
        """Of a face that turns one corner moves at (0.19, 0.28) um/s, which is 0.34: the answer's residuals are of that law."""
        robot = box(mass=10.0)
        corners = np.array([(X, Y, 0.0), (-X, Y, 0.0), (-X, -Y, 0.0)])
        face = rbd.constraints.Contact("face", "box", corners=corners, friction=0.5, on=0.0)
        state = rbd.State(robot, [0, 0, 0, 0, 0, 0, 1], [2.3e-7, 2.0e-7, 0.0, 0.0, 0.0, 4e-7])
        push = rbd.ExternalForce("box", (3.0, 2.0, 0.0), moment=(1.0, 4.0, 1.0))
        found = rbd.solve(state, [], [face], external=[push], rest_speed=3e-7)
        other = rbd.solve(state, [], [face], external=[push], rest_speed=3e-7, solver=rbd.ConeSolver())
        assert found.residuals.within(1e-9) and found.a == pytest.approx(other.a, abs=1e-9)
        across, normal = found.corner_forces["face"][:, :2], found.corner_forces["face"][:, 2]
        slides = np.hypot(*(state.v[:2] + state.v[5] * corners[:, 1::-1] * [-1.0, 1.0]).T) > 3e-7
        assert slides.sum() == 1 and np.hypot(*across[slides].T) == pytest.approx(0.5 * normal[slides], abs=1e-9)


    @pytest.mark.parametrize("wrong", [-1e-6, np.nan, np.inf, "fast", None, True])
    def test_a_limit_that_is_no_speed_is_refused(self, talos, wrong):
        """With what came and what was expected."""
        state, tau = up(talos, 0.0)
        for door in (rbd.solve, rbd.gauss_problem, rbd.studies.compare_laws, rbd.studies.compare_solvers):
            with pytest.raises(rbd.InputError, match="rest_speed is .*; expected a speed"):
                door(state, tau, talos.soles(), rest_speed=wrong)


class TestProjectVelocity:
    """A velocity put onto contacts."""

    def test_it_is_the_nearest_that_keeps_the_contacts(self, talos, rng):
        """J v = 0, and v - v+ is perpendicular, in M, to every velocity that the contacts leave free."""
        state = talos.standing().with_velocity(0.1 * rng.normal(size=talos.nv))
        onto = project_velocity(state, talos.soles())
        J = np.vstack([c.rows(state).J for c in talos.soles()])
        assert np.abs(J @ onto.v).max() < 1e-13 and np.array_equal(onto.q, state.q)
        N = np.linalg.svd(J)[2][len(J) :]
        assert np.abs(N @ state.M @ (state.v - onto.v)).max() < 1e-11
        assert np.abs(project_velocity(onto, talos.soles()).v - onto.v).max() < 1e-14

    def test_what_it_gives_is_solved_without_a_word(self, talos, rng):
        """Noise of a tenth of a metre a second, in every direction, and all three solvers."""
        tau = rbd.hold(talos.standing(), talos.soles()).tau
        for _ in range(5):
            state = talos.standing().with_velocity(0.1 * rng.normal(size=talos.nv))
            for solver in SOLVERS:
                s = rbd.solve(project_velocity(state, talos.soles()), tau, talos.soles(), solver=solver)
                assert s.opening == () and s.status is rbd.problem.Status.SOLVED

    def test_rows_that_repeat_each_other(self, rng):
        """Four points hold a box that six rows would hold."""
        robot = box(mass=3.0)
        corners = [rbd.PointContact(f"{x}{y}", "box", offset=(x, y, 0.0), friction=0.5) for x in (-X, X) for y in (-Y, Y)]
        state = rbd.State(robot, pin.neutral(robot.model), rng.normal(size=6))
        assert np.abs(project_velocity(state, corners).v).max() < 1e-12

    def test_a_belt_carries_and_a_smooth_point_slides(self):
        """A ground that moves takes the contact along; without friction only the normal velocity goes."""
        robot = box(mass=3.0)
        state = rbd.State(robot, pin.neutral(robot.model), np.array([1.0, 2.0, 3.0, 0.0, 0.0, 0.0]))
        belt = rbd.SurfaceContact("belt", "box", **FACE, friction=0.5, on=rbd.Ground(velocity=(0.3, 0.0, 0.0)))
        assert project_velocity(state, [belt]).v == pytest.approx([0.3, 0.0, 0.0, 0.0, 0.0, 0.0], abs=1e-12)
        ice = rbd.SurfaceContact("ice", "box", **FACE, friction=0.0)
        toe = PointContact("ice", "box", friction=0.0)
        assert project_velocity(state, [toe]).v[:3] == pytest.approx([1.0, 2.0, 0.0], abs=1e-12)
        assert project_velocity(state, [ice]).v == pytest.approx(np.zeros(6), abs=1e-12)

    def test_a_mechanism_by_its_file(self, rng):
        """None: loops and wheels of the robot."""
        robot = rbd.mechanism.four_bar(1.0, 3.0, 2.0, 2.5)
        state = rbd.State(robot, robot.posture("assembled"), rng.normal(size=robot.nv))
        onto = project_velocity(state)
        assert np.abs(np.vstack([c.rows(state).J for c in robot.loops()]) @ onto.v).max() < 1e-12 and onto.v.any()

    def test_what_no_velocity_keeps_is_refused(self):
        """Two belts that pull apart under one box."""
        robot = box(mass=3.0)
        state = rbd.State(robot, pin.neutral(robot.model))
        belts = [
            rbd.PointContact(n, "box", friction=0.5, on=rbd.Ground(velocity=(u, 0, 0)))
            for n, u in (("one", 0.3), ("other", -0.3))
        ]
        with pytest.raises(rbd.InputError, match=r"no velocity .* is missed by 0\.3"):
            project_velocity(state, belts)

    def test_nothing_to_keep(self, talos, rng):
        """No constraint, or dry friction alone: the same velocity."""
        state = talos.standing().with_velocity(rng.normal(size=talos.nv))
        assert project_velocity(state, []).v is state.v
        friction = rbd.JointFriction("rub", talos.actuated_names[0], 1.0)
        assert np.array_equal(project_velocity(state, [friction]).v, state.v)
        with pytest.raises(rbd.InputError, match="a State of a robot was expected first"):
            project_velocity(talos, [])


def test_a_message_of_many_is_short():
    """Eight contacts: six are told, two are counted."""
    rows = [rbd.Rows(f"c{i}", np.eye(8)[i : i + 1], np.zeros(1), rbd.problem.NonNegative(1), velocity=[1.0]) for i in range(8)]
    s = rbd.solve_problem(rbd.GaussProblem(np.eye(8), np.zeros(8), rows), solver=rbd.ConeSolver())
    assert len(s.opening) == 8 and re.search(r"'c5' at 1 m/s and 2 more", str(s))


def test_nothing_is_said_where_all_contacts_hold(talos):
    """A held contact has no choice to open, however fast."""
    state, tau = up(talos, 1.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error", OpeningContactWarning)
        assert rbd.solve(state, tau, talos.soles(None)).opening == ()
