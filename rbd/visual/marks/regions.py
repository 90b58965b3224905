"""Regions, largest pushes, wrench cones, footprints and capture points among the marks around a robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np

from rbd.arrays import Array, rank_of
from rbd.constraints.convex.polygons import outline
from rbd.control.capture import CaptureRegion
from rbd.control.walking.plan import WalkPlan
from rbd.errors import InputError
from rbd.robust.holding import RobustHold
from rbd.robust.places import RobustRegion
from rbd.robust.pushed import RobustPushLimits
from rbd.statics.pushes import PushLimits
from rbd.statics.regions import SupportRegion
from rbd.statics.wrench_cones import ContactWrenchCone
from rbd.statics.zero_moment_point import ZmpRegion
from rbd.visual.marks import primitives
from rbd.visual.marks.mark import Label, Mark, Sizes, number
from rbd.visual.style import LIMIT_COLORS, LIMITED_COLOR, PUSH_COLOR, SUPPORT_COLOR, WRENCH_COLOR, ZMP_COLOR, contact_colors

APART = 0.1
"""Footprints nearer to the one before than this share of their size are the same: a foot that was lifted for an instant."""

SAMPLES = 25
"""Points of a way through the air."""
RING = np.array([[np.cos(a), np.sin(a), 0.0] for a in np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)])
"""Corners of a circle around where a point is put down."""


@dataclass(frozen=True, eq=False)
class Footprints:
    """The outlines of a contact where it stood, or is to stand.

    Attributes:
        name: Of the contact.
        color: The contact's.
        outlines: Corners of each in W, in order around it, shapes (k, 3) [m]; of a point one.
        ways: Of a plan: ways through the air, points in W, shapes (k, 3) [m]; its outlines are not filled.
    """

    name: str
    color: str
    outlines: tuple[Array, ...]
    ways: tuple[Array, ...] = ()


def footprints_of(trajectory: Any) -> list[Footprints]:
    """Of each contact of three points or more, the places where all its points carried load; none if it stood in one place.

    A contact that slides leaves one footprint, where it stands best: where its least loaded point carries most. On terrain,
    where points come and go, it is the hull of the loaded ones, where most of them carry load.

    Args:
        trajectory: With points, point_forces and modes.
    """
    found, terrains = [], getattr(trajectory, "terrains", ())
    for name, color in contact_colors(trajectory.points).items():
        points = np.asarray(trajectory.points[name])
        if points.shape[1] < 3:  # points and edges leave no print
            continue
        each = np.linalg.norm(trajectory.point_forces[name], axis=-1)
        load = np.where(np.isfinite(points).all(axis=(1, 2)), each.min(axis=-1, initial=np.inf), 0.0)
        if terrains:
            carry, many = each > 0.0, (each > 0.0).sum(axis=1)
            load = np.where(many > 2, many + np.where(carry, each, np.inf).min(axis=1) / each.max(), 0.0)
        there = np.concatenate([[False], np.asarray(trajectory.modes[name]) != "open", [False]])
        edges = np.flatnonzero(there[1:] != there[:-1]).reshape(-1, 2).tolist()
        best = [first + int(load[first:end].argmax()) for first, end in edges]
        places: list[Array] = []
        for corners in (_around(points[i][each[i] > 0.0]) if terrains else points[i] for i in best if load[i] > 0.0):
            if not places or _distance(places[-1], corners) > APART:
                places.append(corners)
        if len(places) > 1:
            found.append(Footprints(name, color, tuple(places)))
    return found


@dataclass(frozen=True, eq=False)
class CapturePoint:
    """Where the centre of mass would come to rest over, if the ground pushed from there.

    Attributes:
        place: On the ground, in W, shape (3,) [m].
    """

    place: Array


def planned_footprints(plan: WalkPlan, after: float = -np.inf) -> list[Footprints]:
    """Of each foot of a plan the footholds after the first stance at which it lands after a time [s], and the ways to them."""
    out = []
    for foot, color in contact_colors(plan.poses).items():
        if own := [s for s in plan.swings[foot] if s.landing > after]:
            outlines = tuple([plan.outline(foot, s.end) for s in own])
            out.append(Footprints(f"{foot}, as planned", color, outlines, tuple([plan.way(s, SAMPLES) for s in own])))
    return out


def _distance(one: Array, other: Array) -> float:
    """How far two outlines are from each other, in sizes of the first."""
    off = other - one if one.shape == other.shape else (other.mean(axis=0) - one.mean(axis=0))[None]
    return float(np.linalg.norm(off, axis=1).max() / np.ptp(one, axis=0).max())


def _around(points: Array) -> Array:
    """The corners of the hull of points in a plane, seen from above, in order, shape (k, 3)."""
    return points[outline(points[:, :2].tolist())]


Proved: TypeAlias = RobustHold | RobustRegion | RobustPushLimits
Drawn: TypeAlias = (
    SupportRegion | ZmpRegion | CaptureRegion | PushLimits | ContactWrenchCone | Footprints | CapturePoint | Proved
)
_FARTHEST = 2.0
"""Regions are cut so far from the centre of mass, in sizes of the robot."""


def marks_of(drawn: Sequence[Drawn], sizes: Sizes) -> list[Mark]:
    """What is drawn for regions, pushes, cones and footprints.

    A support region lies at the height of the lowest contact, a region of zero-moment points on its plane, a capture region on
    that of its contacts, the inner polygon as an area, the outer one as a line; each push is an arrow from where it acts, in
    the colour of what gives way, at the scale of the forces; of a wrench cone it is the forces through its point without a
    moment.

    Raises:
        InputError: of something else.
    """
    out: list[Mark] = []
    for i, one in enumerate(drawn):
        at = f"statics/{i}"
        if isinstance(one, SupportRegion | RobustRegion):
            heights = [r.patch.corners_W[:, 2].min() for r in one.loads.rows if r.patch is not None and len(r.patch.corners)]
            corners = one.corners_at(min(heights, default=0.0))
            out += _area(at, corners, name_and_color(one)[1], i, sizes, one.state.com)
            if isinstance(one, RobustRegion) and len(one.outer):
                out.append(_outer(at, one.outer_at(min(heights, default=0.0)), name_and_color(one)[1], sizes))
        elif isinstance(one, ZmpRegion):
            out += _area(at, one.vertices, name_and_color(one)[1], i, sizes, one.state.com)
        elif isinstance(one, CaptureRegion):
            inner, outer = (np.insert(p, 2, one.state.com[2] - one.height, axis=1) for p in (one.inner, one.outer))
            out += _area(at, inner, name_and_color(one)[1], i, sizes, one.state.com)
            out.append(_outer(at, outer, name_and_color(one)[1], sizes))
        elif isinstance(one, CapturePoint):
            out.append(_capture_point(at, one, sizes))
        elif isinstance(one, PushLimits):
            out += _pushes(at, one, sizes)
        elif isinstance(one, RobustPushLimits):
            out += _robust_pushes(at, one, sizes)
        elif isinstance(one, RobustHold):
            out += _push_sets(at, one, sizes)
        elif isinstance(one, ContactWrenchCone):
            out += _cone(at, one, sizes)
        elif isinstance(one, Footprints):
            out += _footprints(at, one, sizes)
        else:
            raise InputError(f"{one!r:.80} cannot be drawn; expected a region, push limits or a wrench cone.")
    titles = [name for name, _ in legend_of(drawn)]
    return [_labelled(mark, titles[int(mark.path.split("/")[1])]) for mark in out]


def _labelled(mark: Mark, title: str) -> Mark:
    """The mark in the layer of regions, with its name; an area or a cone has a tag."""
    at = mark.points.mean(axis=0) if len(mark.points) else np.zeros(3)
    kind = mark.path.rsplit("/", 1)[1]
    words = (f"limit: {LIMIT_COLORS[kind][1]}",) if kind in LIMIT_COLORS else ()
    return replace(mark, layer="regions", label=Label(title, words, at, tag=kind in ("area", "cone")))


def left_out_of(drawn: Sequence[Drawn], sizes: Sizes) -> list[str]:
    """What of them is cut at the edge of the picture, in words."""
    reach, out = _FARTHEST * sizes.body, []
    for one in drawn:
        if isinstance(one, PushLimits) and (sizes.metres_per_newton * one.forces > reach).any():
            most = f"; the largest is {number(float(np.nanmax(one.forces)))} N"
            reach_N = reach / sizes.metres_per_newton
            out.append(f"Double arrowhead: largest pushes not drawn to full length ({reach_N:.4g} N{most}).")
        elif isinstance(one, SupportRegion | ZmpRegion | RobustRegion) and len(one.vertices):
            if (np.abs(one.vertices[:, :2] - one.state.com[:2]) > reach).any():
                out.append(f"The {name_and_color(one)[0].split(',')[0]} is cut {number(reach)} m from the centre of mass.")
    return out


def legend_of(drawn: Sequence[Drawn]) -> list[tuple[str, str]]:
    """(name, colour) of each."""
    return [name_and_color(one) for one in drawn]


def name_and_color(one: Drawn) -> tuple[str, str]:
    """What it is called, and the colour that it has in scenes and in figures."""
    if isinstance(one, Footprints):
        return f"footprints of {one.name}", one.color
    if isinstance(one, CapturePoint):
        return "capture point", PUSH_COLOR
    if isinstance(one, CaptureRegion):
        return "capture region" + ("" if one.area else ", empty"), SUPPORT_COLOR
    if isinstance(one, PushLimits):
        return "largest pushes", LIMIT_COLORS["edge"][0]
    if isinstance(one, RobustPushLimits):
        return "pushes that every member withstands", PUSH_COLOR
    if isinstance(one, RobustHold):
        return "pushes that are proved to be held", WRENCH_COLOR
    if isinstance(one, RobustRegion):
        return "places where every member is held" + (", empty" if one.empty else ""), LIMITED_COLOR
    if isinstance(one, ContactWrenchCone):
        return "forces through the point", WRENCH_COLOR
    name, color = ("zero-moment points", ZMP_COLOR) if isinstance(one, ZmpRegion) else ("support region", SUPPORT_COLOR)
    if isinstance(one, SupportRegion) and one.torque_limits:
        name, color = name + ", torques within limits", LIMITED_COLOR
    return name + (", empty" if one.empty else "" if one.bounded else ", without end"), color


def _area(at: str, corners: Array, color: str, number: int, sizes: Sizes, com: Array) -> list[Mark]:
    """A polygon, an edge or a point, a little above what was drawn before it."""
    if not len(corners):
        return []
    reach = _FARTHEST * sizes.body
    corners = np.clip(corners, com - reach, com + reach) + [0.0, 0.0, (2.0 + number) * sizes.lift]
    edge = primitives.line(corners, radius=1.8 * sizes.line, closed=len(corners) > 2)
    marks = [Mark(f"{at}/edge", (edge,), color, seen_through=True)]
    if len(corners) > 2:
        marks.append(Mark(f"{at}/area", (primitives.polygon(corners),), color, 0.22))
    return marks


def _outer(at: str, corners: Array, color: str, sizes: Sizes) -> Mark:
    """The line of an outer polygon."""
    edge = primitives.line(corners + [0.0, 0.0, sizes.lift], radius=0.7 * sizes.line, closed=True)
    return Mark(f"{at}/outer", (edge,), color, 0.6)


def _robust_pushes(at: str, limits: RobustPushLimits, sizes: Sizes) -> list[Mark]:
    """The pushes that all members withstand as arrows, a line round their convex set, and balls at outer ends."""
    reach, color = _FARTHEST * sizes.body, name_and_color(limits)[1]
    inner, outer = (
        limits.directions * np.minimum(sizes.metres_per_newton * size, reach)[:, None] for size in (limits.inner, limits.outer)
    )
    arrows = [primitives.arrow(limits.point, way, radius=0.3 * sizes.shaft, longest=reach) for way in inner if way.any()]
    marks = [Mark(f"{at}/arrows", arrows, color, seen_through=True)] if arrows else []
    if len(inner) > 2 and rank_of(limits.directions) == 2:
        U = np.linalg.svd(limits.directions)[2][:2]
        order = np.argsort(np.arctan2(*(U @ limits.directions.T)[::-1]), kind="stable")
        line = primitives.line(limits.point + inner[order], radius=sizes.line, closed=True)
        marks.append(Mark(f"{at}/around", (line,), color, seen_through=True))
    marks.append(Mark(f"{at}/outer", (primitives.ball(1.5 * sizes.line, limits.point + outer),), color, 0.6, seen_through=True))
    return marks


def _push_sets(at: str, held: RobustHold, sizes: Sizes) -> list[Mark]:
    """The forces of each set of pushes from its point: the edges and faces of their hull, moments left out."""
    lines, faces, color = list[Any](), list[Any](), name_and_color(held)[1]
    for each in held.loads.pushes:
        point = np.array(held.loads.state.frame(each.frame, each.offset).X_WF.translation)
        forces = np.unique(np.asarray(each.corners)[:, :3], axis=0) * sizes.metres_per_newton
        length = np.maximum(np.linalg.norm(forces, axis=1), 1e-12)
        tips = point + forces * np.minimum(1.0, _FARTHEST * sizes.body / length)[:, None]
        flat, edges = hull_of(tips)
        lines += [primitives.line(tips[list(edge)], radius=sizes.line) for edge in edges]
        faces += [primitives.polygon(tips[list(face)]) for face in flat]
    marks = [Mark(f"{at}/edge", lines, color, seen_through=True)] if lines else []
    return [*marks, Mark(f"{at}/area", faces, color, 0.2, seen_through=True)] if faces else marks


def hull_of(points: Array) -> tuple[list[tuple[int, ...]], list[tuple[int, int]]]:
    """(faces, edges) of the convex hull of points in space, flat ones and lines too, by numbers of the points."""
    off = points - points.mean(axis=0)
    rank = rank_of(off) if len(points) > 1 else 0
    if rank < 2:
        ends = [int(np.argmin(off @ (points[-1] - points[0]))), int(np.argmax(off @ (points[-1] - points[0])))] if rank else []
        return [], [(ends[0], ends[1])] if rank else []
    if rank == 2:
        U = np.linalg.svd(off)[2][:2]
        around = outline((off @ U.T).tolist())
        return [tuple(around)], list(zip(around, [*around[1:], around[0]], strict=True))
    from scipy.spatial import ConvexHull

    hull = ConvexHull(points)
    beside: dict[tuple[int, int], list[Array]] = {}
    for face, equation in zip(hull.simplices.tolist(), hull.equations, strict=True):
        for a, b in zip(face, [*face[1:], face[0]], strict=True):
            beside.setdefault((min(a, b), max(a, b)), []).append(equation[:3])
    edges = [edge for edge, (one, *more) in beside.items() if not more or one @ more[0] < 1.0 - 1e-9]
    return [tuple(face) for face in hull.simplices.tolist()], edges


def _footprints(at: str, stood: Footprints, sizes: Sizes) -> list[Mark]:
    flat = [outline + [0.0, 0.0, sizes.lift] for outline in stood.outlines]
    if stood.ways:
        rings = [outline if len(outline) > 1 else outline + 4.0 * sizes.line * RING for outline in flat]
        lines = [primitives.line(outline, radius=0.9 * sizes.line, closed=True) for outline in rings]
        ways = [primitives.line(way, radius=0.4 * sizes.line) for way in stood.ways]
        return [Mark(f"{at}/edges", lines, stood.color, 0.9), Mark(f"{at}/ways", ways, stood.color, 0.5)]
    edges = [primitives.line(outline, radius=0.7 * sizes.line, closed=True) for outline in flat]
    areas = [primitives.polygon(outline) for outline in flat]
    return [Mark(f"{at}/edges", edges, stood.color, 0.6), Mark(f"{at}/areas", areas, stood.color, 0.18)]


def _capture_point(at: str, point: CapturePoint, sizes: Sizes) -> Mark:
    """A ring with a cross in it, on the ground."""
    centre, r = point.place + [0.0, 0.0, 2.0 * sizes.lift], 0.02 * sizes.body
    ring = primitives.line(centre + r * RING, radius=sizes.line, closed=True)
    cross = [primitives.line(centre + r * RING[[i, i + 6]], radius=sizes.line) for i in (1, 4)]
    return Mark(f"{at}/edges", (ring, *cross), PUSH_COLOR, seen_through=True)


def _pushes(at: str, limits: PushLimits, sizes: Sizes) -> list[Mark]:
    """An arrow a direction from the smallest push that holds the robot to the largest; round a robot that is held, a line."""
    some = np.isfinite(limits.forces)
    directions, point, reach = limits.directions[some], limits.point, _FARTHEST * sizes.body
    whole, starts = (sizes.metres_per_newton * size[some, None] * directions for size in (limits.forces, limits.least))
    tips = whole * np.minimum(1.0, reach / np.maximum(np.linalg.norm(whole, axis=1), 1e-12))[:, None]
    marks = []
    kinds = [given[0].kind if given else "none" for given, holds in zip(limits.gives_way, some, strict=True) if holds]
    for kind, (color, _) in LIMIT_COLORS.items():
        own = [(start, tip - start) for start, tip, k in zip(starts, whole, kinds, strict=True) if k == kind]
        arrows = [primitives.arrow(point + start, way, radius=0.3 * sizes.shaft, longest=reach) for start, way in own]
        if arrows:
            marks.append(Mark(f"{at}/{kind}", arrows, color, seen_through=True))
    if limits.held and len(tips) > 2 and rank_of(limits.directions) == 2:
        U = np.linalg.svd(limits.directions)[2][:2]
        order = np.argsort(np.arctan2(*(U @ limits.directions.T)[::-1]), kind="stable")
        around = primitives.line(point + tips[order], radius=sizes.line, closed=True)
        marks.append(Mark(f"{at}/around", (around,), "#7f7f7f", seen_through=True))
    return marks


def _cone(at: str, cone: ContactWrenchCone, sizes: Sizes) -> list[Mark]:
    leans = cone.leans()
    if len(leans) < 3:
        return []
    height = 2.0 * sizes.cone
    rim = np.column_stack([leans, np.ones(len(leans))]) * height
    rim *= np.minimum(1.0, 2.0 * height / np.linalg.norm(rim, axis=1))[:, None]
    edge = primitives.line(cone.about + rim, radius=sizes.line, closed=True)
    return [
        Mark(f"{at}/cone", (primitives.fan(cone.about, cone.about + rim),), WRENCH_COLOR, 0.28, seen_through=True),
        Mark(f"{at}/rim", (edge,), WRENCH_COLOR, seen_through=True),
    ]
