"""`region`: an inner and an outer bound of where the centre of mass may be so that every member of a set is held.

The load of a member is linear in the place x of its centre of mass (`rbd.robust.centres`): one conic program finds the farthest
x along a direction that the corrections prove. The set of places of each member is convex, and so is that of all: places
between proved ones are proved, and virtual velocities that do no work along an edge refute all places on it, and all beyond.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from rbd.arrays import Array, check_number, check_whole
from rbd.constraints.constraint import Constraint, listed
from rbd.constraints.convex.polygons import area_of, clipped, convex_hull
from rbd.displayed import Displayed
from rbd.errors import CannotHold, InputError, NoSolution
from rbd.errors.inputs import check_choice
from rbd.model.state import State, checked
from rbd.records import Field
from rbd.robust.holding import BEHIND, TORQUES, Counterexample, RobustHold, at_pose, counterexample, held_behind
from rbd.robust.pose_bounds import Boxed
from rbd.robust.poses import GivenSet
from rbd.robust.program import Held, Repair, Way, largest
from rbd.robust.proofs import Prover, worst_along
from rbd.robust.sets import Boxes, Masses
from rbd.robust.uncertain_loads import UncertainLoads
from rbd.statics.force_balance import ForceBalance
from rbd.statics.planar_projection import WITHIN_M, Region

_BEYOND = 1e-7
"""How far beyond what a program finds it is refuted [m]."""
_SHARES = (1e-3, 0.01, 0.02, 0.05, 0.1, 0.2, 0.4, 0.7)
"""Of the way from a corner of the outer polygon to its middle, where places are proved in parts."""
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
        inner, outer = 1e4 * self.area, 1e4 * self.outer_area
        return (
            f"places of the centre of mass: every member is held inside {inner:.2f} cm2 ({len(self.vertices)} corners), "
            f"a member is not outside of {outer:.2f} cm2 ({len(self.outer)} corners)."
        )


def region(
    state: State,
    contacts: Sequence[Constraint],
    *,
    pushes: object = None,
    friction: float | Mapping[str, float] | None = None,
    mass: Masses = None,
    com: Boxes = None,
    joints: Boxed | None = None,
    torques: str = "each",
    margin: float = 0.0,
    loops: bool = True,
    most_parts: int = 1,
    most_directions: int = 24,
) -> RobustRegion:
    """Where the centre of mass may be for every member of a set to be held, seen along gravity, with proofs of both sides.

    Masses and poses do not move the centre of mass: it is at the place x that is asked about. With `com` the centres of mass of
    links are off the places from which x is known, and the region is the smaller. Torques are within their limits, with gravity
    torques and Jacobians of the pose, as of `rbd.statics.support_region` with torque_limits=True.

    Args:
        state: The pose of a robot with one floating base; v must be zero.
        contacts: What it stands on, at least one.
        pushes: As of `rbd.robust.hold`.
        friction: As of `rbd.robust.hold`.
        mass: As of `rbd.robust.hold`.
        com: As of `rbd.robust.hold`.
        joints: As of `rbd.robust.hold`: a box of poses.
        torques: As of `rbd.robust.hold`; one torque, or one law of the push, is of one place of the centre of mass.
        margin: What every member keeps to each limit [N, N m].
        loops: Whether the robot's own loops hold.
        most_parts: Into how many parts the set may be split to prove a place, for torques of each. With more than one, up to
            eight proofs look for a place near each corner of the outer polygon.
        most_directions: Directions in which its end is looked for, at most.

    Returns:
        The inner polygon, empty where one affine correction proves no place, and the outer one.

    Raises:
        InputError: a robot without a floating base, or with two; gravity that is level; as of `rbd.robust.hold`.
        CannotHold: some members are held nowhere, by themselves or by torques that are shared.
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
    check_choice("torques", torques, TORQUES)
    parts = check_whole("most_parts", most_parts, 100_000, least=1) if torques == "each" else 1
    given = GivenSet(state, listed(contacts), pushes, friction, mass, com, joints, loops, np.zeros(2))
    ends = _Ends(given, torques, kept)
    outer, edges = ends.outer(most)
    inner = ends.inner(most)
    proved = [ends.proved(corner, inner.mean(axis=0)) for corner in inner]
    if parts > 1:
        proved += [ends.proved(corner, outer.mean(axis=0), parts) for corner in outer]
    found = [each for each in proved if each is not None]
    corners = np.array([place for place, _ in found]).reshape(-1, 2)
    kept_ones = _outermost(corners)
    holds, balance = tuple([found[i][1] for i in kept_ones]), given.whole.balance
    weights = np.array([hold.forces.mean(axis=0) / balance.unit for hold in holds]).reshape(-1, balance.sets.size)
    return RobustRegion(balance, corners[kept_ones], outer, weights, holds, edges, np.zeros((0, 2)), False)


@dataclass(frozen=True, eq=False)
class _Ends:
    """The ends of the region of a set.

    Attributes:
        given: The set, with a place.
        torques: As of `region`.
        margin: What is kept.
    """

    given: GivenSet
    torques: str
    margin: float

    def _behind(self, direction: Array) -> tuple[UncertainLoads, Way, Way]:
        """(loads with the centre of mass 10 m behind the origin, what a metre along a direction adds, and across it)."""
        places = self.given.places
        return (places.at(places.origin - WITHIN_M * direction), *places.ways(direction))

    def inner(self, most: int) -> Array:
        """Corners of the polygon of places that programs find to be proved, counterclockwise; none where there is none."""

        def farthest(direction: Array) -> Array | None:
            L, along, beside = self._behind(direction)
            found = largest(
                L, L.corners, L.columns, self.torques, components=L.components, margin=self.margin, ways=along, free=beside,
                at_most=2.0 * WITHIN_M, turns=L.turns, repair=Repair.of(L, L.turns),
            )  # fmt: skip
            return self._place(direction, found)

        return _polygon(farthest, most)

    def _place(self, direction: Array, found: Held) -> Array | None:
        """Where an extent from 10 m behind the origin goes to; None where there is no such place."""
        if not np.isfinite(found.value):
            return None
        across, origin = np.array([-direction[1], direction[0]]), self.given.places.origin
        return np.asarray(origin + (found.value - WITHIN_M) * direction + found.aside * across)

    def proved(self, corner: Array, middle: Array, parts: int = 1) -> tuple[Array, RobustHold] | None:
        """(place, proof) as near to a corner as is proved; None where it is not."""

        def towards(share: float) -> Array:
            return np.asarray(corner + share * (middle - corner))

        shares = BEHIND if parts == 1 else _SHARES
        found = held_behind(lambda share: self.given.at_place(towards(share)), self.torques, self.margin, parts, shares)
        return None if found is None else (towards(found[0]), found[1])

    def outer(self, most: int) -> tuple[Array, tuple[Counterexample, ...]]:
        """(corners of the outer polygon, what refutes both ends of each edge).

        Raises:
            CannotHold: some members are held nowhere.
            NoSolution: the region does not end within 10 m, or a proof was not found.
        """
        sides = list[_Side]()
        name = self.given.state.robot.name

        def farthest(direction: Array) -> Array | None:
            side, place = self._side(direction)
            sides.append(side)
            return place

        _polygon(farthest, most)
        if not len(_cut(sides)):
            raise CannotHold(f"{name}: no place of the centre of mass is one where every member is held. Try a smaller set.")
        kept = [side for side in sides if len(_on_side(_cut(sides), side))]
        outer, against = _cut(kept), list[Counterexample]()
        for side in kept:
            for place in _on_side(outer, side):
                prover = Prover(side.given.at_place(place).whole, self.torques)
                proof = prover.contradiction(side.members, side.velocities, self.margin)
                if proof is None:
                    raise NoSolution(f"{name}: that a member is not held at an edge of the region was not proved.")
                found = counterexample(prover, proof, self.margin)
                against.append(found if side.pose is None else at_pose(found, side.pose))
        return outer, tuple(against)

    def _side(self, direction: Array, pose: Mapping[str, float] | None = None) -> tuple[_Side, Array]:
        """(the side along a direction, its farthest place) of the worst members that a search finds."""
        L, along, beside = self._behind(direction)
        corners, far = np.arange(len(L.corners)), 2.0 * WITHIN_M
        members, found = worst_along(L, corners, self.margin, along, beside, far, self.torques, L.components)
        if L.turns and self.torques == "each":  # a pose alone has no bounds over a box
            where = self.given.pose_of(L.member(*members[0]))
            return replace(self, given=self.given.at_pose(where))._side(direction, where)
        place, name = self._place(direction, found), L.state.robot.name
        if place is None:
            one = self.torques == "each"
            raise CannotHold(
                f"{name}: {'a member is' if one else 'some members are'} held nowhere, wherever the centre of mass is"
                + ("." if one else f", by torques that are shared (torques={self.torques!r}). Try torques='each'.")
            )
        if found.value >= far * (1.0 - 1e-6):
            raise NoSolution(f"{name}: the region does not end within {WITHIN_M:g} m.")
        return _Side(direction, float(direction @ place) + _BEYOND, members, found.velocities, self.given, pose), place


@dataclass(frozen=True, eq=False)
class _Side:
    """A side of the outer polygon: some members are held nowhere beyond.

    Attributes:
        direction: Outwards, shape (2,).
        value: Largest direction . x [m].
        members: Which are not held together, as (corner, t).
        velocities: Virtual velocity of each, shape (k, nv).
        given: The set that they are members of.
        pose: Joints of a pose of a box, where they are of that pose.
    """

    direction: Array
    value: float
    members: list[tuple[int, Array]]
    velocities: Array
    given: GivenSet
    pose: Mapping[str, float] | None


def _outermost(corners: Array) -> list[int]:
    """The numbers of the corners of the hull, counterclockwise, each once."""
    if len(corners) < 3:
        return list(range(len(corners)))
    return [int(np.argmin(np.linalg.norm(corners - c, axis=1))) for c in convex_hull(corners)]


def _cut(sides: Sequence[_Side]) -> Array:
    """The corners of what all sides leave, shape (j, 2)."""
    corners = [(-_FAR, -_FAR), (_FAR, -_FAR), (_FAR, _FAR), (-_FAR, _FAR)]
    for side in sides:
        corners = clipped(corners, -float(side.direction[0]), -float(side.direction[1]), -side.value)
    return convex_hull(np.array(corners))


def _on_side(corners: Array, side: _Side) -> Array:
    """The ends of the polygon's edge on a side, shape (2, 2); none where another side is nearer everywhere."""
    along = corners @ np.array([-side.direction[1], side.direction[0]])
    on = np.flatnonzero(np.abs(corners @ side.direction - side.value) < 1e-9)
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
