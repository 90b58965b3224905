"""Contacts of a robot with a world that does not move: points and surfaces, held or rubbing.

Rows are in contact axes (tangent, tangent, normal); the normal points out of the ground, so that a positive normal force
pushes the robot away from it. J v is the velocity of the contact point (and the angular velocity of a patch), J_dot v its
classical acceleration with the contact axes held still.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, check_finite, is_finite, numbers, three
from rbd.cones import Cone, Free, FrictionCone, NonNegative, WrenchCone, check_friction
from rbd.errors import InputError
from rbd.rows import Patch, Rows
from rbd.state import State


@dataclass(frozen=True, eq=False)
class PointContact:
    """A point of the robot touching the ground.

    `friction=None` holds: 3 rows, forces in all directions. `friction=mu` pushes and rubs: 3 rows and a friction cone.
    `friction=0.0` only pushes: 1 row, the normal one.

    Attributes:
        name: The contact's role, e.g. "left_toe".
        frame: Frame of the robot that the point is fixed to.
        offset: The point, from the frame's origin in the frame's axes, shape (3,) [m].
        normal: The ground's outward normal, a unit vector in world axes, shape (3,).
        friction: Coulomb's coefficient, or None.
        facets: Facets of the pyramid that a QP puts in place of the cone; it circumscribes the cone, so it admits up to
            mu / cos(pi / facets) on its edges.

    Raises:
        InputError: negative friction, a normal that is not of unit length, numbers that are not finite.
    """

    name: str
    frame: str
    offset: Sequence[float] | Array = (0.0, 0.0, 0.0)
    normal: Sequence[float] | Array = (0.0, 0.0, 1.0)
    friction: float | None = None
    facets: int = 4
    _axes: Array = field(init=False, repr=False)
    _X_FP: pin.SE3 = field(init=False, repr=False)
    _cone: Cone = field(init=False, repr=False)
    _upright: bool = field(init=False, repr=False)

    def __init__(
        self,
        name: str,
        frame: str,
        *,
        offset: Sequence[float] | Array = (0.0, 0.0, 0.0),
        normal: Sequence[float] | Array = (0.0, 0.0, 1.0),
        friction: float | None = None,
        facets: int = 4,
    ) -> None:
        _check_names(name, frame)
        check_friction(0.0 if friction is None else friction, facets)
        put = object.__setattr__
        put(self, "name", name)
        put(self, "frame", frame)
        put(self, "offset", three(f"offset of contact {name!r}", offset))
        put(self, "normal", _unit(name, normal))
        put(self, "friction", friction)
        put(self, "facets", facets)
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
        """
        _check_state(state, self.name)
        X_WP, J, v, bias = state.moving(self.frame, self._X_FP, pin.LOCAL_WORLD_ALIGNED)
        R = self._axes
        J, v, bias = J[:3], v[:3], bias[:3]
        if not self._upright:
            J, v, bias = R.T @ J, R.T @ v, R.T @ bias
        resultant = R
        if self._cone.dim == 1:
            J, v, bias, resultant = J[2:], v[2:], bias[2:], R[:, 2:]
        patch = Patch(X_WP.translation, R, _ONE_CORNER, self.friction)
        return Rows(self.name, J, bias, self._cone, v, resultant=resultant, patch=patch)


@dataclass(frozen=True, eq=False)
class SurfaceContact:
    """A flat patch of the robot on flat ground: a sole, a palm.

    `friction=None` holds: 6 rows, wrenches of all kinds. `friction=mu` pushes and rubs at the patch's corners, and so
    resists torque: 6 rows, wrenches that corner forces in friction cones can make. `friction=0.0` only pushes at them.

    Attributes:
        name: The contact's role, e.g. "left_sole".
        frame: Frame of the robot that the patch is fixed to.
        corners: Corner points in patch axes from the patch's centre, shape (k, 3) [m].
        placement: X_FP, from the frame to the patch's centre and axes: the patch's z is the ground's outward normal.
        friction: Coulomb's coefficient, or None.
        facets: Facets of each corner's pyramid in a QP; see `PointContact`.

    Args:
        name: The contact's role.
        frame: Frame of the robot.
        half_lengths: Half sizes (X, Y) of a rectangle along the patch's x and y [m]; or give `corners`.
        corners: Corner points, shape (k, 2) in the patch's plane or (k, 3), at least three and not on one line.
        placement: pin.SE3, a 4 x 4 matrix, or None for the frame itself.
        friction: Coulomb's coefficient, or None.
        facets: Facets of each corner's pyramid.

    Raises:
        InputError: negative friction, a patch without area, both or neither of `half_lengths` and `corners`.
    """

    name: str
    frame: str
    corners: Array
    placement: pin.SE3
    friction: float | None
    facets: int
    _cone: Cone = field(init=False, repr=False)

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
    ) -> None:
        _check_names(name, frame)
        check_friction(0.0 if friction is None else friction, facets)
        put = object.__setattr__
        put(self, "name", name)
        put(self, "frame", frame)
        put(self, "corners", _corners(name, half_lengths, corners))
        put(self, "placement", _placement(name, placement))
        put(self, "friction", friction)
        put(self, "facets", facets)
        if friction is None:
            put(self, "_cone", Free(6))
        else:
            put(self, "_cone", WrenchCone(self.corners, float(friction), int(facets)))

    def rows(self, state: State) -> Rows:
        """Six rows: velocity of the patch's centre, then angular velocity, in patch axes.

        Raises:
            FrameNotFound: with the nearest names.
        """
        _check_state(state, self.name)
        X_WP, J, v, bias = state.moving(self.frame, self.placement, pin.LOCAL)
        R = X_WP.rotation
        resultant = np.zeros((6, 6))
        resultant[:3, :3] = resultant[3:, 3:] = R
        patch = Patch(X_WP.translation, R, self.corners, self.friction)
        return Rows(self.name, J, bias, self._cone, v, resultant=resultant, patch=patch)


_ONE_CORNER = np.zeros((1, 3))
_ONE_CORNER.flags.writeable = False


def _check_names(name: str, frame: str) -> None:
    for what, value in (("name", name), ("frame", frame)):
        if not isinstance(value, str) or not value:
            raise InputError(f"the {what} of a contact is {value!r:.80}; expected a word, e.g. 'left_sole'.")


def _check_state(state: State, name: str) -> None:
    if not isinstance(state, State):
        raise InputError(f"rows of {name!r} want a State, got {type(state).__name__}. Make one: rbd.State(robot, q, v).")


def contact_axes(normal: Array) -> Array:
    """R_WP with the normal as third column, the first along W's x as far as it goes (W's y for a normal along x)."""
    along = np.array([1.0, 0.0, 0.0]) if abs(normal[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    t1 = along - (along @ normal) * normal
    t1 /= np.linalg.norm(t1)
    return np.column_stack([t1, np.cross(normal, t1), normal])


def _unit(name: str, normal: Sequence[float] | Array) -> Array:
    n = three(f"normal of contact {name!r}", normal)
    length = float(np.linalg.norm(n))
    if abs(length - 1.0) > 1e-6:
        raise InputError(f"normal of contact {name!r} has length {length:.6g}; expected a unit vector in world axes.")
    return n / length


def _corners(
    name: str, half_lengths: Sequence[float] | Array | None, corners: Sequence[Sequence[float]] | Array | None
) -> Array:
    if (half_lengths is None) == (corners is None):
        raise InputError(f"contact {name!r} wants half_lengths=(X, Y) or corners=, one of the two.")
    if half_lengths is not None:
        half = numbers(f"half_lengths of contact {name!r}", half_lengths)
        if half.shape != (2,) or not (half > 0.0).all() or not is_finite(half):
            raise InputError(f"half_lengths of contact {name!r} are {half_lengths!r:.80}; expected two lengths > 0 [m].")
        X, Y = half
        return np.array([[X, Y, 0.0], [X, -Y, 0.0], [-X, -Y, 0.0], [-X, Y, 0.0]])
    given = numbers(f"corners of contact {name!r}", corners)
    if given.ndim != 2 or given.shape[1] not in (2, 3) or len(given) < 3:
        raise InputError(
            f"corners of contact {name!r} have shape {given.shape}; expected (k, 2) or (k, 3) with k >= 3. "
            "For one point use PointContact."
        )
    check_finite(f"corners of contact {name!r}", given)
    out = np.zeros((len(given), 3))
    out[:, : given.shape[1]] = given
    spread = np.linalg.svd(out - out.mean(axis=0), compute_uv=False)
    if spread[1] <= 1e-9 * max(spread[0], 1e-300) or spread[0] == 0.0:
        raise InputError(f"corners of contact {name!r} lie on one line; a patch needs an area.")
    return out


def _placement(name: str, placement: pin.SE3 | Array | None) -> pin.SE3:
    if placement is None:
        return pin.SE3.Identity()
    matrix = placement.homogeneous if isinstance(placement, pin.SE3) else numbers(f"placement of contact {name!r}", placement)
    R = matrix[:3, :3] if matrix.shape == (4, 4) else np.zeros((3, 3))
    if not is_finite(matrix) or np.abs(R @ R.T - np.eye(3)).max() > 1e-6 or np.linalg.det(R) < 0.0:
        raise InputError(f"placement of contact {name!r} is no rigid placement; expected pin.SE3 or a 4 x 4 matrix.")
    return pin.SE3(R, matrix[:3, 3])
