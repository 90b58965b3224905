"""Studies: a function at many samples as one dataset; and answers to one problem compared, by both laws, by several solvers."""

from rbd.modules import submodule as _submodule
from rbd.studies.comparison import LawComparison, SolverComparison, compare_laws, compare_solvers
from rbd.studies.own_processes import Workers
from rbd.studies.running import study
from rbd.studies.samples import grid

__all__ = ["LawComparison", "SolverComparison", "Workers", "compare_laws", "compare_solvers", "grid", "study"]


def __getattr__(name: str) -> object:
    return _submodule(__name__, name)
