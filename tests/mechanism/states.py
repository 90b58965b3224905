"""States of robots at rest."""

from __future__ import annotations

import pinocchio as pin

import rbd
from rbd.model.checked_model import CheckedModel


def at_neutral(robot: CheckedModel) -> rbd.State:
    """The robot with every joint at zero, at rest."""
    return rbd.State(robot, pin.neutral(robot.model))
