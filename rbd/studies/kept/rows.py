"""`KeptRows`: what is kept of the samples of a chunk, filled sample by sample or batch by batch."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import Any

import numpy as np

from rbd.answers.many.naming import Named, Variable
from rbd.arrays import Array
from rbd.errors import InputError, RbdError
from rbd.errors.reasons import Reason
from rbd.studies.kept.layout import Layout, described, words_of
from rbd.studies.kept.plain import NotKept
from rbd.studies.kept.variable import Block, missing, own_variables, storable
from rbd.studies.kept.wanted import Keep, Wanted

LONGEST_MESSAGE = 1000
"""Characters of a message that are kept."""


class KeptRows:
    """What is kept of n consecutive samples.

    Args:
        n: How many they are.
        keep: What is kept; as of `rbd.study`.
        first: Number of the first one.
        arguments: Names of the samples' arguments, which no variable may have.

    Raises:
        InputError: `keep` is neither names nor functions by name.
    """

    def __init__(self, n: int, keep: Keep | Wanted, *, first: int = 0, arguments: Collection[str] = ()) -> None:
        self.n, self._start = n, first
        self._wanted = keep if isinstance(keep, Wanted) else Wanted(keep)
        self._layout = Layout(arguments)
        self._columns: dict[str, _Column] = {}
        self._ok, self._reason = np.zeros(n, bool), np.full(n, Reason.NOT_RUN.code, np.int16)
        self._messages = np.full(n, "", object)

    def put(self, i: int, result: Any) -> None:
        """Keep the result of one sample.

        Args:
            i: Which one, from 0 within the chunk.
            result: What the function returned.

        Raises:
            InputError: what cannot be kept: it ends the study. Names the sample.
        """
        try:
            found, verdict = self._wanted.of_one(result)
        except NotKept as told:
            raise InputError(f"{self._sample(i)}: {told}.") from None
        except (Exception, SystemExit) as error:  # of a function of `keep`, or of a quantity that this result has not
            self.refuse(i, error)
            return
        columns = self._columns
        for name, variable in found:
            column = columns.get(name)
            if column is None or not column.fits(variable):
                column = self._column(name, variable, variable.values.shape, self._sample(i))
            column.values[i] = variable.values if column.dims else variable.values.item()
        if len(found) > 1:
            self._refuse_twice(found, self._sample(i))
        if verdict is None:
            self._ok[i], self._reason[i] = True, 0
        else:
            self._no_answer(i, *verdict)

    def put_batch(self, start: int, stop: int, result: Any) -> BaseException | None:
        """Keep the result of a batched function: one row a sample.

        Args:
            start: The first of its samples, from 0 within the chunk.
            stop: The one after the last.
            result: What the function returned.

        Returns:
            What a function of `keep` raised, if one did; then nothing is kept.

        Raises:
            InputError: what cannot be kept: it ends the study. Names the samples.
        """
        where = words_of(self._start + start, self._start + stop)
        try:
            found, (codes, messages) = self._wanted.of_batch(result, stop - start)
        except NotKept as told:
            raise InputError(f"{where}: {told}.") from None
        except (Exception, SystemExit) as error:  # of a function of `keep`
            return error
        for name, variable in found:
            column = self._columns.get(name)
            if column is None or not column.fits(variable, 1):
                column = self._column(name, variable, variable.values.shape[1:], where)
            column.values[start:stop] = variable.values
        self._refuse_twice(found, where)
        self._reason[start:stop] = codes
        self._ok[start:stop] = codes == 0
        for row, message in messages.items():  # the number of a state is that within the batch
            self._messages[start + row] = _shortened(message.removeprefix(f"at state {row}: "))
        return None

    def refuse(self, i: int, error: BaseException, more: str = "") -> None:
        """Sample i has no result, for an error's reason.

        Args:
            i: Which one, from 0 within the chunk.
            error: What the function raised.
            more: Stands behind the error's text in the message.
        """
        self._no_answer(i, Reason.of(error), text_of(error) + more)

    def block(self) -> Block:
        """All that was kept; samples that were not put have `Reason.NOT_RUN`."""
        own = own_variables(self._ok, self._reason, self._messages)
        found = {name: column.variable() for name, column in self._columns.items()}
        return Block(np.arange(self._start, self._start + self.n), own | found)

    def _no_answer(self, i: int, reason: Reason, message: str) -> None:
        self._ok[i], self._reason[i] = False, reason.code
        self._messages[i] = _shortened(message)

    def _column(self, name: str, variable: Variable, shape: tuple[int, ...], where: str) -> _Column:
        self._layout.agree(name, variable, shape, where)
        return self._columns.setdefault(name, _Column(self.n, variable, shape))

    def _refuse_twice(self, found: list[Named], where: str) -> None:
        names = {name for name, _ in found}
        if len(names) == len(found):
            return
        twice = described({name: 0 for name, _ in found if sum(name == other for other, _ in found) > 1})
        raise InputError(
            f"{where}: two values would have the name {twice}. Give contacts names that differ in letters and digits, and "
            "values names of their own."
        )

    def _sample(self, i: int) -> str:
        return words_of(self._start + i, self._start + i + 1)


def text_of(error: BaseException) -> str:
    """The text of an error with its notes; in front of it the name of its class, if that is no class of rbd."""
    name = type(error).__name__
    try:
        text = "\n".join([str(error), *map(str, getattr(error, "__notes__", ()))]).strip()
    except Exception:  # the class may be the user's
        text = "its text cannot be read"
    return text if isinstance(error, RbdError) else f"{name}: {text}" if text else name


def _shortened(message: str) -> str:
    return storable(message if len(message) <= LONGEST_MESSAGE else f"{message[: LONGEST_MESSAGE - 4]} ...")


class _Column:
    """The values of one variable, of all samples."""

    def __init__(self, n: int, variable: Variable, shape: tuple[int, ...]) -> None:
        own = variable.values.dtype
        self._kind = own.kind
        kind = np.dtype(object) if own.kind == "U" else own  # text of any length, until all of it is known
        self.values: Array = np.full((n, *shape), missing(own), kind)
        self.dims, self._labels, self._shape, self._about = variable.dims, variable.labels, shape, variable

    def fits(self, variable: Variable, skip: int = 0) -> bool:
        """Whether a variable is plainly of the same layout; where this is False, a closer look is needed."""
        values = variable.values
        return (
            (variable.labels is self._labels or variable.labels == self._labels)
            and variable.dims == self.dims
            and values.shape[skip:] == self._shape
            and values.dtype.kind == self._kind
            and variable.units == self._about.units
        )

    def variable(self) -> Variable:
        """With the values of all samples."""
        return replace(self._about, values=self.values.astype(str) if self._kind == "U" else self.values)
