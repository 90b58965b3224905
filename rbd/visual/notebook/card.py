"""A card: what a notebook shows of a record, as HTML without scripts; its values in a few words, with units.

Text and lines take their colours from the notebook, so that light and dark themes both work. Styles are written on the
elements, because many viewers of stored notebooks remove style sheets.
"""

from __future__ import annotations

import html
import inspect
import re
from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import dataclass, fields, is_dataclass
from enum import Enum
from functools import cache, singledispatch
from typing import Any, TypeAlias

import numpy as np

from rbd.arrays import Array

MOST_ROWS = 40
"""Rows of a table that are shown; a line says how many more there are."""
MOST_LETTERS = 160
"""Letters of a cell that are shown."""
_LINE = "1px solid rgba(127, 127, 127, 0.3)"
_MARKS = {True: ("#2e9e5b", "&#9679; "), False: ("#d55e00", "&#9650; "), None: ("#7f8c99", "")}
"""Colours that are seen on white and on black, and signs that differ without them: good, bad, neither."""
_NUMBER = re.compile(r"[-+]?(\d[\d.]*(e[-+]?\d+)?|inf|nan)( %| deg)?|-")

Cells: TypeAlias = Sequence[str]


@dataclass(frozen=True)
class CardTable:
    """A table of words.

    Attributes:
        rows: The cells, row by row; of each, `MOST_LETTERS` letters are shown.
        heads: Heads of the columns, with units; none are written where it is empty.
        title: What stands above it.
        whole: How many rows there are in all, where `rows` are some of them.
        rest: Where all can be found, as in "robot.joints".
    """

    rows: Sequence[Cells]
    heads: Cells = ()
    title: str = ""
    whole: int = 0
    rest: str = ""


@dataclass(frozen=True)
class Fold:
    """A part that is folded at first.

    Attributes:
        title: What one clicks on.
        parts: Tables and paragraphs.
    """

    title: str
    parts: Sequence[CardTable | str]


@dataclass(frozen=True)
class Card:
    """What a notebook shows of a record.

    Attributes:
        result: The first line, the answer, in words.
        good: Whether that is what one hopes for; None: it is neither good nor bad.
        tables: The numbers.
        notes: Sentences below.
        folds: Proof and details.
        drawing: Curves, as SVG made by `rbd.visual.notebook.motion_cards`, with its names escaped.
    """

    result: str
    good: bool | None = None
    tables: Sequence[CardTable] = ()
    notes: Sequence[str] = ()
    folds: Sequence[Fold] = ()
    drawing: str = ""


def escaped(text: object, most: int = MOST_LETTERS) -> str:
    """Text for HTML, cut to a number of letters."""
    words = " ".join(str(text).split())
    return html.escape(words if len(words) <= most else words[: most - 1] + "\N{HORIZONTAL ELLIPSIS}")


def card_html(card: Card) -> str:
    """The card as one element of HTML."""
    color, sign = _MARKS[card.good]
    mark = f'<span style="color:{color}" aria-hidden="true">{sign}</span>' if sign else ""
    parts = [f'<p style="margin:0 0 0.4em">{mark}<strong>{escaped(card.result, 400)}</strong></p>']
    parts += [table_html(table) for table in card.tables if table.rows]
    parts += [card.drawing] if card.drawing else []
    parts += [f'<p style="margin:0.2em 0">{escaped(note, 400)}</p>' for note in card.notes]
    parts += [_fold_html(fold) for fold in card.folds if any(map(_filled, fold.parts))]
    return '<div class="rbd-card" style="max-width:64em;line-height:1.45;text-align:left">' + "\n".join(parts) + "</div>"


def table_html(table: CardTable) -> str:
    """A table as HTML: words at the left, numbers at the right."""
    rows = table.rows[:MOST_ROWS]
    heads = "".join(_cell(head, "th", _right(table.rows, i), scope="col") for i, head in enumerate(table.heads))
    head = f"<thead><tr>{heads}</tr></thead>" if heads else ""
    right = [_right(table.rows, i) for i in range(max(map(len, table.rows), default=0))]
    lines = ["".join(_cell(cell, "td", right[i]) for i, cell in enumerate(row)) for row in rows]
    body = "".join(f'<tr style="border-bottom:{_LINE}">{line}</tr>' for line in lines)
    above = "text-align:left;caption-side:top;padding:0"
    title = f'<caption style="{above}">{escaped(table.title)}</caption>' if table.title else ""
    missing = max(table.whole, len(table.rows)) - len(rows)
    where = f", in {escaped(table.rest)}" if table.rest else ""
    more = f'<p style="margin:0 0 0.4em">and {missing} more{where}</p>' if missing > 0 else ""
    style = "border-collapse:collapse;margin:0.2em 0 0.5em 0;font-variant-numeric:tabular-nums"
    return f'<table style="{style}">{title}{head}<tbody>{body}</tbody></table>{more}'


def _right(rows: Sequence[Cells], column: int) -> bool:
    """Whether all cells of a column are numbers."""
    cells = [row[column] for row in rows if column < len(row) and row[column]]
    return bool(cells) and all(_NUMBER.fullmatch(cell) for cell in cells)


def _cell(text: str, kind: str, right: bool, **attributes: str) -> str:
    said = "".join(f' {name}="{value}"' for name, value in attributes.items())
    align = "right" if right else "left"
    style = f"text-align:{align};padding:0.1em 1.2em 0.1em 0"
    return f'<{kind}{said} style="{style}">{escaped(text)}</{kind}>'


def _fold_html(fold: Fold) -> str:
    parts = [table_html(part) if isinstance(part, CardTable) else _lines(part) for part in fold.parts]
    title = f'<summary style="cursor:pointer">{escaped(fold.title)}</summary>'
    return f'<details style="margin:0.2em 0">{title}{"".join(parts)}</details>'


def _filled(part: CardTable | str) -> bool:
    return bool(part if isinstance(part, str) else part.rows)


def _lines(text: str) -> str:
    """Lines as they are printed, the first forty."""
    lines = text.split("\n")
    shown = [html.escape(line[:MOST_LETTERS]) for line in lines[:MOST_ROWS]]
    more = [f"and {len(lines) - MOST_ROWS} more lines"] if len(lines) > MOST_ROWS else []
    return '<pre style="margin:0.2em 0;white-space:pre;overflow-x:auto;background:none">' + "\n".join(shown + more) + "</pre>"


HEADS = ("field", "value", "unit", "meaning")


@singledispatch
def card_of(record: Any) -> Card:
    """The card of a record: by default its first printed line, and a table of its fields with units and meanings."""
    kind = type(record)
    printed = str(record) if prints_itself(kind) else ""
    first, _, rest = printed.partition("\n")
    said = f"{kind.__name__}: {(inspect.getdoc(kind) or '').split(chr(10), 1)[0].rstrip('.')}"
    folds = [Fold("As printed", [printed])] if rest else []
    return Card(first or said, tables=[CardTable(field_rows(record), HEADS)], folds=folds)


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


def share(x: float | None, decimals: int = 1) -> str:
    """A share in per cent; "-" where there is none."""
    return "-" if x is None or x != x else f"{fixed(100.0 * x, decimals)} %"


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


def field_rows(record: Any, leave_out: Sequence[str] = ()) -> list[tuple[str, str, str, str]]:
    """(name, value, unit, meaning) of each field of a record."""
    kind: type = type(record)
    told = documented(kind)
    rows = []
    for name, value in fields_of(record).items():
        if name not in leave_out:
            unit, meaning = told.get(name, ("", ""))
            plain = isinstance(value, str | bool | Enum) or value is None
            rows.append((name, words(value), "" if plain else unit, meaning))
    return rows


def joined(words: Iterable[str], most: int = 6) -> str:
    """Some words with commas, and how many more there are."""
    listed = list(words)
    more = f" and {len(listed) - most} more" if len(listed) > most else ""
    return ", ".join(listed[:most]) + more
