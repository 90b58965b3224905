"""Force elements over the frames of a motion: where their ends are, and how they pull or push."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rbd.arrays import Array
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State
from rbd.visual.marks.force_elements import (
    PULLS,
    PUSHES,
    RELAXED,
    STRAIGHT,
    ShownElement,
    full_of,
    radius_of,
    shown_elements,
    spiral_of,
    turns_of,
    wire_of,
)
from rbd.visual.marks.mark import Sizes

ELEMENT_COLORS = "Springs and dampers: orange where they pull, blue where they push."


@dataclass(frozen=True, eq=False)
class ElementTrack:
    """A force element over time.

    Attributes:
        name: Its name.
        shape: As of `ShownElement`.
        unit: Of its tension, "N" or "N m".
        points: Its ends in W, shape (n, 2, 3) [m]; NaN where it does not act.
        axis: In W, shape (n, 3); zero of what does not turn.
        tension: Positive where it pulls, shape (n,).
    """

    name: str
    shape: str
    unit: str
    points: Array
    axis: Array
    tension: Array

    @property
    def rows(self) -> Array:
        """One row a frame: both ends, the axis, the tension, shape (n, 10)."""
        return np.column_stack([self.points.reshape(len(self.tension), 6), self.axis, self.tension])


def tracks_of(
    robot: CheckedModel, q: Sequence[Array], v: Sequence[Array], times: Array, external: Any
) -> tuple[tuple[ElementTrack, ...], list[str]]:
    """(force elements at every frame, what of them is not drawn, in words).

    Args:
        robot: The robot.
        q: Configuration of each frame.
        v: Velocity of each frame.
        times: Their times [s].
        external: As `rbd.simulate` was given it: constant, or a function of state and time.
    """
    seen: dict[str, list[tuple[int, ShownElement]]] = {}
    words: list[str] = []
    if external is None:
        return (), words
    if not callable(external):
        found, words = shown_elements(State(robot, q[0], v[0]), external)
        if not found:
            return (), words
    for i, (q_i, v_i, t) in enumerate(zip(q, v, times, strict=True)):
        state = State(robot, q_i, v_i)
        found, unseen = shown_elements(state, external(state, float(t)) if callable(external) else external)
        words += [word for word in unseen if word not in words]
        for element in found:
            seen.setdefault(element.name, []).append((i, element))
    return tuple(_track(name, some, len(q)) for name, some in seen.items()), words


def _track(name: str, seen: Sequence[tuple[int, ShownElement]], n: int) -> ElementTrack:
    points, axis, tension = np.full((n, 2, 3), np.nan), np.zeros((n, 3)), np.zeros(n)
    for i, element in seen:
        points[i], axis[i], tension[i] = element.points, element.axis, element.tension
    first = seen[0][1]
    return ElementTrack(name, first.shape, first.unit, points, axis, tension)


def element_look(track: ElementTrack, sizes: Sizes) -> dict[str, object]:
    """What a page needs to draw a force element, besides where it is: sizes [m], colours, and the force of full colour."""
    lengths = np.linalg.norm(track.points[:, 1] - track.points[:, 0], axis=1)
    known = lengths[np.isfinite(lengths)]
    length = float(np.median(known)) if len(known) else 0.0
    return {
        "name": track.name,
        "shape": track.shape,
        "unit": track.unit,
        "length": max(length, 1e-3 * sizes.body),
        "radius": radius_of(sizes, length),
        "wire": wire_of(sizes),
        "spiral": spiral_of(sizes),
        "turns": turns_of(length, radius_of(sizes, length)),
        "straight": STRAIGHT,
        "full": full_of(track.unit, sizes),
        "colors": [RELAXED, PULLS, PUSHES],
    }
