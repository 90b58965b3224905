"""Balls, disks and wheels on a plane: the point of contact moves over the body, and the material there is at rest.

Let c be the centre, r d the way from it to the lowest point, n the plane's normal. The rows are the velocity of the material
point that touches now, as seen from the plane, in axes R of the contact:

    y = R^T g        g = v_c + w x (r d) - u        u = the plane's own velocity at that point

and their J_dot v is the derivative of that number, in which r d' is the motion of the contact over the body:

    y' = R^T g' + R'^T g        g' = a_c + w' x (r d) + w x (r d') - du/dt

It is not the acceleration of the material point: that has w x (w x r d) in place of w x (r d'). It points into the body, so
that a ball that rolls would seem to lift off, or be held down with w^2 r. The normal row is the derivative of the height of
the lowest point, its `error`; the others have none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_float, as_vector3, cross_matrix
from rbd.constraints.contact_geometry import check_state, contact_axes, unit_normal
from rbd.constraints.nonholonomic import check_words, unit_direction
from rbd.constraints.surface import twist
from rbd.errors import InputError
from rbd.model.state import State
from rbd.problem.cones import Cone, Free, FrictionCone, NonNegative, check_friction
from rbd.problem.ground import Ground
from rbd.problem.rows import Patch, Rows

_HERE = pin.SE3.Identity()
_FLAT = 1e-4
"""Sine of the angle between a disk and its plane below which it lies flat: its lowest point is not one point."""


@dataclass(frozen=True, eq=False)
class RollingBall:
    """A ball on a plane.

    Three rows (tangent, tangent, normal) of the plane's axes. `friction=None` rolls: it neither slips nor leaves, and may
    spin about the normal. `friction=mu` presses and rubs: it slips where it must, and `rbd.ConeSolver` takes one that does.
    `friction=0.0` only presses: the normal row alone. Rolling and spinning resistance are left out.

    `solution.forces[name]` is the force on the ball at its lowest point, shape (3,), in world axes.

    Attributes:
        name: The contact's role, e.g. "ball".
        frame: Frame of the robot at the ball's centre.
        radius: [m].
        point: Any point of the plane, in W, shape (3,) [m].
        normal: Of the plane, to the ball's side, a unit vector in W, shape (3,).
        friction: Coulomb's coefficient, or None.
        facets: Facets of the pyramid that a QP puts in place of the cone; see `PointContact`.
        velocity: Of the plane's material, as of a turntable or a belt, world axes: linear (3,), or linear and angular (6,)
            [m/s, rad/s]; zero if not given.
        acceleration: Likewise of its material point at `about` [m/s2, rad/s2].
        about: Point in W where these are given, as a point on a turntable's axis, shape (3,) [m]; `point` if not given.

    Raises:
        InputError: a radius that is not above zero, negative friction, a normal that is not of unit length.
    """

    name: str
    frame: str
    radius: float = field(kw_only=True)
    point: Sequence[float] | Array = field(default=(0.0, 0.0, 0.0), kw_only=True)
    normal: Sequence[float] | Array = field(default=(0.0, 0.0, 1.0), kw_only=True)
    friction: float | None = field(default=None, kw_only=True)
    facets: int = field(default=4, kw_only=True)
    velocity: Sequence[float] | Array | None = field(default=None, kw_only=True)
    acceleration: Sequence[float] | Array | None = field(default=None, kw_only=True)
    about: Sequence[float] | Array | None = field(default=None, kw_only=True)
    _plane: Plane = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_plane", _plane(self))

    def rows(self, state: State) -> Rows:
        """Three rows (tangent, tangent, normal), or the normal one alone without friction.

        Raises:
            FrameNotFound: with the nearest names.
        """
        check_state(state, self.name)
        P, body = self._plane, _Body(*state.moving(self.frame, _HERE, pin.LOCAL_WORLD_ALIGNED))
        R = P.axes
        return _rows(self, P, body, -P.n, -P.n_rate, R, P.turning @ R)


@dataclass(frozen=True, eq=False)
class RollingDisk:
    """A thin disk on a plane, upright or leaning: a coin, a hoop, a wheel of a bicycle.

    Three rows (heading, side, normal): the heading is where a positive spin about `axis` rolls it to, axis x normal, the side
    is towards the axis. The contact is the lowest point of the rim, which moves on the rim. Friction as of `RollingBall`, in
    whose words the other attributes are told. A disk that lies flat touches along its rim and is refused.

    Attributes:
        name: The contact's role, e.g. "front_wheel".
        frame: Frame of the robot at the disk's centre.
        radius: [m].
        axis: About which it spins, in the frame's axes, of any length, shape (3,).
        point: Of the plane.
        normal: Of the plane.
        friction: Coulomb's coefficient, or None.
        facets: Of its pyramid.
        velocity: Of the plane's material.
        acceleration: Likewise.
        about: Where these are given.

    Raises:
        InputError: as of `RollingBall`; an axis of no length.
    """

    name: str
    frame: str
    radius: float = field(kw_only=True)
    axis: Sequence[float] | Array = field(default=(0.0, 1.0, 0.0), kw_only=True)
    point: Sequence[float] | Array = field(default=(0.0, 0.0, 0.0), kw_only=True)
    normal: Sequence[float] | Array = field(default=(0.0, 0.0, 1.0), kw_only=True)
    friction: float | None = field(default=None, kw_only=True)
    facets: int = field(default=4, kw_only=True)
    velocity: Sequence[float] | Array | None = field(default=None, kw_only=True)
    acceleration: Sequence[float] | Array | None = field(default=None, kw_only=True)
    about: Sequence[float] | Array | None = field(default=None, kw_only=True)
    _plane: Plane = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_plane", _plane(self))
        object.__setattr__(self, "axis", unit_direction(f"axis of {self.name!r:.80}", self.axis))

    def rows(self, state: State) -> Rows:
        """Three rows (heading, side, normal), or the normal one alone without friction.

        Raises:
            FrameNotFound: with the nearest names.
            InputError: the disk lies flat.
        """
        return _disk_rows(self, state, self._plane, np.asarray(self.axis))


@dataclass(frozen=True, eq=False)
class RollingWheel:
    """A wheel of a vehicle that cannot leave its plane: it rolls without slip and does not slide sideways.

    Two rows (heading, side), those of `RollingDisk` without the normal one, which is empty for a vehicle on a planar joint:
    its joints carry it. A vehicle that is free in space wants `RollingDisk`, or `friction=mu`: then the rows are those of
    the disk, with the normal, and the wheel may slip; that is refused where the vehicle cannot press on the plane.

    Attributes:
        name: The contact's role, e.g. "left_wheel".
        frame: Frame of the robot at the wheel's centre, on the wheel, which spins.
        radius: [m].
        axis: About which it spins, in the frame's axes, shape (3,).
        point: Of the plane.
        normal: Of the plane.
        friction: Coulomb's coefficient, or None.
        facets: Of its pyramid.
        velocity: Of the plane's material.
        acceleration: Likewise.
        about: Where these are given.

    Raises:
        InputError: as of `RollingDisk`.
    """

    name: str
    frame: str
    radius: float = field(kw_only=True)
    axis: Sequence[float] | Array = field(default=(0.0, 1.0, 0.0), kw_only=True)
    point: Sequence[float] | Array = field(default=(0.0, 0.0, 0.0), kw_only=True)
    normal: Sequence[float] | Array = field(default=(0.0, 0.0, 1.0), kw_only=True)
    friction: float | None = field(default=None, kw_only=True)
    facets: int = field(default=4, kw_only=True)
    velocity: Sequence[float] | Array | None = field(default=None, kw_only=True)
    acceleration: Sequence[float] | Array | None = field(default=None, kw_only=True)
    about: Sequence[float] | Array | None = field(default=None, kw_only=True)
    _plane: Plane = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_plane", _plane(self))
        object.__setattr__(self, "axis", unit_direction(f"axis of {self.name!r:.80}", self.axis))

    def rows(self, state: State) -> Rows:
        """Two rows (heading, side); with friction as `RollingDisk`.

        Raises:
            FrameNotFound: with the nearest names.
            InputError: the wheel lies flat; it has friction, and the vehicle cannot press it on the plane.
        """
        rows = _disk_rows(self, state, self._plane, np.asarray(self.axis), normal=self.friction is not None)
        if self.friction is not None and np.abs(rows.J[-1]).max() < 1e-9:
            raise InputError(
                f"wheel {self.name!r:.80} has friction, and nothing presses it on its plane, which {state.robot.name} cannot "
                "leave. Use friction=None."
            )
        return rows


@dataclass(frozen=True, eq=False)
class Plane:
    """A plane whose material may move.

    Attributes:
        point: Of the plane, in W, shape (3,) [m].
        axes: R_WP, the normal third, shape (3, 3).
        about: Point of the material in W where velocity and acceleration are given, shape (3,) [m].
        u: Velocity there, linear then angular, shape (6,) [m/s, rad/s].
        s: Acceleration of that material point, and angular, shape (6,) [m/s2, rad/s2].
        ground: The plane alone.
    """

    point: Array
    axes: Array
    about: Array
    u: Array
    s: Array
    ground: Ground

    @property
    def n(self) -> Array:
        """The normal."""
        return self.axes[:, 2]

    @property
    def turning(self) -> Array:
        """Matrix of the angular velocity: turning @ x = W x x."""
        return cross_matrix(self.u[3:])

    @property
    def n_rate(self) -> Array:
        """Derivative of the normal, of a plane that tilts."""
        return self.turning @ self.n


@dataclass(frozen=True, eq=False)
class _Body:
    """Centre of the body that rolls: pose, Jacobian, velocity and J_dot v, world axes."""

    X: pin.SE3
    J: Array
    v: Array
    bias: Array


def _plane(given: RollingBall | RollingDisk | RollingWheel) -> Plane:
    """The plane of a user's arguments, all of them checked.

    Raises:
        InputError: naming what does not fit.
    """
    name = given.name
    check_words(name, given.frame)
    check_friction(0.0 if given.friction is None else given.friction, given.facets)
    if not 0.0 < as_float(given.radius) < 1e50:
        raise InputError(f"radius of {name!r:.80} is {given.radius!r:.80}; expected a length > 0 [m].")
    point = as_vector3(f"point of {name!r:.80}", given.point)
    if given.about is not None and given.velocity is None and given.acceleration is None:
        raise InputError(f"{name!r:.80} has about= without velocity= or acceleration=: it says where these are given.")
    about = point if given.about is None else as_vector3(f"about of {name!r:.80}", given.about)
    u, s = twist(f"velocity of {name!r:.80}", given.velocity), twist(f"acceleration of {name!r:.80}", given.acceleration)
    n = unit_normal(name, given.normal)
    return Plane(point, contact_axes(n), about, u, s, Ground(point=point, normal=n))


def _disk_rows(given: RollingDisk | RollingWheel, state: State, P: Plane, axis: Array, *, normal: bool = True) -> Rows:
    """Rows of a disk: d lies in it, as far down as it goes, and the heading is along its rim."""
    check_state(state, given.name)
    body = _Body(*state.moving(given.frame, _HERE, pin.LOCAL_WORLD_ALIGNED))
    n, dn, e = P.n, P.n_rate, body.X.rotation @ axis
    de = cross_matrix(body.v[3:]) @ e
    along = float(e @ n)
    up = n - along * e  # in the disk; its length is the sine of the angle between disk and plane
    steep = float(np.linalg.norm(up))
    if steep < _FLAT:
        raise InputError(
            f"{given.name!r:.80} lies flat on its plane, so that its whole rim touches; expected a disk that stands or leans. "
            "Is its axis the right one?"
        )
    up /= steep
    dup = _turned(up, dn - (float(dn @ e) + float(n @ de)) * e - along * de, steep)
    heading = cross_matrix(e) @ n / steep
    dheading = _turned(heading, cross_matrix(de) @ n + cross_matrix(e) @ dn, steep)
    N = cross_matrix(n)
    R = np.column_stack([heading, N @ heading, n])
    dR = np.column_stack([dheading, cross_matrix(dn) @ heading + N @ dheading, dn])
    return _rows(given, P, body, -up, -dup, R, dR, normal=normal)


def _turned(unit: Array, rate: Array, length: float) -> Array:
    """Derivative of a vector's direction, from the vector's derivative and length."""
    return (rate - unit * float(unit @ rate)) / length


def _rows(
    given: RollingBall | RollingDisk | RollingWheel,
    P: Plane,
    body: _Body,
    d: Array,
    dd: Array,
    R: Array,
    dR: Array,
    *,
    normal: bool = True,
) -> Rows:
    """Rows of a contact r d from the centre, where d and the axes R change at dd and dR."""
    r, (v, w), u = float(given.radius) * d, np.split(body.v, 2), P.u[:3]
    p = body.X.translation + r
    dr = float(given.radius) * dd
    arm = cross_matrix(r)
    from_about = p - P.about
    g = v - arm @ w - u - P.turning @ from_about
    surface = P.s[:3] + cross_matrix(P.s[3:]) @ from_about + P.turning @ (v + dr - u)  # of the field u, where the contact goes
    dg = body.bias[:3] - arm @ body.bias[3:] + cross_matrix(w) @ dr - surface
    J = R.T @ (body.J[:3] - arm @ body.J[3:])
    kept = slice(2, 3) if given.friction == 0.0 else slice(0, 3 if normal else 2)
    error = np.array([0.0, 0.0, float(P.n @ (p - P.point))])
    m = len(error[kept])
    return Rows(
        given.name,
        J[kept],
        (R.T @ dg + dR.T @ g)[kept],
        _cone(given, m),
        (R.T @ g)[kept],
        error[kept],
        resultant=R[:, kept],
        patch=Patch(p, R, np.zeros((1, 3)), given.friction, None, P.ground if normal else None, 0.0),
        holonomic=np.array([False, False, True])[kept],
    )


def _cone(given: RollingBall | RollingDisk | RollingWheel, m: int) -> Cone:
    if given.friction is None:
        return Free(m)
    return NonNegative(1) if given.friction == 0.0 else FrictionCone(float(given.friction), int(given.facets))
