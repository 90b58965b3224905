"""What can be said of an answer beyond its residuals.

What is unique, which force was chosen, which rows contradict each other, how the answer changes.

Arrays only; `rbd.Solution` is the door.
"""

from rbd.analysis.infeasibility import Contradiction, contradiction
from rbd.analysis.sensitivity import Derivatives
from rbd.analysis.uniqueness import Uniqueness
from rbd.modules import submodule as _submodule

__all__ = ["Contradiction", "Derivatives", "Uniqueness", "contradiction"]


def __getattr__(name: str) -> object:
    return _submodule(__name__, name)
