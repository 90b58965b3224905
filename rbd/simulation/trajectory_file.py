"""Named arrays and a header in one file, .npz or .nc: written whole or not at all, read with every size checked.

An .npz is what `numpy.load` reads, without pickles: text stands in arrays of characters, and the header is JSON in one of
them. An .nc is netCDF 3 (64-bit offsets) through xarray and SciPy, which any tool for netCDF reads; the header is an attribute.
"""

from __future__ import annotations

import io
import json
import os
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rbd.arrays import Array
from rbd.errors import InputError
from rbd.model.output_files import write_file
from rbd.simulation.trajectory_sizes import Member, check_header, check_netcdf, npz_members

if TYPE_CHECKING:
    import xarray

FORMAT, VERSION = "rbd trajectory", 1
HEADER = "header"
EXTRA = "Install the extra: pip install 'rbd[study]'"


def a_trajectory_path(path: object) -> Path:
    """A path that ends in .npz or .nc.

    Raises:
        InputError: if it does not.
    """
    text = os.fspath(path) if isinstance(path, str | os.PathLike) else None
    if not isinstance(text, str) or not text or "\0" in text:
        raise InputError(f"path is {path!r:.80}; expected the path of a file, e.g. 'fall.npz'.")
    try:
        found = Path(text).expanduser()
    except RuntimeError:  # "~nobody"
        found = Path(text)
    if found.suffix not in (".npz", ".nc"):
        raise InputError(f"path is {text!r:.200}; expected one that ends in .npz, or in .nc for netCDF.")
    return found


def write_npz(path: Path, header: Mapping[str, Any], arrays: Mapping[str, Array]) -> None:
    """Header and arrays, float or text, uncompressed."""
    text = np.array(as_json(header))
    write_file(path, lambda file: np.savez(file, allow_pickle=False, **{HEADER: text, **arrays}))


def read_npz(path: Path) -> tuple[dict[str, Any], dict[str, Array]]:
    """Header and arrays of what `write_npz` wrote.

    Raises:
        InputError: no such file, or not such a file: cut short, changed, or something else.
    """
    data = _bytes(path)
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = npz_members(archive, len(data))
            if HEADER not in members:
                raise InputError(_foreign(path, f"it holds {', '.join(sorted(members))[:200] or 'nothing'}"))
            header = _header(path, str(_array(archive, members.pop(HEADER))), len(data))
            arrays = {name: _array(archive, member) for name, member in members.items()}
    except (
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
    ) as error:  # what zipfile and NumPy raise on bytes that are not theirs
        if isinstance(error, InputError):
            raise
        raise InputError(_foreign(path, f"{error or type(error).__name__}"[:200])) from error
    return header, arrays


def write_netcdf(path: Path, header: Mapping[str, Any], dataset: xarray.Dataset) -> None:
    """A dataset, the header among its attributes."""
    told = dataset.assign_attrs({**dataset.attrs, HEADER: as_json(header)})
    try:
        content = told.to_netcdf(engine="scipy", format="NETCDF3_64BIT")
    except UnicodeEncodeError as error:
        raise InputError(f"a netCDF file has no character {error.object[error.start]!r}. Save it as .npz.") from None
    write_file(path, lambda file: file.write(content))


def read_netcdf(path: Path) -> tuple[dict[str, Any], xarray.Dataset]:
    """Header and dataset of what `write_netcdf` wrote; errors as `read_npz`."""
    xarray, data = xarray_or_error(), _bytes(path)
    try:
        check_netcdf(data)
        dataset = xarray.load_dataset(io.BytesIO(data), engine="scipy", decode_cf=False)
        text = dataset.attrs.get(HEADER)
    except Exception as error:  # SciPy's reader raises whatever the wrong bytes lead to
        raise InputError(_foreign(path, f"{error or type(error).__name__}"[:200])) from error
    if not isinstance(text, str):
        raise InputError(_foreign(path, f"it holds {', '.join(sorted(map(str, dataset.variables)))[:200]}"))
    return _header(path, text, len(data)), dataset


def xarray_or_error() -> Any:
    """The module xarray.

    Raises:
        InputError: if it is not installed; names the extra.
    """
    try:
        import xarray
    except ImportError as error:
        raise InputError(f"xarray is not installed here, and this needs it. {EXTRA}") from error
    return xarray


def as_json(header: Mapping[str, Any]) -> str:
    """The header as text, numbers to the last bit."""
    return json.dumps({"format": FORMAT, "version": VERSION, **header}, allow_nan=False)


def _bytes(path: Path) -> bytes:
    try:
        if os.path.exists(path) and not os.path.isfile(path) and not os.path.isdir(path):
            raise OSError("it is a device or a pipe")
        return path.read_bytes()
    except (OSError, ValueError) as error:  # a ValueError where the path can be none
        raise InputError(f"{str(path)!r:.200} cannot be read: {getattr(error, 'strerror', None) or error}.") from error
    except MemoryError:
        raise InputError(f"{str(path)!r:.200} is larger than the memory.") from None


def _array(archive: zipfile.ZipFile, member: Member) -> Array:
    with archive.open(member.info) as file:
        file.read(member.start)
        data = file.read()  # to the end, where the checksum is compared
    if len(data) != member.size:
        raise ValueError(f"{member.info.filename!r:.80} is cut short")
    shape, kind = member.shape, member.kind
    out = np.frombuffer(data, kind).reshape(shape, order="F" if member.by_columns else "C") if data else np.zeros(shape, kind)
    if kind.kind == "U":
        out.tolist()  # raises on what are no characters
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
    return f"{path.name} is no trajectory, or not a whole one: {what}. Expected what Trajectory.save(path) writes."
