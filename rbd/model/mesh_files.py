"""Mesh files: found inside the folders of the robot's packages and nowhere else, and looked at before a reader opens them.

Assimp reads some forty formats, follows references to other files, and never returns on some headers; coal takes NaN.
So only the three formats that robots use are taken, and what their bytes betray is refused here.
"""

from __future__ import annotations

import re
import stat
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from rbd.arrays import Array
from rbd.errors import ModelError

MOST_BYTES = 256 * 2**20
LARGEST = 1e6
"""No coordinate is larger, in the file's unit: a kilometre in millimetres."""
OUTSIDE = "is outside the package folders"
MISSING = "is not there"

_STL_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_MATERIALS = re.compile(rb"^[ \t]*mtllib[ \t]+([^\r\n]+)", re.MULTILINE)
_NO_NUMBER = re.compile(rb"(?:[\d.]\s+|>\s*|\bv\s+)[-+]?(?:nan|inf)", re.IGNORECASE)
_MAYBE_NO_NUMBER = tuple(word.encode() for word in ("nan", "NaN", "NAN", "Nan", "inf", "Inf", "INF"))


def find_mesh(name: str, base: Path, folders: Iterable[Path]) -> Path:
    """The file that a mesh's name means, links resolved, inside one of the folders.

    Args:
        name: `package://name/file`, `file:///file`, or a path; relative ones start from `base`, then from the folders.
        base: The folder of the robot's file.
        folders: Where `package://` starts from, and where the file must lie.

    Raises:
        ModelError: why not, to be put behind the name: `OUTSIDE`, `MISSING`, or words about its scheme.
    """
    scheme, separator, rest = name.partition("://")
    folders = list(folders)
    if separator and scheme == "package":
        places = [folder / rest.lstrip("/") for folder in folders]
    elif separator and scheme == "file":
        places = [Path("/" + rest.lstrip("/"))]
    elif separator:
        raise ModelError(f"begins with {scheme[:20]!r}; expected package://, file:// or a path")
    else:
        places = [base / name, *(folder / name for folder in folders)]
    real_folders = [folder.resolve() for folder in folders]
    there, inside = False, False
    for place in places:
        try:
            real = place.resolve(strict=True)
        except (OSError, RuntimeError, ValueError):  # not there, a loop of links, a folder that is not ours, a zero byte
            inside |= _inside(place, real_folders)
            continue
        if _inside(real, real_folders):
            return real
        there = True
    raise ModelError(MISSING if inside and not there else OUTSIDE)


def _inside(path: Path, real_folders: Iterable[Path]) -> bool:
    """Whether a path lies in one of the folders, links and dots resolved as far as it exists."""
    try:
        real = path.resolve()
    except (OSError, RuntimeError, ValueError):
        return False
    return any(real.is_relative_to(folder) for folder in real_folders)


def mesh_bytes(path: Path, kinds: Iterable[str]) -> tuple[str, bytes]:
    """(ending, content) of a mesh file, a regular one of at most `MOST_BYTES`.

    Args:
        path: Of the file.
        kinds: Endings that are read, with their dots.

    Raises:
        ModelError: why not, to be put behind the file's name.
    """
    kind, known = path.suffix.lower(), tuple(kinds)
    if kind not in known:
        raise ModelError(f"is a {kind or 'nameless'} file; expected {', '.join(known)}")
    try:
        found = path.stat()
        if not stat.S_ISREG(found.st_mode):  # a pipe would be waited for, a device has no end
            raise ModelError("is no regular file")
        if found.st_size > MOST_BYTES:
            raise ModelError(f"is larger than {MOST_BYTES // 2**20} MiB")
        return kind, path.read_bytes()
    except OSError as error:
        raise ModelError(f"cannot be read ({error.strerror})") from None


def check_mesh(path: Path, folders: Iterable[Path]) -> None:
    """Refuse a mesh file that no reader should open.

    Raises:
        ModelError: why, to be put behind the file's name.
    """
    kind, data = mesh_bytes(path, _CHECKS)
    if not data:
        raise ModelError("is empty")
    _CHECKS[kind](data)
    if kind == ".obj":
        _check_materials(data, path, folders)


def _check_stl(data: bytes) -> None:
    """A binary STL says how many triangles follow, 50 bytes each; a text one begins with 'solid' and has facets."""
    count = int.from_bytes(data[80:84], "little") if len(data) >= 84 else 0
    if count and 84 + 50 * count <= len(data):
        corners = np.frombuffer(data, _STL_TRIANGLE, count, offset=84)["corners"]
        if not (np.abs(corners) <= LARGEST).all():
            raise ModelError(f"has coordinates that are not finite, or above {LARGEST:g}")
    elif not data.lstrip()[:5].lower() == b"solid" or b"vertex" not in data:
        raise ModelError("is no whole STL file")
    else:
        _check_numbers(data)


def _check_collada(data: bytes) -> None:
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        raise ModelError("has a DOCTYPE or an ENTITY")
    if b"<COLLADA" not in data[:4096] and b"COLLADA" not in data[:65536]:
        raise ModelError("is no Collada file")
    _check_numbers(data)


def _check_numbers(data: bytes) -> None:
    if any(word in data for word in _MAYBE_NO_NUMBER) and _NO_NUMBER.search(data):
        raise ModelError("has NaN or infinity in it")


def _check_materials(data: bytes, path: Path, folders: Iterable[Path]) -> None:
    """The material files of an OBJ are opened too: they must lie where meshes may."""
    real_folders = [folder.resolve() for folder in folders]
    for line in _MATERIALS.findall(data):
        words = line.decode("utf-8", "replace").strip()
        for name in {words, *words.split()}:
            if not _inside(path.parent / name, real_folders):
                raise ModelError("names a material file outside the package folders")


_CHECKS = {".stl": _check_stl, ".dae": _check_collada, ".obj": _check_numbers}


def check_scale(text: str | None) -> Array:
    """The scale of a mesh, shape (3,); ones where it is not given.

    Raises:
        ModelError: not three finite numbers, or a zero.
    """
    try:
        scale = np.array([float(word) for word in ("1 1 1" if text is None else text).split()])
    except ValueError:
        scale = np.zeros(0)
    if scale.shape != (3,) or not (np.abs(scale) <= LARGEST).all() or not scale.all():
        raise ModelError(f"has the scale {text!r:.60}; expected three finite numbers, none of them zero")
    return scale
