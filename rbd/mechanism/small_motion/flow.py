"""The true motion near a state: its rates along curves on the constraints, and their derivatives by differences.

About a motion with constant v_0, q_0(t) = q_0 (+) v_0 t, a neighbour has the coordinates

    dq = q (-) q_0(t)        dv = v - v_0        dq' = P v + P_0 v_0        dv' = a(q, v)

P and P_0 are the derivatives of the difference by q and by q_0. To first order dq' = dv - ad(v_0) dq, where ad holds the
structure constants of these velocities (w x u and the like of a floating base): zero for joints with one degree of freedom.
Where a body of revolution spins by eta (`rbd.mechanism.small_motion.spin`), v - eta takes the place of v in dq', and dv' = a +
ad(eta) v.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from rbd.answers.analysis.external_derivatives import STEP, slope
from rbd.answers.least_constraint import solve
from rbd.arrays import Array
from rbd.constraints.constraint import Constraint
from rbd.constraints.manifold import RANK, ConstraintManifold
from rbd.errors import RbdWarning
from rbd.mechanism.small_motion.spin import ad_matrix
from rbd.model.chart import Charts
from rbd.model.external import External
from rbd.model.state import State


class Flow:
    """Rates of motion at states on the constraints, and their slopes.

    Args:
        state: The state of the motion with which others are compared.
        tau: Its torques, shape (nu,).
        constraints: Its constraints.
        external: Its external forces.
        manifold: The constraints' manifold.
        S: Combinations of the rows that are held, shape (k, m).
        spin: eta, shape (nv,).
    """

    def __init__(
        self,
        state: State,
        tau: Array,
        constraints: Sequence[Constraint],
        external: External,
        manifold: ConstraintManifold,
        S: Array,
        spin: Array,
    ) -> None:
        self._state, self._tau, self._constraints, self._external = state, tau, constraints, external
        self._manifold, self._S = manifold, S
        self._charts = Charts(state.robot)
        self._spin, self._turning = spin, ad_matrix(state.robot, spin)

    def slope(self, change: Array, torques: Array) -> tuple[Array, Array]:
        """(x', f') at the state: tangents of a curve on the constraints and of its rates, shapes (2 nv,).

        Args:
            change: (dq, dv) along which the curve begins, before its projection onto the constraints, shape (2 nv,).
            torques: Change of tau along the curve, shape (nu,).

        Raises:
            NotDifferentiable: the rates have a kink there.
        """

        def sample(h: float) -> Array:
            return self._sample(h * change, h * torques)

        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RbdWarning)
            found = slope(sample, self._sample(0.0 * change, 0.0 * torques), STEP, "the state")
        n = len(change)
        return found[:n], found[n:]

    def _sample(self, change: Array, torques: Array) -> Array:
        """(dq, dv, dq', dv') at the state on the constraints that is nearest to a change, shape (4 nv,)."""
        state, robot = self._state, self._state.robot
        model, nv = robot.model, robot.nv
        q = pin.integrate(model, state.q, change[:nv])
        if self._manifold.constraints and self._manifold.placed.any() and change.any():
            q = self._manifold.project(q).q
        v = state.v + change[nv:]
        near = State(robot, q, v)
        if len(self._S):
            rows, scale = self._manifold.rows(near), robot.joints.scale
            v = v - scale * np.linalg.lstsq(self._S @ rows.J * scale, self._S @ rows.velocity, rcond=RANK)[0]
            near = State(robot, q, v)
        a = solve(near, self._tau + torques, self._constraints, external=self._external).a
        xi = pin.difference(model, state.q, near.q)
        chart = self._charts.at(state.q)
        moved = chart.rate(xi, v - self._spin) - chart.rate(-xi, state.v - self._spin)
        return np.concatenate([xi, v - state.v, moved, a + self._turning @ v])
