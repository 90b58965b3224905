"""What a study keeps of each type of result: names, plain values as variables, blocks of samples."""

from __future__ import annotations

import numbers
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from enum import IntEnum
from functools import cache
from typing import Any

import numpy as np

from rbd.arrays import Array
from rbd.errors import InputError
from rbd.errors.reasons import Reason
from rbd.records import Field, Variable


@cache
def kind_of(result: type) -> tuple[Field, ...]:
    """The table of a type of records, of which a study keeps fields by name; empty of other types."""
    own = getattr(result, "fields", ())
    return own if isinstance(own, tuple) and all(isinstance(line, Field) for line in own) else ()


def is_of_many(record: object) -> bool:
    """Whether a record is of many states: it has `reason_codes` and `reasons`, of each."""
    return hasattr(record, "reason_codes") and hasattr(record, "reasons")


def kept_names(result: type) -> dict[str, str]:
    """What `keep` of `rbd.study` may name of a type of results: {name: what it is}; see `rbd.study`.

    Args:
        result: A class that a study's function may return, e.g. `rbd.Solution`.

    Raises:
        InputError: no class, or one without a table of fields. Of those a function returns the numbers that count, by name.

    Example:
        >>> list(rbd.studies.kept_names(rbd.statics.SupportRegion))
        ['residual', 'area', 'empty', 'bounded', 'cut', 'inscribed_radius', 'com_distance', 'area_gap']
        >>> rbd.studies.kept_names(rbd.Actuation)["worst_torque"]
        'largest share of a motor limit that is used'
    """
    kind = kind_of(result) if isinstance(result, type) else ()
    if not kind:
        raise InputError(
            f"{result!r:.80} is no type of which a study keeps something by name; these have a table `fields`, such as "
            "rbd.Solution, rbd.Actuation, rbd.Trajectory. A function may return numbers and arrays by name, too: "
            "{'height': 0.3}."
        )
    return {line.name: line.meaning for line in kind}


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


_EXACT = 2**53
"""Whole numbers up to this are exact as float64, which numbers are kept as."""
WANTED = "expected numbers, truth values, text, arrays, records of rbd, or a mapping of these by name, as {'height': 0.3}"


class NotKept(Exception):  # noqa: N818  it becomes a message, not raised to a user
    """What a function returned cannot be kept."""


def mapping_of(result: Any) -> Mapping[Any, Any] | None:
    """A result as values by name: of a mapping, a dataclass, a named tuple, an xarray.Dataset; None of others."""
    if isinstance(result, Mapping):
        if (xarray := sys.modules.get("xarray")) is not None and isinstance(result, xarray.Dataset):
            return {str(name): result[name] for name in result.data_vars}
        return result
    if isinstance(result, tuple) and hasattr(result, "_asdict"):
        found: Mapping[Any, Any] = result._asdict()
        return found
    if is_dataclass(result) and not isinstance(result, type):
        return {field.name: getattr(result, field.name) for field in fields(result)}
    return None


def variable_of(name: str, value: Any, rows: int | None) -> Variable | None:
    """A plain value as a variable; None of None: there is no value.

    Args:
        name: Its name, which its dimensions have too where they have none.
        value: It.
        rows: Of a batched function's value the number of samples along its first axis; None of one sample's.

    Raises:
        NotKept: no plain value, or not one row a sample.
    """
    if value is None:
        return None
    if isinstance(value, float) and rows is None:
        return Variable(np.array(value))
    if isinstance(value, IntEnum) and rows is None:
        return Variable(np.array(int(value), np.int16), flags={int(x): x.name.lower() for x in type(value)})
    if (xarray := sys.modules.get("xarray")) is not None and isinstance(value, xarray.DataArray):
        return _labelled(name, value, rows)
    values = _array(name, value)
    inner = values.shape if rows is None else _rows_checked(name, values, rows)
    return Variable(values, tuple([f"{name}_{i}" for i in range(len(inner))]))


def _rows_checked(name: str, values: Array, rows: int) -> tuple[int, ...]:
    if not values.ndim or len(values) != rows:
        raise NotKept(
            f"{name!r:.80} has shape {values.shape} for {rows} samples; a batched function returns arrays with one row a sample"
        )
    return values.shape[1:]


def _labelled(name: str, value: Any, rows: int | None) -> Variable:
    values = _array(name, value.values)
    dims, attributes = tuple(str(dim) for dim in value.dims), value.attrs
    if rows is not None:
        _rows_checked(name, values, rows)
        dims = dims[1:]
    labels = {dim: tuple(map(_label, value.coords[dim].values.tolist())) for dim in dims if dim in value.coords}
    units, long_name = (storable(str(attributes.get(key, ""))) for key in ("units", "long_name"))
    return Variable(values, dims, units, long_name, labels)


def _label(given: Any) -> Any:
    return storable(given) if isinstance(given, str) else given


def _array(name: str, value: Any) -> Array:
    """Numbers as float64, truth values and text as they are."""
    if isinstance(value, tuple | list) and any(isinstance(x, np.ma.MaskedArray) for x in value):
        value = [_filled(name, x) if isinstance(x, np.ma.MaskedArray) else x for x in value]
    if isinstance(value, np.ma.MaskedArray):
        value = _filled(name, value)
    if isinstance(value, tuple | list) and not value:
        raise NotKept(f"{name!r:.80} is {value!r}, which has no entries")
    if isinstance(value, str | bool | int | float | np.ndarray | np.generic | tuple | list):
        try:
            found = np.asarray(value)
        except (ValueError, OverflowError):  # lists of unequal length, numbers without end
            found = np.empty(0, object)
    elif isinstance(value, numbers.Real):
        found = np.asarray(float(value))
    else:
        raise NotKept(f"{_what(name)} {_told(value)}; {WANTED}")
    kind = found.dtype.kind
    if not found.size and kind in "fiubU":
        raise NotKept(f"{name!r:.80} has shape {found.shape}, without entries; leave it out, or return None in its place")
    if kind == "f":
        return found.astype(np.float64, copy=False)
    if kind in "iu":
        if found.size and (found.max() > _EXACT or found.min() < -_EXACT):
            raise NotKept(f"{name!r:.80} has a whole number beyond 2^53, which no float64 is exactly; return it as text")
        return found.astype(np.float64)
    if kind == "b":
        return found
    if kind == "U" and (not isinstance(value, tuple | list) or all(isinstance(x, str) for x in value)):
        return _text(value, found)
    given = f"an array of {found.dtype}" if isinstance(value, np.ndarray | np.generic) else _told(value)
    more = " Return real and imaginary part by name." if kind == "c" else ""
    raise NotKept(f"{_what(name)} {given}; {WANTED}.{more}".rstrip("."))


def _filled(name: str, value: Any) -> Array:
    """A masked array of numbers with NaN for what is masked."""
    if not np.ma.is_masked(value):
        return np.asarray(value.data)
    if value.dtype.kind not in "fiu":
        raise NotKept(
            f"{name!r:.80} is a masked array of {value.dtype}; only those of numbers are kept, with NaN for the masked"
        )
    return np.where(np.ma.getmaskarray(value), np.nan, value.data)


def _text(value: Any, found: Array) -> Array:
    """Text with escapes for what cannot be stored. Arrays of NumPy drop a NUL at the end, so that the text as given is read."""
    given: list[str] = [value] if isinstance(value, str) else list(value if isinstance(value, tuple | list) else found.flat)
    texts = [storable(x) for x in given]
    return np.asarray(texts).reshape(found.shape) if texts != given else found


def _what(name: str) -> str:
    return "the function returned" if name == "value" else f"{name!r:.80} is"


def _told(value: Any) -> str:
    kind = type(value).__name__
    return f"{'an' if kind[:1] in 'aeiouAEIOU' else 'a'} {kind}, {value!r:.60}"
