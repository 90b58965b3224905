"""The world of a robot: its gravity, checked, and a base that slides in one of its vertical planes.

Pinocchio's planar joint slides in x-y. It is placed by a constant rotation T, whose first two columns are the plane's axes and
whose third is its normal; what hangs from it (the root link's inertia, frames, further joints) is turned back by T^T. So all
links are where the file puts them. q is the place along the plane's axes, then the cosine and the sine of the angle; v is in
the base's own axes.

    plane    q                    the angle, counter-clockwise for who looks from
    "xy"     x, y, cos, sin       +z
    "xz"     x, z, cos, sin       -y, as `rbd.mechanism.link_angles` measures; it turns about -y
    "yz"     y, z, cos, sin       +x
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Literal, get_args

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_vector3
from rbd.errors import InputError
from rbd.errors.inputs import check_choice
from rbd.model.urdf import BASE_JOINT

STANDARD = (0.0, 0.0, -9.81)
"""Gravity in W of robots that do not say otherwise [m/s2]."""
MOST = 1e4
"""Larger accelerations are not taken [m/s2]: a thousand times the Earth's."""
LEAST_FALL = 1e-3
"""Least share of gravity across a plane for lines along gravity to be followed to that plane."""


def checked_gravity(gravity: Sequence[float] | Array) -> Array:
    """A vector of gravity in W, copied, shape (3,) [m/s2]; zero is allowed.

    Raises:
        InputError: not three finite numbers, or more than 1e4 m/s2.
    """
    if isinstance(gravity, int | float | np.number):
        raise InputError(
            f"gravity is {gravity!r:.80}; expected the vector in W [m/s2], e.g. (0, 0, -9.81), or (0, 0, -1.62) on the Moon."
        )
    out = as_vector3("gravity", gravity)
    if not math.hypot(*out.tolist()) <= MOST:
        raise InputError(f"gravity is {out.tolist()}; expected at most {MOST:g} m/s2. Is it given in m/s2?")
    return np.array(out)


def is_standard(gravity: Array) -> bool:
    """Whether gravity is (0, 0, -9.81) m/s2."""
    return tuple(np.asarray(gravity).tolist()) == STANDARD


def is_along_z(gravity: Array) -> bool:
    """Whether gravity points along -z of W, with any size above zero."""
    x, y, z = np.asarray(gravity).tolist()
    return bool(z < 0.0 and max(abs(x), abs(y)) <= 1e-12 * -z)


def along_gravity(gravity: Array, points: Array, height: float | Array = 0.0) -> Array:
    """Where lines along gravity through points meet the level plane z = height: (x, y) in W, shape (..., 2) [m].

    (x, y) - (g_x, g_y) (z - height) / g_z: under gravity along -z the x and y of the points.

    Args:
        gravity: In W, shape (3,) [m/s2].
        points: In W, shape (..., 3) [m].
        height: Of the plane [m]; one for all points, or one each.

    Raises:
        InputError: gravity is zero or (to 0.001 of its size) parallel to the plane, whose lines do not meet it.
    """
    x, y, z = np.asarray(gravity).tolist()
    size = math.hypot(x, y, z)
    if not abs(z) > LEAST_FALL * size:
        what = "zero" if not size else f"{[x, y, z]} m/s2, level"
        raise InputError(
            f"gravity is {what}; expected one with a part along z: a centre of mass is projected along gravity onto a level "
            "plane. rbd.hold answers for one pose under any gravity."
        )
    points = np.asarray(points, float)
    if x == 0.0 and y == 0.0:
        return np.array(points[..., :2])
    return np.asarray(points[..., :2] - ((points[..., 2] - height) / z)[..., None] * np.array([x, y]))


Plane = Literal["xy", "xz", "yz"]
"""The axes of W along which a planar base slides."""
PLANES: tuple[Plane, ...] = get_args(Plane)
TURNS: Mapping[str, Array] = {
    "xy": np.eye(3),
    "xz": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    "yz": np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
}
TURN_RATES: Mapping[str, str] = {"xy": "wz", "xz": "w", "yz": "wx"}
"""Name of the entry of v that turns the base; "w" is minus the rate about y."""


def checked_plane(plane: str | None, root: str) -> Plane:
    """The plane of a planar base, "xy" by default.

    Args:
        plane: As given.
        root: Kind of the root joint.

    Raises:
        InputError: not the name of a plane, or given for a root that is not planar.
    """
    if plane is None:
        return "xy"
    known: Plane = check_choice("plane", plane, PLANES)  # type: ignore[assignment]  # one of them
    if root != "planar":
        raise InputError(f"plane={plane!r} came with root={root!r}; it is of a base that slides: root='planar'.")
    return known


def turn_base(model: pin.Model, plane: Plane) -> None:
    """Let the planar joint at the root of a new model slide in another plane than x-y; in place.

    Args:
        model: As it was built: its joint 1 is the base.
        plane: The plane.
    """
    T = TURNS[plane]
    if plane == "xy":
        return
    back = pin.SE3(T.T, np.zeros(3))
    model.jointPlacements[1] = pin.SE3(T, np.zeros(3))
    model.inertias[1] = back.act(model.inertias[1])
    for i in range(2, model.njoints):
        if model.parents[i] == 1:
            model.jointPlacements[i] = back * model.jointPlacements[i]
    for frame in model.frames:
        if frame.parentJoint == 1:
            frame.placement = back * frame.placement


def plane_of_base(model: pin.Model) -> Plane | None:
    """The plane in which the base of a model slides; None if it has no such base."""
    if model.njoints < 2 or model.names[1] != BASE_JOINT or model.joints[1].shortname() != "JointModelPlanar":
        return None
    T = model.jointPlacements[1].rotation
    return next((plane for plane in PLANES if np.array_equal(T, TURNS[plane])), None)


def base_turn(model: pin.Model) -> pin.SE3 | None:
    """X_JB from the axes of a planar base's joint to those of its root link; None where they are the same."""
    plane = plane_of_base(model)
    return None if plane in (None, "xy") else pin.SE3(TURNS[plane].T, np.zeros(3))
