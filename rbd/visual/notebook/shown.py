"""What a notebook shows of a record, as HTML: all cases, put together."""

from __future__ import annotations

import warnings
from typing import Any

from rbd.visual.notebook import answers, mechanisms, motions, robots, scenes, statics
from rbd.visual.notebook.card import card_html
from rbd.visual.notebook.registry import card_of

CASES = (answers, mechanisms, motions, robots, scenes, statics)
"""The modules that have cases of `card_of`."""


def html_of(record: Any) -> str:
    """What a notebook shows of a record, as HTML.

    Warnings are not repeated: the function that gave the record has given them.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return card_html(card_of(record))
