"""The gravity of a robot's world: its vector checked, and points seen along it on a level plane."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rbd.arrays import Array, as_vector3
from rbd.errors import InputError

STANDARD = (0.0, 0.0, -9.81)
"""Gravity in W of robots that do not say otherwise [m/s2]."""
MOST = 1e4
"""Larger accelerations are not taken [m/s2]: a thousand times the Earth's."""
LEAST_FALL = 1e-3
"""Least share of gravity across a plane for lines along gravity to be followed to that plane."""


def checked_gravity(gravity: Sequence[float] | Array) -> Array:
    """A vector of gravity in W, copied, shape (3,) [m/s2]; zero is allowed.

    Raises:
        InputError: not three finite numbers, or more than 1e4 m/s2.
    """
    if isinstance(gravity, int | float | np.number):
        raise InputError(
            f"gravity is {gravity!r:.80}; expected the vector in W [m/s2], e.g. (0, 0, -9.81), or (0, 0, -1.62) on the Moon."
        )
    out = as_vector3("gravity", gravity)
    if not math.hypot(*out.tolist()) <= MOST:
        raise InputError(f"gravity is {out.tolist()}; expected at most {MOST:g} m/s2. Is it given in m/s2?")
    return np.array(out)


def is_standard(gravity: Array) -> bool:
    """Whether gravity is (0, 0, -9.81) m/s2."""
    return tuple(np.asarray(gravity).tolist()) == STANDARD


def is_along_z(gravity: Array) -> bool:
    """Whether gravity points along -z of W, with any size above zero."""
    x, y, z = np.asarray(gravity).tolist()
    return bool(z < 0.0 and max(abs(x), abs(y)) <= 1e-12 * -z)


def along_gravity(gravity: Array, points: Array, height: float | Array = 0.0) -> Array:
    """Where lines along gravity through points meet the level plane z = height: (x, y) in W, shape (..., 2) [m].

    (x, y) - (g_x, g_y) (z - height) / g_z: under gravity along -z the x and y of the points.

    Args:
        gravity: In W, shape (3,) [m/s2].
        points: In W, shape (..., 3) [m].
        height: Of the plane [m]; one for all points, or one each.

    Raises:
        InputError: gravity is zero or (to 0.001 of its size) parallel to the plane, whose lines do not meet it.
    """
    x, y, z = np.asarray(gravity).tolist()
    size = math.hypot(x, y, z)
    if not abs(z) > LEAST_FALL * size:
        what = "zero" if not size else f"{[x, y, z]} m/s2, level"
        raise InputError(
            f"gravity is {what}; expected one with a part along z: a centre of mass is projected along gravity onto a level "
            "plane. rbd.hold answers for one pose under any gravity."
        )
    points = np.asarray(points, float)
    if x == 0.0 and y == 0.0:
        return np.array(points[..., :2])
    return np.asarray(points[..., :2] - ((points[..., 2] - height) / z)[..., None] * np.array([x, y]))
