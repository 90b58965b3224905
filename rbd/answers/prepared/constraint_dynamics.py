"""Answers from the few rows of the bodies and joints that constraints touch; constants are computed once.

A *plan* belongs to a robot and its constraints: where their columns are (`rbd.answers.prepared.law_kernel`), and the rows of
each body in contact: three at a single point, five of points on a line, else six. Then at each state

    rows        from Pinocchio's M, h, joint Jacobians and body accelerations: J M^-1 J^T and their accelerations without forces
    forces      all that rest: of least norm, if these are in their sets; else Newton's method on those rows
    certificate `pin.rnea` at (q, v, a) with the forces of the columns on their bodies, from arrays of its own

Of joints that are driven, with accelerations e at a time, all of this is done for a - e: J_dot v and h are those of the motion
with the accelerations e, from `pin.rnea`, and the rows of the drives hold as those of locks.

M, J and J_dot v, and the factors that found the answer, take no part in the certificate. What is not covered gets None, and is
solved the general way: what rolls, terrain, feedback, constraints of a user's own.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from itertools import accumulate
from types import ModuleType
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import pinocchio as pin

from rbd.answers.analysis.force_choice import MINIMUM_NORM, UNIQUE
from rbd.answers.prepared.constraint_columns import Column, JointColumn, Source, elements_of, law_kernel, site_of, source_of
from rbd.answers.prepared.contact_bodies import (
    MOST,
    OF_BASE,
    OF_BASE_TWO,
    OF_LINK,
    WORLD,
    JointEntry,
    Site,
    Workspace,
    Workspaces,
    keep,
    plane_gaps,
    value_of,
)
from rbd.arrays import Array, max_abs
from rbd.constraints.constraint import OPEN
from rbd.constraints.joint import JointLimit
from rbd.constraints.loop import LoopClosure
from rbd.model.checked_model import CheckedModel
from rbd.model.external import ExternalForce
from rbd.problem.cones import NonNegative
from rbd.problem.contact_motion import Opening
from rbd.problem.force_set import at_rest
from rbd.problem.ground import motion_of

METHODS = ("closed form", "cones: Newton")
"""Of constraints that are held or stick, and of those that slip or open."""
DOUBTFUL = 1e-6
"""Upper bounds of the scaled residuals above this are not looked into: the general way is taken."""


class FoundForces(NamedTuple):
    """Acceleration and forces under a law.

    Attributes:
        a: Acceleration, shape (nv,).
        forces: Row forces, shape (m,), in the order and axes of the constraints' rows.
        weights: Of the columns of their force set, shape (p,); None where all are bilateral.
        method: What found them.
        steps: Newton's steps.
        worst: Upper bound of its largest scaled residual. Above `SOLVED` the scales themselves have to judge.
        moving: (number, speed [m/s, rad/s]) of bilateral constraints that move faster than the rest speed.
        openings: Points that separate.
        choice: Which forces these are of those with the same motion; empty for any.
    """

    a: Array
    forces: Array
    weights: Array | None
    method: str
    steps: int = 0
    worst: float = 0.0
    moving: tuple[tuple[int, float], ...] = ()
    openings: tuple[Opening, ...] = ()
    choice: str = UNIQUE


@cache
def certificate_kernel() -> ModuleType:
    """`rbd.answers.prepared.certificate_kernel`, likewise."""
    from rbd.answers.prepared import certificate_kernel

    return certificate_kernel


Loads: TypeAlias = tuple[Array, Array]
_UNLOADED: Loads = np.empty((0, 2), np.int64), np.empty((0, 9))
_NOT_MOVING: tuple[tuple[int, float], ...] = ()
_NOT_OPEN: tuple[Opening, ...] = ()


class Found(NamedTuple):
    """What a plan finds at one state.

    Attributes:
        a: Acceleration, shape (nv,).
        w: Weights of the columns of the constraints at rest, shape (p,).
        u: Velocities of these columns.
        modes: What each element does, of `law_kernel`.
        how: How it was found, of `law_kernel`.
        steps: Newton's steps.
        dependent: Whether rows depend on each other.
    """

    a: Array
    w: Array
    u: Array
    modes: Array
    how: int
    steps: int
    dependent: bool


class Plan(Workspaces):
    """Constraints of one robot with rows that are the same at each state, prepared.

    Args:
        robot: The robot.
        sources: The constraints' sets of forces, and what forces of unit weight do.
    """

    def __init__(self, robot: CheckedModel, sources: Sequence[Source]) -> None:
        self._robot, self.sources = robot, sources
        self.force_set = at_rest(*[source.cone for source in sources])
        self.bilateral, G = self.force_set.bilateral, self.force_set.G
        self._of_points = G.shape[0] == G.shape[1] and bool((G == np.eye(len(G))).all())
        self._kernel = law_kernel()
        self._per_inertia, self._fall = 1.0 / robot.least_inertia, np.array(robot.model.gravity.linear)
        self._place([column for source in sources for column in source.columns])
        self._stand()
        columns = list(accumulate((len(source.columns) for source in sources), initial=0))
        self._drives = [
            (j, self._robot.joints[s.drive.joint].v.start, s.drive) for j, s in zip(columns, sources, strict=False) if s.drive
        ]
        super().__init__(robot.model, self._sites, self._units)

    @classmethod
    def of(cls, robot: CheckedModel, constraints: Sequence[object]) -> Plan:
        """That of constraints which are all covered, none of them a limit."""
        return cls(robot, [source for c in constraints if (source := source_of(robot, c)) is not None])

    def _place(self, found: Sequence[Column | JointColumn]) -> None:
        """The rows; the columns in them, and for the certificate in the axes of their joints; what elements they are."""
        bodies = dict[tuple[object, ...], list[tuple[int, Column]]]()
        for j, column in enumerate(found):
            if isinstance(column, Column):
                bodies.setdefault((column.joint, column.base, column.motion, column.closes, column.ground), []).append(
                    (j, column)
                )
        p, self._sites, self._units, m = len(found), list[Site](), list[JointEntry](), 0
        self._grounds = [(k, c[0][1].ground) for k, c in enumerate(bodies.values()) if c[0][1].ground is not None]
        place, own = (
            self._kernel.Columns(*(np.zeros((p, 3)) for _ in range(4)), np.zeros((p, 5), np.int64)) for _ in ("place", "own")
        )
        kernel, motions = self._kernel, list[tuple[float, ...]]()
        for members in bodies.values():
            site = site_of([c for _, c in members])
            R, by_rows = site.X_JC.rotation, site.axes in (OF_BASE, OF_BASE_TWO, OF_LINK)
            for i, (j, c) in enumerate(members):
                turned = R.T @ c.force if c.axes == kernel.BODY else c.force
                moment = c.moment if c.axes >= kernel.EDGE else R.T @ c.moment
                _write(place, j, turned, moment, site.X_JC.actInv(c.point), R.T @ c.along)
                _write(own, j, c.force, c.moment, c.point, c.along)
                place.body[j] = len(self._sites), kernel.ROWS if by_rows else c.axes, m, site.size, 0
                if by_rows:
                    place.force[j, 0] = i
                own.body[j] = c.joint, c.axes, c.base, len(motions), by_rows
            self._sites.append(site)
            motions.append((*site.motion, *site.turn, *R.ravel()))
            m += site.size
        rows, entries, self._core = dict[JointColumn, int](), list[tuple[int, int, float]](), m
        of_joints = [(j, torques) for j, torques in enumerate(found) if not isinstance(torques, Column)]
        for j, torques in sorted(of_joints, key=lambda each: not self.force_set.is_line[each[0]]):  # bilateral ones first
            gear = torques[0][1]
            row = tuple([(dof, x / gear) for dof, x in torques])
            if row not in rows:
                rows[row] = m
                self._units += [JointEntry(m, dof, x) for dof, x in row]
                m += 1
            place.force[j, 0] = gear
            place.body[j], own.body[j] = (-1, 0, rows[row], 1, 0), (-1, 0, 0, 0, 0)
            entries += [(j, dof, x) for dof, x in torques]
            self._core = m if self.force_set.is_line[j] else self._core
        self._m, self._columns = m, place
        at, gears = np.array([e[:2] for e in entries], np.int64).reshape(-1, 2), np.array([e[2] for e in entries], float)
        self.own = *own, at, gears, np.reshape(motions, (-1, 45))
        self.elements, self._closed = elements_of(self._kernel.Elements, self.force_set, place, m)
        self.repeated = len(self.force_set.G) > m

    def _stand(self) -> None:
        """The gaps of contacts on planes whose place is known."""
        contacts = [contact for source in self.sources for contact in source.contacts]
        joints = sorted({self._robot.site(contact.frame)[0] for contact in contacts if contact.plane is not None})
        self._gaps, self._heights = plane_gaps(self._robot, contacts, joints)
        self.corner_entries = (12 * np.array(joints, int)[:, None] + np.arange(12)).ravel()

    def off_plane(self, X: Array) -> Any:
        """Largest distance of a corner from the plane on which it stands, where that is known, shape (...) [m].

        Args:
            X: Placements of the bodies with such corners, shape (..., 12 bodies).
        """
        return np.abs(X @ self._gaps.T - self._heights).max(axis=-1, initial=0.0)

    def answer(
        self,
        q: Array,
        v: Array,
        generalised: Array,
        pushes: Sequence[ExternalForce] = (),
        *,
        coulomb: bool,
        rest_speed: float,
        within: float,
        mu: Array | None = None,
        t: float = 0.0,
    ) -> FoundForces | None:
        """Acceleration and forces under a contact law, certified; None where the general way has to be taken.

        Args:
            q: Configuration, shape (nq,).
            v: Velocity, shape (nv,).
            generalised: S^T tau, and tau_ext but for the pushes, shape (nv,).
            pushes: Forces of the world.
            coulomb: Coulomb's law; else the convex one.
            rest_speed: Up to this speed a contact is at rest [m/s, rad/s].
            within: If a corner is farther off its plane, the general way is taken [m].
            mu: Friction of the cones; None: the constraints' own.
            t: Time, for drives [s].
        """
        driven, rates = self._driven(t) if self._drives else (None, ())
        own = self._own_at(t) if self._grounds else self.own
        loads, elements = self.loads(pushes), self.elements if mu is None else self.elements._replace(mu=self.friction(mu))
        space, misses = self.taken(), np.empty(5)
        for k, _ in self._grounds:
            space.sites[k, 12:24] = own[-1][k, :12]
        try:
            found = self.search(space, q, v, generalised, rest_speed, coulomb, elements, loads, driven=driven)
            if found is None:
                return None
            for j, rate in rates:
                found.u[j] -= rate
            worst = self.judged(space, q, v, generalised, found, rest_speed, coulomb, elements, loads, misses, own, driven)
            if not misses[4] <= OPEN:
                return None
            gaps = self._gaps.dot(space.places[self.corner_entries]) - (self._heights_at(t) if self._grounds else self._heights)
            if len(gaps) and not max_abs(gaps) <= within:
                return None
        finally:
            self.put_back(space)
        if not worst <= DOUBTFUL:
            return None
        w, forces = found.w, found.w.copy() if self._of_points else self.force_set.G.dot(found.w)
        moving, openings = _NOT_MOVING, _NOT_OPEN
        if found.u.dot(found.u) > rest_speed * rest_speed:
            moving, openings = self._moving(found.u, rest_speed), self._openings(found.modes, found.u)
            w = self._weights(found.modes, w)
        choice = UNIQUE
        if self.repeated or found.dependent:
            choice = MINIMUM_NORM if found.how == self._kernel.HELD and not found.dependent else ""
        return FoundForces(
            found.a, forces, None if self.bilateral else w, METHODS[found.how], found.steps, worst, moving, openings, choice
        )  # fmt: skip

    def _own_at(self, t: float) -> tuple[Array, ...]:
        """`own` at a time, with the motions of ground that follows one."""
        motions = self.own[-1].copy()
        for k, ground in self._grounds:
            motions[k, :12] = np.concatenate(motion_of(ground.at(t)))
        return *self.own[:-1], motions

    def _heights_at(self, t: float) -> Array:
        """Heights of the planes at a time."""
        on = [c.plane for source in self.sources for c in source.contacts if c.plane is not None for _ in c.corners]
        return np.array([ground.at(t).height for ground in on])

    def _driven(self, t: float) -> tuple[Array, list[tuple[int, float]]]:
        """Accelerations e at a time, shape (nv,), and (column, speed) of the drives.

        Raises:
            InputError: of their motions.
        """
        e, rates = np.zeros(self._robot.nv), []
        for j, dof, drive in self._drives:
            _, rate, e[dof] = drive.motion_at(t).tolist()
            rates.append((j, rate))
        return e, rates

    def friction(self, mu: Array) -> Array:
        """Friction of the elements, shape (..., e), with that of the cones replaced, shape (..., cones)."""
        out = np.zeros((*mu.shape[:-1], len(self.elements.mu)))
        out[..., self.elements.mu > 0.0] = mu
        return out

    def loads(self, pushes: Sequence[ExternalForce]) -> Loads:
        """Of pushes, as `law_kernel.answer` takes them.

        Raises:
            FrameNotFound: with the nearest names.
        """
        if not pushes:
            return _UNLOADED
        model, joints, values = self._robot.model, np.empty((len(pushes), 2), np.int64), np.empty((len(pushes), 9))
        for e, push in enumerate(pushes):
            joint, X_JF = self._robot.site(push.frame)
            joints[e] = joint, model.idx_vs[joint] + model.nvs[joint] - 1
            values[e, :3], values[e, 3:6], values[e, 6:] = push.force, push.moment, X_JF.act(np.asarray(push.offset))
        return joints, values

    def search(
        self, space: Workspace, q: Array, v: Array, generalised: Array, rest_speed: float, coulomb: bool, elements: Any,
        loads: Loads, into: Sequence[Array] = (), driven: Array | None = None,
    ) -> Found | None:  # fmt: skip
        """What obeys the law at one state, not yet certified; None where nothing is known.

        Args:
            space: Used.
            q: As of `answer`, as are the next four.
            v: As there.
            generalised: As there.
            rest_speed: As there.
            coulomb: As there.
            elements: As `elements`, with the friction at this state.
            loads: Of `loads`.
            into: Arrays for a, w, u and modes; else new ones.
            driven: Accelerations e of driven joints, shape (nv,).
        """
        model, data, kernel = self._robot.model, space.data, self._kernel
        p = 0 if into else self.force_set.size
        a, w, u, modes = into or (np.empty(len(v)), np.empty(p), np.empty(p), np.zeros(len(elements.first), np.int64))
        if not self._m and loads is _UNLOADED:
            a[:] = pin.aba(model, data, q, v, generalised)
            return Found(a, w, u, modes, kernel.HELD, 0, False)
        pin.crba(model, data, q, WORLD)
        if driven is None:
            pin.nonLinearEffects(model, data, q, v)
        else:
            space.read[2][:] = pin.rnea(model, data, q, v, driven)
        how, steps, dependent = kernel.answer(
            *space.read, *space.fixed, v, generalised, space.memory, *loads, *self._columns, *elements, self._core, rest_speed,
            coulomb, self._closed, self.repeated, a, w, modes, u,
        )  # fmt: skip
        if driven is not None:
            a += driven
        return None if how == kernel.NOTHING else Found(a, w, u, modes, how, steps, dependent)

    def judged(
        self, space: Workspace, q: Array, v: Array, generalised: Array, found: Found, rest_speed: float, coulomb: bool,
        elements: Any, loads: Loads, misses: Array, own: tuple[Array, ...] | None = None, driven: Array | None = None,
    ) -> float:  # fmt: skip
        """An upper bound of the largest scaled residual; those of the equations are written.

        Args:
            space: As `search` left it; or with the places of all joints.
            q: As of `search`, as are the next two.
            v: As there.
            generalised: As there.
            found: What is judged: its a and w.
            rest_speed: As there, as are the next three.
            coulomb: As there.
            elements: As there.
            loads: As there.
            misses: Written: of stationarity, feasibility, cone and complementarity, and how far
                loops are open, shape (5,).
            own: The columns with the motions of the ground at a time, in place of its own.
            driven: As there.
        """
        own = self.own if own is None else own
        (X, twists, lifts), torque = space.read[3:], np.empty(len(v))
        kernel = certificate_kernel()
        kernel.act(*loads, *own, X, found.w, space.pushes.reshape(-1, 6), torque)
        left = pin.rnea(self._robot.model, space.data, q, v, found.a, space.forces)
        worst: float = kernel.judged(
            left, generalised, torque, self._per_inertia, found.a if driven is None else found.a - driven, v, found.w,
            *own, *elements, X, twists, lifts, self._fall, rest_speed, coulomb, misses,
        )  # fmt: skip
        return worst

    def all_judged(
        self, space: Workspace, q: Array, v: Array, generalised: Array, a: Array, w: Array, X: Array, mu: Array,
        rest_speed: float, coulomb: bool, loads: Loads, misses: Array,
    ) -> Array:  # fmt: skip
        """As `judged` at n states, shape (n,), at which all joints have the places X, shape (n, 12 joints)."""
        n, places, kernel, model = len(q), X.reshape(len(q), -1, 12), certificate_kernel(), self._robot.model
        pushes, twists, lifts = (np.empty((n, len(space.pushes))) for _ in range(3))
        torque, left, worst = np.empty(v.shape), np.empty(v.shape), np.empty(n)
        kernel.act_on_all(*loads, *self.own, places, w, pushes.reshape(n, -1, 6), torque)
        states = zip(q, v, a, pushes, left, twists, lifts, strict=True)
        for q_i, v_i, a_i, pushed, missing, twist, lift in states:
            space.pushes[:] = pushed
            missing[:] = pin.rnea(model, space.data, q_i, v_i, a_i, space.forces)
            twist[:], lift[:] = space.rates, space.lifts
        kernel.all_judged(
            left, generalised, torque, self._per_inertia, a, v, w, *self.own, *self.elements._replace(mu=mu),
            places, twists.reshape(n, -1, 6), lifts.reshape(n, -1, 6), self._fall, rest_speed, coulomb, misses,
            worst,
        )  # fmt: skip
        return worst

    def _moving(self, u: Array, rest_speed: float) -> tuple[tuple[int, float], ...]:
        """(number, speed) of bilateral constraints that move."""
        each = enumerate(zip(self.sources, self.force_set.slices, strict=True))
        speeds = [(i, max_abs(u[columns])) for i, (source, columns) in each if source.cone.bilateral]
        return tuple([(i, speed) for i, speed in speeds if speed > rest_speed])

    def _openings(self, modes: Array, u: Array) -> tuple[Opening, ...]:
        """Points that separate."""
        elements, out = self.force_set.elements, list[Opening]()
        for i in np.flatnonzero(modes == self._kernel.OPENS).tolist():
            e = elements[i]
            of = sum(other.rows == e.rows for other in elements)
            out.append(Opening(self.sources[e.rows].name, e.number, of, float(u[e.columns][-1])))
        return tuple(out)

    def _weights(self, modes: Array, w: Array) -> Array:
        """Weights of the force set of moving rows: of a point that slides or opens, its normal weight alone."""
        kept = np.ones(len(w), bool)
        for mode, e in zip(modes.tolist(), self.force_set.elements, strict=True):
            if mode in (self._kernel.SLIDES, self._kernel.OPENS) and e.is_cone:
                kept[e.columns.start : e.columns.start + 2] = False
        return w[kept]


def _write(columns: Any, j: int, *vectors: Array) -> None:
    columns.force[j], columns.moment[j], columns.arm[j], columns.along[j] = vectors


class ConstraintDynamics:
    """Constraints of one robot, prepared: a `Plan` for each set of joint limits that are reached, and ropes that are taut.

    Args:
        robot: The robot.
        sources: Of the constraints, None of a joint limit.
        limits: The joint limits, by their numbers.
        ropes: The ropes of known length, likewise.

    Attributes:
        on_still_ground: Whether all act between one body and ground at rest, as forces that are constant in axes; no drive.
    """

    def __init__(
        self,
        robot: CheckedModel,
        sources: Sequence[Source | None],
        limits: Mapping[int, JointLimit],
        ropes: Mapping[int, LoopClosure],
    ) -> None:
        self._robot, self.sources, self._limits, self._ropes = robot, sources, limits, ropes
        self._ends = [(robot.site(rope.frame_a), robot.site(rope.frame_b)) for rope in ropes.values()]
        self._spaces = Workspaces(robot.model, [])
        known = [source for source in sources if source is not None]
        columns = [c for source in known for c in source.columns if isinstance(c, Column)]
        still = all(c.base < 0 and c.axes <= law_kernel().EDGE for c in columns)
        self.on_still_ground = still and not any(source.drive for source in known)
        stops = [limit.stop(robot) for limit in limits.values()]
        self._q = np.array([stop.q for stop in stops], int)
        self._low, self._high = np.array([s.lower for s in stops]), np.array([s.upper for s in stops])
        self._margin = np.array([limit.margin for limit in limits.values()])
        self._dofs, self._plans = [stop.v for stop in stops], dict[bytes, Plan]()
        self._plain = None if limits or ropes else Plan(robot, sources)  # type: ignore[arg-type]

    def plans(self, q: Array) -> Iterator[tuple[Plan, Array]]:
        """The plans of configurations, shape (n, nq), each with the numbers of its states."""
        if self._plain is not None:
            yield self._plain, np.arange(len(q))
        elif len(q):
            _, first, which = np.unique(self._reached(q), axis=0, return_index=True, return_inverse=True)
            for k, at in enumerate(first.tolist()):
                yield self.plan(q[at]), np.flatnonzero(which.ravel() == k)

    def _reached(self, q: Array) -> Array:
        """Which limits are reached, the lower ones first, and which ropes taut, shape (..., 2 limits + ropes), truth values."""
        x = q[..., self._q]
        taut = np.empty((*q.shape[:-1], len(self._ropes)), bool)
        if self._ropes:
            with self._spaces.workspace() as space:
                for each, into in zip(q.reshape(-1, q.shape[-1]), taut.reshape(-1, len(self._ropes)), strict=True):
                    into[:] = self._taut(space, each)
        return np.concatenate([x - self._low <= self._margin, self._high - x <= self._margin, taut], axis=-1)

    def _taut(self, space: Workspace, q: Array) -> list[bool]:
        """Which ropes are as long as they are, to their margins."""
        pin.forwardKinematics(self._robot.model, space.data, q)
        at, out = space.data.oMi, []
        for rope, ((a, X_a), (b, X_b)) in zip(self._ropes.values(), self._ends, strict=True):
            far = float(np.linalg.norm(at[b].act(X_b.translation) - at[a].act(X_a.translation)))
            out.append(rope.slack_by(far) <= rope.margin)
        return out

    def plan(self, q: Array) -> Plan:
        """That of the joint limits reached, and the ropes taut, at q."""
        if self._plain is not None:
            return self._plain
        sides = self._reached(q)
        key = sides.tobytes()
        found = self._plans.get(key)
        if found is None:
            sources, n = list(self.sources), len(self._q)
            for k, (number, limit) in enumerate(self._limits.items()):
                signs = [sign for sign, at in ((1.0, sides[k]), (-1.0, sides[n + k])) if at]
                columns = [((self._dofs[k], sign),) for sign in signs]
                sources[number] = Source(limit.name, NonNegative(len(signs)), columns)
            for (number, rope), taut in zip(self._ropes.items(), sides[2 * n :], strict=True):
                if not taut:
                    sources[number] = Source(rope.name, NonNegative(0), [])
            found = Plan(self._robot, sources)  # type: ignore[arg-type]
            keep(self._plans, key, found, MOST)
        return found


def prepared(robot: CheckedModel, constraints: tuple[object, ...]) -> ConstraintDynamics | None:
    """The prepared form of a robot's constraints, kept with the robot; None where they are not covered.

    Raises:
        FrameNotFound: with the nearest names.
    """
    key, known = (ConstraintDynamics, constraints), robot.kept
    try:
        return known[key]
    except KeyError:
        pass
    except TypeError:  # objects that cannot be keys
        return None
    same = value_of(constraints)  # they are often made anew
    try:
        found: Any = known.pop(same, same)
    except TypeError:  # with a set of forces of a user's own, which cannot be a key
        found = same = key
    if found is same:
        found = _covered(robot, constraints) if robot.sound else None
    for each in (same, key):
        keep(known, each, found, MOST)
    return found


def _covered(robot: CheckedModel, constraints: tuple[object, ...]) -> ConstraintDynamics | None:
    """The form made; None of constraints that it does not cover."""
    limits = {i: c for i, c in enumerate(constraints) if type(c) is JointLimit}
    ropes = {i: c for i, c in enumerate(constraints) if type(c) is LoopClosure and c.can_be_slack}
    sources = [None if i in limits else source_of(robot, c) for i, c in enumerate(constraints)]
    names = {getattr(c, "name", None) for c in constraints}
    covered = len(names) == len(constraints) and all(s is not None or i in limits for i, s in enumerate(sources))
    covered &= _drives_alone([s for s in sources if s is not None], [limit.stop(robot).v for limit in limits.values()])
    return ConstraintDynamics(robot, sources, limits, ropes) if covered else None


def _drives_alone(sources: Sequence[Source], stops: Sequence[int]) -> bool:
    """Whether nothing else has a row of a joint that is driven: its row, of a - e, would be another's."""
    rows = [(s.drive is not None, c) for s in sources for c in s.columns if not isinstance(c, Column)]
    driven = [dof for drives, torques in rows if drives for dof, _ in torques]
    others = [dof for drives, torques in rows if not drives for dof, _ in torques]
    return len(set(driven)) == len(driven) and not set(driven) & {*others, *stops}
