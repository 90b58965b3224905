"""`Pacing`: a store is written once a second, every 5 s at least, and also where nothing follows for a long time."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from rbd.errors.stopped import StudyStopped
from rbd.model.forks import RenewedLock

OFTEN, SELDOM, SHARE = 1.0, 5.0, 20.0
"""The shortest and the longest time between two writings [s]; between them it is so many times as long as a writing takes."""


class Pacing:
    """When to write what was changed: once a second, less often where that takes long, from a thread where nothing follows.

    A process that is killed, or a machine without power, loses what was finished since the last writing: of a second, or of up
    to 5 s where a writing takes more than 0.05 s.

    Args:
        write: Writes all that is not yet written.
        told: The error of a store that cannot be written, from its reason.

    Attributes:
        guard: Held while a store is changed or written.
    """

    def __init__(self, write: Callable[[], None], told: Callable[[Exception], StudyStopped]) -> None:
        self.guard = RenewedLock()
        self._write, self._told = write, told
        self._last, self._pause = time.monotonic() - OFTEN, OFTEN
        self._timer: threading.Timer | None = None
        self._failed: StudyStopped | None = None
        self._changed = self._made = False

    def check(self) -> None:
        """Raise the error of an earlier writing.

        Raises:
            StudyStopped: the store could not be written.
        """
        if self._failed is not None:
            raise self._failed

    def changed(self, *, now: bool = False) -> None:
        """Something is to be written; it is, if the last writing was long enough ago, and else later.

        Args:
            now: Whether at once.
        """
        self._changed = True
        wait = self._last + self._pause - time.monotonic()
        if now or wait <= 0:
            self.write()
        elif self._timer is None:
            self._timer = threading.Timer(wait, self._later)
            self._timer.daemon = True
            self._timer.start()

    def write(self) -> None:
        """Write what is not yet written.

        Raises:
            StudyStopped: it cannot be.
        """
        self.check()
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if not self._changed:
            return
        began = time.monotonic()
        try:
            self._write()
        except (OSError, StudyStopped) as error:
            self._failed = self._told(error)
            raise self._failed from error
        self._changed = False
        self._last = time.monotonic()
        if self._made:  # the first writing makes the arrays, and says nothing about later ones
            self._pause = min(SELDOM, max(OFTEN, SHARE * (self._last - began)))
        self._made = True

    def stop(self) -> None:
        """Write nothing later."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _later(self) -> None:
        with self.guard:
            self._timer = None
            try:
                self.write()
            except StudyStopped:  # raised by the next call
                return


def why(error: BaseException) -> str:
    """What the system says about a failed writing."""
    cause = error if isinstance(error, OSError) else error.__cause__
    return getattr(cause, "strerror", None) or str(error) or type(error).__name__
