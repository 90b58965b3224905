"""Checks and measures of arrays, cheap enough for every call."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from scipy.linalg import blas

from rbd.errors import InputError

Array: TypeAlias = np.ndarray


def is_finite(value: Array) -> bool:
    """Whether every entry is finite, and small enough (1e150) to be squared."""
    # One BLAS pass without a temporary: NaN and infinity survive the sum of squares.
    return math.isfinite(np.vdot(value, value))


def check_finite(what: str, value: Array) -> None:
    """Refuse NaN and infinity.

    Raises:
        InputError: naming the first bad entry.
    """
    if not is_finite(value):
        bad = np.argwhere(~np.isfinite(value))
        where = f" at {tuple(int(i) for i in bad[0])}: {value[tuple(bad[0])]}" if len(bad) else ": too large to be squared"
        raise InputError(f"{what} is not finite{where}. Check what it was computed from.")


def largest(x: Array) -> float:
    """Largest absolute entry of a vector of finite numbers; zero of an empty one.

    NaN may be passed over: check what went in.
    """
    return abs(float(x[blas.idamax(x)])) if len(x) else 0.0


def three(what: str, value: Sequence[float] | Array) -> Array:
    """Three finite numbers as an array.

    Raises:
        InputError: if they are not.
    """
    try:
        out = np.array(value, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"{what} is {value!r}; expected three numbers.") from None
    if out.shape != (3,):
        raise InputError(f"{what} has shape {out.shape}; expected three numbers, (3,).")
    check_finite(what, out)
    return out
