"""`Samples`: named arguments of many calls, in a fixed order; computed where they are needed."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rbd.arrays import Array
from rbd.displayed import Displayed
from rbd.errors import InputError, nearest
from rbd.studies.sampling.columns import Column, Coordinate

MOST_SAMPLES = 2**53
"""More are refused: beyond, a sample's number is not exact as a float."""
FORMAT = b"rbd samples 1"
AT_ONCE = 512
"""Samples that are computed at once where they are gone through one by one."""
RESERVED = ("ok", "reason", "message")
"""Variables that every dataset of a study has."""
ONE = "sample"
"""The dimension, of length 1, of samples of which no argument varies."""


@dataclass(frozen=True, eq=False, repr=False)
class Samples(Displayed):
    """Arguments of n calls: what `rbd.grid`, `rbd.sample` and `rbd.studies.table` give; `*` combines two, each with each.

    The samples are numbered from 0, the last dimension varying fastest. Only values along each dimension are in memory.

    Attributes:
        dims: {dimension of the dataset: its length}; of a grid one for each argument that varies, of draws and tables "sample".
        given: The values of each argument.
        shown: Coordinates of the dataset that are no arguments, as of the rows of an xarray.Dataset.

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
    shown: tuple[Column, ...] = ()

    def __post_init__(self) -> None:
        if not self.given:
            raise InputError("samples have no arguments; give at least one, such as friction=[0.3, 0.6].")
        if not self.dims:
            object.__setattr__(self, "dims", {ONE: 1})
        if len(self) > MOST_SAMPLES:
            raise InputError(f"samples are {len(self):.3g}, more than 2^53; give fewer values of each argument.")
        if own := [x for x in self.taken if x in RESERVED and x not in self.names]:
            raise InputError(
                f"samples have a dimension or coordinate {own[0]!r}, which every dataset of a study has for itself; rename it."
            )
        taken = [*self.dims]
        for each in self._columns:
            taken += [x for x in each.coords() if x not in self.dims or each.dim != x]
            taken += [x for x in dict.fromkeys(dim for dims, _, _ in each.coords().values() for dim in dims) if x != each.dim]
        if twice := [x for x in dict.fromkeys(taken) if taken.count(x) > 1]:
            raise InputError(
                f"samples have {twice[0]!r:.80} twice, among arguments {list(self.names)} and dimensions {list(self.dims)}; "
                "rename one."
            )

    def __len__(self) -> int:
        return math.prod(self.dims.values())

    def __iter__(self) -> Iterator[dict[str, Any]]:
        """All arguments of each sample, one after the other, as of `row`."""
        n, fixed = len(self), self.fixed
        for start in range(0, n, AT_ONCE):
            for found in arguments(self.columns(start, min(start + AT_ONCE, n))):
                yield {name: found[name] if name in found else fixed[name] for name in self.names}

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all arguments."""
        return tuple(each.name for each in self.given)

    @property
    def taken(self) -> tuple[str, ...]:
        """All names that the samples have in the dataset, which results cannot have: arguments, coordinates, dimensions."""
        found = dict.fromkeys((*self.names, *self.dims))
        for each in self._columns:
            for name, (dims, _, _) in each.coords().items():
                found |= dict.fromkeys((name, *dims))
        return tuple(found)

    @property
    def fixed(self) -> dict[str, Any]:
        """{name: value} of the arguments that are the same in all samples, and are not in `columns`."""
        return {each.name: each.one(0) for each in self.given if not each.dim} if self._vary else {}

    @property
    def _columns(self) -> tuple[Column, ...]:
        """All that stands in the coordinates."""
        return (*self.given, *self.shown)

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
        if len(self.dims) == 1:
            return {each.name: each.take(slice(start, stop)) for each in self.given if each.dim or not self._vary}
        at = dict(zip(self.dims, np.unravel_index(np.arange(start, stop), tuple(self.dims.values())), strict=True))
        return {each.name: each.take(at[each.dim]) for each in self.given if each.dim}

    def row(self, i: int) -> dict[str, Any]:
        """All arguments of one sample, to call the function with them again: `function(**samples.row(17))`.

        Args:
            i: Number of the sample; from the end if negative.

        Raises:
            InputError: there is no such sample.
        """
        if isinstance(i, bool) or not isinstance(i, int | np.integer) or not -len(self) <= i < len(self):
            raise InputError(f"there is no sample {i!r:.80}; there are {len(self):,}, from 0 on.")
        at = self._places(int(i) % len(self))
        return {each.name: each.one(at.get(each.dim, 0)) for each in self.given}

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
        places = {}
        for dim, n in self.dims.items():
            if dim not in labels and n > 1:
                raise InputError(f"{dim} has {n} values; say which, as {dim}=...")
            places[dim] = self._place(dim, labels[dim]) if dim in labels else 0
        return {each.name: each.one(places.get(each.dim, 0)) for each in self.given}

    def coords(self) -> dict[str, Coordinate]:
        """{name: (dimensions, values, attributes)} of the dataset's coordinates; objects by their names.

        A dimension without an argument of its name, such as `sample`, is numbered. Vectors of a grid, and numbers with labels,
        have the labels (or numbers) under their name and the values in `<name>_value`.
        """
        found: dict[str, Coordinate] = {dim: ((dim,), self._labels(dim), {}) for dim in self.dims}
        for each in self._columns:
            found |= each.coords()
        return {name: (dims, np.array(values), attrs) for name, (dims, values, attrs) in found.items()}

    def digest(self) -> str:
        """A hash of the arguments of all samples, 64 digits: the same in all processes; units do not count.

        Raises:
            InputError: an object whose content cannot be read.
        """
        found = hashlib.sha256(FORMAT)
        found.update(repr([(dim, n) for dim, n in self.dims.items()]).encode())
        for each in self.given:
            each.add_to(found)
        if self.shown:
            found.update(b"shown")
        for each in self.shown:
            each.add_to(found)
        return found.hexdigest()

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
        return replace(self, given=tuple(x.with_units(units.get(x.name, x.units)) for x in self.given))

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
            told = "Draw all that is random in one rbd.sample; name the dimension of a table: rbd.studies.table(..., dimension="
            raise InputError(f"both samples vary along {both[0]!r:.80}. {told}'case').")
        return Samples({**dims, **more}, (*self.given, *other.given), (*self.shown, *other.shown))

    __array_ufunc__ = None  # so that an array times samples is refused, and not tried entry by entry

    def _places(self, i: int) -> dict[str, int]:
        """{dimension: where sample i is along it}."""
        found = {}
        for dim, n in reversed(list(self.dims.items())):
            i, found[dim] = divmod(i, n)
        return found

    def _labels(self, dim: str) -> Array:
        own = [each for each in self._columns if each.name == each.dim == dim]
        return own[0].shown if own else np.arange(self.dims[dim])

    def _place(self, dim: str, label: object) -> int:
        """Where a label stands along a dimension."""
        known = self._labels(dim)
        if known.dtype.kind in "iuf" and isinstance(label, int | float | np.number) and not isinstance(label, bool):
            number = float(label)
            found = np.flatnonzero((known == number) | (np.isnan(known) if number != number else False))
            if not len(found):
                close = known[np.argsort(np.abs(known - number), kind="stable")[:2]]
                raise InputError(f"{dim} has no value {label!r:.80}; nearest: {', '.join(str(x) for x in np.sort(close))}.")
            return int(found[0])
        text = str(getattr(label, "name", label))
        shown = [str(x) for x in known]
        if text not in shown:
            raise InputError(f"{dim} has no value {label!r:.80}; {nearest(text, shown)}.")
        return shown.index(text)

    def __repr__(self) -> str:
        parts = [f"{dim} {n:,}" for dim, n in self.dims.items()]
        return f"Samples({len(self):,}: {' x '.join(parts)}; arguments {', '.join(self.names)})"[:300]

    def __str__(self) -> str:
        size = " x ".join(f"{dim} ({n:,})" for dim, n in self.dims.items())
        lines = [f"{len(self):,} sample{'' if len(self) == 1 else 's'}" + (f": {size}" if len(self.dims) > 1 else "")]
        width = max(len(name) for name in self.names[:20])
        lines += [f"  {each.name:<{width}}  {each.text}" for each in self.given[:20]]
        if len(self.given) > 20:
            lines.append(f"  and {len(self.given) - 20} more arguments")
        return "\n".join(lines)


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
