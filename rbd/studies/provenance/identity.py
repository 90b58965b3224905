"""What a function is: a hash of its source, of functions of its module that it calls, and of the values that it uses."""

from __future__ import annotations

import ast
import functools
import hashlib
import inspect
import sys
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import is_dataclass
from types import CodeType, FunctionType, MethodType, ModuleType
from typing import Any

import numpy as np

from rbd.errors import InputError
from rbd.studies.provenance.fingerprint import add, hash_of, source_of

CHANGING = {"append", "add", "clear", "discard", "extend", "insert", "pop", "remove", "setdefault", "update"}
"""Methods that change a collection."""


def name_of(function: Any) -> str:
    """Module and name of a function, e.g. "push_study.push"; of a `functools.partial`, that of its function."""
    while isinstance(function, functools.partial):
        function = function.func
    if not hasattr(function, "__qualname__"):
        function = type(function)
    return f"{function.__module__}.{function.__qualname__}"


def function_hash(function: Callable[..., Any]) -> str:
    """A hash that is the same in every process for the same function, and differs where it computes something else.

    It covers the source without comments and docstrings, defaults, values in closures, bound arguments, functions and classes
    of its own module that are used, and values of that module that are numbers, text, arrays or collections of those, or that
    tell how they are made (`__reduce__`, as robots and states do). Other modules, and functions of `rbd` itself, count by their
    names: versions stand beside results.
    """
    found = _Hash()
    found.add(function)
    return found.sha.hexdigest()


class _Hash:
    """A hash of functions, with all that they use."""

    def __init__(self) -> None:
        self.sha = hashlib.sha256()
        self._seen: dict[int, int] = {}
        self._alive: list[Any] = []

    def add(self, x: Any) -> None:
        """Add a function, a class or a value of any kind."""
        if id(x) in self._seen:
            add(self.sha, f"again {self._seen[id(x)]}")
            return
        if isinstance(x, functools.partial):
            self._all("partial", (x.func, *x.args, *(part for pair in sorted(x.keywords.items()) for part in pair)))
        elif isinstance(x, MethodType):
            self._all("method", (x.__func__, x.__self__))
        elif isinstance(getattr(x, "__wrapped__", None), FunctionType) and not isinstance(x, FunctionType):  # functools.cache
            self._all(f"wrapped by {name_of(type(x))}", (x.__wrapped__,))
        elif isinstance(x, FunctionType | type):
            self._seen[id(x)] = len(self._seen)
            self._alive.append(x)  # so that no other object gets its id
            self._function(x) if isinstance(x, FunctionType) else self._class(x)
        elif _keeps_values(x):
            self._object(x)
        else:
            self._value(x)

    def _all(self, what: str, values: Iterable[Any]) -> None:
        values = list(values)
        add(self.sha, f"{what} {len(values)}")
        for each in values:
            self.add(each)

    def _value(self, x: Any) -> None:
        try:
            add(self.sha, hash_of(x))
        except InputError:  # an open file, a lock
            add(self.sha, name_of(type(x)))

    def _object(self, x: Any) -> None:
        """An object of a user's class: its class, and the plain values that it has."""
        self.add(type(x))
        for name, value in sorted(vars(x).items()):
            if not name.startswith("_") and _is_plain(value):
                add(self.sha, name)
                add(self.sha, value)

    def _function(self, x: FunctionType) -> None:
        add(self.sha, f"function {name_of(x)}")
        if _by_name_only(x.__module__):
            return
        self._source(x)
        self._all("defaults", (x.__defaults__, x.__kwdefaults__))
        changes = _may_change_values(x.__code__)
        for name, cell in zip(x.__code__.co_freevars, x.__closure__ or (), strict=True):
            add(self.sha, name)
            try:
                self._used(cell.cell_contents, changes)
            except ValueError:  # not yet assigned
                add(self.sha, "empty")
        wrapped = getattr(x, "__wrapped__", None)
        if wrapped is not None:
            self.add(wrapped)
        for name in sorted(set(_names(x.__code__)) & x.__globals__.keys()):
            value = x.__globals__[name]
            add(self.sha, name)
            if isinstance(value, FunctionType | type) and value.__module__ != x.__module__:
                add(self.sha, name_of(value))
            else:
                self._used(value, changes)

    def _used(self, value: Any, changes: bool) -> None:
        """A value from outside a function; where the function may fill collections, such as a list of calls, not theirs."""
        if changes and isinstance(value, list | dict | set):
            add(self.sha, type(value).__name__)
        else:
            self.add(value)

    def _class(self, x: type) -> None:
        add(self.sha, f"class {name_of(x)}")
        if _by_name_only(x.__module__):
            return
        try:
            add(self.sha, _plain(inspect.getsource(x)))
        except (OSError, TypeError, SyntaxError):
            own = {name: each for name, each in vars(x).items() if isinstance(each, FunctionType) or name[:2] != "__"}
            self._all("members", (part for pair in sorted(own.items()) for part in pair))

    def _source(self, function: FunctionType) -> None:
        try:
            add(self.sha, _plain(inspect.getsource(function), lambda_only=function.__name__ == "<lambda>"))
        except (OSError, TypeError, SyntaxError, ValueError):  # typed in, or several on one line
            add(self.sha, source_of(function))


def _keeps_values(x: Any) -> bool:
    """Whether an object has attributes that may be computed when they are first read: none that says how it is pickled."""
    kind = type(x)
    default = kind.__reduce__ is object.__reduce__ and kind.__reduce_ex__ is object.__reduce_ex__
    return default and hasattr(x, "__dict__") and not is_dataclass(x) and not isinstance(x, ModuleType)


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
