"""Named arrays and a header in one file, .npz or .nc: written whole or not at all, read with every size checked first.

An .npz is what `numpy.load` reads, without pickles: text is stored in arrays of characters, and the header is JSON in one of
them. An .nc is netCDF 3 (64-bit offsets) through xarray and SciPy, which any tool for netCDF reads; the header is an attribute.
"""

from __future__ import annotations

import hashlib
import io
import json
import math
import os
import struct
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.lib import format as npy

from rbd.arrays import Array
from rbd.errors import InputError
from rbd.model.output_files import write_file
from rbd.modules import xarray_or_error

if TYPE_CHECKING:
    import xarray

FORMAT, VERSION = "rbd trajectory", 1
HEADER = "header"
FREE, TIMES = 16_000_000, 64
"""Limit of the unpacked bytes: a constant, and a multiple of the file's size; real motions do not compress further."""
OBJECTS = 100_000
"""Limit of the entries in a header: this number, and one more for each byte of the file."""
_TYPES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 4, 6: 8}
"""Bytes of the types of netCDF 3: byte, char, short, int, float, double."""
_DIMENSIONS, _VARIABLES, _ATTRIBUTES = 10, 11, 12
INVALID_BYTES = (
    zipfile.BadZipFile,
    zlib.error,
    ValueError,
    KeyError,
    EOFError,
    OSError,
    MemoryError,
    NotImplementedError,
    RuntimeError,
    SyntaxError,
    TypeError,
)
"""Exceptions of zipfile and NumPy on invalid bytes."""


def a_path(path: object, expected: str = "the path of a file, e.g. 'fall.npz'") -> Path:
    """A path, `~` understood.

    Raises:
        InputError: if it is none; the message says what was expected.
    """
    text = os.fspath(path) if isinstance(path, str | os.PathLike) else None
    if not isinstance(text, str) or not text or "\0" in text:
        raise InputError(f"path is {path!r:.80}; expected {expected}.")
    try:
        return Path(text).expanduser()
    except RuntimeError:  # "~nobody"
        return Path(text)


def a_trajectory_path(path: object) -> Path:
    """A path that ends in .npz or .nc.

    Raises:
        InputError: if it does not.
    """
    found = a_path(path)
    if found.suffix not in (".npz", ".nc"):
        raise InputError(f"path is {str(path)!r:.200}; expected one that ends in .npz, or in .nc for netCDF.")
    return found


def write_npz(path: Path, header: Mapping[str, Any], arrays: Mapping[str, Array]) -> None:
    """Header and arrays, float or text, uncompressed."""
    text = np.array(as_json(header))
    write_file(path, lambda file: np.savez(file, allow_pickle=False, **{HEADER: text, **arrays}))


def read_npz(path: Path) -> tuple[dict[str, Any], dict[str, Array]]:
    """Header and arrays from a file of `write_npz`.

    Raises:
        InputError: no such file, or not a trajectory: cut short, changed, or of another kind.
    """
    data = _bytes(path)
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = npz_members(archive, len(data))
            if HEADER not in members:
                raise InputError(_foreign(path, f"it holds {', '.join(sorted(members))[:200] or 'nothing'}"))
            header = _header(path, str(_array(archive, members.pop(HEADER))), len(data))
            arrays = {name: _array(archive, member) for name, member in members.items()}
    except INVALID_BYTES as error:
        if isinstance(error, InputError):
            raise
        raise InputError(_foreign(path, f"{error or type(error).__name__}"[:200])) from error
    return header, arrays


def npz_arrays(path: Path) -> dict[str, Array]:
    """{name: array} of any .npz with numbers and text; pickles are not read.

    Raises:
        InputError: no such file, no .npz, cut short, or with arrays of objects.
    """
    data = _bytes(path)
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = npz_members(archive, len(data), kinds="fiuU")
            return {name: _array(archive, member) for name, member in members.items()}
    except INVALID_BYTES as error:
        why = str(error)[:200] or type(error).__name__
        raise InputError(f"{path.name} is no .npz with arrays of numbers: {why}") from error


def write_netcdf(path: Path, header: Mapping[str, Any], dataset: xarray.Dataset) -> None:
    """A dataset, the header among its attributes."""
    whole = dataset.assign_attrs({**dataset.attrs, HEADER: as_json(header)})
    try:
        content = whole.to_netcdf(engine="scipy", format="NETCDF3_64BIT")
    except UnicodeEncodeError as error:
        raise InputError(f"a netCDF file has no character {error.object[error.start]!r}. Save it as .npz.") from None
    write_file(path, lambda file: file.write(content))


def read_netcdf(path: Path) -> tuple[dict[str, Any], xarray.Dataset]:
    """Header and dataset from a file of `write_netcdf`; errors as `read_npz`."""
    xarray, data = xarray_or_error(), _bytes(path)
    try:
        check_netcdf(data)
        dataset = xarray.load_dataset(io.BytesIO(data), engine="scipy", decode_cf=False)
        text = dataset.attrs.get(HEADER)
    except Exception as error:  # SciPy's reader can raise any exception on invalid bytes
        raise InputError(_foreign(path, f"{error or type(error).__name__}"[:200])) from error
    if not isinstance(text, str):
        raise InputError(_foreign(path, f"it holds {', '.join(sorted(map(str, dataset.variables)))[:200]}"))
    return _header(path, text, len(data)), dataset


def as_json(header: Mapping[str, Any]) -> str:
    """The header as text, numbers to the last bit."""
    return json.dumps({"format": FORMAT, "version": VERSION, **header}, allow_nan=False)


def _bytes(path: Path) -> bytes:
    try:
        if os.path.exists(path) and not os.path.isfile(path) and not os.path.isdir(path):
            raise OSError("it is a device or a pipe")
        return path.read_bytes()
    except (OSError, ValueError) as error:  # a ValueError if the path is invalid
        raise InputError(f"{str(path)!r:.200} cannot be read: {getattr(error, 'strerror', None) or error}.") from error
    except MemoryError:
        raise InputError(f"{str(path)!r:.200} is larger than the memory.") from None


def _array(archive: zipfile.ZipFile, member: ArchiveMember) -> Array:
    with archive.open(member.info) as file:
        file.read(member.start)
        data = file.read()  # to the end, where the checksum is compared
    if len(data) != member.size:
        raise ValueError(f"{member.info.filename!r:.80} is cut short")
    shape, kind = member.shape, member.kind
    out = np.frombuffer(data, kind).reshape(shape, order="F" if member.by_columns else "C") if data else np.zeros(shape, kind)
    if kind.kind == "U":
        out.tolist()  # raises on invalid characters
    return out


def _header(path: Path, text: str, file_size: int) -> dict[str, Any]:
    try:
        check_header(text, file_size)
        header = json.loads(text)
    except (ValueError, RecursionError):
        header = None
    if not isinstance(header, dict) or header.get("format") != FORMAT:
        raise InputError(_foreign(path, f"its header is {text!r:.80}"))
    if header.get("version") != VERSION:
        raise InputError(
            f"{path.name} is a trajectory of format {header.get('version')!r:.20}; this rbd reads format {VERSION}. "
            f"It was written by rbd {header.get('rbd')!r:.20}: use that, or a later one."
        )
    return header


def _foreign(path: Path, what: str) -> str:
    return f"{path.name} is no trajectory, or an incomplete one: {what}. Expected what Trajectory.save(path) writes."


@dataclass(frozen=True)
class ArchiveMember:
    """An array of an .npz, as described by its header.

    Attributes:
        info: Its entry in the archive.
        shape: Shape of the array.
        by_columns: Whether it is stored in Fortran's order.
        kind: Its type, numbers or text.
        start: Where its data begin in the member [bytes].
        size: Size of its data [bytes].
    """

    info: zipfile.ZipInfo
    shape: tuple[int, ...]
    by_columns: bool
    kind: np.dtype[np.generic]
    start: int
    size: int


def npz_members(archive: zipfile.ZipFile, file_size: int, kinds: str = "fU") -> dict[str, ArchiveMember]:
    """{array: its description}; only the first bytes of each member are unpacked.

    Raises:
        ValueError: sizes that do not agree, types that are neither numbers nor text, more data than such a file can contain.
    """
    infos = archive.infolist()
    _check_total(sum(info.file_size for info in infos), file_size)
    members = {info.filename.removesuffix(".npy"): _member(archive, info, kinds) for info in infos}
    if len(members) != len(infos):
        raise ValueError("two of its arrays have one name")
    return members


def _member(archive: zipfile.ZipFile, info: zipfile.ZipInfo, kinds: str) -> ArchiveMember:
    with archive.open(info) as file:
        version = npy.read_magic(file)
        read = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}.get(version)
        if read is None:
            raise ValueError(f"{info.filename!r:.80} is an array of version {version}")
        shape, by_columns, kind = read(file)
        start = file.tell()
    size = math.prod(shape) * kind.itemsize
    if kind.hasobject or kind.kind not in kinds or any(k < 0 for k in shape) or start + size != info.file_size:
        raise ValueError(f"{info.filename!r:.80} says that it is {kind} of shape {shape}, which it is not")
    return ArchiveMember(info, shape, by_columns, kind, start, size)


def check_netcdf(data: bytes) -> None:
    """Refuse a netCDF 3 file whose variables together are larger than the file: several would overlap.

    Raises:
        ValueError: if so, or if the bytes are no such file.
    """
    if data[:3] != b"CDF" or data[3:4] not in (b"\x01", b"\x02"):
        raise ValueError("it does not begin as netCDF 3 does")
    reader = _Reader(data)
    records = reader.number()
    lengths = [reader.dimension() for _ in range(reader.count(_DIMENSIONS))]
    reader.attributes()
    total = 0
    for _ in range(reader.count(_VARIABLES)):
        shape, width = reader.variable(lengths, long=data[3] == 2)
        total += math.prod(records if i == 0 and k == 0 else k for i, k in enumerate(shape)) * width
        if total > len(data):
            raise ValueError("its variables are larger than the file")


def check_header(text: str, file_size: int) -> None:
    """Refuse JSON with more entries than a trajectory in a file of that size can have.

    Raises:
        ValueError: if it has more.
    """
    most = OBJECTS + file_size
    if sum(text.count(mark) for mark in ",[{:") > most:
        raise ValueError(f"its header has more than {most:,} entries")


def _check_total(total: int, file_size: int) -> None:
    most = FREE + TIMES * file_size
    if total > most:
        raise ValueError(f"it says that it holds {total:,} bytes; a file of {file_size:,} bytes may hold {most:,} at most")


def checksum(header: Mapping[str, Any], arrays: Mapping[str, Array]) -> str:
    """Checksum of the header and of all arrays: netCDF has none."""
    found = hashlib.sha256(json.dumps(header, sort_keys=True).encode())
    for name, x in sorted(arrays.items()):
        text = "\0".join(x.tolist()).encode(errors="surrogatepass") if x.dtype.kind == "U" else x.astype("<f8").tobytes()
        found.update(name.encode(errors="surrogatepass") + text)
    return found.hexdigest()


def listed_in(header: Mapping[str, Any], what: str) -> list[Any]:
    """The list that a header has under a key.

    Raises:
        InputError: if it is not a list.
    """
    value = header.get(what)
    if not isinstance(value, list):
        raise InputError(f"{what} in its header is {value!r:.80}; expected a list")
    return value


def words_in(header: Mapping[str, Any], what: str) -> tuple[str, ...]:
    """The different strings that a header has under a key; errors as `listed_in`."""
    value = listed_in(header, what)
    if not all(isinstance(word, str) and word for word in value) or len(set(value)) != len(value):
        raise InputError(f"{what} in its header are {value!r:.80}; expected different words")
    return tuple(value)


class _Reader:
    """The header of a netCDF 3 file, item after item; everything in it is padded to four bytes."""

    def __init__(self, data: bytes) -> None:
        self._data, self._at = data, 4

    def number(self) -> int:
        """A whole number from 0."""
        return self._unpacked(">I", 4)

    def count(self, kind: int) -> int:
        """Number of dimensions, variables or attributes that follow."""
        tag, count = self.number(), self.number()
        if tag != (kind if count else tag) or tag not in (0, kind) or 4 * count > len(self._data):
            raise ValueError("its header is damaged")
        return count

    def dimension(self) -> int:
        """Length of a dimension; zero for the unlimited one."""
        self._name()
        return self.number()

    def attributes(self) -> None:
        """Skip attributes."""
        for _ in range(self.count(_ATTRIBUTES)):
            self._name()
            width = self._width()
            self._skip(self.number() * width)

    def variable(self, lengths: list[int], *, long: bool) -> tuple[list[int], int]:
        """(shape, bytes of an entry) of a variable."""
        self._name()
        ids = [self.number() for _ in range(self._few(self.number()))]
        self.attributes()
        width = self._width()
        self._skip(12 if long else 8)  # its size, which readers ignore, and its offset
        try:
            return [lengths[i] for i in ids], width
        except IndexError:
            raise ValueError("a variable has a dimension that is not there") from None

    def _name(self) -> None:
        self._skip(self.number())

    def _width(self) -> int:
        kind = self.number()
        if kind not in _TYPES:
            raise ValueError(f"it holds numbers of the type {kind}, which netCDF 3 has not")
        return _TYPES[kind]

    def _few(self, count: int) -> int:
        if count > 32:
            raise ValueError(f"a variable has {count} dimensions")
        return count

    def _skip(self, size: int) -> None:
        self._at += -(-size // 4) * 4
        if self._at > len(self._data):
            raise ValueError("its header is cut short")

    def _unpacked(self, form: str, size: int) -> int:
        try:
            value = struct.unpack_from(form, self._data, self._at)[0]
        except struct.error:
            raise ValueError("its header is cut short") from None
        self._at += size
        return int(value)
