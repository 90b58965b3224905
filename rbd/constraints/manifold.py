"""The manifold of bilateral constraints: their rows stacked and scaled, rank, null space, and projection onto them.

Ranks and singular values are dimensionless. A velocity is v = D z, with D the robot's length for translational coordinates and
one for rotational ones; a row is divided by its largest norm near the start. So they do not depend on the unit of
length.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, blas, inertia_factor, lapack, lazy, max_abs, zeros
from rbd.constraints.constraint import Constraint, anchored, is_carried, is_timed, rows_of, with_loops
from rbd.constraints.descent import Residual, Space, descend
from rbd.constraints.loop import LoopRows, rows_function
from rbd.errors import InputError
from rbd.errors.inputs import check_different
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State, checked
from rbd.problem.cones import LINE, Free
from rbd.problem.rows import Rows

RANK = 1e-8
"""A singular value counts as zero at this fraction of the largest one (or of one, if all are small)."""

CLOSED = 1e-9
"""Largest constraint violation [m, rad, over the rows' lengths] of an assembled configuration."""

ZERO = 1e-9
"""Singular values below this fraction of the largest count as zero."""

ITERATIONS = 100

RowName = tuple[str, int]
"""(constraint, its row, from 0)."""


class StackedRows:
    """Stacked rows of several constraints at one state.

    Args:
        state: The state.
        rows: Rows of each constraint.
        carried: Which constraints are on moving ground, and so have no fixed position; none if not given.
        manifold: The manifold that they belong to, for `elsewhere`.

    Attributes:
        state: The state.
        rows: Rows of each constraint.
        J: Shape (m, nv).
        offset: J_dot v, and feedback, shape (m,).
        velocity: J v less the surface's velocity, shape (m,).
        error: Position errors, shape (m,); zero in rows that have none.
        placed: Which rows have one, shape (m,), bool; None for all.
    """

    def __init__(
        self,
        state: State,
        rows: Sequence[Rows],
        carried: Sequence[bool] | None = None,
        manifold: ConstraintManifold | None = None,
    ) -> None:
        self.state, self.rows, self._manifold = state, rows, manifold
        if isinstance(rows, LoopRows):
            self.J, self.offset, self.velocity, self.error, self.placed = rows.J, rows.bias, rows.velocity, rows.error, None
            return
        self.J = np.concatenate([np.zeros((0, len(state.v))), *[r.J for r in rows]])
        self.offset = self.bias
        self.velocity = np.concatenate([zeros(0), *[velocity_of(r, state) for r in rows]])
        if any([r.stabilised for r in rows]):
            self.offset = self.offset + np.concatenate([r.feedback for r in rows])
        masks = [_placed(r, state, c) for r, c in zip(rows, carried or [False] * len(rows), strict=True)]
        parts = [np.ones(len(r), bool) if p is None else p for r, p in zip(rows, masks, strict=True)]
        self.placed = None if all([mask is None for mask in masks]) else np.concatenate(parts)
        errors = np.concatenate([zeros(0), *[zeros(len(r)) if r.error is None else r.error for r in rows]])
        self.error = errors if self.placed is None else np.where(self.placed, errors, 0.0)

    def elsewhere(self, q: Array, v: Array) -> StackedRows:
        """The same constraints at another state."""
        assert self._manifold is not None
        return self._manifold.rows(State(self.state.robot, q, v, t=self.state.t))

    @property
    def drift(self) -> float:
        """Largest position error [m, rad]."""
        return max_abs(self.error)

    @property
    def drift_rate(self) -> float:
        """Largest velocity error [m/s, rad/s]."""
        return max_abs(self.velocity)

    @property
    def names(self) -> list[RowName]:
        """(constraint, row) of each row."""
        return [(r.name, i) for r in self.rows for i in range(len(r))]

    def name_of(self, row: int) -> str:
        """The constraint of a row of the stack."""
        return self.names[row][0]

    @property
    def bias(self) -> Array:
        """J_dot v without feedback, shape (m,)."""
        return np.concatenate([zeros(0), *(r.bias for r in self.rows)])

    @lazy
    def L(self) -> Array:
        """Lower Cholesky factor of M."""
        return inertia_factor(self.state.M)

    @lazy
    def W(self) -> Array:
        """L^-1 J^T, shape (nv, m)."""
        return blas.dtrsm(1.0, self.L, self.J.T, lower=1)

    @lazy
    def inverse(self) -> Array:
        """The pseudo-inverse of W, shape (m, nv)."""
        U, s, Vt = np.linalg.svd(self.W, full_matrices=False)
        kept = s > ZERO * s[:1]
        return np.asarray((Vt[kept].T / s[kept]) @ U[:, kept].T)

    @lazy
    def delassus(self) -> Array:
        """W^T W, shape (m, m)."""
        return self.W.T @ self.W

    @lazy
    def cholesky(self) -> Array | None:
        """Upper R with R^T R = W^T W; None where it is not positive definite."""
        R, info = lapack.dpotrf(self.delassus, lower=0, clean=1)
        return R if info == 0 else None


@dataclass(frozen=True, eq=False)
class LinearisedRows(Residual):
    """The constraints at one configuration, dimensionless.

    Attributes:
        error: Position errors of the rows that have one.
        J: Jacobian of these with respect to z, shape (k, nv).
        A: That of all rows, of those that constrain velocity alone too, shape (m, nv).
    """

    A: Array


class ConstraintManifold(Space[LinearisedRows]):
    """Bilateral constraints on a robot: the configurations that satisfy them, and the velocities that they allow.

    Args:
        state: Contacts without an anchor are anchored here, and rows are scaled about it; its velocity is not used.
        constraints: Bilateral constraints; None for the wheels of the robot's file.
        loops: Whether the robot's own loops hold; one that is given counts once.
        driven: Whether some may follow motions of time: what J allows at the state's time is looked at.
        tolerance: Largest constraint violation [m, rad, over the rows' norms]; above `CLOSED` for files
            whose lengths are rounded, where singular values count as zero below ten times that.

    Attributes:
        constraints: Those that have rows.
        driven: Names of those that follow motions of time.
        q: The configuration of the state.
        n: Number of velocities; their units `scale` are D.
        zero: Singular values count as zero at this fraction of the largest.

    Raises:
        InputError: no constraint, a unilateral or frictional one, or one with prescribed motion.
        DuplicateName: two with the same name.
    """

    def __init__(
        self,
        state: State,
        constraints: Sequence[Constraint] | None = None,
        *,
        tolerance: float = CLOSED,
        loops: bool = True,
        driven: bool = False,
    ) -> None:
        at_rest = checked(state).with_velocity(state.robot.zero_v)
        given = own_or(state.robot, constraints, loops)
        rows = rows_of(at_rest, given)
        kept = [anchored(c, r, at_rest) if is_bilateral(r) else c for c, r in zip(given, rows, strict=True) if len(r)]
        self._set(at_rest, kept, tolerance)
        _check(self._start.rows, self.driven if driven else ())

    longest = 0.5

    @classmethod
    def unchecked(
        cls, state: State, constraints: Sequence[Constraint], carried: Sequence[bool] | None = None
    ) -> ConstraintManifold:
        """The manifold of given constraints without checks, for the steps of a simulation.

        Args:
            state: A state of the robot.
            constraints: The constraints, in order; some may be inactive.
            carried: Which of them are on moving ground.
        """
        out = cls.__new__(cls)
        out._set(state, constraints, CLOSED, carried)
        return out

    @classmethod
    def about(cls, state: State, constraints: Sequence[Constraint]) -> ConstraintManifold:
        """The manifold of constraints of any kind, without checks; those without a position are anchored at the state's."""
        at_rest = state.with_velocity(state.robot.zero_v)
        put = [anchored(c, r, at_rest) for c, r in zip(constraints, rows_of(at_rest, constraints), strict=True)]
        return cls.unchecked(at_rest, put, [is_carried(c) for c in put])

    def _set(
        self, state: State, constraints: Sequence[Constraint], tolerance: float, carried: Sequence[bool] | None = None
    ) -> None:
        super().__init__(state.robot)
        self.q, self.constraints, self._carried = state.q, tuple(constraints), carried
        self.driven = tuple([c.name for c in self.constraints if is_timed(c)])
        self.tolerance, self.zero = tolerance, max(RANK, 10.0 * tolerance)
        self.cut = 1e-12 if tolerance <= CLOSED else self.zero
        self._state, self.n = state, state.robot.nv
        self._rows = rows_function(state.robot, self.constraints)

    def rows(self, state: State) -> StackedRows:
        """The rows at a state, in their units."""
        return StackedRows(state, self._rows(state), self._carried, self)

    @lazy
    def _start(self) -> StackedRows:
        return self.rows(self._state)

    @lazy
    def _sizes(self) -> list[int]:
        return [len(r) for r in self._start.rows]

    @lazy
    def names(self) -> tuple[RowName, ...]:
        """(constraint, row) of each row."""
        return tuple(self._start.names)

    @lazy
    def placed(self) -> Array:
        """Which rows have a position error, shape (m,), bool."""
        placed = self._start.placed
        return np.ones(self.m, bool) if placed is None else placed

    @property
    def m(self) -> int:
        """Number of rows."""
        return len(self._start.J)

    @lazy
    def weights(self) -> Array:
        """Row scales, shape (m,): one over the largest norm here and at three configurations nearby."""
        norms = np.linalg.norm(self._start.J * self.scale, axis=1)
        for q in poses_nearby(self.robot, self.q, self.scale):
            try:
                there = self._scaled(q, np.ones(self.m))
            except InputError:  # a constraint may be undefined there
                continue
            norms = np.maximum(norms, np.linalg.norm(there.A, axis=1))
        most = float(norms.max(initial=0.0))
        # A row of rounding errors gets scale one: normalised it would count.
        return 1.0 / np.maximum(norms, 1e-6 * most) if most > 0.0 else np.ones(self.m)

    def at(self, q: Array) -> LinearisedRows:
        """J and errors at a configuration, dimensionless.

        Raises:
            InputError: if the number of rows has changed, e.g. at a joint limit.
        """
        return self._scaled(q, self.weights)

    def _scaled(self, q: Array, weights: Array) -> LinearisedRows:
        found = self.rows(State(self.robot, q, t=self._state.t))
        if [len(r) for r in found.rows] != self._sizes:
            raise InputError(f"constraints of {self.robot.name} change their rows near the state (there {self._sizes}).")
        A, here = (found.J * self.scale) * weights[:, None], self.placed
        return LinearisedRows(found.state, (found.error * weights)[here], A[here], A)

    def rank(self, J: Array, zero: float | None = None) -> int:
        """Rank of a dimensionless Jacobian; singular values count as zero at a fraction of the largest."""
        return self.n - null_space(J, self.zero if zero is None else zero)[0].shape[1]

    def project(self, q: Array) -> LinearisedRows:
        """The point nearest to the constraints that Levenberg-Marquardt steps reach; check its `error`."""
        return descend(self, self.at(q), tolerance=1e-14, most=ITERATIONS).at

    def check_assembled(self) -> LinearisedRows:
        """The constraints at the state.

        Raises:
            InputError: if it violates the constraints, with the worst row and its error.
        """
        at = self.at(self.q)
        if max_abs(at.error) > self.tolerance:
            worst = int(np.flatnonzero(self.placed)[np.argmax(np.abs(at.error))])
            name, row = self.names[worst]
            off = max_abs(at.error) / float(self.weights[worst])
            raise InputError(
                f"{self.robot.name} is not assembled: row {row} of {name!r:.80} is off by {off:.3g} (m or rad). "
                "Close it first, with rbd.mechanism.assemble."
            )
        return at


def own_or(robot: CheckedModel, constraints: Sequence[Constraint] | None, loops: bool = True) -> tuple[Constraint, ...]:
    """The constraints given and the robot's own loops, if these hold; if None, its wheels and loops.

    Raises:
        InputError: if it is not a list.
    """
    return with_loops(robot, robot.wheels() if constraints is None else constraints, loops)


def null_space(J: Array, zero: float = RANK) -> tuple[Array, Array]:
    """(orthonormal basis of the null space, shape (n, d); all singular values, shape (min(m, n),))."""
    if not len(J):
        return np.eye(J.shape[1]), np.zeros(0)
    _, s, Vt = np.linalg.svd(J)
    return Vt[rank_of(s, zero) :].T, s


def rank_of(singular_values: Array, zero: float = RANK, *, least: float = 1.0) -> int:
    """Number of singular values above a fraction of the largest, or of `least` if all are smaller."""
    return int((singular_values > zero * max(least, float(singular_values.max(initial=0.0)))).sum())


def poses_nearby(robot: CheckedModel, q: Array, scale: Array | float = 1.0) -> Iterator[Array]:
    """Three configurations half a radian away, the same each time: a row's size at one pose is not representative.

    Args:
        robot: The robot.
        q: The configuration.
        scale: Unit of each velocity, shape (nv,).
    """
    rng = np.random.default_rng(0)
    for _ in range(3):
        z = rng.normal(size=robot.nv)
        yield pin.normalize(robot.model, pin.integrate(robot.model, q, scale * (0.5 * z / np.linalg.norm(z))))


def is_bilateral(rows: Rows) -> bool:
    """Whether the rows are bilateral: no force is bounded, and no row disappears (as a joint limit's does)."""
    parts = rows.cone.generators()[1]
    return all(part == LINE for part in parts) and (len(parts) > 0 or isinstance(rows.cone, Free))


def velocity_of(rows: Rows, state: State) -> Array:
    """J v less the surface's velocity; J v for rows without a velocity."""
    silent = rows.velocity is zeros(len(rows))
    return rows.J @ state.v if silent else rows.velocity


def _placed(rows: Rows, state: State, carried: bool) -> Array | None:
    """Which rows have a position error; None for all."""
    if rows.error is None:
        return np.zeros(len(rows), bool)
    if not carried:
        return rows.holonomic
    if rows.holonomic is None:
        return np.zeros(len(rows), bool)
    surface = rows.J @ state.v - rows.velocity
    return rows.holonomic & (np.abs(surface) <= 1e-12 * max(1.0, max_abs(surface)))


def _check(rows: Sequence[Rows], driven: Sequence[str]) -> None:
    check_different([r.name for r in rows], "constraints")
    for r in rows:
        if not is_bilateral(r):
            raise InputError(
                f"{r.name!r:.80} can break or slip (its forces are in a {type(r.cone).__name__}); mobility is that of "
                "bilateral constraints. Leave it out, or give it friction=None."
            )
        if r.name not in driven and max_abs(r.velocity) > 1e-12:
            raise InputError(f"{r.name!r:.80} has prescribed motion; expected constraints at rest. Leave it out.")
