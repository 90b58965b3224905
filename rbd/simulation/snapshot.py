"""All points of a motion at one state, stacked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array
from rbd.constraints.points import Measured, Source, Structure
from rbd.model.state import State
from rbd.problem.cones import Cone, Free, FrictionCone
from rbd.simulation.moment import HOLDS, OPEN, PUSHES, SLIPS, STICKS, Touch


@dataclass(frozen=True, eq=False)
class Layout:
    """The points of all sources: made anew only where points come and go.

    Attributes:
        structures: Of each source.
        owners: Constraint of each point, shape (k,).
        numbers: Number of each point among its constraint's.
        cones: Set of each point's forces.
        widths: Rows of each point, shape (k,).
        normals: Row of each point's normal, shape (k,).
        pushes: Which points push and may part, shape (k,).
        rubs: Which of them have friction, shape (k,).
        slides: Which points slide or rub: those with friction, and intervals, shape (k,).
        sliding_rows: The two rows of each of those along which it does, shape (sum of slides, 2); of an interval, one twice.
        sliding_kept: One, or zero for the second of an interval, shape (sum of slides, 2).
        tangents: The two tangent rows of each point with friction, shape (sum of rubs, 2).
        held: Which rows belong to points that are held, shape (p,).
        mu: Friction coefficients, shape (k,); zero of what has none.
        spans: (points, rows) of each source.
        boxed: Whether some point's forces are bounded by numbers.
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
    tangents: Array
    held: Array
    mu: Array
    spans: tuple[tuple[slice, slice], ...]
    boxed: bool

    @classmethod
    def of(cls, structures: tuple[Structure, ...]) -> Layout:
        """The stack of several sources' points."""
        owners = tuple(o for s in structures for o in s.owners)
        cones = tuple(c for s in structures for c in s.cones)
        widths = np.array([c.dim for c in cones], int)
        names = [type(c).__name__ for c in cones]
        spans, point, row = [], 0, 0
        for s in structures:
            k, m = len(s.owners), int(s.widths.sum())
            spans.append((slice(point, point + k), slice(row, row + m)))
            point, row = point + k, row + m
        normals = np.cumsum(widths) - 1
        rubs, boxes = (np.array([n == kind for n in names], bool) for kind in ("FrictionCone", "Box"))
        slides = rubs | boxes
        rows = normals[slides][:, None] - np.where(rubs[slides][:, None], [2, 1], 0)
        kept = np.where(rubs[slides][:, None], 1.0, [1.0, 0.0]).reshape(-1, 2)
        return cls(
            structures,
            owners,
            tuple(i for s in structures for i in s.numbers),
            cones,
            widths,
            normals,
            np.array([n not in ("Free", "Box") for n in names], bool),
            rubs,
            slides,
            rows,
            kept,
            normals[rubs][:, None] - np.array([2, 1]),
            np.repeat(np.array([isinstance(c, Free) for c in cones], bool), widths),
            np.array([c.mu if isinstance(c, FrictionCone) else 0.0 for c in cones]),
            tuple(spans),
            "Box" in names,
        )


@dataclass(frozen=True, eq=False)
class Snapshot:
    """All points at one state.

    Attributes:
        state: The state.
        layout: The points.
        sources: What each source measured.
        J: Shape (p, nv).
        velocity: Shape (p,).
        bias: Shape (p,).
        gap: Shape (k,).
        error: Position errors of what holds, shape (p,).
    """

    state: State
    layout: Layout
    sources: tuple[Measured, ...]
    J: Array
    velocity: Array
    bias: Array
    gap: Array
    error: Array

    @property
    def approach(self) -> Array:
        """Normal velocity of each point, shape (k,): negative where it comes nearer."""
        return self.velocity[self.layout.normals]

    @property
    def drift(self) -> float:
        """Largest position error of what holds."""
        return float(np.abs(self.error).max(initial=0.0))

    @property
    def drift_rate(self) -> float:
        """Largest velocity of the rows that hold."""
        return float(np.abs(self.velocity[self.layout.held]).max(initial=0.0))

    @property
    def penetration(self) -> float:
        """How deep the deepest point is."""
        gap = self.gap[self.layout.pushes]
        return max(0.0, -float(gap.min())) if len(gap) else 0.0


class Points:
    """The sources of a motion, and the last layout that they had."""

    def __init__(self, sources: Sequence[Source]) -> None:
        self.sources = tuple(sources)
        self._layout: Layout | None = None

    def at(self, state: State, t: float) -> Snapshot:
        """All points at a state and a time [s]."""
        measured = [s.at(state, t) for s in self.sources]
        structures = tuple([m.structure for m in measured])
        layout = self._layout
        if layout is None or layout.structures != structures:
            layout = self._layout = Layout.of(structures)
        nv = state.robot.nv
        if len(measured) == 1:
            m = measured[0]
            return Snapshot(state, layout, (m,), m.J, m.velocity, m.bias, m.gap, m.error)
        if not measured:
            none = np.zeros(0)
            return Snapshot(state, layout, (), np.zeros((0, nv)), none, none, none, none)
        J, velocity, bias, gap, error = (
            np.concatenate([getattr(m, what) for m in measured]) for what in ("J", "velocity", "bias", "gap", "error")
        )
        return Snapshot(state, layout, tuple(measured), J, velocity, bias, gap, error)


def touches_of(snapshot: Snapshot, force: Array, speed: Array, names: Sequence[str]) -> Mapping[str, Touch]:
    """What each constraint does, of row forces and sliding speeds.

    Args:
        snapshot: The points.
        force: Row forces, shape (p,) [N, N m]; zero of what does not act.
        speed: How fast each point slides, shape (k,) [m/s].
        names: All constraints, in order; those that have no points do nothing.
    """
    out: dict[str, Touch] = {}
    layout = snapshot.layout
    for measured, (points, rows) in zip(snapshot.sources, layout.spans, strict=True):
        f, u = force[rows], speed[points]
        for owner, at, row in _groups(measured.structure):
            out[owner] = _touch(measured, f[row], u[at], at, row)
    return {name: out.get(name, Touch(np.zeros(0), OPEN)) for name in names}


def _groups(structure: Structure) -> list[tuple[str, slice, slice]]:
    """(constraint, its points, its rows) of a source's points; those of one constraint stand together."""
    out: list[tuple[str, slice, slice]] = []
    ends = np.cumsum(structure.widths)
    first = 0
    k = len(structure.owners)
    for i in range(k):
        if i == k - 1 or structure.owners[i + 1] != structure.owners[first]:
            begin = int(ends[first - 1]) if first else 0
            out.append((structure.owners[first], slice(first, i + 1), slice(begin, int(ends[i]))))
            first = i + 1
    return out


_CARRIES = 1e-12
_SLIDES = 1e-6


def _touch(measured: Measured, force: Array, speed: Array, at: slice, row: slice) -> Touch:
    structure = measured.structure
    cones = structure.cones[at]
    if isinstance(cones[0], Free):
        mode = HOLDS
    else:
        widths = structure.widths[at]
        normals = np.cumsum(widths) - 1
        loaded = np.abs(force[normals]) > _CARRIES
        slides = loaded & (speed > _SLIDES)
        rubs = widths[0] == 3 or type(cones[0]).__name__ == "Box"
        mode = OPEN if not loaded.any() else SLIPS if slides.any() else STICKS if rubs else PUSHES
    whole = len(structure.owners) == len(cones)
    resultant = measured.to_world @ force if measured.to_world is not None and whole else force
    if measured.points is None or measured.axes is None:
        return Touch(resultant, mode)
    points, axes = measured.points[at], measured.axes
    if isinstance(cones[0], Free):  # one point, the centre of what holds
        return Touch(resultant, mode, points, (axes @ force[:3])[None] if len(points) == 1 and len(force) >= 3 else None)
    k, width = len(cones), cones[0].dim
    pushed = np.zeros((k, 3))
    pushed[:, 3 - width :] = force.reshape(k, width)
    pushed = np.einsum("kij,kj->ki", axes[at], pushed) if axes.ndim == 3 else pushed @ axes.T
    if measured.to_world is None:
        resultant = pushed.sum(axis=0)
        if measured.arms is not None:
            resultant = np.concatenate([resultant, np.cross(measured.arms[at], pushed).sum(axis=0)])
    return Touch(resultant, mode, points, pushed)
