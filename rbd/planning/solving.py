"""Poses and forces of a plan at its knots: the centroid's program and whole-body poses in turn, until they agree."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, lazy
from rbd.centroid import CentroidCosts, CentroidPlan, CentroidProgram
from rbd.centroid.program import inner_corners
from rbd.errors import NoSolution
from rbd.model.sampled_motion import interpolated_q
from rbd.motion.frame_terms import carriers, numbers_of, placements
from rbd.motion.ground_clearance import OverGround
from rbd.motion.reference_motion import minimum_jerk
from rbd.motion.repair.feet import Feet, blend, blurred
from rbd.motion.repair.forces import torque_rows, wrenches_on
from rbd.motion.repair.posture import LIMIT_ROOM, Goals, Reference, posed
from rbd.motion.repair.sweep import Sweep
from rbd.motion.self_collision import BodyPairs
from rbd.planning.curve import Curve
from rbd.planning.kept_limits import joint_limits
from rbd.planning.stays import PlannedContacts, coefficient_of

STIFFNESS, TURNS = (0.3, 0.7, 1.0, 1.0, 1.0, 1.0), (4, 3, 3, 3, 3, 6)
AIR = 8
"""How stiffly poses follow the plan's forces, from pass to pass; steps of Gauss-Newton in each; and
how many more passes as the last but one there are where nothing stands for a time."""
FLYING = 5.0
"""What is missing on the base weighs so much more where nothing stands: no force takes up the rest."""
FOLLOWS = 0.6
"""From pass to pass the plan's centre of mass stays nearer to that of the poses, by this: legs do not become longer."""
HELD = 1e-6
"""What a joint's unit of speed changes by less than this, of the momentum and the angular momentum over the mass, is held."""
UNLOADS = 0.15
"""How long contacts take to come to the least with which they press [s]."""
SETTLED, AGREES = 1e-6, 1e-4
"""Where the last step of a pass is shorter [m, rad], and the plan's centre of mass is so near to the poses' [m], both agree."""
SHRINKS, MORE = 0.8, 20
"""As long as a pass makes that distance smaller by a fifth or more, another one follows; 20 at most."""
NEARER = LIMIT_ROOM - 2e-3
"""Where keyframes have joints so, they come nearer to their limits than elsewhere, by this at most [rad]: least squares leave a
little. Keyframes at the ends are met exactly."""
ENDS = 0.1
"""Within this the first and the last poses come to those of keyframes, which least squares do not meet exactly [s]."""
NEAR, NEAR_FLIGHTS, KEPT = 200.0, 20.0, 1e6
"""Poses of keyframes, those of plans with flights, and those at the ends weigh so much more than those of other knots."""


@dataclass(frozen=True, eq=False)
class Knots:
    """Times of a plan, with its contacts there.

    Attributes:
        supports: The contacts.
        t: Equal times, shape (n,) [s].
        friction: Share of the friction that is used.
        inner: Share of soles that is used.
        loaded: Points press with this share of what they carry of the weight on average, at least, where that is possible.
        torques: (least, most) torques at velocities.
        bodies: Pairs of bodies that are kept apart.
        over: Links that are kept off the ground.
        costs: Of the centroid's program.
    """

    supports: PlannedContacts
    t: Array
    friction: float
    inner: float
    loaded: float
    torques: Callable[[Array], tuple[Array, Array]]
    bodies: BodyPairs | None
    over: OverGround | None
    costs: CentroidCosts

    @property
    def dt(self) -> float:
        """Time between two of them [s]."""
        return float(self.t[1] - self.t[0])

    @lazy
    def q(self) -> Array:
        """The reference: from keyframe to keyframe with minimum jerk."""
        keys, robot = self.supports.keys, self.supports.robot
        way = minimum_jerk(robot, [state.q for _, state in keys], np.array([t for t, _ in keys]), rate=1.0 / self.dt)
        return np.asarray(interpolated_q(robot, way.t, way.q, way.v, self.t.clip(way.t[0], way.t[-1])))

    @lazy
    def feet(self) -> Feet:
        """The contacts along the reference."""
        return Feet.of(self.supports.robot, self.supports.contacts, self.q, self.dt)

    @lazy
    def on(self) -> Array:
        """Which contacts stand, shape (n, contacts)."""
        return self.supports.on(self.t)

    @lazy
    def carries(self) -> Array:
        """Which contacts may carry, shape (n, contacts): not at the ends of a stay, so that forces do not jump there."""
        on = np.pad(self.on, ((1, 1), (0, 0)), mode="edge")
        return np.asarray(on[:-2] & on[1:-1] & on[2:])

    @lazy
    def least(self) -> Array:
        """What points press with at least, shape (n, k) [N]: contacts with `loaded` of their share of the weight."""
        from scipy.ndimage import distance_transform_edt

        idle = np.pad(~self.carries, ((1, 1), (0, 0)), mode="edge")
        since = np.stack([distance_transform_edt(~x) if x.any() else np.full(len(x), np.inf) for x in idle.T], axis=1)[1:-1]
        ramp = np.minimum(since * self.dt / UNLOADS, 1.0)
        robot, corners = self.supports.robot, np.bincount(self.group)
        weight = robot.mass * float(np.linalg.norm(robot.gravity))
        share = self.loaded * weight * ramp / (np.maximum(self.on.sum(axis=1), 1)[:, None] * corners)
        return np.asarray(share[:, self.group])

    @lazy
    def group(self) -> Array:
        """Which contact each point at which forces act belongs to, shape (k,)."""
        corners = [np.asarray(c.corners) for c in self.supports.contacts]
        return np.repeat(np.arange(len(corners)), [len(c) for c in corners])

    def places(self, R: Array, p: Array) -> Array:
        """Where forces act, for contacts placed so, shape (n, k, 3) [m]."""
        return self._placed([inner_corners(x, self.inner) for x in self._corners], R, p)

    def corners(self, R: Array, p: Array) -> Array:
        """Corners of contacts placed so, shape (n, k, 3) [m]."""
        return self._placed(self._corners, R, p)

    @lazy
    def _corners(self) -> list[Array]:
        return self.supports.corners(self.t)

    @staticmethod
    def _placed(corners: list[Array], R: Array, p: Array) -> Array:
        return np.concatenate([x @ R[:, f].swapaxes(1, 2) + p[:, f, None] for f, x in enumerate(corners)], axis=1)

    def solved(self, done: Callable[[float], None]) -> tuple[Array, CentroidPlan]:
        """(q, forces): poses that move as their contacts allow, from the first keyframe to the last, shape (n, nq).

        Raises:
            NoSolution: there is no motion of the centre of mass over these contacts.
        """
        robot, group = self.supports.robot, self.group
        R, p, free = self.supports.paths(self.t)
        places, touches = self.places(R, p), self.carries[:, group]
        normals = self.normals[:, group]
        reference = Reference.of(robot, self.q, self.dt, self.feet, self.torques)
        weight = np.tile(reference.weight, (len(self.t), 1))
        for t, _ in self.supports.keys:
            weight[np.abs(self.t - t) < 0.5 * self.dt] *= NEAR_FLIGHTS if self.supports.flies else NEAR
        weight[[0, 1, 2, -3, -2, -1]] = KEPT * reference.weight
        numbers, k = numbers_of(robot)
        keys = np.array([state.q for _, state in self.supports.keys])
        of_keys, allowed = keys[:, numbers], joint_limits(robot, keys)
        low, high = reference.low.copy(), reference.high.copy()
        ends = of_keys[[0, -1]]
        low[k] = np.minimum(np.clip(of_keys.min(axis=0), low[k] - NEARER, low[k]), ends.min(axis=0))
        high[k] = np.maximum(np.clip(of_keys.max(axis=0), high[k], high[k] + NEARER), ends.max(axis=0))
        reference = replace(reference, q=self.q, weight=weight, low=low, high=high)
        sweep, plan, q = Sweep.of(robot, self.q, self.dt), None, self.q
        mu = self.friction * float(self.coefficients.min())
        R_at, p_at = R, p
        least: Array | None = self.least
        owed, bent = np.zeros((2, len(self.t), 6))
        begins, ends = (sweep.com[0], np.zeros(3), np.zeros(3)), sweep.com[-1]
        com, moment = sweep.com, blurred(sweep.moment, 0.03 / self.dt)
        held = self._held(sweep)
        more = AIR * self.supports.flies
        passes = list(zip(STIFFNESS, TURNS, strict=True))
        passes[-1:-1] = more * passes[-2:-1]
        most, apart = len(passes) + MORE, np.inf
        for i in range(most):
            stiff, turns = passes[i] if i < len(passes) else passes[-2]
            nearer = FOLLOWS ** (max(i - 1, 0) + 2 * max(i + 1 - len(passes), 0))
            limits = None if plan is None else torque_rows(reference, self.feet, sweep, plan, self.places, group)
            costs = replace(self.costs, com=nearer * self.costs.com, momentum=nearer * self.costs.momentum)
            program = CentroidProgram(
                self.dt, robot.mass, robot.gravity, places, touches, mu, com, moment, None, None,
                (bool(self.on[0].any()), bool(self.on[-1].any())), limits, begins, ends, costs, normals, least, held,
            )  # fmt: skip
            try:
                plan = program.solve(plan)
            except NoSolution:
                if least is None:
                    raise
                least, program = None, replace(program, least=None)  # some have to press with less
                plan = program.solve(plan)
            goals = Goals(R_at, p_at, free, plan.com, wrenches_on(plan, places, group, p), owed=owed + bent)
            heavy = stiff * np.where(self.on.any(axis=1), 1.0, FLYING)
            over = self.over if i else None  # in the first pass feet come onto their ways over what lies between
            q, left, last = posed(q, reference, self.feet, goals, self.bodies, turns, heavy, over)
            q[:, numbers] = q[:, numbers].clip(*allowed)  # so is the B-spline: it is nowhere beyond its control points
            sweep = Sweep.of(robot, q, self.dt)
            on_curve = _through(sweep)
            bent = _bent(sweep, on_curve, self.t)
            now, then = self.feet.at(sweep.R, sweep.p), self.feet.at(*placements(robot, on_curve))
            R_at, p_at = now.R @ then.R.swapaxes(-1, -2) @ R, p + now.p - then.p
            owed = owed + (stiff == 1.0) * (left.need[:, :6] + bent)
            owed[[0, 1, 2, -3, -2, -1]] = 0.0
            com, moment = sweep.com, 0.5 * (plan.moment + sweep.moment)
            before, apart = apart, float(np.abs(plan.com - sweep.com).max())
            done(min((i + 1.0) / len(passes), 1.0))
            if stiff == 1.0 and last < SETTLED and apart < AGREES:
                break
            if i + 1 >= len(passes) and not AGREES < apart < SHRINKS * before:
                break
        assert plan is not None
        q = on_curve
        for end, frames in ((0, range(len(q))), (-1, range(len(q) - 1, -1, -1))):  # the keyframes at the ends are met exactly
            off = pin.difference(robot.model, q[end], self.supports.keys[end][1].q)
            for i, share in zip(frames, 1.0 - blend(np.arange(0.0, ENDS, self.dt) / ENDS), strict=False):
                q[i] = pin.integrate(robot.model, q[i], share * off)
        return q, plan

    def _held(self, sweep: Sweep) -> tuple[Array, Array]:
        """(times, rows) of `CentroidProgram.fixed`: what no joint changes of the momentum while the contacts rest."""
        robot = self.supports.robot
        moves, n = carriers(robot)[self.feet.joint], len(self.t)
        rows = [np.zeros((n, 0, robot.nv))]
        feet = self.feet.at(sweep.R, sweep.p)
        for f, flat in enumerate(feet.flat):
            J = np.where(moves[f], sweep.J, 0.0) * self.on[:, f, None, None]
            rows.append(J[:, :3] + np.cross(J[:, 3:], feet.p[:, f, :, None], axis=1))
            rows += [J[:, 3:]] * bool(flat)
        J = np.concatenate(rows, axis=1)
        own = np.concatenate([sweep.J_com, sweep.turning], axis=1)
        left = own - own @ np.linalg.pinv(J, rcond=HELD) @ J
        size, axes = np.linalg.eigh(left @ left.swapaxes(1, 2))
        at, rows_at = list[int](), [np.zeros((0, 9))]
        for k in np.flatnonzero((size < HELD**2).any(axis=1)):
            own = axes[k][:, size[k] < HELD**2]
            _, s, V = np.linalg.svd(own[3:])
            turns = np.arange(len(V)) < (s > HELD).sum()  # the others are places
            held = np.hstack([~turns[:, None] * (V @ own[:3].T), turns[:, None] * (V @ own.T)])
            held = held[turns * (2 <= k < n - 2) | ~turns * (3 <= k < n - 3)]  # it is at rest before and after
            at += [int(k)] * len(held)
            rows_at.append(held)
        return np.array(at, int), np.concatenate(rows_at)

    @lazy
    def coefficients(self) -> Array:
        """Friction of each contact, shape (contacts,)."""
        return np.array([coefficient_of(contact) for contact in self.supports.contacts])

    @lazy
    def normals(self) -> Array:
        """Of the surfaces under contacts, shape (n, contacts, 3); upwards where none stands."""
        out = np.tile([0.0, 0.0, 1.0], (len(self.t), len(self.supports.contacts), 1))
        for f, own in enumerate(self.supports.stays):
            for s in own:
                out[[s.holds(x) for x in self.t], f] = s.normal
        return out


def _through(c: Sweep) -> Array:
    """Where the cubic B-spline with control points c is at knots, shape (n, nq); its rates there are those of c."""
    model = c.robot.model
    q = np.array([pin.integrate(model, x, c.dt**2 / 6.0 * a) for x, a in zip(c.q, c.a, strict=True)])
    q[[0, -1]] = c.q[[0, -1]]
    return q


def _bent(c: Sweep, q: Array, t: Array) -> Array:
    """What the base needs more at knots along the cubic spline than at its control points, shape (n, 6)."""
    model, data = c.robot.model, c.robot.model.createData()
    moves = zip(*Curve.of(c.robot, t, q).at(t), c.q, c.v, c.a, strict=True)
    out = np.array([(pin.rnea(model, data, *x[:3]) - pin.rnea(model, data, *x[3:]))[:6].copy() for x in moves])
    out[[0, 1, 2, -3, -2, -1]] = 0.0  # at rest
    return out
