"""`Store`: what all stores do; and the one in memory."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from rbd.arrays import Array
from rbd.errors import InputError
from rbd.errors.reasons import Reason
from rbd.studies.dataset import dataset_of
from rbd.studies.kept.variable import Block, Variable, missing
from rbd.studies.samples import Samples

if TYPE_CHECKING:
    import xarray


class Store(Protocol):
    """Results of n samples, filled block by block.

    Attributes:
        done: Which samples are finished, shape (n,), truth values.
    """

    done: Array

    def put(self, block: Block) -> None:
        """Keep a finished block.

        A store on disk writes it within a second or so, or when it is closed.

        Raises:
            InputError: a variable that does not agree with that of earlier samples.
            StudyStopped: it cannot be written.
        """
        ...

    def dataset(self) -> xarray.Dataset:
        """All that is kept; what is not done has `Reason.NOT_RUN`."""
        ...

    def close(self) -> None:
        """Write what is not yet written, and give the store free for others."""
        ...


class Kept:
    """The variables that were kept so far, without their values; refuses those that disagree with earlier ones."""

    def __init__(self) -> None:
        self._first: dict[str, tuple[int, int]] = {}
        self._forms: dict[str, tuple[tuple[int, ...], str, int]] = {}
        self._labels: dict[str, tuple[Any, ...]] = {}

    def check(self, block: Block) -> None:
        """Refuse variables whose shape, kind or labels differ from those of earlier samples.

        Raises:
            InputError: names the variable, both shapes, and the samples.
        """
        for place, (name, v) in enumerate(block.variables.items()):
            _check_name(name)
            shape, kind = v.values.shape[1:], _KINDS.get(v.values.dtype.kind, str(v.values.dtype))
            old = self._forms.setdefault(name, (shape, kind, block.start))
            if old[:2] != (shape, kind):
                raise InputError(
                    f"{name!r} is {kind} of shape {shape} in samples {block.start} to {block.stop - 1}, and {old[1]} of shape "
                    f"{old[0]} from sample {old[2]} on. All samples of a study have results of one shape: leave it out by "
                    "keep=, or return numbers that all have."
                )
            for dim, labels in v.labels.items():
                if tuple(self._labels.setdefault(dim, tuple(labels))) != tuple(labels):
                    raise InputError(
                        f"{dim!r} of {name!r} has the labels {str(tuple(labels)):.200} in samples {block.start} to "
                        f"{block.stop - 1}, and {str(self._labels[dim]):.200} in others. Give each its own dimension."
                    )
            self._first[name] = min(self._first.get(name, (block.start, place)), (block.start, place))

    @property
    def first(self) -> dict[str, tuple[int, int]]:
        """{variable: the first block that has it, and its place there}."""
        return dict(self._first)

    def begin(self, first: Mapping[str, tuple[int, int]], forms: Mapping[str, Variable]) -> None:
        """Take over the variables of a store."""
        self.check(Block(0, 0, {name: forms[name] for name in first}, np.empty(0), np.empty(0), {}))
        self._first |= first

    def in_order(self) -> list[str]:
        """Names by the first sample that has them, whatever the order in which blocks are finished."""
        return sorted(self._first, key=self._first.__getitem__)


_KINDS = {"f": "numbers", "i": "whole numbers", "u": "whole numbers", "b": "truth values", "U": "text", "O": "text"}


def _check_name(name: str) -> None:
    if not name or "/" in name or name.startswith(("__", ".")):
        raise InputError(
            f"a result is named {name!r:.80}; no variable of a dataset that is stored can have this name. Rename it."
        )


class Buffer:
    """Results of consecutive samples, in arrays that are filled.

    Attributes:
        start: Number of the first sample.
        stop: Number after the last.
        variables: {name: variable with the values of all these samples}.
        ok: Which have a result.
        reason: Codes of reasons; `Reason.NOT_RUN` where nothing was computed.
        messages: {number of the sample: message}.
    """

    def __init__(self, start: int, stop: int) -> None:
        n = stop - start
        self.start, self.stop = start, stop
        self.variables: dict[str, Variable] = {}
        self.ok, self.reason = np.zeros(n, bool), np.full(n, Reason.NOT_RUN.code, np.int16)
        self.messages: dict[int, str] = {}

    def put(self, block: Block) -> None:
        """Take the part of a block that lies here."""
        first, last = max(self.start, block.start), min(self.stop, block.stop)
        here, there = slice(first - self.start, last - self.start), slice(first - block.start, last - block.start)
        for name, v in block.variables.items():
            if name not in self.variables:
                self.variables[name] = empty_of(v, self.stop - self.start)
            self.variables[name].values[here] = v.values[there]
        self.ok[here], self.reason[here] = block.ok[there], block.reason[there]
        if block.messages:
            self.messages |= {i: text for i, text in block.messages.items() if first <= i < last}

    def block(self, order: list[str] | None = None) -> Block:
        """All of it."""
        names = self.variables if order is None else [name for name in order if name in self.variables]
        variables = {name: self.variables[name] for name in names}
        return Block(self.start, self.stop, variables, self.ok, self.reason, self.messages)


def empty_of(v: Variable, n: int) -> Variable:
    """A variable of n samples without values; text as objects, of any length."""
    kind = np.dtype(object) if v.values.dtype.kind in "UOT" else v.values.dtype
    return replace(v, values=np.full((n, *v.values.shape[1:]), missing(kind), kind))


class MemoryStore:
    """A store that ends with the process.

    Args:
        samples: The samples.
        attributes: Provenance, which stands in the dataset.
    """

    def __init__(self, samples: Samples, attributes: Mapping[str, Any]) -> None:
        self.samples, self.attributes = samples, attributes
        self.done = np.zeros(len(samples), bool)
        self.kept, self.found = Kept(), Buffer(0, len(samples))

    def put(self, block: Block) -> None:
        """As `Store.put`."""
        self.kept.check(block)
        self.found.put(block)
        self.done[block.start : block.stop] = True

    def dataset(self) -> xarray.Dataset:
        """As `Store.dataset`."""
        return dataset_of(self.samples, self.found.block(self.kept.in_order()), self.attributes)

    def close(self) -> None:
        """Nothing to do."""
