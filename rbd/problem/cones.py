"""Force cones K of constraints, and their generators.

A cone K here is any closed convex set of forces in contact axes (tangent, tangent, normal): a whole space, a half-line, a
friction cone, an interval. Every K is the image K = G P of a product P of simple *parts* (line, half-line, interval,
second-order cone): `generators` gives (G, parts). `rbd.problem.force_set` stacks them. All else that is asked of a set follows
from these two, and is a member of `Cone` that a set may answer itself: a new set is one class.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, ClassVar, NamedTuple, TypeAlias

import numpy as np

from rbd.arrays import Array, as_array, as_finite, as_float, block_diagonal, locked
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.errors.inputs import check_kind, listed_items


@dataclass(frozen=True)
class Interval:
    """The numbers from `lo` to `hi`: without ends a line, from zero on a half-line."""

    lo: float = -math.inf
    hi: float = math.inf
    dim: ClassVar[int] = 1
    mu: ClassVar[float] = 0.0
    facets: ClassVar[int] = 0

    def alone(self) -> Cone:
        """As a set."""
        if self in (LINE, HALF_LINE):
            return Free(1) if self == LINE else NonNegative(1)
        return Bounds(np.array([self.lo]), np.array([self.hi]))


LINE, HALF_LINE = Interval(), Interval(0.0)
"""A component that pulls and pushes, and one that only pushes."""


@dataclass(frozen=True)
class SecondOrderCone:
    """Forces (tangent, tangent, normal) with |f_t| <= mu f_n; `facets`: of the pyramid that may replace it."""

    mu: float
    facets: int = 4
    dim: int = 3

    def alone(self) -> Cone:
        """As a set."""
        return FrictionCone(self.mu, self.facets)


Part: TypeAlias = Interval | SecondOrderCone


class Cone(Displayed):
    """A closed convex set of forces: what a new one inherits from, with `dim` and `generators` of its own.

    Sets are hashable and never change, so that what follows from them is computed once. A set of half-lines alone is a
    polyhedron; a point whose set it is may stick or break, and is refused where it already slides.

    Attributes:
        dim: Number of force components.

    Example:
        >>> class SuctionCup(rbd.problem.Cone):
        ...     dim = 3  # 20 N of vacuum on (tangent, tangent, normal): |f_t| <= 0.5 (f_n + 20)
        ...
        ...     def generators(self):
        ...         cone, parts = rbd.problem.FrictionCone(0.5).generators()
        ...         return np.column_stack([cone, [0.0, 0.0, -1.0]]), (*parts, rbd.problem.cones.Interval(20.0, 20.0))
        >>> box = rbd.testing.box(mass=1.0)
        >>> ceiling = rbd.Ground(normal=(0.0, 0.0, -1.0))
        >>> cup = rbd.PointContact("cup", "box", offset=(0.0, 0.0, 0.5), friction=SuctionCup(), on=ceiling)
        >>> held = rbd.solve(rbd.State(box, [0, 0, 0, 0, 0, 0, 1]), [], [cup])  # it hangs from the ceiling
        >>> held.forces["cup"].round(6)
        array([0.  , 0.  , 9.81])
    """

    if TYPE_CHECKING:

        @property
        def dim(self) -> int:
            """Number of force components."""

    bilateral: ClassVar[bool] = False
    """Whether it is all of R^dim: a constraint that holds whatever force that takes."""
    bounded: ClassVar[bool] = False
    """Whether it resists motion in either direction, and has no position to return to, as dry friction."""
    one_sided: ClassVar[bool] = False
    """Whether each component pushes in one direction alone."""
    separate: ClassVar[bool] = False
    """Whether its components are those of separate points, one behind the other."""
    keeps_position: ClassVar[bool] = False
    """Whether feedback of a position error means something (`feedback`)."""

    def generators(self) -> tuple[Array, tuple[Part, ...]]:
        """(G, parts): the set is G times the product of the parts; G has shape (dim, sum of the parts' dims)."""
        raise NotImplementedError

    def project(self, force: Array) -> Array:
        """The nearest force in the set, shape (dim,), in the Euclidean norm of the components as given.

        Here by projected gradients on the weights of the parts, to about nine digits; sets with a closed form have their own.
        """
        G, parts = self.generators()
        return np.asarray(G @ nearest_weights(G, force, lambda w: _of_parts(parts, w), 5000))

    @property
    def at_points(self) -> Array | None:
        """Forces (tangent, tangent, normal) at points that weights of the parts make, shape (3k, p); None: not at points.

        Of three components it is G itself: the set of one point.
        """
        return self.generators()[0] if self.dim == 3 and not self.bilateral else None

    def inward(self, velocity: Array) -> Array:
        """What G^T J_dot v lacks of its points' accelerations, shape (p,): centripetal ones of a patch that turns."""
        return np.zeros(self.generators()[0].shape[1])

    def feedback(self, u: Array, e: Array | None) -> Array:
        """What feedback of velocity u and position error e (None: there is none) may ask for, shape (dim,); here nothing."""
        return np.zeros(self.dim)

    def friction_used(self, force: Array) -> float | None:
        """Share of friction that a force (3,) with a load uses; None if the set does not say."""
        return None

    def rim(self) -> Array:
        """Forces on the boundary at a unit normal force, in order around it, shape (n, 3), for pictures; none if unknown."""
        turn = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
        points, (_, parts) = self.at_points, self.generators()
        mu, first = (parts[0].mu, parts[0].dim) if parts else (0.0, 0)
        if points is None or len(points) != 3 or not mu:
            return np.zeros((0, 3))
        found = np.column_stack([mu * np.cos(turn), mu * np.sin(turn), np.ones(48)]) @ points[:, :first].T
        return found[found[:, 2] > 0.0]


def nearest_weights(G: Array, force: Array, project: Callable[[Array], Array], steps: int) -> Array:
    """Weights in a convex set with G w nearest to a force, by accelerated projected gradients; slow and approximate.

    Args:
        G: Shape (m, p).
        force: Shape (m,).
        project: Gives the nearest weights in the set.
        steps: How many at most.
    """
    step = 1.0 / max(float(np.linalg.norm(G, 2)) ** 2, 1e-300)
    w = ahead = project(np.linalg.lstsq(G, force, rcond=None)[0])
    for i in range(steps):
        new = project(ahead - step * (G.T @ (G @ ahead - force)))
        if np.abs(new - w).max(initial=0.0) <= 1e-15 * np.abs(new).max(initial=1.0):
            break
        w, ahead = new, new + i / (i + 3.0) * (new - w)
    return w


@lru_cache(maxsize=512)
def checked_generators(cone: Cone) -> tuple[Array, tuple[Part, ...]]:
    """(G, parts) of a set, whose class may be a user's.

    Raises:
        InputError: parts that are none, a G of another shape or with numbers that are not finite.
    """
    kind = type(cone).__name__
    G, parts = cone.generators()
    if odd := [part for part in parts if not isinstance(part, Part)]:
        raise InputError(
            f"{kind}.generators() gives a part {odd[0]!r:.80}; expected Interval, LINE, HALF_LINE or SecondOrderCone of "
            "rbd.problem.cones. The parts of another set are the second of its own generators()."
        )
    return as_finite(f"G of {kind}.generators()", G, (cone.dim, sum(part.dim for part in parts))), parts


def _of_parts(parts: Sequence[Part], w: Array) -> Array:
    """The nearest weights in the product of parts."""
    ends = np.cumsum([part.dim for part in parts])[:-1]
    return np.concatenate([part.alone().project(x) for part, x in zip(parts, np.split(w, ends), strict=True)])


@dataclass(frozen=True)
class Free(Cone):
    """Force set of a bilateral constraint of `dim` rows: all of R^dim.

    Example:
        >>> hinge = rbd.problem.Free(2)
        >>> hinge.project(np.array([3.5, -1.0]))
        array([ 3.5, -1. ])
    """

    bilateral = True
    keeps_position = True
    dim: int

    def __post_init__(self) -> None:
        _check_dim(self.dim)

    def project(self, force: Array) -> Array:
        """The force itself."""
        return force

    def generators(self) -> tuple[Array, tuple[Part, ...]]:
        """Identity and lines."""
        return np.eye(self.dim), (LINE,) * self.dim

    def feedback(self, u: Array, e: Array | None) -> Array:
        """All of it."""
        return u.copy() if e is None else u + e


@dataclass(frozen=True)
class NonNegative(Cone):
    """Force set of `dim` rows that only push, e.g. of a joint limit: every component >= 0.

    Example:
        >>> rbd.problem.NonNegative(2).project(np.array([3.0, -1.0]))
        array([3., 0.])
    """

    one_sided = True
    separate = True
    keeps_position = True
    dim: int = 1

    def __post_init__(self) -> None:
        _check_dim(self.dim)

    def project(self, force: Array) -> Array:
        """Negative components become zero."""
        return np.maximum(force, 0.0)

    def generators(self) -> tuple[Array, tuple[Part, ...]]:
        """Identity and half-lines."""
        return np.eye(self.dim), (HALF_LINE,) * self.dim

    @property
    def at_points(self) -> Array:
        """Its components are the normal forces of points."""
        return np.kron(np.eye(self.dim), [[0.0], [0.0], [1.0]])

    def feedback(self, u: Array, e: Array | None) -> Array:
        """What pushes out; nothing where there still is a gap."""
        return pushed_out(u, e)


class _AtAPoint(Cone):
    """What the sets of a point's forces (tangent, tangent, normal) have in common: feedback is along the normal alone."""

    keeps_position = True
    dim = 3

    def feedback(self, u: Array, e: Array | None) -> Array:
        """Along the normal alone."""
        return np.append(np.zeros(2), pushed_out(u[2:], None if e is None else e[2:]))


@dataclass(frozen=True)
class FrictionCone(_AtAPoint):
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

    def project(self, force: Array) -> Array:
        """The nearest force in the true (circular) cone; closed form."""
        return project_cones(np.asarray(force, float), self.mu)

    def generators(self) -> tuple[Array, tuple[Part, ...]]:
        """Identity and one second-order cone."""
        return np.eye(3), (SecondOrderCone(self.mu, self.facets),)

    def friction_used(self, force: Array) -> float | None:
        """|f_t| / (mu f_n)."""
        return friction_used(self.mu, force)


@dataclass(frozen=True)
class EllipticCone(_AtAPoint):
    """Force set of a contact whose friction differs along the tangents: `|(f_x / mu_x, f_y / mu_y)| <= f_n`.

    It is FrictionCone(mu_x) if both are alike. Under Coulomb's law friction takes the most power from a point that slides: the
    force is along -(mu_x^2 v_x, mu_y^2 v_y), in general not against the velocity.

    Args:
        mu_x: Friction coefficient along the contact's first axis.
        mu_y: Along the second one.
        facets: Facets of the pyramid that replaces it in the QP.

    Example:
        >>> ice_skate = rbd.problem.EllipticCone(0.02, 0.8)
        >>> ice_skate.friction_used(np.array([1.0, 0.0, 100.0])), ice_skate.friction_used(np.array([0.0, 40.0, 100.0]))
        (0.5, 0.5)
    """

    mu_x: float
    mu_y: float
    facets: int = 4

    def __post_init__(self) -> None:
        for mu in (self.mu_x, self.mu_y):
            check_friction(mu, self.facets)
            if not mu:
                raise InputError(f"EllipticCone has the coefficients {self.mu_x!r}, {self.mu_y!r}; both are to be above zero.")

    def generators(self) -> tuple[Array, tuple[Part, ...]]:
        """The larger coefficient's cone, one of its axes shortened."""
        mu = max(self.mu_x, self.mu_y)
        return np.diag([self.mu_x / mu, self.mu_y / mu, 1.0]), (SecondOrderCone(mu, self.facets),)

    def friction_used(self, force: Array) -> float | None:
        """|(f_x / mu_x, f_y / mu_y)| / f_n."""
        return math.hypot(force[0] / self.mu_x, force[1] / self.mu_y) / float(force[2])


@dataclass(frozen=True, eq=False)
class Bounds(Cone):
    """Force set between bounds `lo` and `hi`, shape (dim,) [N, N m], e.g. of dry friction in a joint.

    Example:
        >>> dry = rbd.problem.Bounds([-2.0], [2.0])
        >>> dry.project(np.array([3.5]))
        array([2.])
    """

    bounded = True
    lo: Array
    hi: Array

    def __post_init__(self) -> None:
        lo, hi = np.atleast_1d(as_array("lo of a Box", self.lo)), np.atleast_1d(as_array("hi of a Box", self.hi))
        if lo.shape != hi.shape or lo.ndim != 1 or not ((lo <= hi) & (lo < np.inf) & (hi > -np.inf)).all():
            raise InputError(f"Box wants lo <= hi of one length, got lo = {self.lo!r:.80}, hi = {self.hi!r:.80}.")
        object.__setattr__(self, "lo", locked(lo))  # rays and parts are cached for the life of the set
        object.__setattr__(self, "hi", locked(hi))

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


@dataclass(frozen=True)
class Product(Cone):
    """Cartesian product of several force sets `cones`, their components stacked.

    Example:
        >>> both = rbd.problem.Product([rbd.problem.FrictionCone(0.5), rbd.problem.NonNegative(1)])
        >>> both.dim, both.project(np.array([1.0, 0.0, 1.0, -2.0]))
        (4, array([0.6, 0. , 1.2, 0. ]))
    """

    separate = True
    cones: tuple[Cone, ...]

    def __init__(self, cones: Sequence[Cone]) -> None:
        members = tuple(listed_items("cones of Product", cones, "several sets"))
        for cone in members:
            expected = "a set of forces, e.g. rbd.problem.Free(3) or rbd.problem.FrictionCone(0.7)"
            check_kind("a member of Product", cone, Cone, expected)
        object.__setattr__(self, "cones", members)

    @property
    def dim(self) -> int:
        """Sum of the members' dimensions."""
        return sum(c.dim for c in self.cones)

    def project(self, force: Array) -> Array:
        """The projections onto the members, stacked."""
        return np.concatenate([c.project(f) for c, f in self._split(force)])

    def generators(self) -> tuple[Array, tuple[Part, ...]]:
        """Block-diagonal G; the members' parts in order."""
        blocks = [c.generators() for c in self.cones]
        return block_diagonal([g for g, _ in blocks]), tuple(part for _, parts in blocks for part in parts)

    @property
    def at_points(self) -> Array | None:
        """Those of the members, if each has some."""
        maps = [c.at_points for c in self.cones]
        return block_diagonal([x for x in maps if x is not None]) if maps and all(x is not None for x in maps) else None

    @property
    def keeps_position(self) -> bool:  # type: ignore[override]
        """Whether feedback of some member's position error means something."""
        return any(c.keeps_position for c in self.cones)

    def inward(self, velocity: Array) -> Array:
        """Those of the members."""
        return np.concatenate([c.inward(u) for c, u in self._split(velocity)])

    def feedback(self, u: Array, e: Array | None) -> Array:
        """Those of the members."""
        errors = [None] * len(self.cones) if e is None else [x for _, x in self._split(e)]
        return np.concatenate([c.feedback(x, y) for (c, x), y in zip(self._split(u), errors, strict=True)])

    def _split(self, rows: Array) -> list[tuple[Cone, Array]]:
        ends = np.cumsum([c.dim for c in self.cones])[:-1]
        return list(zip(self.cones, np.split(rows, ends), strict=True))


def friction_used(friction: float | Cone | None, force: Array) -> float | None:
    """Share of friction that a force (tangent, tangent, normal) with a load uses; None without friction.

    Args:
        friction: A coefficient, a set of forces, or None.
        force: Its normal part above zero, shape (3,) [N].
    """
    if isinstance(friction, Cone):
        return friction.friction_used(force)
    return math.hypot(force[0], force[1]) / (friction * float(force[2])) if friction else None


def pushed_out(u: Array, e: Array | None) -> Array:
    """Feedback that only pushes, of velocities u and errors e: never above zero, and zero where there is still a gap."""
    return np.minimum(0.0, u) if e is None else np.where(e <= 0.0, np.minimum(0.0, u + e), 0.0)


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


class ConeProjection(NamedTuple):
    """Nearest points of the cones |p_t| <= mu p_n to points (x, y, n), or Coulomb's projections of them; shapes (...).

    Attributes:
        x: First component of the unit tangential direction.
        y: Second one.
        normal: Normal part of the projection.
        factor: Of the tangential parts: they keep their direction.
        pushes: Whether the projection is not the apex.
        slips: Whether it is on the cone's boundary.
    """

    x: Array
    y: Array
    normal: Array
    factor: Array
    pushes: Array
    slips: Array

    def slopes(self, mu: Array | float, *, coulomb: bool = False) -> Array:
        """Derivatives of the projections, an element of the generalised Jacobian, shape (..., 3, 3)."""
        x, y, factor, slips = self.x, self.y, self.factor, self.slips
        V = np.zeros((*x.shape, 3, 3))
        if coulomb:
            along, spread = mu * slips, -(factor * slips)
            V[..., 2, 2] = self.pushes
        else:
            share = 1.0 / (1.0 + np.square(mu))
            along, spread = mu * share * slips, (1.0 - share - factor) * slips
            V[..., 2, 2] = factor + (share - factor) * slips
            V[..., 2, 0], V[..., 2, 1] = along * x, along * y
        turned = spread * x
        V[..., 0, 0] = factor + turned * x
        V[..., 1, 1] = factor + spread * y * y
        V[..., 0, 1] = V[..., 1, 0] = turned * y
        V[..., 0, 2], V[..., 1, 2] = along * x, along * y
        return V


def projection(points: Sequence[Array] | Array, mu: Array | float, *, coulomb: bool = False) -> ConeProjection:
    """Projections of points on the cones |p_t| <= mu p_n.

    Args:
        points: Their tangential parts, both, and the normal ones, each of shape (...).
        mu: Friction coefficients.
        coulomb: Alart and Curnier's projection: max(n, 0) along the normal, and the tangential part cut to the disc of radius
            mu times that. Else the nearest points.
    """
    x, y, n = points
    t = np.hypot(x, y)
    if coulomb:
        normal = np.maximum(n, 0.0)
    else:
        normal = np.where(t <= mu * n, n, np.maximum((mu * t + n) / (1.0 + np.square(mu)), 0.0))
    t = np.maximum(t, _TINY)
    factor = np.minimum(mu * normal / t, 1.0)
    pushes = normal > 0.0
    return ConeProjection(x / t, y / t, normal, factor, pushes, (factor < 1.0) & pushes)


_TINY = 1e-200


def project_cones(W: Array, mu: Array | float, *, coulomb: bool = False) -> Array:
    """The points of `projection`, shape (..., 3), of points W; the nearest of the dual cone is W plus that of -W (Moreau)."""
    found = projection((W[..., 0], W[..., 1], W[..., 2]), mu, coulomb=coulomb)
    return np.stack([found.factor * W[..., 0], found.factor * W[..., 1], found.normal], axis=-1)
