"""Many points of a shape near a surface, reduced to a few: the loaded ones, and those over which the body would tip.

The choice depends only on the present positions, not on earlier choices, and changes only far from where the body touches.
"""

from __future__ import annotations

import math

import numpy as np

from rbd.arrays import Array

LOWEST = 8
"""When contact points are reduced to a few, this many of the lowest are always included, so that none in contact is dropped."""
DIRECTIONS = 8
"""Seen from above, the farthest point in each of so many directions is chosen too."""
MOST_POINTS = LOWEST + DIRECTIONS
TIPS = 0.1
"""A point at height h counts as nearer by h over this [rad]: points that touch only after a large tilt."""
_angles = 2.0 * np.pi * (np.arange(DIRECTIONS) + 0.5) / DIRECTIONS
_TOWARDS = np.column_stack([np.cos(_angles), np.sin(_angles)])


def spread(points: Array, height: Array, up: Array) -> Array:
    """Indices of the points chosen among many, in ascending order; at most `MOST_POINTS`.

    Args:
        points: Shape (n, 3) [m].
        height: Height above the surface, shape (n,) [m].
        up: Unit vector away from the surface, shape (3,).
    """
    if len(points) <= MOST_POINTS:
        return np.arange(len(points))
    return np.flatnonzero(spread_each(points.T, height, np.array([len(points)]), up[None]))


def spread_each(points: Array, height: Array, counts: Array, up: Array) -> Array:
    """Which points are chosen, of several groups of more than `MOST_POINTS` each, shape (n,).

    Args:
        points: One group after the other, shape (3, n) [m].
        height: Height above the surface, shape (n,) [m].
        counts: Number of points of each group, shape (g,).
        up: Unit vector away from the surface, in the axes of each group, shape (g, 3).
    """
    starts = np.cumsum(counts) - counts
    group = np.repeat(np.arange(len(counts)), counts)
    lowest = np.minimum.reduceat(height, starts)
    flat = np.add.reduce(across_each(up).take(group, axis=2) * points, axis=1)
    chosen = _lowest(height, starts, counts)
    away = _away(flat, height - lowest.take(group))
    most = np.maximum.reduceat(away, starts, axis=1).repeat(counts, axis=1)
    direction, at = (away == most).nonzero()
    key = group.take(at) + len(counts) * direction
    chosen[at[np.diff(key, prepend=-1) > 0]] = True  # of equal ones the first
    return chosen


def _lowest(height: Array, starts: Array, counts: Array) -> Array:
    """Which points are among the `LOWEST` of their group, of equal ones the first, shape (n,)."""
    column = np.arange(counts.max())
    inside = column < counts[:, None]
    table = np.append(height, np.inf)[np.where(inside, starts[:, None] + column, len(height))]
    last = np.partition(table, LOWEST - 1, axis=1)[:, LOWEST - 1, None]
    below, equal = table < last, table == last
    missing = LOWEST - np.count_nonzero(below, axis=1)[:, None]
    return np.asarray((below | (equal & (np.cumsum(equal, axis=1) <= missing)))[inside])


def farthest(flat: Array, height: Array) -> Array:
    """Index of the farthest point in each direction, less its height over `TIPS`, shape (DIRECTIONS,).

    Args:
        flat: Points as seen from above, shape (2, n) [m].
        height: Shape (n,) [m].
    """
    return np.asarray(_away(flat, height).argmax(axis=1))


def _away(flat: Array, height: Array) -> Array:
    """How far each point is in each direction, less its height over `TIPS`, shape (DIRECTIONS, n)."""
    return np.asarray(_TOWARDS @ flat - height / TIPS)


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


def across_each(n: Array) -> Array:
    """`across` of each row of n, shape (2, 3, g)."""
    x, y, z = n.T
    level = np.abs(z) > 0.7
    s = np.hypot(np.where(level, z, y), x)
    a, b, c = np.where(level, z, -y) / s, np.where(level, 0.0, x) / s, np.where(level, -x, 0.0) / s
    return np.array([[a, b, c], [y * c - z * b, z * a - x * c, x * b - y * a]])
