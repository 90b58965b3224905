"""Time steps on ground at rest by the few rows of the bodies in contact, not of all their points.

`rbd.answers.prepared.contact_bodies` gives the acceleration a_0 that holds the bodies still, and the forces F_0 on them. From
its factors, for any acceleration s of the bodies,

    F = F_0 + L s,        a = a_0 + M^-1 J^T L s,        L = (J M^-1 J^T)^-1            J: of the bodies, not of their points

Points are fixed to their bodies: P^T V are their velocities, and P p is what point impulses p do to the bodies. Over a time h

    u+ = u_0 + h P^T s + ...        sticking: u+ = 0, which one s gives for all points of a body

If the corner forces of least norm for that F are in their cones, they are the answer. Else it is the velocity problem of
`rbd.simulation.velocity_problem` with D = P^T L^-1 P. What is not covered has no `GroundDynamics`, and steps the general way:
other constraints than contacts with friction on planes at rest, bodies that touch along an edge only, dependent rows. On
terrain corners over a face of a piece are on that face's plane: as long as contacts touch the same faces by the same corners,
their steps are those on planes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rbd.answers.prepared.contact_bodies import (
    MOST_BODIES,
    WORLD,
    ContactBodies,
    Site,
    Workspace,
    gap_map,
    keep,
    rotations,
)
from rbd.arrays import Array, cross_matrix, each_times, filled, is_finite, lazy, max_abs, rank_of, zeros
from rbd.constraints.ground_points import PlanePoints
from rbd.constraints.terrain.on_terrain import OnTerrain
from rbd.constraints.terrain.touches import Touches
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State
from rbd.simulation.bases import step_kernel
from rbd.simulation.stacked_points import PointLayout, PointPlaces, Points, Snapshot
from rbd.simulation.velocity_problem import StepEquations, VelocityAnswer

INDEPENDENT = 1e-6
"""Singular values below this, over the largest, are those of points on a line, or of dependent rows."""
MOST_SETS = 64
"""Sets of active points whose shares are kept with the points."""


class TouchingPoints:
    """Points on planes at rest on their bodies: what does not change with where the planes are.

    Args:
        robot: The robot.
        joint: The joint of each point's body, shape (k,).
        local: Where each is in its joint's axes, and from its contact's centre, shape (k, 3, 2) [m].

    Attributes:
        bodies: The bodies, in the order of their joints: points at one place have three rows, those that are not on a line six;
            None if others cannot be held still so.
        of: The body of each point, shape (k,).
        arms: Where each point is in its joint's axes, shape (k, 3) [m].
        centred: The same from its contact's centre.
        of_rows: Velocities of the points by those of the rows, shape (k, 3, rows).
        agrees: Whether the equations of motion were found to be those of M and h; None before they were compared.
    """

    def __init__(self, robot: CheckedModel, joint: Array, local: Array) -> None:
        self.arms, self.centred = (x.copy() for x in np.moveaxis(local, 2, 0))
        joints, self.of = np.unique(joint, return_inverse=True)
        members = [np.flatnonzero(self.of == b) for b in range(len(joints))]
        sizes = [self._rank(own) for own in members]
        held = [
            Site(int(joint), pin.SE3(np.eye(3), self.arms[own[0]] if size == 3 else np.zeros(3)), size, axes=0)
            for joint, size, own in zip(joints, sizes, members, strict=True)
        ]
        self.bodies = ContactBodies.of(robot, held) if all(sizes) and joints[0] else None
        self.agrees: bool | None = None
        self._known = dict[bytes, Array]()
        if self.bodies is None:
            return
        self.of_rows = np.zeros((len(local), 3, self.bodies.m))
        for own, size, rows in zip(members, sizes, self.bodies.rows, strict=True):
            self.of_rows[own, :, rows] = self._moved(own)[:, :, :size]

    def _moved(self, points: Array) -> Array:
        """Velocities of points by those of their body, (linear, angular), shape (points, 3, 6)."""
        return np.array([np.concatenate([np.eye(3), -cross_matrix(x)], axis=1) for x in self.arms[points]])

    def _rank(self, points: Array) -> int:
        """Rows of a body that some of its points hold: 3 of points at one place, 6; 0 where they hold it in part."""
        if not np.ptp(self.arms[points], axis=0).any():
            return 3
        return 6 * (rank_of(self._moved(points).reshape(-1, 6), INDEPENDENT) == 6)

    def shares(self, active: Array) -> Array:
        """Forces of least norm at active points for forces on the rows, shape (k, 3, rows); NaN where those do not hold all."""
        known = self._known.get(active.tobytes())
        if known is None:
            assert self.bodies is not None
            known = np.zeros(self.of_rows.shape)
            for b, rows in enumerate(self.bodies.rows):
                own, size = np.flatnonzero((self.of == b) & active), rows.stop - rows.start
                if not len(own) or self._rank(own) != size:
                    known[:] = np.nan
                    break
                known[own, :, rows] = np.linalg.pinv(self.of_rows[own, :, rows].reshape(-1, size).T).reshape(-1, 3, size)
            keep(self._known, active.tobytes(), known, MOST_SETS)
        return known

    @classmethod
    def prepared(cls, robot: CheckedModel, sources: Sequence[PlanePoints]) -> TouchingPoints:
        """Those of a robot and its points: computed once, and kept while the robot is in use."""
        joint, local = np.concatenate([s.joint for s in sources]), np.concatenate([s.local for s in sources])
        known, key = robot.kept_bodies, (cls, joint.tobytes(), local.tobytes())
        found: TouchingPoints | None = known.get(key)
        if found is None:
            found = cls(robot, joint, local)
            keep(known, key, found, MOST_BODIES)
        return found


_AGREES = 1e-9
"""Tolerance of the equations of motion at the start, scaled: beyond it the model has something that is not covered."""
_NOTHING = zeros(0)


SAME_POINT = 1e-9
"""A point over an edge that has moved by less in its body is where it was [m]."""


@dataclass
class _Prepared:
    """The form of a set of points, with where those over edges are in their bodies."""

    passing: list[Array]
    tried: bool = False
    ground: GroundDynamics | None = None


class GroundSteps:
    """The prepared forms of a motion's contacts: one on planes; on terrain one for each set of points on pieces at rest.

    Args:
        points: The contacts.
        sources: Theirs, all with ground or with terrain.
        robot: The robot.
    """

    def __init__(self, points: Points, sources: Sequence[PlanePoints | OnTerrain], robot: CheckedModel) -> None:
        self._points, self._sources, self._model = points, tuple(sources), robot.model
        self._terrains = [source for source in sources if isinstance(source, OnTerrain)]
        self._space = Workspace(robot.model, ()) if self._terrains else None

    @classmethod
    def of(cls, points: Points, start: State) -> GroundSteps | None:
        """Those of a motion; None where no set of its contacts can have one."""
        sources = [source for source in points.sources if isinstance(source, PlanePoints | OnTerrain)]
        if not sources or len(sources) < len(points.sources) or not start.robot.sound:
            return None
        found = cls(points, sources, start.robot)
        return found if found._terrains or found.at(start, start.t).ground is not None else None

    def at(self, state: State, t: float) -> Snapshot:
        """All points at a state and a time [s]: by the prepared form of their set, if it has one."""
        found = self._touched(state)
        layout = self._points.layout(
            tuple([s.structure if isinstance(s, PlanePoints) else s.structure(found[s][0]) for s in self._sources])
        )
        ground = self._prepared(layout, state, found)
        if ground is not None:
            return ground.at(state, t)
        measured = [s.at(state, t) if isinstance(s, PlanePoints) else s.measured(state, *found[s]) for s in self._sources]
        return Snapshot.of(state, layout, measured)

    def _prepared(
        self, layout: PointLayout, state: State, found: dict[OnTerrain, tuple[Touches, Array, Array]]
    ) -> GroundDynamics | None:
        """The form of a set of points; of those over edges only while these stay where they are in their bodies."""
        here = [source.passing(*found[source]) for source in self._terrains]
        known: _Prepared | None = layout.computed.get(GroundSteps)
        if known is None or any(max_abs((x - y).ravel()) > SAME_POINT for x, y in zip(here, known.passing, strict=True)):
            again = known is not None
            known = layout.computed[GroundSteps] = _Prepared(here)
            if again or any(map(len, here)):
                return None
        if not known.tried:
            passing = dict(zip(self._terrains, here, strict=True))
            planes = [s if isinstance(s, PlanePoints) else s.on_planes(found[s][0], passing[s]) for s in self._sources]
            known.ground = GroundDynamics.of(layout, [s for s in planes if s is not None], state)
            known.tried = True
        return known.ground

    def _touched(self, state: State) -> dict[OnTerrain, tuple[Touches, Array, Array]]:
        """As of `OnTerrain.touches`, of all that are on terrain."""
        if self._space is None:
            return {}
        pin.forwardKinematics(self._model, self._space.data, state.q)
        places, found = self._space.places.reshape(-1, 12), dict[OnTerrain, tuple[Touches, Array, Array]]()
        for source in self._terrains:
            X = places[source.joints]
            R, p = rotations(X.reshape(-1)), X[:, 9:]
            found[source] = source.touches_of(R, p, state.t), R, p
        return found


class GroundDynamics:
    """The constant data of one set of points on planes at rest, for the steps of one motion.

    It has one pin.Data of its own, overwritten by every call: results do not depend on earlier calls.

    Attributes:
        layout: The points.
    """

    def __init__(
        self, layout: PointLayout, sources: Sequence[PlanePoints], touching: TouchingPoints, robot: CheckedModel
    ) -> None:
        assert touching.bodies is not None
        self._sources, self._model, self._touching, self._kernel = tuple(sources), robot.model, touching, step_kernel()
        self.layout, self._bodies = layout, touching.bodies
        self._workspace = self._bodies.taken()
        self._axes = axes = np.concatenate([source.axes for source in sources])
        self._height = np.concatenate([source.height for source in sources])
        self._gaps = gap_map(touching.of, touching.arms, axes[:, :, 2], len(self._bodies.sites))
        self._places = np.array(touching.of, np.int64), axes, touching.arms
        self._shares = layout.everything, touching.shares(layout.everything)
        self._mu, self._gravity = layout.mu, robot.gravity

    def __del__(self) -> None:
        space = self.__dict__.get("_workspace")
        if space is not None:
            self._bodies.put_back(space)

    @classmethod
    def of(cls, layout: PointLayout, sources: Sequence[PlanePoints], state: State) -> GroundDynamics | None:
        """The prepared form of a layout's points, or None where they, or the robot, are not covered.

        Args:
            layout: The points.
            sources: Of each of its structures, if it is on planes.
            state: Any state.
        """
        k = sum(len(source.joint) for source in sources)
        if not k or k != len(layout.owners) or any(s.surface is not None or not len(s.joint) for s in sources):
            return None  # nor where one has no point, as a hand off its rail
        if not (layout.mu > 0.0).all():  # of bilateral rows, and of sets that are no circular cones
            return None
        touching = TouchingPoints.prepared(state.robot, sources)
        if touching.bodies is None or touching.agrees is False:
            return None
        found = cls(layout, sources, touching, state.robot)
        return found if found._agrees(state) else None

    def at(self, state: State, t: float) -> Snapshot:
        """All points at a state: gaps and velocities; the rest is computed the general way, if asked for."""
        X, gap, velocity, found = self._measured(state.q, state.v)
        return filled(
            Snapshot, state=state, layout=self.layout, velocity=velocity, gap=gap, error=self.layout.at_rest,
            measure=lambda: [source.at(state, t) for source in self._sources], ground=self, placed=X, extremes=found,
        )  # fmt: skip

    def _measured(self, q: Array, v: Array) -> tuple[Array, Array, Array, tuple[float, float, float]]:
        """(placements of the bodies, gaps and velocities of the points, `Snapshot.extremes`)."""
        pin.forwardKinematics(self._model, self._workspace.data, q, v)
        X, V = self._bodies.placements(self._workspace), self._bodies.velocities(self._workspace)
        gap, velocity = np.empty(len(self._height)), np.empty(3 * len(self._height))
        return X, gap, velocity, self._kernel.points(X, V, self._gaps, self._height, *self._places, gap, velocity)

    def located(self, X: Array) -> list[PointPlaces]:
        """Where the points of each source are, by placements of the bodies at n states, shape (n, 12 bodies)."""
        of = self._touching.of
        R = rotations(X)[:, of]
        arms = each_times(R, self._touching.centred)
        points = X.reshape(len(X), -1, 12)[:, of, 9:] + each_times(R, self._touching.arms)
        out = []
        for source, (at, _) in zip(self._sources, self.layout.spans, strict=True):
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
        if active is not self._shares[0]:
            self._shares = active, self._touching.shares(active)
        v, impulse, velocity = np.empty(len(start)), np.empty(len(u)), np.empty(len(u))
        how, merit = kernel.advance(
            *space.read, *space.fixed, state.v, applied, space.memory, start, _NOTHING if mean is None else mean, u, guess,
            _NOTHING if shift is None else shift, active, h, law == "coulomb", *self._places, self._shares[1], self._mu,
            v, impulse, velocity,
        )  # fmt: skip
        if how == kernel.UNDECIDED or not is_finite(v):
            return None
        return VelocityAnswer(v, impulse, self.layout.at_rest if how == kernel.REST else velocity, merit, how != kernel.NEWTON)

    def toward(self, state: State, closes: Array, gap: Array) -> Array:
        """The least displacement in the metric of M that closes the gaps (k,) of some points, by their rates, shape (nv,)."""
        space, out = self._workspace, np.empty(len(state.v))
        pin.crba(self._model, space.data, state.q, WORLD)
        self._kernel.toward(
            *space.read, *space.fixed, out, out, space.memory, *self._places, self._shares[1], self._mu, closes, gap, out
        )
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
        return VelocityAnswer(end, np.zeros(3 * len(self._height)), self._measured(state.q, end)[2], 0.0, True)

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
        X = at.placed if at.ground is self else self._measured(state.q, state.v)[0]
        touching, axes, kernel = self._touching, self._axes, self._kernel
        pushed = np.empty(len(X) // 2)
        kernel.wrenches(X, forces, touching.of, axes, touching.arms, pushed)
        taken = bodies.inverse_dynamics(space, state.q, state.v, a, pushed)
        return kernel.residual(
            X, bodies.velocities(space), bodies.lifts(space), self._gravity, touching.of, axes, touching.arms, self._mu, taken,
            applied, a, forces, u, answer.velocity, h,
        )  # fmt: skip

    def points_of_rows(self, X: Array) -> Array:
        """Velocities of the points for unit velocities of the bodies' rows, shape (p, rows)."""
        turns = self._axes.swapaxes(1, 2) @ rotations(X)[self._touching.of]
        return (turns @ self._touching.of_rows).reshape(3 * len(self._height), -1)

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
        F, P = space.row_forces.copy(), self.points_of_rows(bodies.placements(space))
        moving = State(start.robot, q, v)
        snapshot = self.at(moving, 0.0)
        rows = np.linalg.lstsq(P, snapshot.J, rcond=None)[0]
        off = moving.M @ a + moving.h - applied - rows.T @ F
        size = max(1.0, max_abs(moving.h), max_abs(F))
        self._touching.agrees = max_abs(off) <= _AGREES * size and max_abs((P @ rows - snapshot.J).ravel()) <= _AGREES
        return self._touching.agrees
