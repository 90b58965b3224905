"""Time stepping at the level of velocity: contacts that stick, slip, break and strike, at second order between impacts.

A step of length h from (q, v), with the points that touch at q:

    1   M(q) v_h = M v + h/2 (S^T tau + tau_ext - h(q, v)) + J(q)^T p           u(v_h) obeys the law
    2   q_m = q (+) h/2 v
    3   M(q_m) v+ = M v + h (S^T tau + tau_ext - h(q_m, v_h)) + J(q_m)^T p      u(v+) obeys the law
    4   q+ = q_m (+) h/2 v+,    put back onto the positions of what holds and of what is closed

(velocities of a floating base in axes frozen at q and at q_m: see `rbd.model.bases`)

u is the velocity of the points at the end of the (half) step, J v + h/2 J_dot v. For a free conservative system 2 to 4 are
Verlet's scheme. Friction is directed against the velocity in the middle of the step where a point slides throughout. 1 also
gives the accelerations and forces that are recorded: those at the step's beginning.

Where a point would come through its surface, the step is ended at the touch, and what touches is struck:

    M v+ = M v- + J^T p,        u+ = J v+ + e u_n-  along normals that approach           (Newton's restitution e)

and the law is Coulomb's between impulses and u+. Points already closed may lift. Source: [Moreau1988], [Stewart2000].
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rbd.arrays import Array, as_float, zeros
from rbd.constraints.sources import sources_of
from rbd.constraints.stabilisation import Baumgarte
from rbd.errors import InputError
from rbd.model.bases import Bases
from rbd.model.state import State
from rbd.simulation.begun import Begun
from rbd.simulation.closing import Closing, Nearness, first_crossing
from rbd.simulation.contact_points import SLIDES, Carry, Layout, Points, Snapshot, slide, stopping, turned_back
from rbd.simulation.events import Moment, Watch
from rbd.simulation.motion import Motion
from rbd.simulation.recorded_forces import least_forces, touches_of
from rbd.simulation.velocity_problem import VelocityAnswer, VelocitySolver

_STILL = 1e-7
"""A point that arrives slower than this [m/s, rad/s] needs no impulse."""


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
        if not 0.0 < as_float(self.impact_speed) <= 1e3:
            raise InputError(f"impact_speed is {self.impact_speed!r:.80}; expected a speed above 0 [m/s].")
        if isinstance(self.impacts, bool) or not isinstance(self.impacts, int | np.integer) or not 0 <= self.impacts <= 10_000:
            raise InputError(f"impacts is {self.impacts!r:.80}; expected a whole number from 0.")
        if not isinstance(self.extrapolate, bool):
            raise InputError(f"extrapolate is {self.extrapolate!r:.80}; expected True or False.")

    def reason_unsupported(self, motion: Motion, state: State) -> str | None:
        """It takes all constraints."""
        return None

    def run(self, motion: Motion, state: State, times: Sequence[float]) -> Iterator[Moment]:
        """One moment at each of the times."""
        return _Run(self, motion, state).moments(times)


class _Run:
    """One simulation: what stands between the steps."""

    def __init__(self, settings: TimeStepping, motion: Motion, start: State) -> None:
        self.settings, self.motion, self.robot = settings, motion, start.robot
        self.points = Points(sources_of(motion.constraints, start))
        self.solver = VelocitySolver(motion.law)
        self.bases = Bases(start.robot)
        self.nearness = Nearness(start)
        self.closing = Closing(motion, self.points, self.nearness)
        self.feedback = motion.stabilisation if isinstance(motion.stabilisation, Baumgarte) else None
        self.restitution = dict(motion.restitution or {})
        self.names = tuple(c.name for c in motion.constraints)
        self.watch = Watch()
        self.force = np.zeros(0)  # row forces to start from, of the last layout
        self.at = self.points.at(start, 0.0)
        self.closed = self.at.gap <= self.nearness.of(self.at).loose  # what touched in the step before
        self.away = np.zeros(len(self.at.gap), bool)  # what touches and flies off: it does not act in the step that begins here
        self.before: Begun | None = None  # the step before, where this one goes on like it
        self.told: Array | None = None  # the points' velocities as the law of the step before has them

    def moments(self, times: Sequence[float]) -> Iterator[Moment]:
        """The moments at the given times."""
        t = times[0]
        self._strike(t)
        last = len(times) - 1
        for k in range(last + 1):
            t = times[k]
            h = times[k + 1] - t if k < last else times[k] - times[k - 1] if k else 1e-3
            coming = self._coming(t, h)
            yield self._moment(t, coming, h, recorded=self.motion.recorded(k, times))
            if k < last:
                self._to(t, times[k + 1], coming)

    # -- one step --------------------------------------------------------------------------------------------------------

    def _coming(self, t: float, h: float) -> Begun:
        """The first half of a step: solved, or as the step before went on. It does not depend on what is recorded."""
        at, before = self.at, self.before
        if not self.settings.extrapolate or before is None or not np.array_equal(self._touching(), before.active):
            return self._begin(t, h)
        part = 0.5 * h / before.h
        v, u = at.state.v, self._rates(before.active)
        v_h = v + part * (v - before.at.state.v) + 0.5 * h * self.bases.spin(v)
        u_h = u + part * (at.velocity - before.at.velocity)
        return Begun(at, before.active, None, VelocityAnswer(v_h, part * before.answer.impulse, u_h, 0.0), h, u)

    def _begin(self, t: float, h: float, more: Array | None = None) -> Begun:
        """The first half of a step from where we are."""
        at, half = self.at, 0.5 * h
        active = self._touching() if more is None else self._touching() | more
        tau, force = self.motion.forces(at.state, t)
        v, spin = at.state.v, self.bases.spin(at.state.v)
        u = self._rates(active)
        turned = v + half * spin
        offset = u - at.J @ turned + half * at.bias
        rhs = at.state.M @ turned + half * force
        change, guess, wanted = self._later(at, half), half * self._guess(at), self._wanted(at.layout, u, at.error, half)
        offset = offset - wanted
        shift = None if change is None else turned_back(at.layout, active, u, change, guess)
        answer = self.solver.solve(at, active, rhs, offset, half, guess, shift)
        if change is None:
            shift = turned_back(at.layout, active, u, answer.velocity - u, answer.impulse)
            if shift is not None:
                answer = self.solver.solve(at, active, rhs, offset, half, answer.impulse, shift)
        return Begun(at, active, tau, replace(answer, velocity=answer.velocity + wanted), h, u)

    def _rates(self, active: Array) -> Array:
        """Velocities of the points where we are, shape (p,): of those that act as the law of the step before has them.

        It knows that what is closed is still; J v is so to O(h^2) only, which half a step would make O(h) of a force.
        """
        at = self.at
        return at.velocity if self.told is None else np.where(np.repeat(active, at.layout.widths), self.told, at.velocity)

    def _touching(self) -> Array:
        """Which points touch where we are, shape (k,): those at no gap, and those that were closed and have not gone far.

        Not those that fly off after a blow: at its end the step would hold down what is on its way back by then.
        """
        gap, near = self.at.gap, self.nearness.of(self.at)
        touching: Array = ((gap <= near.tight) | (self.closed & (gap <= near.loose))) & ~self.away
        return touching

    def _finish(self, t: float, begun: Begun, h: float) -> tuple[Snapshot, VelocityAnswer, Snapshot]:
        """(where a step of length h ends before positions are put right, velocities and impulses, its middle)."""
        bases, q, v = self.bases, begun.at.state.q, begun.at.state.v
        v_h = begun.answer.v if h == begun.h else v + (begun.answer.v - v) * (h / begun.h)
        q_m = bases.moved(q, v, 0.5 * h)
        v, v_h = bases.carried((v, v_h), q, q_m)
        spin = bases.spin(v_h)
        middle = self.points.at(State(self.robot, q_m, v_h), t + 0.5 * h)
        _, force = self.motion.forces(middle.state, t + 0.5 * h)
        offset = middle.velocity - middle.J @ (v_h + 0.5 * h * spin) + 0.5 * h * middle.bias
        rhs = middle.state.M @ (v + h * spin) + h * force
        then = begun.seen_in(middle.layout)
        guess, u0 = then.answer.impulse * (2.0 * h / begun.h), then.velocity
        shift = turned_back(middle.layout, then.active, u0, then.answer.velocity - u0, guess)
        wanted = self._wanted(middle.layout, u0, then.error, h)
        answer = self.solver.solve(middle, then.active, rhs, offset - wanted, h, guess, shift)
        answer = replace(answer, velocity=answer.velocity + wanted)
        q_end = bases.moved(q_m, answer.v, 0.5 * h)
        (v_end,) = bases.carried((answer.v,), q_m, q_end)
        return self.points.at(State(self.robot, q_end, v_end), t + h), answer, middle

    def _later(self, at: Snapshot, half: float) -> Array | None:
        """How the points' velocities change in half a step, as they did in the step before; None where that tells nothing."""
        before = self.before
        if before is None or before.at.layout is not at.layout:
            return None
        change: Array = (at.velocity - before.at.velocity) * (half / before.h)
        return change

    def _to(self, t: float, t_end: float, begun: Begun) -> None:
        """From a begun step to its end, through the impacts on the way."""
        step = t_end - t
        for _ in range(self.settings.impacts):
            h = t_end - t
            end, answer, middle = self._finish(t, begun, h)
            through = self._through(begun, end).any()
            stop = 0.0 if through else self._stop(t, begun, answer, h) if middle.layout is begun.at.layout else 0.0
            if through:
                h, end, answer, middle = self._located(t, h, begun, end)
            elif stop:
                h = stop
                end, answer, middle = self._finish(t, begun, h)
                if self._through(begun, end).any():
                    h, end, answer, middle = self._located(t, h, begun, end)
            else:
                self._accept(t, h, begun, answer, middle, end)
                return
            self._accept(t, h, begun, answer, middle, end)
            self.before = None  # friction, or what touches, has changed
            t += h
            if t_end - t <= 1e-9 * step:
                return
            begun = self._begin(t, t_end - t)
        self._plastic(t, t_end, begun)

    def _plastic(self, t: float, t_end: float, begun: Begun) -> None:
        """The rest of a step in which too much strikes: what would come through its surface is stopped without a bounce."""
        h = t_end - t
        more = np.zeros(len(begun.active), bool)
        while True:
            end, answer, middle = self._finish(t, begun, h)
            through = Carry(end.layout, begun.at.layout).points(self._through(begun, end), False) & ~more
            if not through.any():
                self._accept(t, h, begun, answer, middle, end)
                return
            more = more | through
            begun = self._begin(t, h, more)

    def _through(self, begun: Begun, end: Snapshot) -> Array:
        """Which points have come through their surface without acting, shape (k,) of the end's layout.

        One that comes into sight below the surface and moves away, as another corner of a hull may, has not come through it.
        """
        deep: Array = ~begun.seen_in(end.layout).active & (end.gap < -self.nearness.of(end).tight)
        if end.layout is not begun.at.layout and deep.any():
            deep &= Carry(begun.at.layout, end.layout).known | (end.approach < -_STILL)
        return deep

    def _stop(self, t: float, begun: Begun, answer: VelocityAnswer, h: float) -> float:
        """When within the step what slides stops, or turns back, and friction jumps; zero if nothing does."""
        layout = begun.at.layout
        stops = stopping(layout, begun.u, answer.velocity, begun.answer.impulse)
        if stops is None:
            return 0.0
        rows, kept = layout.sliding_rows[stops], layout.sliding_kept[stops]
        first = self._begin(t, 1e-3 * h)
        u0 = first.u[rows] * kept
        rate = (first.answer.velocity[rows] * kept - u0) / (0.5 * first.h)
        s = -(u0 * rate).sum(axis=1) / np.maximum((rate * rate).sum(axis=1), 1e-300)
        left = np.hypot(*(u0 + s[:, None] * rate).T)
        s = s[(s > 1e-3 * h) & (s < (1.0 - 1e-3) * h) & (left < 0.1 * np.hypot(*u0.T))]
        return float(s.min(initial=h)) % h

    def _located(self, t: float, h: float, begun: Begun, end: Snapshot) -> tuple[float, Snapshot, VelocityAnswer, Snapshot]:
        """A shorter step, to where the first point touches."""
        low, high, at_low, at_high = 0.0, h, begun.at, end
        for _ in range(30):
            through = self._through(begun, at_high)
            carry, n = Carry(at_low.layout, at_high.layout), at_high.layout.normals[through]
            gap, rate = carry.points(at_low.gap, np.inf)[through], carry.rows(at_low.velocity)[n]
            unseen = ~np.isfinite(gap)  # it was beyond the margin: by a straight line back from where it is
            rate[unseen] = at_high.velocity[n][unseen]
            least = 2.0 * self.nearness.of(at_high).tight[through]
            gap[unseen] = np.maximum(at_high.gap[through] - rate * (high - low), least)[unseen]
            s = low + first_crossing(gap, rate, at_high.gap[through], at_high.velocity[n], high - low)
            found, answer, middle = self._finish(t, begun, s)
            apart = (found.gap / self.nearness.of(found).tight)[~begun.seen_in(found.layout).active]
            deepest = float(apart.min(initial=np.inf))
            if abs(deepest) <= 1.0 or high - low < 1e-12 * h:
                return s, found, answer, middle
            if deepest > 0.0:
                low, at_low = s, found
            else:
                high, at_high = s, found
        return s, found, answer, middle

    def _accept(self, t: float, h: float, begun: Begun, answer: VelocityAnswer, middle: Snapshot, end: Snapshot) -> None:
        """Take a step: keep its forces, tell what ended, put positions right, strike what arrives."""
        then = begun.seen_in(end.layout)
        if middle.layout is not end.layout:
            carry = Carry(middle.layout, end.layout)
            answer = replace(answer, impulse=carry.rows(answer.impulse), velocity=carry.rows(answer.velocity))
        layout = end.layout
        self.force = answer.impulse / h
        if len(self.force):
            # A corner that carries nothing, as the others carry all, and stays where it is has not left.
            closed = layout.pushes & then.active & (answer.velocity[layout.normals] <= SLIDES)
            self.watch.step(t, h, layout, self.force, (then.velocity, answer.velocity), closed)
            end = self.closing.put_right(end, t + h, closed & (answer.impulse[layout.normals] > 0.0))
            if self.solver.redundant.found and self.closing.holds:
                end = self.closing.stilled(end, t + h)
                if end.layout is layout:
                    answer = replace(answer, velocity=np.where(layout.held, end.velocity, answer.velocity))
        same = begun.at.layout is end.layout
        self.before = Begun(begun.at, begun.active, None, answer, h, begun.u) if same else None
        self.at = end
        if end.layout is layout:
            self.told, self.closed = answer.velocity, then.active
        else:
            carry = Carry(layout, end.layout)
            known = np.repeat(carry.known, end.layout.widths)
            self.told = np.where(known, carry.rows(answer.velocity), end.velocity)
            self.force, self.closed = carry.rows(self.force), carry.points(then.active, False)
        self._strike(t + h, self.closed)

    def _strike(self, t: float, closed: Array | None = None) -> None:
        """Impacts of the points that touch and approach: of those that were not closed before, however slowly they come.

        Args:
            t: When [s].
            closed: Which points were closed before, shape (k,); None at the start.
        """
        at, layout = self.at, self.at.layout
        self.away = np.zeros(len(at.gap), bool)
        touches, approach = self._touching(), at.approach
        slow = -self.settings.impact_speed
        limit = -_STILL if closed is None else np.where(closed, slow, -_STILL)
        arrives = touches & layout.pushes & (approach < limit)
        if not arrives.any() and (closed is not None or at.drift_rate <= _STILL):
            if closed is None:
                self.away = self._rises()
            return
        if arrives.any():  # what is as near as closed points may be is struck together with what arrives
            touches = touches | (at.gap <= self.nearness.of(at).loose)
            arrives = touches & layout.pushes & (approach < limit)
        self.closed = touches
        offset = at.velocity - at.J @ at.state.v
        n = layout.normals[arrives]
        e = np.array([self.restitution.get(layout.owners[i], 0.0) for i in np.flatnonzero(arrives)])
        offset[n] += np.where(approach[arrives] < slow, e * approach[arrives], 0.0)
        M = at.state.M
        answer = self.solver.solve(at, touches, M @ at.state.v, offset, 0.0, np.zeros(len(offset)))
        self.at, self.before, self.told = self.points.at(at.state.with_velocity(answer.v), t), None, None
        self.away = self._rises()
        self.watch.impact(t, layout, arrives, at.approach, answer.impulse[layout.normals], self.away)

    def _rises(self) -> Array:
        """Which points move away from their surface, faster than what comes to rest, shape (k,)."""
        return self.at.layout.pushes & (self.at.approach > self.settings.impact_speed)

    # -- what is told ----------------------------------------------------------------------------------------------------

    def _moment(self, t: float, coming: Begun, h: float, *, recorded: bool) -> Moment:
        """What is known at t; of a moment that is not recorded, no forces, and the acceleration of the step before."""
        at = coming.at
        if not recorded:
            a = (coming.answer.v - at.state.v) * (2.0 / h) - self.bases.spin(at.state.v)
            return Moment(t, at.state, a, zeros(self.robot.nu), dict, events=self.watch.taken())
        begun = coming if coming.tau is not None else self._begin(t, h)
        if stopping(at.layout, begun.u, begun.answer.velocity, begun.answer.impulse) is not None:
            begun = self._begin(t, 1e-3 * h)  # what slides now, and stops before half the step is over, slides in the record
        answer, half = begun.answer, 0.5 * begun.h
        assert begun.tau is not None
        speed = slide(at.layout, answer.velocity)
        a, law = (answer.v - at.state.v) / half - self.bases.spin(at.state.v), self.motion.law
        return Moment(
            t, at.state, a, begun.tau,
            lambda: touches_of(at, least_forces(at, begun.active, answer, half, law), speed, self.names),
            answer.law, at.drift, at.drift_rate, at.penetration, self.watch.taken(),
        )  # fmt: skip

    def _guess(self, at: Snapshot) -> Array:
        """Row forces to start from."""
        return self.force if len(self.force) == len(at.velocity) else np.zeros(len(at.velocity))

    def _wanted(self, layout: Layout, u: Array, error: Array, h: float) -> Array | float:
        """Velocities of what holds after a time h, shape (p,), as Baumgarte's feedback wants them; 0.0 without it.

        It is one implicit Euler step of error'' + 2 zeta w error' + w^2 error = 0 from (error, u), stable at any h. u is the
        velocity that the step before was to have: that of the state differs from it by O(h^2), and these differences must not
        add up.
        """
        if self.feedback is None:
            return 0.0
        w, zeta = float(self.feedback.frequency), float(self.feedback.damping_ratio)
        return np.where(layout.held, (u - h * w * w * error) / (1.0 + 2.0 * zeta * w * h + (w * h) ** 2), 0.0)
