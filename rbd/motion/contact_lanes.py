"""Contacts of a motion from what is said to touch: of a plan, or of a file, measured along the motion."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from rbd.arrays import Array
from rbd.constraints.terrain.terrain import Terrain
from rbd.errors import InputError
from rbd.model.sampled_motion import SampledMotion
from rbd.motion.contact_timeline import AGAIN, ContactTimeline, FloorPoints
from rbd.motion.frame_terms import placements
from rbd.motion.terrain_lanes import OverTerrain

TOUCHES_M = 0.006
"""A point is on the floor from 6 mm over it [m]."""
SLOPE_S = 0.3
"""Window of the slope of a point's position, cut off where it does not touch [s]."""
REST_SPEED = 5e-3
"""A point that moves along the floor faster than this slides [m/s]."""
LEAST = 3
"""Frames that a slope needs."""


def lanes_of(
    motion: SampledMotion, points: FloorPoints, touches: Array, ground: float | Terrain, rest_speed: float = REST_SPEED
) -> ContactTimeline:
    """The contacts of a motion whose points touch as said, measured: heights, speeds, which of them slide or are raised.

    Args:
        motion: The motion.
        points: Points that may touch.
        touches: Which do, shape (n, k).
        ground: Height of the floor [m], or the terrain: then of points over an edge their places on it.
        rest_speed: Fastest motion of a point that holds [m/s].
    """
    if isinstance(ground, Terrain):
        over = OverTerrain.of(ground, points, *placements(motion.robot, motion.q))
        owners = [points.names.index(name.removesuffix(AGAIN)) for name in over.points.names]
        lanes = lanes_of(motion, over.points, touches[:, owners] & over.rests, 0.0, rest_speed)
        found = over.of_timeline(lanes, np.ones(len(over.points), bool))
        return replace(found, heights=over.heights, ground=ground, raised=found.touches & (over.heights > TOUCHES_M))
    places = points.places(*placements(motion.robot, motion.q))
    heights = places[..., 2] - ground
    speeds, noise = slopes(motion.t, places[..., :2], touches, np.zeros(len(points)))
    slides = touches & (speeds > rest_speed)
    return ContactTimeline(
        motion.t, points, touches, slides, heights, speeds, places, ground, noise, touches & (heights > TOUCHES_M)
    )


@dataclass(frozen=True, eq=False)
class StoredContacts:
    """Contacts and forces beside a motion in a file, as `Motion.save` writes them.

    Attributes:
        names: Of the points.
        touches: Which of them touch, shape (n, k).
        slides: Which of these slide, shape (n, k).
        raised: Which of these are above the floor, shape (n, k).
        forces: On the robot, in W, shape (n, k, 3) [N]; None where there are none.
    """

    names: Sequence[str]
    touches: Array
    slides: Array
    raised: Array
    forces: Array | None

    def of(self, motion: SampledMotion, ground: float | Terrain) -> tuple[ContactTimeline | None, Array | None, str]:
        """(contacts of a motion, forces, what to note): None of a robot that has not these points."""
        robot, names, points = motion.robot, list(self.names), None
        with suppress(InputError):  # it has no feet, and nothing else that could touch
            points = FloorPoints.of(robot)
            fixed = {name for name in names if isinstance(ground, float) or not name.endswith(AGAIN)}
            points = points if fixed <= set(points.names) else FloorPoints.of(robot, bodies=True)
        over = None
        if points is not None and isinstance(ground, Terrain):
            over = OverTerrain.of(ground, points, *placements(robot, motion.q))
            points = over.points
        odd = [name for name in names if points is None or name not in points.names]
        if points is None or odd:
            return None, None, f"contacts of the file are not read: {robot.name} has no point {odd[0]!r:.80}."
        kept = np.isin(points.names, names)
        points = points.some(kept)
        at = [names.index(name) for name in points.names]
        on = self.touches[:, at]
        lanes = lanes_of(motion, points, on, ground if isinstance(ground, float) else 0.0)
        if over is not None:
            lanes = replace(over.of_timeline(lanes, kept), heights=over.heights[:, kept], ground=ground)
        lanes = replace(lanes, slides=on & self.slides[:, at], raised=on & self.raised[:, at])
        feet = ", ".join(points.contacts[g].name for g in np.unique(points.group))
        forces = None if self.forces is None else self.forces[:, at]
        return lanes, forces, f"contacts{'' if forces is None else ' and forces'} are those of the file, of {feet:.300}."


def slopes(t: Array, xy: Array, touches: Array, noise: Array) -> tuple[Array, Array]:
    """(speed along the floor, its standard deviation), each of shape (n, k) [m/s]: regressions within each stretch of contact.

    Over `SLOPE_S`, or over three frames where that is less: a foot that goes up sideways does not slide before it does.

    Args:
        t: Times, shape (n,) [s].
        xy: Positions, shape (n, k, 2) [m].
        touches: Shape (n, k).
        noise: Standard deviation of positions, shape (k,) [m].
    """
    n, k = touches.shape
    i = np.arange(n)[:, None]
    starts = touches & ~np.vstack([np.zeros((1, k), bool), touches[:-1]])
    ends = touches & ~np.vstack([touches[1:], np.zeros((1, k), bool)])
    start = np.maximum.accumulate(np.where(starts, i, 0), axis=0)
    end = np.minimum(np.minimum.accumulate(np.where(ends, i, n)[::-1], axis=0)[::-1] + 1, n)
    time, x = (t - t.mean())[:, None, None], xy - xy.mean(axis=0)
    of_time = np.broadcast_to(np.concatenate([time, time**2], axis=2), (n, k, 2))
    sums = np.concatenate([np.zeros((1, k, 6)), np.cumsum(np.concatenate([of_time, x, x * time], axis=2), axis=0)])

    def over(begin: Array, last: Array) -> tuple[Array, Array]:
        first = np.maximum(start, begin)
        last = np.maximum(np.minimum(end, last), first)
        count, column = np.maximum(last - first, 1), np.arange(k)
        T, TT, X, TX = np.split(sums[last, column] - sums[first, column], [1, 2, 4], axis=2)
        T, TT = T[..., 0], TT[..., 0]
        spread = TT - T**2 / count
        enough = touches & (last - first >= LEAST) & (spread > 0.0)
        safe = np.where(enough, spread, 1.0)
        slope = (TX - (T / count)[..., None] * X) / safe[..., None]
        speed = np.where(enough, np.hypot(slope[..., 0], slope[..., 1]), np.where(touches, 0.0, np.nan))
        return speed, np.where(enough, noise / np.sqrt(safe), 0.0)

    half = 0.5 * SLOPE_S + 1e-9
    long, spread = over(np.searchsorted(t, t - half)[:, None], np.searchsorted(t, t + half)[:, None])
    middle = np.clip(i, start + 1, np.maximum(end - 2, start + 1))
    short, _ = over(middle - 1, middle + 2)
    return np.minimum(long, short), spread
