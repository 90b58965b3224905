"""`SensorNoise`: standard deviations of measurements, and the resulting covariance of generalised forces.

To first order, of the equations y = M(q) a + h(q, v) - tau_ext(q) - S^T tau = J(q)^T f,

    cov y = M s_a^2 M^T + D_v s_v^2 D_v^T + D_q s_q^2 D_q^T + S^T s_tau^2 S
    D_v = dh/dv,   D_q = d(M a + h - tau_ext - J^T f)/dq

with independent sensors. M a + h is differentiated in closed form by Pinocchio, J^T f and tau_ext by central differences.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.linalg import solve_triangular

from rbd.arrays import Array, as_array, check_finite
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.errors.inputs import check_kind
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State

FLOOR = 1e-6
"""Standard deviations of generalised forces are at least this share of `force_scale`: without noise they are that exact."""
_ROUNDING = 1e-13  # of the largest variance: what is added to all, so that a large noise leaves a positive definite matrix
_MOST = 1e6
_STEP = 1e-5  # of the central differences [rad, m]: they are then right to ten digits


@dataclass(frozen=True, eq=False)
class SensorNoise(Displayed):
    """Standard deviations of measured q, v, a and tau, independent of each other; zero is exact.

    Attributes:
        q: Of the configuration, along each velocity: one number or shape (nv,) [m, rad].
        v: Of the velocity, one number or shape (nv,) [m/s, rad/s].
        a: Of the acceleration, one number or shape (nv,) [m/s2, rad/s2].
        tau: Of the motor torques, one number or shape (nu,) [N, N m].

    Raises:
        InputError: negative numbers, or all zero.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> state, feet = solo.standing(), solo.feet()
        >>> noise = rbd.motion.SensorNoise(a=0.1, tau=0.02)
        >>> estimate = rbd.estimate_forces(state, np.zeros(solo.nv), feet, rbd.hold(state, feet).tau, noise=noise)
        >>> estimate.deviations["front_left"].round(3)
        array([0.077, 0.084, 0.126])
    """

    q: float | Sequence[float] | Array = 0.0
    v: float | Sequence[float] | Array = 0.0
    a: float | Sequence[float] | Array = 0.0
    tau: float | Sequence[float] | Array = 0.0

    def __post_init__(self) -> None:
        given = {what: as_array(f"noise of {what}", getattr(self, what)) for what in ("q", "v", "a", "tau")}
        for what, value in given.items():
            check_finite(f"noise of {what}", value)
            if value.ndim > 1 or not ((value >= 0.0) & (value < _MOST)).all():
                raise InputError(
                    f"noise of {what} is {getattr(self, what)!r:.80}; expected standard deviations of 0 or more, below "
                    f"{_MOST:g}, one number or one a coordinate."
                )
        if not any(value.any() for value in given.values()):
            raise InputError("the noise is zero everywhere; give noise=None for equal weights.")

    def of(self, what: str, size: int) -> Array:
        """Standard deviations of one sensor, shape (size,).

        Raises:
            InputError: another number of them.
        """
        value = as_array(f"noise of {what}", getattr(self, what))
        if value.ndim and value.shape != (size,):
            raise InputError(f"noise of {what} has shape {value.shape}; expected one number or ({size},), one a coordinate.")
        return np.full(size, float(value)) if not value.ndim else value

    def covariance(self, state: State, a: Array, force_at: Callable[[State], Array] | None, *, torques: bool) -> Array:
        """Covariance of M a + h - tau_ext - S^T tau - J^T f, shape (nv, nv) [N2, N2 m2].

        Args:
            state: The measured state.
            a: The measured acceleration, shape (nv,).
            force_at: tau_ext + J^T f at a state, for the same f; None: it is taken as independent of q.
            torques: Whether torques were measured.
        """
        robot, nv = state.robot, state.robot.nv
        q, v = self.of("q", nv), self.of("v", nv)
        parts = [state.M * self.of("a", nv)]
        if q.any() or v.any():
            by_q, by_v = _inverse_dynamics_slopes(state, a)
            parts.append(by_v * v)
            if q.any():
                parts.append((by_q if force_at is None else by_q - _slope(state, force_at)) * q)
        if torques:
            parts.append(robot.actuation.T * self.of("tau", robot.nu))
        L = np.hstack(parts)
        return np.asarray(L @ L.T)


def force_scale(state: State, *, motors: bool = True) -> Array:
    """What a generalised force is measured against at each coordinate, shape (nv,) [N, N m].

    A motor's effort limit; where none is stated, and of bases and passive joints, g sqrt(m M_ii) with m the robot's mass: the
    weight, of a rotation times the radius of gyration about its axis. Without gravity, g is 1 m/s2.

    Args:
        state: The robot.
        motors: Whether effort limits count.
    """
    robot = state.robot
    g = float(np.linalg.norm(robot.gravity)) or 1.0
    own = state.M.diagonal()
    out = g * np.sqrt(robot.mass * np.maximum(own, 1e-12 * max(1.0, float(own.max(initial=0.0)))))
    if motors:
        limit = robot.effort_limit
        known = np.isfinite(limit)
        out[robot.actuated[known]] = limit[known]
    return np.asarray(out)


def whitening(covariance: Array | None, scale: Array) -> Array:
    """Inverse of a square root of a covariance, shape (k, k); without one, equal weights over the scales.

    Args:
        covariance: Shape (k, k), or None.
        scale: `force_scale` of the coordinates, shape (k,).
    """
    if covariance is None:
        return np.diag(1.0 / scale)
    scaled = covariance / np.outer(scale, scale)
    scaled.flat[:: len(scaled) + 1] += FLOOR**2 + _ROUNDING * float(scaled.diagonal().max(initial=0.0))
    L = np.linalg.cholesky(scaled)
    return np.asarray(solve_triangular(L, np.diag(1.0 / scale), lower=True))


def checked_noise(robot: CheckedModel, noise: SensorNoise | None, *, torques: bool) -> SensorNoise | None:
    """The noise, if it fits the robot.

    Raises:
        InputError: it is none, sizes that do not fit, noise of torques that were not measured.
    """
    if noise is None:
        return None
    check_kind("noise", noise, SensorNoise, "rbd.motion.SensorNoise(q=..., v=..., a=..., tau=...), or None")
    for what in ("q", "v", "a"):
        noise.of(what, robot.nv)
    if noise.of("tau", robot.nu).any() and not torques:
        raise InputError("noise of tau was given without torques. Give tau, or leave its noise out.")
    return noise


def _inverse_dynamics_slopes(state: State, a: Array) -> tuple[Array, Array]:
    """d(M a + h)/dq and /dv, shapes (nv, nv)."""
    robot, q, v = state.robot, state.q, state.v
    return robot.pool.compute(lambda data: tuple(x.copy() for x in pin.computeRNEADerivatives(robot.model, data, q, v, a)[:2]))


def _slope(state: State, force_at: Callable[[State], Array]) -> Array:
    """Derivative of a generalised force by q, on the tangent space, shape (nv, nv)."""
    robot, nv = state.robot, state.robot.nv
    out = np.empty((nv, nv))
    for i in range(nv):
        d = np.zeros(nv)
        d[i] = _STEP
        ahead, behind = (State(robot, pin.integrate(robot.model, state.q, x), state.v, t=state.t) for x in (d, -d))
        out[:, i] = (force_at(ahead) - force_at(behind)) / (2.0 * _STEP)
    return out
