"""Whole-body poses over a whole motion, by one banded Gauss-Newton method: feet exact, forces balanced, limits kept.

    minimise   sum over frames of |rows|^2        over all q[0], ..., q[n-1] at once

Rows of one frame: feet, centre of mass, nearness to the reference, limits of joints, bodies kept apart. Rows of three frames:
what is missing on the base (`Sweep.need`), torques beyond limits, accelerations off the reference's, speeds beyond limits. The
matrix of the normal equations has three blocks of nv below its diagonal, and is factorised as a band.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, each_times
from rbd.model.checked_model import CheckedModel
from rbd.motion.causes import speed_limits
from rbd.motion.frame_terms import carriers, numbers_of, placements, wrench_scale
from rbd.motion.grasps import Grasps
from rbd.motion.ground_clearance import OverGround
from rbd.motion.repair.feet import Feet, blurred
from rbd.motion.repair.sweep import Sweep, rates
from rbd.motion.self_collision import BodyPairs, NearBodies

FOOT = np.array([2e-5, 2e-5, 2e-5, 1e-4, 1e-4, 1e-4])
"""Errors of a foot that stands that cost one: of its place and its rotation, in its own axes [m, rad]."""
LOOSE = np.array([0.01, 0.01, 3e-4, 1e-3, 1e-3, 0.05])
"""The same of stances that are level but may move along the floor and turn on it."""
KEPT = np.array([5e-4, 5e-4, 5e-4, 5e-3, 5e-3, 5e-3])
"""The same of frames that are kept."""
GRASP = 0.4 * KEPT
"""The same of second hands, in the axes that first ones give them."""
SWINGS, SOON_FREE = 0.006, 0.25
"""In the air it costs as many times less, from where a foot is this free on; and again as many times less where it is 2."""
COM_M, COM_LOOSE = np.array([2e-3, 2e-3, 0.05]), np.array([0.03, 0.03, 0.05])
"""Of the centre of mass [m]; where stances are loose."""
MISSING = 4e-3
"""Of what is missing on the base, over the weight, and over 0.3 m times the weight."""
BASE_M, BASE_TURN, LEG, TRUNK, LIMB = 0.15, 0.05, 0.5, 0.12, 0.25
"""Distances from the reference that cost one: of the base [m], [rad], of joints of legs, of the trunk and others [rad]."""
ACCELERATION, TRUNK_ACCELERATION = 7.0, 3.0
"""The same of accelerations [rad/s2]."""
HEAVY = 0.2
"""A joint that carries more than this share of the mass and no foot is one of the trunk."""
LIMIT_ROOM, LIMIT_RAD, NEAR_LIMIT = 0.03, 1e-3, 0.02
"""Joints stay this far inside their limits; error that costs one; where they are held, from how far inside these [rad]."""
TORQUE_SHARE, TORQUE_UNIT = 0.75, 0.02
"""Share of the torque limits that is used; error that costs one, over the limit."""
APART, APART_UNIT = 0.01, 7e-4
"""Bodies are kept this far apart; error that costs one [m]."""
OFF_GROUND_UNIT = 2e-4
"""Error of how far links are from the ground that costs one [m]: keyframes that they pass near to do not lead into it."""
SPEED_SHARE, SPEED_UNIT = 0.96, 0.002
"""Share of the speed limits that is used; error that costs one, over the limit."""
DAMPING, LONGEST = 4000.0, 0.3
"""Added to the diagonal; and the longest step of a coordinate [m, rad]: where steps are longer, they are shortened."""


@dataclass(frozen=True, eq=False)
class Goals:
    """What the poses are to reach, in n frames.

    Attributes:
        R: Orientations of feet, shape (n, F, 3, 3).
        p: Their origins, shape (n, F, 3) [m].
        free: How free they are, 0 in stances, 1 on their way to the next, 2 if there is none, shape (n, F).
        com: Centre of mass, shape (n, 3) [m].
        wrenches: Forces on the feet and moments about p, in W, shape (n, F, 2, 3) [N, N m]; None: none is known.
        kept: Frames whose poses stay as they are.
        grasps: What two hands hold.
        owed: What is added to what is missing on the base, in its axes, shape (n, 6) [N, N m]: the sum of what earlier poses
            left of it, so that in the end nothing is left, as of the method of multipliers.
    """

    R: Array
    p: Array
    free: Array
    com: Array
    wrenches: Array | None
    kept: Feet | None = None
    grasps: Grasps | None = None
    owed: Array | float = 0.0


class Normal:
    """Normal equations of rows over all frames, below the diagonal: H[i] are the blocks of frames k and k + i, transposed.

    They lie in memory as LAPACK wants a band: column c of frame k in one row, from its diagonal on.
    """

    def __init__(self, n: int, nv: int) -> None:
        self.band = np.zeros((n, nv * (3 * nv + 1)))
        blocks = self.band[:, : 3 * nv * nv].reshape(n, nv, 3, nv)
        self.H, self.g = [blocks[: n - i, :, i] for i in range(3)], np.zeros((n, nv))
        self.rows: list[tuple[Array, Array]] = []

    def add(self, J: Array, r: Array, frames: Array | None = None) -> None:
        """Rows of single frames: J (frames, m, nv), r (frames, m); each frame once; of all if not given."""
        if frames is None:  # those of all are taken together
            self.rows.append((J, r))
            return
        T = J.swapaxes(1, 2)
        self.H[0][frames] += T @ J
        self.g[frames] += each_times(T, r)

    def add_three(self, J: Sequence[Array], r: Array, at: Array) -> None:
        """Rows of frames at - 1, at, at + 1."""
        T = [x.swapaxes(1, 2) for x in J]
        for i in range(3):
            self.g[at - 1 + i] += each_times(T[i], r)
            for j in range(i + 1):
                self.H[i - j][at - 1 + j] += T[j] @ J[i]

    def add_inner(self, J: Sequence[Array], r: Array) -> None:
        """Rows of three frames in a row, for all inner frames: J (n - 2, m, nv) each, r (n - 2, m)."""
        (inner, m, nv), n = J[0].shape, len(self.g)
        every, right = np.zeros((n, 3, m, nv)), np.zeros((n, 3, m))
        for i in range(3):
            every[i : inner + i, i], right[i : inner + i, i] = J[i], r
        self.add(every.reshape(n, 3 * m, nv), right.reshape(n, 3 * m))
        for i in (1, 2):
            one, other = (x.reshape(n - i, (3 - i) * m, nv) for x in (every[: n - i, : 3 - i], every[i:, i:]))
            self.H[i] += one.swapaxes(1, 2) @ other

    def add_diagonal(self, w: tuple[Array, Array, Array], r: Array) -> None:
        """Rows of single coordinates of frames k - 1, k, k + 1, for all inner frames: weights and r (n - 2, nv)."""
        n, nv = self.g.shape
        c = np.arange(nv)
        for i in range(3):
            self.g[i : n - 2 + i] += w[i] * r
            for j in range(i + 1):
                self.H[i - j][j : n - 2 + j, c, c] += w[i] * w[j]

    def solution(self) -> Array:
        """H^-1 g, shape (n, nv)."""
        from scipy.linalg import solveh_banded

        n, nv = self.g.shape
        J, r = (np.concatenate(x, axis=1) for x in zip(*self.rows, strict=True))
        self.add(J, r, np.arange(n))
        self.H[0] *= np.triu(np.ones((nv, nv)))  # what is left of the diagonal LAPACK would take for entries far below it
        flat = self.band.reshape(n * nv, 3 * nv + 1).T
        flat[0] += DAMPING
        return np.asarray(solveh_banded(flat, self.g.ravel(), lower=True, overwrite_ab=True, check_finite=False)).reshape(n, nv)


@dataclass(frozen=True, eq=False)
class Reference:
    """What poses stay near to: q and accelerations of n frames, with the weights of each coordinate.

    Attributes:
        robot: The robot.
        dt: Time between frames [s].
        q: Shape (n, nq).
        a: Shape (n, nv).
        weight: Of the distance of each coordinate, shape (nv,) [1/m, 1/rad].
        weight_a: Of accelerations, shape (nv,).
        low, high: Limits of coordinates in v's order; infinite where there are none, shapes (nv,).
        index: Index in q of each coordinate of one number, -1 of others, shape (nv,).
        speed: Limits of velocities, infinite where there are none, shape (nv,).
        torques: (least, most) torques at velocities, shapes (n, nu).
    """

    robot: CheckedModel
    dt: float
    q: Array
    a: Array
    weight: Array
    weight_a: Array
    low: Array
    high: Array
    index: Array
    speed: Array
    torques: Callable[[Array], tuple[Array, Array]]

    @classmethod
    def of(
        cls, robot: CheckedModel, q: Array, dt: float, feet: Feet, torques: Callable[[Array], tuple[Array, Array]]
    ) -> Reference:
        """That of a motion with its feet."""
        model, nv = robot.model, robot.nv
        legs = carriers(robot)[feet.joint].any(axis=0)
        data = model.createData()
        pin.computeSubtreeMasses(model, data)
        mass = np.repeat(list(data.mass), model.nvs)
        trunk = ~legs & (mass > HEAVY * robot.mass)
        weight = 1.0 / np.select([legs, trunk], [LEG, TRUNK], LIMB)
        weight[:6] = 1.0 / np.repeat([BASE_M, BASE_TURN], 3)
        low, high, index = np.full(nv, -np.inf), np.full(nv, np.inf), np.full(nv, -1)
        i, k = numbers_of(robot)
        low[k], high[k], index[k] = model.lowerPositionLimit[i] + LIMIT_ROOM, model.upperPositionLimit[i] - LIMIT_ROOM, i
        a = blurred(rates(robot, q, dt)[1], 0.02 / dt)
        out = q.copy()
        out[:, i] = np.clip(q[:, i], low[k], high[k])
        weight_a = 1.0 / np.where(trunk, TRUNK_ACCELERATION, ACCELERATION)
        return cls(robot, dt, out, a, weight, weight_a, low, high, index, speed_limits(robot), torques)


def posed(
    q: Array, reference: Reference, feet: Feet, goals: Goals, bodies: BodyPairs | None, turns: int,
    stiff: Array | float = 1.0, over: OverGround | None = None,
) -> tuple[Array, Sweep, float]:
    """(poses, their sweep before the last step, the length of that) after some steps of Gauss-Newton.

    Args:
        q: Where it begins, shape (n, nq).
        reference: What they stay near to.
        feet: The feet; their poses are computed anew.
        goals: What they are to reach; without wrenches, stances may move along the floor and turn on it.
        bodies: Pairs of bodies that are kept apart.
        turns: How many steps.
        stiff: Share of the weight of what is missing on the base; of each frame, shape (n,), or of all.
        over: Links that are kept off the ground; its contacts are those of `feet`.
    """
    robot, dt, loose = reference.robot, reference.dt, goals.wrenches is None
    unit = foot_units(feet, goals.free, loose)
    for _ in range(turns):
        sweep = _pushed(robot, q, dt, feet, goals)
        normal = Normal(len(q), robot.nv)
        _pose_rows(normal, sweep, feet, goals.R, goals.p, unit)
        if goals.kept is not None:
            kept = goals.kept
            _pose_rows(normal, sweep, kept, kept.R, kept.p, np.broadcast_to(KEPT, (*kept.p.shape[:2], 6)))
        if goals.grasps is not None and goals.grasps.things:
            now = goals.grasps.at(sweep.R, sweep.p)
            unit_of = np.broadcast_to(GRASP, (*now.first.p.shape[:2], 6))
            _pose_rows(normal, sweep, now.second, *now.goals, unit_of, now.first.joint)
        w = 1.0 / (COM_LOOSE if loose else COM_M)
        normal.add(w[:, None] * sweep.J_com, w * (goals.com - sweep.com))
        _near_rows(normal, q, reference)
        if not loose:
            _force_rows(normal, sweep, reference, stiff, goals.owed)
        if bodies is not None:
            _apart_rows(normal, sweep, bodies)
        if over is not None:
            _off_ground_rows(normal, sweep, over, goals.free == 0.0)
        b = reference.weight_a
        normal.add_diagonal((b / dt**2, -2.0 * b / dt**2, b / dt**2), b * (reference.a - sweep.a)[1:-1])
        fast = (np.sign(sweep.v) * np.maximum(np.abs(sweep.v) - SPEED_SHARE * reference.speed, 0.0))[1:-1]
        b = np.where(fast != 0.0, 1.0 / (SPEED_UNIT * reference.speed), 0.0)
        normal.add_diagonal((-b / (2.0 * dt), 0.0 * b, b / (2.0 * dt)), -b * fast)
        step = normal.solution()
        q = _moved(robot, q, step)
    return q, sweep, float(np.abs(step).max())


def _pushed(robot: CheckedModel, q: Array, dt: float, feet: Feet, goals: Goals) -> Sweep:
    """The sweep of poses whose feet are pushed as the goals say: by forces that stay as they are while the poses change."""
    if goals.wrenches is None:
        return Sweep.of(robot, q, dt)
    R, p = placements(robot, q)
    turn, force, moment = R[:, feet.joint], goals.wrenches[:, :, 0], goals.wrenches[:, :, 1]
    moment = moment + np.cross(goals.p - p[:, feet.joint], force)  # about the joints' origins
    local = np.concatenate([np.matmul(x[..., None, :], turn)[..., 0, :] for x in (force, moment)], axis=2)
    sweep, moves = Sweep.of(robot, q, dt, feet.joint.tolist(), local), carriers(robot)
    for f in np.flatnonzero(~feet.flat):  # in its derivatives the forces turn with the bodies
        columns = np.flatnonzero(moves[feet.joint[f]])
        J = sweep.J[:, :, columns]
        linear = J[:, :3] + np.cross(J[:, 3:], goals.p[:, f, :, None], axis=1)
        sweep.by_q[:, columns[:, None], columns] += linear.swapaxes(1, 2) @ np.cross(J[:, 3:], force[:, f, :, None], axis=1)
    return sweep


def _pose_rows(normal: Normal, sweep: Sweep, feet: Feet, R: Array, p: Array, unit: Array, holders: Array | None = None) -> None:
    """Errors of the poses of frames over a unit, shape (n, F, 6): of places and rotations, in the axes of the goals R, p.

    The goals move with the bodies of `holders`, of one joint a frame; None: they do not.
    """
    now = feet.at(sweep.R, sweep.p)
    error, moves = now.error(R, p) / unit, carriers(sweep.robot)
    for f, joint in enumerate(feet.joint):
        sign = moves[joint] * 1.0 - (0.0 if holders is None else moves[holders[f]])
        columns = np.flatnonzero(sign)
        J, back = sweep.J[:, :, columns] * sign[columns], R[:, f].swapaxes(1, 2)
        linear = J[:, :3] + np.cross(J[:, 3:], now.p[:, f, :, None], axis=1)
        rows = np.zeros((len(J), 6, sweep.robot.nv))
        rows[:, :, columns] = np.concatenate([back @ linear, back @ J[:, 3:]], axis=1) / unit[:, f, :, None]
        normal.add(rows, error[:, f])


def foot_units(feet: Feet, free: Array, loose: bool) -> Array:
    """Errors of feet that cost one, shape (n, F, 6), by how free they are, shape (n, F)."""
    air = FOOT / SWINGS ** (np.minimum(free / SOON_FREE, 1.0) + np.maximum(free - 1.0, 0.0))[..., None]
    unit = np.where(free[..., None] == 0.0, LOOSE if loose else FOOT, air)
    return np.where(feet.flat[:, None] | (np.arange(6) < 3), unit, np.inf)


def _near_rows(normal: Normal, q: Array, reference: Reference) -> None:
    """Nearness to the reference, and limits of joints; both rows of single coordinates."""
    robot, c = reference.robot, np.arange(reference.robot.nv)
    off = np.array([pin.difference(robot.model, x, y) for x, y in zip(q, reference.q, strict=True)])
    normal.H[0][:, c, c] += reference.weight**2
    normal.g += reference.weight**2 * off
    k = np.flatnonzero(reference.index >= 0)
    x, low, high = q[:, reference.index[k]], reference.low[k], reference.high[k]
    near = (x < low + NEAR_LIMIT) | (x > high - NEAR_LIMIT)
    w = np.where(near, LIMIT_RAD**-2, 0.0)
    normal.H[0][:, k, k] += w
    normal.g[:, k] += w * (np.clip(x, low, high) - x)


def _force_rows(normal: Normal, sweep: Sweep, reference: Reference, stiff: Array | float, owed: Array | float) -> None:
    """What is missing on the base, and torques beyond their share of the limits; both by three frames."""
    robot, dt, need = sweep.robot, sweep.dt, sweep.need[1:-1]

    def by(frames: Array | slice, rows: Array | slice) -> list[Array]:
        """Derivatives of some rows of `need` by the three poses."""
        M, by_v, by_q = (x[1:-1][frames][:, rows] for x in (sweep.M, sweep.by_v, sweep.by_q))
        inertia, damping = M / dt**2, by_v / (2.0 * dt)
        return [inertia - damping, by_q - 2.0 * inertia, inertia + damping]

    w = np.broadcast_to(stiff, len(sweep.q))[1:-1, None] / (MISSING * wrench_scale(robot))
    normal.add_inner([w[:, :, None] * x for x in by(slice(None), slice(6))], -w * (sweep.need[:, :6] + owed)[1:-1])
    least, most = (TORQUE_SHARE * x[1:-1] for x in reference.torques(sweep.v))
    tau = need[:, robot.actuated]
    over = np.maximum(tau - most, 0.0) + np.minimum(tau - least, 0.0)
    some = np.flatnonzero(over.any(axis=1))
    w = np.where(over[some] != 0.0, 1.0 / (TORQUE_UNIT * np.maximum(most, -least)[some]), 0.0)
    normal.add_three([w[:, :, None] * x for x in by(some, robot.actuated)], -w * over[some], some + 1)


def _apart_rows(normal: Normal, sweep: Sweep, bodies: BodyPairs) -> None:
    """Pairs of bodies that are nearer than `APART`."""
    moves = carriers(sweep.robot)
    for i, j, near in bodies.near(sweep.R, sweep.p, APART, again=True):
        apart = min(APART, max(bodies.at_rest(i, j), -APART_UNIT))  # as near as where the robot rests
        near = near.some(near.gap < apart)
        one, other = (moves[bodies.shapes[x][2].joint] for x in (i, j))
        _add_apart(normal, sweep, near, [(near.first, -1.0, one), (near.second, 1.0, other)], apart, APART_UNIT)


def _off_ground_rows(normal: Normal, sweep: Sweep, over: OverGround, stands: Array) -> None:
    """Links that are nearer to the ground than wanted, but while their contacts stand, which shape (n, F) tells."""
    moves = carriers(sweep.robot)
    for i, j, near in over.near(sweep.R, sweep.p, over.wanted, stands):
        sides = [(near.second, 1.0, moves[over.shapes[i].joint])]
        _add_apart(normal, sweep, near, sides, float(over.wanted[i, j]), OFF_GROUND_UNIT)


def _add_apart(
    normal: Normal, sweep: Sweep, near: NearBodies, sides: Sequence[tuple[Array, float, Array]], apart: float, unit: float
) -> None:
    """Rows of two bodies that are to be so far apart: the distance grows with n . (v_second - v_first).

    Args:
        normal: Where they are added.
        sweep: Of the poses.
        near: Where both are.
        sides: (points, -1 of the first or 1 of the second, which coordinates move them) of those that move.
        apart: How far apart [m].
        unit: Error that costs one [m].
    """
    k, n = near.frames, near.normal
    J, row = sweep.J[k], np.zeros((len(k), sweep.robot.nv))
    for point, sign, moves in sides:
        speed = np.einsum("ni,nij->nj", n, J[:, :3]) + np.einsum("ni,nij->nj", np.cross(point, n), J[:, 3:])
        row += sign * np.where(moves, speed, 0.0)
    normal.add(row[:, None] / unit, ((apart - near.gap) / unit)[:, None], k)


def _moved(robot: CheckedModel, q: Array, dq: Array) -> Array:
    """The next poses; where steps are long they are shortened, smoothly over time."""
    from scipy.ndimage import minimum_filter1d

    largest = np.abs(dq).max(axis=1)
    if largest.max() > LONGEST:
        share = minimum_filter1d(np.minimum(1.0, LONGEST / np.maximum(largest, 1e-9)), 13)
        dq = blurred(share, 3.0)[:, None] * dq
    return np.array([pin.integrate(robot.model, x, y) for x, y in zip(q, dq, strict=True)])
