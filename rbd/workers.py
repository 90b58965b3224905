"""`Workers`: processes that compute what is submitted, of which some may die; scripts that would start them; BLAS threads."""

from __future__ import annotations

import multiprocessing
import multiprocessing.connection
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache
from typing import Any, TypeVar

from rbd.arrays import check_whole
from rbd.errors import InputError
from rbd.installation import cores
from rbd.model.data_pool import RenewedLock

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
    with the first study. One that dies, of a signal or for want of memory, is replaced, and what it computed is computed again.

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
        self.count = cores() if count is None else check_whole("count", count, MOST)
        self._threads = ThreadPoolExecutor(self.count)  # each waits for a process of its own, so that it is known who died
        self._own, self._pools = threading.local(), list[ProcessPoolExecutor]()

    def submit(self, fn: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        """A future of `fn(*args, **kwargs)`, as of every executor; `ProcessDied` if its process does.

        Raises:
            RuntimeError: they are shut down.
        """
        return self._threads.submit(self._run, fn, args, kwargs)

    def _run(self, fn: Callable[..., T], args: tuple[Any, ...], kwargs: dict[str, Any]) -> T:
        pool: Any = getattr(self._own, "pool", None)
        try:
            if pool is None:
                pool = self._own.pool = ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), initializer=_begin)
                with _child_environment():
                    pool.submit(cores)
                self._pools.append(pool)
            (process,) = pool._processes.values()
            return pool.submit(fn, *args, **kwargs).result()
        except BrokenExecutor as error:
            self._own.pool = None
            self._pools.remove(pool)
            end = time.monotonic() + 5.0
            while process.exitcode is None and time.monotonic() < end:  # the pool waits for it, too, and may know it first
                time.sleep(0.01)
            raise ProcessDied(process.exitcode) from error

    def kill(self) -> None:
        """End all processes at once; others take their places when something is submitted."""
        for pool in self._pools:
            for process in list((pool._processes or {}).values()):
                process.kill()

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes, after what was submitted; as of every executor."""
        self._threads.shutdown(wait=wait, cancel_futures=cancel_futures)
        for pool in self._pools:
            pool.shutdown(wait=wait)


class ProcessDied(Exception):  # noqa: N818  it says what happened
    """The process that computed something died.

    Attributes:
        code: Its exit code; of a signal less than zero.
    """

    def __init__(self, code: int | None) -> None:
        self.code = code or 0
        told = f"ended with exit code {code}; what it printed says more"
        if self.code < 0:
            more = ", as the system does where memory runs out" if self.code == -signal.SIGKILL else ""
            told = f"was ended by signal {-self.code} ({signal.Signals(-self.code).name}){more}"
        super().__init__(told)


_LIMITED = dict[str, object]()
"""The block that has set the limit, if one has. Not a lock: a process forked while one is held can never take it."""


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Within, NumPy's and SciPy's BLAS use one thread in this process, and afterwards as many as before.

    On matrices of a hundred rows several threads wait for each other longer than they compute: where other programs run, too, a
    falling humanoid's steps take four times as long with two threads. The bits are the same. A block inside another, also of
    another thread, changes nothing: the first one sets and restores.
    """
    if _LIMITED.setdefault("block", mine := object()) is not mine:  # one call: no other thread comes in between
        yield
        return
    try:
        with _libraries().limit(limits=1, user_api="blas"):
            yield
    finally:
        _LIMITED.clear()


@cache
def _libraries() -> Any:
    import scipy.linalg  # loaded first, so that its BLAS is found  # noqa: F401
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


@contextmanager
def _child_environment() -> Iterator[None]:
    """What a process inherits that is started within: one BLAS thread, and SIGINT blocked, as Ctrl-C is for its parent.

    It shows no warnings as it imports the script: its parent did. Those of the function are recorded, whatever the filters.
    """
    with _STARTING:
        before, options = dict(os.environ), sys.warnoptions
        blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        os.environ.update(ONE_THREAD | {MARK: "1"})
        sys.warnoptions = [*options, "ignore"]
        try:
            yield
        finally:
            sys.warnoptions = options
            for name in (*ONE_THREAD, MARK):
                os.environ.pop(name, None)
            os.environ.update(before)
            signal.pthread_sigmask(signal.SIG_SETMASK, blocked)


def _begin() -> None:
    """First in a process: end with the parent, even if that is killed."""
    parent = multiprocessing.parent_process()

    def end() -> None:
        multiprocessing.connection.wait([parent.sentinel] if parent else [])
        os._exit(1)

    threading.Thread(target=end, daemon=True).start()


def check_guard(what: str) -> None:
    """Refuse to start processes in one of them, as it imports the script of the first.

    Args:
        what: Is started anew, and how it is computed in this process instead, in words.

    Raises:
        InputError: they are not those of `Workers`; the latter end, so that the first process can say why.
    """
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        if os.environ.get(MARK):
            os._exit(UNGUARDED)
        raise InputError(without_guard(what))


def without_guard(what: str) -> str:
    """What is wrong with a script that starts its processes anew in each of them; argument as of `check_guard`."""
    subject, here = what.split("; ")
    return (
        f"{subject} is started again in each of its own processes, as they import the script. Put the calls of the script "
        'below the line\n\n    if __name__ == "__main__":\n\nso that only the first process runs them; functions and robots '
        f"stay above it. {here} computes in this process."
    )
