"""Which accelerations and speeds along a path are possible: at each of its points a convex set of (u, x) = (s'', s'^2).

    v = q' s',   a = q' s'' + q'' s'^2,   M q' u + (M q'' + C q') x + g = S^T tau + J^T f

is affine in (u, x): torques within limits are half-planes, and contact forces f in circular cones a projection of a convex set.
Half-planes of that come one by one: a conic program finds the point of the set nearest to one that is asked about, in the size
of the forces that (u, x) changes, and the line through it, across the way there, holds the set on one side.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.errors import NoSolution
from rbd.model.checked_model import CheckedModel
from rbd.model.sampled_motion import cubic, interpolated_q
from rbd.motion.contact_timeline import ContactTimeline
from rbd.motion.frame_terms import FrameTerms, placements, wrench_scale
from rbd.motion.reference_motion import Motion
from rbd.problem.conic import Conic, Unknowns
from rbd.problem.programs import Outcome
from rbd.solvers.cone_least_squares import nearest_in_cones
from rbd.solvers.conic_newton import interior_point, solve_conic

TOLERANCE = 1e-4
"""A point is of the set if it is this near to it, in shares of the weight and of torque limits."""
SPARED = 1e-3
"""Share of speed limits that is left to what lies between the points."""
SLACK = 1e-4
"""Share of the weight that each component of the wrench may miss besides: a flight's set would else be a point."""
_MET = 1e-6
_SMOOTH = 1e-4
"""Friction of a floor without any: cones that have an inside."""
_SQUARES = 1e-3
_FLAT = 1e-6
"""Forces that a unit of u changes by no more, over weight and limits: of a path at rest."""
_SPEAKS = 1e-3
"""A motor is in the way if its multiplier is more than this of the largest."""


@dataclass(frozen=True)
class PathLimits:
    """What a timing keeps to.

    Attributes:
        friction: Coulomb's coefficient.
        threshold: Share of the weight that may be missing, where the motion as it was, or the pose at rest, misses it.
        torque: Limits of the motors, shape (nu,), inf where there is none [N m, N].
        speed: Limits of v, shape (nv,), inf where there is none [m/s, rad/s].
        pace: Largest s'.
    """

    friction: float
    threshold: float
    torque: Array
    speed: Array
    pace: float


@dataclass(eq=False)
class PathSet:
    """The set at one point of a path, inside the half-planes known so far; more come with `separate`.

    Attributes:
        normals: Of the half-planes normals . (u, x) <= sides, shape (r, 2).
        sides: Shape (r,).
        causes: What each of them stands for: "fastest", "speed limit of ...", "motor of ...", "balance".
        program: (rows of forces over the weight, rows of (u, x) over `scale`, their lower and upper bounds), of balance, then
            of torques that forces change; None where no force can act: the half-planes are then the set.
        mu: Friction of these forces.
        scale: What (u, x) are divided by there, shape (2,).
        metric: Their inner product, shape (2, 2).
        motors: Names of the motors in the last rows.
        need: What (1, u, x) make of wrench, torques and squared speeds, over weight and limits, shape (3, r).
        missed: What may be missing here, as it is missing in the motion as it was, else at rest, over weight and weight times
            `LENGTH`, shape (6,).
        empty: Whether it was found to be empty.
        known: Points of it that were found.
    """

    normals: Array
    sides: Array
    causes: list[str]
    program: tuple[Array, Array, Array, Array] | None
    mu: float
    scale: Array
    metric: Array
    motors: list[str]
    need: Array
    missed: Array
    empty: bool = False
    known: list[Array] = field(default_factory=list)

    def beyond(self, p: Array) -> float:
        """How far (u, x) is outside the half-planes, over limits; zero or less inside."""
        return float((self.normals @ p - self.sides).max(initial=-np.inf))

    def needs(self, p: Array) -> Array:
        """Wrench, torques and squared speeds at (u, x), over weight and limits, shape (r,)."""
        return np.asarray(self.need[0] + p @ self.need[1:])

    def knows(self, p: Array) -> bool:
        """Whether no program is needed to tell how far (u, x) is outside."""
        return self.program is None or any(np.abs((p - each) / self.scale).max() <= 1e-9 for each in self.known)

    def separate(self, p: Array) -> float:
        """How far (u, x) is outside the set, in shares of weight and limits, zero inside; a half-plane between is added.

        Raises:
            NoSolution: the program was not solved.
        """
        outside = max(self.beyond(p), 0.0)
        if self.program is None or self.knows(p):
            return outside
        forces, pair, low, high = self.program
        z, n = p / self.scale, forces.shape[1]
        cones, mu = np.arange(n).reshape(-1, 3), np.full(n // 3, self.mu)
        blocks = {"forces": Unknowns(n, cones=cones, mu=mu), "p": Unknowns(2, self.metric, -self.metric @ z)}
        posed = Conic.of(blocks, [], [({"forces": forces, "p": pair}, low, high)])
        found = interior_point(posed)
        if found.outcome is not Outcome.NOT_FOUND or posed.outside(found.x) > _MET:
            found = solve_conic(posed, newton=False, tolerance=_MET)
        if found.outcome is Outcome.INFEASIBLE:
            self.empty = True
            return np.inf
        if posed.outside(found.x) > 10.0 * _MET:
            raise NoSolution(f"a program with {n} forces was not solved along the path. Use fewer contacts.")
        off = z - found.x[-2:]
        distance = float(np.sqrt(off @ self.metric @ off))
        if distance <= TOLERANCE:
            self.known.append(p)
            return max(outside, distance)
        normal = self.metric @ off / distance
        torques = np.abs(found.z[len(found.z) - len(self.motors) :])
        most = max(np.abs(found.y).max(initial=0.0), np.abs(found.z).max(initial=0.0))
        loud = torques.max(initial=0.0) > _SPEAKS * most
        self.normals = np.vstack([self.normals, normal / self.scale])
        self.sides = np.append(self.sides, normal @ found.x[-2:])
        self.causes.append(f"motor of {self.motors[int(torques.argmax())]}" if loud else "balance")
        return distance


class PathSets:
    """The sets along a path, made where they are asked for; a place on it counts frames, 2.5 is halfway from frame 2 to 3.

    Attributes:
        motion: The path, with s = t of its frames.
        lanes: Its contacts, or None. Between two frames a point touches that does so in one of them.
        limits: What is kept to.
        programs: How many programs were solved.
    """

    def __init__(self, motion: Motion, lanes: ContactTimeline | None, limits: PathLimits) -> None:
        self.motion, self.lanes, self.limits = motion, lanes, limits
        self.programs = 0
        self._sets: dict[float, PathSet] = {}

    def time(self, places: Array) -> Array:
        """S of places, shape (m,) [s]."""
        return np.interp(places, np.arange(self.motion.n), self.motion.t)

    def path(self, s: Array) -> tuple[Array, Array, Array]:
        """(q, q', q'') at s, shapes (m, nq), (m, nv), (m, nv): as `Motion.resample` has them."""
        m = self.motion
        q2 = np.stack([np.interp(s, m.t, each) for each in m.a.T], axis=1)
        return interpolated_q(m.robot, m.t, m.q, m.v, s), cubic(m.t, m.v, m.a, s), q2

    def touches(self, places: Array, what: str = "touches") -> Array:
        """Which points touch, or what else the lanes say of them, at places, shape (m, k)."""
        given = getattr(self.lanes, what)
        low, high = np.floor(places).astype(int), np.ceil(places).astype(int)
        return np.asarray(given[low] | given[high])

    def points_at(self, q: Array) -> Array:
        """Where the contact points are, shape (m, k, 3) [m]."""
        assert self.lanes is not None
        return self.lanes.points.places(*placements(self.motion.robot, q))

    def at(self, places: Array) -> list[PathSet]:
        """The sets at places on the path."""
        new = np.array(sorted({float(x) for x in places} - self._sets.keys()))
        for begin in range(0, len(new), 512):
            part = new[begin : begin + 512]
            self._sets.update(zip(part.tolist(), self._made(part), strict=True))
        return [self._sets[float(x)] for x in places]

    def separate(self, places: Array, p: Array) -> Array:
        """`PathSet.separate` of many, shape (m,)."""
        sets = self.at(places)
        self.programs += sum(not each.knows(x) for each, x in zip(sets, p, strict=True))
        return np.array([each.separate(x) for each, x in zip(sets, p, strict=True)])

    def stands(self, place: float) -> float:
        """How far the robot at rest there is outside the set."""
        return float(self.separate(np.array([place]), np.zeros((1, 2)))[0])

    def _made(self, places: Array) -> list[PathSet]:
        robot, limits = self.motion.robot, self.limits
        path = self.path(self.time(places))
        rows = self.rows(*path)
        known = np.isfinite(limits.torque)
        full = np.where(known, limits.torque, 1.0)
        contact = self._contacts(places, path, rows, full)
        torque = rows[:, :, robot.actuated] / full
        speed = np.square(path[1] / ((1.0 - SPARED) * limits.speed))
        return [self._one(torque[i], speed[i], known, *(each[i] for each in contact)) for i in range(len(places))]

    def _contacts(self, places: Array, path: tuple[Array, Array, Array], rows: Array, full: Array) -> tuple[Array, ...]:
        """(wrench of 1, u, x (m, 3, 6), A (m, 6, k, 3), T (m, nu, k, 3), touching (m, k), missed (m, 6)), over weight, limits.

        Forces w over the weight have the wrench A w, and carry T w of the torques. Without a floating base there are none.
        """
        robot, m = self.motion.robot, len(places)
        if not robot.floating:
            nothing = np.zeros((m, 0))
            return np.zeros((m, 3, 0)), np.zeros((m, 0, 0, 3)), np.zeros((m, robot.nu, 0, 3)), nothing.astype(bool), nothing
        assert self.lanes is not None
        terms, scale = FrameTerms.of(robot, *path, None), wrench_scale(robot)
        base = np.stack([terms.to_wrench(rows[:, i, :6]) for i in range(3)], axis=1) / scale
        touching, at, missed = self.touches(places), self.points_at(path[0]), np.zeros((m, 6))
        A = terms.wrench_map(at, touching) * (scale[0] / scale)[:, None, None]
        for need in (base[:, 0], base[:, 0] + base[:, 2]):  # at rest; as it was
            left = nearest_in_cones(A, need, self.limits.friction).left
            over = np.linalg.norm(left, axis=1) / max(self.limits.threshold, 1e-12)
            # all up to the threshold, none from twice that; no jump, and never more than the threshold
            share = np.clip(2.0 - over, 0.0, 1.0)[:, None]
            missed = share / np.maximum(over, 1.0)[:, None] * left + (1.0 - share) * missed
        base[:, 0] -= missed
        T = terms.joint_map(self.lanes.points.joint, at, touching, robot.actuated) * (scale[0] / full)[:, None, None]
        return base, A, T, touching, missed

    def _one(
        self, torque: Array, speed: Array, known: Array, base: Array, A: Array, T: Array, touching: Array, missed: Array
    ) -> PathSet:
        """The set at a place, of torques over limits (3, nu), squared speeds over limits (nv,) of x = 1, and `_contacts`."""
        limits, names = self.limits, self.motion.robot.actuated_names
        carried = np.asarray((np.abs(T) > 0.0).any(axis=(1, 2)))
        own, some = np.flatnonzero(known & ~carried), np.flatnonzero(known & carried)
        t, K = torque[0, own], torque[1:, own].T
        normals, sides = [K, -K, np.array([[0.0, -1.0], [0.0, limits.pace**-2.0]])], [1.0 - t, 1.0 + t, np.array([0.0, 1.0])]
        causes = 2 * [f"motor of {names[j]}" for j in own] + ["rest", "fastest"]
        if speed.any():
            j = int(speed.argmax())
            normals, sides = [*normals, np.array([[0.0, speed[j]]])], [*sides, np.ones(1)]
            causes.append(f"speed limit of {_coordinate(self.motion.robot, j)}")
        G, b = base[1:].T, base[0]
        if len(b) and not touching.any():
            normals, sides = [*normals, G, -G], [*sides, SLACK - b, SLACK + b]
            causes += 2 * len(b) * ["balance"]
        changed = np.concatenate([G, torque[1:, known].T])
        unit = 1.0 / np.maximum(np.linalg.norm(changed, axis=0), _FLAT)
        metric, program = (changed * unit).T @ (changed * unit) + _SQUARES * np.eye(2), None
        if k := int(touching.sum()):
            forces = np.concatenate([A[:, touching].reshape(6, -1), -T[some][:, touching].reshape(len(some), 3 * k)])
            pair, one = np.concatenate([-G, torque[1:, some].T]) * unit, np.ones(len(some))
            low, high = (np.append(b + sign * SLACK, sign * one - torque[0, some]) for sign in (-1.0, 1.0))
            program = forces, pair, low, high
        mu, motors = max(limits.friction, _SMOOTH), [names[j] for j in some]
        need = np.hstack([base + np.outer([1.0, 0.0, 0.0], missed), torque[:, known], np.outer([0.0, 0.0, 1.0], speed)])
        return PathSet(np.concatenate(normals), np.concatenate(sides), causes, program, mu, unit, metric, motors, need, missed)

    def rows(self, q: Array, q1: Array, q2: Array) -> Array:
        """Generalised forces that contacts and motors must come to, of 1, u and x, shape (m, 3, nv) [N, N m]."""
        model, nothing = self.motion.robot.model, np.zeros(self.motion.robot.nv)
        data, out = model.createData(), np.empty((len(q), 3, self.motion.robot.nv))
        for i in range(len(q)):
            out[i, 0] = pin.rnea(model, data, q[i], nothing, nothing)
            out[i, 1] = pin.rnea(model, data, q[i], nothing, q1[i])
            out[i, 2] = pin.rnea(model, data, q[i], q1[i], q2[i])
        out[:, 1:] -= out[:, :1]
        return out


def _coordinate(robot: CheckedModel, v: int) -> str:
    """The joint of a coordinate of v."""
    return next(joint.name for joint in robot.joints.values() if joint.v.start <= v < joint.v.stop)
