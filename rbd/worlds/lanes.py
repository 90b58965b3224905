"""Numbers of eight worlds at once: what a kernel loads, compares and stores, compiled to vectors of the processor.

A kernel is written as for one world. `load` of an array of shape (rows, LANES) gives a row as one number of `LANES` worlds,
whose + - * / are instructions on vectors; of an array of shape (rows,) it gives a float, and the same text is the kernel of one
world. Not compiled, a row is an array of NumPy. There are no branches by such a number: `above` takes one of two, lane by lane.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rbd.arrays import Array
from rbd.kernels import before_compiling

LANES = 8
Number = Any
"""A float, or one of each lane."""


def load(a: Array, i: int) -> Number:
    """Row i, as it is now."""
    return a[i].copy() if a.ndim == 2 else a[i]


def store(a: Array, i: int, x: Number) -> None:
    """Write row i."""
    a[i] = x


def root(x: Number) -> Number:
    """Square root."""
    return np.sqrt(x)


def above(a: Number, b: Number, x: Number, y: Number) -> Number:
    """X where a > b, else y; y where a is NaN."""
    return np.where(a > b, x, y)


def largest(x: Number) -> float:
    """The largest of the lanes; infinite where one is NaN."""
    return float(np.max(x)) if np.all(x == x) else np.inf


def spread(a: Array, x: float) -> Number:
    """A float in each lane that an array has."""
    return np.full(a.shape[1], x) if a.ndim == 2 else x


def lane(a: Array, i: int, of: int) -> float:
    """Entry of one lane in row i."""
    return float(a[i, of] if a.ndim == 2 else a[i])


def put_lane(a: Array, i: int, of: int, x: float) -> None:
    """Write that of one lane."""
    if a.ndim == 2:
        a[i, of] = x
    else:
        a[i] = x


def lanes_of(a: Array) -> int:
    """How many a row of an array has."""
    return a.shape[1] if a.ndim == 2 else 1


before_compiling("rbd.worlds.lanes_of_numba")
