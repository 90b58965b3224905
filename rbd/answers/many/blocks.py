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

BLOCK, CHUNK = 512, 64
"""States whose working arrays are in memory at a time, and states that are judged together: 1 MB of two soles on a Talos."""


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
    if form is not None and form.on_still_ground:
        mu = states.point_friction
        some = np.flatnonzero(left if mu is None else left & (mu > 0.0).all(axis=1))
        for plan, at in form.plans(states.q[some]):
            for start in range(0, len(at), BLOCK):
                part = some[at[start : start + BLOCK]]
                found = answered(plan, part, None if mu is None else plan.friction(mu[part]))
                sheet.write_block(part, found)
                left[part[found.good]] = False
    return np.flatnonzero(left)


def _answered(plan: Plan, states: ManyStates, part: Array, given_mu: Array | None, law: Law, rest_speed: float) -> BlockAnswer:
    """The answers to some states under a law."""
    n, p, coulomb, kernel, elements = len(part), plan.force_set.size, law == COULOMB, law_kernel(), plan.elements
    pushes, generalised = states.acting_on(part)
    generalised[:, states.robot.motors] += states.vectors["tau"][part]
    mu = np.tile(elements.mu, (n, 1)) if given_mu is None else given_mu
    q, v, loads, worst, off = states.q[part], states.v[part], plan.loads(pushes), np.full(n, np.inf), np.zeros(n)
    a, w, u, misses = (np.zeros((n, size)) for size in (states.robot.nv, p, p, 5))
    modes, how, loose = np.zeros((n, len(elements.first)), np.int64), np.full(n, kernel.NOTHING), np.zeros(n, bool)
    with plan.workspace() as space:
        X = np.zeros((CHUNK, len(space.places)))
        for start in range(0, n, CHUNK):
            some = slice(start, min(start + CHUNK, n))
            rows = zip(q[some], v[some], generalised[some], mu[some], X, a[some], w[some], u[some], modes[some], strict=False)
            for i, (q_i, v_i, given, rough, placed, *into) in enumerate(rows, start):
                if given_mu is not None:
                    elements = elements._replace(mu=rough)
                found = plan.search(space, q_i, v_i, given, rest_speed, coulomb, elements, loads, into)
                placed[:] = space.places
                if found is not None:
                    how[i], loose[i] = found.how, found.dependent
            here = X[: some.stop - start]
            worst[some] = plan.all_judged(
                space, q[some], v[some], generalised[some], a[some], w[some], here, mu[some], rest_speed, coulomb, loads,
                misses[some],
            )  # fmt: skip
            off[some] = plan.off_plane(here[:, plan.corner_entries])
    worst[how == kernel.NOTHING] = np.inf
    good = worst <= SOLVED
    for i in np.flatnonzero(~good & (worst <= DOUBTFUL)).tolist():  # the scales themselves have to judge
        again = found_again(states, int(part[i]), law, rest_speed)
        if again is not None and again.residuals.within(SOLVED):
            good[i], misses[i, :4] = True, list(again.residuals.scaled.values())[:4]
    chosen = (plan.repeated | loose) & (loose | (how != kernel.HELD))
    held = np.array([source.cone.bilateral for source in plan.sources for _ in source.columns], bool)
    warned = {
        DISTANT: off > TOUCHES,
        MOVES: (np.abs(u[:, held]) > rest_speed).any(axis=1),
        OPENED: (modes == kernel.OPENS).any(axis=1),
    }
    return BlockAnswer(good, a, w, misses, np.array([*METHODS, ""])[how], chosen, warned)


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
