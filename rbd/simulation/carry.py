"""What is known of points, carried over to a layout in which some have come into sight and others have gone out of it."""

from __future__ import annotations

import numpy as np

from rbd.arrays import Array
from rbd.simulation.snapshot import Layout


class Carry:
    """From one layout to another: each point is the one of the same constraint and number.

    Args:
        old: The layout that arrays are in.
        new: The layout that they are wanted in.

    Attributes:
        known: Which points were there before, shape (k,).
    """

    def __init__(self, old: Layout, new: Layout) -> None:
        at = {key: i for i, key in enumerate(zip(old.owners, old.numbers, strict=True))}
        self.same = old is new
        self._from = np.array([at.get(key, -1) for key in zip(new.owners, new.numbers, strict=True)], int)
        self.known = self._from >= 0
        firsts, widths = old.normals + 1 - old.widths, new.widths
        rows = [firsts[i] + np.arange(w) if i >= 0 else np.full(w, -1) for i, w in zip(self._from, widths, strict=True)]
        self._rows = np.concatenate([np.zeros(0, int), *rows])

    def points(self, values: Array, otherwise: object) -> Array:
        """One value a point, shape (k,)."""
        if self.same:
            return values
        out = np.full(len(self._from), otherwise, dtype=values.dtype)
        out[self.known] = values[self._from[self.known]]
        return out

    def rows(self, values: Array) -> Array:
        """One value a row, shape (p,); zero of points that were not there."""
        if self.same:
            return values
        known = self._rows >= 0
        out = np.zeros(len(self._rows))
        out[known] = values[self._rows[known]]
        return out
