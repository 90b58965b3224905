"""The parts of a motion between switches: at an event, constraints begin and cease to act, and an integrator starts anew.

Each part is a run of the integrator with the constraints that act. A constraint keeps its anchor: where it was when it was
switched on, or at the start of the motion.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from rbd.arrays import Array
from rbd.constraints.constraint import Constraint, anchored, rows_of
from rbd.constraints.distance_warnings import distant
from rbd.control.accepted_steps import INSTANT
from rbd.control.schedules import asked
from rbd.errors import InputError
from rbd.model.state import State
from rbd.simulation.energy_balance import energy
from rbd.simulation.impacts import AT_REST, impact_of
from rbd.simulation.motion import AtEvents, Event, Integrator, Motion, Sample
from rbd.simulation.state_events import StateEvent, Switch, check_known

TOUCHES, LEAVES = "touches", "leaves"


class Phases:
    """A motion whose constraints are switched at events.

    Args:
        motion: The motion, with all its constraints.
        inactive: Names of those that do not act at the start.
        state: Its start.
        times: Sample times [s].

    Attributes:
        ended: Names of the events that ended it; empty where none did.
    """

    def __init__(self, motion: Motion, inactive: Sequence[str], state: State, times: Sequence[float]) -> None:
        self._motion, self._times, self._state = motion, times, state
        self._active = [c for c in motion.constraints if c.name not in inactive]
        self._since = {c.name: state for c in self._active}
        self._anchored: dict[str, Constraint] = {}
        self.ended: tuple[str, ...] = ()

    def run(self, integrator: Integrator) -> Iterator[Sample]:
        """All samples, in order of time.

        Args:
            integrator: The integrator of each part.

        Raises:
            InputError: a switch that does not fit.
            NoSolution: an impact without a solution; and what the integrator raises.
        """
        motion, state, times = self._motion, self._state, self._times
        if not motion.search:  # nothing is switched
            yield from integrator.run(motion, state, times)
            return
        part, events, work = self._part(tuple(self._active), None), tuple[Event, ...](), (0.0, 0.0, 0.0)
        while True:
            last: Sample | None = None
            for i, sample in enumerate(integrator.run(part, state, times)):
                if any(work):
                    done, taken, other = work
                    done, taken, other = done + sample.motor_work, taken + sample.dissipated, other + sample.other_work
                    sample = sample.but(motor_work=done, dissipated=taken, other_work=other)
                if part.before is not None and not i:
                    sample = sample.but(events=(*events, *sample.events), found=AtEvents((), True))
                if sample.found is not None and sample.found.interrupts:
                    last = sample
                    break
                yield sample
                if self.ended:
                    return
            if last is None:
                return
            assert last.found is not None and motion.search is not None
            stops, t = last.found.interrupts, last.t
            self.ended = tuple(str(event.name) for event in stops if motion.search.ends(event))
            if self.ended and not any(event.then is not None for event in stops):
                yield last
                return
            state, made = self._switched(stops, last.state, t)
            given = 0.0 if state is last.state else energy(motion, state) - energy(motion, last.state)
            work = last.motor_work, last.dissipated, last.other_work + given
            events = (*last.events, *made)
            rest = [] if self.ended else [x for x in self._times if x > t + INSTANT]
            times = [t, *rest]
            part = self._part(self._placed(), len(self._times) - len(rest))

    def _part(self, acting: tuple[Constraint, ...], before: int | None) -> Motion:
        """The motion from one switch to the next."""
        off = frozenset(self._motion.names).difference(c.name for c in acting)
        return replace(self._motion, constraints=acting, before=before, inactive=off)

    def _switched(self, stops: Sequence[StateEvent], state: State, t: float) -> tuple[State, list[Event]]:
        """(the state after the switches of events, the touches and ends of contact there)."""
        made: list[Event] = []
        for event in stops:
            switch = self._switch_of(event, state, t)
            if switch is not None:
                state = self._after(switch, str(event.name), state, t, made)
        return state, made

    def _switch_of(self, event: StateEvent, state: State, t: float) -> Switch | None:
        then, what = event.then, f"then of event {event.name!r:.80}"
        switch = asked(what, then, state, t) if callable(then) else then
        if switch is not None and not isinstance(switch, Switch):
            raise InputError(f"{what} gave {switch!r:.80} at t = {t:.6g} s; expected an rbd.simulation.Switch, or None.")
        if switch is not None:
            for side in ("on", "off"):
                check_known(f"{side} of the Switch of event {event.name!r:.80}", getattr(switch, side), self._motion.names)
        return switch

    def _after(self, switch: Switch, name: str, state: State, t: float, made: list[Event]) -> State:
        """The state after a switch; its touches and ends of contact are appended."""
        motion, before = self._motion, {c.name for c in self._active}
        if switch.q is not None or switch.v is not None:
            q: Array = state.q if switch.q is None else switch.q  # type: ignore[assignment]  # State checks it
            v: Array = state.v if switch.v is None else switch.v  # type: ignore[assignment]
            state = State(motion.robot, q, v)
        self._active = [c for c in motion.constraints if c.name in switch.on or (c.name in before and c.name not in switch.off)]
        new = [c for c in self._active if c.name not in before]
        for c in new:
            self._since[c.name] = state
            self._anchored.pop(c.name, None)
        told = distant(rows_of(state, new), below_only=True)
        if told:
            raise InputError(
                f"event {name!r:.80} at t = {t:.6g} s switches on what is off its ground: {', '.join(told[:6])}. To move it "
                "there would change the energy. Switch it on where it touches, e.g. at an event that is its height; give the "
                "plane, on=...; or move the robot, Switch(q=...)."
            )
        made += [Event(t, each, LEAVES, -1) for each in switch.off if each in before]
        if switch.impact and self._active:
            found = impact_of(state, self._active, motion.restitution or {}, law=motion.law, plastic=motion.plastic, t=t)
            for c in self._active:
                speed, size = found.approach.get(c.name, 0.0), found.normal_impulses.get(c.name, 0.0)
                if c in new or speed > AT_REST:
                    made.append(Event(t, c.name, TOUCHES, -1, speed, size))
            state = found.state
        else:
            made += [Event(t, c.name, TOUCHES, -1) for c in new]
        return state

    def _placed(self) -> tuple[Constraint, ...]:
        """The constraints that act, those that acted before at their anchors."""
        for c in self._active:
            if c.name not in self._anchored:
                since = self._since[c.name]
                (rows,) = rows_of(since, (c,))
                self._anchored[c.name] = anchored(c, rows, since)
        return tuple(self._anchored[c.name] for c in self._active)
