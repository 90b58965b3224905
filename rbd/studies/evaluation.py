"""`Evaluation`: a function with what is kept of its results; evaluates the samples of a chunk, in any process."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rbd.studies.kept.rows import KeptRows
from rbd.studies.kept.variable import Block
from rbd.studies.kept.wanted import Keep

BATCH = 512
"""Samples that a batched function gets at a time: as many as `solve_many` puts in a block, whatever the chunk."""


@dataclass(frozen=True, eq=False)
class Evaluation:
    """What is computed for each sample, and what is kept of it; it is sent to the workers once.

    Attributes:
        function: Called with the arguments of a sample; `rng=` a Generator of the sample, where it has such a parameter.
        keep: Names of what is kept; None: the defaults of the result's type.
        seed: Root of the seeds of all samples.
        batched: Whether the function takes arrays over samples, `BATCH` at a time.
    """

    function: Callable[..., Any]
    keep: Keep = None
    seed: int = 0
    batched: bool = False

    def block(self, start: int, columns: Mapping[str, Sequence[Any]]) -> Block:
        """Results of consecutive samples.

        Args:
            start: Number of the first sample.
            columns: {argument: values}, of one length.
        """
        n = len(next(iter(columns.values())))
        rows = KeptRows(n, self.keep, first=start, arguments=tuple(columns))
        takes_rng = "rng" in inspect.signature(self.function).parameters
        for i in range(0, n, BATCH) if self.batched else range(n):
            j = min(i + BATCH, n)
            given = {name: values[i:j] if self.batched else values[i] for name, values in columns.items()}
            if takes_rng:
                given["rng"] = np.random.default_rng(self.seed_of(start + i))
            try:
                result = self.function(**given)
            except Exception as error:
                for k in range(i, j) if self.batched else [i]:
                    rows.refuse(k, error)
                continue
            if self.batched:
                rows.put_batch(i, j, result)
            else:
                rows.put(i, result)
        return rows.block()

    def seed_of(self, i: int) -> np.random.SeedSequence:
        """The seed of sample i: child i of `SeedSequence(seed).spawn`, whatever the chunks."""
        return np.random.SeedSequence(self.seed, spawn_key=(i,))
