"""Projection of a velocity onto constraints: the nearest admissible one in the inertia metric."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import blas, lapack

from rbd.arrays import max_abs
from rbd.constraints.constraint import Constraint, rows_of
from rbd.errors import InputError, SingularInertia
from rbd.mechanism.held import of_its_file
from rbd.model.state import State
from rbd.problem.cones import Box

ZERO = 1e-9
"""Singular values of J, in the metric of inertia, below this fraction of the largest count as zero."""
MET = 1e-9
"""How well the rows must be met, over the largest sum of terms in a row."""


def project_velocity(state: State, constraints: Sequence[Constraint] | None = None) -> State:
    """The same configuration with the nearest velocity, in the metric of inertia, under which constraints keep their places.

        minimise 1/2 |v+ - v|_M^2     subject to     J v+ = u ,       v+ = v - M^-1 J^T (J M^-1 J^T)^+ (J v - u)

    u is the velocity of what is touched, zero of a ground at rest. Contacts are taken as ones that hold, whatever their
    friction: they neither slip nor leave. Contacts without friction (and stops of joints) keep their normal velocity at zero
    and may slide. Leave out those that shall slide, open or strike. It is what a plastic impact on all of them does to v, with
    forces of either sign. Rows may repeat each other.

    Measured or recorded velocities are off the contacts by noise; above `rest_speed`, `rbd.solve` takes that for a contact
    that leaves or strikes.

    Args:
        state: The robot at (q, v).
        constraints: Contacts, loops, rolling wheels, locks; None for the loops and wheels of the robot's file. Dry friction in
            joints says nothing of velocities and is passed over.

    Returns:
        A state with the same q.

    Raises:
        InputError: something is no constraint, or no velocity keeps all of them: two belts that pull apart.
        SingularInertia: M is not positive definite.

    >>> rbd.solve(rbd.mechanism.project_velocity(state, robot.soles()), tau, robot.soles())
    """
    if not isinstance(state, State):
        raise InputError(f"a State was expected first, got {type(state).__name__}. Make one: rbd.State(robot, q, v).")
    given = of_its_file(state.robot) if constraints is None else constraints
    rows = [r for r in rows_of(state, given) if len(r) and not isinstance(r.cone, Box)]
    if not rows:
        return state
    J = np.concatenate([r.J for r in rows])
    u = J @ state.v - np.concatenate([r.velocity for r in rows])
    L, info = lapack.dpotrf(state.M, lower=1, clean=1)
    if info != 0:
        raise SingularInertia(f"M of {state.robot.name} is not positive definite (leading minor {abs(info)}) at this state.")
    W, v = blas.dtrsm(1.0, L, J.T, lower=1), state.v
    for _ in range(3):  # once is exact but for rounding, which an ill-conditioned M or J makes large
        y = np.linalg.lstsq(W.T, J @ v - u, rcond=ZERO)[0]  # of least norm: of least |v+ - v| in M
        v = v - blas.dtrsv(L, y, lower=1, trans=1)
    off = np.abs(J @ v - u) / max(1e-300, max_abs(np.abs(J) @ np.abs(v)), max_abs(np.abs(J) @ np.abs(state.v)), max_abs(u))
    if max_abs(off) > MET:
        worst = int(np.argmax(off))
        name = [r.name for r in rows for _ in range(len(r))][worst]
        raise InputError(
            f"no velocity of {state.robot.name} keeps these constraints together: {name!r:.80} is missed by "
            f"{abs(float((J @ v - u)[worst])):.3g} m/s (rad/s) at least. Leave out one of those that move against each other."
        )
    return state.with_velocity(v)
