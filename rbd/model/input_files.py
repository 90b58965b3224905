"""Input files, XML and meshes: found only in allowed folders, and checked as bytes before a reader opens them.

What could fill the memory or lead elsewhere is refused. Meshes are taken from the folders of the robot's packages and from
nowhere else. Assimp reads some forty formats, follows references to other files, and never returns on some headers; coal takes
NaN. So of meshes only the three formats that robots use are taken, and what their bytes betray is refused here.
"""

from __future__ import annotations

import re
import stat
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from rbd.arrays import Array, check_whole
from rbd.displayed import Displayed
from rbd.errors import ModelError

_BODY = re.compile(rb"<(?:link|body)[\s/>]")
_DECLARATION = re.compile(rb"<!(?i:doctype|entity)")
_ATTRIBUTE = re.compile(rb"=\s*[\"']")
_ENCODING = re.compile(rb"<\?xml[^>]*encoding\s*=\s*[\"']([^\"']*)")
_BYTE_FOR_BYTE = ("utf-8", "utf8", "us-ascii", "ascii")
MOST_BYTES = 256 * 2**20
LARGEST = 1e6
"""No coordinate of a mesh is larger, in the file's unit: a kilometre in millimetres."""
OUTSIDE = "is outside the package folders"
MISSING = "is not there"
_STL_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_MATERIALS = re.compile(rb"^[ \t]*mtllib[ \t]+([^\r\n]+)", re.MULTILINE)
_NO_NUMBER = re.compile(rb"(?:[\d.]\s+|>\s*|\bv\s+)[-+]?(?:nan|inf)", re.IGNORECASE)
_MAYBE_NO_NUMBER = tuple(word.encode() for word in ("nan", "NaN", "NAN", "Nan", "inf", "Inf", "INF"))


@dataclass(frozen=True, kw_only=True)
class FileLimits(Displayed):
    """Limits of the size of a robot's file; raise the one in question: `load_robot(path, limits=FileLimits(max_dof=400))`.

    Attributes:
        max_bytes: Size of the file.
        max_elements: Elements, comments and ends of elements together.
        max_links: Links of a URDF, bodies of an MJCF; Pinocchio's readers recurse over them, and a chain of 4,000 ends the
            process.
        max_dof: Degrees of freedom; one `pin.Data` takes about 32 nv^3 bytes, so 400 of them want 2 GB.
        max_attributes: An element of so many attributes is refused.
        max_depth: Elements inside elements.

    Example:
        >>> small = rbd.model.FileLimits(max_dof=10)
        >>> rbd.load_robot("solo12", limits=small)
        Traceback (most recent call last):
            ...
        rbd.errors.ModelError: ...
    """

    max_bytes: int = 64_000_000
    max_elements: int = 1_000_000
    max_links: int = 2_000
    max_dof: int = 200
    max_attributes: int = 10_000
    max_depth: int = 250

    def __post_init__(self) -> None:
        for field in fields(self):
            check_whole(f"FileLimits.{field.name}", getattr(self, field.name), 2**40)


def read_xml(path: Path, limits: FileLimits) -> ElementTree.Element:
    """The first element of a file, its tag without namespace.

    Raises:
        ModelError: no regular file, too large, with a document type or entities, in an encoding other than UTF-8, or no XML.
    """
    return parse_xml(path.name, file_bytes(path, limits.max_bytes), limits)


def parse_xml(name: str, data: bytes, limits: FileLimits) -> ElementTree.Element:
    """The first element of a text in memory, its tag without namespace.

    Args:
        name: Of the file, for messages.
        data: Its bytes.
        limits: How large it may be.

    Raises:
        ModelError: as `read_xml`.
    """
    if len(data) > limits.max_bytes:
        raise _too_large(name, f"is larger than {limits.max_bytes / 1e6:g} MB", "max_bytes")
    _check_bytes(name, data, limits)
    try:
        element = ElementTree.fromstring(data)
    except (ElementTree.ParseError, UnicodeError, ValueError, LookupError) as error:
        raise ModelError(f"{name} cannot be read as XML: {error}.") from None
    _check_depth(name, element, limits)
    if element.tag.startswith("{"):  # a default namespace, as Drake's files have it
        space = element.tag[: element.tag.index("}") + 1]
        for e in element.iter():
            e.tag = e.tag.removeprefix(space)
    return element


def is_file(path: Path) -> bool:
    """Whether there is a file; not so where one may not look, and where no file can have this name."""
    try:
        return path.is_file()
    except (OSError, ValueError):  # a name too long, a folder without permission; a null character
        return False


def file_bytes(path: Path, most: int, expected: str = "a URDF or MJCF file") -> bytes:
    """The content of a regular file, no more than one byte beyond the largest size.

    Raises:
        ModelError: no regular file, or not to be read.
    """
    try:
        found = path.stat()
        if not stat.S_ISREG(found.st_mode):  # a pipe would be waited for, a device has no end
            raise ModelError(f"{path.name:.120} is no regular file; expected {expected}.")
        with path.open("rb") as file:
            return file.read(min(most, found.st_size) + 1)
    except (OSError, ValueError) as error:
        raise ModelError(f"{path.name:.120} cannot be read: {getattr(error, 'strerror', None) or error}.") from None


def _check_bytes(file: str, data: bytes, limits: FileLimits) -> None:
    if _DECLARATION.search(data):
        raise ModelError(f"{file} has a DOCTYPE or an ENTITY in it; robots need neither, and it is not read. Take it out.")
    if b"\0" in data:
        raise ModelError(f"{file} cannot be read as XML: it has zero bytes in it, as binary and UTF-16 files do.")
    declared = _ENCODING.match(data.lstrip(b"\xef\xbb\xbf"))
    if declared and declared[1].decode("latin-1").lower() not in _BYTE_FOR_BYTE:
        raise ModelError(
            f"{file} cannot be read as XML: its encoding is {declared[1].decode('latin-1')!r:.40}. Expected UTF-8."
        )
    try:
        data.decode("utf-8")
    except UnicodeDecodeError as error:
        raise ModelError(f"{file} cannot be read as XML: byte {error.start} is {data[error.start]:#x}, not UTF-8.") from None
    links = len(_BODY.findall(data))
    if links > limits.max_links:
        raise _too_large(file, f"has {links} links; at most {limits.max_links} are taken", "max_links")
    if data.count(b"<") > limits.max_elements:
        raise _too_large(file, f"has more than {limits.max_elements} elements", "max_elements")
    for chunk in data.split(b"<") if data.count(b"=") >= limits.max_attributes else ():
        if chunk.count(b"=") >= limits.max_attributes and len(_ATTRIBUTE.findall(chunk)) >= limits.max_attributes:
            raise _too_large(
                file, f"has {limits.max_attributes} attributes or more on <{chunk[:40].split()[0].decode()}>", "max_attributes"
            )


def _check_depth(file: str, element: ElementTree.Element, limits: FileLimits) -> None:
    level, depth = [element], 0
    while level:
        depth += 1
        if depth > limits.max_depth:
            raise _too_large(file, f"has elements {depth} deep inside each other", "max_depth")
        level = [child for e in level for child in e]


def _too_large(file: str, what: str, limit: str) -> ModelError:
    return ModelError(f"{file} {what}. If that is meant, raise it: load_robot(..., limits=rbd.model.FileLimits({limit}=...)).")


def find_mesh(name: str, base: Path, folders: Iterable[Path]) -> Path:
    """The file that a mesh's name means, links resolved, inside one of the folders.

    Args:
        name: `package://name/file`, `file:///file`, or a path; relative ones start from `base`, then from the folders.
        base: The folder of the robot's file.
        folders: Where `package://` starts from, and where the file must lie.

    Raises:
        ModelError: the reason, to follow the name: `OUTSIDE`, `MISSING`, or a message about its scheme.
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
            inside |= is_inside(place, real_folders)
            continue
        if is_inside(real, real_folders):
            return real
        there = True
    raise ModelError(MISSING if inside and not there else OUTSIDE)


def is_inside(path: Path, real_folders: Iterable[Path]) -> bool:
    """Whether a path is in one of the folders, links and dots resolved as far as it exists."""
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
    """A binary STL states the number of triangles, 50 bytes each; a text one begins with 'solid' and has facets."""
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
            if not is_inside(path.parent / name, real_folders):
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
