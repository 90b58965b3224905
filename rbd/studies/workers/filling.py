"""`fill`: evaluates what a store lacks and puts each finished block into it, with progress, until done or interrupted."""

from __future__ import annotations

import signal
import threading
import time
import warnings
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from contextlib import closing, contextmanager, nullcontext
from dataclasses import dataclass, field
from types import FrameType
from typing import Any

import numpy as np

from rbd.errors import InputError
from rbd.errors.warned import StudyWarning, stacklevel_of_user
from rbd.simulation.progress_bar import PACE, PATIENCE, bar_of, can_show
from rbd.studies.sampling.samples import Samples
from rbd.studies.stores import Store
from rbd.studies.workers import executors
from rbd.studies.workers.evaluation import Evaluation, Finished, Told
from rbd.studies.workers.executors import Chunks, Lost, Stopped
from rbd.studies.workers.own_processes import sent_columns


@dataclass(frozen=True, eq=False)
class Filled:
    """How the filling of a store ended.

    Attributes:
        total: Number of all samples.
        done: How many of them are done.
        interrupted: "Ctrl-C after 340 of 1,000 samples"; empty where it was not interrupted.
        stopped: Why it ended before all samples were done; empty where it did not, or was interrupted.
        cause: The error that ended it, if there is one.
        told: The warnings of the function.
    """

    total: int
    done: int
    interrupted: str = ""
    stopped: str = ""
    cause: BaseException | None = None
    told: Told = field(default_factory=Told)

    def warn(self) -> None:
        """Issue the function's warnings, one of each kind, and one of an interruption."""
        self.told.warn(self.total)
        if self.interrupted:
            left = "the others have the reason not_run" if self.done < self.total else "none is missing"
            warnings.warn(f"{self.interrupted}; {left}.", StudyWarning, stacklevel=stacklevel_of_user())


def check_all(
    evaluation: Evaluation, executor: Executor | int | None, chunk: int | None, samples: Samples | None = None
) -> None:
    """Refuse before work starts what could not be done: chunks, executors, functions and samples that cannot be sent.

    Raises:
        InputError: names it, and what to try.
    """
    if chunk is not None and (isinstance(chunk, bool) or not isinstance(chunk, int | np.integer) or chunk < 1):
        raise InputError(f"chunk is {chunk!r:.80}; expected a whole number of samples from 1, or None: about a second each.")
    if not callable(evaluation.function):
        raise InputError(f"function is {evaluation.function!r:.80}; expected one that is called with the values of a sample.")
    executors.check(executor)
    if executors.sent_of(evaluation, executor) and samples is not None:
        sent_columns({each.name: list(each.choices) for each in samples.given if each.dim and each.choices is not None})


def fill(
    store: Store,
    evaluation: Evaluation,
    samples: Samples,
    *,
    executor: Executor | int | None = None,
    chunk: int | None = None,
    progress: bool = True,
    interruption: Interruption | None = None,
) -> Filled:
    """Evaluate what the store lacks, and put it there; Ctrl-C ends it in order, a second one at once.

    Args:
        store: Filled.
        evaluation: What is computed.
        samples: The samples, in the store's numbering.
        executor: None: spawned processes, one a core; n: that many, 0: in this process; or an executor, which stays open.
        chunk: Samples that are sent at a time; None: about a second's.
        progress: Whether a bar is drawn, where stderr is a terminal.
        interruption: That within which the caller is; None: one of its own.

    Returns:
        How it ended. Chunks that were under way when it ended are lost.

    Raises:
        InputError: as `check_all`; results that cannot be kept.
        OSError: the store cannot be written.
    """
    check_all(evaluation, executor, chunk, samples)
    done = np.asarray(store.done, bool)
    chunks = Chunks(done, chunk, batched=evaluation.batched)
    told, lost, ended = Told(), list[Lost](), list[Stopped]()
    interrupted = False
    within = Interruption() if interruption is None else nullcontext(interruption)
    with counted(len(samples), int(np.count_nonzero(done)), shown=progress) as counts, within as interruption:
        try:
            with closing(executors.blocks(evaluation, samples, chunks, executor, check=interruption.check)) as found:
                for each in found:
                    if isinstance(each, Finished):
                        with interruption.held():
                            _put(store, each, told, counts)
                    elif isinstance(each, Lost):
                        lost.append(each)
                    elif isinstance(each, Stopped):
                        ended.append(each)
                    counts.draw()
        except KeyboardInterrupt:
            if interruption.asked > 1:
                raise
            interrupted = True
    total = len(samples)
    so_far = f"{counts.done:,} of {total:,} samples"
    if interrupted:
        return Filled(total, counts.done, interrupted=f"Ctrl-C after {so_far}", told=told)
    if ended:
        return Filled(total, counts.done, "", f"{ended[0].why}; {so_far} are done.", ended[0].cause, told)
    return Filled(total, counts.done, stopped=_of_lost(lost, so_far, chunks.unit), told=told)


def _put(store: Store, finished: Finished, told: Told, counts: Progress) -> None:
    block = finished.block
    new = np.logical_not(store.done[block.numbers])  # of a batched function, whole batches are computed again
    store.put(block)
    told.join(finished.told)
    counts.add(int(np.count_nonzero(new)), int(np.count_nonzero(new & ~np.asarray(block.ok))))


def _of_lost(lost: Sequence[Lost], so_far: str, unit: int) -> str:
    if not lost:
        return ""
    places = [x.told for x in lost[:5]] + ([f"one of {len(lost) - 5} chunks more"] if len(lost) > 5 else [])
    told = " or ".join(filter(None, (", ".join(places[:-1]), places[-1])))
    which = "" if all(x.stop - x.start <= unit for x in lost) else "chunk=1 says which sample it is. "
    return (
        f"each process that computed {told} {lost[0].why}. All others are done, {so_far}. {which}Call "
        "the function with it in a process of its own to see why."
    )


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
