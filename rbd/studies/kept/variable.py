"""`Block`: what is kept of some samples, as arrays; blocks put together; and the value that stands where there is none."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from rbd.answers.many.naming import Variable
from rbd.arrays import Array
from rbd.errors.reasons import Reason

__all__ = ["Block", "Variable", "missing", "storable"]


OK, REASON, MESSAGE = "ok", "reason", "message"
"""Variables that every study has."""
_CODES = {reason.code: reason.name.lower() for reason in Reason}


@dataclass(frozen=True, eq=False)
class Block:
    """Results of some samples.

    Attributes:
        numbers: Those of the samples, shape (n,).
        variables: {name: values of all of them}: numbers (float64), truth values, codes or text; `missing` where a sample has
            none. Every block has `ok`, which samples have a result; `reason`, a code, 0 where there is one; and `message`.
    """

    numbers: Array
    variables: Mapping[str, Variable]

    @property
    def ok(self) -> Array:
        """Which samples have a result."""
        return self.variables[OK].values


def own_variables(ok: Array, reason: Array, message: Array) -> dict[str, Variable]:
    """The three variables of every study, of some samples; the codes as the CF conventions have them."""
    return {
        OK: Variable(ok, long_name="whether there is a result"),
        REASON: Variable(reason, long_name="why there is none", flags=_CODES),
        MESSAGE: Variable(message, long_name="message of the error"),
    }


def empty_of(name: str, v: Variable, n: int) -> Variable:
    """A variable of n samples that were not computed; text as objects, of any length."""
    kind = np.dtype(object) if v.values.dtype.kind in "UOT" else v.values.dtype
    fill = Reason.NOT_RUN.code if name == REASON else missing(kind)
    return replace(v, values=np.full((n, *v.values.shape[1:]), fill, kind))


def joined(numbers: Array, blocks: Iterable[Block], forms: Mapping[str, Variable]) -> Block:
    """What blocks have of some samples, as one block.

    Args:
        numbers: Those of the samples, ascending.
        blocks: The blocks, in any order.
        forms: The variables in order, besides `ok`, `reason`, `message`.
    """
    n, own = len(numbers), own_variables(np.empty(0, bool), np.empty(0, np.int16), np.empty(0, object))
    found = {name: empty_of(name, v, n) for name, v in {**own, **forms}.items()}
    for block in blocks:
        at = np.searchsorted(numbers, block.numbers)
        inside = (at < n) & (numbers[np.minimum(at, n - 1)] == block.numbers)
        for name, v in block.variables.items():
            found[name].values[at[inside]] = v.values[inside]
    return Block(numbers, found)


def missing(kind: np.dtype) -> float | int | bool | str:
    """The value that stands where there is none: NaN of a number, -1 of a code, False or an empty text."""
    return {"f": np.nan, "i": -1, "b": False}.get(kind.kind, "")


def storable(text: str) -> str:
    """Text that zarr and netCDF can store: what UTF-8 has not (parts of file names in other codes), and NUL, as escapes."""
    if text.isascii() and "\0" not in text:
        return text
    return text.encode("utf-8", "backslashreplace").decode().replace("\0", "\\x00")
