"""`region`: an inner and an outer bound of where the centre of mass may be so that every member of a set is held.

With masses within intervals the load of a member is a + sum of t_i D_i. Where its centre of mass is at x instead of c, on the
base it is

    h - J_w^T ((x - c) x M g),      M and M c linear in t,

so that a and D_i are linear in x: one conic program finds the farthest x along a direction that the corrections prove. The set
of places of each member is convex, and so is that of all: places between proved ones are proved, and a virtual velocity that
does no work along an edge refutes all places on it, and all beyond.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, TypeAlias

import numpy as np

from rbd.arrays import Array, check_number, check_whole
from rbd.constraints.constraint import Constraint
from rbd.constraints.convex.polygons import area_of, clipped, convex_hull
from rbd.displayed import Displayed
from rbd.errors import InputError, NoSolution
from rbd.model.state import State, checked
from rbd.model.world import along_gravity
from rbd.records import Field
from rbd.robust.holding import Counterexample, RobustHold, counterexample, held_behind
from rbd.robust.program import Held, largest
from rbd.robust.proofs import Prover, worst_along
from rbd.robust.sets import Boxes, Masses, middle_of
from rbd.robust.uncertain_loads import UncertainLoads
from rbd.statics.force_balance import ForceBalance
from rbd.statics.planar_projection import WITHIN_M, Region

_BEYOND = 1e-7
"""How far beyond what a program finds it is refuted [m]."""
_FAR = 1e3
"""No place is farther [m]."""
_SAME = 1e-6
"""Places nearer to each other than this are one [m]."""


@dataclass(frozen=True, eq=False)
class RobustRegion(Region, Displayed):
    """Where the centre of mass may be for every member of a set, seen along gravity, from inside and from outside.

    Attributes:
        loads: The pose, its contacts with their least friction.
        vertices: Corners on z = 0 of what is proved for every member, counterclockwise, shape (k, 2) [m]; none if nothing is.
        outer: Corners of a polygon outside of which a member is proved not to be held, shape (j, 2) [m].
        weights: Forces at the middle of the set that prove each corner, as of `SupportRegion`, shape (k, p).
        holds: The proof of each corner; between corners members are held, too, as the set of places of each is convex.
        counterexamples: Of each edge of `outer` its two ends, with one virtual velocity that refutes all places between them.
        directions: Without end in none, shape (0, 2).
        cut: Whether the region goes on beyond 10 m; it is refused.

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> sole = rbd.SurfaceContact("base", "box", half_lengths=(0.2, 0.1), friction=0.5)
        >>> found = rbd.robust.region(rbd.State(box, [0, 0, 0, 0, 0, 0, 1]), [sole], mass={"box": 0.3})
        >>> print(f"{found.area:.5f} to {found.outer_area:.5f} m2")
        0.08000 to 0.08000 m2
    """

    loads: ForceBalance
    vertices: Array
    outer: Array
    weights: Array
    holds: tuple[RobustHold, ...]
    counterexamples: tuple[Counterexample, ...]
    directions: Array
    cut: bool

    fields: ClassVar[tuple[Field, ...]] = (
        *Region.fields,
        Field("outer_area", (), "m2", "area outside of which a member is proved not to be held"),
    )

    @property
    def outer_area(self) -> float:
        """Area of the outer polygon [m2]."""
        return area_of(self.outer)

    @property
    def _outline(self) -> tuple[Array, Array]:
        return self.vertices, self.vertices.mean(axis=0) if len(self.vertices) else np.zeros(2)

    def corners_at(self, height: float) -> Array:
        """Its corners on the level plane z = height, along gravity from those on z = 0, in W, shape (k, 3) [m]."""
        return self._raised(self.vertices, height)

    def outer_at(self, height: float) -> Array:
        """The outer corners there, shape (j, 3) [m]."""
        return self._raised(self.outer, height)

    def _raised(self, corners: Array, height: float) -> Array:
        g = self.state.robot.gravity
        return np.column_stack([corners + height / g[2] * g[:2], np.full(len(corners), float(height))])

    def __str__(self) -> str:
        return (
            f"region of the centre of mass: every member is held within {1e4 * self.area:.2f} cm2, one is not outside of "
            f"{1e4 * self.outer_area:.2f} cm2; {len(self.vertices)} and {len(self.outer)} corners."
        )


def region(
    state: State,
    contacts: Sequence[Constraint],
    *,
    pushes: object = None,
    friction: float | Mapping[str, float] | None = None,
    mass: Masses = None,
    com: Boxes = None,
    margin: float = 0.0,
    loops: bool = True,
    most_directions: int = 24,
) -> RobustRegion:
    """Where the centre of mass may be for every member of a set to be held, seen along gravity, with proofs of both sides.

    Masses do not move the centre of mass: it is at the place x that is asked about. With `com` the centres of mass of links
    are off the places from which x is known, and the region is the smaller. Torques are within their limits, each member's own,
    with gravity torques and Jacobians of this pose, as of `rbd.statics.support_region` with torque_limits=True.

    Args:
        state: The pose of a robot with one floating base; v must be zero.
        contacts: What it stands on, at least one.
        pushes: As of `rbd.robust.hold`.
        friction: As of `rbd.robust.hold`.
        mass: As of `rbd.robust.hold`.
        com: As of `rbd.robust.hold`.
        margin: What every member keeps to each limit [N, N m].
        loops: Whether the robot's own loops hold.
        most_directions: Directions in which its end is looked for, at most.

    Returns:
        The inner polygon, empty where one affine correction proves no place, and the outer one.

    Raises:
        InputError: a robot without a floating base, or with two; gravity that is level; as of `rbd.robust.hold`.
        NoSolution: a program was not solved; or the region does not end within 10 m.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> push = rbd.robust.PushSet.box("base_link", (-2, -2, 0), (2, 2, 0))
        >>> found = rbd.robust.region(solo.standing(), solo.feet(friction=0.7), pushes=push, mass=0.05)
        >>> print(f"{1e4 * found.area:.0f} to {1e4 * found.outer_area:.0f} cm2")
        1041 to 1041 cm2
    """
    most = check_whole("most_directions", most_directions, 1000, least=4)
    kept = check_number("margin", margin, 0.0, 1e9, expected="a force [N], zero or more")
    bases = checked(state).robot.bases
    if len(bases) != 1 or state.robot.model.joints[bases[0]].nv != 6:
        raise InputError(
            f"{state.robot.name} has {len(bases)} bases; expected one that floats, so that its centre of mass can move."
        )
    places = _Places.of(UncertainLoads.of(state, contacts, pushes, friction, mass, com, loops), kept)
    outer, edges = places.outer(most)
    inner = places.inner(most)
    middle = inner.mean(axis=0) if len(inner) else np.zeros(2)
    corners, holds = list[Array](), list[RobustHold]()
    for corner in inner:
        if (proved := places.proved(corner, middle)) is not None:
            corners.append(proved[0])
            holds.append(proved[1])
    weights = [hold.forces.mean(axis=0) / places.loads.balance.unit for hold in holds]
    p = places.loads.balance.sets.size
    return RobustRegion(
        places.loads.balance, np.array(corners).reshape(-1, 2), outer, np.array(weights).reshape(-1, p), tuple(holds), edges,
        np.zeros((0, 2)), False,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Places:
    """The loads where the centre of mass is at a place, linear in it.

    Attributes:
        loads: With the centre of mass of every member at `origin`.
        origin: On z = 0, shape (2,) [m].
        corners: What a metre along x and y adds to the loads at the corners, shape (2, k, nv).
        columns: To the columns, shape (2, n, nv).
        margin: What is kept.
    """

    loads: UncertainLoads
    origin: Array
    corners: Array
    columns: Array
    margin: float

    @classmethod
    def of(cls, L: UncertainLoads, margin: float) -> _Places:
        """The places of a set of loads; its own centres of mass are where they are.

        Raises:
            InputError: gravity whose lines do not meet the plane z = 0.
        """
        state, robot, g = L.state, L.state.robot, L.state.robot.gravity
        origin = along_gravity(g, state.com)
        at, turned = robot.model.joints[robot.bases[0]].idx_v, np.zeros((3, robot.nv))
        turned[:, at + 3 : at + 6] = state.base_pose(robot.bases[0]).rotation
        middle, moment, columns = robot.mass, robot.mass * state.com, L.columns.copy()
        for i, (link, column, kilograms, half) in enumerate(L.links):
            if column == i:
                c = np.array(state.frame(link, middle_of(robot, link)).X_WF.translation)
                more = kilograms - float(robot.model.inertias[robot.site(link)[0]].mass)
                middle, moment = middle + more, moment + more * c
                columns[i] -= turned.T @ np.cross(half * (state.com - c), g)
        corners = L.corners - turned.T @ np.cross(middle * state.com - moment, g)
        ways = [-turned.T @ np.cross(axis, g) for axis in np.eye(3)[:2]]
        return cls(
            L.with_corners(corners, L.components, columns), origin,
            np.array([np.tile(middle * way, (len(corners), 1)) for way in ways]),
            np.array([np.outer(L.mass, way) for way in ways]), margin,
        )  # fmt: skip

    def at(self, place: Array) -> UncertainLoads:
        """The loads with the centre of mass at a place, shape (2,) on z = 0."""
        off, L = place - self.origin, self.loads
        corners = L.corners + np.tensordot(off, self.corners, 1)
        return L.with_corners(corners, L.components, L.columns + np.tensordot(off, self.columns, 1))

    def ways(self, direction: Array) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """((along, along of columns), (beside, ...)) of a metre along a direction, and across it."""
        across = np.array([-direction[1], direction[0]])
        found = [(np.tensordot(d, self.corners, 1), np.tensordot(d, self.columns, 1)) for d in (direction, across)]
        return found[0], found[1]

    def inner(self, most: int) -> Array:
        """Corners of the polygon of places that programs find to be proved, counterclockwise; none where there is none."""

        def farthest(direction: Array) -> Array | None:
            L, (along, beside) = self.at(self.origin - WITHIN_M * direction), self.ways(direction)
            found = largest(L, L.corners, L.columns, margin=self.margin, ways=along, free=beside, at_most=2.0 * WITHIN_M)
            return self.place(direction, found)

        return _polygon(farthest, most)

    def place(self, direction: Array, found: Held) -> Array | None:
        """Where an extent from 10 m behind the origin goes to; None where there is no such place."""
        if not np.isfinite(found.value):
            return None
        across = np.array([-direction[1], direction[0]])
        return np.asarray(self.origin + (found.value - WITHIN_M) * direction + found.aside * across)

    def proved(self, corner: Array, middle: Array) -> tuple[Array, RobustHold] | None:
        """(place, proof) as near to a corner as is proved; None where it is not."""

        def towards(share: float) -> Array:
            return np.asarray(corner + share * (middle - corner))

        found = held_behind(lambda share: self.at(towards(share)), self.margin)
        return None if found is None else (towards(found[0]), found[1])

    def outer(self, most: int) -> tuple[Array, tuple[Counterexample, ...]]:
        """(corners of the outer polygon, what refutes both ends of each edge).

        Raises:
            NoSolution: the region does not end within 10 m, or a proof was not found.
        """
        sides = list[_Side]()
        name = self.loads.state.robot.name

        def farthest(direction: Array) -> Array | None:
            L, (along, beside) = self.at(self.origin - WITHIN_M * direction), self.ways(direction)
            ways = along[1], beside[1]
            v, t, found = worst_along(L, np.arange(len(L.corners)), self.margin, along[0], beside[0], 2.0 * WITHIN_M, ways)
            place = self.place(direction, found)
            if place is None or found.value >= 2.0 * WITHIN_M * (1.0 - 1e-6):
                raise NoSolution(f"{name}: a member is held nowhere, or the region does not end within {WITHIN_M:g} m.")
            sides.append((direction, float(direction @ place) + _BEYOND, v, t, found.velocities))
            return place

        _polygon(farthest, most)
        kept = [side for side in sides if len(_on_side(_cut(sides), side))]
        outer, against = _cut(kept), list[Counterexample]()
        for side in kept:
            _, _, v, t, velocities = side
            for place in _on_side(outer, side):
                prover = Prover(self.at(place), "each")
                proof = prover.contradiction([(v, t)], velocities, self.margin)
                if proof is None:
                    raise NoSolution(f"{name}: that a member is not held at an edge of the region was not proved.")
                against.append(counterexample(prover, proof, self.margin))
        return outer, tuple(against)


_Side: TypeAlias = tuple[Array, float, int, Array, Array]
"""(direction d, largest d . x, corner, numbers t, velocity) of a member that is held nowhere beyond."""


def _cut(sides: Sequence[_Side]) -> Array:
    """The corners of what all sides leave, shape (j, 2)."""
    corners = [(-_FAR, -_FAR), (_FAR, -_FAR), (_FAR, _FAR), (-_FAR, _FAR)]
    for d, value, *_ in sides:
        corners = clipped(corners, -float(d[0]), -float(d[1]), -value)
    return convex_hull(np.array(corners))


def _on_side(corners: Array, side: _Side) -> Array:
    """The ends of the polygon's edge on a side, shape (2, 2); none where another side is nearer everywhere."""
    along = corners @ np.array([-side[0][1], side[0][0]])
    on = np.flatnonzero(np.abs(corners @ side[0] - side[1]) < 1e-9)
    if len(on) < 2 or np.ptp(along[on]) < _SAME:
        return np.zeros((0, 2))
    return corners[[on[np.argmin(along[on])], on[np.argmax(along[on])]]]


def _polygon(farthest: Callable[[Array], Array | None], most: int) -> Array:
    """The hull of farthest places: in three directions, then across its edges, until none is farther; none if there is none."""
    tried = [np.array([np.cos(a), np.sin(a)]) for a in 0.1 + np.arange(3) * (2.0 * np.pi / 3.0)]
    found = [place for d in tried if (place := farthest(d)) is not None]
    if len(found) < 3:
        return np.zeros((0, 2))
    while len(tried) < most:
        corners = convex_hull(np.array(found))
        along = np.roll(corners, -1, axis=0) - corners
        length = np.linalg.norm(along, axis=1)
        normals = np.column_stack([along[:, 1], -along[:, 0]]) / np.maximum(length, 1e-12)[:, None]
        fresh = [
            i for i in np.argsort(-length) if length[i] > _SAME and min(np.abs(normals[i] - d).max() for d in tried) > _SAME
        ]
        if not fresh:
            break
        tried.append(normals[fresh[0]])
        if (place := farthest(tried[-1])) is not None:
            found.append(place)
    corners = convex_hull(np.array(found))
    apart = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1) > _SAME
    return np.asarray(corners[apart] if apart.any() else corners[:1])
