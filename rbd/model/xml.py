"""XML files from anywhere, as elements; what could fill the memory or lead elsewhere is refused by its bytes."""

from __future__ import annotations

import re
import stat
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass, fields
from pathlib import Path

from rbd.errors import InputError, ModelError

_BODY = re.compile(rb"<(?:link|body)[\s/>]")
_DECLARATION = re.compile(rb"<!(?i:doctype|entity)")
_ATTRIBUTE = re.compile(rb"=\s*[\"']")
_ENCODING = re.compile(rb"<\?xml[^>]*encoding\s*=\s*[\"']([^\"']*)")
_BYTE_FOR_BYTE = ("utf-8", "utf8", "us-ascii", "ascii")


@dataclass(frozen=True, kw_only=True)
class FileLimits:
    """How large a robot's file may be; raise what is in the way: `load_robot(path, limits=FileLimits(max_dof=400))`.

    Attributes:
        max_bytes: Size of the file.
        max_elements: Elements, comments and ends of elements together.
        max_links: Links of a URDF, bodies of an MJCF; Pinocchio's readers recurse over them, and a chain of 4,000 ends the
            process.
        max_dof: Degrees of freedom; one `pin.Data` takes about 32 nv^3 bytes, so 400 of them want 2 GB.
        max_attributes: An element of so many attributes is refused.
        max_depth: Elements inside elements.
    """

    max_bytes: int = 64_000_000
    max_elements: int = 1_000_000
    max_links: int = 2_000
    max_dof: int = 200
    max_attributes: int = 10_000
    max_depth: int = 250

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not isinstance(value, int) or isinstance(value, bool) or not 1 <= value <= 2**40:
                raise InputError(f"FileLimits.{field.name} is {_shown(value)}; expected a whole number from 1 to 2**40.")


def read_xml(path: Path, limits: FileLimits) -> ElementTree.Element:
    """The first element of a file, its tag without namespace.

    Raises:
        ModelError: no regular file, too large, with a document type or entities, in an encoding other than UTF-8, or no XML.
    """
    data = _bytes(path, limits)
    _check_bytes(path.name, data, limits)
    try:
        element = ElementTree.fromstring(data)
    except (ElementTree.ParseError, UnicodeError, ValueError, LookupError) as error:
        raise ModelError(f"{path.name} cannot be read as XML: {error}.") from None
    _check_depth(path.name, element, limits)
    if element.tag.startswith("{"):  # a default namespace, as Drake's files have it
        space = element.tag[: element.tag.index("}") + 1]
        for e in element.iter():
            e.tag = e.tag.removeprefix(space)
    return element


def _bytes(path: Path, limits: FileLimits) -> bytes:
    try:
        found = path.stat()
        if not stat.S_ISREG(found.st_mode):  # a pipe would be waited for, a device has no end
            raise ModelError(f"{path.name} is no regular file; expected a URDF or MJCF file.")
        with path.open("rb") as file:
            data = file.read(min(limits.max_bytes, found.st_size) + 1)
    except (OSError, ValueError) as error:
        raise ModelError(f"{path.name} cannot be read: {getattr(error, 'strerror', None) or error}.") from None
    if len(data) > limits.max_bytes:
        raise _too_large(path.name, f"is larger than {limits.max_bytes / 1e6:g} MB", "max_bytes")
    return data


def _check_bytes(file: str, data: bytes, limits: FileLimits) -> None:
    if _DECLARATION.search(data):
        raise ModelError(f"{file} has a DOCTYPE or an ENTITY in it; robots need neither, and it is not read. Take it out.")
    if b"\0" in data:
        raise ModelError(f"{file} cannot be read as XML: it has zero bytes in it, as binary and UTF-16 files do.")
    declared = _ENCODING.match(data.lstrip(b"\xef\xbb\xbf"))
    if declared and declared[1].decode("latin-1").lower() not in _BYTE_FOR_BYTE:
        name = declared[1].decode("latin-1")
        raise ModelError(f"{file} cannot be read as XML: its encoding is {name!r:.40}. Expected UTF-8.")
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


def _shown(value: object) -> str:
    return "a number of many digits" if isinstance(value, int) and abs(value) > 2**200 else f"{value!r:.80}"


def _too_large(file: str, what: str, limit: str) -> ModelError:
    return ModelError(f"{file} {what}. If that is meant, raise it: load_robot(..., limits=rbd.model.FileLimits({limit}=...)).")
