"""Processes that tests of studies share."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

import rbd


@pytest.fixture(scope="session")
def workers() -> Iterator[rbd.studies.Workers]:
    """Two processes, started by the first test that asks for them."""
    with rbd.studies.Workers(2) as found:
        yield found
