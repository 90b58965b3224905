"""Newton's method for equilibria and steady motions.

A motion with constant v, q(t) = q (+) v t, is steady if the constraints and v' = 0 hold at all times. They are
imposed at three,

    c(q_k) = 0        J(q_k) v = 0        a(q_k, v, tau) = 0        q_k = q (+) t_k v

which singles out the motions along which nothing changes: a body that merely does not accelerate at one instant violates them
at the next. Unknown are the changes of q on the tangent space, of v and, if asked for, of tau; each step is the least of those
that solve the linearised equations (least squares), so directions on which nothing depends stay as they are.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin

from rbd.answers.least_constraint import solve
from rbd.arrays import Array, as_finite, max_abs, range_of
from rbd.constraints.constraint import Constraint, has_friction, member
from rbd.constraints.manifold import ConstraintManifold, null_space
from rbd.errors import InputError, NoSolution, RbdWarning
from rbd.mechanism.small_motion.tangent_space import ad_matrix, fitted_spin, slopes_along, spin_axes, velocity_slopes
from rbd.model.external import External
from rbd.model.state import State

MET = 1e-10
"""Residuals up to this are met [m, rad; m/s; m/s2]."""
STEPS = 60
ROUGH = 1e-8
STRIDE, STRIDES = 0.2, 150
"""Length of a step downhill [rad, robot's lengths], and how many there are at most."""
SLOW = 6
"""So many steps in a row that each reduce the residual by less than a tenth end the search."""
FARTHEST = 0.3
"""Longest step [rad, robot's lengths], over one for velocities."""
AT = (0.0, 0.35, 0.8)
"""Times at which a motion must be steady, over the time in which its fastest coordinate moves by a radian."""
SINGULAR = 1e-9
"""Singular values below this fraction of the largest count as zero."""

Condition = Callable[[State], Any]


@dataclass(frozen=True, eq=False)
class FoundState:
    """Where the search ended.

    Attributes:
        state: The state.
        tau: Its torques, shape (nu,).
        spin: eta of bodies of revolution, shape (nv,).
        residual: Largest residual of the equations.
        acceleration: a + ad(eta) v there, shape (nv,).
        iterations: Newton steps.
        freedoms: Dimension of the steady states around it: directions in which the equations stay satisfied.
    """

    state: State
    tau: Array
    spin: Array
    residual: float
    acceleration: Array
    iterations: int
    freedoms: int


@dataclass(frozen=True, eq=False)
class Search:
    """The equations and what is unknown.

    Attributes:
        constraints: As given, those with friction in their bilateral form.
        manifold: Theirs.
        external: Other forces.
        positions: Entries of dq that may change, shape (k,).
        velocities: Entries of v that may change, shape (l,); empty for an equilibrium.
        free_torques: Whether tau may change.
        conditions: Functions of the state that are to vanish.
    """

    constraints: tuple[Constraint, ...]
    manifold: ConstraintManifold
    external: External
    positions: Array
    velocities: Array
    free_torques: bool
    conditions: tuple[Condition, ...] = ()

    def run(self, state: State, tau: Array) -> FoundState:
        """The nearest steady state that Newton's steps reach; check its residual.

        Raises:
            NoSolution: the equations of motion have no answer at the start.
        """
        with warnings.catch_warnings(action="ignore", category=RbdWarning):
            return self._run(state, tau)

    def _run(self, state: State, tau: Array) -> FoundState:
        robot, axes = state.robot, self._axes(state)
        here = _Point(state, tau, axes, np.zeros(axes.shape[1]))
        here = self._onto(here)
        if axes.shape[1]:
            a = self._residuals(here, AT[:1])[1]
            here = replace(here, s=np.linalg.lstsq(axes, fitted_spin(robot, here.state.v, a), rcond=None)[0])
        times = self._times(here)
        here, F, steps = self._newton(start := here, times)
        if max_abs(F) > ROUGH and not len(self.velocities) and not self.free_torques:
            again, F_again, more = self._newton(self._settled(start), times)
            if max_abs(F_again) < max_abs(F):
                here, F, steps = again, F_again, steps + more
        freedoms = self._freedoms(self._slopes(here, times) * self._units(here))
        return FoundState(here.state, here.tau, here.spin, max_abs(F), self._residuals(here, AT[:1])[1], steps, freedoms)

    def _units(self, here: _Point) -> Array:
        scale = here.state.robot.joints.scale
        ones = np.ones(len(here.s) + len(here.tau) * self.free_torques)
        return np.concatenate([scale[self.positions], scale[self.velocities], ones])

    def _newton(self, here: _Point, times: Sequence[float], moving: bool = True) -> tuple[_Point, Array, int]:
        """(where the steps end, residuals there, number of steps).

        Args:
            here: Where they start.
            times: When the equations are to hold.
            moving: With a = 0; else the constraints alone.
        """
        moves, units = len(self.positions) + len(self.velocities), self._units(here)
        scale = here.state.robot.joints.scale
        F, slow = self._residuals(here, times, moving)[0], 0
        for step in range(STEPS):
            if max_abs(F) <= MET or slow == SLOW or not len(units):
                return here, F, step
            z = self._step(self._slopes(here, times, moving) * units, F, len(here.tau))
            length = max_abs(z[:moves])
            z *= min(1.0, FARTHEST * max(1.0, max_abs(here.state.v / scale)) / length) if length else 1.0
            for _ in range(12):
                try:
                    nearer = self._moved(here, units * z)
                    if moving and not len(self.velocities):
                        nearer = self._onto(nearer)
                    F_there = self._residuals(nearer, times, moving)[0]
                except (NoSolution, InputError):
                    z *= 0.5
                    continue
                before, after = float(np.linalg.norm(F)), float(np.linalg.norm(F_there))
                if after < before:
                    slow = slow + 1 if after > 0.9 * before else 0
                    here, F = nearer, F_there
                    break
                z *= 0.5
            else:
                return here, F, step  # rounding, or a least residual that is not zero
        return here, F, STEPS

    def _onto(self, here: _Point) -> _Point:
        """The nearest point that satisfies the constraints."""
        return self._newton(here, AT[:1], moving=False)[0]

    def _settled(self, here: _Point) -> _Point:
        """Where it comes near to rest when it follows its acceleration without inertia: downhill in the energy, in M's metric.

        Newton's steps from there find the stable equilibrium below, where those from the start found none.
        """
        robot, size, before = here.state.robot, STRIDE, np.zeros(here.state.robot.nv)
        for _ in range(STRIDES):
            a = self._residuals(here, AT[:1])[1]
            if float(a @ here.state.M @ before) < 0.0:
                size *= 0.5
            top = max_abs(a / robot.joints.scale)
            if not top or size < 1e-3 * STRIDE:
                break
            y = np.zeros(len(self._units(here)))
            y[: len(self.positions)] = (size / top * a)[self.positions]
            here, before = self._onto(self._moved(here, y)), a
        return here

    def _step(self, slopes: Array, F: Array, nu: int) -> Array:
        """The least step that solves the linearised equations; the torques do what they can before anything moves."""
        if not self.free_torques or not nu:
            return -np.linalg.lstsq(slopes, F, rcond=SINGULAR)[0]
        moves, torques = slopes[:, :-nu], slopes[:, -nu:]
        U = range_of(torques, SINGULAR)
        first = np.linalg.lstsq(moves - U @ (U.T @ moves), -(F - U @ (U.T @ F)), rcond=SINGULAR)[0]
        rest = np.linalg.lstsq(torques, -(F + moves @ first), rcond=SINGULAR)[0]
        return np.concatenate([first, rest])

    def _axes(self, state: State) -> Array:
        """Axes about which bodies of revolution may spin, shape (nv, j); none of an equilibrium."""
        return spin_axes(state.robot) if len(self.velocities) else np.zeros((state.robot.nv, 0))

    def _freedoms(self, slopes: Array) -> int:
        """Dimension of the changes of q and v, with those of tau that keep them steady, that satisfy the equations."""
        free = null_space(slopes, SINGULAR)[0][: len(self.positions) + len(self.velocities)]
        return int((np.linalg.svd(free, compute_uv=False) > 1e-6).sum()) if free.size else 0

    def _times(self, here: _Point) -> tuple[float, ...]:
        speed = max_abs((here.state.v - here.spin) / here.state.robot.joints.scale)
        return tuple(t / max(speed, 1e-3) for t in AT) if len(self.velocities) else AT[:1]

    def _moved(self, here: _Point, y: Array) -> _Point:
        robot, state = here.state.robot, here.state
        to_q, to_v, s, tau = np.split(y, np.cumsum([len(self.positions), len(self.velocities), len(here.s)]))
        dq, dv = np.zeros(robot.nv), np.zeros(robot.nv)
        dq[self.positions], dv[self.velocities] = to_q, to_v
        q = pin.normalize(robot.model, pin.integrate(robot.model, state.q, dq))
        moved = State(robot, q, state.v + dv, t=state.t)
        return _Point(moved, here.tau + tau if self.free_torques else here.tau, here.axes, here.s + s)

    def _residuals(self, here: _Point, times: Sequence[float], moving: bool = True) -> tuple[Array, Array]:
        """(the residuals, a + ad(eta) v at the first time); without `moving` those of the constraints alone."""
        parts = []
        for t in times:
            there = here.at(t)
            rows = self.manifold.rows(there)
            if not moving:
                return np.concatenate([rows.error, rows.velocity]), np.zeros(0)
            a = solve(there, here.tau, self.constraints, external=self.external, rest_speed=1e3).a
            parts += [rows.error, rows.velocity, a + ad_matrix(there.robot, here.spin) @ there.v]
        first = parts[2]
        parts += [_value(condition, here.state) for condition in self.conditions]
        return np.concatenate(parts), first

    def _slopes(self, here: _Point, times: Sequence[float], moving: bool = True) -> Array:
        state, robot = here.state, here.state.robot
        model, blocks = robot.model, []
        carried = state.v - here.spin
        turning, by_spin = ad_matrix(robot, here.spin), -ad_matrix(robot, state.v) @ here.axes
        for t in times:
            there = here.at(t)
            rows = self.manifold.rows(there)
            placed = np.ones(len(rows.J), bool) if rows.placed is None else rows.placed
            by_q = pin.dIntegrate(model, state.q, t * carried, pin.ARG0)
            by_v = t * pin.dIntegrate(model, state.q, t * carried, pin.ARG1)
            H, D = np.where(placed[:, None], rows.J, 0.0), velocity_slopes(there, self.manifold, rows)
            none, no_torque = np.zeros((len(H), len(here.s))), np.zeros((len(H), robot.nu))
            equations = [(H, np.zeros_like(H), none, no_torque), (D, rows.J, none, no_torque)]
            if moving:
                d = solve(there, here.tau, self.constraints, external=self.external, rest_speed=1e3).derivatives()
                equations.append((d.da_dq, d.da_dv + turning, by_spin, d.da_dtau))
            for q_part, v_part, s_part, tau_part in equations:
                of_q, moved = q_part @ by_q, q_part @ by_v
                parts = [of_q[:, self.positions], (moved + v_part)[:, self.velocities], s_part - moved @ here.axes]
                blocks.append(np.hstack([*parts, tau_part] if self.free_torques else parts))
        blocks += [self._condition_slopes(condition, here) for condition in self.conditions if moving]
        return np.vstack(blocks)

    def _condition_slopes(self, condition: Condition, here: _Point) -> Array:
        moves, value = len(self.positions) + len(self.velocities), _value(condition, here.state)
        directions = np.eye(moves, moves + len(here.s) + len(here.tau) * self.free_torques)
        found = slopes_along(lambda step: _value(condition, self._moved(here, step).state), directions, value, "the state")
        return found @ directions


@dataclass(frozen=True, eq=False)
class _Point:
    """Values of the unknowns.

    Attributes:
        state: q and v.
        tau: Shape (nu,).
        axes: Unit twists of spin, shape (nv, j).
        s: Rates of spin about them, shape (j,) [rad/s].
    """

    state: State
    tau: Array
    axes: Array
    s: Array

    @property
    def spin(self) -> Array:
        """eta, shape (nv,)."""
        return self.axes @ self.s

    def at(self, t: float) -> State:
        """The state after a time of the motion with constant v, in axes that do not spin."""
        if not t:
            return self.state
        robot = self.state.robot
        q = pin.integrate(robot.model, self.state.q, t * (self.state.v - self.spin))
        return State(robot, pin.normalize(robot.model, q), self.state.v, t=self.state.t + t)


def _value(condition: Condition, state: State) -> Array:
    meaning = ": a number, or some, that are to be zero"
    return np.atleast_1d(as_finite("a condition's value", condition(state), (), ("n",), meaning=meaning))


def held_together(constraint: Constraint) -> Constraint:
    """The constraint without its limits of friction, which are checked at the end: it holds, and neither slips nor opens."""
    given = getattr(constraint, "__dataclass_fields__", {}).get("friction")
    if has_friction(constraint) and float(member(constraint, "friction")) > 0.0 and given is not None and given.init:
        return replace(constraint, friction=None)  # type: ignore[type-var]
    return constraint
