"""Contacts among the marks: points of application, patches, friction cones, arrows of the resultant and of corner forces."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from rbd.arrays import Array
from rbd.constraints.convex.polygons import convex_hull, inside_distance
from rbd.problem.answer import ContactForce
from rbd.problem.cones import Cone, FrictionCone
from rbd.visual import shapes
from rbd.visual.marks.arrows import force_arrow, moment_marks, tip_of
from rbd.visual.marks.mark import Label, Mark, Sizes, node, number, numbers

if TYPE_CHECKING:
    from rbd.answers.solution import Solution
    from rbd.problem.rows import Patch
    from rbd.statics.actuation import Actuation

# How far outside its patch rounding may put a centre of pressure.
SLACK_M = 1e-6


@dataclass(frozen=True, eq=False, slots=True)
class ShownForce:
    """Force of a contact on the robot, and its point of application.

    Attributes:
        name: The contact's name.
        patch: Where it acts.
        force: Resultant force on the robot in W, shape (3,) [N].
        start: Point in W where the resultant acts, shape (3,) [m]: see `acting_point`.
        corner_forces: Force at each corner of the patch in W, shape (k, 3) [N]; k = 0 where there is no split.
        friction_used: |f_t| / (mu f_n) of the resultant; None without a coefficient or without load. A
            patch may slip at one corner though its resultant is inside the cone: that is not seen here.
        moment: On the robot about `start`, in W, shape (3,) [N m]: of a loaded sole, its torsion about the normal.
    """

    name: str
    patch: Patch
    force: Array
    start: Array
    corner_forces: Array
    friction_used: float | None
    moment: Array

    @property
    def corners(self) -> Array:
        """Corners of the patch in W, shape (k, 3) [m]."""
        return corners_in_world(self.patch)

    @property
    def pressure(self) -> float:
        """Force along the contact normal [N], positive when the surroundings push the robot away."""
        return float(self.force @ self.patch.axes[:, 2])

    @property
    def tangential(self) -> float:
        """Size of the force across the contact's normal [N]."""
        return float(np.linalg.norm(self.force - self.pressure * self.patch.axes[:, 2]))

    @property
    def friction(self) -> str:
        """What of the friction is used, in words; "held" where the contact is bilateral, empty where there is no load."""
        if self.patch.friction is None:
            return "held"
        used = self.friction_used
        return "" if used is None else f"friction {100.0 * used:.0f} %{_of(self.patch.friction, ' of mu = ')}"

    @property
    def lines(self) -> tuple[str, ...]:
        """What the page says of it."""
        patch = self.patch
        lines = [f"|f| {number(float(np.linalg.norm(self.force)))} N", f"force on the robot {numbers(self.force)} N"]
        lines.append(f"normal {number(self.pressure)} N, tangential {number(self.tangential)} N")
        if self.friction_used is not None:
            lines.append(f"friction used {100.0 * self.friction_used:.1f} %{_of(patch.friction, ' of mu ')}")
        elif patch.friction is None:
            lines.append("bilateral: held without a limit")
        if float(np.linalg.norm(self.moment)) > 1e-6:
            lines.append(f"moment {numbers(self.moment)} N m")
        lines.append(f"{'centre of pressure' if len(patch.corners) > 1 else 'acts at'} {numbers(self.start)} m")
        if patch.against is not None:
            lines.append(f"against {patch.against}, which feels the opposite")
        return tuple(lines)


def corners_in_world(patch: Patch) -> Array:
    """Corners of a contact patch in W, shape (k, 3) [m]."""
    return patch.point + patch.corners @ patch.axes.T


def acting_point(patch: Patch, wrench: Array) -> Array:
    """Point in W where the resultant of a contact acts, shape (3,) [m].

    For a loaded patch this is the centre of pressure, p + n x m / (n . f). The patch's reference point is used for a
    point contact, and where the centre of pressure is not inside the patch (a bilateral sole can pull).

    Args:
        patch: The contact.
        wrench: Force [N] and, for a surface, moment [N m] at the patch's point, in W, shape (3,) or (6,).
    """
    point = ContactForce.of(patch, wrench).centre_of_pressure
    if point is None or inside_distance((patch.axes.T @ (point - patch.point))[:2], _outline(patch)) < -SLACK_M:
        return np.array(patch.point, float)
    return point


def _outline(patch: Patch) -> Array:
    return convex_hull(patch.corners[:, :2])


def shown_forces(solution: Solution | Actuation) -> list[ShownForce]:
    """Force of every contact of a solution; constraints without a patch, or without points in touch, are left out."""
    out = []
    forces: Mapping[str, Array] = solution.forces
    split: Mapping[str, Array] = solution.corner_forces
    # An `Actuation` carries its rows itself, a `Solution` its problem.
    keeper: Any = getattr(solution, "problem", solution)
    for rows in keeper.rows:
        if rows.patch is None or not len(rows.patch.corners) or rows.name not in forces:
            continue
        wrench = np.asarray(forces[rows.name], float)
        at_corners = np.asarray(split.get(rows.name, np.zeros((0, 3))), float).reshape(-1, 3)
        start = acting_point(rows.patch, wrench)
        used = ContactForce.of(rows.patch, wrench).friction_used
        moment = wrench[3:] + np.cross(rows.patch.point - start, wrench[:3]) if len(wrench) == 6 else np.zeros(3)
        out.append(ShownForce(rows.name, rows.patch, wrench[:3], start, at_corners, used, moment))
    return out


def contact_marks(contact: ShownForce, color: str, sizes: Sizes) -> list[Mark]:
    """Patch, friction cone and arrows of one contact; between two bodies the second's force too, thin and pale."""
    at, name, patch = f"contacts/{node(contact.name)}", contact.name, contact.patch
    outline = ordered_corners(contact)
    place = Label(name, contact.lines, patch.point, tag=False)
    marks = []
    if len(outline) >= 2:
        marks.append(Mark(f"{at}/patch", shapes.polygon(outline), color, 0.55, label=place))
        edge = shapes.tube(outline, radius=sizes.line, closed=len(outline) > 2)
        marks.append(Mark(f"{at}/outline", edge, color, seen_through=True, label=place))
        if len(outline) == 2:
            ends = [shapes.ball(1.3 * sizes.shaft, centre=end) for end in outline]
            marks.append(Mark(f"{at}/ends", shapes.joined(ends), color, seen_through=True, label=place))
    else:
        dot = shapes.ball(2.0 * sizes.shaft, centre=patch.point)
        marks.append(Mark(f"{at}/point", dot, color, seen_through=True, label=place))
    if patch.friction:
        marks += _cone_marks(at, contact, patch.friction, color, sizes)
    if len(contact.corner_forces) > 1:
        marks.append(_corner_mark(at, contact, color, sizes))
    big = Label(name, contact.lines, tip_of(contact.start, contact.force, sizes))
    marks.append(Mark(f"{at}/force", force_arrow(contact.start, contact.force, sizes), color, seen_through=True, label=big))
    if patch.against is not None:  # what the other body feels
        back = force_arrow(contact.start, -contact.force, sizes, thick=0.6)
        lines = (f"force on {patch.against} {numbers(-contact.force)} N", f"the opposite of that on the robot at {name}")
        label = Label(f"{name}, on {patch.against}", lines, tip_of(contact.start, -contact.force, sizes), tag=False)
        marks.append(Mark(f"{at}/reaction", back, color, 0.6, seen_through=True, label=label))
    return [*marks, *moment_marks(f"{at}/moment", name, contact.start, contact.moment, color, sizes)]


def _cone_marks(at: str, contact: ShownForce, friction: float | Cone, color: str, sizes: Sizes) -> list[Mark]:
    """The set of forces of a point with a load, as far as it has a shape to draw, at the point where the resultant acts."""
    given = friction if isinstance(friction, Cone) else FrictionCone(friction)
    rim = given.rim()
    if not len(rim):
        return []
    longest = float(np.linalg.norm(rim, axis=1).max())
    rim = contact.start + sizes.cone / longest * rim @ contact.patch.axes.T
    words = (_told(friction), *(w for w in (contact.friction,) if w))
    label = Label(f"{contact.name}: friction cone", words, rim.mean(axis=0), tag=False)
    edge = shapes.tube(rim, radius=0.7 * sizes.line, closed=True)
    return [
        Mark(f"{at}/cone", shapes.fan(contact.start, rim), color, 0.28, seen_through=True, layer="cones", label=label),
        Mark(f"{at}/rim", edge, color, seen_through=True, layer="cones", label=label),
    ]


def _of(friction: float | Cone | None, words: str) -> str:
    """The coefficient in words; empty of sets that have more than one number."""
    return "" if friction is None or isinstance(friction, Cone) else f"{words}{friction:g}"


def _told(friction: float | Cone) -> str:
    if isinstance(friction, Cone):
        return f"forces in a {type(friction).__name__}"
    return f"mu {friction:g}, half angle {np.degrees(np.arctan(friction)):.0f} degrees"


def _corner_mark(at: str, contact: ShownForce, color: str, sizes: Sizes) -> Mark:
    """The forces at the corners of a patch, thin, as one mark."""
    pairs = list(zip(contact.corners, contact.corner_forces, strict=True))
    thin = [force_arrow(corner, force, sizes, thick=0.45) for corner, force in pairs]
    lines = tuple(f"corner {i}: {numbers(force)} N at {numbers(corner)} m" for i, (corner, force) in enumerate(pairs[:8], 1))
    if len(pairs) > len(lines):
        lines = (*lines, f"and {len(pairs) - len(lines)} more")
    label = Label(f"{contact.name}: corner forces on the robot", lines, contact.corners.mean(axis=0), tag=False)
    return Mark(f"{at}/corner_forces", shapes.joined(thin), color, seen_through=True, layer="corner forces", label=label)


def ordered_corners(contact: ShownForce) -> Array:
    """Corners of the patch in W, in order around it, shape (k, 3) [m]."""
    patch = contact.patch
    hull = _outline(patch)
    height = float(patch.corners[:, 2].mean())
    return patch.point + np.column_stack([hull, np.full(len(hull), height)]) @ patch.axes.T
