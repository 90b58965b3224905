"""`solve_many`: accelerations and contact forces of a robot at many states, as arrays, each with its residuals."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rbd.answers.many.answers import Sheet
from rbd.answers.many.blocks import by_blocks
from rbd.answers.many.solutions import Solutions, answer_at, warnings_of
from rbd.answers.many.states import Friction, ManyExternal, ManyStates
from rbd.answers.many.status import StateStatus
from rbd.answers.many.warned import INACCURATE, LIMIT, TORQUE, beyond_limits, warn
from rbd.arrays import Array, as_float
from rbd.constraints.constraint import Constraint
from rbd.errors import InputError, RbdError
from rbd.model.checked_model import CheckedModel
from rbd.problem.contact_motion import REST_SPEED
from rbd.problem.problem import COULOMB, Law
from rbd.solvers.default import slip_law


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
    loops: bool = True,
) -> Solutions:
    """Accelerations and contact forces at n states of one robot: what `rbd.solve` answers at each, as arrays over states.

    Each argument has one row for all states, or one a state; a state that cannot be answered is a row of NaN with a
    `StateStatus` and a message, and no exception. What concerns all states, as a wrong size, is one.

    Memory: the arguments, with one row a state, and the answers, 8 bytes a number; of Talos on two soles 1.7 kB a state, and
    working arrays of a few hundred states. Give a million states in parts, `for part in np.array_split(q, 20)`.

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
        loops: Whether the robot's own loops hold; one that is given counts once.

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
    if not 0.0 <= as_float(rest_speed) < 1e100:
        raise InputError(f"rest_speed is {rest_speed!r:.80}; expected a speed of 0 or more [m/s, rad/s].")
    states = ManyStates.of(robot, q, v, constraints, external=external, friction=friction, tau=tau, loops=loops)
    sheet = Sheet(states)
    sheet.refuse_bad_input()
    for i in by_blocks(sheet, asked, rest_speed).tolist():
        _one(sheet, i, asked, rest_speed)
    sheet.column("warned", TORQUE)[:] = _overloaded(states) & (sheet.status != StateStatus.BAD_INPUT)
    sheet.column("warned", LIMIT)[:] = beyond_limits(states) & (sheet.status != StateStatus.BAD_INPUT)
    sheet.column("warned", INACCURATE)[:] = sheet.status == StateStatus.INACCURATE
    found = Solutions(**sheet.fields(), law=asked, rest_speed=rest_speed)
    warn(found, stacklevel=2)
    return found


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
