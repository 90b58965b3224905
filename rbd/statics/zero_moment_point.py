"""The zero-moment point of a motion, and where contacts allow it to be.

The contact forces of a motion have the resultant F and the moment M_c about the centre of mass c:

    F = m (c'' - g),   M_c = L'     the rate of centroidal momentum, less the weight and what else the world applies

The zero-moment point z is where, on a plane with the normal n, their moment is along n: n x M_z = 0. It exists where F . n is
not zero, and means something where F . n > 0. On flat ground it is the centre of pressure.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rbd.arrays import Array, as_array, check_flag, cross_matrix, is_finite
from rbd.constraints.constraint import Constraint
from rbd.constraints.convex.polygons import across
from rbd.constraints.surface import On, plane_of
from rbd.displayed import Displayed
from rbd.errors import InputError, NoSolution
from rbd.model.external import External, generalised
from rbd.model.state import State, checked
from rbd.model.world import along_gravity
from rbd.problem.conic import Conic, Unknowns
from rbd.problem.ground import Ground
from rbd.problem.rows import Rows, by_rows
from rbd.statics.force_balance import (
    ForceBalance,
    check_area_gap,
    force_sets,
    friction_words,
    given_rows,
    names_of,
)
from rbd.statics.planar_projection import Region, planar_region

LEAST_FORCE = 1e-9
"""A force along the normal below this share of the weight has no zero-moment point."""


def zmp(state: State, a: Array, *, on: On = 0.0, external: External = None) -> Array:
    """The zero-moment point of a motion on a plane, in W, shape (3,) [m].

    From the rate of centroidal momentum alone: which forces at which contacts make the motion does not matter.

    Args:
        state: Where the robot is and how it moves.
        a: Its acceleration, shape (nv,).
        on: The plane: the height of a level one [m], or `rbd.Ground(point=..., normal=...)`.
        external: Forces of the world beside the contacts: generalised (nv,), or `ExternalForce`s and springs
            (`rbd.constraints.forces`).

    Raises:
        NoSolution: no force along the normal pushes: in free fall, say, there is no such point.
        InputError: wrong sizes, numbers that are not finite, a plane that is not known.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> state, feet = solo.standing(), solo.feet()
        >>> forward = rbd.mechanism.project_acceleration(state, np.eye(solo.nv)[0], feet).a
        >>> rbd.statics.zmp(state, np.zeros(solo.nv)).round(3), rbd.statics.zmp(state, forward).round(3)
        (array([0., 0., 0.]), array([-0.02,  0.  ,  0.  ]))
    """
    robot, ground = checked(state).robot, plane_of("the zero-moment point", on)
    acceleration = robot.check_v(a, "a")
    A_g, rate, _ = state.centroidal()
    wrench = A_g @ acceleration + rate - robot.weight - generalised(state, external)[1]
    n, foot = _foot(state, ground)
    push, weight = float(n @ wrench[:3]), float(np.linalg.norm(robot.weight))
    if not push > LEAST_FORCE * max(weight, 1.0):
        raise NoSolution(
            f"{robot.name} has no zero-moment point: the motion takes {push:.4g} N along the normal of the plane, and only a "
            "force that pushes has one."
        )
    moment = wrench[3:] + np.cross(state.com - foot, wrench[:3])
    return np.asarray(foot + np.cross(n, moment) / push)


@dataclass(frozen=True, eq=False)
class ZmpRegion(Region, Displayed):
    """Where the zero-moment point may be for forces at the contacts to make the motion.

    Attributes:
        loads: The robot, its contacts, and the sets of their forces.
        ground: The plane.
        friction: "cone", "inscribed" or "circumscribed".
        pendular: Whether the motions are those of the linear pendulum.
        vertices: Corners on the plane, counterclockwise seen against its normal, in W, shape (k, 3) [m]; none of an empty
            region; of one that is `cut`, of its part within 10 m.
        outer: Corners of a polygon that holds the region, shape (j, 3); those of the region itself with pyramids.
        weights: Contact forces that certify each corner, as weights over the robot's weight, shape (k, p).
        directions: Unit vectors that span the directions in which the region has no end, shape (r, 3); none if it ends.
        cut: Whether the region goes on beyond 10 m from below the centre of mass, with an end or without, and `vertices` end
            there.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> region = rbd.statics.zmp_region(solo.standing(), solo.feet(friction=0.7), friction="inscribed")
        >>> print(f"{region.area:.4f} m2, {region.distance([0.0, 0.0, 0.0]):.3f} m from its edge")
        0.0430 m2, 0.104 m from its edge
    """

    loads: ForceBalance
    ground: Ground
    friction: str
    pendular: bool
    vertices: Array
    outer: Array
    weights: Array
    directions: Array
    cut: bool

    def distance(self, point: Sequence[float] | Array) -> float:
        """Distance from a point of the plane to the region's edge [m]: positive inside, negative outside, -inf if empty.

        Where the nearest edge is that at which the region is `cut`, its own is at that distance or more (of negative ones, the
        nearer to zero), which an `InaccurateWarning` says.
        """
        at = as_array("point", point)
        if at.shape != (3,) or not is_finite(at):
            raise InputError(f"point is {point!r:.80}; expected three finite numbers, as rbd.statics.zmp gives them.")
        return self._distance(self._flat(at[None])[0], stacklevel=2)

    def __str__(self) -> str:
        kind = "of the linear pendulum" if self.pendular else "of any motion"
        how = f"{kind}, on {names_of(self.loads.rows)}; {friction_words(self.loads.sets)}"
        if self.empty:
            return f"zero-moment points {how}: none."
        size = f"{1e4 * self.area:.2f} cm2" if self.bounded else "without end"
        return f"zero-moment points {how}: {size}{self.cut_words}, {len(self.vertices)} corners."

    @property
    def _outline(self) -> tuple[Array, Array]:
        return self._flat(self.vertices), np.zeros(2)

    def _flat(self, points: Array) -> Array:
        return np.asarray((points - _foot(self.state, self.ground)[1]) @ _plane_axes(self.ground))


def zmp_region(
    state: State,
    contacts: Sequence[Constraint],
    *,
    on: On = 0.0,
    pendular: bool = True,
    torque_limits: bool = False,
    margin: float = 0.0,
    friction: str = "cone",
    area_gap: float = 1e-4,
) -> ZmpRegion:
    """Where the zero-moment point may be, for forces in the contacts' friction cones to make the motion [Caron2017].

    On flat ground with enough friction it is the convex hull of the contact points. With hands on walls or feet on slopes it is
    another polygon, which may lie outside that hull, and depends on the height of the plane.

    Args:
        state: Where the robot is; its velocity does not count.
        contacts: What it touches, at least one. Contacts between two of its bodies do not change the resultant.
        on: The plane: the height of a level one [m], or `rbd.Ground(point=..., normal=...)`.
        pendular: The centre of mass stays at its height and the angular momentum about it is constant (linear pendulum); the
            region then depends on where the centre of mass is. False: any motion with a force that pushes along the normal.
        torque_limits: Whether motors keep within their limits, with the gravity torques and Jacobians of this pose; torques of
            the acceleration are left out.
        margin: Share of each coefficient of friction that is left unused.
        friction: "cone", the circular cones; "inscribed" or "circumscribed", the pyramids inside or around them.
        area_gap: With circular cones, by how much the area of the outer polygon may exceed that of the inner one [m2].

    Raises:
        InputError: no contacts, a plane that is not known; of a pendulum, one that is not level or at the centre of mass.
        NoSolution: a program was not solved.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> for pendular in (True, False):
        ...     region = rbd.statics.zmp_region(solo.standing(), solo.feet(friction=0.7), pendular=pendular)
        ...     print(f"{region.area:.3f} m2")
        0.067 m2
        0.131 m2
    """
    check_flag("pendular", pendular)
    check_flag("torque_limits of zmp_region", torque_limits)
    gap = check_area_gap(area_gap)
    ground = plane_of("the zero-moment point", on)
    rows = given_rows(state, contacts)
    loads = ForceBalance(state, rows, force_sets(rows, friction, margin), state.h)
    program = (_pendulum if pendular else _any_motion)(loads, ground, [loads.torque_rows] if torque_limits else [])
    found, ways, cut = planar_region(program, np.zeros(2), gap, state.robot.name)
    foot, axes = _foot(state, ground)[1], _plane_axes(ground)
    return ZmpRegion(
        loads, ground, friction, bool(pendular), foot + found.inner @ axes.T, foot + found.outer @ axes.T,
        found.x[:, : loads.sets.size], ways @ axes.T, cut,
    )  # fmt: skip


def wrench_map(rows: Sequence[Rows], sets_G: Array, about: Array) -> Array:
    """Wrench about a point of unit weights, world axes, shape (6, p); zero for what is no contact with the surroundings.

    Args:
        rows: The contacts' rows.
        sets_G: Row forces of unit weights, shape (m, p).
        about: The point in W, shape (3,) [m].
    """
    out = np.zeros((6, sets_G.shape[1]))
    for r, G in by_rows(rows, sets_G):
        if r.resultant is None or r.patch is None or r.patch.against is not None:
            continue
        wrench = r.resultant @ G
        out[:3] += wrench[:3]
        out[3:] += cross_matrix(r.patch.point - about) @ wrench[:3]
        if len(wrench) == 6:
            out[3:] += wrench[3:]
    return out


def _pendulum(loads: ForceBalance, ground: Ground, limits: Sequence[Any]) -> Conic:
    """X = (w, z - foot): M_c = 0, F_z = the weight's part along -z, and F along the line from z to c."""
    state, n = loads.state, np.asarray(ground.normal)
    height, g = float(ground.distances(state.com[None])[0]), state.robot.gravity
    if not ground.level:
        raise InputError("a linear pendulum moves on a level plane. Try on=0.0.")
    along_gravity(g, state.com)  # refuses one that is zero or level
    if not g[2] < 0.0:
        raise InputError(f"gravity is {g.tolist()}; expected one that pulls a linear pendulum towards its plane.")
    down = -float(g[2] / np.linalg.norm(g))
    if abs(height) < 1e-6:
        raise InputError("the plane of the zero-moment point goes through the centre of mass. Give another height.")
    W, E = wrench_map(loads.rows, loads.sets.G, state.com), _plane_axes(ground)
    along = {"forces": E.T @ W[:3], "point": down * np.eye(2) / height}  # F_t / F_z = (c - z)_t / height
    equations = [({"forces": W[3:]}, np.zeros(3)), ({"forces": n[None] @ W[:3]}, np.array([down])), (along, np.zeros(2))]
    return Conic.of({"forces": loads.block(), "point": Unknowns(2)}, equations, limits)


def _any_motion(loads: ForceBalance, ground: Ground, limits: Sequence[Any]) -> Conic:
    """X = (w, z - foot): F . n = the weight, and z = n x M_foot over it; larger forces have the same points."""
    n, foot = _foot(loads.state, ground)
    W, E = wrench_map(loads.rows, loads.sets.G, foot), _plane_axes(ground)
    across = {"forces": E.T @ cross_matrix(n) @ W[3:], "point": -np.eye(2)}
    equations = [({"forces": n[None] @ W[:3]}, np.ones(1)), (across, np.zeros(2))]
    return Conic.of({"forces": loads.block(), "point": Unknowns(2)}, equations, limits)


def _foot(state: State, ground: Ground) -> tuple[Array, Array]:
    """(n, the point of the plane nearest to the centre of mass)."""
    n = np.asarray(ground.normal)
    return n, state.com - float(ground.distances(state.com[None])[0]) * n


def _plane_axes(ground: Ground) -> Array:
    """Two unit vectors along the plane, x and y of a level one, as columns, shape (3, 2)."""
    return across(np.asarray(ground.normal)).T
