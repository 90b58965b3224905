"""A planar chain under relations of its angles: a locked joint, the polar manipulator, any other equation.

q = q(s) with fewer coordinates s, of which f move freely; rates q' = B s_free'. Then, for the end point,

    r' = J_c s_free',   J_c = J B,   r'' = J_c s_free'' + J_c' s_free',

and J_c has one column per degree of freedom that is left. Where every relation could be solved for an angle, all of s is free;
others enter through the null space of their derivative, and angles must then satisfy them (`project`).
Source: [Duarte2021], problems 2 and 3; the polar manipulator is [MussaIvaldi1986]'s.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
import sympy

from rbd.arrays import Array, as_array, lazy
from rbd.displayed import Displayed
from rbd.errors import InputError, NoSolution
from rbd.planar import expressions
from rbd.planar.angles import Symbols, plain
from rbd.planar.chain import Chain, check_chain
from rbd.planar.kinematics import Split, total
from rbd.planar.relations import Reduced, Relation, newton, read, reduce


class ConstrainedSplit(Split[Symbols]):
    """The acceleration's three parts in the free angles."""

    @property
    def note(self) -> str:
        """Why there is a Coriolis part or not."""
        return (
            "Parts belong to the free angles: squares of their rates are centripetal, products of two are Coriolis. "
            "With one free angle there is no Coriolis part: all rates are multiples of one, and every product is a square."
        )


@dataclass(frozen=True, eq=False)
class ConstrainedChain(Displayed):
    """A planar chain under relations of its angles: its kinematics in the angles that remain free.

    Attributes:
        chain: The chain without them.
        relations: As they were given, each an expression that is zero.
        reduced: The angles under them, `rbd.planar.relations.Reduced`.

    Example:
        >>> chain = rbd.planar.Chain(2)
        >>> th1, th2 = chain.q
        >>> folding = rbd.planar.constrained(chain, 2 * th1 + th2)
        >>> folding.mobility, folding.free, folding.q
        (1, Matrix([[theta_1(t)]]), Matrix([
        [   theta_1(t)],
        [-2*theta_1(t)]]))
    """

    chain: Chain
    relations: tuple[sympy.Expr, ...]
    reduced: Reduced

    @property
    def mobility(self) -> int:
        """Number of free angles: n less the relations."""
        return self.reduced.free.rows

    @property
    def free(self) -> Symbols:
        """The angles that move freely, shape (f, 1) [rad]."""
        return self.reduced.free

    @property
    def coordinates(self) -> Symbols:
        """The angles that are not eliminated, shape (m, 1) [rad]; the free ones if all relations were solved."""
        return self.reduced.coordinates

    @lazy
    def J1(self) -> Symbols:
        """Derivative of the relations that were not solved by the free angles, shape (k, f): J1 s_free' + J2 s_dep' = 0."""
        return self._slopes(list(self.free))

    @lazy
    def J2(self) -> Symbols:
        """Derivative of the relations that were not solved by the angles that are not free, shape (k, k)."""
        return self._slopes([angle for angle in self.coordinates if angle not in self.free])

    @lazy
    def det_J2(self) -> sympy.Expr:
        """Signed determinant of J2; where it is zero, the free angles' rates do not determine the others. 1 if all are solved.

        For the loop L1 e^(i th1) + L2 e^(i th2) + L3 e^(i th3) + L4 e^(i th4) = 0 with th1 and th4 free it is
        L2 L3 sin(th3 - th2) [m^2].
        """
        return sympy.trigsimp(self.reduced.regular)

    def _slopes(self, angles: list[sympy.Expr]) -> Symbols:
        """Derivative of the relations that were not solved by some angles."""
        remaining = self.reduced.remaining
        return sympy.ImmutableMatrix(len(remaining), len(angles), lambda i, k: remaining[i].diff(angles[k]))

    @property
    def q(self) -> Symbols:
        """All angles as functions of the coordinates, shape (n, 1) [rad]."""
        return self.reduced.q

    @lazy
    def rates(self) -> Symbols:
        """B of q' = B s_free', shape (n, f)."""
        slopes = self.q.jacobian(self.coordinates) if self.coordinates.rows else sympy.zeros(self.chain.n, 0)
        return sympy.ImmutableMatrix(slopes * self.reduced.rates)

    @lazy
    def _motion(self) -> tuple[Symbols, Symbols, Symbols, Symbols]:
        """All angles and their first three derivatives in the coordinates and the free rates."""
        qd = sympy.ImmutableMatrix(self.rates * self.free.diff(self.chain.t))
        qdd = self.rate(qd)
        return self.q, qd, qdd, self.rate(qdd)

    def rate(self, expr: Any) -> Any:
        """Time derivative of an expression in the coordinates and the free rates, itself in them."""
        t, free = self.chain.t, self.free.diff(self.chain.t)
        known = dict(zip(self.coordinates.diff(t), self.reduced.rates * free, strict=True))
        return expr.diff(t).xreplace({old: new for old, new in known.items() if old != new})

    def on(self, expr: Any) -> Any:
        """An expression of the chain with relations inserted: angles and their derivatives become those of the free ones."""
        old = (self.chain.q, self.chain.qd, self.chain.qdd, self.chain.qddd)
        known = {a: b for olds, news in zip(old, self._motion, strict=True) for a, b in zip(olds, news, strict=True)}
        return expr.xreplace(known)

    # Kinematics

    def position(self, i: int | None = None) -> Symbols:
        """Position of joint i (None: the end point) [m], shape (2, 1).

        Raises:
            InputError: if i is not in 0..n; also below.
        """
        return self.on(self.chain.position(i))

    def full_jacobian(self, i: int | None = None) -> Symbols:
        """The unconstrained chain's Jacobian at the angles that the relations allow [m], shape (2, n)."""
        return self.on(self.chain.jacobian(i))

    def jacobian(self, i: int | None = None) -> Symbols:
        """The reduced Jacobian J_c = J B [m], shape (2, f): velocity per rate of the free angles."""
        return sympy.ImmutableMatrix((self.full_jacobian(i) * self.rates).applyfunc(_shorter))

    def jacobian_rate(self, i: int | None = None) -> Symbols:
        """Time derivative of the reduced Jacobian [m/s], shape (2, f)."""
        return self.rate(self.jacobian(i))

    def velocity(self, i: int | None = None) -> Symbols:
        """J_c s_free' [m/s], shape (2, 1)."""
        return sympy.ImmutableMatrix(self.jacobian(i) * self.free.diff(self.chain.t))

    def acceleration(self, i: int | None = None) -> Symbols:
        """`J_c s_free'' + J_c' s_free'` [m/s^2], shape (2, 1)."""
        t = self.chain.t
        return sympy.ImmutableMatrix(self.jacobian(i) * self.free.diff(t, 2) + self.jacobian_rate(i) * self.free.diff(t))

    def jerk(self, i: int | None = None) -> Symbols:
        """`J_c s_free''' + 2 J_c' s_free'' + J_c'' s_free'` [m/s^3], shape (2, 1)."""
        return sympy.ImmutableMatrix(self.rate(self.acceleration(i)))

    def split(self, i: int | None = None) -> ConstrainedSplit:
        """The acceleration in three parts of the free angles [m/s^2]: terms in `s''`, in `s_i'^2`, in `s_i' s_j'`."""
        J, t = self.jacobian(i), self.chain.t
        qd = list(self.free.diff(t))

        def along(column: int, k: int) -> Symbols:
            """How a column of J_c changes per rate of free angle k."""
            turn = self.reduced.rates[:, k]
            return sum((J[:, column].diff(s) * turn[j] for j, s in enumerate(self.coordinates)), sympy.zeros(2, 1))

        pairs = combinations(range(self.mobility), 2)
        return ConstrainedSplit(
            sympy.ImmutableMatrix(J * self.free.diff(t, 2)),
            total([along(k, k) * qd[k] ** 2 for k in range(self.mobility)]),
            total([(along(k, j) + along(j, k)) * qd[k] * qd[j] for k, j in pairs]),
            self.chain.angles,
        )

    def agreement(self, i: int | None = None) -> dict[str, Symbols]:
        """Residuals of the full chain's motion with the relations inserted, less this one's: zeros, shape (2, 1) each."""
        pairs = {
            "velocity": (self.chain.velocity(i), self.velocity(i)),
            "acceleration": (self.chain.acceleration(i), self.acceleration(i)),
            "jerk": (self.chain.jerk(i), self.jerk(i)),
            "split": (self.chain.acceleration(i), self.split(i).total),
        }
        return {name: (self.on(full) - own).applyfunc(_cancelled).as_immutable() for name, (full, own) in pairs.items()}

    # Numbers

    def function(self, expr: Any, *, parameters: Mapping[Any, float] | None = None) -> Callable[..., Array]:
        """A numeric function f(s, sd, sdd, sddd) of any expression of the chain, on the relations.

        Args:
            expr: As in `Chain.function`; angles that are not free are replaced.
            parameters: {symbol: number} for all other symbols.

        Returns:
            Function of the coordinates, shape (m,) or (samples, m), and of the free angles' rates, (f,) or (samples, f).
            Relations that were not solved must hold: `project`.

        Raises:
            InputError: as `Chain.function` does.
        """
        placed = self.on(expr) if isinstance(expr, sympy.Basic | sympy.MatrixBase) else expr
        inner = self.chain.function(placed, parameters=parameters)
        order = list(self.chain.q)
        places = [[order.index(angle) for angle in angles] for angles in (self.coordinates, self.free)]

        def values(s: Any, sd: Any = None, sdd: Any = None, sddd: Any = None) -> Array:
            given = zip(("s", "sd", "sdd", "sddd"), (s, sd, sdd, sddd), (places[0], *[places[1]] * 3), strict=True)
            return inner(*(None if x is None else _spread(name, x, at, self.chain.n) for name, x, at in given))

        return values

    def project(self, q: Sequence[float] | Array, *, parameters: Mapping[Any, float] | None = None) -> Array:
        """Angles near given ones that satisfy the relations [rad], shape (n,): by Newton's method with least steps.

        Args:
            q: Where to begin, shape (n,) [rad].
            parameters: {symbol: number} for symbols in the relations.

        Raises:
            InputError: on another shape, or numbers that are not finite.
            NoSolution: if it does not get there.
        """
        start = plain("q", q, (self.chain.n,), ": one angle per link [rad]")
        relations = sympy.ImmutableMatrix(self.relations)
        value = self.chain.function(relations, parameters=parameters)
        slope = self.chain.function(relations.jacobian(self.chain.q), parameters=parameters)
        found, residual = newton(lambda x: (value(x), slope(x)), start)
        if residual > 1e-10:
            raise NoSolution(
                f"no angles near {np.round(start, 4)} satisfy the relations: the residual is {residual:.3g}. Begin elsewhere."
            )
        return found

    # Display

    def latex(self, expr: Any = None) -> str:
        """LaTeX of an expression, as `Chain.latex`; of the relations if none is given.

        Raises:
            InputError: on what has no LaTeX.
        """
        return expressions.latex([sympy.Eq(r, 0) for r in self.relations] if expr is None else expr)

    def _repr_latex_(self) -> str:
        """LaTeX of the end point's position, for notebooks."""
        return expressions.in_dollars(rf"\mathbf{{r}}_P = {self.latex(self.position())}")

    def __repr__(self) -> str:
        listed = ", ".join(f"{relation} = 0" for relation in self.relations)
        return f"ConstrainedChain({self.chain.n} links, {listed}; free: {', '.join(map(str, self.free)) or 'none'})"


def constrained(
    chain: Chain, relation: Any, *, branch: int | None = None, free: Sequence[Any] | None = None
) -> ConstrainedChain:
    """A chain under one relation of its angles, or several.

    Args:
        chain: The chain.
        relation: {joint: angle} for locked joints, where joint is a number from 1 (theta_1, at the base) to n, or an angle of
            `chain.q`; `sympy.Eq(2*th1 + th2, sympy.pi)`; an expression that is zero; or a list of these. Angles are those of
            the chain, in its convention [rad]; other symbols are constants.
        branch: Relations not linear in any angle are used by their derivative, for any of their solutions; a
            number, 0, 1, ..., solves them for an angle instead, by that one of the solutions that SymPy finds.
        free: Angles that shall be free, by number from 1 or as angles of `chain.q`, as many as the relations leave: those
            with known motion. None: the first ones that determine the others.

    Raises:
        InputError: on contradictory or redundant relations, naming them; on rates, time or other varying
            quantities in a relation; on objects that are not relations; on free angles that are too few or too many, or
            that do not determine the others.

    Example:
        >>> from sympy import Eq, pi, symbols
        >>> arm = rbd.planar.Chain(2, lengths=symbols("ell ell", positive=True))
        >>> th1, th2 = arm.q
        >>> rbd.planar.constrained(arm, Eq(2 * th1 + th2, pi)).jacobian()  # the end point moves along y
        Matrix([
        [                    0],
        [2*ell*cos(theta_1(t))]])

        A four-bar, its links' angles measured from x: the end returns to the start.

        >>> loop = rbd.planar.Chain(4, angles="segment")
        >>> rbd.planar.constrained(loop, loop.position(), free=(1, 4)).det_J2
        -ell_2*ell_3*sin(theta_2(t) - theta_3(t))
    """
    check_chain(chain)
    if branch is not None and (isinstance(branch, bool) or not isinstance(branch, int | np.integer) or branch < 0):
        raise InputError(f"branch is {branch!r:.80}; expected None, or which solution to take: 0, 1, ...")
    relations: tuple[Relation, ...] = read(chain, relation)
    known = () if free is None else _angles(chain, free)
    return ConstrainedChain(chain, tuple(r.expr for r in relations), reduce(chain, relations, branch, known))


def _angles(chain: Chain, given: Any) -> tuple[sympy.Expr, ...]:
    """Angles of the chain, given by number or as themselves.

    Raises:
        InputError: on other objects, on one that comes twice, on none.
    """
    out = []
    listed = list(given) if isinstance(given, list | tuple | sympy.MatrixBase) else [given]
    for one in listed:
        whole = isinstance(one, int | np.integer | sympy.Integer) and not isinstance(one, bool)
        angle = chain.q[int(one) - 1] if whole and 1 <= int(one) <= chain.n else one
        if not isinstance(angle, sympy.Expr) or angle not in set(chain.q) or angle in out:
            names = ", ".join(map(str, chain.q))
            raise InputError(f"free has {one!r:.80} in it; expected numbers 1 to {chain.n}, each once, or angles of {names}.")
        out.append(angle)
    if not out:
        raise InputError("free names no angle; expected some, or None to choose them by themselves.")
    return tuple(out)


def _shorter(expr: sympy.Expr) -> sympy.Expr:
    """The expression with its brackets multiplied out, if that makes it shorter: terms that cancel are gone."""
    flat = sympy.expand(expr)
    if flat.count_ops() < expr.count_ops():
        return flat
    numerator, _ = sympy.fraction(sympy.together(expr))
    return sympy.S.Zero if sympy.expand(numerator) == 0 else expr


def _cancelled(expr: sympy.Expr) -> sympy.Expr:
    """The expression simplified: by multiplying out where that shows it to be zero, which is quick."""
    flat = sympy.expand(expr)
    return flat if flat == 0 else sympy.simplify(flat)


def _spread(what: str, value: Any, places: list[int], n: int) -> Array:
    """Values of some angles as rows of all n of them, zeros elsewhere: those do not occur."""
    given = as_array(what, value)
    if given.ndim not in (1, 2) or given.shape[-1] != len(places):
        k = len(places)
        raise InputError(f"{what} has shape {given.shape}; expected one number per free angle, ({k},), or (samples, {k}).")
    out = np.zeros((*given.shape[:-1], n))
    out[..., places] = given
    return out
