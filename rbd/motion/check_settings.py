"""`CheckSettings`: what a motion was checked with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from rbd.constraints.terrain.terrain import Terrain
from rbd.displayed import Displayed


@dataclass(frozen=True)
class CheckSettings(Displayed):
    """What a motion was checked with; as the arguments of `check_motion`."""

    friction: float
    torque_limits: bool | float
    ground: float | str | Terrain | None
    threshold: float
    bodies: bool
    self_collision: bool
    torque_speed: Mapping[str, tuple[float, float]] | None
    touch_height: float
    touch_speed: float
    rest_speed: float
    grasp_tolerance: tuple[float, float]
