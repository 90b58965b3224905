"""Velocity constraints: A(q) v = b(t), and edges of skates."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_finite, as_vector3, cross_matrix, lazy, locked, zeros
from rbd.constraints.function import UserFunction, check_function, hessian_by_rates, rate
from rbd.constraints.surface import (
    check_state,
    check_words,
    unit_direction,
)  # fmt: skip
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.model.dynamics import polarised
from rbd.model.state import State
from rbd.problem.cones import Free
from rbd.problem.ground import unit_normal
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
