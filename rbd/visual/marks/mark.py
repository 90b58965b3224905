"""A mark: coloured shapes in the world, their layer and label; the sizes of marks, and arrows of forces and moments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array
from rbd.model.checked_model import CheckedModel
from rbd.visual.marks.primitives import Primitive, arc, arrow
from rbd.visual.shapes import Mesh, axes_along, round_number
from rbd.visual.style import hexadecimal, rgb

WEIGHTLESS_N = 100.0
"""Newtons for one arrow of the usual length if a robot has no weight (no mass, or no gravity)."""
FULL_TURN = np.radians(300.0)
"""Angle of the arc of a torque at its limit, and of a moment at the full scale [rad]."""


@dataclass(frozen=True, eq=False, slots=True)
class Label:
    """What the page says when one points at a mark, and next to it when labels are on.

    Attributes:
        title: Its name, as "left_sole".
        lines: Numbers with units; the first is the shortest, and is shown when labels are on.
        at: Point in W where the label stands, shape (3,) [m].
        tag: Whether it is shown next to the mark when labels are on; else only when one points at the mark.
    """

    title: str
    lines: tuple[str, ...]
    at: Array
    tag: bool = True


@dataclass(frozen=True, eq=False, slots=True)
class Mark:
    """Shapes of one colour in the world.

    Attributes:
        path: Path in the viewer's tree, such as 'forces/left_sole/arrow'.
        shape: In W [m]: primitives (arrows, balls, ...), or the triangles of any other shape.
        color: '#rrggbb'.
        opacity: 1 is solid.
        seen_through: Whether it shines faintly through what hides it.
        layer: With what it is shown and hidden: one of `rbd.visual.pages.link.LAYERS`.
        label: What the page says of it; None: nothing.
        scenery: Whether it is of the world: it casts and takes shadows, and the camera need not see all of it.
    """

    path: str
    shape: Mesh | Sequence[Primitive]
    color: str
    opacity: float = 1.0
    seen_through: bool = False
    layer: str = "forces"
    label: Label | None = None
    scenery: bool = False

    @property
    def points(self) -> Array:
        """What its shapes span, in W, shape (k, 3) [m]."""
        if isinstance(self.shape, Mesh):
            return self.shape.vertices
        return np.vstack([np.zeros((0, 3)), *(one.points for one in self.shape if not one.empty)])


@dataclass(frozen=True, slots=True)
class Sizes:
    """Sizes of the marks, constant within a scene.

    Attributes:
        body: Largest side of the box around the robot [m].
        metres_per_newton: Length of an arrow over its force [m/N].
        weight_N: The robot's weight [N]; zero where nothing weighs.
        largest_moment: Of the first picture [N m]: the scale of moments reaches to it.
    """

    body: float
    metres_per_newton: float
    weight_N: float = 0.0
    largest_moment: float = 0.0

    @classmethod
    def of(cls, robot: CheckedModel, cloud: Array, arrow_per_weight: float | None, largest_moment: float) -> Sizes:
        """The sizes for a robot.

        Args:
            robot: Which.
            cloud: Its outermost points in W, shape (n, 3) [m].
            arrow_per_weight: Length of an arrow as large as its weight [m]; None: half its size, rounded.
            largest_moment: Of the first picture [N m].
        """
        body = float(np.ptp(cloud, axis=0).max()) or 1.0
        length = arrow_per_weight or round_number(0.5 * body)
        weight = float(robot.mass * np.linalg.norm(robot.model.gravity.linear))
        return cls(body, length / (weight or WEIGHTLESS_N), weight, largest_moment)

    @property
    def shaft(self) -> float:
        """Radius of an arrow's shaft [m]."""
        return 0.0065 * self.body

    @property
    def line(self) -> float:
        """Radius of a drawn line [m]."""
        return 0.0022 * self.body

    @property
    def cone(self) -> float:
        """Length of a friction cone's side [m]."""
        return 0.12 * self.body

    @property
    def lift(self) -> float:
        """Height of marks above the ground, so that the two do not flicker [m]."""
        return 0.0012 * self.body

    @property
    def arc(self) -> float:
        """Radius of the arc of a torque or a moment [m]."""
        return 0.05 * self.body

    @property
    def full_moment(self) -> float:
        """The moment whose arc has the angle `FULL_TURN` [N m]: 1, 2 or 5 times a power of ten.

        At least that of a force with an arrow of half the robot's size, at a tenth of that size.
        """
        full = round_number(min(max(0.05 * self.body**2 / self.metres_per_newton, 1e-200), 1e200))
        if not full < self.largest_moment < 1e200:
            return full
        up = round_number(self.largest_moment)
        return up if up >= self.largest_moment else round_number(2.2 * up)

    @property
    def longest(self) -> float:
        """Largest length of an arrow [m]; what is longer is cut, and has two heads."""
        return max(3.0 * self.body, 1.5 * self.weight_N * self.metres_per_newton)


def numbers(values: Array, digits: int = 4) -> str:
    """Numbers in parentheses, rounded to a number of digits of the largest: '(0, 12.3, 448.1)'."""
    values = np.atleast_1d(np.asarray(values, float))
    most = float(np.abs(values).max(initial=0.0))
    if most >= 1e12:
        return "(" + ", ".join(f"{x:.{digits}g}" for x in values) + ")"
    places = max(0, digits - 1 - int(np.floor(np.log10(most)))) if most > 1e-12 else 0
    words = [f"{x:.{places}f}" for x in np.round(values, places) + 0.0]  # + 0.0 turns the -0 of rounding into 0
    return "(" + ", ".join(word.rstrip("0").rstrip(".") if "." in word else word for word in words) + ")"


def number(value: float) -> str:
    """A number with four digits; zero where it is below a millionth."""
    return f"{value:.4g}" if abs(value) >= 1e-6 else "0"


def node(name: str) -> str:
    """A name for a path in the viewer's tree, where a slash would open a new level."""
    return name.replace("/", "|") or "unnamed"


SMALLEST_ARC = np.radians(1.0)
"""Arcs of less than this angle [rad] are not drawn."""
LOW, HALF, FULL = "#009e73", "#e69f00", "#c1272d"
"""Colours of a torque of zero, half and all of its limit."""


def force_arrow(start: Array, force: Array, sizes: Sizes, *, thick: float = 1.0) -> Primitive:
    """The arrow of a force [N] from its point in W, both of shape (3,); `thick` in radii of the scene's arrows."""
    return arrow(start, sizes.metres_per_newton * force, radius=thick * sizes.shaft, longest=sizes.longest)


def is_cut(force: Array, sizes: Sizes) -> bool:
    """Whether the arrow of a force [N], shape (3,), is longer than the picture shows."""
    return sizes.metres_per_newton * float(np.linalg.norm(force)) > sizes.longest


def moment_angle(moment: float, sizes: Sizes) -> float:
    """Angle of the arc of a moment [N m], in [-FULL_TURN, FULL_TURN] [rad]."""
    return float(np.clip(moment / sizes.full_moment, -1.0, 1.0)) * FULL_TURN


def moment_marks(path: str, title: str, point: Array, moment: Array, color: str, sizes: Sizes) -> list[Mark]:
    """A bent arrow about the axis of a moment [N m], in W, shape (3,); none where its arc is below a degree."""
    size = float(np.linalg.norm(moment))
    angle = moment_angle(size, sizes)
    if angle < SMALLEST_ARC:
        return []
    heads = 2 if size > sizes.full_moment else 1
    bent = arc(point, axes_along(moment), sizes.arc, angle, thickness=0.6 * sizes.shaft, heads=heads)
    lines = (f"|m| {number(size)} N m", f"moment on the robot {numbers(moment)} N m")
    label = Label(f"moment of {title}", lines, bent.points[-1], tag=False)
    return [Mark(path, (bent,), color, seen_through=True, layer="moments", label=label)]


def share_color(share: float) -> str:
    """Colour of a share of a limit: green for none, amber for half, red for all of it."""
    share = min(max(share, 0.0), 1.0)
    one, two, w = (LOW, HALF, 2.0 * share) if share < 0.5 else (HALF, FULL, 2.0 * share - 1.0)
    return hexadecimal((1.0 - w) * a + w * b for a, b in zip(rgb(one), rgb(two), strict=True))
