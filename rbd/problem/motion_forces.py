"""The forces that a motion allows, point by point: Coulomb's law, solved for the force.

With y the acceleration that a weight of the force set answers to (J a + J_dot v, of a point in contact axes):

    keeps still     y = 0                     any force of its cone
    opens           y_n > 0                   f = 0
    starts to slip  y_n = 0, y_t != 0         f = N (-mu y_t / |y_t|, 1), N >= 0
    slides already  y_n = 0, u_t != 0         f = N (-mu u_t / |u_t|, 1), N >= 0
    sinks           y_n < 0                   none: nothing moves so
    holds           y = 0 of a bilateral row  any force; y != 0: nothing moves so
    yields          an interval               its bound: low where y > 0, high where y < 0
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from math import hypot, inf
from typing import TypeAlias

import numpy as np

from rbd.arrays import Array
from rbd.problem.cones import Part, SecondOrderCone
from rbd.problem.force_set import Element, ForceSet
from rbd.records import joined


@dataclass(frozen=True)
class Refused:
    """A row or point that cannot move as wanted.

    Attributes:
        rows: Number of its constraint.
        number: Its number among the elements of its constraint.
        of: How many its constraint has.
        holds: Whether it is a bilateral row; else a point that sinks.
        acceleration: y, or y_n [m/s2, rad/s2].
    """

    rows: int
    number: int
    of: int
    holds: bool
    acceleration: float


def allowed_forces(sets: ForceSet, y: Array, still: Array, margin: float = 0.0) -> tuple[ForceSet, tuple[Refused, ...]]:
    """The sets of the forces that go with the accelerations y, and what moves as nothing does.

    Args:
        sets: The force sets, circular cones as they are, their velocities regarded.
        y: Accelerations of the columns, shape (p,).
        still: What counts as zero of each, shape (p,).
        margin: Friction of points that keep still stays within 1 - margin of the cone.
    """
    if (np.abs(y) <= still).all():
        return narrowed(sets, margin), ()
    changed, refused = dict[int, _Choice](), list[Refused]()
    counts = Counter(e.rows for e in sets.elements)
    for i, e in enumerate(sets.elements):
        at = e.columns.start
        if e.is_cone:
            (t, s, n), normal = y[e.columns].tolist(), float(still[at + 2])
            slip = hypot(t, s)
            if n < -normal:
                refused.append(Refused(e.rows, e.number, counts[e.rows], False, n))
            elif n > normal:
                changed[i] = _AXIS, 0.0, 0.0
            elif slip > still[at]:
                changed[i] = np.array([[-e.mu * t / slip], [-e.mu * s / slip], [1.0]]), 0.0, inf
            continue
        for j in range(at, e.columns.stop):
            low, high, c = float(sets.lower[j]), float(sets.upper[j]), float(y[j])
            if abs(c) <= still[j] or low == high:
                continue
            bound = low if c > 0.0 else high
            if abs(bound) < inf:
                changed[i] = _ONE, bound, bound
            else:
                refused.append(Refused(e.rows, e.number, counts[e.rows], low == -inf and high == inf, c))
    return _chosen(sets, changed, margin), tuple(refused)


@lru_cache(maxsize=256)
def narrowed(sets: ForceSet, margin: float) -> ForceSet:
    """The same with friction within 1 - margin of its cones; itself without a margin."""
    if not (margin and len(sets.mu)):
        return sets
    return replace(sets, elements=tuple([replace(e, shape=_narrower(e, margin)) for e in sets.elements]))


def _narrower(element: Element, margin: float) -> Part:
    """Its shape; of a circular cone one with less friction."""
    return SecondOrderCone(element.mu * (1.0 - margin), element.shape.facets) if element.is_cone else element.shape


_Choice: TypeAlias = tuple[Array, float, float]
"""What is left of an element: its old columns by new ones, and the bounds of these."""
_AXIS, _ONE = np.array([[0.0], [0.0], [1.0]]), np.ones((1, 1))


def _chosen(sets: ForceSet, changed: dict[int, _Choice], margin: float) -> ForceSet:
    """The sets with some elements' columns exchanged, and other cones narrowed."""
    blocks, elements, lower, upper = list[Array](), list[Element](), list[Array](), list[Array]()
    at = 0
    for i, e in enumerate(sets.elements):
        block, low, high = changed.get(i, (np.eye(e.size), sets.lower[e.columns], sets.upper[e.columns]))
        blocks.append(block)
        lower.append(np.atleast_1d(low))
        upper.append(np.atleast_1d(high))
        shape = e.shape if i in changed else _narrower(e, margin)
        elements.append(replace(e, shape=shape, columns=slice(at, at + block.shape[1])))
        at += block.shape[1]
    return sets.exchanged(blocks, np.concatenate(lower), np.concatenate(upper), elements)


def refusal_words(refused: Sequence[Refused], names: Sequence[str]) -> str:
    """E.g. "'left_sole' (point 2 of 4) sinks at 0.3 m/s2 and 'loop' accelerates at 0.1 m/s2": the worst of each constraint."""
    worst: dict[int, Refused] = {}
    for one in refused:
        if one.rows not in worst or abs(one.acceleration) > abs(worst[one.rows].acceleration):
            worst[one.rows] = one
    told = []
    for one in worst.values():
        does = "is held, and would accelerate" if one.holds else f"(point {one.number + 1} of {one.of}) would sink"
        told.append(f"{names[one.rows]!r:.80} {does} at {abs(one.acceleration):.3g}")
    return joined(told)


def given_weights(sets: ForceSet, allowed: ForceSet, w: Array) -> Array:
    """Weights of the sets that `allowed` was made of, shape (p,), from those of `allowed`, or of its pyramids."""
    if allowed.G is sets.G:  # no column was exchanged
        return w
    out = np.empty(sets.size)
    for old, new in zip(sets.elements, allowed.elements, strict=True):
        out[old.columns] = w[new.columns] @ allowed.push[new.columns] if old.is_cone else w[new.columns]
    return out
