"""A bench of friction problems: readers and writers of public formats, problems of humanoids, answers by recomputed residual."""

from functools import partial as _partial

from rbd.audits.bench.files import read, write
from rbd.audits.bench.friction import FrictionAnswer, FrictionProblem, solve
from rbd.audits.bench.scenes import SCENES, humanoid_problems
from rbd.modules import submodule as _submodule

__all__ = ["SCENES", "FrictionAnswer", "FrictionProblem", "humanoid_problems", "read", "solve", "write"]


__getattr__ = _partial(_submodule, __name__)
