"""Derivatives of the equations of motion and of poses fixed to bodies by configuration and velocity, by Pinocchio.

The forces of `state_derivatives` act at poses fixed to bodies, and each keeps its components in axes of its own: those of the
pose, which turn with the body, or constant ones. A change dq is in the tangent space, as everywhere: q becomes
pin.integrate(q, dq), and v keeps its numbers.

Pinocchio differentiates spatial accelerations in the axes of the body. Here they are classical, a + (w x v; 0), and in
constant axes a vector x changes besides by the turn of the body: d(R x) = R (dx + dw x x).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, cross_matrix
from rbd.model.state import State


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
    """

    J: Array
    acceleration: Array
    velocity_dq: Array
    acceleration_dq: Array
    acceleration_dv: Array
    force_dq: Array | None


@dataclass(frozen=True, eq=False)
class StateDerivatives:
    """Derivatives of J^T f - (M a + h) at fixed a, with J^T f of the forces at all poses.

    Attributes:
        force_dq: Shape (nv, nv).
        force_dv: Shape (nv, nv).
        poses: Of each pose.
    """

    force_dq: Array
    force_dv: Array
    poses: list[PoseDerivatives]


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
    robot, q, v = state.robot, state.q, state.v
    model, nv, found, turned = robot.model, robot.nv, [], []
    applied = pin.StdVec_Force(model.njoints, pin.Force.Zero())
    with robot.pool.lock:
        slot, ticket = robot.pool.take(lambda data: pin.computeForwardKinematicsDerivatives(model, data, q, v, a))
        data = slot.data
        for pose, force in zip(poses, forces, strict=True):
            joint, X_JF = robot.site(pose.frame)
            X_JP = X_JF * pose.X_FP
            of_body = [x.reshape(6, nv) for x in pin.getFrameAccelerationDerivatives(model, data, joint, X_JP, pin.LOCAL)]
            acceleration = pin.getFrameClassicalAcceleration(model, data, joint, X_JP, pin.LOCAL).vector
            R = data.oMi[joint].rotation @ X_JP.rotation
            moved, local = _derivatives(of_body, acceleration, v, R, pose.axes, force)
            found.append(moved)
            applied[joint] += X_JP.act(pin.Force(local))
            if pose.axes is not None:
                turned.append((of_body[3], local))
        # It differentiates M a + h less J^T f with f constant in the axes of the bodies.
        pin.computeRNEADerivatives(model, data, q, v, a, applied)
        force_dq, force_dv = -data.dtau_dq, -data.dtau_dv
        robot.pool.give_back(slot, ticket)
    for J, local in turned:
        turn = J[3:]
        force_dq += J[:3].T @ (cross_matrix(local[:3]) @ turn) + turn.T @ (cross_matrix(local[3:]) @ turn)
    return StateDerivatives(force_dq, force_dv, found)


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
    if v.any():
        along, spin = cross_matrix(u[:3]), cross_matrix(u[3:])
        a_dq[:3] += spin @ u_dq[:3] - along @ u_dq[3:]
        a_dv[:3] += spin @ J[:3] - along @ turn
    if axes is None:
        turned = [R @ (cross_matrix(f) @ turn) for f in (-force[:3], -force[3:])]
        return PoseDerivatives(J, acceleration, u_dq, a_dq, a_dv, np.concatenate(turned)), force
    T = axes.T @ R
    u_dq, a_dq = (
        np.concatenate([T @ (x_dq[:3] - cross_matrix(x[:3]) @ turn), T @ (x_dq[3:] - cross_matrix(x[3:]) @ turn)])
        for x_dq, x in ((u_dq, u), (a_dq, acceleration))
    )
    J, a_dv, acceleration = (np.concatenate([T @ x[:3], T @ x[3:]]) for x in (J, a_dv, acceleration))
    return PoseDerivatives(J, acceleration, u_dq, a_dq, a_dv, None), np.concatenate([T.T @ force[:3], T.T @ force[3:]])
