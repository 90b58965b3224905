"""Round parts of shapes: balls, rims of cylinders, ellipsoids. Each knows its lowest point, and how that wanders over it.

All is in the axes of the body that carries the part. `up` is the unit normal of what is below it, as the body sees it; where
the body turns, `up` turns the other way at a rate that the caller knows, and the lowest point wanders over the body at

    ball:       p = c - r up                                   p' = -r up'
    rim:        p = c - r e,  e = u / |u|,  u = up - (up . a) a    p' = -r e'
    ellipsoid:  p = c - Q up / s,  s = sqrt(up . Q up)         p' = -Q up' / s + Q up (up . Q up') / s^3
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from rbd.arrays import Array

FLAT_M = 1e-7
"""A rim whose lowest point is less than this below its centre lies flat: all of it is as low."""
STEEP = 0.1
"""A rim that leans by more than this (sine) touches at its lowest point alone."""


class Round(Protocol):
    """A part of a shape that has one lowest point."""

    def lowest(self, up: Array) -> Array | None:
        """The lowest point, shape (3,) [m]; None where many are as low."""

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

    def lowest(self, up: Array) -> Array | None:
        """Straight below the centre."""
        return self.centre - self.radius * up

    def wander(self, up: Array, rate: Array) -> Array:
        """Against the turn of `up`."""
        return -self.radius * rate


@dataclass(frozen=True, eq=False)
class Rim:
    """The edge of a cylinder's or cone's flat end.

    Attributes:
        centre: Shape (3,) [m].
        axis: Unit vector, shape (3,).
        radius: [m].
        corners: Which of the shape's vertices stand on it.
    """

    centre: Array
    axis: Array
    radius: float
    corners: slice

    def lowest(self, up: Array) -> Array | None:
        """As far down in the rim's plane as it goes; None where the rim lies flat."""
        u = up - float(up @ self.axis) * self.axis
        length = float(np.linalg.norm(u))
        return None if self.radius * length < FLAT_M else self.centre - (self.radius / length) * u

    def wander(self, up: Array, rate: Array) -> Array:
        """Along the rim; fast where it lies nearly flat, as a coin does that comes to rest."""
        u = up - float(up @ self.axis) * self.axis
        length = float(np.linalg.norm(u))
        if self.radius * length < FLAT_M:
            return np.zeros(3)
        du = rate - float(rate @ self.axis) * self.axis
        e = u / length
        return -self.radius * (du - e * float(e @ du)) / length

    def stands(self, up: Array) -> bool:
        """Whether it leans so much that only its lowest point can touch."""
        return 1.0 - float(up @ self.axis) ** 2 > STEEP**2


@dataclass(frozen=True, eq=False)
class Oval:
    """An ellipsoid.

    Attributes:
        centre: Shape (3,) [m].
        Q: R diag(radii)^2 R^T, shape (3, 3) [m2].
    """

    centre: Array
    Q: Array

    def lowest(self, up: Array) -> Array | None:
        """Where the tangent plane is level."""
        down = self.Q @ up
        return self.centre - down / np.sqrt(up @ down)

    def wander(self, up: Array, rate: Array) -> Array:
        """The derivative of `lowest`."""
        down, s = self.Q @ up, float(np.sqrt(up @ self.Q @ up))
        return -(self.Q @ rate) / s + down * float(down @ rate) / s**3
