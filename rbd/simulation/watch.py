"""Beginnings and ends of contact, of slipping and of sticking, each with its time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array
from rbd.simulation.moment import Event
from rbd.simulation.snapshot import Layout

SLIDES = 1e-6
"""A point that slides slower than this [m/s] sticks."""


@dataclass(frozen=True, eq=False)
class _Step:
    """What is kept of a step: row forces in its middle, and the velocities of the points at its beginning."""

    t: float
    h: float
    force: Array
    velocity: Array


class Watch:
    """Compares each step with the two before it; times within a step are extrapolated from what went on before it."""

    def __init__(self) -> None:
        self._events: list[Event] = []
        self._layout: Layout | None = None
        self._closed, self._slides = np.zeros(0, bool), np.zeros(0, bool)
        self._past: list[_Step] = []

    def taken(self) -> tuple[Event, ...]:
        """The events since the last call, in order of time."""
        out = tuple(sorted(self._events, key=lambda e: e.t))
        self._events.clear()
        return out

    def step(self, t: float, h: float, layout: Layout, force: Array, velocities: tuple[Array, Array], closed: Array) -> None:
        """A step was taken.

        Args:
            t: Its beginning [s].
            h: Its length [s].
            layout: The points.
            force: Row forces in its middle, shape (p,).
            velocities: Of the points at its beginning and at its end, shapes (p,).
            closed: Which points touch all through it, shape (k,).
        """
        begins = self._watched(layout)
        slides = closed & (slide(layout, velocities[1]) > SLIDES)
        now = _Step(t, h, force, velocities[0])
        if not begins and not (np.array_equal(closed, self._closed) and np.array_equal(slides, self._slides)):
            self._compare(layout, now, closed, slides)
        self._closed, self._slides = closed, slides
        self._past = self._past[-1:] + [now]

    def _compare(self, layout: Layout, now: _Step, closed: Array, slides: Array) -> None:
        ended, begun, both = self._closed & ~closed, ~self._closed & closed, self._closed & closed & layout.rubs
        for i in np.flatnonzero(ended).tolist():
            row = int(layout.normals[i])
            self._tell(self._zero(now, lambda s, row=row: float(s.force[row])), layout, i, "leaves")
        for i in np.flatnonzero(begun).tolist():
            self._tell(now.t, layout, i, "touches")
        for i in np.flatnonzero(both & self._slides & ~slides).tolist():
            self._tell(self._stops(now, layout, i), layout, i, "sticks")
        for i in np.flatnonzero(both & ~self._slides & slides).tolist():
            self._tell(self._zero(now, lambda s, i=i: 1.0 - _used(layout, i, s.force)), layout, i, "slips")

    def impact(self, t: float, layout: Layout, arrives: Array, speed: Array, impulse: Array, bounces: Array) -> None:
        """Points were struck.

        Args:
            t: When [s].
            layout: The points.
            arrives: Which of them, shape (k,).
            speed: Normal velocities before, shape (k,).
            impulse: Normal impulses, shape (k,).
            bounces: Which of them leave again, shape (k,).
        """
        self._watched(layout)
        for i in np.flatnonzero(arrives).tolist():
            self._tell(t, layout, i, "touches", -float(speed[i]), float(impulse[i]))
        self._closed = np.where(arrives, ~bounces, self._closed)
        self._past = []

    def _watched(self, layout: Layout) -> bool:
        """Whether there is nothing to compare with."""
        if layout is self._layout:
            return False
        k = len(layout.owners)
        self._layout = layout
        self._closed, self._slides = np.zeros(k, bool), np.zeros(k, bool)
        self._past = []
        return True

    def _tell(self, t: float, layout: Layout, i: int, kind: str, speed: float = 0.0, impulse: float = 0.0) -> None:
        self._events.append(Event(float(t), layout.owners[i], kind, layout.numbers[i], speed, impulse))

    def _zero(self, now: _Step, of: object) -> float:
        """When a quantity becomes zero: after the middle of the last step, by a straight line through the last two middles."""
        if len(self._past) < 2:
            return now.t
        one, two = self._past
        f1, f2 = of(one), of(two)  # type: ignore[operator]
        t1, t2 = one.t + 0.5 * one.h, two.t + 0.5 * two.h
        after = t2 + f2 * (t2 - t1) / (f1 - f2) if f1 > f2 > 0.0 else now.t
        return min(max(after, t2), now.t + now.h)

    def _stops(self, now: _Step, layout: Layout, i: int) -> float:
        """When sliding ends in this step, by a straight line through the speeds at its beginning and at the last one's."""
        speed = float(slide(layout, now.velocity)[i])
        before = float(slide(layout, self._past[-1].velocity)[i]) if self._past else speed
        after = speed * self._past[-1].h / (before - speed) if before > speed else now.h
        return now.t + min(after, now.h)


def slide(layout: Layout, velocity: Array) -> Array:
    """How fast each point slides, or rubs, shape (k,) [m/s, rad/s]; zero of what does not."""
    out = np.zeros(len(layout.owners))
    out[layout.slides] = np.hypot(*(velocity[layout.sliding_rows] * layout.sliding_kept).T)
    return out


def _used(layout: Layout, i: int, force: Array) -> float:
    """|f_t| / (mu f_n) of a point with friction; zero where it carries nothing."""
    n = int(layout.normals[i])
    limit = float(layout.mu[i] * force[n])
    return float(np.hypot(force[n - 2], force[n - 1])) / limit if limit > 0.0 else 0.0
