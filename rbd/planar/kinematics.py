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
from itertools import combinations
from typing import Any, Generic, TypeVar

import numpy as np
import sympy
from sympy.physics.mechanics import dynamicsymbols

from rbd.arrays import Array, lazy
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.planar import expressions
from rbd.planar.angles import JOINT, Symbols, to_segments

MOST_MINORS = 6
"""Links up to which a determinant is written in sines of angles between links."""
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


@dataclass(frozen=True, eq=False)
class Links:
    """Links hinged end to end, the first at the origin, in symbols.

    Attributes:
        lengths: ell_k [m].
        q: Their angles theta_k(t), shape (n, 1) [rad].
        angles: How they are measured; see `rbd.planar.angles`.
    """

    lengths: tuple[sympy.Expr, ...]
    q: Symbols
    angles: str

    @property
    def n(self) -> int:
        """Number of links."""
        return len(self.lengths)

    @lazy
    def moved_by(self) -> Symbols:
        """A of psi = A q + b, shape (n, n): which angles turn which link."""
        return to_segments(self.n, self.angles)[0]

    @lazy
    def psi(self) -> Symbols:
        """Angle of every link from x, psi = A q + b, shape (n, 1) [rad]."""
        matrix, offset = to_segments(self.n, self.angles)
        return (matrix * self.q + offset).as_immutable()

    def rate(self, order: int) -> Symbols:
        """The `order`-th time derivative of the angles q, shape (n, 1)."""
        return self.q.diff(dynamicsymbols._t, order)

    def segment_vectors(self, order: int, *, turned: bool = False) -> list[Symbols]:
        """What every link adds: the `order`-th time derivative of ell_k (cos, sin)(psi_k), one (2, 1) per link.

        Turned, of ell_k (-sin, cos)(psi_k), its derivative by psi_k.
        """
        unit, names = _unit(order, turned)
        out = []
        for length, psi in zip(self.lengths, self.psi, strict=True):
            rates = [psi.diff(dynamicsymbols._t, k) if k else psi for k in range(order + 1)]
            out.append(length * unit.xreplace(dict(zip(names, rates, strict=False))))
        return out

    def motion(self, i: int | None, order: int) -> Symbols:
        """Position of joint i (order 0), velocity (1), acceleration (2) or jerk (3), shape (2, 1) [m, m/s, ...].

        Raises:
            InputError: if i is not in 0..n; also below.
        """
        return _total(self.segment_vectors(order)[: check_joint(self.n, i)])

    def jacobian(self, i: int | None, order: int = 0) -> Symbols:
        """Jacobian of joint i (order 0) or its first or second time derivative, shape (2, n).

        Column j is sum_k A_kj ell_k (-sin, cos)(psi_k), as psi = A q + b.
        """
        last = check_joint(self.n, i)
        turned = self.segment_vectors(order, turned=True)
        columns = [_total([turned[k] for k in range(last) if self.moved_by[k, j]]) for j in range(self.n)]
        return sympy.ImmutableMatrix(sympy.Matrix.hstack(*columns))

    def by_jacobian(self, i: int | None, order: int) -> Symbols:
        """Velocity J qd, acceleration Jd qd + J qdd, or jerk Jdd qd + 2 Jd qdd + J qddd of joint i, shape (2, 1).

        Leibniz's rule for the derivatives of J qd.
        """
        terms = []
        for k in range(order):
            terms.append(sympy.binomial(order - 1, k) * self.jacobian(i, k) * self.rate(order - k))
        return _total(terms)

    def split(self, i: int | None) -> Split[Symbols]:
        """The acceleration of joint i in its three parts, in symbols [m/s^2]."""
        last, qd = check_joint(self.n, i), self.rate(1)
        turned_again = [-vector for vector in self.segment_vectors(0)[:last]]

        def second_derivative(j: int, k: int) -> Symbols:
            return _total([vector for m, vector in enumerate(turned_again) if self.moved_by[m, j] and self.moved_by[m, k]])

        return Split(
            tangential=self.jacobian(last) * self.rate(2),
            centripetal=_total([second_derivative(j, j) * qd[j] ** 2 for j in range(self.n)]),
            coriolis=_total([second_derivative(j, k) * (2 * qd[j] * qd[k]) for j, k in combinations(range(self.n), 2)]),
            angles=self.angles,
        )

    def determinant(self) -> sympy.Expr:
        """The determinant of J for two links, det(J J^T) of more, det(J^T J) of one; zero where the chain is singular.

        A 2 x 2 minor of columns i < j is sum ell_k ell_l sin(psi_l - psi_k), over the pairs of a link k that joint i moves and
        a link l that joint j moves; pairs that both joints move cancel. By Cauchy and Binet det(J J^T) is the sum of their
        squares. Their number grows with n^4; beyond 6 links it is left as |J_x|^2 |J_y|^2 - (J_x . J_y)^2, the rows of J.
        """
        if self.n == 1:
            return self.lengths[0] ** 2
        if self.n > MOST_MINORS:
            J = self.jacobian(None)
            xx, yy, xy = (sympy.Add(*(J[a, j] * J[b, j] for j in range(self.n))) for a, b in ((0, 0), (1, 1), (0, 1)))
            return xx * yy - xy**2
        minors = [self._minor(i, j) for i, j in combinations(range(self.n), 2)]
        return minors[0] if self.n == 2 else sympy.Add(*(minor**2 for minor in minors))

    def _minor(self, i: int, j: int) -> sympy.Expr:
        psi, ell, moved_by = self.psi, self.lengths, self.moved_by
        first = [k for k in range(self.n) if moved_by[k, i] and not moved_by[k, j]]
        second = [k for k in range(self.n) if moved_by[k, j]]
        return sympy.Add(*(ell[k] * ell[m] * sympy.sin(psi[m] - psi[k]) for k in first for m in second))

    def singular_configurations(self) -> tuple[sympy.Eq, ...]:
        """sin(psi_{k+1} - psi_k) = 0 for every neighbouring pair: all links on one line, stretched or folded.

        J = [ell_k (-sin, cos)(psi_k)] A with A invertible, so its rank is that of the segments' directions.
        """
        psi = self.psi
        return tuple(sympy.Eq(sympy.sin(psi[k + 1] - psi[k]), 0) for k in range(self.n - 1))


@lru_cache(maxsize=8)
def _unit(order: int, turned: bool) -> tuple[Symbols, tuple[sympy.Expr, ...]]:
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


def _total(vectors: list[Symbols]) -> Symbols:
    """Sum of vectors (2, 1), the zero vector if there are none: summed at once, as SymPy's `+` copies what it has."""
    return sympy.ImmutableMatrix([sympy.Add(*(vector[axis] for vector in vectors)) for axis in range(2)])


def jacobian(f: Any, x: Any) -> Symbols:
    """All first partial derivatives of a vector function: J[i, j] = d f_i / d x_j.

    Args:
        f: One expression, a list, a row or column matrix of them; or a Python function that returns one of these, called with
            the variables one by one.
        x: One variable, or several: symbols, functions of time (dynamicsymbols) or their derivatives. Time itself may be one.

    Returns:
        Shape (number of functions, number of variables), not simplified.

    Raises:
        InputError: on invalid or repeated variables, on objects that are not expressions, or a function that fails on symbols.

    Source: [Duarte2021], "Jacobian matrix" and problem 6.

    Example:
        >>> from sympy import sin
        >>> from sympy.abc import x, y
        >>> rbd.planar.jacobian([x**2 * y, 5 * x + sin(y)], [x, y])
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
