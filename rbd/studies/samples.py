"""`Samples`: named arguments of many calls, in a fixed order; `grid`: all combinations of values."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any

import numpy as np

from rbd.arrays import Array
from rbd.displayed import Displayed
from rbd.errors import InputError, nearest
from rbd.model.content_hash import digest
from rbd.records import joined

MOST_SAMPLES = 2**53
"""More are refused: beyond, a sample's number is not exact as a float."""
OWN = ("ok", "reason", "message")
"""What every sample has in a store."""
RESERVED = (*OWN, "reason_text")
"""Variables that every dataset of a study has."""
ONE = "sample"
"""The dimension, of length 1, of samples of which no argument varies."""
Coordinate = tuple[tuple[str, ...], Array, dict[str, str]]
"""Dimensions, values and attributes, as xarray takes them."""
ADDRESS = re.compile(r"\b0x[0-9a-fA-F]{4,}")
LONGEST_LABEL = 60


@dataclass(frozen=True, eq=False, repr=False)
class Column:
    """The values of one argument along one dimension of the samples.

    Attributes:
        name: Name of the argument.
        dim: The dimension along which it varies; "" if it is the same in all samples.
        values: Along the dimension, shape (n, ...): numbers, truth values, dates; texts and others as objects.
        labels: What coordinates show of each value, shape (n,); None: numbers stand for themselves.
        named: Whether a user gave the labels.
        units: Unit; "" where none is known.
        mark: What stands for the values in `digest`, where they differ in the last bits from platform to platform.
    """

    name: str
    dim: str
    values: Array
    labels: Array | None = None
    named: bool = False
    units: str = ""
    mark: str = ""

    def __len__(self) -> int:
        return len(self.values)

    def take(self, at: Array) -> Array | list[Any]:
        """The values at some places: a new array of numbers, shape (k, ...), or a list of texts and objects."""
        found = self.values[at]
        return found.tolist() if found.dtype == object else found

    def one(self, i: int) -> Any:
        """The value at a place: a plain number, an array, a text, an object."""
        found = self.take(np.array([i]))[0]
        return found.item() if isinstance(found, np.generic) and found.dtype.kind in "biufc" else found

    @property
    def shown(self) -> Array:
        """Labels of all values, shape (n,); of vectors without labels their numbers 0 to n - 1."""
        if self.labels is not None:
            return self.labels
        return np.arange(len(self)) if self.values.ndim > 1 else self.values

    def coords(self) -> dict[str, Coordinate]:
        """{name: coordinate}: one dimension along the samples; numbers with labels, and vectors of a grid, have two."""
        dims, at = ((self.dim,), slice(None)) if self.dim else ((), 0)
        units = {"units": self.units} if self.units else {}
        inner = tuple(f"{self.name}_{i}" for i in range(self.values.ndim - 1))
        if self.values.dtype != object and (self.labels is not None or (inner and self.dim == self.name)):
            value = ((*dims, *inner), self.values[at], units)
            return {self.name: (dims, self.shown[at], {}), f"{self.name}_value": value}
        return {self.name: ((*dims, *inner), (self.values if inner else self.shown)[at], units)}

    def content(self) -> tuple[Any, ...]:
        """All that is in the column, for `digest`; but for units, and for labels that follow from the objects."""
        listed = self.values.tolist() if self.values.dtype == object else []
        text = bool(listed) and all(type(x) is str for x in listed)  # as one text: they may be millions
        values: Any = ("".join(listed), np.array([len(x) for x in listed])) if text else self.mark or self.values
        return self.dim, values, self.labels if self.named else None

    @property
    def text(self) -> str:
        """The values in a few words, for people."""
        unit, n, shown = f" {self.units}" if self.units and self.labels is None else "", len(self), self.shown
        several = "" if n == 1 else "s"
        if self.values.ndim > 1 and self.labels is None:
            return f"{n:,} array{several} of shape {self.values.shape[1:]}{unit}"
        if not self.dim:
            return f"{_label(shown[0])}{unit} in all"
        if shown.dtype.kind in "iuf" and n > 3:
            return f"{n:,} values from {np.nanmin(shown):.6g} to {np.nanmax(shown):.6g}{unit}"
        return f"{n:,} value{several}: {joined(dict.fromkeys(map(_label, shown[:1000].tolist()))):.200}{unit}"


def column(name: str, given: Any, dim: str, *, distinct: bool = False) -> Column:
    """Values as a user gave them, as a column along `dim`; fixed, along none, if one value was given.

    Args:
        name: Name of the argument.
        given: One value (number, text, None, object), a sequence or array of values, or a mapping {label: value}.
        dim: The dimension.
        distinct: Whether labels must differ: of an axis of a grid, and of what has the name of its dimension.

    Raises:
        InputError: no values, arrays of different lengths, a set, labels that repeat, masked values.
    """
    check_name(name)
    labels: Array | None = None
    units = str(getattr(given, "attrs", {}).get("units", "")) if hasattr(given, "dims") else ""
    if isinstance(given, Mapping):
        labels, given = _labels_of_keys(name, list(given)), list(given.values())
    elif is_one(given):
        plain = getattr(given, "ndim", None) == 0 and hasattr(given, "item") and not isinstance(given, np.ma.MaskedArray)
        given, dim = [given.item() if plain else given], ""
    elif isinstance(given, set | frozenset):
        raise InputError(f"{name} is a set, which has no order; give a list.")
    values = _values(name, given)
    if not len(values):
        raise InputError(f"{name} has no values; give at least one.")
    own = _labels(values.tolist()) if values.dtype == object and labels is None else labels
    found = Column(name, dim, values, own, labels is not None, units)
    if dim and (distinct or name == dim):
        _check_distinct(found)
    return found


def is_one(given: object) -> bool:
    """Whether this is one value, and no sequence of values: text, a number, None, a robot, a law, what has a name."""
    if given is None or isinstance(given, str | bytes | Enum | type) or getattr(given, "ndim", None) == 0:
        return True
    named = isinstance(getattr(given, "name", None), str) and not hasattr(given, "dtype")
    return not isinstance(given, Iterable) or named


def check_name(name: object) -> None:
    """Refuse names that no dataset can have.

    Raises:
        InputError: no text, empty, or with a slash or a blank.
    """
    if not isinstance(name, str) or not name or "/" in name or any(letter.isspace() for letter in name):
        raise InputError(f"{name!r:.80} cannot be the name of an argument; expected text without '/' and blanks.")


def _values(name: str, given: Any) -> Array:
    """Numbers, truth values or dates as an array of one of a few kinds; texts and others as objects, one a value."""
    listed = given.to_numpy() if hasattr(given, "to_numpy") else given
    try:
        listed = listed if isinstance(listed, np.ndarray) else list(listed)
    except TypeError as error:
        raise InputError(f"{name} is {given!r:.80}, which has no values to go through ({error}); give a list.") from None
    if any(isinstance(x, np.ma.MaskedArray) for x in ([listed] if isinstance(listed, np.ndarray) else listed)):
        raise InputError(f"{name} is a masked array. Give its values with NaN, {name}.filled(numpy.nan), or those that count.")
    try:
        array = np.asarray(listed)
    except ValueError:  # of different shapes
        shapes = list(dict.fromkeys(str(getattr(x, "shape", (len(x),))) for x in listed if hasattr(x, "__len__")))
        if all(np.asarray(y).dtype.kind in "biufc" for x in listed for y in (x if isinstance(x, list | tuple) else [x])):
            raise InputError(
                f"{name} has arrays of different shapes, {', '.join(shapes[:4])}; give arrays of one shape, or name each: "
                f"{name}={{'first': ..., 'second': ...}}."
            ) from None
        array = np.empty(0, object)
    kind = "f" if array.dtype.kind == "u" and array.size and array.max() > np.iinfo(np.int64).max else array.dtype.kind
    if kind in "iufcbmM":
        return np.array(array, {"i": np.int64, "u": np.int64, "f": np.float64, "c": np.complex128}.get(kind))
    found = np.empty(len(listed), object)
    for i, x in enumerate(listed):  # one by one, as NumPy would look into lists of contacts
        found[i] = str(x) if isinstance(x, np.str_) else x
    return _without_gaps(found)


def _without_gaps(values: Array) -> Array:
    """Values of a data frame: where all else is numbers, missing ones are NaN; else what is missing is None."""
    gaps = np.array([type(x).__name__ == "NAType" or (isinstance(x, float) and x != x) for x in values], bool)
    if not gaps.any():
        return values
    numbers = all(isinstance(x, int | float | np.number) and not isinstance(x, bool) for x in values[~gaps])
    found = values.copy()
    found[gaps] = math.nan if numbers else None
    return found.astype(float) if numbers else found


def _labels(objects: list[Any]) -> Array:
    """Texts for objects: their names, else short texts; where these repeat, their type and number."""
    found = [_label(x) for x in objects]
    several = {x if isinstance(x, str | int | float | None) else id(x) for x in objects}
    if len(set(found)) < len(several) and not any(hasattr(x, "name") for x in objects):
        found = [f"{type(x).__name__} {i}" for i, x in enumerate(objects)]
    return np.array(found, str)


def _label(value: Any) -> str:
    """A short text for a value: a number, a name, or what it prints, if that is short and has no address."""
    if isinstance(value, list | tuple | set | frozenset) and value:
        parts = list(map(_label, value))
        return ", ".join(sorted(parts) if isinstance(value, set | frozenset) else parts)[:LONGEST_LABEL]
    if isinstance(value, float | np.floating):
        return f"{float(value):.12g}"
    name = value if isinstance(value, str) else getattr(value, "name", None) or getattr(value, "__name__", None)
    if isinstance(name, str):
        return str(name)
    shown = repr(value)
    return type(value).__name__ if len(shown) > LONGEST_LABEL or ADDRESS.search(shown) or "\n" in shown else str(value)


def _labels_of_keys(name: str, keys: list[Any]) -> Array:
    numbers = all(isinstance(key, int | float) and not isinstance(key, bool) for key in keys)
    if not numbers and not all(isinstance(key, str) for key in keys):
        raise InputError(f"{name} has labels {keys!r:.80}; expected all texts, or all numbers: {{label: value}}.")
    return np.array(keys)


def _check_distinct(found: Column) -> None:
    """Refuse an axis with the same label twice.

    Raises:
        InputError: naming the label, and what to do.
    """
    shown = found.shown if found.labels is not None else found.values
    told = [str(x) for x in (shown + 0.0 if shown.dtype.kind == "f" else shown).tolist()]  # -0.0 is 0.0
    if len(set(told)) == len(told):
        return
    twice = next(x for i, x in enumerate(told) if x in told[:i])
    objects = found.values[[x == twice for x in told]].tolist() if found.values.dtype == object else []
    if objects and not isinstance(objects[0], str) and objects[0] is not objects[-1]:
        raise InputError(
            f"{found.name} has different objects with the same name {twice!r:.80}; name each: "
            f"{found.name}={{'first': ..., 'second': ...}}."
        )
    raise InputError(
        f"{found.name} has {twice:.80} more than once; give each value of a grid once. To repeat a computation with other "
        "random numbers, add an argument such as trial=range(10)."
    )


@dataclass(frozen=True, eq=False, repr=False)
class Samples(Displayed):
    """Arguments of n calls: what `rbd.grid`, `rbd.sample` and `rbd.studies.table` give; `*` combines two, each with each.

    The samples are numbered from 0, the last dimension varying fastest. Only values along each dimension are in memory.

    Attributes:
        dims: {dimension of the dataset: its length}; of a grid one for each argument that varies, of draws and tables "sample".
        given: The values of each argument.

    Example:
        >>> samples = rbd.grid(friction=[0.3, 0.6, 0.9], push_y=[0.0, 100.0]).with_units(push_y="N")
        >>> print(samples)
        6 samples: friction (3) x push_y (2)
          friction  3 values: 0.3, 0.6, 0.9
          push_y    2 values: 0, 100 N
        >>> samples.row(3)
        {'friction': 0.6, 'push_y': 100.0}
        >>> samples.at(friction=0.9, push_y=0)
        {'friction': 0.9, 'push_y': 0.0}
        >>> samples.columns(2, 4)
        {'friction': array([0.6, 0.6]), 'push_y': array([  0., 100.])}
    """

    dims: Mapping[str, int]
    given: tuple[Column, ...]

    def __post_init__(self) -> None:
        if not self.given:
            raise InputError("samples have no arguments; give at least one, such as friction=[0.3, 0.6].")
        if not self.dims:
            object.__setattr__(self, "dims", {ONE: 1})
        if len(self) > MOST_SAMPLES:
            raise InputError(f"samples are {len(self):.3g}, more than 2^53; give fewer values of each argument.")
        if own := [x for x in self.dims if x in RESERVED and x not in self.names]:
            raise InputError(f"samples have a dimension {own[0]!r}, which every dataset of a study has for itself; rename it.")
        own_coords = [(each.dim, each.coords()) for each in self.given]
        taken = [*self.dims, *(name for dim, coords in own_coords for name in coords if name != dim)]
        taken += [x for dim, coords in own_coords for x in {x for each in coords.values() for x in each[0]} - {dim}]
        if twice := [x for x in taken if taken.count(x) > 1]:
            raise InputError(
                f"samples have {twice[0]!r:.80} twice, among arguments {list(self.names)} and dimensions {list(self.dims)}; "
                "rename one."
            )

    def __len__(self) -> int:
        return math.prod(self.dims.values())

    def __iter__(self) -> Iterator[dict[str, Any]]:
        """All arguments of each sample, one after the other, as of `row`."""
        return map(self.row, range(len(self)))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all arguments."""
        return tuple(each.name for each in self.given)

    @property
    def fixed(self) -> dict[str, Any]:
        """Arguments that are the same in all samples, unless nothing varies."""
        return {each.name: each.one(0) for each in self.given if not each.dim} if self._vary else {}

    @property
    def _vary(self) -> bool:
        """Whether any argument varies; else there is one sample."""
        return any(each.dim for each in self.given)

    def columns(self, start: int, stop: int) -> dict[str, Any]:
        """The arguments that vary, of consecutive samples; if none does, all of them.

        Args:
            start: Number of the first sample.
            stop: Number after the last.

        Returns:
            {name: values}: numbers as an array of float64, int64 or truth values, shape (stop - start, ...); texts and objects
            as a list.

        Raises:
            InputError: samples that there are not.
        """
        if not 0 <= start <= stop <= len(self):
            raise InputError(f"samples {start} to {stop} are not among 0 to {len(self)}.")
        at = dict(zip(self.dims, np.unravel_index(np.arange(start, stop), tuple(self.dims.values())), strict=True))
        first = next(iter(at.values()))
        return {each.name: each.take(at.get(each.dim, first)) for each in self.given if each.dim or not self._vary}

    def row(self, i: int) -> dict[str, Any]:
        """All arguments of one sample, to call the function with them again: `function(**samples.row(17))`.

        Args:
            i: Number of the sample; from the end if negative.

        Raises:
            InputError: there is no such sample.
        """
        if isinstance(i, bool) or not isinstance(i, int | np.integer) or not -len(self) <= i < len(self):
            raise InputError(f"there is no sample {i!r:.80}; there are {len(self):,}, from 0 on.")
        at = dict(zip(self.dims, np.unravel_index(int(i) % len(self), tuple(self.dims.values())), strict=True))
        return {each.name: each.one(int(at.get(each.dim, 0))) for each in self.given}

    def at(self, **labels: object) -> dict[str, Any]:
        """All arguments of one sample, found by its coordinates: `samples.at(friction=0.6, push_y=100.0)`.

        Args:
            labels: For each dimension the label of a value: a number, a name; of `sample` the number of the draw or row. A
                dimension with one value needs none.

        Raises:
            InputError: a dimension or a label that there is not, with the nearest; a dimension without a label.
        """
        if wrong := [name for name in labels if name not in self.dims]:
            raise InputError(f"{wrong[0]!r:.80} is no dimension of these samples; {nearest(wrong[0], self.dims)}.")
        if open_ := [dim for dim, n in self.dims.items() if dim not in labels and n > 1]:
            raise InputError(f"{open_[0]} has {self.dims[open_[0]]} values; say which, as {open_[0]}=...")
        places = {dim: self._place(dim, label) for dim, label in labels.items()}
        return {each.name: each.one(places.get(each.dim, 0)) for each in self.given}

    def coords(self) -> dict[str, Coordinate]:
        """{name: (dimensions, values, attributes)} of the dataset's coordinates; objects by their names.

        A dimension without an argument of its name, such as `sample`, is numbered. Vectors of a grid, and numbers with labels,
        have the labels (or numbers) under their name and the values in `<name>_value`.
        """
        found: dict[str, Coordinate] = {dim: ((dim,), self._labels(dim), {}) for dim in self.dims}
        for each in self.given:
            found |= each.coords()
        return {name: (dims, np.array(values), attrs) for name, (dims, values, attrs) in found.items()}

    def digest(self) -> str:
        """A hash of the arguments of all samples, 64 digits: the same in all processes; units do not count.

        Raises:
            InputError: an object whose content cannot be read.
        """
        return digest((list(self.dims.items()), self.names, {each.name: each.content() for each in self.given}), "samples")

    def with_units(self, **units: str) -> Samples:
        """The same samples, with units in the attributes of their coordinates: `samples.with_units(push_y="N")`.

        Raises:
            InputError: an argument that there is not, with the nearest; a unit that is no text.
        """
        for name, unit in units.items():
            if name not in self.names:
                raise InputError(f"these samples have no {name!r:.80}; {nearest(name, self.names)}.")
            if not isinstance(unit, str):
                raise InputError(f"the unit of {name} is {unit!r:.80}; expected text such as 'N'.")
        return replace(self, given=tuple(replace(x, units=units.get(x.name, x.units)) for x in self.given))

    def __mul__(self, other: Samples) -> Samples:
        """Each of these samples with each of the others, which vary faster: random draws at every point of a grid.

        Raises:
            InputError: both have an argument, or a dimension, of one name; or `other` is something else.
        """
        if not isinstance(other, Samples):
            raise InputError(f"samples times {other!r:.80}; expected samples: rbd.studies.table(...) makes them of rows.")
        if both := sorted(set(self.names) & set(other.names)):
            raise InputError(f"both samples have {', '.join(both)}; an argument can stand in one of them only.")
        dims, more = self.dims if self._vary else {}, other.dims if other._vary else {}
        if both := sorted(set(dims) & set(more)):
            raise InputError(
                f"both samples vary along {both[0]!r:.80}. Draw all that is random in one rbd.sample; name the dimension of a "
                "table: rbd.studies.table(..., dimension='case')."
            )
        return Samples({**dims, **more}, (*self.given, *other.given))

    __array_ufunc__ = None  # so that an array times samples is refused, and not tried entry by entry

    def _labels(self, dim: str) -> Array:
        own = [each.shown for each in self.given if each.name == each.dim == dim]
        return own[0] if own else np.arange(self.dims[dim])

    def _place(self, dim: str, label: object) -> int:
        """Where a label stands along a dimension."""
        known, name = self._labels(dim).tolist(), getattr(label, "name", label)
        shown = list(map(str, known))
        if name not in known and str(name) not in shown:
            raise InputError(f"{dim} has no value {label!r:.80}; {nearest(str(name), shown)}.")
        return known.index(name) if name in known else shown.index(str(name))

    def __str__(self) -> str:
        size = " x ".join(f"{dim} ({n:,})" for dim, n in self.dims.items())
        lines = [f"{len(self):,} sample{'' if len(self) == 1 else 's'}" + (f": {size}" if len(self.dims) > 1 else "")]
        width = max(len(name) for name in self.names[:20])
        lines += [f"  {each.name:<{width}}  {each.text}" for each in self.given[:20]]
        more = len(self.given) - 20
        return "\n".join(lines + ([f"  and {more} more arguments"] if more > 0 else []))


def arguments(columns: Mapping[str, Sequence[Any] | Array]) -> Iterator[dict[str, Any]]:
    """The arguments of each sample of some columns, one after the other: plain Python numbers, arrays, texts, objects.

    Args:
        columns: {name: values}, as of `Samples.columns`.
    """
    plain = [
        x.tolist() if isinstance(x, np.ndarray) and x.ndim == 1 and x.dtype.kind in "biufc" else x for x in columns.values()
    ]
    names = tuple(columns)
    return (dict(zip(names, values, strict=True)) for values in zip(*plain, strict=True))


def grid(arguments: Mapping[str, object] | None = None, /, **values: object) -> Samples:
    """All combinations of the values of each argument, the last varying fastest; for `rbd.study`.

    Only the values are in memory, never the combinations: a grid of 10^9 samples costs as much as its axes. Each argument with
    values is a dimension of the dataset, and they are its coordinate; their order is kept. NaN is a number like others.

    Args:
        arguments: {argument: values}, in place of or beside those by name: `rbd.grid({"friction": [0.3, 0.6]})`.
        values: For each argument of the function one of

            - numbers, truth values or texts in a list, array, range or series, each once;
            - objects, such as robots, contacts, laws, or lists of contacts: coordinates show their names. Names that repeat
              are refused; `{label: object}` names objects, and numbers too: `friction={"ice": 0.05, "rubber": 0.9}`;
            - vectors or matrices, shape (n, ...), along the first axis: the coordinate numbers them, or has the labels of a
              mapping, and `<name>_value` contains them;
            - one value, such as `robot=talos`: it is the same in all samples, and a coordinate without a dimension.

    Returns:
        The samples. `grid(...) * rbd.sample(...)` are draws at every point, `grid(...) * table` every row of a table at every
        point: for arguments that vary together.

    Raises:
        InputError: no argument, one that is given twice, an argument without values, values or labels that repeat, vectors of
            different lengths.

    Example:
        >>> print(rbd.grid(law=["convex", "coulomb"], push=[(0, 9, 0), (9, 0, 0), (9, 9, 0)], friction=0.7))
        6 samples: law (2) x push (3)
          law       2 values: convex, coulomb
          push      3 arrays of shape (3,)
          friction  0.7 in all
    """
    rows = hasattr(arguments, "columns") or hasattr(arguments, "dims")
    if arguments is not None and (rows or not isinstance(arguments, Mapping)):
        told = "rbd.study takes the rows of tables as they are" if rows else "name them"
        raise InputError(
            f"grid has a {type(arguments).__name__}; expected arguments by name, rbd.grid(friction=[0.3, 0.6]), or a mapping "
            f"of them, rbd.grid({{'friction': [0.3, 0.6]}}). Please: {told}."
        )
    named = arguments or {}
    if twice := sorted(set(named) & set(values)):
        raise InputError(f"{twice[0]} is given twice, in the mapping and by name; give it once.")
    given = [column(name, each, name, distinct=True) for name, each in {**named, **values}.items()]
    return Samples({each.name: len(each) for each in given if each.dim}, tuple(given))
