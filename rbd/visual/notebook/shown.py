"""What a notebook shows of a record, as HTML: all cases, put together."""

from __future__ import annotations

import warnings
from typing import Any

from rbd.visual.notebook import answer_cards, motion_cards, page_frames, robot_cards
from rbd.visual.notebook.card import card_html, card_of

CASES = (answer_cards, robot_cards, motion_cards, page_frames)
"""The modules that have cases of `card_of`."""


def html_of(record: Any) -> str:
    """What a notebook shows of a record, as HTML.

    Warnings are not repeated: the function that gave the record has given them.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return card_html(card_of(record))
