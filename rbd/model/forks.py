"""Objects that a child process renews after `fork`: locks that a thread of the parent may have held then.

A fork copies the memory and only the thread that forks. A lock that another thread holds stays locked in the child.
"""

from __future__ import annotations

import os
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


def _renew() -> None:
    for owner in list(_known):
        owner.renew_after_fork()


if hasattr(os, "register_at_fork"):  # not on Windows, which has no fork
    os.register_at_fork(after_in_child=_renew)
