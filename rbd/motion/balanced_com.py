"""How far the centre of mass of a motion must shift so that its zero-moment point stays within the contacts.

A shift s of the centre of mass at height z above the floor, under a force F upwards, shifts the zero-moment point by

    s - z m / F s''

so for a zero-moment point that must move by d the shift solves a linear equation over the whole motion [Kajita2003]: it looks
ahead, as a person leans before lifting a foot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_banded

from rbd.arrays import Array
from rbd.constraints.convex.polygons import convex_hull, inside_distance, nearest_on_edge
from rbd.model.world import along_gravity
from rbd.motion.frame_terms import FrameTerms

FLIES = 0.1
"""Below this share of the weight a motion has no zero-moment point."""
INSET = 0.1
"""Where the zero-moment point is put inside: this share of the way from their edge to the middle of the contacts."""
ROUND_M = 1e-3
"""A zero-moment point that is outside by less stays where it is [m]."""
REST_S = 1.5
"""How long a motion that must shift where it begins or ends is taken to stand still before and after it [s]."""
REST_FRAMES = 90


@dataclass(frozen=True, eq=False)
class Shift:
    """A shift of the centre of mass along the floor at n times.

    Attributes:
        s: Shape (n, 2) [m].
        rate: Shape (n, 2) [m/s].
        acceleration: Shape (n, 2) [m/s2].
        zmp: By how much the zero-moment point moves, shape (n, 2) [m].
    """

    s: Array
    rate: Array
    acceleration: Array
    zmp: Array


def com_shift(t: Array, terms: FrameTerms, places: Array, touches: Array, ground: float) -> Shift:
    """The shift with which the zero-moment point is in the hull of the points that touch, where it can.

    Args:
        t: Times, shape (n,) [s].
        terms: The equations of motion at these times.
        places: Where points touch, shape (n, k, 3) [m].
        touches: Which of them do, shape (n, k).
        ground: Height of the floor [m].
    """
    mass = float(terms.M_base[0, 0, 0])
    gravity = terms.robot.gravity
    weight = -mass * float(gravity[2])  # what a floor carries at rest
    up, height = terms.wrench[:, 2], terms.com[:, 2] - ground
    carried = (up > FLIES * weight) & touches.any(axis=1)
    force = np.where(carried, up, weight)
    ahead = np.stack([-terms.wrench[:, 4], terms.wrench[:, 3]], axis=1) - height[:, None] * terms.wrench[:, :2]
    zmp = terms.com[:, :2] + ahead / force[:, None]
    d = np.zeros((len(t), 2))
    for i in np.flatnonzero(carried):
        d[i] = _move(zmp[i], places[i][touches[i], :2])
    below = [along_gravity(gravity, terms.com[i], ground) for i in (0, -1)]  # its zero-moment point at rest
    rest = [_move(below[i], places[i][touches[i], :2]) if d[i].any() else np.zeros(2) for i in (0, -1)]
    pad = np.arange(1, REST_FRAMES + 1) * (REST_S / REST_FRAMES)
    times = np.concatenate([t[0] - pad[::-1], t, t[-1] + pad])
    ends = [np.full(REST_FRAMES, height[i] * mass / weight) for i in (0, -1)]
    c = np.concatenate([ends[0], np.where(carried, height * mass / force, 0.0), ends[1]])
    wanted = np.concatenate([np.tile(rest[0], (REST_FRAMES, 1)), d, np.tile(rest[1], (REST_FRAMES, 1))])
    on = np.concatenate([np.ones(REST_FRAMES, bool), carried, np.ones(REST_FRAMES, bool)])
    solved = _solved(times, c, on, wanted)
    inside = slice(REST_FRAMES, REST_FRAMES + len(t))
    s, rate = solved[inside], np.gradient(solved, times, axis=0)[inside]
    acceleration = np.where(carried[:, None], (s - d) * (force / (np.maximum(height, 1e-3) * mass))[:, None], 0.0)
    return Shift(s, rate, acceleration, d)


def nearest_inside(point: Array, corners: Array) -> Array:
    """The nearest point of the hull of some corners, a little inside it; the point itself if it is inside, shape (2,)."""
    hull = convex_hull(corners)
    if inside_distance(point, hull) >= 0.0:
        return point
    inner = hull + INSET * (hull.mean(axis=0) - hull) if len(hull) > 2 else hull
    return nearest_on_edge(point, inner)


def _move(zmp: Array, corners: Array) -> Array:
    """By how much a zero-moment point must move, shape (2,)."""
    if not len(corners) or inside_distance(zmp, convex_hull(corners)) > -ROUND_M:
        return np.zeros(2)
    return nearest_inside(zmp, corners) - zmp


def _solved(t: Array, c: Array, carried: Array, d: Array) -> Array:
    """The shift s with s - c s'' = d, and s'' = 0 in the air; s = d at both ends."""
    n = len(t)
    if not d.any():
        return d.copy()
    h = np.diff(t)
    before, after = h[:-1], h[1:]
    low = 2.0 / (before * (before + after))
    high = 2.0 / (after * (before + after))
    one, k = np.where(carried[1:-1], 1.0, 0.0), np.where(carried[1:-1], c[1:-1], 1.0)
    bands = np.zeros((3, n))
    bands[1, 0] = bands[1, -1] = 1.0
    bands[1, 1:-1] = one + k * (low + high)
    bands[0, 2:] = -k * high
    bands[2, :-2] = -k * low
    right = d.copy()
    right[1:-1] *= one[:, None]
    return np.asarray(solve_banded((1, 1), bands, right))


def held_places(places: Array, touches: Array, groups: Sequence[int] | Array) -> Array:
    """Where contacts are held: each point where it was when its contact began to touch, shape (n, k, 3).

    Args:
        places: Of the points in each frame, shape (n, k, 3) [m].
        touches: Shape (n, k).
        groups: Contact of each point, shape (k,).
    """
    out, groups = places.copy(), np.asarray(groups)
    for g in np.unique(groups):
        own = groups == g
        on = np.asarray(touches[:, own].any(axis=1))
        for i in range(1, len(on)):
            if on[i] and on[i - 1]:
                out[i, own] = out[i - 1, own]
    return out
