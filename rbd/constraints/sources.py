"""What each constraint of a motion gives: points at a state, and how far they are from touching."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import TypeGuard

import numpy as np

from rbd.arrays import Array
from rbd.constraints.constraint import Constraint, rows_of
from rbd.constraints.contact import PointContact, SurfaceContact
from rbd.constraints.ground_points import Grounds, OnGround
from rbd.constraints.joint import JointLimit
from rbd.constraints.line_contact import LineContact
from rbd.constraints.points import ALWAYS, Measured, Source, Structure
from rbd.model.state import State
from rbd.problem.cones import Box, Cone, Free, FrictionCone, HalfLine, Interval, Line, NonNegative, SecondOrderCone
from rbd.problem.contact_motion import centripetal
from rbd.problem.rows import Rows


class Stops:
    """All joint limits of a motion: one row a bound, none of them dear."""

    def __init__(self, limits: Sequence[JointLimit], start: State) -> None:
        robot, self.owners = start.robot, []
        at: list[tuple[int, int, float, float]] = []
        for limit in limits:
            place = limit._stop.of(limit, robot)
            for sign, bound in ((1.0, place.lower), (-1.0, place.upper)):
                if np.isfinite(bound):
                    at.append((place.q, place.v, sign, bound))
                    self.owners.append((limit.name, 0 if sign > 0.0 else 1))
        self.q = np.array([x[0] for x in at], int)
        self.v = np.array([x[1] for x in at], int)
        self.sign = np.array([x[2] for x in at])
        self.bound = np.array([x[3] for x in at])
        k = len(at)
        self.J = np.zeros((k, robot.nv))
        self.J[np.arange(k), self.v] = self.sign
        cone = NonNegative(1)
        self.structure = Structure(tuple(n for n, _ in self.owners), tuple(i for _, i in self.owners), (cone,) * k)
        self.nothing = np.zeros(k)

    def at(self, state: State, t: float) -> Measured:
        """Distances to all bounds."""
        gap = self.gaps(state, t)
        return Measured(self.structure, self.J, self.sign * state.v[self.v], self.nothing, gap, self.nothing)

    def gaps(self, state: State, t: float) -> Array:
        """The distances alone."""
        return self.sign * (state.q[self.q] - self.bound)


class FromRows:
    """Any other constraint, by its rows; of one whose points come and go, each keeps its number while the motion lasts."""

    def __init__(self, constraint: Constraint) -> None:
        self.constraint = constraint
        self._told = getattr(constraint, "points", None)
        self._numbers: dict[tuple[str, int], int] = {}
        self._seen: dict[tuple[tuple[str, ...], Structure], Structure] = {}

    def at(self, state: State, t: float) -> Measured:
        """Its rows, those of patches at their corners."""
        (rows,) = rows_of(state, (self.constraint,))
        local, structure = _structure(rows.name, rows.cone)
        told = self._told(state) if callable(self._told) else None
        if told is not None:
            structure = self._numbered(tuple(told.names), structure)
        error = np.zeros(len(rows)) if rows.error is None else rows.error
        J, velocity, bias = rows.J, rows.velocity, rows.bias
        to_world = rows.resultant
        if local is not None:
            bias = local.T @ bias + centripetal(rows.cone, velocity)
            J, velocity, error = local.T @ J, local.T @ velocity, local.T @ error
            to_world = None if to_world is None else to_world @ local
        if not len(rows):
            return Measured(structure, J, velocity, bias, np.zeros(0), error, to_world)
        pushes = _pushes(structure)
        gap = np.where(pushes, error[structure.normals] if rows.error is not None else 0.0, ALWAYS)
        kept = np.repeat(~pushes, structure.widths)
        points, axes = _points(rows, len(gap)) if told is None else (told.positions, told.axes)
        return Measured(structure, J, velocity, bias, gap, np.where(kept, error, 0.0), to_world, None, points, axes)

    def gaps(self, state: State, t: float) -> Array:
        """What `at` says."""
        return self.at(state, t).gap

    def _numbered(self, labels: tuple[str, ...], structure: Structure) -> Structure:
        """The points under the numbers that their labels had when they were first seen; the same points, the same object."""
        known = self._seen.get((labels, structure))  # the sets may change with the state, e.g. friction
        if known is None:
            times = [labels[:i].count(label) for i, label in enumerate(labels)]  # two points may bear one label
            numbers = tuple(self._numbers.setdefault(one, len(self._numbers)) for one in zip(labels, times, strict=True))
            known = self._seen[labels, structure] = Structure(structure.owners, numbers, structure.cones)
        return known


def _points(rows: Rows, k: int) -> tuple[Array | None, Array | None]:
    """(points (k, 3), axes (3, 3)) of a patch."""
    if rows.patch is None:
        return None, None
    corners = rows.patch.corners if len(rows.patch.corners) == k else np.zeros((k, 3))
    return rows.patch.point + corners @ rows.patch.axes.T, rows.patch.axes


@lru_cache(maxsize=512)
def _structure(name: str, cone: Cone) -> tuple[Array | None, Structure]:
    """(G where rows are not the points' own, the points) of a set."""
    G, parts = cone.generators()
    if all(isinstance(part, Line) for part in parts):
        return None, Structure((name,), (0,), (Free(cone.dim),)) if cone.dim else Structure((), (), ())
    cones = tuple(_single(part) for part in parts)
    same = G.shape[0] == G.shape[1] and np.array_equal(G, np.eye(len(G)))
    return None if same else G, Structure((name,) * len(cones), tuple(range(len(cones))), cones)


def _single(part: object) -> Cone:
    if isinstance(part, SecondOrderCone):
        return FrictionCone(part.mu, part.facets)
    if isinstance(part, HalfLine):
        return NonNegative(1)
    if isinstance(part, Interval):
        return Box(np.array([part.lo]), np.array([part.hi]))
    return Free(1)


@lru_cache(maxsize=512)
def _pushes(structure: Structure) -> Array:
    """Which points push and may part, shape (k,)."""
    return np.array([not isinstance(c, Free | Box) for c in structure.cones], bool)


def sources_of(constraints: Sequence[Constraint], start: State) -> list[Source]:
    """The sources of a motion's constraints, in their order.

    Contacts with ground at rest stand together, where the first of their kind does; all joint limits stand at the end.
    """
    out: list[Source] = []
    stops: list[JointLimit] = []
    for constraint in constraints:
        if isinstance(constraint, JointLimit):
            stops.append(constraint)
        elif _on_ground(constraint):
            out.append(OnGround(constraint, start))
        else:
            out.append(FromRows(_anchored(constraint, start)))
    for point_alone in (True, False):
        out = _together(out, point_alone, start)
    return [*out, Stops(stops, start)] if stops else out


def _together(sources: list[Source], point_alone: bool, start: State) -> list[Source]:
    """The contacts of one kind as one source, if they are two or more."""
    alike = [s for s in sources if isinstance(s, OnGround) and s.point_alone == point_alone and s.surface is None]
    if len(alike) < 2:
        return sources
    together = Grounds(alike, start)
    return [together if s is alike[0] else s for s in sources if s is alike[0] or s not in alike]


def _on_ground(constraint: Constraint) -> TypeGuard[PointContact | SurfaceContact | LineContact]:
    if not isinstance(constraint, PointContact | SurfaceContact | LineContact):
        return False
    return constraint.friction is not None and constraint.against is None


def _anchored(constraint: Constraint, start: State) -> Constraint:
    """What knows no place is put where it is; what comes and goes is seen from afar."""
    afar = getattr(constraint, "with_margin", None)
    if callable(afar):
        return afar(AFAR)
    anchored = getattr(constraint, "anchored", None)
    (rows,) = rows_of(start, (constraint,))
    if not callable(anchored) or rows.error is not None or getattr(constraint, "velocity", None) is not None:
        return constraint  # what is carried along has no place to be
    return anchored(start)


AFAR = 0.05
"""Margin of contacts that come and go [m]: what is nearer is watched."""
