"""`Variable` and `Block`: what is kept of one result, and of the samples of one chunk, as arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from rbd.arrays import Array


@dataclass(frozen=True, eq=False)
class Variable:
    """A quantity that is kept, of one sample or of n.

    Attributes:
        values: Of one sample an array of the shape of `dims`; of n samples, one more axis in front.
        dims: Names of the dimensions of one sample's value; empty of a number.
        units: Unit, "" where there is none.
        long_name: What it is.
        labels: {dimension: labels of its entries}, text.
        flags: {code: its meaning}, of codes.
    """

    values: Array
    dims: tuple[str, ...] = ()
    units: str = ""
    long_name: str = ""
    labels: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    flags: Mapping[int, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Block:
    """Results of the samples start to stop.

    Attributes:
        start: Number of the first.
        stop: Number after the last.
        variables: {name: values of all of them}; NaN, or the least integer, where a sample has none.
        ok: Which have a result, shape (n,), truth values.
        reason: `Reason.code` of each, shape (n,), int16; 0 where it is ok.
        messages: {number of the sample: message} where it is not ok.
    """

    start: int
    stop: int
    variables: Mapping[str, Variable]
    ok: Array
    reason: Array
    messages: Mapping[int, str]


def missing(kind: np.dtype) -> float | int | bool | str:
    """The value that stands where there is none: NaN, -1, False or an empty text."""
    return {"f": np.nan, "c": np.nan, "i": -1, "u": 0, "b": False}.get(kind.kind, "")
