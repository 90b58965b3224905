"""Where chunks are evaluated: in this process, in spawned processes, or by any executor of `concurrent.futures`."""

from __future__ import annotations

import hashlib
import multiprocessing
import os
import pickle
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from functools import lru_cache
from typing import Any

from rbd.studies.evaluation import Evaluation
from rbd.studies.kept.variable import Block

Chunk = tuple[int, Mapping[str, Any]]
"""Number of the first sample, and {argument: values}."""


def blocks(evaluation: Evaluation, chunks: Iterable[Chunk], executor: Executor | int | None) -> Iterator[Block]:
    """The results of chunks, in the order in which they are finished.

    Args:
        evaluation: What is computed.
        chunks: The samples; read as workers become free, so that they need not all be in memory.
        executor: None: spawned processes, one a core; n: that many, 0: in this process; or an executor, which stays open.
    """
    if executor == 0:
        for start, columns in chunks:
            yield evaluation.block(start, columns)
        return
    own = executor if isinstance(executor, Executor) else _spawned(os.cpu_count() if executor is None else executor)
    sent = pickle.dumps(evaluation)
    key = hashlib.sha256(sent).hexdigest()
    try:
        pending: set[Future[Block]] = set()
        for start, columns in chunks:
            pending.add(own.submit(_evaluate, key, sent, start, columns))
            if len(pending) >= 4 * (os.cpu_count() or 1):
                done, pending = wait(pending, return_when=FIRST_COMPLETED)
                yield from (future.result() for future in done)
        while pending:
            done, pending = wait(pending, return_when=FIRST_COMPLETED)
            yield from (future.result() for future in done)
    finally:
        if own is not executor:
            own.shutdown(cancel_futures=True)


def _spawned(workers: int | None) -> ProcessPoolExecutor:
    return ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn"))


def _evaluate(key: str, sent: bytes, start: int, columns: Mapping[str, Any]) -> Block:
    return _kept(key, sent).block(start, columns)


@lru_cache(maxsize=4)
def _kept(key: str, sent: bytes) -> Evaluation:
    """The evaluation, unpickled once in a process, so that its robots are built once."""
    found: Evaluation = pickle.loads(sent)
    return found
