"""Torques and forces for a wanted motion: those that the motion allows, with the least effort.

`rbd.hold` and `rbd.inverse_dynamics` are this, at rest and moving.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from rbd.answers.prepared.constraint_dynamics import prepared
from rbd.arrays import BELOW_ONE, Array, check_number, lazy, max_abs, zeros
from rbd.constraints.constraint import Constraint
from rbd.constraints.distance_warnings import warn_of_limits
from rbd.constraints.round_feet import warn_of_balls
from rbd.errors import CannotMove, ContactMoves, InaccurateWarning, NoSolution, Reason, SpeedLimitWarning
from rbd.errors.inputs import check_choice, check_kind
from rbd.model.external import External, generalised
from rbd.model.state import State
from rbd.problem.answer import Status
from rbd.problem.conic import Conic, ConicAnswer
from rbd.problem.force_set import ForceSet, at_rest
from rbd.problem.motion_forces import Refused, allowed_forces, narrowed, refusal_words
from rbd.problem.programs import CONIC_STEPS, Outcome
from rbd.problem.residuals import SOLVED
from rbd.problem.rows import Rows
from rbd.solvers.conic_newton import solve_conic
from rbd.statics.actuation import Actuation
from rbd.statics.effort import DEFAULT, POSSIBLE, Effort
from rbd.statics.force_balance import ForceBalance, contact_rows, refuse_motion
from rbd.statics.least_effort import LeastEffort
from rbd.statics.nearest_possible_motion import nearest_possible

MARGIN = 0.05
"""How far friction of points that keep still is kept from its limit unless said otherwise, as a share of it."""


@dataclass(frozen=True, eq=False)
class EffortChoice:
    """What torques and forces are chosen by.

    Attributes:
        effort: What is made least.
        friction: "cone" or "inscribed".
        margin: Friction of points that keep still stays within 1 - margin of its cone; None: `MARGIN` where that is possible,
            else 0.
        rest_speed: As of `rbd.solve`.
        holds: Whether poses are to be held, at rest.
    """

    effort: Effort
    friction: str
    margin: float | None
    rest_speed: float
    holds: bool

    @classmethod
    def of(
        cls, objective: Effort | None, friction: str, margin: float | None, rest_speed: float, *, holds: bool
    ) -> EffortChoice:
        """Checked.

        Raises:
            InputError: an objective that is none, an unknown word, a margin or a speed that is none.
        """
        effort = DEFAULT if objective is None else objective
        check_choice("friction", friction, ("cone", "inscribed"))
        check_kind("objective", effort, Effort, "an rbd.statics.Effort, or None")
        check_number("rest_speed", rest_speed, 0.0, 1e100, expected="a speed of 0 or more [m/s, rad/s]")
        return cls(effort, friction, None if margin is None else checked_margin(margin), rest_speed, holds)

    @property
    def margins(self) -> tuple[float, ...]:
        """The margins, in the order in which they are tried."""
        return (MARGIN, 0.0) if self.margin is None else (self.margin,)


@dataclass(frozen=True, eq=False)
class WantedMotion:
    """A motion, its contacts, and what torques and forces are chosen by.

    Attributes:
        state: The robot at (q, v).
        a: Its acceleration, shape (nv,).
        contacts: Contacts and other constraints.
        external: Other forces, as given.
        choice: What torques and forces are chosen by.
    """

    state: State
    a: Array
    contacts: tuple[Constraint, ...]
    external: External
    choice: EffortChoice

    @classmethod
    def of(
        cls, state: State, a: Array, contacts: tuple[Constraint, ...], external: External, choice: EffortChoice,
        *, stacklevel: int | None = None,
    ) -> WantedMotion:  # fmt: skip
        """Checked; a warning names contacts that are off their planes, if a `stacklevel` is given.

        Raises:
            NotAtRest: a pose is to be held, and the robot, or what a contact touches, moves.
            DuplicateName: two constraints of one name.
        """
        if choice.holds:
            refuse_motion(state)
        out, level = cls(state, a, contacts, external, choice), None if stacklevel is None else stacklevel + 1
        if out.quick is None:
            out.__dict__["rows"] = rows = contact_rows(state, contacts, stacklevel=level)
            if choice.holds:
                refuse_motion(state, rows)
        elif level is not None:
            warn_of_limits(state, contacts, stacklevel=level)
            warn_of_balls(state, contacts, stacklevel=level)
        if level is not None and not choice.holds:
            _warn_of_speed(state, level)
        return out

    @lazy
    def quick(self) -> Actuation | None:
        """The answer of the constraints' prepared form, with the first margin; None where it has none that is certified."""
        choice, state, (margin, *_) = self.choice, self.state, self.choice.margins
        form = prepared(state.robot, self.contacts) if choice.friction == "cone" and not choice.effort.bounded else None
        if form is None or not form.on_still_ground:
            return None
        prepared_effort = LeastEffort.of(form.plan(state.q), choice.effort, margin)
        answer = prepared_effort.least(state, self.a, self.external, choice.rest_speed)
        if answer is None:
            return None
        found, bound = answer
        loads = ForceBalance(state, partial(getattr, self, "rows"), prepared_effort.sets, found.need)
        return self._actuation(loads, found.tau, found.w, margin, found.steps, "Newton", bound=bound)

    @lazy
    def rows(self) -> tuple[Rows, ...]:
        """The rows of the constraints."""
        return contact_rows(self.state, self.contacts, stacklevel=None)

    @lazy
    def tau_ext(self) -> Array:
        """Generalised force of the world, shape (nv,)."""
        return zeros(self.state.robot.nv) if self.external is None else generalised(self.state, self.external)[0]

    def sought(self, margin: float) -> Actuation | ConicAnswer:
        """The torques and forces of least effort; where there are none within tolerance, what the program ended with.

        Near a limit, or where contacts are nearly redundant, the least may not be found; torques that are possible are.

        Args:
            margin: Friction of points that keep still stays within 1 - margin of its cone.

        Raises:
            ContactMoves: the velocity is none that the contacts allow.
            CannotMove: the acceleration is none that they allow.
        """
        allowed, refused = self._allowed(margin)
        if refused:
            name = self.state.robot.name
            raise CannotMove(
                f"{name} cannot move so: {refusal_words(refused, [r.name for r in self.rows])} m/s2 (or rad/s2). Put the "
                "acceleration onto the contacts, rbd.mechanism.project_acceleration(state, a, contacts), or leave out what "
                "opens.",
                nearest=partial(WantedMotion.nearest, self, margin),
                reason=Reason.CANNOT_MOVE_CONTACT,
            )
        loads = self._loads(allowed)
        program = self.choice.effort.program(loads)
        found = solve_conic(program)
        least = found.solved
        if not least and found.certificate is None and program.outside(found.x) > POSSIBLE:
            zero = np.zeros_like(program.H)
            found = solve_conic(replace(program, H=zero, g=zero[:, 0]), newton=False, tolerance=POSSIBLE)
        x = _balanced(program, found.x)
        if not (found.solved or found.certificate is None and program.outside(x) <= POSSIBLE):
            return found
        w = x * loads.unit
        return self._actuation(loads, loads.torques(w)[0], w, margin, found.iterations, found.method, least=least)

    def loads(self, margin: float) -> ForceBalance:
        """The equations of motion, and the forces that the motion allows."""
        return self._loads(self._allowed(margin)[0])

    def _actuation(
        self, loads: ForceBalance, tau: Array, w: Array, margin: float, steps: int, method: str, *, least: bool = True,
        bound: float = math.inf,
    ) -> Actuation:  # fmt: skip
        choice = self.choice
        return Actuation(
            self.a, tau, w, loads, self.contacts, self.external, choice.effort, margin, choice.rest_speed, steps, method, least,
            bound,
        )  # fmt: skip

    def _loads(self, sets: ForceSet) -> ForceBalance:
        state = self.state
        need = state.h - self.tau_ext
        if self.choice.holds:
            return ForceBalance(state, self.rows, sets, need, self._motion)
        terms = np.abs(state.M) @ np.abs(self.a) + np.abs(need)
        return ForceBalance(state, self.rows, sets, state.M @ self.a + need, self._motion, terms)

    def _allowed(self, margin: float) -> tuple[ForceSet, tuple[Refused, ...]]:
        if self.choice.holds:
            return self._pyramids(narrowed(self.sets, margin)), ()
        allowed, refused = allowed_forces(self.sets, *self._accelerations(), margin)
        return self._pyramids(allowed), refused

    def _pyramids(self, sets: ForceSet) -> ForceSet:
        return sets.with_pyramids(inscribed=True) if self.choice.friction == "inscribed" and len(sets.mu) else sets

    @lazy
    def sets(self) -> ForceSet:
        """The force sets, velocities regarded.

        Raises:
            ContactMoves: the velocity is none that the contacts allow.
        """
        if self.choice.holds:
            return at_rest(*[r.cone for r in self.rows])
        rest_speed = self.choice.rest_speed
        sets = ForceSet.of(self.rows, rest_speed)
        if sets.impact:
            raise ContactMoves(
                f"contact {sets.impact} (at rest is up to rest_speed = {rest_speed:g} m/s). Put the velocity onto the "
                "contacts: rbd.mechanism.project_velocity(state, contacts).",
                reason=Reason.CONTACT_MOVES_IMPACT,
            )
        for r in self.rows:
            if len(r) and r.speed > rest_speed and at_rest(r.cone).bilateral:
                raise ContactMoves(
                    f"{r.name!r:.80} is held, and its velocity is {r.speed:.3g} (at rest is up to rest_speed = "
                    f"{rest_speed:g}). Put the velocity onto the contacts: rbd.mechanism.project_velocity(state, contacts).",
                    reason=Reason.CONTACT_MOVES_HELD,
                )
        return sets

    def _accelerations(self) -> tuple[Array, Array]:
        """(accelerations, what counts as zero) of the columns of the sets."""
        sets = self.sets
        if not self.rows:
            return np.zeros(sets.size), np.zeros(sets.size)
        J, offset = self._motion
        y = sets.accelerations(J @ self.a + offset)
        if max_abs(y) <= SOLVED:  # the least that counts as zero: all points keep still
            return y, np.full(len(y), SOLVED)
        sizes = [np.abs(r.bias) + np.abs(r.feedback) for r in self.rows]
        terms = np.maximum(np.abs(J) @ np.abs(self.a) + np.concatenate(sizes), 1.0)
        along = np.abs(sets.H).T @ terms + np.abs(sets.offset)
        return y, SOLVED * np.maximum(along, 1.0)

    @lazy
    def _motion(self) -> tuple[Array, Array]:
        """(J, bias and feedback) of all rows."""
        if not self.rows:
            return np.zeros((0, self.state.robot.nv)), zeros(0)
        offset = np.concatenate([r.bias for r in self.rows])
        if any([r.stabilised for r in self.rows]):
            offset = offset + np.concatenate([r.feedback for r in self.rows])
        return np.concatenate([r.J for r in self.rows]), offset

    def nearest(self, margin: float, before: list[ConicAnswer] | None = None) -> Actuation:
        """The nearest possible motion, contacts as they are; `before`: as of `nearest_possible`.

        Raises:
            NoSolution: where there is none, or it was not found.
        """
        sets = self.sets
        loads = self._loads(self._pyramids(narrowed(sets, margin)))
        J, offset = self._motion
        live = sets.lower < sets.upper
        H, at = sets.H[:, live].T, sets.offset[live]
        free = self.tau_ext - self.state.h
        found = nearest_possible(loads, self.a, free, H @ J, H @ offset + at, self.choice.effort, before)
        name = self.state.robot.name
        if found is Outcome.INFEASIBLE:
            raise NoSolution(f"{name} has no possible motion that keeps its contacts as they are.")
        if isinstance(found, Outcome):
            raise NoSolution(f"the nearest possible motion of {name} was not found within {CONIC_STEPS} steps.")
        a, w = found
        moved = replace(self, a=a, choice=replace(self.choice, holds=False))
        loads = moved._loads(loads.sets)
        out = moved._actuation(loads, loads.torques(w)[0], w, margin, 0, "Clarabel")
        checked = warned(out, 4)
        if checked is None:
            raise NoSolution(
                f"the nearest possible motion of {self.state.robot.name} was found only to a scaled residual of "
                f"{out.residuals.worst:.1e}."
            )
        return checked


_NONE = np.zeros(0, int)


def _warn_of_speed(state: State, stacklevel: int) -> None:
    beyond = state.robot.too_fast(state.v)
    fast = beyond.nonzero()[0] if beyond.any() else _NONE
    for i in fast[:1]:
        name = state.robot.actuated_names[i]
        joint, motor = state.robot.joints[name], state.robot.motor_data[name]
        assert motor is not None
        more = f"; {len(fast)} joints are faster than theirs" if len(fast) > 1 else ""
        warnings.warn(
            f"{name} moves at {abs(state.v[joint.v.start]):.4g} {joint.unit}/s, faster than the {motor.speed_limit:.4g} "
            f"{joint.unit}/s of its motor{more}.",
            SpeedLimitWarning,
            stacklevel=stacklevel,
        )


def checked_margin(margin: float) -> float:
    """A number from 0, below 1.

    Raises:
        InputError: it is none.
    """
    words = "a number from 0, below 1: 0.05 keeps friction 5 % from its limit"
    return check_number("margin", margin, 0.0, BELOW_ONE, expected=words)


_EXACT = 1e-14
"""What is left of balance below this, of numbers around one, is rounding."""


def warned(actuation: Actuation, stacklevel: int) -> Actuation | None:
    """The actuation, with a warning where it is inaccurate; None where its residuals say that it is none."""
    status = actuation.status
    if status is Status.SOLVED:
        return actuation
    if status is not Status.INACCURATE:
        return None
    worst = actuation.residuals.worst
    name = actuation.state.robot.name
    warnings.warn(
        f"the torques of {name} have a scaled residual of {worst:.1e} (solved is 1e-9).", InaccurateWarning, stacklevel
    )
    return actuation


def _balanced(program: Conic, x: Array) -> Array:
    """The same x moved, within what is strictly inside its bounds and cones, so that A x = b to rounding."""
    left = program.b - program.A @ x
    if not left.size or np.abs(left).max() <= _EXACT:
        return x
    free = (x > program.lower) & (x < program.upper)
    if len(program.mu):
        cones = x[program.cones]
        inner = np.hypot(cones[:, 0], cones[:, 1]) < program.mu * cones[:, 2] * (1.0 - 1e-9)
        free[program.cones[~inner]] = False
    moved = x.copy()
    moved[free] += np.linalg.lstsq(program.A[:, free], left, rcond=1e-12)[0]
    return moved if program.outside(moved) < program.outside(x) else x
