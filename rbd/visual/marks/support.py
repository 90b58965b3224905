"""The support polygon on the plane of its contacts, and the centre of mass with its drop line."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from rbd.arrays import Array
from rbd.constraints.convex.polygons import convex_hull
from rbd.model.gravity import LEAST_FALL, STANDARD, along_gravity, is_along_z
from rbd.problem.ground import Ground
from rbd.visual import shapes
from rbd.visual.marks.contacts import ShownForce
from rbd.visual.marks.mark import Label, Mark, Sizes, number, numbers
from rbd.visual.style import COM_COLOR, SUPPORT_COLOR

# A contact with less than this share of all contact forces is not drawn as support.
LOADED_SHARE = 1e-6
# Contacts whose normal leans more than 45 degrees do not carry weight from below.
UPRIGHT = float(np.cos(np.pi / 4.0))
DOWN = np.array(STANDARD)
# Of the arrow of gravity, in sizes of the robot.
GRAVITY_LENGTH = 0.25


def support_polygon(contacts: Iterable[ShownForce]) -> Array:
    """Corners of the support polygon on the ground, counter-clockwise, shape (k, 2) [m].

    The convex hull of all corners of the loaded contacts, projected along z. It is valid for flat ground only:
    contacts whose normal leans more than 45 degrees and those between two bodies are left out, friction and torque limits
    are ignored. Fewer than three corners come out where the contacts are points, or lie on a line.
    """
    below = [c.corners[:, :2] for c in _supporting(contacts)]
    return convex_hull(np.vstack(below)) if below else np.zeros((0, 2))


def support_outline(contacts: Iterable[ShownForce]) -> Array:
    """The corners of `support_polygon` in W, shape (k, 3) [m]: each on the plane of its contact.

    Where that plane is not known, on the plane of the contact's own corners. On stairs the corners have different heights.
    """
    given = _supporting(contacts)
    hull = support_polygon(given)
    if not len(hull):
        return np.zeros((0, 3))
    corners = np.vstack([c.corners for c in given])
    planes = [plane_of(c) for c in given for _ in c.corners]
    nearest = [int(np.argmin(((corners[:, :2] - p) ** 2).sum(axis=1))) for p in hull]
    return np.column_stack([hull, [_height(planes[i], p) for i, p in zip(nearest, hull, strict=True)]])


def ground_under(point: Array, contacts: Iterable[ShownForce]) -> float:
    """Height of the ground in W under a point, for the mark below the centre of mass [m].

    That of the plane of all contacts; on stairs the lowest; zero if there is none.
    """
    planes = [plane_of(c) for c in contacts if c.patch.against is None and c.patch.axes[2, 2] > UPRIGHT]
    return min((_height(plane, point) for plane in planes), default=0.0)


def plane_of(contact: ShownForce) -> Ground:
    """The plane that a contact touches: the one that is known, else that of its own corners."""
    patch = contact.patch
    if patch.on is not None:
        return patch.on
    corners = contact.corners
    return Ground(point=corners.mean(axis=0) if len(corners) else patch.point, normal=patch.axes[:, 2])


def _height(plane: Ground, point: Array) -> float:
    return plane.below(float(point[0]), float(point[1]))


def _supporting(contacts: Iterable[ShownForce]) -> list[ShownForce]:
    """Loaded contacts with ground that is not steeper than 45 degrees."""
    given = [c for c in contacts if c.patch.against is None]
    least = LOADED_SHARE * sum(float(np.linalg.norm(c.force)) for c in given)
    return [c for c in given if c.pressure > least and c.patch.axes[2, 2] > UPRIGHT]


def not_supporting(contacts: Sequence[ShownForce]) -> list[str]:
    """Which contacts are not in the support polygon though they are in the picture, in words."""
    inside = {c.name for c in _supporting(contacts)}
    given = [c for c in contacts if c.patch.against is None and c.name not in inside]
    steep = [c.name for c in given if c.patch.axes[2, 2] <= UPRIGHT]
    idle = [c.name for c in given if c.name not in steep and c.patch.friction is not None]
    out = []
    if inside and idle:
        out.append(f"Not in the support polygon: {', '.join(idle)} (no load).")
    if inside and steep:
        out.append(f"Not in the support polygon: {', '.join(steep)} (steeper than 45 degrees).")
    return out


def support_marks(outline: Array, sizes: Sizes) -> list[Mark]:
    """The support polygon on the ground: an area, a segment for two corners, a dot for one.

    Args:
        outline: Its corners in W, on the ground, shape (k, 3) [m].
        sizes: Of all marks.
    """
    if len(outline) == 0:
        return []
    flat, layer = outline + [0.0, 0.0, sizes.lift], "support polygon"
    x, y = outline[:, 0], outline[:, 1]
    area = 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))
    words = (f"area {number(area)} m2", f"{len(outline)} corners, seen along z; of the loaded contacts with the ground")
    label = Label("support polygon", words, flat.mean(axis=0))
    edge = shapes.tube(flat, radius=1.8 * sizes.line, closed=len(outline) > 2)
    marks = [Mark("support/outline", edge, SUPPORT_COLOR, seen_through=True, layer=layer, label=replace(label, tag=False))]
    if len(outline) > 2:
        marks.append(Mark("support/area", shapes.polygon(flat), SUPPORT_COLOR, 0.3, True, layer, label))
    return marks


def com_marks(com: Array, sizes: Sizes, ground: float = 0.0, gravity: Array = DOWN) -> list[Mark]:
    """The centre of mass, its drop line along gravity, and a ring with a cross where that meets the ground.

    Gravity that does not point along -z is an arrow from the centre of mass besides; without gravity, and where it does not
    point to the ground, there is no drop line.

    Args:
        com: In W, shape (3,) [m].
        sizes: Of all marks.
        ground: Its height in W [m].
        gravity: In W, shape (3,) [m/s2].
    """
    label = Label("centre of mass", (f"{numbers(com)} m",), com)
    marks = [Mark("com/ball", shapes.ball(0.02 * sizes.body, centre=com), COM_COLOR, 1.0, True, "centre of mass", label)]
    size = float(np.linalg.norm(gravity))
    if not is_along_z(gravity) and size:
        arrow = shapes.arrow(com, GRAVITY_LENGTH * sizes.body * gravity / size, radius=0.7 * sizes.shaft)
        words = Label("gravity", (f"{number(size)} m/s2", f"{numbers(gravity)} m/s2"), com + 0.3 * sizes.body * gravity / size)
        marks.append(Mark("com/gravity", arrow, COM_COLOR, 1.0, True, "centre of mass", words))
    if not -gravity[2] > LEAST_FALL * size:
        return marks
    foot = np.array([*along_gravity(gravity, com, ground), ground + sizes.lift])
    r = 0.028 * sizes.body
    ring = shapes.ring(foot, np.eye(3), r, thickness=0.8 * sizes.line)
    cross = [shapes.tube(np.array([foot - 1.5 * r * e, foot + 1.5 * r * e]), radius=0.8 * sizes.line) for e in np.eye(3)[:2]]
    mark = shapes.joined([ring, *cross])
    drop = shapes.tube(np.array([com, foot]), radius=sizes.line)
    layer, below = "centre of mass", replace(label, title="below the centre of mass", at=foot, tag=False)
    return [
        *marks,
        Mark("com/drop_line", drop, COM_COLOR, 1.0, True, layer, below),
        Mark("com/on_the_ground", mark, COM_COLOR, 1.0, True, layer, below),
    ]
