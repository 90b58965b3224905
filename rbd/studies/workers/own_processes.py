"""`Workers`: spawned processes for studies; one that dies is replaced, and what it computed is computed again."""

from __future__ import annotations

import multiprocessing
import multiprocessing.connection
import os
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor, wait as wait_for
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import Any, TypeVar

from rbd.errors import InputError
from rbd.model.forks import RenewedLock

T = TypeVar("T")
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
MARK = "RBD_STUDY_WORKER"
"""Set in the environment of the processes, so that a script that starts its study there again is noticed."""
UNGUARDED = 79
"""Exit code of such a process."""
MOST = 1024
"""Processes, at most; more are a cluster's."""
DEATHS = 2
"""A task is given up when so many processes have died of it."""
_STARTING = RenewedLock()


class WorkerDied(BrokenExecutor):
    """Processes died of one and the same task; the others go on."""


class _Task:
    """What is submitted, and how many processes have died of it."""

    def __init__(self, call: Callable[[], Any], future: Future[Any]) -> None:
        self.call, self.future, self.deaths = call, future, 0


class _Seat:
    """One process: a pool of one, so that it is known which task it died of."""

    def __init__(self) -> None:
        self.pool: ProcessPoolExecutor | None = None
        self.tasks: list[_Task] = []
        self.process: Any = None

    def submit(self, task: _Task, finished: Callable[[_Seat, _Task, Future[Any]], None]) -> None:
        """Give the process one more task; the first one starts it."""
        self.tasks.append(task)
        if self.pool is None:
            self.pool = ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn"), initializer=_begin)
        with _child_environment():
            inner = self.pool.submit(task.call)
        if self.process is None:
            self.process = next(iter(self.pool._processes.values()), None)
        inner.add_done_callback(lambda done: finished(self, task, done))

    def exit_code(self) -> int | None:
        """What the process ended with, a negative number by a signal; None where that is unknown."""
        end = time.monotonic() + 1.0
        while self.process is not None and self.process.exitcode is None and time.monotonic() < end:
            time.sleep(0.01)
        return None if self.process is None else self.process.exitcode

    def close(self, *, wait: bool) -> None:
        """End the process, after its tasks."""
        if self.pool is not None:
            self.pool.shutdown(wait=wait, cancel_futures=True)

    def kill(self) -> None:
        """End the process at once."""
        if self.process is not None and self.process.is_alive():
            self.process.kill()


class Workers(Executor):
    """Processes that stay open for several studies: an executor, to be used in a `with` statement.

    Each is a new Python process with one BLAS thread that ignores Ctrl-C and ends with the one that started it. They start
    with the first study. A process that dies, of a signal or for want of memory, is replaced and its chunk computed again.

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
        self._seats = [_Seat() for _ in range(self.count)]
        self._waiting: deque[_Task] = deque()
        self._lock = RenewedLock()
        self._closed = False

    def __repr__(self) -> str:
        return f"Workers({self.count}{', closed' if self._closed else ''})"

    def submit(self, fn: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        """A future of `fn(*args, **kwargs)`, as of every executor.

        Raises:
            RuntimeError: they are shut down.
        """
        future: Future[T] = Future()
        with self._lock:
            if self._closed:
                raise RuntimeError("cannot schedule new futures after shutdown")
            self._waiting.append(_Task(_Call(fn, args, kwargs), future))
            self._hand_out()
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes, after what was submitted; as of every executor."""
        with self._lock:
            self._closed = True
            waiting = list(self._waiting) if cancel_futures else []
            self._waiting = deque(() if cancel_futures else self._waiting)
            for task in waiting:
                task.future.cancel()
            futures = [task.future for seat in self._seats for task in seat.tasks] + [task.future for task in self._waiting]
            for seat in self._seats:
                self._close_if_idle(seat)
        if wait:
            wait_for(futures)
            for seat in self._seats:
                seat.close(wait=True)

    def drop(self) -> None:
        """End at once what is computed, with its processes; others take their places when something is submitted."""
        with self._lock:
            waiting, self._waiting = list(self._waiting), deque()
            busy = [seat for seat in self._seats if seat.tasks]
            for seat in busy:
                self._seats[self._seats.index(seat)] = _Seat()
        for task in [*waiting, *(task for seat in busy for task in seat.tasks)]:
            task.future.cancel()
        for seat in busy:
            seat.kill()
        for seat in busy:
            seat.close(wait=True)

    def _hand_out(self) -> None:
        """Each process has one task, and one more that waits in its pipe; called with the lock."""
        for most in (1, 2):
            for seat in self._seats:
                while self._waiting and len(seat.tasks) < most:
                    task = self._waiting.popleft()
                    if task.future.running() or task.future.set_running_or_notify_cancel():
                        self._give(seat, task)

    def _give(self, seat: _Seat, task: _Task) -> None:
        try:
            seat.submit(task, self._finished)
        except BrokenProcessPool:  # it died while it had nothing to do, or a moment ago
            seat.tasks.remove(task)
            self._waiting.appendleft(task)
            if seat in self._seats:
                self._replace(seat)
        except RuntimeError as error:  # Python is ending
            seat.tasks.remove(task)
            task.future.set_exception(error)

    def _close_if_idle(self, seat: _Seat) -> None:
        if self._closed and not self._waiting and not seat.tasks:
            seat.close(wait=False)

    def _finished(self, seat: _Seat, task: _Task, done: Future[Any]) -> None:
        """Called in the thread of a seat's pool."""
        error = None if done.cancelled() else done.exception()
        with self._lock:
            if seat not in self._seats:  # dropped, or replaced
                return
            if isinstance(error, BrokenProcessPool):
                self._replace(seat)
                return
            seat.tasks.remove(task)
            self._hand_out()
            self._close_if_idle(seat)
        if error is not None:
            task.future.set_exception(error)
        elif not done.cancelled():
            task.future.set_result(done.result())

    def _replace(self, seat: _Seat) -> None:
        """The process of a seat died, of the first of its tasks: another process begins with them."""
        self._seats[self._seats.index(seat)] = _Seat()
        if seat.tasks:
            seat.tasks[0].deaths += 1
            code = seat.exit_code()
            if seat.tasks[0].deaths >= DEATHS or code == UNGUARDED:
                seat.tasks.pop(0).future.set_exception(WorkerDied(_cause_of(code)))
        self._waiting.extendleft(reversed(seat.tasks))
        self._hand_out()


class _Call:
    """A function with its arguments, to be called in the process."""

    def __init__(self, fn: Callable[..., Any], args: tuple[Any, ...], kwargs: dict[str, Any]) -> None:
        self.fn, self.args, self.kwargs = fn, args, kwargs

    def __call__(self) -> Any:
        return self.fn(*self.args, **self.kwargs)


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


def _cause_of(code: int | None) -> str:
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
