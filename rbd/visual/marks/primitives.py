"""Simple shapes of marks by points and sizes: arrows, balls, lines, areas, cones, arcs; the page makes triangles of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from rbd.arrays import Array

ARC_POINTS = 5
"""Points along an arc that are told: enough to frame a picture."""
LEAST_POINTS = {"ball": 1, "line": 1, "polygon": 3}
"""Fewer are nothing to draw; of other kinds than these two."""


@dataclass(frozen=True, eq=False, slots=True)
class Primitive:
    """A simple shape in the world, see web/primitives.js.

    Attributes:
        kind: "arrow", "ball", "line", "polygon", "fan" or "arc".
        points: In W, shape (k, 3) [m]: start and tip; centres of balls; corners in order; an apex and a rim; of an arc the
            centre and points along it, the last its tip.
        sizes: Radii and lengths [m], angles [rad], and what else the kind needs.
    """

    kind: str
    points: Array
    sizes: Mapping[str, object] = field(default_factory=dict)

    @property
    def empty(self) -> bool:
        """Whether there is nothing to draw: an arrow or an arc of no length, an area of an edge alone."""
        return len(self.points) < LEAST_POINTS.get(self.kind, 2)

    def data(self) -> dict[str, object]:
        """What the page needs."""
        return {"kind": self.kind, "points": np.round(self.points, 6).tolist(), **self.sizes}


def arrow(start: Array, vector: Array, *, radius: float, longest: float = np.inf) -> Primitive:
    """An arrow from `start` along `vector`, both of shape (3,) [m]: its tip is at start + vector.

    A zero vector gives none. An arrow that would be longer than `longest` [m] is cut there, and has two heads.
    """
    length = float(np.linalg.norm(vector))
    start = np.asarray(start, float)
    tips = [start + np.asarray(vector) * min(1.0, longest / length)] if length else []
    return Primitive("arrow", np.array([start, *tips]), {"radius": radius, "heads": 2 if length > longest else 1})


def arc(centre: Array, axes: Array, radius: float, angle: float, *, thickness: float, heads: int = 1) -> Primitive:
    """A bent arrow about the third axis of `axes`: it begins on the first one, and its tip is on the circle at `angle` [rad].

    Args:
        centre: Of the circle, in W, shape (3,) [m].
        axes: R_WA; positive angles turn from the first axis to the second, negative ones the other way.
        radius: Of the circle [m].
        angle: From the start to the tip [rad]. Zero gives none.
        thickness: Radius of the bent shaft [m].
        heads: How many heads it has at its end; a whole turn without one is a ring.
    """
    turns = np.linspace(0.0, angle, ARC_POINTS)[:, None] if angle else np.zeros((0, 1))
    around = centre + radius * (np.cos(turns) * axes[:, 0] + np.sin(turns) * axes[:, 1])
    sizes = {"axis": np.round(axes[:, 2], 6).tolist(), "angle": angle, "radius": thickness, "heads": heads}
    return Primitive("arc", np.vstack([centre, around]), sizes)


def ring(centre: Array, axes: Array, radius: float, *, thickness: float) -> Primitive:
    """A ring about the third axis of `axes`."""
    return arc(centre, axes, radius, 2.0 * np.pi, thickness=thickness, heads=0)


def ball(radius: float, centres: Array | Sequence[Array]) -> Primitive:
    """A sphere about each of some centres, shape (3,) or (k, 3) [m]."""
    return Primitive("ball", np.atleast_2d(np.asarray(centres, float)), {"radius": radius})


def line(points: Array | Sequence[Array], *, radius: float, closed: bool = False) -> Primitive:
    """A line through points, shape (n, 3) [m], thick enough to be visible: browsers draw plain lines one pixel wide."""
    return Primitive("line", np.asarray(points, float), {"radius": radius, "closed": closed})


def polygon(points: Array) -> Primitive:
    """The inside of a convex polygon with these corners in order, shape (n, 3) [m]."""
    return Primitive("polygon", np.asarray(points, float))


def fan(apex: Array, rim: Array) -> Primitive:
    """Triangles from a point, shape (3,) [m], to each side of a closed line, shape (n, 3) [m]: a cone without its lid."""
    return Primitive("fan", np.vstack([apex, rim]))
