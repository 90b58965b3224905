"""`grid`, `sample`, tables: the samples of a study, each a set of named arguments."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Protocol

import numpy as np

from rbd.arrays import Array
from rbd.errors import InputError


class Samples(Protocol):
    """Named arguments of n calls, in a fixed order.

    Attributes:
        names: Names of the arguments.
        dims: {dimension of the dataset: its length}; of a grid one for each name, else "sample".
    """

    names: tuple[str, ...]
    dims: Mapping[str, int]

    def __len__(self) -> int: ...

    def columns(self, start: int, stop: int) -> dict[str, Any]:
        """{name: values of the samples start to stop}: an array of numbers, else a list of objects."""
        ...

    def coords(self) -> dict[str, tuple[tuple[str, ...], Array, dict[str, str]]]:
        """{name: (dimensions, values, attributes)} as coordinates of the dataset; objects by their names."""
        ...

    def digest(self) -> str:
        """A hash of all values, which tells whether a store is of the same samples."""
        ...


class Grid:
    """All combinations of given values, the last name varying fastest; computed where they are needed."""

    def __init__(self, axes: Mapping[str, Sequence[Any] | Array]) -> None:
        self.axes = {name: np.asarray(values) for name, values in axes.items()}
        self.names = tuple(self.axes)
        self.dims: Mapping[str, int] = {name: len(values) for name, values in self.axes.items()}

    def __len__(self) -> int:
        return math.prod(self.dims.values())

    def columns(self, start: int, stop: int) -> dict[str, Any]:
        """As `Samples.columns`."""
        at = np.unravel_index(np.arange(start, stop), tuple(self.dims.values()))
        return {name: values[i] for (name, values), i in zip(self.axes.items(), at, strict=True)}

    def coords(self) -> dict[str, tuple[tuple[str, ...], Array, dict[str, str]]]:
        """As `Samples.coords`."""
        return {name: ((name,), values, {}) for name, values in self.axes.items()}

    def digest(self) -> str:
        """As `Samples.digest`."""
        found = hashlib.sha256(b"grid")
        for name, values in self.axes.items():
            found.update(name.encode() + values.tobytes())
        return found.hexdigest()


class Table:
    """Samples in columns of one length: of draws, tables, and iterables of mappings."""

    def __init__(self, columns: Mapping[str, Sequence[Any] | Array]) -> None:
        self._columns = {name: np.asarray(values) for name, values in columns.items()}
        self.names = tuple(self._columns)
        self.dims: Mapping[str, int] = {"sample": len(next(iter(self._columns.values())))}

    def __len__(self) -> int:
        return self.dims["sample"]

    def columns(self, start: int, stop: int) -> dict[str, Any]:
        """As `Samples.columns`."""
        return {name: values[start:stop] for name, values in self._columns.items()}

    def coords(self) -> dict[str, tuple[tuple[str, ...], Array, dict[str, str]]]:
        """As `Samples.coords`."""
        return {name: (("sample",), values, {}) for name, values in self._columns.items()}

    def digest(self) -> str:
        """As `Samples.digest`."""
        found = hashlib.sha256(b"table")
        for name, values in self._columns.items():
            found.update(name.encode() + values.tobytes())
        return found.hexdigest()


def grid(**axes: Sequence[Any] | Array) -> Grid:
    """All combinations of the values of each argument, the last varying fastest."""
    return Grid(axes)


def samples_of(given: object) -> Samples:
    """What a user gave as samples.

    Raises:
        InputError: what cannot be taken.
    """
    if isinstance(given, Grid | Table):
        return given
    if isinstance(given, Mapping):
        return Table(given)
    if isinstance(given, Iterable):
        rows = list(given)
        return Table({name: [row[name] for row in rows] for name in rows[0]})
    raise InputError(f"samples are {given!r:.80}; expected rbd.grid(...), rbd.sample(...), a table or mappings.")
