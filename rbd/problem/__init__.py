"""The least-constraint problem in arrays: cones, rows, sets of forces, residuals. Knows NumPy, and no robot or solver."""

from rbd.modules import submodule as _submodule


def __getattr__(name: str) -> object:
    return _submodule(__name__, name)
