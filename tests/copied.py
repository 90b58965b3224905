"""Real instances of the package's classes, found by walking what its functions return; and whether a copy is the same."""

from __future__ import annotations

import inspect
import types
from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import partial
from typing import Any

import numpy as np
import pinocchio as pin

import rbd
from rbd.arrays import lazy

ENOUGH = 8
"""So many instances of a class are walked through and kept."""

COMPILED = ("_entries",)
"""Fields that are compiled again in a copy: another function, of the same expression."""


def instances(roots: Iterable[object]) -> dict[type, list[Any]]:
    """{class of rbd: some of its instances} of all that the roots hold, their computed attributes too."""
    found: dict[type, list[Any]] = {}
    seen: set[int] = set()
    waiting, alive = list(roots), []
    while waiting:
        one = waiting.pop()
        if id(one) in seen or isinstance(one, type | types.ModuleType | types.FunctionType | Enum):
            continue
        seen.add(id(one))
        alive.append(one)  # so that no other object gets its id
        if isinstance(one, Mapping):
            waiting += [*one.keys(), *one.values()]
        elif isinstance(one, partial):
            waiting += [*one.args, *one.keywords.values()]
        elif isinstance(one, list | tuple | set | frozenset):
            waiting += list(one)[:50]
        if str(type(one).__module__).split(".")[0] != "rbd":
            continue
        kept = found.setdefault(type(one), [])
        if len(kept) < ENOUGH:
            kept.append(one)
            waiting += attributes(one).values()
    return found


def attributes(one: object) -> dict[str, Any]:
    """What an object keeps, and what it computes when it is asked for."""
    for name, what in inspect.getmembers_static(type(one), lambda x: isinstance(x, lazy | property)):
        if isinstance(what, lazy | property):
            try:
                getattr(one, name)
            except (rbd.RbdError, AttributeError, NotImplementedError, AssertionError):
                continue
    names = set(getattr(one, "__dict__", {})) | {n for kind in type(one).__mro__ for n in getattr(kind, "__slots__", ())}
    return {name: getattr(one, name) for name in sorted(names) if hasattr(one, name) and not name.startswith("__")}


def difference(one: Any, other: Any, where: str = "it") -> str:
    """Where a copy differs from what it was made of, in words; empty if it does not."""
    if one is other:
        return ""
    if type(one) is not type(other):
        return f"{where} is a {type(other).__name__}, and was a {type(one).__name__}"
    if isinstance(one, np.ndarray) and one.dtype == object == other.dtype:
        return difference((one.shape, *one.flat), (other.shape, *other.flat), where)
    if isinstance(one, np.ndarray):
        return "" if np.array_equal(one, other, equal_nan=one.dtype.kind in "fc") else f"{where} differs"
    if isinstance(one, float | int | str | bytes | complex):
        same = one == other or one != one
        return (difference(vars(one), vars(other), where) if hasattr(one, "__dict__") else "") if same else f"{where} differs"
    if isinstance(one, Mapping):
        if list(one) != list(other) and any(isinstance(key, str) for key in one):
            return f"{where} has keys {list(other)}, and had {list(one)}"
        pairs: Iterable[tuple[Any, Any, Any]] = ((key, one[key], other.get(key)) for key in one if isinstance(key, str))
    elif isinstance(one, list | tuple):
        if len(one) != len(other):
            return f"{where} has {len(other)} entries, and had {len(one)}"
        pairs = ((i, a, b) for i, (a, b) in enumerate(zip(one, other, strict=True)))
    elif isinstance(one, set | frozenset):
        return "" if sorted(map(str, one)) == sorted(map(str, other)) else f"{where} differs"
    elif isinstance(one, rbd.State):
        pairs = [(name, getattr(one, name), getattr(other, name)) for name in ("robot", "q", "v", "M", "h", "com")]
    elif isinstance(one, rbd.model.checked_model.CheckedModel):
        names = ("model", "name", "passive", "sound", "effort_limit", "bases")
        pairs = [(name, getattr(one, name), getattr(other, name)) for name in names]
    elif isinstance(one, BaseException):
        pairs = [("args", one.args, other.args), *((n, x, vars(other).get(n)) for n, x in vars(one).items())]
    elif is_dataclass(one):
        pairs = [(f.name, getattr(one, f.name), getattr(other, f.name)) for f in fields(one) if f.name not in COMPILED]
    elif isinstance(one, pin.Model | pin.SE3 | pin.Inertia | pin.Motion | pin.Force):
        return "" if one == other else f"{where} differs"
    elif isinstance(one, partial):
        # A method's object is copied too.
        func, copied = (getattr(each.func, "__func__", each.func) for each in (one, other))
        return difference((one.args, one.keywords), (other.args, other.keywords), where) if func is copied else where
    elif str(type(one).__module__).startswith("sympy"):
        return "" if one == other else f"{where} differs"
    else:
        return ""  # without parts that could be compared
    for name, a, b in pairs:
        if type(a).__name__ in ("StateOrigin", "LeftBehind", "PerRobot"):
            continue  # left behind on purpose
        if told := difference(a, b, f"{where}.{name}"):
            return told
    return ""
