"""Contacts at k corner points: `Contact`, and contacts at a point, along an edge and over a flat patch.

Rows are in contact axes (tangent, tangent, normal); the normal points out of the surface, so that a positive normal
force pushes the robot away from it. J v is the velocity of the contact point (and the angular velocity of a patch), J_dot v
its classical acceleration in fixed contact axes; both relative to the surface (`rbd.constraints.surface`).
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Self

import numpy as np
import pinocchio as pin

from rbd.arrays import ABOVE_ZERO, Array, as_array, as_vector3, check_number, is_finite
from rbd.constraints.contact_points import ContactPoints
from rbd.constraints.ground_points import Grounds, OnGround
from rbd.constraints.round_feet import Ball
from rbd.constraints.surface import (
    HERE,
    UP,
    Counterpart,
    On,
    RelativeMotion,
    Surface,
    anchor_of,
    check_own_friction,
    check_state,
    check_words,
    cone_of,
    contact_axes,
    corners_of,
    edge_axes,
    jump_of,
    surface_of,
)
from rbd.constraints.terrain.on_terrain import OnTerrain
from rbd.constraints.terrain.resting import resting_rows, shift_under
from rbd.constraints.terrain.terrain import Terrain
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.model.placement import rigid_placement
from rbd.model.state import State
from rbd.problem.cones import Cone, check_friction
from rbd.problem.ground import Body, Ground
from rbd.problem.rows import Patch, Rows

_FIVE = np.array([0, 1, 2, 4, 5])


@dataclass(frozen=True, eq=False, init=False)
class Contact(Displayed):
    """A contact of the robot at one corner point, at two (an edge), or at k >= 3 (a patch): what the three kinds share.

    Its rows, by the number of corners::

        corners   rows, friction=None or mu                                         frictionless
        1         velocity of the point (3)                                         its normal one
        2         velocity of the middle (3), angular velocity about y and z (2)    the same 5
        k         velocity of the centre (3), angular velocity (3)                  the same 6

    `friction=None` is bilateral: forces and moments in all directions. `friction=mu` is unilateral with Coulomb friction at the
    corners, which resists torque too: row forces are resultants of corner forces in friction cones. `friction=0.0` is
    unilateral without friction.

    `PointContact`, `LineContact` and `SurfaceContact` construct the three kinds.

    Attributes:
        name: The contact's role, e.g. "left_sole".
        frame: Frame of the robot to which it is fixed.
        corners: Corner points from the contact's centre in its axes, shape (k, 3) [m]; two become an edge along x.
        placement: X_FP, from the frame to the centre and axes: z is the outward normal of the surface. A point takes
            W's axes, rotated to the normal.
        friction: Coulomb's coefficient; a set of forces, `rbd.problem.Cone`, of each corner (3 components: tangent, tangent,
            normal) or of all rows, e.g. `rbd.problem.EllipticCone(mu_x, mu_y)`; or None.
        facets: Facets of each corner's pyramid that replaces the cone in a QP; it circumscribes the cone, so it admits
            up to mu / cos(pi / facets) on its edges.
        on: The surface: a plane, `rbd.Ground(point=..., normal=...)`, which may move, or the height of a level one [m];
            `rbd.Terrain`; another body, `rbd.Body(frame)`; or None if it is unknown, and the contact is assumed to touch
            in any pose. A contact more than a millimetre off its plane gets a `DistantContactWarning` from `rbd.solve`, and
            `rbd.simulate` lets the body fall onto the plane.
        anchor: Where it first touched, in W or in the body's axes: for a point, shape (3,) [m], else pin.SE3 of its centre. The
            rows' `error` is the displacement and rotation from there, in contact axes: its derivative is J v where the
            error is zero, and to first order elsewhere. None gives no error. See `anchored`.
        cone: Set of its row forces.
        plane: What its gap is measured from: its ground's plane, or the one through the anchor; None if unknown.
        ball: Of a round foot of `robot.feet()`, which has the point of one posture: a warning names it where another is lowest.

    Raises:
        InputError: negative friction, corners of zero length or area, numbers that are not finite.

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> triangle = [(0.2, 0.0, 0.0), (-0.1, 0.15, 0.0), (-0.1, -0.15, 0.0)]
        >>> face = rbd.constraints.Contact("face", "box", corners=triangle, friction=0.6)
        >>> rbd.solve(rbd.State(box, [0, 0, 0, 0, 0, 0, 1]), [], [face]).corner_forces["face"].round(3)
        array([[ 0. ,  0. , 32.7],
               [0. ,  0. , 32.7],
               [ 0. , 0. , 32.7]])
    """

    name: str
    frame: str
    corners: Array
    placement: pin.SE3
    friction: float | Cone | None
    facets: int
    on: Surface
    anchor: pin.SE3 | Array | None
    cone: Cone = field(init=False, repr=False)
    _touched: Counterpart = field(init=False, repr=False)
    plane: Ground | None = field(init=False, repr=False)
    _against: str | None = field(init=False, repr=False)
    _reach: float = field(init=False, repr=False)
    _axes: Array = field(init=False, repr=False)
    _upright: bool = field(init=False, repr=False)
    ball: ClassVar[Ball | None] = None

    def __init__(
        self,
        name: str,
        frame: str,
        *,
        corners: Sequence[Sequence[float]] | Array,
        placement: pin.SE3 | Array | None = None,
        friction: float | Cone | None = None,
        facets: int = 4,
        on: On = None,
        anchor: pin.SE3 | Sequence[float] | Array | None = None,
    ) -> None:
        check_words("a contact", name=name, frame=frame)
        if not isinstance(friction, Cone):
            check_friction(0.0 if friction is None else friction, facets)
        points, X_FP = corners_of(name, corners, rigid_placement(f"placement of contact {name!r}", placement))
        surface = surface_of(name, on)
        if isinstance(surface, Terrain) and surface.friction is not None and friction is not None:
            friction = surface.friction
        if isinstance(surface, Body) and surface.frame == frame:
            raise InputError(f"contact {name!r} is between {frame!r} and itself; expected a frame of another body.")
        X_S0 = anchor_of(name, anchor, point=len(points) == 1)
        self.__dict__.update(
            name=name, frame=frame, friction=friction, facets=facets, on=surface, corners=points, placement=X_FP,
            anchor=X_S0.translation if X_S0 is not None and len(points) == 1 else X_S0,
            cone=cone_of(name, points, friction, int(facets)), _touched=Counterpart(name, surface, X_S0),
            _against=surface.frame if isinstance(surface, Body) else None,
            # Without a bound if corners are off the contact's plane.
            _reach=np.inf if points[:, 2].any() else float(np.linalg.norm(points, axis=1).max()),
        )  # fmt: skip
        axes = contact_axes(UP if self.normal is None else self.normal)
        self.__dict__.update(plane=self._measured_from(X_S0), _axes=axes, _upright=bool(np.array_equal(axes, np.eye(3))))

    @property
    def normal(self) -> Array | None:
        """Outward normal of the surface, shape (3,), in W or in the body's axes; None: the placement's z."""
        given = None if self.on is None or isinstance(self.on, Terrain) else self.on.normal
        if given is None:
            return UP.copy() if len(self.corners) == 1 else None
        return np.array(given)

    @property
    def on_still_ground(self) -> bool:
        """Whether it touches ground at rest, or a surface that is not named."""
        return self._touched.still

    @property
    def turned(self) -> Array | None:
        """R_WC of a point whose axes are not the world's; None for others."""
        return None if self._upright or len(self.corners) != 1 else self._axes

    @property
    def frames(self) -> tuple[str, ...]:
        """Its frame, and that of the body that it touches."""
        return (self.frame,) if self._against is None else (self.frame, self._against)

    def rows(self, state: State) -> Rows:
        """One to six rows in contact axes; see the class.

        Raises:
            FrameNotFound: with the nearest names.
            InputError: if both frames are on one body, or an edge is inclined more than 45 degrees to its surface.
        """
        if type(state) is not State:  # one call less on the hot path
            check_state(state, self.name)
        if isinstance(self.on, Terrain):
            return resting_rows(self, state)
        k, touched = len(self.corners), self._touched
        if k != 2 and touched.still:  # nothing to subtract, as of most contacts
            X_WP, J, v, bias = state.moving(self.frame, self.placement, pin.LOCAL if k > 1 else pin.LOCAL_WORLD_ALIGNED)
            X_WS, R = HERE, X_WP.rotation if k > 1 else self._axes
        else:
            motion = touched.motion(state, self.frame, self.placement)
            X_WP, X_WS, R = motion.X_WP, motion.X_WS, self._axes_at(motion)
            J, v, bias = motion.in_axes(R) if k > 1 else (motion.J, motion.v, motion.bias)
        if k == 1 and not (self._upright and X_WS is HERE):
            J, v, bias = R.T @ J[:3], R.T @ v[:3], R.T @ bias[:3]
        error = None if touched.anchor is None else touched.displacement(X_WP, X_WS, R, k)
        if k == 1:
            kept: Any = slice(2, 3) if self.friction == 0.0 else slice(3)
            resultant = R[:, kept]
        else:
            kept = _FIVE if k == 2 else slice(6)
            resultant = np.zeros((6, 6))
            resultant[:3, :3] = resultant[3:, 3:] = R
            resultant = resultant[:, kept]
        if k == 2:  # the direction's acceleration, x cross x'', is the body's less (w_x w_z, -w_x w_y)
            bias[4:] -= v[3] * np.array([v[5], -v[4]])
        J, v, bias, error = J[kept], v[kept], bias[kept], None if error is None else error[kept]
        plane = self.plane if touched.still or self.plane is None else self.plane.at(state.t)
        patch = Patch(X_WP.translation, R, self.corners, self.friction, self._against, plane, self._reach)
        return Rows.unchecked(self.name, J, bias, self.cone, v, error, resultant, patch)

    @property
    def jump(self) -> Callable[[float, float], float | None] | None:
        """Gives a time in an interval at which its ground's motion jumps [s], None if there is none; None without a motion."""
        return jump_of(self.on)

    def points(self, state: State, t: float = 0.0) -> ContactPoints | None:
        """Its corners on the ground at a state; None if bilateral or on a body, where the rows are used.

        Args:
            state: The robot.
            t: Time since the ground's motion was given [s].
        """
        source = self.source(state)
        return None if source is None else ContactPoints.of(source.at(state, t))

    def source(self, start: State) -> Grounds | OnTerrain | None:
        """Its points on the ground for a motion; None if bilateral, on a body, or with a set of all rows."""
        if self.friction is None or self._against is not None or (isinstance(self.friction, Cone) and self.friction.dim > 3):
            return None
        return OnTerrain([self], start) if isinstance(self.on, Terrain) else Grounds([OnGround(self, start)], start)

    def anchored(self, state: State) -> Self:
        """The same contact, anchored where it touches at this state."""
        if isinstance(self.on, Terrain):
            X_S0 = pin.SE3(np.eye(3), -shift_under(self, state)) * state.moving(self.frame, self.placement, pin.LOCAL)[0]
        else:
            motion = Counterpart(self.name, self.on, pin.SE3.Identity()).motion(state, self.frame, self.placement)
            X_S0 = motion.X_WS.actInv(motion.X_WP)
        return self._again(anchor=X_S0.translation if len(self.corners) == 1 else X_S0)

    def with_friction(self, mu: float | Cone | None, *, facets: int | None = None) -> Self:
        """The same contact with another coefficient, and other facets of its pyramids if they are given.

        Raises:
            InputError: on a terrain with a coefficient of its own.
        """
        check_own_friction(self.name, self.on, mu)
        return self._again(friction=mu, facets=self.facets if facets is None else facets)

    def with_ground(self, on: On) -> Self:
        """The same contact on another surface; its anchor, if it has one, is on the other one."""
        return self._again(on=on)

    def of_corners(self, chosen: Sequence[int]) -> Self:
        """The same contact at some of its corners: all its rows up to three on a line, which are an edge; or a point."""
        return self._again(corners=self.corners[list(chosen)])

    def _again(self, **changes: Any) -> Self:
        """The same with other arguments of `Contact`, whatever the class's own constructor takes."""
        names = ("name", "frame", "corners", "placement", "friction", "facets", "on", "anchor")
        out = copy.copy(self)
        Contact.__init__(out, **{name: getattr(self, name) for name in names} | changes)
        return out

    def renamed(self, prefix: str, placement: pin.SE3 | None) -> Self:
        """The same contact on a robot with prefixed names, its ground moved by a placement.

        Raises:
            InputError: if it has an anchor or a moving ground, which cannot be moved.
        """
        name, frame, on = prefix + self.name, prefix + self.frame, self.on
        if isinstance(on, Body):
            on = Body(prefix + on.frame, normal=on.normal)
        elif placement is not None:
            if isinstance(on, Terrain):
                raise InputError(f"contact {self.name!r} is on terrain, which cannot be moved: make it with frame={frame!r}.")
            given = () if on is None else (on.velocity, on.acceleration, on.motion)
            if self.anchor is not None or any(each is not None for each in given):
                raise InputError(
                    f"contact {self.name!r} has an anchor or a moving ground, given in the second robot's world; make it "
                    f"again in W, with frame={frame!r}."
                )
            n, point = self.normal, None if on is None else on.point
            if n is not None or point is not None:
                on = Ground(
                    normal=None if n is None else placement.rotation @ n,
                    point=None if point is None else placement.act(np.asarray(point)),
                )
        return self._again(name=name, frame=frame, on=on)

    def _measured_from(self, anchor: pin.SE3 | None) -> Ground | None:
        """The plane from which its gap is measured: its ground's, or that through the anchor.

        No gap on another body, or on ground that moves the contact away from its anchor.
        """
        on = self.on
        if isinstance(on, Ground) and on.point is not None:
            return on
        if anchor is None or isinstance(on, Body | Terrain) or (on is not None and on.velocity is not None):
            return None
        n = anchor.rotation[:, 2] if self.normal is None else self.normal
        motion = None if on is None else on.motion
        return Ground(point=anchor.translation, normal=n / np.linalg.norm(n), motion=motion)

    def _axes_at(self, motion: RelativeMotion) -> Array:
        """R_WC at a state."""
        R, n = motion.X_WP.rotation, self.normal
        if len(self.corners) == 1:
            return motion.X_WS.rotation @ self._axes
        return R if len(self.corners) > 2 or n is None else edge_axes(self.name, R[:, 0], motion.X_WS.rotation @ n)


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
        on: The surface: `rbd.Ground`, the height of a level one [m], `rbd.Terrain`, `rbd.Body` for another body, or None if it
            is unknown.
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
        on: The surface: `rbd.Ground`, the height of a level one [m], `rbd.Terrain`, `rbd.Body` for another body, or None if it
            is unknown.
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
        L = check_number(f"half_length of contact {name!r}", half_length, ABOVE_ZERO, 1e100, expected="a length > 0 [m]")
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
        on: The surface: `rbd.Ground`, the height of a level one [m], `rbd.Terrain`, `rbd.Body` for another body, or None if it
            is unknown.
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
