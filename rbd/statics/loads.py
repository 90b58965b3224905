"""`Loads`: what contact forces must balance, in rows with motors and without, scaled to the order of one.

M a + h - tau_ext = S^T tau + J^T G w      the equations of motion, for a wanted motion (at rest: a = 0, v = 0)
A x = b                                    its rows without a motor: bases and passive joints; x = w / unit
tau / limit = t - T x                      its rows with one; limits are those at rest, and `bounds` those at this speed
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array, lazy
from rbd.constraints.constraint import Constraint, rows_of
from rbd.constraints.distance_warnings import warn_of_distant, warn_of_limits
from rbd.errors import NotAtRest
from rbd.errors.inputs import check_different
from rbd.model.joints import Joint
from rbd.model.state import State
from rbd.problem.force_set import ForceSet
from rbd.problem.rows import Rows

_BEYOND = 1e-9
"""A torque beyond its limit by less, over the limit, is there by rounding."""

AT_REST = 1e-9
"""Largest |v| of a robot at rest."""


def contact_rows(state: State, contacts: Sequence[Constraint], *, stacklevel: int | None = 3) -> tuple[Rows, ...]:
    """Rows of constraints, each with its own name; warnings name contacts off their planes, and joints beyond their limits.

    Args:
        state: The robot.
        contacts: The constraints.
        stacklevel: Of the warnings: 2 for the line that called this; None for none.

    Raises:
        DuplicateName: two of one name.
    """
    rows = tuple(rows_of(state, contacts))
    check_different([r.name for r in rows], "contacts")
    if stacklevel is not None:
        warn_of_limits(state, contacts, stacklevel=stacklevel + 1)
        if not all([r.touches for r in rows]):
            warn_of_distant(state.robot, rows, stacklevel=stacklevel + 1)
    return rows


def refuse_motion(state: State, rows: Sequence[Rows] = ()) -> None:
    """Refuse a robot that moves, and contacts with a ground that does.

    Raises:
        NotAtRest: if `|v|` exceeds 1e-9, or what a contact touches moves.
    """
    if (speed := float(np.abs(state.v).max(initial=0.0))) > AT_REST:
        raise NotAtRest(f"statics wants a robot at rest, and |v| reaches {speed:.3g}. Use State(robot, q) with v = 0.")
    for r in rows:  # at v = 0, J_dot v of a ground at rest is zero
        if r.speed > AT_REST or np.abs(r.bias).max(initial=0.0) > AT_REST:
            raise NotAtRest(f"statics wants a ground at rest, and what {r.name!r} touches moves. Use rbd.solve.")


@dataclass(frozen=True, eq=False)
class Loads:
    """The equations of motion of a wanted motion, with the sets of the forces that it allows.

    Attributes:
        state: The robot at (q, v).
        rows: The rows of the contacts and other constraints.
        sets: The forces that may act, as weights on p columns: f = G w.
        need: M a + h - tau_ext, shape (nv,) [N, N m]: what torques and forces must come to.
        stacked: (J, bias and feedback) of the rows, where they are known already.
        terms: Size of what adds up to `need`, shape (nv,) [N, N m]: where it cancels, what is left is rounding of it.
    """

    state: State
    rows: Sequence[Rows]
    sets: ForceSet
    need: Array
    stacked: tuple[Array, Array] | None = None
    terms: Array | None = None

    @lazy
    def unit(self) -> float:
        """The body weight [N]; 1 without gravity."""
        return self.state.robot.force_unit

    @lazy
    def J(self) -> Array:
        """Stacked Jacobian, shape (m, nv)."""
        if self.stacked is not None:
            return self.stacked[0]
        return np.concatenate([r.J for r in self.rows]) if self.rows else np.zeros((0, self.state.robot.nv))

    def accelerations(self, a: Array) -> Array:
        """Of the rows, J a + bias + feedback, shape (m,) [m/s2, rad/s2]."""
        if self.stacked is not None:
            return np.asarray(self.stacked[0] @ a + self.stacked[1])
        return np.concatenate([np.zeros(0), *[r.J @ a + r.bias + r.feedback for r in self.rows]])

    @lazy
    def per_weight(self) -> Array:
        """Generalised forces of unit weights, J^T G, shape (nv, p)."""
        return np.asarray(self.J.T @ self.sets.G)

    @lazy
    def limit(self) -> Array:
        """Effort limits at rest, shape (nu,); without a stated one the body weight times one metre."""
        limit = self.state.robot.effort_limit
        return np.where(np.isfinite(limit), limit, self.unit)

    @lazy
    def limited(self) -> Array:
        """Which motors have a stated limit, shape (nu,), of truth values."""
        return np.isfinite(self.state.robot.effort_limit)

    @lazy
    def bounds(self) -> tuple[Array, Array]:
        """(least, most) torques over `limit`, shapes (nu,): -1 and 1 but where a torque-speed line leaves less."""
        least, most = self.state.robot.limits_at(self.state.v)
        return least / self.limit, most / self.limit

    @lazy
    def idle_joints(self) -> list[tuple[Joint, list[int]]]:
        """(joint, its indices in v that no motor drives), of bases and passive joints."""
        still = set(self.state.robot.unactuated.tolist())
        found = [
            (joint, sorted(still.intersection(range(joint.v.start, joint.v.stop))))
            for joint in self.state.robot.joints.values()
        ]
        return [(joint, where) for joint, where in found if where]

    @lazy
    def row_size(self) -> Array:
        """What the rows without motors are divided by, shape (e,): a passive finger is balanced as well as a base.

        The largest of its terms, at least what moves it at 1 m/s2 (rad/s2), or 1 N, over the unit.
        """
        still = self.state.robot.idle
        need = np.abs(self.need if self.terms is None else self.terms)[still]
        top = np.maximum(np.abs(self.per_weight[still]).max(axis=1, initial=0.0), need / self.unit)
        return np.maximum(top, np.minimum(self.state.M.diagonal()[still], 1.0) / self.unit)

    @lazy
    def A(self) -> Array:
        """Rows without motors, of weights over the unit, shape (e, p)."""
        return self.per_weight[self.state.robot.idle] / self.row_size[:, None]

    @lazy
    def b(self) -> Array:
        """What they must come to, shape (e,)."""
        return self.need[self.state.robot.idle] / (self.row_size * self.unit)

    @lazy
    def T(self) -> Array:
        """Torques over their limits that a unit of each weight carries, shape (nu, p)."""
        return self.per_weight[self.state.robot.motors] * (self.unit / self.limit)[:, None]

    @lazy
    def t(self) -> Array:
        """Torques over their limits without contact forces, shape (nu,)."""
        return self.need[self.state.robot.motors] / self.limit

    @lazy
    def lower(self) -> Array:
        """Lower bounds of weights over the unit, shape (p,)."""
        return self.sets.lower / self.unit

    @lazy
    def upper(self) -> Array:
        """Upper bounds, likewise."""
        return self.sets.upper / self.unit

    def torques(self, w: Array) -> tuple[Array, Array]:
        """(tau, left): motor torques beside the weights w [N], and what is left where no motor is, shapes (nu,) and (e,).

        A torque that is beyond its limit by rounding is put onto it.
        """
        robot = self.state.robot
        load = self.need - self.per_weight @ w
        tau, (least, most) = load[robot.actuated], self.bounds
        inside = np.minimum(np.maximum(tau, least * self.limit), most * self.limit)
        over = tau != inside
        if over.any():
            over &= np.abs(tau - inside) <= _BEYOND * self.limit
            tau[over] = inside[over]
        return tau, load[robot.unactuated]
