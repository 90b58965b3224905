"""A card: what a notebook shows of a record, as HTML without scripts and without colours of its own for text and ground.

Text and lines take their colours from the notebook, so that light and dark themes both work. Styles are written on the
elements, because many viewers of stored notebooks remove style sheets.
"""

from __future__ import annotations

import html
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

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
class Table:
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
    parts: Sequence[Table | str]


@dataclass(frozen=True)
class Card:
    """What a notebook shows of a record.

    Attributes:
        result: The first line, the answer, in words.
        good: Whether that is what one hopes for; None: it is neither good nor bad.
        tables: The numbers.
        notes: Sentences below.
        folds: Proof and details.
        drawing: Curves, as SVG made by `rbd.visual.notebook.small_curves`, with its names escaped.
    """

    result: str
    good: bool | None = None
    tables: Sequence[Table] = ()
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


def table_html(table: Table) -> str:
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
    parts = [table_html(part) if isinstance(part, Table) else _lines(part) for part in fold.parts]
    title = f'<summary style="cursor:pointer">{escaped(fold.title)}</summary>'
    return f'<details style="margin:0.2em 0">{title}{"".join(parts)}</details>'


def _filled(part: Table | str) -> bool:
    return bool(part if isinstance(part, str) else part.rows)


def _lines(text: str) -> str:
    """Lines as they are printed, the first forty."""
    lines = text.split("\n")
    shown = [html.escape(line[:MOST_LETTERS]) for line in lines[:MOST_ROWS]]
    more = [f"and {len(lines) - MOST_ROWS} more lines"] if len(lines) > MOST_ROWS else []
    return '<pre style="margin:0.2em 0;white-space:pre;overflow-x:auto;background:none">' + "\n".join(shown + more) + "</pre>"
