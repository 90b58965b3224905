"""Samples at events of the user, between the samples of an integrator."""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import Protocol

from rbd.control.schedules import INSTANT
from rbd.model.state import State
from rbd.simulation.event_detection import EventDetection
from rbd.simulation.events import FOUND, EventSearch, ImpactState, Zero
from rbd.simulation.instant import HalfStep, Step
from rbd.simulation.simulated_motion import AtEvents, Event, Sample
from rbd.simulation.smooth import SmoothMotion, SmoothStage
from rbd.simulation.time_step import StepSystem

RISES, FALLS = "rises through zero", "falls through zero"
"""Kinds of these events."""


def _crossed(
    search: EventSearch, zeros: list[Zero], since: float, t: float, sample: Callable[[float], Sample]
) -> Generator[Sample, None, bool]:
    """The samples at zeros within a step; returns whether the last of them interrupts the motion.

    Args:
        search: The search that found them.
        zeros: In order of time.
        since: Beginning of the step [s].
        t: Its end [s].
        sample: The sample at a time in it.
    """
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


class SmoothStep(Protocol):
    """Protocol of a step of smooth motion.

    Attributes:
        end: The stage at its end, on the constraints.
        next: Guess of the next step [s]; None: none.
    """

    end: SmoothStage
    next: float | None

    def at(self, t: float) -> SmoothStage:
        """The stage at a time within the step, on the constraints."""

    def state_at(self, t: float) -> State:
        """The state of that stage, perhaps without its acceleration."""


def crossed_smoothly(smooth: SmoothMotion, since: float, end: SmoothStage, step: SmoothStep) -> Generator[Sample, None, bool]:
    """The samples at events of smooth motion until a stage; returns whether the last interrupts the motion.

    Args:
        smooth: The motion.
        since: Beginning of the interval [s].
        end: The stage at its end.
        step: The step in which the interval is.
    """
    search = smooth.motion.search
    if not search:
        return False
    zeros = search.between(end.t, end.state, step.state_at)
    return (yield from _crossed(search, zeros, since, end.t, lambda t: smooth.sample(step.at(t))))


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
    since, search, touches = half.start.t, system.motion.search, end.passed.touches
    if not search:
        return False

    def at(when: float) -> Step:
        for touch in touches:
            if when == touch.after.t:
                return Step(touch.after, end.passed.until(touch))
        return end if when == t else system.step(half, when)

    def state_at(when: float) -> State:
        return at(when).end.at.state

    def sample(when: float) -> Sample:
        there = at(when).end
        return recorded(system, system.half_step(there, max(t - when, 1e-3 * (t - since))), ())

    for touch in [*touches, None]:
        if touch is None:
            zeros = search.between(t, end.end.at.state, state_at)
        else:
            late, before, after = min(touch.late, INSTANT), touch.before, touch.after
            q, v = system.bases.moved(before.q, before.v, late)
            impact = ImpactState(after.at.state, State(before.robot, q, v, t=before.t), late)
            zeros = search.between(after.t, before, state_at, impact)
        for each in _crossed(search, zeros, since, t, sample):
            assert each.found is not None
            if each.found.interrupts:
                detection.add(at(each.t).passed)
                yield each.but(events=(*detection.taken(), *each.events))
                return True
            yield each
    return False
