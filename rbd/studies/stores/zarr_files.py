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

ROOT = "zarr.json"


class SyncedStore(LocalStore):
    """Zarr's store in a folder; a file is on the disk before it replaces the old one, so that a lost machine loses none."""

    async def _set(self, key: str, value: Any, exclusive: bool = False) -> None:
        path = self.root / key
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
    """Attributes and {array: description}, as `write_root` wrote them; of another zarr folder what it has of these.

    Raises:
        OSError: no such file.
        ValueError: another file.
    """
    found = json.loads((root / ROOT).read_bytes())
    try:
        attributes, listed = dict(found["attributes"]), found.get("consolidated_metadata") or {"metadata": {}}
        return attributes, dict(listed["metadata"])
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
