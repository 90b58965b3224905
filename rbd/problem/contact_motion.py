"""Which forces a contact point can apply, given its velocity.

With u = G^T velocity, the velocity of a point (tangent, tangent, normal):

    opening     (u_n > 0)              is inactive: its weight is 0, whatever y
    sliding     (u_n = 0, u_t != 0)    f = N (-mu u_t / |u_t|, 1), N >= 0, y = c_n: a coupled row, G != H
    approaching (u_n < 0)              an impact: no acceleration solves it
    dry friction (an interval, u != 0) the weight is at the bound that opposes the motion
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot, inf, isfinite

import numpy as np

from rbd.arrays import Array
from rbd.problem.cones import HALF_LINE, Interval, Part
from rbd.records import joined

REST_SPEED = 1e-6
"""A contact that can break or slip counts as at rest up to this speed [m/s, rad/s], unless its problem gives another."""
_LISTED = 6  # largest number of points or contacts listed by name


@dataclass(frozen=True)
class Opening:
    """A contact point that separates: its force is zero.

    Attributes:
        rows: Name of its rows.
        corner: Number of the point among the points of its rows, from 0.
        of: How many points these rows have.
        speed: Along the normal [m/s]; of a joint's limit, of the joint [rad/s, m/s].
    """

    rows: str
    corner: int
    of: int
    speed: float


@dataclass(frozen=True)
class Sliding:
    """A contact point that slides: its force is N (-mu t, 1).

    Attributes:
        rows: Name of its rows.
        corner: Number of the point among the points of its rows.
        column: Its column of G and H.
        mu: Friction coefficient.
        direction: Unit vector t of its tangential velocity, in contact axes.
        speed: [m/s].
    """

    rows: str
    corner: int
    column: int
    mu: float
    direction: tuple[float, float]
    speed: float


def opening_words(openings: Sequence[Opening]) -> str:
    """E.g. "'left_sole' at 0.2 m/s, 'right_sole' (points 1, 2 of 4) at up to 0.3 m/s"; points are counted from 1."""
    names = list(dict.fromkeys(point.rows for point in openings))
    return joined((_told([point for point in openings if point.rows == name]) for name in names), _LISTED)


def _told(points: list[Opening]) -> str:
    name, of = points[0].rows, points[0].of
    which = ""
    if len(points) < of:
        numbers = ", ".join(str(point.corner + 1) for point in points[:_LISTED])
        which = f" (point{'s' * (len(points) > 1)} {numbers}{', ...' * (len(points) > _LISTED)} of {of})"
    fastest = max(point.speed for point in points)
    return f"{name!r:.80}{which} at {'up to ' * (len(points) > 1)}{fastest:.3g} m/s"


_NORMAL, _AXES = np.array([[0.0, 0.0, 1.0]]), np.eye(3)


class MotionJudge:
    """Collects which points slide and open, and what impacts.

    Attributes:
        sliding: Points whose friction follows their motion.
        openings: Points that move away.
        impact: Message: which contact approaches; empty where none does.
    """

    def __init__(self, rest_speed: float) -> None:
        self.rest_speed = rest_speed
        self.sliding: list[Sliding] = []
        self.openings: list[Opening] = []
        self.impact = ""

    def judge(self, point: tuple[str, int, int], shape: Part, u: Array, column: int) -> tuple[Array, Array, float, float]:
        """(forces of unit weights (n, 3), directions of their accelerations (n, 3), lower and upper bound of the weights).

        Args:
            point: Name of the rows, number of the point, number of points.
            shape: Its set, at rest.
            u: Its velocity.
            column: Its first column in the force set.
        """
        name, number, of = point
        rest, normal = self.rest_speed, float(u[-1])
        if isinstance(shape, Interval) and shape != HALF_LINE:
            against = shape.lo if normal > 0.0 else shape.hi
            rubs = abs(normal) > rest and isfinite(against)
            return _NORMAL, _NORMAL, *((against, against) if rubs else (shape.lo, shape.hi))
        mu = shape.mu
        speed = hypot(u[0], u[1]) if mu else 0.0
        if normal < -rest and not self.impact:
            self.impact = f"{name!r} approaches at {-normal:.3g} m/s: an impact, which no acceleration answers"
        if normal > rest:
            self.openings.append(Opening(name, number, of, normal))
        if abs(normal) > rest:
            return _NORMAL, _NORMAL, 0.0, 0.0
        if not mu:
            return _NORMAL, _NORMAL, 0.0, inf
        if speed > rest:
            t = float(u[0]) / speed, float(u[1]) / speed
            self.sliding.append(Sliding(name, number, column, mu, t, speed))
            return np.array([[-mu * t[0], -mu * t[1], 1.0]]), _NORMAL, 0.0, inf
        return _AXES, _AXES, -inf, inf
