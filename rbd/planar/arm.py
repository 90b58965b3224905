"""A planar chain in numbers: what inverse kinematics needs of it, in floats and over many samples at once.

phi = A q + b are the angles of the links from x; r = sum_k ell_k (cos phi_k, sin phi_k) is the end point.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import sympy

from rbd.arrays import Array, as_array, check_finite
from rbd.errors import InputError
from rbd.planar.chain import Chain, check_chain

ROUND_OFF = 8 * float(np.finfo(float).eps)
"""A point this near an edge of what the chain can reach, relative to its length, is on it: the point itself is no better."""


@dataclass(frozen=True, eq=False)
class Arm:
    """Numbers of a chain.

    Attributes:
        lengths: Of the links [m], shape (n,).
        to_segment: A, shape (n, n), and
        offset: b [rad], shape (n,), of phi = A q + b.
        from_segment: The inverse of A.
        outer: The farthest that the end point gets from the base [m]: the sum of the lengths.
        inner: The nearest [m]: the longest link less all others, or zero.
    """

    lengths: Array
    to_segment: Array
    offset: Array
    from_segment: Array
    outer: float
    inner: float

    @property
    def n(self) -> int:
        """How many links."""
        return len(self.lengths)

    def segments(self, q: Array) -> Array:
        """Angles of the links from x, phi = A q + b [rad], shape (..., n)."""
        return q @ self.to_segment.T + self.offset

    def joints(self, phi: Array) -> Array:
        """The chain's own angles q, of those of the links [rad], shape (..., n)."""
        return (phi - self.offset) @ self.from_segment.T

    def end(self, q: Array) -> Array:
        """The end point [m], shape (..., 2)."""
        return self.lengths @ units(self.segments(q))

    def jacobian(self, q: Array) -> Array:
        """J of r' = J q' [m], shape (..., 2, n)."""
        e = units(self.segments(q)) * self.lengths[:, None]
        return np.stack([-e[..., 1], e[..., 0]], axis=-2) @ self.to_segment

    def jacobian_rate(self, q: Array, qd: Array) -> Array:
        """J' [m/s], shape (..., 2, n): a column ell_k (-sin, cos) turns at phi_k'."""
        e = units(self.segments(q)) * (self.lengths * (qd @ self.to_segment.T))[..., None]
        return -np.swapaxes(e, -1, -2) @ self.to_segment

    def jacobian_second_rate(self, q: Array, qd: Array, qdd: Array) -> Array:
        """J'' [m/s^2], shape (..., 2, n): a column becomes -ell_k (phi_k'' (cos, sin) + phi_k'^2 (-sin, cos))."""
        e = units(self.segments(q)) * self.lengths[:, None]
        turned = np.stack([-e[..., 1], e[..., 0]], axis=-1)
        rate, bend = (qd @ self.to_segment.T)[..., None], (qdd @ self.to_segment.T)[..., None]
        return -np.swapaxes(bend * e + rate**2 * turned, -1, -2) @ self.to_segment

    def distance(self, points: Array) -> Array:
        """How far points are from the nearest that the end point can get to [m], shape (...)."""
        r = np.hypot(points[..., 0], points[..., 1])
        return np.maximum(np.maximum(r - self.outer, self.inner - r), 0.0)

    def reachable(self, distance: Array, tolerance: float) -> Array:
        """Whether points at such distances count as within reach, shape (...)."""
        return distance <= max(tolerance, ROUND_OFF) * self.outer

    def nearest(self, points: Array, direction: Array) -> Array:
        """The nearest points within reach [m], shape (..., 2); of the base itself, the one in a direction [rad]."""
        r = np.hypot(points[..., 0], points[..., 1])
        inside = (r >= self.inner) & (r <= self.outer)
        away = np.where(r > 0.0, np.arctan2(points[..., 1], points[..., 0]), direction)
        return np.where(inside[..., None], points, np.clip(r, self.inner, self.outer)[..., None] * units(away))

    def beyond(self, target: Array) -> str:
        """Where an unreachable target lies, in words."""
        r = float(np.hypot(*target))
        if self.n == 1:
            side = "outside" if r > self.outer else "inside"
            return f"{side} the circle of radius {self.outer:g} m, all that one link reaches"
        if r > self.outer:
            return f"beyond {self.outer:g} m, where the chain is stretched out"
        return f"in the hole of radius {self.inner:g} m around the base, as one link is longer than all others together"


def arm_of(chain: Chain) -> Arm:
    """The numbers of a chain.

    Raises:
        InputError: if it is no chain, or a length is a symbol.
    """
    check_chain(chain)
    if not chain.is_numeric:
        raise InputError(
            f"the chain's lengths are symbols, {', '.join(map(str, chain.lengths))}; expected numbers: "
            f"Chain({chain.n}, lengths={[0.5] * min(chain.n, 3)}), or inverse_formulas for one and two links in symbols."
        )
    return _arm(chain)


@lru_cache(maxsize=64)
def _arm(chain: Chain) -> Arm:
    there = chain.angle_map("segment")
    back = np.linalg.inv(np.array(there.matrix, dtype=float))
    # Sums of the exact lengths: 0.1 + 0.2 - 0.3 is no hole.
    total, longest = sum(chain.lengths), max(chain.lengths, key=float)
    return Arm(
        np.array([float(length) for length in chain.lengths]),
        np.array(there.matrix, dtype=float),
        np.array(there.offset, dtype=float).ravel(),
        np.round(back),
        float(total),
        max(float(2 * longest - total), 0.0),
    )


def units(angle: Array) -> Array:
    """(cos, sin) of angles, shape (..., 2)."""
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def wrapped(q: Array) -> Array:
    """Angles brought to (-pi, pi] by full turns [rad]; those that are there already are not touched."""
    turns = np.ceil((q - np.pi) / (2.0 * np.pi))
    return np.where((q > -np.pi) & (q <= np.pi), q, q - 2.0 * np.pi * turns)


def beside(q: Array, start: Array) -> Array:
    """Angles moved by full turns to within half a turn of others [rad]."""
    return q - 2.0 * np.pi * np.round((q - start) / (2.0 * np.pi))


def plain(what: str, value: object) -> Array:
    """Finite numbers as a new float array; exact numbers of SymPy, alone, in lists or as a column, are numbers too.

    Raises:
        InputError: on anything else.
    """
    if isinstance(value, sympy.MatrixBase) and 1 in value.shape:
        value = list(value)
    if isinstance(value, list | tuple) and any(isinstance(x, sympy.Expr) for x in value):
        value = [float(x) if isinstance(x, sympy.Expr) and x.is_number and x.is_finite and x.is_real else x for x in value]
    out = as_array(what, value)
    check_finite(what, out.ravel())
    return out


def check_start(start: Sequence[float] | Array | None, n: int) -> Array | None:
    """A configuration to be near to, shape (n,) [rad], or None.

    Raises:
        InputError: if it is neither.
    """
    if start is None:
        return None
    q = plain("start", start)
    if q.shape != (n,):
        raise InputError(f"start has shape {q.shape}; expected one angle per link, ({n},) [rad].")
    return q
