"""Analysis of an answer beyond its residuals.

Uniqueness, force distribution, contradictory rows, derivatives.

Works on arrays; users call it through `rbd.Solution`.
"""

from functools import partial as _partial

from rbd.answers.analysis.enclosure import Enclosure
from rbd.answers.analysis.infeasibility import Contradiction, contradiction
from rbd.answers.analysis.parameters import ParameterDerivatives
from rbd.answers.analysis.sensitivity import Derivatives
from rbd.answers.analysis.uniqueness import Uniqueness
from rbd.modules import submodule as _submodule

__all__ = ["Contradiction", "Derivatives", "Enclosure", "ParameterDerivatives", "Uniqueness", "contradiction"]


__getattr__ = _partial(_submodule, __name__)
