"""Where a call of `rbd.solve`, and a step of `rbd.simulate`, spend their time: by part, in us and per cent.

Python's profiler counts the functions of a run, and Pinocchio's, which it does not see by itself. What a function spends in
itself belongs to the part of its module; what it spends in NumPy or in helpers, to the part that called these. The profiler's
own cost a call, measured on an empty function, is taken off, and the parts are scaled to what the run takes without the
profiler. Medians of several runs.
"""

from __future__ import annotations

import cProfile
import statistics
import time
import types
import warnings
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache, partial

import pinocchio as pin
from bench_answers import answers_of
from bench_draws import Draws
from bench_simulation import STEP, Bench
from bench_timing import DRAWS, Column
from rich.table import Table

from rbd.errors import RbdWarning

PARTS = {
    "rbd/model/state.py": "State",
    "rbd/model/checked_model.py": "State",
    "rbd/model/": "terms of the equations of motion",
    "rbd/problem/residuals.py": "certificate",
    "rbd/problem/law_distance.py": "certificate",
    "rbd/answers/prepared/": "prepared form: the order of the call",
    "rbd/solvers/point_law": "certificate: law of the points",
    "rbd/solvers/": "law: Newton's method, or QP",
    "rbd/answers/many/": "many states",
    "rbd/answers/solution.py": "record",
    "rbd/problem/answer.py": "record",
    "rbd/answers/least_constraint.py": "rbd.solve: finding the prepared form, warnings",
    "rbd/constraints/": "rows of the constraints",
    "rbd/problem/": "problem in arrays",
    "rbd/simulation/recording.py": "recording",
    "rbd/simulation/velocity_problem.py": "law: velocity problem",
    "rbd/simulation/stacked_points.py": "contact points",
    "rbd/simulation/contact_gaps.py": "gaps, position correction",
    "rbd/simulation/trajectory": "trajectory",
    "rbd/simulation/": "time step",
    "rbd/control/": "controller",
    "tests/bench_simulation.py": "controller",
    "tests/bench_answers.py": "the loop around",
}
"""{beginning of a file's path: part}; the longest beginning counts."""
FUNCTIONS = {
    "held": "held bodies: factors, rows and forces",
    "row_terms": "held bodies: factors, rows and forces",
    "speeds": "speeds of the contacts, at rest or not",
    "sticking": "law: corner forces of least norm, in their cones?",
    "change": "law: change of the acceleration",
    "checked": "certificate: forces onto the bodies, residual of rnea",
    "inverse_dynamics": "certificate: forces onto the bodies, residual of rnea",
    "wrenches": "certificate: forces onto the bodies, residual of rnea",
    "row_accelerations": "certificate: row accelerations from the bodies'",
    "accelerations": "certificate: row accelerations from the bodies'",
    "in_row_axes": "certificate: row accelerations from the bodies'",
    "off_plane": "gaps of the contacts",
}
"""{function of `rbd/answers/prepared`: part}, before `PARTS`."""
CALLS, STEPS = 30, 200
"""In one run of the profiler."""
PIN = "Pinocchio: "
Key = tuple[str, int, str]
Stats = dict[Key, tuple[int, int, float, float, dict[Key, tuple[int, int, float, float]]]]


@contextmanager
def pinocchio_seen() -> Iterator[None]:
    """Pinocchio's functions as Python functions, which the profiler counts, as long as the block lasts."""
    names = [name for name in dir(pin) if type(getattr(pin, name)).__name__ == "function" and name[0].islower()]
    kept = {name: getattr(pin, name) for name in names if not isinstance(getattr(pin, name), types.FunctionType)}
    for name, call in kept.items():
        seen = types.FunctionType(_forward.__code__.replace(co_name=PIN + name), {"call": call}, PIN + name)
        setattr(pin, name, seen)
    try:
        yield
    finally:
        for name, call in kept.items():
            setattr(pin, name, call)


def _forward(*args: object, **kwargs: object) -> object:
    return call(*args, **kwargs)  # type: ignore[name-defined]  # noqa: F821


def part_of(key: Key) -> str | None:
    """The part of a function, by its file; None of what counts for its callers."""
    path, _, name = key
    if name.startswith(PIN):
        return name
    if "/rbd/answers/prepared/" in path and name in FUNCTIONS:
        return FUNCTIONS[name]
    fitting = [begin for begin in PARTS if f"/{begin}" in path]
    return PARTS[max(fitting, key=len)] if fitting else None


def by_part(runs: Sequence[Callable[[], object]]) -> dict[str, float]:
    """Share of the time that each part takes, medians over the runs: what interrupts one run falls on few parts of it."""
    found = [_profiled(run) for run in runs]
    medians = {part: statistics.median(seconds.get(part, 0.0) for seconds in found) for part in found[0]}
    return {part: seconds / sum(medians.values()) for part, seconds in medians.items()}


def _profiled(run: Callable[[], object]) -> dict[str, float]:
    """Seconds of each part in one run."""
    inner, outer = profiler_cost()
    profile = cProfile.Profile()
    with pinocchio_seen():
        profile.enable()
        run()
        profile.disable()
    profile.create_stats()
    stats: Stats = profile.stats  # type: ignore[attr-defined]
    called: dict[Key, int] = defaultdict(int)
    for _, _, _, _, callers in stats.values():
        for caller, (_, calls, _, _) in callers.items():
            called[caller] += calls
    seconds: dict[str, float] = defaultdict(float)
    for key, (_, calls, own, _, _) in stats.items():
        net = max(0.0, own - inner * calls - outer * called[key])
        for part, share in _shares(stats, key, 0).items():
            seconds[part] += share * net
    return seconds


def _shares(stats: Stats, key: Key, depth: int) -> dict[str, float]:
    """{part: share} of a function's own time."""
    part = part_of(key)
    if part is not None:
        return {part: 1.0}
    callers = stats[key][4]
    total = sum(own for _, _, own, _ in callers.values())
    if depth > 8 or not callers:
        return {"the loop around": 1.0}
    shares: dict[str, float] = defaultdict(float)
    for caller, (_, _, own, _) in callers.items():
        weight = own / total if total > 0.0 else 1.0 / len(callers)
        for part, share in _shares(stats, caller, depth + 1).items():
            shares[part] += weight * share
    return shares


def _nothing() -> None:
    return None


@cache
def profiler_cost(n: int = 5_000, rounds: int = 15) -> tuple[float, float]:
    """Seconds that the profiler adds to a function for each call of it, and to its caller: the least of several rounds."""
    found = [_cost(n) for _ in range(rounds)]
    bare, own, caller = (min(each) for each in zip(*found, strict=True))
    return own, max(0.0, caller - bare)


def _cost(n: int) -> tuple[float, float, float]:
    """Seconds a call of an empty function: in all without the profiler; of its own, and of its caller, with it."""

    def calls() -> None:
        for _ in range(n):
            _nothing()

    start = time.perf_counter()
    calls()
    bare = (time.perf_counter() - start) / n
    profile = cProfile.Profile()
    profile.enable()
    calls()
    profile.disable()
    profile.create_stats()
    own = {key[2]: found[2] / n for key, found in profile.stats.items()}  # type: ignore[attr-defined]
    return bare, own["_nothing"], own["calls"]


Columns = dict[str, tuple[float, dict[str, float]]]
"""{what was run: (seconds, share of each part)}."""


def lines(columns: Columns) -> list[list[str]]:
    """Cells of a table by part, the largest part first: us and per cent of each column; parts below 1 % are left out."""
    weight: dict[str, float] = defaultdict(float)
    for _, shares in columns.values():
        for part, share in shares.items():
            weight[part] = max(weight[part], share)
    out = [["part", *(cell for label in columns for cell in (f"{label} [us]", "%"))]]
    for part in sorted(weight, key=lambda each: -weight[each]):
        if weight[part] >= 0.01:
            shown = [
                (1e6 * seconds * shares.get(part, 0.0), 100.0 * shares.get(part, 0.0)) for seconds, shares in columns.values()
            ]
            out.append([part, *(cell for us, percent in shown for cell in (f"{us:.1f}", f"{percent:.0f}"))])
    return [*out, ["all", *(cell for seconds, _ in columns.values() for cell in (f"{1e6 * seconds:.1f}", "100"))]]


def profile_table(title: str, columns: Columns) -> Table:
    """The same for a terminal."""
    table = Table(title=title)
    headings, *rows = lines(columns)
    for heading in headings:
        table.add_column(heading, justify="left" if heading == "part" else "right")
    for row in rows:
        table.add_row(*row)
    return table


def profiles(d: Draws) -> dict[str, Columns]:
    """{title: columns}: a call on two soles, from State on; a step of a robot that sways on its feet."""
    calls: Columns = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RbdWarning)
        for label, column in answers_of(d).items():
            runs = [partial(_calls, column, range(begin, begin + CALLS)) for begin in range(0, DRAWS, CALLS)] * 4
            calls[label] = statistics.median(map(_timed, runs)) / CALLS, by_part(runs)
        steps = {}
        for name in ("talos", "solo12"):
            bench = Bench.of(name)
            runs = [partial(bench.standing_run, bench.swaying, STEPS, STEPS)] * 12
            steps[name] = statistics.median(map(_timed, runs)) / STEPS, by_part(runs)
    return {
        f"{d.robot.name}: a call of rbd.solve on two soles, from State on": calls,
        f"a step of rbd.simulate of {1e3 * STEP:g} ms on frictional feet": steps,
    }


def _calls(column: Column, draws: range) -> None:
    for i in draws:
        column(i)


def _timed(run: Callable[[], object]) -> float:
    start = time.thread_time()
    run()
    return time.thread_time() - start
