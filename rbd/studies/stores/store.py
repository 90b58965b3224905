"""`Store`: what all stores do; and the one in memory."""

from __future__ import annotations

from dataclasses import replace
from typing import Protocol

import numpy as np

from rbd.arrays import Array
from rbd.errors import InputError
from rbd.studies.kept.variable import Block, Variable, missing


class Store(Protocol):
    """Results of n samples, filled block by block.

    Attributes:
        done: Which samples are finished, shape (n,), truth values.
    """

    done: Array

    def put(self, block: Block) -> None:
        """Keep a finished block; afterwards it survives the end of the process, where the store is a file."""
        ...

    def contents(self) -> Block:
        """All that is kept, of samples 0 to n; what is not done has `Reason.NOT_RUN`."""
        ...

    def close(self) -> None:
        """Give the store free for others."""
        ...


class MemoryStore:
    """A store that ends with the process."""

    def __init__(self, n: int) -> None:
        self.n, self.done = n, np.zeros(n, bool)
        self._variables: dict[str, Variable] = {}
        self._ok, self._reason = np.zeros(n, bool), np.zeros(n, np.int16)
        self._messages: dict[int, str] = {}

    def put(self, block: Block) -> None:
        """As `Store.put`."""
        at = slice(block.start, block.stop)
        for name, variable in block.variables.items():
            own = self._variables.get(name)
            if own is None:
                kind = variable.values.dtype
                own = replace(variable, values=np.full((self.n, *variable.values.shape[1:]), missing(kind), kind))
                self._variables[name] = own
            elif own.values.shape[1:] != variable.values.shape[1:]:
                raise InputError(f"{name} has shape {variable.values.shape[1:]} and had {own.values.shape[1:]}.")
            own.values[at] = variable.values
        self._ok[at], self._reason[at] = block.ok, block.reason
        self._messages |= block.messages
        self.done[at] = True

    def contents(self) -> Block:
        """As `Store.contents`."""
        return Block(0, self.n, self._variables, self._ok, self._reason, self._messages)

    def close(self) -> None:
        """Nothing to do."""
