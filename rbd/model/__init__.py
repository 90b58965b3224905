"""Robot files to a checked model; states; terms of the equations of motion. Knows Pinocchio, and no problem or solver."""

from rbd.model.dynamics import ExternalForce
from rbd.model.state import State
from rbd.model.xml import FileLimits
from rbd.modules import submodule as _submodule

__all__ = ["ExternalForce", "FileLimits", "State"]


def __getattr__(name: str) -> object:
    return _submodule(__name__, name)
