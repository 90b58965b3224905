"""`Workers`: spawned processes for studies, replaced when one of them dies; what is sent to them, as bytes."""

from __future__ import annotations

import hashlib
import io
import multiprocessing
import multiprocessing.connection
import os
import pickle
import signal
import sys
import threading
import time
from collections import ChainMap
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from typing import Any, TypeVar

import numpy as np

from rbd.errors import InputError
from rbd.model.data_pool import RenewedLock
from rbd.modules import cloudpickle_or_error
from rbd.studies.provenance.identity import NoContent, add

T = TypeVar("T")
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
MARK = "RBD_STUDY_WORKER"
"""Set in the environment of the processes, so that a script that starts its study there again is noticed."""
UNGUARDED = 79
"""Exit code of such a process."""
MOST = 1024
"""Processes, at most; more are a cluster's."""
_STARTING = RenewedLock()


class Workers(Executor):
    """Processes that stay open for several studies: an executor, to be used in a `with` statement.

    Each is a new Python process with one BLAS thread that ignores Ctrl-C and ends with the one that started it. They start
    with the first study. Where one dies, of a signal or for want of memory, all are
    replaced, and what they computed is computed again.

    Attributes:
        count: Number of processes.

    Example:
        >>> def square(x):
        ...     return x * x
        >>> with rbd.studies.Workers(1) as workers:
        ...     for last in (4.0, 9.0):
        ...         found = rbd.study(square, rbd.grid(x=[1.0, last]), executor=workers, progress=False)
        ...         print(found.value.values)
        [ 1. 16.]
        [ 1. 81.]
    """

    def __init__(self, count: int | None = None) -> None:
        """Processes, as many as there are cores, or `count`.

        Raises:
            InputError: no whole number from 1 to `MOST`.
        """
        if count is not None and (isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= MOST):
            raise InputError(f"count is {count!r:.80}; expected a number of processes from 1 to {MOST}, or None: one a core.")
        self.count = count or cores()
        self._pool: ProcessPoolExecutor | None = None
        self._processes: list[Any] = []
        self._closed = False

    def __repr__(self) -> str:
        return f"Workers({self.count}{', closed' if self._closed else ''})"

    def submit(self, fn: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        """A future of `fn(*args, **kwargs)`, as of every executor.

        Raises:
            RuntimeError: they are shut down; BrokenProcessPool, one of them died, until `renew`.
        """
        if self._closed:
            raise RuntimeError("cannot schedule new futures after shutdown")
        with _child_environment():
            if self._pool is None:
                spawn = multiprocessing.get_context("spawn")
                self._pool = ProcessPoolExecutor(self.count, mp_context=spawn, initializer=_begin)
            future = self._pool.submit(fn, *args, **kwargs)
        self._processes = list((self._pool._processes or {}).values()) or self._processes
        return future

    def renew(self) -> int | None:
        """End all processes at once; others take their places when something is submitted.

        Returns:
            The exit code of one that had died before; None where none had, or it is unknown.
        """
        end = time.monotonic() + 1.0
        while time.monotonic() < end and any(p.exitcode is None for p in self._processes) and self._pool_is_broken():
            time.sleep(0.01)  # the pool is ending the others
        codes = [p.exitcode for p in self._processes if p.exitcode not in (None, 0)]
        for process in self._processes:
            process.kill()
        pool, self._pool, self._processes = self._pool, None, []
        if pool is not None:
            pool.shutdown(wait=True, cancel_futures=True)
        return next(
            (code for code in codes if code != -signal.SIGTERM), codes[0] if codes else None
        )  # it ends others by SIGTERM

    def _pool_is_broken(self) -> bool:
        return self._pool is not None and bool(self._pool._broken)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes, after what was submitted; as of every executor."""
        self._closed = True
        if self._pool is not None:
            self._pool.shutdown(wait=wait, cancel_futures=cancel_futures)


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def end_if_unguarded() -> None:
    """In a process of `Workers` that is still importing its script: end it, so that the first process can say why.

    Raises:
        InputError: the same in a process of another pool.
    """
    if not getattr(multiprocessing.current_process(), "_inheriting", False):
        return
    if os.environ.get(MARK):
        os._exit(UNGUARDED)
    raise InputError(WITHOUT_GUARD)


WITHOUT_GUARD = (
    "the study is started again in each of its own processes, as they import the script. Put the calls of the script below "
    'the line\n\n    if __name__ == "__main__":\n\nso that only the first process runs them; functions and robots stay above '
    "it. executor=0 computes in this process."
)


def cause_of(code: int | None) -> str:
    """Why a process died, in words."""
    if code == UNGUARDED:
        return WITHOUT_GUARD
    if code == -signal.SIGKILL:
        return "was ended by signal 9 (SIGKILL), as the system does where memory runs out"
    if code is not None and code < 0:
        return f"was ended by signal {-code} ({signal.Signals(-code).name})"
    return "ended without a word" if code is None else f"ended with exit code {code}; what it printed says more"


@contextmanager
def _child_environment() -> Iterator[None]:
    """What a process inherits that is started within: one BLAS thread, and SIGINT blocked, as Ctrl-C is for its parent.

    It shows no warnings as it imports the script: its parent did. Those of the function are recorded, whatever the filters.
    """
    with _STARTING:
        before = {name: os.environ.get(name) for name in (*ONE_THREAD, MARK)}
        blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        os.environ.update(ONE_THREAD | {MARK: "1"})
        options, sys.warnoptions = sys.warnoptions, [*sys.warnoptions, "ignore"]
        try:
            yield
        finally:
            sys.warnoptions = options
            for name, value in before.items():
                if value is None:
                    os.environ.pop(name, None)
                else:
                    os.environ[name] = value
            signal.pthread_sigmask(signal.SIG_SETMASK, blocked)


def _begin() -> None:
    """First in a process: end with the parent, even if that is killed."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


def _end_with(sentinel: int) -> None:
    multiprocessing.connection.wait([sentinel])
    os._exit(1)


def pickled(value: Any, parts: Mapping[str, Any]) -> bytes:
    """A value as bytes, by cloudpickle: functions of `__main__` and inner ones by value, those of modules by name.

    Args:
        value: What is sent.
        parts: What of it is looked through where it cannot be: {name for messages: part}.

    Raises:
        InputError: it cannot be pickled; names the value that cannot, and what to do.
    """
    cloudpickle = cloudpickle_or_error()
    # cloudpickle alone sends a file that is open for reading as its text, which is another value than the file
    table = ChainMap({io.TextIOWrapper: _of_file}, cloudpickle.Pickler.dispatch_table)
    pickler = type("Pickler", (cloudpickle.Pickler,), {"dispatch_table": table})
    try:
        with io.BytesIO() as file:
            pickler(file).dump(value)
            return file.getvalue()
    except Exception as error:  # pickling calls code of the user's classes
        where = next(filter(None, (_without_content(part, name) for name, part in parts.items())), "")
        told = f"{where}, which only this process has; " if where else ""
        raise InputError(
            f"{next(iter(parts))} cannot be sent to other processes: {told}{type(error).__name__}: {error!s:.200}. Create what "
            "cannot inside the function, or give what it is made of, such as a path; executor=0 computes in this process."
        ) from error


def sent_columns(columns: Mapping[str, Any]) -> Mapping[str, Any] | bytes:
    """The samples of a chunk as they go to another process: with objects among them as bytes, as functions do.

    Args:
        columns: {argument: values}: an array, or a list of texts and objects.

    Raises:
        InputError: an object that cannot be pickled; names it.
    """
    if all(isinstance(values, np.ndarray) or all(type(x) is str for x in values) for values in columns.values()):
        return columns
    return pickled(dict(columns), {f"samples: {name}": values for name, values in columns.items()})


def _without_content(value: Any, name: str) -> str:
    """The way to the first object that has no content, and its type; empty if there is none."""
    try:
        add(hashlib.sha256(), value, name)
    except NoContent as error:
        return error.what
    return ""


def _of_file(file: io.TextIOWrapper) -> tuple[Any, ...]:
    """How a text file is pickled: not at all, but for those by which every process writes.

    Raises:
        pickle.PicklingError: it is another one.
    """
    for name in ("stdout", "stderr"):
        if file is getattr(sys, name):
            return getattr, (sys, name)
    raise pickle.PicklingError(f"cannot pickle the open file {getattr(file, 'name', '')!r:.100}")
