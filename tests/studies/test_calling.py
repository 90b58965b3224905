"""Whether a function takes the samples is known from its parameters, before any work."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

import rbd
from rbd.errors import InputError
from rbd.studies.evaluation import bound, check_call, takes_rng


def push(friction: float, push_y: float = 0.0) -> float:
    """One that is asked."""
    return friction * push_y


def anything(**given: float) -> float:
    """Takes all names."""
    return sum(given.values())


def by_place(friction: float, /, push_y: float = 0.0) -> float:
    """Takes one by position only."""
    return friction + push_y


def drawn(friction: float, rng: Any) -> float:
    """Draws."""
    return friction * float(rng.random())


def drawn_or_not(friction: float, *, rng: Any = None) -> float:
    """May draw."""
    return friction


async def later(friction: float) -> float:
    """An async function."""
    return friction


def each(friction: float) -> Any:
    """A generator."""
    yield friction


class Model:
    """A callable object, with a method."""

    def __init__(self, friction: float) -> None:
        self.friction = friction

    def __call__(self, push_y: float) -> float:
        """Called."""
        return push_y

    def run(self, push_y: float, margin: float = 0.0) -> float:
        """Called."""
        return push_y + margin


@pytest.mark.parametrize(
    ("function", "names"),
    [
        (push, ["friction"]),
        (push, ["push_y", "friction"]),
        (anything, ["a", "b.c"]),
        (drawn, ["friction"]),
        (drawn, ["friction", "rng"]),
        (partial(push, 0.5), ["push_y"]),
        (partial(push, friction=0.5), ["push_y"]),
        (partial(push, friction=0.5), ["push_y", "friction"]),
        (Model(0.5), ["push_y"]),
        (Model(0.5).run, ["push_y"]),
        (Model, ["friction"]),
        (lambda a: a, ["a"]),
        (dict, ["a"]),  # a builtin without a signature
    ],
)
def test_what_can_be_called_is_taken(function: Callable[..., Any], names: list[str]) -> None:
    """Functions, partials, objects, methods, classes, builtins."""
    check_call(function, names)


@pytest.mark.parametrize(
    ("function", "names", "told"),
    [
        (push, ["fricton"], "push has no parameter 'fricton', which the samples give; nearest: 'friction'"),
        (push, ["push_y"], r"push needs friction, which the samples do not give; .*rbd\.grid\(friction=\.\.\.\)"),
        (partial(push, 0.5), ["friction"], "push has no parameter 'friction'"),
        (Model(0.5), ["push_x"], "Model has no parameter 'push_x'.*nearest: 'push_y'"),
        (Model(0.5).run, ["margin"], r"Model\.run needs push_y"),
        (lambda: 0.0, ["a"], "it has none"),
        (by_place, ["friction"], "takes 'friction' by position only.*Remove the '/'"),
        (by_place, ["push_y"], "needs friction"),
        (push, ["friction", "ok"], "has the name 'ok', which every dataset"),
        (anything, ["reason"], "'reason'"),
        (later, ["friction"], "async"),
        (each, ["friction"], "generator"),
        (partial(push, robot="solo12"), ["friction"], "push cannot be called with .*partial gives it: .*robot='solo12'"),
        ("push", ["friction"], "function is 'push'; expected a function"),
        (None, ["friction"], "function is None"),
    ],
)
def test_what_cannot_be_called_is_refused(function: Any, names: list[str], told: str) -> None:
    """With the nearest names, and what to do."""
    with pytest.raises(InputError, match=told):
        check_call(function, names)


def test_who_draws_is_known() -> None:
    """By a parameter of this name, which is not given already and can be given by name."""
    assert takes_rng(drawn) and takes_rng(drawn_or_not) and takes_rng(partial(drawn, friction=0.5))
    assert not takes_rng(push) and not takes_rng(anything) and not takes_rng(dict)
    assert not takes_rng(partial(drawn, rng=None)) and not takes_rng(partial(partial(drawn, rng=None), friction=1.0))
    assert not takes_rng(lambda rng, /: rng)


def test_what_is_fixed_is_bound_once() -> None:
    """A function of what varies is left; without anything fixed it is the function itself."""
    assert bound(push, rbd.grid(friction=[0.5])) is push and bound(push, rbd.grid(friction=0.5)) is push
    left = bound(push, rbd.grid(friction=0.5, push_y=[1.0, 2.0]))
    assert left(push_y=2.0) == 1.0
    samples = rbd.grid(friction=[0.5, 1.0], rng=3)
    assert not takes_rng(bound(drawn, samples))
    with pytest.raises(InputError, match="no parameter 'push_x'"):
        bound(push, rbd.grid(friction=[0.5], push_x=1.0))
