"""Force elements as plain data, for files and comparisons: lists, texts and numbers to the last bit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, TypeVar

import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.errors import InputError, nearest

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
        X: Array = np.asarray(value[_POSE], float)
        if X.shape != (4, 4):
            raise InputError(f"a pose of a force element has shape {X.shape}; expected (4, 4).")
        return pin.SE3(X[:3, :3].copy(), X[:3, 3].copy())
    if isinstance(value, Mapping) and list(value) == [_JOINTS]:
        return value[_JOINTS]
    return tuple(value) if isinstance(value, list) else value
