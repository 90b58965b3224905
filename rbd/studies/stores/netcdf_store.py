"""`NetcdfStore`: results of a small study in one netCDF file, which is replaced whole every few seconds."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rbd.arrays import Array
from rbd.errors import InputError
from rbd.errors.reasons import Reason
from rbd.errors.stopped import StudyStopped
from rbd.model.output_files import write_file
from rbd.modules import xarray_or_error
from rbd.simulation.trajectory_file import check_netcdf
from rbd.studies.dataset import MESSAGE, OK, REASON, normal, with_outcome
from rbd.studies.kept.variable import Block
from rbd.studies.provenance.provenance import LAYOUT, check_same, continued, format_of, others_of
from rbd.studies.sampling.samples import Samples
from rbd.studies.stores.pacing import Pacing, why
from rbd.studies.stores.places import Lock
from rbd.studies.stores.store import MemoryStore, variable_of

if TYPE_CHECKING:
    import xarray

LARGEST = 200_000_000
"""Bytes of the largest study that is written as netCDF: the file is written whole each time."""


class NetcdfStore(MemoryStore):
    """A study in a netCDF 3 file; arguments and errors as `ZarrStore`."""

    def __init__(self, path: Path, samples: Samples, attributes: Mapping[str, Any]) -> None:
        super().__init__(samples, attributes)
        self.path, self._written = path, 0
        place = path.resolve()
        self._lock = Lock(path, place.with_name(f".{place.name}.lock"))
        self._pacing = Pacing(self._write, self._told)
        try:
            if path.exists():
                self._load()
        except BaseException:
            self._lock.close()
            raise

    def put(self, block: Block) -> None:
        """As `Store.put`.

        Raises:
            InputError: besides, a study that is too large for netCDF.
        """
        with self._pacing.guard:
            self._pacing.check()
            each = sum(math.prod(v.values.shape[1:]) * v.values.dtype.itemsize for v in block.variables.values())
            if each * len(self.samples) > LARGEST:
                raise InputError(
                    f"{len(self.samples):,} samples of {each:,} bytes each are too large for {str(self.path)!r:.200}, which is "
                    f"written whole each time (at most {LARGEST:,} bytes). Give out= a path that ends in .zarr."
                )
            super().put(block)
            self._pacing.changed()

    def dataset(self) -> xarray.Dataset:
        """As `Store.dataset`."""
        with self._pacing.guard:
            self._pacing.write()
        return read_netcdf_study(self.path) if self.path.exists() else self.kept()

    def close(self) -> None:
        """As `Store.close`."""
        try:
            with self._pacing.guard:
                self._pacing.write()
        finally:
            self._pacing.stop()
            self._lock.close()

    def _write(self) -> None:
        content = encoded(self.kept(), json.dumps({"first": self.seen.first, "coords": list(self.samples.coords())}), self.path)
        write_file(self.path, lambda file: file.write(content), StudyStopped)
        self._written = int(np.count_nonzero(self.done))

    def _told(self, error: Exception) -> StudyStopped:
        return StudyStopped(
            f"{str(self.path)!r:.300} cannot be written: {why(error)}. {self._written:,} of {len(self.samples):,} samples are "
            "stored; make room, and the same call goes on from there."
        )

    def _load(self) -> None:
        found = _decoded(self.path)
        check_same(found.attrs, self.attributes, str(self.path))
        self.others = others_of(found.attrs, self.attributes)
        self.attributes = continued(found.attrs, self.attributes)
        n, axes = len(self.samples), len(self.samples.dims)
        first = {str(name): (int(a), int(b)) for name, (a, b) in json.loads(found.attrs[LAYOUT])["first"].items()}
        for name in first:
            x = found[name]
            dims = tuple(str(dim) for dim in x.dims[axes:])
            labels = {dim: tuple(x[dim].values.tolist()) for dim in dims if dim in found.coords}
            values = np.array(x.values).reshape(n, *x.shape[axes:])
            self.found.variables[name] = variable_of(values, dims, labels, x.attrs)
        self.seen.begin(first, self.found.variables)
        self.found.ok[:] = found[OK].values.ravel()
        self.found.reason[:] = found[REASON].values.ravel()
        self.found.messages |= {i: str(text) for i, text in enumerate(found[MESSAGE].values.ravel()) if text}
        self.done = self.found.reason != Reason.NOT_RUN.code
        self._written = int(np.count_nonzero(self.done))


def read_netcdf_study(path: Path) -> xarray.Dataset:
    """The dataset of a file of a study.

    Raises:
        InputError: no such file.
    """
    found = _decoded(path)
    found.attrs = {name: value for name, value in found.attrs.items() if name != LAYOUT}
    return with_outcome(found)


def encoded(dataset: xarray.Dataset, layout: str, path: Path) -> bytes:
    """A dataset as the bytes of a netCDF 3 file.

    Raises:
        InputError: text or numbers that netCDF 3 does not have.
    """
    blank = [name for name in dataset.coords if " " in str(name) and name not in dataset.dims]
    texts = {name: _as_text(x.values) for name, x in dataset.coords.items() if _is_foreign(x.values)}
    layout = json.dumps({**json.loads(layout), "kinds": {str(name): str(dataset[name].dtype) for name in texts}})
    dataset = dataset.assign_coords({name: (dataset[name].dims, text, dataset[name].attrs) for name, text in texts.items()})
    whole = dataset.reset_coords(blank).assign_attrs({**dataset.attrs, LAYOUT: layout})
    try:
        return bytes(whole.to_netcdf(engine="scipy", format="NETCDF3_64BIT"))
    except (UnicodeEncodeError, ValueError, TypeError) as error:
        raise InputError(
            f"these results cannot be written as {path.name!r}: {error!s:.200}. Give out= a path that ends in .zarr."
        ) from error


def _is_foreign(values: Array) -> bool:
    """Whether netCDF 3 lacks values: dates, times, and whole numbers of more than 32 bits. They are written as text."""
    return values.dtype.kind in "mM" or (values.dtype.kind == "i" and bool(values.size) and int(np.abs(values).max()) >= 2**31)


def _as_text(values: Array) -> Array:
    return (values if values.dtype.kind == "M" else values.astype(np.int64)).astype(str).astype(object)


def _of_text(values: Array, kind: np.dtype) -> Array:
    texts = values.astype(str)
    return texts.astype(kind) if kind.kind == "M" else texts.astype(np.int64).astype(kind)


def _decoded(path: Path) -> xarray.Dataset:
    module = xarray_or_error()
    try:
        data = path.read_bytes()
        check_netcdf(data)
        found: xarray.Dataset = module.load_dataset(io.BytesIO(data), engine="scipy", decode_times=False)
    except Exception as error:  # SciPy's reader can raise any exception on invalid bytes
        raise InputError(
            f"{str(path)!r:.300} is no store of a study, or a damaged one: {error!s:.200}. Give another path, or move it away."
        ) from error
    found.attrs = {name: value.item() if isinstance(value, np.generic) else value for name, value in found.attrs.items()}
    format_of(found.attrs, str(path))
    try:
        layout = json.loads(found.attrs[LAYOUT])
        first = layout["first"]
        kinds = {name: np.dtype(kind) for name, kind in layout.get("kinds", {}).items()}
        found = found.assign_coords(
            {n: (found[n].dims, _of_text(found[n].values, k), found[n].attrs) for n, k in kinds.items()}
        )
        return normal(found, [OK, REASON, MESSAGE, *sorted(first, key=first.__getitem__)], layout["coords"])
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"{str(path)!r:.300} is a damaged store: {error!s:.200}. Give another path, or move it away."
        ) from error
