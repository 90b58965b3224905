"""What a study keeps of results: `keep` checked, values as variables, rows of a chunk as a block, and whether blocks agree."""

from __future__ import annotations

import numbers
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from enum import IntEnum
from functools import cache
from typing import Any, TypeAlias

import numpy as np

from rbd.arrays import Array
from rbd.errors import InputError, RbdError, nearest
from rbd.errors.reasons import Reason
from rbd.records import Field, Named, Variable
from rbd.studies.provenance import storable
from rbd.studies.samples import OWN, RESERVED

Function: TypeAlias = Callable[[Any], Any]
Keep: TypeAlias = Sequence[str | Mapping[str, Function]] | Mapping[str, Function] | None
"""What `rbd.study` takes: names; {name: function of a result}; or names and such mappings; None: the defaults."""
Rows: TypeAlias = tuple[Array, Mapping[int, str]]
"""Of n rows: `Reason.code` of each, shape (n,), 0 where there is an answer; {row: message} of the others."""
OK, REASON, MESSAGE = OWN
"""Variables that every study has."""
LONGEST_MESSAGE = 1000
"""Characters of a message that are kept."""
WANTED = "expected numbers, truth values, text, arrays, records of rbd, or a mapping of these by name, as {'height': 0.3}"
_EXACT = 2**53
"""Whole numbers up to this are exact as float64, which numbers are kept as."""
_KINDS = {"f": "numbers", "b": "truth values", "i": "codes", "U": "text"}
_MISSING: dict[str, Any] = {"f": np.nan, "i": -1, "b": False, "U": ""}
"""{kind of a variable: what stands where a sample has no value}."""


class NotKept(InputError):
    """What a function returned cannot be kept: it ends the study."""


@dataclass(frozen=True, eq=False)
class Block:
    """Results of some samples.

    Attributes:
        numbers: Those of the samples, shape (n,).
        variables: {name: values of all of them}: numbers (float64), truth values, codes or text. Every block has `ok`, which
            samples have a result; `reason`, a code, 0 where there is one; and `message`.
    """

    numbers: Array
    variables: Mapping[str, Variable]

    @property
    def ok(self) -> Array:
        """Which samples have a result."""
        return self.variables[OK].values


def empty_of(v: Variable, shape: tuple[int, ...], n: int) -> Variable:
    """A variable of n samples that were not computed; text as objects, of any length."""
    kind = _kind(v.values.dtype)
    return replace(v, values=np.full((n, *shape), _MISSING[kind], object if kind == "U" else v.values.dtype))


def own_variables(n: int) -> dict[str, Variable]:
    """`ok`, `reason` and `message` of n samples that were not computed; the codes as the CF conventions have them."""
    codes = {reason.code: reason.name.lower() for reason in Reason}
    return {
        OK: Variable(np.zeros(n, bool), long_name="whether there is a result"),
        REASON: Variable(np.full(n, Reason.NOT_RUN.code, np.int16), long_name="why there is none", flags=codes),
        MESSAGE: Variable(np.full(n, "", object), long_name="message of the error"),
    }


def joined(numbers: Array, blocks: Iterable[Block], forms: Mapping[str, Variable]) -> Block:
    """What blocks have of some samples, as one block.

    Args:
        numbers: Those of the samples, ascending.
        blocks: The blocks, in any order.
        forms: The variables in order, besides `ok`, `reason`, `message`.
    """
    n = len(numbers)
    found = own_variables(n) | {name: empty_of(v, v.values.shape[1:], n) for name, v in forms.items()}
    for block in blocks:
        at = np.searchsorted(numbers, block.numbers)
        inside = (at < n) & (numbers[np.minimum(at, n - 1)] == block.numbers)
        for name, v in block.variables.items():
            found[name].values[at[inside]] = v.values[inside]
    return Block(numbers, found)


@cache
def table_of(kind: type) -> dict[str, Field]:
    """{name: field} of a type of records, of which a study keeps fields by name; empty of other types."""
    own = getattr(kind, "fields", ())
    lines = own if isinstance(own, tuple) and all(isinstance(line, Field) for line in own) else ()
    return {line.name: line for line in lines}


def is_of_many(record: object) -> bool:
    """Whether a record is of many states: it has `reason_codes` and `reasons`, of each."""
    return hasattr(record, "reason_codes") and hasattr(record, "reasons")


def kept_names(result: type) -> dict[str, str]:
    """What `keep` of `rbd.study` may name of a type of results: {name: what it is}; see `rbd.study`.

    Args:
        result: A class that a study's function may return, e.g. `rbd.Solution`.

    Raises:
        InputError: no class, or one without a table of fields. Of those a function returns the numbers that count, by name.

    Example:
        >>> list(rbd.studies.kept_names(rbd.statics.SupportRegion))
        ['residual', 'area', 'empty', 'bounded', 'cut', 'inscribed_radius', 'com_distance', 'area_gap']
        >>> rbd.studies.kept_names(rbd.Actuation)["worst_torque"]
        'largest share of a motor limit that is used'
    """
    table = table_of(result) if isinstance(result, type) else {}
    if not table:
        raise InputError(
            f"{result!r:.80} is no type of which a study keeps something by name; these have a table `fields`, such as "
            "rbd.Solution, rbd.Actuation, rbd.Trajectory. A function may return numbers and arrays by name, too: "
            "{'height': 0.3}."
        )
    return {name: line.meaning for name, line in table.items()}


def mapping_of(result: Any) -> Mapping[Any, Any] | None:
    """A result as values by name: of a mapping, a dataclass, a named tuple, an xarray.Dataset; None of others."""
    if type(result) is dict or isinstance(result, Mapping):  # the first is found faster
        return {name: result[name] for name in result.data_vars} if hasattr(result, "data_vars") else result
    names = getattr(result, "_fields", ()) if isinstance(result, tuple) else ()
    if is_dataclass(result) and not isinstance(result, type):
        names = [field.name for field in fields(result)]
    return {name: getattr(result, name) for name in names} or None


def variable_of(name: str, value: Any, rows: int | None) -> Variable:
    """A plain value as a variable.

    Args:
        name: Its name, which its dimensions have too where they have none.
        value: It.
        rows: Of a batched function's value the number of samples along its first axis; None of one sample's.

    Raises:
        NotKept: no plain value, or not one row a sample.
    """
    if isinstance(value, IntEnum) and rows is None:
        return Variable(np.array(int(value), np.int16), flags={int(x): x.name.lower() for x in type(value)})
    given = value if hasattr(value, "dims") and hasattr(value, "coords") else None
    values = _array(name, value if given is None else given.values)
    if rows is not None and (not values.ndim or len(values) != rows):
        raise NotKept(
            f"{name!r:.80} has shape {values.shape} for {rows} samples; a batched function returns arrays with one row a sample"
        )
    inner = values.ndim if rows is None else values.ndim - 1
    if given is None:
        return Variable(values, tuple([f"{name}_{i}" for i in range(inner)]))
    return labelled(given, values, values.ndim - inner)


def labelled(given: Any, values: Array, outer: int) -> Variable:
    """Values with dimensions, labels, unit and meaning of an array of xarray, less its `outer` first dimensions."""
    dims = tuple(map(str, given.dims[outer:]))
    coords = {dim: given.coords[dim].values.tolist() for dim in dims if dim in given.coords}
    labels = {dim: tuple([storable(x) if isinstance(x, str) else x for x in some]) for dim, some in coords.items()}
    units, about, meanings = (storable(str(given.attrs.get(key, ""))) for key in ("units", "long_name", "flag_meanings"))
    flags = zip(given.attrs.get("flag_values", ()), meanings.split(), strict=False)
    return Variable(values, dims, units, about, labels, dict(flags))


def _array(name: str, value: Any) -> Array:
    """Numbers as float64, truth values and text as they are."""
    listed = list(value) if isinstance(value, tuple | list) else [value]
    if any(isinstance(x, np.ma.MaskedArray) for x in listed):
        raise NotKept(f"{name!r:.80} is a masked array; return x.filled(numpy.nan)")
    try:
        plain = isinstance(value, str | bool | int | float | np.ndarray | np.generic | tuple | list)
        found = np.asarray(value if plain else float(value) if isinstance(value, numbers.Real) else None)
    except (ValueError, OverflowError):  # lists of unequal length, numbers without end
        found = np.array(None)
    kind = found.dtype.kind
    if not found.size and kind in "fiubU":
        raise NotKept(f"{name!r:.80} has shape {found.shape}, without entries; leave it out, or return None in its place")
    if kind in "iu" and (found.max() > _EXACT or found.min() < -_EXACT):
        raise NotKept(f"{name!r:.80} has a whole number beyond 2^53, which no float64 is exactly; return it as text")
    if kind == "U" and all(isinstance(x, str | np.ndarray) for x in listed):
        # arrays of NumPy drop a NUL at the end, so that the text as given is read
        texts = list(map(storable, found.flat if isinstance(value, np.ndarray) else listed))
        return np.asarray(texts).reshape(found.shape)
    if kind not in "fiub":
        kinds = type(value).__name__
        told = (
            f"an array of {found.dtype}" if isinstance(value, np.ndarray | np.generic) else f"{_article(kinds)}, {value!r:.60}"
        )
        more = ". Return real and imaginary part by name" if kind == "c" else ""
        raise NotKept(f"{'the function returned' if name == 'value' else f'{name!r:.80} is'} {told}; {WANTED}{more}")
    return found if kind == "b" else found.astype(np.float64, copy=False)


def _article(kind: str) -> str:
    return f"{'an' if kind[:1] in 'aeiouAEIOU' else 'a'} {kind}"


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
        if isinstance(keep, str) or not isinstance(keep, Sequence | Mapping | None):
            example = f"({keep!r:.40},)" if isinstance(keep, str) else "('status', 'forces')"
            raise InputError(f"keep is {keep!r:.80}; expected names, e.g. keep={example}, or {{name: function of a result}}.")
        entries = [keep] if isinstance(keep, Mapping) else list(keep or ())
        if wrong := [x for x in entries if not isinstance(x, str | Mapping)]:
            raise InputError(f"keep has the entry {wrong[0]!r:.80}; expected a name, or {{name: function of a result}}.")
        self.functions: dict[str, Function] = {name: f for x in entries if isinstance(x, Mapping) for name, f in x.items()}
        for name, function in self.functions.items():
            _check_function(name, function)
        names = [name for x in entries for name in ([x] if isinstance(x, str) else x)]
        if twice := [name for name in names if names.count(name) > 1]:
            raise InputError(f"keep names {twice[0]!r:.80} twice.")
        self.names = None if keep is None else tuple(name for name in names if name not in self.functions)

    @property
    def text(self) -> str:
        """The names, for people and stores."""
        return "default" if self.names is None else ", ".join(self.names)

    def of(self, result: Any, rows: int | None) -> tuple[list[Named], Rows | None]:
        """What is kept of a result, and which of its rows are no answers; None: all are.

        Args:
            result: Of one sample, or of a batch.
            rows: The number of samples of a batch; None of one sample.

        Raises:
            NotKept: a result, or a name of `keep`, that cannot be kept.
            Exception: what a function of `keep` raises.
        """
        names = () if self.names is None and self.functions else self.names
        found, refused = _variables_of("", result, rows, names)
        if refused is None or rows is not None:
            for name, function in self.functions.items():
                found += _variables_of(name, function(result), rows)[0]
        return found, refused


def _variables_of(
    name: str, value: Any, rows: int | None, names: Collection[str] | None = None
) -> tuple[list[Named], Rows | None]:
    """The variables of a result, or of a value by name, and which rows are no answers; names of parts have its name in front.

    Args:
        name: Empty of a whole result.
        value: A plain value, a record, or a mapping of these.
        rows: The number of samples of a batch; None of one sample.
        names: Which parts of it; None: all, or what its type says.
    """
    kind: type = type(value)
    if isinstance(value, float | bool | np.bool_) and rows is None and names is None:  # what most functions return
        return [(name or "value", Variable(np.array(value)))], None
    front = f"{name}_" if name else ""
    if table := table_of(kind):
        _check_names(names, table, f"{kind.__name__} has not")
        _check_rows(f"{name!r:.80} is" if name else "the function returned", value, rows)
        found, refused = _of_record(value, table, names, rows)
        return [(f"{front}{own}", x) for own, x in found], refused
    parts = mapping_of(value)
    if parts is None and not name and (value is None or isinstance(value, tuple)):
        several = f"a tuple of {len(value)}; return them by name, e.g. {{'friction_used': ..., 'torque': ...}}" if value else ""
        raise NotKept(f"the function returned {several or f'None; {WANTED}'}")
    if parts is None:
        name, parts, front = name or "value", {name or "value": value}, ""
    if names:
        _check_names(names, parts, "the function did not return")
    found, refused = list[Named](), None
    for key, x in parts.items():
        own: type = type(x)
        if x is None or (names is not None and key not in names):
            continue
        if own is float and rows is None:  # what most values are
            inner = [(f"{front}{key}", Variable(np.array(x)))]
        elif not name and (table_of(own) or mapping_of(x) is not None):  # one level of records and mappings under names
            inner, codes = _variables_of(str(key), x, rows)
            refused = codes if refused is None else refused
        else:
            inner = [(f"{front}{key}", variable_of(f"{front}{key}", x, rows))]
        found += inner
    return found, refused


def _check_names(names: Collection[str] | None, known: Mapping[str, Any], what: str) -> None:
    for name in names or ():
        if name not in known:
            raise NotKept(f"keep names {name!r:.80}, which {what}; {nearest(name, list(map(str, known)))}")


def _of_record(
    record: Any, table: Mapping[str, Field], names: Collection[str] | None, rows: int | None
) -> tuple[list[Named], Rows | None]:
    """Certificates of a record, then what is named, None: the defaults; without an answer its certificate and residuals."""
    certificates = [name for name, line in table.items() if line.certificate]
    defaults = [name for name, line in table.items() if line.default]
    chosen = [table[name] for name in (defaults if names is None else dict.fromkeys([*certificates, *names]))]
    reason, refused = getattr(record, "no_answer", None), None
    if rows is not None:
        refused = record.reason_codes, record.reasons
    elif reason is not None:
        chosen = [line for line in chosen if line.certificate or line.name == "residuals"]
        refused = np.array([reason[0].code]), {0: reason[1]}
    return [each for line in chosen for each in line.variables(record)], refused


def _check_rows(what: str, record: Any, rows: int | None) -> None:
    """Refuse a record of many states for one sample, of one state for many, and of another number of states."""
    told = f"{what} {_article(type(record).__name__)}"
    if rows is None and is_of_many(record):
        raise NotKept(f"{told}, of many states. Set batched=True, or return one of them")
    if rows is not None and not is_of_many(record):
        raise NotKept(
            f"{told}, of one sample; expected one row a sample: what rbd.solve_many returns, or arrays by name. Leave "
            "batched=True out where the function takes one sample"
        )
    if rows is not None and len(record) != rows:
        raise NotKept(f"{told} of {len(record)} states for {rows} samples; expected one a sample")


def _check_function(name: object, function: object) -> None:
    if not isinstance(name, str) or not name.isidentifier() or name in RESERVED:
        raise InputError(f"keep has the name {name!r:.80}; expected letters, digits and _, and none of {', '.join(RESERVED)}.")
    if not callable(function):
        raise InputError(
            f"keep[{name!r}] is {function!r:.80}; expected a function of a result, e.g. {{{name!r}: lambda held: "
            "held.residuals.worst}. Names stand beside such a mapping: keep=('forces', {...})."
        )


_ADVICE = {
    "kind": "Return one kind always.",
    "shape": "Return arrays of one shape, leave it out by keep=(...), or keep numbers of it: keep={'name': function}. Robots "
    "of other sizes are studies of their own.",
    "dimensions": "Return it along the same dimensions always.",
    "unit": "Return it in one unit always.",
    "length": "Give one of their dimensions another name.",
    "labels": "Give dimensions with other labels names of their own.",
}


class Layout:
    """Kinds, shapes, units, labels and dimensions of what is kept, by the first samples that had it.

    Args:
        taken: Names of the samples' coordinates and dimensions.

    Attributes:
        first: {variable with entries: the first sample of the first block that has it, and its place there}.
    """

    def __init__(self, taken: Collection[str] = ()) -> None:
        self._taken = taken
        self._known: dict[str, tuple[dict[str, Any], str]] = {}
        self._variables: dict[str, Variable] = {}
        self.first: dict[str, tuple[int, int]] = {}

    def add(self, block: Block, where: str = "") -> None:
        """Take over the variables of a block, or refuse one that does not agree with those of earlier ones.

        Args:
            block: The results.
            where: Which samples they are, for messages; empty: their numbers.

        Raises:
            InputError: another shape, kind, unit or other labels; which variable, in which samples.
        """
        start, stop = int(block.numbers[0]), int(block.numbers[-1]) + 1
        for place, (name, v) in enumerate(block.variables.items()):
            if name not in RESERVED:
                self.agree(name, v, v.values.shape[1:], where or words_of(start, stop))
                if v.values.size:
                    self.first[name] = min(self.first.get(name, (start, place)), (start, place))

    @property
    def forms(self) -> dict[str, Variable]:
        """Variables, each of some samples, by the first sample that has them, in whatever order blocks were finished."""
        return {name: self._variables[name] for name in sorted(self.first, key=self.first.__getitem__)}

    def agree(self, name: str, variable: Variable, shape: tuple[int, ...], where: str) -> None:
        """Refuse a variable that does not agree with the first of its name, or whose dimensions disagree with another's.

        Args:
            name: Its name.
            variable: It, of one sample or of many.
            shape: Of one sample's value.
            where: Which samples have it, for the message.

        Raises:
            InputError: see above; a name that no variable can have; complex numbers and other objects.
        """
        kind = _KINDS.get(_kind(variable.values.dtype), "")
        if not kind:
            raise InputError(
                f"{name!r:.80} is an array of {variable.values.dtype} in {where}; expected real numbers, truth values or text."
            )
        if len(variable.dims) != len(shape):
            raise InputError(f"{name!r:.80} has {len(shape)} axes in {where} and dimensions {variable.dims}.")
        form = {"kind": kind, "shape": shape, "dimensions": variable.dims, "unit": variable.units}
        self._compare(name, f"{name!r:.80}", form, where)
        for dim, size in zip(variable.dims, shape, strict=True):
            labels = {"labels": variable.labels[dim]} if dim in variable.labels else {}
            self._compare(dim, f"the dimension {dim!r:.80} of {name!r:.80}", {"length": size, **labels}, where)
        self._variables.setdefault(name, variable)

    def _compare(self, name: str, what: str, form: dict[str, Any], where: str) -> None:
        known, since = self._known.setdefault(name, (form, where))
        if known is form:
            self._check_name(name, what, where)
        for each, value in form.items():
            if (old := known.setdefault(each, value)) is not value and old != value:
                both = [(value, old)] if each != "labels" else [x for x in zip(value, old, strict=False) if x[0] != x[1]]
                new, old = both[0] if both else (value, old)
                raise InputError(f"{what} has the {each} {new!r:.80} in {where}, and {old!r:.80} in {since}. {_ADVICE[each]}")

    def _check_name(self, name: object, what: str, where: str) -> None:
        """Refuse a name that no variable, or dimension, of the dataset can have: no text, a reserved one, an argument's."""
        if not isinstance(name, str) or not name.isidentifier() or name.startswith("__"):
            plain = "".join(c if c.isalnum() else "_" for c in str(name))[:60]
            told = f", e.g. {plain!r}" if plain.isidentifier() else ""
            raise InputError(f"{what} in {where} has the name {name!r:.80}; expected letters, digits and _{told}.")
        if name in (*RESERVED, "sample"):
            raise InputError(f"{what} in {where} has the name {name!r}, which every study has itself. Choose another name.")
        if name in self._taken:
            raise InputError(
                f"{what} in {where} has the name {name!r:.80}, which is an argument of the samples and stands in the dataset "
                "as such. Leave it out, or choose another name."
            )


def _kind(dtype: np.dtype) -> str:
    """Kind of the entries of an array: "f" of numbers, "b" of truth values, "i" of codes, "U" of text; or none of these."""
    return "U" if dtype.kind in "OTU" else dtype.kind


def words_of(start: int, stop: int) -> str:
    """Consecutive samples in words, for a message."""
    return f"sample {start}" if stop == start + 1 else f"samples {start} to {stop - 1}"


class KeptRows:
    """What is kept of n consecutive samples.

    Args:
        n: How many they are.
        keep: What is kept.
        first: Number of the first one.
        arguments: Names of the samples' arguments, which no variable may have.
    """

    def __init__(self, n: int, keep: OutputSelection, *, first: int = 0, arguments: Collection[str] = ()) -> None:
        self.n, self._start, self._keep = n, first, keep
        self._layout = Layout(arguments)
        self._columns: dict[str, Variable] = {}
        self._own = own_variables(n)

    def put(self, start: int, result: Any, rows: int | None = None) -> BaseException | None:
        """Keep the result of one sample, or of a batch.

        Args:
            start: The sample, or the first one, from 0 within the chunk.
            result: What the function returned.
            rows: How many samples the batch has; None: it is one sample.

        Returns:
            What a function of `keep`, or a quantity that this result has not, raised; then nothing is kept.

        Raises:
            InputError: what cannot be kept: it ends the study. Names the samples.
        """
        stop, at = start + (rows or 1), start if rows is None else slice(start, start + rows)
        try:
            found, refused = self._keep.of(result, rows)
            if len(dict(found)) < len(found):
                twice = next(name for name, v in found if dict(found)[name] is not v)
                raise NotKept(
                    f"two values would have the name {twice!r:.80}. Give contacts names that differ in letters and digits, and "
                    "values names of their own"
                )
        except NotKept as error:
            raise NotKept(f"{words_of(self._start + start, self._start + stop)}: {error}.") from None
        except (Exception, SystemExit) as error:
            return error
        for name, v in found:
            column, shape = self._columns.get(name), v.values.shape[rows is not None :]
            if column is None or not _alike(v, column, shape):
                self._layout.agree(name, v, shape, words_of(self._start + start, self._start + stop))
            if column is None:
                column = self._columns[name] = empty_of(v, shape, self.n)
            column.values[at] = v.values if v.dims or rows else v.values.item()
        codes, messages = refused if refused is not None else (0, {})
        self._own[REASON].values[start:stop], self._own[OK].values[start:stop] = codes, refused is None or codes == 0
        for row, message in messages.items():  # the number of a state is that within the batch
            self._own[MESSAGE].values[start + row] = _shortened(message.removeprefix(f"at state {row}: "))
        return None

    def refuse(self, i: int, error: BaseException, more: str = "") -> None:
        """Sample i has no result, for an error's reason.

        Args:
            i: Which one, from 0 within the chunk.
            error: What the function raised.
            more: Stands behind the error's text in the message.
        """
        self._own[OK].values[i], self._own[REASON].values[i] = False, Reason.of(error).code
        self._own[MESSAGE].values[i] = _shortened(text_of(error) + more)

    def block(self) -> Block:
        """All that was kept; samples that were not put have `Reason.NOT_RUN`."""
        return Block(np.arange(self._start, self._start + self.n), {**self._own, **self._columns})


def _alike(v: Variable, column: Variable, shape: tuple[int, ...]) -> bool:
    """Whether a variable is plainly of the same form; where this is False, a closer look is needed."""
    one, other = v.values.dtype, column.values.dtype
    return (
        (one is other or _kind(one) == _kind(other))
        and shape == column.values.shape[1:]
        and v.dims == column.dims
        and v.units == column.units
        and (v.labels is column.labels or v.labels == column.labels)
    )


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
