"""Force cones K of constraints, and their generators.

A cone K here is any closed convex set of forces in contact axes (tangent, tangent, normal): a whole space, a half-line, a
friction cone, an interval. Every K is the image K = G P of a product P of simple *parts* (line, half-line, interval,
second-order cone): `generators` gives (G, parts). `rbd.problem.force_set` stacks them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np

from rbd.arrays import Array, as_array, as_float, block_diagonal, cross_matrix, is_finite, lazy
from rbd.displayed import Displayed
from rbd.errors import InputError, NoSolution
from rbd.problem.programs import nonnegative


@dataclass(frozen=True)
class Line:
    """The whole real line: a component that pulls and pushes."""

    dim: int = 1


@dataclass(frozen=True)
class HalfLine:
    """The numbers >= 0: a component that only pushes."""

    dim: int = 1


@dataclass(frozen=True)
class Interval:
    """The numbers from `lo` to `hi`."""

    lo: float
    hi: float
    dim: int = 1


@dataclass(frozen=True)
class SecondOrderCone:
    """Forces (tangent, tangent, normal) with |f_t| <= mu f_n; `facets`: of the pyramid that may replace it."""

    mu: float
    facets: int = 4
    dim: int = 3


Part: TypeAlias = Line | HalfLine | Interval | SecondOrderCone


class Cone(Protocol):
    """A closed convex set of forces; hashable, so that its rays are computed once."""

    @property
    def dim(self) -> int:
        """Number of force components."""

    def project(self, force: Array) -> Array:
        """The nearest force in the set, shape (dim,), in the Euclidean norm of the components as given."""

    def generators(self) -> tuple[Array, tuple[Part, ...]]:
        """(G, parts): the set is G times the product of the parts; G has shape (dim, sum of the parts' dims)."""

    def __hash__(self) -> int: ...


@dataclass(frozen=True)
class Free(Displayed):
    """Force set of a bilateral constraint of `dim` rows: all of R^dim.

    Example:
        >>> hinge = rbd.problem.Free(2)
        >>> hinge.project(np.array([3.5, -1.0]))
        array([ 3.5, -1. ])
    """

    dim: int

    def __post_init__(self) -> None:
        _check_dim(self.dim)

    def project(self, force: Array) -> Array:
        """The force itself."""
        return force

    def generators(self) -> tuple[Array, tuple[Part, ...]]:
        """Identity and lines."""
        return np.eye(self.dim), (Line(),) * self.dim


@dataclass(frozen=True)
class NonNegative(Displayed):
    """Force set of `dim` rows that only push, e.g. of a joint limit: every component >= 0.

    Example:
        >>> rbd.problem.NonNegative(2).project(np.array([3.0, -1.0]))
        array([3., 0.])
    """

    dim: int = 1

    def __post_init__(self) -> None:
        _check_dim(self.dim)

    def project(self, force: Array) -> Array:
        """Negative components become zero."""
        return np.maximum(force, 0.0)

    def generators(self) -> tuple[Array, tuple[Part, ...]]:
        """Identity and half-lines."""
        return np.eye(self.dim), (HalfLine(),) * self.dim


@dataclass(frozen=True)
class FrictionCone(Displayed):
    """Force set of a contact with Coulomb friction: `|f_t| <= mu f_n` on (tangent, tangent, normal).

    Solvers with true cones use it as it is; the QP uses its circumscribed pyramid of `facets` facets.

    Example:
        >>> cone = rbd.problem.FrictionCone(0.5)
        >>> cone.project(np.array([1.0, 0.0, 1.0])), cone.project(np.array([0.0, 0.0, -1.0]))
        (array([0.6, 0. , 1.2]), array([0., 0., 0.]))
    """

    mu: float
    facets: int = 4

    def __post_init__(self) -> None:
        check_friction(self.mu, self.facets)

    @property
    def dim(self) -> int:
        """Three."""
        return 3

    def project(self, force: Array) -> Array:
        """The nearest force in the true (circular) cone; closed form."""
        return np.asarray(project_cones(np.asarray(force, float)[None], np.array([self.mu]))[0])

    def generators(self) -> tuple[Array, tuple[Part, ...]]:
        """Identity and one second-order cone."""
        return np.eye(3), (SecondOrderCone(self.mu, self.facets),)


@dataclass(frozen=True, eq=False)
class Box(Displayed):
    """Force set between bounds `lo` and `hi`, shape (dim,) [N, N m], e.g. of dry friction in a joint.

    Example:
        >>> dry = rbd.problem.Box([-2.0], [2.0])
        >>> dry.project(np.array([3.5]))
        array([2.])
    """

    lo: Array
    hi: Array

    def __post_init__(self) -> None:
        lo, hi = np.atleast_1d(as_array("lo of a Box", self.lo)), np.atleast_1d(as_array("hi of a Box", self.hi))
        if lo.shape != hi.shape or lo.ndim != 1 or not ((lo <= hi) & (lo < np.inf) & (hi > -np.inf)).all():
            raise InputError(f"Box wants lo <= hi of one length, got lo = {self.lo!r:.80}, hi = {self.hi!r:.80}.")
        lo.flags.writeable = hi.flags.writeable = False  # rays and parts are cached for the life of the set
        object.__setattr__(self, "lo", lo)
        object.__setattr__(self, "hi", hi)

    @property
    def dim(self) -> int:
        """Number of bounded components."""
        return len(self.lo)

    def project(self, force: Array) -> Array:
        """Each component clipped."""
        return np.clip(force, self.lo, self.hi)

    def generators(self) -> tuple[Array, tuple[Part, ...]]:
        """Identity and intervals."""
        return np.eye(self.dim), tuple(Interval(float(a), float(b)) for a, b in zip(self.lo, self.hi, strict=True))


@dataclass(frozen=True, eq=False)
class WrenchCone(Displayed):
    """Force set of a patch: wrenches about its centre that forces in friction cones at its corners can make.

    Corner force p_i at corner c_i gives force p_i and moment c_i x p_i; all in contact axes.

    Args:
        corners: Corner points from the patch's centre, shape (k, 3) [m].
        mu: Friction coefficient; 0 leaves the normal components only.
        facets: Facets of each corner's pyramid in the QP.

    Example:
        >>> sole = rbd.problem.WrenchCone([(0.1, 0.05, 0.0), (0.1, -0.05, 0.0), (-0.1, -0.05, 0.0), (-0.1, 0.05, 0.0)], 0.5)
        >>> balanced, tipping = np.array([0, 0, 10.0, 0, 0.5, 0]), np.array([0, 0, 10.0, 0, 2.0, 0])
        >>> [np.allclose(sole.project(wrench), wrench) for wrench in (balanced, tipping)]  # 10 N at 5 cm, or at 20 cm
        [True, False]
    """

    corners: Array
    mu: float
    facets: int = 4

    def __post_init__(self) -> None:
        check_friction(self.mu, self.facets)
        corners = as_array("corners of a WrenchCone", self.corners)
        if corners.ndim != 2 or corners.shape[1] != 3 or not len(corners) or not is_finite(corners):
            raise InputError(f"corners of a WrenchCone have shape {corners.shape}; expected (k, 3) finite numbers.")
        corners.flags.writeable = False  # rays and parts are cached for the life of the set
        object.__setattr__(self, "corners", corners)

    @property
    def dim(self) -> int:
        """Six."""
        return 6

    @lazy
    def corner_map(self) -> Array:
        """The wrench of stacked corner forces, shape (6, 3k); its transpose maps a twist rate to corner accelerations."""
        return np.hstack([np.vstack([np.eye(3), cross_matrix(c)]) for c in self.corners])

    def project(self, force: Array) -> Array:
        """The nearest wrench of the corner pyramids (not of the true cones), by nonnegative least squares.

        Newtons and newton metres have the same weight.
        """
        return _nearest_of_corners(self, force)

    def generators(self) -> tuple[Array, tuple[Part, ...]]:
        """The corner map and one second-order cone a corner; without friction, its normal columns and half-lines."""
        return _of_corners(self)


@dataclass(frozen=True)
class LineCone(Displayed):
    """Force set of an edge: the wrenches that forces in friction cones at the two ends of a line can make.

    The line is along the contact's x axis. Components (fx, fy, fz, moment about y, moment about z), about its middle:
    a line transmits no moment about its own axis.

    Args:
        half_length: Half of the line's length [m].
        mu: Friction coefficient; 0 leaves the normal components only.
        facets: Facets of each end's pyramid in the QP.

    Example:
        >>> edge = rbd.problem.LineCone(0.1, 0.5)
        >>> balanced, tipping = np.array([0, 0, 10.0, 0.5, 0]), np.array([0, 0, 10.0, 2.0, 0])
        >>> [np.allclose(edge.project(wrench), wrench) for wrench in (balanced, tipping)]  # 10 N at 5 cm, or at 20 cm
        [True, False]
    """

    half_length: float
    mu: float
    facets: int = 4

    def __post_init__(self) -> None:
        check_friction(self.mu, self.facets)
        if not 0.0 < as_float(self.half_length) < 1e100:
            raise InputError(f"half_length of a LineCone is {self.half_length!r:.80}; expected a length > 0 [m].")

    @property
    def dim(self) -> int:
        """Five."""
        return 5

    @property
    def corners(self) -> Array:
        """The two ends from the middle, in contact axes, shape (2, 3) [m]."""
        return np.array([[self.half_length, 0.0, 0.0], [-self.half_length, 0.0, 0.0]])

    @property
    def corner_map(self) -> Array:
        """The row forces of stacked end forces, shape (5, 6)."""
        return np.delete(WrenchCone(self.corners, self.mu).corner_map, 3, axis=0)

    def project(self, force: Array) -> Array:
        """The nearest row forces of the end pyramids (not of the true cones), by nonnegative least squares."""
        return _nearest_of_corners(self, force)

    def generators(self) -> tuple[Array, tuple[Part, ...]]:
        """The map of the ends and a second-order cone an end; without friction, its normal columns and half-lines."""
        return _of_corners(self)


def _of_corners(cone: WrenchCone | LineCone) -> tuple[Array, tuple[Part, ...]]:
    k = len(cone.corners)
    if cone.mu == 0.0:
        return cone.corner_map[:, 2::3], (HalfLine(),) * k
    return cone.corner_map, (SecondOrderCone(cone.mu, cone.facets),) * k


def _nearest_of_corners(cone: WrenchCone | LineCone, force: Array) -> Array:
    G = cone.corner_map @ block_diagonal([pyramid(cone.mu, cone.facets)] * len(cone.corners))
    weights = nonnegative(G, force)
    if weights is None:
        raise NoSolution(f"the wrench nearest to {np.array2string(force, precision=4):.200} in the cone was not found.")
    return G @ weights


@dataclass(frozen=True)
class Product(Displayed):
    """Cartesian product of several force sets `cones`, their components stacked.

    Example:
        >>> both = rbd.problem.Product([rbd.problem.FrictionCone(0.5), rbd.problem.NonNegative(1)])
        >>> both.dim, both.project(np.array([1.0, 0.0, 1.0, -2.0]))
        (4, array([0.6, 0. , 1.2, 0. ]))
    """

    cones: tuple[Cone, ...]

    def __init__(self, cones: Sequence[Cone]) -> None:
        try:
            members = tuple(cones)
        except TypeError:
            raise InputError(f"Product wants several sets, got {cones!r:.80}.") from None
        for cone in members:
            if isinstance(cone, type) or not (hasattr(cone, "dim") and hasattr(cone, "generators")):
                raise InputError(
                    f"{cone!r:.80} is no set of forces; expected e.g. rbd.problem.Free(3) or rbd.problem.FrictionCone(0.7)."
                )
        object.__setattr__(self, "cones", members)

    @property
    def dim(self) -> int:
        """Sum of the members' dimensions."""
        return sum(c.dim for c in self.cones)

    def project(self, force: Array) -> Array:
        """The projections onto the members, stacked."""
        ends = np.cumsum([c.dim for c in self.cones])[:-1]
        return np.concatenate([c.project(f) for c, f in zip(self.cones, np.split(force, ends), strict=True)])

    def generators(self) -> tuple[Array, tuple[Part, ...]]:
        """Block-diagonal G; the members' parts in order."""
        blocks = [c.generators() for c in self.cones]
        return block_diagonal([g for g, _ in blocks]), tuple(part for _, parts in blocks for part in parts)


def pyramid(mu: float, facets: int, *, inscribed: bool = False) -> Array:
    """Rays of the friction pyramid as columns (tangent, tangent, 1), shape (3, facets)."""
    angle = (2 * np.arange(facets) + 1) * math.pi / facets
    radius = mu if inscribed else mu / math.cos(math.pi / facets)
    return np.vstack([radius * np.cos(angle), radius * np.sin(angle), np.ones(facets)])


def _check_dim(dim: int) -> None:
    if isinstance(dim, bool) or not isinstance(dim, int | np.integer) or not 0 <= dim <= 100_000:
        raise InputError(f"the dimension of a set is {dim!r:.80}; expected a whole number from 0 to 100,000.")


def check_friction(mu: float, facets: int) -> None:
    """Refuse a friction coefficient or a facet count that is not valid.

    Raises:
        InputError: if mu is negative, infinite or not a number, or facets is not a whole number >= 3.
    """
    if not 0.0 <= as_float(mu) < 1e100:
        raise InputError(f"friction is {mu!r:.80}; expected a finite number >= 0, or None for a bilateral contact.")
    if isinstance(facets, bool) or not isinstance(facets, int | np.integer) or not 3 <= facets <= 1000:
        raise InputError(f"facets is {facets!r:.80}; expected a whole number from 3 to 1000 (4 is usual).")


def project_cones(W: Array, mu: Array) -> Array:
    """The nearest points of the cones |w_t| <= mu w_n to the rows of W, shape (k, 3)."""
    return _project(W, mu, np.ones(1))


def project_dual_cones(W: Array, mu: Array) -> Array:
    """The nearest points of their dual cones, mu |w_t| <= w_n, to the rows of W, shape (k, 3)."""
    return _project(W, np.ones(1), mu)


def _project(W: Array, s: Array, r: Array) -> Array:
    """Nearest points of the cones r |w_t| <= s w_n."""
    t, n = np.hypot(W[:, 0], W[:, 1]), W[:, 2]
    inside = r * t <= s * n
    if inside.all():
        return W
    polar = s * t <= -r * n
    size: Array = s * s + r * r
    along = (s * t + r * n) / size  # length along the edge (s, r)
    scale = np.where(t > 0.0, s * along / np.where(t > 0.0, t, 1.0), 0.0)
    edge = np.column_stack([scale * W[:, 0], scale * W[:, 1], r * along])
    return np.where(inside[:, None], W, np.where(polar[:, None], 0.0, edge))
