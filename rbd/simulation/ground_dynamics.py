"""Time steps on ground at rest by Pinocchio's contact dynamics, without M, J and J_dot v as arrays.

`pin.constraintDynamics` gives the acceleration a_0 that holds the contact bodies still, and the forces F_0 on them. From its
factors, for any acceleration s of the bodies,

    F = F_0 + L s,        a = a_0 + M^-1 J^T L s,        L = (J M^-1 J^T)^-1            J: of the bodies, not of their points

Points are fixed to their bodies: P^T V are their velocities, and P p is what point impulses p do to the bodies. Over a time h

    u+ = u_0 + h P^T s + ...        sticking: u+ = 0, which one s gives for all points of a body

If the corner forces of least norm for that F are in their cones, they are the answer. Else it is the velocity problem of
`rbd.simulation.velocity_problem` with D = P^T L^-1 P. What is not covered has no `GroundDynamics`, and steps the general way:
other constraints than contacts with friction on ground at rest, bodies that touch along an edge only, dependent rows.
"""

from __future__ import annotations

from collections.abc import Sequence
from weakref import WeakKeyDictionary

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, cross_matrix, cross_rows, is_finite, max_abs, rank_of, zeros
from rbd.constraints.ground_points import Grounds, OnGround
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State
from rbd.simulation.contact_points import Points, Snapshot
from rbd.simulation.ground_bodies import INDEPENDENT, Body, TurnedMap, bodies_of, rows_from, views_of
from rbd.simulation.velocity_problem import Undecided, VelocityAnswer, active_rows, point_impulses

_SETTINGS = (1e-10, 1e-10, 0.0, 1)
"""Of Pinocchio's proximal iterations: one, without regularisation, is exact where rows are independent."""
_AGREES = 1e-9
"""Tolerance of the equations of motion at the start, scaled: beyond it the model has something that is not covered."""
_TURNS = 1e-16
"""Centripetal changes of velocity in a step up to this are rounding [m/s]."""
_SPARE: WeakKeyDictionary[CheckedModel, list[pin.Data]] = WeakKeyDictionary()
"""Data that no motion uses: of a humanoid they are megabytes, and new ones take as long as fifty steps."""
_MOST_SPARE = 4


class GroundDynamics:
    """The constant data of one robot's contacts with ground at rest, for the steps of one motion.

    It has one pin.Data of its own, overwritten by every call: results do not depend on earlier calls.

    Attributes:
        layout: The points.
        at_rest: Velocities of points at rest, shape (p,): the array of every answer in which all stick.
        size: Number of the bodies' rows.
    """

    def __init__(self, points: Points, grounds: Sequence[OnGround], bodies: Sequence[Body], start: State) -> None:
        model = start.robot.model
        self._points, self._model = points, model
        self._spare = _SPARE.setdefault(start.robot, [])
        self._data = self._spare.pop() if self._spare else model.createData()
        self.layout = points.layout(tuple([s.structure for s in points.sources]))  # type: ignore[attr-defined]
        self._models, self._datas = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
        for body in bodies:
            self._models.append(body.pinocchio(model))
            self._datas.append(self._models[len(self._models) - 1].createData())
        pin.initConstraintDynamics(model, self._data, self._models, self._datas)
        self._settings, self._factors = pin.ProximalSettings(*_SETTINGS), self._data.constraint_chol
        #: Placements and velocities of all joints, views of the data: row j has R_Wj by columns and p_Wj, or (v, w) of joint j.
        self._places, self._rates, self._accelerations = views_of(self._data, model.njoints)
        self._joints = np.array([body.joint for body in bodies])
        sizes = [body.size for body in bodies]
        self.size = sum(sizes)
        firsts = np.cumsum([0, *sizes]).tolist()
        self._target = np.zeros(self.size + model.nv)
        k, n = len(self.layout.owners), len(bodies)
        axes = np.concatenate([np.tile(ground.R, (len(ground.local), 1, 1)) for ground in grounds])
        height = np.concatenate([np.full(len(ground.local), ground.height) for ground in grounds])
        spread, shares = np.zeros((k, 3, 6 * n)), np.zeros((k, 3, self.size))
        of_rows, self._height, self._gaps = np.zeros((k, 3, self.size)), height, np.zeros((k, 12 * n))
        self._row_velocity = np.zeros((self.size, 6 * n))
        self._body, self._arm, self._axes = np.zeros(k, int), np.zeros((k, 3)), axes
        self._turns = np.zeros(n, bool)
        for b, body in enumerate(bodies):
            rows, six = slice(firsts[b], firsts[b + 1]), slice(6 * b, 6 * b + 6)
            S = np.array([np.concatenate([np.eye(3), -cross_matrix(x)], axis=1) for x in body.arms])
            own = np.eye(3)[None] if body.size == 3 else S
            shares[body.points, :, rows] = np.linalg.pinv(own.reshape(-1, body.size).T).reshape(-1, 3, body.size)
            spread[body.points, :, six], of_rows[body.points, :, rows] = S, own
            self._row_velocity[rows, six] = S[0] if body.size == 3 else np.eye(6)
            self._body[body.points], self._arm[body.points] = b, body.arms
            self._turns[b] = body.size == 6
            normals = axes[body.points, :, 2]
            self._gaps[body.points, 12 * b : 12 * b + 9] = (body.arms[:, :, None] * normals[:, None]).reshape(-1, 9)
            self._gaps[body.points, 12 * b + 9 : 12 * b + 12] = normals
        self._velocity = TurnedMap(axes, self._body, spread)
        self._forces = TurnedMap(axes, self._body, shares)
        self._of_rows = of_rows
        self._mu = self.layout.mu
        self.at_rest = zeros(3 * k)
        held = [data for body, data in zip(bodies, self._datas, strict=True) if body.size == 6]
        #: Velocities (v, w) of the bodies that touch at patches: a view of Pinocchio's.
        self._patches = rows_from([(x.contact1_velocity.linear, x.contact1_velocity.angular) for x in held], 6)
        self._joint_forces = pin.StdVec_Force()
        for _ in range(model.njoints):
            self._joint_forces.append(pin.Force.Zero())
        self._pushed_joints = [self._joint_forces[body.joint] for body in bodies]

    def __del__(self) -> None:
        if len(self._spare) < _MOST_SPARE:
            self._spare.append(self._data)

    @classmethod
    def of(cls, points: Points, start: State) -> GroundDynamics | None:
        """The prepared form of a motion's contacts, or None where they, or the robot, are not covered."""
        robot, grounds = start.robot, list[OnGround]()
        for source in points.sources:
            if not isinstance(source, OnGround | Grounds):
                return None
            grounds += source.members
        if not grounds or not robot.sound or any(g.surface is not None or not g.contact.friction for g in grounds):
            return None
        bodies = bodies_of(grounds, start)
        if any(body.size not in (3, 6) for body in bodies):
            return None
        found = cls(points, grounds, bodies, start)
        return found if found._agrees(start) else None

    def at(self, state: State, t: float) -> Snapshot:
        """All points at a state: gaps and velocities; the rest is computed the general way, if asked for."""
        pin.forwardKinematics(self._model, self._data, state.q, state.v)
        X, V = self._places.take(self._joints, axis=0).ravel(), self._rates.take(self._joints, axis=0).ravel()
        gap = self._gaps.dot(X) - self._height
        return Snapshot(
            state, self.layout, self._velocity(X, V), gap, self.at_rest,
            lambda: [source.at(state, t) for source in self._points.sources],
        )  # fmt: skip

    def answer(
        self,
        q: Array,
        v: Array,
        applied: Array,
        start: Array,
        h: float,
        active: Array,
        guess: Array,
        *,
        law: str,
        shift: Array | None,
        u: Array | None = None,
        mean: Array | None = None,
    ) -> VelocityAnswer | None:
        """Velocity start + h a and impulses of a step of length h; None where the general way is to answer.

        Args:
            q: Configuration at which forces are computed, shape (nq,).
            v: Velocity at which they are, shape (nv,).
            applied: S^T tau + tau_ext, shape (nv,).
            start: Velocity to which h a is added, shape (nv,).
            h: Length of the step [s].
            active: Which points are active, shape (k,).
            guess: Impulses to start from, shape (p,).
            law: "coulomb" or "convex".
            shift: Added to u+ only in the contact law, shape (p,).
            u: The points' velocities at the step's beginning, for u+ = u + h (J a + J_dot v).
            mean: Velocity w for u+ = J w + h J a + h/2 J_dot v, in place of u.
        """
        everything = active is self.layout.everything
        if not everything and not active.any():
            return self._free(q, v, applied, start, h)
        a = pin.constraintDynamics(self._model, self._data, q, v, applied, self._models, self._datas, self._settings)
        if not is_finite(a):
            return None
        X, F, W = self._places.take(self._joints, axis=0).ravel(), self._data.lambda_c, self.at_rest
        if mean is not None:
            pin.forwardKinematics(self._model, self._data, q, mean + (0.5 * h) * a)
            W = self._rates.take(self._joints, axis=0).ravel()
        if shift is None and (mean is not None or u is self.at_rest) and self._straight(h) and (everything or active.all()):
            if mean is not None:
                self._target[: self.size] = self._row_velocity.dot(W) * (-1.0 / h)
                change = self._factors.solve(self._target)
                F, near = F - change[: self.size], a + change[self.size :]
            else:
                near = a
            f = self._forces(X, F)
            if self._inside(f):
                return VelocityAnswer(start + h * near, h * f, self.at_rest, 0.0, True)
        return self._by_points(q, v, X, W, a, start, h, active, guess, law, shift, u)

    def _by_points(
        self,
        q: Array,
        v: Array,
        X: Array,
        W: Array,
        a: Array,
        start: Array,
        h: float,
        active: Array,
        guess: Array,
        law: str,
        shift: Array | None,
        u: Array | None,
    ) -> VelocityAnswer | None:
        """The velocity problem of the active points, from the factors of the bodies."""
        P = self._points_of_rows(X)
        F, L = self._data.lambda_c, self._factors.getInverseOperationalSpaceInertiaMatrix()
        before, part = (P @ self._row_velocity.dot(W), 0.5) if u is None else (u, 1.0)
        pin.forwardKinematics(self._model, self._data, q, v)  # `pin.constraintDynamics` does not write the joints' velocities
        V, P_L = self._rates.take(self._joints, axis=0).ravel(), P @ L
        free = before - h * (P_L @ F) + (part * h) * self._centripetal(X, V)
        rows = active_rows(self.layout, active, h)
        index, D = rows.index, P_L @ P.T
        try:
            own = D[index][:, index]
            f, merit, least = point_impulses(
                rows, own, free[index], guess[index], None if shift is None else shift[index], h, law
            )
        except Undecided:
            return None
        impulse = np.zeros(len(free))
        impulse[index] = f
        self._target[: self.size] = L @ (P.T @ impulse / h - F)
        change = self._factors.solve(self._target)
        return VelocityAnswer(start + h * (a + change[self.size :]), impulse, D @ impulse + free, merit, least)

    def _free(self, q: Array, v: Array, applied: Array, start: Array, h: float) -> VelocityAnswer | None:
        """The step without any contact; the points' velocities are J v, of the velocity after it."""
        end = start + h * pin.aba(self._model, self._data, q, v, applied)
        if not is_finite(end):
            return None
        pin.forwardKinematics(self._model, self._data, q, end)
        X, V = self._places.take(self._joints, axis=0).ravel(), self._rates.take(self._joints, axis=0).ravel()
        return VelocityAnswer(end, np.zeros(len(self.at_rest)), self._velocity(X, V), 0.0, True)

    def residual(self, q: Array, v: Array, applied: Array, a: Array, u: Array, h: float, answer: VelocityAnswer) -> float:
        """Residual of a half step by another route than its answer's: inverse dynamics and the bodies' accelerations, scaled.

        Args:
            q: Configuration, shape (nq,).
            v: Velocity, shape (nv,).
            applied: S^T tau + tau_ext, shape (nv,).
            a: Acceleration of the answer, shape (nv,).
            u: The points' velocities at the step's beginning, shape (p,).
            h: Length of the half step [s].
            answer: The answer.
        """
        model, data, forces = self._model, self._data, self._joint_forces
        pin.forwardKinematics(model, data, q, v, a)
        X, V, A = (x.take(self._joints, axis=0).ravel() for x in (self._places, self._rates, self._accelerations))
        f = answer.impulse.reshape(-1, 3) / h
        pushed = np.matvec(self._rotations(X).swapaxes(1, 2)[self._body], np.matvec(self._axes, f))
        wrenches = np.zeros((len(self._joints), 6))
        np.add.at(wrenches, self._body, np.concatenate([pushed, cross_rows(self._arm, pushed)], axis=1))
        for slot, wrench in zip(self._pushed_joints, wrenches, strict=True):
            slot.vector = wrench
        unbalanced = pin.rnea(model, data, q, v, a, forces) - applied
        moved = (self._velocity(X, A) + self._centripetal(X, V, rows=False)) * h + u - answer.velocity
        moved[~np.repeat(answer.impulse.reshape(-1, 3).any(axis=1), 3)] = 0.0
        x, y, n = f.T
        outside = float((np.hypot(x, y) - self._mu * n).max(initial=0.0)) / max(1.0, max_abs(answer.impulse) / h)
        size = max(1.0, max_abs(applied), max_abs(answer.impulse) / h)
        return max(max_abs(unbalanced) / size, max_abs(moved) / (h * max(1.0, max_abs(a))), outside)

    def _straight(self, h: float) -> bool:
        """Whether bodies that touch at patches turn so slowly that their points' centripetal accelerations are rounding."""
        return bool(np.vdot(self._patches, self._patches) * h <= _TURNS)

    def _inside(self, f: Array) -> bool:
        """Whether forces of points are in their cones; false where a force pulls."""
        x, y, n = f.reshape(-1, 3).T
        return bool((np.hypot(x, y) <= self._mu * n).all())

    def _rotations(self, X: Array) -> Array:
        """R_WJ of the bodies' joints, shape (n, 3, 3)."""
        return X.reshape(-1, 12)[:, :9].reshape(-1, 3, 3).swapaxes(1, 2)

    def _points_of_rows(self, X: Array) -> Array:
        """Velocities of the points for unit velocities of the bodies' rows, shape (p, rows)."""
        Q = self._axes.swapaxes(1, 2) @ self._rotations(X)[self._body]
        return (Q @ self._of_rows).reshape(len(self.at_rest), self.size)

    def _centripetal(self, X: Array, V: Array, rows: bool = True) -> Array:
        """Classical accelerations of the points less those by spatial ones of their bodies, w x (v + w x r), shape (p,).

        Args:
            X: Placements of the bodies' joints.
            V: Their velocities.
            rows: By the bodies' rows, of which those of a single point are classical already.
        """
        motion = V.reshape(-1, 6)[self._body]
        if rows:
            motion = motion * self._turns[self._body, None]
        w = motion[:, 3:]
        acceleration = cross_rows(w, motion[:, :3] + cross_rows(w, self._arm))
        return np.matvec(self._axes.swapaxes(1, 2) @ self._rotations(X)[self._body], acceleration).ravel()

    def _agrees(self, start: State) -> bool:
        """Whether it has the same equations of motion as the robot's M and h at the start, and rows of full rank."""
        rng = np.random.default_rng(0)
        q, v, applied = start.q, rng.normal(size=start.robot.nv), rng.normal(size=start.robot.nv)
        data = self._data
        a = pin.constraintDynamics(self._model, data, q, v, applied, self._models, self._datas, self._settings)
        if not is_finite(a):
            return False
        L = self._factors.getInverseOperationalSpaceInertiaMatrix()
        size = np.sqrt(L.diagonal())
        if not (size > 0.0).all() or rank_of(L / size / size[:, None], INDEPENDENT**2) < self.size:
            return False
        P = self._points_of_rows(self._places.take(self._joints, axis=0).ravel())
        moving = State(start.robot, q, v)
        snapshot = self.at(moving, 0.0)
        rows = np.linalg.lstsq(P, snapshot.J, rcond=None)[0]
        off = moving.M @ a + moving.h - applied - rows.T @ data.lambda_c
        size = max(1.0, max_abs(moving.h), max_abs(data.lambda_c))
        return max_abs(off) <= _AGREES * size and max_abs((P @ rows - snapshot.J).ravel()) <= _AGREES
