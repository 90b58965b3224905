"""Relations between the angles of a chain, as they come: read and checked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import sympy
from sympy.core.function import AppliedUndef

from rbd.errors import InputError

if TYPE_CHECKING:
    from rbd.planar.chain import Chain


@dataclass(frozen=True)
class Relation:
    """One relation.

    Attributes:
        label: As it was given, for messages.
        expr: What is zero.
    """

    label: str
    expr: sympy.Expr


def read(chain: Chain, relation: Any) -> tuple[Relation, ...]:
    """Relations as they come: {angle or its number: value}, an equation, an expression that is zero, or a list of these.

    Raises:
        InputError: on anything else, saying what.
    """
    several = list(relation) if isinstance(relation, list | tuple | sympy.MatrixBase) else [relation]
    out: list[Relation] = []
    for one in several:
        if isinstance(one, Mapping):
            out += [_held(chain, key, value) for key, value in one.items()]
        else:
            out.append(_equation(chain, one))
    if not out:
        raise InputError(
            "no relation came; expected one, as {1: 0} for joint 1 held at 0 rad, or sympy.Eq(2*th1 + th2, sympy.pi)."
        )
    return tuple(out)


def _held(chain: Chain, key: Any, value: Any) -> Relation:
    names = ", ".join(str(angle) for angle in chain.q)
    if isinstance(key, int | np.integer | sympy.Integer) and not isinstance(key, bool):
        if not 1 <= int(key) <= chain.n:
            raise InputError(f"there is no joint {key} to be held; expected 1 to {chain.n} (1 is at the base), for {names}.")
        angle = chain.q[int(key) - 1]
    elif key in set(chain.q):
        angle = key
    else:
        raise InputError(f"{key!r:.80} is no angle of the chain; expected 1 to {chain.n}, or one of chain.q: {names}.")
    label = f"{angle} = {value}"
    return Relation(label, _checked(chain, label, angle - _expression(label, value)))


def _equation(chain: Chain, given: Any) -> Relation:
    label = f"{given.lhs} = {given.rhs}" if isinstance(given, sympy.Eq) else str(given)[:120]
    if given is True or given is sympy.true:
        raise InputError("a relation came as True: it holds always, and constrains nothing. Leave it out.")
    if given is False or given is sympy.false:
        raise InputError(
            "a relation came as False: an equation that cannot hold, or Python's == between expressions, which compares how "
            "they are written; expected sympy.Eq(left, right)."
        )
    if isinstance(given, sympy.Eq):
        return Relation(label, _checked(chain, label, _expression(label, given.lhs) - _expression(label, given.rhs)))
    if isinstance(given, int | float | str) or not isinstance(given, sympy.Expr):
        raise InputError(
            f"a relation came as {given!r:.80}; expected {{joint number: angle}}, sympy.Eq(left, right), an expression that is "
            f"zero, or a list of these."
        )
    return Relation(f"{label} = 0", _checked(chain, label, given))


def _expression(label: str, value: Any) -> sympy.Expr:
    try:
        out = None if isinstance(value, bool | str) else sympy.sympify(value, strict=True)
    except (sympy.SympifyError, TypeError, ValueError, AttributeError):
        out = None
    if not isinstance(out, sympy.Expr) or out.is_finite is False or out is sympy.nan or out.has(sympy.I):
        raise InputError(
            f"in the relation {label:.120} a side is {value!r:.80}; expected a finite real number or expression [rad]."
        )
    return sympy.nsimplify(out, rational=True) if out.is_Float else out


def _checked(chain: Chain, label: str, expr: sympy.Expr) -> sympy.Expr:
    """The expression, if it is one of this chain's angles and of constants."""
    names = ", ".join(str(angle) for angle in chain.q)
    if expr.has(sympy.nan, sympy.zoo, sympy.oo, -sympy.oo):
        raise InputError(f"the relation {label:.120} is not finite; expected real numbers and expressions.")
    if expr.atoms(sympy.Derivative):
        raise InputError(
            f"the relation {label:.120} has rates in it; expected one of angles alone. What constrains rates and cannot be "
            "integrated is nonholonomic: see rbd.constraints."
        )
    strangers = expr.atoms(AppliedUndef) - set(chain.q)
    if strangers or chain.t in expr.xreplace({angle: sympy.Dummy() for angle in chain.q}).free_symbols:
        who = ", ".join(sorted(str(s) for s in strangers)) or "t"
        raise InputError(
            f"the relation {label:.120} has {who} in it, which varies and is no angle of the chain; expected angles of "
            f"chain.q, {names}, and constants. A driven joint is a free one whose motion you give to `function`."
        )
    if not expr.has(*chain.q):
        if sympy.simplify(expr) == 0:
            raise InputError(f"the relation {label:.120} holds always, and constrains nothing. Leave it out.")
        raise InputError(f"the relation {label:.120} has no angle of the chain in it; expected some of chain.q: {names}.")
    return expr
