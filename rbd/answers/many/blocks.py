"""Answers at many states in blocks, by the prepared form of their contacts; a certified answer needs no separate solve."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from rbd.answers.least_constraint import posed
from rbd.answers.many.many_answers import DISTANT, MOVES, Sheet
from rbd.answers.many.states import ManyStates
from rbd.answers.prepared.constraint_dynamics import DOUBTFUL, METHODS, FoundForces
from rbd.answers.prepared.contact_dynamics import (
    BLOCK,
    BlockAnswer,
    ContactDynamics,
    prepared,
)
from rbd.answers.solution import Solution
from rbd.arrays import Array
from rbd.constraints.constraint import member
from rbd.errors import Reason
from rbd.problem.answer import StateStatus
from rbd.problem.gauss_problem import BILATERAL, COULOMB, GaussProblem, Law
from rbd.problem.residuals import SOLVED


def by_blocks(sheet: Sheet, law: Law, rest_speed: float) -> Array:
    """Answer what the prepared form of the contacts covers; the numbers of the states that are left."""
    states = sheet.states

    def answered(blocks: ContactDynamics, part: Array, mu: Array | None) -> BlockAnswer:
        q, v, generalised = states.q[part], states.v[part], _generalised(states, part)
        found = blocks.solve(q, v, generalised, coulomb=law == COULOMB, rest_speed=rest_speed, mu=mu)
        _settle_doubtful(states, part, found, law, rest_speed)
        return found

    return in_blocks(sheet, METHODS, answered)


def in_blocks(
    sheet: Sheet, methods: Sequence[str], answered: Callable[[ContactDynamics, Array, Array | None], BlockAnswer]
) -> Array:
    """Write what is certified of blocks of states, if the prepared form covers the contacts; the numbers of those left.

    Args:
        sheet: Written.
        methods: Words for the numbers of `BlockAnswer.method`.
        answered: The answers to the states of some numbers, with their points' friction if it is not the contacts' own.
    """
    states = sheet.states
    left = np.ones(len(states), bool)
    left[list(states.refused)] = False
    blocks = prepared(states.robot, states.constraints)
    if blocks is not None:
        mu = friction_of(states)
        some = np.flatnonzero(left if mu is None else left & (mu > 0.0).all(axis=1))
        for start in range(0, len(some), BLOCK):
            part = some[start : start + BLOCK]
            found = answered(blocks, part, None if mu is None else mu[part])
            write(sheet, part, found, methods)
            left[part[found.found]] = False
    return np.flatnonzero(left)


def friction_of(states: ManyStates) -> Array | None:
    """Coefficients of all points at all states, shape (n, k); None where they are the contacts' own."""
    if not states.friction:
        return None
    given = [(len(member(c, "corners")), states.friction.get(c.name, member(c, "friction"))) for c in states.constraints]
    columns = [np.broadcast_to(mu, len(states)) for k, mu in given if mu is not None for _ in range(k)]
    return np.stack(columns, axis=1)


def _generalised(states: ManyStates, part: Array) -> Array:
    """S^T tau + tau_ext of some states, shape (n, nv)."""
    out = states.external_of(part)
    out[:, states.robot.motors] += states.vectors["tau"][part]
    return out


def _settle_doubtful(states: ManyStates, part: Array, found: BlockAnswer, law: Law, rest_speed: float) -> None:
    """Certify rows whose bounds are too coarse by the scales of their residuals, computed in full."""
    names = [c.name for c in states.constraints]
    with np.errstate(invalid="ignore"):
        doubtful = ~found.found & (found.method >= 0) & (np.maximum.reduce(list(found.residuals.values())) <= DOUBTFUL)
    for row in np.flatnonzero(doubtful).tolist():
        forces = {name: array[row] for name, array in zip(names, found.forces, strict=True)}
        corners = {name: array[row] for name, array in zip(names, found.corner_forces, strict=True)}
        method = METHODS[found.method[row]]
        solution = of_row(states, int(part[row]), found.a[row], forces, corners, method, law, rest_speed)
        if solution.residuals.within(SOLVED):
            found.found[row] = True
            for name in found.residuals:
                found.residuals[name][row] = solution.residuals.scaled[name]


def write(sheet: Sheet, part: Array, found: BlockAnswer, methods: Sequence[str]) -> None:
    """The certified rows of a block.

    Args:
        sheet: Written.
        part: Numbers of the block's states.
        found: Their answers.
        methods: Words for the numbers of `found.method`.
    """
    names = [c.name for c in sheet.states.constraints]
    good: Array | slice = found.found
    at: Array | slice = part[good]
    if found.found.all() and part[-1] - part[0] == len(part) - 1:  # one copy in place of two
        good, at = slice(None), slice(int(part[0]), int(part[-1]) + 1)
    sheet.a[at], sheet.status[at], sheet.reason_codes[at] = found.a[good], StateStatus.SOLVED, Reason.NONE.code
    codes = np.zeros(len(methods), np.int8)
    for number in np.flatnonzero(np.bincount(found.method[good], minlength=len(methods))).tolist():
        codes[number] = sheet.code(methods[number])
    sheet.codes[at] = codes[found.method[good]]
    for name, values in found.residuals.items():
        sheet.column("residuals", name)[at] = values[good]
    if found.distant.any():
        sheet.column("warned", DISTANT)[at] = found.distant[good]
    if found.moving.any():
        sheet.column("warned", MOVES)[at] = found.moving[good]
    for k, name in enumerate(names):
        for kind, arrays in (("forces", found.forces), ("corner_forces", found.corner_forces)):
            sheet.table(kind, name, *arrays[k].shape[1:])[at] = arrays[k][good]
        sheet.column("friction_used", name)[at] = found.friction_used[k][good]
        sheet.table("centre_of_pressure", name, 3)[at] = found.centre_of_pressure[k][good]


def of_row(
    states: ManyStates,
    i: int,
    a: Array,
    forces: dict[str, Array],
    corners: dict[str, Array],
    method: str,
    law: Law,
    rest_speed: float,
) -> Solution:
    """The whole `Solution` of state i from its row: no solver is asked.

    Args:
        states: The states.
        i: Which.
        a: Its acceleration, shape (nv,).
        forces: {contact: force (3,) or wrench (6,)}, world axes.
        corners: {contact: forces at its corners (k, 3)}, world axes.
        method: What found them.
        law: The law.
        rest_speed: As of `rbd.solve`.
    """
    problem = posed(states.state(i), states.vectors["tau"][i], states.constraints_at(i), states.external_at(i), rest_speed)
    rows, weights = [], []
    for r in problem.rows:
        assert r.resultant is not None and r.patch is not None
        rows.append(r.resultant.T @ forces[r.name])
        weights.append(rows[-1] if r.patch.friction is None else (corners[r.name] @ r.patch.axes).ravel())
    w = None if problem.bilateral else np.concatenate(weights)
    return Solution.prepared(
        partial(_same, problem), FoundForces(a, np.concatenate(rows), w, method), BILATERAL if w is None else law, 0.0
    )


def _same(problem: GaussProblem) -> GaussProblem:
    return problem
