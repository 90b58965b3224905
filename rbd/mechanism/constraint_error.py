"""Errors of constraints with some joints fixed, as `rbd.constraints.descent` brings them to zero, and bilateral velocities."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_finite, lazy, max_abs
from rbd.constraints.constraint import Constraint, rows_of
from rbd.constraints.descent import Residual, Space, descend
from rbd.constraints.joint import joint_limits
from rbd.constraints.manifold import CLOSED, StackedRows, own_or, rank_of as rank_at
from rbd.errors import InputError
from rbd.errors.inputs import check_different, check_kind
from rbd.mechanism.idle import IdleFreedom, idle_directions, idle_freedoms
from rbd.mechanism.poses import distance
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State, checked
from rbd.problem.cones import Bounds, NonNegative
from rbd.problem.rows import Rows

SINGULAR = 1e-5
"""A singular value counts as zero at this fraction of the largest: constraints satisfied to 1e-12 leave a pose where they are
singular uncertain by 1e-6, and its singular values with it."""

_NO_ERROR = np.zeros(0)


@dataclass(frozen=True, eq=False)
class ConstraintResidual(Residual):
    """Residual of the constraints at one configuration.

    Attributes:
        rows: All rows, in the constraints' order.
        error: Position errors, shape (m,) [m, rad]; of unilateral rows, only violations.
        J: Jacobian of these over the free velocities, in units of `Closure.scale`, shape (m, free).
        idle: Directions of idle freedoms that are at rest, shape (k, free).
    """

    rows: tuple[Rows, ...]
    idle: Array

    @lazy
    def svd(self) -> tuple[Array, Array, Array]:
        """U, s, Vt of J, in full; without rows, of one row of zeros."""
        return np.linalg.svd(self.J if len(self.J) else np.zeros((1, self.J.shape[1])))

    @property
    def rank(self) -> int:
        """Rank of J."""
        return rank_of(self.svd[1])

    @property
    def null(self) -> Array:
        """Orthonormal directions that J allows, shape (free - rank, free)."""
        return self.svd[2][self.rank :]


class Closure(Space[ConstraintResidual]):
    """Constraints on a robot, some of its joints fixed.

    Args:
        robot: The robot.
        constraints: Bilateral constraints, and joint limits; None for the loops and wheels of its file.
        fixed: {joint: value}.
        within_limits: Add the limits of the robot's file.
        one_sided: Include violations of joint limits; if not, only bilateral constraints.
        loops: Whether the robot's own loops hold.
        t: Time of the configurations [s].

    Attributes:
        skipped: Why some constraints are skipped, one sentence each; filled at the first evaluation.
        idle: Idle freedoms that are left at rest: their directions are rows of J, without an error; see `rested`.
        resting: Whether they are rows of J. Steps onto the constraints leave them at rest without, and are faster.

    Raises:
        InputError: no constraints, no robot, values of a wrong size.
        JointNotFound: an unknown fixed joint.
        DuplicateName: two constraints with the same name.
    """

    longest = math.inf  # the damping alone keeps steps short

    def __init__(
        self,
        robot: CheckedModel,
        constraints: Sequence[Constraint] | None,
        fixed: Mapping[str, object] | None = None,
        *,
        within_limits: bool = False,
        one_sided: bool = True,
        loops: bool = True,
        t: float = 0.0,
    ) -> None:
        check_kind("the robot", robot, CheckedModel, "a robot: rbd.load_robot(name)")
        super().__init__(robot, fixed)
        self.unit_error, self.t = robot.joints.length, t
        self._given, self._one_sided = own_or(robot, constraints, loops), one_sided
        self._limits = tuple(joint_limits(robot)) if within_limits else ()
        self.constraints: tuple[Constraint, ...] | None = None
        self.skipped: tuple[str, ...] = ()
        self.idle: list[IdleFreedom] | None = None
        self.resting = True

    def rested(self, at: ConstraintResidual) -> ConstraintResidual:
        """The residual with idle freedoms at rest from here on; they are looked for where J first allows a velocity."""
        if self.idle is not None or not len(at.null):
            return self.at(at.q) if self.idle else at
        off = lambda z: self.at(self.move(at.q, z)).residual  # noqa: E731
        self.idle = idle_freedoms(at.state, at.J, self.free, self.scale, off)
        return self.at(at.q) if self.idle else at

    def apart(self, one: Array, other: Array) -> float:
        """Distance of two poses as `poses.distance`; of idle freedoms the second is turned towards the first."""
        for _ in range(4 if self.idle else 0):
            Z = self.at(other).idle
            other = self.move(other, np.linalg.lstsq(Z, Z @ self.way(other, one), rcond=None)[0])
        return distance(self.robot, one, other)

    def start(self, q0: Array) -> ConstraintResidual:
        """The residual at q0 with the fixed joints at their values; the constraints are checked here.

        Raises:
            InputError: q0 is invalid, an object is not a constraint, or no constraint determines a position.
            DuplicateName: two constraints with the same name.
        """
        state = State(self.robot, self.inside(self.robot.check_q(q0)), t=self.t)
        rows = rows_of(state, self._given) + rows_of(state, self._limits)
        self._check(rows)
        self.constraints = (*self._given, *self._limits)
        return self._residual(state, tuple(rows))

    def at(self, q: Array) -> ConstraintResidual:
        """The residual at a configuration."""
        if self.constraints is None:
            return self.start(q)
        state = State(self.robot, q, t=self.t)
        return self._residual(state, tuple([c.rows(state) for c in self.constraints]))

    def _residual(self, state: State, rows: tuple[Rows, ...]) -> ConstraintResidual:
        parts = [position_residual(r) for r in rows if self._one_sided or type(r.cone) is not NonNegative]
        parts, none = [part for part in parts if len(part[0])], np.zeros((0, len(self.free)))
        if not parts:
            return ConstraintResidual(state, np.zeros(0), none, rows, none)
        error, J = parts[0] if len(parts) == 1 else map(np.concatenate, zip(*parts, strict=True))
        J = J[:, self.free] * self.scale
        Z = idle_directions(state, J, self.free, self.scale, self.idle) if self.idle and self.resting else none
        if len(Z):  # as a projector, whose sign does not depend on that of the directions
            error, J = np.concatenate([error, np.zeros(len(self.free))]), np.concatenate([J, np.linalg.pinv(Z) @ Z])
        return ConstraintResidual(state, error, J, rows, Z)

    def _check(self, rows: list[Rows]) -> None:
        skipped, says = [], False
        check_different([r.name for r in rows], "constraints")
        for r in rows:
            if r.cone.bounded:
                skipped.append(f"{r.name!r:.80} resists motion and gives no position")
            elif len(r) and (r.error is None or r.holonomic is not None and not r.holonomic.any()):
                skipped.append(f"{r.name!r:.80} constrains velocities alone, or has no anchor")
            elif len(r) and not (r.cone.bilateral or r.cone.one_sided):
                raise InputError(
                    f"{r.name!r:.80} can slip or break ({type(r.cone).__name__}), so it does not determine a position. "
                    "Give it friction=None to make it bilateral, or leave it out."
                )
            else:
                says = True
        self.skipped = tuple(skipped)
        if not says:
            raise InputError(
                f"no constraint determines a position of {self.robot.name}: {'; '.join(skipped) or 'none was given':.400}. "
                "Give constraints with an error, e.g. rbd.LoopClosure, a contact with an anchor, a rbd.JointLock with a "
                "position."
            )


def position_residual(rows: Rows) -> tuple[Array, Array]:
    """The position errors of the rows, and their Jacobian; nothing for rows without an error.

    For unilateral rows only violations; nothing for joint friction.
    """
    error, J = rows.error, rows.J
    if error is None or type(rows.cone) is Bounds:
        return _NO_ERROR, J
    if type(rows.cone) is NonNegative:
        beyond = error < 0.0
        return error[beyond], J[beyond]
    if rows.holonomic is not None:
        return error[rows.holonomic], J[rows.holonomic]
    return error, J


def rank_of(s: Array) -> int:
    """Number of singular values that are not zero, at `SINGULAR`."""
    return rank_at(s, SINGULAR, least=0.0)


ASIDE = 0.02
"""Step along a direction that J allows in the test for a finite motion, in units of `Closure.scale`."""


def branches_meet(closure: Closure, at: ConstraintResidual) -> bool:
    """Whether the constraints have a higher rank at poses one step away along the directions that J allows."""
    return any(there.rank > at.rank for there in around(closure, at, tolerance=1e-11, most=60))


def around(closure: Closure, at: ConstraintResidual, *, tolerance: float, most: int) -> Iterator[ConstraintResidual]:
    """Poses one step forward and back along the directions that J allows, projected onto the constraints."""
    for z in (sign * ASIDE * row for row in at.null for sign in (1.0, -1.0)):
        there = descend(closure, closure.at(closure.move(at.q, z)), tolerance=tolerance, most=most)
        if there.closed:
            yield there.at


Rates = Mapping[str, "float | Sequence[float] | Array"]


def independent_columns(J: Array, last: Array | None = None) -> list[int]:
    """Columns left after selecting the best conditioned basis one by one; those marked `last` are selected last."""
    n = J.shape[1]
    last = np.zeros(n, bool) if last is None else last
    size = float(np.linalg.norm(J, 2)) if J.size else 0.0
    # The first of those within a thousandth of the longest, so that rounding does not choose.
    basis, left = farthest_columns(J, np.flatnonzero(~last), 0.999, SINGULAR * size)
    basis += farthest_columns(left, np.flatnonzero(last), 0.999, SINGULAR * size)[0]
    return [i for i in range(n) if i not in basis]


def farthest_columns(J: Array, among: Array, tie: float, zero: float) -> tuple[list[int], Array]:
    """(columns, what is left of J across them): each next one is the farthest from those before, as in a pivoted QR.

    Args:
        J: Shape (m, n).
        among: Columns that may be selected.
        tie: Of those as long as this part of the longest, the first is selected.
        zero: Columns up to this length are zero.
    """
    chosen: list[int] = []
    while len(among):
        sizes = np.linalg.norm(J[:, among], axis=0)
        if not sizes.max() > zero:
            break
        pivot = int(among[np.flatnonzero(sizes >= tie * sizes.max())[0]])
        unit = J[:, pivot] / np.linalg.norm(J[:, pivot])
        J = J - np.outer(unit, unit @ J)
        chosen.append(pivot)
        among = among[among != pivot]
    return chosen, J


class BilateralVelocities:
    """Rows of bilateral constraints at a state, as conditions on its velocity: J v = u."""

    def __init__(self, state: State, constraints: Sequence[Constraint] | None, loops: bool) -> None:
        self.state, self.joints = checked(state), state.robot.joints
        self.given = own_or(state.robot, constraints, loops)
        found = self.rows(state if not state.v.any() else state.with_velocity(state.robot.zero_v))
        self.J, self.u, self.row_names = found.J, -found.velocity, [name for name, _ in found.names]

    def rows(self, state: State) -> StackedRows:
        """The bilateral rows.

        Raises:
            InputError: a constraint can slip or break, or is not assembled.
        """
        out = []
        for r in rows_of(state, self.given):
            if not len(r) or r.cone.bounded or r.cone.one_sided:
                continue  # joint limits and friction depend on forces
            if not r.cone.bilateral:
                raise InputError(
                    f"{r.name!r:.80} can slip or break ({type(r.cone).__name__}): forces decide whether it sticks (rbd.solve). "
                    "Give it friction=None to make it bilateral."
                )
            error, _ = position_residual(r)
            if max_abs(error) > CLOSED * max(1.0, self.joints.reach):
                raise InputError(
                    f"{state.robot.name} is not assembled: {r.name!r:.80} is off by {max_abs(error):.3g} m (or rad). "
                    "Close it first, with rbd.mechanism.assemble."
                )
            out.append(r)
        return StackedRows(state, out)

    def off(self, free: Array, dv: Array) -> float:
        """Largest position error of the bilateral rows after a displacement of some velocities [m, rad]."""
        away = np.zeros(self.state.robot.nv)
        away[free] = dv
        there = State(self.state.robot, pin.integrate(self.state.robot.model, self.state.q, away))
        return max([0.0, *(max_abs(position_residual(r)[0]) for r in rows_of(there, self.given) if r.cone.bilateral)])

    def values(self, known: Rates, what: str) -> tuple[Array, Array]:
        """(which velocities are known, their values), both (nv,)."""
        check_kind("known", known, Mapping, f"a mapping {{joint: {what}}}, e.g. {{'crank': 1.0}}")
        mask, out = np.zeros(self.state.robot.nv, bool), np.zeros(self.state.robot.nv)
        for name, value in known.items():
            at = self.joints.velocity(name)
            size = at.stop - at.start
            given = as_finite(f"known {what} of {name!r:.80}", value, (size,), *[()] * (size == 1))
            if mask[at].any():
                raise InputError(f"known {what} of {name!r:.80} is given twice: once for the joint, once for a part of it.")
            mask[at], out[at] = True, given
        return mask, out
