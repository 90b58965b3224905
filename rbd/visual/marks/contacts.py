"""Marks drawn around a robot: points of application, arrows, friction cones, patches, support polygon, centre of mass."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np

from rbd.arrays import Array
from rbd.constraints.convex.polygons import convex_hull, inside_distance
from rbd.errors import InputError
from rbd.problem.answer import ContactForce
from rbd.visual import shapes
from rbd.visual.marks.mark import Mark, Sizes
from rbd.visual.style import COM_COLOR, PUSH_COLOR, SUPPORT_COLOR

if TYPE_CHECKING:
    from rbd.model.state import State
    from rbd.problem.ground import Ground
    from rbd.problem.rows import Patch
    from rbd.solution import Solution
    from rbd.statics.actuation import Actuation

# A contact with less than this share of all contact forces is not drawn as support.
LOADED_SHARE = 1e-6
# How far outside its patch rounding may put a centre of pressure.
SLACK_M = 1e-6
# Contacts whose normal leans more than 45 degrees do not carry weight from below.
UPRIGHT = float(np.cos(np.pi / 4.0))


@runtime_checkable
class Push(Protocol):
    """An external force at a frame, like `rbd.ExternalForce`: only the members that a picture needs."""

    @property
    def frame(self) -> str:
        """Name of the frame that is pushed."""

    @property
    def force(self) -> Sequence[float] | Array:
        """Force in W, shape (3,) [N]."""

    @property
    def offset(self) -> Sequence[float] | Array:
        """Point of application from the frame's origin, in frame axes, shape (3,) [m]."""


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
    """

    name: str
    patch: Patch
    force: Array
    start: Array
    corner_forces: Array
    friction_used: float | None

    @property
    def corners(self) -> Array:
        """Corners of the patch in W, shape (k, 3) [m]."""
        return corners_in_world(self.patch)

    @property
    def pressure(self) -> float:
        """Force along the contact normal [N], positive when the surroundings push the robot away."""
        return float(self.force @ self.patch.axes[:, 2])


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
    """Force of every contact of a solution; constraints without a patch (loops, limits) are left out."""
    out = []
    forces: Mapping[str, Array] = solution.forces
    split: Mapping[str, Array] = solution.corner_forces
    # A `Actuation` carries its rows itself, a `Solution` its problem.
    keeper: Any = getattr(solution, "problem", solution)
    for rows in keeper.rows:
        if rows.patch is None or rows.name not in forces:
            continue
        wrench = np.asarray(forces[rows.name], float)
        at_corners = np.asarray(split.get(rows.name, np.zeros((0, 3))), float).reshape(-1, 3)
        start = acting_point(rows.patch, wrench)
        used = ContactForce.of(rows.patch, wrench).friction_used
        out.append(ShownForce(rows.name, rows.patch, wrench[:3], start, at_corners, used))
    return out


def pushes(state: State, external: Iterable[Push] | Push | None) -> list[tuple[str, Array, Array]]:
    """Name, point in W [m] and force in W [N] of every push. Moments are not drawn.

    Raises:
        InputError: if `external` contains other than external forces at named frames.
    """
    if external is None:
        return []
    try:
        given = [external] if isinstance(external, Push) else list(external)
    except TypeError:
        raise InputError(f"external is {external!r:.80}; expected ExternalForces.") from None
    out = []
    for push in given:
        if not isinstance(push, Push):
            raise InputError(
                f"external holds a {type(push).__name__}; only ExternalForce has a point to draw it from. "
                "Leave generalised forces out of the picture: show(state, solution)."
            )
        point = np.array(state.frame(push.frame, push.offset).X_WF.translation)
        out.append((push.frame, point, np.asarray(push.force, float)))
    return out


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

    On z = 0 of contacts whose plane is not known. On stairs the corners have different heights.
    """
    given = _supporting(contacts)
    hull = support_polygon(given)
    if not len(hull):
        return np.zeros((0, 3))
    corners = np.vstack([c.corners for c in given])
    planes = [c.patch.on for c in given for _ in c.corners]
    nearest = [int(np.argmin(((corners[:, :2] - p) ** 2).sum(axis=1))) for p in hull]
    return np.column_stack([hull, [_height(planes[i], p) for i, p in zip(nearest, hull, strict=True)]])


def ground_under(point: Array, contacts: Iterable[ShownForce]) -> float:
    """Height of the ground in W under a point, for the mark below the centre of mass [m].

    That of the plane of all contacts; on stairs the lowest; zero if none is known.
    """
    planes = [c.patch.on for c in contacts if c.patch.against is None and c.patch.axes[2, 2] > UPRIGHT]
    return min((_height(plane, point) for plane in planes), default=0.0)


def _height(plane: Ground | None, point: Array) -> float:
    return 0.0 if plane is None else plane.below(float(point[0]), float(point[1]))


def _supporting(contacts: Iterable[ShownForce]) -> list[ShownForce]:
    """Loaded contacts with ground that is not steeper than 45 degrees."""
    given = [c for c in contacts if c.patch.against is None]
    least = LOADED_SHARE * sum(float(np.linalg.norm(c.force)) for c in given)
    return [c for c in given if c.pressure > least and c.patch.axes[2, 2] > UPRIGHT]


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
    """The legend, as data for the page: names, sizes of forces [N], friction used.

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


def scale_note(metres_per_newton: float, weight_N: float) -> str:
    """The force of a metre of arrow, in newtons and in weights of the robot."""
    per_metre = 1.0 / metres_per_newton
    times = per_metre / weight_N if weight_N else 0.0
    share = ", the weight" if abs(times - 1.0) < 1e-9 else f", {times:.3g} times the weight"
    return f"1 m of arrow is {per_metre:.4g} N{share if times else ''}."


def seen_from(contacts: Iterable[ShownForce], front_left: Sequence[float]) -> list[float]:
    """From the robot to the camera, in W: in front, on the left, above; the front is where the x axes of the soles point."""
    toes = sum((c.patch.axes[:2, 0] for c in contacts if len(c.corners) > 2), start=np.zeros(2))
    length = float(np.linalg.norm(toes))
    ahead = toes / length if length > 1e-3 else np.array([1.0, 0.0])
    left = np.array([-ahead[1], ahead[0]])
    return np.round([*(front_left[0] * ahead + front_left[1] * left), front_left[2]], 4).tolist()


def _entry(color: str, name: str, value: str, detail: str) -> dict[str, str]:
    return {"color": color, "name": name, "value": value, "detail": detail}


def _ordered(contact: ShownForce) -> Array:
    """Corners of the patch in W, in order around it, shape (k, 3) [m]."""
    patch = contact.patch
    hull = _outline(patch)
    height = float(patch.corners[:, 2].mean())
    return patch.point + np.column_stack([hull, np.full(len(hull), height)]) @ patch.axes.T


def _node(name: str) -> str:
    """A name for a Meshcat path, where a slash would open a new level."""
    return name.replace("/", "|") or "unnamed"
