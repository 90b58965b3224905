"""One tree of errors, each with words that help."""

from __future__ import annotations

import inspect
import pickle
import re

import numpy as np
import pytest

import rbd
from rbd import errors, testing
from rbd.errors import InputError, NoSolution, RbdError, RbdWarning, nearest
from rbd.errors.inputs import check_known

CLASSES = [
    c
    for room in (errors, testing.solver_check)
    for _, c in inspect.getmembers(room, inspect.isclass)
    if c.__module__ == room.__name__ and issubclass(c, Exception)
]


def drawn() -> dict[str, str | None]:
    """{name: its parent's name} as the docstring's picture of the tree has it, by indentation."""
    out: dict[str, str | None] = {}
    above: list[tuple[int, str]] = []
    for line in (errors.__doc__ or "").splitlines():
        first_column = re.split(r"\s{3,}", re.sub(r"\(.*?\)", "", line.strip()))[0]
        names = re.findall(r"\b(?:[A-Z][a-z]+){2,}\b|\bUnsupported\b", first_column)
        if not names:
            continue
        indent = len(line) - len(line.lstrip())
        while above and above[-1][0] >= indent:
            above.pop()
        out.update(dict.fromkeys(names, above[-1][1] if above else None))
        above.append((indent, names[0]))
    return out


def test_the_tree_is_as_it_is_drawn() -> None:
    """Every class of rbd.errors and of rbd.testing stands in the picture, below its parent, and nothing else does."""
    tree = drawn()
    assert set(tree) == {c.__name__ for c in CLASSES}
    for c in CLASSES:
        parent = tree[c.__name__]
        assert parent is None or c.__bases__[0].__name__ == parent


@pytest.mark.parametrize("kind", CLASSES)
def test_everything_descends_from_one_root(kind: type) -> None:
    """`except RbdError` catches all errors; `RbdWarning` filters all warnings; each has a docstring."""
    assert issubclass(kind, RbdWarning if issubclass(kind, Warning) else RbdError)
    assert kind.__doc__


def test_what_is_wrong_with_an_argument_is_a_value_error() -> None:
    """InputError is a ValueError too, as NumPy's users expect."""
    assert issubclass(InputError, ValueError)
    assert issubclass(RbdWarning, UserWarning)


@pytest.mark.parametrize("kind", [c for c in CLASSES if c.__module__ == "rbd.errors"])
def test_errors_cross_processes(kind: type) -> None:
    """They pickle, message and all: a worker's error reaches whoever asked."""
    error = pickle.loads(pickle.dumps(kind("what came, what was expected, what to try")))
    assert type(error) is kind and str(error) == "what came, what was expected, what to try"


def test_no_solution_carries_problem_and_result() -> None:
    """Both by name; None where there is none."""
    error = NoSolution("none", problem="p", result="r")  # type: ignore[arg-type]
    assert (error.problem, error.result) == ("p", "r")
    assert (NoSolution("none").problem, NoSolution("none").result) == (None, None)


@pytest.mark.parametrize("name", ["RbdError", "InputError", "NoSolution", "CannotHold"])
def test_common_errors_are_at_the_top(name: str) -> None:
    """What a script is likely to catch is in `rbd` itself."""
    assert getattr(rbd, name) is getattr(errors, name)


@pytest.mark.parametrize(
    ("name", "names", "said"),
    [
        ("left_sol", ["left_sole", "right_sole", "torso"], "nearest: 'left_sole'"),
        ("sole", ["left_sole_link", "right_sole_link", "torso"], "'left_sole_link', 'right_sole_link'"),
        ("SOLE_LINK", ["left_sole_link", "torso"], "nearest: 'left_sole_link'"),
        ("xyzzy", ["a", "b"], "there are 'a', 'b'"),
        ("xyzzy", list("abcdefghij"), "there are 'a', 'b', 'c', 'd', 'e', 'f', 'g', 'h', ..."),
        ("anything", [], "there are none"),
        ("", ["a"], "there are 'a'"),
        (None, ["a"], "there are 'a'"),
        (3.5, ["a"], "there are 'a'"),
    ],
)
def test_nearest_names(name: object, names: list[str], said: str) -> None:
    """Like ones by spelling, else by a common part, else the first few of what there is; for any object as a name."""
    assert said in nearest(name, names)


def test_nearest_names_are_few() -> None:
    """At most four are offered, or as many as asked for."""
    names = [f"arm_left_{i}_joint" for i in range(9)]
    assert nearest("arm_left_joint", names).count("'") == 8
    assert nearest("arm_left_joint", names, count=2).count("'") == 4


@pytest.mark.parametrize("odd", [np.zeros(3), 3, None, ["a"], float("nan")], ids=str)
def test_a_name_of_another_kind_is_unknown(odd: object):
    """An array, a number or a list is refused by name, as a word that nothing has."""
    with pytest.raises(rbd.errors.UnknownName, match="no joint"):
        check_known("no joint", odd, ["a", "b"])
