"""Time steps on ground at rest by Pinocchio's contact dynamics, without M, J and J_dot v of the whole robot.

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

import math
from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from rbd.answers.prepared.contact_bodies import Workspace
from rbd.answers.prepared.sites import MOST_BODIES, Site, keep
from rbd.arrays import Array, cross_matrix, cross_rows, each_times, is_finite, lazy, max_abs, rank_of, rows_from, zeros
from rbd.constraints.ground_points import Grounds, OnGround
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State
from rbd.simulation.bases import step_kernel
from rbd.simulation.stacked_points import PointPlaces, Points, Snapshot
from rbd.simulation.velocity_problem import Undecided, VelocityAnswer, active_rows, point_impulses

INDEPENDENT = 1e-6
"""Singular values below this, over the largest, are those of points on a line, or of dependent rows."""


class TouchingBody:
    """The points of one joint's body.

    Args:
        joint: The joint's number.
        points: Their indices.
        arms: Where they are in the joint's axes, shape (k, 3) [m].

    Attributes:
        size: Rows that hold it still: 3 of a single point, 6 of several that are not on a line; 0 of others.
    """

    def __init__(self, joint: int, points: Sequence[int], arms: Array) -> None:
        self.joint, self.points, self.arms = joint, np.array(points), arms
        spread = np.concatenate([np.concatenate([np.eye(3), -cross_matrix(x)], axis=1) for x in arms])
        self.size = 3 if len(arms) == 1 else 6 if rank_of(spread, INDEPENDENT) == 6 else 0

    @property
    def site(self) -> Site:
        """What holds it still, in the joint's axes."""
        return Site(self.joint, pin.SE3(np.eye(3), self.arms[0] if self.size == 3 else np.zeros(3)), self.size, turns=True)


class TouchingBodies:
    """The bodies of contacts with ground at rest: what of them does not change with where the ground is.

    Args:
        robot: The robot.
        grounds: The contacts.

    Attributes:
        bodies: In the order of their joints.
        covered: Whether each can be held still, by `TouchingBody.size` rows.
        joints: Their joints, shape (n,).
        size: Number of all their rows.
        of: The body of each point, shape (k,).
        arms: Where each point is in its joint's axes, shape (k, 3) [m].
        centred: The same from its contact's centre.
        patches: Which bodies have six rows, shape (n,).
        spread: Velocities of the points, in joint axes, by the bodies' (v, w), shape (k, 3, 6n).
        of_rows: The same by velocities of the rows, shape (k, 3, rows).
        shares: Forces of least norm at the points for forces on the rows, shape (k, 3, rows).
        row_velocity: Velocities of the rows by the bodies' (v, w), shape (rows, 6n).
        agrees: Whether the equations of motion were found to be those of M and h; None before they were compared.
        spare: Workspaces that no motion uses.
    """

    def __init__(self, robot: CheckedModel, grounds: Sequence[OnGround]) -> None:
        points: dict[int, list[tuple[int, Array]]] = {}
        k = 0
        for ground in grounds:
            joint, X_JF = robot.site(ground.contact.frame)
            for x in ground.local:
                points.setdefault(joint, []).append((k, (X_JF * ground.X_FP).act(x)))
                k += 1
        self.bodies = [TouchingBody(j, [i for i, _ in of], np.array([x for _, x in of])) for j, of in sorted(points.items())]
        self.covered = all([body.size and body.joint for body in self.bodies])
        self.joints = np.array([body.joint for body in self.bodies])
        n, ends = len(self.bodies), np.cumsum([body.size for body in self.bodies]).tolist()
        self.size = ends[-1]
        self.of, self.arms, self.patches = np.zeros(k, int), np.zeros((k, 3)), np.array([b.size == 6 for b in self.bodies])
        self.spread, self.row_velocity = np.zeros((k, 3, 6 * n)), np.zeros((self.size, 6 * n))
        self.of_rows, self.shares = np.zeros((k, 3, self.size)), np.zeros((k, 3, self.size))
        for b, body in enumerate(self.bodies):
            rows, six = slice(ends[b] - body.size, ends[b]), slice(6 * b, 6 * b + 6)
            S = np.array([np.concatenate([np.eye(3), -cross_matrix(x)], axis=1) for x in body.arms])
            self.of[body.points], self.arms[body.points] = b, body.arms
            self.spread[body.points, :, six] = S
            if body.size:
                own = np.eye(3)[None] if body.size == 3 else S
                self.of_rows[body.points, :, rows] = own
                self.shares[body.points, :, rows] = np.linalg.pinv(own.reshape(-1, body.size).T).reshape(-1, 3, body.size)
                self.row_velocity[rows, six] = S[0] if body.size == 3 else np.eye(6)
        placements = [robot.site(ground.contact.frame)[1] * ground.X_FP for ground in grounds]
        self.centred = np.concatenate([g.local @ X.rotation.T for g, X in zip(grounds, placements, strict=True)])
        self.agrees: bool | None = None
        self.spare: list[StepWorkspace] = []

    @classmethod
    def prepared(cls, robot: CheckedModel, grounds: Sequence[OnGround]) -> TouchingBodies:
        """Those of a robot and its contacts: computed once, and kept while the robot is in use."""
        known, key = robot.kept_bodies, (cls, *[ground.contact for ground in grounds])
        found: TouchingBodies | None = known.get(key)
        if found is None:
            found = cls(robot, grounds)
            keep(known, key, found, MOST_BODIES)
        return found

    def workspace(self, model: pin.Model) -> StepWorkspace:
        """A workspace that no other motion uses."""
        try:
            return self.spare.pop()
        except IndexError:
            return StepWorkspace(model, self.bodies)


class StepWorkspace(Workspace):
    """That of one motion, with views of its data.

    Attributes:
        places: Placements of all joints, a view of the data: row j has R_Wj by columns, then p_Wj.
        rates: Velocities (v, w) of all joints in their axes, likewise.
        accelerations: Their spatial accelerations, likewise.
        patch_rates: Velocities (v, w) of the bodies with six rows, as `pin.constraintDynamics` leaves them.
        pushed: Forces on the bodies.
    """

    def __init__(self, model: pin.Model, bodies: Sequence[TouchingBody]) -> None:
        super().__init__(model, [body.site for body in bodies])
        n = model.njoints
        self.places = rows_from([(X.rotation, X.translation) for X in (self.data.oMi[j] for j in range(n))], 12)
        self.rates, self.accelerations = (
            rows_from([(V.linear, V.angular) for V in (of[j] for j in range(n))], 6) for of in (self.data.v, self.data.a)
        )
        held = [contact.contact1_velocity for body, contact in zip(bodies, self.contacts, strict=True) if body.size == 6]
        self.patch_rates = rows_from([(V.linear, V.angular) for V in held], 6)
        self.pushed = [self.forces[body.joint] for body in bodies]


MOST_SPARE = 2
"""Workspaces that are kept with a set of contacts."""


class TurnedMap:
    """The map (R, x) -> G^T R S x of every point, R of its body, as one constant matrix on products of R's and x's entries.

    Args:
        axes: G of each point, shape (k, 3, 3).
        body: The body of each point, shape (k,).
        S: Shape (k, 3, n).
    """

    def __init__(self, axes: Array, body: Array, S: Array) -> None:
        k, n = len(S), int(body.max()) + 1
        each = np.zeros((k, 3, n, 3, 3, S.shape[2]))
        each[np.arange(k), :, body] = np.einsum("icr,ief->irecf", axes, S)
        whole = each.reshape(3 * k, -1)
        used = np.flatnonzero(whole.any(axis=0))
        of_body, e, c, self._other = np.unravel_index(used, (n, 3, 3, S.shape[2]))
        self._matrix, self._place = whole[:, used].copy(), 12 * of_body + 3 * e + c

    @property
    def parts(self) -> tuple[Array, Array, Array]:
        """The matrix; and of each product, which entry of R's and which of x it has."""
        return self._matrix, self._place, self._other

    def __call__(self, X: Array, x: Array) -> Array:
        """Shape (p,), from the placements of the bodies and x, each one after the other."""
        out: Array = self._matrix.dot(X.take(self._place) * x.take(self._other))
        return out


_AGREES = 1e-9
"""Tolerance of the equations of motion at the start, scaled: beyond it the model has something that is not covered."""
_STANDS = 1e-15
"""Squares of the contact bodies' velocities up to this: w x v is rounding beside other accelerations [m/s2]."""
_TURNS = 1e-16
"""Centripetal changes of velocity in a step up to this are rounding [m/s]."""
_NOTHING = zeros(0)


class GroundDynamics:
    """The constant data of one robot's contacts with ground at rest, for the steps of one motion.

    It has one pin.Data of its own, overwritten by every call: results do not depend on earlier calls.

    Attributes:
        layout: The points.
        at_rest: Velocities of points at rest, shape (p,): the array of every answer in which all stick.
        size: Number of the bodies' rows.
    """

    def __init__(self, points: Points, grounds: Sequence[OnGround], bodies: TouchingBodies, start: State) -> None:
        model = start.robot.model
        self._points, self._model, self._bodies, self._kernel = points, model, bodies, step_kernel()
        self.layout = points.layout(tuple([s.structure for s in points.sources]))  # type: ignore[attr-defined]
        self._workspace = space = bodies.workspace(model)
        self._places, self._rates, self._accelerations = space.places, space.rates, space.accelerations
        self._data, self._factors = space.data, space.factors
        self._joints, self.size, self._row_velocity = bodies.joints, bodies.size, bodies.row_velocity
        self._target = np.zeros(self.size + model.nv)
        k = len(bodies.of)
        self._axes = axes = np.concatenate([np.tile(ground.R, (len(ground.local), 1, 1)) for ground in grounds])
        self._height = np.concatenate([np.full(len(ground.local), ground.height) for ground in grounds])
        gaps = np.zeros((k, len(bodies.bodies), 12))
        gaps[np.arange(k), bodies.of, :9] = (bodies.arms[:, :, None] * axes[:, None, :, 2]).reshape(k, 9)
        gaps[np.arange(k), bodies.of, 9:] = axes[:, :, 2]
        self._gaps = gaps.reshape(k, -1)
        self._velocity = TurnedMap(axes, bodies.of, bodies.spread)
        self._forces = TurnedMap(axes, bodies.of, bodies.shares)
        self._mu, self.at_rest = self.layout.mu, zeros(3 * k)

    def __del__(self) -> None:
        space = self.__dict__.get("_workspace")
        if space is not None and len(self._bodies.spare) < MOST_SPARE:
            self._bodies.spare.append(space)

    @classmethod
    def of(cls, points: Points, start: State) -> GroundDynamics | None:
        """The prepared form of a motion's contacts, or None where they, or the robot, are not covered."""
        robot, grounds = start.robot, list[OnGround]()
        for source in points.sources:
            if not isinstance(source, Grounds):
                return None
            grounds += source.members
        if not grounds or not robot.sound or any(g.surface is not None or not g.contact.friction for g in grounds):
            return None
        bodies = TouchingBodies.prepared(robot, grounds)
        if not bodies.covered or bodies.agrees is False:
            return None
        found = cls(points, grounds, bodies, start)
        return found if found._agrees(start) else None

    def at(self, state: State, t: float) -> Snapshot:
        """All points at a state: gaps and velocities; the rest is computed the general way, if asked for."""
        pin.forwardKinematics(self._model, self._data, state.q, state.v)
        gap, velocity = self._kernel.points(
            self._places, self._rates, self._joints, self._gaps, self._height, *self._velocity.parts
        )
        return Snapshot(
            state, self.layout, velocity, gap, self.at_rest,
            lambda: [source.at(state, t) for source in self._points.sources], lambda: self._located(state),
        )  # fmt: skip

    def _located(self, state: State) -> list[PointPlaces]:
        """Where the points of each source are."""
        pin.forwardKinematics(self._model, self._data, state.q)
        X, of = self._places.take(self._joints, axis=0), self._bodies.of
        R = self._rotations(X)[of]
        arms = each_times(R, self._bodies.centred)
        points = X[of, 9:] + each_times(R, self._bodies.arms)
        out = []
        for source, (at, _) in zip(self._points.sources, self.layout.spans, strict=True):
            assert isinstance(source, Grounds)
            out.append(PointPlaces(source.structure, points[at], source.R, None if source.point_alone else arms[at], None))
        return out

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
        added: Array | None = None,
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
            added: Diagonal matrix that is added to M, shape (nv, nv), zero for floating bases; None: nothing is.
        """
        model = self._model if added is None else self._heavier(added)
        everything = active is self.layout.everything
        if not everything and not active.any():
            return self._free(model, q, v, applied, start, h)
        a = self._workspace.held(model, q, v, applied)
        if a is None or not math.isfinite(a.dot(a)):
            return None
        if mean is not None:
            pin.forwardKinematics(self._model, self._data, q, mean + (0.5 * h) * a)
        may_stick = shift is None and (mean is not None or u is self.at_rest) and (everything or active.all())
        if may_stick and self._straight(h):
            answer = self._sticking(a, start, h, whole=mean is not None)
            if answer is not None:
                return answer
        return self._by_points(q, v, a, start, h, active, guess, law, shift, u)

    def _sticking(self, a: Array, start: Array, h: float, *, whole: bool) -> VelocityAnswer | None:
        """The step if all points stick, by their forces of least norm; None if these are not in their cones."""
        F, kernel, change = self._data.lambda_c, self._kernel, _NOTHING
        if whole:
            kernel.target(self._rates, self._joints, self._row_velocity, h, self._target)
            change = self._factors.solve(self._target)
        inside, impulse, v = kernel.sticking(self._places, self._joints, F, change, a, start, h, self._mu, *self._forces.parts)
        return VelocityAnswer(v, impulse, self.at_rest, 0.0, True) if inside else None

    def _by_points(
        self,
        q: Array,
        v: Array,
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
        X, W = self._places.take(self._joints, axis=0).ravel(), self._rates.take(self._joints, axis=0).ravel()
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

    def _heavier(self, added: Array) -> pin.Model:
        """The model with a diagonal matrix added to M, as rotor inertia of its joints."""
        self._stiffened.armature = self._model.armature + added.diagonal()
        return self._stiffened

    @lazy
    def _stiffened(self) -> pin.Model:
        return pin.Model(self._model)

    def _free(self, model: pin.Model, q: Array, v: Array, applied: Array, start: Array, h: float) -> VelocityAnswer | None:
        """The step without any contact; the points' velocities are J v, of the velocity after it."""
        end = start + h * pin.aba(model, self._data, q, v, applied)
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
        model, data = self._model, self._data
        pin.forwardKinematics(model, data, q, v, a)
        X, V, A = (x.take(self._joints, axis=0) for x in (self._places, self._rates, self._accelerations))
        Q, (of, arms) = self._turns_of(X), (self._bodies.of, self._bodies.arms)
        P, w, forces = (Q @ self._bodies.spread).reshape(len(u), -1), V[:, 3:], answer.impulse / h
        for slot, wrench in zip(self._workspace.pushed, (P.T @ forces).reshape(-1, 6), strict=True):
            slot.vector = wrench
        unbalanced = pin.rnea(model, data, q, v, a, self._workspace.forces) - applied
        moved = (P @ A.ravel()) * h + u - answer.velocity
        if np.vdot(V, V) > _STANDS:  # spatial accelerations are not classical
            inwards = cross_rows(w[of], V[of, :3] + cross_rows(w[of], arms))
            moved += h * each_times(Q, inwards).ravel()
        f, size = forces.reshape(-1, 3), max(1.0, max_abs(applied), max_abs(forces))
        moved[~np.repeat(f.any(axis=1), 3)] = 0.0
        outside = float((np.hypot(f[:, 0], f[:, 1]) - self._mu * f[:, 2]).max(initial=0.0)) / max(1.0, max_abs(forces))
        return max(max_abs(unbalanced) / size, max_abs(moved) / (h * max(1.0, max_abs(a))), outside)

    def _straight(self, h: float) -> bool:
        """Whether bodies that touch at patches turn so slowly that their points' centripetal accelerations are rounding."""
        rates = self._workspace.patch_rates
        return not len(rates) or bool(np.vdot(rates, rates) * h <= _TURNS)

    def _rotations(self, X: Array) -> Array:
        """R_WJ of the bodies' joints, shape (n, 3, 3)."""
        return X.reshape(-1, 12)[:, :9].reshape(-1, 3, 3).swapaxes(1, 2)

    def _turns_of(self, X: Array) -> Array:
        """Rotations from the joints' axes to those of each point, shape (k, 3, 3)."""
        return np.asarray(self._axes.swapaxes(1, 2) @ self._rotations(X)[self._bodies.of])

    def _points_of_rows(self, X: Array) -> Array:
        """Velocities of the points for unit velocities of the bodies' rows, shape (p, rows)."""
        return (self._turns_of(X) @ self._bodies.of_rows).reshape(len(self.at_rest), self.size)

    def _centripetal(self, X: Array, V: Array) -> Array:
        """Classical accelerations of the points less those by the rows' spatial ones, w x (v + w x r), shape (p,).

        The rows of a single point are classical already.
        """
        motion = (V.reshape(-1, 6) * self._bodies.patches[:, None])[self._bodies.of]
        w = motion[:, 3:]
        acceleration = cross_rows(w, motion[:, :3] + cross_rows(w, self._bodies.arms))
        return each_times(self._turns_of(X), acceleration).ravel()

    def _agrees(self, start: State) -> bool:
        """Whether it has the same equations of motion as the robot's M and h at the start, and rows of full rank."""
        rng = np.random.default_rng(0)
        q, v, applied = start.q, rng.normal(size=start.robot.nv), rng.normal(size=start.robot.nv)
        data, a = self._data, self._workspace.held(self._model, q, v, applied)
        if a is None or not is_finite(a):
            return False
        L = self._factors.getInverseOperationalSpaceInertiaMatrix()
        size = np.sqrt(L.diagonal())
        if not (size > 0.0).all() or rank_of(L / size / size[:, None], INDEPENDENT**2) < self.size:
            return False
        if self._bodies.agrees is not None:
            return self._bodies.agrees
        P = self._points_of_rows(self._places.take(self._joints, axis=0).ravel())
        moving = State(start.robot, q, v)
        snapshot = self.at(moving, 0.0)
        rows = np.linalg.lstsq(P, snapshot.J, rcond=None)[0]
        off = moving.M @ a + moving.h - applied - rows.T @ data.lambda_c
        size = max(1.0, max_abs(moving.h), max_abs(data.lambda_c))
        self._bodies.agrees = max_abs(off) <= _AGREES * size and max_abs((P @ rows - snapshot.J).ravel()) <= _AGREES
        return self._bodies.agrees
