"""Robots at rest: torques and contact forces that hold them, and the least friction that does."""

from rbd.modules import submodule as _submodule


def __getattr__(name: str) -> object:
    return _submodule(__name__, name)
