"""Velocity constraints: A(q) v = 0, edges of skates, and balls, disks and wheels that roll on a plane.

Let c be the centre, r d the vector from it to the lowest point, n the plane's normal. The rows are the velocity of the material
point that touches now, relative to the plane, in axes R of the contact:

    y = R^T g        g = v_c + w x (r d) - u        u = the plane's velocity at that point

and their J_dot v is its derivative, in which r d' is the motion of the contact over the body:

    y' = R^T g' + R'^T g        g' = a_c + w' x (r d) + w x (r d') - du/dt

This is not the material point's acceleration, which has w x (w x r d) in place of w x (r d'). It points into the body, so
that a rolling ball would seem to lift off, or be pulled down with w^2 r. The normal row is the derivative of the height of
the lowest point, its `error`; the others have none.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np
import pinocchio as pin

from rbd.arrays import ABOVE_ZERO, Array, as_finite, as_vector3, check_number, cross_matrix, lazy, locked, zeros
from rbd.constraints.function import UserFunction, check_function, hessian_by_rates, rate
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
from rbd.model.dynamics import polarised
from rbd.model.state import State
from rbd.problem.cones import Free, check_friction
from rbd.problem.ground import Body, Ground, unit_normal
from rbd.problem.motions import Prescribed
from rbd.problem.rows import Patch, Rows

_ONE_CORNER, _NO_ERROR, _VELOCITY_ONLY = locked(np.zeros((1, 3))), zeros(1), locked(np.zeros(1, bool))


@dataclass(frozen=True, eq=False)
class VelocityConstraint(Displayed):
    """Velocity constraint A(q) v = 0, or = b(t): m Pfaffian rows, integrable or not; driven as a function of time.

    Its rows::

        J = A(q)        J_dot v = A_dot v, along the motion        no error: positions are not constrained

    With b, at the state's time t, the rows' velocity is A v - b(t), and their acceleration A v_dot + A_dot v - b'(t).
    b must not jump. `rbd.DrivenJoint` also keeps a position.

    A has one column an entry of v, and v is not always the derivative of q. For a joint with one degree of freedom it is. For
    a planar joint (x, y, cos, sin) v = (vx, vy, w) is in the body's axes, so that a row in x', y' and the angle's th'
    is converted by x' = cos(th) vx - sin(th) vy, y' = sin(th) vx + cos(th) vy, th' = w::

        no side slip:   -sin(th) x' + cos(th) y' = 0        is the constant row     A = (0, 1, 0)
        x' + x th' = 0                                      is the row              A = (cos(th), -sin(th), x)

    For a floating base v is (linear, angular) in the base's axes: with R its rotation matrix, p' = R v[:3].

    Row forces are the multipliers: J^T f is the generalised force.

    An A that may be called with many configurations at once, as columns of q, shape (nq, k), and then gives (m, nv, k), is
    called once for all that A_dot v takes; see `rbd.FunctionConstraint`. It should be a function of q alone.

    Attributes:
        name: The constraint's role, e.g. "no_side_slip".
        A: Function of q with values (m, nv), or (nv,) for one row; or the matrix itself if it is constant.
        bias: Function of q and v with values A_dot v, shape (m,). None: by differences of A along q (+) t v, to 1e-10 of A.
        b: Prescribed velocities A v, shape (m,), or a number for one row: constant, or a function of time, or a spline of
            SciPy's. None: zero.
        b_rate: Function of time with values b', shape (m,). None: by differences, to 1e-10 of b.

    Raises:
        InputError: A is neither a function nor a matrix; b is neither a function nor numbers.

    Example:
        >>> arm = rbd.planar.to_robot(rbd.planar.Chain(2, lengths=[1.0, 1.0]), masses=[1.0, 1.0])
        >>> belt = rbd.VelocityConstraint("belt", [1.0, 1.0])  # q1' + q2' = 0: the second link keeps its direction
        >>> solution = rbd.solve(arm.at([0.0, 0.5]), [1.0, 0.0], [belt])
        >>> solution.a.round(3), solution.forces["belt"].round(3)
        (array([-10.286,  10.286]), array([-0.209]))
    """

    name: str
    A: Callable[[Array], Any] | Array | Sequence[float] | Sequence[Sequence[float]]
    bias: Callable[[Array, Array], Any] | None = field(default=None, kw_only=True)
    b: Callable[[float], Any] | Array | Sequence[float] | float | None = field(default=None, kw_only=True)
    b_rate: Callable[[float], Any] | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        check_function(self.name, "A", self.A if callable(self.A) else None, optional=True)
        check_function(self.name, "bias", self.bias, optional=True)
        if not callable(self.A):
            what = f"A of {self.name!r:.80}"
            A = as_finite(what, self.A, ("m", "nv"), ("nv",), meaning=", or a function of q that gives it")
            object.__setattr__(self, "A", locked(A[None] if A.ndim == 1 else A))
        check_function(self.name, "b_rate", self.b_rate, optional=True)
        if self.b_rate is not None and not callable(self.b):
            raise InputError(f"b_rate of {self.name!r:.80} is the rate of b, and b is {self.b!r:.80}; expected a function.")
        if self.b is not None and not callable(self.b):
            meaning = ": velocities of the rows, or a function of time that gives them"
            object.__setattr__(
                self, "b", locked(np.atleast_1d(as_finite(f"b of {self.name!r:.80}", self.b, (), ("m",), meaning=meaning)))
            )

    def rows(self, state: State) -> Rows:
        """One row a row of A; forces in all directions.

        Raises:
            InputError: A does not have nv columns, or changes its shape; A raises, or has no derivative here.
        """
        check_state(state, self.name)
        q, v, nv = state.q, state.v, state.robot.nv
        J = self._matrix(q, nv)
        m = len(J)
        if self.bias is not None:
            bias = self._biases.vector(m, q, v)
        else:
            bias = rate(self._values, state, J) if callable(self.A) and m else zeros(m)
        velocity = J @ v
        if self.b is not None and m:
            given = self._prescribed.at(state.t)
            if given.shape[1] != m:
                raise InputError(f"b of {self.name!r:.80} has {given.shape[1]} entries; expected {m}, one a row of A.")
            velocity, bias = velocity - given[0], bias - given[1]
        return Rows.unchecked(self.name, J, bias, Free(m), velocity, None, None, None)

    @property
    def jump(self) -> Callable[[float, float], float | None] | None:
        """Gives a time in an interval at which b jumps [s], None if there is none; None without a b of time."""
        return self._prescribed.jump if callable(self.b) else None

    def hessian(self, state: State) -> Array:
        """H(q) with A_dot v = v @ H @ v, shape (m, nv, nv): see `rbd.dynamics.constraint_hessian`.

        Raises:
            InputError: as `rows`; a bias that is not zero at v = 0.
        """
        check_state(state, self.name)
        q, nv = state.q, state.robot.nv
        J = self._matrix(q, nv)
        m = len(J)
        if self.bias is not None:
            return polarised(lambda v: self._biases.vector(m, q, v), nv, self.name)
        if not callable(self.A) or not m:
            return np.zeros((m, nv, nv))
        return hessian_by_rates(self._values, state, J)

    @lazy
    def _values(self) -> UserFunction:
        return UserFunction(self.name, "A", self.A if callable(self.A) else None)

    @lazy
    def _prescribed(self) -> Prescribed:
        b: Any = self.b
        first = self.b_rate
        motion: Any = b if callable(b) else lambda t: np.stack([b, 0.0 * b])
        if first is not None:
            motion = lambda t: np.stack([np.atleast_1d(b(t)), np.atleast_1d(first(t))])  # noqa: E731
        return Prescribed(f"b of {self.name!r:.80}", motion, None, 1)

    @lazy
    def _biases(self) -> UserFunction:
        return UserFunction(self.name, "bias", self.bias)

    def _matrix(self, q: Array, nv: int) -> Array:
        if callable(self.A):
            return self._values.matrix(None, nv, q)
        A = np.asarray(self.A)
        if A.shape[1] != nv:
            raise InputError(f"A of {self.name!r:.80} has {A.shape[1]} columns; expected nv = {nv}, one an entry of v.")
        return A.copy()


@dataclass(frozen=True, eq=False)
class KnifeEdge(Displayed):
    """A knife edge (skate constraint): its point moves along it and turns, and does not slip sideways.

    Its row::

        J v = l . p'        l = n x d / |n x d|        J_dot v = l . p'' + l' . p'

    p the point, d the edge's direction, which turns with its frame, n the normal of its plane. The second
    term gives the side force of a sleigh that turns with w at speed u: l' . p' = -w u [Bloch2003]. One bilateral row,
    on velocity only: the edge is not kept on its plane; where the robot could leave it add a frictionless contact.

    `solution.forces[name]` is the force on the edge, along l, shape (3,), in world axes.

    Attributes:
        name: The edge's role, e.g. "left_skate".
        frame: Frame of the robot to which it is fixed.
        direction: Direction of the edge, in the frame's axes, of any length, shape (3,).
        normal: Normal of the plane, in world axes, a unit vector, shape (3,).
        offset: The point, in the frame's axes, from its origin, shape (3,) [m].

    Raises:
        InputError: a direction of zero length, a normal that is not of unit length.

    Example:
        >>> sleigh = rbd.testing.box(mass=4.0)
        >>> blade = rbd.KnifeEdge("blade", "box", direction=(1, 0, 0))
        >>> moving = rbd.State(sleigh, [0, 0, 0, 0, 0, 0, 1], [2.0, 0, 0, 0, 0, 1.5])  # at 2 m/s, turning at 1.5 rad/s
        >>> rbd.solve(moving, [], [blade]).forces["blade"].round(3)  # m u w, towards the centre of the turn
        array([ 0., 12.,  0.])
    """

    name: str
    frame: str
    direction: Sequence[float] | Array = field(default=(1.0, 0.0, 0.0), kw_only=True)
    normal: Sequence[float] | Array = field(default=(0.0, 0.0, 1.0), kw_only=True)
    offset: Sequence[float] | Array = field(default=(0.0, 0.0, 0.0), kw_only=True)
    _X_FP: pin.SE3 = field(init=False, repr=False)

    def __post_init__(self) -> None:
        check_words("what rolls or glides", name=self.name, frame=self.frame)
        offset = as_vector3(f"offset of {self.name!r:.80}", self.offset)
        self.__dict__.update(
            direction=unit_direction(f"direction of {self.name!r:.80}", self.direction),
            normal=unit_normal(f"normal of contact {self.name!r}", self.normal),
            offset=offset,
            _X_FP=pin.SE3(np.eye(3), offset),
        )

    @property
    def frames(self) -> tuple[str]:
        """Its frame."""
        return (self.frame,)

    def rows(self, state: State) -> Rows:
        """One row: the point's velocity across the edge, in the plane.

        Raises:
            FrameNotFound: with the nearest names.
            InputError: the edge is normal to its plane.
        """
        check_state(state, self.name)
        X_WP, J, v, bias = state.moving(self.frame, self._X_FP, pin.LOCAL_WORLD_ALIGNED)
        n, d = np.asarray(self.normal), X_WP.rotation @ self.direction
        across = cross_matrix(n)
        side = across @ d
        length = float(np.linalg.norm(side))
        if length < 1e-4:
            raise InputError(f"the knife edge {self.name!r:.80} is normal to its plane; expected one along it.")
        l = side / length
        turning = across @ (cross_matrix(v[3:]) @ d) / length
        turning -= l * (l @ turning)
        patch = Patch(X_WP.translation, np.column_stack([-across @ l, l, n]), _ONE_CORNER, None)
        return Rows(
            self.name,
            (l @ J[:3])[None],
            np.array([l @ bias[:3] + turning @ v[:3]]),
            Free(1),
            np.array([l @ v[:3]]),
            _NO_ERROR,
            resultant=l[:, None],
            patch=patch,
            holonomic=_VELOCITY_ONLY,
        )


_FLAT = 1e-4
"""Sine of the angle between a disk and its plane below which it is flat: its lowest point is not unique."""


@dataclass(frozen=True, eq=False)
class Rolling:
    """A body that rolls on a plane of the ground or of another body; base of the kinds below.

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
        check_number(f"radius of {self.name!r:.80}", self.radius, ABOVE_ZERO, 1e50, expected="a length > 0 [m]")
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

    def rows(self, state: State) -> Rows:
        """Three rows (tangent, tangent, normal), or the normal one alone without friction.

        Raises:
            FrameNotFound: with the nearest names.
            InputError: both frames are on one body.
        """
        motion, R = self._met(state)
        return _rows(self, motion, -R[:, 2], np.zeros(3), R, np.zeros((3, 3)))


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
        return _rows(self, motion, -up, -dup, R, dR, normal=normal)


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


def _turned(unit: Array, rate: Array, length: float) -> Array:
    """Derivative of a vector's direction, from the vector's derivative and length."""
    return (rate - unit * float(unit @ rate)) / length


def _rows(given: Rolling, motion: RelativeMotion, d: Array, dd: Array, R: Array, dR: Array, *, normal: bool = True) -> Rows:
    """Rows of a contact r d from the centre, where d and the axes R change at dd and dR, as seen from the surface."""
    r, dr, (v, w) = float(given.radius) * d, float(given.radius) * dd, np.split(motion.v, 2)
    p, arm = motion.X_WP.translation + r, cross_matrix(r)
    g = v - arm @ w
    dg = motion.bias[:3] - arm @ motion.bias[3:] + cross_matrix(w) @ dr
    J = R.T @ (motion.J[:3] - arm @ motion.J[3:])
    ground = motion.ground
    point = motion.X_WS.translation if ground is None else np.asarray(ground.point)
    kept = slice(2, 3) if given.friction == 0.0 else slice(0, 3 if normal else 2)
    error = np.array([0.0, 0.0, float(R[:, 2] @ (p - point))])
    m = len(error[kept])
    against = given.frames[1] if ground is None else None
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
