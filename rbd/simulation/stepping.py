"""Simulation by time steps: the settings of `TimeStepping`, and the loop over the steps.

The loop alone keeps what changes from step to step: the instant that a step begins at, and the memory of event detection.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from rbd.arrays import a_number, zeros
from rbd.errors import InputError
from rbd.model.state import State
from rbd.simulation.contact_points import slide, stopping
from rbd.simulation.events import Event, EventDetection, Sample
from rbd.simulation.motion import Motion
from rbd.simulation.recording import constraint_forces, least_forces
from rbd.simulation.time_step import HalfStep, StepSystem


@dataclass(frozen=True)
class TimeStepping:
    """Contact motion by time stepping: sticking, slipping, rolling, lift-off, impacts; order 2 between and across impacts.

    Attributes:
        impact_speed: A point that approaches slower than this [m/s, rad/s] comes to rest without a bounce.
        impacts: So many impacts are found in one step, each at its own time; then what touches is plastic till the step ends
            (a ball that comes to rest bounces without end).
        extrapolate: Take the first half of a step as the step before went on, where nothing has changed, in place of solving it
            (forces are then solved only where they are recorded). Still of order 2; faster, with errors two to five times as
            large, and stiff feedback stays stable for half as long steps only.

    Raises:
        InputError: a speed that is not positive, a number of impacts below zero.
    """

    impact_speed: float = 1e-3
    impacts: int = 20
    extrapolate: bool = False

    def __post_init__(self) -> None:
        if not 0.0 < a_number(self.impact_speed) <= 1e3:
            raise InputError(f"impact_speed is {self.impact_speed!r:.80}; expected a speed above 0 [m/s].")
        if isinstance(self.impacts, bool) or not isinstance(self.impacts, int | np.integer) or not 0 <= self.impacts <= 10_000:
            raise InputError(f"impacts is {self.impacts!r:.80}; expected a whole number from 0.")
        if not isinstance(self.extrapolate, bool):
            raise InputError(f"extrapolate is {self.extrapolate!r:.80}; expected True or False.")

    def reason_unsupported(self, motion: Motion, state: State) -> str | None:
        """It takes all constraints."""
        return None

    def run(self, motion: Motion, state: State, times: Sequence[float]) -> Iterator[Sample]:
        """One sample at each of the times."""
        system = StepSystem(motion, state, impact_speed=self.impact_speed, impacts=self.impacts, extrapolate=self.extrapolate)
        detection, last = EventDetection(), len(times) - 1
        now, passed = system.begin(state, times[0])
        detection.add(passed)
        for k, t in enumerate(times):
            h = times[k + 1] - t if k < last else t - times[k - 1] if k else 1e-3
            half = system.half_step(now, h)
            make = _recorded if motion.recorded(k, times) else _passed_by
            yield make(system, half, detection.taken())
            if k < last:
                now, passed = system.step(half, times[k + 1])
                detection.add(passed)


def _passed_by(system: StepSystem, half: HalfStep, events: tuple[Event, ...]) -> Sample:
    """A sample that is not recorded: no forces, and the acceleration of the half step, which may be extrapolated."""
    state = half.start.at.state
    a = (half.answer.v - state.v) * (2.0 / half.h) - system.bases.spin(state.v)
    return Sample.of(half.start.t, state, a, zeros(state.robot.nu), dict, events=events)


def _recorded(system: StepSystem, half: HalfStep, events: tuple[Event, ...]) -> Sample:
    """A sample with torques, forces and residuals; the steps do not depend on what is recorded."""
    start = half.start
    at, t, motion = start.at, start.t, system.motion
    if half.tau is None:
        half = system.solved(start, half.h)
    if stopping(at.layout, half.u, half.answer.velocity, half.answer.impulse) is not None:
        half = system.solved(start, 1e-3 * half.h)  # what slides now and stops within the half step slides in the record
    answer, h, active = half.answer, 0.5 * half.h, half.active
    assert half.tau is not None
    speed, names = slide(at.layout, answer.velocity), tuple(c.name for c in motion.constraints)
    a = (answer.v - at.state.v) / h - system.bases.spin(at.state.v)
    return Sample.of(
        t,
        at.state,
        a,
        half.tau,
        lambda: constraint_forces(at, least_forces(at, active, answer, h, motion.law), speed, names),
        law=answer.law,
        drift=at.drift,
        drift_rate=at.drift_rate,
        penetration=at.penetration,
        events=events,
    )
