"""The results of a study as an xarray.Dataset: dimensions and coordinates of its samples, units, reasons, provenance."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from rbd.errors.reasons import Reason
from rbd.modules import xarray_or_error
from rbd.studies.kept.variable import Block
from rbd.studies.samples import Samples

if TYPE_CHECKING:
    import xarray


def dataset_of(samples: Samples, found: Block, attributes: dict[str, Any]) -> xarray.Dataset:
    """All that is kept, over the dimensions of the samples, with `ok`, `reason` (codes) and `message`.

    Args:
        samples: The samples.
        found: Results of all of them.
        attributes: Provenance.
    """
    xarray, shape, dims = xarray_or_error(), tuple(samples.dims.values()), tuple(samples.dims)
    messages = np.full(len(samples), "", object)
    for i, text in found.messages.items():
        messages[i] = text
    coords: dict[str, Any] = {name: (d, values, attrs) for name, (d, values, attrs) in samples.coords().items()}
    variables: dict[str, Any] = {
        "ok": (dims, found.ok.reshape(shape)),
        "reason": (
            dims,
            found.reason.reshape(shape),
            {"flag_values": [r.code for r in Reason], "flag_meanings": " ".join(r.name.lower() for r in Reason)},
        ),
        "message": (dims, messages.astype(str).reshape(shape)),
    }
    for name, v in found.variables.items():
        variables[name] = (
            (*dims, *v.dims),
            v.values.reshape(*shape, *v.values.shape[1:]),
            v.attributes,
        )
        coords |= {dim: (dim, list(labels)) for dim, labels in v.labels.items()}
    return xarray.Dataset(variables, coords, attributes)
