"""The Jacobian of any function, in symbols and in numbers."""

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


def test_numeric_functions_have_the_derivatives_of_their_symbols():
    """The end of three links in Python's numbers against the symbols, far from zero too; a number counts as one row.

    The bound is what the docstring promises: 1e-10 of the largest of f and J.
    """
    chain, rng = Chain(3, lengths=(0.5, 0.4, 0.3)), np.random.default_rng(0)
    for size in (1.0, 100.0):
        q = size * rng.normal(size=3)
        found = jacobian(chain.numeric.position, q)
        assert found.shape == (2, 3) and np.abs(found - chain.numeric.jacobian(q)).max() < 1e-10 * max(1.0, size)
    steep = jacobian(lambda x: math.exp(3.0 * x[0]) * x[1] ** 5, [2, 3])
    assert steep == pytest.approx(math.exp(6.0) * np.array([[3.0 * 3**5, 5.0 * 3**4]]), rel=1e-10)
    assert jacobian(lambda x: [x[0] ** 3, 1.0], np.array([1e6])) == pytest.approx(np.array([[3e12], [0.0]]), rel=1e-10)


@pytest.mark.parametrize(
    ("f", "x", "message"),
    [
        (lambda x: abs(x[0] - 1.0), [1.0], r"no derivative by x\[0\]"),
        (lambda x: [x[0], np.sqrt(x[1])], [1.0, 0.0], r"no derivative by x\[1\]"),
        (lambda x, y: x * y, [1.0, 2.0], r"lambda x: f\(\*x\)"),
        (lambda x: np.eye(2), [1.0], "has shape"),
        (lambda x: 1j * x, [1.0], "real numbers"),
        (lambda x: x / 0.0 if x[0] == 1.0 else x, np.array([1.0]), "finite numbers"),
        (lambda x: x, [float("nan")], "not finite"),
        (lambda x: x, np.eye(2), "shape"),
    ],
)
@pytest.mark.filterwarnings("ignore:(divide|invalid)")
def test_numeric_functions_without_a_derivative_are_refused(f, x, message):
    """What came is named, with the way out."""
    with pytest.raises(InputError, match=message):
        jacobian(f, x)


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
