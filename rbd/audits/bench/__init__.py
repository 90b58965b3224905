"""A bench of friction problems: public formats read and written, problems of humanoids, answers by recomputed residual."""

from functools import partial as _partial

from rbd.audits.bench.files import read, write
from rbd.audits.bench.friction import FrictionAnswer, FrictionProblem, solve
from rbd.audits.bench.scenes import SCENES, humanoid_problems
from rbd.audits.bench.solvers import SOLVERS, Comparison, compare
from rbd.audits.bench.spheres import spheres_in_a_box
from rbd.modules import submodule as _submodule

__all__ = [
    "SCENES",
    "SOLVERS",
    "Comparison",
    "FrictionAnswer",
    "FrictionProblem",
    "compare",
    "humanoid_problems",
    "read",
    "solve",
    "spheres_in_a_box",
    "write",
]


__getattr__ = _partial(_submodule, __name__)
