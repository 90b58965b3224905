"""Robot files to a checked model; states; terms of the equations of motion. Depends on Pinocchio, not on problem or solver.

Names are loaded on first use: the command line checks paths before it loads Pinocchio.
"""

from typing import TYPE_CHECKING as _TYPE_CHECKING

from rbd.modules import named as _named

if _TYPE_CHECKING:
    from rbd.model.external import ExternalForce as ExternalForce
    from rbd.model.input_files import FileLimits as FileLimits
    from rbd.model.motors import Motor as Motor
    from rbd.model.state import State as State

_HOME = {
    "ExternalForce": "rbd.model.external",
    "FileLimits": "rbd.model.input_files",
    "Motor": "rbd.model.motors",
    "State": "rbd.model.state",
}

__all__ = ["ExternalForce", "FileLimits", "Motor", "State"]


def __getattr__(name: str) -> object:
    globals()[name] = found = _named(__name__, _HOME, name)
    return found
