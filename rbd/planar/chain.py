"""A chain of n links in a plane, in symbols: its lengths, its angles and its kinematics.

The links have lengths ell_1..ell_n and are hinged end to end at the origin; x points to the right, y up, angles are
counterclockwise. A chain contains the symbols and its kinematics; dynamics, inverse kinematics, relations of its angles
and its URDF file are functions of a chain: `rbd.planar.dynamics(chain)`. Source: [Duarte2021].
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
import sympy
from sympy.core.function import AppliedUndef
from sympy.physics.mechanics import dynamicsymbols

from rbd.arrays import Array, lazy
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.errors.inputs import check_kind
from rbd.planar import expressions
from rbd.planar.angles import JOINT, AngleMap, Symbols, angle_map, check_convention, to_segments
from rbd.planar.expressions import Compiled, compile_expression
from rbd.planar.kinematics import Split, check_joint, total, unit_rate
from rbd.planar.numeric import ChainNumbers, Ellipse

MOST_MINORS = 6
"""Links up to which a determinant is written in sines of angles between links."""
MOST_LINKS = 50
"""Largest number of links; expressions of longer chains fill pages."""
SHORTEST, LONGEST = 1e-30, 1e30
"""Lengths whose fourth powers, as in det(J J^T), are still floats [m]."""


@dataclass(frozen=True, init=False)
class Chain(Displayed):
    """A planar chain of n links, hinged end to end, the base at the origin: its kinematics in symbols and numbers.

    Joint 0 is the base, joint i the far end of link i, joint n the end point P. In all methods with `i`, None is the
    end point, and values outside 0..n raise InputError. Two chains are equal if they have the same links and the same
    convention of angles.

    Args:
        n: How many links, 1 to 50.
        lengths: Their lengths [m]: None for symbols ell_1..ell_n; or n numbers or positive SymPy expressions, as
            `(ell, ell)`. Decimal numbers are exact: 0.1 is 1/10.
        angles: How theta_i is measured: "joint" from the previous link, "segment" from x, "vertical" from the downward
            vertical (the pendulum's; zero hangs).

    Raises:
        InputError: on a number of links that is not whole and positive, on lengths that are not n positive finite ones, or
            on another convention for the angles.

    Example:
        >>> chain = rbd.planar.Chain(2)
        >>> chain.determinant()
        ell_1*ell_2*sin(theta_2(t))
        >>> arm = rbd.planar.Chain(2, lengths=[1.0, 0.5])
        >>> arm.function(arm.position())([0.0, np.pi / 2]).round(3)
        array([1. , 0.5])
    """

    n: int
    lengths: tuple[sympy.Expr, ...]
    angles: str

    def __init__(self, n: int, *, lengths: Sequence[Any] | Array | None = None, angles: str = JOINT) -> None:
        count = _check_count(n)
        self.__dict__.update(n=count, angles=check_convention(angles), lengths=_check_lengths(count, lengths))

    # The symbols

    @property
    def t(self) -> sympy.Symbol:
        """Time [s]; all angles are functions of it."""
        return dynamicsymbols._t

    @lazy
    def q(self) -> Symbols:
        """Angles theta_1(t)..theta_n(t) [rad], shape (n, 1), measured by the convention `angles`."""
        return sympy.ImmutableMatrix([dynamicsymbols(f"theta_{k + 1}", real=True) for k in range(self.n)])

    @lazy
    def qd(self) -> Symbols:
        """Angular velocities [rad/s], shape (n, 1)."""
        return self.q.diff(self.t)

    @lazy
    def qdd(self) -> Symbols:
        """Angular accelerations [rad/s^2], shape (n, 1)."""
        return self.q.diff(self.t, 2)

    @lazy
    def qddd(self) -> Symbols:
        """Angular jerks [rad/s^3], shape (n, 1)."""
        return self.q.diff(self.t, 3)

    @lazy
    def segment_angles(self) -> Symbols:
        """Angle of every link from x [rad], shape (n, 1): psi = A q + b, see `rbd.planar.angles`."""
        matrix, offset = to_segments(self.n, self.angles)
        return (matrix * self.q + offset).as_immutable()

    @lazy
    def _moved_by(self) -> Symbols:
        """A of psi = A q + b, shape (n, n): which angles turn which link."""
        return to_segments(self.n, self.angles)[0]

    @property
    def is_numeric(self) -> bool:
        """Whether all lengths are numbers."""
        return all(length.is_number for length in self.lengths)

    def with_lengths(self, lengths: Sequence[Any] | Array | None) -> Chain:
        """The same chain with other lengths [m], numbers for instance.

        Raises:
            InputError: as the constructor does.
        """
        return Chain(self.n, lengths=lengths, angles=self.angles)

    def with_angles(self, angles: str) -> Chain:
        """The same chain with its angles measured in another way; values are converted by `convert`.

        Raises:
            InputError: on a convention that is none of the three.
        """
        return Chain(self.n, lengths=self.lengths, angles=angles)

    def angle_map(self, to: str) -> AngleMap:
        """The affine map of this chain's angles to another convention: `matrix`, `offset`, and a call for values.

        Raises:
            InputError: on a convention that is none of the three.
        """
        return angle_map(self.n, self.angles, to)

    def convert(self, values: Any, to: str = "segment") -> Any:
        """Angles of this chain in another convention [rad], not wrapped; rates by `angle_map(to).rates`.

        Args:
            values: Shape (n,) or (samples, n) [rad]; or n expressions in a SymPy matrix.
            to: "joint", "segment" or "vertical".

        Raises:
            InputError: on another shape, numbers that are not finite, or another convention.
        """
        return self.angle_map(to)(values)

    # Kinematics

    def position(self, i: int | None = None) -> Symbols:
        """Position of joint i [m], shape (2, 1): r = sum_k ell_k (cos psi_k, sin psi_k) over the links before it."""
        return self._motion(i, 0)

    def velocity(self, i: int | None = None) -> Symbols:
        """Velocity of joint i by differentiation [m/s], shape (2, 1), one term per link."""
        return self._motion(i, 1)

    def acceleration(self, i: int | None = None) -> Symbols:
        """Acceleration of joint i by differentiation [m/s^2], shape (2, 1), one term per link."""
        return self._motion(i, 2)

    def jerk(self, i: int | None = None) -> Symbols:
        """Jerk of joint i by differentiation [m/s^3], shape (2, 1), one term per link."""
        return self._motion(i, 3)

    def jacobian(self, i: int | None = None) -> Symbols:
        """Jacobian J of joint i [m], shape (2, n): J[a, j] = d r_a / d theta_j, so that v = J qd."""
        return self._jacobian(i, 0)

    def jacobian_rate(self, i: int | None = None) -> Symbols:
        """Time derivative of the Jacobian of joint i [m/s], shape (2, n)."""
        return self._jacobian(i, 1)

    def velocity_by_jacobian(self, i: int | None = None) -> Symbols:
        """J qd [m/s], shape (2, 1): the velocity again, its terms grouped by angle."""
        return self._by_jacobian(i, 1)

    def acceleration_by_jacobian(self, i: int | None = None) -> Symbols:
        """Jd qd + J qdd [m/s^2], shape (2, 1): the acceleration again, its terms grouped by angle."""
        return self._by_jacobian(i, 2)

    def jerk_by_jacobian(self, i: int | None = None) -> Symbols:
        """Jdd qd + 2 Jd qdd + J qddd [m/s^3], shape (2, 1): the jerk again, its terms grouped by angle."""
        return self._by_jacobian(i, 3)

    def determinant(self) -> sympy.Expr:
        """Determinant of the end-point Jacobian, or of J J^T; zero where it is singular.

        Two links: det J = ell_1 ell_2 sin theta_2 [m^2]. More: det(J J^T) [m^4], the sum of its squared 2 x 2 minors. One
        link: det(J^T J) = ell_1^2 [m^2], since J J^T of a column is always singular.

        A minor of columns i < j is sum ell_k ell_l sin(psi_l - psi_k), over the pairs of a link k that joint i moves and
        a link l that joint j moves; pairs that both joints move cancel. By Cauchy and Binet det(J J^T) is the sum of their
        squares. Their number grows with n^4; beyond 6 links it is left as |J_x|^2 |J_y|^2 - (J_x . J_y)^2, the rows of J.
        """
        if self.n == 1:
            return self.lengths[0] ** 2
        if self.n > MOST_MINORS:
            J = self.jacobian()
            xx, yy, xy = (sympy.Add(*(J[a, j] * J[b, j] for j in range(self.n))) for a, b in ((0, 0), (1, 1), (0, 1)))
            return xx * yy - xy**2
        minors = [self._minor(i, j) for i, j in combinations(range(self.n), 2)]
        return minors[0] if self.n == 2 else sympy.Add(*(minor**2 for minor in minors))

    def singular_configurations(self) -> tuple[sympy.Eq, ...]:
        """Conditions that make the end-point Jacobian lose rank, all of them at once: every link on one line.

        sin(psi_{k+1} - psi_k) = 0 for k = 1..n-1: each link continues the one before it or folds back on it, since
        J = [ell_k (-sin, cos)(psi_k)] A with A invertible has the rank of the links' directions. A single link has none: its
        end point always moves along the circle.
        """
        psi = self.segment_angles
        return tuple(sympy.Eq(sympy.sin(psi[k + 1] - psi[k]), 0) for k in range(self.n - 1))

    def split(self, i: int | None = None) -> Split[Symbols]:
        """Acceleration of joint i in tangential, centripetal and Coriolis parts [m/s^2]; see `rbd.planar.kinematics`."""
        last, moved_by, qd = check_joint(self.n, i), self._moved_by, self.qd
        inward = [-vector for vector in self._segments(0)[:last]]

        def second_derivative(j: int, k: int) -> Symbols:
            return total([vector for m, vector in enumerate(inward) if moved_by[m, j] and moved_by[m, k]])

        return Split(
            tangential=self.jacobian(last) * self.qdd,
            centripetal=total([second_derivative(j, j) * qd[j] ** 2 for j in range(self.n)]),
            coriolis=total([second_derivative(j, k) * (2 * qd[j] * qd[k]) for j, k in combinations(range(self.n), 2)]),
            angles=self.angles,
        )

    def _segments(self, order: int, *, turned: bool = False) -> list[Symbols]:
        """What every link adds: the `order`-th time derivative of ell_k (cos, sin)(psi_k), one (2, 1) per link.

        Turned, of ell_k (-sin, cos)(psi_k), its derivative by psi_k.
        """
        unit, names = unit_rate(order, turned)
        rates = [[psi.diff(self.t, k) if k else psi for k in range(order + 1)] for psi in self.segment_angles]
        known = [dict(zip(names, each, strict=False)) for each in rates]
        return [length * unit.xreplace(each) for length, each in zip(self.lengths, known, strict=True)]

    def _motion(self, i: int | None, order: int) -> Symbols:
        """Position of joint i (order 0), velocity (1), acceleration (2) or jerk (3), shape (2, 1) [m, m/s, ...]."""
        return total(self._segments(order)[: check_joint(self.n, i)])

    def _jacobian(self, i: int | None, order: int) -> Symbols:
        """Jacobian of joint i (order 0) or its first or second time derivative, shape (2, n).

        Column j is sum_k A_kj ell_k (-sin, cos)(psi_k), as psi = A q + b.
        """
        last = check_joint(self.n, i)
        turned = self._segments(order, turned=True)
        columns = [total([turned[k] for k in range(last) if self._moved_by[k, j]]) for j in range(self.n)]
        return sympy.ImmutableMatrix(sympy.Matrix.hstack(*columns))

    def _by_jacobian(self, i: int | None, order: int) -> Symbols:
        """The derivatives of J qd by Leibniz's rule: velocity, acceleration or jerk of joint i, shape (2, 1)."""
        rates = (self.qd, self.qdd, self.qddd)
        terms = [sympy.binomial(order - 1, k) * self._jacobian(i, k) * rates[order - 1 - k] for k in range(order)]
        return total(terms)

    def _minor(self, i: int, j: int) -> sympy.Expr:
        psi, ell, moved_by = self.segment_angles, self.lengths, self._moved_by
        first = [k for k in range(self.n) if moved_by[k, i] and not moved_by[k, j]]
        second = [k for k in range(self.n) if moved_by[k, j]]
        return sympy.Add(*(ell[k] * ell[m] * sympy.sin(psi[m] - psi[k]) for k in first for m in second))

    # Numbers and formulas

    def function(self, expr: Any, *, parameters: Mapping[Any, float] | None = None) -> Compiled:
        """A fast NumPy function f(q, qd, qdd, qddd) of any expression of this chain, vectorised over samples.

        Args:
            expr: SymPy expression, matrix or array in the angles and their first three derivatives.
            parameters: {symbol or its name: number} for all other symbols, as lengths and masses.

        Returns:
            Function of arrays of shape (n,) or (samples, n); rates that do not occur may be left out. A column (r, 1) gives
            (r,) or (samples, r); other matrices have two axes.

        Raises:
            InputError: if symbols are left without a number, or a number is not finite.
        """
        return compile_expression((self.q, self.qd, self.qdd, self.qddd), expr, parameters or {})

    @lazy
    def numeric(self) -> ChainNumbers:
        """Ready numeric functions: positions, velocity, acceleration, jerk, jacobian, split; linear in n, for samples.

        Raises:
            InputError: if lengths are symbols; `with_lengths` gives numbers.
        """
        return ChainNumbers.of(self.lengths, self.angles)

    def ellipse(self, q: Sequence[float] | Array, kind: str = "velocity", *, i: int | None = None) -> Ellipse:
        """Velocity or force ellipse of joint i at a configuration; see `rbd.planar.numeric`.

        Args:
            q: Angles, shape (n,) [rad], measured as this chain does.
            kind: "velocity" (what `|qd| <= 1 rad/s` reaches [m/s]) or "force" (what `|tau| <= 1 N m` balances [N]).
            i: The joint, 1..n; None is the end point.

        Raises:
            InputError: on another kind or shape, or where lengths are symbols.
        """
        return self.numeric.ellipse(q, kind, i)

    def latex(self, expr: Any) -> str:
        r"""LaTeX of an expression, in Newton's dots: \ell_{1}, \theta_{1}, \dot{\theta}_{1}.

        Args:
            expr: A SymPy expression, matrix or equation, a `Split`, or several in a tuple.

        Raises:
            InputError: on other input.
        """
        return expressions.latex(expr)

    def formula(self, expr: Any) -> expressions.Formula:
        """The same expression, shown typeset by a notebook.

        Raises:
            InputError: as `latex` does.
        """
        return expressions.Formula(expr)

    def _repr_latex_(self) -> str:
        """LaTeX of the end point's position, for notebooks."""
        return expressions.in_dollars(rf"\mathbf{{r}}_P = {self.latex(self.position())}")


def check_chain(chain: Chain) -> Chain:
    """The chain itself.

    Raises:
        InputError: if it is none.
    """
    check_kind("the chain", chain, Chain, "a planar one, such as rbd.planar.Chain(2)")
    return chain


def _check_count(n: object) -> int:
    """A whole number of links.

    Raises:
        InputError: on other input, as 0, 2.5, True or 51.
    """
    whole = isinstance(n, int | np.integer | sympy.Integer) and not isinstance(n, bool)
    if not whole or not 1 <= int(n) <= MOST_LINKS:  # type: ignore[call-overload]
        raise InputError(f"n is {n!r:.80}; expected a whole number of links, 1 to {MOST_LINKS}, as Chain(2).")
    return int(n)  # type: ignore[call-overload]


def _check_lengths(n: int, lengths: object) -> tuple[sympy.Expr, ...]:
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
    """A positive number, exactly as written; or an expression not known to be otherwise."""
    what = f"the length of link {k + 1}"
    if isinstance(length, sympy.Expr) and not length.is_number:
        moving = length.has(dynamicsymbols._t) or length.has(AppliedUndef)
        if moving or length.is_positive is False or length.is_real is False:
            raise InputError(f"{what} is {str(length):.80}; expected a positive expression that is constant in time.")
        return length
    number = expressions.real(length)
    if not SHORTEST <= number <= LONGEST:
        raise InputError(
            f"{what} is {str(length):.80}; expected a positive finite number [m], {SHORTEST:g} to {LONGEST:g}, or a symbol."
        )
    return length if isinstance(length, sympy.Expr) and not length.has(sympy.Float) else sympy.Rational(repr(number))
