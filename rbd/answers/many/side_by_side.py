"""Many states in several processes: parts of them are answered in workers, and what these write is put together."""

from __future__ import annotations

import os
import pickle
import warnings
from collections.abc import Callable
from concurrent.futures import as_completed
from dataclasses import replace
from functools import cache, lru_cache
from typing import Any

import numpy as np

from rbd.answers.many.many_answers import Sheet
from rbd.answers.many.states import ManyStates
from rbd.arrays import check_whole
from rbd.errors import InputError, Reason
from rbd.errors.warned import StudyWarning, stacklevel_of_user
from rbd.workers import MOST, UNGUARDED, ProcessDied, Workers, check_guard, without_guard

LEAST, MOST_SENT = 1_024, 16_384
"""States that are sent at a time: sending takes as long as some tens of states; of what is under way Ctrl-C loses all."""
SHARES = 4
"""Parts a process has, of many states: so all end together."""
ANEW = "rbd.solve_many; threads=1"
Filled = Callable[..., None]


@cache
def _workers(count: int, process: int) -> Workers:
    """Those of a process: they stay for later calls, and end with it."""
    return Workers(count)


def fill(sheet: Sheet, threads: int | None, answer: Filled, *given: object) -> None:
    """Answer all states of a sheet, here or in several processes; the numbers are the same, bit by bit.

    Ctrl-C leaves what is not done with the reason `NOT_RUN`, and so does a process that dies.

    Args:
        sheet: Filled.
        threads: How many processes; None: one a core; 1: this one.
        answer: A function of a module: fills a sheet.
        given: What it needs besides.

    Raises:
        InputError: no number of processes; or a script starts itself anew in each.
    """
    if threads is not None:
        check_whole("threads", threads, MOST)
    if threads == 1:
        answer(sheet, *given)
        return
    check_guard(ANEW)
    workers, states = _workers(threads or 0, os.getpid()), sheet.states
    sent = pickle.dumps((states.robot, states.constraints, answer, given))
    size = min(max(LEAST, -(-len(states) // (SHARES * workers.count))), MOST_SENT)
    parts = [np.arange(start, min(start + size, len(states))) for start in range(0, len(states), size)]
    sheet.reason_codes[:] = Reason.NOT_RUN.code
    ways = {}
    try:
        for part in parts:
            bare = replace(states.part(part), robot=None, constraints=())  # type: ignore[arg-type]
            ways[workers.submit(_answered, sent, bare)] = part
        for future in as_completed(ways):
            try:
                sheet.put(ways[future], future.result())
            except ProcessDied as error:
                if error.code == UNGUARDED:
                    raise InputError(without_guard(ANEW)) from None
                sheet.reasons.update(dict.fromkeys(ways[future].tolist(), f"the process that computed it {error}"))
    except KeyboardInterrupt:
        for future in ways:
            if future.done() and future.exception() is None:
                sheet.put(ways[future], future.result())
        done = int((sheet.reason_codes != Reason.NOT_RUN.code).sum())
        told = f"Ctrl-C after {done:,} of {len(states):,} states; the others have the reason not_run."
        warnings.warn(told, StudyWarning, stacklevel=stacklevel_of_user())
    finally:
        for future in ways:
            future.cancel()
        if not all(future.done() for future in ways):
            workers.kill()
    sheet.refuse_bad_input()  # by their numbers among all states


@lru_cache(maxsize=4)
def _loaded(sent: bytes) -> Any:
    """A robot and what is asked of it, in another process: once, so that what is prepared for it stays."""
    return pickle.loads(sent)


def _answered(sent: bytes, bare: ManyStates) -> Sheet:
    """In another process: the sheet of some states, less the states."""
    robot, constraints, answer, given = _loaded(sent)
    sheet = Sheet(replace(bare, robot=robot, constraints=constraints))
    with warnings.catch_warnings(action="ignore"):
        answer(sheet, *given)
    sheet.states = bare
    return sheet
