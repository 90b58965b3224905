"""Constraints as contact points: Jacobian, velocity, J_dot v and gap of each of their points at a state.

A point has a set of impulses (a cone, a half-line, an interval, or the whole space), rows J, the velocity of those rows, their
J_dot v, and a gap, its distance from contact. Bilateral constraints and joint friction have a gap of -infinity: they always
act. A sole is given by its corners, each with the ground's normal, so that it can tip.

A kind of constraint gives them by `points(state, t)`; for others they come from rows, with `error` as the gap.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache, partial
from typing import Any, Protocol, TypeAlias

import numpy as np

from rbd.arrays import Array, as_array, as_finite, block_diagonal
from rbd.constraints.constraint import Constraint, anchored, member, rows_of
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.model.state import State
from rbd.problem.answer import corner_split
from rbd.problem.cones import Cone, Free
from rbd.problem.rows import Rows

ALWAYS = -np.inf
"""The gap of constraints that are always active."""
SLIDES = 1e-6
"""A point that slides more slowly than this [m/s] sticks."""
MARGIN = 0.05
"""Margin of contacts that appear and disappear [m]: points nearer than this are watched."""


@dataclass(frozen=True, eq=False)
class ContactPoints(Displayed):
    """The contact points of a constraint at one state, for simulation: k points, touching or near, with p rows in all.

    Attributes:
        names: Label of each point, constant over time: "left_sole_link_0:3" is corner 3 of that shape.
        positions: In W, shape (k, 3) [m].
        axes: R_WC (tangent, tangent, normal), shape (3, 3), or (k, 3, 3) of each; normal forces push the (first) body away.
        gaps: Distance along the normal, shape (k,) [m]; negative where shapes overlap, -inf for those always active.
        J: Jacobian of the points' rows, a point's normal row last, shape (p, nv).
        velocity: J v less the surface's velocity, shape (p,) [m/s].
        bias: J_dot v less the surface's acceleration, shape (p,) [m/s2].
        cones: Set of each point's forces, whose dimensions are the numbers of its rows.
        resultant: Maps the p row forces to the force (r = 3) or wrench (r = 6) on the robot in world axes, shape (r, p); None:
            the sum of the points' forces.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> points = solo.feet()[0].points(solo.standing())
        >>> points.names, points.positions.round(3), points.gaps.round(6), points.J.shape
        (('front_left:0',), array([[0.195, 0.169, 0.   ]]), array([0.]), (3, 18))
    """

    names: tuple[str, ...]
    positions: Array
    axes: Array
    gaps: Array
    J: Array
    velocity: Array
    bias: Array
    cones: tuple[Cone, ...]
    resultant: Array | None = None

    @classmethod
    def of(cls, measured: Measured) -> ContactPoints:
        """The contact points that a source gave at a state."""
        points, axes, of = measured.points, measured.axes, measured.structure
        assert points is not None and axes is not None
        names = tuple(f"{owner}:{number}" for owner, number in zip(of.owners, of.numbers, strict=True))
        resultant = measured.to_world
        if resultant is None:
            each = np.broadcast_to(axes, (len(points), 3, 3))
            resultant = np.hstack([np.zeros((3, 0)), *(R[:, 3 - w :] for R, w in zip(each, of.widths, strict=True))])
            if measured.arms is not None:
                moments = np.cross(np.repeat(measured.arms, of.widths, axis=0), resultant.T).T
                resultant = np.concatenate([resultant, moments])
        return cls(names, points, axes, measured.gap, measured.J, measured.velocity, measured.bias, of.cones, resultant)


@dataclass(frozen=True, eq=False)
class Structure:
    """The points of a source: the data that do not change with the state.

    Attributes:
        owners: Name of the constraint of each point.
        numbers: Number of each point among those of its constraint.
        cones: Set of each point's forces.
        pieces: Name of the piece of terrain that each point is on; none: they are not on terrain.
        sets: The different ones among these sets.
        which: Index of each point's set, shape (k,).
        widths: Number of rows of each point, shape (k,).
        normals: The row of each point's normal, shape (k,); its last.
    """

    owners: tuple[str, ...]
    numbers: tuple[int, ...]
    cones: tuple[Cone, ...]
    pieces: tuple[str, ...] = ()
    sets: tuple[Cone, ...] = field(init=False)
    which: Array = field(init=False)
    widths: Array = field(init=False)
    normals: Array = field(init=False)

    def __post_init__(self) -> None:
        different = {id(c): c for c in self.cones}
        place = {key: i for i, key in enumerate(different)}
        sets, which = tuple(different.values()), np.array([place[id(c)] for c in self.cones], int)
        widths = np.array([c.dim for c in sets], int)[which]
        self.__dict__.update(sets=sets, which=which, widths=widths, normals=np.cumsum(widths) - 1)


@dataclass(frozen=True, eq=False)
class Measured:
    """The points of a source at a state: k points with p rows in all.

    Attributes:
        structure: The points.
        J: Shape (p, nv).
        velocity: J v less the surface's velocity, shape (p,).
        bias: J_dot v less the surface's acceleration, shape (p,).
        gap: Shape (k,) [m, rad]; -inf for constraints that are always active.
        error: Position errors of bilateral rows, shape (p,); zero elsewhere.
        to_world: Maps the p row forces to the resultant on the robot in world axes, shape (r, p); None: row forces themselves,
            or the sum of the points' forces, with their moments if there are arms.
        arms: From its contact's centre to each point in W, shape (k, 3) [m]; None if the resultant is only a force.
        points: Positions of the points in W, shape (k, 3) [m], of a bilateral patch its corners; None if it is not a contact.
        axes: R_WC of the contact axes; (3, 3), or (k, 3, 3); None if it is not a contact.
        split: Of a bilateral patch: row forces (p,) -> the forces at its corners of least norm, shape (corners, 3), in W.
        pushes: Force on its point of a unit force of each row, in contact axes, shape (p, 3); None: along the last axes.
    """

    structure: Structure
    J: Array
    velocity: Array
    bias: Array
    gap: Array
    error: Array
    to_world: Array | None = None
    arms: Array | None = None
    points: Array | None = None
    axes: Array | None = None
    pushes: Array | None = None
    split: Callable[[Array], Array] | None = None


Group: TypeAlias = tuple[Callable[[Sequence[Any], State], "PointSource"], Hashable]


class PointSource(Protocol):
    """Protocol: gives points at a state."""

    @property
    def group(self) -> Group | None:
        """(type that computes several sources at once, key of the sources that it takes together); None for a single source."""

    def at(self, state: State, t: float) -> Measured:
        """Its points at a state and a time [s]."""

    def gaps(self, state: State, t: float) -> Array:
        """Gaps, shape (k,) [m, rad]: `at(state, t).gap` to rounding, computed faster where possible."""


def sources_of(constraints: Sequence[Constraint], start: State) -> list[PointSource]:
    """The sources of a motion's constraints, in their order; a group is at the position of its first member."""
    out = [_source(constraint, start) for constraint in constraints]
    for group in dict.fromkeys(source.group for source in out if source.group is not None):
        alike = [source for source in out if source.group == group]
        if len(alike) > 1:
            together = group[0](alike, start)
            out = [together if s is alike[0] else s for s in out if s is alike[0] or s not in alike]
    return out


def _source(constraint: Constraint, start: State) -> PointSource:
    """The source of one constraint: given by itself, by its points, or by its rows."""
    prepared = member(constraint, "source")
    source = prepared(start) if callable(prepared) else None
    if source is not None:
        return source if source.group is not None or _pieces(source.at(start, 0.0).structure) is None else ByParts(source)
    with_margin = member(constraint, "with_margin")
    if callable(with_margin):  # points that appear and disappear, within a margin
        constraint = with_margin(MARGIN)
    points = member(constraint, "points")
    if callable(points) and points(start, 0.0) is not None:
        return ByParts(FromPoints(constraint.name, points))
    (rows,) = rows_of(start, (constraint,))
    return FromRows(anchored(constraint, rows, start))


class ByParts:
    """The points of a source with a cone, a half-line or an interval each: other sets become the parts that make them.

    A point of another set becomes one for each part, at the same place and with the same gap: their forces add up.
    """

    group = None

    def __init__(self, source: PointSource) -> None:
        self.source = source

    def at(self, state: State, t: float) -> Measured:
        """Its points."""
        m = self.source.at(state, t)
        found = _pieces(m.structure)
        if found is None:
            return m
        structure, G, of, pushes = found
        given = ContactPoints.of(m)
        axes = given.axes if given.axes.ndim == 2 else given.axes[of]
        return Measured(
            structure, G.T @ m.J, G.T @ m.velocity, G.T @ m.bias, m.gap[of], G.T @ m.error, given.resultant @ G,
            None, given.positions[of], axes, pushes,
        )  # fmt: skip

    def gaps(self, state: State, t: float) -> Array:
        """The gaps of `at`."""
        return self.at(state, t).gap


@lru_cache(maxsize=512)
def _pieces(structure: Structure) -> tuple[Structure, Array, Array, Array] | None:
    """(points of the parts, G, point of each part, forces of unit weights) of points; None where each set is a part."""
    sources = [(np.eye(c.dim), (c,)) if c.bilateral else _alone(c) for c in structure.cones]
    if all(len(cones) == 1 and np.array_equal(G, np.eye(len(G))) for G, cones in sources):
        return None
    counts = [len(cones) for _, cones in sources]
    of = np.repeat(np.arange(len(counts)), counts)
    most = max(counts)
    numbers = tuple(most * n + i for n, k in zip(structure.numbers, counts, strict=True) for i in range(k))
    cones = tuple(cone for _, cones in sources for cone in cones)
    pushes = np.concatenate([np.hstack([np.zeros((G.shape[1], 3 - len(G[:3]))), G[:3].T]) for G, _ in sources])
    return (
        Structure(tuple(structure.owners[i] for i in of), numbers, cones),
        block_diagonal([G for G, _ in sources]),
        of,
        pushes,
    )


def _alone(cone: Cone) -> tuple[Array, tuple[Cone, ...]]:
    G, parts = cone.generators()
    return G, tuple(part.alone() for part in parts)


class FromPoints:
    """Source from a constraint's `points`; each point keeps its number throughout a motion."""

    group = None

    def __init__(self, name: str, points: Callable[[State, float], ContactPoints]) -> None:
        self.name, self._points = name, points
        self._numbers: dict[tuple[str, int], int] = {}
        self._seen: dict[tuple[tuple[str, ...], tuple[Cone, ...]], Structure] = {}

    def at(self, state: State, t: float) -> Measured:
        """Its points."""
        found = self._points(state, t)
        if not isinstance(found, ContactPoints):
            raise InputError(
                f"points of {self.name!r:.80} gave a {type(found).__name__} in place of rbd.constraints.ContactPoints."
            )
        x = _checked(self.name, found, len(state.v))
        structure = self._numbered(x.names, x.cones)
        return Measured(structure, x.J, x.velocity, x.bias, x.gaps, np.zeros(len(x.J)), x.resultant, None, x.positions, x.axes)

    def gaps(self, state: State, t: float) -> Array:
        """The gaps of `at`."""
        return self.at(state, t).gap

    def label(self, number: int) -> str:
        """The label of a point, by its number in this motion."""
        return next(label for (label, _), n in self._numbers.items() if n == number)

    def _numbered(self, labels: tuple[str, ...], cones: tuple[Cone, ...]) -> Structure:
        """The points in the order in which their labels first appeared; the same object for the same points."""
        known = self._seen.get((labels, cones))  # the sets can change with the state, e.g. friction
        if known is None:
            times = [labels[:i].count(label) for i, label in enumerate(labels)]  # two points can have one label
            numbers = tuple(self._numbers.setdefault(one, len(self._numbers)) for one in zip(labels, times, strict=True))
            known = self._seen[labels, cones] = Structure((self.name,) * len(labels), numbers, cones)
        return known


def _checked(owner: str, found: ContactPoints, nv: int) -> ContactPoints:
    """The result of a user's `points`, as arrays.

    Raises:
        InputError: inconsistent sizes, or numbers that are not finite; gaps may be infinite.
    """
    names, cones = (() if isinstance(given, str) else tuple(given) for given in (found.names, found.cones))
    k, dims = len(names), [getattr(cone, "dim", None) for cone in cones]
    if len(cones) != k or not all([isinstance(dim, int) for dim in dims]):
        raise InputError(
            f"points of {owner!r:.80}: names are {found.names!r:.80}, cones {found.cones!r:.80}; expected a label and a set of "
            'forces for each point, e.g. names=("toe",), cones=(rbd.problem.FrictionCone(0.5),).'
        )
    p = sum(dims)  # type: ignore[arg-type]  # whole numbers
    told = f"of the points of {owner!r:.80}"
    gaps = as_array(f"gaps {told}", found.gaps)
    if gaps.shape != (k,):
        raise InputError(f"gaps {told} has shape {gaps.shape}; expected ({k},).")
    if np.isnan(gaps).any():
        raise InputError(f"gaps {told} is {gaps!r:.80}; expected distances [m], -inf for points that are always active.")
    arrays: dict[str, Array | None] = {
        what: as_finite(f"{what} {told}", getattr(found, what), *shapes)
        for what, *shapes in (
            ("positions", (k, 3)), ("axes", (3, 3), (k, 3, 3)), ("J", (p, nv)), ("velocity", (p,)), ("bias", (p,)),
        )
    }  # fmt: skip
    arrays |= {"gaps": gaps, "resultant": None}
    if found.resultant is not None:
        arrays["resultant"] = as_finite(f"resultant {told}", found.resultant, (3, p), (6, p))
    return ContactPoints(names, cones=cones, **arrays)  # type: ignore[arg-type]  # only the resultant may be None


class FromRows:
    """Source from a constraint's rows, those of patches at their corners."""

    group = None

    def __init__(self, constraint: Constraint) -> None:
        self.constraint = constraint

    def at(self, state: State, t: float) -> Measured:
        """Its rows."""
        (rows,) = rows_of(state, (self.constraint,))
        structure = _whole(rows.name, rows.cone)
        parts = _pieces(structure)
        structure, local = (structure, None) if parts is None else parts[:2]
        error = np.zeros(len(rows)) if rows.error is None else rows.error
        J, velocity, bias = rows.J, rows.velocity, rows.bias
        to_world = rows.resultant
        if local is not None:
            bias = local.T @ bias + rows.cone.inward(velocity)
            J, velocity, error = local.T @ J, local.T @ velocity, local.T @ error
            to_world = None if to_world is None else to_world @ local
        if not len(rows):
            return Measured(structure, J, velocity, bias, np.zeros(0), error, to_world)
        pushes = _pushes(structure)
        gap = np.where(pushes, error[structure.normals] if rows.error is not None else 0.0, ALWAYS)
        kept = np.repeat(~pushes, structure.widths)
        points, axes, split = _places(rows, len(gap))
        return Measured(
            structure, J, velocity, bias, gap, np.where(kept, error, 0.0), to_world, None, points, axes, split=split
        )  # fmt: skip

    def gaps(self, state: State, t: float) -> Array:
        """The gaps of `at`."""
        return self.at(state, t).gap


def _places(rows: Rows, k: int) -> tuple[Array | None, Array | None, Callable[[Array], Array] | None]:
    """(points (k, 3), axes (3, 3)) of a patch; of a bilateral one its corners, and what splits its forces among these."""
    if rows.patch is None:
        return None, None, None
    whole = len(rows.patch.corners) != k
    split = partial(corner_split, rows) if whole and isinstance(rows.cone, Free) and rows.resultant is not None else None
    corners = np.zeros((k, 3)) if whole and split is None else rows.patch.corners
    return rows.patch.point + corners @ rows.patch.axes.T, rows.patch.axes, split


@lru_cache(maxsize=512)
def _whole(name: str, cone: Cone) -> Structure:
    """All rows of a set as one point; no point without rows."""
    return Structure((name,), (0,), (Free(cone.dim) if cone.bilateral else cone,)) if cone.dim else Structure((), (), ())


@lru_cache(maxsize=512)
def _pushes(structure: Structure) -> Array:
    """Which points are unilateral along their normal, shape (k,)."""
    return np.array([not (c.bilateral or c.bounded) for c in structure.cones], bool)
