"""The results of a study as an xarray.Dataset: dimensions and coordinates of its samples, units, reasons, provenance."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rbd.arrays import Array
from rbd.errors.reasons import Reason
from rbd.modules import xarray_or_error
from rbd.studies.kept.variable import Block, storable
from rbd.studies.sampling.samples import Samples

if TYPE_CHECKING:
    import xarray

OK, REASON, MESSAGE = "ok", "reason", "message"
"""Variables that every study has."""
OUTCOME = ("summary", "interrupted")
"""Attributes on how many samples have a result, and how many were not computed."""
OWN: Mapping[str, dict[str, Any]] = {
    OK: {"long_name": "whether there is a result"},
    REASON: {
        "long_name": "why there is none",
        "flag_values": [reason.code for reason in Reason],
        "flag_meanings": " ".join(reason.name.lower() for reason in Reason),
    },
    MESSAGE: {"long_name": "message of the error"},
}
"""Their attributes; the codes as the CF conventions have them."""


def dataset_of(samples: Samples, found: Block, attributes: Mapping[str, Any]) -> xarray.Dataset:
    """All that is kept, over the dimensions of the samples, with `ok`, `reason` (codes) and `message`.

    Args:
        samples: The samples.
        found: Results of all of them.
        attributes: Provenance; `with_outcome` adds how many samples have a result.
    """
    xarray, shape, dims = xarray_or_error(), tuple(samples.dims.values()), tuple(samples.dims)
    messages = np.full(len(samples), "", object)
    for i, text in found.messages.items():
        messages[i] = text
    values = {OK: found.ok, REASON: found.reason, MESSAGE: messages}
    variables: dict[str, Any] = {name: (dims, x.reshape(shape), OWN[name]) for name, x in values.items()}
    coords: dict[str, Any] = dict(coordinates(samples))
    for name, v in found.variables.items():
        inner = v.values.shape[1:]
        variables[name] = ((*dims, *v.dims), v.values.reshape(*shape, *inner), v.attributes)
        coords |= {dim: ((dim,), np.asarray(labels), {}) for dim, labels in v.labels.items()}
    return with_outcome(normal(xarray.Dataset(variables, coords, dict(attributes))))


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


def with_outcome(dataset: xarray.Dataset) -> xarray.Dataset:
    """The dataset with `summary`, how many samples have a result, and `interrupted` where some were not computed."""
    reason = dataset[REASON].values
    codes, counts = np.unique(reason, return_counts=True)
    found = {int(code): int(count) for code, count in zip(codes, counts, strict=True)}
    n, not_run = reason.size, found.pop(Reason.NOT_RUN.code, 0)
    good = found.pop(Reason.NONE.code, 0)
    texts = {reason.code: reason.value for reason in Reason}
    failed = sorted(found.items(), key=lambda pair: (-pair[1], pair[0]))
    parts = [f"{good:,} ok", *(f"{count:,} {texts.get(code, code)}" for code, count in failed)]
    parts += [f"{not_run:,} not run"] if not_run else []
    dataset.attrs.pop("interrupted", None)
    dataset.attrs["summary"] = f"{n:,} sample{'s' if n > 1 else ''}: {'; '.join(parts)}"
    if not_run:
        dataset.attrs["interrupted"] = f"{n - not_run:,} of {n:,} samples are done"
    return dataset
