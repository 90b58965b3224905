"""The command line, `rbd stand` and its like, and what its commands print."""

from functools import partial as _partial

from rbd.modules import submodule as _submodule

__getattr__ = _partial(_submodule, __name__)
