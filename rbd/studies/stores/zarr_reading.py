"""The dataset of a zarr store, finished or not."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rbd.errors import InputError
from rbd.errors.reasons import Reason
from rbd.modules import xarray_or_error
from rbd.studies.dataset import MESSAGE, OK, OWN, REASON, normal, with_outcome
from rbd.studies.kept.variable import missing
from rbd.studies.provenance.provenance import LAYOUT, format_of

if TYPE_CHECKING:
    import xarray

LOADED = 1_000_000_000
"""Datasets up to so many bytes are read into memory, larger ones as they are used."""


def read_zarr(path: Path) -> xarray.Dataset:
    """The dataset of a store, in memory if it is small, else read as it is used.

    Raises:
        InputError: no store of a study, or a damaged one.
    """
    from rbd.studies.stores import zarr_files

    xarray = xarray_or_error()
    try:
        attributes, arrays = zarr_files.read_root(path)
    except (OSError, ValueError) as error:
        raise InputError(f"{str(path)!r:.300} is no store of a study: {error!s:.200}.") from error
    format_of(attributes, str(path))
    if REASON in arrays and not {OK, MESSAGE} <= set(arrays):
        raise InputError(f"{str(path)!r:.300} is damaged: it has no {OK} or no {MESSAGE}.")
    try:
        layout = json.loads(attributes[LAYOUT])
        coords = [str(name) for name in layout["coords"]]
        order = [OK, REASON, MESSAGE, *sorted(layout["first"], key=layout["first"].__getitem__)]
        found = xarray.open_zarr(path, chunks=None, consolidated=True, decode_times=False)
        first = layout["first"]
        _check_files(path, arrays, found, [*first, OK, MESSAGE])
        if REASON not in arrays:
            found = _without_results(found, layout["dims"])
        if found.nbytes <= LOADED:
            found = found.load()
        found = _without_parts(found, first if found.nbytes <= LOADED else ())
        found = normal(found, order, coords)
    except (RuntimeError, ValueError, OSError, KeyError, TypeError) as error:
        raise InputError(
            f"{str(path)!r:.300} is damaged: {error!s:.200}. The same call of rbd.study computes damaged chunks again."
        ) from error
    found.attrs = {name: value for name, value in attributes.items() if name not in (LAYOUT, "coordinates")}
    return with_outcome(found)


def _check_files(path: Path, arrays: Mapping[str, Any], dataset: xarray.Dataset, names: Iterable[str]) -> None:
    """Refuse a store in which a file is missing: zarr reads zeros, or no values, in its place.

    Raises:
        OSError: names the file.
    """
    from rbd.studies.stores import zarr_files

    done = None
    if REASON in arrays:
        chunk = arrays[REASON]["chunk_grid"]["configuration"]["chunk_shape"]
        reached = dataset[REASON].values != Reason.NOT_RUN.code
        for axis, size in enumerate(chunk):
            reached = np.logical_or.reduceat(reached, np.arange(0, reached.shape[axis], size), axis=axis)
        done = reached
    for name, description in arrays.items():
        if name != REASON:
            file = zarr_files.missing_file(path, name, description, done if name in names else None)
            if file is not None:
                raise OSError(f"the file {str(file.relative_to(path))!r} is missing")


def _without_parts(dataset: xarray.Dataset, names: Iterable[str]) -> xarray.Dataset:
    """Without values of samples that are not done, which a writing that was ended left: `reason` is written last."""
    left = dataset[REASON].values == Reason.NOT_RUN.code
    if not left.any():
        return dataset
    changed = {}
    for name in (OK, MESSAGE, *names):
        x = dataset[name]
        values = x.values.astype(object) if x.dtype.kind in "OTU" else x.values.copy()
        values[left] = missing(x.dtype)
        changed[name] = (x.dims, values, x.attrs)
    return dataset.assign(changed)


def _without_results(dataset: xarray.Dataset, lengths: Mapping[str, int]) -> xarray.Dataset:
    """A dataset of coordinates with the variables that every study has."""
    dims, shape = tuple(lengths), tuple(lengths.values())
    codes = np.full(shape, Reason.NOT_RUN.code, np.int16)
    own = {OK: np.zeros(shape, bool), REASON: codes, MESSAGE: np.full(shape, "", object)}
    return dataset.assign({name: (dims, values, OWN[name]) for name, values in own.items()})
