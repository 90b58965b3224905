"""Position, velocity, acceleration, jerk of a chain's joints in symbols, and their Jacobians.

Everything is a sum over segments, r = sum_k ell_k (cos phi_k, sin phi_k), so one segment is differentiated and the others
are like it: a term never grows with the number of links, and every power of a rate stays around its own bracket,

    a = -sum_k ell_k [ phi_k'' (sin, -cos)(phi_k) + phi_k'^2 (cos, sin)(phi_k) ].

Source: [Duarte2021], "Differential kinematics". Its printed acceleration of two links reads th1' + th2'^2 where the square of
the sum, (th1' + th2')^2, belongs.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np
import sympy

from rbd.errors import InputError
from rbd.planar.angles import Symbols, to_segments

if TYPE_CHECKING:
    from rbd.planar.chain import Chain

MOST_MINORS = 6
"""Links up to which a determinant is written in sines of angles between links."""


def check_joint(chain: Chain, i: object, *, first: int = 0) -> int:
    """A joint's number: 0 is the base, n the end point, which None is too.

    Raises:
        InputError: if it is none of first..n.
    """
    if i is None:
        return chain.n
    whole = isinstance(i, int | np.integer | sympy.Integer) and not isinstance(i, bool)
    if not whole or not first <= int(i) <= chain.n:  # type: ignore[call-overload]
        base = " (0 is the base)" if first == 0 else ""
        raise InputError(f"there is no joint {i!r:.80}; expected {first} to {chain.n}{base}, or None for the end point.")
    return int(i)  # type: ignore[call-overload]


@lru_cache(maxsize=8)
def _unit(order: int, turned: bool) -> tuple[Symbols, tuple[sympy.Expr, ...]]:
    """Derivative of the unit vector of a segment, or of that vector turned by 90 degrees, in symbols to be replaced.

    (cos, sin)(phi(t)) is differentiated `order` times and its rates collected beside the sine and the cosine.
    """
    t = sympy.Symbol("t")
    phi = sympy.Function("phi")(t)
    names = sympy.symbols("phi_0:4")
    vector = sympy.Matrix([-sympy.sin(phi), sympy.cos(phi)] if turned else [sympy.cos(phi), sympy.sin(phi)]).diff(t, order)
    flat = vector.xreplace({phi.diff(t, k): names[k] for k in range(3, 0, -1)}).xreplace({phi: names[0]})
    sides = [sympy.cos(names[0]), sympy.sin(names[0])]
    return flat.applyfunc(lambda x: sympy.collect(sympy.expand(x), sides)).as_immutable(), names


def segment_vectors(chain: Chain, order: int, *, turned: bool = False) -> list[Symbols]:
    """What every segment adds: the `order`-th time derivative of ell_k (cos, sin)(phi_k), one (2, 1) per link.

    Turned, of ell_k (-sin, cos)(phi_k), its derivative by phi_k.
    """
    unit, names = _unit(order, turned)
    out = []
    for length, phi in zip(chain.lengths, chain.segment_angles, strict=True):
        rates = [phi.diff(chain.t, k) if k else phi for k in range(order + 1)]
        out.append(length * unit.xreplace(dict(zip(names, rates, strict=False))))
    return out


def total(vectors: list[Symbols]) -> Symbols:
    """Sum of vectors (2, 1), the zero vector of none: sums are made at once, as SymPy's `+` copies what it has."""
    return sympy.ImmutableMatrix([sympy.Add(*(vector[axis] for vector in vectors)) for axis in range(2)])


def motion(chain: Chain, i: int | None, order: int) -> Symbols:
    """Position of joint i (order 0), velocity (1), acceleration (2) or jerk (3), shape (2, 1) [m, m/s, ...].

    Raises:
        InputError: if i is none of 0..n.
    """
    return total(segment_vectors(chain, order)[: check_joint(chain, i)])


def jacobian(chain: Chain, i: int | None, order: int = 0) -> Symbols:
    """Jacobian of joint i (order 0) or its first or second time derivative, shape (2, n).

    Column j is sum_k A_kj ell_k (-sin, cos)(phi_k), as phi = A q + b.

    Raises:
        InputError: if i is none of 0..n.
    """
    last = check_joint(chain, i)
    turned = segment_vectors(chain, order, turned=True)
    moved_by, _ = to_segments(chain.n, chain.angles)
    columns = [total([turned[k] for k in range(last) if moved_by[k, j]]) for j in range(chain.n)]
    return sympy.ImmutableMatrix(sympy.Matrix.hstack(*columns))


def by_jacobian(chain: Chain, i: int | None, order: int) -> Symbols:
    """Velocity J qd, acceleration Jd qd + J qdd, or jerk Jdd qd + 2 Jd qdd + J qddd of joint i, shape (2, 1).

    Leibniz's rule for the derivatives of J qd.

    Raises:
        InputError: if i is none of 0..n.
    """
    rates = [chain.qd, chain.qdd, chain.qddd]
    terms = []
    for k in range(order):
        terms.append(sympy.binomial(order - 1, k) * jacobian(chain, i, k) * rates[order - 1 - k])
    return total(terms)


def determinant(chain: Chain) -> sympy.Expr:
    """The determinant of J for two links, det(J J^T) of more, det(J^T J) of one; zero where the chain is singular.

    A 2 x 2 minor of columns i < j is sum ell_k ell_l sin(phi_l - phi_k), over the pairs of a link k that joint i moves and a
    link l that joint j moves; pairs that both joints move cancel. By Cauchy and Binet det(J J^T) is the sum of their squares.
    Their number grows with n^4; beyond 6 links it is left as |J_x|^2 |J_y|^2 - (J_x . J_y)^2, the rows of J.
    """
    if chain.n == 1:
        return chain.lengths[0] ** 2
    if chain.n > MOST_MINORS:
        J = jacobian(chain, None)
        xx, yy, xy = (sympy.Add(*(J[a, j] * J[b, j] for j in range(chain.n))) for a, b in ((0, 0), (1, 1), (0, 1)))
        return xx * yy - xy**2
    minors = [_minor(chain, i, j) for i, j in combinations(range(chain.n), 2)]
    return minors[0] if chain.n == 2 else sympy.Add(*(minor**2 for minor in minors))


def _minor(chain: Chain, i: int, j: int) -> sympy.Expr:
    moved_by, _ = to_segments(chain.n, chain.angles)
    phi, ell = chain.segment_angles, chain.lengths
    first = [k for k in range(chain.n) if moved_by[k, i] and not moved_by[k, j]]
    second = [k for k in range(chain.n) if moved_by[k, j]]
    return sympy.Add(*(ell[k] * ell[m] * sympy.sin(phi[m] - phi[k]) for k in first for m in second))


def singular_configurations(chain: Chain) -> tuple[sympy.Eq, ...]:
    """sin(phi_{k+1} - phi_k) = 0 for every neighbouring pair: all links on one line, stretched or folded.

    J = [ell_k (-sin, cos)(phi_k)] A with A invertible, so its rank is that of the segments' directions.
    """
    phi = chain.segment_angles
    return tuple(sympy.Eq(sympy.sin(phi[k + 1] - phi[k]), 0) for k in range(chain.n - 1))
