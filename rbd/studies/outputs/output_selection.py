"""`OutputSelection`, the argument `keep` of a study, checked; `KeptRows`, what it picks of the samples of a chunk."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np

from rbd.arrays import Array
from rbd.errors import InputError, RbdError, nearest
from rbd.errors.reasons import Reason
from rbd.records import Field, Named, Variable
from rbd.studies.outputs.fields import (
    WANTED,
    Block,
    NotKept,
    is_of_many,
    kind_of,
    mapping_of,
    missing,
    own_variables,
    storable,
    variable_of,
)
from rbd.studies.outputs.layout import RESERVED, Layout, described, words_of

Function: TypeAlias = Callable[[Any], Any]
Verdict: TypeAlias = tuple[Reason, str] | None
"""Why a result is no answer, and its message; None where it is one."""
Rows: TypeAlias = tuple[Array, Mapping[int, str]]
"""Of a result with n rows: `Reason.code` of each, shape (n,), 0 where there is an answer; {row: message} of the others."""
Keep: TypeAlias = Sequence[str | Mapping[str, Function]] | Mapping[str, Function] | None
"""What `rbd.study` takes: names; {name: function of a result}; or names and such mappings; None: the defaults."""


class OutputSelection:
    """What is kept of a result: names that its type knows, and functions of it.

    Args:
        keep: As of `rbd.study`.

    Attributes:
        names: Names that are kept; None: the defaults of each type.
        functions: {name: function of a result}.

    Raises:
        InputError: neither names nor functions by name, or one name twice.
    """

    def __init__(self, keep: Keep) -> None:
        self.names: tuple[str, ...] | None = None
        self.functions: dict[str, Function] = {}
        self._chosen: dict[type, tuple[tuple[Field, ...], tuple[Field, ...]]] = {}
        if keep is None:
            return
        if isinstance(keep, str) or not isinstance(keep, Sequence | Mapping):
            example = f"({keep!r:.40},)" if isinstance(keep, str) else "('status', 'forces')"
            raise InputError(f"keep is {keep!r:.80}; expected names, e.g. keep={example}, or {{name: function of a result}}.")
        names: list[str] = []
        for entry in [keep] if isinstance(keep, Mapping) else keep:
            if isinstance(entry, Mapping):
                for name, function in entry.items():
                    _check_function(name, function)
                    names.append(name)
                    self.functions[name] = function
            elif isinstance(entry, str):
                names.append(entry)
            else:
                raise InputError(f"keep has the entry {entry!r:.80}; expected a name, or {{name: function of a result}}.")
        twice = [name for name in names if names.count(name) > 1]
        if twice:
            raise InputError(f"keep names {twice[0]!r:.80} twice.")
        self.names = tuple(name for name in names if name not in self.functions)

    def of_one(self, result: Any) -> tuple[list[Named], Verdict]:
        """What is kept of one sample's result, and why it is no answer, where it is none.

        Raises:
            NotKept: a result, or a name of `keep`, that cannot be kept.
            Exception: what a function of `keep` raises.
        """
        kind: type = type(result)
        verdict: Verdict = None
        if not kind_of(kind):
            found, verdict = self._plain(result, None)
        elif is_of_many(result):
            raise NotKept(f"the function returned {_told(result)}, of many states. Set batched=True, or return one of them")
        else:
            verdict = getattr(result, "no_answer", None)
            found = [named for line in self._of_kind(kind)[verdict is not None] for named in line.variables(result)]
        if verdict is None:
            for name, function in self.functions.items():
                found += _named(name, function(result), None)[0]
        return found, verdict

    def of_batch(self, result: Any, n: int) -> tuple[list[Named], Rows]:
        """What is kept of a batched function's result, with one row a sample, and which rows are no answers.

        Raises:
            NotKept: a result, or a name of `keep`, that cannot be kept.
            Exception: what a function of `keep` raises.
        """
        kind: type = type(result)
        if not kind_of(kind):
            found, rows = self._plain_batch(result, n)
        elif not is_of_many(result):
            raise NotKept(
                f"the batched function returned {_told(result)}, of one sample; expected one row a sample: what rbd.solve_many "
                "returns, or arrays by name. Leave batched=True out where the function takes one sample"
            )
        else:
            if len(result) != n:
                raise NotKept(f"the batched function returned {len(result)} states for {n} samples; expected one a sample")
            rows = result.reason_codes, result.reasons
            found = [named for line in self._of_kind(kind)[0] for named in line.variables(result)]
        for name, function in self.functions.items():
            found += _named_batch(name, function(result), n)[0]
        return found, rows

    def _of_kind(self, kind: type) -> tuple[tuple[Field, ...], tuple[Field, ...]]:
        """(what is kept of an answer, what is kept where there is none): certificates first."""
        chosen = self._chosen.get(kind)
        if chosen is None:
            table = {line.name: line for line in kind_of(kind)}
            for name in self.names or ():
                if name not in table:
                    raise NotKept(f"keep names {name!r:.80}, which {kind.__name__} has not; {nearest(name, table)}")
            lines = _chosen(kind, () if self.names is None and self.functions else self.names)
            chosen = self._chosen[kind] = lines, _proof(lines)
        return chosen

    def _picked(self, result: Any) -> Iterable[tuple[Any, Any, tuple[str, ...] | None]]:
        """A result that is no record of rbd: the name and value of each that is kept, and what is kept in it; None: all."""
        found = mapping_of(result)
        if found is None:
            if result is None:
                raise NotKept(f"the function returned None; {WANTED}")
            if isinstance(result, tuple):
                raise NotKept(
                    f"the function returned a tuple of {len(result)}; return them by name, e.g. "
                    "{'friction_used': ..., 'torque': ...}"
                )
            found = {"value": result}
        names = self.names
        if self.functions and not names:
            return []
        if names is None:
            return [(name, value, None) for name, value in found.items()]
        if all(name in found for name in names):
            return [(name, found[name], None) for name in names]
        return _within(names, found)

    def _plain(self, result: Any, rows: int | None) -> tuple[list[Named], Verdict]:
        found: list[Named] = []
        verdict: Verdict = None
        for name, value, within in self._picked(result):
            if isinstance(value, float | bool | np.bool_):  # what most functions return, without the looks at other types
                found.append((name, Variable(np.array(value))))
                continue
            inner, told = _named(name, value, rows, within)
            found += inner
            verdict = verdict or told
        return found, verdict

    def _plain_batch(self, result: Any, n: int) -> tuple[list[Named], Rows]:
        found: list[Named] = []
        codes, messages = np.zeros(n, np.int16), dict[int, str]()
        for name, value, within in self._picked(result):
            inner, (own, told) = _named_batch(name, value, n, within)
            found += inner
            if told or own.any():
                codes, messages = np.where(codes, codes, own), {**told, **messages}
        return found, (codes, messages)


def _within(names: Sequence[str], found: Mapping[Any, Any]) -> list[tuple[Any, Any, tuple[str, ...] | None]]:
    """Values that are kept, where some names are `<key>_<name>`: of a record, or a mapping, that stands under a key.

    Raises:
        NotKept: a name that there is not, with the nearest.
    """
    known = {f"{key}_{own}": (key, own) for key, value in found.items() for own in _names_in(value)}
    chosen: dict[Any, tuple[str, ...]] = {}
    for name in names:
        if name not in found and name not in known:
            told = nearest(name, [*map(str, found), *known])
            raise NotKept(f"keep names {name!r:.80}, which the function did not return; {told}")
        key, own = (name, ()) if name in found else (known[name][0], known[name][1:])
        more = tuple(_names_in(found[key], defaults=True)) if name in found else own
        chosen[key] = tuple(dict.fromkeys((*chosen.get(key, ()), *more)))
    return [(key, found[key], within) for key, within in chosen.items()]


def _names_in(value: Any, *, defaults: bool = False) -> Iterable[str]:
    """Names of what can be kept in a value: of a record, or of a mapping; all, or those that are kept where nothing is said."""
    kind: type = type(value)
    if lines := kind_of(kind):
        return [line.name for line in lines if line.default or not defaults]
    return [str(own) for own in mapping_of(value) or ()]


def _named(name: str, value: Any, rows: int | None, within: tuple[str, ...] | None = None) -> tuple[list[Named], Verdict]:
    """A value by name; of a record of rbd or a mapping its own variables, those of `within`, with the name in front."""
    kind: type = type(value)
    if kind_of(kind):
        if is_of_many(value):
            raise NotKept(f"{name!r:.80} is {_told(value)}, of many states. Set batched=True, or return one of them")
        verdict: Verdict = getattr(value, "no_answer", None)
        lines = _chosen(kind, within) if verdict is None else _proof(_chosen(kind, within))
        return [(f"{name}_{own}", x) for line in lines for own, x in line.variables(value)], verdict
    inner = mapping_of(value)
    if inner is None:
        variable = variable_of(name, value, rows)
        return ([] if variable is None else [(name, variable)]), None
    pairs = [
        (f"{name}_{own}", variable_of(f"{name}_{own}", x, rows)) for own, x in inner.items() if within is None or own in within
    ]
    return [(own, x) for own, x in pairs if x is not None], None


def _named_batch(name: str, value: Any, n: int, within: tuple[str, ...] | None = None) -> tuple[list[Named], Rows]:
    kind: type = type(value)
    if not kind_of(kind):
        return _named(name, value, n, within)[0], (np.zeros(n, np.int16), {})
    if not is_of_many(value) or len(value) != n:
        raise NotKept(f"{name!r:.80} is {_told(value)}; expected one row a sample: {n}")
    found = [(f"{name}_{own}", x) for line in _chosen(kind, within) for own, x in line.variables(value)]
    return found, (value.reason_codes, value.reasons)


def _chosen(kind: type, names: Collection[str] | None) -> tuple[Field, ...]:
    """What is kept of a record: certificates, then what is named, in that order; None: the defaults."""
    lines = kind_of(kind)
    if names is None:
        return tuple(line for line in lines if line.default)
    table = {line.name: line for line in lines}
    certificates = [line.name for line in lines if line.certificate]
    return tuple(table[name] for name in dict.fromkeys([*certificates, *names]))


def _proof(lines: Iterable[Field]) -> tuple[Field, ...]:
    """What is kept of a record that is no answer."""
    return tuple(line for line in lines if line.certificate or line.name == "residuals")


def _check_function(name: object, function: object) -> None:
    if not isinstance(name, str) or not name.isidentifier() or name in RESERVED:
        raise InputError(f"keep has the name {name!r:.80}; expected letters, digits and _, and none of {', '.join(RESERVED)}.")
    if not callable(function):
        raise InputError(
            f"keep[{name!r}] is {function!r:.80}; expected a function of a result, e.g. {{{name!r}: lambda held: "
            "held.residuals.worst}. Names stand beside such a mapping: keep=('forces', {...})."
        )


def _told(value: Any) -> str:
    kind = type(value).__name__
    return f"{'an' if kind[:1] in 'AEIOU' else 'a'} {kind}"


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

    def __init__(self, n: int, keep: Keep | OutputSelection, *, first: int = 0, arguments: Collection[str] = ()) -> None:
        self.n, self._start = n, first
        self._wanted = keep if isinstance(keep, OutputSelection) else OutputSelection(keep)
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
