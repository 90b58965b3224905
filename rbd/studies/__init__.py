"""One problem answered several times: by both laws, by several solvers."""

from rbd.modules import submodule as _submodule


def __getattr__(name: str) -> object:
    return _submodule(__name__, name)
