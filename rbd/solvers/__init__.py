"""Solvers: each takes a `GaussProblem` and gives a `Solution`. They know no robot, and raise nothing about answers."""

from typing import Protocol

from rbd.modules import submodule as _submodule
from rbd.problem.problem import GaussProblem
from rbd.solution import Solution


class Solver(Protocol):
    """What `rbd.solve` needs of a solver."""

    @property
    def law(self) -> str:
        """The contact law it solves for: "bilateral", "convex" or "coulomb"."""

    def reason_unsupported(self, problem: GaussProblem) -> str | None:
        """Why this problem cannot be taken, in words, or None."""

    def solve(self, problem: GaussProblem) -> Solution:
        """The best answer found; its residuals tell how good it is."""


def __getattr__(name: str) -> object:
    return _submodule(__name__, name)
