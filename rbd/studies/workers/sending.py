"""An evaluation as bytes for other processes; what cannot be sent is named before work starts."""

from __future__ import annotations

import functools
import io
import pickle
import sys
import types
from collections import ChainMap
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from rbd.errors import InputError

DEPTH = 6
"""How far a value that cannot be pickled is looked for, in steps such as "the global", "the attribute", "the item"."""


def pickled(evaluation: Any, function: Callable[..., Any], *, same_script: bool) -> bytes:
    """The evaluation as bytes: with cloudpickle functions of `__main__` by value, without it by their names.

    Args:
        evaluation: What is sent.
        function: The user's function in it.
        same_script: Whether the processes that get it import the same script, so that its functions can go by name.

    Raises:
        InputError: it cannot be pickled; names the value that cannot, and what to do.
    """
    dumps = _dumps()
    try:
        sent: bytes = dumps(evaluation)
    except Exception as error:  # pickling calls code of the user's classes
        raise InputError(_refusal(function, evaluation, error, dumps)) from error
    main = sys.modules["__main__"]
    by_name = dumps is pickle.dumps and getattr(function, "__module__", None) == "__main__"
    if by_name and not (same_script and getattr(main, "__file__", None)):
        where = "the other processes do not run this script" if getattr(main, "__file__", None) else "there is no script"
        raise InputError(
            f"{_name(function)} is defined in __main__, and {where}, so it cannot go to other processes by its name. Install "
            "cloudpickle (pip install 'rbd-contact[study]'), or define it in a module; executor=0 computes in this process."
        )
    return sent


def sent_columns(columns: Mapping[str, Any]) -> Mapping[str, Any] | bytes:
    """The samples of a chunk as they go to another process: with objects among them as bytes, as functions do.

    Args:
        columns: {argument: values}: an array, or a list of texts and objects.

    Raises:
        InputError: an object that cannot be pickled; names it.
    """
    if all(isinstance(values, np.ndarray) or all(type(x) is str for x in values) for values in columns.values()):
        return columns
    dumps = _dumps()
    try:
        return dumps(dict(columns))
    except Exception as error:  # pickling calls code of the user's classes
        path, culprit = _culprit(dict(columns), dumps)
        install = "install cloudpickle (pip install 'rbd-contact[study]'), or " if dumps is pickle.dumps else ""
        raise InputError(
            f"samples cannot be sent to other processes: {path or 'one'} is {_described(culprit)} ({error!s:.160}). To try: "
            f"{install}give what it is made of and create it in the function; executor=0 computes in this process."
        ) from error


def _dumps() -> Callable[[Any], bytes]:
    try:
        import cloudpickle
    except ImportError:
        return pickle.dumps
    # cloudpickle alone sends a file that is open for reading as its text, which is another value than the file
    table = ChainMap({io.TextIOWrapper: _of_file}, cloudpickle.Pickler.dispatch_table)
    pickler = type("Pickler", (cloudpickle.Pickler,), {"dispatch_table": table})

    def dumps(value: Any) -> bytes:
        with io.BytesIO() as file:
            pickler(file).dump(value)
            return file.getvalue()

    return dumps


def _of_file(file: io.TextIOWrapper) -> tuple[Any, ...]:
    """How a text file is pickled: not at all, but for those by which every process writes.

    Raises:
        pickle.PicklingError: it is another one.
    """
    for name in ("stdout", "stderr"):
        if file is getattr(sys, name):
            return getattr, (sys, name)
    raise pickle.PicklingError(f"cannot pickle the open file {getattr(file, 'name', '')!r:.100}")


def _refusal(function: Any, evaluation: Any, error: Exception, dumps: Callable[[Any], bytes]) -> str:
    name = _name(function)
    start = f"{name} cannot be sent to other processes: "
    if dumps is pickle.dumps and ("<lambda>" in name or "<locals>" in name):
        return (
            f"{start}it is defined inside a function. Define it at the top of a module, or install cloudpickle (pip install "
            "'rbd-contact[study]'); executor=0 computes in this process."
        )
    keep = evaluation.keep if isinstance(evaluation.keep, Mapping) else {}
    for what, value in ((name, function), *((f"keep[{key!r}]", found) for key, found in keep.items())):
        if not _fits(value, dumps):
            path, culprit = _culprit(value, dumps)
            told = f"{path} is {_described(culprit)}" if path else f"{what} is {_described(culprit)}"
            return (
                f"{start}{told}, which only this process has ({error!s:.160}). Create it inside the function, or give the "
                "function what it is made of, such as a path; a function of a module is sent by its name; executor=0 computes "
                "in this process."
            )
    return f"{start}{type(error).__name__}: {error!s:.300}. executor=0 computes in this process."


def _name(function: Any) -> str:
    return str(getattr(function, "__qualname__", None) or repr(function)[:80])


def _fits(value: Any, dumps: Callable[[Any], bytes]) -> bool:
    try:
        dumps(value)
    except Exception:
        return False
    return True


def _culprit(value: Any, dumps: Callable[[Any], bytes]) -> tuple[str, Any]:
    """The innermost value that cannot be pickled, and the way to it in words."""
    path, seen = "", {id(value)}
    for _ in range(DEPTH):
        for way, part in _parts(value):
            if id(part) not in seen and not _fits(part, dumps):
                path, value = f"{way} of {path}" if path else way, part
                seen.add(id(part))
                break
        else:
            break
    return path, value


def _parts(value: Any) -> Iterator[tuple[str, Any]]:
    """What a value is pickled with: (words, part)."""
    if isinstance(value, functools.partial):
        yield "the function", value.func
        yield from ((f"argument {i}", x) for i, x in enumerate(value.args))
        yield from ((f"the argument {name}", x) for name, x in value.keywords.items())
    elif isinstance(value, types.MethodType):
        yield "its object", value.__self__
        yield "its function", value.__func__
    elif isinstance(value, types.FunctionType):
        for name, cell in zip(value.__code__.co_freevars, value.__closure__ or (), strict=True):
            try:
                yield f"its variable {name}", cell.cell_contents
            except ValueError:  # not set yet
                continue
        yield from ((f"its global {name}", value.__globals__[name]) for name in _globals(value.__code__, value.__globals__))
        yield from ((f"its default {i}", x) for i, x in enumerate(value.__defaults__ or ()))
        yield from ((f"the default of {name}", x) for name, x in (value.__kwdefaults__ or {}).items())
    elif isinstance(value, Mapping):
        yield from ((f"the item {key!r:.40}", x) for key, x in value.items())
    elif isinstance(value, list | tuple | set | frozenset):
        yield from ((f"item {i}", x) for i, x in enumerate(value))
    else:
        yield from ((f"the attribute {name}", x) for name, x in getattr(value, "__dict__", {}).items())


def _globals(code: types.CodeType, known: Mapping[str, Any]) -> Iterator[str]:
    yield from (name for name in code.co_names if name in known)
    for inner in code.co_consts:
        if isinstance(inner, types.CodeType):
            yield from _globals(inner, known)


def _described(value: Any) -> str:
    kind = type(value).__name__
    if isinstance(value, io.IOBase):
        return f"an open file ({kind})"
    if isinstance(value, types.GeneratorType):
        return "a generator"
    if kind in ("lock", "RLock", "_RLock", "Condition", "Semaphore", "Event"):
        return f"a lock ({kind})"
    return f"an object of type {type(value).__module__}.{kind}"
