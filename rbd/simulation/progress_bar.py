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
    start, total, began = float(times[0]), float(times[-1]) - float(times[0]), time.perf_counter()
    due, bar, task = began + PATIENCE, None, None

    def reached(t: float) -> None:
        nonlocal due, bar, task
        now = time.perf_counter()
        if now < due:
            return
        if bar is None:
            bar, task = _opened(doing, total)
        bar.update(task, completed=t - start, pace=(t - start) / (now - began))
        bar.refresh()
        due = time.perf_counter() + PACE

    try:
        yield reached
    finally:  # the cursor is restored too
        if bar is not None:
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

    return Progress(
        TextColumn("{task.description}", markup=False), BarColumn(), *columns, console=Console(stderr=True), auto_refresh=False,
        transient=True,
    )  # fmt: skip


def _opened(doing: str, total: float) -> tuple[Any, Any]:
    """(the bar, its task), drawn for the first time."""
    from rich.progress import TextColumn, TimeRemainingColumn

    pace = "{task.completed:.3f} of {task.total:g} s, {task.fields[pace]:.3g} x real time, left"
    bar = bar_of(TextColumn(pace if doing == "simulating" else "{task.percentage:.0f} %, left"), TimeRemainingColumn())
    task = bar.add_task(doing, total=total, pace=0.0)
    bar.start()
    return bar, task
