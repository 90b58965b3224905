"""A study's function and samples as bytes for other processes; what cannot be sent is named before work starts."""

from __future__ import annotations

import hashlib
import io
import pickle
import sys
from collections import ChainMap
from collections.abc import Mapping
from typing import Any

import numpy as np

from rbd.errors import InputError
from rbd.modules import cloudpickle_or_error
from rbd.studies.provenance.identity import NoContent, add


def pickled(value: Any, parts: Mapping[str, Any]) -> bytes:
    """A value as bytes, by cloudpickle: functions of `__main__` and inner ones by value, those of modules by name.

    Args:
        value: What is sent.
        parts: What of it is looked through where it cannot be: {name for messages: part}.

    Raises:
        InputError: it cannot be pickled; names the value that cannot, and what to do.
    """
    cloudpickle = cloudpickle_or_error()
    # cloudpickle alone sends a file that is open for reading as its text, which is another value than the file
    table = ChainMap({io.TextIOWrapper: _of_file}, cloudpickle.Pickler.dispatch_table)
    pickler = type("Pickler", (cloudpickle.Pickler,), {"dispatch_table": table})
    try:
        with io.BytesIO() as file:
            pickler(file).dump(value)
            return file.getvalue()
    except Exception as error:  # pickling calls code of the user's classes
        where = next(filter(None, (_without_content(part, name) for name, part in parts.items())), "")
        told = f"{where}, which only this process has; " if where else ""
        raise InputError(
            f"{next(iter(parts))} cannot be sent to other processes: {told}{type(error).__name__}: {error!s:.200}. Create what "
            "cannot inside the function, or give what it is made of, such as a path; executor=0 computes in this process."
        ) from error


def sent_columns(columns: Mapping[str, Any]) -> Mapping[str, Any] | bytes:
    """The samples of a chunk as they go to another process: with objects among them as bytes, as functions do.

    Args:
        columns: {argument: values}: an array, or a list of texts and objects.

    Raises:
        InputError: an object that cannot be pickled; names it.
    """
    if all(isinstance(values, np.ndarray) or all(type(x) is str for x in values) for values in columns.values()):
        return columns
    return pickled(dict(columns), {f"samples: {name}": values for name, values in columns.items()})


def _without_content(value: Any, name: str) -> str:
    """The way to the first object that has no content, and its type; empty if there is none."""
    try:
        add(hashlib.sha256(), value, name)
    except NoContent as error:
        return error.what
    return ""


def _of_file(file: io.TextIOWrapper) -> tuple[Any, ...]:
    """How a text file is pickled: not at all, but for those by which every process writes.

    Raises:
        pickle.PicklingError: it is another one.
    """
    for name in ("stdout", "stderr"):
        if file is getattr(sys, name):
            return getattr, (sys, name)
    raise pickle.PicklingError(f"cannot pickle the open file {getattr(file, 'name', '')!r:.100}")
