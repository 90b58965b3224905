"""Gains that hold a posture, from the inertia that the motors feel through what touches.

Let C be the rows of what holds and of the points that touch, Z the motions that they leave, of unit inertia, and P the motion
that motor rates belong to:

    C Z = 0,   Z^T M Z = 1,   y = P q_motors,   P S Z = 1            (P by least squares, strong motors counting most)

Motor torques P^T u make the accelerations y'' = u of these motions, so with h the weight and T how it tips,

    tau = P^T (Z^T h) - P^T (w^2 + T) P (q - q*) - 2 zeta w P^T P v     gives     y'' + 2 zeta w y' + w^2 y = 0

for every small motion that the contacts allow. T is the derivative of Z^T (S^T tau + C^T f - h) along Z at constant torques and
forces; only what tips is in it, not what gravity itself brings back. P^T P is the inertia that the motors feel [Khatib1987]: of
a fixed arm M, of a standing robot's ankles that of the body above them, where the diagonal of M knows of the foot alone.

One number a joint in its place would leave the frequencies of a standing humanoid 12 (Talos) to 17 times (G1) apart, and 1 ms
would be too long a step for the fastest where the slowest is well damped. Without T, Talos buckles below w = 17, G1 below 26.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import scipy.linalg

from rbd.arrays import Array
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State

RANK = 1e-4
"""Motions that move the motors so much less than the largest are none of theirs, as of a body that turns about an edge."""
NUDGE = 1e-4
"""How far the posture is moved to see how it tips [s sqrt(N m), of unit inertia]."""


@dataclass(frozen=True, eq=False)
class Gains:
    """What holds a posture while the same points touch: tau = torque - stiffness (q - q*) - damping v.

    Attributes:
        torque: Shape (nu,) [N, N m]: no motor accelerates under it; of least sum (tau / limit)^2. Zero in free fall.
        stiffness: Shape (nu, nu) [N/m, N m/rad].
        damping: Shape (nu, nu) [N s/m, N m s/rad].
    """

    torque: Array
    stiffness: Array
    damping: Array


def posture_gains(
    state: State, rows_at: Callable[[State], Array], torque: Array | None, frequency: float, damping_ratio: float
) -> Gains:
    """The gains at a posture.

    Args:
        state: The posture, at rest.
        rows_at: C at a state, shape (m, nv); the same rows near the posture.
        torque: In place of the one computed here, shape (nu,); it must be in equilibrium.
        frequency: w [rad/s].
        damping_ratio: zeta.
    """
    robot = state.robot
    C = rows_at(state)
    Z = _motions(state.M, C)
    scale = torque_scale(robot)
    P = scipy.linalg.pinv(Z[robot.actuated] * scale[:, None], rtol=RANK) * scale if robot.nu else np.zeros((Z.shape[1], 0))
    tau = P.T @ (Z.T @ state.h) if torque is None else torque
    tips = _tipping(state, rows_at, C, Z, tau)
    w = frequency
    return Gains(tau, P.T @ (w * w * np.eye(len(tips)) + tips) @ P, 2.0 * damping_ratio * w * P.T @ P)


def torque_scale(robot: CheckedModel) -> Array:
    """What each motor's torque is measured by, shape (nu,): its limit; without one, body weight times a metre, as in `hold`."""
    weight = robot.mass * float(np.linalg.norm(robot.gravity)) or 1.0
    return np.where(np.isfinite(robot.effort_limit), robot.effort_limit, weight)


def _motions(M: Array, C: Array) -> Array:
    """Z: all motions with C Z = 0, of unit inertia, shape (nv, nv - rank)."""
    U = scipy.linalg.cholesky(M)
    if not len(C):
        return scipy.linalg.solve_triangular(U, np.eye(len(M)))
    left, size, _ = scipy.linalg.svd(scipy.linalg.solve_triangular(U, C.T, trans="T"))
    rank = int((size > 1e-9 * size[0]).sum())
    return scipy.linalg.solve_triangular(U, left[:, rank:])


def _tipping(state: State, rows_at: Callable[[State], Array], C: Array, Z: Array, tau: Array) -> Array:
    """T without what brings back: symmetric, no eigenvalue below zero, shape (n, n) [1/s2]."""
    robot = state.robot
    motors = np.zeros(robot.nv)
    motors[robot.actuated] = tau
    # Where the contacts do not carry the weight it falls with a; seen from there, it is at rest.
    a = Z @ (Z.T @ (motors - state.h))
    f = np.linalg.lstsq(C.T, state.h + state.M @ a - motors, rcond=None)[0] if len(C) else np.zeros(0)

    def force(z: Array) -> Array:
        near = State(robot, pin.integrate(robot.model, state.q, z))
        return Z.T @ (motors + rows_at(near).T @ f - near.h - near.M @ a)

    n = Z.shape[1]
    T = np.array([(force(NUDGE * z) - force(-NUDGE * z)) / (2.0 * NUDGE) for z in Z.T]).reshape(n, n)
    size, directions = np.linalg.eigh(0.5 * (T + T.T))
    return (directions * np.maximum(size, 0.0)) @ directions.T
