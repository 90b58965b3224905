"""Detection of events: beginnings and ends of contact, of sliding and of sticking, from the records of steps and impacts."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rbd.arrays import Array
from rbd.simulation.simulated_motion import Event
from rbd.simulation.stacked_points import PointLayout, point_kernel, slide


class StepRecord(NamedTuple):
    """The data of a step for event detection.

    Attributes:
        t: Its beginning [s].
        h: Its length [s].
        layout: The points.
        force: Row forces in its middle, shape (p,).
        velocity: Of the points at its beginning, shape (p,).
        velocity_end: Of the points at its end, shape (p,).
        closed: Which points are in contact throughout, shape (k,).
    """

    t: float
    h: float
    layout: PointLayout
    force: Array
    velocity: Array
    velocity_end: Array
    closed: Array


@dataclass(frozen=True, eq=False)
class ImpactRecord:
    """The data of an impact for event detection.

    Attributes:
        t: Time [s].
        layout: The points.
        arrives: Which of them approached, shape (k,).
        speed: Normal velocities before, shape (k,).
        impulse: Normal impulses, shape (k,).
        bounces: Which of them leave again, shape (k,).
    """

    t: float
    layout: PointLayout
    arrives: Array
    speed: Array
    impulse: Array
    bounces: Array


class EventDetection:
    """Events of a motion: each step is compared with the two before; times within a step are extrapolated from these.

    It belongs to the loop over the steps, and holds all memory of earlier steps.
    """

    def __init__(self) -> None:
        self._events: list[Event] = []
        self._layout: PointLayout | None = None
        self._closed, self._slides = np.zeros(0, bool), np.zeros(0, bool)
        self._past: list[StepRecord] = []

    def add(self, passed: Iterable[StepRecord | ImpactRecord]) -> None:
        """Process steps and impacts, in order of time."""
        for each in passed:
            if isinstance(each, StepRecord):
                self._step(each)
            else:
                self._impact(each)

    def taken(self) -> tuple[Event, ...]:
        """The events since the last call, in order of time."""
        if not self._events:
            return ()
        out = tuple(sorted(self._events, key=lambda e: e.t))
        self._events.clear()
        return out

    def _step(self, now: StepRecord) -> None:
        layout, closed, known = now.layout, now.closed, self._past[-1] if self._past else None
        if known is not None and closed is known.closed and now.velocity_end is known.velocity_end and layout is self._layout:
            self._past = [known, now]  # the same arrays: all points stick as before
            return
        is_new, slides, kinds = self._is_new(layout), np.empty(len(closed), bool), (layout.normals, layout.rubs, layout.slides)
        changed = point_kernel().sliding(*kinds, now.velocity_end, closed, self._closed, self._slides, slides)
        if changed and not is_new:
            self._compare(layout, now, closed, slides)
        self._closed, self._slides = closed, slides
        self._past = self._past[-1:] + [now]

    def _compare(self, layout: PointLayout, now: StepRecord, closed: Array, slides: Array) -> None:
        ended, begun, both = self._closed & ~closed, ~self._closed & closed, self._closed & closed & layout.rubs
        changes: tuple[tuple[str, Array, Callable[[int], float]], ...] = (
            ("leaves", ended, lambda i: self._zero(now, [float(s.force[layout.normals[i]]) for s in self._past])),
            ("touches", begun, lambda _: now.t),
            ("sticks", both & self._slides & ~slides, lambda i: self._stops(now, layout, i)),
            ("slips", both & ~self._slides & slides,
             lambda i: self._zero(now, [1.0 - _used(layout, i, s.force) for s in self._past])),
        )  # fmt: skip
        for kind, which, when in changes:
            for i in np.flatnonzero(which).tolist():
                self._record(when(i), layout, i, kind)

    def _impact(self, impact: ImpactRecord) -> None:
        self._is_new(impact.layout)
        for i in np.flatnonzero(impact.arrives).tolist():
            self._record(impact.t, impact.layout, i, "touches", -float(impact.speed[i]), float(impact.impulse[i]))
        self._closed = np.where(impact.arrives, ~impact.bounces, self._closed)
        self._past = []

    def _is_new(self, layout: PointLayout) -> bool:
        """Whether points have entered or left the contact set; then no comparison is possible."""
        if layout is self._layout:
            return False
        k = len(layout.owners)
        self._layout = layout
        self._closed, self._slides = np.zeros(k, bool), np.zeros(k, bool)
        self._past = []
        return True

    def _record(self, t: float, layout: PointLayout, i: int, kind: str, speed: float = 0.0, impulse: float = 0.0) -> None:
        self._events.append(Event(float(t), layout.owners[i], kind, layout.numbers[i], speed, impulse, layout.pieces[i]))

    def _zero(self, now: StepRecord, values: list[float]) -> float:
        """Time of a quantity's zero: after the middle of the last step, by a straight line through the last two middles.

        Args:
            now: The step in which it becomes zero.
            values: Its values in the middle of the steps before.
        """
        if len(self._past) < 2:
            return now.t
        one, two = self._past
        f1, f2 = values
        t1, t2 = one.t + 0.5 * one.h, two.t + 0.5 * two.h
        after = t2 + f2 * (t2 - t1) / (f1 - f2) if f1 > f2 > 0.0 else now.t
        return min(max(after, t2), now.t + now.h)

    def _stops(self, now: StepRecord, layout: PointLayout, i: int) -> float:
        """End of sliding in this step, by a straight line through the speeds at its beginning and at the last one's."""
        speed = float(slide(layout, now.velocity)[i])
        before = float(slide(layout, self._past[-1].velocity)[i]) if self._past else speed
        after = speed * self._past[-1].h / (before - speed) if before > speed else now.h
        return now.t + min(after, now.h)


def _used(layout: PointLayout, i: int, force: Array) -> float:
    """|f_t| / (mu f_n) of a point with friction; zero where it is unloaded."""
    n = int(layout.normals[i])
    limit = float(layout.mu[i] * force[n])
    return float(np.hypot(force[n - 2], force[n - 1])) / limit if limit > 0.0 else 0.0
