"""Contact points of convex shapes and how they move over two bodies.

A contact point is no material point: the lowest point of a rolling ball stays below its centre. Let p' be the velocity of the
contact point, and v + w x (p - o), b + w' x (p - o) velocity and J_dot v of the body at p, o its joint. Then

    g  = v + w x (p - o)                        relative velocity of the material point at p
    g' = b + w' x (p - o) + w x (p' - v)        its rate of change, at v_dot = 0

For a corner p' = g, and g' is its classical acceleration. For a ball on the ground p' is the velocity of its centre, and there
is no centripetal part. For two bodies take the difference of the two; axes R that turn with the normal add R'^T g.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, cross_matrix, lazy
from rbd.constraints.convex.closest_points import Crossing, Meeting, meeting
from rbd.constraints.convex.solids import Ball, ConvexShape
from rbd.constraints.surface import contact_axes
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State


@dataclass(frozen=True, eq=False)
class Touching:
    """k contact points, in contact axes (tangent, tangent, normal), the normal out of the surface.

    Attributes:
        labels: Shape and number of the point, or the name of a crossing; joined into `names` on demand.
        positions: In W, shape (k, 3) [m].
        axes: R_WC of each, shape (k, 3, 3).
        gaps: Shape (k,) [m]; negative where shapes overlap.
        J: Jacobian of the relative velocity, shape (3k, nv).
        velocity: Shape (3k,) [m/s].
        bias: Shape (3k,) [m/s2].
    """

    labels: Sequence[tuple[str, int]]
    positions: Array
    axes: Array
    gaps: Array
    J: Array
    velocity: Array
    bias: Array

    @lazy
    def names(self) -> tuple[str, ...]:
        """Names that identify points over time: the same corner of the same shape has the same name."""
        return tuple(shape if number < 0 else f"{shape}:{number}" for shape, number in self.labels)


def joined(parts: Sequence[Touching], nv: int) -> Touching:
    """Several stacked; of none, no points."""
    if len(parts) == 1:
        return parts[0]
    if not parts:
        none = np.zeros(0)
        return Touching([], np.zeros((0, 3)), np.zeros((0, 3, 3)), none, np.zeros((0, nv)), none, none)
    return Touching(
        [label for part in parts for label in part.labels],
        *(np.concatenate([getattr(p, what) for p in parts]) for what in ("positions", "axes", "gaps", "J", "velocity", "bias")),
    )


@dataclass(frozen=True, eq=False)
class BodyMotion:
    """A joint's body: pose, Jacobian, velocity and J_dot v of its origin, world axes, linear then angular."""

    X: pin.SE3
    J: Array
    v: Array
    bias: Array


class Bodies:
    """Motions of bodies by joint index."""

    def __init__(self, robot: CheckedModel) -> None:
        self._marks: dict[int, tuple[str, pin.SE3]] = {}
        for frame in robot.frames():
            joint, X_JF = robot.site(frame)
            self._marks.setdefault(joint, (frame, X_JF.inverse()))
        nv = robot.nv
        self._world = BodyMotion(pin.SE3.Identity(), np.zeros((6, nv)), np.zeros(6), np.zeros(6))

    def at(self, state: State, joint: int) -> BodyMotion:
        """The motion of a joint's body; the world for joint 0."""
        if joint == 0:
            return self._world
        frame, X_FJ = self._marks[joint]
        return BodyMotion(*state.moving(frame, X_FJ, pin.LOCAL_WORLD_ALIGNED))


@dataclass(frozen=True, eq=False, slots=True)
class _Low:
    """Points of one shape near the plane, in its body's axes, and their gaps."""

    shape: ConvexShape
    numbers: list[int]
    points: Array
    gaps: Array


class OnPlane:
    """Contact points of shapes with a fixed plane.

    Args:
        robot: The robot.
        bodies: Its bodies.
        shapes: Those that can touch, in the order of their joints.
        axes: R_WC, the plane's normal third, shape (3, 3).
        point: A point of the plane, in W, shape (3,) [m].
    """

    def __init__(self, robot: CheckedModel, bodies: Bodies, shapes: Sequence[ConvexShape], axes: Array, point: Array) -> None:
        self.bodies, self.shapes, self.axes, self.height = bodies, shapes, axes, float(axes[:, 2] @ point)
        self.beyond = np.array([shape.reach for shape in shapes]) + self.height
        # For the potential energy of a body, the first four of its ten parameters: m, and m times the centre of mass.
        self.entries = 10 * (np.array([shape.joint for shape in shapes], int)[:, None] - 1) + np.arange(4)
        self.centres = np.array([[1.0, *shape.centre] for shape in shapes])
        # With gravity -n the potential energy of a unit mass at a point of a body is the point's height: z + up . c.
        self.model = robot.model.copy()
        self.model.gravity = pin.Motion(-axes[:, 2], np.zeros(3))
        self._same_axes: dict[int, Array] = {}
        self.turn = np.hstack([cross_matrix(e) for e in axes.T])  # maps r to r x e of the three axes

    def at(self, state: State, data: pin.Data, margin: float) -> list[Touching]:
        """The points that are at most `margin` above the plane, by body, stacked; empty if there are none.

        Args:
            state: The robot.
            data: Of `model`, under a lock.
            margin: [m].
        """
        table = pin.computePotentialEnergyRegressor(self.model, data, state.q)[self.entries]
        z, up = table[:, 0], table[:, 1:]
        above = np.add.reduce(table * self.centres, axis=1)
        found: dict[int, list[_Low]] = {}
        for i in (above <= margin + self.beyond).nonzero()[0].tolist():
            shape, n, height = self.shapes[i], up[i], float(z[i]) - self.height
            numbers, points = shape.low(n, margin - height)
            if numbers:
                found.setdefault(shape.joint, []).append(_Low(shape, numbers, points, points @ n + height))
        return [self._points(state, found)] if found else []

    def _points(self, state: State, found: dict[int, list[_Low]]) -> Touching:
        lows = [low for parts in found.values() for low in parts]
        gaps = np.concatenate([low.gaps for low in lows])
        k, moves = len(gaps), state.v.any()
        r, positions = np.empty((k, 3)), np.empty((k, 3))
        A = np.empty((k, 3, 6))  # maps the twist of a body at o to the velocities of its points, in contact axes
        A[:, :, :3] = self.axes.T
        J, velocity, bias = np.empty((3 * k, state.robot.nv)), np.zeros(3 * k), np.zeros(3 * k)
        end = 0
        for joint, parts in found.items():
            body, start = self.bodies.at(state, joint), end
            for low in parts:
                end += len(low.numbers)
                low.points.dot(body.X.rotation.T, out=r[end - len(low.numbers) : end])
            here = slice(start, end)
            rows = slice(3 * start, 3 * end)
            np.add(r[here], body.X.translation, out=positions[here])
            A[here, :, 3:] = r[here].dot(self.turn).reshape(-1, 3, 3)
            part = A[here].reshape(-1, 6)
            part.dot(body.J, out=J[rows])
            if moves:
                part.dot(body.v, out=velocity[rows])
                bias[rows] = part.dot(body.bias) + self._centripetal(body, r[here], parts)
        if k not in self._same_axes:
            self._same_axes[k] = np.broadcast_to(self.axes, (k, 3, 3))
        labels = [(low.shape.name, number) for low in lows for number in low.numbers]
        return Touching(labels, positions, self._same_axes[k], gaps, J, velocity, bias)

    def _centripetal(self, body: BodyMotion, r: Array, parts: Sequence[_Low]) -> Array:
        """The term w x (p' - v), in contact axes, shape (3k,)."""
        turn = cross_matrix(body.v[3:])
        moved = r.dot(turn.T)
        if any([low.shape.rounds for low in parts]):
            R = body.X.rotation
            up = R.T @ self.axes[:, 2]
            rate = -cross_matrix(R.T @ body.v[3:]) @ up
            moved += np.array([low.shape.wander(i, up, rate) for low in parts for i in low.numbers]) @ R.T
        return moved.dot(turn.T @ self.axes).reshape(-1)


class Between:
    """Contact points of pairs of shapes of two bodies.

    Args:
        robot: The robot.
        bodies: Its bodies.
        pairs: The pairs of shapes.
    """

    def __init__(self, robot: CheckedModel, bodies: Bodies, pairs: Sequence[tuple[ConvexShape, ConvexShape]]) -> None:
        self.bodies, self.pairs, self.model = bodies, pairs, robot.model
        shapes = list({id(s): s for pair in pairs for s in pair}.values())
        number = {id(s): i for i, s in enumerate(shapes)}
        self.shapes = shapes
        self.first = np.array([number[id(a)] for a, _ in pairs], int)
        self.second = np.array([number[id(b)] for _, b in pairs], int)
        self.within = np.array([a.reach + b.reach for a, b in pairs])

    def at(self, state: State, data: pin.Data, margin: float) -> list[Touching]:
        """The points of pairs whose gap is at most `margin`; arguments as `OnPlane.at`."""
        pin.forwardKinematics(self.model, data, state.q)
        X = {joint: pin.SE3(data.oMi[joint]) for joint in {shape.joint for shape in self.shapes}}
        centres = np.array([X[shape.joint].act(shape.centre) for shape in self.shapes])
        away = np.linalg.norm(centres[self.first] - centres[self.second], axis=1)
        motions: dict[int, BodyMotion] = {}
        found = []
        for i in np.flatnonzero(away - self.within <= margin).tolist():
            one, other = self.pairs[i]
            met = meeting(one, X[one.joint], other, X[other.joint], margin)
            if met is None:
                continue
            for joint in (one.joint, other.joint):
                if joint not in motions:
                    motions[joint] = self.bodies.at(state, joint)
            found.append(_pair(met, (one, other), (motions[one.joint], motions[other.joint])))
        return found


def _pair(met: Meeting, shapes: tuple[ConvexShape, ConvexShape], bodies: tuple[BodyMotion, BodyMotion]) -> Touching:
    """All contact points of two shapes, with the same axes."""
    R, k = contact_axes(met.normal), len(met.crossings)
    positions = np.array([at.position for at in met.crossings])
    turn = np.hstack([cross_matrix(e) for e in R.T])
    J, velocity, bias = np.zeros((3 * k, bodies[0].J.shape[1])), np.zeros(3 * k), np.zeros(3 * k)
    moves = bool(bodies[0].v.any() or bodies[1].v.any())
    for sign, body in ((1.0, bodies[0]), (-1.0, bodies[1])):
        A = np.empty((3 * k, 6))
        A[:, :3] = np.tile(sign * R.T, (k, 1))
        A[:, 3:] = sign * ((positions - body.X.translation) @ turn).reshape(3 * k, 3)
        J += A @ body.J
        if moves:
            velocity += A @ body.v
            bias += A @ body.bias
    if moves:
        each = zip(met.crossings, velocity.reshape(k, 3), strict=True)
        bias += np.concatenate([_turning(met, shapes, bodies, at, R, g) for at, g in each])
    gaps = np.array([at.gap for at in met.crossings])
    return Touching([(at.name, -1) for at in met.crossings], positions, np.tile(R, (k, 1, 1)), gaps, J, velocity, bias)


def _turning(
    met: Meeting,
    shapes: tuple[ConvexShape, ConvexShape],
    bodies: tuple[BodyMotion, BodyMotion],
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


def _ball(shape: ConvexShape, number: int) -> Ball | None:
    i = number - len(shape.vertices)
    part = shape.rounds[i] if 0 <= i < len(shape.rounds) else None
    return part if isinstance(part, Ball) else None


def _normal_rate(
    met: Meeting, shapes: tuple[ConvexShape, ConvexShape], bodies: tuple[BodyMotion, BodyMotion], at: Crossing
) -> Array:
    """Derivative of the normal [1/s]: it turns with its face, or with the line between a ball and a ball or corner."""
    if met.carrier:
        return cross_matrix(bodies[met.carrier - 1].v[3:]) @ met.normal
    balls = _ball(shapes[0], at.first), _ball(shapes[1], at.second)
    apart = at.gap + sum(ball.radius for ball in balls if ball is not None)
    if apart < 1e-9 or balls == (None, None):  # edges that cross: as if it turned with the second
        return cross_matrix(bodies[1].v[3:]) @ met.normal
    centres = [body.X.act(ball.centre) if ball else at.position for ball, body in zip(balls, bodies, strict=True)]
    v = [_arm(c - body.X.translation) @ body.v for c, body in zip(centres, bodies, strict=True)]
    relative = v[0] - v[1]
    return (relative - float(relative @ met.normal) * met.normal) / apart


def _place_rate(
    met: Meeting,
    shapes: tuple[ConvexShape, ConvexShape],
    bodies: tuple[BodyMotion, BodyMotion],
    at: Crossing,
    dn: Array,
    opening: float,
) -> Array:
    """Velocity p' of the contact point: that of the shape's point there, half the gap's change included."""
    for number, shape, body, sign in zip((at.first, at.second), shapes, bodies, (1.0, -1.0), strict=True):
        if number < 0:
            continue
        turn, R = cross_matrix(body.v[3:]), body.X.rotation
        on_it = at.position + 0.5 * sign * at.gap * met.normal
        up, rate = sign * (R.T @ met.normal), sign * (R.T @ (dn - turn @ met.normal))
        rate = body.v[:3] + turn @ (on_it - body.X.translation) + R @ shape.wander(number, up, rate)
        return rate - 0.5 * sign * (opening * met.normal + at.gap * dn)
    return _arm(at.position - bodies[0].X.translation) @ bodies[0].v


def _axes_rate(R: Array, dn: Array) -> Array:
    """Derivative of `contact_axes(n)` where n changes at dn, shape (3, 3)."""
    t, s, n = R.T
    along = np.array([1.0, 0.0, 0.0]) if abs(n[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    u = along - float(along @ n) * n
    du = -float(along @ dn) * n - float(along @ n) * dn
    dt = (du - t * float(t @ du)) / float(np.linalg.norm(u))
    return np.column_stack([dt, cross_matrix(dn) @ t + cross_matrix(n) @ dt, dn])
