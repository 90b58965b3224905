"""`table`: samples in rows, of columns, data frames, datasets and mappings; `samples_of`: whatever a user gives as samples."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from rbd.errors import InputError
from rbd.studies.samples import Column, Samples, check_name, column

TAKEN = (
    "rbd.grid(...), rbd.sample(...), a mapping of columns {'friction': [...]}, a data frame, an xarray.Dataset, a structured "
    "array, or mappings of arguments [{'friction': 0.5}, ...]"
)


def samples_of(given: object) -> Samples:
    """What a user gave as samples: `Samples` as they are, all else as `table` takes it.

    Raises:
        InputError: what cannot be taken.
    """
    return given if isinstance(given, Samples) else table(given)


def table(rows: object, *, dimension: str = "sample") -> Samples:
    """Samples in rows, which were measured, drawn elsewhere, or vary together; `rbd.study` also takes the rows themselves.

    Args:
        rows: One of

            - a mapping of columns of one length, {argument: values}; one value, such as a robot, is the same in all rows;
            - a data frame of pandas or polars; its index is left out;
            - an xarray.Dataset whose variables vary along one dimension, which keeps its name; its coordinates are no
              arguments: for these give `dict(rows.data_vars, t=rows.t)`;
            - of a DataArray, of `.coords`, and of a dataset without variables the coordinates: along several dimensions, as a
              grid;
            - a structured NumPy array;
            - mappings of arguments, in a list or any iterable, which is read once, to its end.
        dimension: Name of the dimension in the dataset.

    Returns:
        The samples. NaN is a number like others; missing numbers of a data frame are NaN, missing texts None.

    Raises:
        InputError: columns of different lengths, rows with different arguments, none at all, tuples without names.

    Example:
        >>> cases = rbd.studies.table({"push_y": [50.0, 80.0], "posture": ["crouched", "upright"]}, dimension="case")
        >>> print(rbd.grid(friction=[0.3, 0.6]) * cases)
        4 samples: friction (2) x case (2)
          friction  2 values: 0.3, 0.6
          push_y    2 values: 50, 80
          posture   2 values: crouched, upright
    """
    check_name(dimension)
    given: Any = rows
    if hasattr(given, "dims") and hasattr(given, "coords"):
        return _of_xarray(given)
    if isinstance(given, Mapping):
        if given and all(hasattr(x, "dims") and hasattr(x, "coords") for x in given.values()):
            return _of_variables(given)
        return _of_columns(given, dimension)
    names = getattr(given.dtype, "names", None) if isinstance(given, np.ndarray) else getattr(given, "columns", None)
    if names is not None:
        if len(set(names)) < len(names):
            raise InputError(f"samples are a data frame with columns {list(names)!r:.200}; name each once.")
        return _of_columns({name: given[name] for name in names}, dimension)
    if isinstance(given, np.ndarray):
        raise InputError(
            f"samples are an array of shape {given.shape} without names; give columns by name: "
            "{'friction': array[:, 0], ...}."
        )
    if isinstance(given, str | bytes) or not isinstance(given, Iterable):
        number = isinstance(given, int) and not isinstance(given, bool)
        told = f" For random draws: rbd.sample({given!r}, friction=(0.1, 1.0))." if number else ""
        raise InputError(f"samples are {given!r:.80}; expected {TAKEN}.{told}")
    return _of_columns(_columns_of(given), dimension)


def _columns_of(rows: Iterable[Any]) -> dict[str, list[Any]]:
    """Columns of mappings, which are read once.

    Raises:
        InputError: what is no mapping, or has other names than the first; the number of the row.
    """
    listed = list(rows)
    if not any(listed):
        raise InputError("samples are empty; give at least one mapping of arguments.")
    for i, row in enumerate(listed):
        if not isinstance(row, Mapping):
            told = "name its values: {'friction': 0.5, ...}" if isinstance(row, list | tuple | np.ndarray) else f"give {TAKEN}"
            raise InputError(f"sample {i} is {row!r:.80}; expected a mapping of arguments. Please {told}.")
        if row.keys() != listed[0].keys():
            missing = ", ".join(str(name) for name in listed[0] if name not in row)
            more = ", ".join(str(name) for name in row if name not in listed[0])
            parts = [f"no {missing}"] * bool(missing) + [f"{more}, which sample 0 does not have"] * bool(more)
            told = f"expected the arguments {', '.join(map(str, listed[0]))}, as in sample 0"
            raise InputError(f"sample {i} has {', and '.join(parts)}; {told}.")
    return {name: [row[name] for row in listed] for name in listed[0]}


def _of_columns(columns: Mapping[Any, Any], dimension: str) -> Samples:
    if not columns:
        raise InputError(f"samples have no columns; expected {TAKEN}.")
    for name, values in columns.items():
        if isinstance(values, Mapping):
            raise InputError(
                f"the column {name!r:.80} is a mapping, {values!r:.80}. Give a list; rbd.grid(...) takes {{label: value}}."
            )
    found = [column(name, values, dimension) for name, values in columns.items()]
    lengths = {len(each): ", ".join(x.name for x in found if x.dim and len(x) == len(each)) for each in found if each.dim}
    if len(lengths) > 1:
        parts = [f"{n} values of {names}" for n, names in lengths.items()]
        raise InputError(
            f"samples have columns of different lengths: {'; '.join(parts)}. Give as many values of each; for all combinations "
            "use rbd.grid(...)."
        )
    return Samples(dict.fromkeys([dimension] * len(lengths), next(iter(lengths), 0)), tuple(found))


def _of_xarray(given: Any) -> Samples:
    """Of a dataset the variables along its one dimension; of one without variables, or an array, the coordinates, as a grid."""
    variables, coords = dict(getattr(given, "data_vars", {})), dict(given.coords.items())
    first = {x.dims[0] for x in variables.values() if x.dims}
    if len(first) > 1 or any(len(x.dims) > 1 and x.dims[1] in coords for x in variables.values()):
        shapes = "; ".join(f"{name} along {', '.join(map(str, x.dims))}" for name, x in list(variables.items())[:6])
        raise InputError(
            f"samples are a dataset with variables along several dimensions ({shapes}). Give one dimension, by "
            "dataset.stack(sample=[...]).reset_index('sample'), or its grid of coordinates: dataset.coords."
        )
    if not variables and not coords:
        raise InputError("samples are an array of xarray without coordinates; give a mapping of columns {name: array}.")
    return _of_variables(variables or coords)


def _of_variables(variables: Mapping[Any, Any]) -> Samples:
    """Columns along the first dimension of each variable; a `sample` that only numbers the others is left out."""
    inner = {dim for x in variables.values() for dim in x.dims[1:]}
    numbered = {"sample"} if any("sample" in x.dims for name, x in variables.items() if name != "sample") else set()
    found, dims = list[Column](), dict[str, int]()
    for name, x in variables.items():
        if name not in inner | numbered:
            dim = str(x.dims[0]) if x.dims else ""
            own = column(str(name), x.values if dim else x.values.item(), dim)
            found.append(replace(own, units=str(x.attrs.get("units", ""))))
            dims |= {dim: x.sizes[dim]} if dim else {}
    return Samples(dims, tuple(found))
