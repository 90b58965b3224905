"""Iterative refinement of motion and forces together, until every row is exact to rounding of its terms.

A solve in double precision leaves errors that are small relative to its largest numbers, and so too large for a light body
next to heavy ones. Refinement computes each equation's residual, row by row from M, J, rhs and offset, and solves
for a correction with the matrices at hand; its errors are small relative to it. After one or two rounds every row has
errors of rounding of its terms [Skeel1980].

    a <- a + M^-1 (rhs + J^T f - M a),    y = H^T (J a + offset) + centripetal part
    dw such that w + dw satisfies the law for the accelerations y + D dw,    w <- w + dw,    a <- a + M^-1 J^T G dw

dw is added to a before it is rounded to the digits of w: the last digit of a force of 10 N moves a milligram at 1e-9 m/s2.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from rbd.arrays import Array, is_finite
from rbd.problem.answer import Answer
from rbd.problem.force_set import ForceSet
from rbd.problem.residuals import ENOUGH
from rbd.solvers.newton import Scaled, last_step, scaled, steps_from

ROUNDS = 4
"""Largest number of corrections; one or two suffice where the modes of the contacts are right."""
NEAR = 1e-2
"""Scaled residuals up to which the modes can be right and refinement is tried."""

Correction: TypeAlias = Callable[[Array, Array], Array]
"""Takes row accelerations c, shape (m,), and the forces (of rows, or weights) that cause them; gives the forces' change."""


@np.errstate(all="ignore")  # overflow ends the loop
def refined(found: Answer, correct: Correction, parts: ForceSet | None = None) -> Answer:
    """The same answer with smaller residuals, or itself where that does not succeed.

    Args:
        found: An answer, solved or not.
        correct: Maps recomputed row accelerations, and row forces or weights, to the change of these.
        parts: The sets of the weights; None where `correct` takes row forces.
    """
    P, best = found.problem, found
    a, x = found.a, found.multipliers if parts is None else found.weights
    assert x is not None
    for _ in range(ROUNDS):
        a = a + P.solve_M(P.rhs + P.J.T @ (x if parts is None else parts.G @ x) - P.M @ a)
        c = P.J @ a + P.offset
        if not is_finite(c):
            break
        change = correct(c, x)
        if not is_finite(change):
            break
        a = a + P.solve_M(P.J.T @ (change if parts is None else parts.G @ change))
        x = x + change if parts is None else parts.project(x + change)
        if not (is_finite(a) and is_finite(x)):
            break
        f, weights = (x, found.weights) if parts is None else (parts.G @ x, x)
        trial = replace(found, a=a, multipliers=f, weights=weights)
        if trial.residuals.less_than(best.residuals):
            best = trial
        if best.residuals.within(ENOUGH):
            break
    return best


def by_newton(S: Scaled, T: ForceSet, *, coulomb: bool) -> Correction:
    """Correction of weights by Newton's steps on the law, from the given weights.

    Args:
        S: The scaled problem; only its D matters.
        T: The sets of the weights.
        coulomb: Coulomb's law; else the convex one.
    """
    columns = slice(None) if S.order.columns is None else S.order.columns

    def correct(c: Array, w: Array) -> Array:
        at = S.guess(w)
        y = (T.H.T @ c + T.offset)[columns] * S.unit / S.rate**2
        x, _, _ = steps_from(replace(S, q=y - S.D @ at), at, coulomb=coulomb, iterations=10, exact=0.0)
        return S.weights(x - at + last_step(S, x, y + S.D @ (x - at), coulomb=coulomb))

    return correct


def rays_refined(found: Answer) -> Answer:
    """`refined` for an answer with weights of the pyramids."""
    P, T = found.problem, found.problem.force_set.pyramids
    S = scaled(T.G.T @ P.delassus @ T.G, T.G.T @ P.free_row_acceleration, T)
    return refined(found, by_newton(S, T, coulomb=False), T)
