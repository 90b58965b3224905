"""Coordinates of force elements: their places, lengths, angles and relative poses, with rates and second derivatives.

Each has x, shape (m,), and D, shape (m, 12), with x_dot = D u of the ends' velocities u
(`rbd.constraints.forces.coordinates.Pair`). A force F conjugate to x is then the wrenches D^T F at the ends, and the gradient
of an energy E(x) is D^T dE/dx. `force_change` and `rate_change` are how D^T F and D u change as the ends move, by (dp, turn) of
each in world axes.

With p_e the place of an end and J_e its Jacobian in world axes, linear then angular, an element applies J_e^T w_e for a wrench
w_e at each end. As q moves, J_e^T w_e of a constant wrench changes too: that is the geometric stiffness. Column k of J_e moves
as a rigid body with all joints up to its own: for joints k and i, i nearer to the root,

    d(lin_k)/dq_i = ang_i x lin_k,    d(ang_k)/dq_i = ang_i x ang_k,    d(lin_i)/dq_k = ang_i x lin_k,    d(ang_i)/dq_k = 0.

Joints with several coordinates on one body (spherical, planar, free) count as one joint: their tangent space is the body's.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, add_wrench, as_vector3, cross_matrices, cross_matrix, cross_rows, lazy
from rbd.errors import InputError
from rbd.errors.inputs import check_kind
from rbd.model.checked_model import FARTHEST
from rbd.model.state import State


@dataclass(frozen=True, eq=False)
class Place:
    """A point with axes, fixed to a frame of the robot or to the ground.

    Attributes:
        frame: The frame; None: the ground, W.
        p: The point in the frame's axes, or in W, shape (3,) [m].
        R: Its axes in those of the frame, or of W, shape (3, 3).
    """

    frame: str | None
    p: Array
    R: Array

    def __str__(self) -> str:
        at = f"({self.p[0]:.6g}, {self.p[1]:.6g}, {self.p[2]:.6g})"
        if self.frame is None:
            return f"the ground at {at}"
        return f"{self.frame} at {at}" if self.p.any() else self.frame


Anchor: TypeAlias = str | Sequence[float] | Array | pin.SE3
"""The other end of an element: a frame's name, or a point of the ground (3,) in W [m], or a pose on the ground."""
Offset: TypeAlias = Sequence[float] | Array | pin.SE3
"""From a frame's origin, in its axes: a point (3,) [m], or a pose, whose axes then count."""


def place_on(what: str, frame: str, offset: Offset) -> Place:
    """A place on a frame of the robot.

    Raises:
        InputError: no name, or an offset that is neither three finite numbers nor a pose.
    """
    check_kind(f"the frame of {what}", frame, str, "the name of a frame of the robot, see robot.frames()")
    return Place(frame, *_pose(f"offset of {what}", offset))


def other_place(what: str, to: Anchor, offset: Offset) -> Place:
    """The other end of an element, on a frame or on the ground.

    Raises:
        InputError: `to` is none, or a point of the ground has an offset besides.
    """
    if isinstance(to, str):
        return place_on(what, to, offset)
    if isinstance(offset, pin.SE3) or as_vector3(f"to_offset of {what}", offset).any():
        raise InputError(f"{what} ends on the ground, and to_offset is given too; give the point of the ground as `to`.")
    if to is None or isinstance(to, bool | int | float):
        raise InputError(f"{what} ends at {to!r:.80}; expected a frame's name, or a point of the ground: to=(0, 0, 2).")
    return Place(None, *_pose(f"to of {what}", to))


def _pose(what: str, given: Offset) -> tuple[Array, Array]:
    p, R = (
        (given.translation.copy(), given.rotation.copy())
        if isinstance(given, pin.SE3)
        else (as_vector3(what, given), np.eye(3))
    )
    if not np.abs(p).max() <= FARTHEST:
        raise InputError(f"{what} is {p.tolist()!r:.80}; expected finite numbers of at most {FARTHEST:g} m.")
    if not np.abs(R.T @ R - np.eye(3)).max() < 1e-9:
        raise InputError(f"{what} has axes that are not orthonormal: R^T R differs from one by more than 1e-9.")
    return p, R


class Pair:
    """The two ends of an element at a state: `to` first, then `frame`. Velocities and wrenches of both are in one vector.

    Attributes:
        J: Jacobians, shape (12, nv): linear and angular of `to`, then of `frame`, in world axes; zero on the ground.
        u: J v, shape (12,) [m/s, rad/s].
        points: Shape (2, 3) [m].
        R: Axes of the place at `to`, in W, shape (3, 3).
        R_other: Axes of the place at `frame`, in W.
    """

    def __init__(self, state: State, to: Place, at: Place) -> None:
        self.state = state
        self._grounded = to.frame is None
        ends = [_moving(state, place) for place in (to, at)]
        self.points = np.array([X.translation for X, _, _ in ends])
        self.R, self.R_other = ends[0][0].rotation, ends[1][0].rotation
        self.J = np.concatenate([J for _, J, _ in ends])
        self.u = np.concatenate([u for _, _, u in ends])

    def outside(self, w: Array) -> Array:
        """The wrench that the ground applies to the robot by wrenches w (12,), about the centre of mass, shape (6,)."""
        if not self._grounded:
            return np.zeros(6)
        out = [0.0] * 6
        add_wrench(out, w[6:].tolist(), self.points[1].tolist(), self.state.com.tolist())
        return np.array(out)

    @lazy
    def _deeper(self) -> Array:
        """Whether coordinate k belongs to a joint at least as far from the root as that of i, entry (k, i), shape (nv, nv)."""
        pieces = self.state.robot.joints.pieces
        order = np.repeat(np.arange(len(pieces)), [piece.nv for piece in pieces])
        return np.asarray(order[:, None] >= order[None, :])

    def geometric(self, w: Array) -> Array:
        """d(J^T w)/dq of constant wrenches w (12,), shape (nv, nv)."""
        out = np.zeros((self.J.shape[1],) * 2)
        for lin, ang, f, m in self._ends(w):
            if not (f.any() or m.any()):
                continue
            tilted = lin.T @ cross_matrix(f) @ ang  # entry (k, i): f . (ang_i x lin_k)
            turned = ang.T @ cross_matrix(m) @ ang
            out += np.where(self._deeper, tilted + turned, tilted.T)
        return out

    def velocity_dq(self) -> Array:
        """d(J v)/dq of constant v, shape (12, nv)."""
        v, deeper = self.state.v, self._deeper
        parts: list[Array] = []
        for lin, ang, _, _ in self._ends(np.zeros(12)):
            beyond_lin, beyond_ang = (lin * v) @ deeper, (ang * v) @ deeper  # of the joints that coordinate i carries
            before = (ang * v) @ ~deeper
            turned = cross_rows(ang.T, beyond_lin.T) + cross_rows(before.T, lin.T)
            parts += [turned.T, cross_rows(ang.T, beyond_ang.T).T]
        return np.concatenate(parts)

    def _ends(self, w: Array) -> list[tuple[Array, Array, Array, Array]]:
        J = self.J
        return [(J[k : k + 3], J[k + 3 : k + 6], w[k : k + 3], w[k + 3 : k + 6]) for k in (0, 6)]


def _moving(state: State, place: Place) -> tuple[pin.SE3, Array, Array]:
    X = pin.SE3(place.R, place.p)
    if place.frame is None:
        return X, np.zeros((6, state.robot.nv)), np.zeros(6)
    X_WP, J, u, _ = state.moving(place.frame, X, pin.LOCAL_WORLD_ALIGNED)
    return X_WP, J, u


SHORTEST = 1e-9
"""A line shorter than this has no direction [m]."""
WIDEST = math.radians(170.0)
"""Largest angle between two frames [rad]: it is known up to full turns only, and beyond half a turn would change its sign."""
_SERIES = (1 / 12, 1 / 720, 1 / 30240, 1 / 1209600, 1 / 47900160, 691 / 1307674368000, 1 / 74724249600)


_SHIFT, _TURN, _FIRST = (np.kron([signs], np.eye(3)) for signs in ((-1, 0, 1, 0), (0, -1, 0, 1), (0, 1, 0, 0)))
"""v_2 - v_1, w_2 - w_1 and w_1 of the velocities of both ends."""


class Coordinates(Protocol):
    """Coordinates x of an element at a state, and D of their rates D u, shape (m, 12)."""

    x: Array
    D: Array

    def change(self) -> Array:
        """[k, i, j]: how D[k, i] changes with motion j of both ends, shape (m, 12, 12)."""


class Distance:
    """The distance of two points, x = |d|.

    Raises:
        InputError: it is zero, so that the line has no direction.
    """

    def __init__(self, pair: Pair, what: str) -> None:
        d = pair.points[1] - pair.points[0]
        self._length = math.sqrt(float(d @ d))
        if not self._length > SHORTEST:
            raise InputError(
                f"{what} has zero length at this state, where the line between its ends has no direction. Move an end; "
                "a spring with rest=0 and preload=0 may have zero length."
            )
        self.x = np.array([self._length])
        self.D = (d / self._length @ _SHIFT)[None]

    def change(self) -> Array:
        """Of the direction: (1 - n n^T) / L."""
        return (_SHIFT.T @ _SHIFT - self.D.T @ self.D)[None] / self._length


class Vector:
    """The vector from one point to the other, in world axes: smooth where the distance is not."""

    def __init__(self, pair: Pair) -> None:
        self.x = pair.points[1] - pair.points[0]
        self.D = _SHIFT

    def change(self) -> Array:
        """Zero."""
        return np.zeros((3, 12, 12))


class _AboutAxis:
    """A rate about an axis g in the axes of the first place: D u = (R g) . (w_2 - w_1), where g changes by dg of that turn."""

    def __init__(self, pair: Pair, g: Array, dg: Array) -> None:
        self._g, self._dg = pair.R @ g, pair.R @ dg @ pair.R.T
        self.D = (self._g @ _TURN)[None]

    def change(self) -> Array:
        """Of the axis."""
        return (_TURN.T @ (self._dg @ _TURN - cross_matrix(self._g) @ _FIRST))[None]


class Angle(_AboutAxis):
    """The angle of the second place's axes about an axis a, relative to the first: the twist of the rotation between them.

    Of the unit quaternion (e, w) between the axes it is 2 atan2(a . e, w), in (-pi, pi]. In a hinge about a it is the hinge's
    angle, whatever else is fixed between; its rate is g . w with g = (w^2 a + w e x a + (a . e) e) / (w^2 + (a . e)^2).

    Raises:
        InputError: the axes are tilted by more than 170 degrees against each other, or the angle less `rest` is beyond that.
    """

    def __init__(self, pair: Pair, axis: Array, rest: float, what: str) -> None:
        quaternion = pin.Quaternion(pair.R.T @ pair.R_other).coeffs()
        e, w = quaternion[:3], float(quaternion[3])
        s = float(axis @ e)
        n = w * w + s * s
        if not n > math.cos(0.5 * WIDEST) ** 2:
            tilt = math.degrees(2.0 * math.acos(min(1.0, math.sqrt(n))))
            raise InputError(
                f"{what} has its axis in one frame tilted by {tilt:.0f} degrees from "
                "that in the other; beyond 170 degrees there is no angle about it. Take another axis."
            )
        across = cross_matrix(e) @ axis
        g = (w * w * axis + w * across + s * e) / n
        dw, de = -0.5 * e, 0.5 * (w * np.eye(3) - cross_matrix(e))
        ds = axis @ de
        dN = np.outer(2.0 * w * axis + across, dw) - w * cross_matrix(axis) @ de + np.outer(e, ds) + s * de
        super().__init__(pair, g, (dN - np.outer(g, 2.0 * w * dw + 2.0 * s * ds)) / n)
        self.x = np.array([rest + from_rest(2.0 * math.atan2(s, w), rest, what)])


class Spin(_AboutAxis):
    """The angular velocity of the second place relative to the first, about an axis fixed in the first; x is not known."""

    def __init__(self, pair: Pair, axis: Array) -> None:
        super().__init__(pair, axis, np.zeros((3, 3)))
        self.x = np.zeros(1)


class Pose:
    """The second place in the axes of the first: position and rotation vector, x = (R^T d, log R^T R_2).

    Args:
        pair: The places.
        what: Names the element in errors.
        turns: Whether F depends on the rotation; where it does not, that counts as zero beyond 170 degrees.

    Raises:
        InputError: the rotation is beyond 170 degrees.
    """

    def __init__(self, pair: Pair, what: str, *, turns: bool = True) -> None:
        R, d = pair.R, pair.points[1] - pair.points[0]
        theta, angle = rotation_vector(R.T @ pair.R_other)
        known = angle <= WIDEST
        if turns and not known:
            raise too_far(what, angle, "A rotation vector is known up to half a turn.")
        self._R, self._d, self._theta = R, d, theta if known else np.zeros(3)
        self._inverse = inverse_left_jacobian(theta) if known else np.zeros((3, 3))
        self._shift = _SHIFT + cross_matrix(d) @ _FIRST
        self.x = np.concatenate([R.T @ d, self._theta])
        self.D = np.concatenate([R.T @ self._shift, self._inverse @ R.T @ _TURN])

    def change(self) -> Array:
        """Of the first place's axes, the lever arm, and the map from turns to rotation vectors."""
        R = self._R
        linear = R.T @ (cross_matrices(self._shift.T) @ _FIRST - cross_matrices(_FIRST.T) @ _SHIFT)
        angular = inverse_change(self._theta, _TURN.T @ R) @ self.D[3:] + self._inverse @ R.T @ cross_matrices(_TURN.T) @ _FIRST
        return np.concatenate([linear, angular], axis=1).transpose(1, 0, 2)


def from_rest(angle: float, rest: float, what: str) -> float:
    """An angle known up to full turns, less the rest angle, within 170 degrees of it.

    Raises:
        InputError: it is farther.
    """
    found = math.remainder(angle - rest, 2.0 * math.pi)
    if not abs(found) <= WIDEST:
        raise too_far(what, abs(found), "Angles between frames, and those of continuous joints, are known up to full turns.")
    return found


def too_far(what: str, angle: float, why: str) -> InputError:
    """The error of an element that is turned almost by half a turn."""
    return InputError(
        f"{what} is {math.degrees(angle):.0f} degrees from its rest; at most 170 are taken. {why} Move `rest` and add what "
        "that takes away as `preload`, or use rbd.JointSpring in a revolute joint with limits, which counts turns."
    )


def rotation_vector(R: Array) -> tuple[Array, float]:
    """(log R, its length), shape (3,) [rad]."""
    quaternion = pin.Quaternion(R).coeffs()
    if quaternion[3] < 0.0:
        quaternion = -quaternion
    sine = math.sqrt(float(quaternion[:3] @ quaternion[:3]))
    angle = 2.0 * math.atan2(sine, float(quaternion[3]))
    return quaternion[:3] * (angle / sine if sine > 1e-9 else 2.0), angle


def _coefficients(theta: Array) -> tuple[float, float]:
    """(c, dc/ds) of s = |theta|^2, c = (1 - t/2 cot t/2) / t^2 with t = |theta|."""
    s = float(theta @ theta)
    if s < 0.25:
        return (
            sum([b * s**k for k, b in enumerate(_SERIES)]),
            sum([k * b * s ** (k - 1) for k, b in enumerate(_SERIES) if k]),
        )
    t = math.sqrt(s)
    cot = 1.0 / math.tan(0.5 * t)
    whole = 1.0 - 0.5 * t * cot
    return whole / s, (0.25 * t / math.sin(0.5 * t) ** 2 - 0.5 * cot) / (2.0 * t * s) - whole / (s * s)


def inverse_left_jacobian(theta: Array) -> Array:
    """The rate of a rotation vector per angular velocity in the first axes, 1 - [theta]/2 + c [theta]^2, shape (3, 3)."""
    T = cross_matrix(theta)
    return np.asarray(np.eye(3) - 0.5 * T + _coefficients(theta)[0] * (T @ T))


def inverse_change(theta: Array, m: Array) -> Array:
    """How that matrix times constant vectors m, shape (..., 3), changes with theta, shape (..., 3, 3)."""
    c, dc = _coefficients(theta)
    T = cross_matrix(theta)
    squared = (m @ theta)[..., None, None] * np.eye(3) + theta[:, None] * m[..., None, :] - 2.0 * m[..., None] * theta
    return np.asarray(0.5 * cross_matrices(m) + c * squared + 2.0 * dc * (m @ (T @ T).T)[..., None] * theta)
