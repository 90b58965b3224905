"""Whether a function can be called with the arguments of samples: checked by its parameters, before any work."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Collection, Iterable
from functools import partial
from typing import Any

from rbd.errors import InputError, nearest
from rbd.studies.sampling.samples import RESERVED, Samples


def bound(function: Callable[..., Any], samples: Samples) -> Callable[..., Any]:
    """The function with the arguments that are the same in all samples, after a check of all names.

    Args:
        function: What is called with each sample.
        samples: The samples.

    Returns:
        A function of `samples.columns(...)`, and of `rng` if it has that parameter: sent once to each worker, with the robots
        that are fixed.

    Raises:
        InputError: as of `check_call`.
    """
    check_call(function, samples.names, [each.name for each in samples.shown])
    fixed = samples.fixed
    return partial(function, **fixed) if fixed else function


def check_call(function: object, names: Iterable[str], shown: Collection[str] = ()) -> None:
    """Refuse a function that cannot be called with these arguments by name.

    Args:
        function: Any callable: a function, method, partial, class, or object with `__call__`. Of builtins without a signature
            nothing is checked.
        names: The arguments that samples have; `rng` need not be among them.
        shown: Coordinates that they have, which are no arguments.

    Raises:
        InputError: no callable; a partial that does not fit; arguments that it lacks, with the nearest of its own; parameters
            without a value; parameters that cannot be given by name; names that datasets of studies have.
    """
    if not callable(function):
        raise InputError(
            f"function is {function!r:.80}; expected a function, which is called with each sample: study(f, samples)."
        )
    called, given = name_of(function), list(names)
    if inspect.iscoroutinefunction(function) or inspect.iscoroutinefunction(type(function).__call__):
        raise InputError(f"{called} is an async function; give a plain one, which returns its result.")
    if inspect.isgeneratorfunction(function):
        raise InputError(f"{called} is a generator; give a plain function, which returns its result.")
    if taken := [name for name in given if name in RESERVED]:
        told = "Rename the parameter, or wrap the function"
        raise InputError(f"an argument has the name {taken[0]!r}, which every dataset of a study has for itself. {told}.")
    parameters = parameters_of(function)
    if parameters is None:
        if isinstance(function, partial) and parameters_of(function.func) is not None:
            named = [f"{name}={x!r:.40}" for name, x in function.keywords.items()]
            told = ", ".join([*(f"{x!r:.40}" for x in function.args), *named])
            raise InputError(f"{called} cannot be called with what its functools.partial gives it: {told:.200}.")
        return
    by_name = [p.name for p in parameters if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY)]
    hidden = [p.name for p in parameters if p.kind is p.POSITIONAL_ONLY]
    if not any(p.kind is p.VAR_KEYWORD for p in parameters):
        for name in given:
            if name in by_name:
                continue
            if name in hidden:
                raise InputError(f"{called} takes {name!r} by position only; samples give it by name. Remove the '/' after it.")
            known = nearest(name, by_name) if by_name else "it has none"
            raise InputError(f"{called} has no parameter {name!r:.80}, which the samples give; {known}.")
    needed = [p for p in parameters if p.default is p.empty and p.kind not in (p.VAR_POSITIONAL, p.VAR_KEYWORD)]
    missing = [p.name for p in needed if p.name not in given and not (p.name == "rng" and p.name in by_name)]
    if missing:
        if both := [name for name in missing if name in shown]:
            told = f"it is a coordinate only: dict(dataset.data_vars, {both[0]}=dataset.{both[0]}) gives it as an argument"
            raise InputError(f"{called} needs {both[0]}, which the samples do not give; {told}.")
        told = f"add them to the samples (one value is the same for all: rbd.grid({missing[0]}=...)), or give them defaults"
        raise InputError(f"{called} needs {', '.join(missing)}, which the samples do not give; {told}.")


def takes_rng(function: Callable[..., Any]) -> bool:
    """Whether the function has a parameter `rng`, by name, that no `functools.partial` has given already."""
    inner: Any = function
    while isinstance(inner, partial):
        if "rng" in inner.keywords:
            return False
        inner = inner.func
    own = [p for p in parameters_of(function) or [] if p.name == "rng"]
    return bool(own) and own[0].kind in (own[0].POSITIONAL_OR_KEYWORD, own[0].KEYWORD_ONLY)


def parameters_of(function: Callable[..., Any]) -> list[inspect.Parameter] | None:
    """The parameters of a callable; None of a builtin that has no signature."""
    try:
        return list(inspect.signature(function).parameters.values())
    except (ValueError, TypeError):
        return None


def name_of(function: object) -> str:
    """The name of a callable, of what a partial calls, or of its class."""
    while isinstance(function, partial):
        function = function.func
    return str(getattr(function, "__qualname__", type(function).__qualname__))
