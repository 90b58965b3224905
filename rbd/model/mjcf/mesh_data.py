"""Corners and triangles of a mesh: from an STL, OBJ or MSH file, or from the text of the MJCF file itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rbd.arrays import Array
from rbd.errors import ModelError
from rbd.model.mesh_files import mesh_bytes

LARGEST = 1e6
"""No coordinate is larger, in the file's unit."""
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def read_mesh(path: Path) -> tuple[Array, Array, int]:
    """(corners (k, 3), triangles (m, 3), corners of the file's widest face); MuJoCo keeps coordinates in single precision.

    Raises:
        ValueError: why not, to be put behind the file's name.
    """
    readers = {".stl": _stl, ".obj": _obj, ".msh": _msh}
    try:
        kind, data = mesh_bytes(path, readers)
    except ModelError as error:
        raise ValueError(str(error)) from None
    vertices, faces, widest = readers[kind](data)
    return *checked(vertices, faces), widest


def checked(vertices: Array, faces: Array) -> tuple[Array, Array]:
    """The same.

    Raises:
        ValueError: numbers that are not finite or too large, triangles of corners that are not there.
    """
    if not len(vertices) or not (np.abs(vertices) <= LARGEST).all():
        raise ValueError(f"has no corners, or coordinates that are not finite or above {LARGEST:g}")
    if len(faces) and not (0 <= faces.min() and faces.max() < len(vertices)):
        raise ValueError("has triangles of corners that are not there")
    return vertices, faces


def hull(vertices: Array) -> Array:
    """The triangles of the convex hull of points, counter-clockwise as seen from outside, shape (m, 3).

    Raises:
        ValueError: points in a plane.
    """
    from scipy.spatial import ConvexHull, QhullError  # 0.2 s to import, and few files need it

    if len(vertices) < 4:
        raise ValueError("has fewer than four corners")
    try:
        found = ConvexHull(vertices)
    except QhullError:
        raise ValueError("has all its corners in one plane") from None
    faces, outward = np.array(found.simplices), found.equations[:, :3]
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.einsum("fi,fi->f", normals, outward) < 0.0
    faces[inward] = faces[inward][:, ::-1]
    return faces


def _stl(data: bytes) -> tuple[Array, Array, int]:
    count = int.from_bytes(data[80:84], "little") if len(data) >= 84 else 0
    if not count or 84 + 50 * count > len(data):
        raise ValueError("is no whole binary STL file")
    corners = np.frombuffer(data, _TRIANGLE, count, offset=84)["corners"].astype(float)
    return corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3), 3


def _obj(data: bytes) -> tuple[Array, Array, int]:
    corners: list[list[float]] = []
    rings: list[list[int]] = []
    try:
        for line in data.decode("utf-8", "replace").splitlines():
            words = line.split()
            if words[:1] == ["v"]:
                x, y, z = words[1:4]
                corners.append([float(_plain(word)) for word in (x, y, z)])
            elif words[:1] == ["f"]:
                ring = [int(_plain(word.split("/")[0])) for word in words[1:]]
                rings.append([i - 1 if i > 0 else len(corners) + i for i in ring])
        vertices = np.array(corners, np.float32).reshape(-1, 3).astype(float)
    except (ValueError, OverflowError):
        raise ValueError("is no OBJ file that can be read") from None
    checked(vertices, np.array([i for ring in rings for i in ring], int))
    faces = [triangle for ring in rings for triangle in _cut(vertices, ring)]
    return vertices, np.array(faces, int).reshape(-1, 3), max(map(len, rings), default=0)


def _plain(word: str) -> str:
    """A number as other readers take it: Python's 1_0 is their 1."""
    if "_" in word:
        raise ValueError(word)
    return word


def _cut(vertices: Array, ring: list[int]) -> list[list[int]]:
    """Triangles of a face: of four corners along the shorter diagonal, as MuJoCo takes it; of more, all at the first corner."""
    if len(ring) == 4:
        a, b, c, d = ring
        across, other = vertices[a] - vertices[c], vertices[b] - vertices[d]
        if not across @ across < other @ other:
            return [[a, b, d], [b, c, d]]
    return [[ring[0], ring[k], ring[k + 1]] for k in range(1, len(ring) - 1)]


def _msh(data: bytes) -> tuple[Array, Array, int]:
    """MuJoCo's own: the numbers of corners, normals, texture points and triangles, then these."""
    if len(data) < 16:
        raise ValueError("is no whole MSH file")
    corners, normals, textures, triangles = (int(n) for n in np.frombuffer(data, "<i4", 4))
    size = 16 + 12 * (corners + normals + triangles) + 8 * textures
    if min(corners, normals, textures, triangles) < 0 or len(data) != size:
        raise ValueError("is no whole MSH file")
    vertices = np.frombuffer(data, "<f4", 3 * corners, offset=16).astype(float).reshape(-1, 3)
    faces = np.frombuffer(data, "<i4", 3 * triangles, offset=len(data) - 12 * triangles).astype(int).reshape(-1, 3)
    return vertices, faces, 3
