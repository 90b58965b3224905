"""Walls, slopes, tables and moving ground that contacts touch: a bounded translucent piece of each plane, with a grid."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from rbd.arrays import Array
from rbd.constraints.constraint import member
from rbd.constraints.terrain.terrain import Terrain
from rbd.problem.ground import Ground
from rbd.visual import shapes
from rbd.visual.marks import primitives
from rbd.visual.marks.contacts import plane_of
from rbd.visual.marks.mark import Label, Mark, Sizes, number, numbers

if TYPE_CHECKING:
    from rbd.constraints.constraint import Constraint
    from rbd.visual.marks.shown_force import ShownForce

SURFACE_COLOR, MOVING_COLOR = "#8d99a6", "#b07a2a"
GROUND_MARGIN, WALL_MARGIN, BODY_MARGIN = 0.35, 0.22, 0.07
"""How far a piece of a plane reaches beyond its contacts, in sizes of the robot."""
SAME_M, SAME_AXIS = 1e-3, 1e-4
"""Planes nearer than this to each other are one [m], and by the angle of their normals [rad]."""
FASTEST = 0.16
"""Length of the arrow of the fastest point of a moving surface, in sizes of the robot."""
MOST_LINES = 40


@dataclass(frozen=True, eq=False)
class ShownSurface:
    """A plane that contacts touch.

    Attributes:
        names: Of the contacts.
        point: A point of the plane in W, shape (3,) [m].
        normal: Out of it, in W, a unit vector, shape (3,).
        corners: Of the contacts, in W, shape (k, 3) [m].
        twist: Velocity of its material, linear at `about` and angular, in W, shape (6,) [m/s, rad/s].
        about: Where the linear velocity is given, in W, shape (3,) [m].
        body: Frame of the body of the robot that it belongs to; empty for the ground.
    """

    names: tuple[str, ...]
    point: Array
    normal: Array
    corners: Array
    twist: Array = field(default_factory=lambda: np.zeros(6))
    about: Array = field(default_factory=lambda: np.zeros(3))
    body: str = ""

    @classmethod
    def of(cls, name: str, plane: Ground, corners: Array, ground: Ground | None = None, body: str = "") -> ShownSurface:
        """The plane of a contact, around its corners.

        Args:
            name: Of the contact.
            plane: Where it is.
            corners: Near to it, in W, shape (k, 3) [m].
            ground: With the velocity of its surface, where that is known.
            body: Frame of the body of the robot that it belongs to.
        """
        twist, about, normal = np.zeros(6), corners.mean(axis=0), np.asarray(plane.normal, float)
        if ground is not None and ground.velocity is not None:
            twist = np.asarray(ground.velocity, float)
            about = about if ground.about is None else np.asarray(ground.about, float)
        on_it = corners - np.outer((corners - np.asarray(plane.point)) @ normal, normal)
        return cls((name,), on_it.mean(axis=0), normal, on_it, twist, about, body)

    def moved(self, shift: Sequence[float] | Array) -> ShownSurface:
        """The same elsewhere, by a shift in W, shape (3,) [m]."""
        by = np.asarray(shift, float)
        return replace(self, point=self.point + by, corners=self.corners + by, about=self.about + by)

    @property
    def moves(self) -> bool:
        """Whether its material has a velocity."""
        return bool(self.twist.any())

    @property
    def title(self) -> str:
        """What it is, in words."""
        if self.body:
            return f"plane of {self.body}"
        steep = abs(float(self.normal[2]))
        lean = f"slope of {np.degrees(np.arccos(min(steep, 1.0))):.0f} degrees"
        kind = "wall" if steep < 0.26 else "ground" if steep > 0.9999 else lean
        return f"moving {kind}" if self.moves else f"{kind} at {number(float(self.point[2]))} m" if kind == "ground" else kind

    @property
    def lines(self) -> tuple[str, ...]:
        """What the page says of it."""
        lines = []
        if self.twist[:3].any():
            at = f" at {numbers(self.about)} m" if self.twist[3:].any() else ""
            lines.append(f"velocity {numbers(self.twist[:3])} m/s{at}")
        if self.twist[3:].any():
            lines.append(f"turns with {numbers(self.twist[3:])} rad/s about {numbers(self.about)} m")
        lean = np.degrees(np.arccos(np.clip(float(self.normal[2]), -1.0, 1.0)))
        leans = f"normal {numbers(self.normal, 3)}, {lean:.1f} degrees from the vertical"
        touched = f"touched by {', '.join(self.names)}"
        return (*lines, leans, touched) if self.moves else (touched, leans)

    @property
    def short(self) -> str:
        """Its speed for the legend; empty where it rests."""
        linear, turn = (float(np.linalg.norm(part)) for part in (self.twist[:3], self.twist[3:]))
        return ", ".join([f"{number(linear)} m/s"] * (linear > 0.0) + [f"{number(turn)} rad/s"] * (turn > 0.0))

    def velocity(self, points: Array) -> Array:
        """Of its material at points in W, shape (k, 3) [m/s]."""
        return np.asarray(self.twist[:3] + np.cross(self.twist[3:], points - self.about))

    def joined(self, other: ShownSurface) -> ShownSurface | None:
        """This and another one as one; None if they are not the same plane with the same motion."""
        apart = abs(float(self.normal @ (other.point - self.point)))
        turned = float(np.abs(self.normal - other.normal).max())
        if self.body != other.body or apart > SAME_M or turned > SAME_AXIS or not np.array_equal(self.twist, other.twist):
            return None
        if self.twist[3:].any() and not np.array_equal(self.about, other.about):
            return None
        return replace(self, names=self.names + other.names, corners=np.vstack([self.corners, other.corners]))


def surfaces_of(contacts: Sequence[ShownForce], given: Mapping[str, Constraint]) -> list[ShownSurface]:
    """The planes that contacts touch, each once; not the level ground at rest at z = 0, which is drawn as the floor.

    A contact whose plane is not known touches the plane of its own corners.

    Args:
        contacts: As `shown_forces` gives them.
        given: {name: constraint}, where known: `on` tells how the ground moves.
    """
    found: list[ShownSurface] = []
    for contact in contacts:
        patch, on = contact.patch, member(given.get(contact.name), "on")
        if patch is None or isinstance(on, Terrain):  # which is drawn whole
            continue
        ground = on if isinstance(on, Ground) and on.motion is None else patch.on
        found.append(ShownSurface.of(contact.name, plane_of(contact), contact.corners, ground, contact.against))
    return each_once(found)


def surfaces_of_planes(
    planes: Mapping[str, Ground], points: Mapping[str, Array], forces: Mapping[str, Array]
) -> list[ShownSurface]:
    """The planes that contacts touch during a motion, each once, around where they push; not the floor.

    A plane on which nothing pushes is drawn where a point comes nearest to it.

    Args:
        planes: {contact: its plane}.
        points: {contact: its points in W, shape (n, k, 3) [m]}; NaN where there is none.
        forces: {contact: forces at them, shape (n, k, 3) [N]}.
    """
    found = []
    for name, plane in planes.items():
        P = points[name].reshape(-1, 3) if name in points else np.zeros((0, 3))
        there = np.isfinite(P).all(axis=1)
        loaded = there & (np.linalg.norm(forces[name].reshape(-1, 3), axis=1) > 0.0) if len(P) else there
        if there.any():
            nearest = np.nanargmin(np.where(there, np.abs(plane.distances(np.nan_to_num(P))), np.inf))
            found.append(ShownSurface.of(name, plane, P[loaded] if loaded.any() else P[[nearest]], plane))
    return each_once(found)


def each_once(surfaces: Iterable[ShownSurface]) -> list[ShownSurface]:
    """Those that are the same plane as one; without the level ground at rest at z = 0, which is drawn as the floor."""
    found: list[ShownSurface] = []
    for one in surfaces:
        if not one.moves and not one.body and one.normal[2] > 1.0 - SAME_AXIS and abs(float(one.point[2])) < SAME_M:
            continue
        for i, other in enumerate(found):
            if (both := other.joined(one)) is not None:
                found[i] = both
                break
        else:
            found.append(one)
    return found


def surface_marks(place: int, surface: ShownSurface, sizes: Sizes) -> list[Mark]:
    """A translucent piece of a plane around its contacts with a grid on it, and arrows of its motion."""
    at, color = f"surfaces/{place}", MOVING_COLOR if surface.moves else SURFACE_COLOR
    axes = plane_axes(surface.normal)
    flat = (surface.corners - surface.point) @ axes
    share = BODY_MARGIN if surface.body else WALL_MARGIN if abs(float(surface.normal[2])) < 0.7 else GROUND_MARGIN
    margin = share * sizes.body
    cell = shapes.round_number(0.25 * margin)
    low = np.floor((flat[:, :2].min(axis=0) - margin) / cell) * cell
    high = np.ceil((flat[:, :2].max(axis=0) + margin) / cell) * cell
    # Behind the patches of the contacts, so that the two do not flicker.
    origin = surface.point - 0.5 * sizes.lift * surface.normal if not surface.moves else surface.point

    def there(x: float, y: float) -> Array:
        return np.asarray(origin + axes[:, 0] * x + axes[:, 1] * y)

    rim = np.array([there(low[0], low[1]), there(high[0], low[1]), there(high[0], high[1]), there(low[0], high[1])])
    label = Label(surface.title, surface.lines, rim[2])
    lines = []
    for k in range(2):
        steps = np.arange(low[k], high[k] + 0.5 * cell, cell)
        for s in steps[:: max(1, len(steps) // MOST_LINES)]:
            ends = ((s, low[1]), (s, high[1])) if k == 0 else ((low[0], s), (high[0], s))
            lines.append(shapes.ribbon(there(*ends[0]), there(*ends[1]), surface.normal, 0.8 * sizes.line))
    edge = primitives.line(rim, radius=0.7 * sizes.line, closed=True)
    hover = Label(surface.title, surface.lines, rim[2], tag=False)
    marks = [
        Mark(f"{at}/area", (primitives.polygon(rim),), color, 0.22, layer="surfaces", label=label),
        Mark(f"{at}/grid", shapes.joined(lines), color, 0.45, layer="surfaces", label=hover),
        Mark(f"{at}/edge", (edge,), color, 0.8, layer="surfaces", label=hover),
    ]
    if surface.moves:
        marks += _flow(at, surface, [there(x, y) for x in _inside(low[0], high[0]) for y in _inside(low[1], high[1])], sizes)
    return marks


def _inside(low: float, high: float) -> list[float]:
    return [low + (high - low) * share for share in (1.0 / 6.0, 0.5, 5.0 / 6.0)]


def _flow(at: str, surface: ShownSurface, points: Sequence[Array], sizes: Sizes) -> list[Mark]:
    """Small arrows of a surface's velocity at some points."""
    where = np.array(points)
    velocity = surface.velocity(where)
    if not (fastest := float(np.linalg.norm(velocity, axis=1).max())):
        return []
    lift = 2.0 * sizes.lift * surface.normal
    scale = FASTEST * sizes.body / fastest
    arrows = [primitives.arrow(p + lift, scale * v, radius=0.4 * sizes.shaft) for p, v in zip(where, velocity, strict=True)]
    label = Label(surface.title, (*surface.lines, f"its longest arrow is {number(fastest)} m/s"), where[-1], tag=False)
    return [Mark(f"{at}/velocity", arrows, MOVING_COLOR, seen_through=True, layer="surfaces", label=label)]


def plane_axes(normal: Array) -> Array:
    """Axes along a plane, the third its normal, shape (3, 3): the first is horizontal, W's x on level ground."""
    along = np.array([0.0, 0.0, 1.0]) if abs(float(normal[2])) < 0.9999 else np.array([0.0, 1.0, 0.0])
    first = np.cross(along, normal)
    first /= np.linalg.norm(first)
    return np.column_stack([first, np.cross(normal, first), normal])


def surface_entries(surfaces: Sequence[ShownSurface]) -> list[tuple[str, str, str]]:
    """(name, colour, speed) of each surface for the legend; surfaces of one name are listed once."""
    rows = [(s.title, MOVING_COLOR if s.moves else SURFACE_COLOR, s.short) for s in surfaces]
    return list(dict.fromkeys(rows))
