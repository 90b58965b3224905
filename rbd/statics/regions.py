"""The support region: where the centre of mass may be, for any contacts, with torque limits or without."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from rbd.arrays import Array, as_array, check_flag, cross_matrix, is_finite, lazy
from rbd.constraints.constraint import Constraint
from rbd.constraints.convex.polygons import area_of
from rbd.displayed import Displayed
from rbd.errors import InputError, NoSolution
from rbd.model.state import State
from rbd.model.world import along_gravity
from rbd.problem.conic import Certificate, Conic, Unknowns
from rbd.problem.programs import Outcome
from rbd.records import Field, vector
from rbd.statics.force_balance import (
    ForceBalance,
    check_area_gap,
    friction_words,
    names_of,
    outside,
    standing_loads,
    torques_left,
)
from rbd.statics.planar_projection import Region, planar_region

SMALLEST_GAP_M2 = 1e-9
_SHARE = 1e-2
"""A motor is in the way whose limit makes more than this of the certificate's gap."""


@dataclass(frozen=True, eq=False)
class SupportRegion(Region, Displayed):
    """Where the centre of mass may be, seen along gravity, for the robot to be at rest on its contacts.

    Moved along gravity, a weight keeps its line of action: what counts is where that line meets the level plane z = 0 of W.
    Under gravity along -z that is the place of the centre of mass seen from above; under one that leans, below or above it.

    Attributes:
        loads: The pose, its contacts, and what their forces do.
        friction: "cone", "inscribed" or "circumscribed".
        torque_limits: Whether motors keep within their limits.
        margin: Share of each coefficient of friction that is left unused.
        vertices: Corners on z = 0, counterclockwise seen from above, shape (k, 2) [m]: each with its forces. Two of a segment,
            one of a point, none of an empty region. Of a region that is `cut`, of its part within 10 m of the contacts' middle.
        outer: Corners of a polygon that holds the region, shape (j, 2) [m]; those of the region itself with pyramids.
        weights: Forces that certify each corner, as weights of `loads.sets` over the robot's weight, shape (k, p).
        directions: Unit vectors that span the directions in which the region has no end, shape (r, 2); none if it ends.
        contradiction: Of an empty region, the multipliers that certify it; or None.
        programs: How many linear or conic programs that took.
        cut: Whether the region goes on beyond 10 m from its contacts, with an end or without, and `vertices` end there.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> region = rbd.statics.support_region(solo.standing(), solo.feet(friction=0.7))
        >>> region.vertices.round(3)
        array([[-0.195, -0.169],
               [ 0.195, -0.169],
               [ 0.195,  0.169],
               [-0.195,  0.169]])
        >>> print(f"{region.area:.4f} m2, {region.distance():.3f} m from its edge, {region.distance([0.5, 0.0]):.3f} m outside")
        0.1315 m2, 0.169 m from its edge, -0.305 m outside
    """

    loads: ForceBalance
    friction: str
    torque_limits: bool
    margin: float
    vertices: Array
    outer: Array
    weights: Array
    directions: Array
    contradiction: Certificate | None
    programs: int
    cut: bool

    fields: ClassVar[tuple[Field, ...]] = (
        Field("residual", (), "N, N m", "largest error of the corners", certificate=True),
        *Region.fields,
        Field(
            "com_distance", (), "m", "distance of the centre of mass from the edge, positive inside",
            lambda region: region.com_to_edge[0],
        ),
        Field("area_gap", (), "m2", "by how much the outer polygon is larger", default=False),
    )  # fmt: skip

    @property
    def area_gap(self) -> float:
        """By how much the outer polygon is larger [m2]."""
        return max(0.0, area_of(self.outer) - area_of(self.vertices))

    def distance(self, point: Sequence[float] | Array | None = None) -> float:
        """Distance from a point to the region's edge [m]: positive inside, negative outside; -inf of an empty region.

        Where the nearest edge is that at which the region is `cut`, its own is at that distance or more (of negative ones, the
        nearer to zero), which an `InaccurateWarning` says.

        Args:
            point: (x, y) on z = 0 of W [m], or (x, y, z), seen along gravity; the centre of mass if not given.
        """
        at = self.state.com if point is None else as_array("point", point)
        if at.shape not in ((2,), (3,)) or not is_finite(at):
            raise InputError(f"point is {point!r:.80}; expected two finite numbers, x and y in metres.")
        return self._distance(at if len(at) == 2 else along_gravity(self.state.robot.gravity, at), stacklevel=2)

    @property
    def com_to_edge(self) -> tuple[float, bool]:
        """(`distance` of the centre of mass, whether it is known): see `to_edge`."""
        return self.to_edge(along_gravity(self.state.robot.gravity, self.state.com))

    @property
    def com_in_words(self) -> str:
        """Where the centre of mass is: "12.3 mm inside", or "at least 9876.5 mm inside" where the region is cut."""
        distance, known = self.com_to_edge
        if known or distance >= 0.0:
            least = "" if known else "at least "
            return f"{least}{1e3 * abs(distance):.1f} mm {'inside' if distance >= 0.0 else 'outside'}"
        return f"at most {1e3 * abs(distance):.1f} mm outside"

    @property
    def _outline(self) -> tuple[Array, Array]:
        return self.vertices, _middle(self.loads)

    def corners_at(self, height: float) -> Array:
        """Its corners on the level plane z = height, along gravity from those on z = 0, in W, shape (k, 3) [m]."""
        g = self.state.robot.gravity
        return np.column_stack([self.vertices + height / g[2] * g[:2], np.full(len(self.vertices), float(height))])

    def tau(self, corner: int) -> Array:
        """Motor torques that go with these forces at this pose, shape (nu,) [N, N m]."""
        return torques_left(self.loads, self.weights[self._corner(corner)])[0]

    @lazy
    def residual(self) -> float:
        """Largest error of the corners, recomputed from forces: of balance [N, N m], and of forces outside their cones [N]."""
        worst, robot = 0.0, self.state.robot
        base, below = robot.bases[0], along_gravity(robot.gravity, self.state.com)
        at, R = robot.model.joints[base].idx_v, self.state.base_pose(base).rotation
        for corner, x in zip(self.vertices, self.weights, strict=True):
            moved = np.zeros(robot.nv)
            moved[at + 3 : at + 6] = R.T @ np.cross([*(corner - below), 0.0], robot.mass * robot.gravity)
            left = torques_left(self.loads, x, moved)[1]
            worst = max(worst, float(np.abs(left).max()), outside(self.loads, x))
        return worst

    def __str__(self) -> str:
        limits = "within torque limits at this pose" if self.torque_limits else "torques of any size"
        how = f"on {names_of(self.loads.rows)}; {friction_words(self.loads.sets)}, {limits}"
        if self.empty:
            blocked = self.motors_in_the_way
            why = f" Torque limits in the way: {', '.join(blocked)}." if blocked else ""
            return f"support region: empty, {how}.{why}"
        if not self.bounded:
            ways = "; ".join(map(vector, self.directions))
            return f"support region: without end along {ways}, {how}."
        gap = f" and up to {1e4 * self.area_gap:.2f} more" if self.area_gap > SMALLEST_GAP_M2 else ""
        return (
            f"support region: {1e4 * self.area:.2f} cm2{gap}{self.cut_words}, {len(self.vertices)} corners, "
            f"centre of mass {self.com_in_words}, {how}."
        )

    @property
    def motors_in_the_way(self) -> tuple[str, ...]:
        """Motors without whose limits an empty region may not be empty."""
        if self.contradiction is None or not len(self.contradiction.z):
            return ()
        _, low, high = self.loads.torque_rows
        share = np.abs(self.contradiction.z) * np.maximum(np.abs(low), np.abs(high))
        motors = np.flatnonzero(self.loads.limited)[share > _SHARE * self.contradiction.gap]
        return tuple(self.state.robot.actuated_names[i] for i in motors)


def support_region(
    state: State,
    contacts: Sequence[Constraint],
    *,
    torque_limits: bool = False,
    margin: float = 0.0,
    friction: str = "cone",
    area_gap: float = 1e-4,
    loops: bool = True,
) -> SupportRegion:
    """Where the centre of mass may be, seen along gravity, for some contact forces to balance the robot's weight.

    The contacts may be any: soles, hands on walls, rails that are held, on whatever planes. The region is all c with forces f
    in their cones and J^T f = h where no motor is, h the weight with its line of action through c. It is given on the level
    plane z = 0 of W, along gravity: under gravity along -z it is the region seen from above, at any height.

    With torque limits, `|tau| <= limit` besides, with the gravity torques and Jacobians of *this pose*: as if the centre of
    mass moved and the pose stayed. That neglects what a true motion of the centre of mass changes in both, so that it is right
    where the centre of mass of the pose is, and near it [Orsolino2020]. Joints without a motor are balanced at this pose
    likewise.

    Args:
        state: The pose of a robot with one floating base; v must be zero.
        contacts: What it stands on and holds to, at least one.
        torque_limits: Whether motors keep within the limits of the robot's file.
        margin: Share of each coefficient of friction that is left unused, from 0 to below 1.
        friction: "cone", the circular cones; "inscribed", the pyramids inside them, with each contact's facets;
            "circumscribed", those around them. With pyramids the region is a polygon, found exactly.
        area_gap: With circular cones, by how much the area of the polygon that holds the region may exceed that of the polygon
            inside it [m2].
        loops: Whether the robot's own loops hold; one that is given counts once.

    Raises:
        NotAtRest: if `|v|` exceeds 1e-9, or what a contact touches moves.
        InputError: a robot that is fixed to the world or has two bases, gravity that is zero or level, no contacts.
        NoSolution: a program was not solved.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> three = solo.feet(friction=0.7)[:3]
        >>> region = rbd.statics.support_region(solo.standing(), three)
        >>> region.vertices.round(3)
        array([[-0.195,  0.169],
               [ 0.195, -0.169],
               [ 0.195,  0.169]])
        >>> print(f"{region.distance([0.1, 0.1]):.3f} m")
        0.069 m
    """
    check_flag("torque_limits", torque_limits)
    gap = check_area_gap(area_gap)
    loads = standing_loads(state, contacts, friction, margin, loops)
    _check_stands(state)
    found, directions, cut = planar_region(_program(loads, torque_limits), _middle(loads), gap, state.robot.name)
    if found.outcome is Outcome.INFEASIBLE and found.contradiction is None:
        raise NoSolution(f"{state.robot.name}: whether the region is empty was not found.")
    return SupportRegion(
        loads, friction, bool(torque_limits), float(margin), found.inner, found.outer, found.x[:, : loads.sets.size],
        directions, found.contradiction, found.programs, cut,
    )  # fmt: skip


def _check_stands(state: State) -> None:
    robot, g = state.robot, state.robot.gravity
    if len(robot.bases) != 1:
        bases = "is fixed to the world" if not robot.bases else f"is {len(robot.bases)} robots"
        raise InputError(f"{robot.name} {bases}; a support region is that of one robot with a floating base.")
    along_gravity(g, np.zeros(3))  # refuses a gravity whose lines do not meet the plane


def _program(loads: ForceBalance, limits: bool) -> Conic:
    """X = (w, centre of mass): weight and forces balance.

    A centre of mass moved by d along z = 0 adds the moment d x m g to what gravity does on the base.
    """
    state, robot = loads.state, loads.state.robot
    R = state.base_pose(robot.bases[0]).rotation
    first = int(np.searchsorted(robot.unactuated, robot.model.joints[robot.bases[0]].idx_v))
    shift = np.zeros((len(loads.b), 2))
    down = robot.gravity / np.linalg.norm(robot.gravity)
    shift[first + 3 : first + 6] = -R.T @ cross_matrix(down)[:, :2]  # d x down = -down x d
    shift /= loads.row_size[:, None]
    below = along_gravity(down, state.com)
    return Conic.of(
        {"forces": loads.block(), "point": Unknowns(2)},
        [({"forces": loads.A, "point": shift}, loads.b + shift @ below)],
        [loads.torque_rows] if limits else [],  # of the pose: a centre of mass loads no motor
    )


def _middle(loads: ForceBalance) -> Array:
    """Of the contacts' corners and the centre of mass, seen along gravity, shape (2,) [m]: where the region is looked for."""
    g = loads.state.robot.gravity
    points = [along_gravity(g, r.patch.corners_W) for r in loads.rows if r.patch is not None and len(r.patch.corners)]
    return np.asarray(np.concatenate([along_gravity(g, loads.state.com)[None], *points]).mean(axis=0))
