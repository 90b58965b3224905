"""Judgements in processes of their own: a child that is silent, limited, and tells what it found through a pipe."""

from __future__ import annotations

import json
import os
import resource
import select
import signal
import time
import traceback
import warnings
from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple


class Ended(NamedTuple):
    """A child that has ended.

    Attributes:
        i: Its number.
        said: What it found, as JSON; empty where it ended without a word.
        signal: What ended it; 0 where nothing did.
        late: Whether it took longer than it may, and was ended.
    """

    i: int
    said: str
    signal: int
    late: bool


def child(judge: Callable[[], Any], failed: Callable[[BaseException], Any], limits: dict[int, int]) -> tuple[int, int]:
    """(process, pipe) of a child that judges, silent whatever parsers print.

    Args:
        judge: What is to be told, as JSON.
        failed: What is told of an error in it.
        limits: {resource: most}, soft and hard.
    """
    read, write = os.pipe()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # Python 3.12 warns of threads beside a fork
        process = os.fork()
    if process:
        os.close(write)
        return process, read
    try:
        quiet = os.open(os.devnull, os.O_RDWR)
        for stream in (0, 1, 2):
            os.dup2(quiet, stream)
        for what, most in limits.items():
            resource.setrlimit(what, (most, most))
        os.write(write, json.dumps(judge()).encode())  # at once: a pipe with something in it is taken for ended
    except BaseException as error:
        os.write(write, json.dumps(failed(error)).encode())
    finally:
        os._exit(0)


def ended(start: Callable[[int], tuple[int, int]], numbers: Iterable[int], jobs: int, seconds: float) -> Iterator[Ended]:
    """The children of these numbers, as they end; `jobs` at a time, each ended after so many seconds."""
    waiting, running = iter(numbers), dict[int, tuple[int, int, float]]()
    while (i := next(waiting, None) if len(running) < jobs else None) is not None or running:
        if i is not None:
            process, pipe = start(i)
            running[pipe] = (i, process, time.monotonic() + seconds)
            continue
        ready = select.select(list(running), [], [], 0.1)[0]
        late = [pipe for pipe, job in running.items() if pipe not in ready and time.monotonic() > job[2]]
        for pipe in ready + late:
            i, process, _ = running.pop(pipe)
            if pipe in late:
                os.kill(process, signal.SIGKILL)
            with open(pipe) as stream:
                said = stream.read()
            yield Ended(i, said, os.waitpid(process, 0)[1] & 127, pipe in late)


def alone(work: Callable[[], Any], seconds: float = 60.0) -> Any:
    """What some work tells, as JSON, that is done in a child: what would end the process fails the test alone."""

    def failed(error: BaseException) -> dict[str, str]:
        return {"error": "".join(traceback.format_exception(error))}

    (end,) = ended(lambda _: child(lambda: {"told": work()}, failed, {}), [0], 1, seconds)
    assert end.said and not end.signal and not end.late, f"it ended by signal {end.signal}, late: {end.late}, without a word"
    told = json.loads(end.said)
    assert "told" in told, told["error"]
    return told["told"]
