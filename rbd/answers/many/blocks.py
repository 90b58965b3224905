"""Answers at many states by the prepared form of their constraints; a certified answer needs no separate solve."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rbd.answers.least_constraint import prepared_solution
from rbd.answers.many.many_answers import DISTANT, MOVES, OPENED, BlockAnswer, Sheet
from rbd.answers.many.states import ManyStates
from rbd.answers.prepared.constraint_dynamics import DOUBTFUL, METHODS, Plan, law_kernel, prepared
from rbd.answers.solution import Solution
from rbd.arrays import Array
from rbd.problem.gauss_problem import COULOMB, Law
from rbd.problem.ground import TOUCHES
from rbd.problem.residuals import SOLVED

BLOCK = 512
"""States whose working arrays are in memory at a time; of two soles on a Talos 0.7 MB."""


def by_blocks(sheet: Sheet, law: Law, rest_speed: float) -> Array:
    """Answer what the prepared form of the constraints covers; the numbers of the states that are left."""
    return in_blocks(sheet, lambda plan, part, mu: _answered(plan, sheet.states, part, mu, law, rest_speed))


def in_blocks(sheet: Sheet, answered: Callable[[Plan, Array, Array | None], BlockAnswer]) -> Array:
    """Write what is certified of blocks of states, if the prepared form covers the constraints; the numbers of those left.

    Args:
        sheet: Written.
        answered: The answers of a plan to the states of some numbers, with the friction of its elements there if it is not
            their own.
    """
    states = sheet.states
    left = np.ones(len(states), bool)
    left[list(states.refused)] = False
    form = prepared(states.robot, states.constraints)
    if form is not None:
        mu = states.point_friction
        some = np.flatnonzero(left if mu is None else left & (mu > 0.0).all(axis=1))
        for plan, at in form.plans(states.q[some]):
            for start in range(0, len(at), BLOCK):
                part = some[at[start : start + BLOCK]]
                found = answered(plan, part, None if mu is None else plan.friction(mu[part]))
                sheet.write_block(part, found)
                left[part[found.good]] = False
    return np.flatnonzero(left)


def _answered(plan: Plan, states: ManyStates, part: Array, mu: Array | None, law: Law, rest_speed: float) -> BlockAnswer:
    """The answers to some states under a law."""
    n, p, coulomb, kernel, elements = len(part), plan.force_set.size, law == COULOMB, law_kernel(), plan.elements
    pushes, generalised = states.acting_on(part)
    generalised[:, states.robot.motors] += states.vectors["tau"][part]
    a, w, u, misses, X = (np.zeros((n, size)) for size in (states.robot.nv, p, p, 4, len(plan.corner_entries)))
    modes, how, loose = np.zeros((n, len(elements.first)), np.int64), np.zeros(n, int), np.zeros(n, bool)
    worst, loads = np.full(n, np.inf), plan.loads(pushes)
    rows = zip(states.q[part], states.v[part], generalised, misses, a, w, u, modes, strict=True)
    with plan.workspace() as space:
        for i, (q, v, given, missed, *into) in enumerate(rows):
            if mu is not None:
                elements = elements._replace(mu=mu[i])
            found = plan.search(space, q, v, given, rest_speed, coulomb, elements, loads, into)
            if found is not None:
                worst[i] = plan.judged(space, q, v, given, found, rest_speed, coulomb, elements, loads, missed)
                how[i], loose[i] = found.how, found.dependent
                if X.size:
                    X[i] = space.places[plan.corner_entries]
    good = worst <= SOLVED
    for i in np.flatnonzero(~good & (worst <= DOUBTFUL)).tolist():  # the scales themselves have to judge
        again = found_again(states, int(part[i]), law, rest_speed)
        if again is not None and again.residuals.within(SOLVED):
            good[i], misses[i] = True, list(again.residuals.scaled.values())[:4]
    chosen = (plan.repeated | loose) & (loose | (how != kernel.HELD))
    held = np.array([source.cone.bilateral for source in plan.sources for _ in source.columns], bool)
    warned = {
        DISTANT: plan.off_plane(X) > TOUCHES,
        MOVES: (np.abs(u[:, held]) > rest_speed).any(axis=1),
        OPENED: (modes == kernel.OPENS).any(axis=1),
    }
    return BlockAnswer(good, a, w, misses, np.array(METHODS)[how], chosen, warned)


def found_again(states: ManyStates, i: int, law: Law, rest_speed: float) -> Solution | None:
    """The whole `Solution` of state i by its plan, as blocks found it; None where it is none."""
    form = prepared(states.robot, states.constraints)
    if form is None:
        return None
    mu = None if states.point_friction is None else states.point_friction[i]
    found = prepared_solution(
        form, states.state(i), states.vectors["tau"][i], states.constraints_at(i), law, states.external_at(i), rest_speed,
        within=np.inf, mu=mu,
    )  # fmt: skip
    return None if found is None else found[0]
