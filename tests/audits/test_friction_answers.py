"""Answers of friction problems: closed forms, residuals that see each fault, drawn problems, solvers side by side."""

from __future__ import annotations

import numpy as np
import pytest

import rbd
from rbd.audits.bench import FrictionProblem, compare, humanoid_problems, solve, spheres_in_a_box
from rbd.audits.bench.friction import SOLVED, _nearest

MU, MU_R = 0.5, 0.2
PUSHED = {
    "opens": ([1.0, 2.0, 0.0], [0.0, 0.0, 0.0]),
    "sticks": ([-1.0, 0.3, 0.0], [1.0, -0.3, 0.0]),
    "slides": ([-1.0, 3.0, 4.0], [1.0, -MU * 0.6, -MU * 0.8]),
    "slides in the plane": ([-1.0, 2.0], [1.0, -MU]),
    "slides and rolls": ([-1.0, 2.0, 0.0, 0.0, -3.0], [1.0, -MU, 0.0, 0.0, MU_R]),
    "slides without rolling": ([-1.0, 2.0, 0.0, 0.0, -0.1], [1.0, -MU, 0.0, 0.0, 0.1]),
}
"""{what a contact of unit inertia does: (q, r)}: closed forms."""


def alone(q: list[float]) -> FrictionProblem:
    rolling = [MU_R] if len(q) == 5 else None
    return FrictionProblem("alone", len(q), mu=[MU], mu_r=rolling, W=np.eye(len(q)), q=q)


class TestOneContact:
    """Closed forms, and faults in them."""

    @pytest.mark.parametrize("what", PUSHED)
    def test_forces_are_those_of_the_closed_form(self, what):
        """It opens, sticks, slides against its friction, rolls against its moment."""
        q, r = PUSHED[what]
        answer = solve(alone(q))
        np.testing.assert_allclose(answer.r, r, atol=1e-14)
        assert answer.solved and answer.complementarity < 1e-14 and answer.outside < 1e-15 and answer.fclib_error < 1e-14

    @pytest.mark.parametrize("what", PUSHED)
    def test_every_fault_of_a_force_is_seen(self, what):
        """Scaled, turned, pulling, without friction: the residual is of the fault's size, and no answer is called solved."""
        q, r = PUSHED[what]
        problem, exact = alone(q), np.array(r)
        step = np.eye(len(q))[0]
        faults = [exact + 0.01 * step, exact - 0.01 * step, exact + 0.01 * np.roll(step, 1)]
        for wrong in faults:
            assert 1e-3 < problem.answer(wrong).natural_map < 0.1
        assert problem.answer(exact + 1e-11 * step).verdict == "not solved"

    def test_the_convex_law_lifts_what_slides(self):
        """With r = (r_n, -mu r_n) and u_n = mu |u_t|: r_n - 1 = mu (2 - mu r_n), which Coulomb's law does not call solved."""
        r_n = (1.0 + 2.0 * MU) / (1.0 + MU * MU)
        answer = alone([-1.0, 2.0, 0.0]).answer(np.array([r_n, -MU * r_n, 0.0]))
        assert answer.convex_map < 1e-15 and answer.natural_map > 0.1

    def test_projections_on_rolling_cones_are_nearest(self):
        """Inside the cone, and no other point of it makes an acute angle (the obtuse-angle criterion)."""
        rng = np.random.default_rng(0)
        p, mu, mu_r = 2.0 * rng.normal(size=(500, 5)), np.full(500, MU), np.full(500, MU_R)
        found = _nearest(p, mu, mu_r)
        for disc, u in ((slice(1, 3), MU), (slice(3, 5), MU_R)):
            assert (np.linalg.norm(found[:, disc], axis=1) <= u * found[:, 0] + 1e-15).all()
        turn = rng.uniform(0.0, 2.0 * np.pi, (2, 500))
        rim = np.column_stack(
            [np.ones(500), MU * np.cos(turn[0]), MU * np.sin(turn[0]), MU_R * np.cos(turn[1]), MU_R * np.sin(turn[1])]
        )
        assert ((p - found) @ rim.T).max() < 1e-13 and np.abs(((p - found) * found).sum(axis=1)).max() < 1e-13


class TestForms:
    """Local, global and least-constraint problems."""

    def test_a_global_problem_and_its_local_one_have_the_same_answer(self):
        """W = H^T M^-1 H and q = H^T M^-1 f + w, of a robot; the judge's residual is the same."""
        given = next(humanoid_problems(1))
        local = FrictionProblem("local", 3, mu=given.mu, W=given.delassus, q=given.free)
        answer = solve(given)
        assert answer.solved and local.answer(answer.r).natural_map < 1e-10  # the digits of M's inverse are in W and q
        np.testing.assert_allclose(local.answer(answer.r).u, answer.u, atol=1e-10)

    @pytest.mark.parametrize("what", ["opens", "sticks", "slides", "slides in the plane"])
    def test_every_solver_of_rbd_takes_it_as_a_least_constraint_problem(self, what):
        """Normals last, planes embedded in space; the forces come back in the file's order."""
        q, r = PUSHED[what]
        problem = alone(q)
        found = rbd.solve_problem(problem.gauss)
        np.testing.assert_allclose(problem.forces_of(found.multipliers), r, atol=1e-12)

    def test_what_is_no_least_constraint_problem_says_why(self):
        """Rolling, a W that is not symmetric, one with an eigenvalue below zero."""
        uneven = FrictionProblem("uneven", 3, mu=[0.5], W=np.eye(3) + 1e-3 * np.eye(3, k=1), q=[-1.0, 0.0, 0.0])
        for problem, told in ((alone(PUSHED["slides and rolls"][0]), "resists rolling"), (uneven, "W is symmetric|symmetric")):
            with pytest.raises(rbd.errors.Unsupported, match=told):
                problem.gauss  # noqa: B018
        assert solve(uneven).solved
        with pytest.raises(rbd.InputError, match="eigenvalue -1"):
            FrictionProblem("pulls", 3, mu=[0.5], W=np.diag([1.0, 1.0, -1.0]), q=np.zeros(3)).gauss  # noqa: B018

    @pytest.mark.parametrize(
        ("changes", "told"),
        [
            ({"dim": 4}, "dimension is 4"),
            ({"W": None}, "expected W and q of a local problem"),
            ({"W": np.eye(4)}, "W"),
            ({"q": [0.0, np.inf, 0.0]}, "q .* not finite"),
            ({"mu": [[0.5]]}, "mu"),
        ],
    )
    def test_nonsense_is_refused_by_its_field(self, changes, told):
        """Sizes and numbers."""
        given = {"dim": 3, "mu": [0.5], "W": np.eye(3), "q": np.zeros(3)}
        with pytest.raises(rbd.InputError, match=told):
            FrictionProblem("nonsense", **(given | changes))

    def test_badly_scaled_is_what_has_inertias_a_million_apart(self):
        """Its tolerance is 1e-9 in place of 1e-12."""
        for far, tolerance in ((1e5, SOLVED), (1e7, 1e-9)):
            W = np.diag(np.repeat([1.0, far], 3))
            assert FrictionProblem("far", 3, mu=[0.5, 0.5], W=W, q=np.zeros(6)).tolerance == tolerance


class TestDrawnProblems:
    """Humanoids, and spheres in a box."""

    def test_each_scene_is_solved_and_a_seed_repeats_it(self):
        """Two of each; the same bits from the same seed, others from another."""
        for problem, again in zip(humanoid_problems(14, seed=3), humanoid_problems(14, seed=3), strict=True):
            answer = solve(problem)
            assert answer.solved and answer.r.any(), problem.name
            np.testing.assert_array_equal(again.f, problem.f)
        other = next(humanoid_problems(1, seed=4))
        assert not np.array_equal(other.f, next(humanoid_problems(1, seed=3)).f)

    def test_painleves_paradox_holds_where_its_first_point_slides(self):
        """A normal force with its friction presses the point down: W_nn - mu W_nt . d < 0."""
        for problem in humanoid_problems(4, scenes=["Painleve"]):
            W, slip = problem.delassus.toarray(), problem.free[1:3]
            assert W[0, 0] - problem.mu[0] * W[0, 1:3] @ slip / np.linalg.norm(slip) < 0.0

    def test_redundant_soles_have_more_contacts_than_their_forces_decide(self):
        """Rank 12 of two soles."""
        problem = next(humanoid_problems(1, scenes=["redundant soles"]))
        assert np.linalg.matrix_rank(problem.delassus.toarray(), tol=1e-8) == 12 < 3 * len(problem.mu)

    def test_nonsense_is_refused(self):
        """A scene that there is not, numbers that are none."""
        for asked, told in (
            ({"scenes": ["dance"]}, "a scene is 'dance'"),
            ({"count": -1}, "count is -1"),
            ({"seed": 0.5}, "seed is 0.5"),
        ):
            with pytest.raises(rbd.InputError, match=told):
                next(humanoid_problems(**asked))
        for asked, told in (({"side": 1}, "side is 1"), ({"friction": -1.0}, "friction is -1")):
            with pytest.raises(rbd.InputError, match=told):
                spheres_in_a_box(**asked)

    def test_the_floor_of_a_box_of_spheres_carries_their_weight(self):
        """Spheres at rest: u = 0, and vertical impulses of floor and walls are n m g dt."""
        problem = spheres_in_a_box(4, 3)
        answer = solve(problem)
        n = problem.M.shape[0] // 6
        mass = problem.M.diagonal()[0]
        upwards = (problem.H @ answer.r)[2::6].sum()
        assert answer.solved and np.abs(answer.u).max() < 1e-14
        np.testing.assert_allclose(upwards, n * mass * 9.81 * 1e-3, rtol=1e-12)


class TestSolvers:
    """Several solvers, judged by one residual."""

    def test_solvers_are_judged_by_their_law(self):
        """One contact slides: Coulomb's solvers solve it, and those of the convex law solve theirs."""
        pytest.importorskip("mujoco")
        found = compare([alone(PUSHED["slides"][0])])
        maps = {name: found.taken(name)[0] for name in found.answers}
        solved = {name for name, answer in maps.items() if answer.solved}
        assert solved == {"rbd, sparse Newton", "rbd, default solver", "Pinocchio, ADMM", "Pinocchio, PGS"}
        convex = {name for name, answer in maps.items() if answer.convex_map < 1e-8}
        assert convex == {"Clarabel, convex law", "MuJoCo, PGS, convex law"}
        assert found.table().count("\n") == 2 + len(maps)

    def test_a_solver_that_cannot_take_a_problem_says_why(self):
        """And does not count; an unknown one is refused."""
        found = compare([alone(PUSHED["slides and rolls"][0])], ["rbd, sparse Newton", "Pinocchio, PGS"])
        assert found.solved("rbd, sparse Newton") == 1 and not found.taken("Pinocchio, PGS")
        assert "resists rolling" in str(found.answers["Pinocchio, PGS"][0])
        with pytest.raises(rbd.InputError, match="a solver is 'magic'"):
            compare([], ["magic"])
