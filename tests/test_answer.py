"""What a solver returns, what is made of it, and the door for problems in arrays."""

from __future__ import annotations

import copy
import pickle
from dataclasses import dataclass, replace

import numpy as np
import pytest

import rbd
from rbd.errors import ContactMoves, InaccurateWarning, InputError, NonUniqueMotionWarning, NoSolution, Unsupported
from rbd.problem.rows import Patch, Rows
from rbd.solvers.default import GaussFirst

G = 9.81


def block(push_N: float = 80.0, velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> rbd.GaussProblem:
    """10 kg on a floor with mu = 0.6, pushed along x."""
    patch = Patch(np.zeros(3), np.eye(3), np.zeros((1, 3)), 0.6)
    resultant = np.eye(6, 3)[:3]
    floor = Rows(
        "floor",
        np.eye(3),
        np.zeros(3),
        rbd.problem.FrictionCone(0.6),
        velocity=np.array(velocity),
        resultant=resultant,
        patch=patch,
    )
    return rbd.GaussProblem(10.0 * np.eye(3), np.array([push_N, 0.0, -10.0 * G]), [floor])


def legs(cone: rbd.problem.cones.Cone | None = None) -> rbd.GaussProblem:
    """A plate on four legs, its weight of 400 N at (0.45, 0.2) m: 4 rows of rank 3, one more than needed."""
    rows = []
    for name, (x, y) in {"++": (0.6, 0.4), "+-": (0.6, -0.4), "-+": (-0.6, 0.4), "--": (-0.6, -0.4)}.items():
        rows.append(Rows(name, np.array([[1.0, y - 0.2, 0.45 - x]]), np.zeros(1), cone or rbd.problem.NonNegative(1)))
    return rbd.GaussProblem(np.eye(3), np.array([-400.0, 0.0, 0.0]), rows)


def apart(size: float = 1.0) -> rbd.GaussProblem:
    """Two rows that ask for accelerations 0 and `size` along x: the nearest is half of it."""
    e = np.eye(2)[:1]
    rows = [Rows("one", e, np.zeros(1), rbd.problem.Free(1)), Rows("two", e, np.array([-size]), rbd.problem.Free(1))]
    return rbd.GaussProblem(np.eye(2), np.array([3.0, 4.0]), rows)


@pytest.mark.parametrize("solver", [rbd.KKT(), rbd.ProxQP(), rbd.ConeSolver()], ids=repr)
def test_a_solver_returns_a_plain_answer_that_arithmetic_judges(solver) -> None:
    """Residuals, status, forces, accelerations, contacts, Gauss's function; no analysis."""
    P = block() if solver.reason_unsupported(block()) is None else apart(0.0)
    answer = solver.solve(P)
    assert (
        type(answer) is rbd.problem.Answer
        and answer.status is rbd.problem.Status.SOLVED
        and repr(answer).startswith("Answer(solved")
    )
    assert answer.a_free is P.a_free and answer.residuals.worst < 1e-9
    solution = rbd.Solution.of(answer)
    for name, force in solution.forces.items():
        assert np.abs(answer.forces[name] - force).max() < 1e-12
        assert np.array_equal(answer.accelerations[name], solution.accelerations[name])
    assert answer.gauss == pytest.approx(solution.gauss) and answer.rank == solution.rank == (3 if P.m == 3 else 1)
    assert not hasattr(answer, "uniqueness") and not hasattr(answer, "contradiction")


def test_a_solution_takes_what_is_known_of_its_answer() -> None:
    """The residuals are computed once; a solution is its own; what is no answer is refused."""
    answer = rbd.ProxQP().solve(block())
    solution = rbd.Solution.of(answer)
    assert solution.residuals is answer.residuals and solution.a is answer.a and rbd.Solution.of(solution) is solution
    assert repr(solution).startswith("Solution(solved") and "floor" in str(solution)
    for wrong in (None, 3.0, {"a": 1.0}):
        with pytest.raises(InputError, match="a solver gave .*; expected an rbd.problem.Answer"):
            rbd.Solution.of(wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize("way", [copy.copy, copy.deepcopy, lambda x: pickle.loads(pickle.dumps(x))])
def test_answers_and_their_solutions_travel(way) -> None:
    """A copy has the same numbers, and computes the rest again."""
    for one in (rbd.ProxQP().solve(legs()), rbd.Solution.of(rbd.ProxQP().solve(block()))):
        other = way(one)
        assert type(other) is type(one) and np.array_equal(other.a, one.a) and str(other) == str(one)


@pytest.mark.parametrize("solver", [rbd.ProxQP(), rbd.ConeSolver(law="convex"), rbd.ConeSolver()], ids=repr)
def test_where_rows_repeat_each_other_the_solver_says_so_and_the_solution_takes_the_shortest_forces(solver) -> None:
    """Four legs: 250, 100, 50 and 0 N, the shortest that push; any other forces of the same motion will do for the solver."""
    answer = solver.solve(legs())
    assert answer.redundant and answer.status is rbd.problem.Status.SOLVED
    internal = np.array([1.0, -1.0, -1.0, 1.0])
    for f in (answer.multipliers, np.array([275.0, 75.0, 25.0, 25.0])):
        assert np.abs(legs().J.T @ internal).max() < 1e-14
        given = replace(answer, multipliers=f, weights=f)
        solution = rbd.Solution.of(given)
        assert solution.multipliers == pytest.approx([250.0, 100.0, 50.0, 0.0], abs=1e-9)
        assert solution.force_choice == "minimum norm of the corner forces [N]"
        kept = rbd.Solution.of(replace(given, redundant=False))
        assert kept.multipliers is f


def test_rows_that_do_not_repeat_each_other_are_said_to_be_so() -> None:
    """Then forces are the solver's, to the last digit."""
    for solver in (rbd.ProxQP(), rbd.ConeSolver()):
        answer = solver.solve(block())
        assert not answer.redundant and rbd.Solution.of(answer).multipliers is answer.multipliers
    held, twice = rbd.KKT().solve(apart(0.0)), rbd.KKT().solve(legs(rbd.problem.Free(1)))
    assert held.redundant and twice.redundant
    assert rbd.Solution.of(twice).multipliers == pytest.approx([225.0, 125.0, 75.0, -25.0])


def test_other_motions_become_solutions_too() -> None:
    """Painleve's rod at rest: two motions, each with its own analysis."""
    L = np.linalg.cholesky(np.array([[1.0, 0.0, 0.9], [0.0, 1.0, 0.0], [0.9, 0.0, 1.0]]))
    rows = [Rows("point", L, np.zeros(3), rbd.problem.FrictionCone(1.5))]
    P = rbd.GaussProblem(np.eye(3), np.linalg.solve(L, np.array([1.0, 0.0, 0.1])), rows)
    answer = rbd.ConeSolver(starts=20).solve(P)
    assert [type(other) for other in answer.others] == [rbd.problem.Answer]
    with pytest.warns(NonUniqueMotionWarning, match="^the problem has no one motion: 2 were found"):
        solution = rbd.solve_problem(P, solver=rbd.ConeSolver(starts=20))
    assert [type(other) for other in solution.others] == [rbd.Solution]
    assert solution.others[0].uniqueness().law.kind == "coulomb"


class TestTheDoorForArrays:
    """`rbd.solve_problem`: `rbd.solve` without a robot."""

    def test_it_gives_what_solve_gives(self, talos) -> None:
        """The same bits as the general way, and the same to rounding as the prepared one; derivatives too."""
        state, soles = talos.standing(), talos.soles()
        tau = rbd.hold(state, soles).tau
        by_state = rbd.solve(state, tau, soles)
        by_arrays = rbd.solve_problem(rbd.gauss_problem(state, tau, soles))
        general = rbd.solve(state, tau, soles, solver=GaussFirst())
        assert np.array_equal(general.a, by_arrays.a) and np.array_equal(general.multipliers, by_arrays.multipliers)
        assert by_state.a == pytest.approx(by_arrays.a, abs=1e-11)
        assert by_state.multipliers == pytest.approx(by_arrays.multipliers, abs=1e-9)
        assert by_arrays.derivatives().active == by_state.derivatives().active

    def test_the_box_under_both_laws(self) -> None:
        """80 N: it lifts under the convex law, and slides on the ground under Coulomb's."""
        for convex in ({"law": "convex"}, {"solver": rbd.ProxQP()}, {"law": "convex", "solver": rbd.ProxQP()}):
            assert rbd.solve_problem(block(), **convex).contacts["floor"].normal == pytest.approx(107.426470588)
        for coulomb in ({}, {"law": "coulomb"}, {"solver": rbd.ConeSolver()}):
            assert rbd.solve_problem(block(), **coulomb).contacts["floor"].normal == pytest.approx(98.1)

    def test_what_is_no_problem_and_no_solver_is_refused(self) -> None:
        """In words, before anything is computed."""
        with pytest.raises(InputError, match="expected a GaussProblem"):
            rbd.solve_problem("problem")  # type: ignore[arg-type]
        with pytest.raises(InputError, match="expected a solver"):
            rbd.solve_problem(block(), solver=rbd.ProxQP)  # type: ignore[arg-type]
        with pytest.raises(Unsupported, match="KKT takes bilateral constraints"):
            rbd.solve_problem(block(), solver=rbd.KKT())
        with pytest.raises(ContactMoves, match="'floor' approaches"):
            rbd.solve_problem(block(velocity=(0.0, 0.0, -1.0)))
        with pytest.raises(ContactMoves, match="'floor' moves at 1 m/s"):
            rbd.solve_problem(block(velocity=(1.0, 0.0, 0.0)), law="convex")

    @pytest.mark.parametrize("solver", [rbd.ProxQP(), rbd.KKT()], ids=repr)
    def test_rows_that_contradict_each_other_have_the_motion_of_least_violation(self, solver) -> None:
        """Half of what they are apart; raised with the proof, or returned unchecked."""
        with pytest.raises(NoSolution, match="'one' and 'two' contradict each other") as caught:
            rbd.solve_problem(apart(), solver=solver)
        unchecked = rbd.solve_problem(apart(), solver=solver, check=False)
        for found in (caught.value.result, unchecked, caught.value.nearest()):
            assert found.a == pytest.approx([0.5, 4.0], abs=1e-9)
        assert unchecked.status is rbd.problem.Status.INFEASIBLE and unchecked.infeasible and unchecked.problem.m == 2
        assert set(caught.value.contradiction.rows) == {"one", "two"}

    def test_an_inaccurate_answer_of_no_robot_is_said_aloud(self) -> None:
        """Off by 1e-8: the warning speaks of the problem."""
        with pytest.warns(InaccurateWarning, match="Other is inaccurate on the problem"):
            rbd.solve_problem(apart(0.0), solver=Other(1e-8))


@dataclass(frozen=True)
class Other:
    """Somebody's solver: the right answer, or off by a share of it; it may give a reason."""

    share: float = 0.0
    reason: str = ""
    law: str = "bilateral"

    def reason_unsupported(self, problem: rbd.GaussProblem) -> str | None:
        """It takes anything."""
        return None

    def solve(self, problem: rbd.GaussProblem) -> rbd.problem.Answer:
        """By least squares."""
        P, m = problem, problem.m
        system = np.block([[P.M, -P.J.T], [P.J, np.zeros((m, m))]])
        x = np.linalg.lstsq(system, np.concatenate([P.rhs, -P.offset]))[0]
        x = x * (1.0 + self.share)
        return rbd.problem.Answer(P, x[: P.nv], x[P.nv :], None, "bilateral", "Other", 1, 0.0, reason=self.reason)


def test_why_there_is_no_answer_is_found_out_for_solvers_that_do_not_say() -> None:
    """Rows apart: least violation, and a proof. With a reason of its own: its own motion, and the proof all the same."""
    found = rbd.solve_problem(apart(), solver=Other(), check=False)
    assert found.solver == "Other" and found.infeasible and found.a == pytest.approx([0.5, 4.0], abs=1e-12)
    own = Other(reason="it jams").solve(apart())
    told = rbd.solve_problem(apart(), solver=Other(reason="it jams"), check=False)
    assert np.array_equal(told.a, own.a) and not told.infeasible and told.status is rbd.problem.Status.INFEASIBLE
    assert own.status is rbd.problem.Status.FAILED  # without a proof
    with pytest.raises(NoSolution, match="no answer within tolerance .Other"):
        rbd.solve_problem(apart(0.0), solver=Other(1e-3))
