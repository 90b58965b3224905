"""A mark: a coloured shape in the world, its layer and its label; and the sizes of all marks."""

from __future__ import annotations

from dataclasses import dataclass

from rbd.arrays import Array
from rbd.visual.shapes import Mesh


@dataclass(frozen=True, eq=False, slots=True)
class Label:
    """What the page says when one points at a mark, and next to it when labels are on.

    Attributes:
        title: Its name, as "left_sole".
        lines: Numbers with units, as "force (1.2, 0.3, 448.1) N"; the first is shown when labels are on.
        at: Point in W where the label stands, shape (3,) [m].
    """

    title: str
    lines: tuple[str, ...]
    at: Array


@dataclass(frozen=True, eq=False, slots=True)
class Mark:
    """One coloured shape in the world.

    Attributes:
        path: Path in the viewer's tree, such as 'forces/left_sole/arrow'.
        mesh: Triangles in W [m].
        color: '#rrggbb'.
        opacity: 1 is solid.
        seen_through: Whether it shines faintly through what hides it.
        layer: With what it is shown and hidden: one of `rbd.visual.layers.LAYERS`.
        label: What the page says of it; None: nothing.
    """

    path: str
    mesh: Mesh
    color: str
    opacity: float = 1.0
    seen_through: bool = False
    layer: str = "forces"
    label: Label | None = None


@dataclass(frozen=True, slots=True)
class Sizes:
    """Sizes of the marks, constant within a scene.

    Attributes:
        body: Largest side of the box around the robot [m].
        metres_per_newton: Length of an arrow over its force [m/N].
    """

    body: float
    metres_per_newton: float

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
