"""`screenshot`, `contact_sheet` and `motion_sheet` of `rbd.visual` with one browser for all pictures of a run."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

from rbd import visual


@cache
def browser() -> visual.Browser:
    """The browser, started by the first picture; it ends with Python."""
    return visual.Browser()


def screenshot(*given: Any, **settings: Any) -> Path:
    """See `rbd.visual.screenshot`."""
    return visual.screenshot(*given, browser=browser(), **settings)


def contact_sheet(*given: Any, **settings: Any) -> Path:
    """See `rbd.visual.contact_sheet`."""
    return visual.contact_sheet(*given, browser=browser(), **settings)


def motion_sheet(*given: Any, **settings: Any) -> Path:
    """See `rbd.visual.motion_sheet`."""
    return visual.motion_sheet(*given, browser=browser(), **settings)
