"""A store for a study, by its path; and the dataset of one that is there."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rbd.modules import xarray_or_error, zarr_or_error
from rbd.studies.sampling.grids import grid
from rbd.studies.sampling.samples import Samples
from rbd.studies.stores.netcdf_store import NetcdfStore, read_netcdf_study
from rbd.studies.stores.places import NETCDF, ZARR, a_store_path, check_store_place
from rbd.studies.stores.store import MemoryStore, Store
from rbd.studies.stores.zarr_reading import read_zarr
from rbd.studies.stores.zarr_store import ZarrStore

if TYPE_CHECKING:
    import xarray


def store_of(path: Path | None, samples: Samples, attributes: Mapping[str, Any]) -> Store:
    """A store that can be filled.

    Args:
        path: Where it is, or is to be; None: in memory.
        samples: The samples.
        attributes: Provenance.

    Raises:
        InputError: a path where no store can be, or where another study's is.
    """
    if path is None:
        return MemoryStore(samples, attributes)
    return (NetcdfStore if path.suffix == NETCDF else ZarrStore)(path, samples, attributes)


def checked_path(out: object) -> Path | None:
    """The path of a store, after a check that one can be there; None without one.

    Raises:
        InputError: where none can be, or xarray or zarr are not installed.
    """
    xarray_or_error()
    _import_all()
    if out is None:
        return None
    path = a_store_path(out)
    if path.suffix == ZARR:
        zarr_or_error()
    check_store_place(path)
    return path


@cache
def _import_all() -> None:
    """Make a dataset: xarray imports dask, among others, when the first one is made; it is to fail before work."""
    MemoryStore(grid(x=[0.0]), {}).dataset()


def open_study(path: object) -> xarray.Dataset:
    """The dataset of a stored study, finished or not, as `rbd.study` returns it; nothing is computed.

    A dataset up to 1 GB is read into memory, a larger one as it is used. Samples that are not yet computed have the reason
    "not_run".

    Args:
        path: What was given as `out=`.

    Raises:
        InputError: no store of a study there.

    Example:
        >>> import tempfile
        >>> folder = tempfile.mkdtemp()
        >>> def twice(x):
        ...     return {"twice": 2.0 * x}
        >>> swept = rbd.study(twice, rbd.grid(x=[1.0, 2.0]), executor=0, out=f"{folder}/twice.zarr")
        >>> print(rbd.studies.open_study(f"{folder}/twice.zarr").identical(swept))
        True
    """
    found = a_store_path(path)
    if found.suffix == ZARR:
        zarr_or_error()
    return read_netcdf_study(found) if found.suffix == NETCDF else read_zarr(found)
