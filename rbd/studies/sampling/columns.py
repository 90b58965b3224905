"""`Column`: the values of one argument along one dimension of the samples, and its gaps."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any

import numpy as np

from rbd.arrays import Array
from rbd.errors import InputError
from rbd.studies.provenance.identity import Hash, add


def without_gaps(name: str, given: Any) -> Any:
    """Values with NaN or None for what is masked or missing; all else as it was given.

    Args:
        name: Name of the argument.
        given: What a user gave. Looked at are masked arrays, also in a list, and arrays of objects, as data frames have them.

    Returns:
        Masked numbers as float64 with NaN; of an array of objects float64 with NaN for pandas.NA where all else is numbers, and
        None where all else is text or truth values.

    Raises:
        InputError: a masked array of anything but numbers, of which some are masked.
    """
    if isinstance(given, list | tuple) and any(isinstance(x, np.ma.MaskedArray) for x in given):
        return [without_gaps(name, x) for x in given]
    if isinstance(given, np.ma.MaskedArray):
        return _unmasked(name, given)
    if isinstance(given, np.ndarray) and given.dtype.kind in "OT" and given.ndim == 1:
        return _of_objects(given)
    return given


def _unmasked(name: str, given: np.ma.MaskedArray) -> Any:
    if not np.ma.is_masked(given):
        found = np.asarray(given.data)
    elif given.dtype.kind in "iuf":
        found = np.where(np.ma.getmaskarray(given), np.nan, given.data)
    else:
        told = "Masked numbers become NaN; give other values without the masked ones"
        raise InputError(f"{name} is a masked array of {given.dtype}, of which some are masked. {told}: {name}.compressed().")
    return found if found.ndim else found.item()


def _of_objects(given: Array) -> Array:
    gaps = np.array([_is_gap(x) for x in given.tolist()], bool)
    others = given[~gaps].tolist()
    if not gaps.any() or not others:
        return given
    if all(isinstance(x, str | bool | np.bool_) for x in others):
        found = given.astype(object)
        found[gaps] = None
        return found
    if None in given.tolist():  # among numbers it may be meant: "no limit"
        return given
    if all(isinstance(x, int | float | np.integer | np.floating) and not isinstance(x, bool) for x in others):
        numbers = np.full(len(given), np.nan)
        numbers[~gaps] = others
        return numbers
    return given


def _is_gap(value: object) -> bool:
    """Whether this is None, NaN or pandas.NA."""
    return value is None or (isinstance(value, float) and value != value) or type(value).__name__ == "NAType"


Coordinate = tuple[tuple[str, ...], Array, dict[str, str]]
"""Dimensions, values and attributes, as xarray takes them."""
ADDRESS = re.compile(r"\b0x[0-9a-fA-F]{4,}")
LONGEST_LABEL = 60


@dataclass(frozen=True, eq=False, repr=False)
class Column:
    """The values of one argument.

    Attributes:
        name: Name of the argument.
        dim: The dimension along which it varies; "" if it is the same in all samples.
        values: Along the dimension, shape (n, ...): numbers or truth values; numbers of `choices` where there are some.
        choices: Texts and objects from which `values` choose; None of numbers.
        labels: What coordinates show: of each choice, or of each value, shape (n,); None: numbers stand for themselves.
        units: Unit; "" where none is known.
        mark: What stands for the values in `digest`, where they differ in the last bits from platform to platform.
    """

    name: str
    dim: str
    values: Array
    choices: tuple[Any, ...] | None = None
    labels: Array | None = None
    units: str = ""
    mark: str = ""

    def __len__(self) -> int:
        return len(self.values)

    def take(self, at: Array | slice) -> Array | list[Any]:
        """The values at some places: a new array of numbers, shape (k, ...), or a list of texts and objects."""
        found: Array = self.values[at]
        choices = self.choices
        if choices is not None:
            return [choices[i] for i in found.tolist()]
        return found.copy() if isinstance(at, slice) else found  # a function may change what it is given

    def one(self, i: int) -> Any:
        """The value at a place: a plain number, an array, a text, an object."""
        found = self.take(slice(i, i + 1))[0]
        return found.item() if isinstance(found, np.generic) and found.dtype.kind in "biufc" else found

    @property
    def shown(self) -> Array:
        """Labels of all values, shape (n,); of vectors without labels their numbers 0 to n - 1."""
        if self.labels is not None:
            return np.asarray(self.labels[self.values] if self.choices is not None else self.labels)
        return np.arange(len(self)) if self.values.ndim > 1 else self.values

    def coords(self) -> dict[str, Coordinate]:
        """{name: coordinate}: one dimension along the samples; numbers with labels, and vectors of a grid, have two."""
        dims = (self.dim,) if self.dim else ()
        at: Any = slice(None) if self.dim else 0
        units = {"units": self.units} if self.units else {}
        inner = tuple(f"{self.name}_{i}" for i in range(self.values.ndim - 1))
        if self.choices is None and (self.labels is not None or (inner and self.dim == self.name)):
            value = ((*dims, *inner), self.values[at], units)
            return {self.name: (dims, self.shown[at], {}), f"{self.name}_value": value}
        shown = self.values if inner else self.shown
        return {self.name: ((*dims, *inner), shown[at], units)}

    def add_to(self, found: Hash) -> None:
        """Add all that is in the column to a hash, but for units, and for labels that follow from the objects."""
        labels, choices = self.labels, list(self.choices or ())
        if labels is not None and choices and np.array_equal(labels, _labels(choices)):
            labels = None
        if all(type(x) is str for x in choices):  # as one text: they may be millions
            choices = ["".join(choices), np.array([len(x) for x in choices], np.int64)]
        add(found, (self.name, self.dim, self.mark or self.values, choices, labels), self.name)

    @property
    def text(self) -> str:
        """The values in a few words, for people."""
        unit, n = f" {self.units}" if self.units and self.labels is None else "", len(self)
        if self.values.ndim > 1 and self.labels is None:
            return f"{_count(n, 'array')} of shape {self.values.shape[1:]}{unit}"
        shown = self.shown
        if not self.dim:
            return f"{_label(shown[0])}{unit} in all"
        if shown.dtype.kind in "iufmM" and n > 3:
            known = shown[shown == shown] if (shown == shown).any() else shown  # without NaN
            ends = [f"{x:.6g}" if shown.dtype.kind == "f" else str(x) for x in (known.min(), known.max())]
            return f"{n:,} values from {' to '.join(ends)}{unit}"
        first = list(dict.fromkeys(_label(x) for x in shown[:1000]))
        listed = ", ".join(first[:6]) + (", ..." if len(first) > 6 else "")
        return f"{_count(n, 'value')}: {listed[:200]}{unit}"

    def with_units(self, units: str) -> Column:
        """The same with a unit."""
        return replace(self, units=units)


def column(name: str, given: Any, dim: str, *, distinct: bool = False) -> Column:
    """Values as a user gave them, as a column along `dim`; fixed, along none, if one value was given.

    Args:
        name: Name of the argument.
        given: One value (number, text, None, object), a sequence or array of values, or a mapping {label: value}.
        dim: The dimension.
        distinct: Whether labels must differ: of an axis of a grid, and of what has the name of its dimension.

    Raises:
        InputError: no values, arrays of different lengths, a set, labels that repeat, masked values that are no numbers.
    """
    check_name(name)
    given = without_gaps(name, given)
    labels: Array | None = None
    units = str(getattr(given, "attrs", {}).get("units", "")) if hasattr(given, "dims") else ""
    if isinstance(given, Mapping):
        labels, given = _labels_of_keys(name, list(given)), list(given.values())
    elif is_one(given):
        given = given.item() if getattr(given, "ndim", None) == 0 and hasattr(given, "item") else given
        return replace(_column(name, [given], ""), units=units)
    elif isinstance(given, set | frozenset):
        raise InputError(f"{name} is a set, which has no order; give a list.")
    elif not isinstance(given, np.ndarray):
        given = _sequence(name, given)
    given = without_gaps(name, given)
    if not len(given):
        raise InputError(f"{name} has no values; give at least one.")
    found = replace(_column(name, given, dim), units=units)
    if labels is not None:
        chosen = labels if found.choices is None else _at_choices(found, labels)
        found = replace(found, labels=chosen)
    if distinct or name == dim:
        _check_distinct(found)
    return found


def is_one(given: object) -> bool:
    """Whether this is one value, and no sequence of values: text, a number, None, a robot, a law."""
    if given is None or isinstance(given, str | bytes | Enum | type):
        return True
    if isinstance(given, np.ndarray):
        return given.ndim == 0
    if getattr(given, "ndim", None) == 0:
        return True
    return not (isinstance(given, Iterable) and not isinstance(given, np.generic)) or _is_record(given)


def _is_record(given: object) -> bool:
    """Whether an object that can be iterated over is one thing all the same: a named one, such as a robot."""
    return isinstance(getattr(given, "name", None), str) and not hasattr(given, "dtype")


def check_name(name: object) -> None:
    """Refuse names that no dataset can have.

    Raises:
        InputError: no text, empty, or with a slash or a blank.
    """
    if not isinstance(name, str) or not name or "/" in name or any(letter.isspace() for letter in name):
        raise InputError(f"{name!r:.80} cannot be the name of an argument; expected text without '/' and blanks.")


def _sequence(name: str, given: Any) -> Array | list[Any]:
    values = getattr(given, "values", None)  # of pandas and xarray, which know their kind
    if isinstance(values, np.ndarray) and hasattr(given, "dtype"):
        return values
    if hasattr(given, "to_numpy"):
        return np.asarray(given.to_numpy())
    try:
        return list(given)
    except TypeError as error:
        raise InputError(f"{name} is {given!r:.80}, which has no values to go through ({error}); give a list.") from None


def _column(name: str, values: Array | list[Any], dim: str) -> Column:
    """The column of a non-empty array or list, without labels of a user."""
    array = _numbers(name, values)
    if array is not None:
        return Column(name, dim, array)
    listed = values.tolist() if isinstance(values, np.ndarray) else values
    codes: dict[object, int] = {}
    choices: list[Any] = []
    numbers = np.empty(len(listed), np.int64)
    for i, value in enumerate(listed):
        plain = value is None or isinstance(value, str | bool | int | float)
        key = (type(value), value) if plain else id(value)
        if key not in codes:
            codes[key] = len(choices)
            choices.append(value)
        numbers[i] = codes[key]
    return Column(name, dim, numbers, tuple(choices), _labels(choices))


def _numbers(name: str, values: Array | list[Any]) -> Array | None:
    """Numbers, truth values or dates as an array of one of a few kinds; None if there are other things among them."""
    if not isinstance(values, np.ndarray):
        truths = [isinstance(x, bool | np.bool_) for x in values]
        if any(truths) and not all(truths):
            return None
        if not all(_is_numeric(x) for x in values):
            return None
        try:
            values = np.array(values)
        except (ValueError, OverflowError):
            shapes = list(dict.fromkeys(str(np.shape(x)) if _regular(x) else "ragged" for x in values))
            raise InputError(
                f"{name} has arrays of different shapes, {', '.join(shapes[:4])}; give arrays of one shape, or name each: "
                f"{name}={{'first': ..., 'second': ...}}."
            ) from None
    kind = values.dtype.kind
    if kind == "u" and values.size and values.max() > np.iinfo(np.int64).max:
        kind = "f"
    if kind in "iufcb":
        return values.astype({"i": np.int64, "u": np.int64, "f": np.float64, "c": np.complex128, "b": np.bool_}[kind])
    return values.copy() if kind in "mM" else None


def _is_numeric(value: object) -> bool:
    if isinstance(value, np.ndarray):
        return value.dtype.kind in "biufc" and not isinstance(value, np.ma.MaskedArray)
    if isinstance(value, list | tuple):
        return bool(value) and all(_is_numeric(x) for x in value)
    return isinstance(value, int | float | complex | np.number | np.bool_) and not isinstance(value, Enum)


def _regular(value: Any) -> bool:
    try:
        np.shape(value)
    except ValueError:
        return False
    return True


def _labels(choices: Sequence[object]) -> Array:
    """Texts for objects, distinct: their names, else short texts; where these repeat, their type and number."""
    if all(type(x) is str for x in choices):
        return np.array(choices, str)
    found = [_label(x) for x in choices]
    own = [name for x in choices if isinstance(name := getattr(x, "name", None), str) and not isinstance(x, Enum)]
    if len(set(found)) < len(found) and not own:
        found = [f"{type(x).__name__} {i}" for i, x in enumerate(choices)]
    return np.array(found, str)


def _label(value: Any) -> str:
    """A short text for a value: a number, a name, or what it prints, if that is short and has no address."""
    if isinstance(value, Enum):
        return str(value.value) if isinstance(value, str) else value.name
    if isinstance(value, float | np.floating):
        return f"{float(value):.12g}"
    if isinstance(value, set | frozenset):
        return f"{{{', '.join(sorted(map(_label, value)))}}}"[:LONGEST_LABEL]
    if isinstance(value, list | tuple) and value:
        return ", ".join(_label(x) for x in value)[:LONGEST_LABEL]
    if isinstance(value, str | np.generic):
        return str(value)
    name = getattr(value, "name", None) or getattr(value, "__name__", None)
    if isinstance(name, str):
        return name
    shown = repr(value)
    return type(value).__name__ if len(shown) > LONGEST_LABEL or ADDRESS.search(shown) or "\n" in shown else shown


def _labels_of_keys(name: str, keys: list[Any]) -> Array:
    if not keys:
        raise InputError(f"{name} has no values; give at least one, as {{label: value}}.")
    if all(isinstance(key, str) for key in keys):
        return np.array(keys, str)
    if all(isinstance(key, int | float) and not isinstance(key, bool) for key in keys):
        return np.array(keys)
    raise InputError(f"{name} has labels {keys!r:.80}; expected all texts, or all numbers: {{label: value}}.")


def _at_choices(found: Column, labels: Array) -> Array | None:
    """Labels of the choices, of labels of the values; a choice with two labels becomes two choices."""
    assert found.choices is not None
    if len(found.choices) < len(labels):
        raise InputError(f"{found.name} has one value under several labels; give each value once.")
    return labels


def _check_distinct(found: Column) -> None:
    """Refuse an axis with the same label twice.

    Raises:
        InputError: naming the label, and what to do.
    """
    shown = found.shown if found.labels is not None or found.values.ndim == 1 else found.values
    shown = shown + 0.0 if shown.dtype.kind == "f" else shown  # -0.0 is 0.0
    unique = (
        np.unique(shown, axis=0, equal_nan=True) if shown.dtype.kind in "fc" and shown.ndim == 1 else np.unique(shown, axis=0)
    )
    if len(unique) == len(shown):
        return
    seen: set[str] = set()
    twice = next(label for x in shown.tolist() if (label := str(x)) in seen or seen.add(label))  # type: ignore[func-returns-value]
    if found.choices is not None and len(set(found.values.tolist())) == len(found):
        raise InputError(
            f"{found.name} has different objects with the same name {twice!r:.80}; name each: "
            f"{found.name}={{'first': ..., 'second': ...}}."
        )
    raise InputError(
        f"{found.name} has {twice:.80} more than once; give each value of a grid once. To repeat a computation with other "
        "random numbers, add an argument such as trial=range(10)."
    )


def _count(n: int, what: str) -> str:
    return f"{n:,} {what}{'' if n == 1 else 's'}"
