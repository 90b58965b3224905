"""Contacts at a point, along an edge and over a flat patch: `Contact` at one corner point, at two, and at three or more."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_array, as_float, as_vector3, is_finite
from rbd.constraints.contact import Contact
from rbd.errors import InputError
from rbd.problem.cones import Cone
from rbd.problem.ground import On


@dataclass(frozen=True, eq=False, init=False)
class PointContact(Contact):
    """A contact at a point of the robot: `Contact` at one corner point.

    Three rows: the velocity of the point; without friction its normal part alone.

    Attributes:
        name: The contact's role, e.g. "left_foot".
        frame: Frame of the robot to which it is fixed.
        offset: The point, from the frame's origin in the frame's axes, shape (3,) [m].
        friction: Coulomb's coefficient, or a set of forces, as of `Contact`; 0 without friction; None, bilateral: it neither
            slips nor separates.
        facets: Facets of the pyramid that replaces the cone in a QP.
        on: The surface: `rbd.Ground`, the height of a level one [m], `rbd.Body` for another body, or None if it is unknown.
        anchor: Where the point first touched, in W or in the body's axes, shape (3,) [m]; None: the rows have no `error`.

    Raises:
        InputError: negative friction, numbers that are not finite, as `Contact`.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> feet = [rbd.PointContact(name, name, friction=0.6) for name in ("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT")]
        >>> solution = rbd.solve(solo.standing(), np.zeros(solo.nu), feet)
        >>> solution.forces["FL_FOOT"].round(3)
        array([-0.31 , -0.016,  0.517])
    """

    corners: Array = field(init=False, repr=False)
    placement: pin.SE3 = field(init=False, repr=False)
    offset: Array

    def __init__(
        self,
        name: str,
        frame: str,
        *,
        offset: Sequence[float] | Array = (0.0, 0.0, 0.0),
        friction: float | Cone | None = None,
        facets: int = 4,
        on: On = None,
        anchor: Sequence[float] | Array | None = None,
    ) -> None:
        at = as_vector3(f"offset of contact {name!r}", offset)
        super().__init__(name, frame, corners=at[None], friction=friction, facets=facets, on=on, anchor=anchor)
        object.__setattr__(self, "offset", at)


@dataclass(frozen=True, eq=False, init=False)
class LineContact(Contact):
    """A contact along a straight edge of the robot: `Contact` at its two ends. Rotation about the edge is free.

    Give the surface's normal for a body that rolls over its edge: the default is the placement's z, which
    tilts with the body. Its part along the edge is left out.

    Attributes:
        name: The contact's role, e.g. "left_foot".
        frame: Frame of the robot to which it is fixed.
        half_length: Half of the edge's length [m].
        placement: X_FP, from the frame to the edge's middle; the edge is along x.
        friction: Coulomb's coefficient, or a set of forces, as of `Contact`; 0 without friction; None, bilateral: it neither
            slips nor separates.
        facets: Facets of the pyramid that replaces the cone in a QP.
        on: The surface: `rbd.Ground`, the height of a level one [m], `rbd.Body` for another body, or None if it is unknown.
        anchor: Pose where the edge first touched, rotation about it excluded, pin.SE3; None: the rows have no `error`.

    Raises:
        InputError: a length that is not positive, and as `Contact`.

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> edge = rbd.LineContact("edge", "box", half_length=0.2, friction=0.8)
        >>> push = rbd.ExternalForce("box", (30.0, 0.0, 0.0))
        >>> solution = rbd.solve(rbd.State(box, [0, 0, 0, 0, 0, 0, 1]), [], [edge], external=[push])
        >>> solution.corner_forces["edge"].round(3)
        array([[-15.  ,  0.  ,  49.05],
               [-15.  ,  0.  ,  49.05]])
    """

    corners: Array = field(init=False, repr=False)
    half_length: float

    def __init__(
        self,
        name: str,
        frame: str,
        *,
        half_length: float,
        placement: pin.SE3 | Array | None = None,
        friction: float | Cone | None = None,
        facets: int = 4,
        on: On = None,
        anchor: pin.SE3 | Array | None = None,
    ) -> None:
        if not 0.0 < as_float(half_length) < 1e100:
            raise InputError(f"half_length of contact {name!r} is {half_length!r:.80}; expected a length > 0 [m].")
        L = float(half_length)
        ends = [[L, 0.0, 0.0], [-L, 0.0, 0.0]]
        super().__init__(name, frame, corners=ends, placement=placement, friction=friction, facets=facets, on=on, anchor=anchor)
        object.__setattr__(self, "half_length", L)


@dataclass(frozen=True, eq=False, init=False)
class SurfaceContact(Contact):
    """A contact of a flat patch of the robot, e.g. a sole or a palm: `Contact` at three corner points or more.

    The corners are in patch axes from the patch's centre, given by either of::

        half_lengths = (X, Y)    half sizes of a rectangle along the patch's x and y [m]
        corners                  shape (k, 2) in the patch's plane or (k, 3), at least three and not on one line

    Attributes:
        name: The contact's role, e.g. "left_sole".
        frame: Frame of the robot to which it is fixed.
        placement: X_FP, from the frame to the patch's centre and axes: z is the outward normal of the surface. By default
            those of the frame.
        friction: Coulomb's coefficient, or a set of forces, as of `Contact`; 0 without friction; None, bilateral: it neither
            slips nor separates.
        facets: Facets of the pyramid that replaces the cone in a QP.
        on: The surface: `rbd.Ground`, the height of a level one [m], `rbd.Body` for another body, or None if it is unknown.
        anchor: Pose of the centre where it first touched, pin.SE3; None: the rows have no `error`.

    Raises:
        InputError: both or neither of `half_lengths` and `corners`, and as `Contact`.

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> face = rbd.SurfaceContact("face", "box", half_lengths=(0.2, 0.2), friction=0.6, on=0.0)
        >>> solution = rbd.solve(rbd.State(box, [0, 0, 0, 0, 0, 0, 1]), [], [face])
        >>> solution.forces["face"].round(3)
        array([ 0. ,  0. , 98.1, 0. ,  0. ,  0. ])
    """

    def __init__(
        self,
        name: str,
        frame: str,
        *,
        half_lengths: Sequence[float] | Array | None = None,
        corners: Sequence[Sequence[float]] | Array | None = None,
        placement: pin.SE3 | Array | None = None,
        friction: float | Cone | None = None,
        facets: int = 4,
        on: On = None,
        anchor: pin.SE3 | Array | None = None,
    ) -> None:
        if (half_lengths is None) == (corners is None):
            raise InputError(f"contact {name!r} wants half_lengths=(X, Y) or corners=, one of the two.")
        if corners is None:
            half = as_array(f"half_lengths of contact {name!r}", half_lengths)
            if half.shape != (2,) or not (half > 0.0).all() or not is_finite(half):
                raise InputError(f"half_lengths of contact {name!r} are {half_lengths!r:.80}; expected two lengths > 0 [m].")
            X, Y = half
            corners = np.array([[X, Y, 0.0], [X, -Y, 0.0], [-X, -Y, 0.0], [-X, Y, 0.0]])
        corners = as_array(f"corners of contact {name!r}", corners)
        if corners.ndim != 2 or corners.shape[1] not in (2, 3) or len(corners) < 3:
            raise InputError(
                f"corners of contact {name!r} have shape {corners.shape}; expected (k, 2) or (k, 3) with k >= 3. "
                "For one point use PointContact, for two LineContact."
            )
        super().__init__(
            name, frame, corners=corners, placement=placement, friction=friction, facets=facets, on=on, anchor=anchor
        )
