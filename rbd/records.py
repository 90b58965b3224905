"""Fields of records: one table a class (name, dimensions, unit, meaning), from which text, JSON, datasets and `keep=` follow.

A class has its table as `fields`, a tuple of `Field`; of a class without one, the table is what its docstring says of its
attributes. A record whose fields have dimensions of a robot's coordinates has a property `coordinate_axes`: that of the robot.
"""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence, Set
from dataclasses import dataclass, field, fields as own_fields, is_dataclass
from enum import Enum
from functools import cache, lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from rbd.modules import xarray_or_error

if TYPE_CHECKING:
    import xarray

    from rbd.arrays import Array


class Axis(NamedTuple):
    """Labels along a dimension, and units of the coordinates there; no units where they are no coordinates."""

    labels: tuple[Any, ...]
    units: tuple[str, ...] = ()


SPATIAL = ("fx", "fy", "fz", "mx", "my", "mz")
AXES: dict[str, Axis] = {"axis": Axis(("x", "y", "z")), "spatial": Axis(SPATIAL)}
"""{dimension: labels along it}, of those that are the same in every record."""


@dataclass(frozen=True, eq=False)
class Variable:
    """A quantity of one record, or of n.

    Attributes:
        values: Of one record an array of the shape of `dims`; of n records, one more axis in front.
        dims: Names of the dimensions of one record's value; empty of a number.
        units: Unit, "" where there is none.
        long_name: What it is.
        labels: {dimension: labels of its entries}, text or numbers.
        flags: {code: its meaning}, of codes.
    """

    values: Array
    dims: tuple[str, ...] = ()
    units: str = ""
    long_name: str = ""
    labels: Mapping[str, tuple[Any, ...]] = field(default_factory=dict)
    flags: Mapping[int, str] = field(default_factory=dict)

    @property
    def attributes(self) -> dict[str, Any]:
        """Its unit and what it is, as attributes of an xarray variable; of codes their meanings too, as CF has them."""
        found: dict[str, Any] = {"units": self.units, "long_name": self.long_name}
        if self.flags:
            found["flag_values"], found["flag_meanings"] = list(self.flags), " ".join(self.flags.values())
        return {name: value for name, value in found.items() if value}


Named: TypeAlias = tuple[str, Variable]


@dataclass(frozen=True, eq=False)
class Field:
    """A line of the table of a class: a quantity that its records have.

    Attributes:
        name: Its name, in `keep=`, JSON and datasets; that of the attribute, unless `value` gives it.
        dims: Names of the dimensions of one record's value.
        unit: Unit, "" where there is none; "{}" in it stands for the units of the coordinates along its dimension.
        meaning: What it is, in one line.
        value: Gives it, of a record; None: the attribute of this name.
        entry: Name of the variable of one entry, of a field that is a mapping: "force_{}". Of such, `dims` may have "{}" too.
        each: Meaning of one entry: "force of {}".
        flags: {code: its meaning}, of codes.
        default: Whether a study keeps it where nothing is said.
        certificate: Whether a study keeps it whatever is said.
    """

    name: str
    dims: tuple[str, ...] = ()
    unit: str = ""
    meaning: str = ""
    value: Callable[[Any], Any] | None = None
    entry: str = ""
    each: str = ""
    flags: Mapping[int, str] = field(default_factory=dict)
    default: bool = field(default=True, kw_only=True)
    certificate: bool = field(default=False, kw_only=True)

    def of(self, record: Any) -> Any:
        """Its value in a record."""
        return getattr(record, self.name) if self.value is None else self.value(record)

    def read(self, record: Any) -> Any:
        """Its value in a record, a code as its meaning."""
        value = self.of(record)
        return self.flags.get(int(value), value) if self.flags and np.ndim(value) == 0 else value

    def unit_in(self, axes: Mapping[str, Axis]) -> str:
        """Its unit, of coordinates as these axes have them: "m/s2 or rad/s2"."""
        if "{}" not in self.unit:
            return self.unit
        return _unit_of(self.unit, axes[self.dims[0]].units) if self.dims[0] in axes else ""

    def variables(self, record: Any) -> list[Named]:
        """Its variables: one, or of a mapping one an entry; None is NaN; what is a `Variable` already stays one."""
        value, axes = self.of(record), axes_of(record)
        if not isinstance(value, Mapping):
            return [(self.name, self._variable(value, axes))]
        return [(self.entry.format(key(name)), self._variable(x, axes, name)) for name, x in value.items()]

    def _variable(self, value: Any, axes: Mapping[str, Axis], name: str = "") -> Variable:
        if isinstance(value, Variable):
            return value
        dims = tuple([dim.format(key(name)) for dim in self.dims])
        labels = {dim: axes[dim].labels for dim in dims if dim in axes}
        if value is None:
            value = np.full([len(labels[dim]) for dim in dims], math.nan)
        meaning = self.each.format(name) if self.each else self.meaning
        return Variable(np.asarray(value), dims, self.unit_in(axes), meaning, labels, self.flags)


@lru_cache(maxsize=1000)
def _unit_of(form: str, units: tuple[str, ...]) -> str:
    return " or ".join(dict.fromkeys(form.format(unit) for unit in units))


def axes_of(record: Any) -> Mapping[str, Axis]:
    """{dimension: labels along it}, of what a record has."""
    return getattr(record, "coordinate_axes", AXES)


@lru_cache(maxsize=1000)
def key(name: str) -> str:
    """A name inside the names of variables: letters, digits and _."""
    return re.sub(r"\W", "_", name)


RANKED_FILES = (
    Field(
        "motions", (), "", "numbers of each motion, best first",
        lambda found: [{"file": file, "rank": i + 1, **numbers} for i, (file, numbers) in enumerate(found.ranked)],
    ),
    Field(
        "failed", (), "", "files that were not checked",
        lambda found: [
            {"file": file, "error": message, "reason": reason, "reason_code": reason.code}
            for file, (reason, message) in found.failed.items()
        ],
    ),
)  # fmt: skip
"""Of what ranks files: a record with `ranked`, [(file, its numbers)], and `failed`, {file: (reason, message)}."""


@cache
def fields_of(kind: type) -> tuple[Field, ...]:
    """The table of a class: its own, else its fields or public attributes with what its docstring says of them."""
    own = getattr(kind, "fields", ())
    if isinstance(own, tuple) and own and all(isinstance(line, Field) for line in own):
        return own
    told = documented(kind)
    names = [f.name for f in own_fields(kind) if not f.name.startswith("_")] if is_dataclass(kind) else list(told)
    return tuple(Field(name, (), *told.get(name, ("", ""))) for name in names)


_ENTRY = re.compile(r"^ {4}(\w+)(?: \([^)]*\))?: (.*(?:\n {5,}.*)*)", re.MULTILINE)
_SECTION = re.compile(r"^(Attributes|Args):\n((?: {4}.*\n?|\n)+)", re.MULTILINE)
_UNIT = re.compile(r"\[([^\]\[]*)\]")
_CITATION = re.compile(r"[A-Z]\w+\d{4}|.*=")


@cache
def documented(kind: type) -> dict[str, tuple[str, str]]:
    """{name: (unit, meaning)} of what the docstrings of a class and its bases describe; the unit without brackets."""
    found: dict[str, tuple[str, str]] = {}
    for base in reversed(kind.__mro__):
        text = inspect.cleandoc(base.__dict__.get("__doc__") or "")
        for _, section in _SECTION.findall(text + "\n"):
            found |= {name: unit_and_meaning(told) for name, told in _ENTRY.findall(section)}
    return found


def unit_and_meaning(told: str) -> tuple[str, str]:
    """Unit and meaning in the description of an attribute, or in the first line of a property's docstring."""
    text = " ".join(told.split())
    units = [each for each in _UNIT.findall(text) if each and not _CITATION.match(each)]
    first = re.split(r"(?<=[\w)\]}])[.;:] (?![^{]*\})", text, maxsplit=1)[0]  # not within {name: what it is}
    meaning = re.sub(r",? ?\bshape \([^)]*\)|\s*\[[^\]]*\]", "", first).strip(" ,.")
    return (units[0] if units else ""), meaning


def rows_of(record: Any) -> list[tuple[str, str, str, str]]:
    """(name, value in a few words, unit, meaning) of each field of a record, for text and HTML."""
    axes, rows = axes_of(record), []
    for line in fields_of(record.__class__):
        if line.value is None and (not hasattr(record, line.name) or callable(getattr(record, line.name))):
            continue
        value = line.read(record)
        plain = isinstance(value, str | bool | Enum) or value is None
        rows.append((line.name, words(value), "" if plain else line.unit_in(axes), line.meaning))
    return rows


def plain_of(record: Any, names: Iterable[str] | None = None) -> dict[str, Any]:
    """The fields of a record as JSON can have them: numbers, text, lists; coordinates by their labels.

    Args:
        record: The record.
        names: Of the fields; None: all.
    """
    axes, found = axes_of(record), {}
    for line in fields_of(record.__class__):
        if names is None or line.name in names:
            value = plain(line.read(record))
            axis = axes.get(line.dims[0]) if len(line.dims) == 1 and isinstance(value, list) else None
            found[line.name] = dict(zip(axis.labels, value, strict=True)) if axis is not None and axis.units else value
    return found


def plain(value: Any) -> Any:
    """A value as JSON can have it, None in place of NaN and infinity; a record as its fields."""
    if isinstance(value, Variable):
        value = value.values
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, Enum):
        return str(value)
    if value is None or isinstance(value, str | bool | int | float):
        return None if isinstance(value, float) and not math.isfinite(value) else value
    if isinstance(value, Mapping):
        return {str(name): plain(x) for name, x in value.items()}
    return [plain(x) for x in value] if isinstance(value, Sequence | Set) else plain_of(value)


def dataset(variables: Iterable[Named], along: Mapping[str, Any], attributes: Mapping[str, Any]) -> xarray.Dataset:
    """Variables of n records as an xarray.Dataset, with labels, units and meanings.

    Args:
        variables: Values of all records: the first axes are the dimensions of `along`, the last ones those of one record.
        along: {dimension of the records: its labels, or as xarray takes coordinates}.
        attributes: Of the dataset.

    Raises:
        InputError: xarray is not installed; names the extra.
    """
    data, coords = {}, dict(along)
    for name, variable in variables:
        data[name] = ((*along, *variable.dims), variable.values, variable.attributes)
        coords |= {dim: np.array(labels, None if labels else str) for dim, labels in variable.labels.items()}
    return xarray_or_error().Dataset(data, coords, attributes)


FEW = 6
"""The most numbers of an array that are written out; of longer ones, shape and range are."""


def number(x: float, digits: int = 6) -> str:
    """A number; zero where it is rounding of zero, "-" of NaN."""
    return "-" if x != x else f"{float(x) + 0.0:.{digits}g}"


def fixed(x: float, decimals: int) -> str:
    """A number rounded to some decimals; never "-0"."""
    return "-" if x != x else f"{round(float(x), decimals) + 0.0:.{decimals}f}"


def vector(x: Sequence[float] | Array, decimals: int = 3) -> str:
    """A short vector, as "(0.1, 0, 2)", rounded to some decimals."""
    return "(" + ", ".join(fixed(v, decimals) for v in x) + ")"


def share(x: float | None, decimals: int = 1) -> str:
    """A share in per cent; "-" where there is none."""
    return "-" if x is None or x != x else f"{fixed(100.0 * x, decimals)} %"


def joined(listed: Iterable[object], most: int = 6) -> str:
    """Some words with commas, and how many more there are."""
    told = list(map(str, listed))
    more = f" and {len(told) - most} more" if len(told) > most else ""
    return ", ".join(told[:most]) + more


def counted(n: int, one: str, several: str = "") -> str:
    """A count with its noun, as "1 step" or "2 steps"; with its verb, where the words for several are given."""
    return f"{n} {one if n == 1 else several or one + 's'}"


def words(value: Any) -> str:
    """A value in a few words; of a long array its shape and range."""
    if value is None:
        return "none"
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, Enum | str):
        return str(value) or "none"
    if isinstance(value, int | np.integer):
        return str(int(value))
    if isinstance(value, float | np.floating):
        return number(float(value))
    if isinstance(value, np.ndarray):
        return _array(value)
    short = FEW >= len(value) > 0 if isinstance(value, Sequence | Set | Mapping) else False
    if isinstance(value, Mapping):
        all_plain = short and all(isinstance(x, int | float | str | Enum) for x in value.values())
        listed = ", ".join(f"{name}: {words(x)}" for name, x in value.items()) if all_plain else ""
        return listed or (f"{len(value)}: {joined(value)}" if value else "none")
    if isinstance(value, Sequence | Set) and not hasattr(value, "_fields"):
        return _sequence(list(value), short)
    return _object(value)


def _array(x: Array) -> str:
    if not x.size:
        return f"empty, shape {x.shape}"
    if x.dtype.kind == "b":
        return f"shape {x.shape}, {int(x.sum())} true"
    if x.dtype.kind not in "fiu":
        return joined(dict.fromkeys(x.ravel()[:1000].tolist()))
    if x.size <= FEW and x.ndim <= 1:
        return number(float(x)) if x.ndim == 0 else "(" + ", ".join(number(v, 4) for v in x) + ")"
    known = x[np.isfinite(x)]
    limits = f"{number(known.min(), 4)} to {number(known.max(), 4)}" if known.size else "no finite entry"
    return f"shape {x.shape}, {limits}"


def _sequence(value: Sequence[Any], short: bool) -> str:
    if not value:
        return "none"
    if short and all(isinstance(x, int | float | str | Enum) or _symbolic(x) for x in value):
        return ", ".join(words(x) for x in value)
    named = [x.name for x in value if isinstance(getattr(x, "name", None), str)]
    kinds = joined(dict.fromkeys(type(x).__name__ for x in value), 3)
    return joined(named) if len(named) == len(value) else f"{len(value)} of {kinds}"


def _symbolic(value: object) -> bool:
    """Whether it is SymPy's, whose text says more than the name of its class: 1/2 is a Half."""
    return str(type(value).__module__).startswith("sympy.")


def _object(value: Any) -> str:
    if _symbolic(value):
        return str(value).split("\n", 1)[0]
    if isinstance(name := getattr(value, "name", None), str):
        return f"{type(value).__name__} {name}"
    if callable(value) and hasattr(value, "__qualname__"):
        return str(value.__qualname__)
    own, kind = str(type(value).__module__).split(".")[0], type(value)
    written = "__create_fn__" in getattr(kind.__repr__, "__qualname__", "") or hasattr(kind.__repr__, "__wrapped__")
    if own == "rbd" and is_dataclass(value) and kind.__str__ is object.__str__ and written:
        return kind.__name__  # what dataclasses write has all numbers of all arrays
    return str(value).split("\n", 1)[0] if own in ("rbd", "builtins") else kind.__name__
