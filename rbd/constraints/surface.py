"""Motion of a contact relative to the surface: ground, another body, or an anchor on either; its axes and force sets.

Let the surface move with velocity u, acceleration s, angular velocity W and angular acceleration W', all of its material
point at the contact. Relative to the surface, in axes that turn with it, a point with v and a of a body with w and w'
has

    v_rel = v - u          a_rel  = a - s - 2 W x v_rel
    w_rel = w - W          w'_rel = w' - W' - W x w_rel

(the point is on the surface, so s contains the centripetal acceleration; - 2 W x v_rel is Coriolis'). The surface is
the ground with a given motion, or another body of the robot. Where u, s are given at
another point of the surface, at a distance r from the contact, they are converted:

    u + W x r              s + W' x r + W x (W x r)
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_finite, as_float, as_vector3, cross_matrix, lazy, zeros
from rbd.constraints.terrain.terrain import Terrain
from rbd.errors import InputError
from rbd.errors.inputs import check_known
from rbd.model.placement import rigid_placement
from rbd.model.state import State
from rbd.problem.cones import Cone, Free, FrictionCone, NonNegative
from rbd.problem.corner_cones import LineCone, WrenchCone
from rbd.problem.ground import FLOOR, Body, Ground, motion_of

Surface = Ground | Body | Terrain | None
"""A checked surface; None: ground at rest, its position not known."""
On = Surface | float
"""A surface as users give it: also the height of a level ground [m]."""
HERE = pin.SE3.Identity()
UP = np.array([0.0, 0.0, 1.0])
STEEPEST = 0.7
"""Largest cosine between line and normal: at 45 degrees to the surface it is no line contact."""


@dataclass(frozen=True, eq=False)
class RelativeMotion:
    """Motion of a contact relative to the surface; world axes, linear then angular.

    Attributes:
        X_WP: Pose of the contact in W.
        X_WS: Pose of the surface in W: of the other body's frame; of the ground how far its motion has moved it.
        J: Jacobian of the relative velocity, shape (6, nv).
        v: Relative velocity J v - (u, W), shape (6,) [m/s, rad/s].
        bias: Relative acceleration when v_dot = 0, shape (6,) [m/s2, rad/s2].
        ground: The ground as it is then; None for a body, or ground that is not known.
    """

    X_WP: pin.SE3
    X_WS: pin.SE3
    J: Array
    v: Array
    bias: Array
    ground: Ground | None = None

    def in_axes(self, R: Array) -> tuple[Array, Array, Array]:
        """(J, velocity, J_dot v) in contact axes R_WC, six rows each."""
        J, v, bias = (np.concatenate([R.T @ x[:3], R.T @ x[3:]]) for x in (self.J, self.v, self.bias))
        return J, v, bias


@dataclass(frozen=True, eq=False)
class Counterpart:
    """The surface that a contact touches, and the contact's anchor.

    Attributes:
        name: The contact's name.
        on: The ground or the body; None for ground at rest.
        anchor: Where the contact first touched, in W or in the body's axes; None if not needed.
    """

    name: str
    on: Surface
    anchor: pin.SE3 | None

    @lazy
    def still(self) -> bool:
        """Whether it is the ground at rest, with an anchor on it."""
        return self.on is None or (isinstance(self.on, Ground) and not self.on.moves)

    def motion(self, state: State, frame: str, X_FP: pin.SE3) -> RelativeMotion:
        """Motion of a pose P fixed to a frame, relative to the surface.

        Raises:
            FrameNotFound: with the nearest names.
            InputError: if both frames are of one body.
        """
        X_WP, J, v, bias = state.moving(frame, X_FP, pin.LOCAL_WORLD_ALIGNED)
        if self.still:
            return RelativeMotion(X_WP, HERE, J, v, bias, self.on if isinstance(self.on, Ground) else None)
        p, X_WS, on = X_WP.translation, HERE, None
        if isinstance(self.on, Body):
            check_two_bodies(state, self.name, frame, self.on)
            X_WS, J_S, u, s = state.moving(self.on.frame, HERE, pin.LOCAL_WORLD_ALIGNED)
            r = p - X_WS.translation
            J = J - J_S
            J[:3] += cross_matrix(r) @ J_S[3:]  # - W x r
        else:
            assert isinstance(self.on, Ground)
            on = self.on.at(state.t)
            u, s = motion_of(on)
            r = zeros(3) if on.about is None else p - on.about
            if on is not self.on:
                X_WS = pin.SE3(np.eye(3), self.on.shift(state.t))
        turn, W = cross_matrix(u[3:]), u[3:]
        u = np.concatenate([u[:3] + turn @ r, W])
        s = np.concatenate([s[:3] + cross_matrix(s[3:]) @ r + turn @ (turn @ r), s[3:]])
        v = v - u
        bias = bias - s
        bias[:3] -= 2.0 * turn @ v[:3]
        bias[3:] -= turn @ v[3:]
        return RelativeMotion(X_WP, X_WS, J, v, bias, on)

    def displacement(self, X_WP: pin.SE3, X_WS: pin.SE3, axes: Array, corners: int) -> Array:
        """From the anchor to a contact, in contact axes R_WC: the shift [m], then of an edge or a patch the rotation.

        Of an edge the rotation is that of its direction, x0 cross x. It needs an anchor.
        """
        assert self.anchor is not None
        X_W0 = self.anchor if X_WS is HERE else X_WS * self.anchor
        shift, turned = axes.T @ (X_WP.translation - X_W0.translation), X_W0.rotation.T @ axes
        if corners == 1:
            return shift
        return np.concatenate([shift, pin.log3(turned) if corners > 2 else [0.0, turned[0, 2], -turned[0, 1]]])


def jump_of(on: Surface) -> Callable[[float, float], float | None] | None:
    """Gives a time in an interval at which a ground's motion jumps [s], None if there is none; None without a motion."""
    if isinstance(on, Terrain):
        return on.jump
    return on.moved.jump if isinstance(on, Ground) and on.moved is not None else None


def check_own_friction(name: str, on: Surface, mu: object) -> None:
    """Refuse another coefficient than that of a terrain with its own.

    Raises:
        InputError: with the contact's name and the terrain's coefficient.
    """
    if isinstance(on, Terrain) and on.friction is not None and mu != on.friction:
        raise InputError(f"the friction of contact {name!r} is its terrain's, {on.friction:g}; give it there.")


def surface_of(name: str, on: object) -> Surface:
    """The surface that `on=` of a contact stands for: a ground, the height of a level one, a body, or None (not known).

    Raises:
        InputError: if it is none of these.
    """
    if on is None or isinstance(on, Ground | Body | Terrain):
        return on
    height = as_float(on)
    if not abs(height) < 1e100:
        raise InputError(
            f"on of {name!r:.80} is {on!r:.80}; expected rbd.Ground(point=..., normal=...), the height of a level ground [m], "
            "rbd.Body(frame), or None where it is not known."
        )
    return FLOOR if height == 0.0 else Ground(point=(0.0, 0.0, height))


def plane_of(name: str, on: object) -> Ground:
    """A ground whose plane is known.

    Raises:
        InputError: if it is a body, or a ground without a point.
    """
    ground = surface_of(name, on)
    if not isinstance(ground, Ground) or ground.point is None:
        raise InputError(f"on of {name!r:.80} is {on!r:.80}; expected rbd.Ground(point=..., normal=...), with a point.")
    return ground


def standing_plane(name: str, on: object, at: Array | None = None) -> Ground:
    """The plane of a contact: its ground's; through W's origin if only the normal is known; else z = 0.

    On terrain the one below a place `at`, in W, shape (3,) [m].

    Raises:
        InputError: the contact is with a body, or on terrain and it has no place.
    """
    surface = surface_of(name, on)
    if isinstance(surface, Terrain):
        if at is None or np.shape(at) != (3,):
            raise InputError(f"contact {name!r:.80} is on terrain: give its place, as pin.SE3 or (x, y, z).")
        return surface.ground_at(float(at[0]), float(at[1]))
    if isinstance(surface, Body):
        raise InputError(f"contact {name!r:.80} is with a body of the robot; expected one with the ground.")
    if surface is None or surface.normal is None:
        return FLOOR
    return surface if surface.point is not None else Ground(point=np.zeros(3), normal=surface.normal)


def surfaces_of(names: Sequence[str], on: On | Mapping[str, On]) -> dict[str, Surface]:
    """The surface under each of several feet.

    Args:
        names: Of the feet.
        on: One for all, or {foot: surface}; z = 0 for feet that are not named.

    Raises:
        UnknownName: an unknown foot, with the nearest names.
        InputError: neither a ground nor a body.
    """
    if not isinstance(on, Mapping):
        one = surface_of("the feet", on)
        return dict.fromkeys(names, one)
    for name in on:
        check_known("on names what is no foot,", name, names)
    return {name: surface_of(name, on.get(name, FLOOR)) for name in names}


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


def check_words(whose: str, **words: object) -> None:
    """Refuse names that are not strings.

    Args:
        whose: What they belong to, for messages.
        words: {role: name}.

    Raises:
        InputError: naming the role.
    """
    for what, value in words.items():
        if not isinstance(value, str) or not value:
            raise InputError(f"the {what} of {whose} is {value!r:.80}; expected a string, e.g. 'left_sole'.")


def check_state(state: State, name: str) -> None:
    """Refuse an object that is not a State.

    Raises:
        InputError: with the constraint's name.
    """
    if not isinstance(state, State):
        raise InputError(f"rows of {name!r:.80} want a State, got {type(state).__name__}. Make one: rbd.State(robot, q, v).")


def contact_axes(normal: Array, along: Array | None = None) -> Array:
    """R_WP with the normal as third column, the first along the projection of a direction.

    Without one, or where it is within 6 degrees of the normal, along that of W's x (of W's y for a normal along x).
    """
    if along is None or float(np.linalg.norm(along - (along @ normal) * normal)) < 0.1:
        along = np.array([1.0, 0.0, 0.0]) if abs(normal[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    t1 = along - (along @ normal) * normal
    t1 /= np.linalg.norm(t1)
    return np.column_stack([t1, np.cross(normal, t1), normal])


def out_along(n: Array) -> str:
    """The way out of a solid along a normal, shape (3,), in words."""
    x, y, z = (n + 0.0).tolist()
    return f" (out along ({x:.3g}, {y:.3g}, {z:.3g}))"


def unit_direction(what: str, given: Sequence[float] | Array) -> Array:
    """A direction, normalised.

    Raises:
        InputError: it is not three finite numbers, or has zero length.
    """
    out = as_vector3(what, given)
    length = float(np.linalg.norm(out))
    if not 1e-9 < length < 1e9:
        raise InputError(f"{what} has length {length:.3g}; expected a direction, e.g. (1, 0, 0).")
    return out / length


def shortest_turn(a: Array, b: Array, half: Array | None = None) -> Array:
    """The shortest rotation vector from one unit vector to another; for opposite ones about a unit vector, by default x."""
    axis = cross_matrix(a) @ b
    sine, cosine = float(np.linalg.norm(axis)), float(a @ b)
    if sine > 1e-12:
        return axis * (math.atan2(sine, cosine) / sine)
    return axis if cosine > 0.0 else math.pi * (np.array([1.0, 0.0, 0.0]) if half is None else half)


def edge_axes(name: str, x: Array, n: Array) -> Array:
    """R_WP of an edge along x: z is the normal n less its part along the edge.

    Raises:
        InputError: the edge is more than 45 degrees off the surface.
    """
    along = float(n @ x)
    if not abs(along) <= STEEPEST:
        raise InputError(
            f"the line of contact {name!r} is at {90.0 - np.rad2deg(np.arccos(min(1.0, abs(along)))):.0f} degrees to its "
            "surface; expected one along it (up to 45 are accepted). Is the placement's x along the line?"
        )
    z = n - along * x
    z /= np.linalg.norm(z)
    return np.column_stack([x, np.cross(z, x), z])


def cone_of(name: str, corners: Array, friction: float | Cone | None, facets: int) -> Cone:
    """Set of a contact's row forces.

    Raises:
        InputError: a set that is neither one of a corner's forces nor one of all rows.
    """
    k = len(corners)
    rows = {1: 3, 2: 5}.get(k, 6)
    if friction is None:
        return Free(rows)
    if isinstance(friction, Cone):
        if friction.dim not in (3, rows):
            raise InputError(
                f"the friction of contact {name!r} is a set of dimension {friction.dim}; expected 3, of the force at each "
                f"corner, or {rows}, of all its rows."
            )
        if friction.dim == rows:
            return friction
        return LineCone(float(corners[0, 0]), friction) if k == 2 else WrenchCone(corners, friction)
    mu = float(friction)
    if k == 1:
        return FrictionCone(mu, facets) if mu else NonNegative(1)
    return LineCone(float(corners[0, 0]), mu, facets) if k == 2 else WrenchCone(corners, mu, facets)


def anchor_of(name: str, anchor: pin.SE3 | Sequence[float] | Array | None, *, point: bool) -> pin.SE3 | None:
    """The anchor, as a placement."""
    if anchor is None:
        return None
    if point:
        return pin.SE3(np.eye(3), as_vector3(f"anchor of contact {name!r}", anchor))
    return rigid_placement(f"anchor of contact {name!r}", anchor)


def corners_of(name: str, corners: object, X_FP: pin.SE3) -> tuple[Array, pin.SE3]:
    """(corners from the centre, shape (k, 3), the placement of the centre): W's axes for a point, x along an edge."""
    given = as_finite(f"corners of contact {name!r}", corners, ("k", 2), ("k", 3))
    if not len(given):
        raise InputError(f"contact {name!r} has no corners; expected one or more, shape (k, 2) or (k, 3).")
    out = np.zeros((len(given), 3))
    out[:, : given.shape[1]] = given
    if len(out) == 1:
        return np.zeros((1, 3)), pin.SE3(np.eye(3), X_FP.act(out[0]))
    spread = np.linalg.svd(out - out.mean(axis=0), compute_uv=False)
    if len(out) > 2:
        if spread[1] <= 1e-9 * max(spread[0], 1e-300) or spread[0] == 0.0:
            raise InputError(f"corners of contact {name!r} lie on one line; a patch needs an area. For a line use LineContact.")
        return out, X_FP
    half = 0.5 * (out[0] - out[1])
    length = float(np.linalg.norm(half))
    if not length > 0.0:
        raise InputError(f"the two corners of contact {name!r} are one point; for a point use PointContact.")
    if half[1] or half[2] or half[0] < 0.0 or (out[0] + out[1]).any():
        x = half / length
        y = np.cross(UP, x) if abs(x[2]) < 0.99 else np.array([0.0, 1.0, 0.0])
        z = np.cross(x, y / np.linalg.norm(y))
        X_FP = X_FP * pin.SE3(np.column_stack([x, np.cross(z, x), z]), 0.5 * (out[0] + out[1]))
    return np.array([[length, 0.0, 0.0], [-length, 0.0, 0.0]]), X_FP
