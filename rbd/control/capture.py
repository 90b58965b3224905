"""Capture regions: from which velocities a robot comes to rest on its contacts, without a step; bounded from both sides.

With the centre of mass c at a height h over level contacts, w = sqrt(g / h), and the capture point x = c + c' / w:

inside     The motion  c(t) = x + (c(0) - x) exp(-w t)  comes to rest over x. At all times it takes the force m (w^2 (c - x), g)
           through c, from the point x of the ground: s = exp(-w t) of the first one, and 1 - s of the weight's, applied at x.
           So forces within their cones, and torques within their limits, at its beginning and its end suffice at all times;
           and the places x for which there are such forces are convex.
outside    About an edge of the contacts' hull no force from the ground turns the robot back. With u the distance of c beyond
           the edge over its height z, K the angular momentum about the edge, |L| <= Lmax about c, and z below a height H,

               K' >= m g z u,    u' = (K - L) / (m z^2)        so, while u < 0,    (K - Lmax)^2 - m^2 g H^3 u^2  does not fall:

           where K - Lmax > m sqrt(g H^3) |u| the centre of mass passes the edge with K > Lmax, and K never falls again.

The first is the motion of a linear inverted pendulum [Kajita2003]; x is its divergent component of motion [Englsberger2015].
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from rbd.arrays import Array, as_finite, check_flag, check_number, lazy
from rbd.constraints.constraint import Constraint, with_loops
from rbd.constraints.convex.polygons import area_of, convex_hull, half_planes, inside_distance, overlap
from rbd.displayed import Displayed, drawing
from rbd.errors import InputError
from rbd.model.state import State, checked
from rbd.problem.programs import Outcome, linear_program
from rbd.records import Field
from rbd.statics.force_balance import contact_forces
from rbd.statics.regions import SupportRegion, support_region
from rbd.statics.zero_moment_point import ZmpRegion, zmp_region

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

LEVEL_M = 1e-3
"""Contacts are on one level plane where none of their points is farther from it [m]."""
MOMENTUM = 0.1
"""The angular momentum that is assumed to be the largest, over m h sqrt(g h)."""


@dataclass(frozen=True, eq=False)
class CaptureRegion(Displayed):
    """Where the capture point may be for a robot to come to rest on its contacts, without a step.

    Attributes:
        state: The robot; `capture_point` is that of its velocity.
        begin: Points of the ground from which the first force may come: a `ZmpRegion`.
        end: Places over which it may rest: a `SupportRegion`.
        inner: Corners of a polygon, counterclockwise, shape (k, 2) [m]: from each capture point in it a motion to rest is
            certified, with the centre of mass at its height and no angular momentum. None where it is empty.
        outer: Corners of a polygon, shape (j, 2) [m]: from no capture point outside it can the robot come to rest.
        height: Of the centre of mass over the contacts now [m].
        highest: Up to which height it may come [m], in the bound `outer`.
        momentum: The largest angular momentum about a level axis [N m s], in the same.
        torque_limits: Whether motors keep within their limits, at this pose, in the motions of `inner`.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> region = rbd.control.capture_region(solo.standing(), solo.feet(friction=0.7))
        >>> print(region)
        without a step it comes to rest from capture points in 674.13 cm2, and from none outside 1636.76 cm2
        >>> region.contains([0.1, 0.0]), region.beyond([0.3, 0.0])
        (True, True)
    """

    state: State
    begin: ZmpRegion
    end: SupportRegion
    inner: Array
    outer: Array
    height: float
    highest: float
    momentum: float
    torque_limits: bool

    fields: ClassVar[tuple[Field, ...]] = (
        Field("area", (), "m2", "area of the inner polygon"),
        Field("rate", (), "1/s", "rate w at which capture points move away"),
    )

    @property
    def area(self) -> float:
        """Of the inner polygon [m2]."""
        return area_of(self.inner)

    @property
    def rate(self) -> float:
        """At which capture points move away, w = sqrt(g / h) [1/s]."""
        return float(np.sqrt(np.linalg.norm(self.state.robot.gravity) / self.height))

    @lazy
    def capture_point(self) -> Array:
        """Of the state, c + c' / w, shape (2,) [m]."""
        A_g, _, mass = self.state.centroidal()
        return np.asarray((self.state.com + (A_g @ self.state.v)[:3] / (mass * self.rate))[:2])

    def contains(self, point: Sequence[float] | Array) -> bool:
        """Whether it comes to rest from a capture point by the motion that is certified; False says nothing.

        Args:
            point: Shape (2,) [m].
        """
        return inside_distance(_point(point), self.inner) >= 0.0

    def beyond(self, point: Sequence[float] | Array) -> bool:
        """Whether no motion comes to rest from a capture point, within the largest height and angular momentum.

        Args:
            point: Shape (2,) [m].
        """
        return inside_distance(_point(point), self.outer) < 0.0

    def com(self, point: Sequence[float] | Array, t: float) -> tuple[Array, Array]:
        """(centre of mass, its velocity) of the motion to rest from a capture point, at a time [s], shapes (3,) [m, m/s].

        Args:
            point: Shape (2,) [m].
            t: Time [s].
        """
        x, c = _point(point), self.state.com
        left = np.exp(-self.rate * t) * (c[:2] - x)
        return np.array([*(x + left), c[2]]), np.array([*(-self.rate * left), 0.0])

    def forces(self, point: Sequence[float] | Array, t: float) -> dict[str, Array]:
        """{contact: force (3,) or wrench (6,) at the patch's centre} of that motion, world axes [N, N m].

        Args:
            point: Shape (2,) [m], in the inner polygon.
            t: Time [s].

        Raises:
            InputError: a point outside the inner polygon.
        """
        x, left = _point(point), float(np.exp(-self.rate * t))
        first, last = (_mixed(x, region.vertices[:, :2], region.weights) for region in (self.begin, self.end))
        return contact_forces(self.end.loads, left * first + (1.0 - left) * last)

    def plot(self, ax: Axes) -> list[Artist]:
        """Draw it from above: see `rbd.visual.plot_capture`."""
        return list(drawing("plot_capture")(ax, self))

    def __str__(self) -> str:
        return (
            f"without a step it comes to rest from capture points in {1e4 * self.area:.2f} cm2, and from none outside "
            f"{1e4 * area_of(self.outer):.2f} cm2"
        )


def capture_region(
    state: State,
    contacts: Sequence[Constraint],
    *,
    torque_limits: bool = True,
    momentum: float | None = None,
    highest: float | None = None,
    margin: float = 0.0,
    friction: str = "cone",
    loops: bool = True,
) -> CaptureRegion:
    """From which velocities a robot comes to rest on its contacts, as a region of capture points; bounded from both sides.

    The centre of mass is where it is in the state, and its velocity any level one. `inner` is where `zmp_region` of a pendulum,
    for the beginning of the motion, and `support_region`, for its end, overlap: with the forces of both every motion from
    there to rest is certified. `outer` is the contacts' hull, each edge moved out by

        (Lmax / (m h w)) + ((H / h)^1.5 - 1) d,        d the distance of the centre of mass from the edge:

    beyond it no force of the contacts can hold the robot. A point mass that stays at its height, on soles with enough friction,
    has both equal to the soles' hull.

    Neglected in `inner`: what the accelerations of the motion, and other poses, change in torques. Neglected in `outer`:
    friction and torques; it is of no use for robots that jump.

    Args:
        state: The robot with its velocity; contacts carry it, standing.
        contacts: What it stands on, at least one, on one level plane.
        torque_limits: Whether motors are to keep within their limits, at this pose, in the motions of `inner`.
        momentum: The largest angular momentum about a level axis through the centre of mass [N m s], for `outer`; None:
            0.1 m h sqrt(g h).
        highest: The largest height of the centre of mass over the contacts [m], for `outer`; None: that of the state.
        margin: Share of each coefficient of friction that is left unused in `inner`.
        friction: "cone", "inscribed" or "circumscribed", as of `support_region`.
        loops: Whether the robot's own loops hold; one that is given counts once.

    Raises:
        InputError: contacts that are not on one level plane, or no contacts; a robot that is fixed to the world; numbers out of
            range.
        NoSolution: a program was not solved.

    Example:
        >>> talos = rbd.load_robot("talos")
        >>> region = rbd.control.capture_region(talos.standing(), talos.soles(friction=0.7))
        >>> print(f"{region.area:.3f} m2 of the soles' {0.0571:.3f} m2")
        0.057 m2 of the soles' 0.057 m2
    """
    check_flag("torque_limits", torque_limits)
    robot = checked(state).robot
    pose = State(robot, state.q)
    held = with_loops(robot, contacts, loops)
    end = support_region(pose, held, torque_limits=torque_limits, margin=margin, friction=friction, loops=False)
    patches = [r.patch for r in end.loads.rows if r.patch is not None and len(r.patch.corners)]
    corners = np.concatenate([np.zeros((0, 3)), *[p.corners_W for p in patches]])
    level = float(corners[:, 2].mean()) if len(corners) else 0.0
    if not len(corners) or np.ptp(corners[:, 2]) > 2.0 * LEVEL_M or any(abs(p.axes[2, 2]) < 1.0 - 1e-4 for p in patches):
        low, high = (corners[:, 2].min(), corners[:, 2].max()) if len(corners) else (np.nan, np.nan)
        raise InputError(
            f"contacts of capture_region are at heights from {low:.4g} to {high:.4g} m, or lean; expected all on one level "
            "plane. `rbd.control.Balance` plans steps on others."
        )
    h = float(state.com[2]) - level
    if not h > 0.0:
        raise InputError(f"the centre of mass of {robot.name} is {h:.3g} m over its contacts; expected it above them.")
    g = float(np.linalg.norm(robot.gravity))
    w, mass = np.sqrt(g / h), robot.mass
    usual = mass * h * np.sqrt(g * h)
    most, top = MOMENTUM * usual, h
    if momentum is not None:
        most = check_number("momentum of capture_region", momentum, 0.0, 1e3 * usual, expected="[N m s]")
    if highest is not None:
        top = check_number("highest of capture_region", highest, h, 1e3 * h, expected=f"a height of {h:.3g} m or more")
    begin = zmp_region(pose, held, on=level, torque_limits=torque_limits, margin=margin, friction=friction)
    both = overlap(begin.vertices[:, :2].tolist(), end.vertices.tolist())
    inner = convex_hull(np.array(both)) if len(both) else np.zeros((0, 2))
    hull = convex_hull(corners[:, :2])
    return CaptureRegion(
        state, begin, end, inner, _moved_out(hull, state.com[:2], most / (mass * h * w), (top / h) ** 1.5 - 1.0), h, top,
        float(most), bool(torque_limits),
    )  # fmt: skip


def _moved_out(hull: Array, com: Array, by: float, share: float) -> Array:
    """The hull, with its edges moved outwards: corners of what is left, counterclockwise."""
    if len(hull) < 3:  # a line or a point: a robot that is balanced on it
        raise InputError("contacts of capture_region are in one line; expected points around an area.")
    normals, offsets = half_planes(hull)
    inside = normals @ com - offsets
    sides = offsets - by - np.where(inside > 0.0, share * inside, -inside)
    pairs = np.column_stack([np.arange(len(hull)), np.roll(np.arange(len(hull)), 1)])
    return np.array([np.linalg.solve(normals[pair], sides[pair]) for pair in pairs])


def _mixed(x: Array, corners: Array, weights: Array) -> Array:
    """Forces of a point of a polygon, of those of its corners."""
    n = len(corners)
    A = np.vstack([corners.T, np.ones(n)]) if n else np.zeros((3, 0))
    shares = np.tile([0.0, 1.0], (n, 1))
    found = linear_program(np.zeros(n), np.zeros((0, n)), np.zeros(0), A, np.array([*x, 1.0]), bounds=shares)
    if found.outcome is not Outcome.SOLVED:
        raise InputError(f"point is {np.round(x, 4).tolist()}; expected one in the inner polygon.")
    return np.asarray(found.x @ weights)


def _point(given: Sequence[float] | Array) -> Array:
    return as_finite("capture point", given, (2,))
