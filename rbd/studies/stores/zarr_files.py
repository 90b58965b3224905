"""Files of a zarr store, each written whole and to the disk, or not at all. Imports zarr: the extra `study`."""

from __future__ import annotations

import asyncio
import json
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from zarr.codecs import ZstdCodec
from zarr.storage import LocalStore

from rbd.arrays import Array
from rbd.errors.stopped import StudyStopped
from rbd.model.output_files import write_file
from rbd.studies.provenance.provenance import LAYOUT

ROOT = "zarr.json"


class SyncedStore(LocalStore):
    """Zarr's store in a folder; a file is on the disk before it replaces the old one, so that a lost machine loses none."""

    async def _set(self, key: str, value: Any, exclusive: bool = False) -> None:
        path = self.root / key
        if exclusive and path.exists():  # zarr asks for a new root at each new array
            raise FileExistsError(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        view = value.as_buffer_like()
        await asyncio.to_thread(write_file, path, lambda file: file.write(view), StudyStopped)


def new_array(
    root: Path, name: str, dims: Iterable[str], shape: tuple[int, ...], chunk: tuple[int, ...], kind: np.dtype, fill: Any
) -> None:
    """Make an empty array; one that is already there is replaced.

    Args:
        root: The folder of the store.
        name: Name of the array.
        dims: Names of its dimensions.
        shape: Their lengths.
        chunk: Lengths of a chunk.
        kind: Type of its values; objects are text.
        fill: The value of what is not written.
    """
    text = kind.kind in "OUT"
    zarr.create_array(
        SyncedStore(root),
        name=name,
        shape=shape,
        chunks=tuple(max(1, k) for k in chunk),
        dtype=str if text else kind,
        fill_value="" if text else fill,
        compressors=ZstdCodec(level=1, checksum=True),
        dimension_names=tuple(dims),
        overwrite=True,
    )


def array(root: Path, name: str) -> Any:
    """An array, to be read and written."""
    with zarr.config.set({"array.write_empty_chunks": True}):
        return zarr.open_array(SyncedStore(root), path=name, mode="r+")


def write_coordinates(root: Path, coordinates: Mapping[str, tuple[Iterable[str], Array, Mapping[str, Any]]]) -> list[str]:
    """Write coordinates that are not there as they should be.

    Args:
        root: The folder of the store.
        coordinates: {name: (dimensions, values, attributes)}.

    Returns:
        The names of all.
    """
    for name, (dims, values, attrs) in coordinates.items():
        x = as_array(values)
        if has_values(root, name, x):
            continue
        chunk = tuple(min(n, 1 << 17) for n in x.shape)
        new_array(root, name, dims, x.shape, chunk, x.dtype, np.zeros(1, x.dtype)[0])
        array(root, name)[...] = x
        set_attributes(root, name, attrs)
    return list(coordinates)


def has_values(root: Path, name: str, wanted: Array) -> bool:
    """Whether an array is there, can be read, and has these values: numbers, truth values, or text as objects."""
    if not (root / name / ROOT).is_file():
        return False
    try:
        found = np.asarray(array(root, name)[...])
    except (RuntimeError, ValueError, OSError, KeyError, TypeError):
        return False
    if wanted.dtype == object:
        return found.shape == wanted.shape and list(map(str, found.flat)) == list(map(str, wanted.flat))
    return found.dtype == wanted.dtype and np.array_equal(found, wanted, equal_nan=wanted.dtype.kind == "f")


def missing_file(root: Path, name: str, description: Mapping[str, Any], done: Array | None = None) -> Path | None:
    """The first file of an array that is not there; None if all are.

    Args:
        root: The folder of the store.
        name: Name of the array.
        description: As `read_root` has it.
        done: Of the first axes of chunks, which are to be there; None: all.
    """
    chunk = description["chunk_grid"]["configuration"]["chunk_shape"]
    number = [-(-n // k) for n, k in zip(description["shape"], chunk, strict=True)]
    for index in np.ndindex(*number):
        if (done is None or done[index[: done.ndim]]) and not (file := chunk_file(root, name, index)).is_file():
            return file
    return None


def chunk_file(root: Path, name: str, index: tuple[int, ...]) -> Path:
    """The file of a chunk."""
    return root.joinpath(name, "c", *(str(i) for i in index))


def set_attributes(root: Path, name: str, attributes: Mapping[str, Any]) -> None:
    """Give an array attributes."""
    path = root / name / ROOT
    found = json.loads(path.read_bytes())
    found["attributes"] = dict(attributes)
    _write_json(path, found)


def write_root(root: Path, attributes: Mapping[str, Any], names: Iterable[str]) -> None:
    """Attributes of the store and the list of its arrays, with their descriptions: what is not listed is not part of it.

    The list is what zarr calls consolidated metadata, which xarray reads first.
    """
    arrays = {name: json.loads((root / name / ROOT).read_bytes()) for name in names}
    listed = {"kind": "inline", "must_understand": False, "metadata": arrays}
    whole = {"zarr_format": 3, "node_type": "group", "attributes": dict(attributes), "consolidated_metadata": listed}
    _write_json(root / ROOT, whole)


def read_root(root: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Attributes and {array: description}, as `write_root` wrote them; of another zarr folder its attributes.

    Raises:
        OSError: no such file.
        ValueError: another file.
    """
    found = json.loads((root / ROOT).read_bytes())
    try:
        attributes = dict(found["attributes"])
        return attributes, dict(found["consolidated_metadata"]["metadata"]) if LAYOUT in attributes else {}
    except (KeyError, TypeError) as error:
        raise ValueError(f"it has no {error}") from error


def sync_folders(folders: Iterable[Path]) -> None:
    """Names of new files to the disk."""
    for folder in folders:
        held = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(held)
        except OSError:  # a file system that has no such thing for folders
            pass
        finally:
            os.close(held)


def as_array(values: Any) -> Array:
    """Values as zarr writes them: text as objects."""
    x = np.asarray(values)
    return x.astype(object) if x.dtype.kind in "UT" else x


def labels_of(values: Any) -> list[Any]:
    """Labels of a dimension as Python's text or numbers."""
    x = np.asarray(values)
    return [str(each) for each in x] if x.dtype.kind in "OTU" else list(x.tolist())


def _write_json(path: Path, whole: Mapping[str, Any]) -> None:
    data = json.dumps(whole, allow_nan=True, indent=1).encode()
    write_file(path, lambda file: file.write(data), StudyStopped)
