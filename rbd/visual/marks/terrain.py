"""Terrain among the marks: its pieces around what happens on it, as solids with their edges and a grid on their tops."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from rbd.arrays import Array
from rbd.constraints.convex.polygons import across
from rbd.constraints.terrain.pieces import Heights, Piece
from rbd.constraints.terrain.terrain import Terrain
from rbd.visual import shapes
from rbd.visual.marks import primitives
from rbd.visual.marks.mark import Label, Mark, Sizes
from rbd.visual.shapes import Mesh, joined

TERRAIN_COLOR, EDGE_COLOR = "#ccd3da", "#66717d"
REACH, SKIRT = 2.5, 0.1
"""How far around what happens it is drawn, and how far its sides reach below its lowest top, in sizes of the robot."""
BENT = np.cos(np.radians(20.0))
"""Edges between faces that are bent less are not drawn."""
MOST_CELLS = 40_000
"""Of more cells of a grid of heights every second is drawn, or fewer."""
LISTED = 8


@dataclass(frozen=True, eq=False)
class ShownTerrain:
    """A part of a terrain.

    Attributes:
        terrain: Which.
        low: Lowest corner of a box about what happens on it, in W, shape (3,) [m].
        high: Highest corner.
        shift: By how much it is drawn beside where it is, in W, shape (3,) [m].
    """

    terrain: Terrain
    low: Array
    high: Array
    shift: Array = field(default_factory=lambda: np.zeros(3))

    @classmethod
    def about(cls, terrain: Terrain, points: Array, shift: Sequence[float] | Array = (0.0, 0.0, 0.0)) -> ShownTerrain:
        """The part around some points in W, shape (k, 3) [m]; of none, around the world's origin."""
        P = points[np.isfinite(points).all(axis=1)]
        P = P if len(P) else np.zeros((1, 3))
        return cls(terrain, P.min(axis=0), P.max(axis=0), np.asarray(shift, float))

    @property
    def title(self) -> str:
        """What it is, in words."""
        return str(self.terrain).split(" (")[0]

    @property
    def lines(self) -> tuple[str, ...]:
        """What the page says of it."""
        names, friction = self.terrain.names, self.terrain.friction
        more = f", and {len(names) - LISTED} more" if len(names) > LISTED else ""
        coefficient = "friction of each contact" if friction is None else f"friction {friction:g} of all contacts"
        return ", ".join(names[:LISTED]) + more, coefficient


def terrain_marks(place: int, shown: ShownTerrain, sizes: Sizes) -> list[Mark]:
    """The surface of a terrain, with shadows on it; a grid on tops of less than 45 degrees, and its edges."""
    at, reach = f"terrain/{place}", REACH * sizes.body
    low, high = shown.low - reach, shown.high + reach
    edges, lines = list[primitives.Primitive](), list[Mesh]()
    cell = shapes.round_number(0.12 * sizes.body)
    meshes, flat, sides = _parts(shown.terrain, low, high)
    base = _base(meshes, flat, SKIRT * sizes.body)
    mesh = _whole(meshes, flat, sides, base)
    if not len(mesh.faces):
        return []
    for solid in shown.terrain.solids:
        for ends in () if isinstance(solid, Heights) else _edges(solid, low, high, base):
            edges.append(primitives.line(ends + shown.shift, radius=0.6 * sizes.line))
    for normal, corners in flat:
        if normal[2] > np.sqrt(0.5):
            lines += [shapes.ribbon(a, b, normal, 0.5 * sizes.line) for a, b in _grid(corners, cell)]
    # Below the patches of the contacts, so that the two do not flicker.
    down = shown.shift - [0.0, 0.0, 0.5 * sizes.lift]
    top = mesh.vertices[mesh.vertices[:, 2].argmax()] + shown.shift
    label, hover = (Label(shown.title, shown.lines, top, tag=tag) for tag in (True, False))
    grid = joined(lines).placed(np.eye(3), 0.5 * (down + shown.shift))
    return [
        Mark(f"{at}/solid", mesh.placed(np.eye(3), down), TERRAIN_COLOR, layer="surfaces", label=label, scenery=True),
        Mark(f"{at}/grid", grid, EDGE_COLOR, 0.35, layer="surfaces", label=hover, scenery=True),
        Mark(f"{at}/edges", edges, EDGE_COLOR, layer="surfaces", label=hover, scenery=True),
    ]


Faces: TypeAlias = list[tuple[Array, Array]]
"""(outward normal, corners in order) of each face."""


def surface_of(terrain: Terrain, low: Array, high: Array, skirt: float) -> Mesh:
    """The triangles of a terrain in a box of x and y, with its sides down to below the lowest top in it.

    Args:
        terrain: Which.
        low: Lowest corner of the box, shape (3,) [m].
        high: Highest corner.
        skirt: How far below [m].
    """
    meshes, flat, sides = _parts(terrain, low, high)
    return _whole(meshes, flat, sides, _base(meshes, flat, skirt))


def _parts(terrain: Terrain, low: Array, high: Array) -> tuple[list[Mesh], Faces, list[Array]]:
    """(grids, faces that look up, corners of others) in a box of x and y."""
    meshes, flat, sides = list[Mesh](), list[tuple[Array, Array]](), list[Array]()
    for solid in terrain.solids:
        if isinstance(solid, Heights):
            meshes.append(_surface(solid, low, high))
            continue
        for normal, corners in faces_of(solid, low, high):
            if normal[2] > 1e-6:
                flat.append((normal, corners))
            else:
                sides.append(corners)
    return meshes, flat, sides


def _base(meshes: Sequence[Mesh], flat: Faces, skirt: float) -> Array:
    """The plane (n, d) at which sides end, below the lowest top."""
    tops = [corners[:, 2].min() for _, corners in flat] + [mesh.vertices[:, 2].min() for mesh in meshes if len(mesh.faces)]
    return np.array([0.0, 0.0, -1.0, skirt - min(tops, default=0.0)])


def _whole(meshes: Sequence[Mesh], flat: Faces, sides: Sequence[Array], base: Array) -> Mesh:
    return joined([*meshes, *(_fan(corners) for _, corners in flat), *(_fan(_cut(corners, base)) for corners in sides)])


def faces_of(piece: Piece, low: Array, high: Array) -> Faces:
    """(outward normal, corners in order) of its faces as far as they are above a box of x and y; of a half-space in the box."""
    planes = _walls(low, high)
    whole = not len(piece.vertices)
    out = []
    for face, loop in zip(piece.faces, piece.loops, strict=True):
        n = face[:3]
        if whole:
            middle = 0.5 * (low + high)
            size, axes = 2.0 * float(np.linalg.norm(high - low)), across(n)
            square = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]]) * size
            corners = middle + (face[3] - n @ middle) * n + square @ axes
        else:
            corners = piece.vertices[list(loop)]
        for plane in planes if whole else planes[[0, 1, 3, 4]]:
            corners = _cut(corners, plane)
        if len(corners) > 2:
            out.append((n, corners))
    return out


def _walls(low: Array, high: Array) -> Array:
    """The planes of a box, rows (n, d) with n . x <= d inside, shape (6, 4)."""
    return np.column_stack([np.vstack([np.eye(3), -np.eye(3)]), np.concatenate([high, -low])])


def _cut(corners: Array, plane: Array) -> Array:
    """What of a polygon has n . x <= d; plane is (n, d)."""
    if not len(corners):
        return corners
    off = corners @ plane[:3] - plane[3]
    if (off <= 0.0).all():
        return corners
    out = []
    for a, b, s, t in zip(corners, np.roll(corners, -1, axis=0), off, np.roll(off, -1), strict=True):
        if s <= 0.0:
            out.append(a)
        if (s < 0.0 < t) or (t < 0.0 < s):
            out.append(a + s / (s - t) * (b - a))
    return np.reshape(out, (-1, 3))


def _fan(corners: Array) -> Mesh:
    """Triangles of a convex polygon, which share no corners with others: its shading is flat."""
    k = np.arange(1, max(len(corners) - 1, 1))
    return Mesh(corners, np.column_stack([np.zeros(len(k), int), k, k + 1]))


def _edges(piece: Piece, low: Array, high: Array, base: Array) -> list[Array]:
    """Its edges that are bent, inside a box and above the base, shape (2, 3) each [m]."""
    out = []
    planes = _walls(low, high)[[0, 1, 3, 4]]
    for a, b, one, two in piece.edges.tolist():
        if piece.faces[one, :3] @ piece.faces[two, :3] > BENT:
            continue
        ends = piece.vertices[[a, b]]
        for plane in (*planes, base):
            off = ends @ plane[:3] - plane[3]
            if (off > 0.0).all():
                break
            if (off > 0.0).any():
                crossing = ends[0] + off[0] / (off[0] - off[1]) * (ends[1] - ends[0])
                ends = np.array([crossing, ends[1]]) if off[0] > 0.0 else np.array([ends[0], crossing])
        else:
            out.append(ends)
    return out


def _grid(corners: Array, cell: float) -> list[Array]:
    """Lines of a polygon at whole multiples of `cell` along x and y, shape (2, 3) each [m]."""
    out, after = [], np.roll(corners, -1, axis=0)
    for axis in (0, 1):
        x, y = corners[:, axis], after[:, axis]
        for at in cell * np.arange(np.ceil(x.min() / cell + 1e-9), np.ceil(x.max() / cell - 1e-9)):
            crosses = np.flatnonzero((x <= at) != (y <= at))
            if len(crosses) == 2:
                share = ((at - x[crosses]) / (y[crosses] - x[crosses]))[:, None]
                out.append(corners[crosses] + share * (after[crosses] - corners[crosses]))
    return out


def _surface(grid: Heights, low: Array, high: Array) -> Mesh:
    """The triangles of a grid of heights in a box of x and y, cut as its prisms are."""
    ends = np.array(grid.z.shape) - 1
    first = np.clip(np.floor((low[:2] - grid.origin) / grid.spacing), 0, ends).astype(int)
    last = np.clip(np.ceil((high[:2] - grid.origin) / grid.spacing), 0, ends).astype(int)
    if (last <= first).any():
        return joined([])
    step = max(1, int(np.ceil(np.sqrt(np.prod(last - first) / MOST_CELLS))))
    i, j = (np.unique([*range(a, b, step), b]) for a, b in zip(first, last, strict=True))
    x, y = grid.origin[0] + grid.spacing[0] * i, grid.origin[1] + grid.spacing[1] * j
    P = np.stack([*np.meshgrid(x, y, indexing="ij"), grid.z[np.ix_(i, j)]], axis=-1)
    a, b, c, d = P[:-1, :-1], P[1:, :-1], P[1:, 1:], P[:-1, 1:]
    corners = np.stack([a, b, c, a, c, d], axis=2).reshape(-1, 3)
    return Mesh(corners, np.arange(len(corners)).reshape(-1, 3))
