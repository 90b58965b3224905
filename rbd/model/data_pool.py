"""A few `pin.Data` of a robot, lent to its states: creating one costs about ten times all dynamics terms."""

from __future__ import annotations

import itertools
import threading
from collections import deque
from collections.abc import Callable

import pinocchio as pin

from rbd.model.forks import renewed_after_fork

_tickets = itertools.count(1)


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
