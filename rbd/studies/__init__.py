"""Comparison of answers to one problem: by both laws, by several solvers."""

from rbd.modules import submodule as _submodule
from rbd.studies.comparison import LawComparison, SolverComparison, compare_laws, compare_solvers

__all__ = ["LawComparison", "SolverComparison", "compare_laws", "compare_solvers"]


def __getattr__(name: str) -> object:
    return _submodule(__name__, name)
