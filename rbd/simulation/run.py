"""`simulate`: from a state and constraints to a trajectory, with a progress bar; phases between switches.

Each part is a run of the integrator with the constraints that act. A constraint keeps its anchor: where it was when it was
switched on, or at the start of the motion.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from rbd.arrays import Array, check_flag, check_positive, check_whole, is_finite
from rbd.constraints.constraint import Constraint, anchored, rows_of, with_loops
from rbd.constraints.distance_warnings import check_start, distant, warn_of_distant, warn_of_limits
from rbd.constraints.round_feet import warn_of_rolling
from rbd.constraints.stabilisation import Baumgarte
from rbd.control.schedules import INSTANT, Controller, ExternalAt, asked, hook, sample_period
from rbd.errors import (
    BadEvent,
    InaccurateWarning,
    InputError,
    NoSolution,
    RbdError,
    Reason,
    SimulationStopped,
    Unsupported,
)
from rbd.errors.inputs import check_different
from rbd.mechanism.projection import Projection
from rbd.model.external import External
from rbd.model.state import State
from rbd.problem.cones import Free
from rbd.problem.gauss_problem import Law
from rbd.problem.residuals import USABLE
from rbd.simulation.energy_balance import energy, too_stiff, unbalanced
from rbd.simulation.events import EventSearch, StateEvent, Switch, check_known, events_of, names_of
from rbd.simulation.impacts import AT_REST, impact_of, restitution_of
from rbd.simulation.integrators import DormandPrince8, RungeKutta4, TimeStepping
from rbd.simulation.missing_floor_warning import Floor
from rbd.simulation.progress_bar import progress_of
from rbd.simulation.recording import Recording
from rbd.simulation.simulated_motion import AtEvents, Event, Integrator, Sample, SimulatedMotion, Stabilisation
from rbd.simulation.trajectory import Trajectory
from rbd.solvers.default import slip_law
from rbd.workers import one_blas_thread

MOST_STEPS = 100_000_000


def simulate(
    state: State,
    constraints: Sequence[Constraint] = (),
    *,
    duration: float,
    step: float,
    controller: Controller | None = None,
    external: External | ExternalAt = None,
    law: Law | str = "coulomb",
    restitution: float | Mapping[str, float] = 0.0,
    integrator: Integrator | None = None,
    stabilisation: Stabilisation = Projection(),  # noqa: B008  a frozen record of settings
    record_every: int = 1,
    may_sink: bool = False,
    progress: bool = True,
    events: Sequence[StateEvent | Callable[..., float]] = (),
    inactive: str | Sequence[str] = (),
    loops: bool = True,
) -> Trajectory:
    """Motion of a robot over time, under the same constraints that `rbd.solve` takes, with its residuals.

    Bilateral constraints alone (loops, rolling, contacts, locks, drives) give smooth motion: Gauss's acceleration, integrated
    on the robot's configuration space (`RungeKutta4`, order 4, or `DormandPrince8`). Where a contact can break, slip or impact
    (contacts with friction, limits, dry friction) it is time stepping at the level of velocity (`TimeStepping`, order 2)::

        M v+ = M v + h (S^T tau + tau_ext - h(q, v)) + J^T p,        impulses p and velocities J v+ under the contact law.

    A contact with friction whose plane is known (`on=`, the feet of a robot) may start above it, and then falls. With an
    anchor, `anchor=(0, 0, 0)`, the plane goes through that point. Without either it touches at the start, and the plane goes
    through it there, which a `DistantContactWarning` says unless that is z = 0. A bilateral contact off its plane, any below
    it, and bodies inside each other get such a warning, too; from more than 1 cm inside each other there is no motion.

    Args:
        state: Initial configuration, velocity and time: the motion begins at `state.t`, zero if none was given.
        constraints: As for `rbd.solve`, each with a different name. Bilateral contacts are anchored at the start.
        duration: Simulated time [s].
        step: Time between samples [s]: the step of fixed-step integrators; the last may be shorter.
        controller: Motor torques (nu,) of a state and a time; None for none. It is called at every stage of a step. One with
            memory is told the start of a motion and every step that is taken: `rbd.control.SteppedController`.
        external: External forces as for `rbd.solve`; or a function of state and time that gives them.
        law: "coulomb", or "convex" (Gauss's principle with circular cones), of contacts that can slip, as in `rbd.solve`.
        restitution: Newton's coefficient e of impacts, u_n+ = -e u_n-; one for all, or {constraint: e}, 0 for the others.
        integrator: `RungeKutta4()`, `DormandPrince8()` or `TimeStepping()`; by default the first or the last, see above. Of
            springs and dampers that are too stiff for the first two an `InaccurateWarning` tells.
        stabilisation: Keeps positions and velocities on bilateral constraints: `Projection()`, `Baumgarte(...)`, or None.
        record_every: A sample is recorded every so many steps, and at the first and the last.
        may_sink: Go on where a robot falls through the floor of its feet; by default the run stops there, with a quarter of the
            robot's mass below the floor. Contacts support the points that are given alone.
        progress: Show a bar on a terminal where it takes long.
        events: Functions of the state, or of state and time, whose zeros are found to 1e-12 s on the integrator's interpolant:
            `rbd.simulation.StateEvent`, or plain functions with the attributes `direction` and `terminal`, as of SciPy's
            `solve_ivp`. Each is an entry of `trajectory.events` and a sample; contacts can be switched there.
        inactive: Names of constraints that do not act until an event switches them on.
        loops: Whether the robot's own loops hold; one that is given counts once.

    Returns:
        The trajectory; printed, it shows energy, residuals and events. After Ctrl-C it contains the motion until then, and
        `trajectory.interrupted` gives the time; Ctrl-C within the first step is a KeyboardInterrupt. Where a recorded residual
        of the law is above 1e-7, or "energy" above 1e-3 of the largest kinetic energy so far (the steps are too long), an
        `InaccurateWarning` is issued once, with time and size.

    Raises:
        InputError: arguments that do not fit, two constraints with the same name, a controller's torques that are not finite.
        Unsupported: the integrator does not accept a constraint, which is named.
        SimulationStopped: a step has no solution; a robot sinks through the floor of its feet (`may_sink`); or a function of
            yours (controller, external force, constraint) raised an error, which is its `__cause__`: with state, time,
            constraints and the trajectory until then.

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> face = rbd.SurfaceContact("face", "box", half_lengths=(0.2, 0.2), friction=0.5, on=0.0)
        >>> slides = rbd.State(box, [0, 0, 0, 0, 0, 0, 1], [1.0, 0, 0, 0, 0, 0])
        >>> motion = rbd.simulate(slides, [face], duration=0.3, step=1e-2)
        >>> print(f"{motion.com[-1, 0]:.4f} m, {1.0 / (2 * 0.5 * 9.81):.4f} m")  # v^2 / (2 mu g)
        0.1019 m, 0.1019 m
    """
    if not isinstance(state, State):
        raise InputError(f"simulate wants a State first, got {type(state).__name__}. Make one: rbd.State(robot, q, v).")
    every = check_whole("record_every", record_every, 10**12)
    check_flag("may_sink", may_sink)
    check_flag("progress", progress)
    times = [state.t + x for x in _times(duration, step)]
    motion = _motion(
        state, with_loops(state.robot, constraints, loops), controller, external, law, restitution, stabilisation, every,
        events, inactive, step,
    )  # fmt: skip
    off = names_of("inactive", inactive)
    chosen = _integrator(integrator, motion, state, off)
    adaptive, explicit = isinstance(chosen, DormandPrince8), isinstance(chosen, RungeKutta4 | DormandPrince8)
    stiff = too_stiff(motion, state, min(step, duration), adaptive=adaptive) if explicit else ""
    if stiff:
        warnings.warn(f"{state.robot.name} has {stiff}", InaccurateWarning, stacklevel=2)
    recording, passed, k = Recording(motion), list[Event](), 0
    plastic = float(getattr(chosen, "impact_speed", 0.0))
    phases = Phases(replace(motion, plastic=plastic), off, state, times)
    floors = () if may_sink else Floor.of(state, motion.constraints)
    t, here, interrupted, ended, sunk = state.t, state, "", Reason.NONE, ""
    with progress_of(times, shown=progress) as shown, one_blas_thread():
        try:
            motion.start()
            for sample in phases.run(chosen):
                if not is_finite(sample.a):  # q and v were checked by their State
                    raise NoSolution(f"the acceleration at t = {sample.t:.6g} s is not finite.")
                t, here = sample.t, sample.state
                passed += sample.events
                if motion.recorded(k, times) if sample.found is None else sample.found.recorded:
                    recording.add(sample)
                k += sample.found is None
                shown(t)
                for floor in floors:
                    sunk = sunk or floor.sunk(here)
                if sunk:
                    break
        except KeyboardInterrupt:
            if t == state.t:  # no step was taken: there is no motion to return
                raise
            interrupted, ended = f"interrupted at t = {t:.6g} s of {times[-1]:.6g} s", Reason.INTERRUPTED
        except Exception as error:  # a controller, a force or a constraint of the user can raise any exception
            if isinstance(error, InputError) and t == state.t:
                raise
            kept, why, ended = None, f"stopped at t = {t:.6g} s", _reason(error)
            if len(recording):
                kept = Trajectory.of(motion, recording, passed, chosen, step, why, ended)
            if explicit and ended == Reason.STOPPED_NO_SOLUTION:
                stiff = stiff or too_stiff(motion, here, step, t, adaptive=adaptive)
            raise _stopped(error, motion, here, t, kept, ended, stiff, chosen) from error
    if phases.ended:
        interrupted, ended = f"ended by event {phases.ended[0]!r} at t = {t:.6g} s", Reason.EVENT
    missing, reason = motion.search.missing() if motion.search and ended in (Reason.NONE, Reason.EVENT) else ("", ended)
    if sunk or missing:
        interrupted, ended = f"stopped at t = {t:.6g} s", Reason.STOPPED_SINKS if sunk else reason
    trajectory = Trajectory.of(motion, recording, passed, chosen, step, interrupted, ended)
    inaccurate = _inaccurate(trajectory, chosen, stiff)
    if sunk or missing:
        before = "".join(f" Before that, {said}" for said in inaccurate)
        reached = f"at t = {t:.6g} s {sunk}. `error.trajectory` and `error.state` have what was reached.{before}"
        why = reached if sunk else f"{missing} `error.trajectory` has the whole motion."
        raise SimulationStopped(why, state=here, t=t, names=motion.names, trajectory=trajectory, reason=ended)
    for said in inaccurate:
        warnings.warn(said, InaccurateWarning, stacklevel=2)
    warn_of_rolling(state, trajectory.q, trajectory.forces, motion.constraints, stacklevel=3)
    return trajectory


def _inaccurate(trajectory: Trajectory, by: Integrator, stiff: str) -> list[str]:
    """Messages: which recorded samples violate the equations of motion or the contact law, and that steps make energy.

    Not the latter where elements are too stiff, of which there was a warning.
    """
    return [said for said in (_unlawful(trajectory), "" if stiff else unbalanced(vars(trajectory), by)) if said]


def _unlawful(trajectory: Trajectory) -> str:
    """Message: which recorded samples violate the equations of motion or the contact law; empty if none does."""
    law = trajectory.residuals["law"]
    above = np.flatnonzero(law > USABLE)
    if not len(above):
        return ""
    worst = int(law.argmax())
    return (
        f"the simulation of {trajectory.robot.name} is inaccurate: residual 'law' is {law[worst]:.2g} (scaled) at "
        f"t = {trajectory.t[worst]:.6g} s; {len(above)} of {len(law)} recorded samples are above {USABLE:g}, the first at "
        f"t = {trajectory.t[above[0]]:.6g} s. `trajectory.residuals['law']` has all of them. Accelerations and forces are "
        "wrong by about that much there. Try a shorter step; look for constraints that contradict each other, and for a "
        "singular pose, where there may be no finite forces that make the motion."
    )


def _reason(error: Exception) -> Reason:
    reasons: tuple[tuple[type[Exception], Reason], ...] = (
        (BadEvent, Reason.STOPPED_BAD_EVENT),
        (InputError, Reason.STOPPED_BAD_INPUT),
        (RbdError, Reason.STOPPED_NO_SOLUTION),
        (np.linalg.LinAlgError, Reason.STOPPED_NO_SOLUTION),
    )
    return next((reason for kind, reason in reasons if isinstance(error, kind)), Reason.STOPPED_OTHER)


def _stopped(
    error: Exception,
    motion: SimulatedMotion,
    state: State,
    t: float,
    kept: Trajectory | None,
    reason: Reason,
    stiff: str,
    by: Integrator,
) -> SimulationStopped:
    known = error.problem if isinstance(error, NoSolution) else None
    active = motion.names if known is None else tuple(r.name for r in known.rows if len(r))
    what = f"the step of {motion.robot.name} after t = {t:.6g} s " + (
        f"has no solution: {error}"
        if isinstance(error, RbdError | np.linalg.LinAlgError)
        else f"failed: {type(error).__name__} was raised ({error!s:.300}). "
        "If it comes from your controller, external force or constraint, the traceback above shows where."
    )
    inaccurate = [] if kept is None else _inaccurate(kept, by, stiff)
    reached = "Nothing was recorded before" if kept is None else "`error.trajectory` and `error.state` have what was reached"
    return SimulationStopped(
        f"{what}{f' It has {stiff}' if stiff else ''} Active: {', '.join(active) or 'nothing'}. {reached}."
        + "".join(f" Before that, {said}" for said in inaccurate),
        state=state, t=t, names=active, trajectory=kept, cause=error, reason=reason,
    )  # fmt: skip


def _motion(
    state: State,
    given: tuple[Constraint, ...],
    controller: Controller | None,
    external: External | ExternalAt,
    law: Law | str,
    restitution: float | Mapping[str, float],
    stabilisation: Stabilisation,
    every: int,
    events: Sequence[StateEvent | Callable[..., float]],
    inactive: str | Sequence[str],
    step: float,
) -> SimulatedMotion:
    rows = rows_of(state, given)
    names = [c.name for c in given]
    check_different(names, "constraints")
    off = names_of("inactive", inactive)
    check_known("inactive", off, names)
    warn_of_limits(state, given, stacklevel=4)
    acting = [r for r in rows if r.name not in off]
    warn_of_distant(state, [c for c in given if c.name not in off], acting, below_only=True, stacklevel=4)
    check_start(state.robot, acting, stacklevel=4)
    wanted = events_of(events, names)
    if off and not wanted:
        raise InputError(f"inactive is {off!r:.80}, and no event can switch it on; leave the constraint out, or give events=.")
    kind = slip_law(law).kind
    if controller is not None and not callable(controller):
        raise InputError(f"controller is {controller!r:.80}; expected a function of state and time that gives torques (nu,).")
    if stabilisation is not None and not isinstance(stabilisation, Projection | Baumgarte):
        raise InputError(
            f"stabilisation is {stabilisation!r:.80}; expected rbd.simulation.Projection(), rbd.constraints.Baumgarte(...) "
            "or None."
        )
    for method in ("reset", "accepted"):
        hook(controller, method)  # which raises if it is none
    sample_period(controller)
    e, search = restitution_of(restitution, names), EventSearch(wanted, float(step)) if wanted else None
    return SimulatedMotion(state.robot, given, controller, external, kind, e, stabilisation, every, search)


def _times(duration: float, step: float) -> list[float]:
    check_positive("duration", duration, 1e9, "s")
    check_positive("step", step, 1e9, "s")
    if duration / step > MOST_STEPS:
        raise InputError(f"{duration:g} s by {step:g} s are {duration / step:.3g} steps; expected at most {MOST_STEPS:,}.")
    whole = round(duration / step)
    if abs(whole * step - duration) > 1e-9 * max(duration, step) or not whole:
        whole = math.floor(duration / step) + 1
    return [k * step for k in range(whole)] + [float(duration)]


def _integrator(given: Integrator | None, motion: SimulatedMotion, state: State, inactive: Sequence[str] = ()) -> Integrator:
    if given is None:
        held = all(isinstance(r.cone, Free) for r in rows_of(state, motion.constraints))
        if held:
            return RungeKutta4()
        given = TimeStepping()
    if isinstance(given, type) or not (hasattr(given, "run") and hasattr(given, "reason_unsupported")):
        raise InputError(
            f"integrator is {given!r:.80}; expected rbd.RungeKutta4(), rbd.DormandPrince8() or rbd.TimeStepping()."
        )
    if motion.search and not getattr(given, "finds_events", False):
        raise Unsupported(
            f"integrator {given!r:.80} does not look for events: it has no attribute finds_events = True. Use "
            "rbd.RungeKutta4(), rbd.DormandPrince8() or rbd.TimeStepping(), or leave events= out."
        )
    active = tuple(c for c in motion.constraints if c.name not in inactive)
    reason = given.reason_unsupported(replace(motion, constraints=active) if inactive else motion, state)
    if reason is not None:
        raise Unsupported(reason)
    return given


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

    def __init__(self, motion: SimulatedMotion, inactive: Sequence[str], state: State, times: Sequence[float]) -> None:
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

    def _part(self, acting: tuple[Constraint, ...], before: int | None) -> SimulatedMotion:
        """The motion from one switch to the next."""
        off = frozenset(self._motion.names).difference(c.name for c in acting)
        return replace(self._motion, constraints=acting, before=before, inactive=off)

    def _switched(self, stops: Sequence[StateEvent], state: State, t: float) -> tuple[State, list[Event]]:
        """(the state after the switches of events, the touches and ends of contact there)."""
        made: list[Event] = []
        for event in stops:
            then, what = event.then, f"then of event {event.name!r:.80}"
            switch = asked(what, then, state, t) if callable(then) else then
            if switch is None:
                continue
            if not isinstance(switch, Switch):
                raise InputError(f"{what} gave {switch!r:.80} at t = {t:.6g} s; expected an rbd.simulation.Switch, or None.")
            for side, names in (("on", switch.on), ("off", switch.off)):
                check_known(f"{side} of the Switch of event {event.name!r:.80}", names, self._motion.names)
            state = self._after(switch, str(event.name), state, t, made)
        return state, made

    def _after(self, switch: Switch, name: str, state: State, t: float, made: list[Event]) -> State:
        """The state after a switch; its touches and ends of contact are appended."""
        motion, before = self._motion, {c.name for c in self._active}
        if switch.q is not None or switch.v is not None:
            q: Array = state.q if switch.q is None else switch.q  # type: ignore[assignment]  # State checks it
            v: Array = state.v if switch.v is None else switch.v  # type: ignore[assignment]
            state = State(motion.robot, q, v, t=state.t)
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
