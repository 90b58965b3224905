"""Reference motions: read, made, edited and differentiated."""

from rbd.modules import submodule as _submodule
from rbd.motion.derivation import Derivation, derivatives
from rbd.motion.making import minimum_jerk
from rbd.motion.motion import Motion

__all__ = ["Derivation", "Motion", "derivatives", "minimum_jerk"]


def __getattr__(name: str) -> object:
    return _submodule(__name__, name)
