"""How many links a chain has, and how long they are: what counts as such."""

from __future__ import annotations

import numpy as np
import sympy
from sympy.core.function import AppliedUndef
from sympy.physics.mechanics import dynamicsymbols

from rbd.arrays import a_number
from rbd.errors import InputError

MOST_LINKS = 50
"""A chain of more links is a rope; its expressions fill pages."""
SHORTEST, LONGEST = 1e-30, 1e30
"""Lengths whose fourth powers, as in det(J J^T), are still floats [m]."""


def check_count(n: object) -> int:
    """A whole number of links.

    Raises:
        InputError: on anything else, as 0, 2.5, True or 51.
    """
    whole = isinstance(n, int | np.integer | sympy.Integer) and not isinstance(n, bool)
    if not whole or not 1 <= int(n) <= MOST_LINKS:  # type: ignore[call-overload]
        raise InputError(f"n is {n!r:.80}; expected a whole number of links, 1 to {MOST_LINKS}, as Chain(2).")
    return int(n)  # type: ignore[call-overload]


def check_lengths(n: int, lengths: object) -> tuple[sympy.Expr, ...]:
    """The lengths of n links as expressions: symbols ell_1..ell_n of None, decimals as exact fractions.

    Raises:
        InputError: on another count, or a length that is not positive, finite and constant.
    """
    if lengths is None:
        return tuple(sympy.Symbol(f"ell_{k + 1}", positive=True) for k in range(n))
    listed = isinstance(lengths, list | tuple | sympy.MatrixBase | sympy.Tuple)
    listed = listed or isinstance(lengths, np.ndarray) and lengths.ndim > 0
    given = list(lengths) if listed else None  # type: ignore[call-overload]
    if given is None or len(given) != n:
        came = f"{len(given)} of them" if given is not None else f"{lengths!r:.80}"
        raise InputError(f"lengths came as {came}; expected {n}, one per link, as lengths=[0.5] * {n}.")
    return tuple(_check_length(k, length) for k, length in enumerate(given))


def _check_length(k: int, length: object) -> sympy.Expr:
    """A positive number, kept exactly as it is written; or an expression that is not known to be anything else."""
    what = f"the length of link {k + 1}"
    if isinstance(length, sympy.Expr) and not length.is_number:
        moving = length.has(dynamicsymbols._t) or length.has(AppliedUndef)
        if moving or length.is_positive is False or length.is_real is False:
            raise InputError(f"{what} is {str(length):.80}; expected a positive expression that is constant in time.")
        return length
    exact = isinstance(length, sympy.Expr) and not length.has(sympy.Float)
    try:
        number = float(length) if isinstance(length, sympy.Expr) else a_number(length)
    except (TypeError, ValueError, OverflowError):  # complex, or a zoo
        number = np.nan
    if not SHORTEST <= number <= LONGEST:
        raise InputError(
            f"{what} is {str(length):.80}; expected a positive finite number [m], {SHORTEST:g} to {LONGEST:g}, or a symbol."
        )
    # repr, not the float itself: 0.1 shall be 1/10, so that identities hold exactly.
    return length if exact else sympy.Rational(repr(number))
