"""The nearest motion where none satisfies the constraints: least violation first, then least constraint.

First the violation s: added to the row accelerations, it makes them allowed, and no smaller one does,

    minimise 1/2 |W s|^2     subject to     J a + offset + s in K*     for some a ,

rows in the units they are given in, W a diagonal of weights. Its multipliers are W^2 s = f in K with J^T f = 0: the violation
is itself a proof that there is no answer (`rbd.contradiction`), and this program's own certificate. Then, among all
accelerations with that violation, Gauss's problem: the rows with s added to their feedback can be met together.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rbd.analysis.violation import relaxed, smallest_violation
from rbd.arrays import Array, largest, numbers
from rbd.errors import InputError, NoSolution, Unsupported, nearest
from rbd.problem.problem import GaussProblem, checked
from rbd.problem.residuals import USABLE
from rbd.solution import Solution, Status
from rbd.solvers import Solver
from rbd.solvers.proxqp import ProxQP, law_name


@dataclass(frozen=True, eq=False)
class NearestMotion:
    """The motion that violates the constraints least, and of these the one nearest to free motion.

    Attributes:
        a: Acceleration, shape (nv,) [m/s2, rad/s2].
        violation: {constraint: s, shape (m,)}: what would have to be added to its row accelerations [m/s2, rad/s2]; zero
            where it is satisfied.
        optimality: Largest scaled residual of the least violation's own conditions: J^T f = 0, J a + offset + s in K*, and
            f . (J a + offset + s) = 0, with f = W^2 s.
        solution: The answer of the relaxed problem, rows with s added to their feedback, with its own certificate.
    """

    a: Array
    violation: Mapping[str, Array]
    optimality: float
    solution: Solution

    @property
    def forces(self) -> dict[str, Array]:
        """Forces of the relaxed problem, as `Solution.forces` [N, N m]."""
        return self.solution.forces

    @property
    def worst(self) -> float:
        """Largest entry of the violation [m/s2, rad/s2]."""
        return max((largest(s) for s in self.violation.values()), default=0.0)

    def __repr__(self) -> str:
        return f"NearestMotion(violation {self.worst:.3g} m/s2, {self.solution.status}, law {self.solution.law!r})"

    def __str__(self) -> str:
        lines = [f"nearest motion: rows are missed by up to {self.worst:.3g} m/s2 (rad/s2), least squares"]
        for name, s in self.violation.items():
            if largest(s) > 0.0:
                lines.append(f"  {name:<16} by {np.array2string(np.round(s, 4) + 0.0, precision=4)}")
        return "\n".join([*lines, str(self.solution)])


def nearest_motion(
    problem: GaussProblem,
    *,
    weights: Mapping[str, float | Array] | None = None,
    solver: Solver = ProxQP(),  # noqa: B008
) -> NearestMotion:
    """The motion of least violation, and of these the nearest to free motion in the metric of inertia.

    Of a problem that has an answer it is that answer, with no violation.

    Args:
        problem: Constraints that may contradict each other.
        weights: {constraint: weight w > 0 of its rows, one number or shape (m,)}: sum (w s)^2 is minimised. 1 if not given,
            so that 1 rad/s2 counts as 1 m/s2.
        solver: Solves the relaxed problem; its law is the law of the violation, too.

    Raises:
        InputError: unknown constraints, weights that are not positive.
        Unsupported: the solver cannot take the problem.
        NoSolution: one of the two programs was not solved within tolerance.
    """
    P = checked(problem)
    if isinstance(solver, type) or not hasattr(solver, "reason_unsupported"):
        raise InputError(f"solver is {solver!r:.80}; expected a solver, e.g. rbd.ProxQP().")
    reason = solver.reason_unsupported(P)
    if reason is not None:
        raise Unsupported(reason)
    law = law_name(P) if isinstance(solver, ProxQP) else solver.law
    s, optimality = smallest_violation(P, law, _weights(P, weights))
    solution = solver.solve(relaxed(P, s) if s.any() else P)
    if optimality > USABLE or solution.status not in (Status.SOLVED, Status.INACCURATE):
        raise NoSolution(
            f"the nearest motion was not found: least violation to {optimality:.1e}, scaled (usable is 1e-7), relaxed problem "
            f"{solution.status}: {solution.worst}.",
            problem=solution.problem,
            result=solution,
        )
    return NearestMotion(solution.a, {name: s[part].copy() for name, part in P.slices.items()}, optimality, solution)


def _weights(P: GaussProblem, given: Mapping[str, float | Array] | None) -> Array:
    out = np.ones(P.m)
    if given is None:
        return out
    if not isinstance(given, Mapping):
        raise InputError(f"weights are {given!r:.80}; expected {{constraint: weight}}.")
    for name, value in given.items():
        if name not in P.slices:
            raise InputError(f"weights: no constraint {name!r:.80}; {nearest(name, P.slices)}.")
        w = numbers(f"weight of {name!r}", value)
        m = len(out[P.slices[name]])
        if w.shape not in ((), (m,)) or not ((w > 1e-100) & (w < 1e100)).all():
            raise InputError(f"weight of {name!r} is {value!r:.80}; expected one number > 0, or {m} of them.")
        out[P.slices[name]] = w
    return out
