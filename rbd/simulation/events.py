"""`StateEvent`, a function of the state whose zeros a simulation finds; `Switch`; and the search for the zeros.

A function's *side* is its last sign other than zero. A zero is found where the sign at the end of an interval is not that of
the side: its time by Brent's method [Brent1973], chapter 4, which brackets the zero and does not need derivatives, to
1e-12 s or the rounding of times. An interval of time steps ends at each touch: a function that would have passed zero within
the rounding of the touch's time, as the height of the point that touches, is zero there; then the state jumps by the impact.
"""

from __future__ import annotations

import inspect
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from scipy.optimize import brentq

from rbd.arrays import Array, as_float, check_flag, check_number
from rbd.control.schedules import INSTANT
from rbd.displayed import Displayed
from rbd.errors import BadEvent, InputError, Reason, UnknownName, nearest
from rbd.errors.inputs import check_different
from rbd.model.state import State

Function: TypeAlias = Callable[..., Any]
"""A number of (state) or of (state, t)."""
_NAMELESS = ("<lambda>", "partial")
"""Names of functions that have none: they are called by their number."""


@dataclass(frozen=True, eq=False)
class Switch(Displayed):
    """What changes at an event: constraints begin and cease to act, the state is replaced, an impact follows.

    In this order: the state becomes (q, v), where they are given; constraints are switched; and the constraints that then act
    stop the velocities that they do not allow, as `rbd.impact` computes. A bilateral contact without an anchor is anchored
    where it is when it is switched on. A contact below its plane cannot be switched on: that stops the simulation.

    Attributes:
        on: Name, or names, of constraints of the motion that act from now on; those that act already stay.
        off: Name, or names, of those that act no longer: they take no part in the impact, and touches of a contact that is
            off are ignored.
        impact: Whether there is an impact; without one v stays as it is, and must be allowed by bilateral constraints.
        q: Configuration after it, shape (nq,); None: as before.
        v: Velocity before the impact, shape (nv,); None: as before.

    Raises:
        InputError: names that are no text, or both on and off; `impact` that is not True or False.

    Example:
        >>> rbd.simulation.Switch(on="right", off="left")
        Switch(on=('right',), off=('left',), impact=True, q=None, v=None)
    """

    on: str | Sequence[str] = ()
    off: str | Sequence[str] = ()
    _: KW_ONLY
    impact: bool = True
    q: Sequence[float] | Array | None = None
    v: Sequence[float] | Array | None = None

    def __post_init__(self) -> None:
        for what in ("on", "off"):
            object.__setattr__(self, what, names_of(f"{what} of a Switch", getattr(self, what)))
        both = sorted(set(self.on) & set(self.off))
        if both:
            raise InputError(f"a Switch has {both[0]!r:.80} both on and off; give it once.")
        check_flag("impact of a Switch", self.impact)


Then: TypeAlias = Switch | Callable[[State, float], Switch | None]
"""What happens at an event, or a function of the state and the time there that says it."""


@dataclass(frozen=True, eq=False)
class StateEvent(Displayed):
    """An event of a simulation: a function of the state, f(state) or f(state, t), becomes zero or changes its sign.

    A plain function does as well; its attributes `direction` and `terminal` are then read as by SciPy's `solve_ivp`. An event
    is found where f has another sign at the end of a step, or at a sample, than before; then its time is computed to 1e-12 s
    (or rounding). Two zeros within one step are missed: give a shorter step. f that is zero at the start of a motion, or
    after a switch, has no event until it has become zero again.

    Attributes:
        function: f, a finite number.
        name: Name; None: the function's.
        direction: 1 finds zeros at which f rises, -1 those at which it falls, 0 both.
        terminal: Whether the motion ends there; or at the how manieth zero, from 1.
        then: What changes there: a `Switch`, or a function of the state and the time that returns one, or None for nothing.
        while_on: Names of constraints; the event is only looked for while all of these act.
        while_off: Names of constraints; the event is only looked for while none of these acts.
        zero: Values up to this size count as zero: give one where f is not exact, as the height of a foot on the ground is
            not in time steps, which correct positions to 1e-9 m.
        required: Whether a motion without this event is an error.

    Raises:
        InputError: a function that cannot be called, a direction other than -1, 0, 1, a number of zeros below 1.

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> half = rbd.simulation.StateEvent(lambda state: state.q[2] - 0.5, "half way", terminal=True)
        >>> fall = rbd.simulate(rbd.State(box, [0, 0, 1, 0, 0, 0, 1]), duration=1.0, step=0.1, events=[half])
        >>> print(fall.events[0], f"{(2 * 0.5 / 9.81) ** 0.5:.6f} s", fall.t[-1] == fall.events[0].t)
        0.319275 s: half way falls through zero 0.319275 s True
    """

    function: Function
    name: str | None = None
    _: KW_ONLY
    direction: int = 0
    terminal: bool | int = False
    then: Then | None = None
    while_on: str | Sequence[str] = ()
    while_off: str | Sequence[str] = ()
    zero: float = 0.0
    required: bool = False
    _timed: bool = field(init=False, repr=False)

    def __post_init__(self) -> None:
        put, f = object.__setattr__, self.function
        if isinstance(f, type) or not callable(f):
            raise InputError(
                f"an event is {f!r:.80}; expected a function of the state, or of state and time, that gives a number."
            )
        name = self.name if self.name is not None else getattr(f, "__name__", type(f).__name__)
        if not isinstance(name, str) or not name:
            raise InputError(f"the name of an event is {name!r:.80}; expected text, e.g. 'strike'.")
        put(self, "name", name)
        if isinstance(self.direction, bool) or as_float(self.direction) not in (-1.0, 0.0, 1.0):
            raise InputError(
                f"direction of event {name!r:.80} is {self.direction!r:.80}; expected 1 (zeros at which the function rises), "
                "-1 (at which it falls) or 0 (both)."
            )
        put(self, "direction", int(self.direction))
        terminal = self.terminal
        if not isinstance(terminal, bool | np.bool) and not (isinstance(terminal, int | np.integer) and terminal >= 0):
            raise InputError(
                f"terminal of event {name!r:.80} is {terminal!r:.80}; expected True, False, or at the how manieth zero it ends."
            )
        put(self, "terminal", bool(terminal) if isinstance(terminal, bool | np.bool) else int(terminal))
        if (
            self.then is not None
            and not isinstance(self.then, Switch)
            and (isinstance(self.then, type) or not callable(self.then))
        ):
            raise InputError(
                f"then of event {name!r:.80} is {self.then!r:.80}; expected an rbd.simulation.Switch, or a function of state "
                "and time that returns one."
            )
        for what in ("while_on", "while_off"):
            put(self, what, names_of(f"{what} of event {name!r:.80}", getattr(self, what)))
        check_number(f"zero of event {name!r:.80}", self.zero, 0.0, expected="a number from 0")
        check_flag(f"required of event {name!r:.80}", self.required)
        put(self, "_timed", _takes_time(f))

    @classmethod
    def of(cls, given: object, number: int) -> StateEvent:
        """An event as it was given: itself, or a function with the attributes `direction` and `terminal`.

        Args:
            given: The event.
            number: Its number among all, from 1: the name of a lambda.

        Raises:
            InputError: it is neither.
        """
        if not isinstance(given, cls):
            if isinstance(given, type) or not callable(given):
                raise InputError(
                    f"event {number} is {given!r:.80}; expected a function of the state, e.g. lambda state: state.q[2], or an "
                    "rbd.simulation.StateEvent."
                )
            given = cls(
                given,
                getattr(given, "name", None) or None,
                direction=getattr(given, "direction", 0),
                terminal=getattr(given, "terminal", False),
                then=getattr(given, "then", None),
            )
        return replace(given, name=f"event {number}") if given.name in _NAMELESS else given

    def value(self, state: State, t: float) -> float:
        """F at a state and a time [s].

        Raises:
            BadEvent: it is no finite number, or the function cannot be called with these arguments.
        """
        try:
            found = self.function(state, t) if self._timed else self.function(state)
        except TypeError as error:
            how = "(state, t)" if self._timed else "(state)"
            raise BadEvent(f"event {self.name!r:.80} was called with {how} at t = {t:.6g} s, and failed: {error}.") from error
        if found is None:
            raise BadEvent(f"event {self.name!r:.80} gave None at t = {t:.6g} s; expected one number. Does it return one?")
        try:
            out = np.asarray(found, float)
        except (TypeError, ValueError):
            raise BadEvent(f"event {self.name!r:.80} gave {found!r:.80} at t = {t:.6g} s; expected one number.") from None
        if out.size != 1:
            raise BadEvent(
                f"event {self.name!r:.80} gave an array of shape {out.shape} at t = {t:.6g} s; expected one number. Give one "
                "event for each entry."
            )
        g = float(out.reshape(()) if out.ndim == 0 else out.ravel()[0])
        if not np.isfinite(g):
            raise BadEvent(f"event {self.name!r:.80} gave {g} at t = {t:.6g} s; expected a finite number.")
        return g


def _takes_time(f: Function) -> bool:
    """Whether a function takes a state and a time, and not the state alone."""
    try:
        inspect.signature(f).bind(None, 0.0)
    except TypeError:
        return False
    except ValueError:  # some that are written in C have no signature
        return False
    parameters = [p for p in inspect.signature(f).parameters.values() if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)]
    second = parameters[1] if len(parameters) > 1 else None
    return second is None or second.default is second.empty or second.name == "t"


def names_of(what: str, given: object) -> tuple[str, ...]:
    """Names as a tuple: one name, or several.

    Raises:
        InputError: they are no names.
    """
    if isinstance(given, str):
        return (given,)
    names = tuple(given) if isinstance(given, Sequence | set | frozenset) else (given,)
    for name in names:
        if not isinstance(name, str):
            raise InputError(f"{what} is {given!r:.80}; expected names of constraints.")
    return names


def events_of(given: object, constraints: Sequence[str]) -> tuple[StateEvent, ...]:
    """The events of a motion, checked.

    Args:
        given: Events, or functions; one or a list of them.
        constraints: Names of the motion's constraints.

    Raises:
        InputError: no events, or two of one name, or with the name of a constraint.
        UnknownName: an event names a constraint that is not there.
    """
    if isinstance(given, StateEvent) or (callable(given) and not isinstance(given, Sequence)):
        given = [given]
    if isinstance(given, str | bytes) or not isinstance(given, Sequence):
        raise InputError(
            f"events are {given!r:.80}; expected a list of functions of the state, or of rbd.simulation.StateEvent."
        )
    out = tuple(StateEvent.of(each, i) for i, each in enumerate(given, 1))
    check_different([event.name for event in out], "events")  # type: ignore[misc]  # all have names
    for event in out:
        if event.name in constraints:
            raise InputError(f"event {event.name!r:.80} has the name of a constraint; give it another one.")
        switch = event.then if isinstance(event.then, Switch) else Switch()
        for what, names in (
            ("while_on", event.while_on), ("while_off", event.while_off), ("then.on", switch.on), ("then.off", switch.off),
        ):  # fmt: skip
            check_known(f"{what} of event {event.name!r:.80}", names, constraints)
    return out


def check_known(what: str, names: Sequence[str], constraints: Sequence[str]) -> None:
    """Refuse names that are no constraints of a motion.

    Raises:
        UnknownName: the first, with the nearest ones.
    """
    for name in names:
        if name not in constraints:
            raise UnknownName(
                f"{what} names {name!r:.80}, which is no constraint of this motion; {nearest(name, constraints)}."
            )


FOUND = 1e-12
"""Error of the time of a zero [s], where rounding of times is smaller."""
SOON = 1e-4
"""Zeros nearer to each other than this, over the time between samples: two such intervals in a row are chatter."""
_WINDOW, _MOST = 10, 8
"""Chatter as well: so many steps looked back upon, and at least so many zeros in them."""
ROUNDING = 4.0 * float(np.finfo(float).eps)
"""Error of the time of a zero, over the time, if that is larger."""


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


class ImpactState(NamedTuple):
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

    def between(self, t: float, state: State, at: Callable[[float], State], impact: ImpactState | None = None) -> list[Zero]:
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

    def _touches(self, course: _Course, value: float, impact: ImpactState, t: float) -> bool:
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
        return 0 < event.terminal <= course.count

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
        known = {a: side * value_a - zero, b: side * value_b - zero}

        def off(t: float) -> float:
            return known[t] if t in known else side * event.value(at(t), t) - zero

        # The interval begins with a sample.
        return max(brentq(off, a, b, xtol=FOUND, rtol=ROUNDING, maxiter=1000), float(np.nextafter(a, np.inf)))
