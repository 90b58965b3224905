"""Whether a file's quaternions are x, y, z, w or w, x, y, z: the order in which the base stays upright."""

from __future__ import annotations

import numpy as np

from rbd.arrays import Array
from rbd.model.checked_model import CheckedModel
from rbd.model.rotations import conjugate, rotated
from rbd.motion.joint_orders import standing_q

CLEARLY = 0.3
"""By how much the mean cosine of the tilt must differ for an order to be seen."""


def chosen_order(robot: CheckedModel, turn: Array, given: str | None, file: str) -> tuple[Array, list[str]]:
    """(quaternions as x, y, z, w, notes): in the order given, else in that in which the base stays upright.

    A wrong order shows: with every turn of the heading the base rolls. It is x, y, z, w where the frames do not tell.

    Args:
        robot: The robot, whose standing posture tells which of its axes is up.
        turn: Four columns, shape (n, 4).
        given: "xyzw", "wxyz" or None.
        file: Name for the notes.
    """
    orders = {"xyzw": turn, "wxyz": turn[:, [1, 2, 3, 0]]}
    upright = {name: _upright(robot, x) for name, x in orders.items()}
    chosen = given or ("wxyz" if upright["wxyz"] > upright["xyzw"] + CLEARLY else "xyzw")
    other = "wxyz" if chosen == "xyzw" else "xyzw"
    tilt = f"cosine of the base's tilt in the mean {upright[chosen]:.2f}, in the other order {upright[other]:.2f}"
    notes = []
    if given is None:
        sure = abs(upright[chosen] - upright[other]) > CLEARLY
        notes.append(f"quaternions were taken as {', '.join(chosen)}{': ' if sure else ', the usual order: '}{tilt}.")
    elif upright[other] > upright[chosen] + CLEARLY:
        notes.append(
            f"the base spins or lies with quaternions as {', '.join(chosen)}: {tilt}. Is {file} in {', '.join(other)}?"
        )
    return orders[chosen], notes


def _upright(robot: CheckedModel, turn: Array) -> float:
    """The mean cosine between the vertical and the axis of the base that is up when it stands."""
    axis = rotated(conjugate(standing_q(robot)[3:7]), np.array([0.0, 0.0, 1.0]))
    norm = np.linalg.norm(turn, axis=1)
    return float(np.mean(rotated(turn / np.where(norm > 0.0, norm, 1.0)[:, None], axis)[:, 2]))
