"""`Chunks`: the samples that are left to do, cut into parts of about a second each."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from rbd.arrays import Array
from rbd.studies.workers.evaluation import BATCH

SECONDS = 1.0
"""What a chunk is to take: a thousand times what sending it costs, and little to lose."""
MOST = 65_536
"""Samples of a chunk, at most."""
GROWTH = 4
"""A chunk has at most so many times the samples of the largest that is finished: the first of a process take longer."""


class Chunks:
    """Parts of what is not done, in order.

    With a fixed size their boundaries are multiples of it. Else the size follows from the time that a sample takes, and
    becomes smaller near the end, so that all processes end together.

    Attributes:
        left: Number of samples that no chunk has yet.
        shares: Among how many chunks what is left is to be divided at least.
    """

    def __init__(self, done: Array, size: int | None, *, batched: bool, shares: int = 1) -> None:
        self.unit = BATCH if batched else 1
        self.fixed = None if size is None else -(-size // self.unit) * self.unit
        self._runs = _runs(np.asarray(done, bool), self.unit)
        self._run = next(self._runs, None)
        self.left = len(done) - int(np.count_nonzero(done))
        self.shares = shares
        self._pace = self._largest = 0.0

    def take(self) -> tuple[int, int] | None:
        """(start, stop) of the next chunk; None where nothing is left."""
        if self._run is None:
            return None
        start, end = self._run
        if self.fixed is not None:
            stop = min(end, (start // self.fixed + 1) * self.fixed)
        else:
            stop = min(end, start + self._size())
        self._run = (stop, end) if stop < end else next(self._runs, None)
        self.left = max(0, self.left - (stop - start))
        return start, stop

    def learn(self, samples: int, seconds: float) -> None:
        """What a finished chunk took."""
        pace = seconds / samples
        self._pace = pace if not self._pace else 0.5 * (self._pace + pace)
        self._largest = max(self._largest, samples)

    def _size(self) -> int:
        if not self._largest:
            return self.unit
        wanted = min(SECONDS / max(self._pace, 1e-9), GROWTH * self._largest, MOST, self.left / (2 * self.shares))
        least = min(0.05 * SECONDS / max(self._pace, 1e-9), GROWTH * self._largest, MOST)
        return max(1, round(max(wanted, least) / self.unit)) * self.unit


def _runs(done: Array, unit: int) -> Iterator[tuple[int, int]]:
    """(start, stop) of what is not done, rounded outwards to whole units."""
    n = len(done)
    if unit > 1 and n:
        done = np.logical_and.reduceat(done, np.arange(0, n, unit))
    edges = np.flatnonzero(np.diff(np.concatenate(([True], done, [True]))))
    for start, stop in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        yield start * unit, min(stop * unit, n)
