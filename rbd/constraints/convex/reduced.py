"""Contact manifolds reduced to a few points: those that carry, and those that the body would tip over."""

from __future__ import annotations

import math

import numpy as np

from rbd.arrays import Array

LOWEST = 8
"""So many of the lowest points are always among those that are chosen: what touches is not lost for what does not."""
DIRECTIONS = 8
"""Seen from above, the farthest point in each of so many directions is chosen too."""
MOST_POINTS = LOWEST + DIRECTIONS
TIPS = 0.1
"""A point at height h counts as nearer by h over this [rad]: what the body would have to tip far to come down on."""

_angles = 2.0 * np.pi * (np.arange(DIRECTIONS) + 0.5) / DIRECTIONS
_TOWARDS = np.vstack([np.cos(_angles), np.sin(_angles)])


def spread(points: Array, height: Array, up: Array) -> Array:
    """Numbers of the chosen among some points, in ascending order; at most `MOST_POINTS`.

    The answer is a matter of where the points are now, not of what was chosen before, and changes only far from where the
    body touches.

    Args:
        points: Shape (n, 3) [m].
        height: Above what they may touch, shape (n,) [m].
        up: Unit vector away from it, shape (3,).
    """
    if len(points) <= MOST_POINTS:
        return np.arange(len(points))
    lowest = np.argsort(height, kind="stable")[:LOWEST]
    around = farthest(points.dot(across(up).T), height - height[lowest[0]])
    return np.array(sorted({*lowest.tolist(), *around.tolist()}))  # a third of the time of np.union1d


def farthest(flat: Array, height: Array) -> Array:
    """Number of the farthest point in each direction, less its height over `TIPS`, shape (DIRECTIONS,).

    Args:
        flat: Points as seen from above, shape (n, 2) [m].
        height: Shape (n,) [m].
    """
    return np.asarray((flat @ _TOWARDS - height[:, None] / TIPS).argmax(axis=0))


def across(n: Array) -> Array:
    """Two unit vectors across n, shape (2, 3), in a right-handed order."""
    x, y, z = n.tolist()
    if abs(z) > 0.7:
        s = math.hypot(z, x)
        a, b, c = z / s, 0.0, -x / s
    else:
        s = math.hypot(x, y)
        a, b, c = -y / s, x / s, 0.0
    return np.array([[a, b, c], [y * c - z * b, z * a - x * c, x * b - y * a]])
