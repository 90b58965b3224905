"""Solvers: each takes a `GaussProblem` and returns an `Answer`. They know no robots, and return the best answer found."""

from functools import partial as _partial
from typing import Protocol

from rbd.errors import InputError
from rbd.modules import submodule as _submodule
from rbd.problem.answer import Answer
from rbd.problem.gauss_problem import GaussProblem, Law

__all__ = ["Solver"]


class Solver(Protocol):
    """Protocol of a solver: what `rbd.solve` takes as `solver=`, and what a solver of your own must have.

    Example:
        >>> class InFreeFall:
        ...     law = "bilateral"
        ...     def reason_unsupported(self, problem):
        ...         return "it takes no constraints" if problem.m else None
        ...     def solve(self, problem):
        ...         return rbd.problem.Answer(problem, problem.a_free, np.zeros(0), None, "bilateral", "InFreeFall", 0, 0.0)
        >>> box = rbd.testing.box()
        >>> print(rbd.solve(rbd.State(box, [0, 0, 1, 0, 0, 0, 1]), [], solver=InFreeFall()).a)
        [ 0.    0.   -9.81  0.   0.    0.  ]
    """

    @property
    def law(self) -> Law | str:
        """The contact law it solves for, e.g. `Law("coulomb")`, or its string; the answer's law includes the facets."""

    def reason_unsupported(self, problem: GaussProblem) -> str | None:
        """Message: why the solver cannot take this problem; None if it can."""

    def solve(self, problem: GaussProblem) -> Answer:
        """The best answer found; its residuals show how good it is."""


def checked_solver(solver: Solver) -> Solver:
    """The solver, if it is one.

    Raises:
        InputError: if it is not one, e.g. the class of a solver.
    """
    if isinstance(solver, type) or not hasattr(solver, "reason_unsupported"):
        raise InputError(f"solver is {solver!r:.80}; expected a solver, e.g. rbd.ProxQP() or rbd.KKT().")
    return solver


__getattr__ = _partial(_submodule, __name__)
