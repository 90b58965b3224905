"""Arrows of forces at the scene's scale, bent arrows of moments and torques, and the colours of shares of a limit."""

from __future__ import annotations

import numpy as np

from rbd.arrays import Array
from rbd.visual import shapes
from rbd.visual.marks.mark import FULL_TURN, Label, Mark, Sizes, number, numbers
from rbd.visual.shapes import Mesh
from rbd.visual.style import hexadecimal, rgb

SMALLEST_ARC = np.radians(1.0)
"""Arcs of less than this angle [rad] are not drawn."""
LOW, HALF, FULL = "#009e73", "#e69f00", "#c1272d"
"""Colours of a torque of zero, half and all of its limit."""


def force_arrow(start: Array, force: Array, sizes: Sizes, *, thick: float = 1.0) -> Mesh:
    """The arrow of a force [N] from its point in W, both of shape (3,); `thick` in radii of the scene's arrows."""
    return shapes.arrow(start, sizes.metres_per_newton * force, radius=thick * sizes.shaft, longest=sizes.longest)


def tip_of(start: Array, force: Array, sizes: Sizes) -> Array:
    """Where the arrow of a force [N] from its point in W ends, shape (3,) [m]."""
    vector = sizes.metres_per_newton * np.asarray(force)
    length = float(np.linalg.norm(vector))
    return np.asarray(start + vector * min(1.0, sizes.longest / length if length else 1.0))


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
    mesh = shapes.arc_arrow(point, shapes.axes_along(moment), sizes.arc, angle, thickness=0.6 * sizes.shaft, heads=heads)
    lines = (f"|m| {number(size)} N m", f"moment on the robot {numbers(moment)} N m")
    label = Label(f"moment of {title}", lines, mesh.vertices[-1], tag=False)
    return [Mark(path, mesh, color, seen_through=True, layer="moments", label=label)]


def share_color(share: float) -> str:
    """Colour of a share of a limit: green for none, amber for half, red for all of it."""
    share = min(max(share, 0.0), 1.0)
    one, two, w = (LOW, HALF, 2.0 * share) if share < 0.5 else (HALF, FULL, 2.0 * share - 1.0)
    return hexadecimal((1.0 - w) * a + w * b for a, b in zip(rgb(one), rgb(two), strict=True))
