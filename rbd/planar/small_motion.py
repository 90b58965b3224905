"""Small motion of a planar chain about a posture: M x'' + K x = 0, its frequencies and shapes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
import sympy as sp

from rbd.arrays import Array
from rbd.displayed import Displayed
from rbd.errors import InputError, SingularInertia
from rbd.planar.bodies import constant, refuse_symbols, symbols_of
from rbd.planar.chain import Chain

_SINGULAR = "M is singular at this posture: a link turns without moving any mass. Give it inertia, or bodies='rods'."


@dataclass(frozen=True, eq=False)
class Modes(Displayed):
    """Modes of small motion: x(t) = shape cos(w t + phase), all angles together.

    Attributes:
        squared: w^2 of each mode [rad2/s2], ascending where they are numbers. Below zero the posture is unstable: the mode
            grows as exp(sqrt(-w^2) t).
        shapes: One a column, shape (n, n) [rad], its largest entry 1 (in symbols the first); x^T M y = 0 between two of them.

    Example:
        >>> double = rbd.planar.dynamics(rbd.planar.Chain(2, lengths=[1, 1], angles="vertical"), bodies="points", masses=[1, 1])
        >>> modes = double.subs({"g": 9.81}).linearised().modes()
        >>> modes.frequencies.round(4), modes.shapes.round(4)
        (array([0.3815, 0.9211]), array([[ 0.7071, -0.7071],
               [ 1.    ,  1.    ]]))
    """

    squared: tuple[sp.Expr, ...] | Array
    shapes: sp.MatrixBase | Array

    @property
    def frequencies(self) -> Array:
        """Oscillations per second, w / (2 pi) [Hz], shape (n,); NaN for modes that grow.

        Raises:
            InputError: naming the symbols that are left.
        """
        refuse_symbols(symbols_of(sp.sympify(tuple(self.squared))), "a frequency in hertz")
        squared = np.array([float(x) for x in self.squared])
        return np.where(squared >= 0.0, np.sqrt(np.abs(squared)), np.nan) / (2.0 * np.pi)


@dataclass(frozen=True, eq=False)
class LinearisedChain(Displayed):
    """Small motion about a posture, `M x'' + K x = 0` for x = q - at, with constant forces that keep the posture.

    Attributes:
        at: The posture q, shape (n, 1) [rad].
        M: Inertia there, shape (n, n) [kg m2].
        K: Stiffness d2V/dq2 there, shape (n, n) [N m/rad].
        holding: g(at), the static forces, shape (n, 1) [N m]; zero at an equilibrium.

    Example:
        >>> double = rbd.planar.dynamics(rbd.planar.Chain(2, lengths=[1, 1], angles="vertical"), bodies="points", masses=[1, 1])
        >>> small = double.linearised()
        >>> small.M, small.K
        (Matrix([
        [2, 1],
        [1, 1]]), Matrix([
        [2*g, 0],
        [  0, g]]))
    """

    at: sp.MatrixBase
    M: sp.MatrixBase
    K: sp.MatrixBase
    holding: sp.MatrixBase

    def modes(self) -> Modes:
        """Its modes: det(K - w^2 M) = 0. In symbols for one and two links, else in numbers.

        Raises:
            InputError: symbols left in a chain of more than two links; it names them.
            SingularInertia: M is not positive definite there.
        """
        left = symbols_of([*self.M, *self.K])
        n = self.M.rows
        if not left:
            M, K = (np.array(x.evalf(17), dtype=float) for x in (self.M, self.K))
            try:
                squared, shapes = scipy.linalg.eigh(K, M)
            except np.linalg.LinAlgError:
                raise SingularInertia(_SINGULAR) from None
            return Modes(squared, shapes / shapes[np.abs(shapes).argmax(axis=0), np.arange(n)])
        if n > 2:
            refuse_symbols(left, f"a chain of {n} links, whose modes are roots of a polynomial of degree {n},")
        if self.M.det() == 0:
            raise SingularInertia(_SINGULAR)
        if n == 1:
            return Modes((sp.simplify(self.K[0] / self.M[0]),), sp.ones(1, 1))
        return self._two()

    def _two(self) -> Modes:
        """The two roots of a quadratic, the smaller first."""
        M, K = self.M, self.K
        if M[0, 1] == 0 == K[0, 1]:
            return Modes((sp.simplify(K[0, 0] / M[0, 0]), sp.simplify(K[1, 1] / M[1, 1])), sp.eye(2))
        a, c = M.det(), K.det()
        b = K[0, 0] * M[1, 1] + K[1, 1] * M[0, 0] - 2 * K[0, 1] * M[0, 1]
        # factor, not simplify: a hundred times as fast, and roots of squares are taken.
        half, inside = sp.factor(b / (2 * a)), sp.factor((b**2 - 4 * a * c) / (4 * a**2))
        if inside == 0:  # K = w^2 M: every shape is one
            return Modes((sp.factor_terms(half),) * 2, sp.eye(2))
        root = sp.sqrt(inside)
        squared = tuple(sp.factor_terms(half + sign * root) for sign in (-1, 1))
        shapes = [sp.Matrix(self._shape(half, inside, sign * root)) for sign in (-1, 1)]
        return Modes(squared, sp.ImmutableMatrix(sp.Matrix.hstack(*shapes)))

    def _shape(self, half: sp.Expr, inside: sp.Expr, root: sp.Expr) -> tuple[sp.Expr, sp.Expr]:
        """The null vector of K - w^2 M, where w^2 = half + root and root^2 = inside; its first entry that is not zero is 1."""
        for k in (0, 1):
            # x + y ratio = 0, both of them (u + v root): no root is left below the line.
            (u, v), (c, d) = ((self.K[k, j] - half * self.M[k, j], -self.M[k, j]) for j in (0, 1))
            below = sp.factor(c**2 - d**2 * inside)
            if below != 0:
                rational, irrational = (sp.factor(e / below) for e in (d * v * inside - u * c, u * d - v * c))
                return sp.Integer(1), sp.factor_terms(rational + irrational * root)
            x, y = sp.simplify(u + v * root), sp.simplify(c + d * root)
            if y != 0:
                return sp.Integer(1), sp.simplify(-x / y)
            if x != 0:
                break
        return sp.Integer(0), sp.Integer(1)


def linearise(chain: Chain, M: sp.MatrixBase, g: sp.MatrixBase, at: Iterable[Any] | None) -> LinearisedChain:
    """The linear equations of small motion about a posture at rest.

    Args:
        chain: The chain.
        M: Its inertia, shape (n, n) [kg m2].
        g: Moments that balance gravity, shape (n, 1) [N m].
        at: q, n angles [rad], numbers or expressions; None for the chain hanging down.

    Raises:
        InputError: not n angles.
    """
    if at is None:
        down = sp.Matrix([-sp.pi / 2 - psi.subs(dict.fromkeys(chain.q, 0)) for psi in chain.segment_angles])
        posture = chain.segment_angles.jacobian(chain.q).LUsolve(down)
    else:
        if isinstance(at, str) or not np.iterable(at) or len(given := list(at)) != chain.n:
            raise InputError(f"the posture is {at!r:.80}; expected {chain.n} angles [rad], one a link.")
        posture = sp.Matrix([constant(f"angle {i + 1} of the posture", x, chain.t) for i, x in enumerate(given)])
    there = dict(zip(chain.q, posture, strict=True))
    stiffness = g.jacobian(chain.q)
    return LinearisedChain(*(sp.ImmutableMatrix(x) for x in (posture, M.subs(there), stiffness.subs(there), g.subs(there))))
