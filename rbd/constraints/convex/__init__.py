"""Convex shapes: their vertices, faces and closest points."""

from rbd.modules import submodule as _submodule


def __getattr__(name: str) -> object:
    return _submodule(__name__, name)
