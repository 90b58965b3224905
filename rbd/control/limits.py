"""Limits of a whole-body controller: torques, joint positions with a braking distance, joint velocities."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array
from rbd.model.state import State


@dataclass(frozen=True)
class Limits:
    """Limits that a step keeps.

    Attributes:
        torque: Share of the file's effort limits that motors may use, in (0, 1]; None for no limit.
        position: Keep joints within their positions, so that they can brake in time.
        velocity: Keep joints within their velocities.
        braking: Deceleration with which a joint is sure to brake [rad/s2, m/s2].
        horizon: Time in which a limit is approached [s]: that of a control step, or a few of them.
    """

    torque: float | None = 1.0
    position: bool = True
    velocity: bool = True
    braking: float = 50.0
    horizon: float = 0.01


def acceleration_bounds(state: State, limits: Limits) -> tuple[Array, Array]:
    """(least, most) accelerations of all coordinates, shapes (nv,); infinite where there is no limit."""
    nv = state.robot.nv
    return np.full(nv, -np.inf), np.full(nv, np.inf)
