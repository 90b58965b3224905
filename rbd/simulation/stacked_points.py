"""The contact points of all constraints stacked at one state, matched from one step to the next."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache, lru_cache, partial
from itertools import chain, repeat
from types import ModuleType
from typing import Any, Protocol

import numpy as np

from rbd.arrays import Array, lazy, locked, zeros
from rbd.constraints.contact_points import Measured, PointSource, Structure
from rbd.model.state import State
from rbd.problem.cones import Cone

_MOST_LAYOUTS = 1000
"""Number of cached layouts; tumbling shapes can have a new one at every step."""


@dataclass(frozen=True, eq=False)
class PointLayout:
    """The points of all sources: constructed only when points appear or vanish.

    Attributes:
        structures: Structure of each source.
        owners: Constraint of each point, shape (k,).
        numbers: Number of each point among its constraint's.
        cones: Set of each point's forces.
        widths: Rows of each point, shape (k,).
        normals: Row of each point's normal, shape (k,).
        pushes: Which points are unilateral, shape (k,).
        rubs: Which of them have friction, shape (k,).
        slides: Which points can slide: those with friction, and intervals, shape (k,).
        sliding_rows: The two rows of each of those along which it slides, shape (sum of slides, 2); for an interval, one twice.
        sliding_kept: One, or zero for the second of an interval, shape (sum of slides, 2).
        held: Which rows are bilateral, shape (p,).
        mu: Friction coefficients, shape (k,); zero without friction.
        spans: (points, rows) of each source.
        boxed: Whether some point's forces are bounded by numbers.
        computed: Cached results for this layout, by the function that uses them.
    """

    structures: tuple[Structure, ...]
    owners: tuple[str, ...]
    numbers: tuple[int, ...]
    cones: tuple[Cone, ...]
    widths: Array
    normals: Array
    pushes: Array
    rubs: Array
    slides: Array
    sliding_rows: Array
    sliding_kept: Array
    held: Array
    mu: Array
    spans: tuple[tuple[slice, slice], ...]
    boxed: bool
    computed: dict[object, Any] = field(default_factory=dict, repr=False)

    @lazy
    def pieces(self) -> tuple[str, ...]:
        """Name of the piece of terrain that each point is on, shape (k,); empty where it is not on terrain."""
        return tuple(chain.from_iterable([s.pieces or ("",) * len(s.owners) for s in self.structures]))

    @lazy
    def bilateral(self) -> bool:
        """Whether some row is bilateral."""
        return bool(self.held.any())

    @lazy
    def everything(self) -> Array:
        """True for each point, shape (k,). Always the same array, so that `is` tells whether a set has all points."""
        return locked(np.ones(len(self.owners), bool))

    @lazy
    def nothing(self) -> Array:
        """No point, likewise."""
        return locked(np.zeros(len(self.owners), bool))

    @lazy
    def at_rest(self) -> Array:
        """Velocities of points at rest, shape (p,), likewise: those of answers of prepared forms in which all stick."""
        return zeros(len(self.held))

    @classmethod
    def of(cls, structures: tuple[Structure, ...]) -> PointLayout:
        """The stack of several sources' points."""
        widths = np.concatenate([np.zeros(0, int), *[s.widths for s in structures]])
        spans, point, row = [], 0, 0
        for s in structures:
            k, m = len(s.owners), int(s.widths.sum())
            spans.append((slice(point, point + k), slice(row, row + m)))
            point, row = point + k, row + m
        normals = np.cumsum(widths) - 1
        rubs = _each(structures, lambda c: c.dim == 3 and not c.bilateral, bool)
        boxes = _each(structures, lambda c: c.bounded, bool)
        free = _each(structures, lambda c: c.bilateral, bool)
        mu = _each(structures, lambda c: getattr(c, "mu", 0.0), float)
        slides = rubs | boxes
        rows = normals[slides][:, None] - np.where(rubs[slides][:, None], [2, 1], 0)
        kept = np.where(rubs[slides][:, None], 1.0, [1.0, 0.0]).reshape(-1, 2)
        return cls(
            structures,
            tuple(chain.from_iterable([s.owners for s in structures])),
            tuple(chain.from_iterable([s.numbers for s in structures])),
            tuple(chain.from_iterable([s.cones for s in structures])),
            widths,
            normals,
            ~(free | boxes),
            rubs,
            slides,
            rows,
            kept,
            np.repeat(free, widths),
            mu,
            tuple(spans),
            bool(boxes.any()),
        )


@dataclass(frozen=True, eq=False)
class PointPlaces:
    """Where the points of a source are at n states, and what their forces come to: attributes as of `Measured`, stacked.

    `axes` have shape (n, k, 3, 3); n and k are 1 where they are the same for all. `pushes` and `split` are of all states.
    """

    structure: Structure
    points: Array | None
    axes: Array | None
    arms: Array | None
    to_world: Array | None
    pushes: Array | None = None
    split: Callable[[Array], Array] | None = None


class PreparedPoints(Protocol):
    """The prepared form of one set of points, for the steps of one motion: `rbd.simulation.ground_dynamics.GroundDynamics`."""

    def at(self, state: State, t: float) -> Snapshot:
        """All points at a state."""

    def located(self, X: Array) -> Sequence[PointPlaces]:
        """Where the points of each source are, by placements of the bodies at n states."""

    def points_of_rows(self, X: Array) -> Array:
        """Velocities of the points for unit velocities of the bodies' rows."""

    def toward(self, state: State, closes: Array, gap: Array) -> Array:
        """The least displacement that closes the gaps of some points."""

    def answer(
        self, equations: Any, applied: Array, guess: Array, *, law: str, shift: Array | None, added: Array | None = None
    ) -> Any:
        """Velocity and impulses of one half of a step; None where the general way is to answer."""

    def residual(self, at: Snapshot, applied: Array, a: Array, u: Array, h: float, answer: Any) -> float:
        """Residual of a half step by another route than its answer's."""


@dataclass(frozen=True, eq=False)
class Snapshot:
    """All points at one state, stacked; Jacobians and J_dot v are computed when first asked.

    Attributes:
        state: The state.
        layout: The points.
        velocity: Shape (p,).
        gap: Shape (k,).
        error: Position errors of bilateral rows, shape (p,).
        measure: Gives the points of each source.
        ground: Their prepared form, of points on planes at rest.
        placed: Placements of their bodies, of that form.
    """

    state: State
    layout: PointLayout
    velocity: Array
    gap: Array
    error: Array
    measure: Callable[[], Sequence[Measured]] = field(repr=False)
    ground: PreparedPoints | None = field(default=None, repr=False)
    placed: Array = field(default_factory=partial(zeros, 0), repr=False)

    @classmethod
    def of(cls, state: State, layout: PointLayout, measured: Sequence[Measured]) -> Snapshot:
        """The stack of the points of all sources."""
        velocity, gap, error = (_stacked(measured, what) for what in ("velocity", "gap", "error"))
        return cls(state, layout, velocity, gap, error, lambda: measured)

    @lazy
    def sources(self) -> tuple[Measured, ...]:
        """The points of each source."""
        return tuple(self.measure())

    @property
    def places(self) -> Sequence[PointPlaces]:
        """Where the points of each source are, stacks of one state."""
        return places_of([self])

    @lazy
    def J(self) -> Array:
        """Jacobian of all rows, shape (p, nv)."""
        return _stacked(self.sources, "J") if self.sources else np.zeros((0, self.state.robot.nv))

    @property
    def reach(self) -> Array:
        """A matrix with p rows, such as J, of which forces have the same product where they have the same J^T f."""
        return self.J if self.ground is None else self.ground.points_of_rows(self.placed)

    @lazy
    def bias(self) -> Array:
        """J_dot v of all rows, shape (p,)."""
        return _stacked(self.sources, "bias")

    @lazy
    def extremes(self) -> tuple[float, float, float]:
        """The least gap of unilateral points, the largest of all, and the least normal velocity; infinite without points."""
        gap = self.gap[self.layout.pushes]
        return float(gap.min(initial=np.inf)), float(self.gap.max(initial=-np.inf)), float(self.approach.min(initial=np.inf))

    @property
    def approach(self) -> Array:
        """Normal velocity of each point, shape (k,): negative where it approaches."""
        return self.velocity[self.layout.normals]

    @property
    def drift(self) -> float:
        """Largest position error of the bilateral rows; others have none."""
        return float(np.abs(self.error).max(initial=0.0)) if self.layout.bilateral else 0.0

    @property
    def drift_rate(self) -> float:
        """Largest velocity of the bilateral rows."""
        return float(np.abs(self.velocity[self.layout.held]).max(initial=0.0)) if self.layout.bilateral else 0.0

    @property
    def penetration(self) -> float:
        """Depth of the deepest point."""
        return max(0.0, -self.extremes[0])


def places_of(snapshots: Sequence[Snapshot]) -> Sequence[PointPlaces]:
    """Where the points of each source are at several states: with the same `ground`, or of one."""
    first = snapshots[0]
    if first.ground is not None:
        return first.ground.located(np.array([at.placed for at in snapshots]))
    out = []
    for m in first.sources:
        points, arms, to_world = (None if x is None else x[None] for x in (m.points, m.arms, m.to_world))
        axes = None if m.axes is None else m.axes.reshape(1, -1, 3, 3)
        out.append(PointPlaces(m.structure, points, axes, arms, to_world, m.pushes, m.split))
    return out


class Points:
    """The sources of a motion; the same points always have the same layout object."""

    def __init__(self, sources: Sequence[PointSource]) -> None:
        self.sources = tuple(sources)
        self._layouts: dict[tuple[Structure, ...], PointLayout] = {}

    def at(self, state: State, t: float) -> Snapshot:
        """All points at a state and a time [s]."""
        measured = [s.at(state, t) for s in self.sources]
        return Snapshot.of(state, self.layout(tuple([m.structure for m in measured])), measured)

    def layout(self, structures: tuple[Structure, ...]) -> PointLayout:
        """The stack of the points of all sources: the same object for the same points."""
        layout = self._layouts.get(structures)
        if layout is None:
            if len(self._layouts) >= _MOST_LAYOUTS:
                self._layouts.clear()
            layout = self._layouts[structures] = PointLayout.of(structures)
        return layout


def _stacked(measured: Sequence[Measured], what: str) -> Array:
    """One of the arrays of several sources' points, of all of them."""
    if len(measured) == 1:
        return np.asarray(getattr(measured[0], what))
    return np.concatenate([getattr(m, what) for m in measured]) if measured else np.zeros(0)


class PointMatching:
    """Matches the points of two layouts: a point is the one of the same constraint and number.

    Args:
        old: The layout of given arrays.
        new: The layout of the results.

    Attributes:
        known: Which points existed before, shape (k,).
    """

    def __init__(self, old: PointLayout, new: PointLayout) -> None:
        self.same = old is new
        self._from, self._rows, self.known = _matched(old, new)

    def points(self, values: Array, otherwise: object) -> Array:
        """One value a point, shape (k,)."""
        if self.same:
            return values
        out = np.full(len(self._from), otherwise, dtype=values.dtype)
        out[self.known] = values[self._from[self.known]]
        return out

    def rows(self, values: Array) -> Array:
        """One value a row, shape (p,); zero for new points."""
        if self.same:
            return values
        known = self._rows >= 0
        out = np.zeros(len(self._rows))
        out[known] = values[self._rows[known]]
        return out


def _each(structures: Sequence[Structure], value: Callable[[Cone], object], kind: type) -> Array:
    """A value of each point's set, shape (k,)."""
    parts: list[Array] = [np.array([value(c) for c in s.sets], kind)[s.which] for s in structures]
    return np.concatenate([np.zeros(0, kind), *parts])


@lru_cache(maxsize=16)
def _matched(old: PointLayout, new: PointLayout) -> tuple[Array, Array, Array]:
    """(old point of each new one, old row of each new row, both -1 where there is none, which points are known).

    A step asks for the same two layouts several times.
    """
    at = dict(zip(zip(old.owners, old.numbers, strict=True), range(len(old.owners)), strict=True))
    points = np.array([*map(at.get, zip(new.owners, new.numbers, strict=True), repeat(-1))], int)
    known = points >= 0
    before = (old.normals + 1 - old.widths)[points[known]]
    rows = np.full(int(new.widths.sum()), -1)
    widths = new.widths[known]
    starts = np.cumsum(widths) - widths
    rows[np.repeat(known, new.widths)] = np.repeat(before - starts, widths) + np.arange(int(widths.sum()))
    return points, rows, known


def slide(layout: PointLayout, velocity: Array) -> Array:
    """Sliding speed of each point, shape (..., k) [m/s, rad/s], by velocities (..., p); zero without friction."""
    out, along = np.zeros((*velocity.shape[:-1], len(layout.owners))), velocity[..., layout.sliding_rows] * layout.sliding_kept
    out[..., layout.slides] = np.hypot(along[..., 0], along[..., 1])
    return out


def turned_back(layout: PointLayout, active: Array, u: Array, change: Array, pushed: Array) -> Array | None:
    """Correction of a velocity from the end of a step to its middle, where a point slides throughout; zero elsewhere.

    Args:
        layout: The points.
        active: Which of them are active, shape (k,).
        u: Their velocities, shape (p,).
        change: Change of these in half a step, shape (p,).
        pushed: Row forces or impulses before, shape (p,): unloaded points have no friction to turn.
    """
    out = np.empty(len(u))
    return out if point_kernel().turned_back(layout.normals, layout.rubs, active, u, change, pushed, out) else None


def stopping(layout: PointLayout, u0: Array, u1: Array, pushed: Array) -> Array | None:
    """Which of the sliding points stop or reverse between two velocities; None if none does."""
    stops = np.empty(len(layout.sliding_rows), bool)
    return stops if point_kernel().stopping(layout.normals, layout.rubs, layout.slides, u0, u1, pushed, stops) else None


def directed(at: Snapshot, u: Array, end: Array, pushed: Array) -> Array | None:
    """Velocities of points by which forces are those of an instant; None if they are so already in a half step from it.

    Of loaded points: 1 m/s along J v of those that slide by the contact law, whose own u is J v to O(h^2) only. Zero of
    others: brought to rest in the half step, those that creep would have accelerations of their speed over its length.

    Args:
        at: The points at the instant.
        u: Their velocities by the contact law, shape (p,).
        end: The same at the end of the half step, shape (p,).
        pushed: Row forces or impulses in it, shape (p,).
    """
    layout, out = at.layout, np.empty(len(u))
    flags = layout.pushes, layout.rubs, layout.slides
    return out if point_kernel().directed(layout.normals, *flags, at.velocity, u, end, pushed, out) else None


@cache
def point_kernel() -> ModuleType:
    """`rbd.simulation.point_kernel`, imported with the first step."""
    from rbd.simulation import point_kernel

    return point_kernel
