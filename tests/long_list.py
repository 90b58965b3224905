"""Which tests are long: a list of those that took longest, and what a run shows to be missing in it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

LONG = Path(__file__).with_name("long_tests.txt")
"""Tests that take longest: `make test` leaves them to `make test-long`."""


def long_tests() -> set[str]:
    """Names of the long tests, without parameters."""
    return {line.split()[0] for line in LONG.read_text(encoding="utf-8").splitlines() if not line.startswith("#")}


def slow_tests(took: Mapping[str, float]) -> list[str]:
    """Names of the tests that take more than a hundredth of a run, the slowest first."""
    whole = sum(took.values())
    return sorted(
        (name for name, seconds in took.items() if len(took) > 1000 and seconds > whole / 100),
        key=took.__getitem__,
        reverse=True,
    )
