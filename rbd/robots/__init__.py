"""Robots: load them by name or file, stand them up, find their soles and loops, merge two, tell what is wrong with a model."""

from rbd.modules import submodule as _submodule


def __getattr__(name: str) -> object:
    return _submodule(__name__, name)
