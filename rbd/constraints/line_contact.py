"""Contact along a line: an edge of a foot or of a box, about which it may turn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_float
from rbd.constraints.contact_geometry import check_names, check_state, ground_of, rigid_placement, unit_normal
from rbd.constraints.surface import Counterpart, RelativeMotion, anchor_placement, changed, counterpart, remember
from rbd.errors import InputError
from rbd.model.state import State
from rbd.problem.cones import Cone, Free, LineCone, check_friction
from rbd.problem.ground import Ground, On
from rbd.problem.rows import Patch, Rows

_FIVE = np.array([0, 1, 2, 4, 5])
_ALONG = 0.7
"""Largest cosine between line and normal: 45 degrees off the surface it is no line contact any more."""


@dataclass(frozen=True, eq=False)
class LineContact:
    """A straight edge of the robot on the ground, on a surface that moves, or on another body.

    Five rows in contact axes (x along the line, z the normal): velocity of the line's middle, then the angular velocity of
    the line about y and z. Turns about the line are free, and nothing on it resists them. Accelerations of the last two
    rows are those of its direction, x cross x'': the body's less (w_x w_z, -w_x w_y), which a roll about the line w_x adds.

    `friction=None` holds: forces and two moments of all kinds. `friction=mu` pushes and rubs at the two ends: forces and
    moments that end forces in friction cones can make. `friction=0.0` only pushes at them.

    Attributes:
        name: The contact's role, e.g. "left_toe_edge".
        frame: Frame of the robot that the line is fixed to.
        half_length: Half of the line's length [m].
        placement: X_FP, from the frame to the line's middle: the line lies along its x.
        normal: Outward normal of what is touched, a unit vector, shape (3,): in world axes as it is at this state; with
            `against`, in that frame's axes. Without it the placement's z, which tilts with a body that rolls over its
            edge: give it, or `on`, whose normal it then is, for one that does. Its part along the line is left out.
        friction: Coulomb's coefficient, or None.
        facets: Facets of each end's pyramid in a QP; see `PointContact`.
        against: Frame of the other body, in place of the ground; see `PointContact`.
        velocity: Of the ground's surface; see `PointContact`.
        acceleration: Likewise.
        about: Point in W that these are given at; the line's middle if not given.
        anchor: Pose of the line, pin.SE3 in W or in `against`'s axes, where it first touched. The rows' `error` is the way
            of its middle from there, and how far its direction has turned about y and z; turns about the line do not
            count. Its derivative is J v where the error is zero, and to first order elsewhere. None gives no error.
        on: The plane that it stands on; see `PointContact`.

    Raises:
        InputError: negative friction, a length that is not above zero, a normal not of unit length or not that of the plane it
            is on, `against` together with a plane or with a motion of the ground.
    """

    name: str
    frame: str
    half_length: float
    placement: pin.SE3
    normal: Array | None
    friction: float | None
    facets: int
    against: str | None
    velocity: Array | None
    acceleration: Array | None
    about: Array | None
    anchor: pin.SE3 | None
    on: Ground | None
    _cone: Cone = field(init=False, repr=False)
    _touched: Counterpart | None = field(init=False, repr=False)
    _plane: Ground | None = field(init=False, repr=False)

    def __init__(
        self,
        name: str,
        frame: str,
        *,
        half_length: float,
        placement: pin.SE3 | Array | None = None,
        normal: Sequence[float] | Array | None = None,
        friction: float | None = None,
        facets: int = 4,
        against: str | None = None,
        velocity: Sequence[float] | Array | None = None,
        acceleration: Sequence[float] | Array | None = None,
        about: Sequence[float] | Array | None = None,
        anchor: pin.SE3 | Array | None = None,
        on: On = None,
    ) -> None:
        check_names(name, frame)
        check_friction(0.0 if friction is None else friction, facets)
        if not 0.0 < as_float(half_length) < 1e100:
            raise InputError(f"half_length of contact {name!r} is {half_length!r:.80}; expected a length > 0 [m].")
        put = object.__setattr__
        put(self, "name", name)
        put(self, "frame", frame)
        put(self, "half_length", float(half_length))
        put(self, "placement", rigid_placement(f"placement of contact {name!r}", placement))
        told = None if normal is None else unit_normal(name, normal)
        X_S0 = anchor_placement(name, anchor)
        plane, measured_from = ground_of(name, on, against, velocity, X_S0, told)
        put(self, "on", plane)
        put(self, "_plane", measured_from)
        put(self, "normal", told if plane is None else np.array(plane.normal))
        put(self, "friction", friction)
        put(self, "facets", facets)
        touched = counterpart(name, frame, against, velocity, acceleration, about, X_S0)
        remember(self, touched, against=against, velocity=velocity, acceleration=acceleration)
        put(self, "anchor", X_S0)
        put(self, "_cone", Free(5) if friction is None else LineCone(self.half_length, float(friction), int(facets)))

    @property
    def corners(self) -> Array:
        """The two ends, in contact axes from the middle, shape (2, 3) [m]."""
        return np.array([[self.half_length, 0.0, 0.0], [-self.half_length, 0.0, 0.0]])

    def rows(self, state: State) -> Rows:
        """Five rows: velocity of the line's middle, then its angular velocity about y and z, in contact axes.

        Raises:
            FrameNotFound: with the nearest names.
            InputError: if it is between two frames of one body, or the line stands more than 45 degrees off the surface.
        """
        check_state(state, self.name)
        motion = self._motion(state)
        R, error = self._axes(motion), None
        J, v, bias = (np.concatenate([R.T @ x[:3], R.T @ x[3:]]) for x in (motion.J, motion.v, motion.bias))
        wx, wy, wz = v[3:]
        bias[4] -= wx * wz
        bias[5] += wx * wy
        J, v, bias = J[_FIVE], v[_FIVE], bias[_FIVE]
        if self._touched is not None and self.anchor is not None:
            x0 = R.T @ self._touched.anchored_axes(motion)[:, 0]  # x0 cross x, in contact axes: (0, x0_z, -x0_y)
            error = np.concatenate([self._touched.shift(motion, R), [x0[2], -x0[1]]])
        resultant = np.zeros((6, 6))
        resultant[:3, :3] = resultant[3:, 3:] = R
        patch = Patch(motion.X_WP.translation, R, self.corners, self.friction, self.against, self._plane, self.half_length)
        return Rows(self.name, J, bias, self._cone, v, error, resultant=resultant[:, _FIVE], patch=patch)

    def anchored(self, state: State) -> LineContact:
        """The same contact, its anchor where it touches at this state."""
        motion = changed(self, anchor=pin.SE3.Identity())._motion(state)
        return changed(self, anchor=motion.X_WS.actInv(motion.X_WP))

    def _motion(self, state: State) -> RelativeMotion:
        if self._touched is not None:
            return self._touched.motion(state, self.frame, self.placement)
        X_WP, J, v, bias = state.moving(self.frame, self.placement, pin.LOCAL_WORLD_ALIGNED)
        return RelativeMotion(X_WP, pin.SE3.Identity(), J, v, bias)

    def _axes(self, motion: RelativeMotion) -> Array:
        """R_WP: x along the line, z the normal less its part along the line."""
        if self.normal is None:
            return motion.X_WP.rotation
        x, n = motion.X_WP.rotation[:, 0], motion.X_WS.rotation @ self.normal
        along = float(n @ x)
        if not abs(along) <= _ALONG:
            raise InputError(
                f"the line of contact {self.name!r} stands {90.0 - np.rad2deg(np.arccos(min(1.0, abs(along)))):.0f} degrees "
                "off its surface; expected one that lies on it (up to 45 are taken). Is the placement's x along the line?"
            )
        z = n - along * x
        z /= np.linalg.norm(z)
        return np.column_stack([x, np.cross(z, x), z])
