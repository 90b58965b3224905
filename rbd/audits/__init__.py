"""Audits of contact forces: those of other programs, and a public bench of friction problems."""

from functools import partial as _partial

from rbd.modules import submodule as _submodule

__getattr__ = _partial(_submodule, __name__)
