"""What a simulation knows at one time, and what happened since the time before: contacts that begin, end, slip and stick."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array
from rbd.model.state import State
from rbd.simulation.contact_points import SLIDES, Layout, slide

OPEN, STICKS, SLIPS, HOLDS, PUSHES = "open", "sticks", "slips", "holds", "pushes"
"""Modes of a constraint: no force; at rest; sliding; held whatever it takes; a stop or a smooth contact that pushes."""


@dataclass(frozen=True, eq=False)
class Touch:
    """What one constraint does to the robot at one time.

    Attributes:
        force: Force (3,) of a point, wrench (6,) of a surface at its centre: on the robot, world axes [N, N m]. A constraint
            without a resultant (a function, a joint) gives its row forces (m,); zeros where it is not active.
        mode: "open", "sticks", "slips", "holds" or "pushes"; of several points, that of the one that slips, else of the one
            that is closed.
        points: Where it touches, in W, shape (k, 3) [m]; None of what is no contact.
        point_forces: The force at each point, on the robot, world axes, shape (k, 3) [N]; None of what is no contact.
    """

    force: Array
    mode: str
    points: Array | None = None
    point_forces: Array | None = None


@dataclass(frozen=True)
class Event:
    """A beginning or an end of contact.

    Attributes:
        t: When [s].
        name: Of the constraint.
        kind: "touches" (with an impact, or softly), "leaves", "slips" or "sticks".
        point: Which of its points, from 0.
        speed: Of a touch: how fast it approached [m/s, rad/s]; else zero.
        impulse: Of a touch: normal impulse of the impact [N s, N m s]; else zero.
    """

    t: float
    name: str
    kind: str
    point: int = 0
    speed: float = 0.0
    impulse: float = 0.0

    def __str__(self) -> str:
        impact = f" at {self.speed:.3g} m/s, impulse {self.impulse:.3g} N s" if self.speed else ""
        return f"{self.t:.6f} s: {self.name}[{self.point}] {self.kind}{impact}"


@dataclass(frozen=True, eq=False)
class Moment:
    """A simulation at one time.

    Attributes:
        t: [s].
        state: Configuration and velocity.
        a: Acceleration at t, shape (nv,): M a + h = S^T tau + tau_ext + J^T f holds with the forces of `touches`.
        tau: Motor torques at t, shape (nu,) [N, N m].
        touches: Makes {constraint: what it does} when called; dear, so only where it is recorded.
        law: How far the forces are from the law they obey, scaled.
        drift: Largest position error of the constraints that hold [m, rad].
        drift_rate: Largest velocity error of the constraints that hold [m/s, rad/s].
        penetration: How deep the deepest contact is in what it touches [m, rad]; zero or more.
        events: What happened since the moment before, in order of time.
    """

    t: float
    state: State
    a: Array
    tau: Array
    touches: Callable[[], Mapping[str, Touch]]
    law: float = 0.0
    drift: float = 0.0
    drift_rate: float = 0.0
    penetration: float = 0.0
    events: tuple[Event, ...] = ()


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


def _used(layout: Layout, i: int, force: Array) -> float:
    """|f_t| / (mu f_n) of a point with friction; zero where it carries nothing."""
    n = int(layout.normals[i])
    limit = float(layout.mu[i] * force[n])
    return float(np.hypot(force[n - 2], force[n - 1])) / limit if limit > 0.0 else 0.0
