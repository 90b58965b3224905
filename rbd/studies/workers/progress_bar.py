"""The progress of a study on a terminal: samples done, failed, a second, and the time left."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from rbd.simulation.progress_bar import PACE, PATIENCE, bar_of, can_show


class Progress:
    """Counts of a study; drawn on stderr from a second on, if that is a terminal.

    Attributes:
        done: Samples done, with those of earlier calls.
        failed: How many of those done in this call have no result.
    """

    def __init__(self, total: int, done: int, *, drawn: bool) -> None:
        self.total, self.done, self.failed, self._drawn = total, done, 0, drawn
        self._before, self._began = done, time.perf_counter()
        self._next = self._began + PATIENCE
        self._bar: Any = None
        self._task: Any = None

    def add(self, samples: int, failed: int) -> None:
        """Some samples more are done."""
        self.done += samples
        self.failed += failed

    def draw(self) -> None:
        """Draw, if enough time has passed."""
        now = time.perf_counter()
        if not self._drawn or now < self._next:
            return
        if self._bar is None:
            self._open()
        self._bar.update(self._task, completed=self.done, told=self.told(now - self._began))
        self._bar.refresh()
        self._next = time.perf_counter() + PACE

    def told(self, seconds: float) -> str:
        """Counts, rate and time left in words.

        Args:
            seconds: Since this call began [s].
        """
        rate = (self.done - self._before) / seconds
        failed = f", {self.failed:,} without a result" if self.failed else ""
        if not rate:
            return f"{self.done:,} of {self.total:,}, starting"
        left = (self.total - self.done) / rate
        hours, rest = divmod(round(left), 3600)
        return (
            f"{self.done:,} of {self.total:,}{failed}, {rate:.3g} a second, "
            f"left {f'{hours}:' if hours else ''}{rest // 60:02d}:{rest % 60:02d}"
        )

    def stop(self) -> None:
        """Remove the bar and restore the cursor."""
        if self._bar is not None:
            self._bar.stop()

    def _open(self) -> None:
        from rich.progress import TextColumn

        self._bar = bar_of(TextColumn("{task.fields[told]}", markup=False))
        self._task = self._bar.add_task("studying", total=self.total, told="")
        self._bar.start()


@contextmanager
def counted(total: int, done: int, *, shown: bool) -> Iterator[Progress]:
    """The counts of a study, with a bar on a terminal, which is removed at the end, after Ctrl-C and errors too.

    Args:
        total: Number of samples.
        done: How many are done already.
        shown: False for no bar at all.
    """
    progress = Progress(total, done, drawn=shown and can_show())
    try:
        yield progress
    finally:
        progress.stop()
