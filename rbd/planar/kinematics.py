"""Kinematics in symbols: position to jerk of the joints of a row of links, Jacobians, the acceleration in three parts.

All quantities are sums over segments, r = sum_k ell_k (cos psi_k, sin psi_k), so one segment is differentiated and the others
are analogous: a term does not grow with the number of links, and every power of a rate multiplies one bracket,

    a = -sum_k ell_k [ psi_k'' (sin, -cos)(psi_k) + psi_k'^2 (cos, sin)(psi_k) ].

The acceleration in the text's three parts: the chain rule gives a = J qdd + sum_ij r_ij qd_i qd_j, where r_ij is the second
derivative of r:

- tangential: J qdd, the terms in qdd_i;
- centripetal: sum_i r_ii qd_i^2. In joint angles r_ii = -(P - joint i - 1), so each term points from P to the joint that turns;
- Coriolis: 2 sum_{i<j} r_ij qd_i qd_j. In joint angles r_ij = -(P - joint j - 1), the later joint of the two.

The parts depend on how angles are measured, their sum does not. In segment angles, and from the vertical, every link's
direction depends only on its angle: r_ij = 0 for i != j, and there is no Coriolis part; what it was in joint angles
is then in the centripetal one, (th1' + th2')^2 being the square of one segment's rate.

Source: [Duarte2021], "Differential kinematics", and two links after "Linear acceleration"; here for n. Its printed acceleration
of two links reads th1' + th2'^2 where the square of the sum, (th1' + th2')^2, belongs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Generic, TypeVar

import numpy as np
import sympy

from rbd.arrays import Array, as_array, as_finite, max_abs
from rbd.constraints.function import NODES, ROUGH, STEPS, differences
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.planar import expressions
from rbd.planar.angles import JOINT, Symbols

EXAMPLE = "jacobian([x**2 * y, 5*x + sympy.sin(y)], [x, y])"
Value = TypeVar("Value", Symbols, Array)


def check_joint(n: int, i: object, *, first: int = 0) -> int:
    """A joint's number of n links: 0 is the base, n the end point, which None is too.

    Raises:
        InputError: if it is none of first..n.
    """
    if i is None:
        return n
    whole = isinstance(i, int | np.integer | sympy.Integer) and not isinstance(i, bool)
    if not whole or not first <= int(i) <= n:  # type: ignore[call-overload]
        base = " (0 is the base)" if first == 0 else ""
        raise InputError(f"there is no joint {i!r:.80}; expected {first} to {n}{base}, or None for the end point.")
    return int(i)  # type: ignore[call-overload]


@dataclass(frozen=True, eq=False)
class Split(Generic[Value], Displayed):
    """An acceleration in three parts: tangential, centripetal, Coriolis [m/s^2]; shape (2, 1), (2,) or (samples, 2).

    Attributes:
        tangential: Terms in the angular accelerations.
        centripetal: Terms in the square of one angular velocity.
        coriolis: Terms in the product of two; zero in segment angles and from the vertical, and of a single link.
        angles: The convention that the parts belong to.

    Example:
        >>> parts = rbd.planar.Chain(2, lengths=[1, 1]).split()
        >>> parts.coriolis[0]
        -2*cos(theta_1(t) + theta_2(t))*Derivative(theta_1(t), t)*Derivative(theta_2(t), t)
    """

    tangential: Value
    centripetal: Value
    coriolis: Value
    angles: str

    @property
    def total(self) -> Value:
        """The acceleration itself, the sum of the parts."""
        return self.tangential + self.centripetal + self.coriolis

    @property
    def note(self) -> str:
        """Why there is a Coriolis part or not."""
        if self.angles == JOINT:
            return "In joint angles a link turns with every joint before it: products of two rates remain, the Coriolis part."
        return (
            f"In {self.angles} angles every link turns by its own angle alone: no product of two rates occurs, so there is no "
            "Coriolis part."
        )

    def _repr_latex_(self) -> str:
        """The three parts below each other, for notebooks."""
        return expressions.in_dollars(expressions.latex(self))


@lru_cache(maxsize=8)
def unit_rate(order: int, turned: bool) -> tuple[Symbols, tuple[sympy.Expr, ...]]:
    """Derivative of the unit vector of a segment, or of that vector turned by 90 degrees, in symbols to be replaced.

    (cos, sin)(psi(t)) is differentiated `order` times and its rates collected as factors of the sine and the cosine.
    """
    t = sympy.Symbol("t")
    psi = sympy.Function("psi")(t)
    names = sympy.symbols("psi_0:4")
    vector = sympy.Matrix([-sympy.sin(psi), sympy.cos(psi)] if turned else [sympy.cos(psi), sympy.sin(psi)]).diff(t, order)
    flat = vector.xreplace({psi.diff(t, k): names[k] for k in range(3, 0, -1)}).xreplace({psi: names[0]})
    sides = [sympy.cos(names[0]), sympy.sin(names[0])]
    return flat.applyfunc(lambda x: sympy.collect(sympy.expand(x), sides)).as_immutable(), names


def total(vectors: list[Symbols]) -> Symbols:
    """Sum of vectors (2, 1), the zero vector if there are none: summed at once, as SymPy's `+` copies what it has."""
    return sympy.ImmutableMatrix([sympy.Add(*(vector[axis] for vector in vectors)) for axis in range(2)])


def jacobian(f: Any, x: Any) -> Symbols | Array:
    """All first partial derivatives of a vector function: J[i, j] = d f_i / d x_j, in symbols or in numbers, as x is.

    Of numbers, by central differences of sixth order: (f(x + h e) - f(x - h e)) / 2h with two further pairs of nodes. The step
    h starts at 0.01 max(1, |x_j|) and shrinks until fourth and sixth order agree. Of a smooth f the error is below 1e-10 of the
    largest entry of f and J; if the orders stay apart by more than 1e-6, as at a kink, f is refused.

    Args:
        f: One expression, a list, a row or column matrix of them; or a Python function that returns one of these, called with
            the variables one by one. With numbers as x: a function of one array (n,), that returns a number or m numbers.
        x: One variable, or several: symbols, functions of time (dynamicsymbols) or their derivatives. Time itself may be one.
            Or numbers, shape (n,): where the derivatives are taken.

    Returns:
        Shape (number of functions, number of variables), not simplified; an array of that shape where x is numbers.

    Raises:
        InputError: on invalid or repeated variables, on objects that are not expressions, or a function that fails, or that has
            no derivative where x is.

    Source: [Duarte2021], "Jacobian matrix" and problem 6.

    Example:
        >>> from sympy import sin
        >>> from sympy.abc import x, y
        >>> rbd.planar.jacobian([x**2 * y, 5 * x + sin(y)], [x, y])
        Matrix([
        [2*x*y,   x**2],
        [    5, cos(y)]])
        >>> rbd.planar.jacobian(lambda x: [x[0] ** 2 * x[1], 5 * x[0] + np.sin(x[1])], [2.0, 0.0]).round(9)
        array([[0., 4.],
               [5., 1.]])
    """
    function = isinstance(f, sympy.Lambda) or (callable(f) and not isinstance(f, sympy.Expr))
    if function and not isinstance(f, sympy.Lambda) and _numbers(x):
        return _by_differences(f, as_finite("x", x, ("n",), meaning=", one entry a variable"))
    variables = _variables(x)
    if function:
        f = _called(f, variables)
    return sympy.ImmutableMatrix([[row.diff(variable) for variable in variables] for row in _expressions(f)])


def _numbers(x: Any) -> bool:
    """Whether x is an array or a list of Python's or NumPy's numbers."""
    if isinstance(x, np.ndarray):
        return x.dtype.kind in "iuf" and x.size > 0
    return isinstance(x, list | tuple) and len(x) > 0 and all(isinstance(each, int | float | np.number) for each in x)


def _by_differences(f: Callable[[Array], Any], x: Array) -> Array:
    """J of a function of numbers, shape (m, n), by the differences that `FunctionConstraint` takes."""

    def value(at: Array, m: int | None = None) -> Array:
        try:
            out = f(at.copy())
        except Exception as error:
            raise InputError(
                f"the function failed at x = {np.array2string(at, threshold=6)}: {type(error).__name__}: {error!s:.120}. "
                "Expected a function of one array; of one that takes numbers one by one, give lambda x: f(*x)."
            ) from error
        out = np.atleast_1d(as_array("the function's value", out))
        if out.ndim != 1 or not len(out) or (m is not None and len(out) != m):
            raise InputError(
                f"the function's value has shape {out.shape}; expected {'a number, or (m,)' if m is None else (m,)}."
            )
        return out

    middle = value(x)
    if not np.isfinite(middle).all():
        raise InputError(f"the function is {np.array2string(middle, threshold=6)} at x; expected finite numbers.")
    n, m, units = len(x), len(middle), np.maximum(1.0, np.abs(x))

    def moved(left: Array, steps: slice) -> Array:
        ways = np.eye(n)[left, None] * units * STEPS[steps] * np.array(NODES)[:, None]
        return np.array([[value(x + way, m) for way in each] for each in ways])[:, None]

    found, _ = differences(moved, middle, n, n)
    apart = found[:, m] / np.maximum(found[:, m + 1], max_abs(found[:, :m].ravel()))
    if not apart.max() <= ROUGH:
        raise InputError(
            f"the function has no derivative by x[{int(apart.argmax())}] that differences can find (two orders are apart by "
            f"{min(apart.max(), 1.0):.1g}, expected {ROUGH:g}): a kink, a jump, noise, or the end of where it is defined?"
        )
    return np.asarray((found[:, :m] / units[:, None]).T)


def _variables(x: Any) -> list[sympy.Expr]:
    given = _listed("x", x)
    for k, variable in enumerate(given):
        if not isinstance(variable, sympy.Expr) or not variable._diff_wrt:
            raise InputError(
                f"variable {k + 1} is {variable!r:.80}; expected a symbol, or a function of time or its derivative: {EXAMPLE}."
            )
        if variable in given[:k]:
            raise InputError(f"the variable {variable} comes twice in {given!r:.120}; expected each once.")
    return given


def _called(f: Callable[..., Any], variables: list[sympy.Expr]) -> Any:
    try:
        return f(*variables)
    except Exception as error:
        raise InputError(
            f"the function failed on the symbols {', '.join(map(str, variables))}: {type(error).__name__}: {error!s:.120}. "
            f"Expected one argument per variable, and SymPy's functions in it (sympy.sin, not math.sin or numpy.sin); or give "
            "numbers for x."
        ) from error


def _expressions(f: Any) -> list[sympy.Expr]:
    out = []
    for k, entry in enumerate(_listed("f", f)):
        expression = expressions.as_expression(entry)
        if expression is None:
            raise InputError(f"function {k + 1} is {entry!r:.80}; expected a SymPy expression, as in {EXAMPLE}.")
        if expression.has(sympy.nan, sympy.zoo, sympy.oo, -sympy.oo):
            raise InputError(f"function {k + 1} is {entry!r:.80}, which is not finite.")
        out.append(expression)
    return out


def _listed(what: str, value: Any) -> list[Any]:
    """One item, or several in order."""
    if isinstance(value, sympy.MatrixBase):
        if 1 not in value.shape:
            raise InputError(f"{what} is a matrix of shape {value.shape}; expected a row, a column, or a list.")
        return list(value)
    if isinstance(value, str | bytes | dict | set | frozenset) or value is None:
        raise InputError(f"{what} is {value!r:.80}; expected a list, whose order says which row or column is which: {EXAMPLE}.")
    if getattr(value, "ndim", 1) != 1:  # an array of NumPy's; a number of SymPy's has none
        raise InputError(f"{what} has {value.ndim} axes; expected a row, a column, or a list.")
    several = isinstance(value, Iterable) and not isinstance(value, sympy.Expr)
    out = list(value) if several else [value]
    if not out:
        raise InputError(f"{what} is empty; expected at least one {'variable' if what == 'x' else 'expression'}: {EXAMPLE}.")
    return out
