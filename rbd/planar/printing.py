r"""How a chain's expressions are written: LaTeX with Newton's dots, and a formula that a notebook typesets.

SymPy's own printer writes d/dt theta_1(t); mechanics writes \dot{\theta}_1, and leaves the time out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import sympy
from sympy.physics.vector.printing import vlatex

from rbd.errors import InputError

PARTS = ("tangential", "centripetal", "coriolis")


def latex(expr: Any) -> str:
    r"""LaTeX of an expression, without dollars: \ell_{1} \cos{\left(\theta_{1} \right)}, \dot{\theta}_{1}, \ddot{\theta}_{1}.

    Args:
        expr: A SymPy expression, matrix, array or equation; a `Split` of symbols, which gives three aligned lines; or several
            of these in a list or tuple, separated by semicolons.

    Raises:
        InputError: on anything else.
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
        """Refuse early what could not be shown later."""
        latex(self.expr)

    def __str__(self) -> str:
        return latex(self.expr)

    def _repr_latex_(self) -> str:
        return in_dollars(latex(self.expr))
