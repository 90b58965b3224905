"""The meshes of an MJCF file: found, read once on first use (STL, OBJ, MSH), moved and scaled as in the file."""

from __future__ import annotations

import os.path
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np

from rbd.arrays import Array
from rbd.errors import ModelError, nearest
from rbd.model.input_files import mesh_bytes
from rbd.model.mjcf.elements import Defaults, check_attributes
from rbd.model.mjcf.poses import rotation
from rbd.model.mjcf.settings import Settings, keyword, numbers
from rbd.model.mjcf.solids import Solid, mesh_solid
from rbd.model.urdf import FARTHEST, Complaints

Element = ElementTree.Element
SMALLEST_SCALE, LARGEST_SCALE = 1e-9, 1e6
_ELSEWHERE = "Copy it there, or give the folder above both: load_robot(..., package_dirs=[folder])"
LARGEST = 1e6
"""No coordinate is larger, in the file's unit."""
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


@dataclass(frozen=True, eq=False)
class Surface:
    """A mesh: corners (k, 3) [m] and triangles (m, 3), counter-clockwise as seen from outside; none where the file has none.

    Of what the file draws, the widest face has so many corners.
    """

    vertices: Array
    faces: Array
    widest: int = 3


class Meshes:
    """The <mesh> assets of a file.

    Args:
        wrong: Where complaints go.
        root: The file's first element, includes carried out.
        defaults: Its default classes.
        settings: Its settings.
        folder: Where it is.
        folders: Folders of meshes, besides that folder.
    """

    def __init__(
        self, wrong: Complaints, root: Element, defaults: Defaults, settings: Settings, folder: Path, folders: tuple[Path, ...]
    ) -> None:
        self._wrong, self._settings = wrong, settings
        self._folder, self._inside = folder, [each.resolve() for each in (folder, *folders)]
        self._surfaces: dict[str, Surface] = {}
        self._solids: dict[str, Solid] = {}
        self._elements: dict[str, Element] = {}
        for raw in root.findall("asset/mesh"):
            element = defaults.resolved(raw)
            name = element.get("name") or PurePosixPath(element.get("file", "").replace("\\", "/")).stem
            check_attributes(wrong, f"mesh {name!r:.80}", element)
            if name in self._elements:
                wrong.stop(f"two meshes are called {name!r:.80}; expected different names.")
            self._elements[name] = element

    def element(self, what: str, name: str) -> Element:
        """A mesh's element.

        Raises:
            ModelError: no such mesh, with the nearest names.
        """
        if name not in self._elements:
            self._wrong.stop(f"{what} names a mesh {name!r:.80}, which is not in the file; {nearest(name, self._elements)}.")
        return self._elements[name]

    def surface(self, what: str, name: str) -> Surface:
        """A mesh, moved by its refpos and refquat, then scaled.

        Raises:
            ModelError: a mesh that is missing, outside the folders or broken.
        """
        self.element(what, name)
        try:
            return self.load(name)
        except ValueError as error:
            self._wrong.stop(f"mesh {name!r:.80} {error}.")

    def load(self, name: str) -> Surface:
        """The same of a mesh that is in the file.

        Raises:
            ValueError: why not, to be put behind its name.
        """
        if name not in self._surfaces:
            element = self._elements[name]
            self._surfaces[name] = self._moved(name, element, *self._raw(name, element))
        return self._surfaces[name]

    def files(self) -> dict[str, str]:
        """{file as it is named: where it is, relative to the folder of the robot's file}."""
        found = [element.get("file", "") for element in self._elements.values() if element.get("file") is not None]
        return {file: os.path.join(self._settings.mesh_folder, self._wanted(file)) for file in found}

    def file(self, name: str) -> tuple[str, str] | None:
        """(its file as it is named, where that is) of a mesh; None where its corners are in the text."""
        named = self._elements[name].get("file")
        return None if named is None else (named, os.path.join(self._settings.mesh_folder, self._wanted(named)))

    def check_folders(self) -> None:
        """Refuse files outside the folders, opened or not.

        Raises:
            ModelError: naming the file.
        """
        for file, place in self.files().items():
            try:
                inside = any((self._folder / place).resolve().is_relative_to(folder) for folder in self._inside)
            except (OSError, ValueError, RuntimeError):
                inside = False
            if not inside:
                told = f"<mesh> names the file {file!r:.200}, outside the folder of {self._wrong.file}"
                self._wrong.stop(f"{told}. {_ELSEWHERE}.")

    def solid(self, what: str, name: str) -> Solid:
        """What a mesh weighs at density one.

        Raises:
            ModelError: one that encloses no volume.
        """
        if name not in self._solids:
            element, surface = self.element(what, name), self.surface(what, name)
            kinds = ("legacy", "exact", "convex", "shell")
            kind = keyword(self._wrong, f"mesh {name!r:.80}", element, "inertia", "legacy", kinds)
            try:
                convex = kind == "convex" or not len(surface.faces)
                if convex and element.get("maxhullvert", "-1") != "-1":
                    raise ValueError("has maxhullvert, with which its convex hull is not known. Take it out")
                if not convex and surface.widest > 4:  # of 200 corners it leaves out a third of a disc
                    raise ValueError(
                        f"has a face of {surface.widest} corners; MuJoCo's triangles of such a face may leave "
                        "gaps, so that its mass would be another one. Export it with triangles"
                    )
                faces = hull(surface.vertices) if convex else surface.faces
                self._solids[name] = mesh_solid(surface.vertices, faces, kind)
            except ValueError as error:
                self._wrong.stop(f"mesh {name!r:.80} {error}. {what} needs it for its mass; or give the body an <inertial>.")
        return self._solids[name]

    def scale(self, name: str, element: Element) -> Array:
        """The scale of a mesh, shape (3,).

        Raises:
            ModelError: a factor that is zero or nearly so, or no number.
        """
        what = f"mesh {name!r:.80}"
        scale = np.array(numbers(self._wrong, what, element, "scale", 3, (1.0, 1.0, 1.0)))
        if not ((np.abs(scale) >= SMALLEST_SCALE) & (np.abs(scale) <= LARGEST_SCALE)).all():
            told = f"{what} has the scale {element.get('scale')!r:.60}"
            self._wrong.stop(f"{told}; expected factors from {SMALLEST_SCALE:g} to {LARGEST_SCALE:g}, or a mirror's of -1.")
        return scale

    def _raw(self, name: str, element: Element) -> tuple[Array, Array, int]:
        what = f"mesh {name!r:.80}"
        if element.get("file") is not None:
            return read_mesh(self._found(element.get("file", "")))
        words = [len(element.get(key, "").split()) for key in ("vertex", "face")]
        if not words[0] or words[0] % 3 or words[1] % 3:
            raise ValueError("has neither a file nor corners, or not three numbers for each corner and triangle")
        vertices = np.array(numbers(self._wrong, what, element, "vertex", words[0], (), most=FARTHEST), np.float32)
        faces = np.array(numbers(self._wrong, what, element, "face", words[1], ()))
        if (faces != np.round(faces)).any():
            raise ValueError("has triangles whose corners are no whole numbers")
        return *checked(vertices.astype(float).reshape(-1, 3), faces.astype(int).reshape(-1, 3)), 3

    def _moved(self, name: str, element: Element, vertices: Array, faces: Array, widest: int) -> Surface:
        what = f"mesh {name!r:.80}"
        p = np.array(numbers(self._wrong, what, element, "refpos", 3, (0.0, 0.0, 0.0), most=FARTHEST))
        turn = ElementTree.Element("mesh", {} if element.get("refquat") is None else {"quat": element.get("refquat", "")})
        scale = self.scale(name, element)
        out = (vertices - p) @ rotation(self._wrong, what, turn, self._settings) * scale
        return Surface(out, faces if np.prod(scale) > 0.0 else faces[:, ::-1], widest)

    def _found(self, name: str) -> Path:
        try:
            place = (self._folder / self._settings.mesh_folder / self._wanted(name)).resolve()
            if not any(place.is_relative_to(folder) for folder in self._inside):
                told = f"names the file {name!r:.200}, outside the folder of {self._wrong.file}"
                raise ValueError(f"{told}. {_ELSEWHERE}")
            if not place.is_file():
                raise ValueError(f"names the file {name!r:.200}, which is not there")
        except (OSError, RuntimeError):
            raise ValueError(f"names the file {name!r:.200}, which is no path") from None
        return place

    def _wanted(self, name: str) -> str:
        wanted = name.replace("\\", "/")
        return PurePosixPath(wanted).name if self._settings.strip_path else wanted


def read_mesh(path: Path) -> tuple[Array, Array, int]:
    """(corners (k, 3), triangles (m, 3), corners of the file's widest face); MuJoCo stores coordinates in single precision.

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
