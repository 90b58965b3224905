"""The command line: `rbd stand`, `rbd region`, `rbd check`, `rbd simulate`, `rbd mechanism`, `rbd plane` and their reports."""

from rbd.modules import submodule as _submodule


def __getattr__(name: str) -> object:
    return _submodule(__name__, name)
