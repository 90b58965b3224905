"""Results of a function as variables: numbers, arrays, mappings, and records of this package by their type."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rbd.studies.kept.variable import Variable


def variables_of(result: Any, keep: Sequence[str] | None) -> dict[str, Variable]:
    """{name: variable} of one result.

    Args:
        result: What the function returned for one sample.
        keep: Names of what is kept; None: the default of its type.
    """
    if isinstance(result, Mapping):
        return {name: Variable(np.asarray(value)) for name, value in result.items() if keep is None or name in keep}
    if isinstance(result, float | int | np.ndarray):
        value = np.asarray(result)
        return {"value": Variable(value, tuple(f"value_{i}" for i in range(value.ndim)))}
    raise NotImplementedError(type(result).__name__)


def block_of(result: Any, keep: Sequence[str] | None) -> Any:
    """Variables of a batched function's result, `ok`, `reason` and messages of its rows."""
    raise NotImplementedError(type(result).__name__)
