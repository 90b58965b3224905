"""Round parts of shapes: balls, rims of cylinders and cones, ellipsoids.

A round part gives its lowest point. `up` is the unit normal of the surface below, in the body's axes; as the body turns, `up`
turns the other way at a rate that the caller gives, and the lowest point moves over the body at

    ball:       p = c - r up                                   p' = -r up'
    rim:        p = c - r e,  e = u / |u|,  u = up - (up . a) a    p' = -r e'
    ellipsoid:  p = c - Q up / s,  s = sqrt(up . Q up)         p' = -Q up' / s + Q up (up . Q up') / s^3
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from rbd.arrays import Array

LEVEL_M = 1e-7
"""A rim whose lowest point is less than this below its centre is flat: all its points are equally low."""
STEEP = 0.1
"""A rim inclined by more than this (sine) touches only at its lowest point."""


class Round(Protocol):
    """A part of a shape that has one lowest point."""

    def lowest(self, up: Array) -> Array:
        """The lowest point, shape (3,) [m]; NaN where many are equally low."""

    def wander(self, up: Array, rate: Array) -> Array:
        """How fast the lowest point moves over the body while `up` changes at `rate` [1/s], shape (3,) [m/s]."""


@dataclass(frozen=True, eq=False)
class Ball:
    """A ball.

    Attributes:
        centre: Shape (3,) [m].
        radius: [m].
    """

    centre: Array
    radius: float

    def lowest(self, up: Array) -> Array:
        """Straight below the centre."""
        return self.centre - self.radius * up

    def wander(self, up: Array, rate: Array) -> Array:
        """Opposite to the rate of `up`."""
        return -self.radius * rate


@dataclass(frozen=True, eq=False)
class Rim:
    """The edge of a cylinder's or cone's flat end.

    Attributes:
        centre: Shape (3,) [m].
        axis: Unit vector, shape (3,).
        radius: [m].
        first: Number of the first of the shape's vertices that are on it.
    """

    centre: Array
    axis: Array
    radius: float
    first: int

    def lowest(self, up: Array) -> Array:
        """The lowest point in the rim's plane; NaN where the rim is flat."""
        u, length = self._towards(up)
        return self.centre - (self.radius / length) * u

    def wander(self, up: Array, rate: Array) -> Array:
        """Along the rim; fast where it is nearly flat, as for a coin that comes to rest; zero where it is flat."""
        u, length = self._towards(up)
        if np.isnan(length):
            return np.zeros(3)
        du, e = rate - (rate @ self.axis) * self.axis, u / length
        return np.asarray(-self.radius * (du - e * (e @ du)) / length)

    def _towards(self, up: Array) -> tuple[Array, float]:
        """(the part of `up` in the rim's plane, its length: NaN where the rim is flat)."""
        u = up - (up @ self.axis) * self.axis
        length = float(np.sqrt(u @ u))
        return u, np.nan if self.radius * length < LEVEL_M else length

    def stands(self, up: Array) -> bool:
        """Whether it is inclined so much that only its lowest point can touch."""
        return bool(1.0 - (up @ self.axis) ** 2 > STEEP**2)


@dataclass(frozen=True, eq=False)
class Oval:
    """An ellipsoid.

    Attributes:
        centre: Shape (3,) [m].
        Q: R diag(radii)^2 R^T, shape (3, 3) [m2].
    """

    centre: Array
    Q: Array

    def lowest(self, up: Array) -> Array:
        """The point with a horizontal tangent plane."""
        down, s = self._down(up)
        return self.centre - down / s

    def wander(self, up: Array, rate: Array) -> Array:
        """The derivative of `lowest`."""
        down, s = self._down(up)
        return np.asarray(-self.Q @ rate / s + down * (down @ rate) / s**3)

    def _down(self, up: Array) -> tuple[Array, float]:
        """(Q up, s)."""
        down = self.Q @ up
        return down, float(np.sqrt(up @ down))
