"""Balls, disks, wheels and other smooth bodies that roll: on a plane, or a ball in a bowl or a pipe.

Let c be the centre, r the vector from it to the point that touches, n the normal there. The rows are the velocity of the
material point that touches now, relative to the surface, in axes R of the contact:

    y = R^T g        g = v_c + w x r - u        u = the surface's velocity at that point

and their J_dot v is its derivative, in which r' is that of the place of contact:

    y' = R^T g' + R'^T g        g' = a_c + w' x r + w x r' - du/dt

This is not the material point's acceleration, which has w x (w x r) in place of w x r'. It points into the body, so
that a rolling ball would seem to lift off, or be pulled down with w^2 r. The normal row is the derivative of the height of
the lowest point, its `error`; the others have none.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np

from rbd.arrays import ABOVE_ZERO, Array, as_finite, check_number, cross_matrix, locked
from rbd.constraints.function import UserFunction
from rbd.constraints.round_feet import Ball
from rbd.constraints.surface import (
    HERE,
    UP,
    Counterpart,
    On,
    RelativeMotion,
    check_state,
    check_words,
    cone_of,
    contact_axes,
    jump_of,
    plane_of,
    surface_of,
    unit_direction,
)  # fmt: skip
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.model.state import State
from rbd.problem.cones import Free, check_friction
from rbd.problem.ground import Body, Ground
from rbd.problem.rows import Patch, Rows

_ONE_CORNER = locked(np.zeros((1, 3)))

_FLAT = 1e-4
"""Sine of the angle between a disk and its plane below which it is flat: its lowest point is not unique."""


@dataclass(frozen=True, eq=False)
class Rolling:
    """A body that rolls on a surface of the ground or of another body; base of the kinds below.

    Attributes:
        name: The contact's role, e.g. "ball".
        frame: Frame of the robot at the centre of the rolling body.
        radius: [m].
        friction: Coulomb's coefficient, or None: it neither slips nor separates.
        facets: Facets of the pyramid that replaces the cone in a QP; see `Contact`.
        on: The plane: `rbd.Ground(point=..., normal=...)`, whose material may move, as of a turntable or a belt; the height of
            a level one [m]; or `rbd.Body(frame)`, through that frame's origin.

    Raises:
        InputError: a radius that is not positive, negative friction, a ground without a point.
    """

    name: str
    frame: str
    radius: float = field(kw_only=True)
    friction: float | None = field(default=None, kw_only=True)
    facets: int = field(default=4, kw_only=True)
    on: On = field(default=0.0, kw_only=True)
    _axes: Array = field(init=False, repr=False)
    _touched: Counterpart = field(init=False, repr=False)

    def __post_init__(self) -> None:
        check_words("what rolls or glides", name=self.name, frame=self.frame)
        check_friction(0.0 if self.friction is None else self.friction, self.facets)
        least, what = (0.0, ">= 0") if isinstance(self, RollingBody) else (ABOVE_ZERO, "> 0")
        check_number(f"radius of {self.name!r:.80}", self.radius, least, 1e50, expected=f"a length {what} [m]")
        on = surface_of(self.name, self.on)
        if not isinstance(on, Body):
            on = plane_of(self.name, on)
        elif on.frame == self.frame:
            raise InputError(f"contact {self.name!r} is between {self.frame!r} and itself; expected a frame of another body.")
        axes = contact_axes(UP if on.normal is None else np.asarray(on.normal))
        self.__dict__.update(on=on, _axes=axes)
        if isinstance(on, Ground) and on.moves and on.motion is None and on.about is None:
            on = replace(on, about=on.point)
        object.__setattr__(self, "_touched", Counterpart(self.name, on, None))

    @property
    def frames(self) -> tuple[str, ...]:
        """Its frame, and that of the body on which it rolls."""
        return (self.frame, self.on.frame) if isinstance(self.on, Body) else (self.frame,)

    @property
    def jump(self) -> Callable[[float, float], float | None] | None:
        """As of `Contact`."""
        return jump_of(self.on)  # type: ignore[arg-type]  # checked

    def with_friction(self, mu: float) -> Self:
        """The same with another coefficient."""
        return replace(self, friction=mu)

    def _met(self, state: State) -> tuple[RelativeMotion, Array]:
        """(motion of the body's frame relative to the surface, axes of the plane, the normal third)."""
        check_state(state, self.name)
        motion = self._touched.motion(state, self.frame, HERE)
        return motion, motion.X_WS.rotation @ self._axes


@dataclass(frozen=True, eq=False)
class RollingBall(Rolling, Displayed):
    """A ball that rolls on a plane, or slips on it with friction.

    Three rows (tangent, tangent, normal) of the plane's axes. `friction=None` rolls: it neither slips nor separates, and may
    spin about the normal. `friction=mu` is unilateral with Coulomb friction: it can slip, and `rbd.ConeSolver` takes
    one that slips already. `friction=0.0` is unilateral without friction: the normal row alone. Rolling and spinning
    resistance are neglected.

    `solution.forces[name]` is the force on the ball at its lowest point, shape (3,), in world axes.

    Attributes:
        name: The contact's role, e.g. "ball".
        frame: Frame of the robot at the centre of the rolling body.
        radius: Of the rolling body [m].
        friction: Coulomb's coefficient, or None: it neither slips nor separates.
        facets: Facets of the pyramid that replaces the cone in a QP.
        on: The plane: `rbd.Ground(point=..., normal=...)`, the height of a level one [m], or `rbd.Body(frame)`.

    Raises:
        InputError: a radius that is not positive, negative friction, a ground without a point.

    Example:
        >>> ball = rbd.testing.box(mass=1.0, size=(0.1, 0.1, 0.1))
        >>> slope = rbd.Ground(point=(0, 0, 0), normal=(0.6, 0, 0.8))
        >>> rolling = rbd.RollingBall("rolling", "box", radius=0.05, on=slope)
        >>> solution = rbd.solve(rbd.State(ball, [0.03, 0, 0.04, 0, 0, 0, 1]), [], [rolling])
        >>> solution.a[[0, 2, 4]].round(3)  # down the slope, turning about y
        array([ 2.825, -2.119, 70.632])
    """

    @property
    def ball(self) -> Ball:
        """The ball itself, in its frame."""
        return Ball((0.0, 0.0, 0.0), float(self.radius))

    def rows(self, state: State) -> Rows:
        """Three rows (tangent, tangent, normal), or the normal one alone without friction.

        Raises:
            FrameNotFound: with the nearest names.
            InputError: both frames are on one body.
        """
        motion, R = self._met(state)
        return _rows(self, motion, -self.radius * R[:, 2], np.zeros(3), R, np.zeros((3, 3)))


@dataclass(frozen=True, eq=False)
class RollingDisk(Rolling, Displayed):
    """A thin disk that rolls on a plane, upright or leaning: a coin, a hoop, a wheel of a bicycle.

    Three rows (heading, side, normal): the heading is that of rolling by positive spin about `axis`, axis x normal, the side
    is towards the axis. The contact is the lowest point of the rim, which moves on the rim. Friction as of `RollingBall`. A
    flat disk touches along its rim and is refused.

    Attributes:
        name: The contact's role, e.g. "coin".
        frame: Frame of the robot at the centre of the rolling body.
        radius: Of the rolling body [m].
        axis: Spin axis, in the frame's axes, of any length, shape (3,).
        friction: Coulomb's coefficient, or None: it neither slips nor separates.
        facets: Facets of the pyramid that replaces the cone in a QP.
        on: The plane: `rbd.Ground(point=..., normal=...)`, the height of a level one [m], or `rbd.Body(frame)`.

    Raises:
        InputError: a radius that is not positive, negative friction, a ground without a point, an axis of zero length.

    Example:
        >>> disk = rbd.testing.box(mass=1.0, size=(0.5, 0.01, 0.5))
        >>> coin = rbd.RollingDisk("coin", "box", radius=0.25)
        >>> rolls = rbd.State(disk, [0, 0, 0.25, 0, 0, 0, 1], [0.5, 0, 0, 0, 2.0, 0])  # 0.5 m/s, 2 rad/s
        >>> coin.rows(rolls).velocity, rbd.solve(rolls, [], [coin]).forces["coin"].round(3)
        (array([0., 0., 0.]), array([0.  , 0.  , 9.81]))
    """

    axis: Sequence[float] | Array = field(default=(0.0, 1.0, 0.0), kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "axis", unit_direction(f"axis of {self.name!r:.80}", self.axis))

    def rows(self, state: State) -> Rows:
        """Three rows (heading, side, normal), or the normal one alone without friction.

        Raises:
            FrameNotFound: with the nearest names.
            InputError: the disk is flat, or both frames are on one body.
        """
        return self._disk_rows(state)

    def _disk_rows(self, state: State, *, normal: bool = True) -> Rows:
        """Rows of a disk: d points in its plane to the lowest point, and the heading is along its rim."""
        motion, axes = self._met(state)
        n, e = axes[:, 2], motion.X_WP.rotation @ self.axis
        de = cross_matrix(motion.v[3:]) @ e
        along = float(e @ n)
        up = n - along * e  # in the disk; its length is the sine of the angle between disk and plane
        steep = float(np.linalg.norm(up))
        if steep < _FLAT:
            raise InputError(
                f"{self.name!r:.80} lies flat on its plane, so that its whole rim touches; expected a disk that stands or "
                "leans. Is its axis the right one?"
            )
        up /= steep
        dup = _turned(up, -float(n @ de) * e - along * de, steep)
        heading = cross_matrix(e) @ n / steep
        dheading = _turned(heading, cross_matrix(de) @ n, steep)
        N = cross_matrix(n)
        R = np.column_stack([heading, N @ heading, n])
        dR = np.column_stack([dheading, N @ dheading, np.zeros(3)])
        return _rows(self, motion, -self.radius * up, -self.radius * dup, R, dR, normal=normal)


@dataclass(frozen=True, eq=False)
class RollingWheel(RollingDisk):
    """A wheel of a vehicle that cannot leave its plane: it rolls without slip and does not slide sideways.

    Two rows (heading, side), those of `RollingDisk` without the normal one, which is zero for a vehicle on a planar joint:
    its joints carry the weight. A vehicle free in space needs `RollingDisk`, or `friction=mu`: then the rows are those of
    the disk, with the normal, and the wheel may slip; that is refused if the vehicle has no motion along the normal. Its frame
    is on the wheel, which spins.

    Attributes:
        name: The contact's role, e.g. "left_wheel".
        frame: Frame of the robot at the centre of the rolling body.
        radius: Of the rolling body [m].
        axis: Spin axis, in the frame's axes, of any length, shape (3,).
        friction: Coulomb's coefficient, or None: it neither slips nor separates.
        facets: Facets of the pyramid that replaces the cone in a QP.
        on: The plane: `rbd.Ground(point=..., normal=...)`, the height of a level one [m], or `rbd.Body(frame)`.

    Raises:
        InputError: a radius that is not positive, negative friction, a ground without a point, an axis of zero length.

    Example:
        >>> wheel = rbd.testing.box(mass=1.0, size=(0.2, 0.02, 0.2))
        >>> rolling = rbd.RollingWheel("rolling", "box", radius=0.1)
        >>> moves = rbd.State(wheel, [0, 0, 0.1, 0, 0, 0, 1], [0.3, 0.05, 0, 0, 3.0, 0])
        >>> rolling.rows(moves).velocity.round(6)  # it rolls along x, and slides sideways at 0.05 m/s
        array([0.  ,  0.05])
    """

    def rows(self, state: State) -> Rows:
        """Two rows (heading, side); with friction as `RollingDisk`.

        Raises:
            FrameNotFound: with the nearest names.
            InputError: the wheel is flat; or it has friction, and the vehicle has no motion along the normal.
        """
        rows = self._disk_rows(state, normal=self.friction is not None)
        if self.friction is not None and np.abs(rows.J[-1]).max() < 1e-9:
            raise InputError(
                f"wheel {self.name!r:.80} has friction, and no normal force, as {state.robot.name} cannot leave its "
                "plane. Use friction=None."
            )
        return rows


@dataclass(frozen=True, eq=False)
class RollingBody(Rolling, Displayed):
    """A convex smooth body that rolls on a plane, or slips on it: an egg, a rattleback, a tyre with a round section.

    Its surface is an ellipsoid, or any whose point with the outward normal u is a function s(u): the farthest along u. What
    touches is s(-n), n the plane's normal as the body sees it. Three rows (tangent, tangent, normal); friction as of
    `RollingBall`. Grown by `radius`, s(u) + radius u, a rim becomes a tyre: that of a circle of radius R in x and z is

        lambda u: R * np.array([u[0], 0.0, u[2]]) / np.hypot(u[0], u[2])

    The motion of the contact over the body is s' along the turn of u, by differences of sixth order, to 1e-13 of its size.

    Attributes:
        name: The contact's role, e.g. "egg".
        frame: Frame of the robot in which the surface is given.
        shape: Semi-axes of an ellipsoid along the axes of the frame, shape (3,) [m], about its origin; or the function s(u), of
            a unit vector in these axes, with a point in them, shape (3,) [m].
        radius: By which the surface is grown, zero or more [m].
        friction: Coulomb's coefficient, or None: it neither slips nor separates.
        facets: Facets of the pyramid that replaces the cone in a QP.
        on: The plane: `rbd.Ground(point=..., normal=...)`, the height of a level one [m], or `rbd.Body(frame)`.

    Raises:
        InputError: semi-axes that are not positive, a negative radius, negative friction, a ground without a point.

    Example:
        >>> body = rbd.testing.box(mass=1.0, size=(0.2, 0.1, 0.1))
        >>> egg = rbd.constraints.RollingBody("egg", "box", shape=(0.1, 0.05, 0.05))
        >>> rolls = rbd.State(body, [0, 0, 0.05, 0, 0, 0, 1], [0, 0.5, 0, -10.0, 0, 0])  # about its long axis
        >>> egg.rows(rolls).velocity.round(12), rbd.solve(rolls, [], [egg]).forces["egg"].round(3)
        (array([0., 0., 0.]), array([0.  , 0.  , 9.81]))
    """

    shape: Sequence[float] | Array | Callable[[Array], Any] = field(kw_only=True)
    radius: float = field(default=0.0, kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not callable(self.shape):
            what = f"shape of {self.name!r:.80}"
            axes = as_finite(what, self.shape, (3,), meaning=": semi-axes [m], or a function of the normal")
            if not axes.min() > 0.0:
                raise InputError(f"{what} is {axes!r:.80}; expected semi-axes > 0 [m]. Of a disk: rbd.RollingDisk.")
            object.__setattr__(self, "shape", locked(axes))

    def surface(self, u: Array) -> Array:
        """The surface's point with the outward normal u, both in the frame's axes, shape (3,) [m].

        Raises:
            InputError: the function gives no point.
        """
        if callable(self.shape):
            given = UserFunction(self.name, "shape", self.shape).vector(None, u)
            found = as_finite(f"shape of {self.name!r:.80} at the normal {u.round(3).tolist()}", given, (3,))
        else:
            stretched = np.square(self.shape) * u
            found = stretched / math.sqrt(float(stretched @ u))
        return found + self.radius * u

    def rows(self, state: State) -> Rows:
        """Three rows (tangent, tangent, normal), or the normal one alone without friction.

        Raises:
            FrameNotFound: with the nearest names.
            InputError: both frames are on one body; the surface has no point there.
        """
        motion, axes = self._met(state)
        R, w, n = motion.X_WP.rotation, motion.v[3:], axes[:, 2]
        u, du = -R.T @ n, R.T @ (cross_matrix(w) @ n)
        r, ds, speed = R @ self.surface(u), np.zeros(3), float(np.linalg.norm(du))
        if speed > 0.0:
            turned = [math.cos(a) * u + math.sin(a) / speed * du for a in _TURNS]
            ds = speed * sum((c * self.surface(x) for c, x in zip(_WEIGHTS, turned, strict=True)), np.zeros(3))
        return _rows(self, motion, r, cross_matrix(w) @ r + R @ ds, axes, np.zeros((3, 3)))


_TURNS = 5e-3 * np.array([-3.0, -2.0, -1.0, 1.0, 2.0, 3.0])
_WEIGHTS = np.array([-1.0, 9.0, -45.0, 45.0, -9.0, 1.0]) / (60.0 * 5e-3)
"""Of differences of sixth order, over an angle."""


@dataclass(frozen=True, eq=False)
class RollingOnRound(Rolling, Displayed):
    """A ball that rolls in or on a ball or a cylinder: in a bowl, in a pipe, on a globe, on a shaft.

    The normal n is along the line of the two centres, of a cylinder across its axis, towards the ball. Three rows (tangent,
    tangent, normal), of a cylinder the first along its axis; friction as of `RollingBall`. The gap, the normal row's `error`,
    is |c| - R - r outside and R - r - |c| inside, c the ball's centre from the other one.

    Attributes:
        name: The contact's role, e.g. "marble".
        frame: Frame of the robot at the centre of the rolling ball.
        radius: Of the rolling ball [m].
        surface_radius: R, of what it rolls on [m]; negative of what it rolls in.
        axis: Of a cylinder, in W, or in the axes of the body that it is fixed to, of any length, shape (3,); None: a ball.
        friction: Coulomb's coefficient, or None: it neither slips nor separates.
        facets: Facets of the pyramid that replaces the cone in a QP.
        on: Its centre, or a point of its axis: that of `rbd.Ground(point=...)`, a height on W's z axis [m], or the origin of
            the frame of `rbd.Body(frame)`. A ground may turn about it.

    Raises:
        InputError: a radius that is not positive, a bowl that is no larger than the ball, an axis of zero length, negative
            friction, a ground without a point.

    Example:
        >>> marble = rbd.testing.box(mass=1.0, size=(0.1, 0.1, 0.1))
        >>> bowl = rbd.constraints.RollingOnRound("bowl", "box", radius=0.05, surface_radius=-0.5, on=0.5)
        >>> rests = rbd.State(marble, [0, 0, 0.05, 0, 0, 0, 1])
        >>> rbd.solve(rests, [], [bowl]).forces["bowl"].round(3)
        array([0.  , 0.  , 9.81])
    """

    surface_radius: float = field(kw_only=True)
    axis: Sequence[float] | Array | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        what = f"surface_radius of {self.name!r:.80}"
        if not check_number(what, self.surface_radius, -1e50, 1e50, expected="a length, or minus that of what it rolls in [m]"):
            raise InputError(f"{what} is zero; expected a length, or minus that of what it rolls in [m].")
        if -self.radius <= self.surface_radius < 0.0:
            raise InputError(
                f"{self.name!r:.80} has a ball of radius {self.radius:g} m in one of {-self.surface_radius:g} m; expected a "
                "smaller ball."
            )
        if self.axis is not None:
            object.__setattr__(self, "axis", unit_direction(f"axis of {self.name!r:.80}", self.axis))

    def rows(self, state: State) -> Rows:
        """Three rows (tangent, tangent, normal), or the normal one alone without friction.

        Raises:
            FrameNotFound: with the nearest names.
            InputError: both frames are on one body; the centres coincide.
        """
        motion, _ = self._met(state)
        centre = motion.X_WS.translation if motion.ground is None else np.asarray(motion.ground.point)
        way, out = motion.v[:3], math.copysign(1.0, self.surface_radius)
        a: Array | None = None if self.axis is None else motion.X_WS.rotation @ self.axis
        e = motion.X_WP.translation - centre
        if a is not None:
            e, way = e - a * float(a @ e), way - a * float(a @ way)
        far = float(np.linalg.norm(e))
        if far < 1e-9:
            raise InputError(f"{self.name!r:.80} has its centre at that of what it rolls in; it touches at no one point there.")
        n = out * e / far
        dn = out * _turned(e / far, way, far)
        along, dalong = np.zeros(3) if a is None else a, np.zeros(3)
        if a is None:  # along the surface's x or y, as it turns with n
            x = motion.X_WS.rotation[:, int(abs(float(n @ motion.X_WS.rotation[:, 0])) >= 0.9)]
            t = x - float(x @ n) * n
            size = float(np.linalg.norm(t))
            along = t / size
            dalong = _turned(along, -float(x @ dn) * n - float(x @ n) * dn, size)
        side, dside = cross_matrix(n) @ along, cross_matrix(dn) @ along + cross_matrix(n) @ dalong
        R, dR = np.column_stack([along, side, n]), np.column_stack([dalong, dside, dn])
        gap = out * far - self.surface_radius - self.radius
        return _rows(self, motion, -self.radius * n, -self.radius * dn, R, dR, gap)


def _turned(unit: Array, rate: Array, length: float) -> Array:
    """Derivative of a vector's direction, from the vector's derivative and length."""
    return (rate - unit * float(unit @ rate)) / length


def _rows(
    given: Rolling,
    motion: RelativeMotion,
    r: Array,
    dr: Array,
    R: Array,
    dR: Array,
    gap: float | None = None,
    *,
    normal: bool = True,
) -> Rows:
    """Rows of a contact r from the centre, where r and the axes R change at dr and dR, as seen from the surface.

    Without a gap it is that of the plane of `given.on`.
    """
    v, w = np.split(motion.v, 2)
    p, arm = motion.X_WP.translation + r, cross_matrix(r)
    g = v - arm @ w
    dg = motion.bias[:3] - arm @ motion.bias[3:] + cross_matrix(w) @ dr
    J = R.T @ (motion.J[:3] - arm @ motion.J[3:])
    ground = motion.ground
    point = motion.X_WS.translation if ground is None else np.asarray(ground.point)
    kept = slice(2, 3) if given.friction == 0.0 else slice(0, 3 if normal else 2)
    error = np.array([0.0, 0.0, float(R[:, 2] @ (p - point)) if gap is None else gap])
    m = len(error[kept])
    against = given.frames[1] if ground is None else None
    if ground is not None and gap is not None:
        ground = Ground(point=p - gap * R[:, 2], normal=R[:, 2])
    return Rows(
        given.name,
        J[kept],
        (R.T @ dg + dR.T @ g)[kept],
        Free(m) if given.friction is None else cone_of(given.name, _ONE_CORNER, given.friction, int(given.facets)),
        (R.T @ g)[kept],
        error[kept],
        resultant=R[:, kept],
        patch=Patch(p, R, np.zeros((1, 3)), given.friction, against, ground if normal else None, 0.0),
        holonomic=np.array([False, False, True])[kept],
    )
