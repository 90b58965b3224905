"""Faces and edges of convex hulls of a robot's shapes, as arrays for compiled functions."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from rbd.arrays import Array, locked
from rbd.constraints.convex.convex_shapes import ConvexShape
from rbd.model.meshes import solid_hull


class Facets(NamedTuple):
    """Hulls of the corners of shapes, side by side, each in the axes of its body.

    Numbers of corners, faces and edges are those within a hull. A shape with round parts, or flat, has no faces.

    Attributes:
        points: Corners, shape (3, n) [m].
        faces: (N, d), N x <= d inside, shape (f, 4) [1, m].
        loops: Corners of each face in order, counterclockwise as seen from outside.
        sides: The edge from each of these to the next.
        loop_at: Where those of each face begin, shape (f + 1,).
        edges: Of each edge two corners and two faces, shape (e, 4).
        begins: Where corners, faces and edges of each hull begin, shape (hulls + 1, 3).
    """

    points: Array
    faces: Array
    loops: Array
    sides: Array
    loop_at: Array
    edges: Array
    begins: Array

    @classmethod
    def of(cls, shapes: Sequence[ConvexShape]) -> Facets:
        """Those of some shapes."""
        corners = [np.zeros((0, 3)), *[shape.vertices for shape in shapes]]
        each = [_NONE, *[_NONE if shape.rounds else _facets(shape.vertices.tobytes()) for shape in shapes]]
        faces, loops, sides, sizes, edges = (np.concatenate([part[i] for part in each]) for i in range(5))
        counts = np.array([[len(p), len(part[0]), len(part[4])] for p, part in zip(corners, each, strict=True)])
        return cls(
            np.ascontiguousarray(np.concatenate(corners).T), faces, loops, sides, np.append(0, np.cumsum(sizes)), edges,
            np.cumsum(counts, axis=0),
        )  # fmt: skip


_Parts = tuple[Array, Array, Array, Array, Array]
_NONE: _Parts = (np.zeros((0, 4)), *(np.zeros(0, int),) * 3, np.zeros((0, 4), int))


@lru_cache(maxsize=256)
def _facets(data: bytes) -> _Parts:
    """(faces, loops, sides, length of each face's loop, edges) of the hull of some points; none of points in a plane."""
    points = np.frombuffer(data).reshape(-1, 3)
    try:
        hull = solid_hull(points)
    except ValueError:
        return _NONE
    _, first, of = np.unique(np.round(hull.equations, 9), axis=0, return_index=True, return_inverse=True)
    a, b = hull.simplices.ravel(), np.roll(hull.simplices, -1, axis=1).ravel()  # triangles in one plane are one face
    face = np.repeat(of.ravel(), 3)
    order = np.lexsort((np.maximum(a, b), np.minimum(a, b)))
    one, other = order[::2], order[1::2]
    kept = face[one] != face[other]
    one, other = one[kept], other[kept]
    edges = np.column_stack([np.minimum(a, b)[one], np.maximum(a, b)[one], face[one], face[other]])
    after: list[dict[int, tuple[int, int]]] = [{} for _ in first]
    for number, pair in enumerate(zip(one.tolist(), other.tolist(), strict=True)):
        for at in pair:
            after[face[at]][int(a[at])] = int(b[at]), number
    loops, sides, sizes = list[int](), list[int](), list[int]()
    for follows in after:
        begin = at = min(follows)
        sizes.append(len(follows))
        for _ in follows:
            loops.append(at)
            at, number = follows[at]
            sides.append(number)
        assert at == begin
    N = hull.equations[first, :3]
    starts = np.append(0, np.cumsum(sizes))
    d = np.array([(points[loops[i:j]] @ n).max() for i, j, n in zip(starts[:-1], starts[1:], N, strict=True)])
    return locked(np.column_stack([N, d])), np.array(loops, int), np.array(sides, int), np.array(sizes, int), edges
