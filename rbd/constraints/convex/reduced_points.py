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
"""The farthest point in each of this many horizontal directions is included too."""
MOST_POINTS = LOWEST + DIRECTIONS
TIPS = 0.1
"""A point at height h counts as nearer by h over this [rad]: points that touch only after a large tilt."""
_angles = 2.0 * np.pi * (np.arange(DIRECTIONS) + 0.5) / DIRECTIONS
TOWARDS = np.column_stack([np.cos(_angles), np.sin(_angles)])
"""These directions, shape (DIRECTIONS, 2)."""


def spread(points: Array, height: Array, up: Array) -> Array:
    """Indices of the points chosen among many, in ascending order; at most `MOST_POINTS`.

    Args:
        points: Shape (n, 3) [m].
        height: Height above the surface, shape (n,) [m].
        up: Unit vector away from the surface, shape (3,).
    """
    if len(points) <= MOST_POINTS:
        return np.arange(len(points))
    return spread_each(points.T, height, np.array([len(points)]), up[None])


def spread_each(points: Array, height: Array, counts: Array, up: Array) -> Array:
    """Indices of the points chosen in each of several groups, in ascending order.

    Args:
        points: One group after the other, shape (3, n) [m].
        height: Height above the surface, shape (n,) [m].
        counts: Number of points of each group, at least one, shape (g,).
        up: Unit vector away from the surface, in the axes of each group, shape (g, 3).
    """
    groups = np.arange(len(counts))
    group, last, rise, arm = _above_lowest(points, height, counts)
    low = _lowest(height, group, last)
    # A point steeper than `TIPS` above the lowest one is not the farthest in any direction: the lowest one is farther.
    flat = (rise * rise <= (TIPS * TIPS * (1.0 + 1e-9)) * arm).nonzero()[0]
    of = group.take(flat)
    plane = np.add.reduce(across_each(up).take(of, axis=2) * points.take(flat, axis=1), axis=1)
    away = _away(plane, rise.take(flat))
    most = np.maximum.reduceat(away, of.searchsorted(groups), axis=1)
    direction, at = (away == most.take(of, axis=1)).nonzero()
    key = of.take(at) + len(counts) * direction
    far = flat[at[key != np.append(-1, key[:-1])]]  # of equal ones the first
    chosen = np.zeros(len(height), bool)
    chosen[low] = True
    chosen[far] = True
    return chosen.nonzero()[0]


def possible(points: Array, height: Array, counts: Array, turn: float) -> Array:
    """Which points `spread_each` might choose after the surface has turned by up to `turn` [rad], shape (n,).

    It may then also be at any height, and other points may have left the groups if higher ones have, too. Others are not
    chosen: the point that is lowest now is lower and farther in each direction, and `LOWEST` points are lower.
    """
    group, last, rise, arm = _above_lowest(points, height, counts)
    arm = np.sqrt(arm)
    lowest = height <= last.take(group)
    widest = np.maximum.reduceat(np.where(lowest, arm, 0.0), np.cumsum(counts) - counts).take(group)
    near = height - last.take(group) <= turn * (arm + widest)
    return np.asarray(near | (rise <= (TIPS + turn) * arm + 1e-9))


def _above_lowest(points: Array, height: Array, counts: Array) -> tuple[Array, Array, Array, Array]:
    """(group of each point, height of the `LOWEST`-th of each group; each point's height above, and distance from, its lowest).

    Distances are squared; the height is infinite for a smaller group. Arguments as of `spread_each`.
    """
    starts = np.cumsum(counts) - counts
    group = np.arange(len(counts)).repeat(counts)
    table = np.full((len(counts), max(int(counts.max()), LOWEST)), np.inf)
    table[group, np.arange(len(height)) - starts.take(group)] = height
    first = starts + table.argmin(axis=1)
    arm = points - points.take(first, axis=1).take(group, axis=1)
    last = np.partition(table, LOWEST - 1, axis=1)[:, LOWEST - 1]
    return group, last, height - height.take(first).take(group), np.add.reduce(arm * arm, axis=0)


def _lowest(height: Array, group: Array, last: Array) -> Array:
    """Indices of the `LOWEST` of each group, of equal ones the first; of a smaller group all.

    Args:
        height: Shape (n,) [m].
        group: Of each, ascending, shape (n,).
        last: Height of the highest of these, shape (g,) [m].
    """
    low = (height <= last.take(group)).nonzero()[0]
    of = group.take(low)
    many = np.bincount(of, minlength=len(last)) > LOWEST
    if not many.any():
        return low
    tied = height.take(low) == last.take(of)
    missing = LOWEST - np.bincount(of, weights=~tied, minlength=len(last))
    before = np.cumsum(tied) - tied  # ties before this one, in all groups
    before -= before.take(of.searchsorted(np.arange(len(last)))).take(of)
    return low[~tied | (before < missing.take(of))]


def farthest(flat: Array, height: Array) -> Array:
    """Index of the farthest point in each direction, less its height over `TIPS`, shape (DIRECTIONS,).

    Args:
        flat: Points as seen from above, shape (2, n) [m].
        height: Shape (n,) [m].
    """
    return np.asarray(_away(flat, height).argmax(axis=1))


def _away(flat: Array, height: Array) -> Array:
    """How far each point is in each direction, less its height over `TIPS`, shape (DIRECTIONS, n)."""
    return np.asarray(TOWARDS @ flat - height / TIPS)


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
