"""Smooth motion: the acceleration on bilateral constraints, and the projection onto them; shared by all its integrators.

On the rows J v = u, a is Gauss's: nearest to the free acceleration, in |.|_M, with J a + J_dot v = 0. It equals that of
`rbd.solve` with `KKT()`, without the certificate, which is computed for recorded samples.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from rbd.answers.solution import Solution
from rbd.arrays import Array, is_finite, max_abs
from rbd.constraints.constraint import OPEN, Constraint, anchored, ground_of, is_carried, rows_of
from rbd.constraints.loop import LoopRows
from rbd.constraints.manifold import ConstraintManifold, StackedRows, is_bilateral, velocity_of
from rbd.constraints.stabilisation import Baumgarte
from rbd.errors import InputError, NoSolution
from rbd.mechanism.projection import Projection, shortened
from rbd.mechanism.redundant_accelerations import NEAR, StageSolver
from rbd.model.derivatives import Charts
from rbd.model.dynamics import unconstrained
from rbd.model.external import ForceElement
from rbd.model.state import State
from rbd.problem.answer import corner_split
from rbd.problem.gauss_problem import BILATERAL, GaussProblem
from rbd.simulation.instant import held_touches
from rbd.simulation.simulated_motion import HOLDS, ConstraintForce, Sample, SimulatedMotion, dissipation, stored

CLOSE = 3e-2
"""Where the least singular value, over the largest, is below this, stages are projected too: a stage has an error of h^2, which
is amplified by 1 / s. (Accelerations at the nearest point of the constraints are as smooth a field as those at the point
itself, with the same motions on the constraints: the order is unchanged.)"""
ASIDE = 3.0
"""Distance of the nearest neighbours of a crossing, over the distance at which it begins."""
AVOIDED = 0.1
"""If neighbours of a crossing are off the constraints by more than this times the square of their distance, the constraints
do not cross there, but turn away."""
TORN = 0.1
"""Velocity off the constraints after a step, over the largest velocity, above which a step is invalid."""
MOVES = 1e-3
"""Rows that move faster at the start [m/s, rad/s] are violated: projection would be an impact."""
CARRIES = 1e-12
"""Velocity of the surfaces, over the largest velocity, up to which they are at rest [m/s, rad/s]: constraints do no work."""
EXACT = 1e-14
"""Errors up to this are rounding [m, rad]; of velocities, over the largest of them where that is above 1 m/s or rad/s."""


@dataclass(frozen=True, eq=False)
class SmoothStage:
    """A state within a step, with its rows, forces and acceleration.

    Attributes:
        t: [s].
        held: The state, and the rows there.
        tau: Motor torques, shape (nu,).
        applied: S^T tau + tau_ext, shape (nv,).
        a: Acceleration, shape (nv,).
        f: Row forces, shape (m,), if rows are well conditioned; else None.
        elements: Force elements that act.
        work: Work of the motors since the start of the motion [J].
        dissipated: Work that force elements have taken out of the motion since its start [J].
        pushes: Forces that are neither of motors nor of known elements, shape (nv,); None if there are none.
        other_work: Work of pushes, of ground that moves, and of feedback since the start of the motion [J].
    """

    t: float
    held: StackedRows
    tau: Array
    applied: Array
    a: Array
    f: Array | None
    elements: tuple[ForceElement, ...] = ()
    work: float = 0.0
    dissipated: float = 0.0
    pushes: Array | None = None
    other_work: float = 0.0

    @property
    def state(self) -> State:
        """The state."""
        return self.held.state

    @property
    def rhs(self) -> Array:
        """S^T tau + tau_ext - h, shape (nv,)."""
        return self.applied - self.state.h


class SmoothMotion:
    """The vector field (q, v) -> a of a motion on bilateral constraints.

    Args:
        motion: The motion.
        state: Its start; contacts without an anchor are anchored here.

    Attributes:
        motion: The motion.
        charts: Charts of its robot.
    """

    def __init__(self, motion: SimulatedMotion, state: State) -> None:
        self.motion = motion
        self.charts = Charts(motion.robot)
        given = motion.constraints
        placed = tuple(anchored(c, r, state) for c, r in zip(given, rows_of(state, given), strict=True))
        by = motion.stabilisation
        self._projection = by if isinstance(by, Projection) else None
        if isinstance(by, Baumgarte):
            given = placed = tuple(by.of(c) for c in placed)
        carried = [is_carried(c) for c in motion.constraints]
        self._anchored = ConstraintManifold.unchecked(state, placed, carried)
        self._given = self._anchored if given == placed else ConstraintManifold.unchecked(state, given, carried)
        self._open = 0.0
        self._elements = motion.may_have_elements
        carried_first = any(carried) or bool(motion.timed) or _surfaces_move(self._anchored.rows(state))
        self._works = bool(given) and (self._projection is None or carried_first)
        self._pushed = self._works or callable(motion.external) or motion.pushed
        self._solver = StageSolver()

    def start(self, state: State, t: float, h: float) -> SmoothStage:
        """The stage at the given start of a step of length h, of which the controller is told.

        Raises:
            InputError: it violates the constraints in position or velocity.
        """
        reason = reason_not_smooth(self.motion, state)
        if reason is not None:
            raise InputError(reason)
        held = self._anchored.rows(state)
        self._open = held.drift
        self._solver.survey(held)
        self.motion.tell(state, t, h, lambda: held_touches(held.rows, {}))
        return self._stage(held, t)

    def begun(self, stage: SmoothStage, h: float) -> SmoothStage:
        """The stage at the end of a step, after the controller is told that the next one, of length h, begins there."""
        if self.motion.hook is None:
            return stage
        self.motion.tell(stage.state, stage.t, h, lambda: held_touches(stage.held.rows, self._forces(stage)))
        again = self._stage(stage.held, stage.t)
        return replace(again, work=stage.work, dissipated=stage.dissipated, other_work=stage.other_work)

    def at(self, q: Array, v: Array, t: float) -> SmoothStage:
        """A stage within a step.

        Raises:
            NoSolution: the motion is beyond all bounds, or no acceleration satisfies the rows.
        """
        # Without anchors contacts are five times as fast, and their errors are not used here.
        held = self._given.rows(self.motion.reached(q, v, t))
        if self._projection is not None and len(held.J) and self._solver.spread(held) < CLOSE:
            known = self._given is self._anchored
            held = self._projected(held if known else self._anchored.rows(held.state), self._projection, t)
        return self._stage(held, t)

    def landed(self, q: Array, v: Array, t: float) -> SmoothStage:
        """The stage at the end of a step: projected onto the constraints, if `stabilisation` requires it.

        Raises:
            NoSolution: as `at`; or the constraints cannot be satisfied.
        """
        held = self.placed(q, v, t)
        self._solver.learn(held)
        return self._stage(held, t)

    def placed(self, q: Array, v: Array, t: float) -> StackedRows:
        """The state and the rows of `landed`, without the acceleration."""
        held = self._anchored.rows(self.motion.reached(q, v, t))
        if self._projection is not None and len(held.J):
            held = self._projected(held, self._projection, t)
        return held

    def powers(self, first: SmoothStage, stage: SmoothStage) -> Array:
        """Powers whose integrals over a step are work [W]: of motors, of pushes, of force elements, each if there are any.

        Of the motors, less that of the torques at the step's beginning: zero where they are held. Of the elements, the power
        that they take out of the motion. With the pushes, that of constraints on ground that moves, or with feedback.
        """
        out = []
        if self.motion.controller is not None:
            out.append((stage.tau - first.tau).dot(stage.state.v[self.motion.robot.motors]))
        if self._pushed:
            v = stage.state.v
            given = 0.0 if stage.pushes is None else float(stage.pushes @ v)
            if self._works and len(stage.held.J):
                given += float(v @ (stage.state.M @ stage.a - stage.rhs))
            out.append(given)
        if self._elements:
            out.append(dissipation(stage.elements, stage.state))
        return np.array(out, float)

    def worked(self, first: SmoothStage, stage: SmoothStage, work: Array) -> SmoothStage:
        """A stage with the work of motors and force elements up to it.

        Args:
            first: The stage at the beginning of the step.
            stage: The stage.
            work: Integrals of `powers` between them [J].
        """
        given = float(work[-2 if self._elements else -1]) if self._pushed else 0.0
        if not self._works and _surfaces_move(stage.held):  # as no one could tell at the start
            given = math.nan
        if not len(work):
            return replace(stage, other_work=first.other_work + given)
        motors = first.work
        if self.motion.controller is not None:
            motors += self.motion.work(first.tau, first.state.q, stage.state.q) + float(work[0])
        taken = float(work[-1]) if self._elements else 0.0
        return replace(stage, work=motors, dissipated=first.dissipated + taken, other_work=first.other_work + given)

    def _projected(self, held: StackedRows, projection: Projection, t: float) -> StackedRows:
        """Newton's steps in position and velocity; a step's error is small, so that one of each usually suffices."""
        solver = self._solver
        if held.drift > OPEN + self._open or held.drift_rate > TORN * max(1.0, max_abs(held.state.v)):
            worst = int(np.argmax(np.abs(held.error) if held.drift > OPEN + self._open else np.abs(held.velocity)))
            raise NoSolution(
                f"the step to t = {t:.6g} s of {self.motion.robot.name} is too long for how sharply it turns: it leaves "
                f"{held.name_of(worst)!r:.80} by {held.drift:.3g} m and {held.drift_rate:.3g} m/s (or rad). Give a smaller "
                "step, or rbd.DormandPrince8()."
            )
        for _ in range(projection.iterations):
            error, rate = held.drift, held.drift_rate
            # Where rows are nearly dependent a small error means a large displacement.
            enough = 0.5 * projection.tolerance * solver.spread(held)
            rounding = EXACT * max(1.0, max_abs(held.state.v))
            if error <= max(enough, EXACT) and rate <= max((1.0 if self.motion.timed else 10.0) * enough, rounding):
                break
            state = held.state
            d = -solver.back(held, held.error, held.placed, damping=error) if error > 0.1 * enough else None
            v = state.v - solver.back(held, held.velocity, None)
            q = state.q if d is None else self.charts.at(state.q).q(shortened(d))
            nearer = self._anchored.rows(self.motion.reached(q, v, t))
            if nearer.drift >= max(error, EXACT) and nearer.drift_rate >= max(rate, rounding):
                break
            held = nearer
        if held.drift > OPEN:
            worst = int(np.argmax(np.abs(held.error)))
            raise NoSolution(
                f"{self.motion.robot.name} leaves its constraints at t = {t:.6g} s: {held.name_of(worst)!r:.80} is off by "
                f"{held.drift:.3g} m (or rad), and nothing brings it back. Give a smaller step."
            )
        return held

    def sample(self, stage: SmoothStage) -> Sample:
        """The sample at a stage."""
        held = stage.held
        law = self._solver.law(held, stage.a, stage.rhs, stage.f)
        return Sample.of(
            stage.t,
            stage.state,
            stage.a,
            stage.tau,
            lambda: self._forces(stage),
            law=law,
            drift=held.drift,
            drift_rate=held.drift_rate,
            motor_work=stage.work,
            elastic=stored(stage.elements, stage.state),
            dissipated=stage.dissipated,
            other_work=stage.other_work,
        )

    def _forces(self, stage: SmoothStage) -> Mapping[str, ConstraintForce]:
        held = stage.held
        if not held.rows:
            return {}
        f, unique = self._solver.forces(held, stage.a, stage.rhs)
        if unique and isinstance(held.rows, LoopRows):  # without the rows of each loop
            return {name: ConstraintForce(force, HOLDS) for name, force in held.rows.forces(f).items()}
        found = None
        if not unique:  # of all equivalent forces, those of `rbd.solve`
            P = GaussProblem(stage.state.M, stage.rhs, held.rows, from_state=True)
            found = Solution(P, stage.a, f, None, BILATERAL, "smooth", 1, 0.0).settled()
        out, at = {}, 0
        for r in held.rows:
            part, at = f[at : at + len(r)], at + len(r)
            force = found.forces[r.name] if found is not None else part.copy() if r.resultant is None else r.resultant @ part
            points = pushes = None
            if r.patch is not None and r.resultant is not None:
                points = r.patch.point + r.patch.corners @ r.patch.axes.T
                pushes = corner_split(r, part) if found is None else found.corner_forces[r.name]
            out[r.name] = ConstraintForce(force, HOLDS, points, pushes)
        return out

    def _stage(self, held: StackedRows, t: float) -> SmoothStage:
        tau, applied, elements, pushes = self.motion.acting(held.state, t)
        if not len(held.J):
            a, f = unconstrained(held.state, applied), None
        else:
            rhs = applied - held.state.h
            found = self._solver.acceleration(held, rhs, t)
            a, f = found.a, found.f
            if found.crossing is not None and self._projection is not None:
                a = self._across(held, rhs, t, a, found.crossing.rate, self._projection)
        if not is_finite(a):
            raise NoSolution(f"the acceleration of {self.motion.robot.name} is not finite at t = {t:.6g} s.")
        return SmoothStage(t, held, tau, applied, a, f, elements, pushes=pushes)

    def _across(self, held: StackedRows, rhs: Array, t: float, a: Array, rate: float, projection: Projection) -> Array:
        """The acceleration at a singular pose, from those of its neighbours on the branch, ahead and behind.

        (15 A(e) - 6 A(2 e) + A(3 e)) / 10, where A(e) is the mean of a(t + e) and a(t - e) under the present forces: exact to
        e^6, though the neighbours are only known to second order, as A is even in e.

        Args:
            held: The rows.
            rhs: S^T tau + tau_ext - h here.
            t: For messages.
            a: A first guess, with error O(s).
            rate: Rate of the least singular value [1/s].
            projection: Settings of the projection of neighbours.
        """
        state, solver = held.state, self._solver
        v, forces, chart = state.v, rhs + state.h, self.charts.at(state.q)
        e1, mean = ASIDE * NEAR / rate, []
        if 3.0 * e1 * max_abs(a) > max_abs(v):
            return a  # so slow that it reverses here
        for e in (e1, 2.0 * e1, 3.0 * e1):
            found = []
            for side in (e, -e):
                xi = side * v + 0.5 * side * side * a
                beside = self._anchored.rows(self.motion.reached(chart.q(xi), v + side * a, t))
                there = self._projected(beside, projection, t)
                moved = pin.difference(self.motion.robot.model, beside.state.q, there.state.q)
                if max_abs(moved) > AVOIDED * max_abs(xi) ** 2:
                    return solver.acceleration(held, rhs, t, directly=True).a
                found.append(solver.acceleration(there, forces - there.state.h, t, directly=True).a)
            mean.append(0.5 * (found[0] + found[1]))
        return 1.5 * mean[0] - 0.6 * mean[1] + 0.1 * mean[2]


def _surfaces_move(held: StackedRows) -> bool:
    """Whether constraints hold to surfaces that move, and so do work."""
    v = held.state.v
    return len(held.J) > 0 and max_abs(held.J @ v - held.velocity) > CARRIES * max(1.0, max_abs(v))


def reason_unknown_ground(constraint: Constraint) -> str | None:
    """Message: why the ground of a constraint cannot be followed over time; None if it can."""
    ground = ground_of(constraint)
    if ground is None or ground.acceleration is None or not np.any(ground.acceleration):
        return None
    return (
        f"the ground of {constraint.name!r:.80} accelerates, and how it moves is known at one instant only. Give it a velocity "
        "without an acceleration, a motion in time, rbd.Ground(motion=...), or take a second body in the model for what it "
        "touches, on=rbd.Body(...)."
    )


def reason_not_smooth(motion: SimulatedMotion, state: State) -> str | None:
    """Message: why a motion is not smooth; None if it is."""
    rows = rows_of(state, motion.constraints)
    for constraint, r in zip(motion.constraints, rows, strict=True):
        if not is_bilateral(r):
            return (
                f"{r.name!r:.80} can break or slip (its forces live in a {type(r.cone).__name__}), and this integrator takes "
                "bilateral constraints. Use integrator=rbd.TimeStepping(), or friction=None for a bilateral contact."
            )
        if (unknown := reason_unknown_ground(constraint)) is not None:
            return unknown
        if not isinstance(motion.stabilisation, Projection) or not len(r):
            continue
        off = 0.0 if r.error is None else max_abs(r.error)
        if off > OPEN:
            return (
                f"{r.name!r:.80} is off by {off:.3g} m (or rad) at the start. Close it first, with rbd.mechanism.assemble, or "
                "give stabilisation=rbd.constraints.Baumgarte(frequency), which pulls it together; loops=False leaves a "
                "robot's own loops out."
            )
        speed = max_abs(velocity_of(r, state))
        if speed > MOVES:
            return (
                f"{r.name!r:.80} holds, and moves at {speed:.3g} m/s (or rad/s) at the start: that is an impact. Give a state "
                "whose velocity the constraints allow, rbd.mechanism.project_velocity(state, constraints) (at an event: "
                "Switch(..., impact=True); else rbd.impact), or use "
                "integrator=rbd.TimeStepping()."
            )
    return None
