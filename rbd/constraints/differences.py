"""Derivatives of a given function along curves on the manifold of configurations, by differences of sixth order.

The step is chosen by what the differences themselves tell: those of fourth and of sixth order, on the same seven nodes, agree
where the function is smooth over the step, and the step shrinks until they do. Noise, a jump or a kink never lets them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from rbd.arrays import Array

STEP = 0.01
"""First step tried on the tangent space [m, rad]: there rounding and truncation of a function of unit length balance."""

SHRINK, TRIES = 0.25, 9
FIRST_AGREED, SECOND_AGREED = 3e-8, 1e-7
"""Fourth and sixth order are off by h^4 and h^6: where they agree to this, relative, the sixth is right to 1e-11 and 5e-11."""

ROUGH = 1e-6
"""Where they agree no better than to this, relative, the function has no derivative that differences could find."""

_NODES = (-3.0, -2.0, -1.0, 1.0, 2.0, 3.0)
_FIRST = np.array([-1.0, 9.0, -45.0, 45.0, -9.0, 1.0]) / 60.0
_FIRST_4 = np.array([0.0, 1.0, -8.0, 8.0, -1.0, 0.0]) / 12.0
_SECOND, _MIDDLE = np.array([2.0, -27.0, 270.0, 270.0, -27.0, 2.0]) / 180.0, -490.0 / 180.0
_SECOND_4, _MIDDLE_4 = np.array([0.0, -1.0, 16.0, 16.0, -1.0, 0.0]) / 12.0, -30.0 / 12.0


@dataclass(frozen=True, eq=False)
class Difference:
    """A derivative along a curve.

    Attributes:
        value: Shape (m,).
        gap: How far two orders of differences are apart, along the unit vector.
        scale: What that is measured against.
    """

    value: Array
    gap: float
    scale: float

    @property
    def apart(self) -> float:
        """The gap, relative."""
        return self.gap / self.scale


def jacobian(model: pin.Model, f: Callable[[Array], Array], q: Array, middle: Array) -> tuple[Array, float]:
    """(J, apart): f's derivatives by the coordinates of v, shape (m, nv), where `middle` is f(q)."""
    unit = np.eye(model.nv)
    found = [first_derivative(model, f, q, e, middle, tries=1) for e in unit]
    # What rounding leaves of a column of zeros is small against the others, and no reason to look closer.
    size = max([_size(c.value) for c in found if c.gap <= FIRST_AGREED * c.scale], default=0.0)
    found = [
        c if c.gap <= FIRST_AGREED * max(c.scale, size) else first_derivative(model, f, q, e, middle, size=size)
        for e, c in zip(unit, found, strict=True)
    ]
    size = max(_size(c.value) for c in found)
    return np.column_stack([c.value for c in found]), max(c.gap / max(c.scale, size) for c in found)


def first_derivative(
    model: pin.Model, f: Callable[[Array], Array], q: Array, v: Array, middle: Array, *, size: float = 0.0, tries: int = TRIES
) -> Difference:
    """d/dt of f(q (+) t v) at t = 0.

    Args:
        model: Whose manifold it is.
        f: Takes q, gives (m,).
        q: Where.
        v: Not zero.
        middle: f(q).
        size: Of f's derivatives along unit vectors, where that is known.
        tries: Most steps tried.
    """
    return _derivative(model, f, q, v, middle, _first, max(size, 1e-6), tries)


def second_derivative(
    model: pin.Model, f: Callable[[Array], Array], q: Array, v: Array, middle: Array, *, size: float
) -> Difference:
    """d2/dt2 of f(q (+) t v) at t = 0; arguments as of `first_derivative`."""
    return _derivative(model, f, q, v, middle, _second, max(size, 1e-4), TRIES)


_Rule = Callable[[Array, Array, float, float], tuple[Difference, float]]


def _derivative(
    model: pin.Model, f: Callable[[Array], Array], q: Array, v: Array, middle: Array, rule: _Rule, size: float, tries: int
) -> Difference:
    """The derivative along the unit vector of v, scaled back."""
    length = float(np.linalg.norm(v))
    best, h = Difference(np.full(middle.shape, np.nan), np.inf, 1.0), STEP
    for _ in range(tries):
        values = np.array([f(pin.integrate(model, q, (node * h / length) * v)) for node in _NODES])
        if np.isfinite(values).all():  # else the step left the function's domain
            found, agreed = rule(values, middle, h, size)
            if found.apart < best.apart:
                best = found
            if best.apart <= agreed:
                break
        h *= SHRINK
    return replace(best, value=best.value * (length if rule is _first else length**2))


def _first(values: Array, middle: Array, h: float, size: float) -> tuple[Difference, float]:
    first = _FIRST @ values / h
    scale = max(_size(first), _size(middle), size)
    # A kink at the middle leaves first differences alone and shows in the second, as 1/h.
    second, second_4 = _SECOND @ values + _MIDDLE * middle, _SECOND_4 @ values + _MIDDLE_4 * middle
    gap = max(_size(first - _FIRST_4 @ values / h), _size(second - second_4) / h)
    return Difference(first, gap, scale), FIRST_AGREED


def _second(values: Array, middle: Array, h: float, size: float) -> tuple[Difference, float]:
    second = (_SECOND @ values + _MIDDLE * middle) / h**2
    scale = max(_size(second), _size(_FIRST @ values) / h, _size(middle), size)
    return Difference(second, _size(second - (_SECOND_4 @ values + _MIDDLE_4 * middle) / h**2), scale), SECOND_AGREED


def _size(x: Array) -> float:
    return float(np.abs(x).max(initial=0.0))
