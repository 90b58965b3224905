"""A robot whose base slides in an upright plane, put on its feet: turned in the plane and lowered to the ground."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rbd.arrays import Array
from rbd.constraints.contact import Contact
from rbd.model.checked_model import CheckedModel
from rbd.model.gravity import LEAST_FALL
from rbd.model.state import State
from rbd.robots.posture import corner_points

TOGETHER = 1e-6
"""Feet that are nearer to each other along the plane are one support [m]."""
AXES = {"xz": np.eye(3)[[0, 2]], "yz": np.eye(3)[[1, 2]]}
"""The axes of W along an upright plane, the second of them up."""


def stand_upright(robot: CheckedModel, q: Array, feet: Sequence[Contact]) -> Array:
    """Q with its base turned in its plane so that its feet are level, and moved so that the lowest is on z = 0.

    Feet that are one point of the plane, as two point feet side by side, have no level: about them the robot is turned until
    its centre of mass is over them along gravity, where gravity presses it on level ground.

    Args:
        robot: Its base slides in "xz" or "yz".
        q: Configuration, shape (nq,).
        feet: Soles or points.
    """
    q, axes = q.copy(), AXES[robot.plane or "xz"]
    lean = _lean(State(robot, q), feet, axes)
    if lean is not None:
        _turn(q, -lean, q[:2].copy())
    else:
        for _ in range(20):  # one turn is exact for a rigid robot; the second is rounding
            state = State(robot, q)
            at = axes @ corner_points(state, feet).mean(axis=0)
            arm, up = axes @ state.com - at, -axes @ robot.gravity
            if not up[1] > LEAST_FALL * np.linalg.norm(robot.gravity) or not np.linalg.norm(arm) > TOGETHER:
                break
            angle = math.atan2(arm[0] * up[1] - arm[1] * up[0], arm @ up)  # from the arm to up, counter-clockwise
            if abs(angle) < 1e-15:
                break
            _turn(q, angle, at)
    q[1] -= float(corner_points(State(robot, q), feet)[:, 2].min())
    return q


def _lean(state: State, feet: Sequence[Contact], axes: Array) -> float | None:
    """By which angle in the plane the feet are not level; None where they are one point of it."""
    patches = [patch for foot in feet if len(foot.corners) > 1 and (patch := foot.rows(state).patch) is not None]
    if patches:
        up = axes @ np.mean([patch.axes[:, 2] for patch in patches], axis=0)
        return math.atan2(-up[0], up[1]) if np.linalg.norm(up) > TOGETHER else 0.0
    points = corner_points(state, feet) @ axes.T
    spread = points - points.mean(axis=0)
    along = np.linalg.svd(spread)[2][0]
    if float(np.abs(spread @ along).max()) < TOGETHER:
        return None
    along = along if along[0] >= 0.0 else -along
    return math.atan2(along[1], along[0])


def _turn(q: Array, angle: float, about: Array) -> None:
    """Turn the base by an angle about a point of the plane; in place."""
    c, s = math.cos(angle), math.sin(angle)
    R = np.array([[c, -s], [s, c]])
    q[:2] = about + R @ (q[:2] - about)
    q[2:4] = R @ q[2:4]
