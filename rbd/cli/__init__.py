"""The command line: `rbd stand`, `rbd region`, `rbd check`, `rbd simulate`, `rbd mechanism`, `rbd plane` and their reports."""

from functools import partial as _partial

from rbd.modules import submodule as _submodule

__getattr__ = _partial(_submodule, __name__)
