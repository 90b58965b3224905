"""`solve_many`: accelerations and contact forces of a robot at many states, as arrays over states: `Solutions`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rbd.answers.least_constraint import posed, refuse_moving
from rbd.answers.many.blocks import by_blocks, found_again
from rbd.answers.many.many_answers import (
    DISTANT,
    INACCURATE,
    LIMIT,
    MOVES,
    OPENED,
    SEVERAL,
    TORQUE,
    ManyAnswers,
    Sheet,
    beyond_limits,
    of_rows,
    warn,
)
from rbd.answers.many.side_by_side import fill
from rbd.answers.many.states import Friction, ManyExternal, ManyStates
from rbd.answers.solution import Solution, solution_of
from rbd.arrays import Array, check_number
from rbd.constraints.constraint import Constraint
from rbd.constraints.distance_warnings import moves
from rbd.constraints.round_feet import balls_beside
from rbd.displayed import Displayed
from rbd.errors import RbdError
from rbd.model.checked_model import CheckedModel
from rbd.problem.answer import Answer, StateStatus
from rbd.problem.contact_motion import REST_SPEED
from rbd.problem.gauss_problem import COULOMB, Law
from rbd.solvers.default import slip_law, solver_of


def solve_many(
    robot: CheckedModel,
    q: Array,
    v: Array | None,
    tau: Array | None,
    constraints: Sequence[Constraint] = (),
    *,
    law: Law | str | None = None,
    external: ManyExternal = None,
    friction: Friction = None,
    rest_speed: float = REST_SPEED,
    t: Array | float = 0.0,
    loops: bool = True,
    threads: int | None = 1,
) -> Solutions:
    """Accelerations and contact forces at n states of one robot: what `rbd.solve` answers at each, as arrays over states.

    Each argument has one row for all states, or one a state; a state that cannot be answered is a row of NaN with a
    `StateStatus` and a message, and no exception. What concerns all states, as a wrong size, is one.

    Memory: the arguments, with one row a state, and the answers, 8 bytes a number: of Talos on two soles 0.9 and 0.55 kB a
    state, 0.4 kB more once forces are read, and working arrays of a few hundred states. Give a million states in parts,
    `for part in np.array_split(q, 20)`.

    Args:
        robot: The robot.
        q: Configurations, shape (n, nq), or (nq,).
        v: Velocities, shape (n, nv), or (nv,) [m/s, rad/s]; None: at rest.
        tau: Motor torques, shape (n, nu), or (nu,) [N, N m].
        constraints: As of `rbd.solve`.
        law: "coulomb", which is the default, or "convex".
        external: Generalised forces (n, nv) or (nv,), or `ExternalForce`s and springs (`rbd.constraints.forces`) that act at
            every state.
        friction: Coefficients that replace the contacts' own: a number or (n,), of all contacts that have one, or
            {contact: a number or (n,)}.
        rest_speed: As of `rbd.solve`.
        t: Times, of constraints that depend on them: a number or (n,) [s].
        loops: Whether the robot's own loops hold; one that is given counts once.
        threads: How many processes answer them, each with a part; None: one a core. The numbers are the same, bit by bit. They
            start with the first such call, in a second or two, and stay: worth it from some 100,000 states, later from 10,000.

    Returns:
        Arrays over states; `solutions[i]` is the whole `Solution` of one. What `rbd.solve` would warn of is in
        `solutions.warned`, and in one warning a kind.

    Raises:
        InputError: wrong sizes, numbers of states that differ, no robot, an unknown law.
        UnknownName: unknown frames, or friction of a contact that is not there.
        DuplicateName: two constraints of one name.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> q = np.tile(solo.standing().q, (3, 1))
        >>> solutions = rbd.solve_many(solo, q, None, np.zeros(solo.nu), solo.feet(), friction=[0.0, 0.02, 0.7])
        >>> solutions.forces["front_left"].round(3)
        array([[ 0.   ,  0.   ,  0.331],
               [-0.007,  0.   ,  0.336],
               [-0.342, -0.03 ,  0.575]])
    """
    asked = COULOMB if law is None else slip_law(law)
    check_number("rest_speed", rest_speed, 0.0, 1e100, expected="a speed of 0 or more [m/s, rad/s]")
    states = ManyStates.of(robot, q, v, constraints, external=external, friction=friction, t=t, tau=tau, loops=loops)
    sheet = Sheet(states)
    fill(sheet, threads, _answer_all, asked, rest_speed)
    sheet.column("warned", TORQUE)[:] = _overloaded(states) & (sheet.status != StateStatus.BAD_INPUT)
    sheet.column("warned", DISTANT)[:] |= balls_beside(states.robot, states.constraints, states.q)
    sheet.column("warned", LIMIT)[:] = beyond_limits(states) & (sheet.status != StateStatus.BAD_INPUT)
    sheet.column("warned", INACCURATE)[:] = sheet.status == StateStatus.INACCURATE
    found = Solutions(**sheet.fields(), law=asked, rest_speed=rest_speed)
    warn(found, stacklevel=2)
    return found


def _answer_all(sheet: Sheet, law: Law, rest_speed: float) -> None:
    """All states of a sheet."""
    sheet.refuse_bad_input()
    for i in by_blocks(sheet, law, rest_speed).tolist():
        _one(sheet, i, law, rest_speed)


def _one(sheet: Sheet, i: int, law: Law, rest_speed: float) -> None:
    """State i, by the way for all constraints."""
    try:
        solution = answer_at(sheet.states, i, law, rest_speed)
        sheet.write(i, solution, solution.corner_forces if solution.residuals.within(1e-7) else {})
    except RbdError as error:
        sheet.refuse(i, error)
        return
    for what in warnings_of(sheet.states, solution):
        sheet.column("warned", what)[i] = True


def _overloaded(states: ManyStates) -> Array:
    """At which states some torque is beyond its limit, shape (n,), of truth values."""
    tau = states.vectors["tau"]
    with np.errstate(invalid="ignore"):
        least, most = states.robot.limits_at(states.v)
        beyond = (tau < least) | (tau > most)
    return np.asarray(beyond.any(axis=1)) if beyond.any() else np.zeros(len(states), bool)


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

    def _chosen(self, i: int) -> tuple[Answer, Mapping[str, Array]]:
        """State i, solved again, with the forces of minimum norm."""
        return self[i], self[i].corner_forces

    def __getitem__(self, i: int) -> Solution:
        """The whole `Solution` of state i, solved again in the way that its row was.

        Where there is no answer, the best that was found.

        Raises:
            InputError: state i is no input; i is no whole number.
            ContactMoves: a contact moves as the law does not cover.
            IndexError: there is no such state.
        """
        at = self.index(i)
        if not self.one_by_one[at] and self.answered[at]:
            found = found_again(self.states, at, self.law, self.rest_speed)
            if found is not None:
                return found
        return answer_at(self.states, at, self.law, self.rest_speed)

    def __iter__(self) -> Iterator[Solution]:
        return (self[i] for i in range(len(self)))
