"""Times of the processor, by turns; rows of a table with their marks, and the versions of what was measured.

A column is a function of the number of a draw. The columns of a group take turns of `TURN` calls, so that what disturbs the
machine disturbs them alike, and the median of a column's calls counts. Times are of the thread's processor time, so that other
programs trouble them less. Reading this clock takes 0.7 us: `CLOCK` is taken off.
"""

from __future__ import annotations

import importlib.metadata
import platform
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.table import Table

Column = Callable[[int], object]
DRAWS, TURN, ROUNDS = 300, 20, 4


def _clock() -> float:
    """Seconds that one reading of the clock adds to what is between two readings."""
    differences = []
    for _ in range(2001):
        start = time.thread_time()
        differences.append(time.thread_time() - start)
    return statistics.median(differences)


CLOCK = _clock()


def turns(
    columns: Mapping[str, Column], *, draws: int = DRAWS, turn: int = TURN, rounds: int = ROUNDS
) -> dict[str, list[float]]:
    """Seconds of each call of each column, the columns taking turns."""
    times: dict[str, list[float]] = {name: [] for name in columns}
    for run in columns.values():  # what is compiled or prepared on first use
        run(0)
    clock = time.thread_time
    for _ in range(rounds):
        for begin in range(0, draws, turn):
            for name, run in columns.items():
                for i in range(begin, min(begin + turn, draws)):
                    start = clock()
                    run(i)
                    times[name].append(clock() - start - CLOCK)
    return times


def interleaved(columns: Mapping[str, Column], **kwargs: int) -> dict[str, float]:
    """Median seconds of a call of each column; arguments as `turns`."""
    return {name: statistics.median(t) for name, t in turns(columns, **kwargs).items()}


def once(call: Callable[[], object]) -> float:
    """Seconds of one call."""
    start = time.thread_time()
    call()
    return time.thread_time() - start


@dataclass(frozen=True)
class Row:
    """One line of a table: what was measured of each robot, in a unit, beside its marks.

    Attributes:
        what: What was done.
        values: {robot, or "" where there is none: number}.
        unit: Of the numbers, and of the marks.
        marks: The first, to be met, and the second, which is the aim; either may be missing.
    """

    what: str
    values: dict[str, float]
    unit: str = "x"
    marks: tuple[float, ...] = ()

    @property
    def verdict(self) -> str:
        """Which mark the slowest robot meets: "second", "first", "missed", or "" where there are none."""
        if not self.marks:
            return ""
        met = sum(max(self.values.values()) <= mark for mark in self.marks)
        return "missed" if not met else "met" if len(self.marks) == 1 else ("first", "second")[met - 1]

    @property
    def shown(self) -> str:
        """The numbers with the unit, robot by robot."""
        return ", ".join(f"{name} {shown(x)}".strip() for name, x in self.values.items()) + f" {self.unit}"


def shown(x: float) -> str:
    """A number with two or three digits."""
    return f"{x:.0f}" if x >= 99.5 else f"{x:.1f}" if x >= 9.95 else f"{x:.2f}"


def marks_of(row: Row) -> list[str]:
    """The two marks of a row as they are printed."""
    return [*(f"{mark:g}" for mark in row.marks), "", ""][:2]


def robots_of(rows: Sequence[Row]) -> list[str]:
    """Names of the columns: robots, and an empty one last where there are rows of none."""
    names = dict.fromkeys(name for row in rows for name in row.values)
    return sorted(names, key=lambda name: not name)


def table_of(title: str, rows: Sequence[Row]) -> Table:
    """The rows with their marks, and whether they are met."""
    robots = robots_of(rows)
    table = Table(title=title)
    for heading in ("", *robots, "unit", "first mark", "second mark", "meets"):
        table.add_column(heading, justify="left" if heading in ("", "unit") else "right")
    for row in rows:
        numbers = [shown(row.values[name]) if name in row.values else "" for name in robots]
        table.add_row(row.what, *numbers, row.unit, *marks_of(row), row.verdict)
    return table


def versions() -> dict[str, str]:
    """{what: version} of everything that is measured, and the processor."""
    named = ("pin", "numpy", "scipy", "proxsuite", "clarabel", "daqp", "numba", "mujoco")
    found = {"python": platform.python_version()} | {name: _version(name) for name in named}
    return found | {"BLAS": _blas(), "processor": _processor()}


def _version(name: str) -> str:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return "not installed"


def _blas() -> str:
    told = np.show_config(mode="dicts")["Build Dependencies"]["blas"]  # type: ignore[index, call-overload]
    return f"{told['name']} {told['version']}, of NumPy"


def _processor() -> str:
    path = Path("/proc/cpuinfo")
    lines = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
    named = next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), platform.processor())
    cores = sum(line.startswith("processor") for line in lines) or "?"
    return f"{named}, {cores} cores, {platform.system()} {platform.machine()}"
