"""ProxQP: Gauss's principle with cones, on robots that are pushed until they slip and lift."""

from __future__ import annotations

import re
import warnings

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.problem.rows import Rows
from rbd.solvers import proxqp, qp
from rbd.testing import law_residuals

pytestmark = pytest.mark.filterwarnings("ignore::rbd.errors.EffortLimitWarning")  # noise on small motors


def pushed_problems(name: str, count: int, seed: int):
    """(noise in N m, mu, problem) of a standing robot: torque noise 2 to 60 N m, mu 0.05 to 1, half of the postures bent."""
    rng = np.random.default_rng(seed)
    robot = rbd.load_robot(name)
    standing = robot.standing()
    hold = rbd.hold(standing, robot.soles(0.7)).tau
    for i in range(count):
        noise, mu = rng.uniform(2.0, 60.0), rng.uniform(0.05, 1.0)
        state = standing
        if i % 2:
            bend = np.r_[np.zeros(6), 0.1 * rng.normal(size=robot.nv - 6)]
            state = rbd.State(robot, pin.integrate(robot.model, standing.q, bend))
        tau = hold + noise * rng.normal(size=robot.nu)
        yield noise, mu, rbd.gauss_problem(state, tau, robot.soles(mu, on=None))


@pytest.mark.parametrize("name", ["talos", "talos_full", "g1", "g1_hands"])
def test_pushed_robots_are_solved(name, exhaustive):
    """30 states of each robot, or 80: every one solved, by an independent certificate too.

    1,000 of each by `python tests/solvers/test_proxqp.py`.
    """
    solver, slipping, count = rbd.ProxQP(), 0, 80 if exhaustive else 30
    for _, _, problem in pushed_problems(name, count, seed=11):
        s = rbd.Solution.of(solver.solve(problem))
        assert s.status == "solved", s
        assert max(law_residuals(problem, s, "convex").values()) < 1e-9
        slipping += max(np.abs(c).max() for c in s.accelerations.values()) > 1e-3
    assert slipping > count // 4  # not all of them stick


def test_eight_frictional_points_are_solved(talos, rng):
    """The corners of both soles as points with friction: rank-deficient rows, 32 rays."""
    points = lambda mu: [  # noqa: E731
        rbd.PointContact(f"{sole.name}_{i}", sole.frame, offset=sole.placement.act(c), friction=mu)
        for sole in talos.soles()
        for i, c in enumerate(sole.corners)
    ]
    state = talos.standing()
    hold = rbd.hold(state, talos.soles(0.7)).tau
    for _ in range(60):
        mu, tau = rng.uniform(0.05, 1.0), hold + rng.uniform(2.0, 60.0) * rng.normal(size=talos.nu)
        s = rbd.solve(state, tau, points(mu), solver=rbd.ProxQP())
        assert s.status == "solved" and s.problem.m == 24
        assert max(law_residuals(s.problem, s, "convex").values()) < 1e-9
        surface = rbd.solve(state, tau, talos.soles(mu), solver=rbd.ProxQP())  # the same law, said in twelve rows
        assert np.abs(s.a - surface.a).max() < 1e-7 * max(1.0, np.abs(s.a).max())
        left = sum(s.forces[f"left_sole_{i}"] for i in range(4))
        assert left == pytest.approx(surface.forces["left_sole"][:3], abs=1e-6 * max(1.0, np.abs(left).max()))


def test_a_sole_that_holds_is_the_limit_of_great_friction(talos):
    """Where the held wrench lies in the cone, friction changes nothing."""
    state = talos.standing()
    tau = rbd.hold(state, talos.soles(0.7)).tau
    held = rbd.solve(state, tau, talos.soles(None), solver=rbd.ProxQP())
    rubbing = rbd.solve(state, tau, talos.soles(0.7), solver=rbd.ProxQP())
    assert np.abs(held.a - rubbing.a).max() < 1e-8 and np.abs(rubbing.a).max() < 1e-8
    assert np.abs(held.multipliers - rubbing.multipliers).max() < 1e-6
    total = sum(f[:3] for f in rubbing.forces.values())
    assert total == pytest.approx([0, 0, talos.mass * 9.81], abs=1e-9 * talos.mass * 9.81)


@pytest.mark.filterwarnings("ignore::rbd.errors.InaccurateWarning")
def test_numbers_that_ProxSuite_does_not_end_with_displace_no_answer(talos):
    """With friction 1e6 some settings end in NaN, others in the motion: Talos stands still."""
    state, soles = talos.standing(), talos.soles(1e6)
    s = rbd.solve(state, rbd.hold(state, soles).tau, soles, solver=rbd.ProxQP())
    assert np.abs(s.a).max() < 1e-4 and s.residuals.worst < 1e-7


@pytest.mark.parametrize("mu", [1e9, 1e12, 1e15])
def test_friction_beyond_what_a_pyramid_can_carry_is_named(talos, mu):
    """Rays of 1e9 N cancel to 10 N with 1e-6 N of rounding: said with the contact, and true cones solve it."""
    state = talos.standing()
    tau = rbd.hold(state, talos.soles(0.7)).tau
    left, right = talos.soles(mu)[0], talos.soles(0.7)[1]
    words = re.escape(f"left_sole has friction {mu:.3g}, too much for a pyramid")
    with pytest.raises(rbd.NoSolution, match=rf"^{words}.*rbd\.ConeSolver"):
        rbd.solve(state, tau, [left, right], solver=rbd.ProxQP())
    s = rbd.solve(state, tau, [left, right], solver=rbd.ConeSolver(law="convex"))
    assert s.status == "solved" and np.abs(s.a).max() < 1e-8


@pytest.mark.parametrize("seed", range(40))
def test_a_light_body_that_contacts_squeeze_is_as_still_as_they_hold_it(seed):
    """Half a gram that weight would accelerate at 1 m/s2, under a sole and a line with friction 1000, and dry friction.

    ProxSuite squeezes it with kilonewtons; rounding of those moves it at 1e-9 m/s2. A few millinewtons hold it, and no longer
    move it once the squeezing is eased.
    """
    rng = np.random.default_rng(seed)
    J, K = np.zeros((6, 1)), np.zeros((5, 1))
    J[:3, 0], K[:3, 0] = rng.normal(size=3), rng.normal(size=3)
    corners = [[0.04, 0.01, 0.0], [-0.02, 0.01, 0.0], [-0.01, -0.02, 0.0], [0.02, -0.02, 0.0]]
    rows = [
        Rows("sole", J, np.zeros(6), rbd.problem.WrenchCone(corners, 1e3)),
        Rows("line", K, np.zeros(5), rbd.problem.LineCone(0.005, 1e3)),
        Rows("friction", np.eye(1), np.zeros(1), rbd.problem.Bounds([-1.0], [1.0])),
    ]
    P = rbd.GaussProblem(5e-4 * np.eye(1), np.array([5e-4]), rows)
    s = rbd.solve_problem(P, solver=rbd.ProxQP())
    assert s.status == "solved" and abs(s.a[0]) < 1e-9
    eased = proxqp.eased(rbd.ProxQP().solve(P))
    assert eased.residuals.worst < 1e-11 and abs(eased.a[0]) < 1e-11 and np.abs(eased.multipliers).max() < 2e-2


def test_few_weights_have_the_force_of_many():
    """A line along x that must pull, one along y, and rays beside it that press against each other: at most as many as rows."""
    along = np.array([[1.0, 0.0], [0.0, 1.0], [0.5, 1.0], [0.5, -1.0], [1.0, 0.0]])
    weights, holds = np.array([-900.0, 5.0, 300.0, 310.0, 100.0]), np.arange(5) < 2
    few = proxqp._on_few(weights, along, holds, np.inf)
    assert along.T @ few == pytest.approx(along.T @ weights, rel=1e-12) and np.count_nonzero(few) <= 2
    assert few[0] < 0.0 and (few[2:] >= 0.0).all()


def test_little_weights_that_the_last_step_turns_negative_take_no_part_in_it():
    """Two rays of one direction that are to carry 0.9 together, a guess of 1 and 2e-8: not 0.95 and 0, but 0.9 and 0."""
    guess, along = np.array([1.0, 2e-8]), np.ones((2, 1))
    found = proxqp._polished(guess, along, np.full(2, -0.9), np.zeros(2, bool))
    assert found.tolist() == pytest.approx([0.9, 0.0], abs=1e-15)


def test_more_facets_leave_less_freedom(talos, rng):
    """The 8-facet pyramid lies in the 4-facet one and the 16-facet one in that: Gauss's function does not fall with facets.

    With K smaller, K* is larger: a is less constrained, so it comes nearer to free motion.
    """
    state = talos.standing()
    tau = rbd.hold(state, talos.soles(0.7)).tau + 40.0 * rng.normal(size=talos.nu)
    values = [rbd.solve(state, tau, talos.soles(0.3, facets=n), solver=rbd.ProxQP()).gauss for n in (4, 8, 16)]
    assert values[0] >= values[1] * (1 - 1e-9) and values[1] >= values[2] * (1 - 1e-9)


def test_mixed_kinds_in_one_problem(talos, rng):
    """A rubbing sole, a smooth toe point, a held hand: each law is kept."""
    state = talos.standing()
    contacts = [
        talos.soles(0.5)[0],
        rbd.PointContact("toe", talos.soles()[1].frame, offset=talos.soles()[1].placement.translation, friction=0.0),
        rbd.PointContact("hand", "gripper_left_base_link", on=rbd.Ground(normal=(1.0, 0.0, 0.0))),
    ]
    for _ in range(10):
        s = rbd.solve(state, 20.0 * rng.normal(size=talos.nu), contacts, solver=rbd.ProxQP())
        assert s.status == "solved" and str(s.law) == "convex, 4 facets"
        assert max(law_residuals(s.problem, s, "convex").values()) < 1e-9
        assert s.forces["toe"][2] >= 0.0 and not s.forces["toe"][:2].any()
        assert np.abs(s.accelerations["hand"]).max() < 1e-8


def one_row(rhs: float, cone, *, velocity: float = 0.0, bias: float = 0.0) -> rbd.problem.Answer:
    """A mass of 2 kg under a force, on one row of a set."""
    rows = [Rows("row", np.eye(1), np.array([bias]), cone, velocity=np.array([velocity]))]
    return rbd.ProxQP().solve(rbd.GaussProblem(2.0 * np.eye(1), np.array([rhs]), rows))


class TestBounds:
    """Forces between two bounds: c > 0 has f at the lower one, c < 0 at the upper one."""

    @pytest.mark.parametrize("lo", [-5.0, -1.0, 0.0, 2.0])
    @pytest.mark.parametrize("width", [0.0, 1e-3, 3.0, 1e4, np.inf])
    @pytest.mark.parametrize("upside_down", [False, True])
    @pytest.mark.parametrize(("rhs", "bias"), [(4.0, 0.0), (-4.0, 0.0), (0.0, 0.0), (-3.0, 3.0), (100.0, -70.0)])
    def test_one_row_by_hand(self, lo, width, upside_down, rhs, bias):
        """The force that would hold, -(rhs + 2 bias), clipped; half-bounded and one-pointed sets too."""
        lo, hi = (-(lo + width), -lo) if upside_down else (lo, lo + width)
        s = one_row(rhs, rbd.problem.Bounds([lo], [hi]), bias=bias)
        expected = np.clip(-(rhs + 2.0 * bias), lo, hi)
        assert s.status is rbd.problem.Status.SOLVED
        assert s.multipliers[0] == pytest.approx(expected, abs=1e-9 * max(1.0, abs(expected)))
        assert s.a[0] == pytest.approx(0.5 * (rhs + expected), abs=1e-9 * max(1.0, abs(expected)))

    @pytest.mark.parametrize(("velocity", "force"), [(1e-5, -5.0), (-1e-5, 5.0), (1e-7, -1.0), (-1e-7, -1.0)])
    def test_a_velocity_decides(self, velocity, force):
        """Moving, it stands at the bound against the motion, though the push of 1 N could be held; at rest it holds."""
        s = one_row(1.0, rbd.problem.Bounds([-5.0], [5.0]), velocity=velocity)
        assert s.status is rbd.problem.Status.SOLVED and s.multipliers[0] == pytest.approx(force, abs=1e-12)

    def test_beside_pyramids_they_are_certified_by_facets(self, rng):
        """A moving interval among rays: the law speaks of facets, and the bound against the motion holds in it."""
        A = rng.normal(size=(5, 5))
        rub = Rows(
            "rub", np.eye(5)[:2], np.zeros(2), rbd.problem.Bounds([-1.0, -2.0], [1.0, 2.0]), velocity=np.array([0.3, -0.2])
        )
        foot = Rows("foot", np.eye(5)[2:], np.zeros(3), rbd.problem.FrictionCone(0.5))
        P = rbd.GaussProblem(A @ A.T + np.eye(5), rng.normal(size=5) - 3.0 * np.eye(5)[4], [rub, foot])
        s = rbd.ProxQP().solve(P)
        assert str(s.law) == "convex, 4 facets" and s.status is rbd.problem.Status.SOLVED
        assert s.forces["rub"].tolist() == [-1.0, 2.0]

    def test_turned_upside_down_a_problem_is_the_same(self, rng):
        """Bounds from above with the rows, from below with the rows negated: one program, in the same iterations."""
        for _ in range(20):
            A, J, bias, top = rng.normal(size=(8, 8)), rng.normal(size=(5, 8)), rng.normal(size=5), rng.uniform(-3.0, 3.0, 5)
            M, rhs, none = A @ A.T + 0.1 * np.eye(8), 30.0 * rng.normal(size=8), np.full(5, np.inf)
            above = rbd.ProxQP().solve(rbd.GaussProblem(M, rhs, [Rows("rows", J, bias, rbd.problem.Bounds(-none, top))]))
            below = rbd.ProxQP().solve(rbd.GaussProblem(M, rhs, [Rows("rows", -J, -bias, rbd.problem.Bounds(-top, none))]))
            assert above.status is rbd.problem.Status.SOLVED and above.iterations == below.iterations
            assert np.abs(above.a - below.a).max() < 1e-12 * np.abs(above.a).max()
            assert np.abs(above.multipliers + below.multipliers).max() < 1e-12 * np.abs(above.multipliers).max()

    @pytest.mark.parametrize("scale", [1e-3, 1.0, 30.0])
    def test_a_robot_whose_joints_all_rub(self, talos, rng, scale):
        """Two soles and 32 boxes: proved, also by the second code; some joints stick and some slip."""
        state = talos.standing()
        joints = [j for j in talos.joints if j != "root_joint"]
        rubbing = [rbd.JointFriction(f"{j} rubs", j, scale * rng.uniform(0.0, 3.0)) for j in joints]
        for _ in range(5):
            tau = np.clip(30.0 * rng.normal(size=talos.nu), -talos.effort_limit, talos.effort_limit)
            P = rbd.gauss_problem(state, tau, [*talos.soles(0.7), *rubbing])
            s = rbd.ProxQP().solve(P)
            assert s.status is rbd.problem.Status.SOLVED and max(law_residuals(P, s, "convex").values()) < 1e-9

    def test_what_slides_is_refused_by_name(self):
        """No pyramid of forces follows a motion."""
        rows = [
            Rows("brake", np.eye(3)[:1], np.zeros(1), rbd.problem.Bounds([-1.0], [1.0]), velocity=np.array([1.0])),
            Rows("skid", np.eye(3), np.zeros(3), rbd.problem.FrictionCone(0.5), velocity=np.array([0.2, 0.0, 0.0])),
        ]
        reason = rbd.ProxQP().reason_unsupported(rbd.GaussProblem(np.eye(3), np.ones(3), rows))
        assert "'skid' moves at 0.2 m/s" in reason and "ConeSolver" in reason and "brake" not in reason


def test_the_policy_is_followed_until_an_answer_is_solved():
    """A first setting that stops after one iteration is followed by the next."""
    P = next(iter(pushed_problems("talos", 1, 5)))[2]
    lame = qp.Setting(max_iter=1)
    alone = rbd.ProxQP(policy=(lame,)).solve(P)
    retried = rbd.ProxQP(policy=(lame, *qp.POLICY)).solve(P)
    assert retried.status == "solved" and retried.iterations > 1
    assert alone.status != "solved" or np.abs(alone.a - retried.a).max() < 1e-7  # the polish may rescue it


def test_units_of_mass_change_nothing_but_the_forces():
    """M, rhs and forces a million times larger or smaller: the same acceleration, and solved."""
    P = next(iter(pushed_problems("talos", 1, 9)))[2]
    a = rbd.ProxQP().solve(P).a
    for scale in (1e-3, 1e3, 1e6):
        s = rbd.ProxQP().solve(rbd.GaussProblem(scale * P.M, scale * P.rhs, P.rows))
        assert s.status == "solved" and np.abs(s.a - a).max() < 1e-6 * np.abs(a).max()


@pytest.mark.parametrize("friction", [1e-9, 1e-4, 10.0, 1e3])
def test_extreme_friction_is_solved(talos, friction, rng):
    """From ice to glue."""
    state = talos.standing()
    for _ in range(5):
        s = rbd.solve(state, 10.0 * rng.normal(size=talos.nu), talos.soles(friction), check=False, solver=rbd.ProxQP())
        assert s.status == "solved", s


if __name__ == "__main__":
    warnings.simplefilter("ignore", rbd.errors.EffortLimitWarning)
    for robot in ("talos", "talos_full", "g1", "g1_hands"):
        answers = [rbd.ProxQP().solve(problem) for _, _, problem in pushed_problems(robot, 1000, seed=1)]
        worst = np.array([s.residuals.worst for s in answers])
        solved, tries = (worst <= 1e-9).mean(), np.mean([s.iterations for s in answers])
        seconds = np.median([s.seconds for s in answers])
        slip = np.mean([max(np.abs(c).max() for c in s.accelerations.values()) > 1e-3 for s in answers])
        print(
            f"{robot:12} {100 * solved:.2f} % solved, worst {worst.max():.1e}, 99.9 % at {np.quantile(worst, 0.999):.1e}, "
            f"{100 * slip:.0f} % slip or lift, {tries:.1f} iterations, {1e6 * seconds:.0f} us"
        )
