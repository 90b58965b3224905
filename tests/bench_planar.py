"""Planar chains against their marks: 100,000 two-link accelerations, and the dynamics of four links derived from nothing.

Times are of the processor, so that other programs trouble them less. Run by `make bench`.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import numpy as np
from rich.table import Table
from sympy.core.cache import clear_cache

from rbd.planar.chain import Chain
from rbd.planar.equations_of_motion import dynamics

SAMPLES, ROUNDS = 100_000, 15
ACCELERATION_MARK_MS, DYNAMICS_MARK_S = 20.0, 20.0


def _seconds(call: Callable[[], object], rounds: int) -> float:
    """Median time of a call, the first one left out where there are others."""
    times = []
    for _ in range(rounds + (rounds > 1)):
        start = time.thread_time()
        call()
        times.append(time.thread_time() - start)
    return statistics.median(times[rounds > 1 :])


def _derive(n: int) -> None:
    """All terms of the equations of motion of n links in symbols."""
    terms = dynamics(Chain(n))
    _ = terms.M, terms.christoffel, terms.C, terms.g, terms.T, terms.V, terms.equations, terms.bias


def planar_tables() -> list[Table]:
    """Times of planar chains, with their marks."""
    table = Table(title=f"planar chains: {SAMPLES:,} samples, hot; derivations, cold")
    for heading in ("", "median", "mark"):
        table.add_column(heading, justify="left" if not heading else "right")
    rng = np.random.default_rng(0)
    for n in (2, 5):
        chain, motion = Chain(n, lengths=[0.5] * n), rng.normal(size=(3, SAMPLES, n))
        compiled = chain.function(chain.acceleration())
        mark = f"{ACCELERATION_MARK_MS:g} ms" if n == 2 else ""
        for label, function in (("compiled from symbols", compiled), ("from the structure", chain.numeric.acceleration)):
            seconds = _seconds(lambda f=function, m=motion: f(*m), ROUNDS)
            table.add_row(f"{n} links: accelerations, {label}", f"{1e3 * seconds:.1f} ms", mark)
    for n in (2, 4):
        clear_cache()  # SymPy remembers what it has simplified
        mark = f"{DYNAMICS_MARK_S:g} s" if n == 4 else ""
        table.add_row(f"{n} links: dynamics derived", f"{_seconds(lambda n=n: _derive(n), 1):.2f} s", mark)
    return [table]
