"""`Store`: what all stores do; and the one in memory."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from rbd.arrays import Array
from rbd.errors.reasons import Reason
from rbd.studies.dataset import dataset_of
from rbd.studies.kept.layout import Layout
from rbd.studies.kept.variable import Block, Variable, missing
from rbd.studies.provenance.provenance import finished
from rbd.studies.sampling.samples import Samples

if TYPE_CHECKING:
    import xarray


class Store(Protocol):
    """Results of n samples, filled block by block.

    Attributes:
        done: Which samples are finished, shape (n,), truth values.
        others: A sentence on other versions that computed a part of it; empty where there are none.
    """

    done: Array
    others: str

    def put(self, block: Block) -> None:
        """Keep a finished block.

        A store on disk writes it within a second, in 5 s where writing takes long, or when it is closed.

        Raises:
            InputError: a variable that does not agree with that of earlier samples.
            StudyStopped: it cannot be written.
        """
        ...

    def dataset(self) -> xarray.Dataset:
        """All that is kept; what is not done has `Reason.NOT_RUN`.

        Raises:
            StudyStopped: what is not yet written cannot be written.
        """
        ...

    def kept(self) -> xarray.Dataset:
        """The same without writing: of a store that cannot be written, what is there."""
        ...

    def close(self) -> None:
        """Write what is not yet written, and give the store free for others."""
        ...


class Seen:
    """The variables that blocks had so far; refuses those that disagree with earlier ones.

    Args:
        samples: The samples, whose arguments are coordinates.

    Attributes:
        first: {variable: the first block that has it, and its place there}.
    """

    def __init__(self, samples: Samples) -> None:
        self._layout = Layout(samples.taken)
        self.first: dict[str, tuple[int, int]] = {}

    def checked(self, block: Block) -> Block:
        """A block without arrays that have no entries, such as torques of a robot without motors: netCDF has no such thing.

        Raises:
            InputError: variables whose shape, kind, unit or labels differ from those of earlier samples; names the variable,
                both values, and the samples.
        """
        self._layout.check(block)
        if not all(v.values.size for v in block.variables.values()):
            block = replace(block, variables={name: v for name, v in block.variables.items() if v.values.size})
        for place, name in enumerate(block.variables):
            self.first[name] = min(self.first.get(name, (block.start, place)), (block.start, place))
        return block

    def begin(self, first: Mapping[str, tuple[int, int]], forms: Mapping[str, Variable]) -> None:
        """Take over the variables of a store."""
        for name, v in forms.items():
            self._layout.agree(name, v, v.values.shape[1:], "the store")
        self.first |= first

    def in_order(self) -> list[str]:
        """Names by the first sample that has them, whatever the order in which blocks are finished."""
        return sorted(self.first, key=self.first.__getitem__)


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


def variable_of(
    values: Array, dims: tuple[str, ...], labels: Mapping[str, tuple[Any, ...]], attrs: Mapping[str, Any]
) -> Variable:
    """A variable of a store, from its values, names and attributes."""
    flags = zip(attrs.get("flag_values", ()), str(attrs.get("flag_meanings", "")).split(), strict=False)
    told = [str(attrs.get(key, "")) for key in ("units", "long_name")]
    return Variable(values, dims, told[0], told[1], labels, {int(k): word for k, word in flags})


class MemoryStore:
    """A store that ends with the process.

    Args:
        samples: The samples.
        attributes: Provenance, which stands in the dataset.
    """

    others = ""

    def __init__(self, samples: Samples, attributes: Mapping[str, Any]) -> None:
        self.samples, self.attributes = samples, attributes
        self.done = np.zeros(len(samples), bool)
        self.seen, self.found = Seen(samples), Buffer(0, len(samples))

    def put(self, block: Block) -> None:
        """As `Store.put`."""
        block = self.seen.checked(block)
        self.found.put(block)
        self.done[block.start : block.stop] = True

    def dataset(self) -> xarray.Dataset:
        """As `Store.dataset`."""
        return self.kept()

    def kept(self) -> xarray.Dataset:
        """As `Store.kept`."""
        return dataset_of(self.samples, self.found.block(self.seen.in_order()), finished(self.attributes))

    def close(self) -> None:
        """Nothing to do."""
