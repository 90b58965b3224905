"""Forces of a plan at every instant, and the certificate that contacts and motors can bring them about.

At both ends of an interval of length h forces f_0 and f_1 in their cones balance the motion exactly. Between them

    f(t) = (1 - s) f_0 + s f_1 + W G^T (G W G^T)^-1 e(t),        s from 0 to 1

with G the forces' map to the wrench, e(t) what the straight line leaves of the wrench that the motion takes, and weights W
that grow with the room that each force has in its cone. |e| is at most h^2 / 8 times the largest second derivative of the
wrench (`rbd.planning.bounds`), and a cone is convex: where the correction is smaller than the room at both ends, f(t) is in its
cones at all times between them. Torques likewise; the limits that they are within are those at the largest speeds between, as
the torque with which a motor drives does not rise with its speed. Intervals in which that does not follow are halved.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np

from rbd.arrays import Array, each_times
from rbd.motion.frame_terms import FrameTerms, carriers, placements, wrench_scale
from rbd.planning.bounds import Bounds
from rbd.planning.curve import Curve
from rbd.problem.cones import project_cones

HALVED = 7
"""How often an interval between two knots is halved, at most."""
RANK = 1e-7
"""Wrenches that forces in their cones resist with less than this share of their trace count as ones that they do not resist."""
PROJECTIONS, WITHIN = 60, 0.97
"""How often forces are put into their cones and balanced in turn, at most; and the share of the friction of those cones."""
FALLS = 2e-3
"""What may be missing of the wrench on the base where nothing touches, over the weight, and over 0.3 m times the weight."""


_ONCE = ("start", "end", "on", "correction", "off_line", "bend", "drift", "lost")
"""What `Intervals` has once an interval, not at both ends."""


@dataclass(frozen=True, eq=False)
class Pushes:
    """Forces of a plan at points that rest, at n knots.

    Attributes:
        t: Times of the knots, shape (n,) [s].
        joint: Which joint carries each of k points, shape (k,).
        on: Which of them touch, shape (n, k).
        places: Where they rest, shape (n, k, 3) [m].
        axes: Two tangents and the normal of their surfaces, as rows, shape (n, k, 3, 3).
        forces: In W, shape (n, k, 3) [N].
        friction: Coefficient of each point, shape (k,).
    """

    t: Array
    joint: Array
    on: Array
    places: Array
    axes: Array
    forces: Array
    friction: Array

    def before(self, start: Array, end: Array) -> Array:
        """The last knots before the middles of intervals, shape (m,)."""
        return (np.searchsorted(self.t, 0.5 * (start + end)) - 1).clip(0, len(self.t) - 2)

    def rest(self, knot: Array) -> Array:
        """Where points rest between knots and the next ones, shape (m, k, 3) [m]."""
        return np.where(self.on[knot, :, None], self.places[knot], self.places[knot + 1])

    def between(self, knot: Array, t: Array, on: Array) -> Array:
        """Forces at times (2, m) after knots, on straight lines to the next ones, of points that are on, (2, m, k, 3) [N]."""
        s = ((t - self.t[knot]) / (self.t[knot + 1] - self.t[knot]))[..., None, None]
        return np.where(on[..., None], (1.0 - s) * self.forces[knot] + s * self.forces[knot + 1], 0.0)


@dataclass(frozen=True, eq=False)
class Intervals:
    """What is known of m intervals of a plan; shapes (2, m) are of both ends.

    Attributes:
        start: First instants, shape (m,) [s].
        end: Last instants, shape (m,) [s].
        on: Which points push, shape (m, k).
        forces: Their forces in W, shape (2, m, k, 3) [N].
        torques: Of the motors, shape (2, m, nu) [N m].
        missing: What forces leave of the wrench on the base, over the weight, and over 0.3 m times the weight, shape (2, m).
        room: How far inside its cone each force is, shape (2, m, k) [N]; infinite of points that do not push.
        slack: How far torques are inside their limits, the nearest one, shape (2, m) [N m].
        correction: Bound of what is added to each force between the ends, shape (m, k) [N].
        off_line: Bound of how far torques are from a straight line between the ends, the largest one, shape (m,) [N m].
        bend: The same, less how far they are inside their limits at the speeds between, the worst one, shape (m,) [N m].
        drift: Bound of how far a point is from where it rests, shape (m,) [m].
        lost: Bound of what forces cannot balance between the ends, as `missing`; zero where they span all wrenches, shape (m,).
    """

    start: Array
    end: Array
    on: Array
    forces: Array
    torques: Array
    missing: Array
    room: Array
    slack: Array
    correction: Array
    off_line: Array
    bend: Array
    drift: Array
    lost: Array

    @property
    def holds(self) -> Array:
        """Where both ends are possible, shape (m,)."""
        inside = (self.room.min(axis=(0, 2)) >= 0.0) & (self.slack.min(axis=0) >= 0.0)
        return np.asarray((self.missing.max(axis=0) < FALLS) & inside)

    @property
    def sure(self) -> Array:
        """Where all instants are certified to be possible, shape (m,)."""
        between = (self.correction <= self.room.min(axis=0)).all(axis=1) & (self.bend <= 0.0)
        return np.asarray(self.holds & between & (self.missing.max(axis=0) + self.lost < FALLS))

    def at(self, t: Array | float) -> tuple[Array, Array]:
        """(interval in which each time is [s], the later of two; share of it)."""
        i = np.asarray(np.searchsorted(self.start, t, side="right") - 1).clip(0)
        return i, (t - self.start[i]) / (self.end[i] - self.start[i])

    def some(self, which: Array) -> Intervals:
        """Some of them."""
        given = {f.name: getattr(self, f.name) for f in fields(self)}
        return Intervals(**{name: x[which] if name in _ONCE else x[:, which] for name, x in given.items()})

    @classmethod
    def joined(cls, parts: list[Intervals]) -> Intervals:
        """All intervals of some parts, in order of time."""
        names = [f.name for f in fields(cls)]
        out = cls(**{name: np.concatenate([getattr(x, name) for x in parts], axis=int(name not in _ONCE)) for name in names})
        return out.some(np.argsort(out.start, kind="stable"))


def certified(curve: Curve, pushes: Pushes, torques: Callable[[Array], tuple[Array, Array]], parts: int = 2) -> Intervals:
    """The intervals of a plan, halved until each is certified or too short, or one of its ends is impossible."""
    t = np.linspace(0.0, 1.0, parts + 1)
    steps = np.diff(curve.t)
    start = (curve.t[:-1, None] + steps[:, None] * t[:-1]).ravel()
    end = (curve.t[:-1, None] + steps[:, None] * t[1:]).ravel()
    done = list[Intervals]()
    for i in range(HALVED + 1):
        found = examined(curve, pushes, torques, start, end)
        again = ~found.sure & found.holds & (i < HALVED)
        done.append(found.some(~again))
        if not again.any():
            break
        a, b = start[again], end[again]
        middle = 0.5 * (a + b)
        start, end = np.concatenate([a, middle]), np.concatenate([middle, b])
    return Intervals.joined(done)


def examined(
    curve: Curve, pushes: Pushes, torques: Callable[[Array], tuple[Array, Array]], start: Array, end: Array
) -> Intervals:
    """What is known of some intervals, no knot inside of them; arguments as of `certified`."""
    robot, m, k = curve.robot, len(start), len(pushes.joint)
    knot = pushes.before(start, end)
    on = pushes.on[knot] & pushes.on[knot + 1]
    q, v, a = curve.at(np.concatenate([start, end]))
    terms = FrameTerms.of(robot, q, v, a, None)
    R, p = (x.reshape(2, m, *x.shape[1:]) for x in placements(robot, q))
    rest, axes = pushes.rest(knot), pushes.axes[knot]
    both = np.concatenate([rest, rest])
    touches = np.concatenate([on, on])
    G = terms.wrench_map(both, touches).reshape(2, m, 6, 3 * k)
    unit = wrench_scale(robot)
    f = pushes.between(knot, np.array([start, end]), on)
    room = _room(f, axes, pushes.friction, on)
    need = terms.wrench.reshape(2, m, 6)
    lacks = (need - each_times(G, f.reshape(2, m, -1))) / unit
    scaled = G / unit[:, None]
    both_ends = np.broadcast_to(room.min(axis=0), room.shape)
    (own, _), (back, full) = (_back(scaled, np.where(on, np.maximum(x, 0.0) ** 2, 0.0)) for x in (room, both_ends))
    for _ in range(PROJECTIONS):
        f = f + each_times(own, lacks).reshape(2, m, k, 3)
        if (_room(f, axes, pushes.friction, on) >= 0.0).all():
            break
        f = each_times(axes.swapaxes(-1, -2), project_cones(each_times(axes, f), WITHIN * pushes.friction))
        lacks = (need - each_times(G, f.reshape(2, m, -1))) / unit
    missing = np.abs(need - each_times(G, f.reshape(2, m, -1))) / unit
    room = _room(f, axes, pushes.friction, on)
    maps = terms.joint_map(pushes.joint, both, touches, np.asarray(robot.actuated)).reshape(2, m, -1, 3 * k)
    tau = terms.need[:, robot.actuated].reshape(2, m, -1) - each_times(maps, f.reshape(2, m, -1))
    least, most = (x.reshape(2, m, -1) for x in torques(v))
    slack = np.minimum(tau - least, most - tau).min(axis=2)
    least, most = limits_between(curve, torques, start, end, v.reshape(2, m, -1))
    inside = np.minimum(tau - least, most - tau).min(axis=0)
    return Intervals(
        start, end, on, f, tau, missing.max(axis=2), room, slack,
        *_between(curve, pushes, start, end, on, f, inside, back, full, rest, R, p, terms.com.reshape(2, m, 3)),
    )  # fmt: skip


def at_instants(curve: Curve, pushes: Pushes, x: Intervals, t: Array) -> tuple[Array, Array]:
    """(forces in W, torques) of the motion at n times: f(t) as above, shapes (n, k, 3) [N] and (n, nu) [N m]."""
    robot, (i, s), k = curve.robot, x.at(t), len(pushes.joint)
    knot, on = pushes.before(x.start[i], x.end[i]), x.on[i]
    terms = FrameTerms.of(robot, *curve.at(t), None)
    rest, axes = pushes.rest(knot), pushes.axes[knot]
    room = _room(pushes.between(knot, np.array([x.start[i], x.end[i]]), on), axes, pushes.friction, on).min(axis=0)
    unit = wrench_scale(robot)
    scaled = terms.wrench_map(rest, on).reshape(-1, 6, 3 * k) / unit[:, None]
    (back,), _ = _back(scaled[None], np.where(on, np.maximum(room, 0.0) ** 2, 0.0)[None])
    s = s[:, None, None]
    f = (1.0 - s) * x.forces[0, i] + s * x.forces[1, i]
    f = f + each_times(back, terms.wrench / unit - each_times(scaled, f.reshape(-1, 3 * k))).reshape(f.shape)
    maps = terms.joint_map(pushes.joint, rest, on, np.asarray(robot.actuated)).reshape(len(f), -1, 3 * k)
    return f, terms.need[:, robot.actuated] - each_times(maps, f.reshape(-1, 3 * k))


def limits_between(
    curve: Curve, torques: Callable[[Array], tuple[Array, Array]], start: Array, end: Array, v: Array
) -> tuple[Array, Array]:
    """(least, most) torques at all times of m intervals, shapes (m, nu): those at the largest speeds each way.

    Speeds are on the straight line between those at both ends, v (2, m, nv), up to h^2 / 8 times the largest third derivative
    of the joints. Torques with which motors drive do not rise with speed.
    """
    off = curve.sizes(start, end)[2] * ((end - start) ** 2 / 8.0)[:, None]
    return torques(v.min(axis=0) - off)[0], torques(v.max(axis=0) + off)[1]


def _back(scaled: Array, weights: Array) -> tuple[Array, Array]:
    """(W G^T (G W G^T)^-1, where that gives all wrenches, at both ends), shapes (2, m, 3 k, 6) and (m,).

    Args:
        scaled: G, shape (2, m, 6, 3 k).
        weights: W of each point, shape (2, m, k).
    """
    W = np.repeat(weights, 3, axis=2)
    normal = scaled * W[:, :, None] @ scaled.swapaxes(-1, -2)
    size = np.maximum(np.trace(normal, axis1=-2, axis2=-1), 1e-300)[..., None, None]
    back = W[..., None] * scaled.swapaxes(-1, -2) @ np.linalg.pinv(normal / size, rcond=RANK) / size
    return np.asarray(back), np.asarray((np.linalg.eigvalsh(normal / size)[..., 0] > RANK).all(axis=0))


def _room(f: Array, axes: Array, mu: Array, on: Array) -> Array:
    """How far forces are inside their cones, shape (2, m, k) [N]."""
    x, y, n = np.moveaxis(each_times(axes, f), -1, 0)
    return np.asarray(np.where(on, (mu * n - np.hypot(x, y)) / np.sqrt(1.0 + mu**2), np.inf))


def _between(
    curve: Curve, pushes: Pushes, start: Array, end: Array, on: Array, f: Array, inside: Array, back: Array, full: Array,
    rest: Array, R: Array, p: Array, com: Array,
) -> tuple[Array, Array, Array, Array, Array]:  # fmt: skip
    """(correction, off_line, bend, drift, lost) of `Intervals`; `inside`: how far torques are inside their limits, (m, nu)."""
    robot, model = curve.robot, curve.robot.model
    h, m = end - start, len(start)
    bounds = Bounds.of(robot, curve.sizes(start, end))
    levers = np.array([X.lever for X in model.inertias])
    c = p + each_times(R, levers)
    half = 0.5 * h
    # Where points are, and how far they get from where they rest.
    own = np.einsum("amkji,amkj->amki", R[:, :, pushes.joint], rest - p[:, :, pushes.joint])
    middle = own.mean(axis=0)
    now = p[:, :, pushes.joint] + each_times(R[:, :, pushes.joint], np.broadcast_to(own[0], own.shape))
    off = np.linalg.norm(now - rest, axis=3).max(axis=0)
    away = bounds.place[2, pushes.joint].T + bounds.turn[2, pushes.joint].T * np.linalg.norm(middle, axis=2)
    drift = np.where(on, off + away * h[:, None] ** 2 / 8.0, 0.0)
    # The wrench about the centre of mass at the start.
    reach = np.linalg.norm(c - com[0, :, None], axis=3).max(axis=0).T + bounds.com[1] * half
    force, moment = (x * h**2 / 8.0 for x in bounds.wrench(reach))
    size = np.linalg.norm(f, axis=3).max(axis=0)
    moment = moment + (size * drift).sum(axis=1)
    unit = wrench_scale(robot)
    force, moment = force / unit[0], moment / unit[5]
    rows = back.reshape(2, m, -1, 3, 6)
    correction = np.maximum(*np.linalg.norm(rows[..., :3], axis=(3, 4))) * force[:, None]
    correction = correction + np.maximum(*np.linalg.norm(rows[..., 3:], axis=(3, 4))) * moment[:, None]
    lost = np.where(full, 0.0, np.maximum(force, moment))
    # Torques of hinges.
    coordinates = np.asarray(robot.actuated)
    joints = np.searchsorted(list(model.idx_vs), coordinates)  # each has one coordinate
    moves = carriers(robot)[:, coordinates].T
    apart = np.linalg.norm(c[:, :, None] - p[:, :, joints, None], axis=4).max(axis=0).transpose(1, 2, 0)
    apart = apart + (bounds.com[1] + bounds.place[1, joints][:, None]) * half
    points = np.linalg.norm(rest[:, None] - p[:, :, joints, None], axis=4).max(axis=0).transpose(1, 2, 0)
    points = points + bounds.place[1, joints][:, None] * half
    points[~moves[:, pushes.joint]] = np.inf
    changes = np.linalg.norm(f[1] - f[0], axis=2).T / h
    bend = bounds.torques(moves, joints, apart, points, size.T, changes) * h**2 / 8.0
    arms = np.where(np.isfinite(points), points, 0.0)
    bend = bend + np.einsum("jkm,mk->jm", arms, correction * on) + np.einsum("jk,mk->jm", moves[:, pushes.joint], size * drift)
    worst = (bend.T - inside).max(axis=1)
    return correction, bend.max(axis=0, initial=0.0), worst, drift.max(axis=1, initial=0.0), lost
