"""Numbers of force elements: stiffness, damping and other constants, checked; warnings of what is unusual."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np

from rbd.arrays import Array, as_array, as_float
from rbd.errors import InputError
from rbd.errors.warned import ForceElementWarning, stacklevel_of_user

LARGEST = 1e50
"""No constant is larger: products of two still have squares."""
ROUNDING = 1e-12
"""An eigenvalue above minus this, over the largest, is zero."""


def number(what: str, value: float) -> float:
    """A finite number.

    Raises:
        InputError: it is none, or larger than 1e50.
    """
    found = as_float(value)
    if not abs(found) <= LARGEST:
        raise InputError(f"{what} is {value!r:.80}; expected a finite number of at most {LARGEST:g}.")
    return found


def stiffness_of(what: str, value: float) -> float:
    """A stiffness; a negative one is warned of, as it pushes away from rest.

    Raises:
        InputError: no finite number.
    """
    found = number(f"stiffness of {what}", value)
    if found < 0.0:
        _warn(f"stiffness of {what} is {found:g}: a negative one pushes away from rest, and its energy has no minimum.")
    return found


def damping_of(what: str, value: float) -> float:
    """A damping.

    Raises:
        InputError: negative, or no finite number.
    """
    found = as_float(value)
    if not 0.0 <= found <= LARGEST:
        raise InputError(f"damping of {what} is {value!r:.80}; expected a finite number from 0: a negative one would drive.")
    return found


def six(what: str, value: float | Sequence[float] | Array) -> Array:
    """Six finite numbers: of x, y, z and of the rotations about them; one number stands for all six.

    Raises:
        InputError: other numbers.
    """
    found = as_array(what, value)
    if found.shape not in ((), (6,)):
        raise InputError(f"{what} has shape {found.shape}; expected six numbers (x, y, z, about x, about y, about z).")
    _check(what, found)
    return np.broadcast_to(found, 6).copy()


def matrix(what: str, value: float | Sequence[float] | Array) -> Array:
    """Six numbers as a diagonal matrix, or a symmetric one, shape (6, 6).

    Raises:
        InputError: neither, or not finite.
    """
    found = as_array(what, value)
    if found.shape != (6, 6):
        if found.ndim == 2:
            raise InputError(f"{what} has shape {found.shape}; expected six numbers, or a symmetric matrix (6, 6).")
        return np.diag(six(what, found))
    _check(what, found)
    off = np.abs(found - found.T).max()
    if not off <= ROUNDING * np.abs(found).max():
        raise InputError(f"{what} differs from its transpose by {off:.3g}; expected a symmetric matrix: others have no energy.")
    return 0.5 * (found + found.T)


def stiffness_matrix(what: str, value: float | Sequence[float] | Array) -> Array:
    """Stiffnesses of a bushing; negative eigenvalues are warned of.

    Raises:
        InputError: as of `matrix`.
    """
    K = matrix(f"stiffness of {what}", value)
    least = _least(K)
    if least < 0.0:
        _warn(
            f"stiffness of {what} is not positive semidefinite (least eigenvalue {least:.3g}): it pushes away from rest in one "
            "direction, and its energy has no minimum."
        )
    return K


def damping_matrix(what: str, value: float | Sequence[float] | Array) -> Array:
    """Dampings of a bushing.

    Raises:
        InputError: as of `matrix`, or with a negative eigenvalue.
    """
    C = matrix(f"damping of {what}", value)
    least = _least(C)
    if least < 0.0:
        raise InputError(f"damping of {what} has the negative eigenvalue {least:.3g}, which would drive; expected none.")
    return C


def _check(what: str, found: Array) -> None:
    if not np.abs(found).max() <= LARGEST:
        raise InputError(f"{what} is {found.tolist()!r:.80}; expected finite numbers of at most {LARGEST:g}.")


def _least(A: Array) -> float:
    """The least eigenvalue, zero where it is rounding."""
    eigenvalues = np.linalg.eigvalsh(A)
    return float(eigenvalues[0]) if eigenvalues[0] < -ROUNDING * np.abs(eigenvalues).max() else 0.0


def _warn(text: str) -> None:
    warnings.warn(text, ForceElementWarning, stacklevel=stacklevel_of_user())
