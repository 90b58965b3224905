"""Checks of new constraints, solvers and tasks: `check_constraint`, `check_solver`, `check_task`; the reference problems.

The checks are independent. A Jacobian is compared with the motion of the contact point itself, J_dot v with
its second difference, a solver's answer with the equations of its law, written down here once more, and with closed
forms.

    ContractBroken (an RbdError)
      ConstraintWrong     rows that do not describe the motion they claim
      SolverWrong         an answer that misses its law or the closed form
      TaskWrong           rows of a task that are not the acceleration of its value
"""

from functools import partial as _partial

from rbd.modules import submodule as _submodule
from rbd.testing.constraint_check import ConstraintReport, TaskReport, check_constraint, check_task
from rbd.testing.reference import ReferenceProblem, box, reference_problems
from rbd.testing.solver_check import (
    ConstraintWrong,
    ContractBroken,
    SolverReport,
    SolverWrong,
    TaskWrong,
    check_solver,
    law_residuals,
)

__all__ = [
    "ConstraintReport",
    "ConstraintWrong",
    "ContractBroken",
    "ReferenceProblem",
    "SolverReport",
    "SolverWrong",
    "TaskReport",
    "TaskWrong",
    "box",
    "check_constraint",
    "check_solver",
    "check_task",
    "law_residuals",
    "reference_problems",
]


__getattr__ = _partial(_submodule, __name__)
