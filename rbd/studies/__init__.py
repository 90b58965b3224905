"""Studies: a function at many samples as one dataset; and answers to one problem compared, by both laws, by several solvers."""

from rbd.modules import submodule as _submodule
from rbd.studies.comparison import LawComparison, SolverComparison, compare_laws, compare_solvers
from rbd.studies.running import study
from rbd.studies.samples import grid
from rbd.studies.standing import move_under_push, withstand_push

__all__ = [
    "LawComparison",
    "SolverComparison",
    "compare_laws",
    "compare_solvers",
    "grid",
    "move_under_push",
    "study",
    "withstand_push",
]


def __getattr__(name: str) -> object:
    return _submodule(__name__, name)
