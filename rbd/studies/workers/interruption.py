"""Ctrl-C during a study: held back while a block is stored, else at once; never lost in a function that swallows it."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


class Interruption:
    """Within it, Ctrl-C raises KeyboardInterrupt, but not in `held`; a second one does, everywhere.

    Handlers of the user's own, and those of other threads, stay as they are.

    Attributes:
        asked: How often Ctrl-C was pressed.
    """

    def __init__(self) -> None:
        self.asked = 0
        self._held = False
        self._ours = False

    def __enter__(self) -> Interruption:
        main = threading.current_thread() is threading.main_thread()
        if main and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            signal.signal(signal.SIGINT, self._handle)
            self._ours = True
        return self

    def __exit__(self, *args: object) -> None:
        if self._ours:
            signal.signal(signal.SIGINT, signal.default_int_handler)

    def _handle(self, number: int, frame: FrameType | None) -> None:
        self.asked += 1
        if self.asked > 1 or not self._held:
            raise KeyboardInterrupt

    def check(self) -> None:
        """Raise KeyboardInterrupt if Ctrl-C was pressed, for functions that end early by it, as `rbd.simulate` does."""
        if self.asked:
            raise KeyboardInterrupt

    @contextmanager
    def held(self) -> Iterator[None]:
        """A first Ctrl-C within waits for the end."""
        with self.counted():
            yield
        self.check()

    @contextmanager
    def counted(self) -> Iterator[None]:
        """A first Ctrl-C within raises nothing, also not at the end: `asked` tells of it."""
        self._held = True
        try:
            yield
        finally:
            self._held = False
