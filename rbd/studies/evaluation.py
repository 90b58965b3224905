"""`Evaluation`: a function, checked against its arguments, with what is kept of its results; evaluates chunks anywhere."""

from __future__ import annotations

import inspect
import sys
import time
import warnings
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, TypeAlias

import numpy as np

from rbd.arrays import Array
from rbd.errors import InputError, nearest
from rbd.errors.warned import StudyWarning, stacklevel_of_user
from rbd.model.content_hash import name_of
from rbd.model.data_pool import RenewedLock
from rbd.studies.results import Block, KeptRows, NotKept, OutputSelection, text_of, words_of
from rbd.studies.samples import RESERVED, Samples, arguments

BATCH = 512
"""Samples that a batched function gets at a time: as many as `solve_many` puts in a block, whatever the chunk."""
Columns: TypeAlias = Mapping[str, Sequence[Any] | Array]
"""{argument: values of some samples}, of one length."""
ONE_AT_A_TIME = RenewedLock()
"""Held during an evaluation: the filters of warnings are those of the whole process, and user's functions may not be safe."""


@dataclass(eq=False)
class WarningCounts:
    """Warnings by their kind: module and name of the class, which may be unknown in another process.

    Attributes:
        found: {kind: (number of samples that gave such a warning, of a batched function of calls; the first of these samples;
            the message there)}.
    """

    found: dict[tuple[str, str], tuple[int, int, str]] = field(default_factory=dict)

    def add(self, kind: tuple[str, str], n: int, first: int, text: str) -> None:
        """Count warnings; whatever the order of the chunks, the message of the first sample is told."""
        before, earliest, told = self.found.get(kind, (0, first + 1, ""))
        self.found[kind] = (before + n, *((first, text) if first < earliest else (earliest, told)))

    def warn(self, total: int) -> None:
        """Issue one warning for each kind, of the kind's own class where it is known here.

        Args:
            total: Number of all samples.
        """
        for (module, name), (n, first, text) in sorted(self.found.items()):
            category = getattr(sys.modules.get(module), name, None)
            known = isinstance(category, type) and issubclass(category, Warning)
            where = f"sample {first:,}" if n == 1 else f"{n:,} of {total:,} calls warn so, the first of them sample {first:,}"
            told = f"{'' if known else f'{name}: '}{text} [{where}]"
            warnings.warn(told, category if known and category else StudyWarning, stacklevel=stacklevel_of_user())


@dataclass(frozen=True, eq=False)
class Finished:
    """The results of a chunk, and what is told of it.

    Attributes:
        block: The results.
        seconds: How long it took [s].
        warned: The warnings of the function, counted.
    """

    block: Block
    seconds: float
    warned: WarningCounts


@dataclass(frozen=True, eq=False)
class Evaluation:
    """What is computed for each sample, and what is kept of it; it is sent to the workers once.

    Attributes:
        function: Called with the arguments of a sample; `rng=` a Generator of the sample, where it has such a parameter.
        keep: What is kept.
        seed: Root of the seeds of all samples: sample i has child i of `SeedSequence(seed).spawn`, a batch that of its first
            sample; a sample that is computed again alone, because its batch raised, its own.
        batched: Whether the function takes arrays over samples, `BATCH` at a time.
    """

    function: Callable[..., Any]
    keep: OutputSelection = field(default_factory=partial(OutputSelection, None))
    seed: int = 0
    batched: bool = False

    def run(self, start: int, columns: Columns, *, check: Callable[[], None] = lambda: None) -> Finished:
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
        began, n, counts = time.perf_counter(), len(next(iter(columns.values()))), WarningCounts()
        rows = KeptRows(n, self.keep, first=start, arguments=tuple(columns))
        draws = "rng" not in columns and takes_rng(self.function)

        def call(i: int, j: int, given: dict[str, Any]) -> BaseException | None:
            """Samples i to j by one call: what it raised."""
            error: BaseException | None = None
            if draws:
                given["rng"] = np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=(start + i,)))
            try:
                result = self.function(**given)
            except (Exception, SystemExit) as raised:  # the user's function: whatever it raises is told in this sample's row
                error = raised
            if caught:
                if error is None or j == i + 1:  # else each sample alone warns again
                    texts = {(w.category.__module__, w.category.__qualname__): str(w.message) for w in reversed(caught)}
                    for kind, text in texts.items():
                        counts.add(kind, 1, start + i, text)
                caught.clear()
            check()
            return rows.put(i, result, j - i if self.batched else None) if error is None else error

        def alone(k: int) -> BaseException | None:
            try:
                return call(k, k + 1, _parts(columns, k, k + 1))
            except NotKept as error:  # as of a function that drops axes of length one
                return error

        # all warnings are counted, and none is shown, whatever filters are set: those are of the whole process
        recorded = warnings.catch_warnings(record=True, action="always")
        with ONE_AT_A_TIME, recorded as caught, np.errstate(divide="warn", over="warn", under="ignore", invalid="warn"):
            if not self.batched:
                for i, given in enumerate(arguments(columns)):
                    if (error := call(i, i + 1, given)) is not None:
                        rows.refuse(i, error)
            for i in range(0, n if self.batched else 0, BATCH):
                j = min(i + BATCH, n)
                if (together := call(i, j, _parts(columns, i, j))) is None:
                    continue
                failed = {k: e for k in range(i, j) if (e := together if j == i + 1 else alone(k)) is not None}
                for k, error in failed.items():  # where all fail, the function may not be made for arrays of length one
                    same = len(failed) < j - i or text_of(error) == text_of(together)
                    where = words_of(start + i, start + j)
                    rows.refuse(k, error, "" if same else f" ({where} in one call: {text_of(together)})")
        return Finished(rows.block(), time.perf_counter() - began, counts)


def _parts(columns: Columns, i: int, j: int) -> dict[str, Any]:
    """Values i to j, which the function may change: samples are computed again alone from what they were."""
    return {name: x[i:j].copy() if isinstance(x, np.ndarray) else x[i:j] for name, x in columns.items()}


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
    check_call(function, samples.names)
    fixed = samples.fixed
    return partial(function, **fixed) if fixed else function


def check_call(function: object, names: Collection[str]) -> None:
    """Refuse a function that cannot be called with these arguments by name.

    Args:
        function: Any callable: a function, method, partial, class, or object with `__call__`. Of builtins without a signature
            nothing is checked.
        names: The arguments that samples have; `rng` need not be among them.

    Raises:
        InputError: no callable; a partial that does not fit; arguments that it lacks, with the nearest of its own; parameters
            without a value; parameters that cannot be given by name; names that datasets of studies have.
    """
    if not callable(function):
        raise InputError(
            f"function is {function!r:.80}; expected a function, which is called with each sample: study(f, samples)."
        )
    called = name_of(function).partition(".")[2]
    for what, is_one in (("an async function", inspect.iscoroutinefunction), ("a generator", inspect.isgeneratorfunction)):
        if is_one(function) or is_one(type(function).__call__):
            raise InputError(f"{called} is {what}; give a plain function, which returns its result.")
    if taken := [name for name in names if name in RESERVED]:
        raise InputError(
            f"an argument has the name {taken[0]!r}, which every dataset of a study has for itself. Rename the parameter, or "
            "wrap the function."
        )
    try:
        parameters = inspect.signature(function).parameters.values()
    except ValueError as error:  # of a builtin that has none, or of a partial that does not fit
        if isinstance(function, partial) and str(error):
            raise InputError(f"{called} cannot be called with what functools.partial gives it: {function!r:.300}.") from None
        return
    by_name = [p.name for p in parameters if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY)]
    unknown = [] if any(p.kind is p.VAR_KEYWORD for p in parameters) else [name for name in names if name not in by_name]
    if unknown and any(p.name == unknown[0] for p in parameters):
        raise InputError(f"{called} takes {unknown[0]!r} by position only; samples give it by name. Remove the '/' after it.")
    if unknown:
        known = nearest(unknown[0], by_name) if by_name else "it has none"
        raise InputError(f"{called} has no parameter {unknown[0]!r:.80}, which the samples give; {known}.")
    needed = [p.name for p in parameters if p.default is p.empty and p.kind not in (p.VAR_POSITIONAL, p.VAR_KEYWORD)]
    missing = [name for name in needed if name not in names and not (name == "rng" and name in by_name)]
    if missing:
        raise InputError(
            f"{called} needs {', '.join(missing)}, which the samples do not give; add them to the samples (one value is the "
            f"same for all: rbd.grid({missing[0]}=...)), or give them defaults."
        )


def takes_rng(function: Callable[..., Any]) -> bool:
    """Whether the function has a parameter `rng`, by name, that no `functools.partial` has given already."""
    try:
        own = inspect.signature(function).parameters.get("rng")
    except ValueError:
        return False
    by_name = own is not None and own.kind in (own.POSITIONAL_OR_KEYWORD, own.KEYWORD_ONLY)
    while isinstance(function, partial):
        by_name, function = by_name and "rng" not in function.keywords, function.func
    return by_name
