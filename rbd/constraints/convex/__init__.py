"""Convex shapes: their vertices, faces and closest points."""

from functools import partial as _partial

from rbd.modules import submodule as _submodule

__getattr__ = _partial(_submodule, __name__)
