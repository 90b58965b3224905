"""The warnings of single answers, counted over many states: one warning of each kind."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np

from rbd.answers.many.answers import ManyAnswers
from rbd.answers.many.states import ManyStates
from rbd.arrays import Array
from rbd.constraints.constraint import Constraint, is_open
from rbd.constraints.distance_warnings import joint_bounds
from rbd.errors import (
    DistantContactWarning,
    EffortLimitWarning,
    InaccurateWarning,
    JointLimitWarning,
    LoopNotClosedWarning,
    MovingConstraintWarning,
    NonUniqueMotionWarning,
    OpeningContactWarning,
    RbdWarning,
    SpeedLimitWarning,
)
from rbd.problem.rows import Rows

TORQUE, DISTANT, MOVES, OPENED, LOOP, SEVERAL, INACCURATE, SPEED, LIMIT = (
    "a torque is beyond its effort limit",
    "a contact is off its plane",
    "a bilateral constraint moves",
    "a contact separates and carries no force",
    "a loop is open",
    "more than one motion satisfies the law",
    "inaccurate",
    "a joint is faster than its motor can turn",
    "a joint is beyond its limits",
)
WARNINGS: dict[str, type[RbdWarning]] = {
    TORQUE: EffortLimitWarning,
    DISTANT: DistantContactWarning,
    MOVES: MovingConstraintWarning,
    OPENED: OpeningContactWarning,
    LOOP: LoopNotClosedWarning,
    SEVERAL: NonUniqueMotionWarning,
    INACCURATE: InaccurateWarning,
    SPEED: SpeedLimitWarning,
    LIMIT: JointLimitWarning,
}
"""The warning of each kind."""


def of_rows(constraints: Sequence[Constraint], rows: Sequence[Rows]) -> list[str]:
    """Kinds that the rows of one state give."""
    told = [DISTANT] if any(r.overlaps or r.gaps_off_plane is not None for r in rows) else []
    if any(is_open(constraint, r) for constraint, r in zip(constraints, rows, strict=True)):
        told.append(LOOP)
    return told


def beyond_limits(states: ManyStates) -> Array:
    """At which states some joint is beyond its limits, shape (n,), of truth values; see `warn_of_limits`."""
    low, high = joint_bounds(states.robot, states.constraints)
    with np.errstate(invalid="ignore"):
        return np.asarray(((states.q < low) | (states.q > high)).any(axis=1))


def warn(found: ManyAnswers, *, stacklevel: int) -> None:
    """One warning for each kind that occurred.

    Args:
        found: The answers.
        stacklevel: Which line is to blame, as of `warnings.warn`: 2 for the one that called this.
    """
    for what, some in found.warned.items():
        warnings.warn(
            f"{what} at {int(some.sum())} of {len(found)} states of {found.states.robot.name}, the first of them state "
            f"{int(some.argmax())}; `.warned[{what!r}]` says which, and the answer of one state says more.",
            WARNINGS[what],
            stacklevel=stacklevel + 1,
        )
