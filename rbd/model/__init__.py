"""Robot files to a checked model; states; terms of the equations of motion. Knows Pinocchio, and no problem or solver.

Its names are loaded when they are asked for: the command line checks paths before it loads Pinocchio.
"""

from importlib import import_module as _import_module
from typing import TYPE_CHECKING as _TYPE_CHECKING

from rbd.modules import submodule as _submodule

if _TYPE_CHECKING:
    from rbd.model.dynamics import ExternalForce as ExternalForce
    from rbd.model.input_files import FileLimits as FileLimits
    from rbd.model.state import State as State

_HOME = {"ExternalForce": "dynamics", "FileLimits": "input_files", "State": "state"}

__all__ = ["ExternalForce", "FileLimits", "State"]


def __getattr__(name: str) -> object:
    if name in _HOME:
        found: object = getattr(_import_module(f"{__name__}.{_HOME[name]}"), name)
        return found
    return _submodule(__name__, name)
