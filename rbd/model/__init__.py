"""Robot files to a checked model; states; terms of the equations of motion. Knows Pinocchio, and no problem or solver."""

from rbd.modules import submodule as _submodule


def __getattr__(name: str) -> object:
    return _submodule(__name__, name)
