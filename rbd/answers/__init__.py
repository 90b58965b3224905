"""Answers of Gauss's principle, at one state and at many, and what they say beyond their residuals."""

from rbd.modules import submodule as _submodule


def __getattr__(name: str) -> object:
    return _submodule(__name__, name)
