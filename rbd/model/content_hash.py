"""`digest`: a hash of what a value is or a function computes, the same in every process; what has no content is refused."""

from __future__ import annotations

import ast
import copyreg
import functools
import hashlib
import inspect
import struct
import sys
import textwrap
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from types import CodeType, FunctionType, MappingProxyType, MethodType, ModuleType
from typing import Any

import numpy as np

from rbd.errors import InputError
from rbd.model.checked_model import CheckedModel

_UTF = ("utf-8", "surrogatepass")
_OF_CLASSES = {"__dict__", "__weakref__", "__doc__", "_abc_impl"}
_MADE_OF: dict[type, tuple[str, ...]] = {
    MethodType: ("__self__", "__func__"),
    functools.partial: ("func", "args", "keywords"),
    property: ("fget", "fset", "fdel"),
    functools.cached_property: ("func",),
    staticmethod: ("__wrapped__",),
    classmethod: ("__wrapped__",),
}
"""{kind of what is made of functions: the attributes that it consists of}."""


class NoContent(InputError):
    """An object that has no content to read, such as an open file or a lock.

    Attributes:
        what: Its type, and the way to it.
        cause: What Python says of it.
    """

    def __init__(self, what: str, cause: str) -> None:
        self.what, self.cause = what, cause
        super().__init__(
            f"{what}, which has no content that could be counted ({cause}), so a store could go on with another one. Create "
            "it inside the function, give what it is made of, or define __reduce__ in its class; without out= the study runs "
            "as it is."
        )


def name_of(function: Any) -> str:
    """Module and name of a function, e.g. "push_study.push"; of a `functools.partial`, that of its function."""
    while isinstance(function, functools.partial):
        function = function.func
    if not hasattr(function, "__qualname__"):
        function = type(function)
    return f"{function.__module__}.{function.__qualname__}"


def digest(value: Any, path: str = "") -> str:
    """A hash of a value's content, the same in every process, that differs where a function computes something else.

    Of a function it covers what pickling by value would send: the source without comments and docstrings, defaults, values in
    closures, bound arguments, the object of a method, with all attributes, functions and classes that are used, with class
    attributes, and the values of modules that are used, as they are now. Robots count by their digests, other objects by what
    `pickle` sends of them, less what is computed when it is read. What is installed, and `rbd` itself, counts by name: versions
    stand beside results. Numbers count by value (0.5 of NumPy is 0.5 of Python), arrays by type, shape and entries in
    little-endian order, mappings and sets without their order, members of an Enum by name. Addresses never count.

    Args:
        value: A function, or a value.
        path: Its name in messages; empty: that of the function.

    Raises:
        InputError: it uses what has no content, such as a lock or an open file; names the way to it.
    """
    return _Walk().digest(value, path or name_of(value).rpartition(".")[2])


class _Walk:
    """Digests of a function and of all that it uses, each computed once."""

    def __init__(self) -> None:
        self._known: dict[int, str] = {}
        self._above: list[int] = []
        self._alive: list[Any] = []

    def digest(self, x: Any, path: str) -> str:
        """Of a function, a class or a value of any kind; `path` is the way to it."""
        leaf = _leaf(x)
        if leaf is not None:
            return _hash(*leaf)
        if id(x) in self._known:
            return self._known[id(x)]
        if id(x) in self._above:
            return f"again {self._above.index(id(x))}"
        self._above.append(id(x))
        self._alive.append(x)  # so that no other object gets its id
        found = self._known[id(x)] = _hash(*[part.encode(*_UTF) for part in self._parts(x, path)])
        self._above.pop()
        return found

    def _parts(self, x: Any, path: str) -> Iterator[str]:
        """The kind of an object, and digests of what it is made of."""
        kind = type(x)
        wrapped = (
            ("__wrapped__",) if isinstance(getattr(x, "__wrapped__", None), FunctionType) else ()
        )  # functools.cache, Numba
        if isinstance(x, FunctionType):
            yield from self._function(x, path)
        elif isinstance(x, type):
            yield from self._class(x, path)
        elif names := next((names for each, names in _MADE_OF.items() if isinstance(x, each)), wrapped):
            yield name_of(kind)
            yield from self._named({name.strip("_"): getattr(x, name) for name in names}, path)
        elif kind in (dict, MappingProxyType):
            yield from ("mapping", *self._items(x, path))
        elif kind in (list, tuple):
            yield from (kind.__name__, *self._each(x, path))
        elif isinstance(x, set | frozenset):
            yield from (name_of(kind), *sorted(self._each(x, path)))
        elif isinstance(x, np.ndarray):
            yield from ("objects", f"{x.dtype} {x.shape}", *self._each(x.ravel().tolist(), path))
        elif is_dataclass(x) and _by_name(kind) and kind.__reduce__ is object.__reduce__:
            yield from (name_of(kind), *self._named({f.name: getattr(x, f.name) for f in fields(x)}, path))
        else:
            yield from self._object(x, path)

    def _each(self, values: Iterable[Any], path: str) -> Iterator[str]:
        yield from (self.digest(value, f"{path}[{i}]") for i, value in enumerate(values))

    def _items(self, x: Mapping[Any, Any], path: str) -> Iterator[str]:
        for key_digest, key in sorted(((self.digest(key, path), key) for key in x), key=lambda pair: pair[0]):
            yield from (key_digest, self.digest(x[key], f"{path}[{key!r:.40}]"))

    def _named(self, x: Mapping[str, Any], path: str) -> Iterator[str]:
        for name in sorted(x):
            yield from (name, self.digest(x[name], f"{path}.{name}"))

    def _object(self, x: Any, path: str) -> Iterator[str]:
        """What `pickle` sends of an object: the function that makes it, arguments, state, entries."""
        kind = type(x)
        try:
            registered: Any = copyreg.dispatch_table.get(kind)
            sent: Any = registered(x) if registered else x.__reduce_ex__(4)
        except Exception as error:  # whatever a foreign class raises where it cannot be sent
            raise NoContent(f"{path} is a {kind.__module__}.{kind.__qualname__}", str(error)[:200]) from error
        yield f"object of {name_of(kind)}"
        if isinstance(sent, str):
            yield f"{getattr(x, '__module__', '')} {sent}"
            return
        make, arguments, state, entries, pairs = (*sent, None, None, None)[:5]
        yield from (self.digest(make, path), self.digest(kind, path), self.digest(arguments, path))
        for part in state if isinstance(state, tuple) else (state,):
            if isinstance(part, dict) and all(isinstance(name, str) for name in part):
                own = {name: inspect.getattr_static(kind, name, None) for name in part}  # computed ones when they are read
                kept = {name: part[name] for name, x in own.items() if not isinstance(x, functools.cached_property)}
                yield from self._named(kept, path)
            else:
                yield self.digest(part, path)
        yield from self._each(entries or (), path)
        yield from self._items(dict(pairs or ()), path)

    def _function(self, x: FunctionType, path: str) -> Iterator[str]:
        yield f"function {name_of(x)}"
        if _by_name(x) and "<" not in x.__qualname__:
            return
        yield from (self.digest(x.__defaults__, path), self.digest(x.__kwdefaults__, path))
        yield from self._named(inspect.getclosurevars(x).nonlocals, path)
        yield from self._named(vars(x), path)  # what it wraps, and what it keeps as attributes
        if not _by_name(x):
            yield self._source(x)
            yield from self._used(x.__globals__, set(_names(x.__code__)), path, ())

    def _used(self, has: Mapping[str, Any], names: set[str], path: str, inside: tuple[ModuleType, ...]) -> Iterator[str]:
        """What of a module's values a code names; of the user's modules among them, what it names of these."""
        for name in sorted(names & has.keys()):
            value = has[name]
            if isinstance(value, ModuleType) and not _by_name(value) and value not in inside:
                yield from (name, *self._used(vars(value), names, f"{path}.{name}", (*inside, value)))
            else:
                yield from (name, self.digest(value, f"{path}.{name}"))

    def _class(self, x: type, path: str) -> Iterator[str]:
        yield f"class {name_of(x)}"
        if not _by_name(x):
            yield from (self.digest(base, path) for base in x.__bases__)
            members = {
                name: value
                for name, value in vars(x).items()
                if name not in _OF_CLASSES and not inspect.isgetsetdescriptor(value)
                and not inspect.ismemberdescriptor(value) and (name[:2] != "__" or isinstance(value, FunctionType))
            }  # fmt: skip
            yield from self._named(members, path)

    def _source(self, function: FunctionType) -> str:
        try:
            return _plain(inspect.getsource(function), lambda_only=function.__name__ == "<lambda>")
        except (OSError, TypeError, SyntaxError, ValueError):  # typed in, or several on one line
            return self._code(function.__code__, function.__name__)

    def _code(self, code: CodeType, path: str) -> str:
        """Compiled code as text."""
        constants = [self._code(x, path) if isinstance(x, CodeType) else self.digest(x, path) for x in code.co_consts]
        return f"{code.co_code.hex()} {constants} {code.co_names} {code.co_varnames}"


def _leaf(x: Any) -> tuple[bytes, ...] | None:
    """Kind and content of what is a value, or counts by its digest or name; None of what holds other objects."""
    if isinstance(x, np.generic) and x.dtype.kind in "biufcSU":
        x = x.item()
    kind = type(x).__name__.encode()
    if isinstance(x, Enum):
        return b"enum", f"{name_of(type(x))}.{x.name}".encode(*_UTF)
    if type(x) in (bool, int, str, type(None)):
        return kind, str(x).encode(*_UTF)
    if type(x) in (float, complex):
        parts = [np.nan if part != part else part for part in (np.real(x), np.imag(x))]  # every NaN is the same
        return kind, struct.pack("<dd", *parts)
    if isinstance(x, bytes | bytearray):
        return b"bytes", bytes(x)
    if isinstance(x, np.ndarray | np.generic) and x.dtype.kind in "biufcSUmM":
        little = x.dtype.newbyteorder("<")
        return b"array", f"{little.str} {x.shape}".encode(), np.ascontiguousarray(x, little).tobytes()
    if isinstance(x, CheckedModel):
        return b"robot", x.digest.encode()
    if x is sys.stdout or x is sys.stderr:
        return b"stream", x.name.encode()
    return (b"module", x.__name__.encode()) if isinstance(x, ModuleType) else None


def _hash(*parts: bytes) -> str:
    """The SHA-256 hash of parts, with their lengths, 64 hexadecimal digits."""
    return hashlib.sha256(b"".join(b"%d:" % len(part) + part for part in parts)).hexdigest()


def _by_name(x: Any) -> bool:
    """Whether a function or a class counts by its name: of this package, Python's, and of what is installed."""
    module = (x.__name__ if isinstance(x, ModuleType) else x.__module__) or ""
    top = module.partition(".")[0]
    if top in ("rbd", "builtins") or top in sys.stdlib_module_names:
        return top != "__main__"
    file = getattr(sys.modules.get(module), "__file__", None) or ""
    return "site-packages" in file or "dist-packages" in file


def _names(code: CodeType) -> Iterator[str]:
    """Names of the module that a function, or one inside it, uses."""
    yield from code.co_names
    for each in code.co_consts:
        if isinstance(each, CodeType):
            yield from _names(each)


def _plain(source: str, *, lambda_only: bool = False) -> str:
    """A source without comments, docstrings and its layout.

    Raises:
        SyntaxError: it is a part of a statement.
        ValueError: several lambdas on one line.
    """
    tree: ast.AST = ast.parse(textwrap.dedent(source))
    if lambda_only:
        (tree,) = [node for node in ast.walk(tree) if isinstance(node, ast.Lambda)]
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            documented = ast.get_docstring(node, clean=False) is not None
            node.body = (node.body[1:] or [ast.Pass()]) if documented else node.body
    return ast.unparse(tree)
