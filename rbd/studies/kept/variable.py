"""`Block`: what is kept of the samples of one chunk, as arrays; and the value that stands where there is none."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rbd.answers.many.naming import Variable
from rbd.arrays import Array

__all__ = ["Block", "Variable", "missing", "storable"]


@dataclass(frozen=True, eq=False)
class Block:
    """Results of the samples start to stop.

    Attributes:
        start: Number of the first.
        stop: Number after the last.
        variables: {name: values of all of them}: numbers (float64), truth values, codes or text; `missing` where a sample has
            none.
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
    """The value that stands where there is none: NaN of a number, -1 of a code, False or an empty text."""
    return {"f": np.nan, "i": -1, "b": False}.get(kind.kind, "")


def storable(text: str) -> str:
    """Text that zarr and netCDF can store: what UTF-8 has not (parts of file names in other codes), and NUL, as escapes."""
    if text.isascii() and "\0" not in text:
        return text
    return text.encode("utf-8", "backslashreplace").decode().replace("\0", "\\x00")
