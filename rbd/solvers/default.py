"""The default solver of a law: for Coulomb's, Gauss's QP first, then circular cones if its answer does not satisfy the law.

The convex law and Coulomb's allow the same forces and accelerations to an unloaded point, and to one that
sticks. An answer of the QP is therefore one of Coulomb's law if at every point with friction

    f = 0     or     y = 0        (y = J a + J_dot v of the point; y_n >= 0 in any case)

and if the forces of the sticking points can be chosen in the circular cones, which the QP's pyramids circumscribe: those of
least norm are. Frictionless contacts, limits and dry friction do not count: both laws treat them in the same way.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from rbd.arrays import Array, block_diagonal, max_abs, range_of
from rbd.errors import InputError
from rbd.problem.answer import Answer
from rbd.problem.cones import pyramid
from rbd.problem.conic import Conic, Unknowns
from rbd.problem.force_set import ForceSet
from rbd.problem.gauss_problem import CONVEX, COULOMB, GaussProblem, Law, checked
from rbd.problem.residuals import ENOUGH, SOLVED, USABLE
from rbd.solvers import Solver, checked_solver
from rbd.solvers.admm import ConeSolver, of_many_contacts
from rbd.solvers.conic_newton import by_dual
from rbd.solvers.kkt import KKT, constrained
from rbd.solvers.proxqp import ProxQP, eased

_ROUNDING = 1e-13
"""Tolerance of forces outside the cones, over the largest force."""
SEVERAL = (
    "Coulomb's law admits {n} motions here: this one, Gauss's, in which points stick, jammed by internal forces, "
    "and one in which points slide or leave"
)
"""`Answer.reason` of the QP's answer where circular cones admit another motion."""
_OTHER = 1e-6
"""Accelerations that differ by more, over max(1, the largest), are different motions."""


_SLIP_LAWS = {"coulomb": COULOMB, "convex": CONVEX}


def slip_law(law: Law | str) -> Law:
    """The law of contacts that can slip, as `rbd.solve` and `rbd.simulate` take it.

    Raises:
        InputError: if it is neither.
    """
    found = _SLIP_LAWS.get(str(law)) if isinstance(law, Law | str) else None
    if found is None:
        raise InputError(f"law is {law!r:.80}; expected 'coulomb' or 'convex'.")
    return found


def solver_of(law: Law | str | None, solver: Solver | None) -> Solver:
    """The solver given, else that of the law given, else that of Coulomb's law.

    Raises:
        InputError: on an unknown law, or on a solver of another law.
    """
    asked = None if law is None else slip_law(law)
    if solver is None:
        return ConeSolver(law=CONVEX) if asked == CONVEX else GaussFirst()
    told = Law.of(checked_solver(solver).law)
    if asked is not None and told.kind not in (asked.kind, "bilateral"):
        raise InputError(
            f"law is '{asked}', and solver={type(solver).__name__}(...) solves for the {told} law. Leave one of them out: "
            "law= alone chooses a solver, and a solver has its law."
        )
    return solver


@dataclass(frozen=True)
class GaussFirst:
    """Coulomb's law: the answer of Gauss's least-constraint QP where that is Coulomb's, else that of circular cones.

    Tried in order: the closed form if all rows are bilateral; the sparse steps of `ConeSolver` where a hundred contacts or more
    are between many bodies; `ProxQP`; `ConeSolver(law="coulomb")` from the QP's forces.
    The answer's `method` names it. Where Coulomb's law has several motions the answer is one of them. Where redundant points
    stick only by internal forces, jammed, the cones search another motion, which then is in `others`.
    """

    law: Law = COULOMB

    def reason_unsupported(self, problem: GaussProblem) -> str | None:
        """Names a contact that approaches."""
        return ConeSolver().reason_unsupported(problem)

    def solve(self, problem: GaussProblem) -> Answer:
        """The first answer whose residuals under Coulomb's law are `solved`, else the best that was found."""
        start = time.perf_counter()
        P = checked(problem)
        if P.bilateral:
            return KKT().solve(P)
        if P.force_set.slipping:
            return ConeSolver().solve(P)
        many = of_many_contacts(P, start)
        if many is not None:
            return many
        convex = ProxQP().solve(P)
        if not (convex.residuals.within(SOLVED) or convex.residuals.within(USABLE)):
            return ConeSolver().solve_from(P, None, start)
        if convex.redundant and not convex.residuals.within(ENOUGH):
            convex = eased(convex)
        found, jammed = coulombs(convex)
        if found is None:
            return ConeSolver().solve_from(P, _from_pyramids(P.force_set) @ convex.weights, start)
        if found.residuals.within(SOLVED):
            return _with_others(found, ConeSolver().solve(P)) if jammed else found
        other = ConeSolver().solve_from(P, found.weights, start)
        return other if other.residuals.less_than(found.residuals) else found


def _with_others(found: Answer, other: Answer) -> Answer:
    """An answer with those motions of another answer that differ from it."""
    if not other.residuals.within(SOLVED):
        return found
    least = _OTHER * max(1.0, max_abs(found.a))
    others = tuple([x for x in (replace(other, others=()), *other.others) if max_abs(x.a - found.a) > least])
    return replace(found, others=others, reason=SEVERAL.format(n=1 + len(others))) if others else found


def coulombs(convex: Answer) -> tuple[Answer | None, bool]:
    """(the motion as an answer of Coulomb's law, with forces in circular cones; whether it is jammed); None if it is not.

    Jammed: points of redundant rows that stick, while their minimum-norm forces are outside the cones.

    Args:
        convex: The answer of `ProxQP` to a problem without sliding points.
    """
    start, P = time.perf_counter(), convex.problem
    T = P.force_set
    w = _from_pyramids(T) @ convex.weights
    if not len(T.mu):
        return _answer(convex, w, start), False
    y = T.accelerations(P.J @ convex.a + P.offset)
    still = np.abs(y[T.cone_columns]).max(axis=1) <= SOLVED * T.reach
    if not still.all():
        along, push = convex.residuals.scales.of_set(T, w)
        still |= (np.abs(y) <= SOLVED * along)[T.cone_columns].all(axis=1)
        moves = T.cone_columns[~still].ravel()
        if (np.abs(w[moves]) > SOLVED * push[moves]).any():
            return None, False
        w[moves] = 0.0
    if not convex.redundant:
        own = _answer(convex, w, start)
        if own.residuals.within(SOLVED):  # its forces are already in the circular cones
            return own, False
    forces, inside = _least_forces(convex, w, still)
    return None if forces is None else _answer(convex, forces, start), convex.redundant and not inside


def _answer(convex: Answer, w: Array, start: float) -> Answer:
    P, seconds = convex.problem, convex.seconds + time.perf_counter() - start
    if convex.redundant:
        f = P.force_set.G @ w
        return replace(convex, a=constrained(P, f), multipliers=f, weights=w, law=COULOMB, seconds=seconds)
    out = replace(convex, weights=w, law=COULOMB, seconds=seconds)
    out.__dict__["residuals"] = convex.residuals.under(COULOMB, w)
    return out


def _least_forces(convex: Answer, w: Array, still: Array) -> tuple[Array | None, bool]:
    """Minimum-norm weights of the sticking points, in circular cones, with the same motion as w.

    Where rows are redundant, those of bilateral rows are chosen with them. First without the cones: usually the result is
    inside them.

    Returns:
        The weights, shape (p,), or None; whether they are also of minimum norm without the cones.
    """
    P, T = convex.problem, convex.problem.force_set
    columns, out = T.cone_columns[still].ravel(), w.copy()
    if not convex.redundant:
        out[columns] = 0.0
        left = convex.multipliers - T.G @ out
        out[columns] = _minimum_norm(T, still.tobytes()) @ left
        G = T.G[:, columns]
    else:
        columns = np.concatenate([columns, np.setdiff1d(np.flatnonzero(T.is_line), T.cone_columns)])
        felt = range_of(P.whitened.T).T
        out[columns] = 0.0
        left, G = felt @ (convex.multipliers - T.G @ out), felt @ T.G[:, columns]
        out[columns] = np.linalg.lstsq(G, left, rcond=1e-12)[0]
    inside = T.project(out)
    if max_abs(inside - out) <= _ROUNDING * max_abs(out):
        return inside, True
    size = max(1.0, max_abs(convex.multipliers))
    cones = np.arange(3 * int(still.sum())).reshape(-1, 3)
    weights = Unknowns(len(columns), 1.0, cones=cones, mu=T.mu[still])
    found = by_dual(Conic.of({"weights": weights}, [({"weights": G}, left / size)]))
    if found is None:
        return None, False
    out[columns] = size * found[0]
    return out, False


@lru_cache(maxsize=256)
def _minimum_norm(T: ForceSet, still: bytes) -> Array:
    """Minimum-norm weights of the sticking points, from row forces."""
    return np.asarray(np.linalg.pinv(T.G[:, T.cone_columns[np.frombuffer(still, bool)].ravel()]))


@lru_cache(maxsize=256)
def _from_pyramids(T: ForceSet) -> Array:
    """Map from the weights of a force set's pyramids to those of the set, with the same forces, shape (p, r)."""
    return block_diagonal([pyramid(e.mu, e.facets) if e.facets else np.ones((1, 1)) for e in T.pyramids.elements])
