"""Where force elements act: places on a frame of the robot or on the ground, how two of them move, and how that changes.

With p_e the place of an end and J_e its Jacobian in world axes, linear then angular, an element applies J_e^T w_e for a wrench
w_e at each end. As q moves, J_e^T w_e of a constant wrench changes too: that is the geometric stiffness. Column k of J_e moves
as a rigid body with all joints up to its own: for joints k and i, i nearer to the root,

    d(lin_k)/dq_i = ang_i x lin_k,    d(ang_k)/dq_i = ang_i x ang_k,    d(lin_i)/dq_k = ang_i x lin_k,    d(ang_i)/dq_k = 0.

Joints with several coordinates on one body (spherical, planar, free) count as one joint: their tangent space is the body's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, add_wrench, as_vector3, cross_matrix, lazy
from rbd.errors import InputError
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
    if not isinstance(frame, str):
        raise InputError(f"{what} is at {frame!r:.80}; expected the name of a frame of the robot, see robot.frames().")
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
            parts += [_cross(ang, beyond_lin) + _cross(before, lin), _cross(ang, beyond_ang)]
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


def _cross(a: Array, b: Array) -> Array:
    """Products of the columns, shape (3, n)."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
