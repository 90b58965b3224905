"""The surface that a contact touches: moving ground, another body, or an anchor on either.

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

import inspect
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_array, as_vector3, check_finite, cross_matrix, lazy
from rbd.constraints.contact_geometry import rigid_placement
from rbd.errors import InputError
from rbd.model.state import State

Contact = TypeVar("Contact")
_HERE = pin.SE3.Identity()


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


@dataclass(frozen=True, eq=False)
class Counterpart:
    """What a contact touches.

    Attributes:
        name: The contact's name.
        against: Frame of the other body; None for the ground.
        velocity: Of the ground's surface at `about`, world axes, linear then angular, shape (6,) [m/s, rad/s].
        acceleration: Likewise [m/s2, rad/s2].
        about: Point in W that they are given at; None for the contact's own point.
        anchor: Where the contact first touched, in W or in `against`'s axes; None where it does not matter.
    """

    name: str
    against: str | None
    velocity: Array
    acceleration: Array
    about: Array | None
    anchor: pin.SE3 | None

    @lazy
    def still(self) -> bool:
        """Whether it is the ground at rest, with an anchor on it."""
        return self.against is None and not (self.velocity.any() or self.acceleration.any())

    def motion(self, state: State, frame: str, X_FP: pin.SE3) -> RelativeMotion:
        """Motion of a pose P fixed to a frame, relative to what it touches.

        Raises:
            FrameNotFound: with the nearest names.
            InputError: if both frames are of one body.
        """
        X_WP, J, v, bias = state.moving(frame, X_FP, pin.LOCAL_WORLD_ALIGNED)
        if self.still:
            return RelativeMotion(X_WP, _HERE, J, v, bias)
        p, X_WS, u, s = X_WP.translation, _HERE, self.velocity, self.acceleration
        r = np.zeros(3) if self.about is None else p - self.about
        if self.against is not None:
            if state.robot.site(frame)[0] == state.robot.site(self.against)[0]:
                raise InputError(
                    f"contact {self.name!r} is between {frame!r} and {self.against!r}, which are fixed to one body "
                    f"of {state.robot.name}; expected frames of two bodies that move against each other."
                )
            X_WS, J_S, u, s = state.moving(self.against, _HERE, pin.LOCAL_WORLD_ALIGNED)
            r = p - X_WS.translation
            J = J - J_S
            J[:3] += cross_matrix(r) @ J_S[3:]  # - W x r
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


def counterpart(
    name: str,
    frame: str,
    against: str | None,
    velocity: Sequence[float] | Array | None,
    acceleration: Sequence[float] | Array | None,
    about: Sequence[float] | Array | None,
    anchor: pin.SE3 | None,
) -> Counterpart | None:
    """What a contact touches, from a user's arguments; None for a ground at rest, which has a shorter way.

    Raises:
        InputError: shapes that do not fit, or what excludes each other.
    """
    if all(given is None for given in (against, velocity, acceleration, about, anchor)):
        return None
    u, s = twist(f"velocity of contact {name!r}", velocity), twist(f"acceleration of contact {name!r}", acceleration)
    if about is not None:
        about = as_vector3(f"about of contact {name!r}", about)
        if velocity is None and acceleration is None:
            raise InputError(f"contact {name!r} has about= without velocity= or acceleration=: it says where these are given.")
    if against is not None:
        if not isinstance(against, str) or not against:
            raise InputError(f"against of contact {name!r} is {against!r:.80}; expected a frame of the other body.")
        if against == frame:
            raise InputError(f"contact {name!r} is between {frame!r} and itself; expected a frame of another body.")
        if velocity is not None or acceleration is not None:
            raise InputError(
                f"contact {name!r} has both against= and a motion of the surface; the body of {against!r} moves as the "
                "state says. Leave velocity= and acceleration= out."
            )
    return Counterpart(name, against, u, s, None if about is None else np.asarray(about), anchor)


def twist(what: str, value: Sequence[float] | Array | None) -> Array:
    """Linear and angular parts, shape (6,); a missing angular part, or None, is zero.

    Raises:
        InputError: if it is neither three nor six finite numbers.
    """
    out = np.zeros(6)
    if value is None:
        return out
    given = as_array(what, value)
    if given.shape not in ((3,), (6,)):
        raise InputError(
            f"{what} has shape {given.shape}; expected (3,), linear, or (6,), linear then angular, in world axes: how the "
            "surface moves."
        )
    check_finite(what, given)
    out[: len(given)] = given
    return out


def anchor_point(name: str, anchor: Sequence[float] | Array | None) -> pin.SE3 | None:
    """A point's anchor, or None.

    Raises:
        InputError: if it is not three finite numbers.
    """
    return None if anchor is None else pin.SE3(np.eye(3), as_vector3(f"anchor of contact {name!r}", anchor))


def anchor_placement(name: str, anchor: pin.SE3 | Array | None) -> pin.SE3 | None:
    """A patch's anchor, or None.

    Raises:
        InputError: if it is no rigid placement.
    """
    return None if anchor is None else rigid_placement(f"anchor of contact {name!r}", anchor)


def remember(contact: object, touched: Counterpart | None, **given: object) -> None:
    """Put what a contact touches, and what it was given about that, into its fields, as the counterpart has checked them."""
    put = object.__setattr__
    put(contact, "against", given["against"])
    for what in ("velocity", "acceleration"):
        put(contact, what, None if given[what] is None or touched is None else getattr(touched, what))
    put(contact, "about", None if touched is None else touched.about)
    put(contact, "_touched", touched)


def changed(contact: Contact, **changes: Any) -> Contact:
    """The same contact with some of its arguments changed."""
    given = {key: getattr(contact, key) for key in inspect.signature(type(contact)).parameters if hasattr(contact, key)}
    return type(contact)(**(given | changes))
