"""One headless browser for the browser tests of a worker."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from rbd.visual.pages.browser import Browser, find_browser


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """A headless browser that stays open; tests that want it are skipped, with the reason, where none is installed."""
    if find_browser() is None:
        pytest.skip("no Chromium on this machine")
    with Browser() as opened:
        yield opened
