"""Local coordinates about a configuration, and derivatives of terms of the dynamics and of poses by them.

    q = q0 (+) xi            xi' = T(xi)^-1 v            T(xi) = d(q0 (+) xi) / d(xi), in the axes that v is given in

xi has the size of v. Of joints whose v is the derivative of their coordinates T is the identity; of planar, spherical and
floating joints it is the right Jacobian of the group's exponential, whose inverse, with ad the bracket with xi, is

    T^-1 = 1 + ad / 2 + ad^2 / 12 - ad^4 / 720 + ...

Near xi = 0 it is evaluated here to rounding. Pinocchio's Jacobians of exponential and logarithm are wrong by 2e-9 (planar:
8e-9) where xi is around 1e-3, by which the energy of a smooth motion would drift. An integrator of any order on (xi, v) has
the same order on (q, v) [MuntheKaas1999], and unit quaternions stay on their sphere, as q0 (+) xi is always on it.

The forces of `state_derivatives` act at poses fixed to bodies, and each keeps its components in axes of its own: those of the
pose, which turn with the body, or constant ones. A change dq is in the tangent space, as everywhere: q becomes
pin.integrate(q, dq), and v keeps its numbers.

Pinocchio differentiates spatial accelerations in the axes of the body. Here they are classical, a + (w x v; 0), and in
constant axes a vector x changes besides by the turn of the body: d(R x) = R (dx + dw x x).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, cross_matrix, max_abs
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State

_RESTS = 1e-14
"""A pose that moves no faster [m/s, rad/s] has the classical accelerations that are spatial ones."""
_NEAR = 1.0
"""Up to this angle [rad] the series is used; beyond, T is Pinocchio's, whose errors are then rounding."""
_EXACT = (720.0, 30240.0, 1209600.0, 47900160.0, 1307674368000.0 / 691.0, 74724249600.0)
_SERIES = (
    *(1.0 / x for x in _EXACT),
    *(2.0 * sum(n ** (-2.0 * k) for n in range(1, 20)) / (2.0 * math.pi) ** (2 * k) for k in range(8, 15)),
)
"""|B_2k| / (2k)! = 2 zeta(2k) / (2 pi)^2k of Bernoulli's numbers from k = 2; the first is 1 / 12."""
Vector = tuple[float, float, float]


class Charts:
    """The charts of one robot: knows which of its velocities are no derivatives of coordinates."""

    def __init__(self, robot: CheckedModel) -> None:
        self.model = robot.model
        self.pieces = [piece for piece in robot.joints.pieces if piece.kind in _RATES]
        self.curved = np.array([i for piece in self.pieces for i in range(piece.v, piece.v + piece.nv)], dtype=int)
        self.turning = self.curved[robot.joints.angular[self.curved]]

    def at(self, q0: Array) -> Chart:
        """The chart about a configuration."""
        return Chart(self, q0)


class Chart:
    """Coordinates xi, shape (nv,), of the configurations about q0."""

    def __init__(self, charts: Charts, q0: Array) -> None:
        self._charts, self.q0 = charts, q0

    def q(self, xi: Array) -> Array:
        """The configuration q0 (+) xi, shape (nq,)."""
        return pin.integrate(self._charts.model, self.q0, xi)

    def rate(self, xi: Array, v: Array) -> Array:
        """The derivative xi' = T(xi)^-1 v, shape (nv,)."""
        curved, model = self._charts.curved, self._charts.model
        if not len(curved):
            return v
        if max_abs(xi[self._charts.turning]) < _NEAR:
            out, x, u = v.copy(), xi.tolist(), v.tolist()
            for piece in self._charts.pieces:
                own = slice(piece.v, piece.v + piece.nv)
                out[own] = _RATES[piece.kind](x[own], u[own])
            return out
        T = pin.dIntegrate(model, self.q0, xi, pin.ARG1)
        out = v.copy()
        out[curved] = np.linalg.solve(T[np.ix_(curved, curved)], v[curved])
        return out


def _coefficients(turn: Sequence[float]) -> tuple[float, float]:
    """(c, dc / ds), s the square of the angle: T^-1 = 1 + P / 2 + c P^2 of rotations, with P = turn x."""
    s = turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2]
    c = slope = 0.0
    for term in reversed(_SERIES):
        slope = slope * s + c
        c = c * s + term
    return 1.0 / 12.0 + s * c, c + s * slope


def _turn_rate(x: Sequence[float], w: Sequence[float]) -> Sequence[float]:
    """T^-1 w of a rotation."""
    first, (c, _) = _cross(x, w), _coefficients(x)
    return [a + 0.5 * b + c * d for a, b, d in zip(w, first, _cross(x, first), strict=True)]


def _space_rate(xi: Sequence[float], u: Sequence[float]) -> Sequence[float]:
    """T^-1 u of a pose, linear then angular: its upper right block is the derivative of the rotations' along the shift."""
    shift, turn, v, w = xi[:3], xi[3:], u[:3], u[3:]
    c, slope = _coefficients(turn)
    slope *= 2.0 * (shift[0] * turn[0] + shift[1] * turn[1] + shift[2] * turn[2])
    turned, moved, swept = _cross(turn, w), _cross(turn, v), _cross(shift, w)
    first = (moved[0] + swept[0], moved[1] + swept[1], moved[2] + swept[2])
    again, second, other = _cross(turn, turned), _cross(turn, first), _cross(shift, turned)
    linear = [a + 0.5 * b + c * (d + e) + slope * f for a, b, d, e, f in zip(v, first, second, other, again, strict=True)]
    return *linear, *(a + 0.5 * b + c * d for a, b, d in zip(w, turned, again, strict=True))


def _plane_rate(xi: Sequence[float], u: Sequence[float]) -> Sequence[float]:
    """T^-1 u of a pose in the plane, (x, y, angle)."""
    x, y, turn = xi
    vx, vy, w = u
    c = _coefficients((0.0, 0.0, turn))[0] * turn
    return (
        vx + 0.5 * (w * y - turn * vy) + c * (w * x - turn * vx),
        vy + 0.5 * (turn * vx - w * x) + c * (w * y - turn * vy),
        w,
    )


def _cross(a: Sequence[float], b: Sequence[float]) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


_RATES: dict[str, Callable[[Sequence[float], Sequence[float]], Sequence[float]]] = {
    "sphere": _turn_rate,
    "plane": _plane_rate,
    "space": _space_rate,
}
"""Of the pieces of joints whose velocities are no derivatives of coordinates."""


@dataclass(frozen=True, eq=False)
class FixedPose:
    """A pose fixed to a frame of the robot, and the axes in which its motion and its forces are given.

    Attributes:
        frame: Frame of the robot.
        X_FP: From the frame to the pose.
        axes: Constant axes R_WC, shape (3, 3); None: those of the pose.
    """

    frame: str
    X_FP: pin.SE3
    axes: Array | None


@dataclass(frozen=True, eq=False)
class PoseDerivatives:
    """How a pose moves at given q, v and a, in its axes, linear then angular, and how that changes.

    Attributes:
        J: Jacobian, which is also the derivative of the velocity by v, and of the acceleration by a, shape (6, nv).
        acceleration: Classical, shape (6,) [m/s2, rad/s2].
        velocity_dq: Shape (6, nv).
        acceleration_dq: Shape (6, nv).
        acceleration_dv: Shape (6, nv).
        force_dq: Of the force at the pose, in world axes, shape (6, nv); None where its axes are constant.
        R: Its axes in the world, shape (3, 3).
    """

    J: Array
    acceleration: Array
    velocity_dq: Array
    acceleration_dq: Array
    acceleration_dv: Array
    force_dq: Array | None
    R: Array


@dataclass(frozen=True, eq=False)
class StateDerivatives:
    """Derivatives of J^T f - (M a + h) at fixed a, with J^T f of the forces at all poses.

    Attributes:
        force_dq: Shape (nv, nv).
        force_dv: Shape (nv, nv).
        poses: Of each pose.
        M: The inertia, shape (nv, nv).
    """

    force_dq: Array
    force_dv: Array
    poses: list[PoseDerivatives]
    M: Array


def state_derivatives(state: State, a: Array, poses: Sequence[FixedPose], forces: Sequence[Array]) -> StateDerivatives:
    """Derivatives of the equations of motion and of poses by q and v, at fixed a.

    Args:
        state: The robot at (q, v).
        a: Acceleration, shape (nv,).
        poses: Where forces act.
        forces: (force, moment) on the robot at each pose, in its axes, constant there, shape (6,).

    Raises:
        FrameNotFound: with the nearest names.
    """
    return state.robot.pool.compute(partial(_state_derivatives, state, a, poses, forces))


def _state_derivatives(
    state: State, a: Array, poses: Sequence[FixedPose], forces: Sequence[Array], data: pin.Data
) -> StateDerivatives:
    robot, q, v = state.robot, state.q, state.v
    model, nv, found, turned = robot.model, robot.nv, [], []
    applied = pin.StdVec_Force(model.njoints, pin.Force.Zero())
    pin.computeForwardKinematicsDerivatives(model, data, q, v, a)
    for pose, force in zip(poses, forces, strict=True):
        joint, X_JF = robot.site(pose.frame)
        X_JP = X_JF * pose.X_FP
        of_body = [x.reshape(6, nv) for x in pin.getFrameAccelerationDerivatives(model, data, joint, X_JP, pin.LOCAL)]
        acceleration = pin.getFrameClassicalAcceleration(model, data, joint, X_JP, pin.LOCAL).vector
        R = (data.oMi[joint] * X_JP).rotation
        moved, local = _derivatives(of_body, acceleration, v, R, pose.axes, force)
        found.append(moved)
        applied[joint] += X_JP.act(pin.Force(local))
        if pose.axes is not None:
            turned.append((of_body[3], local))
    # It differentiates M a + h less J^T f with f constant in the axes of the bodies.
    pin.computeRNEADerivatives(model, data, q, v, a, applied)
    force_dq, force_dv = -data.dtau_dq, -data.dtau_dv
    for J, local in turned:
        turn = J[3:]
        force_dq += J[:3].T @ (cross_matrix(local[:3]) @ turn) + turn.T @ (cross_matrix(local[3:]) @ turn)
    return StateDerivatives(force_dq, force_dv, found, data.M.copy("F"))


def _derivatives(
    of_body: Sequence[Array], acceleration: Array, v: Array, R: Array, axes: Array | None, force: Array
) -> tuple[PoseDerivatives, Array]:
    """(the pose's derivatives in its axes, the force in the axes of the body).

    Args:
        of_body: Pinocchio's: of the velocity by q; of the spatial acceleration by q, v and a.
        acceleration: Classical, in the axes of the body, shape (6,).
        v: The robot's velocity.
        R: R_WP.
        axes: As of `FixedPose`.
        force: In the pose's axes.
    """
    u_dq, a_dq, a_dv, J = of_body
    u = J @ v
    turn = J[3:]
    if max_abs(u) > _RESTS:
        along, spin = cross_matrix(u[:3]), cross_matrix(u[3:])
        a_dq[:3] += spin @ u_dq[:3] - along @ u_dq[3:]
        a_dv[:3] += spin @ J[:3] - along @ turn
    if axes is None:
        turned = np.concatenate([R @ cross_matrix(-force[:3]), R @ cross_matrix(-force[3:])]) @ turn
        return PoseDerivatives(J, acceleration, u_dq, a_dq, a_dv, turned, R), force
    T = axes.T @ R
    u_dq, a_dq = (
        np.concatenate([T @ (x_dq[:3] - cross_matrix(x[:3]) @ turn), T @ (x_dq[3:] - cross_matrix(x[3:]) @ turn)])
        for x_dq, x in ((u_dq, u), (a_dq, acceleration))
    )
    J, a_dv, acceleration = (np.concatenate([T @ x[:3], T @ x[3:]]) for x in (J, a_dv, acceleration))
    return PoseDerivatives(J, acceleration, u_dq, a_dq, a_dv, None, axes), np.concatenate([T.T @ force[:3], T.T @ force[3:]])
