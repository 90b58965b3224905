"""The points of many shapes that are near a plane, in arrays; shapes whose ball is not near are skipped.

The arithmetic of a pose is in `rbd.constraints.plane_kernel`.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy

import numpy as np

from rbd.arrays import Array
from rbd.constraints.convex.convex_shapes import ConvexShape, plane_kernel


class LowPoints:
    """The points of shapes near a plane.

    Points are numbered one shape after the other, in each first the vertices, then the round parts.

    Args:
        shapes: The shapes, those of one body after another.
        bodies: Body of each shape, ascending from 0, shape (shapes,).

    Attributes:
        first: Number of each shape's first point, shape (shapes,).
        body: Body of each point, shape (n,).
        points: Places of all in their bodies' axes, shape (3, n) [m]; `near` writes those of round parts.
        part_of: The round part of each point, or -1, shape (n,).
        roots: `RoundPart.root` of the round parts, shape (parts, 3, 3) [m].
        least: `RoundPart.least` of these, shape (parts,) [m].
    """

    def __init__(self, shapes: Sequence[ConvexShape], bodies: Array) -> None:
        self.shapes, rounds = tuple(shapes), [part for s in shapes for part in s.rounds]
        corners, parts = np.array([len(s.vertices) for s in shapes]), np.array([len(s.rounds) for s in shapes])
        self.first = np.cumsum(corners + parts) - corners - parts
        self.body = np.repeat(bodies, corners + parts)
        self.points = np.concatenate([np.vstack([s.vertices, np.zeros((len(s.rounds), 3))]) for s in shapes]).T.copy()
        self.part_of = np.full(len(self.body), -1)
        where = [first + n + i for first, n, s in zip(self.first, corners, shapes, strict=True) for i in range(len(s.rounds))]
        self.part_of[where] = np.arange(len(rounds))
        self.roots, self.least = np.array([r.root for r in rounds]).reshape(-1, 3, 3), np.array([r.least for r in rounds])
        rims = [first + r.rim if r.rim >= 0 else -1 for first, s in zip(self.first, shapes, strict=True) for r in s.rounds]
        self._given = (
            self.first, corners, np.append(0, np.cumsum(parts)), bodies, np.array([s.centre for s in shapes]),
            np.array([s.reach for s in shapes]), np.array([r.centre for r in rounds]).reshape(-1, 3), self.roots, self.least,
            np.array([r.steep for r in rounds]), np.array(rims, int),
        )  # fmt: skip

    def another(self) -> LowPoints:
        """A copy with places of its own."""
        out = copy(self)
        out.points = self.points.copy()
        return out

    def label(self, point: int) -> tuple[str, int]:
        """(name of a point's shape, its number there)."""
        shape = int(np.searchsorted(self.first, point, side="right")) - 1
        return self.shapes[shape].name, point - int(self.first[shape])

    def near(self, up: Array, height: Array, margin: float) -> tuple[Array, Array]:
        """(numbers of the points up to `margin` above the plane, ascending, their heights [m]), shapes (k,).

        Of a shape with more than `MOST_POINTS` corners, those chosen by `spread`. Not for two threads at once.

        Args:
            up: Normal of the plane in each body's axes, shape (bodies, 3).
            height: Height of each body's origin, shape (bodies,) [m].
            margin: [m].
        """
        numbers, heights = plane_kernel().near_points(self.points, *self._given, up, height, margin)
        return numbers, heights
