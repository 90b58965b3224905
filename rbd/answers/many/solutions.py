"""`Solutions`: what `solve_many` returns, arrays over states; each state's whole `Solution` on demand."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from rbd.answers.least_constraint import posed, refuse_moving
from rbd.answers.many.answers import ManyAnswers
from rbd.answers.many.blocks import of_row
from rbd.answers.many.states import ManyStates
from rbd.answers.many.warned import MOVES, OPENED, SEVERAL, of_rows
from rbd.answers.solution import Solution, solution_of
from rbd.arrays import Array
from rbd.constraints.distance_warnings import moves
from rbd.displayed import Displayed
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


@dataclass(frozen=True, eq=False, repr=False)
class Solutions(ManyAnswers, Displayed):
    """The answers of `rbd.solve_many`: accelerations and contact forces at n states as arrays, each with its residuals.

    `solutions[i]` is the whole `Solution` of state i, with everything that can be asked of one.

    Attributes:
        states: The robot, q, v and what acts at each state.
        a: Accelerations, shape (n, nv) [m/s2, rad/s2]; NaN where there is no answer, as in the other arrays.
        forces: {constraint: (n, 3) of a point, (n, 6) of a surface}, on the robot, world axes [N, N m]; row forces (n, m) of
            others.
        corner_forces: {contact: (n, k, 3)}, world axes [N].
        friction_used: {contact: `|f_t| / (mu f_n)` of its net force, shape (n,)}.
        centre_of_pressure: {contact: point in W, shape (n, 3) [m]}.
        residuals: {equation: scaled residual, shape (n,)}.
        status: A `StateStatus` of each state, shape (n,), integers.
        reason_codes: `rbd.errors.Reason.code` of each state, shape (n,), integers; 0 where there is an answer.
        reasons: {state: message} where it is not solved.
        methods: Names of the methods that answered; `method_codes`, shape (n,), says which did where.
        one_by_one: Which states were answered one by one, shape (n,), truth values.
        warned: {what: states that a single answer would have warned of, shape (n,)}.
        law: The law of all answers.
        rest_speed: As of `rbd.solve`.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> pushes = np.zeros((3, solo.nv))
        >>> pushes[:, 0] = [0.0, 5.0, 10.0]  # forward on the trunk [N]
        >>> solutions = rbd.solve_many(solo, solo.standing().q, None, np.zeros(solo.nu), solo.feet(), external=pushes)
        >>> solutions.a[:, 0].round(3), solutions.friction_used["front_left"].round(3)
        (array([0.   ,  2.314,  4.629]), array([0.854, 0.805, 0.754]))
        >>> print(solutions[2].status)
        solved
    """

    law: Law
    rest_speed: float

    @property
    def tau(self) -> Array:
        """The motor torques that were given, shape (n, nu) [N, N m]."""
        return self.states.vectors["tau"]

    def __getitem__(self, i: int) -> Solution:
        """The whole `Solution` of state i: of its row, or solved again if it was answered one by one.

        Where there is no answer, the best that was found.

        Raises:
            InputError: state i is no input; i is no whole number.
            ContactMoves: a contact moves as the law does not cover.
            IndexError: there is no such state.
        """
        at = self.index(i)
        if self.one_by_one[at] or not self.answered[at]:
            return answer_at(self.states, at, self.law, self.rest_speed)
        forces = {name: values[at] for name, values in self.forces.items()}
        corners = {name: values[at] for name, values in self.corner_forces.items()}
        method = self.methods[self.method_codes[at]]
        return of_row(self.states, at, self.a[at], forces, corners, method, self.law, self.rest_speed)

    def __iter__(self) -> Iterator[Solution]:
        return (self[i] for i in range(len(self)))
