"""A progress bar for runs that take long, on a terminal only."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

PATIENCE = 1.0
"""A run that takes less [s] shows nothing."""
PACE = 0.1
"""Between two drawings of the bar [s]."""


@contextmanager
def progress_of(times: Sequence[float], *, shown: bool = True) -> Iterator[Callable[[float], None]]:
    """A function to call with each time that is reached; after a second it draws a bar on stderr.

    The bar appears only if stderr is a terminal, and is gone at the end, after Ctrl-C and errors too. No thread draws it. A
    call that draws nothing costs about 0.1 us.

    Args:
        times: From the first to the last [s].
        shown: False for no bar at all.
    """
    if not shown or len(times) < 2 or not _can_show():
        yield _nothing
        return
    bar = _Bar(float(times[0]), float(times[-1]))
    try:
        yield bar
    finally:
        bar.stop()


def _nothing(t: float) -> None:
    pass


def _can_show() -> bool:
    """Whether stderr is a terminal that can move its cursor. Notebooks and files are not."""
    try:
        return bool(sys.stderr is not None and sys.stderr.isatty()) and os.environ.get("TERM") != "dumb"
    except ValueError:  # closed
        return False


class _Bar:
    """The bar; it does not exist before its patience has ended."""

    def __init__(self, start: float, end: float) -> None:
        self._start, self._end = start, end
        self._began = time.perf_counter()
        self._next = self._began + PATIENCE
        self._progress: Any = None
        self._task: Any = None

    def __call__(self, t: float) -> None:
        """Draw, if it is time to."""
        now = time.perf_counter()
        if now < self._next:
            return
        if self._progress is None:
            self._open()
        done = t - self._start
        self._progress.update(self._task, completed=done, pace=done / (now - self._began))
        self._progress.refresh()
        self._next = time.perf_counter() + PACE

    def stop(self) -> None:
        """Take the bar away and give the cursor back."""
        if self._progress is not None:
            self._progress.stop()

    def _open(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

        self._progress = Progress(
            TextColumn("simulating"),
            BarColumn(),
            TextColumn("{task.completed:.3f} of {task.total:g} s, {task.fields[pace]:.3g} x real time, left"),
            TimeRemainingColumn(),
            console=Console(stderr=True),
            auto_refresh=False,
            transient=True,
        )
        self._task = self._progress.add_task("", total=self._end - self._start, pace=0.0)
        self._progress.start()
