"""`study`: a function evaluated at many samples, in parallel, resumable, as one labelled dataset."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from typing import TYPE_CHECKING, Any

from rbd.studies.dataset import dataset_of
from rbd.studies.evaluation import Evaluation
from rbd.studies.filling import fill
from rbd.studies.samples import samples_of
from rbd.studies.stores.store import MemoryStore

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
    evaluation = Evaluation(function, None if keep is None else tuple(keep), seed, batched)
    store = MemoryStore(len(found))
    filled = fill(store, evaluation, found, executor=executor, chunk=chunk, progress=progress)
    filled.warn()
    if filled.stopped:
        raise RuntimeError(filled.stopped) from filled.cause
    return dataset_of(found, store.contents(), {"interrupted": filled.interrupted} if filled.interrupted else {})
