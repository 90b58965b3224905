"""Force sets of patches, edges and points on several planes: what forces of one set at each of their corners make."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from rbd.arrays import Array, as_array, as_finite, as_float, block_diagonal, cross_matrix, is_finite, lazy, locked
from rbd.errors import InputError, NoSolution
from rbd.problem.cones import HALF_LINE, Cone, FrictionCone, Part, check_friction, checked_generators, pushed_out, pyramid
from rbd.problem.programs import nonnegative


class _AtCorners(Cone):
    """What forces of one set at each of k corners make: `corners` (k, 3), `corner_map` (dim, 3k) and the set `mu`."""

    keeps_position = True
    if TYPE_CHECKING:
        mu: float | Cone
        facets: int

        @property
        def corners(self) -> Array: ...
        @property
        def corner_map(self) -> Array: ...

    @lazy
    def point(self) -> Cone:
        """The set of one corner's force."""
        return self.mu if isinstance(self.mu, Cone) else FrictionCone(self.mu, self.facets)

    @lazy
    def at_points(self) -> Array:
        """The corners' forces, shape (3k, p); without friction of normal forces alone."""
        G = np.eye(3)[:, 2:] if not self.mu else checked_generators(self.point)[0]
        return np.kron(np.eye(len(self.corners)), G)

    def generators(self) -> tuple[Array, tuple[Part, ...]]:
        """The corner map, and the parts of each corner; without friction, its normal columns and half-lines."""
        parts = (HALF_LINE,) if not self.mu else checked_generators(self.point)[1]
        return self.corner_map @ self.at_points, parts * len(self.corners)

    def project(self, force: Array) -> Array:
        """The nearest row forces of the corners' pyramids (not of the true cones), by nonnegative least squares.

        Newtons and newton metres have the same weight. Of other sets at the corners as of `Cone`.
        """
        if not isinstance(self.point, FrictionCone):
            return super().project(force)
        G = self.corner_map @ block_diagonal([pyramid(self.point.mu, self.facets)] * len(self.corners))
        weights = nonnegative(G, force)
        if weights is None:
            raise NoSolution(f"the wrench nearest to {np.array2string(force, precision=4):.200} in the cone was not found.")
        return np.asarray(G @ weights)

    def inward(self, velocity: Array) -> Array:
        """W x (w x p) of each corner p of a patch that turns with w."""
        w = self._turn(velocity)
        return np.asarray(self.at_points.T @ np.cross(w, np.cross(w, self.corners)).ravel())

    def _turn(self, velocity: Array) -> Array:
        return velocity[3:]

    def feedback(self, u: Array, e: Array | None) -> Array:
        """Along the normal alone, by the corner that asks for least."""
        normals = self.corner_map[:, 2::3]  # their transpose maps rows to the corners' normals
        out = np.zeros(self.dim)
        out[2] = pushed_out(normals.T @ u, None if e is None else normals.T @ e).max()
        return out


@dataclass(frozen=True, eq=False)
class WrenchCone(_AtCorners):
    """Force set of a patch: wrenches about its centre that forces in friction cones at its corners can make.

    Corner force p_i at corner c_i gives force p_i and moment c_i x p_i; all in contact axes.

    Args:
        corners: Corner points from the patch's centre, shape (k, 3) [m].
        mu: Friction coefficient, 0 leaves the normal components only; or the set of each corner's force, of dimension 3.
        facets: Facets of each corner's pyramid in the QP.

    Example:
        >>> sole = rbd.problem.WrenchCone([(0.1, 0.05, 0.0), (0.1, -0.05, 0.0), (-0.1, -0.05, 0.0), (-0.1, 0.05, 0.0)], 0.5)
        >>> balanced, tipping = np.array([0, 0, 10.0, 0, 0.5, 0]), np.array([0, 0, 10.0, 0, 2.0, 0])
        >>> [np.allclose(sole.project(wrench), wrench) for wrench in (balanced, tipping)]  # 10 N at 5 cm, or at 20 cm
        [True, False]
    """

    dim = 6
    corners: Array
    mu: float | Cone
    facets: int = 4

    def __post_init__(self) -> None:
        _check_point(self.mu, self.facets)
        corners = as_array("corners of a WrenchCone", self.corners)
        if corners.ndim != 2 or corners.shape[1] != 3 or not len(corners) or not is_finite(corners):
            raise InputError(f"corners of a WrenchCone have shape {corners.shape}; expected (k, 3) finite numbers.")
        object.__setattr__(self, "corners", locked(corners))  # rays and parts are cached for the life of the set

    @lazy
    def corner_map(self) -> Array:
        """The wrench of stacked corner forces, shape (6, 3k); its transpose maps a twist rate to corner accelerations."""
        return np.hstack([np.vstack([np.eye(3), cross_matrix(c)]) for c in self.corners])


@dataclass(frozen=True)
class LineCone(_AtCorners):
    """Force set of an edge: the wrenches that forces in friction cones at the two ends of a line can make.

    The line is along the contact's x axis. Components (fx, fy, fz, moment about y, moment about z), about its middle:
    a line transmits no moment about its own axis.

    Args:
        half_length: Half of the line's length [m].
        mu: Friction coefficient, 0 leaves the normal components only; or the set of each end's force, of dimension 3.
        facets: Facets of each end's pyramid in the QP.

    Example:
        >>> edge = rbd.problem.LineCone(0.1, 0.5)
        >>> balanced, tipping = np.array([0, 0, 10.0, 0.5, 0]), np.array([0, 0, 10.0, 2.0, 0])
        >>> [np.allclose(edge.project(wrench), wrench) for wrench in (balanced, tipping)]  # 10 N at 5 cm, or at 20 cm
        [True, False]
    """

    dim = 5
    half_length: float
    mu: float | Cone
    facets: int = 4

    def __post_init__(self) -> None:
        _check_point(self.mu, self.facets)
        if not 0.0 < as_float(self.half_length) < 1e100:
            raise InputError(f"half_length of a LineCone is {self.half_length!r:.80}; expected a length > 0 [m].")

    @property
    def corners(self) -> Array:
        """The two ends from the middle, in contact axes, shape (2, 3) [m]."""
        return np.array([[self.half_length, 0.0, 0.0], [-self.half_length, 0.0, 0.0]])

    @property
    def corner_map(self) -> Array:
        """The row forces of stacked end forces, shape (5, 6)."""
        return np.delete(WrenchCone(self.corners, 0.0).corner_map, 3, axis=0)

    def _turn(self, velocity: Array) -> Array:
        """A line's turns about itself leave its points in place, and its rows are accelerations of its direction."""
        return np.array([0.0, velocity[3], velocity[4]])


@dataclass(frozen=True, eq=False)
class UnevenCone(_AtCorners):
    """Force set of a contact that rests on planes of different normals, as a sole on a tread and a ramp.

    Corner i is at c_i and has its own axes R_i (tangent, tangent, normal). Its force p_i, in these, is in a friction cone, and
    gives force R_i p_i and moment c_i x R_i p_i; all in contact axes.

    Args:
        corners: Corner points from the contact's centre, shape (k, 3) [m].
        axes: R_i, from each corner's axes to the contact's, shape (k, 3, 3).
        mu: Friction coefficient, 0 leaves the normal components only; or the set of each corner's force, of dimension 3.
        facets: Facets of each corner's pyramid in the QP.
        dim: Number of row forces: 6 of a patch; 5 of an edge along x, without the moment about it; 3 of a point.

    Example:
        >>> c, s = np.cos(0.2), np.sin(0.2)  # a valley of two planes, each 0.2 rad steep
        >>> valley = [[[c, 0, s], [0, 1, 0], [-s, 0, c]], [[c, 0, -s], [0, 1, 0], [s, 0, c]]]
        >>> ball = rbd.problem.UnevenCone(np.zeros((2, 3)), valley, 0.0, dim=3)
        >>> ball.project(np.array([0.0, 0.0, 10.0])).round(6), ball.project(np.array([10.0, 0.0, 0.0])).round(3)
        (array([ 0.,  0., 10.]), array([0.395, 0.   , 1.947]))
    """

    corners: Array
    axes: Array
    mu: float | Cone
    facets: int = 4
    dim: int = 6

    def __post_init__(self) -> None:
        _check_point(self.mu, self.facets)
        if as_float(self.dim) not in _KEPT:
            raise InputError(f"dim of an UnevenCone is {self.dim!r:.80}; expected 6 of a patch, 5 of an edge, 3 of a point.")
        corners = as_finite("corners of an UnevenCone", self.corners, ("k", 3))
        axes = as_finite("axes of an UnevenCone", self.axes, (len(corners), 3, 3))
        if not len(corners) or np.abs(axes @ axes.transpose(0, 2, 1) - np.eye(3)).max() > 1e-9:
            raise InputError(f"axes of an UnevenCone are of {len(corners)} corners; expected a rotation matrix of each.")
        self.__dict__.update(corners=locked(corners), axes=locked(axes), dim=int(self.dim))

    @lazy
    def corner_map(self) -> Array:
        """The row forces of stacked corner forces, shape (dim, 3k)."""
        kept, each = _KEPT[self.dim], zip(self.corners, self.axes, strict=True)
        return np.hstack([np.vstack([R, cross_matrix(c) @ R])[kept] for c, R in each])

    def inward(self, velocity: Array) -> Array:
        """W x (w x c) of each corner, in its axes."""
        w = np.concatenate([np.zeros(6 - self.dim), velocity[3:]])
        towards = np.cross(w, np.cross(w, self.corners))
        return np.asarray(self.at_points.T @ np.einsum("kji,kj->ki", self.axes, towards).ravel())


_KEPT = {6: np.arange(6), 5: np.array([0, 1, 2, 4, 5]), 3: np.arange(3)}
"""Which of the six components of a wrench are row forces."""


def _check_point(mu: float | Cone, facets: int) -> None:
    if not isinstance(mu, Cone):
        check_friction(mu, facets)
    elif mu.dim != 3:
        raise InputError(f"the set of a corner's force has dimension {mu.dim}; expected 3 (tangent, tangent, normal).")
