"""The Jacobian matrix of any symbolic vector function, not of chains alone."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import sympy

from rbd.errors import InputError
from rbd.planar.angles import Symbols

EXAMPLE = "jacobian([x**2 * y, 5*x + sympy.sin(y)], [x, y])"


def jacobian(f: Any, x: Any) -> Symbols:
    """All first partial derivatives of a vector function: J[i, j] = d f_i / d x_j.

    Args:
        f: One expression, a list, a row or column matrix of them; or a Python function that returns one of these, called with
            the variables one by one.
        x: One variable, or several: symbols, functions of time (dynamicsymbols) or their derivatives. Time itself may be one.

    Returns:
        Shape (number of functions, number of variables), nothing simplified.

    Raises:
        InputError: on variables that are none or come twice, on what is no expression, or a function that fails on symbols.

    Source: [Duarte2021], "Jacobian matrix" and problem 6.

    >>> from sympy.abc import x, y
    >>> jacobian([x**2 * y, 5 * x + sympy.sin(y)], [x, y])
    Matrix([
    [2*x*y,   x**2],
    [    5, cos(y)]])
    """
    variables = _variables(x)
    if isinstance(f, sympy.Lambda) or (callable(f) and not isinstance(f, sympy.Expr)):
        f = _called(f, variables)
    rows = _expressions(f)
    return sympy.ImmutableMatrix([[row.diff(variable) for variable in variables] for row in rows])


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
            f"Expected one argument per variable, and SymPy's functions in it (sympy.sin, not math.sin or numpy.sin)."
        ) from error


def _expressions(f: Any) -> list[sympy.Expr]:
    out = []
    for k, entry in enumerate(_listed("f", f)):
        try:
            expression = sympy.sympify(entry, strict=True)
        except (sympy.SympifyError, TypeError, ValueError, AttributeError):
            expression = None
        if isinstance(entry, bool) or not isinstance(expression, sympy.Expr):
            raise InputError(f"function {k + 1} is {entry!r:.80}; expected a SymPy expression, as in {EXAMPLE}.")
        if expression.has(sympy.nan, sympy.zoo, sympy.oo, -sympy.oo):
            raise InputError(f"function {k + 1} is {entry!r:.80}, which is not finite.")
        out.append(expression)
    return out


def _listed(what: str, value: Any) -> list[Any]:
    """One thing, or several in an order."""
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
