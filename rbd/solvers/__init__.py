"""Solvers: each takes a `GaussProblem` and returns an `Answer`. They do not depend on robots, and return poor answers too."""

from typing import Protocol

from rbd.errors import InputError
from rbd.modules import submodule as _submodule
from rbd.problem.answer import Answer
from rbd.problem.problem import GaussProblem, Law


class Solver(Protocol):
    """Protocol of the solvers that `rbd.solve` takes."""

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


def __getattr__(name: str) -> object:
    return _submodule(__name__, name)
