"""Bounds of points, contact Jacobians, centre of mass and gravity torques over all poses of a box of joints.

With d = q - q0 the distances of the joints of the box from its middle, |d_i| <= r_i, each quantity is

    x(q) = mid + sum_i d_i slopes_i + sum_ij d_i d_j bends_ij + remainder,      |remainder| <= rad

for every q of the box. In a product, terms of third and higher order in d are bounded; that bound is added to rad, with that of
all rounding by `rbd.intervals`. So rad falls with the cube of the box's size, down to rounding.
A joint's rotation enters by sin(q0 + d) = sin q0 + d cos q0 - d^2/2 sin q0 + e, |e| <= |d|^3 / 6, and cos alike; the chain is
multiplied out.

Of Pinocchio only the model's data are used, as exact doubles: placements of joints and frames, axes, masses, centres of mass,
gravity; and of the state q, whose base quaternion is a rotation up to rounding.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_vector3
from rbd.errors import InputError, Unsupported
from rbd.errors.inputs import check_kind
from rbd.intervals import Intervals, U, above, product
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State

Boxed = Mapping[str, tuple[float, float]]
_AXES = {"X": np.eye(3)[0], "Y": np.eye(3)[1], "Z": np.eye(3)[2]}


@dataclass(frozen=True, eq=False)
class Taylor:
    """An array as a polynomial of d: |x(d) - mid - sum_i d_i slopes_i - sum_ij d_i d_j bends_ij| <= rad for |d_i| <= reach_i.

    Attributes:
        mid: Value at the middle of the box, shape S.
        slopes: Rates with each d_i, shape (k, *S).
        bends: Of second order, shape (k, k, *S); of i and j both count.
        rad: Bounds of the remainder, shape S.
        reach: Largest |d_i|, shape (k,).
    """

    mid: Array
    slopes: Array
    bends: Array
    rad: Array
    reach: Array

    @classmethod
    def fixed(cls, x: Intervals | Array, reach: Array) -> Taylor:
        """What does not depend on d."""
        given, k = Intervals.exact(x), len(reach)
        return cls(given.mid, np.zeros((k, *given.shape)), np.zeros((k, k, *given.shape)), given.rad, reach)

    @property
    def swing(self) -> Array:
        """Bounds of |sum_i d_i slopes_i|, shape S."""
        return above(np.tensordot(self.reach, np.abs(self.slopes), 1), len(self.reach) + 1)

    @property
    def bend(self) -> Array:
        """Bounds of |sum_ij d_i d_j bends_ij|, shape S."""
        both = np.abs(self.bends + np.swapaxes(self.bends, 0, 1))
        return above(0.5 * np.tensordot(np.outer(self.reach, self.reach), both, 2), len(self.reach) ** 2 + 4)

    @property
    def moved(self) -> Array:
        """Bounds of |x(d) - mid|, shape S."""
        return above(self.swing + self.bend + self.rad, 2)

    @property
    def range(self) -> Intervals:
        """Intervals that contain it for all d of the box."""
        return Intervals(self.mid, self.moved)

    @property
    def straight(self) -> Taylor:
        """The same without bends: d_i^2 is half its largest, and up to half of that; of other products nothing but bounds."""
        k, square = len(self.reach), np.diag(self.reach**2)
        middle = 0.5 * np.tensordot(square, self.bends, 2)
        spread = self.bend - 0.5 * np.tensordot(square, np.abs(self.bends), 2)
        mid = self.mid + middle
        size = np.abs(mid) + np.tensordot(square, np.abs(self.bends), 2)
        rad = above(self.rad + spread + (k * k + 8) * U * (size + self.bend), 4)
        return Taylor(mid, self.slopes, np.zeros_like(self.bends), rad, self.reach)

    @property
    def T(self) -> Taylor:
        """The transpose of a matrix."""
        return self._each(lambda x: np.swapaxes(x, -2, -1))

    def at(self, d: Array) -> Intervals:
        """Intervals that contain it at one d, shape (k,)."""
        n, both = len(self.reach), np.outer(d, d)
        value = self.mid + np.tensordot(d, self.slopes, 1) + np.tensordot(both, self.bends, 2)
        size = np.abs(self.mid) + np.tensordot(np.abs(d), np.abs(self.slopes), 1)
        size += np.tensordot(np.abs(both), np.abs(self.bends), 2)
        return Intervals(value, above(self.rad + (n + 1) ** 2 * U * size, n * n + 4))

    def __getitem__(self, at: Any) -> Taylor:
        inner, lead = at if isinstance(at, tuple) else (at,), (slice(None),)
        return Taylor(
            np.asarray(self.mid[at]), np.asarray(self.slopes[(*lead, *inner)]), np.asarray(self.bends[(*lead, *lead, *inner)]),
            np.asarray(self.rad[at]), self.reach,
        )  # fmt: skip

    def __neg__(self) -> Taylor:
        return Taylor(-self.mid, -self.slopes, -self.bends, self.rad, self.reach)

    def __add__(self, other: Taylor) -> Taylor:
        mid, slopes, bends = self.mid + other.mid, self.slopes + other.slopes, self.bends + other.bends
        kept = Taylor(mid, slopes, bends, np.zeros_like(mid), self.reach)
        sizes = np.tensordot(np.outer(self.reach, self.reach), np.abs(bends), 2)
        rounding = U * (np.abs(mid) + kept.swing + sizes)
        return Taylor(mid, slopes, bends, above(self.rad + other.rad + rounding, len(self.reach) ** 2 + 5), self.reach)

    def __sub__(self, other: Taylor) -> Taylor:
        return self + (-other)

    def __matmul__(self, other: Taylor) -> Taylor:
        """A product of matrices, or of a matrix and a vector."""
        A, B, n, k = self, other, self.mid.shape[-1], len(self.reach)
        if A.mid.ndim == 1:
            return (A._each(lambda x: x[..., None, :]) @ B)[0]
        if B.mid.ndim == 1:
            return (A @ B._each(lambda x: x[..., None]))[:, 0]
        mid = product(A.mid, B.mid)
        slopes = A.slopes @ B.mid + A.mid @ B.slopes
        bends = A.bends @ B.mid + A.slopes[:, None] @ B.slopes[None] + A.mid @ B.bends
        size_a, size_b, swing_a, swing_b, bend_a, bend_b = np.abs(A.mid), np.abs(B.mid), A.swing, B.swing, A.bend, B.bend
        square = np.outer(A.reach, A.reach)
        all_a, all_b = (np.tensordot(square, np.abs(x.bends), 2) for x in (A, B))  # before bends of i, j and j, i cancel
        kept = swing_a @ size_b + size_a @ swing_b + swing_a @ swing_b + all_a @ size_b + size_a @ all_b
        rad = mid.rad + 2 * (n + 4) * U * kept + swing_a @ bend_b + bend_a @ (swing_b + bend_b)  # rounding, and third order
        rad = rad + A.rad @ (size_b + B.moved) + (size_a + swing_a + bend_a) @ B.rad
        return Taylor(mid.mid, slopes, bends, above(rad, 3 * n + k * k + 12), A.reach)

    def cross(self, other: Taylor) -> Taylor:
        """A vector product."""
        return self.skew @ other

    @property
    def skew(self) -> Taylor:
        """The matrix [x] with [x] y = x times y, of a vector."""
        S = np.zeros((3, 3, 3))
        S[0, 1, 2] = S[1, 2, 0] = S[2, 0, 1] = -1.0
        S[0, 2, 1] = S[1, 0, 2] = S[2, 1, 0] = 1.0
        by = np.moveaxis(S, 2, 0)
        found = self._each(lambda x: np.tensordot(x, by, 1))
        return replace(found, rad=np.tensordot(self.rad, np.abs(by), 1))

    def _each(self, change: Callable[[Array], Array]) -> Taylor:
        return Taylor(change(self.mid), change(self.slopes), change(self.bends), change(self.rad), self.reach)


def stacked(columns: Sequence[Taylor]) -> Taylor:
    """Vectors of n entries as the columns of a matrix; numbers as a vector."""
    parts = [np.stack([getattr(c, name) for c in columns], axis=-1) for name in ("mid", "slopes", "bends", "rad")]
    return Taylor(parts[0], parts[1], parts[2], parts[3], columns[0].reach)


@dataclass(frozen=True, eq=False)
class PoseBounds:
    """What poses of a box of joints have, as forms in d = q - q0.

    Attributes:
        joints: Names of the joints of the box, k in all, in the order of d.
        middle: q0 of these joints, shape (k,) [rad, m].
        reach: Largest |d_i|, shape (k,); the box lies within.
        points: {name: position in W, shape (3,) [m]}.
        jacobians: {name: of the point's velocity in W, by v, shape (3, nv)}.
        com: Centre of mass in W, shape (3,) [m].
        gravity: Generalised gravity g(q), shape (nv,) [N, N m]: torques that hold the robot are g less those of the contacts.
    """

    joints: tuple[str, ...]
    middle: Array
    reach: Array
    points: Mapping[str, Taylor]
    jacobians: Mapping[str, Taylor]
    com: Taylor
    gravity: Taylor

    def difference(self, q: Mapping[str, float]) -> Array:
        """D of values of the joints of the box, shape (k,)."""
        return np.array([q[name] for name in self.joints]) - self.middle


def bounds_over_poses(
    state: State, joints: Boxed, points: Mapping[str, tuple[str, Sequence[float] | Array]] | None = None
) -> PoseBounds:
    """Bounds over all poses whose joints are in a box; joints that are not named, and the base, stay as in the state.

    Args:
        state: The pose; its v is not used.
        joints: {joint of one coordinate: (lowest, highest) [rad, m]}.
        points: {name: (frame, offset in its axes [m])}: whose positions and Jacobians are wanted.

    Raises:
        InputError: an unknown joint or frame, reversed or infinite intervals.
        Unsupported: a joint of a type other than revolute, continuous, prismatic, and a floating base at the root.
    """
    check_kind("state", state, State, "an rbd.State")
    return _Chain(state, joints).bounds(points or {})


class _Chain:
    """Places of all joints."""

    def __init__(self, state: State, joints: Boxed) -> None:
        robot, model = state.robot, state.robot.model
        self._state, self._model, ends = state, model, _ends(robot, joints)
        self._ids = list(ends)
        low, high = np.array(list(ends.values())).reshape(-1, 2).T
        self._middle = 0.5 * low + 0.5 * high
        self._reach = np.asarray(np.nextafter(np.maximum(high - self._middle, self._middle - low), np.inf))
        self._R, self._p = [self._fixed(np.eye(3))], [self._fixed(np.zeros(3))]
        self._axis: list[Taylor | None] = [None]
        for j in range(1, model.njoints):
            self._place(j)

    def _fixed(self, x: Intervals | Array) -> Taylor:
        return Taylor.fixed(x, self._reach)

    def _place(self, j: int) -> None:
        """R_WJ and p_WJ of joint j, and its axis in W."""
        model, joint, parent = self._model, self._model.joints[j], self._model.parents[j]
        X = model.jointPlacements[j]
        R = self._R[parent] @ self._fixed(X.rotation.copy())
        p = self._p[parent] + self._R[parent] @ self._fixed(X.translation.copy())
        kind = joint.shortname().removeprefix("JointModel")
        q = self._state.q[joint.idx_q : joint.idx_q + joint.nq]
        if kind == "FreeFlyer" and parent == 0 and j not in self._ids:
            p = p + R @ self._fixed(q[:3].copy())
            R = R @ self._fixed(_rotation(q[3:]))
            self._axis.append(None)
        elif kind[:1] == "P" and (kind[1:] in _AXES or kind == "PrismaticUnaligned"):
            axis = _AXES[kind[1:]] if kind[1:] in _AXES else _axis_of(joint)
            self._axis.append(R @ self._fixed(axis))
            p = p + R @ self._slide(j, axis, q)
        elif kind in ("RX", "RY", "RZ", "RevoluteUnaligned", "RUBX", "RUBY", "RUBZ", "RevoluteUnboundedUnaligned"):
            axis = _AXES[kind[-1]] if kind[-1] in _AXES else _axis_of(joint)
            self._axis.append(R @ self._fixed(axis))
            R = R @ self._turn(j, axis, q)
        else:
            raise _unknown(model, j)
        self._R.append(R)
        self._p.append(p)

    def _slide(self, j: int, axis: Array, q: Array) -> Taylor:
        """Axis times q."""
        if j not in self._ids:
            return self._fixed(Intervals.exact(axis) * q[0])
        i = self._ids.index(j)
        out = self._fixed(Intervals.exact(axis) * self._middle[i])
        out.slopes[i] = axis
        return out

    def _turn(self, j: int, axis: Array, q: Array) -> Taylor:
        """Cos 1 + sin [a] + (1 - cos) a a^T."""
        c_a, s_a, outer = np.eye(3), self._fixed(axis).skew.mid, Intervals.exact(axis[:, None]) * axis[None, :]
        if j not in self._ids:
            angle = Intervals.exact(q[:1])
            c, s = (angle.cos(), angle.sin()) if len(q) == 1 else (Intervals.exact(q[:1]), Intervals.exact(q[1:]))
            return self._fixed(outer + (Intervals.exact(c_a) - outer) * c[0] + s[0] * s_a)
        i = self._ids.index(j)
        angle = Intervals.exact(self._middle[i : i + 1])
        c, s = angle.cos()[0], angle.sin()[0]
        rest = Intervals.exact(c_a) - outer
        value, rate, bend = outer + rest * c + s * s_a, c * s_a - rest * s, (rest * c + s * s_a) * -0.5
        out = self._fixed(value)
        out.slopes[i], out.bends[i, i] = rate.mid, bend.mid
        r = float(self._reach[i])
        third = r**3 / 6.0 * (np.abs(rest.mid) + rest.rad + np.abs(s_a))  # third derivatives of sin and cos are 1 at most
        return replace(out, rad=above(value.rad + r * rate.rad + r * r * bend.rad + third, 8))

    def bounds(self, points: Mapping[str, tuple[str, Sequence[float] | Array]]) -> PoseBounds:
        """All of it."""
        places, jacobians = {}, {}
        for name, given in points.items():
            frame, offset = _point(name, given)
            placed = self._model.frames[self._state.robot.frame_id(frame)]
            X, j = placed.placement, placed.parentJoint
            local = self._fixed(X.translation.copy()) + self._fixed(X.rotation.copy()) @ self._fixed(offset)
            places[name] = self._p[j] + self._R[j] @ local
            jacobians[name] = self._jacobian(j, places[name])
        mass, moments = self._moments()
        return PoseBounds(
            tuple(str(self._model.names[j]) for j in self._ids), self._middle, self._reach, places, jacobians,
            self._scaled(moments[0], Intervals.exact(1.0) / mass[0]), self._gravity(mass, moments),
        )  # fmt: skip

    def _scaled(self, x: Taylor, factor: Intervals) -> Taylor:
        """X times one number."""
        by = Taylor.fixed(Intervals(factor.mid * np.eye(3), factor.rad * np.eye(3)), self._reach)
        return by @ x

    def _moments(self) -> tuple[list[Intervals], list[Taylor]]:
        """(mass, first moment about the origin of W) of the bodies that each joint carries."""
        model = self._model
        mass = [Intervals.exact(float(body.mass)) for body in model.inertias]
        mass[0], moments = Intervals.exact(0.0), [self._fixed(np.zeros(3))]  # what is fixed to the world does not count
        for j, body in enumerate(model.inertias.tolist()[1:], start=1):
            centre = self._p[j] + self._R[j] @ self._fixed(np.array(body.lever))
            moments.append(self._scaled(centre, mass[j]))
        for j in range(model.njoints - 1, 0, -1):
            parent = model.parents[j]
            mass[parent] = mass[parent] + mass[j]
            moments[parent] = moments[parent] + moments[j]
        return mass, moments

    def _gravity(self, mass: list[Intervals], moments: list[Taylor]) -> Taylor:
        """G_j = -gravity . (a x (S - m p)) of a joint that turns, -m gravity . a of one that slides."""
        pull = self._fixed(-np.array(self._model.gravity.linear))
        entries = [self._fixed(np.zeros(()))] * self._model.nv
        for j in range(1, self._model.njoints):
            m = mass[j]
            arm = moments[j] - self._scaled(self._p[j], m)
            for column, (axis, turns) in self._columns(j).items():
                entries[column] = pull @ (axis.cross(arm) if turns else self._scaled(axis, m))
        return stacked(entries)

    def _columns(self, j: int) -> dict[int, tuple[Taylor, bool]]:
        """{coordinate of v: (axis in W, whether it turns)} of a joint; a floating base moves along and about its own axes."""
        at, axis = self._model.joints[j].idx_v, self._axis[j]
        if axis is None:
            return {at + i: (self._R[j][:, i % 3], i > 2) for i in range(6)}
        return {at: (axis, not self._model.joints[j].shortname().startswith("JointModelP"))}

    def _jacobian(self, j: int, point: Taylor) -> Taylor:
        """Of the velocity of a point on what joint j carries."""
        columns = [self._fixed(np.zeros(3))] * self._model.nv
        while j:
            for column, (axis, turns) in self._columns(j).items():
                columns[column] = axis.cross(point - self._p[j]) if turns else axis
            j = self._model.parents[j]
        return stacked(columns)


def _rotation(q: Array) -> Intervals:
    """R of a quaternion (x, y, z, w)."""
    x, y, z, w = (Intervals.exact(np.array(value)) for value in q)
    rows = [
        [1.0 - (y * y + z * z) * 2.0, (x * y - z * w) * 2.0, (x * z + y * w) * 2.0],
        [(x * y + z * w) * 2.0, 1.0 - (x * x + z * z) * 2.0, (y * z - x * w) * 2.0],
        [(x * z - y * w) * 2.0, (y * z + x * w) * 2.0, 1.0 - (x * x + y * y) * 2.0],
    ]
    return Intervals(np.array([[e.mid for e in row] for row in rows]), np.array([[e.rad for e in row] for row in rows]))


def _axis_of(joint: pin.JointModel) -> Array:
    """Axis of a joint along none of x, y, z."""
    return np.array(joint.extract().axis, float)


def _ends(robot: CheckedModel, joints: Boxed) -> dict[int, tuple[float, float]]:
    """{joint: its interval} of a box, checked."""
    if not isinstance(joints, Mapping):
        raise InputError(f"joints are {joints!r:.80}; expected {{joint: (lowest, highest)}} [rad, m].")
    found = {robot.joint_id(name): _interval(name, interval) for name, interval in joints.items()}
    for j in found:
        if robot.model.joints[j].nv != 1:
            raise _unknown(robot.model, j)
    return found


def middles(robot: CheckedModel, joints: Boxed) -> dict[str, float]:
    """{joint: the middle of its interval} of a box.

    Raises:
        InputError, Unsupported: as of `bounds_over_poses`.
    """
    return {str(robot.model.names[j]): 0.5 * low + 0.5 * high for j, (low, high) in _ends(robot, joints).items()}


def _unknown(model: pin.Model, j: int) -> Unsupported:
    return Unsupported(
        f"joint {model.names[j]!r} is a {model.joints[j].shortname().removeprefix('JointModel')}: bounds over poses know "
        "revolute, continuous and prismatic joints, and a floating base at the root, outside the box."
    )


def _interval(name: str, given: object) -> tuple[float, float]:
    try:
        low, high = (float(x) for x in given)  # type: ignore[attr-defined]
    except (TypeError, ValueError):
        low, high = np.nan, np.nan
    if not (np.isfinite([low, high]).all() and low <= high):
        raise InputError(f"joint {name!r:.80} is within {given!r:.80}; expected two numbers, lowest and highest [rad, m].")
    return low, high


def _point(name: str, given: object) -> tuple[str, Array]:
    if not isinstance(given, tuple) or len(given) != 2:
        raise InputError(f"point {name!r:.80} is {given!r:.80}; expected (frame, offset in its axes [m]).")
    return given[0], as_vector3(f"offset of point {name!r:.80}", given[1])
