"""`study`: a function evaluated at many samples, in parallel, resumable, as one labelled dataset."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from typing import TYPE_CHECKING, Any

from rbd.studies.calling import bound
from rbd.studies.dataset import dataset_of
from rbd.studies.evaluation import Evaluation
from rbd.studies.executors import Chunk, blocks
from rbd.studies.samples import Samples
from rbd.studies.stores.store import MemoryStore
from rbd.studies.tables import samples_of

if TYPE_CHECKING:
    import xarray


def study(
    function: Callable[..., Any],
    samples: object,
    *,
    keep: Sequence[str] | None = None,
    executor: Executor | int | None = None,
    out: str | os.PathLike[str] | None = None,
    seed: int = 0,
    chunk: int | None = None,
    batched: bool = False,
    progress: bool = True,
) -> xarray.Dataset:
    """The results of a function at many samples, as one dataset with named dimensions, units and reasons of failure."""
    found = samples_of(samples)
    function = bound(function, found)
    evaluation = Evaluation(function, None if keep is None else tuple(keep), seed, batched)
    store = MemoryStore(len(found))
    size = chunk or max(1, min(10_000, len(found) // 64))
    for block in blocks(evaluation, _chunks(found, size, store), executor):
        store.put(block)
    return dataset_of(found, store.contents(), {})


def _chunks(samples: Samples, size: int, store: MemoryStore) -> Iterator[Chunk]:
    """What is not done, in parts."""
    for start in range(0, len(samples), size):
        stop = min(start + size, len(samples))
        if not store.done[start:stop].all():
            yield start, samples.columns(start, stop)
