"""Where chunks of about a second are evaluated: here, in spawned processes of which some may die, or by any executor."""

from __future__ import annotations

import multiprocessing
import multiprocessing.connection
import pickle
import signal
import threading
import time
import warnings
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import CancelledError, Executor, Future, ThreadPoolExecutor
from functools import lru_cache
from queue import Empty, SimpleQueue
from typing import Any, NamedTuple, TypeVar

import numpy as np

from rbd.arrays import Array
from rbd.errors import InputError, StudyStopped
from rbd.installation import cores
from rbd.model.content_hash import NoContent, digest, name_of
from rbd.modules import of_extra
from rbd.studies.evaluation import BATCH, ONE_AT_A_TIME, Columns, Evaluation, Finished, WarningCounts
from rbd.studies.results import KeptRows, words_of
from rbd.studies.samples import Samples
from rbd.workers import MOST, UNGUARDED, ProcessDied, Workers, check_guard, without_guard

T = TypeVar("T")
STUDY = "the study; executor=0"
"""What is started again by a script without a guard; and how it computes in this process."""
SECONDS = 1.0
"""What a chunk is to take: a thousand times what sending it costs, and little to lose."""
MOST_SAMPLES = 65_536
"""Samples of a chunk, at most."""
GROWTH = 4
"""A chunk has at most this many times the samples of the largest finished one: the first chunk of a process takes longer."""
TICK = 0.5
"""Seconds after which whoever waits for a chunk looks up, to draw the time."""
MOST_WAITING = 20_000
"""Chunks that are given to an executor and not finished, at most."""
MOST_LOST = 10
"""Chunks whose processes died of them, after which a study ends: then the function is wrong, not a sample."""


class Here(Executor):
    """This process, as an executor: what is submitted is done at once.

    Args:
        check: Called after each call of the function.
    """

    def __init__(self, check: Callable[[], None]) -> None:
        self.check = check

    def submit(self, fn: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        """A future that is done."""
        done = Future[T]()
        done.set_result(fn(*args, **kwargs, check=self.check))
        return done


def pickled(value: Any, parts: Mapping[str, Any], *, looked_through: bool = False) -> bytes:
    """A value as bytes, by cloudpickle: functions of `__main__` and inner ones by value, those of modules by name.

    Args:
        value: What is sent.
        parts: What of it is looked through where it cannot be: {name for messages: part}.
        looked_through: Whether it is in any case: cloudpickle alone sends an open file as its text.

    Raises:
        InputError: it cannot be pickled, or has no content, as an open file; names the value, and what to do.
    """
    cloudpickle = of_extra("cloudpickle", "study")
    try:
        sent: bytes = cloudpickle.dumps(value)
        what = ""
    except Exception as error:  # pickling calls code of the user's classes
        what = f"{type(error).__name__}: {error!s:.200}"
    if what or looked_through:
        try:
            for name, part in parts.items():
                digest(part, name)
        except NoContent as error:
            what = f"{error.what}, which only this process has; {error.cause}"
    if what:
        raise InputError(
            f"{next(iter(parts))} cannot be sent to other processes: {what}. Create what cannot inside the function, or give "
            "what it is made of, such as a path; executor=0 computes in this process."
        )
    return sent


def sent_of(evaluation: Evaluation, executor: Executor | int | None) -> bytes:
    """The evaluation as bytes, of whatever goes to other processes; empty for this one.

    Raises:
        InputError: it cannot be pickled.
    """
    if executor == 0 or isinstance(executor, Here | ThreadPoolExecutor):
        return b""
    kept = {f"keep[{name!r}]": function for name, function in evaluation.keep.functions.items()}
    parts = {name_of(evaluation.function).rpartition(".")[2]: evaluation.function, **kept}
    return pickled(evaluation, parts, looked_through=True)


def sent_columns(columns: Mapping[str, Any]) -> Mapping[str, Any] | bytes:
    """The samples of a chunk as they go to another process: with objects among them as bytes, as functions do.

    Args:
        columns: {argument: values}: an array, or a list of texts and objects.

    Raises:
        InputError: an object that cannot be pickled; names it.
    """
    if all(isinstance(values, np.ndarray) or all(type(x) is str for x in values) for values in columns.values()):
        return columns
    return pickled(dict(columns), {f"samples: {name}": x for name, x in columns.items() if not isinstance(x, np.ndarray)})


def check_executor(executor: Executor | int | None) -> None:
    """Refuse what is no executor, or takes no more work.

    Raises:
        InputError: it is neither None, nor a number of processes, nor an executor; or it is shut down, or broken.
    """
    if executor is None or (isinstance(executor, int) and not isinstance(executor, bool) and 0 <= executor <= MOST):
        if executor != 0:
            check_guard(STUDY)
        return
    wanted = "None (one process a core), a number of processes, 0 for this one, or an executor of concurrent.futures"
    if isinstance(executor, int) and executor > MOST:
        wanted = f"at most {MOST:,} processes. For more, give the executor of a cluster"
    if hasattr(executor, "get_executor"):
        wanted = "its executor: executor=client.get_executor()"
    if not isinstance(executor, Executor):
        raise InputError(f"executor is {executor!r:.80}; expected {wanted}.")
    try:
        executor.submit(cores)
    except Exception as error:  # executors of other packages raise errors of their own
        raise InputError(
            f"the executor takes no work: {error!s:.300}. Make a new one; executor=None starts processes for this call."
        ) from error


class Chunks:
    """Parts of what is not done, in order.

    With a fixed size their boundaries are multiples of it. Else the size follows from the time that a sample takes, and
    becomes smaller near the end, so that all processes end together.

    Attributes:
        unit: Samples that belong together: a batch, or one.
        left: Number of samples that no chunk has yet.
        shares: Among how many chunks what is left is to be divided at least.
    """

    def __init__(self, done: Array, size: int | None, *, batched: bool, shares: int = 1) -> None:
        self.unit, self.shares, self.left = (BATCH if batched else 1), shares, int(np.count_nonzero(~done))
        self.fixed = None if size is None else -(-size // self.unit) * self.unit
        whole = np.logical_and.reduceat(done, np.arange(0, len(done), self.unit)) if len(done) else done
        edges = np.flatnonzero(np.diff(np.concatenate(([True], whole, [True])))) * self.unit
        self._runs = deque(zip(edges[::2].tolist(), np.minimum(edges[1::2], len(done)).tolist(), strict=True))
        self._pace = self._largest = 0.0

    def take(self) -> tuple[int, int] | None:
        """(start, stop) of the next chunk; None where nothing is left."""
        if not self._runs:
            return None
        start, end = self._runs.popleft()
        stop = min(end, start + self._size() if self.fixed is None else (start // self.fixed + 1) * self.fixed)
        if stop < end:
            self._runs.appendleft((stop, end))
        self.left = max(0, self.left - (stop - start))
        return start, stop

    def learn(self, samples: int, seconds: float) -> None:
        """What a finished chunk took."""
        self._pace = max(0.5 * (self._pace + seconds / samples) if self._pace else seconds / samples, 1e-9)
        self._largest = max(self._largest, samples)

    def _size(self) -> int:
        if not self._largest:
            return self.unit
        wanted = max(0.05 * SECONDS / self._pace, min(SECONDS / self._pace, self.left / (2 * self.shares)))
        return max(1, round(min(wanted, GROWTH * self._largest, MOST_SAMPLES) / self.unit)) * self.unit


class _Way(NamedTuple):
    """A chunk on its way: when it was submitted, and whether a process died of it before."""

    start: int
    stop: int
    suspect: bool = False
    begun: float = 0.0


class Crew:
    """Chunks given to an executor, as many at a time as it needs to be busy.

    A chunk of which a process dies is computed once more; then it is divided into its samples, so that one sample loses no
    others; a sample of which two processes die is lost.

    Args:
        executor: Where they are computed; it stays open.
        evaluation: What is computed.
        samples: The samples; read as workers become free.
        chunks: Which of them.

    Raises:
        InputError: the evaluation cannot be sent.
    """

    def __init__(self, executor: Executor, evaluation: Evaluation, samples: Samples, chunks: Chunks) -> None:
        self.executor, self.evaluation, self.samples, self.chunks = executor, evaluation, samples, chunks
        self.sent = sent_of(evaluation, executor)
        self.own = executor if isinstance(executor, Workers) else None
        self.room = 1 if isinstance(executor, Here) else 3 * self.own.count if self.own else 2 * cores() + 1
        self.lost = 0
        self.ways: dict[Future[Any], _Way] = {}
        self.ended = SimpleQueue[tuple[Future[Any], float]]()
        self.again = deque[_Way]()

    def results(self) -> Iterator[Finished | None]:
        """Results of chunks, in the order in which they are finished; None every `TICK` while there is none.

        Raises:
            StudyStopped: the executor computes no more, or `MOST_LOST` samples have ended their processes.
        """
        while True:
            self.chunks.shares = self.room
            try:
                while len(self.ways) < self.room and (way := self._next()) is not None:
                    self._submit(way)
                if not self.ways:
                    return
                future, at = self.ended.get(timeout=TICK)
                yield self._taken(self.ways.pop(future), future, at)
            except Empty:
                yield None
            except (RuntimeError, CancelledError) as error:  # BrokenExecutor is one; or it was shut down meanwhile
                raise StudyStopped(
                    f"the executor computes no more, as it broke or was shut down ({str(error) or type(error).__name__:.200}). "
                    "What is done is kept."
                ) from error

    def end(self) -> None:
        """Nothing that is on its way is wanted any more."""
        for future in self.ways:
            future.cancel()
        if self.ways and self.own:
            self.own.kill()

    def _next(self) -> _Way | None:
        if self.again:
            return self.again.popleft()
        chunk = self.chunks.take()
        return None if chunk is None else _Way(*chunk)

    def _submit(self, way: _Way) -> None:
        columns = self.samples.columns(way.start, way.stop)
        if self.sent:
            future = self.executor.submit(_evaluate, self.sent, way.start, sent_columns(columns))
        else:
            future = self.executor.submit(self.evaluation.run, way.start, columns)
        self.ways[future] = way._replace(begun=time.monotonic())
        future.add_done_callback(lambda each: self.ended.put((each, time.monotonic())))

    def _taken(self, way: _Way, future: Future[Finished], at: float) -> Finished | None:
        """What became of a chunk; None if it is computed again."""
        error = future.exception()
        if isinstance(error, ProcessDied) and error.code == UNGUARDED:
            raise InputError(without_guard(STUDY))
        if isinstance(error, ProcessDied) and not way.suspect:
            self.again.append(way._replace(suspect=True))
            return None
        if isinstance(error, ProcessDied) or type(error).__name__ == "KilledWorker":  # dask's, after some tries of its own
            return self._lost(way, error)
        found = future.result()
        self.chunks.learn(way.stop - way.start, found.seconds)
        if self.room > 1 and not self.own and at - way.begun < 2.0 * found.seconds:  # it hardly waited: give more
            self.room = min(self.room + 1, MOST_WAITING)
        return found

    def _lost(self, way: _Way, error: BaseException | None) -> Finished | None:
        """Processes died of a chunk, twice: of one sample its row says so, of several each is computed alone."""
        if way.stop - way.start > self.chunks.unit:
            parts = range(way.start, way.stop, self.chunks.unit)
            self.again.extend(_Way(k, min(k + self.chunks.unit, way.stop), suspect=True) for k in parts)
            return None
        self.lost += 1
        if self.lost == MOST_LOST:
            raise StudyStopped(
                f"{MOST_LOST} samples, or batches, have ended their processes, the last of them "
                f"{words_of(way.start, way.stop)}: each process that computed it {error}."
            )
        rows = KeptRows(way.stop - way.start, self.evaluation.keep, first=way.start)
        for i in range(rows.n):
            rows.refuse(i, error or ProcessDied(None), "; so did that of a second try")
        return Finished(rows.block(), 0.0, WarningCounts())


@lru_cache(maxsize=4)
def _loaded(sent: bytes) -> Evaluation:
    """An evaluation from its bytes, in another process: once, so that its robots are built once."""
    if multiprocessing.parent_process() is not None and threading.current_thread() is threading.main_thread():
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # Ctrl-C is for the process that started it
    return pickle.loads(sent)


def _evaluate(sent: bytes, start: int, columns: Columns | bytes) -> Finished:
    """In another process: the results of a chunk."""
    what = "function"
    try:
        with ONE_AT_A_TIME, warnings.catch_warnings(action="ignore"):  # robots warned where they were loaded first
            evaluation = _loaded(sent)
            what = "samples"
            loaded: Columns = pickle.loads(columns) if isinstance(columns, bytes) else columns
    except Exception as error:  # modules of the user are imported
        raise InputError(
            f"the processes cannot load the {what}: {type(error).__name__}: {error!s:.300}. What is needed must be importable "
            "there: install the module, put its folder on PYTHONPATH, or for dask client.upload_file(...)."
        ) from None
    return evaluation.run(start, loaded)
