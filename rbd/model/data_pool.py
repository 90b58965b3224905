"""A few `pin.Data` of a robot, lent to its states; and objects that a child process renews after `fork`.

A fork copies the memory and only the thread that forks. A lock that another thread holds stays locked in the child.
"""

from __future__ import annotations

import itertools
import os
import threading
import weakref
from collections import deque
from collections.abc import Callable
from typing import Protocol, TypeVar

import pinocchio as pin


class Forked(Protocol):
    """Protocol: an object with a lock, a thread or a file."""

    def renew_after_fork(self) -> None:
        """Called first in the child: create new locks, discard unfinished work of other threads."""


_known: weakref.WeakSet[Forked] = weakref.WeakSet()


def renewed_after_fork(owner: Forked) -> None:
    """Have `owner.renew_after_fork()` called in every child that is forked while the owner exists."""
    _known.add(owner)


class RenewedLock:
    """A lock that one thread at a time holds, and may take again; used by `with`. A forked child has a new one."""

    def __init__(self) -> None:
        self._lock = threading.RLock()
        renewed_after_fork(self)

    def renew_after_fork(self) -> None:
        """In a forked child: a new lock."""
        self._lock = threading.RLock()

    def __enter__(self) -> None:
        self._lock.acquire()

    def __exit__(self, *_: object) -> None:
        self._lock.release()


def _renew() -> None:
    for owner in list(_known):
        owner.renew_after_fork()


if hasattr(os, "register_at_fork"):  # not on Windows, which has no fork
    os.register_at_fork(after_in_child=_renew)


_tickets = itertools.count(1)
Terms = TypeVar("Terms")


class Slot:
    """One pin.Data and the ticket of the state whose kinematics it contains.

    Attributes:
        data: The Data.
        ticket: 0 while it contains no state's.
        placements: X_WJ of each joint: references, which follow the data.
    """

    __slots__ = ("data", "placements", "ticket")

    def __init__(self, data: pin.Data) -> None:
        self.data = data
        self.placements = [data.oMi[joint] for joint in range(len(data.oMi))]
        self.ticket = 0


class DataPool:
    """A few `pin.Data`, lent to states by ticket.

    Creating one costs about ten times all dynamics terms, and a state may live long; so a state keeps its Data while no one
    else needs it, and runs its kinematics again when it was taken away. All use is under `lock`, but for `give_back`.
    """

    def __init__(self, model: pin.Model, size: int = 4) -> None:
        self._model = model
        self._size = size
        self._lent: list[Slot] = []
        self._free: list[Slot] = []
        self._returned: deque[tuple[Slot, int]] = deque()
        self.lock = threading.RLock()
        renewed_after_fork(self)

    def take(self, fill: Callable[[pin.Data], None]) -> tuple[Slot, int]:
        """A slot filled for a new ticket: a free one, a new one while there are few, else the one lent longest."""
        self._take_back()
        if self._free:
            slot = self._free.pop()
        elif len(self._lent) < self._size:
            slot = Slot(self._model.createData())
        else:
            slot = self._lent.pop(0)
        slot.ticket = 0
        self._lent.append(slot)
        fill(slot.data)
        slot.ticket = next(_tickets)
        return slot, slot.ticket

    def give_back(self, slot: Slot, ticket: int) -> None:
        """End a loan; no effect if the slot has been given to another ticket.

        It takes no lock: the garbage collector can call it at any time, in a thread that may hold another robot's lock.
        While the lock is taken the slot is only noted, for the next `take`.
        """
        self._returned.append((slot, ticket))
        lock = self.lock
        if lock.acquire(blocking=False):
            try:
                self._take_back()
            finally:
                lock.release()

    def compute(self, terms: Callable[[pin.Data], Terms]) -> Terms:
        """What a function computes in a Data that no state needs meanwhile; it copies what it returns of it."""
        with self.lock:
            slot, ticket = self.take(lambda data: None)
            found = terms(slot.data)
            self.give_back(slot, ticket)
        return found

    def _take_back(self) -> None:
        """Make free what was given back; under the lock."""
        while self._returned:
            try:  # the garbage collector may come in between and take the last one
                slot, ticket = self._returned.popleft()
            except IndexError:
                return
            if slot.ticket == ticket and slot in self._lent:
                slot.ticket = 0
                self._lent.remove(slot)
                self._free.append(slot)

    def renew_after_fork(self) -> None:
        """In a forked child: a new lock; what a thread of the parent was computing is not lent again."""
        self.lock = threading.RLock()
        self._lent = [slot for slot in self._lent if slot.ticket]
        self._returned = deque(self._returned)
