"""The marks drawn around a robot: arrows, friction cones, patches, support polygon, centre of mass."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array
from rbd.constraints.convex.polygon import convex_hull
from rbd.visual import shapes
from rbd.visual.colors import COM_COLOR, PUSH_COLOR, SUPPORT_COLOR
from rbd.visual.forces import ShownForce, corners_in_world
from rbd.visual.shapes import Mesh


@dataclass(frozen=True, eq=False, slots=True)
class Mark:
    """One coloured shape in the world.

    Attributes:
        path: Where it stands in the viewer's tree, such as 'forces/left_sole/arrow'.
        mesh: Triangles in W [m].
        color: '#rrggbb'.
        opacity: 1 is solid.
        seen_through: Whether it shines faintly through what hides it.
    """

    path: str
    mesh: Mesh
    color: str
    opacity: float = 1.0
    seen_through: bool = False


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
        """Height above the ground of what lies on it, so that the two do not flicker [m]."""
        return 0.0012 * self.body


def contact_marks(contact: ShownForce, color: str, sizes: Sizes) -> list[Mark]:
    """Patch, friction cone and arrows of one contact; between two bodies the second's force too, thin and pale."""
    at = f"contacts/{_node(contact.name)}"
    patch, scale = contact.patch, sizes.metres_per_newton
    outline = _ordered(contact)
    marks = []
    if len(outline) >= 2:
        marks.append(Mark(f"{at}/patch", shapes.polygon(outline), color, 0.55))
        edge = shapes.tube(outline, radius=sizes.line, closed=len(outline) > 2)
        marks.append(Mark(f"{at}/outline", edge, color, seen_through=True))
        if len(outline) == 2:
            ends = [shapes.ball(1.3 * sizes.shaft, centre=end) for end in outline]
            marks.append(Mark(f"{at}/ends", shapes.joined(ends), color, seen_through=True))
    else:
        dot = shapes.ball(2.0 * sizes.shaft, centre=patch.point)
        marks.append(Mark(f"{at}/point", dot, color, seen_through=True))
    if patch.friction:
        rim, height = shapes.rim_of(patch.friction, sizes.cone)
        cone = shapes.friction_cone(contact.start, patch.axes, patch.friction, slant=sizes.cone)
        lid = contact.start + height * patch.axes[:, 2]
        marks.append(Mark(f"{at}/cone", cone, color, 0.28, seen_through=True))
        ring = shapes.ring(lid, patch.axes, rim, thickness=0.7 * sizes.line)
        marks.append(Mark(f"{at}/rim", ring, color, seen_through=True))
    if len(contact.corner_forces) > 1:
        thin = [
            shapes.arrow(corner, scale * force, radius=0.45 * sizes.shaft)
            for corner, force in zip(corners_in_world(patch), contact.corner_forces, strict=True)
        ]
        marks.append(Mark(f"{at}/corner_forces", shapes.joined(thin), color, seen_through=True))
    big = shapes.arrow(contact.start, scale * contact.force, radius=sizes.shaft)
    marks.append(Mark(f"{at}/force", big, color, seen_through=True))
    if patch.against is not None:  # what the other body feels
        back = shapes.arrow(contact.start, -scale * contact.force, radius=0.6 * sizes.shaft)
        marks.append(Mark(f"{at}/reaction", back, color, 0.6, seen_through=True))
    return marks


def push_mark(number: int, point: Array, force: Array, sizes: Sizes) -> Mark:
    """The arrow of an external force, from the point where it acts."""
    mesh = shapes.arrow(point, sizes.metres_per_newton * force, radius=sizes.shaft)
    return Mark(f"pushes/{number}", mesh, PUSH_COLOR, seen_through=True)


def support_marks(outline: Array, sizes: Sizes) -> list[Mark]:
    """The support polygon on the ground: an area, a segment for two corners, a dot for one.

    Args:
        outline: Its corners in W, on the ground, shape (k, 3) [m].
        sizes: Of all marks.
    """
    if len(outline) == 0:
        return []
    flat = outline + [0.0, 0.0, sizes.lift]
    edge = shapes.tube(flat, radius=1.8 * sizes.line, closed=len(outline) > 2)
    marks = [Mark("support/outline", edge, SUPPORT_COLOR, seen_through=True)]
    if len(outline) > 2:
        marks.append(Mark("support/area", shapes.polygon(flat), SUPPORT_COLOR, 0.25))
    return marks


def com_marks(com: Array, sizes: Sizes, ground: float = 0.0) -> list[Mark]:
    """The centre of mass, its drop line, and a ring with a cross where the line meets the ground, at a height of W [m]."""
    foot = np.array([com[0], com[1], ground + sizes.lift])
    r = 0.028 * sizes.body
    ring = shapes.ring(foot, np.eye(3), r, thickness=0.8 * sizes.line)
    cross = [shapes.tube(np.array([foot - 1.5 * r * e, foot + 1.5 * r * e]), radius=0.8 * sizes.line) for e in np.eye(3)[:2]]
    mark = shapes.joined([ring, *cross])
    return [
        Mark("com/ball", shapes.ball(0.02 * sizes.body, centre=com), COM_COLOR, seen_through=True),
        Mark("com/drop_line", shapes.tube(np.array([com, foot]), radius=sizes.line), COM_COLOR, seen_through=True),
        Mark("com/on_the_ground", mark, COM_COLOR, seen_through=True),
    ]


def legend(
    title: str, contacts: Iterable[ShownForce], colors: Mapping[str, str], pushed: Iterable[tuple[str, float]]
) -> dict[str, object]:
    """What the colours mean, as data for the page: names, sizes of forces [N], friction used.

    Args:
        title: Headline.
        contacts: In the order to be listed.
        colors: By contact name.
        pushed: Name and size [N] of the external forces.
    """
    entries = []
    for c in contacts:
        used = c.friction_used
        detail = f"friction {100.0 * used:.0f} % of mu = {c.patch.friction:g}" if used is not None else ""
        if c.patch.friction is None:
            detail = "held"
        if c.patch.against is not None:
            detail = ", ".join(filter(None, [f"against {c.patch.against}", detail]))
        entries.append(_entry(colors[c.name], c.name, f"{np.linalg.norm(c.force):.4g} N", detail))
    entries += [_entry(PUSH_COLOR, f"push on {name}", f"{size:.4g} N", "") for name, size in pushed]
    return {"title": title, "entries": entries}


def _entry(color: str, name: str, value: str, detail: str) -> dict[str, str]:
    return {"color": color, "name": name, "value": value, "detail": detail}


def _ordered(contact: ShownForce) -> Array:
    """Corners of the patch in W, in order around it, shape (k, 3) [m]."""
    patch = contact.patch
    hull = convex_hull(patch.corners[:, :2])
    height = float(patch.corners[:, 2].mean())
    return patch.point + np.column_stack([hull, np.full(len(hull), height)]) @ patch.axes.T


def _node(name: str) -> str:
    """A name that can stand in a Meshcat path, where a slash would open a new level."""
    return name.replace("/", "|") or "unnamed"
