"""What a child process made by `fork` must renew: locks that a thread of the parent may have held at that moment.

A fork copies the memory and only the thread that forks. A lock that another thread holds stays locked in the child.
"""

from __future__ import annotations

import os
import weakref
from typing import Protocol


class Forked(Protocol):
    """Something with a lock, or with a thread or a file of its own."""

    def renew_after_fork(self) -> None:
        """Called in the child, before anything else runs there: make new locks, forget what other threads left half done."""


_known: weakref.WeakSet[Forked] = weakref.WeakSet()


def renewed_after_fork(owner: Forked) -> None:
    """Have `owner.renew_after_fork()` called in every child that is forked while the owner exists."""
    _known.add(owner)


def _renew() -> None:
    for owner in list(_known):
        owner.renew_after_fork()


if hasattr(os, "register_at_fork"):  # not on Windows, where nothing forks
    os.register_at_fork(after_in_child=_renew)
