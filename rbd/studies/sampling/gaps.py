"""Gaps in arrays and data frames: NaN among numbers, None among texts and truth values."""

from __future__ import annotations

from typing import Any

import numpy as np

from rbd.arrays import Array
from rbd.errors import InputError


def without_gaps(name: str, given: Any) -> Any:
    """Values with NaN or None for what is masked or missing; all else as it was given.

    Args:
        name: Name of the argument.
        given: What a user gave. Looked at are masked arrays, also in a list, and arrays of objects, as data frames have them.

    Returns:
        Masked numbers as float64 with NaN; of an array of objects float64 with NaN for pandas.NA where all else is numbers, and
        None where all else is text or truth values.

    Raises:
        InputError: a masked array of anything but numbers, of which some are masked.
    """
    if isinstance(given, list | tuple) and any(isinstance(x, np.ma.MaskedArray) for x in given):
        return [without_gaps(name, x) for x in given]
    if isinstance(given, np.ma.MaskedArray):
        return _unmasked(name, given)
    if isinstance(given, np.ndarray) and given.dtype.kind in "OT" and given.ndim == 1:
        return _of_objects(given)
    return given


def _unmasked(name: str, given: np.ma.MaskedArray) -> Any:
    if not np.ma.is_masked(given):
        found = np.asarray(given.data)
    elif given.dtype.kind in "iuf":
        found = np.where(np.ma.getmaskarray(given), np.nan, given.data)
    else:
        told = "Masked numbers become NaN; give other values without the masked ones"
        raise InputError(f"{name} is a masked array of {given.dtype}, of which some are masked. {told}: {name}.compressed().")
    return found if found.ndim else found.item()


def _of_objects(given: Array) -> Array:
    gaps = np.array([_is_gap(x) for x in given.tolist()], bool)
    others = given[~gaps].tolist()
    if not gaps.any() or not others:
        return given
    if all(isinstance(x, str | bool | np.bool_) for x in others):
        found = given.astype(object)
        found[gaps] = None
        return found
    if None in given.tolist():  # among numbers it may be meant: "no limit"
        return given
    if all(isinstance(x, int | float | np.integer | np.floating) and not isinstance(x, bool) for x in others):
        numbers = np.full(len(given), np.nan)
        numbers[~gaps] = others
        return numbers
    return given


def _is_gap(value: object) -> bool:
    """Whether this is None, NaN or pandas.NA."""
    return value is None or (isinstance(value, float) and value != value) or type(value).__name__ == "NAType"
