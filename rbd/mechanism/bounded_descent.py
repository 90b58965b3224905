"""Nonlinear least squares over configurations within joint limits: to zero, or to a minimum with its certificate.

The distance is 1/2 |e(q)|^2, e without units. A step z is the minimiser of

    |J z + e|^2 + mu |e|^2 |z|^2        over        lower - q <= z <= upper - q

Its damping is quadratic in the error: quadratic convergence to zero, also with redundant rows [YamashitaFukushima2001]. Where
the errors cannot vanish, Newton's steps with the true Hessian (differences of J^T e) converge to a minimum. Its certificate is
of first order, a gradient J^T e that is zero for every free joint and points outwards at a limit, and of second order, the
least eigenvalue of the Hessian over the free joints.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, max_abs
from rbd.mechanism.poses import displacement
from rbd.model.checked_model import FARTHEST, CheckedModel
from rbd.model.joints import UNLIMITED
from rbd.model.state import State
from rbd.problem.programs import within

_START, _LEAST, _MOST = 0.5, 1e-6, 1e8
_LONGEST = 1.0
"""Largest entry of one step [rad, or the robot's length]."""
_PATIENCE = 10
"""Number of steps that must reduce |e|^2 by a tenth; else the descent ends at a minimum above zero."""
_DIFFERENCE = 1e-5
"""Step of the Hessian's central differences: their error is proportional to its square."""

Errors = Callable[[State], tuple[Array, Array]]
"""(e (m,), J (m, nv)) at a state, without units; J^T e is the exact gradient of 1/2 |e|^2."""


@dataclass(frozen=True, eq=False)
class Reached:
    """Errors at one configuration.

    Attributes:
        state: The robot there, at rest.
        e: The errors, shape (m,).
        J: Its Jacobian, in units of `Bounded.scale`, shape (m, nv).
        steps: Number of steps taken.
    """

    state: State
    e: Array
    J: Array
    steps: int = 0

    @property
    def residual(self) -> float:
        """Largest entry of e."""
        return max_abs(self.e)

    @property
    def size2(self) -> float:
        """|e|^2."""
        return float(self.e @ self.e)

    @property
    def scale(self) -> float:
        """|J| |e|, the scale of gradients."""
        return float(np.linalg.norm(self.J)) * float(np.sqrt(self.size2))


@dataclass(frozen=True, eq=False)
class BoundedMinimum:
    """A minimum of 1/2 |e|^2 within the limits, with its certificate.

    Attributes:
        at: The errors there.
        slope: Largest entry of the gradient J^T e over the free coordinates, over |J| |e|: zero at a minimum.
        curvature: Least eigenvalue of the Hessian over the free coordinates, over its largest.
        held: Multipliers of the limits, shape (nv,): positive at upper limits, negative at lower ones.
    """

    at: Reached
    slope: float
    curvature: float
    held: Array

    @property
    def proved(self) -> bool:
        """Whether it is a minimum: slope below 1e-7, curvature above -1e-6."""
        return self.slope < 1e-7 and self.curvature > -1e-6


class Bounded:
    """Errors of a robot's configurations, within the limits of its joints.

    Args:
        robot: The robot.
        errors: See `Errors`.

    Attributes:
        scale: Unit of each velocity, shape (nv,): the robot's length for translations, else one.
    """

    def __init__(self, robot: CheckedModel, errors: Errors) -> None:
        self.robot, self.errors, self.scale = robot, errors, robot.joints.scale
        model, numbers = robot.model, [p for p in robot.joints.pieces if p.kind == "number"]
        self._q, self._v = (np.array([getattr(p, name) for p in numbers], int) for name in ("q", "v"))
        low, high = model.lowerPositionLimit[self._q], model.upperPositionLimit[self._q]
        self._low, self._high = np.where(low < -UNLIMITED, -np.inf, low), np.where(high > UNLIMITED, np.inf, high)

    def at(self, q: Array, steps: int = 0) -> Reached:
        """The errors at a configuration."""
        state = State(self.robot, q)
        e, J = self.errors(state)
        return Reached(state, e, J * self.scale, steps)

    def inside(self, q: Array) -> Array:
        """The configuration with joints beyond their limits moved onto them."""
        out = q.copy()
        out[self._q] = np.minimum(np.maximum(out[self._q], self._low), self._high)
        return out

    def room(self, q: Array) -> tuple[Array, Array]:
        """Distance of each coordinate to its lower and upper limit, shapes (nv,), in units of `scale`."""
        lower, upper = np.full(self.robot.nv, -np.inf), np.full(self.robot.nv, np.inf)
        unit = self.scale[self._v]
        lower[self._v], upper[self._v] = (self._low - q[self._q]) / unit, (self._high - q[self._q]) / unit
        return lower, upper

    def move(self, q: Array, z: Array) -> Array:
        """The configuration reached by the displacement z, exactly on the limits that it reaches."""
        model = self.robot.model
        return self.inside(np.asarray(pin.normalize(model, pin.integrate(model, q, self.scale * z))))

    def way(self, q: Array, to: Array) -> Array:
        """The displacement from one configuration to another, by the shorter way round."""
        return displacement(self.robot, q, to) / self.scale

    def step_to(self, q: Array, z: Array, steps: int) -> Reached | None:
        """The errors after a step; None if it leads too far from the origin for a state."""
        there = self.move(q, z)
        return self.at(there, steps) if max_abs(there) <= FARTHEST else None

    def descend(self, start: Reached, *, tolerance: float, most: int) -> Reached:
        """Levenberg-Marquardt steps, until the largest error is within the tolerance or no step reduces it."""
        at, mu, before = start, _START, start.size2
        for i in range(most):
            if at.residual <= tolerance:
                break
            size2 = at.size2
            if i % _PATIENCE == _PATIENCE - 1:
                if size2 > 0.9 * before:
                    break
                before = size2
            z = self._step(at, mu)
            expected = size2 - float(np.square(at.J @ z + at.e).sum())
            if not expected > 1e-14 * size2:
                break
            there = self.step_to(at.state.q, z, at.steps + 1)
            gain = -1.0 if there is None else (size2 - there.size2) / expected
            if there is not None and gain > 1e-3:
                at = there
                mu = min(_MOST, 4.0 * mu) if gain < 0.25 else max(_LEAST, 0.25 * mu) if gain > 0.75 else mu
            elif mu > _MOST:
                break
            else:
                mu = max(4.0 * mu, _START)
        return at

    def _step(self, at: Reached, mu: float) -> Array:
        size = float(np.sqrt(at.size2))
        lower, upper = self.room(at.state.q)
        # Far away, translations may be as long as the error; angles may not.
        far = np.where(self.robot.joints.angular, 1.0, max(1.0, size))
        U, s, Vt = np.linalg.svd(at.J * far, full_matrices=False)
        kept = s > 1e-13 * max(1e-300, float(s.max(initial=0.0)))
        U, s, Vt = U[:, kept], s[kept], Vt[kept]
        z = -far * ((s / (s * s + mu * at.size2) * (at.e @ U)) @ Vt)
        if ((z >= lower) & (z <= upper) & (np.abs(z) <= _LONGEST * far)).all():
            return z
        # Divided by the error, so that the solver's tolerance is relative to it.
        A = np.vstack([at.J * far, np.sqrt(mu) * size * np.eye(len(z))])
        b = np.append(-at.e / size, np.zeros(len(z)))
        longest = np.full(len(z), _LONGEST)
        found = within(A, b, np.maximum(lower / far, -longest) / size, np.minimum(upper / far, longest) / size)
        return far * size * found

    def minimise(self, start: Reached, *, most: int = 60) -> BoundedMinimum:
        """Newton's steps to a minimum of 1/2 |e|^2 within the limits; saddles are left along the steepest descent."""
        at = start
        for _ in range(most):
            H = self._hessian(at)
            found, free = self._certificate(at, H)
            if not len(free) or found.slope < 1e-13 and found.curvature > -1e-6:
                return found
            if found.slope < 1e-9 and found.curvature <= -1e-6:  # a saddle: leave it along the steepest descent
                down, z = np.linalg.eigh(H[np.ix_(free, free)])[1][:, 0], np.zeros(self.robot.nv)
                z[free] = 0.1 * down * (1.0 if down @ (at.J.T @ at.e)[free] <= 0.0 else -1.0)
            else:
                z = self._newton(at, H)
            z *= min(1.0, 0.5 / max(1e-300, float(np.linalg.norm(z))))
            there = self._lower(at, z, found.slope)
            if there is None:
                return found
            at = there
        return self._certificate(at, self._hessian(at))[0]

    def _certificate(self, at: Reached, H: Array) -> tuple[BoundedMinimum, Array]:
        """(what slope and Hessian say of a point, free coordinates)."""
        free, slope, held = self._slope(at)
        values = np.linalg.eigvalsh(H[np.ix_(free, free)])
        curvature = float(values.min(initial=0.0)) / (float(np.abs(values).max(initial=0.0)) or 1.0)
        return BoundedMinimum(at, slope, curvature, held), free

    def _newton(self, at: Reached, H: Array) -> Array:
        """The minimiser of the quadratic model within the limits, with the absolute values of its curvatures."""
        values, V = np.linalg.eigh(H)
        root = np.sqrt(np.maximum(np.abs(values), 1e-7 * max(1e-300, float(np.abs(values).max()))))
        b = -(V.T @ (at.J.T @ at.e)) / root
        size = max(1e-300, float(np.linalg.norm(b)))
        lower, upper = self.room(at.state.q)
        return size * within(root[:, None] * V.T, b / size, lower / size, upper / size)

    def _slope(self, at: Reached) -> tuple[Array, float, Array]:
        """(free coordinates, their gradient over |J| |e|, multipliers of the limits)."""
        g = at.J.T @ at.e
        lower, upper = self.room(at.state.q)
        stopped = (lower > -1e-12) & (g > 0.0) | (upper < 1e-12) & (g < 0.0)
        free = np.flatnonzero(~stopped)
        return free, max_abs(g[free]) / max(1e-300, at.scale), np.where(stopped, -g, 0.0)

    def _hessian(self, at: Reached) -> Array:
        n = self.robot.nv
        H = np.empty((n, n))
        model, q = self.robot.model, at.state.q
        for i, unit in enumerate(np.eye(n) * _DIFFERENCE):
            # Also beyond limits, which are handled separately.
            g = [there.J.T @ there.e for there in (self.at(pin.integrate(model, q, self.scale * z)) for z in (unit, -unit))]
            H[i] = (g[0] - g[1]) / (2.0 * _DIFFERENCE)
        return 0.5 * (H + H.T)

    def _lower(self, at: Reached, z: Array, slope: float) -> Reached | None:
        """The first of successively halved steps that reduces |e|^2; at rounding, the gradient. None if there is none."""
        rounding = 1e-14 * float(np.sqrt(at.size2))  # of errors that are differences of positions
        for _ in range(30):
            there = self.step_to(at.state.q, z, at.steps + 1)
            if there is not None:
                less = at.size2 - there.size2
                if less > rounding or less > -rounding and self._slope(there)[1] < 0.5 * slope:
                    return there
            z = 0.5 * z
        return None
