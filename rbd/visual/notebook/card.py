"""A card: what a notebook shows of a record, as HTML without scripts: its printed text, and its fields with units.

Text and lines take their colours from the notebook, so that light and dark themes both work. Styles are written on the
elements, because many viewers of stored notebooks remove style sheets.
"""

from __future__ import annotations

import html
import inspect
import re
from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache
from typing import Any

import numpy as np

from rbd.arrays import Array

MOST_LINES = 40
"""Rows of a table, and lines of a text, that are shown; a line says how many more there are."""
MOST_LETTERS = 160
"""Letters of a cell, or of a line, that are shown."""
HEADS = ("field", "value", "unit", "meaning")
_LINE = "1px solid rgba(127, 127, 127, 0.3)"
_NUMBER = re.compile(r"[-+]?(\d[\d.]*(e[-+]?\d+)?|inf|nan)|-")


def escaped(text: object, most: int = MOST_LETTERS) -> str:
    """Text for HTML, cut to a number of letters."""
    words = " ".join(str(text).split())
    return html.escape(words if len(words) <= most else words[: most - 1] + "\N{HORIZONTAL ELLIPSIS}")


def card_html(text: str, rows: Sequence[Sequence[str]] = (), drawing: str = "") -> str:
    """A card as one element of HTML: the first line of the text, which is the result; the drawing; the rest; the fields.

    Args:
        text: What is printed of a record.
        rows: Name, value, unit and meaning of each field; folded where there is more than the first line.
        drawing: Curves as SVG, or a frame, with all names escaped.
    """
    result, _, rest = text.partition("\n")
    parts = [f'<p style="margin:0 0 0.4em"><strong>{escaped(result, 400)}</strong></p>', drawing]
    parts += [_text_html(rest)] if rest else []
    if rows and (rest or drawing):
        title = '<summary style="cursor:pointer">Fields</summary>'
        parts.append(f'<details style="margin:0.2em 0">{title}{table_html(rows)}</details>')
    elif rows:
        parts.append(table_html(rows))
    whole = "\n".join(part for part in parts if part)
    return f'<div class="rbd-card" style="max-width:64em;line-height:1.45;text-align:left">{whole}</div>'


def table_html(rows: Sequence[Sequence[str]]) -> str:
    """Fields as a table of HTML: words at the left, numbers at the right."""
    head = "".join(f'<th scope="col" style="{_style(name)}">{name}</th>' for name in HEADS)
    lines = ["".join(f'<td style="{_style(cell)}">{escaped(cell)}</td>' for cell in row) for row in rows[:MOST_LINES]]
    body = "".join(f'<tr style="border-bottom:{_LINE}">{line}</tr>' for line in lines)
    more = f"<p>and {len(rows) - MOST_LINES} more</p>" if len(rows) > MOST_LINES else ""
    style = "border-collapse:collapse;margin:0.2em 0 0.5em 0;font-variant-numeric:tabular-nums"
    return f'<table style="{style}"><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>{more}'


def _style(cell: str) -> str:
    return f"text-align:{'right' if _NUMBER.fullmatch(cell) else 'left'};padding:0.1em 1.2em 0.1em 0"


def _text_html(text: str) -> str:
    """Lines as they are printed, the first forty."""
    lines = text.split("\n")
    shown = [html.escape(line[:MOST_LETTERS]) for line in lines[:MOST_LINES]]
    more = [f"and {len(lines) - MOST_LINES} more lines"] if len(lines) > MOST_LINES else []
    return '<pre style="margin:0.2em 0;white-space:pre;overflow-x:auto;background:none">' + "\n".join(shown + more) + "</pre>"


def prints_itself(kind: type) -> bool:
    """Whether a class has a text of its own, for `print`."""
    return kind.__str__ is not object.__str__ and kind.__str__ is not tuple.__str__


FEW = 6
"""The most numbers of an array that are written out; of longer ones, shape and range are."""
_ENTRY = re.compile(r"^ {4}(\w+)(?: \([^)]*\))?: (.*(?:\n {5,}.*)*)", re.MULTILINE)
_SECTION = re.compile(r"^(Attributes|Args):\n((?: {4}.*\n?|\n)+)", re.MULTILINE)
_UNIT = re.compile(r"\[([^\]\[]*)\]")
_CITATION = re.compile(r"[A-Z]\w+\d{4}|.*=")


def number(x: float, digits: int = 6) -> str:
    """A number; zero where it is rounding of zero, "-" of NaN."""
    x = float(x)
    return "-" if x != x else f"{x + 0.0:.{digits}g}"


def fixed(x: float, decimals: int) -> str:
    """A number rounded to some decimals; never "-0"."""
    return "-" if x != x else f"{round(float(x), decimals) + 0.0:.{decimals}f}"


def vector(x: Sequence[float] | Array, decimals: int = 3) -> str:
    """A short vector, as "(0.1, 0, 2)", rounded to some decimals."""
    return "(" + ", ".join(fixed(v, decimals) for v in x) + ")"


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
    if isinstance(value, Mapping):
        return _mapping(value)
    if isinstance(value, Sequence | Set) and not hasattr(value, "_fields"):
        return _sequence(list(value))
    return _object(value)


def _array(x: Array) -> str:
    if not x.size:
        return f"empty, shape {x.shape}"
    if x.dtype.kind == "b":
        return f"shape {x.shape}, {int(x.sum())} true"
    if x.dtype.kind not in "fiu":
        return joined([str(each) for each in dict.fromkeys(x.ravel()[:1000].tolist())])
    if x.size <= FEW and x.ndim <= 1:
        return number(float(x)) if x.ndim == 0 else "(" + ", ".join(number(v, 4) for v in x) + ")"
    known = x[np.isfinite(x)]
    limits = f"{number(known.min(), 4)} to {number(known.max(), 4)}" if known.size else "no finite entry"
    return f"shape {x.shape}, {limits}"


def _mapping(value: Mapping[Any, Any]) -> str:
    if not value:
        return "none"
    if not all(isinstance(key, int | str | Enum) for key in value):
        return f"{len(value)} entries"
    if len(value) <= FEW and all(isinstance(x, int | float | str | Enum) for x in value.values()):
        return ", ".join(f"{key}: {words(x)}" for key, x in value.items())
    return f"{len(value)}: {joined(map(str, value))}"


def _sequence(value: Sequence[Any]) -> str:
    if not value:
        return "none"
    if len(value) <= FEW and all(isinstance(x, int | float | str | Enum) for x in value):
        return ", ".join(words(x) for x in value)
    named = [str(x.name) for x in value if isinstance(getattr(x, "name", None), str)]
    if len(named) == len(value):
        return joined(named)
    kinds = joined(dict.fromkeys(type(x).__name__ for x in value), 3)
    return f"{len(value)} of {kinds}"


def _object(value: Any) -> str:
    if isinstance(name := getattr(value, "name", None), str):
        return f"{type(value).__name__} {name}"
    if callable(value) and hasattr(value, "__qualname__"):
        return str(value.__qualname__)
    own = str(type(value).__module__).split(".")[0]
    if own == "rbd" and is_dataclass(value) and type(value).__str__ is object.__str__ and _dumps(type(value)):
        return type(value).__name__
    return str(value).split("\n", 1)[0] if own in ("rbd", "sympy", "builtins") else type(value).__name__


def _dumps(kind: type) -> bool:
    """Whether its text is the one that dataclasses write, with all numbers of all arrays."""
    return bool(kind.__repr__.__qualname__.endswith("__create_fn__.<locals>.__repr__")) or hasattr(kind.__repr__, "__wrapped__")


@cache
def documented(kind: type) -> dict[str, tuple[str, str]]:
    """{name: (unit, meaning)} of what the docstrings of a class and its bases describe; the unit without brackets."""
    found: dict[str, tuple[str, str]] = {}
    for base in reversed(kind.__mro__):
        text = inspect.cleandoc(base.__dict__.get("__doc__") or "")
        for _, section in _SECTION.findall(text + "\n"):
            for name, told in _ENTRY.findall(section):
                found[name] = _unit_and_meaning(told)
    return found


def _unit_and_meaning(told: str) -> tuple[str, str]:
    text = " ".join(told.split())
    units = [each for each in _UNIT.findall(text) if each and not _CITATION.match(each)]
    first = re.split(r"(?<=[\w)\]}])[.;:] (?![^{]*\})", text, maxsplit=1)[0]  # not within {name: what it is}
    meaning = re.sub(r",? ?\bshape \([^)]*\)|\s*\[[^\]]*\]", "", first).strip(" ,.")
    return (units[0] if units else ""), meaning


def fields_of(record: Any) -> dict[str, Any]:
    """{name: value} of what a record keeps and shows: fields of a dataclass, else public attributes that are documented."""
    if is_dataclass(record):
        return {f.name: getattr(record, f.name, None) for f in fields(record) if not f.name.startswith("_")}
    kind: type = type(record)
    told = documented(kind)
    return {name: getattr(record, name) for name in told if hasattr(record, name) and not callable(getattr(record, name))}


def field_rows(record: Any) -> list[tuple[str, str, str, str]]:
    """(name, value, unit, meaning) of each field of a record."""
    kind: type = type(record)
    told = documented(kind)
    rows = []
    for name, value in fields_of(record).items():
        unit, meaning = told.get(name, ("", ""))
        plain = isinstance(value, str | bool | Enum) or value is None
        rows.append((name, words(value), "" if plain else unit, meaning))
    return rows


def joined(words: Iterable[str], most: int = 6) -> str:
    """Some words with commas, and how many more there are."""
    listed = list(words)
    more = f" and {len(listed) - most} more" if len(listed) > most else ""
    return ", ".join(listed[:most]) + more
