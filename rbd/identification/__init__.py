"""Parameters of a robot from measured motions: base parameters, and inertias that a body can have."""

from rbd.identification.base_parameters import BaseParameters, base_parameters
from rbd.modules import submodule as _submodule

__all__ = ["BaseParameters", "base_parameters"]


def __getattr__(name: str) -> object:
    return _submodule(__name__, name)
