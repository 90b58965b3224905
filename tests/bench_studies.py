"""What `rbd.study` costs: beside the function's own time, in two processes beside one, and with functions that do nothing.

    python tests/bench_studies.py               the tables below, of 10^5 samples of `solve_many`
    python tests/bench_studies.py --n 1000000   the same of 10^6: takes some minutes

`python tests/bench.py --rows studies chunks --write` writes them into docs/studies.md.

Times are those of the clock, as processes take turns on the cores: on a machine that does nothing else.
"""

from __future__ import annotations

import argparse
import functools
import multiprocessing
import os
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from concurrent.futures import Executor, ProcessPoolExecutor
from pathlib import Path

import numpy as np
from bench_timing import Row, table_of
from rich.console import Console

import rbd
from rbd.studies import Workers

BUSY = os.getloadavg()[0]
"""How many other processes wanted the cores when this began."""
CHUNKS = "studies of a function without work, in two processes"
N, EMPTY = 100_000, 20_000
KEEP = ("status", "forces", "worst_residual")
TWO_MARK, OVERHEAD_MARK, EACH_MARK = 0.588, 5.0, 30.0  # 1 / 1.7
INSIDE = [0.0]
"""Seconds spent in the function, in this process."""


@functools.cache
def standing() -> tuple[rbd.Robot, np.ndarray, list, np.ndarray, np.ndarray]:
    """Talos, its q, its soles, torques that hold it, and the generalised force of a push of 1 N to its left."""
    talos = rbd.load_robot("talos")
    state, soles = talos.standing(), talos.soles(friction=0.7)
    unit = rbd.dynamics.generalised(state, rbd.ExternalForce("torso_2_link", (0.0, 1.0, 0.0)))[0]
    return talos, state.q, soles, rbd.hold(state, soles).tau, unit


def pushed(friction: np.ndarray, push_y: np.ndarray) -> rbd.answers.many.Solutions:
    """Motions of Talos, standing and pushed, of all samples of a batch."""
    began = time.perf_counter()
    talos, q, soles, tau, unit = standing()
    found = rbd.solve_many(talos, q, None, tau, soles, external=push_y[:, None] * unit, friction=friction)
    INSIDE[0] += time.perf_counter() - began
    return found


def nothing(x: float) -> float:
    """No work."""
    return x


def three(x: float) -> dict[str, float]:
    """No work, three numbers."""
    return {"a": x, "b": x, "c": x}


def no_work(x: np.ndarray) -> dict[str, np.ndarray]:
    """No work, three numbers of each sample of a batch."""
    return {"a": x, "b": x, "c": x}


def held(friction: float, push_y: float) -> rbd.Actuation:
    """Whether Talos can be held against a push, by which torques."""
    talos, q, _, _, _ = standing()
    push = rbd.ExternalForce("torso_2_link", (0.0, push_y, 0.0))
    return rbd.hold(rbd.State(talos, q), talos.soles(friction=friction), external=push)


def draws(n: int) -> rbd.studies.Samples:
    """Frictions and pushes, n of them."""
    rng = np.random.default_rng(0)
    return rbd.studies.table({"friction": rng.uniform(0.1, 1.0, n), "push_y": rng.uniform(0.0, 200.0, n)})


def seconds(call: Callable[[], object]) -> float:
    """Of one call, by the clock."""
    began = time.perf_counter()
    call()
    return time.perf_counter() - began


def study(n: int, executor: Executor | int, out: Path | None = None) -> object:
    """The study of pushes."""
    return rbd.study(pushed, draws(n), batched=True, keep=KEEP, executor=executor, out=out, progress=False)


def study_rows(n: int = N) -> list[Row]:
    """Two processes beside one, both started; what a study adds to its function, in memory and into a store."""
    warnings.simplefilter("ignore", rbd.errors.RbdWarning)
    with Workers(1) as one, Workers(2) as two:
        for workers in (one, two):
            study(4096, workers)
        times: dict[str, list[float]] = {"one": [], "two": []}
        began = time.process_time()
        study(n, two)
        own = time.process_time() - began
        for _ in range(3 if n <= N else 1):
            times["one"].append(seconds(lambda: study(n, one)))
            times["two"].append(seconds(lambda: study(n, two)))
    study(4096, 0)
    began = time.process_time()
    study(n, 0)
    cost = time.process_time() - began
    INSIDE[0] = 0.0
    here = seconds(lambda: study(n, 0))
    inside = INSIDE[0]
    with tempfile.TemporaryDirectory() as folder:
        study(4096, 0, Path(folder) / "first.zarr")  # which imports zarr
        INSIDE[0] = 0.0
        stored = seconds(lambda: study(n, 0, Path(folder) / "push.zarr"))
        inside_stored = INSIDE[0]
    alone, both = min(times["one"]), min(times["two"])
    pushes = f"{n:,} pushes"
    return [
        Row(f"{pushes}: in two processes, beside one", {"": both / alone}, "x one", (TWO_MARK,)),
        Row(f"{pushes}: what the study adds to the function", {"": 100.0 * (here / inside - 1.0)}, "%", (OVERHEAD_MARK,)),
        Row(
            f"{pushes}: the same, written to a zarr store", {"": 100.0 * (stored / inside_stored - 1.0)}, "%", (OVERHEAD_MARK,)
        ),
        Row(f"{pushes}: processor time of who calls, beside the function's", {"": 100.0 * own / cost}, "%", (5.0,)),
        Row(f"{pushes}: in one process, started", {"": n / alone}, "a second"),
        Row(f"{pushes}: in two", {"": n / both}, "a second"),
        Row("pushes that rbd.hold judges one by one, in one process", {"": _held_a_second()}, "a second"),
        *[
            Row(f"rbd.study of a function that returns {what}, a sample", {"": 1e6 * _each(function)}, "us", (EACH_MARK,))
            for what, function in (("a number", nothing), ("three numbers", three))
        ],
    ]


def _held_a_second(n: int = 400) -> float:
    held(0.5, 10.0)
    return n / seconds(lambda: rbd.study(held, draws(n), executor=0, progress=False))


def _each(function: Callable[..., object]) -> float:
    samples = rbd.grid(x=np.arange(float(EMPTY)))
    return min(seconds(lambda: rbd.study(function, samples, executor=0, progress=False)) for _ in range(3)) / EMPTY


def chunk_rows(executors: dict[str, Executor]) -> list[Row]:
    """Chunks a second that executors take, of a function without work, by samples in a chunk."""
    rows = []
    for executor in executors.values():  # started, and loaded
        _rate(nothing, 200, executor, 10)
    for chunk, n in ((1, 1_000), (10, 5_000), (100, 30_000), (1_000, 100_000), (10_000, 300_000)):
        found = {name: _rate(nothing, n, executor, chunk) for name, executor in executors.items()}
        rows.append(Row(f"one by one, {chunk:,}", found, "1/s"))
    found = {name: _rate(no_work, 2_000_000, executor, 65_536) for name, executor in executors.items()}
    return [*rows, Row("three numbers in batches, 65,536", found, "1/s")]


def _rate(function: Callable[..., object], n: int, executor: Executor, chunk: int) -> float:
    samples, batched = rbd.grid(x=np.arange(float(n))), function is no_work
    return n / seconds(lambda: rbd.study(function, samples, executor=executor, chunk=chunk, batched=batched, progress=False))


def all_chunk_rows() -> list[Row]:
    """Of this package's workers, a pool of the standard library, and dask where it is installed, two processes each."""
    spawn = multiprocessing.get_context("spawn")
    with Workers(2) as own, ProcessPoolExecutor(2, mp_context=spawn) as pool:
        executors: dict[str, Executor] = {"own": own, "pool": pool}
        try:
            import distributed
        except ImportError:
            return chunk_rows(executors)
        with (
            distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50) as cluster,
            distributed.Client(cluster) as client,
        ):
            return chunk_rows(executors | {"dask": client.get_executor()})


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--n", type=int, default=N, help="samples of solve_many")
    given = parser.parse_args()
    console = Console(width=140)
    console.print(table_of("studies", study_rows(given.n)))
    console.print(table_of(CHUNKS, all_chunk_rows()))


if __name__ == "__main__":
    sys.exit(main())
