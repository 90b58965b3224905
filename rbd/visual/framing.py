"""Where the camera of a picture stands and what it sees, as data for the page; and the size of the ground's grid."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence

import numpy as np

from rbd.arrays import Array, as_vector3
from rbd.errors import InputError
from rbd.visual.marks.contacts import ShownForce
from rbd.visual.robot_layers import ahead_of, toes_of
from rbd.visual.shapes import outermost, round_number

FRONT_LEFT = (1.0, 0.62, 0.34)
"""From the robot to the camera, where no direction is given: ahead, left, up."""


def a_direction(seen_from: Sequence[float] | Array | None) -> list[float] | None:
    """A direction from the robot to the camera; None for None.

    Raises:
        InputError: if it is no vector, or straight up or down.
    """
    if seen_from is None:
        return None
    seen = as_vector3("seen_from", seen_from)
    if not seen[:2].any():
        raise InputError(f"seen_from is {seen_from}; expected (x, y, z) from robot to camera, not straight up or down.")
    return list(seen.tolist())


def seen_from(contacts: Iterable[ShownForce]) -> list[float]:
    """From the robot to the camera, in W: in front, on the left, above; the front is where the x axes of the soles point."""
    ahead = ahead_of(toes_of(contacts))
    left = np.array([-ahead[1], ahead[0]])
    return np.round([*(FRONT_LEFT[0] * ahead + FRONT_LEFT[1] * left), FRONT_LEFT[2]], 4).tolist()


def camera_and_ground(
    clouds: Sequence[Array], direction: Sequence[float], front: Sequence[float], *, opens: str, body: float, ground: bool
) -> str:
    """Camera, light and ground for a scene, in the page's format, as JSON.

    Args:
        clouds: Points in W that the camera is to see, each of shape (n, 3) [m].
        direction: From the robot to the camera, in W, shape (3,).
        front: The direction of the robot's front, in W.
        opens: The view in which the page opens, as the page names it.
        body: Size of the robot [m].
        ground: Whether the ground z = 0 is drawn.
    """
    fit = outermost(np.vstack(list(clouds)))
    low, high = fit.min(axis=0), fit.max(axis=0)
    across = float(np.linalg.norm(high - low))
    view = {
        "direction": list(direction),
        "front": list(front),
        "opens": opens,
        "fov": 30.0,
        "points": np.round(fit, 4).tolist(),
        "centre": np.round((low + high) / 2.0, 4).tolist(),
        "radius": round(across / 2.0, 4),
        # A motion over a long way has a coarser grid: no more than some hundred lines.
        "cell": round_number(max(0.2 * body, across / 60.0)) if ground else 0.0,
    }
    return json.dumps({"view": view})
