"""Integrators: of smooth motion on the manifold, at order 4 or 8; and of motion with contacts, at order 2 by time steps.

Each is a loop that yields samples. Only the loop has state from step to step; of time steps this is the instant at which one
begins, and event detection.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np
from scipy.integrate import DOP853

from rbd.arrays import Array, check_flag, check_number, check_positive, check_whole, max_abs, zeros
from rbd.constraints.constraint import Constraint, ground_of, member, rows_of
from rbd.control.schedules import INSTANT, sample_at
from rbd.displayed import Displayed
from rbd.errors import NoSolution
from rbd.model.state import State
from rbd.simulation.event_detection import EventDetection
from rbd.simulation.event_samples import SmoothStep, crossed_in_step, crossed_smoothly
from rbd.simulation.instant import HalfStep, touches_of
from rbd.simulation.recording import StepForces, least_forces
from rbd.simulation.simulated_motion import Event, Sample, SimulatedMotion, stored
from rbd.simulation.smooth import SmoothMotion, SmoothStage, reason_not_smooth, reason_unknown_ground
from rbd.simulation.time_step import StepSystem

TILTS = 1e-9
"""A ground that rotates more slowly than this about an axis in its plane [rad/s] has a constant normal: rounding."""
SHORTEST = 1e-9
"""Shortest step that is tried [s]."""


@dataclass(frozen=True)
class RungeKutta4(Displayed):
    """Integrator of smooth motion at a fixed step, with an error of h^4; for bilateral constraints.

    Every step has a separate chart, q = q0 (+) xi, in which Kutta's method of 1901 is applied to (xi, v); controllers and
    external forces are evaluated at all four stages. Constraints are kept by `stabilisation`. The error is not controlled:
    compare two steps, or `rbd.DormandPrince8`. A step must be short against the fastest oscillation w: beyond 2.8 / w it is
    unstable.

    Example:
        >>> robot = rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0)
        >>> kutta = rbd.RungeKutta4()
        >>> swing = rbd.simulate(robot.at("assembled"), robot.loops(), duration=0.2, step=5e-3, integrator=kutta)
        >>> print(np.ptp(swing.energy) < 1e-6, swing.residuals["drift"].max() < 1e-11)
        True True
    """

    finds_events: ClassVar[bool] = True
    order: ClassVar[int] = 4

    def reason_unsupported(self, motion: SimulatedMotion, state: State) -> str | None:
        """Names the first constraint that can break or slip, or that the start violates; None if it can run."""
        return reason_not_smooth(motion, state)

    def run(self, motion: SimulatedMotion, state: State, times: Sequence[float]) -> Iterator[Sample]:
        """One sample at each of the times, the first at `state`.

        Raises:
            NoSolution: a step without an acceleration, or beyond all bounds.
        """
        return _smooth_samples(motion, state, times, _KuttaStep, _next_sample)


def _next_sample(t: float, times: Sequence[float], every: float | None) -> float:
    """Time of the sample after t [s]; of the last one its own."""
    return times[min(bisect_right(times, t), len(times) - 1)]


class _KuttaStep:
    """One step of Kutta's method, to a given time.

    Attributes:
        end: The stage at its end, on the constraints.
        next: None: no guess of the next step.
    """

    next: float | None = None

    def __init__(self, smooth: SmoothMotion, start: SmoothStage, stop: float, h: float | None) -> None:
        self._smooth, self._start = smooth, start
        self.end = self.at(stop)

    def at(self, t: float) -> SmoothStage:
        """A stage within the step, by a shorter one."""
        smooth, first, h, v, a = self._smooth, self._start, t - self._start.t, self._start.state.v, self._start.a
        chart = smooth.charts.at(first.state.q)
        rates, accelerations, powers, rate = [v], [a], [smooth.powers(first, first)], v
        for part in (0.5, 0.5, 1.0):
            xi, w = part * h * rate, v + part * h * a
            stage = smooth.at(chart.q(xi), w, first.t + part * h)
            a, rate = stage.a, chart.rate(xi, stage.state.v)
            rates.append(rate)
            accelerations.append(a)
            powers.append(smooth.powers(first, stage))
        xi, dv, work = (h / 6.0 * (k[0] + 2.0 * k[1] + 2.0 * k[2] + k[3]) for k in (rates, accelerations, powers))
        return smooth.worked(first, smooth.landed(chart.q(xi), v + dv, t), work)

    def state_at(self, t: float) -> State:
        """The state of `at`."""
        return self.at(t).state


def _smooth_samples(
    motion: SimulatedMotion,
    state: State,
    times: Sequence[float],
    step_of: Callable[[SmoothMotion, SmoothStage, float, float | None], SmoothStep],
    stop_of: Callable[[float, Sequence[float], float | None], float],
    longest: float = math.inf,
    most_steps: float = math.inf,
) -> Iterator[Sample]:
    """The samples of smooth motion, by steps.

    Args:
        motion: The motion.
        state: Its start.
        times: Of the samples [s].
        step_of: Gives the step from a stage, at most to a time, with a guess of its length.
        stop_of: Gives the time that a step must not pass, from the time at which it begins, `times` and the time between the
            controller's samples [s].
        longest: Longest step [s].
        most_steps: Number of steps between two samples at which the motion is given up.

    Raises:
        NoSolution: a step without an acceleration, out of all bounds, or shorter than rounding; more than `most_steps`.
    """
    smooth = SmoothMotion(motion, state)
    stop = stop_of(times[0], times, motion.sample_period)
    stage = smooth.start(state, times[0], min(longest, stop - times[0]))
    motion.watch(stage.state, times[0])
    yield smooth.sample(stage)
    at, h, taken = 1, None, 0
    while at < len(times):
        if taken == most_steps:
            raise NoSolution(
                f"{taken:,} steps since the last sample have come to t = {stage.t:.9g} s, not to {times[at]:.6g} s. "
                "Take rbd.TimeStepping(), which takes stiff springs and dampers implicitly; or a larger most_steps."
            )
        taken += 1
        motion.refuse_jumps(stage.t, min(stop, stage.t + longest))
        step, since = step_of(smooth, stage, stop, h), stage.t
        while at < len(times) and times[at] < step.end.t:
            inside = step.at(times[at])
            if motion.search and (yield from crossed_smoothly(smooth, since, inside, step)):
                return
            yield smooth.sample(inside)
            at, since, taken = at + 1, times[at], 0
        if motion.search and (yield from crossed_smoothly(smooth, since, step.end, step)):
            return
        stop, h, length = stop_of(step.end.t, times, motion.sample_period), step.next, step.end.t - stage.t
        stage = smooth.begun(step.end, min(longest, stop - step.end.t) or length)
        if at < len(times) and times[at] == stage.t:
            yield smooth.sample(stage)
            at, taken = at + 1, 0


@dataclass(frozen=True)
class DormandPrince8(Displayed):
    """Integrator of smooth motion to a tolerance: steps as long as their error allows, dense output of order 7 between them.

    SciPy's DOP853 [Hairer1993] on (xi, v) in a chart q = q0 (+) xi that is recentred after each step, when the constraints
    are projected by `stabilisation`. For bilateral constraints.

    Attributes:
        rtol: Error of a step, over the size of the motion in it.
        atol: Error of a step [m, rad, and per second].
        longest: Longest step [s]: a shorter push on a robot at rest could be stepped over.
        most_steps: Number of steps between two samples at which a motion is given up: stiff force elements would take millions.

    Raises:
        InputError: tolerances that are not in [1e-13, 1e-2], a longest step that is not positive, a number of steps below 1.

    Example:
        >>> robot = rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0)
        >>> exact = rbd.DormandPrince8(rtol=1e-12, atol=1e-12)
        >>> swing = rbd.simulate(robot.at("assembled"), robot.loops(), duration=0.5, step=0.1, integrator=exact)
        >>> print(np.ptp(swing.energy) < 1e-9 * np.ptp(swing.kinetic))
        True
    """

    finds_events: ClassVar[bool] = True
    rtol: float = 1e-10
    atol: float = 1e-12
    longest: float = 0.05
    most_steps: int = 20_000

    def __post_init__(self) -> None:
        check_number("rtol of DormandPrince8", self.rtol, 1e-13, 1e-2, expected="a number from 1e-13 to 1e-2")
        check_number("atol of DormandPrince8", self.atol, 1e-18, 1e-2, expected="a number from 1e-18 to 1e-2")
        check_positive("longest of DormandPrince8", self.longest, math.inf, "s")
        check_whole("most_steps of DormandPrince8", self.most_steps, 10**12)

    def reason_unsupported(self, motion: SimulatedMotion, state: State) -> str | None:
        """Names the first constraint that can break or slip, or that the start violates; None if it can run."""
        return reason_not_smooth(motion, state)

    def run(self, motion: SimulatedMotion, state: State, times: Sequence[float]) -> Iterator[Sample]:
        """One sample at each of the times, the first at `state`.

        Raises:
            NoSolution: a step without an acceleration, out of all bounds, or shorter than rounding; more than `most_steps`.
        """
        return _smooth_samples(motion, state, times, partial(_AdaptiveStep, self), _next_stop, self.longest, self.most_steps)


def _next_stop(t: float, times: Sequence[float], every: float | None) -> float:
    """Time that a step from t must not pass [s]: the controller's next sample, or the end of the motion."""
    if every is None:
        return times[-1]
    sample = (sample_at(t, every) + 1) * every
    i = bisect_left(times, sample - INSTANT)
    return times[i] if i < len(times) and times[i] <= sample + INSTANT else min(sample, times[-1])


class _AdaptiveStep:
    """One step.

    Args:
        by: Tolerances.
        smooth: The motion.
        start: The stage at its beginning.
        last: Time that must not be passed [s]: the motion's end, or the controller's next sample.
        h: First guess of the step [s]; None for SciPy's.

    Attributes:
        end: The stage at its end, on the constraints.
        next: Guess of the next step [s].
    """

    def __init__(self, by: DormandPrince8, smooth: SmoothMotion, start: SmoothStage, last: float, h: float | None) -> None:
        self._smooth, self._start = smooth, start
        self._chart, self._n = smooth.charts.at(start.state.q), len(start.state.v)
        # The last entries are work, of motors and of force elements, in which no error is controlled.
        work = smooth.powers(start, start)
        y = np.concatenate([np.zeros(self._n), start.state.v, np.zeros(len(work))])
        atol = np.append(np.full(2 * self._n, by.atol), np.full(len(work), np.inf))
        first = None if h is None else min(h, last - start.t)
        while True:
            self._code = DOP853(self._rates, start.t, y, last, rtol=by.rtol, atol=atol, first_step=first, max_step=by.longest)
            try:
                said = self._code.step()
            except NoSolution:  # a trial too far ahead can leave the constraints, or meet a singular pose next to its branch
                first = 0.25 * float(self._code.h_abs if first is None else first)
                if first < SHORTEST * max(1.0, abs(start.t)):
                    raise
                continue
            break
        if self._code.status == "failed":
            raise NoSolution(
                f"no step is short enough at t = {start.t:.6g} s for rtol {by.rtol:g} and atol {by.atol:g}: {said} Is there a "
                "jump in the torques, or a singular pose with several motions?"
            )
        self.next: float | None = float(self._code.h_abs)
        self._between: Callable[[float], Array] | None = None
        self.end = self._landed(float(self._code.t), self._code.y)

    def at(self, t: float) -> SmoothStage:
        """A stage within the step, by dense output, on the constraints."""
        return self._landed(t, self._dense(t))

    def state_at(self, t: float) -> State:
        """The state within the step, as `at`, without its acceleration."""
        y = self._dense(t)
        return self._smooth.placed(self._chart.q(y[: self._n]), y[self._n : 2 * self._n], t).state

    def _dense(self, t: float) -> Array:
        if self._between is None:
            self._between = self._code.dense_output()
        return self._between(t)

    def _landed(self, t: float, y: Array) -> SmoothStage:
        xi, v, work = y[: self._n], y[self._n : 2 * self._n], y[2 * self._n :]
        return self._smooth.worked(self._start, self._smooth.landed(self._chart.q(xi), v, t), work)

    def _rates(self, t: float, y: Array) -> Array:
        xi, v, start = y[: self._n], y[self._n : 2 * self._n], self._start
        if t == start.t and not xi.any() and np.array_equal(v, start.state.v):
            return np.concatenate([v, start.a, self._smooth.powers(start, start)])  # known from the step before
        stage = self._smooth.at(self._chart.q(xi), v, t)
        return np.concatenate([self._chart.rate(xi, stage.state.v), stage.a, self._smooth.powers(start, stage)])


@dataclass(frozen=True)
class TimeStepping(Displayed):
    """Integrator of motion with contacts: sticking, slipping, rolling, lift-off, impacts; order 2 between and across impacts.

    What sticks to ground that moves by a motion has its velocity to rounding; its position to 1e-9 of its size.

    On dampers with h d/m above 1 the order is 1 to 1.75, see `rbd.simulation.implicit_forces`. Steps are short if h w is small
    against the fastest turn w: of two free links at h w = 0.5 the energy grows by 8 % in 0.2 s.

    Attributes:
        impact_speed: A point that approaches more slowly than this [m/s, rad/s] comes to rest without a bounce.
        impacts: Number of impacts resolved in one step, each at its time; then contacts are plastic to the step's end
            (a ball that comes to rest has infinitely many).
        extrapolate: Extrapolate the first half of a step from the step before, if contacts have not changed, without solving it
            (forces are then solved only where they are recorded). Still of order 2; faster, with errors two to five times as
            large, and stiff feedback stays stable for half as long steps only.
        touch_tolerance: The largest gap [m, rad] at which a point that was apart makes contact; None: 1e-12 of the size of its
            bodies, at most 1e-12 m. A larger one lets it touch so much too early.

    Raises:
        InputError: a speed that is not positive, a number of impacts below zero, a tolerance that is not positive.

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> corner = rbd.PointContact("corner", "box", friction=0.6, on=0.0)
        >>> thrown = rbd.State(box, [0, 0, 0.05, 0, 0, 0, 1], [1.0, 0, 0, 0, 0, 0])
        >>> steps = rbd.TimeStepping(impact_speed=1e-2)
        >>> slide = rbd.simulate(thrown, [corner], duration=0.4, step=1e-2, integrator=steps)
        >>> [(event.kind, round(event.t, 3)) for event in slide.events]
        [('touches', 0.101), ('slips', 0.101), ('sticks', 0.17)]
    """

    finds_events: ClassVar[bool] = True
    order: ClassVar[int] = 2
    implicit: ClassVar[bool] = True
    impact_speed: float = 1e-3
    impacts: int = 20
    extrapolate: bool = False
    touch_tolerance: float | None = None

    def __post_init__(self) -> None:
        check_positive("impact_speed", self.impact_speed, 1e3, "m/s")
        check_whole("impacts", self.impacts, 10_000, least=0)
        check_flag("extrapolate", self.extrapolate)
        if self.touch_tolerance is not None:
            expected = "a gap above 0 [m], at most 1, or None for 1e-12 of the size of the bodies"
            check_number("touch_tolerance", self.touch_tolerance, 1e-300, 1.0, expected=expected)

    def reason_unsupported(self, motion: SimulatedMotion, state: State) -> str | None:
        """Names the first ground that accelerates, or tilts under a contact that can break; all others are accepted."""
        return next(filter(None, (reason_unknown_ground(c) or _tilts(c, state) for c in motion.constraints)), None)

    def run(self, motion: SimulatedMotion, state: State, times: Sequence[float]) -> Iterator[Sample]:
        """One sample at each of the times."""
        system = StepSystem(
            motion,
            state,
            impact_speed=self.impact_speed,
            impacts=self.impacts,
            extrapolate=self.extrapolate,
            touch_tolerance=self.touch_tolerance,
        )
        detection, last, tells = EventDetection(), len(times) - 1, motion.hook is not None
        now, passed = system.begin(state, times[0])
        motion.watch(now.at.state, times[0])
        detection.add(passed)
        for k, t in enumerate(times):
            h = times[k + 1] - t if k < last else t - times[k - 1] if k else 1e-3
            if tells:
                motion.tell(now.at.state, now.t, h, partial(touches_of, now, motion.constraints, system.points.sources))
            half = system.half_step(now, h)
            make = _recorded if motion.recorded(k, times) else _passed_by
            yield make(system, half, detection.taken())
            if k == last:
                return
            end = system.step(half, times[k + 1])
            if motion.search and (yield from crossed_in_step(system, half, end, times[k + 1], detection, _recorded)):
                return
            now, passed = end
            detection.add(passed)


def _passed_by(system: StepSystem, half: HalfStep, events: tuple[Event, ...]) -> Sample:
    """A sample that is not recorded: no forces, and the acceleration of the half step, possibly extrapolated."""
    start, tau = half.start, zeros(system.robot.nu)
    more = {"motor_work": start.work, "dissipated": start.dissipated, "other_work": start.other_work, "events": events}
    return Sample.of(start.t, start.at.state, half.a, tau, dict, **more)


def _tilts(constraint: Constraint, state: State) -> str | None:
    """Message: why the plane of a contact with friction cannot be followed; None if it can."""
    ground = ground_of(constraint)
    if ground is None or ground.velocity is None or member(constraint, "friction") is None:
        return None
    (rows,) = rows_of(state, (constraint,))
    turn = np.asarray(ground.velocity)[3:]
    normal = ground.normal if rows.patch is None else rows.patch.axes[:, 2]
    n = np.zeros(3) if normal is None else np.asarray(normal)
    if max_abs(turn - (turn @ n) * n) <= TILTS:
        return None
    return (
        f"the ground of {constraint.name!r:.80} tilts: its angular velocity is not along its normal, and the plane of a "
        "contact that can break stays as it is. Give it an angular velocity along its normal, take friction=None for a contact "
        "that is bilateral, or a second body in the model for the ground, on=rbd.Body(...)."
    )


def _recorded(system: StepSystem, half: HalfStep, events: tuple[Event, ...]) -> Sample:
    """A sample with torques, forces and residuals; recording does not affect the steps."""
    start = half.start
    at, motion = start.at, system.motion
    half = system.instant(half)
    answer, h, active, a = half.answer, 0.5 * half.h, half.active, half.a
    assert half.tau is not None
    return Sample.of(
        start.t,
        at.state,
        a,
        half.tau,
        StepForces(at, answer.velocity, motion.names, lambda: least_forces(at, active, answer, h, motion.law)),
        law=system.law_residual(half, a),
        drift=at.drift,
        drift_rate=at.drift_rate,
        penetration=at.penetration,
        events=events,
        motor_work=start.work,
        elastic=stored(half.elements, at.state) if half.elements else 0.0,
        dissipated=start.dissipated,
        other_work=start.other_work,
    )
