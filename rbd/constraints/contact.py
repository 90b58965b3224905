"""Contacts at a point and on a patch: held, with friction or without; on the ground, on moving ground, on another body.

Rows are in contact axes (tangent, tangent, normal); the normal points out of what is touched, so that a positive normal
force pushes the robot away from it. J v is the velocity of the contact point (and the angular velocity of a patch), J_dot v
its classical acceleration with the contact axes held still; both as seen from what is touched (`rbd.constraints.surface`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_vector3
from rbd.constraints.contact_geometry import (
    check_names,
    check_state,
    contact_axes,
    ground_of,
    patch_corners,
    rigid_placement,
    unit_normal,
)
from rbd.constraints.surface import Counterpart, anchor_placement, anchor_point, changed, counterpart, remember
from rbd.model.state import State
from rbd.problem.cones import Cone, Free, FrictionCone, NonNegative, WrenchCone, check_friction
from rbd.problem.ground import Ground, On
from rbd.problem.rows import Patch, Rows

_ONE_CORNER = np.zeros((1, 3))
_ONE_CORNER.flags.writeable = False


@dataclass(frozen=True, eq=False)
class PointContact:
    """A point of the robot touching the ground, a surface that moves, or another body.

    `friction=None` holds: 3 rows, forces in all directions. `friction=mu` pushes and rubs: 3 rows and a friction cone.
    `friction=0.0` only pushes: 1 row, the normal one.

    Attributes:
        name: The contact's role, e.g. "left_toe".
        frame: Frame of the robot that the point is fixed to.
        offset: The point, from the frame's origin in the frame's axes, shape (3,) [m].
        normal: Outward normal of what is touched, a unit vector, shape (3,): in world axes, as it is at this state; with
            `against`, in that frame's axes. By default that of `on`, else z.
        friction: Coulomb's coefficient, or None.
        facets: Facets of the pyramid that a QP puts in place of the cone; it circumscribes the cone, so it admits up to
            mu / cos(pi / facets) on its edges.
        against: Frame of another body of the same model that the point touches, in place of the ground. The force is the
            one on `frame`'s body; the other feels the opposite.
        velocity: Of the ground's surface (a belt, a lift, a turntable, a cart), world axes: linear (3,), or linear and
            angular (6,) [m/s, rad/s]; zero if not given. Rows are relative to it: a point that moves with it is at rest.
        acceleration: Likewise of the material point of the surface that `velocity` is of [m/s2, rad/s2]. Both are of the
            instant: another instant wants another contact.
        about: Point in W, shape (3,) [m], at which `velocity` and `acceleration` are those of the surface, as a point on
            a turntable's axis; the contact's own point if not given.
        anchor: Where on what it touches the point first touched, shape (3,) [m], in W or in `against`'s axes: the rows'
            `error` is the way from there, in contact axes. None gives no error. See `anchored`.
        on: The plane that it stands on, `rbd.Ground(point=..., normal=...)` in W, or the height of a level one [m]. A point
            more than a millimetre off it gets a `DistantContactWarning` where it is solved, and `rbd.simulate` lets it fall
            onto the plane. None: not known, and taken as touching wherever it is.

    Raises:
        InputError: negative friction, a normal that is not of unit length or not that of the plane it is on, numbers that are
            not finite, `against` together with a plane or with a motion of the ground.
    """

    name: str
    frame: str
    offset: Sequence[float] | Array = (0.0, 0.0, 0.0)
    normal: Sequence[float] | Array = (0.0, 0.0, 1.0)
    friction: float | None = None
    facets: int = 4
    against: str | None = None
    velocity: Sequence[float] | Array | None = None
    acceleration: Sequence[float] | Array | None = None
    about: Sequence[float] | Array | None = None
    anchor: Sequence[float] | Array | None = None
    on: On = None
    _axes: Array = field(init=False, repr=False)
    _X_FP: pin.SE3 = field(init=False, repr=False)
    _cone: Cone = field(init=False, repr=False)
    _upright: bool = field(init=False, repr=False)
    _touched: Counterpart | None = field(init=False, repr=False)
    _plane: Ground | None = field(init=False, repr=False)

    def __init__(
        self,
        name: str,
        frame: str,
        *,
        offset: Sequence[float] | Array = (0.0, 0.0, 0.0),
        normal: Sequence[float] | Array | None = None,
        friction: float | None = None,
        facets: int = 4,
        against: str | None = None,
        velocity: Sequence[float] | Array | None = None,
        acceleration: Sequence[float] | Array | None = None,
        about: Sequence[float] | Array | None = None,
        anchor: Sequence[float] | Array | None = None,
        on: On = None,
    ) -> None:
        check_names(name, frame)
        check_friction(0.0 if friction is None else friction, facets)
        put = object.__setattr__
        put(self, "name", name)
        put(self, "frame", frame)
        put(self, "offset", as_vector3(f"offset of contact {name!r}", offset))
        told = None if normal is None else unit_normal(name, normal)
        X_S0 = anchor_point(name, anchor)
        up = np.array([0.0, 0.0, 1.0]) if told is None and on is None else told
        plane, measured_from = ground_of(name, on, against, velocity, X_S0, up)
        put(self, "on", plane)
        put(self, "_plane", measured_from)
        put(self, "normal", up if up is not None or plane is None else np.array(plane.normal))
        put(self, "friction", friction)
        put(self, "facets", facets)
        touched = counterpart(name, frame, against, velocity, acceleration, about, X_S0)
        remember(self, touched, against=against, velocity=velocity, acceleration=acceleration)
        put(self, "anchor", None if X_S0 is None else X_S0.translation)
        put(self, "_axes", contact_axes(np.asarray(self.normal)))
        put(self, "_X_FP", pin.SE3(np.eye(3), self.offset))
        put(self, "_upright", bool(np.array_equal(self._axes, np.eye(3))))
        if friction is None:
            put(self, "_cone", Free(3))
        else:
            put(self, "_cone", NonNegative(1) if friction == 0.0 else FrictionCone(float(friction), int(facets)))

    @property
    def corners(self) -> Array:
        """The point itself, in contact axes from the contact point: one zero row, shape (1, 3) [m]."""
        return np.zeros((1, 3))

    def rows(self, state: State) -> Rows:
        """Three rows (tangent, tangent, normal), or the normal one alone without friction.

        Raises:
            FrameNotFound: with the nearest names.
            InputError: if it is between two frames of one body.
        """
        if type(state) is not State:  # one call less on the hot path
            check_state(state, self.name)
        R, against, error = self._axes, None, None
        if self._touched is None:
            X_WP, J, v, bias = state.moving(self.frame, self._X_FP, pin.LOCAL_WORLD_ALIGNED)
            turned = not self._upright
        else:
            motion = self._touched.motion(state, self.frame, self._X_FP)
            X_WP, J, v, bias = motion.X_WP, motion.J, motion.v, motion.bias
            R, against, turned = motion.X_WS.rotation @ R, self.against, True
            error = self._touched.shift(motion, R)
        J, v, bias = J[:3], v[:3], bias[:3]
        if turned:
            J, v, bias = R.T @ J, R.T @ v, R.T @ bias
        resultant = R
        if self.friction == 0.0:
            J, v, bias, resultant = J[2:], v[2:], bias[2:], R[:, 2:]
            error = None if error is None else error[2:]
        patch = Patch(X_WP.translation, R, _ONE_CORNER, self.friction, against, self._plane, 0.0)
        return Rows.unchecked(self.name, J, bias, self._cone, v, error, resultant, patch)

    def anchored(self, state: State) -> PointContact:
        """The same contact, its anchor where it touches at this state."""
        bare = changed(self, anchor=np.zeros(3))
        assert bare._touched is not None
        motion = bare._touched.motion(state, self.frame, self._X_FP)
        return changed(self, anchor=motion.X_WS.actInv(motion.X_WP.translation))


@dataclass(frozen=True, eq=False)
class SurfaceContact:
    """A flat patch of the robot on something flat: a sole on the ground, a palm on a box.

    `friction=None` holds: 6 rows, wrenches of all kinds. `friction=mu` pushes and rubs at the patch's corners, and so
    resists torque: 6 rows, wrenches that corner forces in friction cones can make. `friction=0.0` only pushes at them.

    Attributes:
        name: The contact's role, e.g. "left_sole".
        frame: Frame of the robot that the patch is fixed to.
        corners: Corner points in patch axes from the patch's centre, shape (k, 3) [m].
        placement: X_FP, from the frame to the patch's centre and axes: the patch's z is the outward normal of what it
            touches.
        friction: Coulomb's coefficient, or None.
        facets: Facets of each corner's pyramid in a QP; see `PointContact`.
        against: Frame of the other body, in place of the ground; see `PointContact`.
        velocity: Of the ground's surface; see `PointContact`.
        acceleration: Likewise.
        about: Point in W that these are given at; the patch's centre if not given.
        anchor: Pose of the patch, pin.SE3 in W or in `against`'s axes, where it first touched. The rows' `error` is the
            way from there and the rotation vector from there, in patch axes: its derivative is J v where the error is
            zero, and to first order elsewhere. None gives no error.
        on: The plane that it stands on; see `PointContact`.

    Args:
        name: The contact's role.
        frame: Frame of the robot.
        half_lengths: Half sizes (X, Y) of a rectangle along the patch's x and y [m]; or give `corners`.
        corners: Corner points, shape (k, 2) in the patch's plane or (k, 3), at least three and not on one line.
        placement: pin.SE3, a 4 x 4 matrix, or None for the frame itself.
        friction: Coulomb's coefficient, or None.
        facets: Facets of each corner's pyramid.
        against: Frame of the other body.
        velocity: Of the ground's surface, (3,) or (6,).
        acceleration: Likewise.
        about: Point in W, (3,).
        anchor: pin.SE3, a 4 x 4 matrix, or None.
        on: rbd.Ground, the height of a level ground [m], or None.

    Raises:
        InputError: negative friction, a patch without area, both or neither of `half_lengths` and `corners`, `against`
            together with a plane or with a motion of the ground.
    """

    name: str
    frame: str
    corners: Array
    placement: pin.SE3
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
    _reach: float = field(init=False, repr=False)

    def __init__(
        self,
        name: str,
        frame: str,
        *,
        half_lengths: Sequence[float] | Array | None = None,
        corners: Sequence[Sequence[float]] | Array | None = None,
        placement: pin.SE3 | Array | None = None,
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
        put = object.__setattr__
        put(self, "name", name)
        put(self, "frame", frame)
        put(self, "corners", patch_corners(name, half_lengths, corners))
        put(self, "placement", rigid_placement(f"placement of contact {name!r}", placement))
        put(self, "friction", friction)
        put(self, "facets", facets)
        X_S0 = anchor_placement(name, anchor)
        plane, measured_from = ground_of(name, on, against, velocity, X_S0)
        put(self, "on", plane)
        put(self, "_plane", measured_from)
        flat = not self.corners[:, 2].any()  # of corners off the patch's own plane no bound is kept
        put(self, "_reach", float(np.linalg.norm(self.corners, axis=1).max()) if flat else np.inf)
        touched = counterpart(name, frame, against, velocity, acceleration, about, X_S0)
        remember(self, touched, against=against, velocity=velocity, acceleration=acceleration)
        put(self, "anchor", X_S0)
        if friction is None:
            put(self, "_cone", Free(6))
        else:
            put(self, "_cone", WrenchCone(self.corners, float(friction), int(facets)))

    def rows(self, state: State) -> Rows:
        """Six rows: velocity of the patch's centre, then angular velocity, in patch axes.

        Raises:
            FrameNotFound: with the nearest names.
            InputError: if it is between two frames of one body.
        """
        if type(state) is not State:  # one call less on the hot path
            check_state(state, self.name)
        error = None
        if self._touched is None or self._touched.still:
            X_WP, J, v, bias = state.moving(self.frame, self.placement, pin.LOCAL)
            R = X_WP.rotation
            if self.anchor is not None:
                X_0P = self.anchor.actInv(X_WP)
                error = np.concatenate([X_0P.rotation.T @ X_0P.translation, pin.log3(X_0P.rotation)])
        else:
            motion = self._touched.motion(state, self.frame, self.placement)
            X_WP, R = motion.X_WP, motion.X_WP.rotation
            J, v, bias = (np.concatenate([R.T @ x[:3], R.T @ x[3:]]) for x in (motion.J, motion.v, motion.bias))
            if self.anchor is not None:
                turned = pin.log3(self._touched.anchored_axes(motion).T @ R)
                error = np.concatenate([self._touched.shift(motion, R), turned])
        resultant = np.zeros((6, 6))
        resultant[:3, :3] = resultant[3:, 3:] = R
        patch = Patch(X_WP.translation, R, self.corners, self.friction, self.against, self._plane, self._reach)
        return Rows.unchecked(self.name, J, bias, self._cone, v, error, resultant, patch)

    def anchored(self, state: State) -> SurfaceContact:
        """The same contact, its anchor where it touches at this state."""
        bare = changed(self, anchor=pin.SE3.Identity())
        assert bare._touched is not None
        motion = bare._touched.motion(state, self.frame, self.placement)
        return changed(self, anchor=motion.X_WS.actInv(motion.X_WP))
