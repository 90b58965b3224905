"""Round parts of shapes: balls, rims of cylinders and cones, ellipsoids; one of each, or many in an array.

A round part gives its lowest point. `up` is the unit normal of the surface below, in the body's axes; as the body turns, `up`
turns the other way at a rate that the caller gives, and the lowest point moves over the body at

    ball:       p = c - r up                                   p' = -r up'
    rim:        p = c - r e,  e = u / |u|,  u = up - (up . a) a    p' = -r e'
    ellipsoid:  p = c - Q up / s,  s = sqrt(up . Q up)         p' = -Q up' / s + Q up (up . Q up') / s^3

The fields of one part are vectors and numbers, those of n stacked parts have n rows; `up` and `rate` have shape (3,) or (n, 3).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
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


def stacked(parts: Sequence[Round]) -> Round:
    """Several parts of one kind as one, each field an array with a row for each."""
    kind = type(parts[0])
    return kind(*(np.array([np.atleast_1d(getattr(part, f.name)) for part in parts]) for f in fields(kind)))  # type: ignore[arg-type]


@dataclass(frozen=True, eq=False)
class Ball:
    """A ball.

    Attributes:
        centre: Shape (3,) [m].
        radius: [m].
    """

    centre: Array
    radius: float | Array

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
    radius: float | Array
    first: int

    def lowest(self, up: Array) -> Array:
        """The lowest point in the rim's plane; NaN where the rim is flat."""
        u, length = self._towards(up)
        return self.centre - (self.radius / length) * u

    def wander(self, up: Array, rate: Array) -> Array:
        """Along the rim; fast where it is nearly flat, as for a coin that comes to rest; zero where it is flat."""
        u, length = self._towards(up)
        du = rate - np.vecdot(rate, self.axis)[..., None] * self.axis
        e = u / length
        moved = -self.radius * (du - e * np.vecdot(e, du)[..., None]) / length
        return np.where(np.isnan(length), 0.0, moved)

    def _towards(self, up: Array) -> tuple[Array, Array]:
        """(the part of `up` in the rim's plane, its length: NaN where the rim is flat)."""
        u = up - np.vecdot(up, self.axis)[..., None] * self.axis
        length = np.sqrt(np.vecdot(u, u))[..., None]
        return u, np.where(self.radius * length < LEVEL_M, np.nan, length)

    def stands(self, up: Array) -> Array:
        """Whether it is inclined so much that only its lowest point can touch."""
        return np.asarray(1.0 - np.vecdot(up, self.axis) ** 2 > STEEP**2)


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
        return -(self.Q @ rate[..., None])[..., 0] / s + down * np.vecdot(down, rate)[..., None] / s**3

    def _down(self, up: Array) -> tuple[Array, Array]:
        """(Q up, s)."""
        down = (self.Q @ up[..., None])[..., 0]
        return down, np.sqrt(np.vecdot(up, down))[..., None]
