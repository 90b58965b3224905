"""What is raised when a constraint or a solver breaks its contract."""

from __future__ import annotations

from dataclasses import dataclass

from rbd.errors import RbdError


class ContractBroken(RbdError):
    """A constraint or a solver does not do what it says."""


class ConstraintWrong(ContractBroken):
    """Rows that do not describe the motion they claim."""


@dataclass(frozen=True)
class SolverReport:
    """What `check_solver` ran.

    Attributes:
        ran: {problem: largest residual, scaled as `Solution.residuals`}.
        skipped: {problem: why the solver does not take it}.
        failed: {problem: what is wrong}.
    """

    ran: dict[str, float]
    skipped: dict[str, str]
    failed: dict[str, str]


class SolverWrong(ContractBroken):
    """Answers that miss the law or the closed form.

    Attributes:
        report: What ran, what was skipped, what failed.
    """

    def __init__(self, message: str, report: SolverReport) -> None:
        super().__init__(message)
        self.report = report
