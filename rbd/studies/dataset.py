"""The results of a study as an xarray.Dataset: dimensions and coordinates of its samples, units, reasons, provenance."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rbd.arrays import Array
from rbd.errors.reasons import Reason
from rbd.modules import xarray_or_error
from rbd.records import Variable
from rbd.studies.outputs.fields import MESSAGE, OK, REASON, Block, storable
from rbd.studies.sampling.samples import ONE, Samples

if TYPE_CHECKING:
    import xarray

LAYOUT = "rbd_layout"
"""Attribute of a store: dimensions, coordinates and their kinds, and the order of its variables, as JSON."""


def empty_dataset(samples: Samples, attributes: Mapping[str, Any]) -> xarray.Dataset:
    """The coordinates of the samples; in the attributes what is needed to read a stored dataset as it was: `LAYOUT`."""
    coords = coordinates(samples)
    kinds = {name: str(x.dtype) for name, (_, x, _) in coords.items() if x.dtype.kind in "imM"}
    layout = json.dumps({"dims": dict(samples.dims), "coords": list(coords), "kinds": kinds, "order": []})
    return xarray_or_error().Dataset(coords=coords, attrs={**attributes, LAYOUT: layout})


def filled(empty: xarray.Dataset, dims: Mapping[str, int], found: Block, rows: slice = slice(None)) -> xarray.Dataset:
    """What is kept, over the dimensions of the samples, with `ok`, `reason` (codes) and `message`.

    Args:
        empty: The samples' coordinates, and attributes.
        dims: {dimension of the samples: its length}.
        found: Results of all samples, or of those of some places along the first dimension.
        rows: These places.
    """
    whole, shape = empty.isel({d: rows for d in list(dims)[:1] if d in empty.dims}), (-1, *tuple(dims.values())[1:])
    labels = {dim: ((dim,), np.asarray(x)) for v in found.variables.values() for dim, x in v.labels.items()}
    values = {
        name: ((*dims, *v.dims), v.values.reshape(*shape, *v.values.shape[1:]), v.attributes)
        for name, v in found.variables.items()
    }
    return normal(whole.assign_coords(labels).assign(values))


def block_of(dataset: xarray.Dataset) -> Block:
    """The block of a dataset that `dataset_of` made of consecutive samples along one dimension, which has their numbers."""
    found: dict[str, Variable] = {}
    for name, x in normal(dataset).data_vars.items():
        dims = tuple(str(dim) for dim in x.dims[1:])
        labels = {dim: tuple(dataset[dim].values.tolist()) for dim in dims if dim in dataset.coords}
        flags = zip(x.attrs.get("flag_values", ()), str(x.attrs.get("flag_meanings", "")).split(), strict=False)
        units, about = (str(x.attrs.get(key, "")) for key in ("units", "long_name"))
        found[str(name)] = Variable(x.values, dims, units, about, labels, {int(code): word for code, word in flags})
    return Block(dataset[ONE].values.astype(np.int64), found)


def coordinates(samples: Samples) -> dict[str, tuple[tuple[str, ...], Array, dict[str, Any]]]:
    """{name: (dimensions, values, attributes)} of the samples' arguments: numbers, truth values or text."""
    found = {}
    for name, (dims, values, attrs) in samples.coords().items():
        x = np.asarray(values)
        if x.dtype.kind in "mM" and np.datetime_data(x.dtype)[0] in ("Y", "M", "W", "D", "h", "m"):
            x = x.astype(f"{x.dtype.kind}8[s]")  # as xarray does in memory, and zarr does not
        found[name] = (tuple(dims), _text(x) if x.dtype.kind in "OUT" else x, dict(attrs))
    return found


def _text(values: Array) -> Array:
    """Text as objects, as zarr and netCDF can store it."""
    found = values.astype(object)
    for i, x in enumerate(found.flat):
        if isinstance(x, str):
            found.flat[i] = storable(x)
    return found


def netcdf(dataset: xarray.Dataset) -> bytes:
    """A dataset as the bytes of a netCDF 3 file; `restored` gives back what it does not have.

    Raises:
        ValueError, TypeError: text or numbers that it cannot hold.
    """
    blank = [name for name in dataset.coords if " " in str(name) and name not in dataset.dims]
    texts = {name: (x.dims, _as_text(x.values), x.attrs) for name, x in dataset.coords.items() if _is_foreign(x.values)}
    return bytes(dataset.assign_coords(texts).reset_coords(blank).to_netcdf(engine="scipy", format="NETCDF3_64BIT"))


def restored(dataset: xarray.Dataset) -> xarray.Dataset:
    """A dataset that was read from a file, in the form that it had in memory, by its attribute `LAYOUT`, which goes."""
    layout = json.loads(dataset.attrs[LAYOUT])
    found = dataset.assign_coords(
        {
            name: (dataset[name].dims, _of_kind(dataset[name].values, np.dtype(kind)), dataset[name].attrs)
            for name, kind in layout["kinds"].items()
        }
    )
    found = normal(found, [OK, REASON, MESSAGE, *layout["order"]], layout["coords"])
    found.attrs = {name: x.item() if isinstance(x, np.generic) else x for name, x in found.attrs.items() if name != LAYOUT}
    return found


def _is_foreign(values: Array) -> bool:
    """Whether netCDF 3 lacks values: dates, times, and whole numbers of more than 32 bits. They are written as text."""
    return values.dtype.kind in "mM" or (values.dtype.kind == "i" and bool(values.size) and int(np.abs(values).max()) >= 2**31)


def _as_text(values: Array) -> Array:
    return (values if values.dtype.kind == "M" else values.astype(np.int64)).astype(str).astype(object)


def _of_kind(values: Array, kind: np.dtype) -> Array:
    if values.dtype.kind not in "OTU":
        return values.astype(kind)
    texts = values.astype(str)
    return texts.astype(kind) if kind.kind == "M" else texts.astype(np.int64).astype(kind)


def normal(dataset: xarray.Dataset, order: Sequence[str] | None = None, coords: Iterable[str] = ()) -> xarray.Dataset:
    """The dataset in the one form that it has from memory, from zarr and from netCDF.

    Text is an array of objects: a long message costs its own length only, and zarr and netCDF write it as it is. Whole numbers
    of coordinates are int64. Only what differs is read, so that variables of a large store stay on the disk.

    Args:
        dataset: As it was made or read.
        order: Names of its variables in order; None: as they are.
        coords: Variables that are coordinates, though a file may not say so: those with blanks in their names.
    """
    dataset = dataset.set_coords([name for name in coords if name in dataset.variables])
    changed: dict[str, Any] = {}
    for name, x in dataset.variables.items():
        attrs = dict(x.attrs)
        if "flag_values" in attrs:
            attrs["flag_values"] = np.atleast_1d(np.asarray(attrs["flag_values"])).astype(x.dtype)
        x.attrs = attrs
        if x.dtype.kind in "UTS" or (name in dataset.coords and x.dtype.kind in "iu" and x.dtype != np.int64):
            wanted = object if x.dtype.kind in "UTS" else np.int64
            changed[str(name)] = (x.dims, np.asarray(x.values).astype(wanted), attrs)
    labels = {name: x for name, x in changed.items() if name in dataset.coords}
    found = dataset.assign_coords(labels).assign({name: x for name, x in changed.items() if name not in labels})
    return _in_order(found, list(dataset.data_vars if order is None else order)).drop_encoding()


def _in_order(dataset: xarray.Dataset, names: list[Any]) -> xarray.Dataset:
    """The dataset with its variables in one order: coordinates of samples by their dimension, of labels by first use."""
    own = list(dataset[OK].dims)
    used = list(dict.fromkeys(dim for name in names for dim in dataset[name].dims if dim not in own))
    place = {dim: k for k, dim in enumerate((*own, *used))}
    labels = [dim for dim in used if dim in dataset.coords]
    others = [name for name in dataset.coords if name not in labels]
    others.sort(
        key=lambda name: (min((place.get(dim, -1) for dim in dataset[name].dims), default=-1), name not in own, str(name))
    )
    variables = {name: dataset.variables[name] for name in (*others, *labels, *names)}
    return type(dataset)(
        {name: variables[name] for name in names}, {c: variables[c] for c in (*others, *labels)}, dataset.attrs
    )


def outcome_of(reason: Array) -> dict[str, str]:
    """`summary`, how many samples have a result, from the codes of all; and `interrupted` where some were not computed."""
    codes, counts = np.unique(reason, return_counts=True)
    found = {int(code): int(count) for code, count in zip(codes, counts, strict=True)}
    n, not_run = reason.size, found.pop(Reason.NOT_RUN.code, 0)
    good = found.pop(Reason.NONE.code, 0)
    texts = {reason.code: reason.value for reason in Reason}
    failed = sorted(found.items(), key=lambda pair: (-pair[1], pair[0]))
    parts = [f"{good:,} ok", *(f"{count:,} {texts.get(code, code)}" for code, count in failed)]
    parts += [f"{not_run:,} not run"] if not_run else []
    told = {"summary": f"{n:,} sample{'s' if n > 1 else ''}: {'; '.join(parts)}"}
    return told | ({"interrupted": f"{n - not_run:,} of {n:,} samples are done"} if not_run else {})
