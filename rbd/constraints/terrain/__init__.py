"""Terrain of convex pieces: its surface, and the points of contacts on it."""

from functools import partial as _partial

from rbd.modules import submodule as _submodule

__getattr__ = _partial(_submodule, __name__)
