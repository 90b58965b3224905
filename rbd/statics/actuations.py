"""`Actuations`: motor torques and contact forces for wanted motions at many states, in array operations where they can be.

Where all points keep still, and constraints are prepared, `rbd.statics.least_effort` finds them; else each is asked alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from rbd.answers.many.blocks import in_blocks
from rbd.answers.many.many_answers import (
    DISTANT,
    INACCURATE,
    LIMIT,
    OPENED,
    SPEED,
    BlockAnswer,
    ManyAnswers,
    Sheet,
    beyond_limits,
    of_rows,
    warn,
)
from rbd.answers.many.states import ManyStates
from rbd.answers.prepared.constraint_dynamics import Plan
from rbd.arrays import Array, locked, zeros
from rbd.constraints.round_feet import balls_beside
from rbd.displayed import Displayed
from rbd.errors import CannotHold, CannotMove, RbdError
from rbd.problem.answer import ACCELERATION, StateStatus, Status
from rbd.problem.conic import ConicAnswer
from rbd.problem.ground import TOUCHES
from rbd.records import Field
from rbd.statics.actuation import CHOICE, CHOSEN, TORQUES, Actuation
from rbd.statics.least_effort import LeastEffort
from rbd.statics.wanted_motion import EffortChoice, WantedMotion
from rbd.statics.why_impossible import actuation_of


@dataclass(frozen=True, eq=False, repr=False)
class Actuations(ManyAnswers, Displayed):
    """Torques and contact forces at n states as arrays, each with its residuals: of `hold_many`, `inverse_dynamics_many`.

    `actuations[i]` is the whole `Actuation` of state i, or raises why there is none.

    Attributes:
        states: The robot, q, v and what acts at each state.
        a: Accelerations, shape (n, nv) [m/s2, rad/s2]; NaN where there is no answer, as in the other arrays.
        forces: {constraint: (n, 3) of a point, (n, 6) of a surface}, on the robot, world axes [N, N m]; row forces (n, m) of
            others.
        corner_forces: {contact: (n, k, 3)}, world axes [N].
        friction_used: {contact: `|f_t| / (mu f_n)` of its net force, shape (n,)}.
        centre_of_pressure: {contact: point in W, shape (n, 3) [m]}.
        residuals: {equation: scaled residual, shape (n,)}.
        status: A `rbd.answers.many.StateStatus` of each state, shape (n,), integers.
        reason_codes: `rbd.errors.Reason.code` of each state, shape (n,), integers; 0 where there is an answer.
        reasons: {state: message} where it is not solved.
        methods: Names of the methods that answered; `method_codes`, shape (n,), says which did where.
        one_by_one: Which states were answered one by one, shape (n,), truth values.
        warned: {what: states that a single answer would have warned of, shape (n,)}.
        tau: Motor torques, shape (n, nu) [N, N m]; NaN where the motion is not possible.
        margin: How far friction of points that keep still was kept from its limit, shape (n,).
        least: Whether the effort is the least, to nine digits, shape (n,), truth values.
        choice: What they are chosen by.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> held = rbd.statics.hold_many(solo, solo.standing().q, solo.feet(), coefficients=[0.0, 0.7])
        >>> held.tau[:, :3].round(3)  # without friction, and with it
        array([[-0.4  ,  0.097,  0.673],
               [-0.31 , -0.012,  0.619]])
        >>> print(f"{held[1].margins.torque.min():.3f}")
        0.999
    """

    tau: Array
    margin: Array
    least: Array
    choice: EffortChoice

    fields: ClassVar[tuple[Field, ...]] = (
        *(line for line in ManyAnswers.fields if line.name not in ("a", "tau")),
        *TORQUES,
        replace(ACCELERATION, default=False),
        *CHOSEN,
    )

    @property
    def torque_use(self) -> Array:
        """Torques over their limits at each state's velocity, shape (n, nu): 1 is at the limit, 0 where there is none."""
        return self.states.robot.torque_use(self.tau, self.states.v)

    def __getitem__(self, i: int) -> Actuation:
        """The whole `Actuation` of state i, sought again by itself.

        Raises:
            InputError: state i is no input; i is no whole number.
            ContactMoves: a velocity that the contacts do not allow.
            CannotMove: there are no such torques and forces: its limits, with the certificate and what is missing.
            IndexError: there is no such state.
        """
        return actuation_of(wanted_at(self.states, self.index(i), self.choice), stacklevel=2)

    def __iter__(self) -> Iterator[Actuation]:
        return (self[i] for i in range(len(self)))


def actuations_of(states: ManyStates, choice: EffortChoice, *, stacklevel: int) -> Actuations:
    """Torques and forces of least effort at each state.

    Args:
        states: With the wanted accelerations as `vectors["a"]`, unless poses are held.
        choice: What they are chosen by.
        stacklevel: Of warnings: 2 for the line that called this.
    """
    sheet, n = Sheet(states), len(states)
    tau, margin, least = np.full((n, states.robot.nu), np.nan), np.full(n, np.nan), np.zeros(n, bool)
    sheet.refuse_bad_input()
    for i in _by_blocks(sheet, choice, tau, margin, least).tolist():
        try:
            found = _one(sheet, i, choice)
        except RbdError as error:
            sheet.refuse(i, error)
            continue
        if found is not None:
            tau[i], margin[i], least[i] = found.tau, found.margin, found.least
    sheet.column("warned", DISTANT)[:] |= balls_beside(states.robot, states.constraints, states.q)
    sheet.column("warned", LIMIT)[:] = beyond_limits(states) & (sheet.status != StateStatus.BAD_INPUT)
    sheet.column("warned", INACCURATE)[:] = sheet.status == StateStatus.INACCURATE
    if not choice.holds:
        sheet.column("warned", SPEED)[:] = states.robot.too_fast(states.v).any(axis=1) & (sheet.status != StateStatus.BAD_INPUT)
    out = Actuations(**sheet.fields(), tau=locked(tau), margin=locked(margin), least=locked(least), choice=choice)
    warn(out, stacklevel=stacklevel + 1)
    return out


def _by_blocks(sheet: Sheet, choice: EffortChoice, tau: Array, margin: Array, least: Array) -> Array:
    """Answer the states whose least effort is inside all limits; the numbers of those that are left."""
    states, effort, rest, (within, *_) = sheet.states, choice.effort, choice.rest_speed, choice.margins
    if choice.friction != "cone" or effort.bounded:
        return np.setdiff1d(np.arange(len(states)), list(states.refused))

    def answered(plan: Plan, part: Array, mu: Array | None) -> BlockAnswer:
        q, v, n, tau_ext = states.q[part], states.v[part], len(part), states.external_of(part)
        a, least_effort = np.zeros(v.shape) if choice.holds else states.vectors["a"][part], LeastEffort.of(plan, effort, within)
        w, misses, good = np.zeros((n, plan.force_set.size)), np.zeros((n, 5)), np.zeros(n, bool)
        X, elements, own = np.zeros((n, len(plan.corner_entries))), plan.elements, None
        with plan.workspace() as space:
            for i, at in enumerate(part):
                if mu is not None:
                    elements = elements._replace(mu=mu[i])
                    own = (1.0 - within) * mu[i][plan.elements.mu > 0.0]
                found = least_effort.certified(
                    space, q[i], v[i], a[i], tau_ext[i], rest, plan.loads([]), elements, own, misses[i]
                )  # fmt: skip
                if found is not None:
                    w[i], tau[at], good[i], X[i] = found[0].w, found[0].tau, True, space.places[plan.corner_entries]
        margin[part[good]], least[part[good]] = within, True
        return BlockAnswer(
            good, a, w, misses, np.full(n, CHOICE), np.zeros(n, bool), {DISTANT: plan.off_plane(X) > TOUCHES}
        )  # fmt: skip

    return in_blocks(sheet, answered)


def wanted_at(states: ManyStates, i: int, choice: EffortChoice) -> WantedMotion:
    """What is wanted at state i.

    Raises:
        InputError: it is no input.
        NotAtRest: a pose is to be held, and what a contact touches moves.
    """
    a = zeros(states.robot.nv) if choice.holds else states.vectors["a"][i]
    return WantedMotion.of(states.state(i), a, states.constraints_at(i), states.external_at(i), choice)


def _one(sheet: Sheet, i: int, choice: EffortChoice) -> Actuation | None:
    """State i; None, and the reason on the sheet, where there is none.

    Raises:
        RbdError: the reason, where it is known without a search for it.
    """
    wanted = wanted_at(sheet.states, i, choice)
    for what in of_rows(wanted.contacts, wanted.rows):
        sheet.column("warned", what)[i] = True
    found: Actuation | ConicAnswer | None = wanted.quick
    for margin in choice.margins if found is None else ():
        found = wanted.sought(margin)
        if isinstance(found, Actuation):
            break
    if wanted.sets.openings:
        sheet.column("warned", OPENED)[i] = True
    if not isinstance(found, Actuation):
        kind, does = (CannotHold, "be held") if choice.holds else (CannotMove, "move so")
        raise kind(f"{sheet.states.robot.name} cannot {does} within its limits; [{i}] raises which, with the certificate.")
    sheet.write(i, found.answer, found.corner_forces)
    return found if found.status in (Status.SOLVED, Status.INACCURATE) else None
