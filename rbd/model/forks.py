"""Objects that a child process renews after `fork`: locks that a thread of the parent may have held then.

A fork copies the memory and only the thread that forks. A lock that another thread holds stays locked in the child.
"""

from __future__ import annotations

import os
import threading
import weakref
from typing import Protocol


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
