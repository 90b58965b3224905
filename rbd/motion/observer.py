"""`MomentumObserver`: contact forces over time without accelerations, from the generalised momentum p = M(q) v.

    p_dot = S^T tau + C^T v + tau_g + tau_ext + J^T f,        M_dot = C + C^T
    r = K (p - p_0 - integral of (S^T tau + C^T v + tau_g + tau_ext + r)),        so that  r_dot = K (J^T f - r)

[DeLuca2005]. r is the generalised contact force through a low-pass of first order, with K = 2 pi times the bandwidth; the
contact forces follow from it as in `estimate_forces`, with J through the same low-pass: that of a constant force is exact while
the robot moves. No acceleration is needed, and an impact is a finite jump of p.

Between two samples, h apart, J^T f has the mean F = (p_1 - p_0) / h - mean of (S^T tau + C^T v + tau_g + tau_ext), and
r_1 = e^(-K h) r_0 + (1 - e^(-K h)) F is the low-pass to the last digit where J^T f is constant between them: no step is too
long for stability. The mean is that of the two ends, an error of the order h^2.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rbd.arrays import Array, as_float, check_flag, check_positive
from rbd.constraints.constraint import Constraint, WithLoops, check_on, listed, with_loops
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.errors.inputs import check_kind
from rbd.model.checked_model import CheckedModel
from rbd.model.dynamics import coriolis_matrix, gravity_torque
from rbd.model.external import External, generalised
from rbd.model.sampled_motion import SampledMotion
from rbd.model.state import State, checked
from rbd.motion.force_estimate import ForceEstimate
from rbd.motion.measured import ForceHistory, check_measured, checked_touches, fitted, history_of
from rbd.motion.sensor_noise import SensorNoise, checked_noise
from rbd.problem.rows import Rows
from rbd.statics.force_balance import contact_rows

MOST_BANDWIDTH = 1e6


class MomentumObserver(Displayed):
    """Contact forces from measured configuration, velocity and motor torques: their low-pass of a known bandwidth.

    A step of the contact force is seen as 1 - exp(-K t), with K = 2 pi bandwidth; a sinusoid of frequency f is smaller by
    sqrt(1 + (f / bandwidth)^2) and late by atan(f / bandwidth). It starts as if the robot did not accelerate, which is right of
    one that stands, and forgets a wrong start as exp(-K t).

    With noise, the covariance is that of independent samples of v (through p = M v) and of tau, in the steady state; noise of q
    and that of v in C^T v are left out.

    Args:
        robot: The robot.
        contacts: What touches; `update` may be given others.
        bandwidth: Where a sinusoid has lost half its power [Hz].
        torques: Whether motor torques are measured; without them, only coordinates that no motor drives count.
        held: Torques stay as given until the next sample, as a digital controller commands them; else they are measured at the
            samples, and the mean of two is taken between them.
        noise: Standard deviations of v and tau.
        loops: Whether the robot's own loops hold; one that is given counts once.

    Raises:
        InputError: a bandwidth that is none, noise of q or a, a fixed base without torques; unknown frames.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> state, feet = solo.standing(), solo.feet()
        >>> observer = rbd.motion.MomentumObserver(solo, feet, bandwidth=20.0)
        >>> tau = rbd.hold(state, feet).tau
        >>> estimates = [observer.update(t, state, tau) for t in np.arange(0.0, 0.05, 5e-3)]
        >>> estimates[-1].forces["front_left"].round(3)
        array([-0.457, -0.389,  6.131])
    """

    def __init__(
        self,
        robot: CheckedModel,
        contacts: Sequence[Constraint],
        *,
        bandwidth: float,
        torques: bool = True,
        held: bool = False,
        noise: SensorNoise | None = None,
        loops: bool = True,
    ) -> None:
        check_kind("robot of MomentumObserver", robot, CheckedModel, "a robot: rbd.load_robot(name)")
        check_flag("torques of MomentumObserver", torques)
        check_flag("held of MomentumObserver", held)
        self.robot, self.contacts, self.torques, self.held = robot, with_loops(robot, contacts, loops), torques, held
        self._given, self._loops = listed(contacts), loops
        for contact in self.contacts:
            check_on(contact, robot)
        self.bandwidth = check_positive("bandwidth", bandwidth, MOST_BANDWIDTH)
        self.noise = checked_noise(robot, noise, torques=torques)
        if self.noise is not None and (self.noise.of("q", robot.nv).any() or self.noise.of("a", robot.nv).any()):
            raise InputError("an observer regards noise of v and tau only; leave q and a out.")
        check_measured(robot, True if torques else None)
        self.reset()

    @property
    def gain(self) -> float:
        """K = 2 pi bandwidth [1/s]."""
        return 2.0 * math.pi * self.bandwidth

    @property
    def force(self) -> Array:
        """The low-pass r of the generalised contact force, shape (nv,) [N, N m]; zero before the first sample."""
        return self._r.copy()

    def reset(self) -> None:
        """Forget all samples."""
        self._t, self._r = -math.inf, np.zeros(self.robot.nv)
        self._momentum = self._drive = self._tau = np.zeros(0)
        self._J: dict[str, tuple[Array, Array]] = {}  # of each contact, its Jacobian at the last sample and its low-pass

    def update(
        self,
        t: float,
        state: State,
        tau: Array | None = None,
        *,
        contacts: Sequence[Constraint] | None = None,
        external: External = None,
    ) -> ForceEstimate:
        """Contact forces at a sample, delayed by the low-pass.

        Args:
            t: Its time [s], after that of the sample before.
            state: Measured configuration and velocity.
            tau: Measured torques, shape (nu,), where `torques` says so. With `held`, those from here to the next sample.
            contacts: What touches now, where it is not what the observer was made with.
            external: Other forces of the world that are known.

        Raises:
            InputError: a time that is not later, a state of another robot, torques that are missing or not expected; and as
                `estimate_forces`.
        """
        robot = self.robot
        if not robot.is_like(checked(state).robot):
            raise InputError(f"the observer is of {robot.name}, and got a state of {state.robot.name}.")
        if (tau is not None) != self.torques:
            raise InputError(f"tau is {tau!r:.80}, and the observer was made with torques={self.torques}.")
        now = as_float(t)
        if not (math.isfinite(now) and now > self._t):
            raise InputError(f"t is {t!r:.80}; expected a time after that of the sample before, {self._t:g} s.")
        given = None if tau is None else robot.check_tau(tau)
        rows = contact_rows(
            state, self.contacts if contacts is None else with_loops(robot, contacts, self._loops), stacklevel=3
        )
        self._advance(now, state, given, external)
        rows = self._delayed(now, rows)
        covariance = None if self.noise is None else self._covariance(state, self.noise, now)
        self._t = now
        return fitted(state, rows, self._r, given, covariance)

    def run(
        self,
        motion: SampledMotion,
        tau: Array | None = None,
        *,
        touches: Array | None = None,
    ) -> ForceHistory:
        """Contact forces at all samples of a motion, from a fresh start.

        Args:
            motion: A trajectory or a reference motion: its t, q and v are read.
            tau: Measured torques, shape (n, nu), where `torques` says so.
            touches: Which contacts touch when, shape (n, k), of truth values; all of them if not given.

        Raises:
            InputError: sizes that do not fit; and as `update`.
        """
        touching = checked_touches(touches, len(motion.t), self._given, self.contacts)
        self.reset()

        def estimate(i: int, state: State, acting: Sequence[Constraint], torque: Array | None) -> ForceEstimate:
            return self.update(motion.t[i], state, torque, contacts=WithLoops(acting))

        return history_of(motion, tau, touching, self.contacts, estimate)

    def _advance(self, t: float, state: State, tau: Array | None, external: External) -> None:
        """Put r forward to a sample."""
        robot = self.robot
        momentum = state.M @ state.v
        drive = coriolis_matrix(state).T @ state.v + gravity_torque(state)
        if external is not None:
            drive += generalised(state, external)[0]
        torque = np.zeros(robot.nv)
        if tau is not None:
            torque[robot.motors] = tau
        if not len(self._momentum):  # as if it did not accelerate
            self._r = state.h - torque
            if external is not None:
                self._r -= generalised(state, external)[0]
        else:
            h = t - self._t
            between = self._tau if self.held else 0.5 * (self._tau + torque)
            mean = (momentum - self._momentum) / h - 0.5 * (drive + self._drive) - between
            kept = math.exp(-self.gain * h)
            self._r = kept * self._r + (1.0 - kept) * mean
        self._momentum, self._drive, self._tau = momentum, drive, torque

    def _delayed(self, t: float, rows: Sequence[Rows]) -> tuple[Rows, ...]:
        """The same rows with their Jacobians through the low-pass; of a contact that is new, as they are."""
        kept, known, out = math.exp(-self.gain * (t - self._t)), self._J, list[Rows]()
        self._J = {}
        for r in rows:
            last, slow = known.get(r.name, (r.J, r.J))
            slow = kept * slow + (0.5 - 0.5 * kept) * (last + r.J) if slow.shape == r.J.shape else r.J
            self._J[r.name] = r.J, slow
            out.append(replace(r, J=slow))
        return tuple(out)

    def _covariance(self, state: State, noise: SensorNoise, t: float) -> Array:
        """Covariance of r in the steady state, for samples as far apart as the last two.

        With alpha = exp(-K h), white noise of variance s^2 a sample comes through the low-pass of differences over h as
        2 (1 - alpha)^2 / (h^2 (1 + alpha)) s^2, through that of means of two as (1 - alpha) / 2 s^2, and through that of held
        samples as (1 - alpha) / (1 + alpha) s^2.
        """
        robot = self.robot
        h = t - self._t if math.isfinite(self._t) else 1.0 / self.gain
        kept = math.exp(-self.gain * h)
        faster = 2.0 * (1.0 - kept) ** 2 / (h * h * (1.0 + kept))
        L = state.M * noise.of("v", robot.nv)
        out = faster * (L @ L.T)
        if self.torques:
            share = (1.0 - kept) / (1.0 + kept) if self.held else 0.5 * (1.0 - kept)
            out[robot.actuated, robot.actuated] += share * noise.of("tau", robot.nu) ** 2
        return np.asarray(out)
