"""`study`: a function evaluated at many samples, in parallel, resumable, as one labelled dataset."""

from __future__ import annotations

import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager, suppress
from types import FrameType
from typing import TYPE_CHECKING, Any

import numpy as np

from rbd.arrays import check_flag
from rbd.errors import InputError, RbdError, StudyStopped, StudyWarning
from rbd.errors.warned import stacklevel_of_user
from rbd.simulation.progress_bar import progress_of
from rbd.studies.evaluation import Evaluation, WarningCounts, bound
from rbd.studies.processes import Chunks, Crew, Here, check_executor, sent_columns, sent_of
from rbd.studies.provenance import attributes_of
from rbd.studies.results import Keep, OutputSelection
from rbd.studies.samples import Samples
from rbd.studies.stores import Store, checked_path
from rbd.studies.tables import samples_of
from rbd.workers import Workers

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
        out: A path that ends in .zarr: what is finished is written there within a second, or 5 s
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
        StudyStopped: a full disk, ten samples of which two processes died each, or a warning where the filters make errors of
            warnings; with what was finished.

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
    path, found, kept = checked_path(out), samples_of(samples), OutputSelection(keep)
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise InputError(f"seed is {seed!r:.80}; expected a whole number from 0.")
    evaluation = Evaluation(bound(function, found), kept, int(seed), bool(batched))
    check_all(evaluation, executor, chunk, found)
    attributes = attributes_of(function, found, (kept.text, kept.functions), int(seed), batched, stored=path is not None)
    store = Store(path, found, attributes)
    with counted_interrupts() as pressed:
        try:
            done, n = int(np.count_nonzero(store.done)), len(found)
            if done and progress and sys.stderr is not None:
                going = "nothing is left to compute" if done == n else "going on"
                sys.stderr.write(f"{done:,} of {n:,} samples were done; {going}.\n")
            if 0 < done < n and "; then " in str(store.attributes["versions"]):
                told = str(store.attributes["versions"]).replace("; then ", ", and the rest with ")
                text = f"A part was computed with {told}. Results may differ in their last bits."
                warnings.warn(text, StudyWarning, stacklevel=stacklevel_of_user())
            return Filling(store, evaluation, found, pressed, chunk).dataset(executor, progress=progress)
        finally:
            store.close()


def check_all(
    evaluation: Evaluation, executor: Executor | int | None, chunk: int | None, samples: Samples | None = None
) -> None:
    """Refuse before work starts what could not be done: chunks, executors, functions and samples that cannot be sent.

    Raises:
        InputError: names it, and what to try.
    """
    if chunk is not None and (isinstance(chunk, bool) or not isinstance(chunk, int | np.integer) or chunk < 1):
        raise InputError(f"chunk is {chunk!r:.80}; expected a whole number of samples from 1, or None: about a second each.")
    check_executor(executor)
    if sent_of(evaluation, executor) and samples is not None:
        sent_columns({each.name: each.values.tolist() for each in samples.given if each.dim and each.values.dtype == object})


@contextmanager
def counted_interrupts() -> Iterator[list[int]]:
    """A list that grows when Ctrl-C is pressed, which raises KeyboardInterrupt as always.

    So that functions that end early by it, as `rbd.simulate` does, end the study too. Handlers of the user's own, and those of
    other threads, stay as they are.
    """
    pressed = list[int]()

    def note(number: int, frame: FrameType | None) -> None:
        pressed.append(number)
        raise KeyboardInterrupt

    main = threading.current_thread() is threading.main_thread()
    ours = main and signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if ours:
        signal.signal(signal.SIGINT, note)
    try:
        yield pressed
    finally:
        if ours:
            signal.signal(signal.SIGINT, signal.default_int_handler)


class Filling:
    """What a store lacks, evaluated and put there; Ctrl-C ends it in order, a second one at once.

    Args:
        store: Filled.
        evaluation: What is computed.
        samples: The samples, in the store's numbering.
        pressed: Grows when Ctrl-C is pressed.
        chunk: Samples that are sent at a time; None: about a second's.

    Attributes:
        interrupted: "Ctrl-C after 340 of 1,000 samples"; empty where it was not interrupted.
        warned: The warnings of the function.
    """

    def __init__(
        self, store: Store, evaluation: Evaluation, samples: Samples, pressed: list[int], chunk: int | None = None
    ) -> None:
        self.store, self.evaluation, self.samples, self.pressed = store, evaluation, samples, pressed
        self.warned, self.interrupted = WarningCounts(), ""
        self._chunks = Chunks(store.done, chunk, batched=evaluation.batched)

    @property
    def so_far(self) -> str:
        """How much is done."""
        return f"{np.count_nonzero(self.store.done):,} of {len(self.samples):,} samples"

    def run(self, executor: Executor | int | None, *, progress: bool = True) -> None:
        """Evaluate, until all is done or it ends. Chunks that are under way when it ends are lost.

        Raises:
            InputError: results that cannot be kept.
            StudyStopped: the store cannot be written, or the executor computes no more.
        """

        def check() -> None:
            if self.pressed:
                raise KeyboardInterrupt

        own = executor if isinstance(executor, Executor) else Workers(executor) if executor != 0 else Here(check)
        crew = Crew(own, self.evaluation, self.samples, self._chunks)
        try:
            with progress_of((0.0, float(len(self.samples))), shown=progress, doing="studying") as draw:
                for finished in crew.results():
                    if finished is not None:
                        self.store.put(finished.block)
                        for kind, counted in finished.warned.found.items():
                            self.warned.add(kind, *counted)
                    draw(float(np.count_nonzero(self.store.done)))
                    check()
        except KeyboardInterrupt:
            if len(self.pressed) > 1:
                raise
            self.interrupted = f"Ctrl-C after {self.so_far}"
        finally:
            crew.end()
            if own is not executor:
                own.shutdown()

    def dataset(self, executor: Executor | int | None, *, progress: bool = True) -> xarray.Dataset:
        """The dataset after `run`. Ctrl-C while it is made does not lose it.

        Raises:
            StudyStopped: it ended early, or a warning is an error; with what is done.
        """
        found: xarray.Dataset | None = None
        try:
            self.run(executor, progress=progress)
            try:
                found = self.store.dataset()
            except KeyboardInterrupt:
                if len(self.pressed) > 1:
                    raise
                self.interrupted, found = f"Ctrl-C after all {self.so_far}", self.store.dataset()
            self.warn()
        except Warning as error:  # by the filters of warnings
            raise StudyStopped(
                f"a warning is an error here, by Python's filters: {error}. This error's `dataset` has the results.",
                dataset=found,
            ) from error
        except StudyStopped as error:
            with suppress(RbdError, OSError):
                error.dataset = self.store.kept()
            raise
        return found

    def warn(self) -> None:
        """Issue the function's warnings, one of each kind, and one of an interruption."""
        self.warned.warn(len(self.samples))
        if self.interrupted:
            left = "none is missing" if self.store.done.all() else "the others have the reason not_run"
            warnings.warn(f"{self.interrupted}; {left}.", StudyWarning, stacklevel=stacklevel_of_user())
