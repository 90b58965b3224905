"""What is raised when a constraint or a solver breaks its contract."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rbd.errors import RbdError

if TYPE_CHECKING:
    from rbd.testing.solver_check import SolverReport


class ContractBroken(RbdError):
    """A constraint or a solver does not do what it says."""


class ConstraintWrong(ContractBroken):
    """Rows that do not describe the motion they claim."""


class SolverWrong(ContractBroken):
    """Answers that miss the law or the closed form.

    Attributes:
        report: What ran, what was skipped, what failed.
    """

    def __init__(self, message: str, report: SolverReport) -> None:
        super().__init__(message)
        self.report = report
