"""Answers of Gauss's principle, at one state and at many, and what they say beyond their residuals."""

from functools import partial as _partial

from rbd.modules import submodule as _submodule

__getattr__ = _partial(_submodule, __name__)
