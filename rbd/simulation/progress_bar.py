"""The progress bar of simulations and other long work, on stderr: drawn after a second, removed at the end."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

PATIENCE = 1.0
"""A run that takes less [s] shows no progress bar."""
PACE = 0.1
"""Between two drawings of it [s]."""


@contextmanager
def progress_of(times: Sequence[float], *, shown: bool = True, doing: str = "simulating") -> Iterator[Callable[[float], None]]:
    """A function to call with each time reached; after a second it draws a bar on stderr.

    The bar appears only if stderr is a terminal, and is removed at the end, after Ctrl-C and errors too. No thread draws it. A
    call without drawing costs about 0.1 us.

    Args:
        times: From the first to the last [s].
        shown: False for no bar at all.
        doing: What takes so long; the pace of other work than a simulation is not told.
    """
    if not shown or len(times) < 2 or not can_show():
        yield _nothing
        return
    bar = _Bar(float(times[0]), float(times[-1]), doing)
    try:
        yield bar
    finally:
        bar.stop()


def _nothing(t: float) -> None:
    pass


def can_show() -> bool:
    """Whether stderr is a terminal that can move its cursor. Notebooks and files are not."""
    try:
        return bool(sys.stderr is not None and sys.stderr.isatty()) and os.environ.get("TERM") != "dumb"
    except ValueError:  # closed
        return False


def bar_of(*columns: Any) -> Any:
    """A bar of `rich` on stderr that is drawn when asked, and removed at the end.

    Args:
        columns: Its columns after what is done and the bar itself.
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    first = (TextColumn("{task.description}", markup=False), BarColumn())
    return Progress(*first, *columns, console=Console(stderr=True), auto_refresh=False, transient=True)


class _Bar:
    """The progress bar, created only after a delay."""

    def __init__(self, start: float, end: float, doing: str) -> None:
        self._start, self._end, self._doing = start, end, doing
        self._began = time.perf_counter()
        self._next = self._began + PATIENCE
        self._progress: Any = None
        self._task: Any = None

    def __call__(self, t: float) -> None:
        """Draw, if enough time has passed."""
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
        """Remove the bar and restore the cursor."""
        if self._progress is not None:
            self._progress.stop()

    def _open(self) -> None:
        from rich.progress import TextColumn, TimeRemainingColumn

        pace = "{task.completed:.3f} of {task.total:g} s, {task.fields[pace]:.3g} x real time, left"
        text = TextColumn(pace if self._doing == "simulating" else "{task.percentage:.0f} %, left")
        self._progress = bar_of(text, TimeRemainingColumn())
        self._task = self._progress.add_task(self._doing, total=self._end - self._start, pace=0.0)
        self._progress.start()
