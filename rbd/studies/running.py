"""`study`: a function evaluated at many samples, in parallel, resumable, as one labelled dataset."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from concurrent.futures import Executor
from typing import TYPE_CHECKING, Any

import numpy as np

from rbd.errors import StudyStopped
from rbd.studies.calling import bound
from rbd.studies.evaluation import Evaluation
from rbd.studies.filling import check_all, fill
from rbd.studies.kept.wanted import Keep
from rbd.studies.provenance import attributes_of
from rbd.studies.stores.opened import checked_path, store_of
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
    check_all(evaluation, executor, chunk)
    store = store_of(path, found, attributes_of(function, found, keep=keep, seed=seed, batched=batched))
    try:
        if progress and store.done.any():
            sys.stderr.write(_told(int(np.count_nonzero(store.done)), len(found)) + "\n")
        filled = fill(store, evaluation, found, executor=executor, chunk=chunk, progress=progress)
        filled.warn()
        if filled.stopped:
            raise StudyStopped(filled.stopped, dataset=store.dataset()) from filled.cause
        return store.dataset()
    finally:
        store.close()


def _told(done: int, n: int) -> str:
    if done == n:
        return f"All {n:,} samples were done; nothing is computed."
    return f"{done:,} of {n:,} samples were done; going on."
