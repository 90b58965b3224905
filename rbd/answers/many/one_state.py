"""The answer at one of many states, by the method of `rbd.solve` for all kinds of constraints."""

from __future__ import annotations

from rbd.answers.least_constraint import posed, refuse_moving
from rbd.answers.many.states import ManyStates
from rbd.answers.many.warned import MOVES, OPENED, SEVERAL, of_rows
from rbd.answers.solution import Solution, solution_of
from rbd.constraints.distance_warnings import moves
from rbd.problem.problem import Law
from rbd.solvers.default import solver_of


def answer_at(states: ManyStates, i: int, law: Law, rest_speed: float) -> Solution:
    """What `rbd.solve(state, ..., check=False)` returns at state i, without its warnings.

    Raises:
        InputError: state i is no input.
        ContactMoves: a contact moves as the law does not cover.
        Unsupported: the solver of the law cannot take the problem.
    """
    problem = posed(states.state(i), states.vectors["tau"][i], states.constraints_at(i), states.external_at(i), rest_speed)
    solver = solver_of(law, None)
    refuse_moving(problem, solver)
    return solution_of(problem, solver)


def warnings_of(states: ManyStates, solution: Solution) -> list[str]:
    """Of what `rbd.solve` would have warned; torques are looked at for all states at once."""
    told, problem = of_rows(states.constraints, solution.problem.rows), solution.problem
    if any(moves(r, problem.rest_speed) for r in problem.rows):
        told.append(MOVES)
    if solution.problem.openings:
        told.append(OPENED)
    return [*told, SEVERAL] if solution.others else told
