"""The points of many shapes that are near a plane, found in arrays; points that cannot have come near are not looked at.

A list contains all points that were less than margin + `SKIN` above the plane at some pose. For any other point at x in its
body, c the centre of its shape and r the radius of the ball around it, the height up . x + z has since decreased by at most

    (up . c + z) before - (up . c + z) now + |up now - up before| r

As long as this is less than what the points of each shape had above the margin then, only the list is looked at (in
molecular dynamics: Verlet's list). The result is the same, to the last bit, as if all points were looked at.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array
from rbd.constraints.convex.rounds import Rim, Round, stacked
from rbd.constraints.convex.solids import RIM_CORNERS, ConvexShape
from rbd.constraints.convex.spread import MOST_POINTS, spread_each

SKIN = 0.03
"""How far above the margin points are listed [m]: a longer list lasts longer."""
_ROUNDING = 1e-9
"""Heights are right to this [m], near and far."""


@dataclass(frozen=True, eq=False)
class _Listed:
    """Points that were near, and the poses at which they were.

    Attributes:
        margin: Height up to which points are near [m].
        up: Normal of the plane in each body's axes, shape (bodies, 3).
        above: Height of each shape's centre, shape (shapes,) [m].
        spare: What the lowest point outside of the list has above the margin, of each shape, shape (shapes,) [m].
        index: The points of the list, ascending, shape (n,).
        points: Shape (3, n) [m]; those of round parts are replaced at each call.
        body: Body of each, shape (n,).
        group: Shape of each corner; of round parts the number of shapes, shape (n,).
        rounds: Where round parts are in the list.
        corners: Where corners of rims are in the list.
        rims: Their rims.
    """

    margin: float
    up: Array
    above: Array
    spare: Array
    index: Array
    points: Array
    body: Array
    group: Array
    rounds: Array
    corners: Array
    rims: Array


class LowPoints:
    """The points of shapes near a plane.

    Points are numbered one shape after the other, in each first the vertices, then the round parts.

    Args:
        shapes: The shapes, those of one body after another.
        bodies: Body of each shape, ascending from 0, shape (shapes,).

    Attributes:
        body: Body of each point, shape (n,).
        has_rounds: Whether some are of round parts.
    """

    def __init__(self, shapes: Sequence[ConvexShape], bodies: Array) -> None:
        sizes = np.array([len(s.vertices) + len(s.rounds) for s in shapes])
        self.shapes, self._bodies = tuple(shapes), bodies
        self._first = np.cumsum(sizes) - sizes
        self._centres, self._reach = np.array([s.centre for s in shapes]), np.array([s.reach for s in shapes])
        self._points = np.concatenate([np.vstack([s.vertices, np.zeros((len(s.rounds), 3))]) for s in shapes]).T.copy()
        self.body = np.repeat(bodies, sizes)
        self._group = np.repeat(np.arange(len(shapes)), sizes)
        rounds = [r for s in shapes for r in s.rounds]
        #: Points of the round parts, ascending; and these parts stacked by kind, with their place among them, and their bodies.
        self._round = np.array([first + len(s.vertices) + i for s, first in self._each() for i in range(len(s.rounds))], int)
        self._kinds: list[tuple[Round, Array, Array]] = []
        for kind in dict.fromkeys(type(r) for r in rounds):
            which = np.array([i for i, r in enumerate(rounds) if type(r) is kind])
            self._kinds.append((stacked([rounds[i] for i in which]), which, self.body[self._round[which]]))
        #: Corners of rims, and the place of each one's rim among all rims.
        rims = [first + r.first for s, first in self._each() for r in s.rounds if isinstance(r, Rim)]
        self._corners = np.array([i for start in rims for i in range(start, start + RIM_CORNERS)], int)
        self._rims = np.repeat(np.arange(len(rims)), RIM_CORNERS)
        self._group[self._round] = len(shapes)
        self.has_rounds = bool(rounds)
        self._listed: _Listed | None = None

    def _each(self) -> Iterator[tuple[ConvexShape, int]]:
        yield from zip(self.shapes, self._first.tolist(), strict=True)

    def another(self) -> LowPoints:
        """A copy with a list of its own."""
        out = copy(self)
        out._listed = None
        return out

    def label(self, point: int) -> tuple[str, int]:
        """(name of a point's shape, its number there)."""
        shape = int(np.searchsorted(self._first, point, side="right")) - 1
        return self.shapes[shape].name, point - int(self._first[shape])

    def at(self, up: Array, height: Array, margin: float) -> tuple[Array, Array, Array]:
        """(numbers (k,), places in their bodies (3, k) [m], heights (k,) [m]) of the points up to `margin` above the plane.

        Of a shape with many, those chosen by `spread_each`. Not for two threads at once.

        Args:
            up: Normal of the plane in each body's axes, shape (bodies, 3).
            height: Height of each body's origin, shape (bodies,) [m].
            margin: [m].
        """
        now = self._listed
        if now is None or now.margin != margin or not self._lasts(now, up, height):
            now = self._listed = self._list(up, height, margin)
        stands = self._place_rounds(now, up)
        above = _heights(now.points, now.body, up, height)
        if stands is not None and len(now.corners):
            above[now.corners[stands[now.rims]]] = np.inf
        near = (above <= margin).nonzero()[0]
        group = now.group.take(near)
        counts = np.bincount(group, minlength=len(self.shapes) + 1)[:-1]
        crowded = np.append(counts > MOST_POINTS, False)
        if crowded.any():
            many = crowded.take(group)
            rows, of = near[many], crowded[:-1].nonzero()[0]
            few = ~many
            few[many] = spread_each(
                now.points.take(rows, axis=1), above.take(rows), counts[of], up.take(self._bodies.take(of), axis=0)
            )
            near = near[few]
        return now.index.take(near), now.points.take(near, axis=1), above.take(near)

    def wander(self, points: Array, up: Array, rate: Array) -> tuple[Array, Array]:
        """(which of some points are of round parts, how fast they move over their bodies (3, that many) [m/s]).

        Args:
            points: Numbers of points, shape (k,).
            up: Normal of the plane in each body's axes, shape (bodies, 3).
            rate: Its rate of change, shape (bodies, 3) [1/s].
        """
        moves = np.empty((3, len(self._round)))
        for parts, which, bodies in self._kinds:
            moves[:, which] = parts.wander(up.take(bodies, axis=0), rate.take(bodies, axis=0)).T
        at = (self._group.take(points) == len(self.shapes)).nonzero()[0]
        return at, moves.take(np.searchsorted(self._round, points.take(at)), axis=1)

    def _place_rounds(self, now: _Listed, up: Array) -> Array | None:
        """Put the lowest points of round parts into the list; returns which rims stand."""
        stands = None
        for parts, which, bodies in self._kinds:
            n = up.take(bodies, axis=0)
            now.points[:, now.rounds.take(which)] = parts.lowest(n).T
            if isinstance(parts, Rim):
                stands = parts.stands(n)
        return stands

    def _lasts(self, then: _Listed, up: Array, height: Array) -> bool:
        """Whether no point outside of the list can be near."""
        turned = up - then.up
        turned = np.sqrt(np.vecdot(turned, turned)).take(self._bodies)
        return bool((then.above - self._above(up, height) + turned * self._reach < then.spare - _ROUNDING).all())

    def _above(self, up: Array, height: Array) -> Array:
        """Height of each shape's centre, shape (shapes,)."""
        return np.asarray(np.vecdot(up.take(self._bodies, axis=0), self._centres) + height.take(self._bodies))

    def _list(self, up: Array, height: Array, margin: float) -> _Listed:
        above = _heights(self._points, self.body, up, height)
        above[self._round] = -np.inf  # always listed
        listed = above <= margin + SKIN
        index = listed.nonzero()[0]
        spare = np.minimum.reduceat(np.where(listed, np.inf, above), self._first) - margin
        place = np.full(len(listed), -1)
        place[index] = np.arange(len(index))
        corners = place[self._corners]
        return _Listed(
            margin,
            up.copy(),
            self._above(up, height),
            spare,
            index,
            self._points.take(index, axis=1),
            self.body.take(index),
            self._group.take(index),
            place[self._round],
            corners[corners >= 0],
            self._rims[corners >= 0],
        )


def _heights(points: Array, body: Array, up: Array, height: Array) -> Array:
    """Heights of points (3, n) of some bodies, shape (n,) [m]: each the same whatever the others are."""
    return np.asarray(np.add.reduce(points * up.T.take(body, axis=1), axis=0) + height.take(body))
