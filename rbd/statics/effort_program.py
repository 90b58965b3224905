"""The torques and forces of least effort for a wanted motion: the program, its solution and its checks."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rbd.arrays import Array
from rbd.constraints.constraint import Constraint
from rbd.errors import InaccurateWarning
from rbd.model.external import External
from rbd.problem.answer import Status
from rbd.problem.conic import Conic, ConicAnswer
from rbd.solvers.conic import solve_conic
from rbd.statics.actuation import Actuation
from rbd.statics.effort import POSSIBLE, Effort
from rbd.statics.loads import Loads

_EXACT = 1e-14
"""What is left of balance below this, of numbers around one, is rounding."""


def least_effort(
    loads: Loads,
    a: Array,
    constraints: Sequence[Constraint],
    external: External,
    effort: Effort,
    margin: float,
    rest_speed: float,
) -> Actuation | ConicAnswer:
    """The actuation; where there is none within tolerance, what the program ended with.

    Near a limit, or where contacts are nearly redundant, the least may not be found; torques that are possible are.
    """
    program = effort.program(loads)
    found = solve_conic(program)
    least = found.solved
    if not least and found.certificate is None and program.outside(found.x) > POSSIBLE:
        zero = np.zeros_like(program.H)
        found = solve_conic(replace(program, H=zero, g=zero[:, 0]), newton=False, tolerance=POSSIBLE)
    x = _balanced(program, found.x)
    if not (found.solved or found.certificate is None and program.outside(x) <= POSSIBLE):
        return found
    w = x * loads.unit
    tau, _ = loads.torques(w)
    return Actuation(a, tau, w, loads, constraints, external, effort, margin, rest_speed, found.iterations, found.method, least)


def warned(actuation: Actuation, stacklevel: int) -> Actuation | None:
    """The actuation, with a warning where it is inaccurate; None where its residuals say that it is none."""
    status = actuation.status
    if status is Status.SOLVED:
        return actuation
    if status is not Status.INACCURATE:
        return None
    worst = actuation.residuals.worst
    name = actuation.state.robot.name
    warnings.warn(
        f"the torques of {name} have a scaled residual of {worst:.1e} (solved is 1e-9).", InaccurateWarning, stacklevel
    )
    return actuation


def _balanced(program: Conic, x: Array) -> Array:
    """The same x moved, within what is strictly inside its bounds and cones, so that A x = b to rounding."""
    left = program.b - program.A @ x
    if not left.size or np.abs(left).max() <= _EXACT:
        return x
    free = (x > program.lower) & (x < program.upper)
    if len(program.mu):
        cones = x[program.cones]
        inner = np.hypot(cones[:, 0], cones[:, 1]) < program.mu * cones[:, 2] * (1.0 - 1e-9)
        free[program.cones[~inner]] = False
    moved = x.copy()
    moved[free] += np.linalg.lstsq(program.A[:, free], left, rcond=1e-12)[0]
    return moved if program.outside(moved) < program.outside(x) else x
