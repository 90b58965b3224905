"""Planar images of convex sets of forces: all (p, q) for which there are forces, as a polygon with its certificate.

    p in S     where     there is w with     A (w, p) = b,   low <= C (w, p) <= high,   w in intervals and circular cones

S is convex, and the point of it that is farthest along a direction d is a linear program, or one with cones. Each gives a point
of S, with forces w, and by its multipliers a half-plane d . p <= value that holds S. The points span the inner polygon, the
half-planes cut out the outer one; the next direction is across the edge where the two differ most [Bretl2008]. Without circular
cones S is a polygon, and the inner one ends as S itself.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from rbd.arrays import Array, check_whole
from rbd.constraints.convex.polygons import area_of, convex_hull, inside_distance, nearest_on_edge
from rbd.displayed import drawing
from rbd.errors import InaccurateWarning, NoSolution
from rbd.model.state import State
from rbd.problem.conic import Certificate, Conic
from rbd.problem.programs import POLYGON_PROGRAMS, Outcome, linear_program
from rbd.records import Field
from rbd.solvers.conic_newton import recession
from rbd.statics.force_balance import ForceBalance, contact_forces
from rbd.statics.force_program import SAME, Support, around, farthest

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

WITHIN_M = 10.0
"""A region is looked for so far around its contacts, and cut off there."""
_START = 0.1
"""Angle of the first direction: off the axes, along which many regions have edges, and an edge is no vertex."""


def inscribed_radius(vertices: Array) -> float:
    """Radius of the largest circle in a flat convex polygon [m]; zero of fewer than three corners.

    Args:
        vertices: Corners in order, shape (k, 2), or (k, 3) in a plane [m].
    """
    if len(vertices) < 3:
        return 0.0
    middle = vertices.mean(axis=0)
    flat = (vertices - middle) @ np.linalg.svd(vertices - middle)[2][:2].T
    along = np.roll(flat, -1, axis=0) - flat
    length = np.linalg.norm(along, axis=1)
    some = length > 0.0
    normals = np.stack([along[some, 1], -along[some, 0]], axis=1) / length[some, None]
    level = (normals * flat[some]).sum(axis=1)
    # The middle is inside: normals point outwards, or all of them inwards, which is the polygon turned by half a turn.
    found = linear_program(np.array([0.0, 0.0, -1.0]), np.column_stack([normals, np.ones(len(normals))]), np.abs(level))
    return float(found.x[2]) if found.outcome is Outcome.SOLVED else np.nan


class Region:
    """Where something may be in a plane: what support regions and zero-moment regions have in common."""

    loads: ForceBalance
    vertices: Array
    weights: Array
    directions: Array
    cut: bool

    fields: ClassVar[tuple[Field, ...]] = (
        Field("area", (), "m2", "area of the region; infinite where it has no end"),
        Field("empty", (), "", "whether there is no such place"),
        Field("bounded", (), "", "whether the region ends everywhere"),
        Field("cut", (), "", "whether it goes on beyond 10 m: area, distance and radius are then of the part within"),
        Field("inscribed_radius", (), "m", "radius of the largest circle inside", default=False),
    )

    @property
    def state(self) -> State:
        """The robot's state."""
        return self.loads.state

    @property
    def empty(self) -> bool:
        """Whether there is no such place."""
        return not len(self.vertices)

    @property
    def bounded(self) -> bool:
        """Whether the region ends everywhere."""
        return not len(self.directions)

    @property
    def inscribed_radius(self) -> float:
        """Radius of the largest circle inside [m]; infinite where the region has no end."""
        return inscribed_radius(self.vertices) if self.bounded else np.inf

    @property
    def area(self) -> float:
        """Of the polygon of `vertices` [m2]: of one that is `cut`, less than the region's; infinite where it has no end."""
        return area_of(self._outline[0]) if self.bounded else np.inf

    def forces(self, corner: int) -> dict[str, Array]:
        """{contact: force (3,) or wrench (6,) at the patch's centre}, world axes [N, N m], that certify a corner."""
        return contact_forces(self.loads, self.weights[self._corner(corner)])

    def plot(self, ax: Axes) -> list[Artist]:
        """Draw it from above: see `rbd.visual.plot_region`."""
        return drawing("plot_region")(ax, self)

    def _corner(self, corner: int) -> int:
        return check_whole("corner", corner, len(self.vertices) - 1, least=0)

    def to_edge(self, at: Array) -> tuple[float, bool]:
        """(distance, known): from a place in the plane to the edge of the polygon [m], and whether that is the region's.

        It is not where the polygon's edge is the cut: the region goes on there, and the distance is at least that.

        Args:
            at: Shape (2,), in the coordinates of `_outline`.
        """
        corners, middle = self._outline
        whole = inside_distance(at, corners)
        if not self.cut:
            return whole, True
        nearest = nearest_on_edge(at, corners)
        return whole, bool(np.abs(nearest - middle).max() < WITHIN_M * (1.0 - 1e-6))

    @property
    def _outline(self) -> tuple[Array, Array]:
        """(corners (k, 2), middle (2,)) of the polygon and of the square at which it is cut, in coordinates of the plane."""
        raise NotImplementedError

    def _distance(self, at: Array, *, stacklevel: int) -> float:
        """`to_edge`, with a warning where that is not known."""
        found, known = self.to_edge(at)
        if not known:
            warnings.warn(
                f"the region is known to {WITHIN_M:g} m, and goes on where it is cut: its edge there is at a signed distance "
                f"of {found:.4g} m or more. `region.cut` says which regions are cut.",
                InaccurateWarning,
                stacklevel=stacklevel + 1,
            )
        return found

    @property
    def cut_words(self) -> str:
        """What is printed beside its area."""
        return f", cut at {WITHIN_M:g} m" if self.cut and self.bounded else ""


@dataclass(frozen=True, eq=False)
class PlanarSet:
    """An inner and an outer polygon of S.

    Attributes:
        outcome: SOLVED; INFEASIBLE where S is empty; NOT_FOUND where a program was not solved.
        inner: Corners of the inner polygon, counterclockwise, shape (k, 2); two of a segment, one of a point, none if empty.
        x: The forces and parameters at each corner, shape (k, n).
        outer: Corners of the outer polygon, shape (j, 2).
        supports: Farthest points, by the angle of their directions.
        programs: How many programs that took.
        contradiction: Of an empty S, the certificate, if one came with the answer.
    """

    outcome: Outcome
    inner: Array
    x: Array
    outer: Array
    supports: tuple[Support, ...]
    programs: int
    contradiction: Certificate | None = None

    @classmethod
    def none(cls, outcome: Outcome, programs: int = 1, contradiction: Certificate | None = None) -> PlanarSet:
        """No polygon."""
        nothing = np.zeros((0, 2))
        return cls(outcome, nothing, nothing, nothing, (), programs, contradiction)


def planar_set(program: Conic, *, area_gap: float = 0.0) -> PlanarSet:
    """The polygon of a program whose p is bounded.

    Args:
        program: The program.
        area_gap: Outer less inner area that will do, unless that takes more than `POLYGON_PROGRAMS`; with 0 edges are followed
            until each is certified.
    """
    n, most = program.A.shape[1], POLYGON_PROGRAMS
    supports: list[Support] = []
    for angle in _START + np.arange(3) * (2.0 * np.pi / 3.0):
        found = farthest(program, np.append(np.zeros(n - 2), [np.cos(angle), np.sin(angle)]))
        if not found.answer.solved:
            return PlanarSet.none(found.answer.outcome, len(supports) + 1, found.answer.certificate)
        supports.append(found)
    open_ = [_between(supports[i], supports[(i + 1) % 3]) for i in range(3)]
    while sum(open_) > area_gap and len(supports) < most:
        i = int(np.argmax(open_))
        a, b = supports[i], supports[(i + 1) % len(supports)]
        along = b.point - a.point
        length = float(np.linalg.norm(along))
        if length <= SAME:
            open_[i] = 0.0
            continue
        found = farthest(program, np.append(np.zeros(n - 2), [along[1] / length, -along[0] / length]))
        if not found.answer.solved:
            return PlanarSet.none(Outcome.NOT_FOUND, len(supports) + 1)
        supports.insert(i + 1, found)
        if found.direction @ (found.point - a.point) <= SAME:  # an edge of the set
            open_[i : i + 1] = [0.0, 0.0]
        else:
            open_[i : i + 1] = [_between(a, found), _between(found, b)]
    if not area_gap and sum(open_) > 0.0:
        return PlanarSet.none(Outcome.NOT_FOUND, len(supports))
    return _polygons(tuple(supports))


def planar_region(program: Conic, middle: Array, area_gap: float, what: str) -> tuple[PlanarSet, Array, bool]:
    """(set, directions, cut): the polygon within `WITHIN_M`, directions without end (r, 2), and whether it goes on beyond.

    A warning of its caller's caller tells where inner and outer polygon differ by more than was asked for.

    Args:
        program: The program.
        middle: Where the region is looked for, shape (2,).
        area_gap: As of `planar_set`, where there are circular cones.
        what: What the region is of, for messages.

    Raises:
        NoSolution: a program was not solved.
    """
    program, round_ones = around(program, middle, WITHIN_M), len(program.mu) > 0
    found, directions = planar_set(program, area_gap=area_gap if round_ones else 0.0), np.zeros((0, 2))
    cut = len(found.inner) > 0 and bool(np.abs(found.inner - middle).max() >= WITHIN_M * (1.0 - 1e-6))
    outcome = found.outcome
    if cut:
        ends = planar_set(around(recession(program), np.zeros(2), 1.0), area_gap=1e-4 if round_ones else 0.0)
        outcome, length = ends.outcome, np.linalg.norm(ends.inner, axis=1)
        endless = length > 0.5  # cut at |p| <= 1: a direction without end reaches that
        directions = ends.inner[endless] / length[endless, None]
    if outcome is not Outcome.SOLVED and (cut or outcome is not Outcome.INFEASIBLE):
        raise NoSolution(f"{what}: a program of the region was not solved. Use fewer contacts.")
    gap = area_of(found.outer) - area_of(found.inner)
    if gap > area_gap * (1.0 + 1e-9) + 1e-9:
        warnings.warn(
            f"the region is known to {gap:.2g} m2 after {found.programs} programs; {area_gap:.2g} m2 was asked for: "
            "take a larger area_gap, or friction='inscribed'.",
            InaccurateWarning,
            stacklevel=3,
        )
    return found, directions, cut


def _between(a: Support, b: Support) -> float:
    """Area that may be of the set beyond the line from one farthest point to the next."""
    corner = _corner(a, b)
    u, v = b.point - a.point, corner - a.point
    return 0.5 * abs(float(u[0] * v[1] - u[1] * v[0]))


def _corner(a: Support, b: Support) -> Array:
    """Where two half-planes' edges meet; of parallel ones the farthest point between."""
    D = np.array([a.direction, b.direction])
    determinant = D[0, 0] * D[1, 1] - D[0, 1] * D[1, 0]
    if abs(determinant) < 1e-12:
        return b.point
    return np.array([a.value * D[1, 1] - b.value * D[0, 1], b.value * D[0, 0] - a.value * D[1, 0]]) / determinant


def _polygons(around: tuple[Support, ...]) -> PlanarSet:
    points = np.array([s.point for s in around])
    corners = convex_hull(points[different(points, 10.0 * SAME)])
    kept = [int(np.argmin(np.abs(points - corner).sum(axis=1))) for corner in corners]
    outer = convex_hull(np.array([_corner(s, around[(i + 1) % len(around)]) for i, s in enumerate(around)]))
    x = np.array([around[i].answer.x for i in kept])
    return PlanarSet(Outcome.SOLVED, points[kept] + 0.0, x, outer + 0.0, around, len(around))


def different(points: Array, within: float) -> list[int]:
    """Indices of points without those that repeat an earlier one."""
    out: list[int] = []
    for i, p in enumerate(points):
        if not any(np.abs(p - points[j]).max() <= within for j in out):
            out.append(i)
    return out
