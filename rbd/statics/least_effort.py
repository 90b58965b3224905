"""Torques and forces of least effort for a wanted motion on prepared constraints, all of whose points keep still.

`pin.rnea` gives M a + h and the bodies' accelerations; the columns of a plan (`rbd.answers.prepared.constraint_dynamics`) act
through the joints' Jacobians, and Newton's method finds the least effort, compiled (`rbd.statics.effort_kernel`). The
certificate of torques and weights is that of every prepared answer. That their effort is the least is judged by a motion, too:
what weights answer to is twice their own part less the velocities of the columns, if the robot moves at the rates that torques
and multipliers are. One call of `pin.forwardKinematics` judges it; no matrix of the program takes part.
"""

from __future__ import annotations

from functools import cache
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from rbd.answers.prepared.constraint_dynamics import _UNLOADED, Found, Loads, Plan, certificate_kernel
from rbd.answers.prepared.contact_bodies import MOST, Workspace, keep
from rbd.arrays import Array
from rbd.model.external import External, acting, generalised
from rbd.model.state import State
from rbd.problem.ground import TOUCHES
from rbd.problem.motion_forces import narrowed
from rbd.problem.residuals import SOLVED
from rbd.statics.effort import Effort


@cache
def effort_kernel() -> ModuleType:
    """`rbd.statics.effort_kernel`, imported when it is first needed: it imports Numba."""
    from rbd.statics import effort_kernel

    return effort_kernel


class Least(NamedTuple):
    """Torques and weights of least effort at one state.

    Attributes:
        tau: Torques, shape (nu,).
        w: Weights, shape (p,).
        rate: Multipliers of the equations without motors, where these are, as velocities, shape (nv,).
        z: Multipliers of the torques' bounds, shape (nu,).
        need: M a + h - tau_ext, shape (nv,).
        steps: Newton's steps.
    """

    tau: Array
    w: Array
    rate: Array
    z: Array
    need: Array
    steps: int


class LeastEffort:
    """What is constant for a plan, an effort and a margin.

    Args:
        plan: The plan.
        effort: What is made least, without bounds on forces.
        margin: Of friction.

    Attributes:
        sets: The sets of forces, friction within the margin.
    """

    def __init__(self, plan: Plan, effort: Effort, margin: float) -> None:
        self._plan, self.sets, self._robot = plan, narrowed(plan.force_set, margin), plan._robot
        robot, T = self._robot, self.sets
        names = [source.name for source in plan.sources]
        self._shares = effort.torque_weights(robot.actuated_names), effort.force_weights(T, names)
        self._bounds = T.lower, T.upper, T.cone_columns
        self._last = np.array(robot.model.idx_vs) + np.array(robot.model.nvs) - 1
        self._of_motors = robot.actuated, robot.unactuated
        self._stated, self._all = np.isfinite(robot.effort_limit), bool(np.isfinite(robot.effort_limit).all())
        self._inertia, self._rest = robot.least_inertia[robot.unactuated], np.zeros(len(T.elements), np.int64)

    @classmethod
    def of(cls, plan: Plan, effort: Effort, margin: float) -> LeastEffort:
        """Kept with the robot."""
        known, key = plan._robot.kept, (cls, plan, effort, margin)
        found = known.get(key)
        if found is None:
            found = cls(plan, effort, margin)
            keep(known, key, found, MOST)
        return found

    def at(
        self, space: Workspace, q: Array, v: Array, a: Array, tau_ext: Array, limits: tuple[Array, Array, Array], unit: float,
        rest_speed: float, mu: Array | None = None, loads: Loads = _UNLOADED,
    ) -> Least | None:  # fmt: skip
        """At one state, not yet certified; None where it was not found, or not all points keep still.

        Args:
            space: Used.
            q: Configuration, shape (nq,).
            v: Velocity, shape (nv,).
            a: Wanted acceleration, shape (nv,).
            tau_ext: Generalised force of the world less that of the loads, shape (nv,).
            limits: Of `limits`.
            unit: `robot.force_unit`.
            rest_speed: Up to this speed a contact is at rest [m/s, rad/s].
            mu: Friction within the margin, shape (k,); None: that of the sets.
            loads: Other forces of the world.
        """
        plan, robot, data, (_, J, _, X, *_) = self._plan, self._robot, space.data, space.read
        w, tau, rate, z = np.zeros(self.sets.size), np.empty(robot.nu), np.empty(robot.nv), np.empty(robot.nu)
        pin.computeJointJacobians(robot.model, data, q)
        pushed = () if loads is _UNLOADED else (space.forces,)
        if pushed:
            certificate_kernel().act(*loads, *plan.own, X, w, space.pushes.reshape(-1, 6), rate)
        need = pin.rnea(robot.model, data, q, v, a, *pushed) - tau_ext
        steps = effort_kernel().least_effort(
            *plan.own, X, J, self._last, space.fixed[0], v, rest_speed, need, *self._of_motors, *limits,
            self._inertia, *self._shares, unit, *self._bounds, self.sets.mu if mu is None else mu, w, tau, rate, z,
        )  # fmt: skip
        return Least(tau, w, rate, z, need, steps) if steps >= 0 else None

    def limits(self, v: Array, unit: float) -> tuple[Array, Array, Array]:
        """What torques are divided by, and their bounds at a velocity."""
        given = self._robot.effort_limit
        return given if self._all else np.where(self._stated, given, unit), *self._robot.limits_at(v)

    def certified(
        self, space: Workspace, q: Array, v: Array, a: Array, tau_ext: Array, rest_speed: float, loads: Loads, elements: Any,
        mu: Array | None, misses: Array,
    ) -> tuple[Least, float] | None:  # fmt: skip
        """At one state, and an upper bound of its largest scaled residual; None where it is not found, or not certified.

        Args:
            space: As of `at`, as are the next six.
            q: As there.
            v: As there.
            a: As there.
            tau_ext: As there.
            rest_speed: As there.
            loads: As there.
            elements: The plan's, with the friction at this state.
            mu: As of `at`.
            misses: Written, as of `Plan.judged`.
        """
        plan, robot, unit, given = self._plan, self._robot, self._robot.force_unit, tau_ext.copy()
        limits = self.limits(v, unit)
        found = self.at(space, q, v, a, tau_ext, limits, unit, rest_speed, mu, loads)
        if found is None:
            return None
        given[robot.motors] += found.tau
        found.rate[robot.motors] = (2.0 * self._shares[0] * found.tau / limits[0] + found.z) / limits[0]
        pin.forwardKinematics(robot.model, space.data, q, found.rate)
        far = effort_kernel().excess(
            *plan.own, *space.read[3:5], found.rate, unit, self._shares[1], found.w,
            *self._bounds, self.sets.mu if mu is None else mu, found.tau, found.z, *limits,
        )  # fmt: skip
        told = Found(a, found.w, found.w, self._rest, 0, 0, False)
        bound = plan.judged(space, q, v, given, told, rest_speed, True, elements, loads, misses)
        return (found, bound) if bound <= SOLVED and far <= SOLVED else None

    def least(self, state: State, a: Array, external: External, rest_speed: float) -> tuple[Least, float] | None:
        """As `certified`; None also where a contact is off the plane that it stands on."""
        plan, tau_ext, (force, pushes, elements) = self._plan, np.zeros(len(a)), acting(external)
        if force is not None or elements:
            tau_ext += generalised(state, elements if force is None else external)[0]
        with plan.workspace() as space:
            found = self.certified(
                space, state.q, state.v, a, tau_ext, rest_speed, plan.loads(pushes), plan.elements, None, np.empty(5)
            )  # fmt: skip
            stands = not len(plan.corner_entries) or plan.off_plane(space.places[plan.corner_entries]) <= TOUCHES
        return found if stands else None
