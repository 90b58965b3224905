"""Three ways to measure the angles of a planar chain, and the maps between them.

Every way is affine in the absolute angles: psi = A q + b, where psi_k is the angle of segment k from x, counterclockwise.

====================  =======================================================  ======================  ============
name                  theta_i is measured                                      A                       b
====================  =======================================================  ======================  ============
"joint"               from the previous link (the first one from x)            lower triangle of ones  0
"segment"             from x                                                   identity                0
"vertical"            from the downward vertical; zero hangs                   identity                -pi/2
====================  =======================================================  ======================  ============

Source: [Duarte2021], "Joint and segment angles" and problems 4 and 5.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import sympy

from rbd.arrays import Array, as_array, as_finite, check_finite, lazy
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.errors.inputs import check_choice

JOINT, SEGMENT, VERTICAL = "joint", "segment", "vertical"
CONVENTIONS = (JOINT, SEGMENT, VERTICAL)
Symbols: TypeAlias = sympy.MatrixBase


def check_convention(angles: object) -> str:
    """One of the three conventions.

    Raises:
        InputError: on any other, with the nearest one.
    """
    return check_choice("the way to measure angles", angles, CONVENTIONS)


def to_segments(n: int, angles: str) -> tuple[Symbols, Symbols]:
    """A (n, n) and b (n, 1) of psi = A q + b, as exact numbers."""
    matrix = sympy.Matrix([[int(i <= k) for i in range(n)] for k in range(n)]) if angles == JOINT else sympy.eye(n)
    offset = sympy.ones(n, 1) * (-sympy.pi / 2 if angles == VERTICAL else 0)
    return matrix, offset


def _from_segments(n: int, angles: str) -> Symbols:
    """The inverse of A: differences of neighbours, or the identity."""
    if angles != JOINT:
        return sympy.eye(n)
    return sympy.Matrix([[int(i == k) - int(i == k - 1) for i in range(n)] for k in range(n)])


@dataclass(frozen=True)
class AngleMap(Displayed):
    """The map between two ways to measure a chain's angles: q_to = matrix q_from + offset, without wrapping.

    Attributes:
        source: The convention of the input.
        to: The convention of the output.
        matrix: Shape (n, n), whole numbers.
        offset: Shape (n, 1) [rad], multiples of pi/2.

    Example:
        >>> chain = rbd.planar.Chain(2)  # angles from the previous link
        >>> to_x = chain.angle_map("segment")
        >>> to_x.matrix, to_x.rates([1.0, -1.0])
        (Matrix([
        [1, 0],
        [1, 1]]), array([1., 0.]))
        >>> to_x([0.5, -0.5])
        array([0.5, 0. ])
    """

    source: str
    to: str
    matrix: Symbols
    offset: Symbols

    def __call__(self, values: Any) -> Any:
        """The angles in the other convention [rad], in the shape given.

        Args:
            values: Angles, shape (n,) or (samples, n) [rad]; or n expressions in a SymPy matrix.

        Raises:
            InputError: on another shape, or numbers that are not finite.
        """
        if isinstance(values, sympy.MatrixBase):
            return self.matrix * self._column(values) + self.offset
        return self.rates(values) + self.floats[1]

    def rates(self, values: Any) -> Any:
        """Angular velocities in the other convention, or accelerations, or jerks: the offset drops out.

        Args:
            values: Rates, shape (n,) or (samples, n); or n expressions in a SymPy matrix.

        Raises:
            InputError: on another shape, or numbers that are not finite.
        """
        if isinstance(values, sympy.MatrixBase):
            return self.matrix * self._column(values)
        return samples("angles", values, self.matrix.rows) @ self.floats[0].T

    def forces(self, values: Any) -> Array:
        """Generalised forces in the other convention [N m], A^-T tau: their power is the same.

        Args:
            values: Forces of the angles given, as motor torques, shape (n,) or (samples, n).

        Raises:
            InputError: on another shape, or numbers that are not finite.
        """
        return samples("tau", values, self.matrix.rows) @ self.inverse.floats[0]

    @lazy
    def floats(self) -> tuple[Array, Array]:
        """The matrix (n, n) and the offset (n,) [rad] as arrays."""
        return np.array(self.matrix, dtype=float), np.array(self.offset, dtype=float).ravel()

    @lazy
    def inverse(self) -> AngleMap:
        """The map back."""
        return angle_map(self.matrix.rows, self.to, self.source)

    def _column(self, values: Symbols) -> Symbols:
        n = self.matrix.rows
        if values.shape not in ((n, 1), (1, n)):
            raise InputError(f"angles came as a matrix of shape {values.shape}; expected one per link, ({n}, 1).")
        return values.reshape(n, 1)


def angle_map(n: int, source: str, to: str) -> AngleMap:
    """The map from one convention to another, for n links.

    Raises:
        InputError: if `to` is none of "joint", "segment", "vertical".
    """
    to = check_convention(to)
    forward, shift = to_segments(n, source)
    _, back = to_segments(n, to)
    inverse = _from_segments(n, to)
    return AngleMap(source, to, (inverse * forward).as_immutable(), (inverse * (shift - back)).as_immutable())


def samples(what: str, values: object, n: int) -> Array:
    """Finite numbers of shape (n,) or (samples, n), as floats; not copied if they are already.

    Raises:
        InputError: on other input.
    """
    given = values if type(values) is np.ndarray and values.dtype == float else as_array(what, values)
    if given.ndim not in (1, 2) or given.shape[-1] != n:
        raise InputError(f"{what} came with shape {given.shape}; expected one number per link, ({n},), or (samples, {n}).")
    check_finite(what, given.ravel())
    return given


def units(angle: Array) -> Array:
    """(cos, sin) of angles, shape (..., 2)."""
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def wrapped(q: Array) -> Array:
    """Angles brought to (-pi, pi] by full turns [rad]; those in it are unchanged."""
    turns = np.ceil((q - np.pi) / (2.0 * np.pi))
    return np.where((q > -np.pi) & (q <= np.pi), q, q - 2.0 * np.pi * turns)


def nearest_turn(q: Array, start: Array) -> Array:
    """Angles moved by full turns to within half a turn of others [rad]."""
    return q - 2.0 * np.pi * np.round((q - start) / (2.0 * np.pi))


def plain(what: str, value: object, shape: tuple[int | str, ...], meaning: str = "") -> Array:
    """Finite numbers as a new float array; exact numbers of SymPy, alone, in lists or as a column, are numbers too.

    Raises:
        InputError: on other input.
    """
    if isinstance(value, sympy.MatrixBase) and 1 in value.shape:
        value = list(value)
    if isinstance(value, list | tuple) and any(isinstance(x, sympy.Expr) for x in value):
        value = [float(x) if isinstance(x, sympy.Expr) and x.is_number and x.is_finite and x.is_real else x for x in value]
    return as_finite(what, value, shape, meaning=meaning)
