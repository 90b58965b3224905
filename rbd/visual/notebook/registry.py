"""Which card belongs to which record: one function with a case for each kind, and a general one for all others."""

from __future__ import annotations

import inspect
from functools import singledispatch
from typing import Any

from rbd.visual.notebook.card import Card, Fold, Table
from rbd.visual.notebook.values import field_rows

HEADS = ("field", "value", "unit", "meaning")


@singledispatch
def card_of(record: Any) -> Card:
    """The card of a record: by default its first printed line, and a table of its fields with units and meanings."""
    kind = type(record)
    printed = str(record) if prints_itself(kind) else ""
    first, _, rest = printed.partition("\n")
    said = f"{kind.__name__}: {(inspect.getdoc(kind) or '').split(chr(10), 1)[0].rstrip('.')}"
    folds = [Fold("As printed", [printed])] if rest else []
    return Card(first or said, tables=[Table(field_rows(record), HEADS)], folds=folds)


def prints_itself(kind: type) -> bool:
    """Whether a class has a text of its own, for `print`."""
    return kind.__str__ is not object.__str__ and kind.__str__ is not tuple.__str__
