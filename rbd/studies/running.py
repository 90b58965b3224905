"""`study`: a function evaluated at many samples, in parallel, resumable, as one labelled dataset."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from typing import TYPE_CHECKING, Any

import numpy as np

from rbd.studies.calling import bound
from rbd.studies.evaluation import Evaluation
from rbd.studies.executors import Chunk, blocks
from rbd.studies.kept.wanted import Keep
from rbd.studies.provenance import attributes_of
from rbd.studies.samples import Samples
from rbd.studies.stores.opened import checked_path, store_of
from rbd.studies.stores.store import Store
from rbd.studies.tables import samples_of

if TYPE_CHECKING:
    import xarray


def study(
    function: Callable[..., Any],
    samples: object,
    *,
    keep: Keep = None,
    executor: Executor | int | None = None,
    out: str | os.PathLike[str] | None = None,
    seed: int = 0,
    chunk: int | None = None,
    batched: bool = False,
    progress: bool = True,
) -> xarray.Dataset:
    """The results of a function at many samples, as one dataset with named dimensions, units and reasons of failure."""
    path = checked_path(out)
    found = samples_of(samples)
    evaluation = Evaluation(bound(function, found), keep, seed, batched)
    attributes = attributes_of(function, found, keep=keep, seed=seed, batched=batched)
    store = store_of(path, found, attributes)
    try:
        if progress and store.done.any():
            sys.stderr.write(_told(int(np.count_nonzero(store.done)), len(found)) + "\n")
        size = chunk or max(1, min(10_000, len(found) // 64))
        for block in blocks(evaluation, _chunks(found, size, store), executor):
            store.put(block)
        return store.dataset()
    finally:
        store.close()


def _told(done: int, n: int) -> str:
    if done == n:
        return f"All {n:,} samples were done; nothing is computed."
    return f"{done:,} of {n:,} samples were done; going on."


def _chunks(samples: Samples, size: int, store: Store) -> Iterator[Chunk]:
    """What is not done, in parts."""
    for start in range(0, len(samples), size):
        stop = min(start + size, len(samples))
        if not store.done[start:stop].all():
            yield start, samples.columns(start, stop)
