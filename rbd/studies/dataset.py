"""The results of a study as an xarray.Dataset: dimensions and coordinates of its samples, units, reasons, provenance."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from rbd.arrays import Array
from rbd.errors.reasons import Reason
from rbd.modules import xarray_or_error
from rbd.studies.kept.variable import Block, Variable
from rbd.studies.samples import Samples

if TYPE_CHECKING:
    import xarray

OK, REASON, MESSAGE = "ok", "reason", "message"
"""Variables that every study has."""
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
        variables[name] = ((*dims, *v.dims), v.values.reshape(*shape, *inner), variable_attributes(v))
        coords |= {dim: ((dim,), np.asarray(labels), {}) for dim, labels in v.labels.items()}
    return with_outcome(normal(xarray.Dataset(variables, coords, dict(attributes))))


def coordinates(samples: Samples) -> dict[str, tuple[tuple[str, ...], Array, dict[str, Any]]]:
    """{name: (dimensions, values, attributes)} of the samples' arguments: numbers, truth values or text."""
    found = {}
    for name, (dims, values, attrs) in samples.coords().items():
        x = np.asarray(values)
        found[name] = (tuple(dims), x.astype(str) if x.dtype.kind in "OT" else x, dict(attrs))
    return found


def variable_attributes(variable: Variable) -> dict[str, Any]:
    """Unit, meaning and codes of a variable, as attributes that zarr and netCDF can write."""
    found: dict[str, Any] = {"units": variable.units, "long_name": variable.long_name}
    if variable.flags:
        found |= {"flag_values": list(variable.flags), "flag_meanings": " ".join(variable.flags.values())}
    return {name: value for name, value in found.items() if value}


def normal(dataset: xarray.Dataset) -> xarray.Dataset:
    """The dataset in the one form that it has from memory, from zarr and from netCDF.

    Text of samples is an array of objects, so that a long message costs its own length only; labels are NumPy's text, whole
    numbers of coordinates int64. Only what differs is touched, so that variables of a store stay unread.
    """
    changed: dict[str, Any] = {}
    for name, x in dataset.variables.items():
        wanted = _kind(x.dtype, label=name in dataset.coords)
        attrs = dict(x.attrs)
        if "flag_values" in attrs:
            attrs["flag_values"] = np.atleast_1d(np.asarray(attrs["flag_values"])).astype(x.dtype)
        if wanted is not None:
            changed[str(name)] = (x.dims, np.asarray(x.values).astype(wanted), attrs)
        else:
            x.attrs = attrs
    if not changed:
        return dataset
    order = list(dataset.data_vars)
    return dataset.assign_coords({name: x for name, x in changed.items() if name in dataset.coords}).assign(
        {name: x for name, x in changed.items() if name not in dataset.coords}
    )[order]


def _kind(dtype: np.dtype, *, label: bool) -> type | str | None:
    """The type to which values are to be converted; None: they have it."""
    if label:
        return str if dtype.kind in "OTS" else np.int64 if dtype.kind in "iu" and dtype != np.int64 else None
    return object if dtype.kind in "UTS" else None


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
    dataset.attrs["summary"] = f"{n:,} samples: {'; '.join(parts)}"
    if not_run:
        dataset.attrs["interrupted"] = f"{n - not_run:,} of {n:,} samples are done"
    return dataset
