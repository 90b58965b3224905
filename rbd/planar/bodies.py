"""Masses, centres of mass and inertias of a planar chain's links: symbols, numbers, point masses or uniform rods."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import sympy as sp
from sympy.core.function import AppliedUndef

from rbd.arrays import Array
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.errors.inputs import check_kind
from rbd.planar.chain import Chain, check_chain
from rbd.planar.expressions import exact, real

Shapes = Literal["points", "rods"]
MOST = 1e12
"""Masses, lengths and inertias above this are refused as mistakes, as in URDF files."""


@dataclass(frozen=True)
class LinkBodies(Displayed):
    """Masses, centres of mass and inertias of a chain's links; one entry a link, from the base outward.

    Attributes:
        lengths: ell_i, from joint i to the next one [m].
        masses: m_i, above zero [kg].
        centres: d_i, from joint i to the centre of mass, along the link [m]; beyond its ends too, as a counterweight is.
        inertias: I_i about the centre of mass, across the plane, zero or more [kg m2].

    Example:
        >>> bodies = rbd.planar.dynamics(rbd.planar.Chain(2), bodies="rods").bodies
        >>> bodies.centres, bodies.inertias
        ((ell_1/2, ell_2/2), (ell_1**2*m_1/12, ell_2**2*m_2/12))
        >>> bodies.first_moments
        (ell_1*m_1/2 + ell_1*m_2, ell_2*m_2/2)
    """

    lengths: tuple[sp.Expr, ...]
    masses: tuple[sp.Expr, ...]
    centres: tuple[sp.Expr, ...]
    inertias: tuple[sp.Expr, ...]

    @property
    def beyond(self) -> tuple[sp.Expr, ...]:
        """Mass of all links beyond each link [kg]; zero for the last."""
        n = len(self.masses)
        return tuple(sp.Add(*self.masses[i + 1 :]) for i in range(n))

    @property
    def first_moments(self) -> tuple[sp.Expr, ...]:
        """nu_i = m_i d_i + ell_i (m_{i+1} + ... + m_n): mass moment of a link and those beyond it about its joint [kg m]."""
        every = zip(self.masses, self.centres, self.lengths, self.beyond, strict=True)
        return tuple(m * d + ell * more for m, d, ell, more in every)

    def coupling(self, i: int, j: int) -> sp.Expr:
        """mu_ij [kg m2], the only numbers in the kinetic energy: T = 1/2 sum_ij mu_ij cos(psi_i - psi_j) w_i w_j.

        mu_ii = I_i + m_i d_i^2 + ell_i^2 (m_{i+1} + ...), and mu_ij = ell_i nu_j for i < j. Links are counted from 0.
        """
        if i == j:
            m, d, ell = self.masses[i], self.centres[i], self.lengths[i]
            return self.inertias[i] + m * d**2 + ell**2 * self.beyond[i]
        return self.lengths[min(i, j)] * self.first_moments[max(i, j)]

    @property
    def unknowns(self) -> tuple[sp.Symbol, ...]:
        """Symbols that are no numbers yet, in the order of lengths, masses, centres, inertias."""
        return symbols_of((*self.lengths, *self.masses, *self.centres, *self.inertias))

    def subs(self, values: Mapping[Any, Any] | None) -> LinkBodies:
        """With numbers for symbols.

        Args:
            values: {symbol: number or expression}; None for none.

        Raises:
            InputError: keys that are no symbols of these bodies, values that no body has.
        """
        if values is None:
            return self
        known = replacements(values, self.unknowns, "these bodies")
        new = {what: [x.subs(known) for x in getattr(self, what)] for what in _NAMES}
        return LinkBodies(*(_checked(what, entries, len(entries)) for what, entries in new.items()))

    def numbers(self) -> tuple[Array, ...]:
        """(lengths, masses, centres, inertias) as arrays of floats, each (n,).

        Raises:
            InputError: naming the symbols that are left.
        """
        refuse_symbols(self.unknowns, "numbers()")
        return tuple(np.array([float(x) for x in getattr(self, what)]) for what in _NAMES)


def bodies_of(
    chain: Chain,
    *,
    bodies: Shapes | None = None,
    lengths: Iterable[Any] | None = None,
    masses: Iterable[Any] | None = None,
    centres: Iterable[Any] | None = None,
    inertias: Iterable[Any] | None = None,
) -> LinkBodies:
    """The bodies of a chain's links.

    Values not given are symbols: m_i, d_i and I_i, positive.

    Args:
        chain: The chain.
        bodies: "points": all mass at each link's end, d_i = ell_i and I_i = 0; "rods": thin and uniform, d_i = ell_i / 2 and
            I_i = m_i ell_i^2 / 12. None: from centres and inertias.
        lengths: In place of the chain's own [m].
        masses: m_i [kg], n numbers or expressions.
        centres: d_i [m].
        inertias: I_i about the centres of mass [kg m2].

    Raises:
        InputError: wrong counts, masses or lengths not above zero, inertias below it, numbers that are not finite, what
            depends on time; points or rods with separate centres or inertias.
    """
    n = check_chain(chain).n
    if bodies is not None and (not isinstance(bodies, str) or bodies not in ("points", "rods")):
        raise InputError(f"bodies is {bodies!r:.80}; expected 'points', 'rods', or None with centres and inertias.")
    if bodies is not None and (centres is not None or inertias is not None):
        raise InputError(f"bodies={bodies!r} says where centres of mass are and what inertias; leave centres and inertias out.")
    ell = _given("lengths", chain.lengths if lengths is None else lengths, n, None, chain.t)
    m = _given("masses", masses, n, "m", chain.t)
    if bodies == "points":
        return LinkBodies(ell, m, ell, (sp.Integer(0),) * n)
    if bodies == "rods":
        half = tuple(x / 2 for x in ell)
        return LinkBodies(ell, m, half, tuple(k * x**2 / 12 for k, x in zip(m, ell, strict=True)))
    return LinkBodies(ell, m, _given("centres", centres, n, "d", chain.t), _given("inertias", inertias, n, "I", chain.t))


def constant(what: str, value: Any, t: sp.Symbol | None = None) -> sp.Expr:
    """A real, finite number or an expression that does not depend on time, for SymPy.

    Raises:
        InputError: other input.
    """
    out = value if isinstance(value, sp.Expr) else exact(value)
    if out is None:
        raise InputError(f"{what} is {value!r:.80}; expected a real, finite number, or a SymPy expression.")
    if out.is_extended_real is False or out.is_finite is False or out.has(sp.nan, sp.zoo, sp.oo):
        raise InputError(f"{what} is {out!s:.80}; expected a real, finite number. Check what it was computed from.")
    if out.has(AppliedUndef) or (t is not None and out.has(t)):
        raise InputError(f"{what} is {out!s:.80}, which depends on time; expected a constant.")
    if not out.free_symbols and not abs(real(out)) <= MOST:
        raise InputError(f"{what} is {value!s:.80}; expected at most {MOST:g}. Units are metres, kilograms and seconds.")
    return sp.nsimplify(out, rational=True) if out.has(sp.Float) else out


def symbols_of(expressions: Iterable[sp.Basic]) -> tuple[sp.Symbol, ...]:
    """Symbols in expressions, in the order in which they come; those of one expression by their names."""
    found: dict[sp.Symbol, None] = {}
    for expression in expressions:
        found.update(dict.fromkeys(sorted(expression.free_symbols, key=str)))
    return tuple(found)


def refuse_symbols(left: Sequence[sp.Symbol], purpose: str, *, how: str = "subs") -> None:
    """Raise if symbols are left where numbers are needed.

    Args:
        left: The symbols.
        purpose: What needs numbers, for the message.
        how: What takes them: "subs" or "values=".

    Raises:
        InputError: naming all of them.
    """
    if left:
        names = ", ".join(map(str, left))
        example = ", ".join(f'"{s}": 1.0' for s in left[:2]) + (", ..." if len(left) > 2 else "")
        example = f"{how}{{{example}}}" if how.endswith("=") else f"{how}({{{example}}})"
        raise InputError(
            f"{purpose} needs numbers, and {'these are still symbols' if len(left) > 1 else 'this is still a symbol'}: {names}."
            f" Give numbers where the chain and its masses are made, or put them in: {example}."
        )


def replacements(values: Mapping[Any, Any], known: Sequence[sp.Symbol], owner: str) -> dict[sp.Symbol, sp.Expr]:
    """{symbol: number or expression}, from symbols or their names.

    Raises:
        InputError: no mapping, unknown symbols, values that are no finite numbers.
    """
    check_kind("values", values, Mapping, "{symbol: number}")
    by_name = {str(symbol): symbol for symbol in known}
    out = {}
    for key, value in values.items():
        symbol = by_name.get(str(key))
        if symbol is None or (isinstance(key, sp.Basic) and key != symbol):
            names = ", ".join(by_name) or "none are left"
            raise InputError(f"{key!s:.80} is no symbol of {owner}; its symbols: {names}.")
        out[symbol] = constant(f"the value of {symbol}", value)
    return out


def _given(what: str, values: Iterable[Any] | None, n: int, letter: str | None, t: sp.Symbol) -> tuple[sp.Expr, ...]:
    if values is None:
        return tuple(sp.Symbol(f"{letter}_{i + 1}", positive=True) for i in range(n))
    if isinstance(values, str | Mapping) or not np.iterable(values):
        raise InputError(f"{what} is {values!r:.80}; expected {n} numbers, one a link.")
    return _checked(what, list(values), n, t)


def _checked(what: str, values: Sequence[Any], n: int, t: sp.Symbol | None = None) -> tuple[sp.Expr, ...]:
    if len(values) != n:
        raise InputError(f"{what} has {len(values)} entries; expected {n}, one a link.")
    wrong, expected = _BOUNDS[what]
    out = []
    for i, value in enumerate(values):
        name = f"{_NAMES[what]} of link {i + 1}"
        number = constant(name, value, t)
        if wrong(number):
            raise InputError(f"the {name} is {number!s:.80}; expected {expected}.")
        out.append(number)
    return tuple(out)


_NAMES = {"lengths": "length", "masses": "mass", "centres": "centre of mass", "inertias": "inertia"}
_BOUNDS: dict[str, tuple[Callable[[sp.Expr], bool], str]] = {
    "lengths": (lambda x: bool(x.is_nonpositive), "a length above zero [m]"),
    "masses": (lambda x: bool(x.is_nonpositive), "a mass above zero [kg]; leave a link without mass out of the chain"),
    "centres": (lambda x: False, "a distance from its joint along the link [m]"),
    "inertias": (lambda x: bool(x.is_negative), "zero (a point mass) or more [kg m2], about the centre of mass"),
}
