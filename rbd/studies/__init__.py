"""Studies: a function at many samples as one dataset; and answers to one problem compared, by both laws, by several solvers."""

from functools import partial as _partial

from rbd.answers.comparison import LawComparison, SolverComparison, compare_laws, compare_solvers
from rbd.modules import submodule as _submodule
from rbd.statics.push_functions import move_under_push, withstand_push
from rbd.studies.draws import sample
from rbd.studies.motion_checks import MotionChecks, check_motions
from rbd.studies.results import kept_names
from rbd.studies.running import study
from rbd.studies.samples import Samples, grid
from rbd.studies.stores import open_study
from rbd.studies.tables import table
from rbd.workers import Workers

__all__ = [
    "LawComparison",
    "MotionChecks",
    "Samples",
    "SolverComparison",
    "Workers",
    "check_motions",
    "compare_laws",
    "compare_solvers",
    "grid",
    "kept_names",
    "move_under_push",
    "open_study",
    "sample",
    "study",
    "table",
    "withstand_push",
]


__getattr__ = _partial(_submodule, __name__)
