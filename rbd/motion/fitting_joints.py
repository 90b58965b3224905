"""Whether the joints of a file can be those of its robot: limits, order, left and right, and velocities beside them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.errors import InputError
from rbd.model.checked_model import CheckedModel
from rbd.motion.file_conventions import beyond_limits, breadth_first, file_order, formats
from rbd.motion.file_frames import Frames, configurations
from rbd.motion.rates import REST_RATE, SHARE, misfit
from rbd.motion.symmetry import other_side
from rbd.robots.robot import Robot

OFF = 3e-3
"""Joints beyond their limits by more than this, in the mean of frames and joints, are looked at [rad]; retargeted have 0."""
FAR = 0.3
"""Beyond this in the mean no order helps: they are those of another robot [rad]."""
DEGREES = 2.0 * np.pi
"""Positions of all joints that spread over less are no degrees: of a robot that hardly moves [rad]."""
CLEARLY = 4.0
"""Another reading is named if joints are beyond their limits by this factor less."""
LOOKED = 300
"""Pairs of frames in which the feet are looked at."""
STILLER, REFUSED = 1.3, 2.5
"""How many times stiller the feet stand with left and right exchanged where that is said, and where the file is refused. Of
seven clips, as they are, it is 0.02 to 0.45."""
CARRIES = np.array([0.01, 0.05])
"""The lower foot's step in a frame, and the spread of its height, beyond which the feet carry nothing and tell nothing [m]."""
STILL, LEVEL = 1e-3, 1e-4
"""Added to speeds [m/s] and heights [m] that are compared, so that a robot at rest tells nothing."""


def check_joints(robot: CheckedModel, names: Sequence[str], x: Array, q: Array, file: str, units: str | None) -> list[str]:
    """Notes on positions of joints that do not look like those of this robot.

    Args:
        robot: The robot.
        names: Joints, each with one degree of freedom.
        x: Their positions, shape (n, k) [rad, m].
        q: The configurations, shape (n, nq).
        file: Its name, for messages.
        units: The units that were given.

    Raises:
        InputError: they are far beyond limits, and within them in degrees, in another order, or with left and right exchanged;
            or the feet stand much stiller so.
    """
    if not len(names) or not len(x):
        return []
    names = list(names)
    off = beyond_limits(robot, names, x)
    swapped = [names.index(other_side(name, names)) for name in names]
    if off.mean() > OFF:
        readings = {f"the order of {what}, joints=[...]": order for what, order in _orders(robot, len(names)).items()}
        found = {what: beyond_limits(robot, order, x).mean() for what, order in readings.items()}
        found["left and right exchanged; rename or exchange its columns"] = beyond_limits(robot, names, x[:, swapped]).mean()
        if units is None:
            found["degrees, units='deg'"] = beyond_limits(robot, names, np.radians(x)).mean() if np.ptp(x) > DEGREES else np.inf
        best = min(found, key=lambda what: found[what])
        worst = int(off.argmax())
        told = f"joint {names[worst]!r:.80} is beyond its limits by {off[worst]:.2g} rad in the mean of the frames"
        if CLEARLY * found[best] < off.mean():
            raise InputError(f"{file}: {told}; they fit {robot.name} in {best}. Or take them as they are: trust=True.")
        if off.mean() > FAR and units is None:
            raise InputError(
                f"{file}: {told}, all joints by {off.mean():.2g}; they look like those of another robot than {robot.name}. "
                "Give the robot that it was made for, joints=[...] in order, or trust=True."
            )
        return [f"{told}; all joints by {off.mean():.2g} rad: are these its joints, in this order?"]
    return _check_sides(robot, names, x, q, swapped, file)


def _orders(robot: CheckedModel, width: int) -> dict[str, Sequence[str]]:
    """{what it is: joints in order}, of the known robots whose files have this number of columns."""
    found = {"the robot's file": file_order(robot), "breadth-first search": breadth_first(robot), **formats(robot)}
    return {what: order for what, order in found.items() if len(order) == width}


def _check_sides(robot: CheckedModel, names: list[str], x: Array, q: Array, swapped: list[int], file: str) -> list[str]:
    """A note, or an error, if the feet stand much stiller with left and right exchanged."""
    if not isinstance(robot, Robot) or not robot.floating or len(robot.source.feet) < 2 or len(x) < 3:
        return []
    if swapped == list(range(len(names))):
        return []
    at = np.unique(np.linspace(0, len(x) - 2, min(LOOKED, len(x) - 1)).astype(int))
    near = np.stack([at, at + 1], axis=1).ravel()
    base = q[near, :3], q[near, 3:7]
    as_is, other = (_unrest(robot, configurations(robot, base, names, y)) for y in (x[near], x[near][:, swapped]))
    ratio = float(np.prod(as_is) / np.prod(other))
    if ratio < STILLER or (other > 0.9 * as_is).any() or (other > CARRIES).any():
        return []
    told = (
        f"with left and right exchanged the lower foot moves {1e3 * other[0]:.2g} mm a frame in place of {1e3 * as_is[0]:.2g}, "
        f"and its height changes by {1e3 * other[1]:.2g} mm in place of {1e3 * as_is[1]:.2g}"
    )
    if ratio > REFUSED:
        raise InputError(f"{file}: {told}. Are its columns exchanged? Rename or exchange them; or trust=True.")
    return [f"{told}: are they exchanged?"]


def _unrest(robot: Robot, q: Array) -> Array:
    """(median step of the lowest point of the feet along the floor, spread of its height) of pairs of frames [m]."""
    model, data = robot.model, robot.model.createData()
    feet = []
    for foot in robot.source.feet:
        corners = np.array([(*corner, 0.0)[:3] for corner in foot.corners or [(0.0, 0.0)]])
        feet.append((robot.frame_id(foot.frame), np.array(foot.translation) + corners @ foot.rotation.T))
    points = []
    for each in q:
        pin.framesForwardKinematics(model, data, each)
        points.append(np.concatenate([p @ data.oMf[i].rotation.T + data.oMf[i].translation for i, p in feet]))
    pairs = np.array(points).reshape(-1, 2, len(points[0]), 3)
    low = pairs[:, 0, :, 2].argmin(axis=1)
    here, there = (pairs[np.arange(len(pairs)), k, low] for k in (0, 1))
    step = float(np.median(np.linalg.norm((there - here)[:, :2], axis=1)))
    return np.array([step + STILL / 60.0, float(here[:, 2].std()) + LEVEL])


def check_given_rates(found: Frames, names: Sequence[str], v: Array, file: str, *, trust: bool = False) -> list[str]:
    """A note that velocities of joints in the file are the rates of their positions, or what they are.

    Args:
        found: The frames.
        names: The joints.
        v: Their velocities, shape (n, k) [rad/s, m/s].
        file: Its name.
        trust: Do not refuse them.

    Raises:
        InputError: they are not, with the joint and the factor.
    """
    robot, t = found.robot, found.t
    columns = [robot.joints[name].q.start for name in names if not robot.joints[name].is_continuous]
    if v.shape != (len(t), len(names)) or len(columns) != len(names) or len(t) < 3:
        return []
    rate = f"{(len(t) - 1) / (t[-1] - t[0]):.6g} Hz"
    fit = misfit(t, np.diff(found.q[:, columns], axis=0), v, SHARE, REST_RATE)
    worst = int(fit.error.argmax())
    if not fit.error[worst]:
        return [f"velocities of joints in the file are the rates of q at {rate}; v is derived from q."]
    told = (
        f"{file}: the velocity of joint {names[worst]!r:.80} is {fit.factor[worst]:.2f} times the rate of its position, off by "
        f"{fit.error[worst]:.2g} of {fit.size[worst]:.2g} rad/s"
    )
    if trust:
        return [f"{told}; it is not used."]
    raise InputError(
        f"{told} (root mean square). Is its rate {rate}, in radians, and are velocities in the "
        "order of positions? Or give rate=, and trust=True, to have v derived from q."
    )
