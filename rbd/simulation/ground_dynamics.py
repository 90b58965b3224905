"""Time steps on ground at rest by the few rows of the bodies in contact, not of all their points.

`rbd.answers.prepared.contact_bodies` gives the acceleration a_0 that holds the bodies still, and the forces F_0 on them. From
its factors, for any acceleration s of the bodies,

    F = F_0 + L s,        a = a_0 + M^-1 J^T L s,        L = (J M^-1 J^T)^-1            J: of the bodies, not of their points

Points are fixed to their bodies: P^T V are their velocities, and P p is what point impulses p do to the bodies. Over a time h

    u+ = u_0 + h P^T s + ...        sticking: u+ = 0, which one s gives for all points of a body

If the corner forces of least norm for that F are in their cones, they are the answer. Else it is the velocity problem of
`rbd.simulation.velocity_problem` with D = P^T L^-1 P. What is not covered has no `GroundDynamics`, and steps the general way:
other constraints than contacts with friction on ground at rest, bodies that touch along an edge only, dependent rows.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from rbd.answers.prepared.contact_bodies import (
    MOST_BODIES,
    WORLD,
    ContactBodies,
    Site,
    gap_map,
    keep,
    rotations,
)
from rbd.arrays import Array, cross_matrix, each_times, filled, is_finite, lazy, max_abs, rank_of, zeros
from rbd.constraints.ground_points import Grounds, OnGround
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State
from rbd.simulation.bases import step_kernel
from rbd.simulation.stacked_points import PointPlaces, Points, Snapshot
from rbd.simulation.velocity_problem import StepEquations, VelocityAnswer

INDEPENDENT = 1e-6
"""Singular values below this, over the largest, are those of points on a line, or of dependent rows."""


class TouchingPoints:
    """The points of contacts with ground at rest on their bodies: what does not change with where the ground is.

    Args:
        robot: The robot.
        grounds: The contacts.

    Attributes:
        bodies: The bodies, in the order of their joints: a single point has three rows, several that are not on a line six;
            None if others cannot be held still so.
        of: The body of each point, shape (k,).
        arms: Where each point is in its joint's axes, shape (k, 3) [m].
        centred: The same from its contact's centre.
        of_rows: The same by velocities of the rows, shape (k, 3, rows).
        shares: Forces of least norm at the points for forces on the rows, shape (k, 3, rows).
        agrees: Whether the equations of motion were found to be those of M and h; None before they were compared.
    """

    def __init__(self, robot: CheckedModel, grounds: Sequence[OnGround]) -> None:
        sites = [robot.site(ground.contact.frame) for ground in grounds]
        placements = [X_JF * ground.X_FP for ground, (_, X_JF) in zip(grounds, sites, strict=True)]
        each = np.repeat(np.arange(len(grounds)), [len(ground.local) for ground in grounds])
        self.centred = np.concatenate([g.local @ X.rotation.T for g, X in zip(grounds, placements, strict=True)])
        self.arms = self.centred + np.array([X.translation for X in placements])[each]
        joints, self.of = np.unique(np.array([joint for joint, _ in sites])[each], return_inverse=True)
        k = len(each)
        S = np.array([np.concatenate([np.eye(3), -cross_matrix(x)], axis=1) for x in self.arms])
        members = [np.flatnonzero(self.of == b) for b in range(len(joints))]
        at = [self.arms[own[0]] if len(own) == 1 else np.zeros(3) for own in members]
        held = [
            Site(int(joint), pin.SE3(np.eye(3), x), 3 if len(own) == 1 else 6, axes=0)
            for joint, x, own in zip(joints, at, members, strict=True)
        ]
        firm = all(len(own) == 1 or rank_of(S[own].reshape(-1, 6), INDEPENDENT) == 6 for own in members)
        self.bodies = ContactBodies.of(robot, held) if firm and joints[0] else None
        self.agrees: bool | None = None
        if self.bodies is None:
            return
        self.of_rows, self.shares = np.zeros((k, 3, self.bodies.m)), np.zeros((k, 3, self.bodies.m))
        for own, rows in zip(members, self.bodies.rows, strict=True):
            by_rows, size = np.eye(3)[None] if len(own) == 1 else S[own], rows.stop - rows.start
            self.of_rows[own, :, rows] = by_rows
            self.shares[own, :, rows] = np.linalg.pinv(by_rows.reshape(-1, size).T).reshape(-1, 3, size)

    @classmethod
    def prepared(cls, robot: CheckedModel, grounds: Sequence[OnGround]) -> TouchingPoints:
        """Those of a robot and its contacts: computed once, and kept while the robot is in use."""
        known, key = robot.kept_bodies, (cls, *[ground.contact for ground in grounds])
        found: TouchingPoints | None = known.get(key)
        if found is None:
            found = cls(robot, grounds)
            keep(known, key, found, MOST_BODIES)
        return found


_AGREES = 1e-9
"""Tolerance of the equations of motion at the start, scaled: beyond it the model has something that is not covered."""
_NOTHING = zeros(0)


class GroundDynamics:
    """The constant data of one robot's contacts with ground at rest, for the steps of one motion.

    It has one pin.Data of its own, overwritten by every call: results do not depend on earlier calls.

    Attributes:
        layout: The points.
        at_rest: Velocities of points at rest, shape (p,): the array of every answer in which all stick.
    """

    def __init__(self, points: Points, grounds: Sequence[OnGround], touching: TouchingPoints, start: State) -> None:
        assert touching.bodies is not None
        self._points, self._model, self._touching, self._kernel = points, start.robot.model, touching, step_kernel()
        self.layout = points.layout(tuple([s.structure for s in points.sources]))  # type: ignore[attr-defined]
        self._bodies = bodies = touching.bodies
        self._workspace = bodies.taken()
        self._axes = axes = np.concatenate([np.tile(ground.R, (len(ground.local), 1, 1)) for ground in grounds])
        self._height = np.concatenate([np.full(len(ground.local), ground.height) for ground in grounds])
        self._gaps = gap_map(touching.of, touching.arms, axes[:, :, 2], len(bodies.sites))
        self._constants = (np.array(touching.of, np.int64), axes, touching.arms, touching.shares, self.layout.mu)
        self._mu, self.at_rest, self._gravity = self.layout.mu, zeros(3 * len(axes)), start.robot.gravity

    def __del__(self) -> None:
        space = self.__dict__.get("_workspace")
        if space is not None:
            self._bodies.put_back(space)

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
        touching = TouchingPoints.prepared(robot, grounds)
        if touching.bodies is None or touching.agrees is False:
            return None
        found = cls(points, grounds, touching, start)
        return found if found._agrees(start) else None

    def at(self, state: State, t: float) -> Snapshot:
        """All points at a state: gaps and velocities; the rest is computed the general way, if asked for."""
        X, gap, velocity, found = self._measured(state.q, state.v)
        return filled(
            Snapshot, state=state, layout=self.layout, velocity=velocity, gap=gap, error=self.at_rest,
            measure=lambda: [source.at(state, t) for source in self._points.sources], locate=self._located, placed=X,
            spread=self._points_of_rows, extremes=found,
        )  # fmt: skip

    def _measured(self, q: Array, v: Array) -> tuple[Array, Array, Array, tuple[float, float, float]]:
        """(placements of the bodies, gaps and velocities of the points, `Snapshot.extremes`)."""
        pin.forwardKinematics(self._model, self._workspace.data, q, v)
        X, V = self._bodies.placements(self._workspace), self._bodies.velocities(self._workspace)
        gap, velocity = np.empty(len(self._height)), np.empty(len(self.at_rest))
        return X, gap, velocity, self._kernel.points(X, V, self._gaps, self._height, *self._constants[:3], gap, velocity)

    def _located(self, X: Array) -> list[PointPlaces]:
        """Where the points of each source are, by placements of the bodies at n states, shape (n, 12 bodies)."""
        of = self._touching.of
        R = rotations(X)[:, of]
        arms = each_times(R, self._touching.centred)
        points = X.reshape(len(X), -1, 12)[:, of, 9:] + each_times(R, self._touching.arms)
        out = []
        for source, (at, _) in zip(self._points.sources, self.layout.spans, strict=True):
            assert isinstance(source, Grounds)
            centred = None if source.point_alone else arms[:, at]
            out.append(PointPlaces(source.structure, points[:, at], source.R.reshape(1, -1, 3, 3), centred, None))
        return out

    def answer(
        self,
        equations: StepEquations,
        applied: Array,
        guess: Array,
        *,
        law: str,
        shift: Array | None,
        added: Array | None = None,
    ) -> VelocityAnswer | None:
        """Velocity and impulses of one half of a step; None where the general way is to answer.

        Args:
            equations: The half.
            applied: S^T tau + tau_ext, shape (nv,).
            guess: Impulses to start from, shape (p,).
            law: "coulomb" or "convex".
            shift: Added to u+ only in the contact law, shape (p,).
            added: Diagonal matrix that is added to M, shape (nv, nv), zero for floating bases; None: nothing is.
        """
        state, _, _, _, active, start, h, u, _, mean = equations
        model, kernel, space = self._model if added is None else self._heavier(added), self._kernel, self._workspace
        if active is not self.layout.everything and not active.any():
            return self._free(model, equations, applied)
        space.terms(model, state.q, state.v)
        v, impulse, velocity = np.empty(len(start)), np.empty(len(u)), np.empty(len(u))
        how, merit = kernel.advance(
            *space.read, *space.fixed, state.v, applied, space.memory, start, _NOTHING if mean is None else mean, u, guess,
            _NOTHING if shift is None else shift, active, h, law == "coulomb", *self._constants, v, impulse, velocity,
        )  # fmt: skip
        if how == kernel.UNDECIDED or not is_finite(v):
            return None
        return VelocityAnswer(v, impulse, self.at_rest if how == kernel.REST else velocity, merit, how != kernel.NEWTON)

    def toward(self, state: State, closes: Array, gap: Array) -> Array:
        """The least displacement in the metric of M that closes the gaps (k,) of some points, by their rates, shape (nv,)."""
        space, out = self._workspace, np.empty(len(state.v))
        pin.crba(self._model, space.data, state.q, WORLD)
        self._kernel.toward(*space.read, *space.fixed, out, out, space.memory, *self._constants, closes, gap, out)
        return out

    def _heavier(self, added: Array) -> pin.Model:
        """The model with a diagonal matrix added to M, as rotor inertia of its joints."""
        self._stiffened.armature = self._model.armature + added.diagonal()
        return self._stiffened

    @lazy
    def _stiffened(self) -> pin.Model:
        return pin.Model(self._model)

    def _free(self, model: pin.Model, equations: StepEquations, applied: Array) -> VelocityAnswer | None:
        """The step without any contact; the points' velocities are J v, of the velocity after it."""
        state = equations.state
        end = equations.start + equations.h * pin.aba(model, self._workspace.data, state.q, state.v, applied)
        if not is_finite(end):
            return None
        return VelocityAnswer(end, np.zeros(len(self.at_rest)), self._measured(state.q, end)[2], 0.0, True)

    def residual(self, at: Snapshot, applied: Array, a: Array, u: Array, h: float, answer: VelocityAnswer) -> float:
        """Residual of a half step by another route than its answer's: inverse dynamics and the bodies' accelerations, scaled.

        Args:
            at: The points at its beginning.
            applied: S^T tau + tau_ext, shape (nv,).
            a: Acceleration of the answer, shape (nv,).
            u: The points' velocities at the step's beginning, shape (p,).
            h: Length of the half step [s].
            answer: The answer.
        """
        bodies, space, forces, state = self._bodies, self._workspace, answer.impulse / h, at.state
        X = at.placed if at.locate is not None else self._measured(state.q, state.v)[0]
        touching, axes, kernel = self._touching, self._axes, self._kernel
        pushed = np.empty(len(X) // 2)
        kernel.wrenches(X, forces, touching.of, axes, touching.arms, pushed)
        taken = bodies.inverse_dynamics(space, state.q, state.v, a, pushed)
        return kernel.residual(
            X, bodies.velocities(space), bodies.lifts(space), self._gravity, touching.of, axes, touching.arms, self._mu, taken,
            applied, a, forces, u, answer.velocity, h,
        )  # fmt: skip

    def _points_of_rows(self, X: Array) -> Array:
        """Velocities of the points for unit velocities of the bodies' rows, shape (p, rows)."""
        turns = self._axes.swapaxes(1, 2) @ rotations(X)[self._touching.of]
        return (turns @ self._touching.of_rows).reshape(len(self.at_rest), -1)

    def _agrees(self, start: State) -> bool:
        """Whether it has the same equations of motion as the robot's M and h at the start, and rows of full rank."""
        rng = np.random.default_rng(0)
        q, v, applied = start.q, rng.normal(size=start.robot.nv), rng.normal(size=start.robot.nv)
        bodies, space = self._bodies, self._workspace
        a = space.held(q, v, applied)
        if a is None or not is_finite(a):
            return False
        L = space.mobility
        size = np.sqrt(L.diagonal())
        if not (size > 0.0).all() or rank_of(L / size / size[:, None], INDEPENDENT**2) < bodies.m:
            return False
        if self._touching.agrees is not None:
            return self._touching.agrees
        F, P = space.row_forces.copy(), self._points_of_rows(bodies.placements(space))
        moving = State(start.robot, q, v)
        snapshot = self.at(moving, 0.0)
        rows = np.linalg.lstsq(P, snapshot.J, rcond=None)[0]
        off = moving.M @ a + moving.h - applied - rows.T @ F
        size = max(1.0, max_abs(moving.h), max_abs(F))
        self._touching.agrees = max_abs(off) <= _AGREES * size and max_abs((P @ rows - snapshot.J).ravel()) <= _AGREES
        return self._touching.agrees
