"""Solvers: each takes a `GaussProblem` and gives an `Answer`. They know no robot, and raise nothing about answers."""

from typing import Protocol

from rbd.errors import InputError
from rbd.modules import submodule as _submodule
from rbd.problem.answer import Answer
from rbd.problem.problem import GaussProblem, Law


class Solver(Protocol):
    """What `rbd.solve` needs of a solver."""

    @property
    def law(self) -> Law | str:
        """The contact law it solves for, e.g. `Law("coulomb")`, or as that prints; the answer has it with its facets."""

    def reason_unsupported(self, problem: GaussProblem) -> str | None:
        """Why this problem cannot be taken, in words, or None."""

    def solve(self, problem: GaussProblem) -> Answer:
        """The best answer found; its residuals tell how good it is."""


def checked_solver(solver: Solver) -> Solver:
    """The solver, if it is one.

    Raises:
        InputError: if it is something else, such as the class of a solver.
    """
    if isinstance(solver, type) or not hasattr(solver, "reason_unsupported"):
        raise InputError(f"solver is {solver!r:.80}; expected a solver, e.g. rbd.ProxQP() or rbd.KKT().")
    return solver


def __getattr__(name: str) -> object:
    return _submodule(__name__, name)
