"""Nonlinear least squares over configurations: to zero, or to a minimum with its certificate.

The distance is 1/2 |e(q)|^2. A step z is the minimiser of

    |J z + e|^2 + mu |e|^2 |z|^2        over        lower - q <= z <= upper - q,    |z_i| <= longest

Its damping is quadratic in the error: quadratic convergence where the errors grow with the distance, also with redundant rows
[YamashitaFukushima2001]; far away the path stays near steepest descent. Where the errors grow only with the square of the
distance (a singular pose) each step quarters them.

Where the errors cannot vanish, Newton's steps with the true Hessian (differences of J^T e) converge to a minimum. Its
certificate is of first order, a gradient J^T e that is zero for every free coordinate and points outwards at a limit, and of
second order, the least eigenvalue of the Hessian over the free coordinates.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, max_abs
from rbd.errors import InputError
from rbd.model.checked_model import CheckedModel
from rbd.model.joints import UNLIMITED
from rbd.model.state import State, with_values
from rbd.problem.programs import within

_START, _LEAST, _MOST = 0.5, 1e-6, 1e8
_PATIENCE = 10
"""Number of steps that must reduce |e|^2 by a tenth; else the descent ends at a minimum above zero."""
_DIFFERENCE = 1e-5
"""Step of the Hessian's central differences: their error is proportional to its square."""


@dataclass(frozen=True, eq=False)
class Residual:
    """Errors at one configuration.

    Attributes:
        state: The robot there, at rest.
        error: The errors, shape (m,).
        J: Their Jacobian over the coordinates of the space, shape (m, n); J^T error is the exact gradient.
    """

    state: State
    error: Array
    J: Array

    @property
    def q(self) -> Array:
        """The configuration, shape (nq,), read-only."""
        return self.state.q

    @property
    def residual(self) -> float:
        """Largest entry of the error."""
        return max_abs(self.error)

    @property
    def size2(self) -> float:
        """|error|^2."""
        return float(self.error @ self.error)

    @property
    def scale(self) -> float:
        """|J| |error|, the scale of gradients."""
        return float(np.linalg.norm(self.J)) * float(np.sqrt(self.size2))


R = TypeVar("R", bound=Residual)


class Space(Generic[R]):
    """Configurations of a robot with errors, in coordinates of unit size; some joints fixed, others within their limits.

    Args:
        robot: The robot.
        fixed: {joint: value}.
        limited: Whether joints stay within the limits of the robot's file.

    Attributes:
        robot: The robot.
        fixed: As given.
        free: Which velocities are free, indices, shape (n,).
        held: Which are not, shape (nv,), bool.
        scale: Unit of each free velocity, shape (n,): the robot's length for translations, else one.
        angular: Which of these are angles, shape (n,).
        unit_error: The error that a translation by one makes, in the errors' unit.
        longest: Largest entry of one step.
        cut: Singular values below this fraction of the largest do not count in a step.

    Raises:
        InputError: values of a wrong size.
        JointNotFound: an unknown fixed joint.
    """

    unit_error, longest, cut = 1.0, 1.0, 1e-13

    def __init__(self, robot: CheckedModel, fixed: Mapping[str, object] | None = None, *, limited: bool = False) -> None:
        self.robot, self.fixed, joints, model = robot, {} if fixed is None else fixed, robot.joints, robot.model
        self._target = with_values(robot, pin.neutral(model), self.fixed, argument="fixed")
        self.held, self._pinned = np.zeros(robot.nv, bool), np.zeros(robot.nq, bool)
        for joint in self.fixed:
            self.held[joints[joint].v] = True
            self._pinned[joints[joint].q] = True
        self.free = np.flatnonzero(~self.held)
        self.scale, self.angular = joints.scale[self.free], joints.angular[self.free]
        numbers = [p for p in joints.pieces if p.kind == "number" and limited]
        self._q, self._v = (np.array([getattr(p, name) for p in numbers], int) for name in ("q", "v"))
        low, high = model.lowerPositionLimit[self._q], model.upperPositionLimit[self._q]
        self._low, self._high = np.where(low < -UNLIMITED, -np.inf, low), np.where(high > UNLIMITED, np.inf, high)

    def at(self, q: Array) -> R:
        """The errors at a configuration; an InputError where they are not defined."""
        raise NotImplementedError

    def inside(self, q: Array) -> Array:
        """A copy of q with the fixed joints at their values, and joints beyond their limits moved onto them."""
        out = np.where(self._pinned, self._target, q)
        out[self._q] = np.minimum(np.maximum(out[self._q], self._low), self._high)
        return out

    def room(self, q: Array) -> tuple[Array, Array]:
        """Distance of each coordinate to its lower and upper limit, shapes (n,)."""
        lower, upper = np.full(self.robot.nv, -np.inf), np.full(self.robot.nv, np.inf)
        unit = self.robot.joints.scale[self._v]
        lower[self._v], upper[self._v] = (self._low - q[self._q]) / unit, (self._high - q[self._q]) / unit
        return lower[self.free], upper[self.free]

    def move(self, q: Array, z: Array) -> Array:
        """The configuration reached by the displacement z, shape (n,), exactly on the limits that it reaches."""
        return self.inside(np.asarray(pin.normalize(self.robot.model, self.displaced(q, z))))

    def displaced(self, q: Array, z: Array) -> Array:
        """The configuration reached by the displacement z, also beyond limits."""
        dq = np.zeros(self.robot.nv)
        dq[self.free] = self.scale * z
        return np.asarray(pin.integrate(self.robot.model, q, dq))

    def way(self, q: Array, to: Array) -> Array:
        """The displacement from one configuration to another, by the shorter way round, shape (n,)."""
        return displacement(self.robot, q, to)[self.free] / self.scale

    def coordinate_names(self, which: Array | list[int]) -> list[str]:
        """Names of some of the coordinates."""
        return [self.robot.joints.velocities[i].name for i in self.free[which]]


def displacement(robot: CheckedModel, q: Array, to: Array) -> Array:
    """The velocity that leads from one pose to another in unit time, by the shorter way round, shape (nv,)."""
    d = np.asarray(pin.difference(robot.model, q, to))
    periodic = robot.joints.periodic
    if periodic.any():
        d[periodic] = np.remainder(d[periodic] + math.pi, 2.0 * math.pi) - math.pi
    return d


@dataclass(frozen=True, eq=False)
class Descent(Generic[R]):
    """Result of a descent.

    Attributes:
        at: The errors at the end.
        steps: Number of steps taken.
        closed: Whether the errors are within the tolerance.
    """

    at: R
    steps: int
    closed: bool


def descend(space: Space[R], start: R, *, tolerance: float, most: int) -> Descent[R]:
    """Levenberg-Marquardt steps, until the largest error is within the tolerance or no step reduces it.

    Args:
        space: The errors.
        start: The first configuration.
        tolerance: Largest entry of the final error.
        most: Largest number of evaluations.
    """
    at, mu, before, steps = start, _START, start.size2, 0
    for i in range(most):
        if at.residual <= tolerance:
            break
        size2 = at.size2
        if i % _PATIENCE == _PATIENCE - 1:
            if size2 > 0.9 * before:
                break
            before = size2
        z = _step(space, at, mu)
        expected = size2 - float(np.square(at.J @ z + at.error).sum())
        if not expected > 1e-14 * size2:
            break
        there = _there(space, at, z)
        gain = -1.0 if there is None else (size2 - there.size2) / expected
        if there is not None and gain > 1e-3:
            at, steps = there, steps + 1
            mu = min(_MOST, 4.0 * mu) if gain < 0.25 else max(_LEAST, 0.25 * mu) if gain > 0.75 else mu
        elif mu > _MOST:
            break
        else:
            mu = max(4.0 * mu, _START)
    return Descent(at, steps, at.residual <= tolerance)


def _there(space: Space[R], at: R, z: Array) -> R | None:
    """The errors after a step; None where they are not defined, or too far from the origin for a state."""
    try:
        return space.at(space.move(at.q, z))
    except InputError:
        return None


def _step(space: Space[R], at: R, mu: float) -> Array:
    size = float(np.sqrt(at.size2))
    lower, upper = space.room(at.q)
    # Far away, translations may be as long as the error; angles may not.
    far = np.where(space.angular, 1.0, max(1.0, size / space.unit_error))
    U, s, Vt = np.linalg.svd(at.J * far, full_matrices=False)
    kept = s > space.cut * max(1e-300, float(s.max(initial=0.0)))
    U, s, Vt = U[:, kept], s[kept], Vt[kept]
    z = -far * ((s / (s * s + mu * at.size2) * (at.error @ U)) @ Vt)
    if ((z >= lower) & (z <= upper) & (np.abs(z) <= space.longest * far)).all():
        return z
    # Divided by the error, so that the solver's tolerance is relative to it.
    A = np.vstack([at.J * far, np.sqrt(mu) * size * np.eye(len(z))])
    b = np.append(-at.error / size, np.zeros(len(z)))
    longest = np.full(len(z), space.longest)
    found = within(A, b, np.maximum(lower / far, -longest) / size, np.minimum(upper / far, longest) / size)
    return far * size * found


@dataclass(frozen=True, eq=False)
class StationaryPoint(Generic[R]):
    """A stationary point of 1/2 |e|^2 within the limits, with its certificate.

    Attributes:
        at: The errors there.
        slope: Largest entry of the gradient J^T e over the free coordinates, over |J| |e|: zero at a minimum.
        curvature: Least eigenvalue of the Hessian over the free coordinates, over its largest.
        held: Multipliers of the limits, shape (n,): positive at upper limits, negative at lower ones.
    """

    at: R
    slope: float
    curvature: float
    held: Array

    @property
    def minimum(self) -> bool:
        """Whether no small motion reduces the distance, to second order: slope below 1e-7, curvature above -1e-6."""
        return self.slope < 1e-7 and self.curvature > -1e-6


def minimise(space: Space[R], start: R, *, most: int = 60) -> StationaryPoint[R]:
    """Newton's steps to a minimum of 1/2 |e|^2 within the limits; saddles are left along the steepest descent."""
    at = start
    for _ in range(most):
        H = _hessian(space, at)
        found, free = _certificate(space, at, H)
        if not len(free) or found.slope < 1e-13 and found.curvature > -1e-6:
            return found
        if found.slope < 1e-9 and found.curvature <= -1e-6:  # a saddle: leave it along the steepest descent
            down, z = np.linalg.eigh(H[np.ix_(free, free)])[1][:, 0], np.zeros(len(H))
            z[free] = 0.1 * down * (1.0 if down @ (at.J.T @ at.error)[free] <= 0.0 else -1.0)
        else:
            z = _newton(space, at, H)
        z *= min(1.0, 0.5 / max(1e-300, float(np.linalg.norm(z))))
        there = _lower(space, at, z, found.slope)
        if there is None:
            return found
        at = there
    return _certificate(space, at, _hessian(space, at))[0]


def _certificate(space: Space[R], at: R, H: Array) -> tuple[StationaryPoint[R], Array]:
    """(what slope and Hessian say of a point, free coordinates)."""
    free, slope, held = _slope(space, at)
    values = np.linalg.eigvalsh(H[np.ix_(free, free)])
    curvature = float(values.min(initial=0.0)) / (float(np.abs(values).max(initial=0.0)) or 1.0)
    return StationaryPoint(at, slope, curvature, held), free


def _newton(space: Space[R], at: R, H: Array) -> Array:
    """The minimiser of the quadratic model within the limits, with the absolute values of its curvatures."""
    values, V = np.linalg.eigh(H)
    root = np.sqrt(np.maximum(np.abs(values), 1e-7 * (float(np.abs(values).max()) or 1.0)))
    b = -(V.T @ (at.J.T @ at.error)) / root
    size = max(1e-300, float(np.linalg.norm(b)))
    lower, upper = space.room(at.q)
    return size * within(root[:, None] * V.T, b / size, lower / size, upper / size)


def _slope(space: Space[R], at: R) -> tuple[Array, float, Array]:
    """(free coordinates, their gradient over |J| |e|, multipliers of the limits)."""
    g = at.J.T @ at.error
    lower, upper = space.room(at.q)
    stopped = (lower > -1e-12) & (g > 0.0) | (upper < 1e-12) & (g < 0.0)
    free = np.flatnonzero(~stopped)
    return free, max_abs(g[free]) / max(1e-300, at.scale), np.where(stopped, -g, 0.0)


def _hessian(space: Space[R], at: R) -> Array:
    n = at.J.shape[1]
    H = np.empty((n, n))
    for i, unit in enumerate(np.eye(n) * _DIFFERENCE):
        # Also beyond limits, which are handled separately.
        ahead, back = (space.at(space.displaced(at.q, z)) for z in (unit, -unit))
        H[i] = (ahead.J.T @ ahead.error - back.J.T @ back.error) / (2.0 * _DIFFERENCE)
    return 0.5 * (H + H.T)


def _lower(space: Space[R], at: R, z: Array, slope: float) -> R | None:
    """The first of successively halved steps that reduces |e|^2; at rounding, the gradient. None if there is none."""
    rounding = 1e-14 * float(np.sqrt(at.size2))  # of errors that are differences of positions
    for _ in range(30):
        there = _there(space, at, z)
        if there is not None:
            less = at.size2 - there.size2
            if less > rounding or less > -rounding and _slope(space, there)[1] < 0.5 * slope:
                return there
        z = 0.5 * z
    return None
