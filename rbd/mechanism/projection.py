"""Projection onto constraints: position and velocity, by the least motion in the inertia metric.

What a motion has drifted off constraints that hold is undone by

    q+ = q (+) d        d  = - M^-1 J^T (J M^-1 J^T)^+ error(q)        repeated: Newton's steps
    v+ = v + w          w  = - M^-1 J^T (J M^-1 J^T)^+ (J v - u)       u: the velocity of what is touched

Both are the least in |.|_M of all that close the rows. So the velocity's loses no energy beyond what the error carried: w is
perpendicular, in M, to all motions that the constraints leave free. Source: `docs/simulation.md`.

Rows may repeat each other, and rank may drop at singular poses. In W = L^-1 J^T (M = L L^T) the steps are those of least
squares, by Cholesky where the rows are well independent and by singular values s where not. There

    d = - L^-T U diag(s / (s^2 + (s_1 |error|)^2)) V^T error        over s > zero s_1

A pose that is off by `error` knows its singular values to s_1 |error| and no better (a redundant row shows that much, not
zero), hence the damping: it fades faster than Newton's steps converge [YamashitaFukushima2001].
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import pinocchio as pin
from scipy.linalg import blas, lapack

from rbd.arrays import Array, as_float, inertia_factor, max_abs
from rbd.errors import InputError
from rbd.model.state import State
from rbd.solvers.kkt import independent_factor

ZERO = 1e-9
"""Singular values below this fraction of the largest count as zero."""
FARTHEST = 0.5
"""Longest entry of one step [m, rad]: farther away, the linearised rows tell nothing."""
HALVINGS = 4

Equations: TypeAlias = Callable[[State], tuple[Array, Array]]
"""(J (m, nv), error (m,)) at a state: the error's derivative along the motion is J v."""


@dataclass(frozen=True)
class Projection:
    """Constraints that hold are kept by projection after every step: q goes to the nearest configuration on them, v along them.

    Attributes:
        tolerance: Largest position error that is left [m, rad].
        iterations: Newton steps at most.

    Raises:
        InputError: a tolerance that is not in (0, 1e-3], iterations that are no whole number from 1.
    """

    tolerance: float = 1e-12
    iterations: int = 20

    def __post_init__(self) -> None:
        if not 0.0 < as_float(self.tolerance) <= 1e-3:
            raise InputError(f"tolerance of Projection is {self.tolerance!r:.80}; expected a number above 0, at most 1e-3.")
        n = self.iterations
        if isinstance(n, bool) or not isinstance(n, int) or not 1 <= n <= 1000:
            raise InputError(f"iterations of Projection is {n!r:.80}; expected a whole number from 1 to 1000.")


def project_position(state: State, equations: Equations, projection: Projection) -> State:
    """The state whose configuration is the nearest, in the inertia metric, that meets the equations; its v is kept.

    It stops where no step comes nearer; look at the errors of the state it returns. Rows may repeat each other.

    Args:
        state: Start.
        equations: J (m, nv) and error (m,) [m, rad] of a state; m may change from state to state.
        projection: How near, and how many steps.
    """
    robot = state.robot
    J, error = equations(state)
    for _ in range(projection.iterations):
        size = max_abs(error)
        if size <= projection.tolerance:
            break
        step = shortened(-correction(inertia_factor(state.M), J, error, damping=size))
        for _ in range(HALVINGS):
            nearer = State(robot, pin.integrate(robot.model, state.q, step), state.v)
            J_there, error_there = equations(nearer)
            if max_abs(error_there) < size:
                break
            step = 0.5 * step
        else:
            break  # rounding, or a true minimum of the distance
        state, J, error = nearer, J_there, error_there
    return state


def correction(L: Array, J: Array, error: Array, *, damping: float = 0.0, zero: float = ZERO) -> Array:
    """The least x in |.|_M with J x = error, as nearly as can be: M^-1 J^T (J M^-1 J^T)^+ error, shape (nv,).

    Args:
        L: Lower factor of M, shape (nv, nv).
        J: Shape (m, nv).
        error: Shape (m,).
        damping: How much of the largest singular value a small one may owe to the pose being off.
        zero: Singular values below this fraction of the largest are left out.
    """
    if not len(error) or not error.any():
        return np.zeros(len(L))
    W = blas.dtrsm(1.0, L, J.T, lower=1)
    R = independent_factor(W.T @ W)
    if R is not None:
        y = W @ lapack.dpotrs(R, error)[0]
    else:
        U, s, Vt = np.linalg.svd(W, full_matrices=False)
        kept = s > zero * s[0]
        s = s[kept]
        y = U[:, kept] @ (s / (s * s + (damping * s[0]) ** 2) * (Vt[kept] @ error)) if len(s) else np.zeros(len(L))
    return blas.dtrsv(L, y, lower=1, trans=1)


def shortened(step: Array) -> Array:
    """The step, no entry of it longer than `FARTHEST`."""
    longest = max_abs(step)
    return step if longest <= FARTHEST else step * (FARTHEST / longest)
