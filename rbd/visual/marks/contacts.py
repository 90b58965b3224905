"""Contacts among the marks: points, their modes, patches, friction cones, forces; support polygon and centre of mass."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from rbd.answers.analysis.contact_modes import modes_at_points
from rbd.arrays import Array
from rbd.constraints.convex.polygons import convex_hull, inside_distance
from rbd.model.world import LEAST_FALL, STANDARD, along_gravity, is_along_z
from rbd.problem.answer import Answer, ContactForce
from rbd.problem.cones import Cone, FrictionCone, friction_used
from rbd.problem.ground import Ground
from rbd.visual.marks import primitives
from rbd.visual.marks.mark import Label, Mark, Sizes, node, number, numbers
from rbd.visual.marks.shown_force import NOWHERE, PointMode, ShownForce, force_marks
from rbd.visual.style import COM_COLOR, MODE_COLORS, SUPPORT_COLOR

if TYPE_CHECKING:
    from rbd.answers.solution import Solution
    from rbd.problem.rows import Patch, Rows
    from rbd.statics.actuation import Actuation

# How far outside its patch rounding may put a centre of pressure.
SLACK_M = 1e-6
DISK, DISK_CORNERS = 4.2, 28
"""Radius of a disk at a point, in radii of an arrow's shaft, and corners of its outline; as in web/animation.js."""


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


def rows_of(solution: Any) -> Sequence[Rows]:
    """The rows of all constraints: of an `Actuation` its own, of a `Solution` those of its problem."""
    return getattr(solution, "problem", solution).rows


def shown_forces(solution: Solution | Actuation) -> list[ShownForce]:
    """Force of every contact of a solution; constraints without a patch, or without points in touch, are left out."""
    out = []
    forces: Mapping[str, Array] = solution.forces
    modes = modes_at_points(solution) if isinstance(solution, Answer) else {}
    for rows in rows_of(solution):
        patch = rows.patch
        if patch is None or not len(patch.corners) or rows.name not in forces:
            continue
        wrench = np.asarray(forces[rows.name], float)
        start, contact = acting_point(patch, wrench), ContactForce.of(patch, wrench)
        at_corners = np.asarray(solution.corner_forces.get(rows.name, NOWHERE), float).reshape(-1, 3)
        against = [f"against {patch.against}"] if patch.against is not None else []
        friction = _friction(patch, contact.friction_used)
        out.append(
            ShownForce(
                f"contacts/{node(rows.name)}",
                rows.name,
                wrench[:3],
                start,
                wrench[3:] + np.cross(patch.point - start, wrench[:3]) if len(wrench) == 6 else np.zeros(3),
                ", ".join([*against, f"normal {number(contact.normal)} N", *friction]),
                against=patch.against or "",
                corners=patch.corners_W,
                corner_forces=at_corners,
                patch=patch,
                points=_points(rows, patch, at_corners, modes),
                friction_used=contact.friction_used,
                further=(f"normal {number(contact.normal)} N, tangential {number(contact.tangential)} N", *friction),
            )
        )
    return out


def _points(rows: Rows, patch: Patch, forces: Array, modes: Mapping[str, Sequence[str]]) -> tuple[PointMode, ...]:
    """(mode, share of friction used) of each corner with a force; at rest where its mode is not known."""
    at_rest = "holds" if patch.friction is None else "sticks" if patch.friction else "pushes"
    words, found = modes.get(rows.name, (at_rest,) * len(forces)), list[PointMode]()
    for word, force in zip(words, forces @ patch.axes, strict=True):
        known = patch.friction and force[2] > 0.0 and patch.turned is None
        used = friction_used(patch.friction, force) if known and patch.friction else None
        found.append((word, used) if force.any() else ("open", None))
    return tuple(found)


def disk_marks(contact: ShownForce, sizes: Sizes) -> list[Mark]:
    """A disk at each point of a contact in the colour of its mode; as much of its area as friction is used, the rest pale."""
    patch, marks = contact.patch, []
    assert patch is not None
    axes, turns = patch.axes, np.linspace(0.0, 2.0 * np.pi, DISK_CORNERS, endpoint=False)
    circle = np.cos(turns)[:, None] * axes[:, 0] + np.sin(turns)[:, None] * axes[:, 1]
    listed = zip(contact.points, contact.corners, strict=True) if len(contact.points) == len(contact.corners) else ()
    for i, ((mode, used), corner) in enumerate(listed):
        share = 1.0 if used is None else float(np.clip(used, 0.0, 1.0))
        words = (mode,) if used is None else (mode, f"friction used {100.0 * used:.1f} %")
        at, label = corner + sizes.lift * axes[:, 2], Label(f"{contact.name}, point {i + 1}", words, corner, tag=False)
        for name, radius, opacity in (("disk", 1.0, 0.35), ("used", float(np.sqrt(share)), 1.0)):
            if share * radius > 0.0 or name == "disk":
                shape = primitives.polygon(at + (opacity * sizes.lift * axes[:, 2]) + DISK * sizes.shaft * radius * circle)
                marks.append(Mark(f"{contact.path}/{name}/{i}", (shape,), MODE_COLORS[mode], opacity, label=label))
    return marks


def _friction(patch: Patch, used: float | None) -> list[str]:
    """What of the friction is used, in words, and of which coefficient; nothing where there is no load."""
    if patch.friction is None:
        return ["bilateral: held without a limit"]
    mu = "" if isinstance(patch.friction, Cone) else f" of mu {patch.friction:g}"
    return [] if used is None else [f"friction used {100.0 * used:.1f} %{mu}"]


def contact_marks(contact: ShownForce, color: str, sizes: Sizes) -> list[Mark]:
    """Patch, friction cone and arrows of one contact."""
    at, patch = contact.path, contact.patch
    assert patch is not None
    outline = ordered_corners(patch)
    place = Label(contact.name, contact.lines, patch.point, tag=False)
    marks = []
    if len(outline) >= 2:
        marks.append(Mark(f"{at}/patch", (primitives.polygon(outline),), color, 0.55, label=place))
        edge = primitives.line(outline, radius=sizes.line, closed=len(outline) > 2)
        marks.append(Mark(f"{at}/outline", (edge,), color, seen_through=True, label=place))
    if len(outline) <= 2:
        radius, kind = (2.0, "point") if len(outline) < 2 else (1.3, "ends")
        dots = primitives.ball(radius * sizes.shaft, outline if len(outline) == 2 else patch.point)
        marks.append(Mark(f"{at}/{kind}", (dots,), color, seen_through=True, label=place))
    if patch.friction:
        marks += _cone_marks(contact, patch, patch.friction, color, sizes)
    return marks + disk_marks(contact, sizes) + force_marks(contact, color, sizes)


def _cone_marks(contact: ShownForce, patch: Patch, friction: float | Cone, color: str, sizes: Sizes) -> list[Mark]:
    """The set of forces of a point with a load, as far as it has a shape to draw, at the point where the resultant acts."""
    given = friction if isinstance(friction, Cone) else FrictionCone(friction)
    rim = given.rim()
    if not len(rim):
        return []
    rim = contact.start + sizes.cone / float(np.linalg.norm(rim, axis=1).max()) * rim @ patch.axes.T
    words = f"forces in a {type(given).__name__}"
    if not isinstance(friction, Cone):
        words = f"mu {friction:g}, half angle {np.degrees(np.arctan(friction)):.0f} degrees"
    lines = (words, *_friction(patch, contact.friction_used))
    label = Label(f"{contact.name}: friction cone", lines, rim.mean(axis=0), tag=False)
    edge = primitives.line(rim, radius=0.7 * sizes.line, closed=True)
    return [
        Mark(f"{contact.path}/cone", (primitives.fan(contact.start, rim),), color, 0.28, True, "cones", label),
        Mark(f"{contact.path}/rim", (edge,), color, 1.0, True, "cones", label),
    ]


def ordered_corners(patch: Patch) -> Array:
    """Corners of a patch in W, in order around it, shape (k, 3) [m]."""
    hull = _outline(patch)
    height = float(patch.corners[:, 2].mean())
    return patch.point + np.column_stack([hull, np.full(len(hull), height)]) @ patch.axes.T


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
    return np.column_stack([hull, [planes[i].below(*p.tolist()) for i, p in zip(nearest, hull, strict=True)]])


def ground_under(point: Array, contacts: Iterable[ShownForce]) -> float:
    """Height of the ground in W under a point, for the mark below the centre of mass [m].

    That of the plane of all contacts; on stairs the lowest; zero if there is none.
    """
    planes = [plane_of(c) for c in contacts if not c.against and _upright(c)]
    return min((plane.below(float(point[0]), float(point[1])) for plane in planes), default=0.0)


def plane_of(contact: ShownForce) -> Ground:
    """The plane that a contact touches: the one that is known, else that of its own corners."""
    patch = contact.patch
    assert patch is not None
    if patch.on is not None:
        return patch.on
    return Ground(point=contact.corners.mean(axis=0), normal=patch.axes[:, 2])


def _upright(contact: ShownForce) -> bool:
    """Whether it is on ground that is not steeper than 45 degrees."""
    return contact.patch is not None and bool(contact.patch.axes[2, 2] > UPRIGHT)


def _supporting(contacts: Iterable[ShownForce]) -> list[ShownForce]:
    """Loaded contacts with ground that is not steeper than 45 degrees."""
    given = [c for c in contacts if not c.against]
    least = LOADED_SHARE * sum(float(np.linalg.norm(c.force)) for c in given)
    return [c for c in given if c.pressure > least and _upright(c)]


def not_supporting(contacts: Sequence[ShownForce]) -> list[str]:
    """Which contacts are not in the support polygon though they are in the picture, in words."""
    inside = {c.name for c in _supporting(contacts)}
    given = [c for c in contacts if not c.against and c.name not in inside]
    steep = [c.name for c in given if not _upright(c)]
    idle = [c.name for c in given if _upright(c) and c.patch is not None and c.patch.friction is not None]
    reasons = (("no load", idle), ("steeper than 45 degrees", steep))
    return [f"Not in the support polygon: {', '.join(names)} ({why})." for why, names in reasons if inside and names]


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
    edge = primitives.line(flat, radius=1.8 * sizes.line, closed=len(outline) > 2)
    marks = [Mark("support/outline", (edge,), SUPPORT_COLOR, seen_through=True, layer=layer, label=replace(label, tag=False))]
    if len(outline) > 2:
        marks.append(Mark("support/area", (primitives.polygon(flat),), SUPPORT_COLOR, 0.3, True, layer, label))
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
    marks = [Mark("com/ball", (primitives.ball(0.02 * sizes.body, com),), COM_COLOR, 1.0, True, "centre of mass", label)]
    size = float(np.linalg.norm(gravity))
    if not is_along_z(gravity) and size:
        arrow = primitives.arrow(com, GRAVITY_LENGTH * sizes.body * gravity / size, radius=0.7 * sizes.shaft)
        words = Label("gravity", (f"{number(size)} m/s2", f"{numbers(gravity)} m/s2"), com + 0.3 * sizes.body * gravity / size)
        marks.append(Mark("com/gravity", (arrow,), COM_COLOR, 1.0, True, "centre of mass", words))
    if not -gravity[2] > LEAST_FALL * size:
        return marks
    foot = np.array([*along_gravity(gravity, com, ground), ground + sizes.lift])
    r = 0.028 * sizes.body
    ring = primitives.ring(foot, np.eye(3), r, thickness=0.8 * sizes.line)
    cross = [primitives.line([foot - 1.5 * r * e, foot + 1.5 * r * e], radius=0.8 * sizes.line) for e in np.eye(3)[:2]]
    drop = primitives.line([com, foot], radius=sizes.line)
    layer, below = "centre of mass", replace(label, title="below the centre of mass", at=foot, tag=False)
    return [
        *marks,
        Mark("com/drop_line", (drop,), COM_COLOR, 1.0, True, layer, below),
        Mark("com/on_the_ground", (ring, *cross), COM_COLOR, 1.0, True, layer, below),
    ]
