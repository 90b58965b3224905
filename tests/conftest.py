"""Robots that many tests share, and seeded draws."""

from __future__ import annotations

import gc
import os
from collections import defaultdict
from collections.abc import Iterator

for library in ("OMP", "OPENBLAS"):  # read when NumPy is loaded: two threads on busy cores cost a quarter more than one
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")
os.environ.setdefault("RBD_COMPILED", "1")  # at once: the work of a call does not depend on those before

import numpy as np  # noqa: E402
import pytest  # noqa: E402
from long_list import LONG, long_tests, slow_tests  # noqa: E402

import rbd  # noqa: E402

gc.disable()  # until all is collected
USERS = {"test_api_examples.py", "test_docs.py", "test_examples.py", "test_notebooks.py", "test_readme.py"}
USERS |= {"test_beyond_joint_limits.py", "test_moving_constraints.py"}
DRAWN = ("JointLimitWarning", "MovingConstraintWarning")
"""Warnings that are errors in `USERS` alone: the others draw q and v of held contacts at random, for laws that hold at any."""


def pytest_addoption(parser: pytest.Parser) -> None:
    """What takes minutes is run by `make exhaustive`."""
    parser.addoption("--exhaustive", action="store_true", help="all draws, and every example from a wheel")
    parser.addoption("--long", choices=("with", "without", "only"), default="with", help=f"the tests of {LONG.name}")
    parser.addoption("--write-long", type=float, metavar="SECONDS", help=f"write the tests that took longer into {LONG.name}")


def pytest_configure(config: pytest.Config) -> None:
    """Markers of this suite."""
    config.addinivalue_line("markers", "long: takes tens of seconds by itself, so it is begun first")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out, or keep alone, the long tests, if asked. What is long comes first. Random states may be beyond joint limits.

    Begun late, it would run alone while the other workers have nothing left to do. On a fresh clone, the second worker
    meanwhile compiles what the first would compile as well.
    """
    if (wanted := config.getoption("--long")) != "with":
        known = long_tests()
        out = [item for item in items if (item.nodeid.partition("[")[0] in known) == (wanted == "without")]
        left = set(map(id, out))
        items[:] = [item for item in items if id(item) not in left]
        config.hook.pytest_deselected(items=out)
    for item in items:
        if item.path.name not in USERS:
            for what in DRAWN:
                item.add_marker(pytest.mark.filterwarnings(f"ignore::rbd.errors.{what}"))
    items.sort(key=lambda item: item.get_closest_marker("long") is None)


def pytest_collection_finish() -> None:
    """What is collected stays to the end, so the garbage collector need not look through it: an eighth of the time."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 20, 100)
    gc.enable()


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """What was left out; in an exhaustive run, what tests have counted: lines that they recorded as the property `counted`."""
    options = terminalreporter.config.getoption
    if options("--long") == "without":
        terminalreporter.write_line(f"left out: the {len(long_tests())} tests of tests/{LONG.name}; `make test-long` runs them")
        took = times_of(terminalreporter)
        for name in slow_tests(took):
            terminalreporter.write_line(
                f"slow, {took[name]:.1f} s, and not in tests/{LONG.name}: {name}; `make time-tests` lists it"
            )
    if (limit := options("--write-long")) is not None:
        write_long(terminalreporter, limit)
    if options("--exhaustive"):
        for report in terminalreporter.getreports("passed"):
            for name, line in report.user_properties:
                if name == "counted":
                    terminalreporter.write_line(line)


def times_of(reporter: pytest.TerminalReporter) -> dict[str, float]:
    """Seconds of each test of a run, fixtures and all parameters together."""
    took: dict[str, float] = defaultdict(float)
    for report in {id(r): r for found in reporter.stats.values() for r in found if hasattr(r, "duration")}.values():
        took[report.nodeid.partition("[")[0]] += report.duration
    return took


def write_long(reporter: pytest.TerminalReporter, limit: float) -> None:
    """Write the names of the tests that took longer, all their parameters together, into the list of long tests."""
    took = times_of(reporter)
    head = "# Tests that take longest: names and seconds, fixtures and all parameters together; written by `make time-tests`."
    names = sorted(name for name, seconds in took.items() if seconds > limit)
    LONG.write_text("\n".join([head, *(f"{name} {took[name]:.1f}" for name in names)]) + "\n", encoding="utf-8")
    long, every = sum(took[name] for name in names), sum(took.values())
    reporter.write_line(f"{len(names)} tests take {long:.0f} of {every:.0f} s and are in {LONG.name} now")


@pytest.fixture(scope="module", autouse=True)
def nothing_left_open() -> Iterator[None]:
    """What a test file has left open is closed, with a ResourceWarning, at its own end and not in another file's test."""
    yield
    gc.collect()


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
