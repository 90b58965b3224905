"""`study`: a function evaluated at many samples, in parallel, resumable, as one labelled dataset."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from rbd.arrays import check_flag
from rbd.errors import InputError, RbdError, StudyStopped, StudyWarning
from rbd.errors.warned import stacklevel_of_user
from rbd.studies.outputs.output_selection import Keep
from rbd.studies.provenance.study_attributes import attributes_of
from rbd.studies.sampling.samples import Samples
from rbd.studies.sampling.tables import samples_of
from rbd.studies.stores import Store, checked_path
from rbd.studies.workers.evaluation import Evaluation, bound
from rbd.studies.workers.filling import Interruption, check_all, fill

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
    """The results of a function at many samples, as one dataset with named dimensions, units and reasons of failure.

    A sample that raises an error is a row: `ok` False, `reason` a code of `rbd.errors.Reason` with the code's meaning among its
    attributes, and `message` the error's text; its values are NaN. The numbers depend neither on the executor nor on the
    chunks: each sample has its own seed, and batched functions get blocks of fixed size. Versions, machine, command, seed and
    hashes of function and samples stand in the dataset's attributes.

    Args:
        function: Called with the arguments of each sample by name. Returns a number, an array, a mapping of these, an
            xarray.DataArray, or a record of `rbd` such as Solution, Actuation, MotionReport. If it has a parameter `rng` that
            the samples lack, it gets a `numpy.random.Generator` of the sample's own seed.
        samples: `rbd.grid(...)`, `rbd.sample(...)`, a table, or an iterable of mappings.
        keep: Names of what is kept of a result (`rbd.studies.kept_names(type)` lists them), functions of it as {name:
            function}, or both; None: what its type says, with its certificate.
        executor: None: spawned processes, one a core; n: that many; 0: this process; or an executor of `concurrent.futures`,
            e.g. `dask.distributed`'s `client.get_executor()`, which is left open.
        out: A path that ends in .zarr, or in .nc for a small study: what is finished is written there within a second, or 5 s
            where a writing takes more than 0.05 s; a process that is killed loses what it has not written yet, and the chunks
            under way. The same call goes on with what is missing. None: in memory only.
        seed: Root of the seeds of all samples.
        chunk: Samples that a worker gets at a time; None: about a second's.
        batched: Whether the function takes arrays over samples, as `rbd.solve_many` does.
        progress: Whether a bar is drawn on a terminal, and a line says on stderr that a stored study goes on.

    Returns:
        A dataset with the dimensions of the grid, or `sample`; its arguments are coordinates. After Ctrl-C, with a
        `StudyWarning`, what was finished: `attrs["interrupted"]` says how much. A stored study above 1 GB is read when
        it is used.

    Raises:
        InputError: before work starts: samples, names, executors, functions that cannot be sent or, with `out`,
            counted, a store of another study; at the first result: what cannot be kept; later: a result of another
            shape. What was finished stays stored.
        StudyStopped: a full disk, a chunk that ends each process that computes it, or a warning where the filters make errors
            of warnings; with what was finished.

    Example:
        >>> box = rbd.testing.box()
        >>> def push(friction, force):
        ...     floor = rbd.SurfaceContact("floor", "box", half_lengths=(0.2, 0.2), friction=friction)
        ...     pushed = rbd.ExternalForce("box", (force, 0, 0))
        ...     return rbd.hold(rbd.State(box, [0, 0, 0, 0, 0, 0, 1]), [floor], external=pushed)
        >>> held = rbd.study(push, rbd.grid(friction=[0.4, 0.8], force=[0.0, 60.0, 120.0]), executor=0)
        >>> print(held.attrs["summary"])
        6 samples: 3 ok; 3 cannot_hold: friction
        >>> print(held.ok.sel(friction=0.8).values)
        [ True  True False]
    """
    check_flag("batched", batched)
    check_flag("progress", progress)
    path, found = checked_path(out), samples_of(samples)
    evaluation = Evaluation(bound(function, found), keep, _seed(seed), bool(batched))
    check_all(evaluation, executor, chunk, found)
    attributes = attributes_of(
        function, found, keep=keep, seed=evaluation.seed, batched=evaluation.batched, stored=path is not None
    )
    store = Store(path, found, attributes)
    with Interruption() as interruption:
        try:
            _tell(store, progress)
            if store.done.all():
                return store.dataset()
            return _filled(store, evaluation, found, interruption, executor=executor, chunk=chunk, progress=progress)
        finally:
            with interruption.counted():
                store.close()


def _filled(store: Store, evaluation: Evaluation, samples: Samples, interruption: Interruption, **how: Any) -> xarray.Dataset:
    """The dataset of a store after what is missing was computed. Ctrl-C while it is made does not lose it."""
    try:
        filled = fill(store, evaluation, samples, interruption=interruption, **how)
        stopped, cause = filled.stopped, filled.cause
        with interruption.counted():
            found = None if stopped else store.dataset()
            if found is not None and interruption.asked and not filled.interrupted:
                filled = replace(filled, interrupted=f"Ctrl-C after all {filled.total:,} samples")
            try:
                filled.warn()
            except Warning as error:  # by the filters of warnings
                made = f"a warning is an error here, by Python's filters: {error}. This error's `dataset` has the results."
                stopped, cause = stopped or made, cause or error
            if found is not None and not stopped:
                return found
    except StudyStopped as error:
        with interruption.counted():
            error.dataset = _of_stopped(store)
        raise
    with interruption.counted():
        kept = _of_stopped(store)
    raise StudyStopped(stopped, dataset=kept) from cause


def _of_stopped(store: Store) -> xarray.Dataset | None:
    """What is kept of a study that stopped; None where it cannot be read."""
    try:
        return store.kept()
    except (RbdError, OSError):
        return None


def _tell(store: Store, progress: bool) -> None:
    """What a stored study has: on stderr how much, as a warning what else computed it."""
    done, n = int(np.count_nonzero(store.done)), len(store.done)
    if not done:
        return
    if progress and sys.stderr is not None:
        going = "nothing is left to compute" if done == n else "going on"
        sys.stderr.write(f"{done:,} of {n:,} samples were done; {going}.\n")
    if done < n and store.others:
        warnings.warn(f"{store.others} Results may differ in their last bits.", StudyWarning, stacklevel=stacklevel_of_user())


def _seed(given: object) -> int:
    if isinstance(given, bool) or not isinstance(given, int | np.integer) or given < 0:
        raise InputError(f"seed is {given!r:.80}; expected a whole number from 0.")
    return int(given)
