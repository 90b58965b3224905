"""Constraints as functions of q, with some joints fixed: what is left of the errors, and how it changes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, max_abs
from rbd.constraints.constraint import Constraint, rows_of
from rbd.constraints.joint_lists import joint_limits
from rbd.errors import DuplicateName, InputError
from rbd.mechanism.coordinates import coordinates_of
from rbd.mechanism.held import of_its_file
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State
from rbd.problem.cones import Box, Free, NonNegative
from rbd.problem.rows import Rows

SINGULAR = 1e-5
"""A singular value counts as zero at this fraction of the largest: constraints met to 1e-12 leave a pose where they are
singular uncertain by 1e-6, and its singular values with it."""

_NO_ERROR = np.zeros(0)


@dataclass(frozen=True, eq=False)
class Misfit:
    """What is left of the constraints at one configuration.

    Attributes:
        state: The robot there, at rest.
        rows: All rows, in the constraints' order.
        error: Position errors that are not met, shape (m,) [m, rad]: of rows that push, only what is beyond.
        J: Jacobian of these over the free velocities, in units of `Closure.metric`, shape (m, free).
    """

    state: State
    rows: tuple[Rows, ...]
    error: Array
    J: Array

    @property
    def q(self) -> Array:
        """The configuration, shape (nq,), read-only."""
        return self.state.q

    @property
    def residual(self) -> float:
        """Largest entry of the error [m, rad]."""
        return max_abs(self.error)


class Closure:
    """Constraints on a robot, some of its joints fixed.

    Args:
        robot: The robot.
        constraints: Those that hold, and limits; None for the loops and wheels of its file.
        fixed: {joint: value}.
        within_limits: Add the limits of the robot's file.
        one_sided: Ask stops too for what is beyond them; if not, only what holds.

    Attributes:
        coordinates: The robot's coordinates.
        fixed: {joint: value} as given.
        free: Which velocities are free, indices, shape (free,).
        metric: Unit of each free velocity, shape (free,): the robot's length for those that slide, else one.
        length: The robot's length [m].
        skipped: Why some constraints have no say, one sentence each; filled at the first evaluation.

    Raises:
        InputError: no constraints, no robot, values of a wrong size.
        JointNotFound: a fixed joint that is none.
        DuplicateName: two constraints of one name.
    """

    def __init__(
        self,
        robot: CheckedModel,
        constraints: Sequence[Constraint] | None,
        fixed: Mapping[str, object] | None = None,
        *,
        within_limits: bool = False,
        one_sided: bool = True,
    ) -> None:
        self.coordinates = coordinates_of(robot)
        self.robot, self.model = robot, robot.model
        self.fixed = {} if fixed is None else fixed
        self._target = self.coordinates.with_values(pin.neutral(self.model), self.fixed)
        held = np.zeros(robot.nv, bool)
        self._pinned = np.zeros(robot.nq, bool)
        for joint in self.fixed:
            place = self.coordinates.places[joint]
            held[self.coordinates.columns(joint)] = True
            self._pinned[place.q : place.q + sum(p.nq for p in place.pieces)] = True
        self.free = np.flatnonzero(~held)
        self.held = held
        self.metric, self.length = self.coordinates.metric[self.free], self.coordinates.length
        given = of_its_file(robot) if constraints is None else listed(constraints)
        self._limits = tuple(joint_limits(robot)) if within_limits else ()
        self.constraints: tuple[Constraint, ...] | None = None
        self._given, self._one_sided = given, one_sided
        self.skipped: tuple[str, ...] = ()
        self._all_free = len(self.free) == robot.nv and bool(np.all(self.metric == 1.0))

    def start(self, q0: Array) -> Misfit:
        """The misfit at q0 with the fixed joints at their values; what the constraints are is checked here.

        Raises:
            InputError: q0 is none, something is no constraint, nothing says where the robot is to be.
            DuplicateName: two constraints of one name.
        """
        state = State(self.robot, self.pin(self.robot.check_q(q0)))
        rows = rows_of(state, self._given) + rows_of(state, self._limits)
        self._check(rows)
        self.constraints = (*self._given, *self._limits)
        return self._misfit(state, tuple(rows))

    def at(self, q: Array) -> Misfit:
        """The misfit at a configuration."""
        if self.constraints is None:
            return self.start(q)
        state = State(self.robot, q)
        return self._misfit(state, tuple([c.rows(state) for c in self.constraints]))

    def pin(self, q: Array) -> Array:
        """A copy of q with the fixed joints at their values."""
        return np.where(self._pinned, self._target, q)

    def move(self, q: Array, z: Array) -> Array:
        """The configuration reached by the displacement z of the free velocities, in units of `metric`."""
        if self._all_free:
            return np.asarray(pin.integrate(self.model, q, z))
        dq = np.zeros(self.robot.nv)
        dq[self.free] = self.metric * z
        q = np.asarray(pin.integrate(self.model, q, dq))
        return self.pin(q) if self.fixed else q

    def way(self, q: Array, to: Array) -> Array:
        """The displacement of the free velocities from one configuration to another, in units of `metric`."""
        return self.coordinates.way(q, to)[self.free] / self.metric

    def names(self, mask: Array) -> list[str]:
        """Names of the free velocities that a mask chooses."""
        return [self.coordinates.names[i] for i in self.free[mask]]

    def _misfit(self, state: State, rows: tuple[Rows, ...]) -> Misfit:
        errors, Js = [], []
        for r in rows:
            error, J = unmet(r)
            if len(error) and (self._one_sided or type(r.cone) is not NonNegative):
                errors.append(error)
                Js.append(J)
        if not errors:
            return Misfit(state, rows, np.zeros(0), np.zeros((0, len(self.free))))
        J = np.concatenate(Js) if len(Js) > 1 else Js[0]
        if not self._all_free:
            J = J[:, self.free] * self.metric
        return Misfit(state, rows, np.concatenate(errors) if len(errors) > 1 else errors[0], J)

    def _check(self, rows: list[Rows]) -> None:
        names, skipped, says = set(), [], False
        for r in rows:
            if r.name in names:
                raise DuplicateName(f"two constraints are called {r.name!r:.80}; give each its own name.")
            names.add(r.name)
            if isinstance(r.cone, Box):
                skipped.append(f"{r.name!r:.80} resists a motion and asks for no place")
            elif len(r) and (r.error is None or r.holonomic is not None and not r.holonomic.any()):
                skipped.append(f"{r.name!r:.80} constrains velocities alone, or has no anchor")
            elif len(r) and not isinstance(r.cone, Free | NonNegative):
                raise InputError(
                    f"{r.name!r:.80} can slip or break ({type(r.cone).__name__}), so it says not where the robot is. "
                    "Give it friction=None to hold it there, or leave it out."
                )
            else:
                says = True
        self.skipped = tuple(skipped)
        if not says:
            why = "; ".join(skipped) if skipped else "none was given"
            raise InputError(
                f"no constraint says where {self.robot.name} is to be: {why:.400}. Give constraints with an error, e.g. "
                "rbd.LoopClosure, a contact with an anchor, a rbd.JointLock with a position."
            )


def listed(constraints: Sequence[Constraint]) -> Sequence[Constraint]:
    """An iterable as a tuple, so that it can be gone through twice; what is none is left to be refused."""
    if isinstance(constraints, str | bytes) or hasattr(constraints, "rows"):
        return constraints
    try:
        return tuple(constraints)
    except TypeError:
        return constraints


def unmet(rows: Rows) -> tuple[Array, Array]:
    """The position errors that rows ask to be zero, and their Jacobian: none of rows without an error.

    Of rows that push only what is beyond; nothing of friction in a joint.
    """
    error, J = rows.error, rows.J
    if error is None or type(rows.cone) is Box:
        return _NO_ERROR, J
    if type(rows.cone) is NonNegative:
        beyond = error < 0.0
        return error[beyond], J[beyond]
    if rows.holonomic is not None:
        return error[rows.holonomic], J[rows.holonomic]
    return error, J


def rank_of(s: Array) -> int:
    """How many singular values are not zero, at `SINGULAR`."""
    return int((s > SINGULAR * s[0]).sum()) if len(s) and s[0] > 0.0 else 0
