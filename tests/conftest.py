"""Robots that many tests share, and seeded draws."""

from __future__ import annotations

import gc
import os

for library in ("OMP", "OPENBLAS"):  # read when NumPy is loaded: two threads on busy cores cost a quarter more than one
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")

import numpy as np  # noqa: E402
import pytest  # noqa: E402

import rbd  # noqa: E402

gc.disable()  # until all is collected


def pytest_addoption(parser: pytest.Parser) -> None:
    """What takes minutes is run by `make exhaustive`."""
    parser.addoption("--exhaustive", action="store_true", help="all draws, and every example from a wheel")


def pytest_configure(config: pytest.Config) -> None:
    """Markers of this suite."""
    config.addinivalue_line("markers", "long: takes tens of seconds by itself, so it is begun first")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What is long comes first: begun late, it would run alone while the other workers have nothing left to do.

    On a fresh clone, the second worker meanwhile compiles what the first would compile as well.
    """
    items.sort(key=lambda item: item.get_closest_marker("long") is None)


def pytest_collection_finish() -> None:
    """What is collected stays to the end, so the garbage collector need not look through it: an eighth of the time."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 20, 100)
    gc.enable()


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """In an exhaustive run, what tests have counted: lines that they recorded as the property `counted`."""
    if terminalreporter.config.getoption("--exhaustive"):
        for report in terminalreporter.getreports("passed"):
            for name, line in report.user_properties:
                if name == "counted":
                    terminalreporter.write_line(line)


@pytest.fixture(scope="session")
def exhaustive(request: pytest.FixtureRequest) -> bool:
    """Whether everything is to be run, however long it takes."""
    return bool(request.config.getoption("--exhaustive"))


@pytest.fixture(scope="session")
def talos() -> rbd.Robot:
    """Talos, 32 motors; do not change it."""
    return rbd.load_robot("talos")


@pytest.fixture(scope="session")
def g1() -> rbd.Robot:
    """G1, 29 motors; do not change it."""
    return rbd.load_robot("g1")


@pytest.fixture
def rng() -> np.random.Generator:
    """The same draws in every run, in every test."""
    return np.random.default_rng(20)
