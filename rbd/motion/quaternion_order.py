"""Whether quaternions are x, y, z, w or w, x, y, z: the order in which the base stays upright, or that its velocities fit."""

from __future__ import annotations

import numpy as np

from rbd.arrays import Array
from rbd.errors import InputError
from rbd.model.checked_model import CheckedModel
from rbd.model.rotations import conjugate, rotated
from rbd.motion.joint_orders import standing_q
from rbd.motion.rates import REST_RATE, turning_error
from rbd.robots.robot import Robot

CLEARLY = 0.3
"""By how much the mean cosine of the tilt must differ for an order to be seen."""

TELLING = 2.0
"""An order fits angular velocities if the other one fits them this many times worse."""


def check_quaternion(order: object) -> None:
    """Refuse what is no order of quaternions.

    Raises:
        InputError: it is neither None, "xyzw" nor "wxyz".
    """
    if order is not None and (not isinstance(order, str) or order not in ("xyzw", "wxyz")):
        raise InputError(f"quaternion is {order!r:.80}; expected 'xyzw' or 'wxyz'.")


def order_base(robot: CheckedModel, t: Array, q: Array, v: Array | None, given: str | None, source: str) -> list[str]:
    """Bring the base's quaternions of configurations into the order x, y, z, w, in place; notes where they were not.

    They are x, y, z, w unless given, or unless the angular velocities fit the other order only, or, where these do not tell,
    the base of a robot with a known posture stays upright in the other order only.
    """
    if given == "xyzw" or not robot.floating:
        return []
    turn = q[:, 3:7]
    other = turn[:, [1, 2, 3, 0]]
    if given is None:
        if v is not None and len(t) > 1:
            own, swapped = (turning_error(robot, t, np.hstack([q[:, :3], x, q[:, 7:]]), v) for x in (turn, other))
            if max(own, swapped) > max(REST_RATE, TELLING * min(own, swapped)):
                if own < swapped:
                    return []
                told = f"angular velocities fit to {swapped:.2g} rad/s, in the other order to {own:.2g}"
                q[:, 3:7] = other
                return [f"quaternions were taken as w, x, y, z: {told}. Else give quaternion='xyzw'."]
        if not isinstance(robot, Robot) or not (robot.source.posture or robot.source.feet):
            return []
        found, notes = chosen_order(robot, turn, None, source)
        if found is turn:
            return []
        q[:, 3:7] = found
        return [f"{note} Else give quaternion='xyzw'." for note in notes]
    q[:, 3:7] = other
    return []


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
