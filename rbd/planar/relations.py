"""Relations between the angles of a chain: read, solved where an angle occurs linearly, and checked against each other.

A relation that some angle occurs in linearly, with a coefficient free of angles, is solved for that angle (the last such one);
it is then substituted in the others. The others, psi(s) = 0, are not solved: rates are in their derivative's null space,

    psi_d s_d' + psi_f s_f' = 0,   s_d' = -psi_d^-1 psi_f s_f',

with as many angles s_d dependent as relations remain. Points on them are looked for numerically, to distinguish relations that
contradict each other, or are redundant where they hold, from independent ones.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
import sympy
from sympy.core.function import AppliedUndef

from rbd.arrays import Array
from rbd.errors import InputError
from rbd.planar.angles import Symbols
from rbd.planar.chain import Chain
from rbd.planar.expressions import as_expression

STARTS = 60
"""Random configurations from which points on the relations are searched."""


@dataclass(frozen=True)
class Relation:
    """One relation.

    Attributes:
        label: As it was given, for messages.
        expr: Expression that is zero.
    """

    label: str
    expr: sympy.Expr


@dataclass(frozen=True, eq=False)
class Reduced:
    """A chain's angles under relations.

    Attributes:
        q: All angles as functions of the coordinates, shape (n, 1).
        coordinates: Angles that were not solved for, shape (m, 1).
        free: Those of them that move freely, shape (f, 1).
        rates: d coordinates = rates d free, shape (m, f).
        remaining: Expressions that are zero and were not solved, in the coordinates.
        regular: Where this is zero, other angles must be taken as free; 1 if all relations were solved.
        points: Numbers of the symbols and the coordinates at configurations that satisfy the relations.
    """

    q: Symbols
    coordinates: Symbols
    free: Symbols
    rates: Symbols
    remaining: tuple[sympy.Expr, ...]
    regular: sympy.Expr
    points: tuple[tuple[dict[sympy.Symbol, float], Array], ...]


def read(chain: Chain, relation: Any) -> tuple[Relation, ...]:
    """Relations as they come: {angle or its number: value}, an equation, an expression that is zero, or a list of these.

    Raises:
        InputError: on other input, naming it.
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
            "no relation came; expected one, as {1: 0} for joint 1 locked at 0 rad, or sympy.Eq(2*th1 + th2, sympy.pi)."
        )
    return tuple(out)


def _held(chain: Chain, key: Any, value: Any) -> Relation:
    names = ", ".join(str(angle) for angle in chain.q)
    if isinstance(key, int | np.integer | sympy.Integer) and not isinstance(key, bool):
        if not 1 <= int(key) <= chain.n:
            raise InputError(f"there is no joint {key} to lock; expected 1 to {chain.n} (1 is at the base), for {names}.")
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
    out = as_expression(value)
    if out is None or out.is_finite is False or out is sympy.nan or out.has(sympy.I):
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


def reduce(chain: Chain, relations: tuple[Relation, ...], branch: int | None, free: tuple[sympy.Expr, ...] = ()) -> Reduced:
    """Solve relations for angles where possible, but not for those that shall be free, and store the others.

    Raises:
        InputError: on contradictory or redundant relations, naming them.
    """
    solved: dict[sympy.Expr, sympy.Expr] = {}
    pending, used = list(relations), list[Relation]()
    while True:
        now = [_substituted(relation, solved, chain, used) for relation in pending]
        chosen = next((k for k, expr in enumerate(now) if _linear(chain, expr, free) is not None), None)
        value = _linear(chain, now[chosen], free) if chosen is not None else None
        if value is None and branch is not None and pending:
            chosen, value = 0, _nonlinear(chain, pending[0], now[0], branch, free)
        if chosen is None or value is None:
            break
        angle, solution = value
        solved = {old: sympy.expand(new.xreplace({angle: solution})) for old, new in solved.items()} | {angle: solution}
        used.append(pending.pop(chosen))
    coordinates = [angle for angle in chain.q if angle not in solved]
    q = sympy.ImmutableMatrix([solved.get(angle, angle) for angle in chain.q])
    if free and len(free) != chain.n - len(relations):
        raise InputError(
            f"free names {len(free)} angles; expected {chain.n - len(relations)}, as {chain.n} angles under {len(relations)} "
            "independent relations leave free."
        )
    if not pending:
        column = sympy.ImmutableMatrix(len(coordinates), 1, coordinates)
        return Reduced(q, column, column, sympy.ImmutableMatrix(sympy.eye(len(coordinates))), (), sympy.Integer(1), ())
    return _implicit(q, coordinates, pending, now, free)


def _substituted(relation: Relation, solved: Mapping[Any, Any], chain: Chain, used: list[Relation]) -> sympy.Expr:
    """The relation in the remaining angles, or an error if it contains none."""
    expr = sympy.expand(relation.expr.xreplace(solved))
    if expr.has(*chain.q) and not all(_vanishes(expr.diff(angle), chain) for angle in chain.q):
        return expr
    rest = sympy.simplify(expr.xreplace({angle: sympy.Rational(k + 1, 7) for k, angle in enumerate(chain.q)}))
    others = "; ".join(r.label for r in used) or "an identity"
    if rest == 0 or _vanishes(rest, chain):
        raise InputError(f"the relation {relation.label} is redundant: it follows from {others}. Leave one of them out.")
    full_turns = sympy.simplify(sympy.sin(rest / 2)) == 0
    turns = " They differ by full turns, which are other poses here: leave one out." if full_turns else ""
    raise InputError(f"the relation {relation.label} contradicts {others}: together they leave {rest} = 0.{turns}")


def _vanishes(expr: sympy.Expr, chain: Chain) -> bool:
    """Whether an expression is zero: by simplification, else by its value at random points."""
    if expr.is_zero is not None:
        return bool(expr.is_zero)
    names = sorted(expr.atoms(AppliedUndef) | expr.free_symbols - {chain.t}, key=str)
    rng = np.random.default_rng(3)
    for _ in range(4):
        point = {name: sympy.Float(float(rng.uniform(0.2, 1.3)), 40) for name in names}
        try:
            if abs(sympy.N(expr.xreplace(point), 30)) > 1e-20:
                return False
        except TypeError:  # a function without a value
            return False
    return True


def _linear(chain: Chain, expr: sympy.Expr, free: tuple[sympy.Expr, ...]) -> tuple[sympy.Expr, sympy.Expr] | None:
    """The last angle that occurs linearly, numbers as coefficients before parameters, and what it is equal to."""
    factors = {angle: sympy.expand(expr.diff(angle)) for angle in reversed(list(chain.q)) if angle not in free}
    found = [(angle, factor) for angle, factor in factors.items() if factor != 0 and not factor.has(*chain.q)]
    if not found:
        return None
    angle, factor = min(found, key=lambda each: not each[1].is_number)
    return angle, sympy.expand(-(expr - factor * angle).expand() / factor)


def _nonlinear(
    chain: Chain, relation: Relation, expr: sympy.Expr, branch: int, free: tuple[sympy.Expr, ...]
) -> tuple[sympy.Expr, sympy.Expr] | None:
    """One of the solutions of a relation that is linear in no angle, if SymPy finds some."""
    unknown = sympy.Dummy("angle", real=True)
    for angle in reversed([a for a in chain.q if expr.has(a) and a not in free]):
        try:
            found = sympy.solve(expr.xreplace({angle: unknown}), unknown)
        except NotImplementedError:
            continue
        real = [s for s in found if isinstance(s, sympy.Expr) and not s.has(sympy.I, unknown)]
        if not real:
            continue
        if branch >= len(real):
            listed = ", ".join(f"{k}: {s}" for k, s in enumerate(real))
            raise InputError(f"branch is {branch}; the relation {relation.label} gives {angle} as {listed:.300}.")
        return angle, real[branch]
    raise InputError(
        f"the relation {relation.label} could not be solved for an angle; leave branch out: its rates need no solution."
    )


def _implicit(
    q: Symbols,
    coordinates: list[sympy.Expr],
    pending: list[Relation],
    remaining: list[sympy.Expr],
    free: tuple[sympy.Expr, ...],
) -> Reduced:
    k, m = len(remaining), len(coordinates)
    names = "; ".join(relation.label for relation in pending)
    if k > m:
        raise InputError(f"{k} relations are left for {m} angles: {names}. They contradict each other, or one is redundant.")
    slopes = sympy.Matrix(remaining).jacobian(coordinates)
    points, scale, jacobians = _points(coordinates, remaining, slopes, names)
    _check_rank(pending, jacobians, scale)
    best, size = tuple(range(m - k, m)), 0.0
    choices = [tuple(j for j in range(m) if coordinates[j] not in free)] if free else combinations(range(m), k)
    for columns in choices:  # the last that is nearly as good as the best: the first angles stay free
        here = float(np.median([abs(np.linalg.det(J[:, columns])) for J in jacobians]))
        if here > 0.0 and here >= 0.3 * size:
            best, size = columns, max(here, size)
    if free and size <= 1e-9 * scale**k:
        raise InputError(
            f"free came as {', '.join(map(str, free))}, whose rates do not determine the others under {names}. "
            "Choose other angles."
        )
    others = [j for j in range(m) if j not in best]
    block = slopes.extract(list(range(k)), list(best))
    regular = block.det()
    solution = -block.adjugate() * slopes.extract(list(range(k)), others) / regular if others else sympy.zeros(k, 0)
    rates = sympy.zeros(m, len(others))
    for row, j in enumerate(best):
        rates[j, :] = solution[row, :]
    for column, j in enumerate(others):
        rates[j, column] = 1
    return Reduced(
        q,
        sympy.ImmutableMatrix(m, 1, coordinates),
        sympy.ImmutableMatrix(len(others), 1, [coordinates[j] for j in others]),
        rates.as_immutable(),
        tuple(remaining),
        regular,
        tuple(points),
    )


def _points(
    coordinates: list[sympy.Expr], remaining: list[sympy.Expr], slopes: Symbols, names: str
) -> tuple[list[tuple[dict[sympy.Symbol, float], Array]], float, list[Array]]:
    """Configurations that satisfy the relations, the size of slopes anywhere, and the slopes there."""
    parameters = sorted(set().union(*(e.free_symbols for e in remaining)) - {s.args[0] for s in coordinates}, key=str)
    plain = [sympy.Dummy() for _ in coordinates]
    known = dict(zip(coordinates, plain, strict=True))
    value = sympy.lambdify([*plain, *parameters], [e.xreplace(known) for e in remaining], "numpy")
    slope = sympy.lambdify([*plain, *parameters], slopes.xreplace(known), "numpy")
    rng = np.random.default_rng(5)
    found, jacobians, anywhere, least = [], [], [], np.inf
    with np.errstate(all="ignore"):
        for _ in range(STARTS):
            numbers = [float(rng.uniform(0.8, 1.2) if p.is_positive else rng.uniform(0.1, 0.6)) for p in parameters]
            s = rng.uniform(-np.pi, np.pi, len(coordinates))
            anywhere.append(np.array(slope(*s, *numbers), dtype=float))
            s, residual = newton(lambda s, p=numbers: (value(*s, *p), slope(*s, *p)), s)
            least = min(least, residual)
            if residual < 1e-9:
                found.append((dict(zip(parameters, numbers, strict=True)), s))
                jacobians.append(np.array(slope(*s, *numbers), dtype=float))
    usable = [J for J in anywhere if np.isfinite(J).all()]
    scale = float(np.median([np.abs(J).max() for J in usable])) if usable else 1.0
    if not found and not parameters:
        raise InputError(
            f"no angles satisfy {names}: from {STARTS} starts the nearest miss is {least:.3g}. The relations contradict each "
            "other, or have no real solution."
        )
    return found, scale, jacobians or usable


def newton(function: Any, s: Array) -> tuple[Array, float]:
    """Gauss and Newton's method with least steps, halved until the residual falls."""
    psi, J = (np.array(x, dtype=float) for x in function(s))
    for _ in range(80):
        if not (np.isfinite(psi).all() and np.isfinite(J).all()):
            return s, np.inf
        if np.abs(psi).max() < 1e-14:
            break
        step = np.linalg.lstsq(J, psi, rcond=1e-12)[0]
        for halving in range(12):
            trial = s - 0.5**halving * step
            new, slope = (np.array(x, dtype=float) for x in function(trial))
            if np.isfinite(new).all() and np.linalg.norm(new) < np.linalg.norm(psi):
                break
        else:
            break
        s, psi, J = trial, new, slope
    return s, float(np.abs(psi).max())


def _check_rank(pending: list[Relation], jacobians: list[Array], scale: float) -> None:
    """Refuse relations that follow from the ones before them, wherever they hold."""
    for k in range(len(pending)):
        ranks = [int(np.sum(np.linalg.svd(J[: k + 1], compute_uv=False) > 1e-4 * scale)) for J in jacobians]
        if max(ranks, default=k + 1) > k:
            continue
        before = "; ".join(relation.label for relation in pending[:k])
        why = f"it follows from {before}" if k else "its derivative is zero wherever it holds"
        raise InputError(
            f"the relation {pending[k].label} gives no condition on rates: {why}. Leave it out, or write it in a way that "
            "crosses zero, as th2 = 0 for cos(th2) = 1."
        )
