"""The dataset of a zarr store, finished or not."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rbd.errors import InputError
from rbd.errors.reasons import Reason
from rbd.modules import xarray_or_error
from rbd.studies.dataset import MESSAGE, OK, OWN, REASON, normal, with_outcome
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
        if REASON not in arrays:
            found = _without_results(found, layout["dims"])
        if found.nbytes <= LOADED:
            found = found.load()
        found = normal(found, order, coords)
    except (RuntimeError, ValueError, OSError, KeyError, TypeError) as error:
        raise InputError(
            f"{str(path)!r:.300} is damaged: {error!s:.200}. The same call of rbd.study computes damaged chunks again."
        ) from error
    found.attrs = {name: value for name, value in attributes.items() if name not in (LAYOUT, "coordinates")}
    return with_outcome(found)


def _without_results(dataset: xarray.Dataset, lengths: Mapping[str, int]) -> xarray.Dataset:
    """A dataset of coordinates with the variables that every study has."""
    dims, shape = tuple(lengths), tuple(lengths.values())
    codes = np.full(shape, Reason.NOT_RUN.code, np.int16)
    own = {OK: np.zeros(shape, bool), REASON: codes, MESSAGE: np.full(shape, "", object)}
    return dataset.assign({name: (dims, values, OWN[name]) for name, values in own.items()})
