"""`add`, `hash_of`: a hash of the content of a value, the same in every process and on every platform."""

from __future__ import annotations

import copyreg
import functools
import hashlib
import inspect
import struct
import textwrap
import types
from collections.abc import Iterable
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any, Protocol

import numpy as np

from rbd.errors import InputError
from rbd.model.travelling import Travelling


class Hash(Protocol):
    """What takes bytes, such as `hashlib.sha256()`."""

    def update(self, data: bytes, /) -> None:
        """Add bytes."""
        ...


def hash_of(value: object) -> str:
    """The SHA-256 hash of a value's content, 64 hexadecimal digits; arguments and errors as of `add`."""
    found = hashlib.sha256()
    add(found, value)
    return found.hexdigest()


def add(found: Hash, value: object) -> None:
    """Add a value's content to a hash, so that equal contents give equal hashes in every process and on every platform.

    Numbers count by value (0.5 of NumPy is 0.5 of Python), arrays by type, shape and entries in little-endian order,
    mappings and sets without their order, functions by module, name, source, defaults and the variables that they enclose,
    classes by name, robots by their `digest`, wherever their files lie, and all other objects by their type and what `pickle`
    would send of them. Addresses never count.

    Args:
        found: The hash, such as `hashlib.sha256()`.
        value: Any object.

    Raises:
        InputError: an object that has no content to read, such as an open file or a lock.
    """
    _add(found, value, ())


def _add(found: Hash, value: Any, path: tuple[int, ...]) -> None:
    if isinstance(value, Enum):
        _tag(found, "enum", f"{_name(type(value))}.{value.name}")
    elif isinstance(value, np.generic) and value.dtype.kind in "biufcSU":
        _add(found, value.item(), path)
    elif value is None or isinstance(value, bool | int | str) and type(value) in (bool, int, str, type(None)):
        _tag(found, type(value).__name__, str(value))
    elif type(value) in (float, complex):
        parts = [np.nan if x != x else x for x in (np.real(value), np.imag(value))]  # every NaN is the same
        _bytes(found, type(value).__name__, struct.pack("<dd", *parts))
    elif isinstance(value, bytes | bytearray):
        _bytes(found, "bytes", bytes(value))
    elif isinstance(value, np.ndarray) and value.dtype.kind in "biufcSUmM":
        kind = value.dtype.newbyteorder("<")
        _tag(found, "array", f"{kind.str} {value.shape}")
        found.update(np.ascontiguousarray(value, kind).tobytes())
    elif isinstance(value, Travelling):
        _tag(found, "robot", value.digest)
    elif isinstance(value, type):
        _tag(found, "class", _name(value))
    elif isinstance(value, types.BuiltinFunctionType | types.ModuleType):
        _tag(found, "builtin", getattr(value, "__qualname__", value.__name__))
    else:
        if id(value) in path:
            _tag(found, "again", str(len(path) - path.index(id(value))))
            return
        _add_parts(found, value, (*path, id(value)))


def _add_parts(found: Hash, value: object, path: tuple[int, ...]) -> None:
    """Add an object that holds others."""
    if isinstance(value, np.ndarray):
        _all(found, "objects", value.tolist(), path)
    elif type(value) in (list, tuple):
        _all(found, type(value).__name__, value, path)  # type: ignore[arg-type]
    elif isinstance(value, dict | types.MappingProxyType) and type(value) in (dict, types.MappingProxyType):
        _unordered(found, "mapping", value.items(), path)
    elif type(value) in (set, frozenset):
        _unordered(found, "set", value, path)  # type: ignore[arg-type]
    elif isinstance(value, types.FunctionType):
        enclosed = [cell.cell_contents for cell in value.__closure__ or () if _is_set(cell)]
        _all(found, "function", [_name(value), source_of(value), value.__defaults__, value.__kwdefaults__, enclosed], path)
    elif isinstance(value, types.MethodType):
        _all(found, "method", [value.__func__, value.__self__], path)
    elif isinstance(value, functools.partial):
        _all(found, "partial", [value.func, value.args, value.keywords], path)
    elif is_dataclass(value) and type(value).__reduce__ is object.__reduce__ and not isinstance(value, type):
        _all(found, _name(type(value)), [part for f in fields(value) for part in (f.name, getattr(value, f.name))], path)
    else:
        _all(found, f"object of {_name(type(value))}", _reduced(value), path)


def _reduced(value: object) -> list[object]:
    """What `pickle` would send of an object: the function that makes it, arguments, state, entries."""
    try:
        registered: Any = copyreg.dispatch_table.get(type(value))
        sent: Any = registered(value) if registered else value.__reduce_ex__(4)
    except Exception as error:  # whatever a foreign class raises where it cannot be sent
        raise InputError(
            f"a {_name(type(value))} has no content that could be compared ({str(error)[:200]}). Use numbers, text, robots, "
            "contacts or dataclasses; make files and other resources inside the function."
        ) from error
    if isinstance(sent, str):
        return [_name(type(value)), sent]
    return [list(part) if i >= 3 and part is not None and i < 5 else part for i, part in enumerate(sent)]


def source_of(function: types.FunctionType) -> str:
    """The source text of a function, without its indentation; where there is none, its compiled code as text."""
    try:
        return textwrap.dedent(inspect.getsource(function)).strip()
    except (OSError, TypeError):
        return _of_code(function.__code__)


def _of_code(code: types.CodeType) -> str:
    constants = [_of_code(x) if isinstance(x, types.CodeType) else hash_of(x) for x in code.co_consts]
    return f"{code.co_code.hex()} {constants} {code.co_names} {code.co_varnames}"


def _name(value: Any) -> str:
    return f"{getattr(value, '__module__', '')}.{getattr(value, '__qualname__', type(value).__qualname__)}"


def _is_set(cell: types.CellType) -> bool:
    try:
        cell.cell_contents  # noqa: B018  an empty cell raises
    except ValueError:
        return False
    return True


def _all(found: Hash, kind: str, values: Iterable[object], path: tuple[int, ...]) -> None:
    values = list(values)
    _tag(found, kind, str(len(values)))
    for value in values:
        _add(found, value, path)


def _unordered(found: Hash, kind: str, values: Iterable[object], path: tuple[int, ...]) -> None:
    each = []
    for value in values:
        own = hashlib.sha256()
        _add(own, value, path)
        each.append(own.digest())
    _bytes(found, kind, b"".join(sorted(each)))


def _tag(found: Hash, kind: str, text: str) -> None:
    _bytes(found, kind, text.encode("utf-8", "surrogatepass"))


def _bytes(found: Hash, kind: str, data: bytes) -> None:
    """Kind and length first, so that no two sequences of values give the same bytes."""
    found.update(f"{kind} {len(data)}:".encode() + data)
