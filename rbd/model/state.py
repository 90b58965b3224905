"""State: a robot at (q, v), with its dynamics and kinematics computed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_finite, as_vector3, check_number, filled, lazy, locked
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.errors.inputs import check_kind
from rbd.model.checked_model import CheckedModel
from rbd.model.data_pool import DataPool, Slot
from rbd.records import Axis, Field

_LATEST = 1e12
"""Bound of times [s]."""


@dataclass(frozen=True, eq=False)
class FrameKinematics:
    """Where a frame is and how it moves: world axes, linear then angular.

    Attributes:
        X_WF: Pose in W; its origin is the requested point.
        J: Jacobian, shape (6, nv): J v is the velocity of the point and the angular velocity.
        v: Velocity J v, shape (6,) [m/s, rad/s].
        bias: J_dot v, shape (6,): the classical acceleration of the point, and the angular one, when v_dot = 0
            [m/s2, rad/s2].
    """

    X_WF: pin.SE3
    J: Array
    v: Array
    bias: Array


class JointState(NamedTuple):
    """A joint at a state.

    Attributes:
        position: Angle [rad], of continuous joints in (-pi, pi], or displacement [m]; of several degrees of freedom its part
            of q.
        velocity: [rad/s, m/s]; of several degrees of freedom its part of v.
    """

    position: float | Array
    velocity: float | Array


class State(Displayed):
    """A robot at configuration q with velocity v: what all terms, constraints and answers are computed from.

    q and v are checked and copied at once; its terms are computed when one is first asked for, and never change. It creates no
    pin.Data: it borrows one of the robot's, and any number of states of one robot may live side by side.

    Args:
        robot: The robot.
        q: Configuration, shape (nq,); quaternions x, y, z, w. It is copied and normalised.
        v: Velocity, shape (nv,) [m/s, rad/s]; of a floating base in the base's axes. Zero if not given.
        t: Time [s], for constraints that depend on it: driven joints, ground with a motion. States made from a state keep it.

    Raises:
        InputError: wrong sizes, NaN or infinity, a quaternion off the unit sphere by more than 1e-6.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> state = solo.standing().with_joints({"FL_KFE": -1.2})
        >>> state.M.shape, state.com.round(3), state.frame("FL_FOOT").X_WF.translation.round(3)
        ((18, 18), array([-0.001,  0.   ,  0.209]), array([ 0.142,  0.172, -0.02 ]))
    """

    fields: ClassVar[tuple[Field, ...]] = (
        Field("q", ("position",), "{}", "configuration"),
        Field("v", ("velocity",), "{}/s", "velocities"),
        Field("com", ("axis",), "m", "centre of mass in W"),
    )

    def __init__(self, robot: CheckedModel, q: Array, v: Array | None = None, *, t: float = 0.0) -> None:
        if not isinstance(robot, CheckedModel):
            raise InputError(f"State wants a robot first, got {type(robot).__name__}. Load one with rbd.load_robot(name).")
        self.robot, self.q, self.v = robot, locked(robot.check_q(q)), robot.zero_v if v is None else locked(robot.check_v(v))
        self.t = _time(t)

    _slot: Slot | None = None
    _ticket = 0
    limits_checked = False
    """Whether its joints were compared with their limits: what is beyond is told once a state."""

    @property
    def coordinate_axes(self) -> dict[str, Axis]:
        """Labels and units of the robot's coordinates."""
        return self.robot.coordinate_axes

    @property
    def _pool(self) -> DataPool:
        return self.robot.pool

    @lazy
    def _terms(self) -> tuple[Array, Array, Array]:
        with self._pool.lock:
            data = self._data()
            return locked(data.M.copy("F")), locked(data.nle.copy()), locked(data.com[0].copy())

    @property
    def M(self) -> Array:
        """Joint-space inertia, shape (nv, nv), rotor inertia included."""
        return self._terms[0]

    @property
    def h(self) -> Array:
        """C(q, v) v - tau_g, shape (nv,) [N, N m]. File damping and friction are in no term of it."""
        return self._terms[1]

    @property
    def com(self) -> Array:
        """Centre of mass in W, shape (3,) [m]."""
        return self._terms[2]

    def __del__(self) -> None:
        if self._slot is not None:
            self._pool.give_back(self._slot, self._ticket)

    def __reduce__(self) -> tuple[object, ...]:
        """A copy, in another process too, has the same robot, q, v and t, to the last bit, and computes its terms itself."""
        v = None if self.v is self.robot.zero_v else self.v.tobytes()
        return _again, (self.robot, self.q.tobytes(), v, self.t)

    def __repr__(self) -> str:
        at = f", t = {self.t:.6g} s" if self.t else ""
        return f"State({self.robot.name!r}, |v| = {np.linalg.norm(self.v):.3g}{at})"

    def with_velocity(self, v: Array) -> State:
        """The same configuration with another velocity."""
        return State(self.robot, self.q, v, t=self.t)

    def at_time(self, t: float) -> State:
        """The same configuration and velocity at a time [s].

        Raises:
            InputError: a time that is not a finite number.

        >>> round(robot.at("assembled").at_time(0.5).t, 3)
        """
        return _of_arrays(self.robot, self.q, self.v, _time(t))

    def on(self, robot: CheckedModel) -> State:
        """The same configuration and velocity of another robot with the same joints, as of a heavier one.

        Raises:
            InputError: joints or motors differ, in number, name or order; names the first.
        """
        check_kind("the robot of a state", robot, CheckedModel, "a robot: rbd.load_robot(...)")
        if robot is self.robot:
            return self
        mine, other = ((*r.model.names, *r.actuated_names, r.nq, r.nv) for r in (self.robot, robot))
        if mine != other:
            unlike = ((a, b) for a, b in zip(mine, other, strict=False) if a != b)
            first = next((f"{a!r:.60} in place of {b!r:.60}" for a, b in unlike), "more of them")
            raise InputError(f"{self.robot.name} and {robot.name} have different joints or motors: {first}.")
        return State(robot, self.q, self.v, t=self.t)

    def with_joints(self, values: Mapping[str, object]) -> State:
        """The same state with other values of some joints; the rest of q, and v, are unchanged.

        The base does not move, so that feet can leave the ground: see `rbd.robots.place_on_ground`. Joints beyond their limits
        are named by `rbd.hold`, `rbd.solve` and others.

        Args:
            values: {joint: value}: an angle [rad], also of a continuous joint, a displacement [m], or the joint's part of q,
                e.g. the seven numbers of a floating base.

        Raises:
            JointNotFound: with the nearest names.
            InputError: values of a wrong size, not finite, a quaternion off the unit sphere.

        >>> bent = talos.standing().with_joints({"arm_left_4_joint": -1.2, "torso_2_joint": 0.1})
        """
        return State(self.robot, with_values(self.robot, self.q, values), self.v, t=self.t)

    def with_joint_velocities(self, values: Mapping[str, object]) -> State:
        """The same state with other velocities of some joints; q and the rest of v are unchanged.

        Args:
            values: {joint: rate}: one number [rad/s, m/s], or the joint's part of v, e.g. the six numbers of a floating base;
                also of a single entry, {"root_joint.vx": 0.5}.

        Raises:
            JointNotFound: with the nearest names.
            InputError: values of a wrong size, or not finite.

        >>> swinging = talos.standing().with_joint_velocities({"arm_left_4_joint": 0.5})
        """
        return State(self.robot, self.q, with_rates(self.robot, self.v, values), t=self.t)

    def joint(self, name: str) -> JointState:
        """Position and velocity of a joint, by its name.

        Raises:
            JointNotFound: with the nearest names.

        >>> talos.standing().joint("arm_left_4_joint").position
        -1.0
        """
        joint = self.robot.joints[name]
        if joint.nv > 1:
            return JointState(self.q[joint.q], self.v[joint.v])
        return JointState(joint.coordinate(self.q), float(self.v[joint.v.start]))

    def _run(self, data: pin.Data) -> None:
        model, q, v = self.robot.model, self.q, self.v
        pin.crba(model, data, q, pin.Convention.WORLD)  # M, the joint Jacobians, A_g and the centre of mass
        pin.nonLinearEffects(model, data, q, v)  # h
        pin.forwardKinematics(model, data, q, v, self.robot.zero_v)  # last: leaves accelerations for v_dot = 0

    def _data(self) -> pin.Data:
        """Data with this state's kinematics; only under the pool's lock."""
        slot = self._slot
        if slot is None or slot.ticket != self._ticket:
            slot, self._ticket = self._pool.take(self._run)
            self._slot = slot
        return slot.data

    def moving(self, frame: str, X_FP: pin.SE3, axes: pin.ReferenceFrame) -> tuple[pin.SE3, Array, Array, Array]:
        """(X_WP, J, v, bias) of a pose P fixed to a frame, in world axes or in P's own (frozen) axes.

        For the code of constraints; elsewhere use `frame`. `axes` is pin.LOCAL_WORLD_ALIGNED or pin.LOCAL. The bias is
        classical: in P's axes it is R_WP^T times the one in world axes, the turning of the axes left out.
        """
        model = self.robot.model
        joint, X_JF = self.robot.site(frame)
        X_JP = X_JF * X_FP
        with self._pool.lock:
            data = self._data()
            J = pin.getFrameJacobian(model, data, joint, X_JP, axes)
            return (
                data.oMi[joint] * X_JP,
                J if J.ndim == 2 else J.reshape(6, 1),  # for a robot with one degree of freedom its shape is (6,)
                pin.getFrameVelocity(model, data, joint, X_JP, axes).vector,
                pin.getFrameClassicalAcceleration(model, data, joint, X_JP, axes).vector,
            )

    def frame(self, name: str, offset: Sequence[float] | Array = (0.0, 0.0, 0.0)) -> FrameKinematics:
        """Pose, Jacobian, velocity and J_dot v of a frame, or of a point fixed to it.

        Args:
            name: Frame of the robot.
            offset: The point, in the frame's axes, from its origin [m].

        Raises:
            FrameNotFound: with the nearest names.
            InputError: if the offset is not three finite numbers.
        """
        X_FP = pin.SE3(np.eye(3), as_vector3("offset", offset))
        return FrameKinematics(*self.moving(name, X_FP, pin.LOCAL_WORLD_ALIGNED))

    def base_pose(self, joint: int = 1) -> pin.SE3:
        """X_WB of a joint's body, of `robot.bases`; by default of the first. That of a planar base is its link's."""
        turn = self.robot.base_turn if joint == 1 else None
        with self._pool.lock:
            found = self._data().oMi[joint].copy()
        return found if turn is None else found * turn

    def joint_places(self, joints: Sequence[int]) -> tuple[Array, Array]:
        """(R_WJ, p_WJ) of joints by their numbers, shapes (n, 3, 3) and (n, 3) [m]."""
        with self._pool.lock:
            self._data()
            assert self._slot is not None
            places = np.array([self._slot.placements[joint].homogeneous for joint in joints])
            return places[:, :3, :3], places[:, :3, 3]

    def joint_motion(self, joints: Sequence[int]) -> tuple[Array, Array, Array]:
        """`joint_places`, and the joints' Jacobian at W's origin over its time derivative, shape (12, nv).

        Column k is the spatial velocity that a unit of v_k gives all bodies beyond its joint: linear, of the point at W's
        origin, then angular. For many points at once; for one point use `frame`.
        """
        nv = self.robot.nv
        with self._pool.lock:
            data = self._data()
            # It leaves placements, velocities and J as they are, to the last bit.
            rate = pin.computeJointJacobiansTimeVariation(self.robot.model, data, self.q, self.v)
            return *self.joint_places(joints), np.concatenate([data.J.reshape(6, nv), rate.reshape(6, nv)])

    def centroidal(self) -> tuple[Array, Array, float]:
        """(A_g (6, nv), A_g_dot v (6,), mass): the centroidal momentum matrix and the bias of the momentum's rate.

        Linear then angular, about the centre of mass, in world axes; the rate of momentum is A_g v_dot + A_g_dot v.
        """
        return self._centroidal

    @lazy
    def _centroidal(self) -> tuple[Array, Array, float]:
        with self._pool.lock:
            data = self._data()
            # From velocities and accelerations for v_dot = 0, which _run left; crba left A_g and the mass.
            rate_bias = np.array(pin.computeCentroidalMomentumTimeVariation(self.robot.model, data).vector)
            return locked(data.Ag.copy()), locked(rate_bias), data.mass[0]


def state_at(robot: CheckedModel, q: Array, v: Array, t: float = 0.0) -> State:
    """The state at q, v and t as an integrator computed them: it keeps these arrays, if they are as a state's.

    Raises:
        InputError: as of `State`.
    """
    if robot._has_state(q, v):
        return _of_arrays(robot, q, v, t)
    return State(robot, q, v, t=t)


def _of_arrays(robot: CheckedModel, q: Array, v: Array, t: float) -> State:
    """The state that keeps these arrays, which are in order."""
    return filled(State, robot=robot, q=locked(q), v=locked(v), t=t)


def with_values(robot: CheckedModel, q: Array, values: Mapping[str, object], *, argument: str = "values") -> Array:
    """A copy of q with given values of some joints: an angle, a displacement, or the joint's part of q.

    Args:
        robot: The robot.
        q: Configuration, shape (nq,).
        values: {joint: value}.
        argument: Their name in messages.

    Raises:
        InputError: not a mapping, or values of a wrong size or not finite.
        JointNotFound: with the nearest names.
    """
    check_kind(argument, values, Mapping, "a mapping {joint: value}, e.g. {'knee': 0.5}")
    out = q.copy()
    for name, value in values.items():
        joint, what = robot.joints[name], f"value of joint {name!r:.80}"
        given = np.atleast_1d(as_finite(what, value, (), ("n",), meaning=": a number, or its part of q"))
        out[joint.q] = joint.target(name, given)
    return out


def with_rates(robot: CheckedModel, v: Array, values: Mapping[str, object]) -> Array:
    """A copy of v with given velocities of some joints, or of single entries.

    Args:
        robot: The robot.
        v: Velocity, shape (nv,).
        values: {joint or entry: its part of v}.

    Raises:
        InputError: not a mapping, or values of a wrong size or not finite.
        JointNotFound: with the nearest names.
    """
    check_kind("values", values, Mapping, "a mapping {joint: velocity}, e.g. {'knee': 0.5}")
    out = v.copy()
    for name, value in values.items():
        at, what = robot.joints.velocity(name), f"velocity of joint {name!r:.80}"
        size = at.stop - at.start
        out[at] = as_finite(what, value, (size,), *[()] * (size == 1), meaning=": a number an entry")
    return out


def _time(t: float) -> float:
    if type(t) is float and abs(t) < _LATEST:
        return t
    return check_number("time t of a state", t, -_LATEST, _LATEST, expected="a finite number of seconds")


def _again(robot: CheckedModel, q: bytes, v: bytes | None, t: float) -> State:
    """A state from another one's data: q is not normalised again, which could change its last bit."""
    return _of_arrays(robot, np.frombuffer(q).copy(), robot.zero_v if v is None else np.frombuffer(v).copy(), t)


def checked(state: State) -> State:
    """The state itself.

    Raises:
        InputError: it is none.
    """
    if not isinstance(state, State):
        raise InputError(
            f"a State of a robot was expected first, got {state!r:.80}. Make one: rbd.State(robot, q, v), or robot.standing()."
        )
    return state
