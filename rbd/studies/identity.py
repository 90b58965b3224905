"""What a function is: a hash of its source, of functions of its module that it calls, and of the values that it uses."""

from __future__ import annotations

import ast
import enum
import functools
import hashlib
import inspect
import sys
import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from dataclasses import fields, is_dataclass
from types import BuiltinFunctionType, CodeType, FunctionType, MethodType, ModuleType
from typing import Any

import numpy as np

CHANGING = {"append", "add", "clear", "discard", "extend", "insert", "pop", "remove", "setdefault", "update"}
"""Methods that change a collection."""


def name_of(function: Any) -> str:
    """Module and name of a function, e.g. "push_study.push"; of a `functools.partial`, that of its function."""
    while isinstance(function, functools.partial):
        function = function.func
    if not hasattr(function, "__qualname__"):
        function = type(function)
    return f"{function.__module__}.{function.__qualname__}"


def hash_of(value: Any) -> str:
    """A hash that is the same in every process for the same function, or value, and differs where it computes something else.

    It covers the source without comments and docstrings, defaults, values in closures, bound arguments, functions and classes
    of its own module that are used, and values of that module that are numbers, text, arrays or collections of those, or that
    tell how they are made (`__reduce__`, as robots and states do). Other modules, and functions of `rbd` itself, count by their
    names: versions stand beside results.
    """
    found = _Hash()
    found.add(value)
    return found.sha.hexdigest()


class _Hash:
    """A hash of values, which are added one after another."""

    def __init__(self) -> None:
        self.sha = hashlib.sha256()
        self._seen: dict[int, int] = {}
        self._alive: list[Any] = []

    def add(self, x: Any) -> None:
        """Add a value of any kind."""
        if x is None or isinstance(x, bool | int | float | complex | str | bytes) and not isinstance(x, enum.Enum):
            self._text(f"{type(x).__name__} {x!r}")
        elif isinstance(x, np.ndarray | np.generic) and x.dtype != object:
            self._text(f"array {x.dtype.kind}{x.dtype.itemsize} {x.shape}")
            self.sha.update(np.ascontiguousarray(x).astype(x.dtype.newbyteorder("<")).tobytes())
        elif id(x) in self._seen:
            self._text(f"again {self._seen[id(x)]}")
        else:
            self._seen[id(x)] = len(self._seen)
            self._alive.append(x)  # so that no other object gets its id
            self._add_new(x)

    def _text(self, text: str) -> None:
        data = text.encode(errors="backslashreplace")
        self.sha.update(f"{len(data)}:".encode() + data)

    def _add_new(self, x: Any) -> None:
        if isinstance(x, enum.Enum):
            self._text(f"{name_of(type(x))} {x.name}")
        elif isinstance(x, functools.partial):
            self._all("partial", (x.func, x.args, x.keywords))
        elif isinstance(x, MethodType):
            self._all("method", (x.__func__, x.__self__))
        elif isinstance(x, FunctionType):
            self._function(x)
        elif isinstance(x, type):
            self._class(x)
        elif isinstance(getattr(x, "__wrapped__", None), FunctionType):  # of functools.cache
            self._all(f"wrapped by {name_of(type(x))}", (x.__wrapped__,))
        elif isinstance(x, ModuleType):
            self._text(f"module {x.__name__}")
        elif isinstance(x, CodeType):
            self._code(x)
        elif isinstance(x, BuiltinFunctionType):
            self._text(f"builtin {x.__module__}.{x.__qualname__}")
        elif isinstance(x, Mapping):
            self._all(f"mapping {len(x)}", [each for pair in x.items() for each in pair])
        elif isinstance(x, Set):
            self._text("set " + " ".join(sorted(hash_of(each) for each in x)))
        elif isinstance(x, Sequence | np.ndarray):
            self._all(f"{type(x).__name__} {len(x)}", x)
        else:
            self._object(x)

    def _all(self, what: str, values: Any) -> None:
        self._text(what)
        for each in values:
            self.add(each)

    def _function(self, x: FunctionType) -> None:
        self._text(f"function {name_of(x)}")
        if _by_name_only(x.__module__):
            return
        self._source(x, x.__code__)
        self._all("defaults", (x.__defaults__, x.__kwdefaults__))
        changes = _may_change_values(x.__code__)
        for name, cell in zip(x.__code__.co_freevars, x.__closure__ or (), strict=True):
            self._text(name)
            try:
                self._used(cell.cell_contents, changes)
            except ValueError:  # not yet assigned
                self._text("empty")
        wrapped = getattr(x, "__wrapped__", None)
        if wrapped is not None:
            self.add(wrapped)
        for name in sorted(set(_names(x.__code__)) & x.__globals__.keys()):
            value = x.__globals__[name]
            self._text(name)
            if isinstance(value, FunctionType | type) and value.__module__ != x.__module__:
                self._text(name_of(value))
            else:
                self._used(value, changes)

    def _used(self, value: Any, changes: bool) -> None:
        """A value from outside a function; where the function may fill collections, such as a list of calls, not theirs."""
        if changes and isinstance(value, list | dict | set):
            self._text(type(value).__name__)
        else:
            self.add(value)

    def _class(self, x: type) -> None:
        self._text(f"class {name_of(x)}")
        if _by_name_only(x.__module__):
            return
        try:
            self._text(_plain(inspect.getsource(x)))
        except (OSError, TypeError, SyntaxError):
            self._all("members", [each for each in vars(x).values() if isinstance(each, FunctionType)])

    def _source(self, function: Callable[..., Any], code: CodeType) -> None:
        try:
            self._text(_plain(inspect.getsource(function), lambda_only=code.co_name == "<lambda>"))
        except (OSError, TypeError, SyntaxError, ValueError):  # typed in, or several on one line
            self.add(code)

    def _code(self, x: CodeType) -> None:
        self._all(
            f"code {x.co_argcount} {x.co_kwonlyargcount} {x.co_flags}", (x.co_code, x.co_names, x.co_varnames, x.co_consts)
        )

    def _object(self, x: Any) -> None:
        """An object: what makes it, or its fields, or the plain values that it has."""
        kind = type(x)
        self.add(kind)
        if kind.__reduce__ is not object.__reduce__ or kind.__reduce_ex__ is not object.__reduce_ex__:
            try:
                recipe = x.__reduce_ex__(4)
            except Exception:  # it has none, and says so by an exception of any kind
                return
            self._all("recipe", recipe[:3] if isinstance(recipe, tuple) else (recipe,))
        elif is_dataclass(x):
            self._all("fields", [each for f in fields(x) for each in (f.name, getattr(x, f.name, None))])
        else:
            own = {k: v for k, v in getattr(x, "__dict__", {}).items() if not k.startswith("_") and _is_plain(v)}
            self.add(own)


def _is_plain(x: Any) -> bool:
    """Numbers, text, arrays, and collections of those: not what an object computes and keeps."""
    if isinstance(x, Mapping):
        return all(_is_plain(each) for pair in x.items() for each in pair)
    if isinstance(x, list | tuple):
        return all(_is_plain(each) for each in x)
    return x is None or isinstance(x, bool | int | float | complex | str | bytes | np.generic | np.ndarray)


def _by_name_only(module: str | None) -> bool:
    """Whether code of a module counts by its name: of this package, Python's, and of what is installed."""
    top = (module or "").partition(".")[0]
    if top in ("rbd", "builtins") or top in sys.stdlib_module_names:
        return top != "__main__"
    file = getattr(sys.modules.get(module or ""), "__file__", None) or ""
    return "site-packages" in file or "dist-packages" in file


def _may_change_values(code: CodeType) -> bool:
    return bool(CHANGING & set(_names(code)))


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
        lambdas = [node for node in ast.walk(tree) if isinstance(node, ast.Lambda)]
        if len(lambdas) != 1:
            raise ValueError(f"{len(lambdas)} lambdas")
        tree = lambdas[0]
    for node in ast.walk(tree):
        if (
            isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef)
            and ast.get_docstring(node, clean=False) is not None
        ):
            node.body = node.body[1:] or [ast.Pass()]
    return ast.unparse(tree)
