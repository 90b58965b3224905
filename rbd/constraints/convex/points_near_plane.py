"""The points of many shapes that are near a plane, found in arrays; points that cannot be near are not tested.

A list contains all points that were less than margin + `SKIN` above the plane at some pose. For any other point at x in its
body, c the centre of its shape and r the radius of the ball around it, the height up . x + z has since decreased by at most

    (up . c + z) before - (up . c + z) now + |up now - up before| r

As long as this is less than what the points of each shape had above the margin then, only the list is looked at (in
molecular dynamics: Verlet's list). Points of a shape with many that `spread_each` does not choose, turned by up to `TURN`, are
not in the list either. The result is the same, to the last bit, as if all points were looked at.

The arithmetic of a pose is in `rbd.constraints.plane_kernel`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import dataclass
from functools import cache
from types import ModuleType
from typing import NamedTuple

import numpy as np

from rbd.arrays import Array
from rbd.constraints.convex.convex_shapes import RIM_CORNERS, Ball, ConvexShape, Oval, Rim, Round
from rbd.constraints.convex.reduced_points import MOST_POINTS, possible

SKIN = 0.03
"""How far above the margin points are listed [m]: a longer list lasts longer."""
TURN = 0.05
"""How far a body may turn before its points are listed again [rad]."""
_ROUNDING = 1e-9
"""Heights are right to this [m], near and far."""


@dataclass(frozen=True, eq=False)
class Listed:
    """The list: points that can be near.

    Attributes:
        index: Their numbers, ascending, shape (n,).
        points: Shape (3, n) [m]; those of round parts are replaced at each call.
        body: Body of each, shape (n,).
        shape: Shape of each, shape (n,).
        many: Which are corners of a shape with more than `MOST_POINTS` of them, shape (n,).
        rounds: Where round parts are in the list.
        corners: Where corners of rims are in the list.
        rims: Their rims.
    """

    index: Array
    points: Array
    body: Array
    shape: Array
    many: Array
    rounds: Array
    corners: Array
    rims: Array


class RoundParts(NamedTuple):
    """Round parts in arrays, for compiled code.

    Attributes:
        kind: 0 of a ball, 1 of a rim, 2 of an ellipsoid, shape (n,).
        centre: Shape (n, 3) [m].
        radius: Shape (n,) [m].
        form: The axis of a rim in the first row; Q of an ellipsoid, shape (n, 3, 3).
        body: Body of each, shape (n,).
    """

    kind: Array
    centre: Array
    radius: Array
    form: Array
    body: Array

    @classmethod
    def of(cls, rounds: Sequence[Round], body: Array) -> RoundParts:
        """Those of several bodies."""
        n = len(rounds)
        kind, centre, radius, form = np.zeros(n, int), np.zeros((n, 3)), np.zeros(n), np.zeros((n, 3, 3))
        for i, part in enumerate(rounds):
            assert isinstance(part, Ball | Rim | Oval)
            kind[i], centre[i] = (Ball, Rim, Oval).index(type(part)), part.centre
            if isinstance(part, Oval):
                form[i] = part.Q
            else:
                radius[i] = part.radius
            if isinstance(part, Rim):
                form[i, 0] = part.axis
        return cls(kind, centre, radius, form, body)


@dataclass(frozen=True, eq=False)
class _Reference:
    """The poses at which the points of each shape were listed.

    Attributes:
        margin: Height up to which points are near [m].
        listed: Which points are in the list, shape (n,).
        up: Normal of the plane in each shape's axes, shape (shapes, 3).
        above: Height of each shape's centre, shape (shapes,) [m].
        turn: How far each shape may turn, shape (shapes,) [rad].
        spare: What the lowest point outside of the list has above the margin, of each shape, shape (shapes,) [m].
    """

    margin: float
    listed: Array
    up: Array
    above: Array
    turn: Array
    spare: Array


class LowPoints:
    """The points of shapes near a plane.

    Points are numbered one shape after the other, in each first the vertices, then the round parts.

    Args:
        shapes: The shapes, those of one body after another.
        bodies: Body of each shape, ascending from 0, shape (shapes,).

    Attributes:
        body: Body of each point, shape (n,).
        parts: The round parts in arrays.
        part_of: The round part of each point, or -1, shape (n,).
    """

    def __init__(self, shapes: Sequence[ConvexShape], bodies: Array) -> None:
        sizes = np.array([len(s.vertices) + len(s.rounds) for s in shapes])
        self.shapes, self._bodies = tuple(shapes), bodies
        self._first = np.cumsum(sizes) - sizes
        self._centres, self._reach = np.array([s.centre for s in shapes]), np.array([s.reach for s in shapes])
        self._points = np.concatenate([np.vstack([s.vertices, np.zeros((len(s.rounds), 3))]) for s in shapes]).T.copy()
        self.body = np.repeat(bodies, sizes)
        self._shape = np.repeat(np.arange(len(shapes)), sizes)
        rounds = [r for s in shapes for r in s.rounds]
        #: Points of the round parts, ascending.
        self._round = np.array([first + len(s.vertices) + i for s, first in self._each() for i in range(len(s.rounds))], int)
        #: Corners of rims, and the place of each one's rim among all rims.
        rims = [first + r.first for s, first in self._each() for r in s.rounds if isinstance(r, Rim)]
        self._corners = np.array([i for start in rims for i in range(start, start + RIM_CORNERS)], int)
        self._rims = np.repeat(np.arange(len(rims)), RIM_CORNERS)
        self._many = np.repeat([len(s.vertices) > MOST_POINTS for s in shapes], sizes)
        self._many[self._round] = False
        self._is_round = np.zeros(len(self.body), bool)
        self._is_round[self._round] = True
        self.parts = RoundParts.of(rounds, self.body[self._round])
        self.part_of = np.full(len(self.body), -1)
        self.part_of[self._round] = np.arange(len(rounds))
        self._list: tuple[_Reference, Listed] | None = None

    def _each(self) -> Iterator[tuple[ConvexShape, int]]:
        yield from zip(self.shapes, self._first.tolist(), strict=True)

    def another(self) -> LowPoints:
        """A copy with a list of its own."""
        out = copy(self)
        out._list = None
        return out

    def label(self, point: int) -> tuple[str, int]:
        """(name of a point's shape, its number there)."""
        shape = int(np.searchsorted(self._first, point, side="right")) - 1
        return self.shapes[shape].name, point - int(self._first[shape])

    def near(self, up: Array, height: Array, margin: float) -> tuple[Listed, Array, Array]:
        """(the list, which of its points are up to `margin` above the plane (k,), their heights (k,) [m]).

        Of a shape with more than `MOST_POINTS` corners, those chosen by `spread`. Not for two threads at once.

        Args:
            up: Normal of the plane in each body's axes, shape (bodies, 3).
            height: Height of each body's origin, shape (bodies,) [m].
            margin: [m].
        """
        now = self._current(up, height, margin)
        here = now.points, now.body, now.shape, now.many, now.rounds, now.corners, now.rims
        return now, *_kernel().near_points(*here, *self.parts, up, height, margin)

    def _current(self, up: Array, height: Array, margin: float) -> Listed:
        """The list, with points of those shapes listed again of which others may have come near."""
        if self._list is not None and self._list[0].margin == margin:
            then, listed = self._list
            before = then.up, then.above, then.turn, then.spare
            if _kernel().lasts(up, height, self._bodies, self._centres, self._reach, *before, _ROUNDING):
                return listed
        up_shape = up.take(self._bodies, axis=0)
        above = np.vecdot(up_shape, self._centres) + height.take(self._bodies)
        again = np.ones(len(above), bool)
        if self._list is not None and self._list[0].margin == margin:
            then, listed = self._list
            turned = up_shape - then.up
            turned = np.sqrt(np.vecdot(turned, turned))
            lasts = (turned <= then.turn) & (then.above - above + turned * self._reach < then.spare - _ROUNDING)
            if lasts.all():
                return listed
            again = ~lasts
            known = then.listed, then.up, then.above, then.turn, then.spare
        else:
            n = len(above)
            known = np.zeros(len(self.body), bool), np.zeros((n, 3)), np.zeros(n), np.zeros(n), np.zeros(n)
        now = _Reference(margin, *(x.copy() for x in known))
        now.up[again], now.above[again] = up_shape[again], above[again]
        self._renew(now, again, up, height)
        listed = self._listed(now.listed)
        self._list = now, listed
        return listed

    def _renew(self, now: _Reference, again: Array, up: Array, height: Array) -> None:
        """List the points of some shapes."""
        points = again.take(self._shape).nonzero()[0]
        above = _heights(self._points.take(points, axis=1), self.body.take(points), up, height)
        shape, is_round, many = self._shape.take(points), self._is_round.take(points), self._many.take(points)
        listed = (above <= now.margin + SKIN) | is_round
        starts = shape.searchsorted(again.nonzero()[0])
        now.spare[again] = np.minimum.reduceat(np.where(listed, np.inf, above), starts) - now.margin
        rows = (listed & many).nonzero()[0]
        counts = np.bincount(shape.take(rows), minlength=len(again))
        now.turn[again] = np.where(counts[again], TURN, np.inf)
        if len(rows):
            listed[rows] = possible(self._points.take(points.take(rows), axis=1), above.take(rows), counts[counts > 0], TURN)
        now.listed[points] = listed

    def _listed(self, which: Array) -> Listed:
        index = which.nonzero()[0]
        corners = index.searchsorted(self._corners)
        here = which.take(self._corners)
        return Listed(
            index,
            self._points.take(index, axis=1),
            self.body.take(index),
            self._shape.take(index),
            self._many.take(index),
            index.searchsorted(self._round),
            corners[here],
            self._rims[here],
        )


@cache
def _kernel() -> ModuleType:
    from rbd.constraints import plane_kernel  # imports Numba

    return plane_kernel


def _heights(points: Array, body: Array, up: Array, height: Array) -> Array:
    """Heights of points (3, n) of some bodies, shape (n,) [m]: each the same whatever the others are."""
    return np.asarray(np.add.reduce(points * up.T.take(body, axis=1), axis=0) + height.take(body))
