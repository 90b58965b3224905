"""How a contact moves as seen from what it touches: ground at rest or in motion, another body, an anchor on either.

Let the surface move with velocity u, acceleration s, angular velocity W and angular acceleration W', all of the material
point of it that now touches. Seen from the surface, in axes that turn with it, a point with v and a of a body with w and w'
has

    v_rel = v - u          a_rel  = a - s - 2 W x v_rel
    w_rel = w - W          w'_rel = w' - W' - W x w_rel

(the point is on the surface now, so the centripetal acceleration is all in s; - 2 W x v_rel is Coriolis'). The surface is
the ground with a motion that is given, or another body of the robot: one formula serves both. Where u, s are known at
another point of the surface, from which the contact is r away, they are carried over:

    u + W x r              s + W' x r + W x (W x r)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, cross_matrix, lazy, zeros
from rbd.errors import InputError
from rbd.model.state import State
from rbd.problem.ground import Body, Ground, Surface

HERE = pin.SE3.Identity()


@dataclass(frozen=True, eq=False)
class RelativeMotion:
    """How a contact moves as seen from what it touches; world axes, linear then angular.

    Attributes:
        X_WP: Pose of the contact in W.
        X_WS: Pose of what it touches in W: of the other body's frame, or the identity for the ground.
        J: Jacobian of the relative velocity, shape (6, nv).
        v: Relative velocity J v - (u, W), shape (6,) [m/s, rad/s].
        bias: Relative acceleration when v_dot = 0, shape (6,) [m/s2, rad/s2].
    """

    X_WP: pin.SE3
    X_WS: pin.SE3
    J: Array
    v: Array
    bias: Array

    def in_axes(self, R: Array) -> tuple[Array, Array, Array]:
        """(J, velocity, J_dot v) in contact axes R_WC, six rows each."""
        J, v, bias = (np.concatenate([R.T @ x[:3], R.T @ x[3:]]) for x in (self.J, self.v, self.bias))
        return J, v, bias


@dataclass(frozen=True, eq=False)
class Counterpart:
    """What a contact touches, and where.

    Attributes:
        name: The contact's name.
        on: The ground or the body; None for ground at rest.
        anchor: Where the contact first touched, in W or in the body's axes; None where it does not matter.
    """

    name: str
    on: Surface
    anchor: pin.SE3 | None

    @lazy
    def still(self) -> bool:
        """Whether it is the ground at rest, with an anchor on it."""
        return self.on is None or (isinstance(self.on, Ground) and not self.on.moves)

    def motion(self, state: State, frame: str, X_FP: pin.SE3) -> RelativeMotion:
        """Motion of a pose P fixed to a frame, relative to what it touches.

        Raises:
            FrameNotFound: with the nearest names.
            InputError: if both frames are of one body.
        """
        X_WP, J, v, bias = state.moving(frame, X_FP, pin.LOCAL_WORLD_ALIGNED)
        if self.still:
            return RelativeMotion(X_WP, HERE, J, v, bias)
        p, X_WS = X_WP.translation, HERE
        if isinstance(self.on, Body):
            check_two_bodies(state, self.name, frame, self.on)
            X_WS, J_S, u, s = state.moving(self.on.frame, HERE, pin.LOCAL_WORLD_ALIGNED)
            r = p - X_WS.translation
            J = J - J_S
            J[:3] += cross_matrix(r) @ J_S[3:]  # - W x r
        else:
            assert self.on is not None
            u, s = motion_of(self.on)
            r = zeros(3) if self.on.about is None else p - self.on.about
        turn, W = cross_matrix(u[3:]), u[3:]
        u = np.concatenate([u[:3] + turn @ r, W])
        s = np.concatenate([s[:3] + cross_matrix(s[3:]) @ r + turn @ (turn @ r), s[3:]])
        v = v - u
        bias = bias - s
        bias[:3] -= 2.0 * turn @ v[:3]
        bias[3:] -= turn @ v[3:]
        return RelativeMotion(X_WP, X_WS, J, v, bias)

    def shift(self, motion: RelativeMotion, axes: Array) -> Array | None:
        """From the anchor to the contact's point, in contact axes R_WP, shape (3,) [m]; None without an anchor."""
        if self.anchor is None:
            return None
        return axes.T @ (motion.X_WP.translation - motion.X_WS.act(self.anchor.translation))

    def anchored_axes(self, motion: RelativeMotion) -> Array:
        """R_W0: the axes of the anchor in W; only where there is one."""
        assert self.anchor is not None
        return motion.X_WS.rotation @ self.anchor.rotation


def motion_of(ground: Ground) -> tuple[Array, Array]:
    """(velocity, acceleration) of a ground, shapes (6,); zero where none is given."""
    u, s = (zeros(6) if given is None else np.asarray(given) for given in (ground.velocity, ground.acceleration))
    return u, s


def check_two_bodies(state: State, name: str, frame: str, on: Body) -> None:
    """Refuse a contact between two frames of one body.

    Raises:
        FrameNotFound: with the nearest names.
        InputError: with both frames.
    """
    if state.robot.site(frame)[0] == state.robot.site(on.frame)[0]:
        raise InputError(
            f"contact {name!r} is between {frame!r} and {on.frame!r}, which are fixed to one body of {state.robot.name}; "
            "expected frames of two bodies that move against each other."
        )
