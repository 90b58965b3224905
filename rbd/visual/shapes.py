"""Triangles of what has no simpler form: pieces of robots, coils, ribbons; round numbers, and the outermost of some points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from rbd.arrays import Array, locked


@dataclass(frozen=True, eq=False, slots=True)
class Mesh:
    """Triangles in space.

    Attributes:
        vertices: Corner points, shape (n, 3) [m].
        faces: Three vertex numbers a triangle, shape (m, 3).
    """

    vertices: Array
    faces: Array

    def scaled(self, by: Array | Sequence[float]) -> Mesh:
        """The same triangles, with each axis times a factor, shape (3,)."""
        return Mesh(self.vertices * by, self.faces)

    def placed(self, rotation: Array, translation: Array) -> Mesh:
        """The same triangles, turned and then shifted: R_AB of shape (3, 3), p_AB of shape (3,) [m]."""
        return Mesh(self.vertices @ np.asarray(rotation).T + translation, self.faces)


def joined(meshes: Sequence[Mesh]) -> Mesh:
    """One mesh with the triangles of all."""
    if not meshes:
        return Mesh(np.zeros((0, 3)), np.zeros((0, 3), int))
    starts = np.cumsum([0] + [len(m.vertices) for m in meshes[:-1]])
    return Mesh(
        np.vstack([m.vertices for m in meshes]),
        np.vstack([m.faces + start for m, start in zip(meshes, starts, strict=True)]),
    )


def axes_along(direction: Array) -> Array:
    """A rotation whose third column points along `direction`, shape (3, 3); the identity for a zero direction."""
    length = float(np.linalg.norm(direction))
    if length == 0.0:
        return np.eye(3)
    n = np.asarray(direction, float) / length
    # The world axis least along n gives the best-conditioned first tangent.
    t = np.cross(np.eye(3)[int(np.argmin(np.abs(n)))], n)
    t /= np.linalg.norm(t)
    return np.column_stack([t, np.cross(n, t), n])


def revolved(profile: Sequence[tuple[float, float]], *, smooth: bool = False, segments: int = 32) -> Mesh:
    """Surface swept by a profile turned about the z axis.

    Args:
        profile: Points (radius, height) [m], upwards with the outside on their right for outward triangles.
        smooth: Whether the profile's corners are rounded by the shading; sharp by default.
        segments: Number of facets around the axis.
    """
    return _revolved(tuple((float(r), float(z)) for r, z in profile), smooth, segments)


@lru_cache(maxsize=64)
def _revolved(profile: tuple[tuple[float, float], ...], smooth: bool, segments: int) -> Mesh:
    """The same, kept: balls and rings of one size are in a scene many times."""
    angles = 2.0 * np.pi * np.arange(segments) / segments
    radius, height = np.array(profile).T
    strips, n = np.arange(len(profile) - 1), len(profile)
    # A sharp edge owns two rings of vertices: shading averages normals over shared vertices only.
    rings = np.arange(n) if smooth else np.repeat(np.arange(n), 2)[1:-1]
    vertices = np.empty((len(rings), segments, 3))
    vertices[:, :, 0], vertices[:, :, 1] = np.outer(radius[rings], np.cos(angles)), np.outer(radius[rings], np.sin(angles))
    vertices[:, :, 2] = height[rings, None]
    here, low = np.arange(segments), (segments * (strips if smooth else 2 * strips))[:, None]
    after = (here + 1) % segments
    high = low + segments
    first = np.stack([low + here, low + after, high + after], axis=-1)
    second = np.stack([low + here, high + after, high + here], axis=-1)
    return Mesh(locked(vertices.reshape(-1, 3)), locked(np.stack([first, second], axis=1).reshape(-1, 3)))


def ball(radius: float, *, centre: Array | None = None, segments: int = 24) -> Mesh:
    """A sphere of this radius [m] about `centre`, shape (3,) [m]; the origin when none is given."""
    latitudes = np.linspace(-np.pi / 2.0, np.pi / 2.0, 2 * segments // 3 + 1)
    mesh = revolved([(radius * np.cos(a), radius * np.sin(a)) for a in latitudes], smooth=True, segments=segments)
    return mesh if centre is None else mesh.placed(np.eye(3), centre)


def cylinder(radius: float, length: float) -> Mesh:
    """A closed cylinder about z, centred on the origin [m]."""
    h = length / 2.0
    return revolved([(0.0, -h), (radius, -h), (radius, h), (0.0, h)])


def capsule(radius: float, length: float) -> Mesh:
    """A cylinder about z of this straight length [m], with round ends."""
    quarter = np.linspace(0.0, np.pi / 2.0, 9)
    low = [(radius * np.sin(a), -length / 2.0 - radius * np.cos(a)) for a in quarter]
    high = [(radius * np.cos(a), length / 2.0 + radius * np.sin(a)) for a in quarter]
    return revolved(low + high, smooth=True, segments=24)


def box(half_sides: Array) -> Mesh:
    """A box about the origin with these half sides, shape (3,) [m]; every face has separate vertices."""
    square = np.array([[-1.0, -1.0, 1.0], [1.0, -1.0, 1.0], [1.0, 1.0, 1.0], [-1.0, 1.0, 1.0]])
    two = np.array([[0, 1, 2], [0, 2, 3]])
    sides = []
    for axis in range(3):
        turned = np.roll(square, axis + 1, axis=1)
        sides += [Mesh(turned * half_sides, two), Mesh(-turned * half_sides, two[:, ::-1])]
    return joined(sides)


def creased(mesh: Mesh, *, angle_deg: float = 35.0) -> Mesh:
    """The same triangles with vertices doubled along sharp edges, so that shading smooths only round parts.

    Viewers average normals over the triangles that share a vertex. Here two triangles share one only if a chain of
    edges flatter than `angle_deg` leads from one to the other around it.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    faces = mesh.faces[(mesh.faces != np.roll(mesh.faces, 1, axis=1)).all(axis=1)]
    a, b, c = (mesh.vertices[faces[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    # Half edges, each named by its lower and upper vertex; equal neighbours after sorting are one edge of two faces.
    here = np.arange(faces.size)
    after = here - here % 3 + (here + 1) % 3
    ends = np.stack([faces.ravel(), faces.ravel()[after]], axis=1)
    swap = ends[:, 0] > ends[:, 1]
    corners = np.where(swap[:, None], np.stack([after, here], axis=1), np.stack([here, after], axis=1))
    ends.sort(axis=1)
    order = np.lexsort((ends[:, 1], ends[:, 0]))
    one, two = order[:-1], order[1:]
    # Neighbours run along their edge in opposite directions; where they do not, their normals would cancel.
    same = (ends[one] == ends[two]).all(axis=1) & (swap[one] != swap[two])
    flat = np.einsum("ij,ij->i", normals[one // 3], normals[two // 3]) > np.cos(np.radians(angle_deg))
    one, two = one[same & flat], two[same & flat]
    links = np.concatenate([corners[one], corners[two]], axis=1)
    rows, columns = links[:, :2].ravel(), links[:, 2:].ravel()
    graph = coo_array((np.ones(len(rows)), (rows, columns)), shape=(faces.size, faces.size))
    count, group = connected_components(graph, directed=False)
    vertices = np.zeros((count, 3))
    vertices[group] = mesh.vertices[faces.ravel()]
    return Mesh(vertices, group.reshape(-1, 3))


def ribbon(start: Array, end: Array, normal: Array, width: float) -> Mesh:
    """A flat line from `start` to `end`, shape (3,) [m], in the plane with this normal, so wide [m]: two triangles."""
    along = end - start
    side = np.cross(normal, along)
    length = float(np.linalg.norm(side))
    if length == 0.0:
        return joined([])
    half = 0.5 * width / length * side
    return Mesh(np.array([start - half, end - half, end + half, start + half]), np.array([[0, 1, 2], [0, 2, 3]]))


def tube(points: Array, radius: float, sides: int = 8) -> Mesh:
    """One tube through many points, shape (n, 3) [m], with its ends closed: rings that are turned as little as possible."""
    points = points[np.concatenate([[True], np.linalg.norm(np.diff(points, axis=0), axis=1) > 1e-12])]
    if len(points) < 2:
        return joined([])
    along = np.diff(points, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    tangents = np.concatenate([along[:1], along[:-1] + along[1:], along[-1:]])
    lengths = np.linalg.norm(tangents, axis=1, keepdims=True)
    tangents = np.where(lengths > 1e-9, tangents / np.maximum(lengths, 1e-12), np.concatenate([along, along[-1:]]))
    side, rings = axes_along(tangents[0])[:, 0], []
    turn = 2.0 * np.pi * np.arange(sides) / sides
    for p, t in zip(points, tangents, strict=True):
        flat = side - (side @ t) * t
        side = flat / np.linalg.norm(flat) if np.linalg.norm(flat) > 1e-9 else axes_along(t)[:, 0]
        rings.append(p + radius * (np.outer(np.cos(turn), side) + np.outer(np.sin(turn), np.cross(t, side))))
    here = np.arange(sides)
    low, after = sides * np.arange(len(points) - 1)[:, None], (here + 1) % sides
    faces = [
        np.stack([low + here, low + after, low + sides + after], -1),
        np.stack([low + here, low + sides + after, low + sides + here], -1),
    ]
    side_walls = Mesh(np.concatenate(rings), np.concatenate([f.reshape(-1, 3) for f in faces]))
    return joined([side_walls, *(ball(radius, centre=end, segments=12) for end in (points[0], points[-1]))])


def round_number(x: float) -> float:
    """The nearest of 1, 2 and 5 times a power of ten, by ratio."""
    power = 10.0 ** np.floor(np.log10(x))
    return float(min((c * power for c in (1.0, 2.0, 5.0, 10.0)), key=lambda c: abs(np.log(c / x))))


_BLOCK = 1024
"""Points that are looked at together: 300 directions of so many stay in the cache."""


def outermost(points: Array, *, directions: int = 300) -> Array:
    """The points that lie farthest out along evenly spread directions: enough to frame a picture, shape (n, 3)."""
    k = np.arange(directions) + 0.5
    z, turn = 1.0 - 2.0 * k / directions, np.pi * (1.0 + np.sqrt(5.0)) * k
    ring = np.sqrt(1.0 - z**2)
    spread = np.column_stack([ring * np.cos(turn), ring * np.sin(turn), z])
    farthest, found, every = np.full(directions, -np.inf), np.zeros(directions, int), np.arange(directions)
    for start in range(0, len(points), _BLOCK):
        along = spread @ points[start : start + _BLOCK].T
        most = along.argmax(axis=1)
        better = along[every, most] > farthest
        farthest[better], found[better] = along[every, most][better], start + most[better]
    return points[np.unique(found)]
