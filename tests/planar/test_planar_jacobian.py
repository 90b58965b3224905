"""The Jacobian of any symbolic function."""

from __future__ import annotations

import math

import numpy as np
import pytest
import sympy
from sympy.abc import x, y

from rbd.errors import InputError
from rbd.planar import Chain, jacobian

EXPECTED = sympy.Matrix([[2 * x * y, x**2], [5, sympy.cos(y)]])


@pytest.mark.parametrize(
    "f",
    [
        [x**2 * y, 5 * x + sympy.sin(y)],
        sympy.Matrix([x**2 * y, 5 * x + sympy.sin(y)]),
        sympy.Matrix([[x**2 * y, 5 * x + sympy.sin(y)]]),
        lambda x, y: (x**2 * y, 5 * x + sympy.sin(y)),
    ],
)
def test_problem_6(f):
    """(x^2 y, 5 x + sin y) has [[2 x y, x^2], [5, cos y]], however it is given."""
    assert jacobian(f, [x, y]) == EXPECTED
    assert jacobian(f, sympy.Matrix([x, y])) == EXPECTED


@pytest.mark.parametrize(("dimension", "freedom"), [(2, 3), (3, 6)], ids=["plane", "space"])
@pytest.mark.parametrize("points", [3, 4, 5])
def test_fixed_distances_leave_a_body_three_or_six_degrees_of_freedom(dimension, freedom, points):
    """Coordinates less the rank of the Jacobian of all squared distances: 2 n - (2 n - 3), 3 n - (3 n - 6)."""
    x = sympy.Matrix(points, dimension, sympy.symbols(f"x:{points * dimension}"))
    pairs = [(i, j) for i in range(points) for j in range(i)]
    J = jacobian([(x[i, :] - x[j, :]).dot(x[i, :] - x[j, :]) for i, j in pairs], list(x))
    place = np.random.default_rng(0).integers(-9, 9, len(x))
    assert len(x) - J.subs(dict(zip(x, map(int, place), strict=True))).rank() == freedom


def test_one_function_one_variable():
    """Scalars are vectors of one; numbers have no slope; Lambda is a function."""
    assert jacobian(x**2, x) == sympy.Matrix([[2 * x]]) and jacobian(3, [x, y]) == sympy.zeros(1, 2)
    assert jacobian(sympy.Lambda((x, y), x * y), (x, y)) == sympy.Matrix([[y, x]])


def test_angles_and_their_rates_are_variables():
    """A chain's own Jacobian, and v = J q' by the rates."""
    chain = Chain(3)
    assert jacobian(chain.position(), chain.q).equals(chain.jacobian())
    assert jacobian(chain.velocity(), chain.qd).applyfunc(sympy.expand) == chain.jacobian().applyfunc(sympy.expand)


@pytest.mark.parametrize(
    ("f", "variables", "message"),
    [
        ([x], [x, x], "comes twice"),
        ([x], [x**2], "variable 1"),
        ([x], [], "empty"),
        ([], [x], "empty"),
        ([x], "x", "list"),
        ([x], None, "list"),
        ([x], 3, "variable 1"),
        ("x**2", x, "list"),
        (["x**2"], x, "function 1"),
        ([x > 1], x, "function 1"),
        ([True], x, "function 1"),
        ([sympy.oo], x, "not finite"),
        ([float("nan")], x, "not finite"),
        (sympy.eye(2), x, "shape"),
        ({x, y}, x, "order"),
        (lambda x: math.sin(x), [x], "sympy.sin"),
        (lambda x, y: x, [x], "one argument per variable"),
    ],
)
def test_bad_input(f, variables, message):
    """What came is named."""
    with pytest.raises(InputError, match=message):
        jacobian(f, variables)
