"""Bilateral rows stacked at one state."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import blas, lapack

from rbd.arrays import Array, inertia_factor, lazy, max_abs, zeros
from rbd.constraints.constraint import Constraint, rows_of
from rbd.model.state import State
from rbd.problem.cones import Free, Line
from rbd.problem.rows import Rows


class HeldRows:
    """The rows of constraints that hold, at one state.

    Args:
        state: Where.
        constraints: Those that hold.
        carried: Which of them are on a ground that moves, and so have no place to be.

    Attributes:
        state: Where.
        rows: Of each constraint.
        J: Shape (m, nv).
        offset: J_dot v, and feedback, shape (m,).
        velocity: J v less the velocity of what is touched, shape (m,).
        error: Position errors, shape (m,); zero in rows that have none.
        placed: Which rows have one, shape (m,), bool; None for all.
    """

    def __init__(self, state: State, constraints: Sequence[Constraint], carried: Sequence[bool]) -> None:
        self.state, self.constraints, self.carried = state, constraints, carried
        self.rows = rows = rows_of(state, constraints)
        if len(rows) == 1:
            self.J, self.offset, self.velocity = rows[0].J, rows[0].bias, velocity_of(rows[0], state)
        elif rows:
            self.J = np.concatenate([r.J for r in rows])
            self.offset = np.concatenate([r.bias for r in rows])
            self.velocity = np.concatenate([velocity_of(r, state) for r in rows])
        else:
            self.J, self.offset, self.velocity = np.zeros((0, len(state.v))), zeros(0), zeros(0)
        if any([r.stabilised for r in rows]):
            self.offset = self.offset + np.concatenate([r.feedback for r in rows])
        masks = [_placed(r, state, c) for r, c in zip(rows, carried, strict=True)]
        if all([mask is None for mask in masks]):
            self.placed = None
            self.error = np.concatenate([r.error for r in rows]) if rows else zeros(0)
        else:
            self.placed = np.concatenate([np.ones(len(r), bool) if p is None else p for r, p in zip(rows, masks, strict=True)])
            errors = np.concatenate([zeros(len(r)) if r.error is None else r.error for r in rows])
            self.error = np.where(self.placed, errors, 0.0)

    def elsewhere(self, q: Array, v: Array) -> HeldRows:
        """The same constraints at another state."""
        return HeldRows(State(self.state.robot, q, v), self.constraints, self.carried)

    @property
    def drift(self) -> float:
        """Largest position error [m, rad]."""
        return max_abs(self.error)

    @property
    def drift_rate(self) -> float:
        """Largest velocity error [m/s, rad/s]."""
        return max_abs(self.velocity)

    def name_of(self, row: int) -> str:
        """The constraint of a row of the stack."""
        ends = np.cumsum([len(r) for r in self.rows])
        return self.rows[int(np.searchsorted(ends, row, side="right"))].name

    @lazy
    def L(self) -> Array:
        """Lower factor of M."""
        return inertia_factor(self.state.M)

    @lazy
    def W(self) -> Array:
        """L^-1 J^T, shape (nv, m)."""
        return blas.dtrsm(1.0, self.L, self.J.T, lower=1)

    @lazy
    def delassus(self) -> Array:
        """W^T W, shape (m, m)."""
        return self.W.T @ self.W

    @lazy
    def cholesky(self) -> Array | None:
        """Upper R with R^T R = W^T W; None where it is not positive definite."""
        R, info = lapack.dpotrf(self.delassus, lower=0, clean=1)
        return R if info == 0 else None


def velocity_of(rows: Rows, state: State) -> Array:
    """J v less the velocity of what is touched; rows that give none get J v."""
    silent = rows.velocity is zeros(len(rows))
    return rows.J @ state.v if silent else rows.velocity


def holds(rows: Rows) -> bool:
    """Whether all forces are allowed: none is bounded, and none comes and goes (a stop that is not reached has no rows)."""
    parts = rows.cone.generators()[1]
    return all(isinstance(part, Line) for part in parts) and (len(parts) > 0 or isinstance(rows.cone, Free))


def _placed(rows: Rows, state: State, carried: bool) -> Array | None:
    """Which rows have a place to be; None for all."""
    if rows.error is None:
        return np.zeros(len(rows), bool)
    if not carried:
        return rows.holonomic
    if rows.holonomic is None:
        return np.zeros(len(rows), bool)
    surface = rows.J @ state.v - rows.velocity
    return rows.holonomic & (np.abs(surface) <= 1e-12 * max(1.0, max_abs(surface)))
