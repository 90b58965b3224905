"""`Evaluation`: a function with what is kept of its results; evaluates a chunk in any process, and counts its warnings."""

from __future__ import annotations

import sys
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np

from rbd.arrays import Array
from rbd.errors import InputError
from rbd.errors.warned import StudyWarning, stacklevel_of_user
from rbd.model.forks import RenewedLock
from rbd.studies.kept.layout import words_of
from rbd.studies.kept.plain import NotKept
from rbd.studies.kept.rows import KeptRows, text_of
from rbd.studies.kept.variable import Block
from rbd.studies.kept.wanted import Keep
from rbd.studies.sampling.samples import arguments
from rbd.studies.workers.calling import takes_rng

Kind = tuple[str, str]
"""Module and name of the class of a warning: the class itself may be unknown in another process."""


@dataclass(eq=False)
class Told:
    """Warnings by their kind.

    Attributes:
        counts: {kind: number of samples that gave such a warning}; of a batched function, of calls.
        first: {kind: number of the first of these samples}.
        texts: {kind: its message}.
    """

    counts: dict[Kind, int] = field(default_factory=dict)
    first: dict[Kind, int] = field(default_factory=dict)
    texts: dict[Kind, str] = field(default_factory=dict)

    def add(self, i: int, caught: list[warnings.WarningMessage]) -> None:
        """The warnings of sample i."""
        for warning in reversed(caught):
            self._count((warning.category.__module__, warning.category.__qualname__), 0, i, str(warning.message))
        for kind in {(w.category.__module__, w.category.__qualname__) for w in caught}:
            self.counts[kind] += 1

    def join(self, other: Told) -> None:
        """Count the warnings of other samples too."""
        for kind, n in other.counts.items():
            self._count(kind, n, other.first[kind], other.texts[kind])

    def _count(self, kind: Kind, n: int, i: int, text: str) -> None:
        self.counts[kind] = self.counts.get(kind, 0) + n
        if i <= self.first.get(kind, i):  # whatever the order of the chunks, the message of the first sample is told
            self.first[kind], self.texts[kind] = i, text

    def warn(self, total: int) -> None:
        """Issue one warning for each kind, of the kind's own class where it is known here.

        Args:
            total: Number of all samples.
        """
        for (module, name), n in sorted(self.counts.items()):
            found = getattr(sys.modules.get(module), name, None)
            known = isinstance(found, type) and issubclass(found, Warning)
            first = self.first[module, name]
            where = f"sample {first:,}" if n == 1 else f"{n:,} of {total:,} calls warn so, the first of them sample {first:,}"
            text = f"{self.texts[module, name]} [{where}]"
            category = found if known and found is not None else StudyWarning
            warnings.warn(
                text if known else f"{name}: {text}",
                category,
                stacklevel=stacklevel_of_user(),
            )


@contextmanager
def recorded() -> Iterator[list[warnings.WarningMessage]]:
    """A list of the warnings that are issued within, all of them, whatever filters are set; none is shown or raised.

    The filters are those of the whole process, so this is used by one thread at a time.
    """
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        yield caught


BATCH = 512
"""Samples that a batched function gets at a time: as many as `solve_many` puts in a block, whatever the chunk."""
Columns: TypeAlias = Mapping[str, Sequence[Any] | Array]
"""{argument: values of some samples}, of one length."""
ONE_AT_A_TIME = RenewedLock()
"""Held during an evaluation: the filters of warnings are those of the whole process, and user's functions may not be safe."""


@dataclass(frozen=True, eq=False)
class Finished:
    """The results of a chunk, and what is told of it.

    Attributes:
        block: The results.
        seconds: How long it took [s].
        told: The warnings of the function, counted.
    """

    block: Block
    seconds: float
    told: Told


def _nothing() -> None:
    pass


@dataclass(frozen=True, eq=False)
class Evaluation:
    """What is computed for each sample, and what is kept of it; it is sent to the workers once.

    Attributes:
        function: Called with the arguments of a sample; `rng=` a Generator of the sample, where it has such a parameter.
        keep: Names of what is kept, or {name: function of the result}; None: the defaults of the result's type.
        seed: Root of the seeds of all samples.
        batched: Whether the function takes arrays over samples, `BATCH` at a time.
    """

    function: Callable[..., Any]
    keep: Keep = None
    seed: int = 0
    batched: bool = False

    def run(self, start: int, columns: Columns, *, check: Callable[[], None] = _nothing) -> Finished:
        """Results of consecutive samples; an exception of the function is a row without a result, with its reason.

        A batch that raises is computed again sample by sample, with arrays of length one, so that only samples that raise
        have no result. What NumPy does about divisions by zero is its default, whatever this process has set.

        Args:
            start: Number of the first sample; of a batched function a multiple of `BATCH`.
            columns: {argument: values}, of one length.
            check: Called after each call of the function; may raise, as Ctrl-C does.

        Raises:
            InputError: results that cannot be kept; names the sample.
        """
        began = time.perf_counter()
        n, told = len(next(iter(columns.values()))), Told()
        rows = KeptRows(n, self.keep, first=start, arguments=tuple(columns))
        draws = "rng" not in columns and takes_rng(self.function)
        with ONE_AT_A_TIME, recorded() as caught, np.errstate(divide="warn", over="warn", under="ignore", invalid="warn"):
            evaluate = self._batches if self.batched else self._singles
            evaluate(rows, start, columns, draws, _After(told, caught, check))
        return Finished(rows.block(), time.perf_counter() - began, told)

    def block(self, start: int, columns: Columns) -> Block:
        """Results of consecutive samples alone; arguments as `run`."""
        return self.run(start, columns).block

    def _singles(self, rows: KeptRows, start: int, columns: Columns, draws: bool, after: _After) -> None:
        """Each sample by a call of its own."""
        function = self.function
        for i, given in enumerate(arguments(columns)):
            if draws:
                given["rng"] = np.random.default_rng(self.seed_of(start + i))
            try:
                result = function(**given)
            except (Exception, SystemExit) as error:  # the user's function: whatever it raises is told in this sample's row
                after(start + i)
                rows.refuse(i, error)
                continue
            after(start + i)
            rows.put(i, result)

    def _batches(self, rows: KeptRows, start: int, columns: Columns, draws: bool, after: _After) -> None:
        """`BATCH` samples by one call; where that raises, each of them by a call of its own."""
        n = len(next(iter(columns.values())))

        def put(i: int, j: int) -> BaseException | None:
            given: dict[str, Any] = {name: _part(values, i, j) for name, values in columns.items()}
            if draws:
                given["rng"] = np.random.default_rng(self.seed_of(start + i))
            try:
                result = self.function(**given)
            except (Exception, SystemExit) as error:
                if j > i + 1:  # each sample alone warns again
                    after.caught.clear()
                after(start + i)
                return error
            after(start + i)
            return rows.put_batch(i, j, result)

        for i in range(0, n, BATCH):
            j = min(i + BATCH, n)
            if (together := put(i, j)) is None:
                continue
            alone = {k: together if j == i + 1 else _alone(put, k) for k in range(i, j)}
            failed = {k: error for k, error in alone.items() if error is not None}
            where = words_of(start + i, start + j)
            for k, error in failed.items():  # where all fail, the function may not be made for arrays of length one
                same = len(failed) < j - i or text_of(error) == text_of(together)
                rows.refuse(k, error, "" if same else f" ({where} in one call: {text_of(together)})")

    def seed_of(self, i: int) -> np.random.SeedSequence:
        """The seed of sample i: child i of `SeedSequence(seed).spawn`, whatever the chunks.

        A batch has that of its first sample; a sample that is computed again alone, because its batch raised, its own.
        """
        return np.random.SeedSequence(self.seed, spawn_key=(i,))


def _part(values: Sequence[Any] | Array, i: int, j: int) -> Sequence[Any] | Array:
    """Values i to j, which the function may change: samples are computed again alone from what they were."""
    return values[i:j].copy() if isinstance(values, np.ndarray) else values[i:j]


def _alone(put: Callable[[int, int], BaseException | None], k: int) -> BaseException | None:
    """What a batched function raised for one sample alone, or why what it returned cannot be kept."""
    try:
        return put(k, k + 1)
    except InputError as error:
        if isinstance(error.__context__, NotKept):  # as of a function that drops axes of length one
            return error
        raise


class _After:
    """What is done after each call: count its warnings, and look whether the study is to end."""

    def __init__(self, told: Told, caught: list[Any], check: Callable[[], None]) -> None:
        self.told, self.caught, self.check = told, caught, check

    def __call__(self, i: int) -> None:
        if self.caught:
            self.told.add(i, self.caught)
            self.caught.clear()
        self.check()
