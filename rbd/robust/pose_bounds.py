"""Bounds of points, contact Jacobians, centre of mass and gravity torques over all poses of a box of joints.

With d = q - q0 the distances of the joints of the box from its middle, |d_i| <= r_i, each quantity is

    x(q) = mid + sum_i d_i slopes_i + remainder,      |remainder| <= rad

for every q of the box. Sums and products of such forms are again such forms: what is of second order in d, and all rounding,
goes into rad, which is bounded by the arithmetic of `rbd.intervals`. So rad falls with the square of the box, down to rounding.
A joint's rotation enters by sin(q0 + d) = sin q0 + d cos q0 + e, |e| <= d^2 / 2, and cos alike; the chain is multiplied out.

Of Pinocchio only the model's data are used, as exact doubles: placements of joints and frames, axes, masses, centres of mass,
gravity; and of the state q, whose base quaternion is a rotation up to rounding.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_vector3
from rbd.errors import InputError, Unsupported
from rbd.errors.inputs import check_kind
from rbd.intervals import Intervals, U, above, product
from rbd.model.state import State

Boxed = Mapping[str, tuple[float, float]]
_AXES = {"X": np.eye(3)[0], "Y": np.eye(3)[1], "Z": np.eye(3)[2]}


@dataclass(frozen=True, eq=False)
class Linear:
    """An array that depends on d almost linearly: |x(d) - mid - sum_i d_i slopes_i| <= rad for all |d_i| <= reach_i.

    Attributes:
        mid: Value at the middle of the box, shape S.
        slopes: Rates with each d_i, shape (k, *S).
        rad: Bounds of the remainder, shape S.
        reach: Largest |d_i|, shape (k,).
    """

    mid: Array
    slopes: Array
    rad: Array
    reach: Array

    @classmethod
    def fixed(cls, x: Intervals | Array, reach: Array) -> Linear:
        """What does not depend on d."""
        given = Intervals.exact(x)
        return cls(given.mid, np.zeros((len(reach), *given.shape)), given.rad, reach)

    @property
    def swing(self) -> Array:
        """Bounds of |sum_i d_i slopes_i|, shape S."""
        return above(np.tensordot(self.reach, np.abs(self.slopes), 1), len(self.reach) + 1)

    @property
    def range(self) -> Intervals:
        """Intervals that contain it for all d of the box."""
        return Intervals(self.mid, above(self.swing + self.rad, 1))

    @property
    def T(self) -> Linear:
        """The transpose of a matrix."""
        return Linear(self.mid.T, np.swapaxes(self.slopes, 1, 2), self.rad.T, self.reach)

    def at(self, d: Array) -> Intervals:
        """Intervals that contain it at one d, shape (k,)."""
        n = len(self.reach)
        value = self.mid + np.tensordot(d, self.slopes, 1)
        size = np.abs(self.mid) + np.tensordot(np.abs(d), np.abs(self.slopes), 1)
        return Intervals(value, above(self.rad + (n + 1) * U * size, n + 4))

    def __getitem__(self, at: Any) -> Linear:
        inner = at if isinstance(at, tuple) else (at,)
        return Linear(
            np.asarray(self.mid[at]), np.asarray(self.slopes[(slice(None), *inner)]), np.asarray(self.rad[at]), self.reach,
        )  # fmt: skip

    def __neg__(self) -> Linear:
        return Linear(-self.mid, -self.slopes, self.rad, self.reach)

    def __add__(self, other: Linear) -> Linear:
        mid, slopes = self.mid + other.mid, self.slopes + other.slopes
        rounding = U * (np.abs(mid) + np.tensordot(self.reach, np.abs(slopes), 1))
        return Linear(mid, slopes, above(self.rad + other.rad + rounding, len(self.reach) + 5), self.reach)

    def __sub__(self, other: Linear) -> Linear:
        return self + (-other)

    def __matmul__(self, other: Linear) -> Linear:
        """A product of matrices, or of a matrix and a vector."""
        A, B, n = self, other, self.mid.shape[-1]
        mid = product(A.mid, B.mid)
        left = np.array([a @ B.mid for a in A.slopes]).reshape(len(A.reach), *mid.shape)
        right = np.array([A.mid @ b for b in B.slopes]).reshape(len(A.reach), *mid.shape)
        swing_a, swing_b, size_a, size_b = A.swing, B.swing, np.abs(A.mid), np.abs(B.mid)
        linear = swing_a @ size_b + size_a @ swing_b
        rad = mid.rad + (n + 2) * U * linear + swing_a @ swing_b  # rounding of the slopes, and terms of second order
        rad = rad + A.rad @ (size_b + swing_b + B.rad) + (size_a + swing_a) @ B.rad
        return Linear(mid.mid, left + right, above(rad, 2 * n + len(A.reach) + 8), A.reach)

    def cross(self, other: Linear) -> Linear:
        """A vector product."""
        return self.skew @ other

    @property
    def skew(self) -> Linear:
        """The matrix [x] with [x] y = x times y, of a vector."""
        S = np.zeros((3, 3, 3))
        S[0, 1, 2] = S[1, 2, 0] = S[2, 0, 1] = -1.0
        S[0, 2, 1] = S[1, 0, 2] = S[2, 1, 0] = 1.0
        return Linear(self.mid @ _flat(S), self.slopes @ _flat(S), self.rad @ np.abs(_flat(S)), self.reach)._square()

    def _square(self) -> Linear:
        return Linear(self.mid.reshape(3, 3), self.slopes.reshape(-1, 3, 3), self.rad.reshape(3, 3), self.reach)


def _flat(S: Array) -> Array:
    """(3, 9): entries of [x] by those of x."""
    return np.moveaxis(S, 2, 0).reshape(3, 9)


def stacked(columns: Sequence[Linear]) -> Linear:
    """Vectors of n entries as the columns of a matrix; numbers as a vector."""
    return Linear(
        np.stack([c.mid for c in columns], axis=-1), np.stack([c.slopes for c in columns], axis=-1),
        np.stack([c.rad for c in columns], axis=-1), columns[0].reach,
    )  # fmt: skip


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
    points: Mapping[str, Linear]
    jacobians: Mapping[str, Linear]
    com: Linear
    gravity: Linear

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
        if not isinstance(joints, Mapping):
            raise InputError(f"joints are {joints!r:.80}; expected {{joint: (lowest, highest)}} [rad, m].")
        self._state, self._model = state, model
        ends = {}
        for name, interval in joints.items():
            ends[robot.joint_id(name)] = _interval(name, interval)
        self._ids = list(ends)
        low, high = np.array(list(ends.values())).reshape(-1, 2).T
        self._middle = 0.5 * low + 0.5 * high
        self._reach = np.asarray(np.nextafter(np.maximum(high - self._middle, self._middle - low), np.inf))
        self._R, self._p = [self._fixed(np.eye(3))], [self._fixed(np.zeros(3))]
        self._axis: list[Linear | None] = [None]
        for j in range(1, model.njoints):
            self._place(j)

    def _fixed(self, x: Intervals | Array) -> Linear:
        return Linear.fixed(x, self._reach)

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
            raise Unsupported(
                f"joint {model.names[j]!r} is a {kind}: bounds over poses know revolute, continuous and prismatic joints, and "
                "a floating base at the root, outside the box."
            )
        self._R.append(R)
        self._p.append(p)

    def _slide(self, j: int, axis: Array, q: Array) -> Linear:
        """Axis times q."""
        if j not in self._ids:
            return self._fixed(Intervals.exact(axis) * q[0])
        i = self._ids.index(j)
        out = self._fixed(Intervals.exact(axis) * self._middle[i])
        out.slopes[i] = axis
        return out

    def _turn(self, j: int, axis: Array, q: Array) -> Linear:
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
        value, rate = outer + rest * c + s * s_a, c * s_a - rest * s
        out = self._fixed(value)
        out.slopes[i] = rate.mid
        r = float(self._reach[i])
        second = 0.5 * r * r * (np.abs(rest.mid) + rest.rad + np.abs(s_a))  # |sin''|, |cos''| <= 1
        return Linear(out.mid, out.slopes, above(value.rad + r * rate.rad + second, 6), self._reach)

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

    def _scaled(self, x: Linear, factor: Intervals) -> Linear:
        """X times one number."""
        by = Linear.fixed(Intervals(factor.mid * np.eye(3), factor.rad * np.eye(3)), self._reach)
        return by @ x

    def _moments(self) -> tuple[list[Intervals], list[Linear]]:
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

    def _gravity(self, mass: list[Intervals], moments: list[Linear]) -> Linear:
        """G_j = -gravity . (a x (S - m p)) of a joint that turns, -m gravity . a of one that slides."""
        pull = self._fixed(-np.array(self._model.gravity.linear))
        entries = [self._fixed(np.zeros(()))] * self._model.nv
        for j in range(1, self._model.njoints):
            m = mass[j]
            arm = moments[j] - self._scaled(self._p[j], m)
            for column, (axis, turns) in self._columns(j).items():
                entries[column] = pull @ (axis.cross(arm) if turns else self._scaled(axis, m))
        return stacked(entries)

    def _columns(self, j: int) -> dict[int, tuple[Linear, bool]]:
        """{coordinate of v: (axis in W, whether it turns)} of a joint; a floating base moves along and about its own axes."""
        at, axis = self._model.joints[j].idx_v, self._axis[j]
        if axis is None:
            return {at + i: (self._R[j][:, i % 3], i > 2) for i in range(6)}
        return {at: (axis, not self._model.joints[j].shortname().startswith("JointModelP"))}

    def _jacobian(self, j: int, point: Linear) -> Linear:
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
