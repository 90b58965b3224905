"""Named arrays and a header in one file, .npz or .nc: written whole or not at all, read with every size checked first.

An .npz is what `numpy.load` reads, without pickles: text is stored in arrays of characters, and the header is JSON in one of
them. An .nc is netCDF 3 (64-bit offsets) through xarray and SciPy, which any tool for netCDF reads; the header is an attribute.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import warnings
import zipfile
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from tokenize import TokenError
from typing import IO, TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.lib import format as npy

from rbd.arrays import Array
from rbd.errors import InputError
from rbd.model.output_files import write_file
from rbd.modules import xarray_or_error

if TYPE_CHECKING:
    import xarray

VERSION = 1
HEADER = "header"
FREE, TIMES = 16_000_000, 64
"""Limit of the unpacked bytes: a constant, and a multiple of the file's size; real motions do not compress further."""
OBJECTS = 100_000
"""Limit of the entries in a header: this number, and one more for each byte of the file."""
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
    TokenError,
    TypeError,
    AttributeError,
)
"""Exceptions of zipfile and NumPy on invalid bytes."""


class FileKind(NamedTuple):
    """What a file holds, as its header says it, and what writes it."""

    name: str
    writer: str


TRAJECTORY = FileKind("trajectory", "Trajectory.save(path)")


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


def write_npz(path: Path, header: Mapping[str, Any], arrays: Mapping[str, Array], kind: FileKind = TRAJECTORY) -> None:
    """Header and arrays, float or text, uncompressed."""
    text = np.array(as_json(header, kind))
    write_file(path, lambda file: np.savez(file, allow_pickle=False, **{HEADER: text, **arrays}))


def read_npz(path: Path, kind: FileKind = TRAJECTORY) -> tuple[dict[str, Any], dict[str, Array]]:
    """Header and arrays from a file of `write_npz`.

    Raises:
        InputError: no such file, or not one of this kind: cut short, changed, or of another kind.
    """
    data = _bytes(path)
    try:
        arrays = _members(data, "fU")
    except INVALID_BYTES as error:
        raise InputError(_foreign(path, f"{error or type(error).__name__}"[:200], kind)) from error
    if HEADER not in arrays:
        raise InputError(_foreign(path, f"it holds {', '.join(sorted(arrays))[:200] or 'nothing'}", kind))
    return _header(path, str(arrays.pop(HEADER)), len(data), kind), arrays


def npz_arrays(path: Path, kinds: str = "fiuU", objects: Callable[[bytes], Any] | None = None) -> dict[str, Any]:
    """{name: array} of any .npz with numbers and text; pickles are not read.

    Args:
        path: The file.
        kinds: Types of arrays that it may hold, NumPy's letters.
        objects: Reads the pickle of an array of objects; without it such arrays are refused.

    Raises:
        InputError: no such file, no .npz, cut short, or with arrays of objects.
    """
    data = _bytes(path)
    try:
        return _members(data, kinds, objects)
    except INVALID_BYTES as error:
        why = str(error)[:200] or type(error).__name__
        raise InputError(f"{path.name} is no .npz with arrays of numbers: {why}") from error


def npy_array(path: Path, objects: Callable[[bytes], Any]) -> Any:
    """The array of an .npy, or what the pickle in one of objects holds.

    Raises:
        InputError: no such file, no .npy, or cut short.
    """
    data = _bytes(path)
    try:
        return _held(io.BytesIO(data), objects)
    except INVALID_BYTES as error:
        raise InputError(f"{path.name} is no .npy that can be read: {str(error)[:200] or type(error).__name__}") from error


def _held(file: IO[bytes], objects: Callable[[bytes], Any] | None) -> Any:
    """What an .npy holds. NumPy reads it piece by piece: what is not there takes no memory."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of headers that Python 2 wrote
        if objects is None:
            return npy.read_array(file, allow_pickle=False)
        whole = io.BytesIO(file.read())
        header = npy.read_array_header_1_0 if npy.read_magic(whole) == (1, 0) else npy.read_array_header_2_0
        if header(whole)[2].hasobject:
            return objects(whole.read())
        whole.seek(0)
        return npy.read_array(whole, allow_pickle=False)


def _members(data: bytes, kinds: str, objects: Callable[[bytes], Any] | None = None) -> dict[str, Any]:
    """{name: array} of an .npz, of types of these kinds.

    Raises:
        ValueError: other types, or more data than such a file can contain; and others of `INVALID_BYTES`.
    """
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        infos = archive.infolist()
        total, most = sum(info.file_size for info in infos), FREE + TIMES * len(data)
        if total > most:
            raise ValueError(f"it says that it holds {total:,} bytes; a file of {len(data):,} bytes may hold {most:,} at most")
        arrays = {info.filename.removesuffix(".npy"): _array(archive, info, kinds, objects) for info in infos}
    if len(arrays) != len(infos):
        raise ValueError("two of its arrays have one name")
    return arrays


def _array(archive: zipfile.ZipFile, info: zipfile.ZipInfo, kinds: str, objects: Callable[[bytes], Any] | None) -> Any:
    """An array of an .npz, or what `objects` makes of one of objects."""
    with archive.open(info) as file:
        try:
            out = _held(file, objects)
        except ValueError as error:
            raise ValueError(f"{info.filename!r:.80}: {error}") from error
        rest = file.read(1)  # at the end the checksum is compared
    if not isinstance(out, np.ndarray):
        return out
    if out.dtype.kind not in kinds or not out.dtype.itemsize or rest:
        raise ValueError(f"{info.filename!r:.80} is an array of {out.dtype}, or longer than it says")
    if out.dtype.kind == "U":
        out.tolist()  # raises on invalid characters
    return out


def write_netcdf(path: Path, header: Mapping[str, Any], dataset: xarray.Dataset) -> None:
    """A dataset, the header among its attributes."""
    whole = dataset.assign_attrs({**dataset.attrs, HEADER: as_json(header, TRAJECTORY)})
    try:
        content = whole.to_netcdf(engine="scipy", format="NETCDF3_64BIT")
    except UnicodeEncodeError as error:
        raise InputError(f"a netCDF file has no character {error.object[error.start]!r}. Save it as .npz.") from None
    write_file(path, lambda file: file.write(content))


def read_netcdf(path: Path) -> tuple[dict[str, Any], xarray.Dataset]:
    """Header and dataset from a file of `write_netcdf`; errors as `read_npz`."""
    xarray, data = xarray_or_error(), _bytes(path)
    try:
        dataset = xarray.load_dataset(BytesReadOnce(data), engine="scipy", decode_cf=False)
        text = dataset.attrs.get(HEADER)
    except Exception as error:  # SciPy's reader can raise any exception on invalid bytes
        raise InputError(_foreign(path, f"{error or type(error).__name__}"[:200])) from error
    if not isinstance(text, str):
        raise InputError(_foreign(path, f"it holds {', '.join(sorted(map(str, dataset.variables)))[:200]}"))
    return _header(path, text, len(data)), dataset


def as_json(header: Mapping[str, Any], kind: FileKind) -> str:
    """The header as text, numbers to the last bit."""
    return json.dumps({"format": f"rbd {kind.name}", "version": VERSION, **header}, allow_nan=False)


def _bytes(path: Path) -> bytes:
    try:
        if os.path.exists(path) and not os.path.isfile(path) and not os.path.isdir(path):
            raise OSError("it is a device or a pipe")
        return path.read_bytes()
    except (OSError, ValueError) as error:  # a ValueError if the path is invalid
        raise InputError(f"{str(path)!r:.200} cannot be read: {getattr(error, 'strerror', None) or error}.") from error
    except MemoryError:
        raise InputError(f"{str(path)!r:.200} is larger than the memory.") from None


def _header(path: Path, text: str, file_size: int, kind: FileKind = TRAJECTORY) -> dict[str, Any]:
    try:
        check_header(text, file_size)
        header = json.loads(text)
    except (ValueError, RecursionError):
        header = None
    if not isinstance(header, dict) or header.get("format") != f"rbd {kind.name}":
        raise InputError(_foreign(path, f"its header is {text!r:.80}", kind))
    if header.get("version") != VERSION:
        raise InputError(
            f"{path.name} is a {kind.name} of format {header.get('version')!r:.20}; this rbd reads format {VERSION}. "
            f"It was written by rbd {header.get('rbd')!r:.20}: use that, or a later one."
        )
    return header


def _foreign(path: Path, what: str, kind: FileKind = TRAJECTORY) -> str:
    return f"{path.name} is no {kind.name}, or an incomplete one: {what}. Expected what {kind.writer} writes."


class BytesReadOnce(io.BytesIO):
    """A file in memory, of which no more is read than twice its size: variables of a netCDF file can claim the same bytes.

    Args:
        data: Its contents.
    """

    def __init__(self, data: bytes) -> None:
        super().__init__(data)
        self._left = 2 * len(data)

    def read(self, size: int | None = -1) -> bytes:
        """The next bytes.

        Raises:
            ValueError: the file has been read twice.
        """
        out = super().read(size)
        self._left -= len(out)
        if self._left < 0:
            raise ValueError("its variables are larger than the file")
        return out


def check_header(text: str, file_size: int) -> None:
    """Refuse JSON with more entries than a trajectory in a file of that size can have.

    Raises:
        ValueError: if it has more.
    """
    most = OBJECTS + file_size
    if sum(text.count(mark) for mark in ",[{:") > most:
        raise ValueError(f"its header has more than {most:,} entries")


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
