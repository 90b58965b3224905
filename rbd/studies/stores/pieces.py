"""`Pieces`: samples cut into consecutive runs, each a rectangle of the samples' grid: the chunks of a zarr array."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from rbd.studies.kept.variable import Block

PIECE, LARGEST_PIECE = 8_000_000, 64_000_000
"""Bytes of a chunk of all variables together: of studies up to 8 GB, and at most."""


@dataclass(frozen=True)
class Pieces:
    """Samples of a grid in C order, cut into consecutive runs that are chunks of an array of the grid's shape.

    All dimensions after one are whole in a chunk, all before it of length 1; so a chunk is a run of consecutive samples, and a
    store is written one chunk after another while samples are computed in their order.

    Attributes:
        shape: Lengths of the dimensions of the samples; none of a single sample.
        chunk: Lengths of the dimensions of a chunk, not more than those.
    """

    shape: tuple[int, ...]
    chunk: tuple[int, ...]

    @classmethod
    def of(cls, shape: Sequence[int], most: int) -> Pieces:
        """Pieces of at most so many samples, as equal as can be, and as large."""
        chunk = [1] * len(shape)
        room = max(1, most)
        for axis in reversed(range(len(shape))):
            if shape[axis] > room:
                count = math.ceil(shape[axis] / room)
                chunk[axis] = math.ceil(shape[axis] / count)
                break
            chunk[axis] = shape[axis]
            room //= shape[axis]
        return cls(tuple(shape), tuple(chunk))

    def __len__(self) -> int:
        return math.prod(self._counts)

    @property
    def _counts(self) -> tuple[int, ...]:
        return tuple(-(-n // k) for n, k in zip(self.shape, self.chunk, strict=True))

    @property
    def _axis(self) -> int:
        """The dimension that is cut; all before it have chunks of length 1."""
        return next((i for i, (n, k) in enumerate(zip(self.shape, self.chunk, strict=True)) if 1 < k), len(self.shape) - 1)

    def number(self, sample: int) -> int:
        """The piece that has this sample."""
        if not self.shape:
            return 0
        axis = self._axis
        tail = math.prod(self.shape[axis + 1 :])
        outer, inner = divmod(sample, self.shape[axis] * tail)
        return outer * self._counts[axis] + inner // (self.chunk[axis] * tail)

    def span(self, piece: int) -> tuple[int, int]:
        """The first sample of a piece, and the first after it."""
        if not self.shape:
            return 0, 1
        axis = self._axis
        tail = math.prod(self.shape[axis + 1 :])
        outer, k = divmod(piece, self._counts[axis])
        first = outer * self.shape[axis] * tail
        start = k * self.chunk[axis]
        return first + start * tail, first + min(start + self.chunk[axis], self.shape[axis]) * tail

    def index(self, piece: int) -> tuple[int, ...]:
        """Numbers of the chunk along each dimension: the name of its file."""
        found = []
        for count in reversed(self._counts):
            piece, at = divmod(piece, count)
            found.append(at)
        return tuple(reversed(found))

    def place(self, piece: int) -> tuple[slice, ...]:
        """Where a piece stands in an array of the grid's shape."""
        return tuple(
            slice(i * k, min((i + 1) * k, n)) for i, k, n in zip(self.index(piece), self.chunk, self.shape, strict=True)
        )


def piece_size(block: Block, n: int) -> int:
    """Samples in a chunk, so that all its variables take some megabytes.

    Args:
        block: Some results.
        n: Number of all samples.
    """
    each = 16 + sum(math.prod(v.values.shape[1:]) * v.values.dtype.itemsize for v in block.variables.values())
    return max(64, int(min(LARGEST_PIECE, max(PIECE, each * n / 1000)) / each))
