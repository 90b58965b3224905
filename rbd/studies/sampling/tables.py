"""`table`: samples in rows, of columns, data frames, datasets and mappings; `samples_of`: whatever a user gives as samples."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from rbd.errors import InputError
from rbd.studies.sampling.columns import Column, check_name, column, is_one
from rbd.studies.sampling.samples import Samples

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
            - an xarray.Dataset whose variables vary along one dimension, which keeps its name; its coordinates stand in the
              dataset of the study, and are no arguments: for these give `dict(rows.data_vars, t=rows.t)`;
            - of a DataArray, of `.coords`, and of a dataset without variables the coordinates: along several dimensions, as a
              grid;
            - a structured NumPy array;
            - mappings of arguments, in a list or any iterable, which is read once, to its end.
        dimension: Name of the dimension in the dataset.

    Returns:
        The samples. NaN is a number like others; masked and missing numbers are NaN, missing texts of a data frame None.

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
    if isinstance(rows, np.ndarray):
        if rows.dtype.names is None:
            told = "give columns by name: {'friction': array[:, 0], ...}"
            raise InputError(f"samples are an array of shape {rows.shape} without names; {told}.")
        return _of_columns({name: rows[name].ravel() for name in rows.dtype.names}, dimension)
    if hasattr(rows, "dims") and hasattr(rows, "coords"):
        return _of_xarray(rows)
    if isinstance(rows, Mapping) and rows and all(hasattr(x, "dims") and hasattr(x, "coords") for x in rows.values()):
        return _of_variables(dict(rows.items()), _index_names(rows))
    if isinstance(rows, Mapping):
        return _of_columns(rows, dimension)
    if hasattr(rows, "columns") and hasattr(rows, "__getitem__"):
        frame: Any = rows
        if len(set(frame.columns)) < len(frame.columns):
            raise InputError(f"samples are a data frame with columns {list(frame.columns)!r:.200}; name each once.")
        return _of_columns({name: frame[name] for name in frame.columns}, dimension)
    if isinstance(rows, str | bytes) or not isinstance(rows, Iterable):
        number = isinstance(rows, int) and not isinstance(rows, bool)
        told = f" For random draws: rbd.sample({rows}, friction=(0.1, 1.0))." if number else ""
        raise InputError(f"samples are {rows!r:.80}; expected {TAKEN}.{told}")
    return _of_columns(_columns_of(rows), dimension)


def _columns_of(rows: Iterable[Any]) -> dict[str, list[Any]]:
    """Columns of mappings, which are read once.

    Raises:
        InputError: what is no mapping, or has other names than the first; the number of the row.
    """
    found: dict[str, list[Any]] = {}
    for i, row in enumerate(rows):
        if not isinstance(row, Mapping):
            told = "name its values: {'friction': 0.5, ...}" if isinstance(row, list | tuple | np.ndarray) else f"give {TAKEN}"
            raise InputError(f"sample {i} is {row!r:.80}; expected a mapping of arguments. Please {told}.")
        if i == 0:
            found = {name: [] for name in row}
        if row.keys() != found.keys():
            missing = [str(name) for name in found if name not in row]
            more = [str(name) for name in row if name not in found]
            parts = [f"no {', '.join(missing)}"] * bool(missing) + [f"{', '.join(more)}, which sample 0 does not have"] * bool(
                more
            )
            raise InputError(
                f"sample {i} has {', and '.join(parts)}; expected the arguments {', '.join(map(str, found))}, as in sample 0."
            )
        for name, value in row.items():
            found[name].append(value)
    if not found:
        raise InputError("samples are empty; give at least one mapping of arguments.")
    return found


def _of_columns(columns: Mapping[Any, Any], dimension: str) -> Samples:
    if not columns:
        raise InputError(f"samples have no columns; expected {TAKEN}.")
    found = []
    for name, values in columns.items():
        if isinstance(values, Mapping):
            told = "Give a list; rbd.grid(...) takes {label: value}"
            raise InputError(f"the column {name!r:.80} is a mapping, {values!r:.80}. {told}.")
        found.append(column(name, values, dimension))
    return Samples(_length(found, dimension), tuple(found))


def _length(columns: list[Column], dimension: str) -> dict[str, int]:
    """{dimension: the one length of all columns}; empty if nothing varies.

    Raises:
        InputError: columns of different lengths, and which have which.
    """
    lengths: dict[int, list[str]] = {}
    for each in columns:
        if each.dim:
            lengths.setdefault(len(each), []).append(each.name)
    if len(lengths) > 1:
        parts = [f"{n} values of {', '.join(names)}" for n, names in lengths.items()]
        raise InputError(
            f"samples have columns of different lengths: {'; '.join(parts)}. Give as many values of each; for all combinations "
            "use rbd.grid(...)."
        )
    return dict.fromkeys([dimension][: len(lengths)], next(iter(lengths), 0))


def _of_xarray(given: Any) -> Samples:
    """Of a dataset the variables along its one dimension; of a dataset without variables, or an array, the coordinates."""
    variables = dict(getattr(given, "data_vars", {}))
    if not variables:
        coords = dict(given.coords.items())
        if not coords:
            raise InputError("samples are an array of xarray without coordinates; give a mapping of columns {name: array}.")
        return _of_variables(coords, _index_names(given.coords))
    first = list(dict.fromkeys(x.dims[0] for x in variables.values() if x.dims))
    if len(first) > 1 or any(len(x.dims) > 1 and x.dims[1] in given.coords for x in variables.values()):
        shapes = "; ".join(f"{name} along {', '.join(map(str, x.dims))}" for name, x in list(variables.items())[:6])
        raise InputError(
            f"samples are a dataset with variables along several dimensions ({shapes}). Give one dimension, by "
            f"dataset.stack(sample=[...]).reset_index('sample'), or its grid of coordinates: dataset.coords."
        )
    return _of_variables(variables, [])


def _index_names(coords: Any) -> list[str]:
    return [str(name) for name, x in coords.items() if x.dims == (name,)]


def _of_variables(variables: Mapping[Any, Any], indices: list[str]) -> Samples:
    """Columns along the first dimension of each variable; a plain `sample` that only numbers others is left out."""
    names = {str(name): x for name, x in variables.items()}
    inner = {dim for x in names.values() for dim in x.dims[1:]}
    numbered = [d for d in indices if d == "sample" and any(d in x.dims for name, x in names.items() if name != d)]
    names = {name: x for name, x in names.items() if name not in inner and name not in numbered}
    dims: dict[str, int] = {}
    for x in names.values():
        if x.dims:
            dims[str(x.dims[0])] = x.sizes[x.dims[0]]
    shown = {name: x for name, x in _coordinates(names).items() if not _numbers_only(x)}
    return Samples(dims, tuple(_columns_of_variables(names, indices)), tuple(_columns_of_variables(shown, [])))


def _coordinates(names: Mapping[str, Any]) -> dict[str, Any]:
    """Coordinates along the first dimensions of variables, which are no variables themselves.

    Raises:
        InputError: two variables with different ones, which therefore are not of the same samples.
    """
    found: dict[str, Any] = {}
    for own, x in names.items():
        for coordinate, values in getattr(x, "coords", {}).items():
            name = str(coordinate)
            if not x.dims or values.dims != x.dims[:1] or name in names:
                continue
            if not found.setdefault(name, values).equals(values):
                raise InputError(
                    f"{own} has other values of the coordinate {name!r:.80} than the variables before it; bring them to the "
                    "same ones by xarray.align(...)."
                )
    return found


def _numbers_only(x: Any) -> bool:
    """Whether a coordinate says no more than the numbers of samples, or than its levels, which are coordinates too."""
    values = x.values
    several = values.dtype.kind == "O" and any(isinstance(value, tuple) for value in values.tolist())
    numbered = x.name == x.dims[0] and values.dtype.kind in "iu" and np.array_equal(values, np.arange(len(values)))
    return several or (numbered and not x.attrs)


def _columns_of_variables(names: Mapping[str, Any], indices: list[str]) -> Iterator[Column]:
    for name, x in names.items():
        values = x.values if x.dims else x.values.item()
        found = column(name, values, str(x.dims[0]) if x.dims else "", distinct=name in indices)
        if not x.dims and not is_one(values):
            raise InputError(f"{name} has no dimension and is {values!r:.80}; expected one value.")
        yield found.with_units(str(x.attrs.get("units", "")))
