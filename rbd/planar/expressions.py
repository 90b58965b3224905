r"""Output of a chain's expressions: LaTeX with Newton's dots, and fast NumPy functions.

SymPy's own printer writes d/dt theta_1(t); mechanics writes \dot{\theta}_1, and leaves the time out. In functions common
subexpressions are computed once, so that a sine occurs once however often it is printed; samples are taken in blocks that
stay in the cache, which halves the time of 100,000 of them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
import sympy
from sympy.core.function import AppliedUndef
from sympy.physics.vector.printing import vlatex
from sympy.printing.numpy import NumPyPrinter

from rbd.arrays import Array, as_float
from rbd.errors import InputError
from rbd.errors.inputs import check_kind
from rbd.planar.angles import Symbols, samples

PARTS = ("tangential", "centripetal", "coriolis")
BLOCK = 4096
"""Samples per block: a dozen temporaries of them fit into 512 kB."""
CUBE, FOURTH = 3, 4
RATES = ("q", "qd", "qdd", "qddd")


def latex(expr: Any) -> str:
    r"""LaTeX of an expression, without dollars: \ell_{1} \cos{\left(\theta_{1} \right)}, \dot{\theta}_{1}, \ddot{\theta}_{1}.

    Args:
        expr: A SymPy expression, matrix, array or equation; a `Split` of symbols, which gives three aligned lines; or several
            of these in a list or tuple, separated by semicolons.

    Raises:
        InputError: on other input.
    """
    if all(hasattr(expr, part) for part in PARTS):
        lines = [rf"\text{{{part.capitalize()}:}}\quad & {latex(getattr(expr, part))}" for part in PARTS]
        return r"\begin{aligned}" + r" \\ ".join(lines) + r"\end{aligned}"
    if isinstance(expr, list | tuple) and expr:
        return r";\quad ".join(latex(each) for each in expr)
    if isinstance(expr, sympy.Basic | sympy.MatrixBase | int | float) and not isinstance(expr, bool):
        return vlatex(expr)
    raise InputError(f"{expr!r:.80} has no LaTeX; expected a SymPy expression, matrix or equation, as chain.velocity().")


def in_dollars(text: str) -> str:
    """LaTeX as notebooks expect it."""
    return rf"$\displaystyle {text}$"


@dataclass(frozen=True, eq=False)
class Formula:
    """An expression that a notebook typesets, and `str` writes as LaTeX.

    Raises:
        InputError: on what has no LaTeX.
    """

    expr: Any

    def __post_init__(self) -> None:
        """Refuse expressions that could not be displayed."""
        latex(self.expr)

    def __str__(self) -> str:
        return latex(self.expr)

    def _repr_latex_(self) -> str:
        return in_dollars(latex(self.expr))


@dataclass(frozen=True, eq=False)
class Compiled:
    """A numeric function of (q, qd, qdd, qddd); see `Chain.function`.

    Attributes:
        n: Number of angles.
        shape: Shape of one sample's value; () is a number.
        needs: How many of the four arguments occur in the expression, 0 to 4.
    """

    n: int
    shape: tuple[int, ...]
    needs: int
    _entries: Any = field(repr=False)
    _asked: tuple[Any, ...] = field(repr=False)

    def __reduce__(self) -> tuple[object, ...]:
        """A copy, in another process too, is compiled again."""
        return compile_expression, self._asked

    def __call__(self, q: Any, qd: Any = None, qdd: Any = None, qddd: Any = None) -> Array:
        """The value at one sample or at many.

        Args:
            q: Angles, shape (n,) or (samples, n) [rad].
            qd: Angular velocities, the same shape [rad/s]; like the next two, it may be left out where it does not occur.
            qdd: Angular accelerations, the same shape [rad/s^2].
            qddd: Angular jerks, the same shape [rad/s^3].

        Returns:
            Shape `shape`, or (samples, *shape).

        Raises:
            InputError: on missing arguments, other shapes or numbers that are not finite; or where the value is not.
        """
        given = check_motion(self.n, (q, qd, qdd, qddd), max(self.needs, 1))
        rows = given[0].reshape(-1, self.n).shape[0]
        flat = np.empty((rows, math.prod(self.shape)))
        with np.errstate(all="ignore"):
            for start in range(0, rows, BLOCK):
                block = slice(start, start + BLOCK)
                columns = [np.ascontiguousarray(x.reshape(-1, self.n)[block].T) for x in given[: self.needs]]
                for k, entry in enumerate(self._evaluated(columns)):
                    flat[block, k] = entry
        if not np.isfinite(flat).all():
            at = int(np.argwhere(~np.isfinite(flat))[0, 0])
            raise InputError(f"the expression has no finite value at sample {at}: it divides by zero, or takes a root of less.")
        return flat.reshape(given[0].shape[:-1] + self.shape)

    def _evaluated(self, columns: list[Array]) -> list[Any]:
        """The entries over one block.

        Raises:
            InputError: on functions that NumPy has not, and on complex values.
        """
        try:
            entries = self._entries(*(row for x in columns for row in x))
        except (NameError, TypeError, ValueError, AttributeError, ArithmeticError) as error:
            raise InputError(f"the expression cannot be computed in NumPy: {error}. Only elementary functions can.") from None
        if any(np.iscomplexobj(entry) for entry in entries):
            raise InputError("the expression has complex values; expected real ones.")
        return list(entries)


class _Printer(NumPyPrinter):
    """NumPy's code, with cubes and fourth powers as products: its x**3 takes fifty times as long as x * x * x."""

    def _print_Pow(self, expr: sympy.Pow, **settings: Any) -> str:
        if expr.exp not in (CUBE, FOURTH):
            return super()._print_Pow(expr, **settings)
        product = "b * b * b" if expr.exp == CUBE else "(b * b) * (b * b)"
        return f"(lambda b: {product})({self._print(expr.base)})"


def check_motion(n: int, given: tuple[Any, ...], needs: int) -> list[Array]:
    """The first `needs` of q, qd, qdd, qddd as finite arrays of one shape, (n,) or (samples, n).

    Raises:
        InputError: if one is missing, or another shape, or not finite.
    """
    out: list[Array] = []
    for name, value in zip(RATES[:needs], given, strict=False):
        if value is None:
            raise InputError(f"{name} is missing; expected {', '.join(RATES[:needs])}, each of shape ({n},) or (samples, {n}).")
        out.append(samples(name, value, n))
        if out[-1].shape != out[0].shape:
            raise InputError(f"{name} has shape {out[-1].shape}, q has {out[0].shape}; expected the same.")
    return out


def compile_expression(motion: tuple[Symbols, ...], expr: Any, parameters: Mapping[Any, float]) -> Compiled:
    """A function of (q, qd, qdd, qddd) that computes an expression; see `Chain.function`.

    Args:
        motion: q, qd, qdd, qddd in symbols, shape (n, 1) each.
        expr: The expression.
        parameters: {symbol or its name: number} for all other symbols.

    Raises:
        InputError: if it is no expression, or symbols are left without a number.
    """
    shape, entries = _entries(expr)
    n = motion[0].rows
    dummies = [sympy.symbols(f"{name}_1:{n + 1}", cls=sympy.Dummy) for name in RATES]
    # One exact replacement from the outside in: a derivative is replaced before the angle inside it is seen.
    known = {old: new for olds, news in zip(motion, dummies, strict=True) for old, new in zip(olds, news, strict=True)}
    plain = [entry.xreplace(known) for entry in entries]
    used = set().union(*(entry.free_symbols for entry in plain))
    numbers = _numbers(used.difference(*dummies), parameters)
    unknown = used.difference(*dummies, numbers).union(*(entry.atoms(AppliedUndef, sympy.Derivative) for entry in plain))
    if unknown:
        names = ", ".join(sorted(str(symbol) for symbol in unknown)[:6])
        raise InputError(
            f"no numbers are known for {names:.200}; give them as parameters={{symbol: number}}, or lengths to the chain "
            "(chain.with_lengths). Only its own angles and their first three derivatives may vary."
        )
    needs = max((k + 1 for k, row in enumerate(dummies) if used & set(row)), default=0)
    arguments = [*numbers, *(symbol for row in dummies[:needs] for symbol in row)]
    try:
        compute = sympy.lambdify(arguments, plain, "numpy", cse=True, printer=_Printer)
    except (NotImplementedError, TypeError, ValueError, SyntaxError, KeyError) as error:
        raise InputError(f"the expression cannot be computed in NumPy: {str(error).splitlines()[0]:.200}") from None
    return Compiled(n, shape, needs, partial(compute, *numbers.values()), (motion, expr, numbers))


def _entries(expr: Any) -> tuple[tuple[int, ...], list[sympy.Expr]]:
    """Shape of a sample, and the entries in row order."""
    if isinstance(expr, sympy.MatrixBase):
        shape = (expr.rows,) if expr.cols == 1 else expr.shape
        return shape, [sympy.sympify(entry) for entry in expr]
    if isinstance(expr, sympy.NDimArray):
        return tuple(expr.shape), list(sympy.flatten(expr.tolist())) if expr.shape else [expr[()]]
    if isinstance(expr, sympy.Expr):
        return (), [expr]
    number = as_float(expr)
    if not math.isfinite(number):
        raise InputError(f"{expr!r:.80} is no expression; expected SymPy's, or a matrix of them, as chain.acceleration().")
    return (), [sympy.Float(number)]


def _numbers(free: set[sympy.Symbol], parameters: Mapping[Any, float]) -> dict[sympy.Symbol, float]:
    """{symbol: number} of what was given by symbol or by name; symbols not in the expression are ignored.

    Raises:
        InputError: on keys that are no symbols, or values that are not finite real numbers.
    """
    check_kind("parameters", parameters, Mapping, "{symbol: number}")
    out = {}
    for key, value in parameters.items():
        check_kind("the symbol of a parameter", key, str | sympy.Symbol, "a symbol, or its name")
        exact = isinstance(value, sympy.Expr) and value.is_number and value.is_real
        number = float(value) if exact else as_float(value)
        if not math.isfinite(number):
            raise InputError(f"parameter {key} is {value!r:.80}; expected a finite number.")
        out.update({symbol: number for symbol in free if str(symbol) == str(key)})
    return out


def as_expression(value: Any) -> sympy.Expr | None:
    """A number or an expression, for SymPy; None for other input, as text or a truth value."""
    try:
        out = None if isinstance(value, bool | str) else sympy.sympify(value, strict=True)
    except (sympy.SympifyError, TypeError, ValueError, AttributeError):
        return None
    return out if isinstance(out, sympy.Expr) else None


def real(value: Any) -> float:
    """A number, of SymPy too, as a float; NaN if it is not one, such as a complex number or an interval."""
    try:
        return float(value) if isinstance(value, sympy.Expr) else as_float(value)
    except (TypeError, ValueError, OverflowError):
        return math.nan


def exact(value: Any) -> sympy.Expr | None:
    """A number as written, 0.1 as 1/10, so that identities hold exactly; None if it is not finite."""
    if isinstance(value, int) and not isinstance(value, bool):
        return sympy.Integer(value)
    number = as_float(value)
    return sympy.Rational(repr(number)) if math.isfinite(number) else None


def coordinate(name: str, value: Any) -> sympy.Expr:
    """A real expression; None gives a symbol of that name.

    Raises:
        InputError: if it is none.
    """
    if value is None:
        return sympy.Symbol(name, real=True)
    given = as_expression(value)
    if given is None or given.is_finite is False or given.is_real is False or given is sympy.nan:
        raise InputError(
            f"{name} is {value!r:.80}; expected a real number or expression [m], as sympy.Symbol('{name}', real=True)."
        )
    return given
