"""The time step of contact motion, a function of its first instant and its length.

A step of length h from (q, v), with the points that are in contact at q:

    1   M(q) v_h = M v + h/2 (S^T tau + tau_ext - h(q, v)) + J(q)^T p           u(v_h) obeys the law
    2   q_m = q (+) h/2 v
    3   M(q_m) v+ = M v + h (S^T tau + tau_ext - h(q_m, v_h)) + J(q_m)^T p      u(v+) obeys the law
    4   q+ = q_m (+) h/2 v+,    projected onto the positions of bilateral constraints and of closed points

(velocities of a floating base in axes frozen at q and at q_m: see `rbd.model.derivatives`)
(springs, dampers and other force elements are taken implicitly in 1 and 3: see `rbd.simulation.implicit_forces`)

u is the velocity of the points at the end of the (half) step, J v + h/2 J_dot v. For a free conservative system 2 to 4 are
Verlet's scheme. Friction is directed against the velocity in the middle of the step where a point slides throughout. 1 also
gives the accelerations and forces that are recorded: those at the step's beginning.

Where a point would penetrate its surface, the step is divided there, and an impact follows:

    M v+ = M v- + J^T p,        u+ = J v+ + e u_n-  along normals that approach           (Newton's restitution e)

and the law is Coulomb's between impulses and u+. Points already closed may lift. Source: [Moreau1988], [Stewart2000].

`StepSystem` has no state that changes: `half_step` and `step` give the same for the same `Instant`, in any order.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from rbd.arrays import Array, filled, is_finite
from rbd.constraints.contact_points import SLIDES, sources_of
from rbd.errors import NoSolution
from rbd.model.dynamics import kinetic_energy, unconstrained
from rbd.model.state import State
from rbd.simulation.bases import Bases
from rbd.simulation.contact_gaps import BodySizes, Correction, first_crossing
from rbd.simulation.energy_balance import energy
from rbd.simulation.event_detection import ImpactRecord, StepRecord
from rbd.simulation.ground_dynamics import GroundSteps
from rbd.simulation.impacts import AT_REST, impact_answer
from rbd.simulation.implicit_forces import ElementTerms, ImplicitElements
from rbd.simulation.instant import HalfStep, Instant, Passed, PreviousStep, Step, Touch, WholeStep
from rbd.simulation.simulated_motion import SimulatedMotion
from rbd.simulation.stacked_points import (
    PointLayout,
    PointMatching,
    Points,
    PreparedPoints,
    Snapshot,
    directed,
    stopping,
    turned_back,
)
from rbd.simulation.velocity_problem import StepEquations, VelocityAnswer, not_finite, solve_velocity

_SLOW = 0.2
"""Longest half step over the time scale of force elements in which their forces are taken as constant."""


class StepSystem:
    """The constant data of time steps: a motion from a state, and the settings of `TimeStepping`."""

    def __init__(
        self,
        motion: SimulatedMotion,
        start: State,
        *,
        impact_speed: float,
        impacts: int,
        extrapolate: bool,
        touch_tolerance: float | None = None,
    ) -> None:
        self.motion, self.robot = motion, start.robot
        self.impact_speed, self.impacts, self.extrapolate = impact_speed, impacts, extrapolate
        self.points = Points(sources_of(motion.constraints, start))
        self.bases, self.sizes = Bases(start.robot), BodySizes.of(start, touch_tolerance)
        self.implicit = ImplicitElements(start)
        self.correction = Correction.of(self.points, motion.stabilisation)
        self.restitution: Mapping[str, float] = dict(motion.restitution or {})
        self.ground = GroundSteps.of(self.points, start)

    def snapshot(self, state: State, t: float) -> Snapshot:
        """All points at a state and a time [s]."""
        return self.points.at(state, t) if self.ground is None else self.ground.at(state, t)

    def begin(self, start: State, t: float) -> Step:
        """The first instant; points that approach where they touch have an impact."""
        at = self.snapshot(start, t)
        gaps, passed = self.sizes.tolerances(at), Passed()
        now = Instant(t, at, gaps, at.gap <= gaps.loose, np.zeros(len(at.gap), bool), np.zeros(len(at.velocity)))
        return Step(self._after_impact(now, passed, first=True), passed)

    def half_step(self, start: Instant, h: float) -> HalfStep:
        """The first half of a step of length h: solved, or extrapolated from the step before."""
        at, before = start.at, start.previous
        known = self.extrapolate and before is not None and not before.elements
        if not known or before is None or not np.array_equal(start.touching, before.active):
            return self.solved(start, h)
        part = 0.5 * h / before.h
        v, u = at.state.v, start.rates(before.active)
        turned = self.bases.turned(v, v, 0.5 * h)
        v_h = turned + part * (v - before.at.state.v)
        u_h = u + part * (at.velocity - before.at.velocity)
        answer = VelocityAnswer(v_h, part * before.impulse, u_h, 0.0, norms=start.norms)
        return HalfStep(start, before.active, None, answer, h, u, turned)

    def solved(
        self, start: Instant, h: float, more: Array | None = None, *, exact: bool = False, u: Array | None = None
    ) -> HalfStep:
        """The first half of a step, solved.

        Args:
            start: Its beginning.
            h: Length of the whole step [s].
            more: Points that are active in addition to touching ones.
            exact: Take force elements as they are at its beginning, not implicitly: accelerations and forces of that instant.
            u: Velocities of the points in the contact law, shape (p,); None: `Instant.rates`.
        """
        at, half = start.at, 0.5 * h
        active = start.touching if more is None else start.touching | more
        tau, applied, elements, _ = self.motion.acting(at.state, start.t)
        change, rounds = (start.change(half), 1) if u is None else (None, 2)
        v, u, guess = at.state.v, start.rates(active) if u is None else u, half * start.force
        turned = self.bases.turned(v, v, half)
        terms = None if exact else ElementTerms.of(at.state, elements)
        E, force = (None, applied) if terms is None else self.implicit.first_half(terms, at.state, turned, applied, h)
        equations = StepEquations(at.state, start.t, at, self._by_bodies(at, terms), active, turned, half, u, at.error)

        def solution(shift: Array | None, guess: Array, norms: Array | None) -> VelocityAnswer:
            return self._answer(equations, force, E, guess, shift, norms)

        def result(answer: VelocityAnswer) -> HalfStep:
            return HalfStep(start, active, tau, answer, h, u, turned, applied, elements, terms)

        if u is at.layout.at_rest:
            return result(solution(None, guess, start.norms))
        shift = None if change is None else turned_back(at.layout, active, u, change, guess)
        answer = solution(shift, guess, start.norms)
        for _ in range(rounds if change is None else 0):
            shift = turned_back(at.layout, active, u, answer.velocity - u, answer.impulse)
            if shift is not None:
                answer = solution(shift, answer.impulse, answer.norms)
        return result(answer)

    def instant(self, half: HalfStep) -> HalfStep:
        """A half step from the same beginning with the accelerations and forces of that instant.

        Force elements as they are, and friction against the velocities of the points that slide there: of those in the step
        the directions are off by O(h^2) over the speed, and points that are slow stop, or turn, in the half step.
        """
        if half.tau is None or half.implicit is not None:
            half = self._exact(half)
        at, answer = half.start.at, half.answer
        slides = None if half.u is at.layout.at_rest else directed(at, half.u, answer.velocity, answer.impulse)
        return half if slides is None else self.solved(half.start, 1e-3 * half.h, exact=True, u=slides)

    def _exact(self, half: HalfStep) -> HalfStep:
        """The same half step with force elements as they are, not implicitly; shorter where they are stiff."""
        h = half.h
        if half.implicit is not None:
            h *= min(1.0, _SLOW / max(h * half.implicit.rate(half.start.at.state.M), _SLOW))
        return self.solved(half.start, h, exact=True)

    def _by_bodies(self, at: Snapshot, terms: ElementTerms | None) -> PreparedPoints | None:
        """The prepared form of the bodies in contact, if they have one and force elements are light."""
        return at.ground if self.implicit.is_light(terms) else None

    def _answer(
        self,
        equations: StepEquations,
        applied: Array,
        E: Array | None,
        guess: Array,
        shift: Array | None,
        norms: Array | None,
    ) -> VelocityAnswer:
        """Velocity and impulses of either half: of the bodies in contact where these can answer, else the general way.

        Args:
            equations: The half.
            applied: S^T tau + tau_ext, shape (nv,).
            E: What force elements add to M, shape (nv, nv); None: nothing.
            guess: Impulses to start from, shape (p,).
            shift: Added to u+ only in the contact law, shape (p,).
            norms: As of `solve_velocity`.
        """
        answer = None
        if equations.ground is not None:
            answer = equations.ground.answer(equations, applied, guess, law=self.motion.law, shift=shift, added=E)
        return self._general(equations, applied, E, guess, shift, norms) if answer is None else answer

    def _general(
        self,
        equations: StepEquations,
        applied: Array,
        E: Array | None,
        guess: Array,
        shift: Array | None,
        norms: Array | None,
    ) -> VelocityAnswer:
        """`_answer` by M + E, h and J."""
        state, t, at, ground, active, start, h, u, error, mean = equations
        at = at or (self.points if ground is None else ground).at(state, t)
        begins, share = (u, 1.0) if mean is None else (at.velocity + at.J @ (mean - state.v), 0.5)
        offset = begins - at.J @ start + share * h * at.bias
        if E is None and not active.any():  # without M and its factors
            v = start + h * unconstrained(state, applied)
            if not is_finite(v):
                raise NoSolution(not_finite(state.robot))
            return VelocityAnswer(v, np.zeros(len(offset)), at.J @ v + offset, 0.0, norms=norms)
        M = state.M if E is None else state.M + E
        rhs = M @ start + h * (applied - state.h)
        wanted = self.correction.wanted(at.layout, u, error, h)
        answer = solve_velocity(
            at, active, rhs, offset - wanted, h, guess, law=self.motion.law, shift=shift, norms=norms, inertia=M
        )
        return answer if self.correction.feedback is None else answer._replace(velocity=answer.velocity + wanted)

    def law_residual(self, half: HalfStep, a: Array) -> float:
        """Residual of the equations of motion and the contact law of a solved half step with its acceleration, scaled."""
        at, answer, h = half.start.at, half.answer, 0.5 * half.h
        if at.ground is None or half.applied is None:
            return answer.law
        return max(answer.law, at.ground.residual(at, half.applied, a, half.u, h, answer))

    def step(self, half: HalfStep, t_end: float) -> Step:
        """From a half step to the end of the step, through the impacts in between."""
        passed = Passed()
        self.motion.refuse_jumps(half.start.t, t_end)
        end = self._advanced(half, t_end, passed).__dict__
        return Step(filled(Instant, **{**end, "t": t_end}), passed)  # sums of parts are off by rounding

    def _advanced(self, half: HalfStep, t_end: float, passed: Passed) -> Instant:
        t = half.start.t
        step = t_end - t
        for _ in range(self.impacts):
            h = t_end - t
            whole = self._finish(half, h)
            deep = self._through(half, whole.end)
            through, stop = deep is not whole.end.layout.nothing and deep.any(), 0.0
            if not through and whole.layout is half.start.at.layout:
                stop = self._sliding_end(half, whole.answer, h)
            if stop:
                h = stop
                whole = self._finish(half, h)
                through = self._through(half, whole.end).any()
            if through:
                whole = self._located(half, whole)
            now = self._accept(half, whole, passed)
            if not through and not stop:
                return now
            t += whole.h
            now = replace(now, previous=None)  # friction, or the contact set, has changed
            if t_end - t <= 1e-9 * step:
                return now
            half = self.solved(now, t_end - t)
        return self._plastic(half, t_end, passed)

    def _finish(self, half: HalfStep, h: float) -> WholeStep:
        """The step of length h before positions are corrected."""
        bases, start = self.bases, half.start
        t, q, v = start.t, start.at.state.q, start.at.state.v
        v_h = half.answer.v if h == half.h else v + (half.answer.v - v) * (h / half.h)
        q_m, v, v_h, turned, mean = bases.middle(q, v, v_h, h)
        state = self.motion.reached(q_m, v_h, t + 0.5 * h)
        tau, applied, elements, pushes = self.motion.acting(state, t + 0.5 * h)
        terms = ElementTerms.of(state, elements)
        ground = self._by_bodies(start.at, terms)
        middle = None if ground is not None else self.points.at(state, t + 0.5 * h)
        layout = start.at.layout if middle is None else middle.layout
        active, u0, error, before = half.points_in(layout)
        guess = before.impulse * (2.0 * h / half.h)
        still = u0 is layout.at_rest and before.velocity is layout.at_rest
        shift = None if still else turned_back(layout, active, u0, before.velocity - u0, guess)
        equations = StepEquations(state, t + 0.5 * h, middle, ground, active, turned, h, u0, error, mean)

        def solution(force: Array, E: Array | None) -> VelocityAnswer:
            return self._answer(equations, force, E, guess, shift, before.norms)

        answer, dissipated, implicit = (
            (solution(applied, None), 0.0, None)
            if terms is None
            else self.implicit.whole_step(terms, state, v, turned, applied, h, solution)
        )
        # of friction, and of points that are stopped
        rubs = not (still and answer.velocity is layout.at_rest)
        other_work = 0.5 * float(answer.impulse @ (u0 + answer.velocity)) if rubs else 0.0
        if middle is not None and len(answer.impulse):  # of ground that moves
            other_work += float(answer.impulse @ (middle.J @ state.v - middle.velocity))
        if pushes is not None:
            given = h * pushes if implicit is None or not callable(self.motion.external) else h * pushes + implicit
            other_work += 0.5 * float((v + answer.v) @ given)
        q_end, v_end = bases.moved(state.q, answer.v, 0.5 * h)
        end = self.snapshot(self.motion.reached(q_end, v_end, t + h), t + h)
        return WholeStep(h, end, answer, layout, tau, dissipated, other_work)

    def _plastic(self, half: HalfStep, t_end: float, passed: Passed) -> Instant:
        """Remainder of a step with too many impacts: points that would penetrate their surface are stopped without a bounce."""
        start, h = half.start, t_end - half.start.t
        more = np.zeros(len(half.active), bool)
        while True:
            whole = self._finish(half, h)
            through = PointMatching(whole.end.layout, start.at.layout).points(self._through(half, whole.end), False) & ~more
            if not through.any():
                return self._accept(half, whole, passed, caught=bool(more.any()))
            more = more | through
            half = self.solved(start, h, more)

    def _through(self, half: HalfStep, end: Snapshot) -> Array:
        """Which points have penetrated their surface while inactive, shape (k,) of the end's layout.

        A point that enters the contact set below the surface and separates (e.g. another corner of a hull) does not count.
        """
        start = half.start
        if half.active is end.layout.everything:
            return end.layout.nothing
        deep: Array = ~half.active_in(end.layout) & (end.gap < -self.sizes.tolerances(end, start.gaps).tight)
        if end.layout is not start.at.layout and deep.any():
            deep &= PointMatching(start.at.layout, end.layout).known | (end.approach < -AT_REST)
        return deep

    def _sliding_end(self, half: HalfStep, answer: VelocityAnswer, h: float) -> float:
        """Time within the step at which a sliding point stops, or turns back, and friction jumps; zero if none does."""
        layout = half.start.at.layout
        stops = None if half.u is layout.at_rest else stopping(layout, half.u, answer.velocity, half.answer.impulse)
        if stops is None:
            return 0.0
        rows, kept = layout.sliding_rows[stops], layout.sliding_kept[stops]
        first = self.solved(half.start, 1e-3 * h)
        u0 = first.u[rows] * kept
        rate = (first.answer.velocity[rows] * kept - u0) / (0.5 * first.h)
        s = -(u0 * rate).sum(axis=1) / np.maximum((rate * rate).sum(axis=1), 1e-300)
        left = np.hypot(*(u0 + s[:, None] * rate).T)
        stops = (s > 1e-3 * h) & (s < (1.0 - 1e-3) * h) & (left < 0.1 * np.hypot(*u0.T))
        return float(s[stops].min(initial=h)) % h

    def _located(self, half: HalfStep, whole: WholeStep) -> WholeStep:
        """A shorter step, up to the first contact."""
        h, low, high, at_low, at_high = whole.h, 0.0, whole.h, half.start.at, whole.end
        for _ in range(30):
            through = self._through(half, at_high)
            match, n = PointMatching(at_low.layout, at_high.layout), at_high.layout.normals[through]
            gap, rate = match.points(at_low.gap, np.inf)[through], match.rows(at_low.velocity)[n]
            unseen = ~np.isfinite(gap)  # it was beyond the margin: extrapolate backwards linearly
            rate[unseen] = at_high.velocity[n][unseen]
            line = at_high.gap[through] - rate * (high - low)
            least = 2.0 * self.sizes.tolerances(at_high, half.start.gaps).tight[through]
            # A point that swings in has no such line above the surface: as high above it as it is deep, the interval is halved.
            gap[unseen] = np.where(line > least, line, -at_high.gap[through])[unseen]
            s = low + first_crossing(gap, rate, at_high.gap[through], at_high.velocity[n], high - low)
            whole = self._finish(half, s)
            found = whole.end
            apart = (found.gap / self.sizes.tolerances(found, half.start.gaps).tight)[~half.active_in(found.layout)]
            deepest = float(apart.min(initial=np.inf))
            if abs(deepest) <= 1.0 or high - low < 1e-12 * h:
                break
            low, at_low, high, at_high = (s, found, high, at_high) if deepest > 0.0 else (low, at_low, s, found)
        return whole

    def _accept(self, half: HalfStep, whole: WholeStep, passed: Passed, *, caught: bool = False) -> Instant:
        """The instant at the end of a step: positions corrected, after the impact of arriving points; extends `passed`.

        Args:
            half: Its first half.
            whole: The step.
            passed: The step, and the impact, are appended to it.
            caught: Whether points were stopped off their surfaces.
        """
        start, (h, end, answer, middle, tau, dissipated, other_work) = half.start, whole
        t, layout = start.t + h, end.layout
        active, velocity, _, _ = half.points_in(layout)
        if middle is not layout:
            match = PointMatching(middle, layout)
            answer = answer._replace(impulse=match.rows(answer.impulse), velocity=match.rows(answer.velocity), norms=None)
        gaps, force = self.sizes.tolerances(end, start.gaps), answer.impulse / h
        if len(force):
            # A redundant corner without load that does not move has not left.
            still = active is layout.everything and answer.velocity is layout.at_rest
            closed = active if still else layout.pushes & active & (answer.velocity[layout.normals] <= SLIDES)
            passed.append(StepRecord(start.t, h, layout, force, velocity, answer.velocity, closed))
            if not self.correction.in_place(end, gaps):
                made, moved, pressed = end, 0.5 * h * velocity[layout.normals], closed & (answer.impulse[layout.normals] > 0.0)
                end = self.correction.positions(made, t, pressed, gaps.size)
                if end is not made and (caught or self.correction.owes(start.at, made, pressed, moved)):
                    other_work += energy(self.motion, end.state) - energy(self.motion, made.state)
            if (answer.redundant or self.motion.timed) and self.correction.bilateral:
                made, rests = end, None
                if self.motion.timed and end.layout is layout:
                    rests = _resting(layout, closed & (answer.impulse[layout.normals] > 0.0), answer.velocity)
                end = self.correction.velocities(end, t, rests)
                if self.motion.timed:
                    other_work += energy(self.motion, end.state) - energy(self.motion, made.state)
                if end.layout is layout:
                    given = layout.held if rests is None else layout.held | rests
                    answer = answer._replace(velocity=np.where(given, end.velocity, answer.velocity))
        norms, by_law, previous = answer.norms, answer.velocity, None
        if end.layout is not layout:
            match, norms = PointMatching(layout, end.layout), None
            by_law = np.where(np.repeat(match.known, end.layout.widths), match.rows(by_law), end.velocity)
            force, active, gaps = match.rows(force), match.points(active, False), self.sizes.tolerances(end)
        if start.at.layout is end.layout:
            previous = PreviousStep(start.at, half.active, h, answer.impulse, bool(half.elements))
        work = start.work
        if self.motion.controller is not None:
            work += self.motion.work(tau, start.at.state.q, end.state.q)
        nothing, dissipated, other_work = end.layout.nothing, start.dissipated + dissipated, start.other_work + other_work
        now = filled(
            Instant, t=t, at=end, gaps=gaps, closed=active, leaves=nothing, force=force, norms=norms, velocity=by_law,
            previous=previous, work=work, dissipated=dissipated, other_work=other_work,
        )  # fmt: skip
        return self._after_impact(now, passed)

    def _after_impact(self, now: Instant, passed: Passed, *, first: bool = False) -> Instant:
        """The instant after the impact of points that touch and approach: at any speed if they were not closed before.

        Args:
            now: The instant before it.
            passed: The impact is appended to it.
            first: At the start of a motion all points count as not closed, and those that move away leave.
        """
        at, layout = now.at, now.at.layout
        slow = -self.impact_speed
        if now.closed is layout.everything and not first and at.extremes[2] >= slow:
            return now
        touches, approach = now.touching, at.approach
        limit = -AT_REST if first else np.where(now.closed, slow, -AT_REST)
        arrives = touches & layout.pushes & (approach < limit)
        if not arrives.any() and (not first or at.drift_rate <= AT_REST):
            return replace(now, leaves=self._leaves(at)) if first else now
        if arrives.any():  # points within the gap of closed ones take part in the impact
            touches = touches | (at.gap <= now.gaps.loose)
            arrives = touches & layout.pushes & (approach < limit)
        answer = impact_answer(
            at, touches, arrives, self.restitution, plastic=self.impact_speed, law=self.motion.law, norms=now.norms
        )
        after = self.snapshot(at.state.with_velocity(answer.v), now.t)
        leaves, match = self._leaves(after), PointMatching(layout, after.layout)
        known = leaves if match.same else PointMatching(after.layout, layout).points(leaves, False)
        passed.append(ImpactRecord(now.t, layout, arrives, approach, answer.impulse[layout.normals], known))
        gaps, norms = self.sizes.tolerances(after, now.gaps), answer.norms if match.same else None
        end = Instant(now.t, after, gaps, match.points(touches, False), leaves, match.rows(now.force), norms, work=now.work)
        lost = kinetic_energy(at.state) - kinetic_energy(after.state)
        end = replace(end, dissipated=now.dissipated, other_work=now.other_work - lost)
        if arrives.any():
            late = float((2.0 * now.gaps.tight[arrives] / -approach[arrives]).max())
            passed.touches.append(Touch(at.state, end, late, len(passed)))
        return end

    def _leaves(self, at: Snapshot) -> Array:
        """Which points separate from their surface faster than the rest speed, shape (k,)."""
        return at.layout.pushes & (at.approach > self.impact_speed)


def _resting(layout: PointLayout, presses: Array, velocity: Array) -> Array:
    """Rows of points that press, shape (p,): their normals, and of those that stick the tangents too."""
    out = np.zeros(len(velocity), bool)
    out[layout.normals[presses]] = True
    along = layout.sliding_rows[presses[layout.slides]]
    out[along[np.hypot(*velocity[along].T) <= SLIDES]] = True
    return out
