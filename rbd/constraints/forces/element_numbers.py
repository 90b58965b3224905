"""Numbers of force elements, checked; and force elements as plain data, for files and comparisons."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any, TypeVar

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_array, as_finite, check_number
from rbd.errors import InputError, nearest
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
    return check_number(what, value, -LARGEST, LARGEST, expected=f"a finite number of at most {LARGEST:g}")


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
    expected = "a finite number from 0: a negative one would drive"
    return check_number(f"damping of {what}", value, 0.0, LARGEST, expected=expected)


def six(what: str, value: float | Sequence[float] | Array) -> Array:
    """Six finite numbers: of x, y, z and of the rotations about them; one number stands for all six.

    Raises:
        InputError: other numbers.
    """
    found = as_finite(what, value, (), (6,), meaning=": six numbers (x, y, z, about x, about y, about z)")
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


_POSE, _JOINTS = "pose", "joints"


class ByValue:
    """An element that equals another of its class with the same data; elements of derived classes equal themselves alone."""

    name: str

    def __eq__(self, other: object) -> bool:
        if self is other:
            return True
        if type(other) is not type(self) or not _is_known(self) or not isinstance(other, ByValue):
            return NotImplemented
        return data_of(self) == data_of(other)

    def __hash__(self) -> int:
        return hash((type(self), self.name))


Kind = TypeVar("Kind", bound=ByValue)
KINDS: dict[str, type[ByValue]] = {}
"""The classes of `rbd.constraints.forces` by name; `kept_as_data` adds them."""


def kept_as_data(kind: type[Kind]) -> type[Kind]:
    """A decorator: files keep the elements of the class. Its fields are those of its constructor, in their final form."""
    KINDS[kind.__name__] = kind
    return kind


def _is_known(element: object) -> bool:
    return KINDS.get(type(element).__name__) is type(element)


def data_of(element: object) -> dict[str, Any] | None:
    """An element as {"kind": its class, and its fields}; None if it is of a class of a user, which no file can describe."""
    if not _is_known(element):
        return None
    given = {each.name: _plain(getattr(element, each.name)) for each in fields(element)}  # type: ignore[arg-type]
    return {"kind": type(element).__name__, **given}


def element_of(data: object) -> Any:
    """The element that `data_of` described, to the last bit.

    Raises:
        InputError: other data, or numbers that the element does not take.
    """
    if not isinstance(data, Mapping) or not isinstance(data.get("kind"), str):
        raise InputError(f"a force element is {data!r:.80}; expected its kind and its fields.")
    kind = KINDS.get(data["kind"])
    if kind is None:
        raise InputError(f"a force element is of kind {data['kind']!r:.80}; {nearest(data['kind'], KINDS)}.")
    names = [each.name for each in fields(kind)]  # type: ignore[arg-type]
    if sorted(key for key in data if key != "kind") != sorted(names):
        raise InputError(f"a force element is {data!r:.200}; expected {', '.join(names)}.")
    try:
        out = kind(**{name: _given(data[name]) for name in names})
    except (TypeError, ValueError, AttributeError, OverflowError) as error:
        raise InputError(f"a force element is {data!r:.200}: {error}") from error
    for name in names:  # a direction that is made of length one again may differ in its last bit
        if isinstance(getattr(out, name), np.ndarray):
            object.__setattr__(out, name, np.array(data[name], float).reshape(getattr(out, name).shape))
    return out


def _plain(value: Any) -> Any:
    if isinstance(value, pin.SE3):
        return {_POSE: value.homogeneous.tolist()}
    if isinstance(value, Mapping):
        return {_JOINTS: {str(key): float(number) for key, number in value.items()}}
    if value is None or isinstance(value, str):
        return value
    return np.asarray(value, float).tolist()


def _given(value: Any) -> Any:
    if isinstance(value, Mapping) and list(value) == [_POSE]:
        X = as_finite("a pose of a force element", value[_POSE], (4, 4))
        return pin.SE3(X[:3, :3].copy(), X[:3, 3].copy())
    if isinstance(value, Mapping) and list(value) == [_JOINTS]:
        return value[_JOINTS]
    return tuple(value) if isinstance(value, list) else value
