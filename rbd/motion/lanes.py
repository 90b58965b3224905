"""`Lanes`: which points of a robot touch the floor and slide on it, over time; editable copies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rbd.arrays import Array, as_float
from rbd.constraints.constraint import Constraint
from rbd.displayed import Displayed
from rbd.errors import InputError, UnknownName, nearest
from rbd.motion.floor_points import FloorPoints


@dataclass(frozen=True, eq=False, repr=False)
class Lanes(Displayed):
    """Which contact points touch and slide, when: a lane for each of k points, in n frames.

    Attributes:
        t: Times, shape (n,) [s].
        points: The points.
        touches: Which of them touch, shape (n, k).
        slides: Which of those that touch slide, shape (n, k).
        heights: Above the floor, shape (n, k) [m].
        speeds: Along the floor, by the slope of the position while it touches, shape (n, k) [m/s]; NaN where it does not.
        places: Positions, shape (n, k, 3) [m].
        ground: Height of the floor [m].
        noise: What the decimals of the data leave in a speed, standard deviation, shape (n, k) [m/s].
        notes: What was assumed, in words.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> low, high = solo.standing().q, solo.standing().q + 0.15 * np.eye(solo.nq)[2]
        >>> hop = rbd.motion.minimum_jerk(solo, [low, high, low], [0.0, 0.3, 0.6], rate=50.0)
        >>> lanes = rbd.motion.find_contacts(hop)
        >>> lanes.names, lanes.intervals("front_left")
        (('front_left 1', 'front_right 1', 'hind_left 1', 'hind_right 1'), [(0.0, 0.06), (0.56, 0.6)])
    """

    t: Array
    points: FloorPoints
    touches: Array
    slides: Array
    heights: Array
    speeds: Array
    places: Array
    ground: float
    noise: Array
    notes: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the points."""
        return self.points.names

    @property
    def contacts(self) -> tuple[Constraint, ...]:
        """The contacts that the points belong to; `points.group` says which."""
        return self.points.contacts

    def of_contact(self, name: str) -> Array:
        """Whether any point of a contact touches, shape (n,)."""
        return np.asarray(self.touches[:, self._chosen(name)].any(axis=1))

    def at_frames(self, chosen: Array) -> Lanes:
        """The same contacts in some of the frames, by a mask or indices."""
        arrays = ("t", "touches", "slides", "heights", "speeds", "places", "noise")
        return replace(self, **{name: getattr(self, name)[chosen] for name in arrays})

    def with_touch(self, name: str, start: float, end: float, touches: bool = True) -> Lanes:
        """A copy in which a point, or all points of a contact, touch from start to end, or do not.

        Points that are said to touch hold, unless they were found to slide.

        Args:
            name: Of a point, "left_sole 1", or of a contact, "left_sole".
            start: Time [s].
            end: Time [s].
            touches: Whether they touch.

        Raises:
            UnknownName: with the nearest names.
            InputError: an end before the start.
        """
        first, last = as_float(start), as_float(end)
        if not first <= last:
            raise InputError(f"from {start!r:.40} to {end!r:.40} s; expected a start and a later end.")
        when = (self.t >= first) & (self.t <= last)
        changed = self.touches.copy()
        changed[np.ix_(when, self._chosen(name))] = bool(touches)
        return replace(self, touches=changed, slides=self.slides & changed)

    def of(self, names: Sequence[str], intervals: Sequence[Sequence[Sequence[float]]]) -> Lanes:
        """A copy in which exactly these touch.

        Args:
            names: Points or contacts.
            intervals: For each of them a list of (start, end) [s].

        Raises:
            UnknownName: with the nearest names.
            InputError: another number of intervals than of names.
        """
        if len(names) != len(intervals):
            raise InputError(f"{len(intervals)} lists of intervals for {len(names)} names; expected one for each.")
        none = np.zeros_like(self.touches)
        found = replace(self, touches=none, slides=none)
        for name, each in zip(names, intervals, strict=True):
            for start, end in each:
                found = found.with_touch(name, start, end)
        return replace(found, slides=self.slides & found.touches)

    def intervals(self, name: str) -> list[tuple[float, float]]:
        """When a point, or any point of a contact, touches: (first time, last time) of each stretch [s]."""
        on = np.concatenate([[False], self.touches[:, self._chosen(name)].any(axis=1), [False]])
        first, last = np.flatnonzero(~on[:-1] & on[1:]), np.flatnonzero(on[:-1] & ~on[1:]) - 1
        return [(float(self.t[i]), float(self.t[j])) for i, j in zip(first, last, strict=True)]

    def _chosen(self, name: str) -> Array:
        groups = [contact.name for contact in self.contacts]
        if name in groups:
            return np.flatnonzero(self.points.group == groups.index(name))
        if name in self.names:
            return np.array([self.names.index(name)])
        raise UnknownName(f"no contact or point {name!r:.80}; {nearest(name, [*groups, *self.names])}.")

    def __repr__(self) -> str:
        return f"Lanes({len(self.t)} frames, {', '.join(c.name for c in self.contacts)})"
