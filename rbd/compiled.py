"""Whether compiled arithmetic is in use: that of Numba, in the optional extra `fast`.

It gives the answers of the NumPy code it replaces, sooner. Numba is imported with the first contact problem, or when shapes
are first looked for on a plane, not with `rbd`; without it, or with RBD_COMPILED=0 in the environment, NumPy computes it all.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from importlib.util import find_spec

_asked: list[bool] = []


def installed() -> bool:
    """Whether the extra `fast` is installed; it is not imported."""
    return find_spec("numba") is not None


@lru_cache(maxsize=1)
def _allowed() -> bool:
    return os.environ.get("RBD_COMPILED", "1") != "0" and installed()


def in_use() -> bool:
    """Whether compiled code runs where there is any."""
    return _asked[-1] if _asked else _allowed()


@contextmanager
def use(compiled: bool) -> Iterator[None]:
    """Run a block with compiled code, if it is installed, or without it; for tests and comparisons, on one thread."""
    _asked.append(compiled and installed())
    try:
        yield
    finally:
        _asked.pop()
