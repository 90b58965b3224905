"""`Evaluation`: a function, checked against its arguments, with what is kept of its results; evaluates chunks anywhere."""

from __future__ import annotations

import inspect
import sys
import time
import warnings
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from typing import Any, TypeAlias

import numpy as np

from rbd.arrays import Array
from rbd.errors import InputError, nearest
from rbd.errors.warned import StudyWarning, stacklevel_of_user
from rbd.model.data_pool import RenewedLock
from rbd.studies.outputs.fields import Block, NotKept
from rbd.studies.outputs.layout import words_of
from rbd.studies.outputs.output_selection import Keep, KeptRows, text_of
from rbd.studies.sampling.samples import RESERVED, Samples, arguments

WarningKind = tuple[str, str]
"""Module and name of the class of a warning: the class itself may be unknown in another process."""


@dataclass(eq=False)
class Told:
    """Warnings by their kind.

    Attributes:
        counts: {kind: number of samples that gave such a warning}; of a batched function, of calls.
        first: {kind: number of the first of these samples}.
        texts: {kind: its message}.
    """

    counts: dict[WarningKind, int] = field(default_factory=dict)
    first: dict[WarningKind, int] = field(default_factory=dict)
    texts: dict[WarningKind, str] = field(default_factory=dict)

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

    def _count(self, kind: WarningKind, n: int, i: int, text: str) -> None:
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


def bound(function: Callable[..., Any], samples: Samples) -> Callable[..., Any]:
    """The function with the arguments that are the same in all samples, after a check of all names.

    Args:
        function: What is called with each sample.
        samples: The samples.

    Returns:
        A function of `samples.columns(...)`, and of `rng` if it has that parameter: sent once to each worker, with the robots
        that are fixed.

    Raises:
        InputError: as of `check_call`.
    """
    check_call(function, samples.names, [each.name for each in samples.shown])
    fixed = samples.fixed
    return partial(function, **fixed) if fixed else function


def check_call(function: object, names: Iterable[str], shown: Collection[str] = ()) -> None:
    """Refuse a function that cannot be called with these arguments by name.

    Args:
        function: Any callable: a function, method, partial, class, or object with `__call__`. Of builtins without a signature
            nothing is checked.
        names: The arguments that samples have; `rng` need not be among them.
        shown: Coordinates that they have, which are no arguments.

    Raises:
        InputError: no callable; a partial that does not fit; arguments that it lacks, with the nearest of its own; parameters
            without a value; parameters that cannot be given by name; names that datasets of studies have.
    """
    if not callable(function):
        raise InputError(
            f"function is {function!r:.80}; expected a function, which is called with each sample: study(f, samples)."
        )
    called, given = name_of(function), list(names)
    if inspect.iscoroutinefunction(function) or inspect.iscoroutinefunction(type(function).__call__):
        raise InputError(f"{called} is an async function; give a plain one, which returns its result.")
    if inspect.isgeneratorfunction(function):
        raise InputError(f"{called} is a generator; give a plain function, which returns its result.")
    if taken := [name for name in given if name in RESERVED]:
        told = "Rename the parameter, or wrap the function"
        raise InputError(f"an argument has the name {taken[0]!r}, which every dataset of a study has for itself. {told}.")
    parameters = parameters_of(function)
    if parameters is None:
        if isinstance(function, partial) and parameters_of(function.func) is not None:
            named = [f"{name}={x!r:.40}" for name, x in function.keywords.items()]
            told = ", ".join([*(f"{x!r:.40}" for x in function.args), *named])
            raise InputError(f"{called} cannot be called with what its functools.partial gives it: {told:.200}.")
        return
    by_name = [p.name for p in parameters if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY)]
    hidden = [p.name for p in parameters if p.kind is p.POSITIONAL_ONLY]
    if not any(p.kind is p.VAR_KEYWORD for p in parameters):
        for name in given:
            if name in by_name:
                continue
            if name in hidden:
                raise InputError(f"{called} takes {name!r} by position only; samples give it by name. Remove the '/' after it.")
            known = nearest(name, by_name) if by_name else "it has none"
            raise InputError(f"{called} has no parameter {name!r:.80}, which the samples give; {known}.")
    needed = [p for p in parameters if p.default is p.empty and p.kind not in (p.VAR_POSITIONAL, p.VAR_KEYWORD)]
    missing = [p.name for p in needed if p.name not in given and not (p.name == "rng" and p.name in by_name)]
    if missing:
        if both := [name for name in missing if name in shown]:
            told = f"it is a coordinate only: dict(dataset.data_vars, {both[0]}=dataset.{both[0]}) gives it as an argument"
            raise InputError(f"{called} needs {both[0]}, which the samples do not give; {told}.")
        told = f"add them to the samples (one value is the same for all: rbd.grid({missing[0]}=...)), or give them defaults"
        raise InputError(f"{called} needs {', '.join(missing)}, which the samples do not give; {told}.")


def takes_rng(function: Callable[..., Any]) -> bool:
    """Whether the function has a parameter `rng`, by name, that no `functools.partial` has given already."""
    inner: Any = function
    while isinstance(inner, partial):
        if "rng" in inner.keywords:
            return False
        inner = inner.func
    own = [p for p in parameters_of(function) or [] if p.name == "rng"]
    return bool(own) and own[0].kind in (own[0].POSITIONAL_OR_KEYWORD, own[0].KEYWORD_ONLY)


def parameters_of(function: Callable[..., Any]) -> list[inspect.Parameter] | None:
    """The parameters of a callable; None of a builtin that has no signature."""
    try:
        return list(inspect.signature(function).parameters.values())
    except (ValueError, TypeError):
        return None


def name_of(function: object) -> str:
    """The name of a callable, of what a partial calls, or of its class."""
    while isinstance(function, partial):
        function = function.func
    return str(getattr(function, "__qualname__", type(function).__qualname__))
