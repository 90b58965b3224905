"""Planar chains against their marks: 100,000 two-link accelerations, and the dynamics of four links derived from nothing.

Times are of the processor, so that other programs trouble them less. Run by `make bench`.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import numpy as np
from bench_timing import Row
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


def planar_rows() -> list[Row]:
    """Times of planar chains, with their marks."""
    rows = []
    rng = np.random.default_rng(0)
    for n in (2, 5):
        chain, motion = Chain(n, lengths=[0.5] * n), rng.normal(size=(3, SAMPLES, n))
        compiled = chain.function(chain.acceleration())
        marks = (ACCELERATION_MARK_MS,) if n == 2 else ()
        for label, function in (("compiled from symbols", compiled), ("from the structure", chain.numeric.acceleration)):
            seconds = _seconds(lambda f=function, m=motion: f(*m), ROUNDS)
            rows.append(Row(f"{n} links: {SAMPLES:,} accelerations, {label}", {"": 1e3 * seconds}, "ms", marks))
    for n in (2, 4):
        clear_cache()  # SymPy remembers what it has simplified
        marks = (DYNAMICS_MARK_S,) if n == 4 else ()
        rows.append(Row(f"{n} links: dynamics derived, cold", {"": _seconds(lambda n=n: _derive(n), 1)}, "s", marks))
    return rows
