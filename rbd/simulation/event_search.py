"""The search for zeros of event functions: between the ends of steps and the samples, on the integrator's interpolant.

A function's *side* is its last sign other than zero. A zero is found where the sign at the end of an interval is not that of
the side: its time by Chandrupatla's method [Chandrupatla1997], which brackets the zero and does not need derivatives, to
1e-12 s or the rounding of times. An interval of time steps ends at each touch: a function that would have passed zero within
the rounding of the touch's time, as the height of the point that touches, is zero there; then the state jumps by the impact.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from rbd.control.accepted_steps import INSTANT
from rbd.errors import BadEvent, Reason
from rbd.model.state import State
from rbd.simulation.state_events import StateEvent

FOUND = 1e-12
"""Error of the time of a zero [s], where rounding of times is smaller."""
SOON = 1e-4
"""Zeros nearer to each other than this, over the time between samples: two such intervals in a row are chatter."""
_WINDOW, _MOST = 10, 8
"""Chatter, too: so many zeros in so many checks."""
_ROUNDS = 100


@dataclass(frozen=True)
class Zero:
    """A zero of an event function.

    Attributes:
        t: Its time [s].
        event: The event.
        rises: Whether the function rises through it.
    """

    t: float
    event: StateEvent
    rises: bool


class Impact(NamedTuple):
    """An impact at the end of an interval.

    Attributes:
        after: The state after it.
        through: The state that the motion would reach without it, a moment later.
        late: That moment [s].
    """

    after: State
    through: State
    late: float


@dataclass(eq=False)
class _Course:
    """What is known of one event function during a motion.

    Attributes:
        event: The event.
        value: At the end of the last interval.
        side: Its last sign that was not zero; 0: none was known since the start, or since a switch.
        floor: Values up to this size count as zero since a touch at which it was zero.
        count: Number of its zeros so far.
        looked: Whether it is looked for now.
        values: Number of its values, and whether one of them was not zero.
        last: Time of its last zero [s].
        near: Number of short intervals between zeros in a row.
        recent: Whether there was a zero at each of the last checks.
    """

    event: StateEvent
    value: float = 0.0
    side: int = 0
    floor: float = 0.0
    count: int = 0
    looked: bool = True
    values: int = 0
    nonzero: bool = False
    last: float = -np.inf
    near: int = 0
    recent: deque[bool] = field(default_factory=lambda: deque(maxlen=_WINDOW))

    def sign(self, value: float) -> int:
        """Its sign; zero up to the size that the event says."""
        return 0 if abs(value) <= max(self.event.zero, self.floor) else 1 if value > 0.0 else -1


class EventSearch:
    """Zeros of the events of one motion; it has the memory of earlier steps, across switches.

    Args:
        events: The events.
        step: Time between samples [s]: the unit of chatter.
    """

    def __init__(self, events: Sequence[StateEvent], step: float) -> None:
        self._courses = [_Course(event) for event in events]
        self._step, self._t, self._begun = step, 0.0, 0.0

    def __bool__(self) -> bool:
        return bool(self._courses)

    def begin(self, state: State, t: float, active: Sequence[str]) -> None:
        """A motion begins, or goes on after a switch.

        Args:
            state: Its state.
            t: Its time [s].
            active: Names of the constraints that act.

        Raises:
            BadEvent: a value that is no finite number.
        """
        self._t = self._begun = t
        for course in self._courses:
            event, fired = course.event, abs(course.last - t) <= INSTANT
            course.looked = set(event.while_on) <= set(active) and not set(event.while_off) & set(active)
            if not course.looked:
                course.side = 0
                continue
            course.value = self._value(course, state, t)
            course.side = 0 if fired else course.sign(course.value)

    def between(self, t: float, state: State, at: Callable[[float], State], impact: Impact | None = None) -> list[Zero]:
        """The zeros since the last call, in order of time, up to the first that interrupts the motion.

        Args:
            t: The end of the interval [s]; it begins where the last one ended.
            state: The state there, before an impact.
            at: The state at any time in it.
            impact: The impact at its end, if there is one.

        Raises:
            BadEvent: a value that is no finite number; or zeros chatter.
        """
        since, self._t = self._t, t
        found: list[tuple[Zero, _Course]] = []
        for course in self._courses:
            if not course.looked:
                continue
            value = self._value(course, state, t)
            touches = impact is not None and self._touches(course, value, impact, t)
            begins = since
            if touches and course.sign(course.value) == 0:  # zero at two touches in a row: did it leave zero in between?
                begins = 0.5 * (since + t)
                self._passed(course, since, self._value(course, at(begins), begins), begins, at)
            zeros = [self._passed(course, begins, 0.0 if touches else value, t, at)]
            if impact is not None:
                after = self._value(course, impact.after, t)
                zeros.append(self._passed(course, t, 0.0 if touches and not course.sign(after) else after, t, at))
            found += [(zero, course) for zero in zeros if zero is not None]
        found.sort(key=lambda each: each[0].t)
        out: list[Zero] = []
        until = np.inf
        for zero, course in found:
            if zero.t > until:
                break
            self._count(course, zero.t)
            out.append(zero)
            if self.interrupts(zero.event):
                until = min(until, zero.t + FOUND)
        return out

    def _touches(self, course: _Course, value: float, impact: Impact, t: float) -> bool:
        """Whether a function is zero where an impact is: it would have passed zero within the rounding of its time."""
        change = self._value(course, impact.through, t + impact.late) - value
        if course.side * change >= 0.0 or abs(value) > abs(change):
            return False
        course.floor = abs(change)
        return True

    def _passed(self, course: _Course, since: float, value: float, t: float, at: Callable[[float], State]) -> Zero | None:
        """The zero of a function between a time and another, where it has a value; where both are one, at a jump."""
        before, side = course.value, course.side
        course.value, sign = value, course.sign(value)
        crosses = bool(side) and sign != side and course.sign(before) == side
        if sign:
            course.side = sign
        if not crosses or course.event.direction * side > 0:
            course.recent.append(False)
            return None
        when = t if since == t else self._zero(course, side, since, before, t, value, at)
        rounding = when <= self._begun + INSTANT and since == self._begun  # at the start
        course.recent.append(not rounding)
        return None if rounding else Zero(when, course.event, side < 0)

    def interrupts(self, event: StateEvent) -> bool:
        """Whether the last zero of an event ends the motion, or may change it."""
        return event.then is not None or self.ends(event)

    def ends(self, event: StateEvent) -> bool:
        """Whether the last zero of an event ends the motion."""
        course = next(c for c in self._courses if c.event is event)
        return bool(event.ends_at) and course.count >= event.ends_at

    @property
    def absent(self) -> tuple[str, ...]:
        """Names of the events that have not happened."""
        return tuple([str(course.event.name) for course in self._courses if not course.count])

    def missing(self) -> tuple[str, Reason]:
        """(message: which events were zero throughout, or required and did not happen, the reason); empty if there are none."""
        out, reason = [], Reason.NONE
        for course in self._courses:
            name = course.event.name
            if course.values > 2 and not course.nonzero:
                out.append(
                    f"event {name!r:.80} was zero at all {course.values} states at which it was computed: it has no events. "
                    "Does it return what was meant?"
                )
                reason = Reason.STOPPED_BAD_EVENT
            elif course.event.required and not course.count:
                out.append(f"event {name!r:.80} is required, and did not happen; its last value is {course.value:.6g}.")
                reason = reason or Reason.STOPPED_NO_EVENT
        return " ".join(out), reason

    def _value(self, course: _Course, state: State, t: float) -> float:
        value = course.event.value(state, t)
        course.values += 1
        course.nonzero = course.nonzero or course.sign(value) != 0
        return value

    def _count(self, course: _Course, t: float) -> None:
        course.count += 1
        course.near = course.near + 1 if t - course.last < SOON * self._step else 0
        course.last = t
        often = sum(course.recent)
        if course.near > 1 or often >= _MOST:
            how = (
                f"three zeros within {2.0 * SOON * self._step:.3g} s"
                if course.near > 1
                else f"{often} zeros in {_WINDOW} steps"
            )
            raise BadEvent(
                f"event {course.event.name!r:.80} chatters: {how}, the last at t = {t:.6g} s. If it is zero but for "
                "rounding, give StateEvent(..., zero=) the size of its errors; if its zeros come ever faster, as the bounces "
                "of a ball, end the motion before, or switch a constraint on; if it oscillates, give a shorter step."
            )

    def _zero(
        self, course: _Course, side: int, a: float, value_a: float, b: float, value_b: float, at: Callable[[float], State]
    ) -> float:
        """The time in (a, b] at which the function leaves its side."""
        event, zero = course.event, course.event.zero
        if side * value_b > zero:
            return b  # zero within the rounding of a touch
        cache: dict[float, float] = {a: side * value_a - zero, b: side * value_b - zero}

        def off(t: float) -> float:
            if t not in cache:
                cache[t] = side * event.value(at(t), t) - zero
            return cache[t]

        found = bracketed_zero(off, a, b, max(FOUND, 4.0 * float(np.finfo(float).eps) * abs(b)))
        return max(found, float(np.nextafter(a, np.inf)))  # the interval begins with a sample


def bracketed_zero(f: Callable[[float], float], a: float, b: float, within: float) -> float:
    """The zero of a function in an interval, to a tolerance: inverse quadratic interpolation, or bisection [Chandrupatla1997].

    Args:
        f: Positive at a, zero or negative at b.
        a: Beginning of the interval.
        b: Its end.
        within: Error of the zero.
    """
    x0, x1, f0, f1 = a, b, f(a), f(b)
    x2, f2, t = x0, f0, 0.5
    for _ in range(_ROUNDS):
        best = x1 if abs(f1) < abs(f0) else x0
        share = 0.5 * within / max(abs(x1 - x0), within)
        if share >= 0.5 or f1 == 0.0 or f0 == 0.0:
            return best
        x = x0 + min(max(t, share), 1.0 - share) * (x1 - x0)
        fx = f(x)
        if (fx > 0.0) == (f0 > 0.0):
            x2, f2, x0, f0 = x0, f0, x, fx
        else:
            x2, f2, x1, f1, x0, f0 = x1, f1, x0, f0, x, fx
        # x0 is the last point, x1 the other side of the bracket, x2 the point before
        ratio, slope = (x0 - x1) / (x2 - x1), (f0 - f1) / (f2 - f1) if f2 != f1 else 0.5
        if slope * slope < ratio and (1.0 - slope) ** 2 < 1.0 - ratio:
            t = f0 / (f1 - f0) * f2 / (f1 - f2) + (x2 - x0) / (x1 - x0) * f0 / (f2 - f0) * f1 / (f2 - f1)
        else:
            t = 0.5
    return x1 if abs(f1) < abs(f0) else x0
