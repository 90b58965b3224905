"""Samples at events of the user, between the samples of an integrator."""

from __future__ import annotations

from collections.abc import Callable, Generator

from rbd.control.accepted_steps import INSTANT
from rbd.model.state import State
from rbd.simulation.event_detection import EventDetection
from rbd.simulation.event_search import FOUND
from rbd.simulation.instant import HalfStep, Step
from rbd.simulation.motion import AtEvents, Event, Motion, Sample
from rbd.simulation.smooth import SmoothMotion, Stage
from rbd.simulation.time_step import StepSystem

RISES, FALLS = "rises through zero", "falls through zero"
"""Kinds of these events."""


def _crossed(
    motion: Motion, since: float, t: float, state: State, at: Callable[[float], State], sample: Callable[[float], Sample]
) -> Generator[Sample, None, bool]:
    """The samples at the events of an interval; returns whether the last of them interrupts the motion.

    Args:
        motion: The motion.
        since: Beginning of the interval [s].
        t: Its end [s].
        state: The state there.
        at: The state at a time in it, by the integrator's interpolant.
        sample: The sample at such a time.
    """
    search = motion.search
    if not search:
        return False
    zeros = search.between(t, state, at)
    while zeros:
        now = [zero for zero in zeros if zero.t <= zeros[0].t + FOUND]
        zeros = zeros[len(now) :]
        stops = tuple(zero.event for zero in now if search.interrupts(zero.event))
        when = now[-1].t
        apart = since + INSTANT < when < t - INSTANT
        events = tuple(Event(zero.t, str(zero.event.name), RISES if zero.rises else FALLS, -1) for zero in now)
        found = sample(when)
        yield found.but(events=(*found.events, *events), found=AtEvents(stops, apart or bool(stops)))
        if stops:
            return True
    return False


def crossed_smoothly(
    smooth: SmoothMotion,
    since: float,
    end: Stage,
    at: Callable[[float], Stage],
    state_at: Callable[[float], State] | None = None,
) -> Generator[Sample, None, bool]:
    """The samples at events of smooth motion until a stage; returns whether the last interrupts the motion.

    Args:
        smooth: The motion.
        since: Beginning of the interval [s].
        end: The stage at its end.
        at: The stage at a time in it.
        state_at: The state there, if that is cheaper.
    """
    states = state_at or (lambda t: at(t).state)
    return (yield from _crossed(smooth.motion, since, end.t, end.state, states, lambda t: smooth.sample(at(t))))


def crossed_in_step(
    system: StepSystem,
    half: HalfStep,
    end: Step,
    t: float,
    detection: EventDetection,
    recorded: Callable[[StepSystem, HalfStep, tuple[Event, ...]], Sample],
) -> Generator[Sample, None, bool]:
    """The samples at events of a time step, each by a shorter step; returns whether the last interrupts the motion.

    Args:
        system: The motion.
        half: The first half of the step.
        end: The end of the step.
        t: Its time [s].
        detection: Is told what happened until an event that interrupts the motion.
        recorded: The sample of a half step.
    """
    since = half.start.t

    def at(when: float) -> Step:
        return end if when == t else system.step(half, when)

    def sample(when: float) -> Sample:
        there = at(when).end
        return recorded(system, system.half_step(there, max(t - when, 1e-3 * (t - since))), ())

    found = _crossed(system.motion, since, t, end.end.at.state, lambda when: at(when).end.at.state, sample)
    for each in found:
        assert each.found is not None
        if each.found.interrupts:
            detection.add(at(each.t).passed)
            yield each.but(events=(*detection.taken(), *each.events))
            return True
        yield each
    return False
