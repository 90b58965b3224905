"""Links off the ground at every instant of a plan.

Of a shape and a convex piece of the ground, at both ends of an interval of length h, and for each unit vector n

    distance(t)  >=  min_i (min over the shape of n . x_i - max over the piece of n . y) - e
    e = h^2 / 8 max (|o''| + r |u''|)

with e how far a point of the shape is from the straight line between its places at the ends: o is the origin of its joint, u a
unit vector fixed to its link, r its largest distance from that origin. Along a straight line n . x is nowhere below both ends.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array
from rbd.constraints.surface import On
from rbd.motion.frame_terms import placements
from rbd.motion.ground_clearance import OverGround
from rbd.planning.bounds import Bounds
from rbd.planning.curve import Curve
from rbd.planning.stays import PlannedContacts
from rbd.statics.limits import Limit

MEASURED = 0.03
"""Links that are farther from the ground are not measured [m]."""
HALVED = 5
"""How often an interval is halved."""
ROUNDING = 1e-6
"""Distances count as kept up to this [m]."""


@dataclass(frozen=True, eq=False)
class OffGround:
    """How near links come to the ground, at all times of a plan.

    Of each link it is the piece at which least is left; a link that touches with a point counts without what is near to it, and
    the point by the name of its contact. A link that carries a contact may be 2 mm inside what this stands on; where it is
    deeper in a keyframe in which the contact stands, it is not measured there.

    Attributes:
        links: Names.
        pieces: Of the ground, by their names in the terrain.
        gaps: Distances at all times, at least, shape (k,) [m]. More than 3 cm over the clearance are not measured, and count as
            that, with no piece.
        least: What they have to be: the clearance, or -2 mm, shape (k,) [m].
        at: When they may be nearest, shape (k,) [s].
    """

    links: tuple[str, ...]
    pieces: tuple[str, ...]
    gaps: Array
    least: Array
    at: Array

    @property
    def holds(self) -> bool:
        """Whether all keep their distance."""
        return bool((self.gaps - self.least >= -ROUNDING).all())

    @property
    def nearest(self) -> tuple[str, str, float, float]:
        """(link, piece, distance at least [m], when [s]) of the nearest link, but for those that a contact exempts."""
        free = np.flatnonzero(self.least >= 0.0)
        i = int(free[self.gaps[free].argmin()]) if len(free) else 0
        return self.links[i], self.pieces[i], float(self.gaps[i]), float(self.at[i])

    @property
    def worst(self) -> tuple[float, str, Limit]:
        """(instant, which link is nearer to what than it may be there, its limit)."""
        i = int((self.gaps - self.least).argmin())
        words = said(self.links[i], self.pieces[i], float(self.gaps[i]), float(self.least[i]), "may come to be")
        return float(self.at[i]), words, Limit("ground", self.links[i])


def said(link: str, piece: str, gap: float, least: float, verb: str = "is") -> str:
    """That a link is too near to a piece, in words."""
    wanted = f", and its clearance is to be {1e3 * least:.1f} mm" if least > 0.0 else ""
    where = f"{-1e3 * gap:.1f} mm inside" if gap < 0.0 else f"{1e3 * gap:.1f} mm from"
    return f"{link!r:.80} {verb} {where} {piece!r:.80}{wanted}"


def over_ground(supports: PlannedContacts, ground: On, clearance: float) -> OverGround | None:
    """The links of a plan's robot over what its contacts stand on, with the distances that they keep.

    None: links have no shapes, or it is not known where the ground is.
    """
    robot, keys = supports.robot, [(t, state.q) for t, state in supports.keys]
    near = placements(robot, np.array([q for _, q in keys]))[1].reshape(-1, 3)
    places = [s.X.translation for own in supports.stays for s in own]
    found = OverGround.of(robot, supports.contacts, ground, np.concatenate([near, np.reshape(places, (-1, 3))]))
    if not found.shapes or not found.pieces:
        return None
    return found.kept(clearance, robot, np.array([q for _, q in keys]), supports.on(np.array([t for t, _ in keys])))


def too_near(supports: PlannedContacts, over: OverGround) -> tuple[float, str, str] | None:
    """(time, link, what is wrong in words) of the first or last keyframe, which a plan meets exactly; None: nothing is."""
    ends = [supports.keys[0], supports.keys[-1]]
    R, p = placements(supports.robot, np.array([state.q for _, state in ends]))
    worst, out = -ROUNDING, None
    for i, j, near in over.near(R, p, float(over.least.max(initial=0.0))):
        link, least, k = over.shapes[i].link, float(over.least[i, j]), int(near.gap.argmin())
        gap = float(near.gap[k])
        if gap - least < worst:
            worst, out = gap - least, (ends[near.frames[k]][0], link, said(link, over.pieces[j].name, gap, least))
    return out


def off_ground(curve: Curve, over: OverGround, halved: int = HALVED) -> OffGround:
    """That of a curve. An interval in which a link may be nearer than its clearance is halved, at most `halved` times."""
    start, end, measured = curve.t[:-1], curve.t[1:], MEASURED + float(over.least.max(initial=0.0))
    clear = max(measured - MEASURED, 0.0)
    found = {shape.link: (measured - clear, float(start[0]), "", clear) for shape in over.shapes}
    for k in range(halved + 1):
        each, again = list(_bounds(curve, over, start, end, measured)), np.zeros(len(start), bool)
        for i, j, some, gaps in each:
            again[some] |= gaps < over.least[i, j] - ROUNDING
        again &= k < halved
        for i, j, some, gaps in each:
            link, least, left = over.shapes[i].link, float(over.least[i, j]), np.where(again[some], np.inf, gaps)
            at = int(left.argmin())
            found[link] = min(found[link], (float(left[at]) - least, float(start[some[at]]), over.pieces[j].name, least))
        if not again.any():
            break
        a, b = start[again], end[again]
        middle = 0.5 * (a + b)
        start, end = np.concatenate([a, middle]), np.concatenate([middle, b])
    numbers = np.array([(left + kept, kept, t) for left, t, _, kept in found.values()]).reshape(-1, 3)
    return OffGround(tuple(found), tuple(piece for *_, piece, _ in found.values()), *numbers.T)


def _bounds(
    curve: Curve, over: OverGround, start: Array, end: Array, within: float
) -> Iterator[tuple[int, int, Array, Array]]:  # fmt: skip
    """(shape, piece, numbers of intervals, how far they are apart in these at least [m]) of pairs that may be near."""
    robot, m, h = curve.robot, len(start), end - start
    R, p = placements(robot, curve.at(np.concatenate([start, end]))[0])
    bounds = Bounds.of(robot, curve.sizes(start, end))
    for i, j, frames in over.close(R, p, np.full(over.least.shape, within)):
        shape, some = over.shapes[i], np.unique(frames % m)
        joint, reach = shape.joint, float(np.linalg.norm(shape.shape.centre)) + shape.shape.reach
        bent = (bounds.place[2, joint, some] + bounds.turn[2, joint, some] * reach) * h[some] ** 2 / 8.0
        turn, place = R.reshape(2, m, *R.shape[1:])[:, some, joint], p.reshape(2, m, *p.shape[1:])[:, some, joint]
        yield i, j, some, np.minimum(over.bounds(i, j, turn, place, bent, within), within)
