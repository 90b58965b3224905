"""Contact points of convex shapes of two bodies, or of one and a plane, and how they move.

A contact point is no material point: the lowest point of a rolling ball stays below its centre. Let p' be the velocity of the
contact point, and v + w x (p - o), b + w' x (p - o) velocity and J_dot v of the body at p, o its joint. Then

    g  = v + w x (p - o)                        relative velocity of the material point at p
    g' = b + w' x (p - o) + w x (p' - v)        its rate of change, at v_dot = 0

For a corner p' = g, and g' is its classical acceleration. For a ball on the ground p' is the velocity of its centre, and there
is no centripetal part. For two bodies take the difference of the two; axes R that turn with the normal add R'^T g.

Let V = (v_0, w) and A = (a_0, alpha) be spatial velocity and J_dot v of a joint's body at W's origin, P a contact point on it,
which moves over the body at c, and d one of the plane's axes:

    J = (d, P x d) J_W over the joints that carry the body        velocity = J v
    bias = d . (a_0 + alpha x P + w x (v_0 + w x P + c))

For a corner c is zero, and the last term makes the acceleration classical; of round parts see
`rbd.constraints.convex.convex_shapes`.

The arithmetic is in `rbd.constraints.plane_kernel`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass
from itertools import chain

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, cross_matrix, lazy, rows_from
from rbd.constraints.convex.closest_points import Crossing, Meeting, meeting_at, nearest_points
from rbd.constraints.convex.convex_shapes import ConvexShape, RoundPart, plane_kernel
from rbd.constraints.convex.points_near_plane import LowPoints
from rbd.constraints.surface import contact_axes
from rbd.model.checked_model import CheckedModel
from rbd.model.state import FrameKinematics, State
from rbd.problem.ground import Ground, motion_of


@dataclass(frozen=True, eq=False)
class Touching:
    """k contact points, in contact axes (tangent, tangent, normal), the normal out of the surface.

    Attributes:
        numbers: Identify points over time: the same corner of the same shape has the same number, shape (k,).
        label: The name of a point, from its number.
        positions: In W, shape (k, 3) [m].
        axes: R_WC of all, shape (3, 3), or of each, shape (k, 3, 3).
        gaps: Shape (k,) [m]; negative where shapes overlap.
        J: Jacobian of the relative velocity, shape (3k, nv).
        velocity: Shape (3k,) [m/s].
        bias: Shape (3k,) [m/s2].
        pieces: Names of the pieces of terrain that points are on, "" of other points; of no terrain, none.
    """

    numbers: Array
    label: Callable[[int], str]
    positions: Array
    axes: Array
    gaps: Array
    J: Array
    velocity: Array
    bias: Array
    pieces: tuple[str, ...] = ()

    @property
    def each_axes(self) -> Array:
        """R_WC of each point, shape (k, 3, 3)."""
        return np.broadcast_to(self.axes, (len(self.gaps), 3, 3))

    @lazy
    def names(self) -> tuple[str, ...]:
        """Names of the points, as constant as their numbers."""
        return tuple([self.label(number) for number in self.numbers.tolist()])


def joined(parts: Sequence[Touching], label: Callable[[int], str], nv: int) -> Touching:
    """Several stacked; of none, no points."""
    if len(parts) == 1:
        return parts[0]
    if not parts:
        none = np.zeros(0)
        return Touching(np.zeros(0, int), label, np.zeros((0, 3)), np.zeros((0, 3, 3)), none, np.zeros((0, nv)), none, none)
    numbers, positions, gaps, J, velocity, bias = (
        np.concatenate([getattr(p, what) for p in parts]) for what in ("numbers", "positions", "gaps", "J", "velocity", "bias")
    )
    axes = np.concatenate([p.each_axes for p in parts])
    pieces = tuple(chain.from_iterable([part.pieces or ("",) * len(part.gaps) for part in parts]))
    return Touching(numbers, label, positions, axes, gaps, J, velocity, bias, pieces if any(pieces) else ())


_PRECISE = 1e-5
"""Coal's distances are right to this [m], by far."""


class Between:
    """Contact points of pairs of shapes of two bodies. Not for two threads at once.

    The nearest points of a pair are computed again when it can have come near: in the axes of the first shape no point of the
    second has moved by more than its centre has, plus the change of its rotation times its radius.

    Args:
        robot: The robot.
        pairs: The pairs of shapes.
        first_number: Points are numbered from here on, in the order in which their names first occur.
    """

    def __init__(self, robot: CheckedModel, pairs: Sequence[tuple[ConvexShape, ConvexShape]], first_number: int) -> None:
        self.pairs, self.model, self.first_number = tuple(pairs), robot.model, first_number
        #: A frame of each joint's body, and the joint from there.
        self._frames = {joint: (frame, X.inverse()) for frame in robot.frames()[::-1] for joint, X in (robot.site(frame),)}
        shapes = list({id(s): s for pair in pairs for s in pair}.values())
        number = {id(s): i for i, s in enumerate(shapes)}
        self.shapes = shapes
        self.first = np.array([number[id(a)] for a, _ in pairs], int)
        self.second = np.array([number[id(b)] for _, b in pairs], int)
        self.within = np.array([a.reach + b.reach for a, b in pairs])
        self.joints = sorted({shape.joint for shape in shapes})
        self._body = np.array([self.joints.index(shape.joint) for shape in shapes], int)
        self._centres = np.array([shape.centre for shape in shapes])
        self._reach = np.array([shape.reach for shape in shapes])
        self._prepare()

    def _prepare(self) -> None:
        self._data = self.model.createData()
        #: Of each pair, when its nearest points were computed: the gap, the second's rotation and centre in the first's axes.
        n = len(self.pairs)
        self._gap, self._turned, self._placed = np.full(n, -np.inf), np.zeros((n, 3, 3)), np.zeros((n, 3))
        #: Names so far; of points with the same name at the same time, how many there were before.
        self._known: dict[tuple[str, int], int] = {}

    def another(self) -> Between:
        """The same with data of its own."""
        out = copy(self)
        out._prepare()
        return out

    def at(self, state: State, margin: float) -> list[Touching]:
        """The points of pairs whose gap is at most `margin` [m]."""
        data = self._data
        pin.forwardKinematics(self.model, data, state.q)
        X = {joint: pin.SE3(data.oMi[joint]) for joint in self.joints}
        R = np.array([X[joint].rotation for joint in self.joints])[self._body]
        p = np.array([X[joint].translation for joint in self.joints])[self._body]
        centres = np.vecdot(R, self._centres[:, None, :]) + p
        away = np.linalg.norm(centres[self.first] - centres[self.second], axis=1)
        motions: dict[int, FrameKinematics] = {}
        found, times = [], Counter[str]()
        for i in self._asked(R, p, centres, np.flatnonzero(away - self.within <= margin), margin):
            one, other = self.pairs[i]
            near = nearest_points(one, X[one.joint], other, X[other.joint])
            self._gap[i] = near.gap
            if near.gap > margin:
                continue
            met = meeting_at(near, one, X[one.joint], other, X[other.joint], margin)
            for joint in (one.joint, other.joint):
                if joint not in motions:
                    motions[joint] = self.motion(state, joint)
            numbers = np.array([self._number(at.name, times) for at in met.crossings])
            found.append(points_of_pair(met, (one, other), (motions[one.joint], motions[other.joint]), numbers, self.label))
        return found

    def _asked(self, R: Array, p: Array, centres: Array, near: Array, margin: float) -> list[int]:
        """Those of some pairs that can be within the margin, at these poses of all shapes' bodies; their poses are kept."""
        one, other = self.first[near], self.second[near]
        to_first = R[one].transpose(0, 2, 1)
        turned, placed = to_first @ R[other], np.vecdot(to_first, (centres[other] - p[one])[:, None, :])
        moved = np.linalg.norm(placed - self._placed[near], axis=1)
        moved += np.linalg.norm(turned - self._turned[near], axis=(1, 2)) * self._reach[other]
        asked = self._gap[near] - moved <= margin + _PRECISE
        index = near[asked]
        self._turned[index], self._placed[index] = turned[asked], placed[asked]
        return list(index.tolist())

    def label(self, number: int) -> str:
        """The name of a point."""
        return list(self._known)[number - self.first_number][0]

    def motion(self, state: State, joint: int) -> FrameKinematics:
        """The motion of a joint's body; the world for joint 0."""
        if joint == 0:
            return FrameKinematics(pin.SE3.Identity(), np.zeros((6, len(state.v))), np.zeros(6), np.zeros(6))
        frame, X_FJ = self._frames[joint]
        return FrameKinematics(*state.moving(frame, X_FJ, pin.LOCAL_WORLD_ALIGNED))

    def _number(self, name: str, times: Counter[str]) -> int:
        key = name, times[name]
        times[name] += 1
        return self._known.setdefault(key, self.first_number + len(self._known))


def points_of_pair(
    met: Meeting,
    shapes: tuple[ConvexShape, ConvexShape],
    bodies: tuple[FrameKinematics, FrameKinematics],
    numbers: Array,
    label: Callable[[int], str],
) -> Touching:
    """All contact points of two shapes, with the same axes."""
    R, k = contact_axes(met.normal), len(met.crossings)
    positions = np.array([at.position for at in met.crossings])
    turn = np.hstack([cross_matrix(e) for e in R.T])
    J, velocity, bias = np.zeros((3 * k, bodies[0].J.shape[1])), np.zeros(3 * k), np.zeros(3 * k)
    moves = bool(bodies[0].v.any() or bodies[1].v.any())
    for sign, body in ((1.0, bodies[0]), (-1.0, bodies[1])):
        A = np.empty((3 * k, 6))
        A[:, :3] = np.tile(sign * R.T, (k, 1))
        A[:, 3:] = sign * ((positions - body.X_WF.translation) @ turn).reshape(3 * k, 3)
        J += A @ body.J
        if moves:
            velocity += A @ body.v
            bias += A @ body.bias
    if moves:
        each = zip(met.crossings, velocity.reshape(k, 3), strict=True)
        bias += np.concatenate([_turning(met, shapes, bodies, at, R, g) for at, g in each])
    gaps = np.array([at.gap for at in met.crossings])
    return Touching(numbers, label, positions, np.tile(R, (k, 1, 1)), gaps, J, velocity, bias)


def _turning(
    met: Meeting,
    shapes: tuple[ConvexShape, ConvexShape],
    bodies: tuple[FrameKinematics, FrameKinematics],
    at: Crossing,
    R: Array,
    velocity: Array,
) -> Array:
    """Terms of J_dot v by the motion of the contact point and of the axes: the last term of g', and R'^T g, shape (3,)."""
    dn = _normal_rate(met, shapes, bodies, at)
    dp = _place_rate(met, shapes, bodies, at, dn, float(velocity[2]))
    one, other = (cross_matrix(body.v[3:]) @ (dp - body.v[:3]) for body in bodies)
    return R.T @ (one - other) + _axes_rate(R, dn).T @ (R @ velocity)


def _arm(r: Array) -> Array:
    """Maps a twist at the origin to the velocity at r, shape (3, 6)."""
    return np.hstack([np.eye(3), -cross_matrix(r)])


def _ball(shape: ConvexShape, number: int) -> RoundPart | None:
    i = number - len(shape.vertices)
    return shape.rounds[i] if 0 <= i < len(shape.rounds) and shape.rounds[i].is_ball else None


def _normal_rate(
    met: Meeting, shapes: tuple[ConvexShape, ConvexShape], bodies: tuple[FrameKinematics, FrameKinematics], at: Crossing
) -> Array:
    """Derivative of the normal [1/s]: it turns with its face, or with the line between a ball and a ball or corner."""
    if met.carrier:
        return cross_matrix(bodies[met.carrier - 1].v[3:]) @ met.normal
    balls = _ball(shapes[0], at.first), _ball(shapes[1], at.second)
    apart = at.gap + sum(ball.reach for ball in balls if ball is not None)
    if apart < 1e-9 or balls == (None, None):  # edges that cross: as if it turned with the second
        return cross_matrix(bodies[1].v[3:]) @ met.normal
    centres = [body.X_WF.act(ball.centre) if ball else at.position for ball, body in zip(balls, bodies, strict=True)]
    v = [_arm(c - body.X_WF.translation) @ body.v for c, body in zip(centres, bodies, strict=True)]
    relative = v[0] - v[1]
    return (relative - float(relative @ met.normal) * met.normal) / apart


def _place_rate(
    met: Meeting,
    shapes: tuple[ConvexShape, ConvexShape],
    bodies: tuple[FrameKinematics, FrameKinematics],
    at: Crossing,
    dn: Array,
    opening: float,
) -> Array:
    """Velocity p' of the contact point: that of the shape's point there, half the gap's change included."""
    for number, shape, body, sign in zip((at.first, at.second), shapes, bodies, (1.0, -1.0), strict=True):
        if number < 0:
            continue
        turn, R = cross_matrix(body.v[3:]), body.X_WF.rotation
        on_it = at.position + 0.5 * sign * at.gap * met.normal
        up, rate = sign * (R.T @ met.normal), sign * (R.T @ (dn - turn @ met.normal))
        rate = body.v[:3] + turn @ (on_it - body.X_WF.translation) + R @ shape.wander(number, up, rate)
        return rate - 0.5 * sign * (opening * met.normal + at.gap * dn)
    return _arm(at.position - bodies[0].X_WF.translation) @ bodies[0].v


def _axes_rate(R: Array, dn: Array) -> Array:
    """Derivative of `contact_axes(n)` where n changes at dn, shape (3, 3)."""
    t, s, n = R.T
    along = np.array([1.0, 0.0, 0.0]) if abs(n[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    u = along - float(along @ n) * n
    du = -float(along @ dn) * n - float(along @ n) * dn
    dt = (du - t * float(t @ du)) / float(np.linalg.norm(u))
    return np.column_stack([dt, cross_matrix(dn) @ t + cross_matrix(n) @ dt, dn])


class OnPlane:
    """Contact points of shapes with a plane, at rest or moving without turning. Not for two threads at once.

    Args:
        robot: The robot.
        shapes: Those that can touch, in the order of their joints.
        axes: R_WC, the plane's normal third, shape (3, 3).
        point: A point of the plane, in W, shape (3,) [m].
        ground: The plane's ground if it moves.
    """

    def __init__(
        self, robot: CheckedModel, shapes: Sequence[ConvexShape], axes: Array, point: Array, ground: Ground | None = None
    ) -> None:
        self.model, self.axes, self.height = robot.model, np.ascontiguousarray(axes), float(axes[:, 2] @ point)
        self._normal, self._ground = axes[:, 2].copy(), ground
        self.joints = sorted({shape.joint for shape in shapes})
        self._joints = np.array(self.joints)
        self.points = LowPoints(shapes, np.array([self.joints.index(shape.joint) for shape in shapes]))
        #: Which coordinates move each body, of zeros and ones, shape (bodies, nv).
        self._carries = np.array([robot.joints.carrying(joint) for joint in self.joints])
        self._prepare()

    def _prepare(self) -> None:
        self._data = self.model.createData()
        every = [self._data.oMi[j] for j in range(self.model.njoints)]  # views, which follow the data
        self._places = rows_from([(X.rotation, X.translation) for X in every], 12)

    def another(self) -> OnPlane:
        """The same with data of its own."""
        out = copy(self)
        out.points = self.points.another()
        out._prepare()
        return out

    def at(self, state: State, margin: float) -> Touching | None:
        """The points at most `margin` [m] above the plane at a state and its time, by their numbers; None if there are none."""
        q, v, ground, height = state.q, state.v, self._ground, self.height
        data, moves, nv = self._data, bool(v.any()), len(v)
        if ground is not None:
            height += float(self._normal @ ground.shift(state.t))
        if moves:
            pin.computeJointJacobiansTimeVariation(self.model, data, q, v)
        else:
            pin.computeJointJacobians(self.model, data, q)
        kernel, low, J_W = plane_kernel(), self.points, data.J.reshape(6, nv).T
        up, height = kernel.normals(self._places, self._joints, self._normal, height)
        numbers, gaps = low.near(up, height, margin)
        k, body = len(numbers), low.body.take(numbers)
        if not k:
            return None
        P, J = kernel.rows(low.points, numbers, body, self._places, self._joints, self.axes, self._carries, J_W)
        velocity, bias = np.zeros(3 * k), np.zeros(3 * k)
        if moves:
            velocity, bias = kernel.motion(
                P, body, low.part_of.take(numbers), self._places, self._joints, self.axes, up, self._carries, J_W,
                data.dJ.reshape(6, nv).T, v, low.roots, low.least,
            )  # fmt: skip
        if ground is not None:
            under = [np.tile(x[:3] @ self.axes, k) for x in motion_of(ground.at(state.t))]
            velocity, bias = velocity - under[0], bias - under[1]
        return Touching(numbers, self.label, P, self.axes, gaps, J, velocity, bias)

    def label(self, number: int) -> str:
        """The name of a point."""
        shape, point = self.points.label(number)
        return f"{shape}:{point}"
