"""Loop closures: two frames of a robot connected by a joint that is not in its tree; the rows of many together.

Rows are in the axes of frame_a, and give the relative pose and motion of frame_b. So a loop inside a robot acts on its two
bodies with opposite forces along one line, and leaves momentum unchanged, also where the loop is not quite closed.

With t a row's direction, fixed in frame_a, and p_b the origin of frame_b, a row of x = R_a^T (p_b - p_a) moves at

    t . x' = (t, p_b x t) . (V_b - V_a)

where V = (linear, angular) is the velocity of a body, its linear part that of the point at W's origin. So one product with the
joints' Jacobian gives all rows, and with t' = w_a x t and p_b' = v_b,

    J_dot v = (t, p_b x t) . (V_b - V_a)' + (t', v_b x t + p_b x t') . (V_b - V_a)
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import NoReturn, Self, overload

import numpy as np
import pinocchio as pin

from rbd.arrays import ABOVE_ZERO, Array, check_number, cross_matrix, lazy, rank_of
from rbd.constraints.constraint import Constraint, rows_of
from rbd.constraints.contact_points import FromRows
from rbd.constraints.surface import check_state, check_words, contact_axes, unit_direction
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.errors.inputs import check_choice
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State
from rbd.problem.cones import Free, NonNegative
from rbd.problem.rows import Rows

KINDS = {
    "point": 3, "revolute": 5, "rigid": 6, "planar": 2, "cylindrical": 4, "prismatic": 5, "universal": 4, "rod": 1, "rope": 1,
}  # fmt: skip
"""Kinds of closures, with their numbers of rows."""

_HERE = pin.SE3.Identity()
_WORLD, _NO_AXES = np.eye(3), np.zeros((3, 3))
_OPPOSITE = 1e-8
"""1 + cosine between two axes below which they count as opposite: 180 deg to 0.01 deg, where the rotation is ambiguous."""
_ACROSS = ("planar", "cylindrical", "prismatic")
"""Kinds whose rows leave displacements along the axis free."""
_LINKS = ("rod", "rope")
SHORTEST = 1e-9
"""Distance [m] of the ends of a rod below which it has no direction."""


@dataclass(frozen=True, eq=False)
class LoopClosure(Displayed):
    """A joint between two frames of a robot: of a ball, a hinge, a weld, a slide, a cross, a pin in a slot, a rod or a rope.

    The kinds, each with its rows::

        kind         rows                                              error is zero where
        "point"      x (3)                                             the origins coincide
        "revolute"   x (3), turn of the axis about t1 and t2 (2)       and `axis` of frame_b is along `axis` of frame_a
        "rigid"      x (3), turn (3)                                   the frames coincide
        "planar"     t1 . x, t2 . x (2)                                the origins coincide, seen along `axis`
        "cylindrical"  t1 . x, t2 . x, the turn of "revolute" (4)      "revolute", but frame_b may be displaced along `axis`
        "prismatic"  t1 . x, t2 . x, turn about t1, t2, axis (5)       "rigid", but frame_b may be displaced along `axis`
        "universal"  x (3), u . z (1)                                  the origins coincide, and `axis_b` is across `axis`
        "rod"        |x| - length (1)                                  the origins are `length` apart
        "rope"       length - |x| (1, none where it is slack)          likewise; zero or more where it holds

    x = R_a^T (p_b - p_a), and (t1, t2, u = axis) right-handed in the axes of frame_a; z is `axis_b` there. A turn's length is
    2 sin(angle / 2), the angle to third order, of the shorter way: J v is its derivative everywhere. Turned by 180 deg "rigid"
    has singular rows, and "revolute" is refused; so has "universal" with its axes along each other.

    "planar" is a pin in a slot along `axis`: a point of frame_b on a line of frame_a, free to slide along it and to turn. It
    is for mechanisms all of whose joints turn about parallel axes, or slide across them: there the other rows of a
    hinge are always satisfied, and would be redundant. It allows an offset of the frames along `axis`, as
    for links on top of each other, and transmits no force along it and no moments; those of a real pin are in no
    equation of motion. With the axis in the plane of a mechanism it is a pin in a slot of one of its links.

    A "rod" stands for a link without mass between two balls; its own spin is in no equation. It pushes and pulls. A "rope"
    only pulls: its row is there where it is taut to `margin`, and its force is zero or more. In a motion it becomes taut by an
    impact, as contacts do. Without `length` either is as long as the distance where its motion or its file begins: see
    `anchored`; at one state it then has no error.

    Bilateral rows but for the rope: forces in all directions. `solution.forces[name]` is the force (3,) of "point", "planar",
    "rod" and "rope", the wrench (6,) of the others, on the body of frame_b at its origin, in world axes; the body of frame_a
    gets the opposite at the same point. Where frame_b is on the ground it is the force on the body of frame_a: forces act on
    the robot.

    Attributes:
        name: The closure's role, e.g. "coupler_pin".
        frame_a: A frame of the robot, or "universe" for the ground.
        frame_b: A frame on another body, or "universe".
        kind: One of `rbd.constraints.loop.KINDS`.
        axis: Of the hinge or slide, normal of the plane, or of the first pin of a cross, in the axes of frame_a, of any
            length, shape (3,). For "revolute" and "cylindrical" it has the same three numbers in frame_b.
        axis_b: Of the second pin of a cross, "universal", in the axes of frame_b, of any length, shape (3,).
        length: Of a rod or rope [m]; None: what it is where it is anchored.
        margin: Of a rope: distance within which it is taut [m].

    Raises:
        InputError: an unknown kind, an axis of zero length, one frame twice, "universal" without its second axis, a length that
            is not positive, a length or second axis of a kind that has none.

    Example:
        >>> robot = rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0)
        >>> joined = rbd.LoopClosure("joined", "coupler_tip", "rocker_tip", kind="planar", axis=(0, -1, 0))
        >>> solution = rbd.solve(robot.at("assembled"), [0.0], [joined], loops=False)
        >>> solution.forces["joined"].round(3)
        array([10.221,  0.   , -9.118])
    """

    name: str
    frame_a: str
    frame_b: str
    kind: str = field(default="point", kw_only=True)
    axis: Sequence[float] | Array = field(default=(0.0, 0.0, 1.0), kw_only=True)
    axis_b: Sequence[float] | Array | None = field(default=None, kw_only=True)
    length: float | None = field(default=None, kw_only=True)
    margin: float = field(default=1e-6, kw_only=True)
    _axes: Array = field(init=False, repr=False)
    _cone: Free | NonNegative = field(init=False, repr=False)

    def __post_init__(self) -> None:
        check_words("a loop closure", name=self.name, frame_a=self.frame_a, frame_b=self.frame_b)
        if self.frame_a == self.frame_b:
            raise InputError(
                f"loop {self.name!r:.80} closes {self.frame_a!r:.80} with itself, on one body; expected frames of two bodies."
            )
        check_choice(f"kind of loop {self.name!r:.80}", self.kind, KINDS)
        axis = unit_direction(f"axis of loop {self.name!r:.80}", self.axis)
        check_number(f"margin of loop {self.name!r:.80}", self.margin, 0.0, math.inf, expected="a distance >= 0 [m]")
        if (self.axis_b is None) == (self.kind == "universal"):
            raise InputError(
                f"loop {self.name!r:.80} of kind {self.kind!r} has axis_b = {self.axis_b!r:.80}; expected the axis of the "
                "second pin, in frame_b, of kind 'universal', and None of others: axis=(1, 0, 0), axis_b=(0, 1, 0)."
            )
        if self.length is not None:
            if self.kind not in _LINKS:
                raise InputError(
                    f"loop {self.name!r:.80} of kind {self.kind!r} has a length; only kinds rod and rope have one."
                )
            check_number(f"length of loop {self.name!r:.80}", self.length, ABOVE_ZERO, 1e50, expected="a length > 0 [m]")
        axis_b = None if self.axis_b is None else unit_direction(f"axis_b of loop {self.name!r:.80}", self.axis_b)
        cone = NonNegative(1) if self.kind == "rope" else Free(KINDS[self.kind])
        self.__dict__.update(axis=axis, axis_b=axis_b, _axes=contact_axes(axis), _cone=cone)

    @property
    def frames(self) -> tuple[str, str]:
        """The two frames."""
        return self.frame_a, self.frame_b

    @property
    def size(self) -> int:
        """Number of rows, of a rope where it is taut."""
        return KINDS[self.kind]

    @property
    def is_link(self) -> bool:
        """Whether it is a rod or rope."""
        return self.kind in _LINKS

    @property
    def is_measured(self) -> bool:
        """Whether it is a rod or rope whose length is that of the pose at which it is anchored."""
        return self.is_link and self.length is None

    @property
    def can_be_slack(self) -> bool:
        """Whether it is a rope of known length, which has no row where it is slack."""
        return self.kind == "rope" and self.length is not None

    def slack_by(self, far: float) -> float:
        """By how much it is longer than a distance of its ends [m]; without a length it is as long."""
        return 0.0 if self.length is None else self.length - far

    @property
    def directions(self) -> Array:
        """Those of its displacements in frame_a, as columns, shape (3, 3); of "planar" and slides the third has no row."""
        return self._axes if self.kind in _ACROSS else _WORLD

    @property
    def slides(self) -> int:
        """Number of rows that are displacements."""
        return min(KINDS[self.kind], 2 if self.kind in _ACROSS else 3)

    @property
    def turning_axes(self) -> Array | None:
        """Axes of the rows that turn: (t1, t2, axis) of a hinge, zero of a weld, (axis_b, 0, axis) of a cross; else None.

        Of cylindrical and prismatic ones in the axes of `directions`, in which their rows are.
        """
        if self.kind == "universal":
            return np.array([self.axis_b, np.zeros(3), self.axis], float).T.copy()
        return {"revolute": self._axes, "cylindrical": _WORLD, "rigid": _NO_AXES, "prismatic": _NO_AXES}.get(self.kind)

    @property
    def cone(self) -> Free | NonNegative:
        """The set of its row forces."""
        return self._cone

    def check(self, robot: CheckedModel) -> None:
        """Refuse a robot on which it closes no loop.

        Raises:
            FrameNotFound: with the nearest names.
            InputError: both frames are on one body.
        """
        if robot.site(self.frame_a)[0] == robot.site(self.frame_b)[0]:
            raise InputError(
                f"loop {self.name!r:.80} closes {self.frame_a!r:.80} with {self.frame_b!r:.80}, which are fixed to one body of "
                f"{robot.name}; expected frames of two bodies that move against each other."
            )

    def anchored(self, state: State) -> Self:
        """The same, as long as it is at a state where it is a rod or rope without a length.

        Raises:
            InputError: its ends coincide there.
        """
        if not self.is_measured:
            return self
        ends = self.link(state)
        length = 0.0 if ends is None else float(np.linalg.norm(ends[1] - ends[0]))
        return replace(self, length=length if length > SHORTEST else self._no_direction())

    def link(self, state: State) -> Array | None:
        """Its ends in W, of a rod or rope, shape (2, 3) [m]; else None."""
        return np.array([state.frame(x).X_WF.translation for x in self.frames]) if self.is_link else None

    def source(self, start: State) -> FromRows | None:
        """Of a rope its row also where it is slack; None: of others their rows."""
        return FromRows(replace(self.anchored(start), margin=math.inf)) if self.kind == "rope" else None

    def loop_dof(self, state: State, normal: Array | None) -> int | None:
        """Number of relative velocities that it leaves free, of six in space, or of three across `normal`; None of a rope."""
        if self.kind == "rope":
            return None
        if normal is None:
            return 6 - KINDS[self.kind]
        # Forces in the plane, and moments across it, are all that its rows do to planar motion.
        F = self.rows(state).resultant
        assert F is not None
        across = F[:3] - np.outer(normal, normal @ F[:3])
        return 3 - rank_of(np.concatenate([across, (normal[: len(F) - 3] @ F[3:])[None]]), 1e-6, unit=True)

    def rows(self, state: State) -> Rows:
        """Bilateral rows in the axes of frame_a; see the class.

        Raises:
            FrameNotFound: with the nearest names.
            InputError: both frames are on one body; the axes of a hinge are opposite; the ends of a rod coincide.
        """
        check_state(state, self.name)
        self.check(state.robot)
        X_Wa, *moving_a = state.moving(self.frame_a, _HERE, pin.LOCAL)
        X_Wb, *moving_b = state.moving(self.frame_b, _HERE, pin.LOCAL)
        A, B = _side_by_side(*moving_a), _side_by_side(*moving_b)  # each product is taken of all three at once
        R, X_ab = X_Wa.rotation, X_Wa.actInv(X_Wb)
        on_robot = R if state.robot.site(self.frame_b)[0] else -R  # minus the force on the ground is the force on the robot
        x, R_ab = X_ab.translation, X_ab.rotation
        turning = cross_matrix(A[3:, -2])
        # As frame_a sees it, in its axes, which turn: of the velocity x x v_a[3:] = - turning @ x, and Coriolis' term.
        linear = R_ab @ B[:3] - A[:3] + cross_matrix(x) @ A[3:]
        linear[:, -1] -= turning @ (turning @ x + 2.0 * linear[:, -2])
        if self.is_link:
            return self._link(linear, x, on_robot)
        if self.kind in _ACROSS:
            T = self._axes[:, :2]
            linear, x, on_robot_x = T.T @ linear, T.T @ x, on_robot @ T
        else:
            on_robot_x = on_robot
        Jx, vx, ax = linear[:, :-2], linear[:, -2], linear[:, -1]
        if self.kind not in _TURNS:
            return self._made(Jx, vx, ax, x, on_robot_x)
        angular = R_ab @ B[3:] - A[3:]
        Jw, w = angular[:, :-2], angular[:, -2]
        aw = angular[:, -1] - turning @ w
        turn, E, bias = _TURNS[self.kind](self, R_ab, w, aw)
        p = len(x)
        resultant = np.zeros((6, p + len(turn)))
        resultant[:3, :p], resultant[3:, p:] = on_robot_x, on_robot @ E.T
        velocity, biases, error = (np.concatenate(pair) for pair in ((vx, E @ w), (ax, bias), (x, turn)))
        return self._made(np.concatenate([Jx, E @ Jw]), velocity, biases, error, resultant)

    def _link(self, linear: Array, x: Array, on_robot: Array) -> Rows:
        """The row of a rod or rope along d = x / |x|: |x|' = d . x', |x|'' = d . x'' + (|x'|^2 - |x|'^2) / |x|."""
        far, pulls = float(np.linalg.norm(x)), self.kind == "rope"
        error = None if self.length is None else np.array([far - self.length])
        if pulls and self.slack_by(far) > self.margin:
            none = np.zeros(0)
            return Rows(
                self.name, np.zeros((0, linear.shape[1] - 2)), none, NonNegative(0), none, none, resultant=np.zeros((3, 0))
            )
        if far > SHORTEST:
            d, dx = x / far, linear[:, -2]
            row = d @ linear
            row[-1] += (dx @ dx - row[-2] ** 2) / far
        elif pulls and self.margin == math.inf:  # slack, of no direction
            d, row = x, 0.0 * linear[0]
        else:
            self._no_direction()
        if pulls:
            d, row, error = -d, -row, None if error is None else -error
        return self._made(row[None, :-2], row[-2:-1], row[-1:], error, (on_robot @ d)[:, None])

    def _no_direction(self) -> NoReturn:
        raise InputError(
            f"the ends of the {self.kind} {self.name!r:.80}, {self.frame_a!r:.80} and {self.frame_b!r:.80}, coincide at this "
            "state, so it has no direction. Start elsewhere, or join them by kind='point'."
        )

    def _made(self, J: Array, velocity: Array, bias: Array, error: Array | None, resultant: Array) -> Rows:
        return Rows(self.name, J, bias, self._cone, velocity, error, resultant=resultant)

    def _hinge(self, R_ab: Array, w: Array, dw: Array) -> tuple[Array, Array, Array]:
        """(error, E, bias) of the rotation that takes the axis u of frame_a to that of frame_b, z = R_ab u, about t1 and t2.

        error = k T^T (u x z) with k = sqrt(2 / (1 + u . z)), so that its length is 2 sin(angle / 2); error' = E w, and
        z' = w x z. bias is error'' where the components of w change at dw.
        """
        u, T = self._axes[:, 2], self._axes[:, :2]
        z = R_ab @ u
        s = float(u @ z)
        if 1.0 + s < _OPPOSITE:
            raise InputError(
                f"loop {self.name!r:.80}: at this state the axis of {self.frame_b!r:.80} is opposite to that of "
                f"{self.frame_a!r:.80}. Turn one of the frames over, or start elsewhere."
            )
        k = math.sqrt(2.0 / (1.0 + s))
        k1, k2 = -0.5 * k / (1.0 + s), 0.75 * k / (1.0 + s) ** 2  # its derivatives by s
        U, W = cross_matrix(u), cross_matrix(w)
        y, dz = U @ z, W @ z
        ds, ddz = float(u @ dz), cross_matrix(dw) @ z + W @ dz
        bias = (k2 * ds * ds + k1 * float(u @ ddz)) * y + 2.0 * k1 * ds * (U @ dz) + k * (U @ ddz)
        Ty, Tz = T.T @ y, T.T @ z
        # E = -k1 y (u x z)^T - k [u][z], with [u][z] = z u^T - s 1, seen along T.
        E = k * (s * T.T - Tz[:, None] * u) - (k1 * Ty)[:, None] * y
        return k * Ty, E, T.T @ bias


def _cross_of(loop: LoopClosure, R_ab: Array, w: Array, dw: Array) -> tuple[Array, Array, Array]:
    """(error, E, bias) of u . z for the second pin z = R_ab axis_b of a cross, z' = w x z: zero where it is across u."""
    u, z = loop._axes[:, 2], R_ab @ loop.axis_b
    W = cross_matrix(w)
    ddz = cross_matrix(dw) @ z + W @ (W @ z)
    return np.array([u @ z]), (cross_matrix(z) @ u)[None], np.array([u @ ddz])


def _side_by_side(J: Array, v: Array, bias: Array) -> Array:
    """A frame's Jacobian, velocity and bias as columns of one matrix, shape (6, nv + 2)."""
    out = np.empty((6, J.shape[1] + 2))
    out[:, :-2], out[:, -2], out[:, -1] = J, v, bias
    return out


def _weld(loop: LoopClosure, R_ab: Array, w: Array, dw: Array) -> tuple[Array, Array, Array]:
    """(error, E, bias) of twice the vector part of the quaternion (x, s) of R_ab, s >= 0, where frame_b turns with w.

    (x, s)' = 1/2 (s w - x x w, -x . w): E = s 1 - [x], and (2 x)'' = E w' - 1/2 |w|^2 x, as all other terms cancel.
    """
    quaternion = pin.Quaternion(R_ab).coeffs()
    x, s = (quaternion[:3], float(quaternion[3])) if quaternion[3] >= 0.0 else (-quaternion[:3], -float(quaternion[3]))
    E = s * np.eye(3) - cross_matrix(x)
    return 2.0 * x, E, E @ dw - 0.5 * float(w @ w) * x


def _guide(loop: LoopClosure, R_ab: Array, w: Array, dw: Array) -> tuple[Array, Array, Array]:
    """As of a weld, about t1, t2 and the axis."""
    turn, E, bias = _weld(loop, R_ab, w, dw)
    D = loop._axes.T
    return D @ turn, D @ E, D @ bias


_TURNS = {
    "revolute": LoopClosure._hinge, "cylindrical": LoopClosure._hinge,
    "rigid": _weld, "prismatic": _guide, "universal": _cross_of,
}  # fmt: skip

FEWEST = 3
"""Fewer closures are faster one by one."""


class LoopStack:
    """Planar and point closures on one robot.

    Args:
        robot: The robot.
        loops: The closures.

    Raises:
        FrameNotFound: with the nearest names.
        InputError: both frames of a closure are on one body.
    """

    def __init__(self, robot: CheckedModel, loops: Sequence[LoopClosure]) -> None:
        for loop in loops:
            loop.check(robot)
        self.loops = tuple(loops)
        sites = [(robot.site(loop.frame_a), robot.site(loop.frame_b)) for loop in loops]
        self._joints = sorted({joint for pair in sites for joint, _ in pair})
        number = {joint: i for i, joint in enumerate(self._joints)}
        self._a, self._b = (np.array([number[pair[k][0]] for pair in sites]) for k in (0, 1))
        # In the axes of the joint of frame_a: three directions, of which the first two count in a planar closure; its origin.
        self._in_a = np.array(
            [
                np.column_stack([X_a.rotation @ loop.directions, X_a.translation])
                for loop, ((_, X_a), _) in zip(loops, sites, strict=True)
            ]
        )
        self._point_b = np.array([X_b.translation for _, (_, X_b) in sites])[:, :, None]
        carries = np.array([robot.joints.carrying(joint) for joint in self._joints])
        self._counts = np.concatenate([np.arange(3) < loop.size for loop in loops])
        ends = np.cumsum([loop.size for loop in loops]).tolist()
        self.spans = [slice(start, end) for start, end in zip([0, *ends], ends, strict=False)]
        self._row = np.repeat(np.arange(len(loops)), [loop.size for loop in loops])
        relative = carries[self._b] - carries[self._a]
        self._moves, self._enters = np.concatenate([relative, carries[self._a]]).T.copy(), relative[self._row]
        #: The force on the ground is minus that on the robot.
        self.on_robot = [1.0 if b else -1.0 for _, (b, _) in sites]

    @classmethod
    def of(cls, robot: CheckedModel, constraints: Sequence[object]) -> LoopStack | None:
        """The stack of constraints that are all planar or point closures, `FEWEST` or more; else None."""
        loops = [c for c in constraints if type(c) is LoopClosure and c.kind in ("planar", "point")]
        return cls(robot, loops) if len(loops) == len(constraints) >= FEWEST else None

    def at(self, state: State) -> LoopRows:
        """Their rows at a state."""
        n = len(self.loops)
        R, p, J_W = state.joint_motion(self._joints)
        of_a = R.take(self._a, axis=0) @ self._in_a
        axes = of_a[:, :, :3]
        p_a = p.take(self._a, axis=0) + of_a[:, :, 3]
        p_b = p.take(self._b, axis=0) + (R.take(self._b, axis=0) @ self._point_b)[:, :, 0]
        moving = (J_W @ (self._moves * state.v[:, None])).T
        V, V_a = moving[:n], moving[n:, :6]  # V_b - V_a and its rate; V_a
        V_b = V[:, :6] + V_a
        v_b = V_b[:, :3] + _cross(V_b[:, 3:], p_b)
        each = np.concatenate([p_b, v_b, V_a[:, 3:], p_b - p_a, V], axis=1).take(self._row, axis=0)
        V, V_dot = each[:, 12:18], each[:, 18:]
        t = axes.transpose(0, 2, 1).reshape(-1, 3)[self._counts]
        turned = _cross(each[:, :9].reshape(-1, 3, 3), t[:, None])  # p_b, v_b and w_a x t
        t_dot = turned[:, 2]
        terms = np.concatenate([t, turned[:, 0]], axis=1)
        rates = np.concatenate([t_dot, turned[:, 1] + _cross(each[:, :3], t_dot)], axis=1)
        J = terms @ J_W[:6]
        J *= self._enters
        bias = np.vecdot(terms, V_dot) + np.vecdot(rates, V)
        return LoopRows(self, J, bias, np.vecdot(terms, V), np.vecdot(t, each[:, 9:12]), axes)


@dataclass(frozen=True, eq=False)
class LoopRows(Sequence[Rows]):
    """Rows of a stack at one state: stacked, and closure by closure as they are asked for.

    Attributes:
        stack: The closures.
        J: Shape (m, nv).
        bias: J_dot v, shape (m,).
        velocity: Shape (m,).
        error: Shape (m,).
        axes: Directions of each closure in W, as columns, shape (n, 3, 3).
    """

    stack: LoopStack
    J: Array
    bias: Array
    velocity: Array
    error: Array
    axes: Array

    @lazy
    def _made(self) -> list[Rows]:
        out = []
        for loop, s, sign, axes in zip(self.stack.loops, self.stack.spans, self.stack.on_robot, self.axes, strict=True):
            resultant = sign * axes[:, : loop.size]
            out.append(
                Rows.unchecked(loop.name, self.J[s], self.bias[s], loop.cone, self.velocity[s], self.error[s], resultant, None)
            )
        return out

    def forces(self, f: Array) -> dict[str, Array]:
        """The force of each closure in world axes, shape (3,) [N], of row forces (m,)."""
        loops, spans, signs = self.stack.loops, self.stack.spans, self.stack.on_robot
        return {
            loop.name: sign * (axes[:, : loop.size] @ f[s])
            for loop, s, sign, axes in zip(loops, spans, signs, self.axes, strict=True)
        }

    def __len__(self) -> int:
        return len(self.stack.loops)

    @overload
    def __getitem__(self, i: int) -> Rows: ...
    @overload
    def __getitem__(self, i: slice) -> list[Rows]: ...
    def __getitem__(self, i: int | slice) -> Rows | list[Rows]:
        return self._made[i]

    def __iter__(self) -> Iterator[Rows]:
        return iter(self._made)


def rows_function(robot: CheckedModel, constraints: Sequence[Constraint]) -> Callable[[State], Sequence[Rows]]:
    """Each constraint's rows as a function of the state, of loops together where that is faster."""
    stack = LoopStack.of(robot, constraints)
    return (lambda state: rows_of(state, constraints)) if stack is None else stack.at


def _cross(a: Array, b: Array) -> Array:
    """Cross products along the last axis: a third of the cost of np.cross."""
    return a.take(_NEXT, axis=-1) * b.take(_LAST, axis=-1) - a.take(_LAST, axis=-1) * b.take(_NEXT, axis=-1)


_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])
