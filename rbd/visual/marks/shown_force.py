"""A force on a body as it is shown: of a contact, a loop, a stop, or a push; its arrows, its label, its line of the legend."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from rbd.arrays import Array
from rbd.visual.marks.mark import Label, Mark, Sizes, force_arrow, moment_marks, number, numbers
from rbd.visual.marks.primitives import ball

if TYPE_CHECKING:
    from rbd.problem.rows import Patch

LISTED = 8
"""Forces at single points that a label tells."""
NOWHERE = np.zeros((0, 3))
PointMode: TypeAlias = tuple[str, float | None]
"""Mode of a point, and the share of its friction that is used; None where it has none to use."""
ROUNDING = 1e-6
"""Smaller moments are rounding [N m]."""


@dataclass(frozen=True, eq=False, slots=True)
class ShownForce:
    """A force and a moment on a body, and the point where they act.

    Attributes:
        path: Of its marks in the viewer's tree.
        name: Of the contact, the loop, the stop or the push.
        force: In W, shape (3,) [N].
        start: Point in W where it acts, shape (3,) [m]: of a loaded sole the centre of pressure, see `acting_point`.
        moment: About `start`, in W, shape (3,) [N m]: of a loaded sole, its torsion about the normal.
        detail: What the legend says of it.
        layer: With what it is shown and hidden.
        color: '#rrggbb'; empty of what has a colour by its name.
        on: The body that it acts on.
        against: Frame of the body that gets the opposite; empty for the ground.
        thick: Of the arrow, in radii of the scene's arrows.
        corners: Points that share the force, in W, shape (k, 3) [m].
        corner_forces: Force at each of them, shape (k, 3) [N]; none where it is not known how they share it.
        patch: Of a contact, where it acts.
        points: (mode, share of friction used) of each corner, see `MODE_COLORS`; the share is None where there is none to use.
        friction_used: |f_t| / (mu f_n) of the resultant; None without a coefficient or without load. A patch may slip at one
            corner though its resultant is inside the cone: that is not seen here.
        further: More lines of its label.
        many: What others of its kind are called, of which only the largest are listed; empty: all are.
        pin: Whether a dot marks the point.
    """

    path: str
    name: str
    force: Array
    start: Array
    moment: Array = field(default_factory=lambda: np.zeros(3))
    detail: str = ""
    layer: str = "forces"
    color: str = ""
    on: str = "the robot"
    against: str = ""
    thick: float = 1.0
    corners: Array = field(default_factory=NOWHERE.copy)
    corner_forces: Array = field(default_factory=NOWHERE.copy)
    patch: Patch | None = None
    points: tuple[PointMode, ...] = ()
    friction_used: float | None = None
    further: tuple[str, ...] = ()
    many: str = ""
    pin: bool = False

    @property
    def size(self) -> float:
        """Of the force [N], or of the moment [N m] where there is no force."""
        return float(np.linalg.norm(self.force if self.force.any() else self.moment))

    @property
    def value(self) -> str:
        """Its size, in words."""
        return f"|f| {number(self.size)} N" if self.force.any() or not self.moment.any() else f"|m| {number(self.size)} N m"

    @property
    def only_points(self) -> bool:
        """Whether it is at single points, without a resultant of interest."""
        return self.patch is None and len(self.corners) > 0

    @property
    def pressure(self) -> float:
        """Force along the contact normal [N], positive when the surroundings push the robot away; else zero."""
        return 0.0 if self.patch is None else float(self.force @ self.patch.axes[:, 2])

    @property
    def lines(self) -> tuple[str, ...]:
        """What the page says of it."""
        if self.only_points:
            pairs = zip(self.corners[:LISTED], self.corner_forces[:LISTED], strict=True)
            each = [f"{numbers(f)} N at {numbers(p)} m" for p, f in pairs]
            return f"{len(self.corners)} points", f"sum of the forces {numbers(self.force)} N", *each
        lines = [self.value, f"force on {self.on} {numbers(self.force)} N", *self.further]
        if float(np.linalg.norm(self.moment)) > ROUNDING:
            lines.append(f"moment on {self.on} {numbers(self.moment)} N m")
        if self.against:
            lines.append(f"against {self.against}, which gets the opposite")
        return (*lines, f"{'centre of pressure' if len(self.corners) > 1 else 'acts at'} {numbers(self.start)} m")


def force_marks(shown: ShownForce, color: str, sizes: Sizes) -> list[Mark]:
    """The arrow of a force, thin ones at the points that share it, the opposite on the other body, the arc of the moment."""
    at, title = shown.path, shown.name
    look = {"color": color, "seen_through": True, "layer": shown.layer}
    marks = []
    if len(shown.corner_forces) > 1 or shown.only_points:
        marks.append(_corner_mark(shown, color, sizes))
    if shown.only_points:
        return marks
    if shown.pin:
        place = Label(title, shown.lines, shown.start, tag=False)
        marks.append(Mark(f"{at}/point", (ball(1.6 * sizes.shaft, shown.start),), label=place, **look))  # type: ignore[arg-type]
    arrow = force_arrow(shown.start, shown.force, sizes, thick=shown.thick)
    tip = Label(title, shown.lines, arrow.points[-1])
    marks.append(Mark(f"{at}/force", (arrow,), label=tip, **look))  # type: ignore[arg-type]
    if shown.against:
        back = force_arrow(shown.start, -shown.force, sizes, thick=0.6 * shown.thick)
        lines = (f"force on {shown.against} {numbers(-shown.force)} N", f"the opposite of that on {shown.on} at {title}")
        label = Label(f"{title}, on {shown.against}", lines, back.points[-1], tag=False)
        marks.append(Mark(f"{at}/reaction", (back,), opacity=0.6, label=label, **look))  # type: ignore[arg-type]
    turns = moment_marks(f"{at}/moment", title, shown.start, shown.moment, color, sizes)
    own = not shown.force.any()  # then the arc has the tag
    return [*marks, *(replace(mark, label=replace(tip, at=mark.points[-1])) if own else mark for mark in turns)]


def _corner_mark(shown: ShownForce, color: str, sizes: Sizes) -> Mark:
    """The forces at the points that share a force, thin, as one mark; of single points each with a dot."""
    pairs = list(zip(shown.corners, shown.corner_forces, strict=True))
    pieces = [force_arrow(corner, force, sizes, thick=0.6 if shown.only_points else 0.45) for corner, force in pairs]
    middle = shown.corners.mean(axis=0)
    if shown.only_points:
        pieces.append(ball(1.4 * sizes.shaft, shown.corners))
        label, layer = Label(shown.name, shown.lines, middle), shown.layer
    else:
        lines = [f"corner {i}: {numbers(force)} N at {numbers(p)} m" for i, (p, force) in enumerate(pairs[:LISTED], 1)]
        lines += [f"and {len(pairs) - LISTED} more"] if len(pairs) > LISTED else []
        label, layer = Label(f"{shown.name}: corner forces on the robot", tuple(lines), middle, tag=False), "corner forces"
    path = shown.path if shown.only_points else f"{shown.path}/corner_forces"
    return Mark(path, pieces, color, seen_through=True, layer=layer, label=label)
