"""Chunks of about a second, and where they are evaluated: here, in spawned processes, or by any executor."""

from __future__ import annotations

import hashlib
import itertools
import multiprocessing
import pickle
import signal
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Generator, Iterator, Mapping
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, ThreadPoolExecutor, wait
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from typing import Any, NamedTuple

import numpy as np

from rbd.arrays import Array
from rbd.errors import InputError
from rbd.studies.provenance.identity import name_of
from rbd.studies.sampling.samples import Samples
from rbd.studies.workers.evaluation import BATCH, ONE_AT_A_TIME, Columns, Evaluation, Finished, recorded
from rbd.studies.workers.own_processes import (
    MOST,
    UNGUARDED,
    WITHOUT_GUARD,
    Workers,
    cause_of,
    cores,
    end_if_unguarded,
    pickled,
    sent_columns,
)

SECONDS = 1.0
"""What a chunk is to take: a thousand times what sending it costs, and little to lose."""
MOST_SAMPLES = 65_536
"""Samples of a chunk, at most."""
GROWTH = 4
"""A chunk has at most this many times the samples of the largest finished one: the first chunk of a process takes longer."""


class Chunks:
    """Parts of what is not done, in order.

    With a fixed size their boundaries are multiples of it. Else the size follows from the time that a sample takes, and
    becomes smaller near the end, so that all processes end together.

    Attributes:
        left: Number of samples that no chunk has yet.
        shares: Among how many chunks what is left is to be divided at least.
    """

    def __init__(self, done: Array, size: int | None, *, batched: bool, shares: int = 1) -> None:
        self.unit = BATCH if batched else 1
        self.fixed = None if size is None else -(-size // self.unit) * self.unit
        self._runs = _runs(np.asarray(done, bool), self.unit)
        self._run = next(self._runs, None)
        self.left = len(done) - int(np.count_nonzero(done))
        self.shares = shares
        self._pace = self._largest = 0.0

    def take(self) -> tuple[int, int] | None:
        """(start, stop) of the next chunk; None where nothing is left."""
        if self._run is None:
            return None
        start, end = self._run
        if self.fixed is not None:
            stop = min(end, (start // self.fixed + 1) * self.fixed)
        else:
            stop = min(end, start + self._size())
        self._run = (stop, end) if stop < end else next(self._runs, None)
        self.left = max(0, self.left - (stop - start))
        return start, stop

    def learn(self, samples: int, seconds: float) -> None:
        """What a finished chunk took."""
        pace = seconds / samples
        self._pace = pace if not self._pace else 0.5 * (self._pace + pace)
        self._largest = max(self._largest, samples)

    def _size(self) -> int:
        if not self._largest:
            return self.unit
        wanted = min(SECONDS / max(self._pace, 1e-9), GROWTH * self._largest, MOST_SAMPLES, self.left / (2 * self.shares))
        least = min(0.05 * SECONDS / max(self._pace, 1e-9), GROWTH * self._largest, MOST_SAMPLES)
        return max(1, round(max(wanted, least) / self.unit)) * self.unit


def _runs(done: Array, unit: int) -> Iterator[tuple[int, int]]:
    """(start, stop) of what is not done, rounded outwards to whole units."""
    n = len(done)
    if unit > 1 and n:
        done = np.logical_and.reduceat(done, np.arange(0, n, unit))
    edges = np.flatnonzero(np.diff(np.concatenate(([True], done, [True]))))
    for start, stop in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        yield start * unit, min(stop * unit, n)


TICK = 0.5
"""Seconds after which whoever waits for a chunk looks up, to draw the time."""
MOST_WAITING = 20_000
"""Chunks that are given to an executor and not finished, at most."""
MOST_LOST = 10
"""Chunks whose processes died of them, after which a study ends: then the function is wrong, not a sample."""
KEPT = 4
"""Evaluations that a process keeps."""


class Lost(NamedTuple):
    """A chunk that cannot be computed: its processes died of it."""

    start: int
    stop: int
    why: str

    @property
    def told(self) -> str:
        """Its samples in words."""
        return f"sample {self.start}" if self.stop == self.start + 1 else f"samples {self.start} to {self.stop - 1}"


class Stopped(NamedTuple):
    """The executor computes no more."""

    why: str
    cause: BaseException | None


@dataclass(frozen=True)
class NotLoaded:
    """What a process answers that has no evaluation: it wants the bytes, or cannot load them.

    Attributes:
        why: Why the bytes could not be loaded; empty where there were none.
    """

    why: str


def check(executor: Executor | int | None) -> None:
    """Refuse what is no executor, or takes no more work.

    Raises:
        InputError: it is neither None, nor a number of processes, nor an executor; or it is shut down, or broken.
    """
    if executor is None or (isinstance(executor, int) and not isinstance(executor, bool) and 0 <= executor <= MOST):
        if executor != 0:
            end_if_unguarded()
        return
    if isinstance(executor, int) and executor > MOST:
        raise InputError(
            f"executor is {executor}; expected at most {MOST:,} processes. For more, give the executor of a cluster."
        )
    wanted = "expected None (one process a core), a number of processes, 0 for this one, or an executor of concurrent.futures"
    if hasattr(executor, "get_executor"):
        raise InputError(f"executor is {executor!r:.80}; expected its executor: executor=client.get_executor().")
    if not isinstance(executor, Executor):
        raise InputError(f"executor is {executor!r:.80}; {wanted}.")
    try:
        executor.submit(_nothing)
    except Exception as error:  # executors of other packages raise errors of their own
        raise InputError(
            f"the executor takes no work: {error!s:.300}. Make a new one; executor=None starts processes for this call."
        ) from error


def sent_of(evaluation: Evaluation, executor: Executor | int | None) -> bytes:
    """The evaluation as bytes, of whatever goes to other processes; empty for this one.

    Raises:
        InputError: it cannot be pickled.
    """
    if executor == 0 or isinstance(executor, ThreadPoolExecutor):
        return b""
    keep = evaluation.keep if isinstance(evaluation.keep, Mapping) else {}
    kept = {f"keep[{name!r}]": function for name, function in keep.items()}
    return pickled(evaluation, {name_of(evaluation.function): evaluation.function, **kept})


def blocks(
    evaluation: Evaluation,
    samples: Samples,
    chunks: Chunks,
    executor: Executor | int | None,
    *,
    check: Callable[[], None],
) -> Generator[Finished | Lost | Stopped | None, None, None]:
    """The results of chunks, in the order in which they are finished; None every `TICK` while there is none.

    Args:
        evaluation: What is computed.
        samples: The samples; read as workers become free.
        chunks: Which of them.
        executor: None: spawned processes, one a core; n: that many, 0: in this process; or an executor, which stays open.
        check: Called after each call of the function in this process.
    """
    if executor == 0:
        with _one_thread():
            while (chunk := chunks.take()) is not None:
                done = evaluation.run(chunk[0], samples.columns(*chunk), check=check)
                chunks.learn(chunk[1] - chunk[0], done.seconds)
                yield done
        return
    own = executor if isinstance(executor, Executor) else Workers(executor)
    crew = _Crew(own, evaluation, sent_of(evaluation, executor), samples, chunks)
    try:
        yield from crew.results()
    finally:
        crew.end()
        if own is not executor:
            own.shutdown()


class _Way(NamedTuple):
    """A chunk on its way: what was submitted, when, and whether a process died while it was computed before."""

    start: int
    stop: int
    future: Future[Any]
    begun: float
    suspect: bool


class _Crew:
    """Chunks given to an executor, as many at a time as it needs to be busy.

    When one of our own processes dies, it is not known of which chunk: those that were computed are suspects, and each is
    computed again alone. The one of which the processes die again is divided into its samples, until that sample is found.
    """

    def __init__(self, executor: Executor, evaluation: Evaluation, sent: bytes, samples: Samples, chunks: Chunks) -> None:
        self.executor, self.evaluation, self.samples, self.chunks = executor, evaluation, samples, chunks
        self.sent, self.key = sent, hashlib.sha256(sent).hexdigest()
        self.own = executor if isinstance(executor, Workers) else None
        self.room = 3 * self.own.count if self.own else 2 * cores() + 1
        self.ways: dict[int, _Way] = {}
        self.numbers, self.ended = itertools.count(), SimpleQueue[tuple[int, float]]()
        self.suspects: list[tuple[int, int]] = []
        self.sending, self.lost = self.room, 0

    def results(self) -> Iterator[Finished | Lost | Stopped | None]:
        """As `blocks`."""
        while True:
            self.chunks.shares = self.room
            try:
                while len(self.ways) < self.room and self._submit_next():
                    self.sending -= 1
            except (RuntimeError, CancelledError) as error:  # BrokenExecutor is one; or it was shut down meanwhile
                yield Stopped(f"the executor takes no more work ({error!s:.200})", error)
                return
            if not self.ways:
                return
            try:
                number, at = self.ended.get(timeout=TICK)
            except Empty:
                yield None
                continue
            way = self.ways.pop(number, None)  # None of a suspect
            found = None if way is None else self._taken(way, at)
            if found is not None:
                yield found
            if isinstance(found, Stopped):
                return

    def end(self) -> None:
        """Nothing that is on its way is wanted any more."""
        for way in self.ways.values():
            way.future.cancel()
        if self.ways and self.own:
            self.own.renew()

    def _submit_next(self) -> bool:
        """Submit one more chunk, if there is one; a suspect alone."""
        if any(way.suspect for way in self.ways.values()) or (self.suspects and self.ways):
            return False
        if self.suspects:
            self._submit(*self.suspects.pop(0), with_bytes=True, suspect=True)
            return True
        if (chunk := self.chunks.take()) is None:
            return False
        self._submit(*chunk, with_bytes=self.sending > 0)
        return True

    def _submit(self, start: int, stop: int, *, with_bytes: bool, suspect: bool = False) -> None:
        columns, begun = self.samples.columns(start, stop), time.monotonic()
        if self.sent:
            call: tuple[Any, ...] = (_evaluate, self.key, self.sent if with_bytes else None, start, sent_columns(columns))
        else:
            call = (_evaluate_here, self.evaluation, start, columns)
        try:
            future = self.executor.submit(*call)
        except BrokenExecutor:
            if not self.own:
                raise
            if self.ways:  # their ends will say so
                self.suspects.append((start, stop))
                return
            self.own.renew()  # one died while it had nothing to do
            future = self.own.submit(*call)
        number = next(self.numbers)
        self.ways[number] = _Way(start, stop, future, begun, suspect)
        future.add_done_callback(lambda _: self.ended.put((number, time.monotonic())))

    def _taken(self, way: _Way, at: float) -> Finished | Lost | Stopped | None:
        """What became of a chunk; None if it is computed again."""
        try:
            found = way.future.result()
        except (BrokenExecutor, CancelledError) as error:
            if self.own and isinstance(error, BrokenExecutor):
                return self._after_death(self.own, way)
            return Stopped(f"the executor broke: {str(error) or 'what it computed was cancelled'}", error)
        except Exception as error:
            if type(error).__name__ == "KilledWorker":  # dask's: workers died of it, as often as dask allows
                return self._lost(way, "ended")
            raise
        if isinstance(found, NotLoaded):
            if found.why:
                raise InputError(found.why)
            self._submit(way.start, way.stop, with_bytes=True, suspect=way.suspect)
            return None
        assert isinstance(found, Finished)
        self.chunks.learn(way.stop - way.start, found.seconds)
        if not self.own and at - way.begun < 2.0 * found.seconds:  # it hardly waited: give more
            self.room = min(self.room + 1, MOST_WAITING)
        return found

    def _after_death(self, own: Workers, way: _Way) -> Lost | Stopped | None:
        """One of our processes died: what was under way is computed again, one after the other."""
        wait([each.future for each in self.ways.values()])
        others = {n: each for n, each in self.ways.items() if isinstance(each.future.exception(), BrokenExecutor)}
        self.ways = {n: each for n, each in self.ways.items() if n not in others}
        code = own.renew()
        if code == UNGUARDED:
            raise InputError(WITHOUT_GUARD) from None
        if way.suspect:
            return self._lost(way, cause_of(code))
        self.suspects += sorted((each.start, each.stop) for each in (way, *others.values()))
        return None

    def _lost(self, way: _Way, why: str) -> Lost | Stopped | None:
        """Processes died of a chunk: it is computed again, sample by sample, so that one sample loses no others."""
        unit = self.chunks.unit
        if way.stop - way.start > unit and not self.chunks.fixed:
            parts = [(start, min(start + unit, way.stop)) for start in range(way.start, way.stop, unit)]
            if self.own:
                self.suspects[:0] = parts
            else:
                for part in parts:
                    self._submit(*part, with_bytes=True)
            return None
        self.lost += 1
        lost = Lost(way.start, way.stop, why)
        if self.lost < MOST_LOST:
            return lost
        return Stopped(f"{MOST_LOST} chunks have ended their processes, the last of them {lost.told}: it {why}", None)


def _nothing() -> None:
    """Asks an executor whether it takes work."""


_loaded: OrderedDict[str, Evaluation] = OrderedDict()


def _evaluate(key: str, sent: bytes | None, start: int, columns: Columns | bytes) -> Finished | NotLoaded:
    """In another process: the results of a chunk. The evaluation is loaded once, so that its robots are built once."""
    with ONE_AT_A_TIME:
        evaluation = _loaded.get(key)
        if evaluation is None:
            if sent is None:
                return NotLoaded("")
            _ignore_interrupts()
            try:
                with recorded():  # what robots warn of, they did where they were loaded first
                    evaluation = pickle.loads(sent)
            except Exception as error:  # modules of the user are imported
                return _not_loaded("function", error)
            _loaded[key] = evaluation
            while len(_loaded) > KEPT:
                _loaded.popitem(last=False)
        if isinstance(columns, bytes):
            try:
                with recorded():
                    columns = pickle.loads(columns)
            except Exception as error:
                return _not_loaded("samples", error)
        assert not isinstance(columns, bytes)
    return _evaluate_here(evaluation, start, columns)


def _not_loaded(what: str, error: Exception) -> NotLoaded:
    return NotLoaded(
        f"the processes cannot load the {what}: {type(error).__name__}: {error!s:.300}. What is needed must be importable "
        "there: install the module, put its folder on PYTHONPATH, or for dask client.upload_file(...)."
    )


def _evaluate_here(evaluation: Evaluation, start: int, columns: Columns) -> Finished:
    with ONE_AT_A_TIME, _one_thread():
        return evaluation.run(start, columns)


def _ignore_interrupts() -> None:
    """In a process of somebody's pool: Ctrl-C is for the process that started it, which ends the study in order."""
    if multiprocessing.parent_process() is not None and threading.current_thread() is threading.main_thread():
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})


def _one_thread() -> AbstractContextManager[Any]:
    """One BLAS thread within, where threadpoolctl is installed; `Workers` have one by their environment."""
    try:
        from threadpoolctl import threadpool_limits
    except ImportError:
        return nullcontext()
    found: AbstractContextManager[Any] = threadpool_limits(1)
    return found
