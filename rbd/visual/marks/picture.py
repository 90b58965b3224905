"""What a picture of one state shows, as marks and as the legend of its page."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from rbd.arrays import Array
from rbd.constraints.terrain.terrain import Terrain, terrains_of
from rbd.model.external import External
from rbd.model.state import State
from rbd.model.world import is_standard
from rbd.visual.marks.applied_forces import (
    LAYER as ELEMENTS,
    RELAXED,
    ShownElement,
    color_of,
    element_marks,
    pushes,
    shown_elements,
)
from rbd.visual.marks.contacts import (
    DOWN,
    com_marks,
    contact_marks,
    ground_under,
    not_supporting,
    rows_of,
    shown_forces,
    support_marks,
    support_outline,
)
from rbd.visual.marks.mark import FULL_TURN, SMALLEST_ARC, Mark, Sizes, is_cut, moment_angle, number, numbers, share_color
from rbd.visual.marks.other_constraints import (
    DRIVE_COLOR,
    ShownDrive,
    ShownTorque,
    drive_marks,
    link_mark,
    link_of,
    motor_torques,
    origin_of,
    other_forces,
    shown_drives,
    shown_pins,
    torque_marks,
)
from rbd.visual.marks.regions import Drawn, left_out_of, legend_of
from rbd.visual.marks.shown_force import NOWHERE, ShownForce, force_marks
from rbd.visual.marks.surfaces import ShownSurface, surface_entries, surface_marks, surfaces_of
from rbd.visual.marks.terrain import TERRAIN_COLOR, ShownTerrain
from rbd.visual.style import COM_COLOR, MODE_COLORS, SUPPORT_COLOR

if TYPE_CHECKING:
    from rbd.answers.solution import Solution
    from rbd.statics.actuation import Actuation


@dataclass(frozen=True, eq=False)
class Picture:
    """What a picture of one state shows.

    Attributes:
        com: Centre of mass in W, shape (3,) [m].
        contacts: Forces of the contacts.
        forces: All forces: of contacts, of other constraints, pushes.
        torques: Of the motors.
        elements: Springs, dampers and other force elements.
        surfaces: Planes that the contacts touch, other than the floor.
        terrains: Terrains that the contacts touch.
        outline: Corners of the support polygon, each on the plane of its contact, shape (k, 3) [m].
        unshown: What of the external forces and constraints has no picture, in words.
        gravity: In W, shape (3,) [m/s2].
        links: Rods and ropes by name: their ends in W, shape (2, 3) [m].
        drives: Driven joints.
    """

    com: Array
    contacts: tuple[ShownForce, ...] = ()
    forces: tuple[ShownForce, ...] = ()
    torques: tuple[ShownTorque, ...] = ()
    elements: tuple[ShownElement, ...] = ()
    surfaces: tuple[ShownSurface, ...] = ()
    terrains: tuple[Terrain, ...] = ()
    outline: Array = field(default_factory=NOWHERE.copy)
    unshown: tuple[str, ...] = ()
    gravity: Array = field(default_factory=DOWN.copy)
    links: Mapping[str, Array] = field(default_factory=dict)
    drives: tuple[ShownDrive, ...] = ()

    @classmethod
    def of(cls, state: State, solution: Solution | Actuation | None, external: External) -> Picture:
        """The picture of a state, its solution, and the external forces that were given.

        Without these, the force elements are those that the solution was made with.

        Raises:
            InputError: if `external` is not what `rbd.solve` takes.
        """
        pushed, unshown = pushes(state, external)
        given_with = getattr(origin_of(solution), "external", None)
        elements, words = shown_elements(state, given_with if external is None else external)
        contacts, others, given, left_out = list[ShownForce](), list[ShownForce](), dict[str, Any](), list[str]()
        if solution is not None:
            constraints: Any = getattr(origin_of(solution), "constraints", ())
            contacts, given = shown_forces(solution), {constraint.name: constraint for constraint in constraints}
            others, left_out = other_forces(state, rows_of(solution), solution.forces, given)
            others += shown_pins(state, solution, given)
        return cls(
            np.asarray(state.com, float),
            tuple(contacts),
            (*contacts, *others, *pushed),
            tuple(motor_torques(state, solution)),
            tuple(elements),
            tuple(surfaces_of(contacts, given)),
            tuple(terrain.at(state.t) for terrain in terrains_of(given.values())),
            support_outline(contacts),
            (*unshown, *words, *left_out),
            state.robot.gravity,
            {name: ends for name, c in given.items() if (ends := link_of(state, c)) is not None},
            tuple(shown_drives(state, given.values())),
        )

    @property
    def colored(self) -> tuple[str, ...]:
        """Names of the constraints with a colour by their name."""
        return tuple(f.name for f in self.forces if not f.color)

    def marks(self, colors: Mapping[str, str], sizes: Sizes, without: Collection[str] = ()) -> list[Mark]:
        """All marks, in the order in which they are drawn.

        Args:
            colors: {constraint: '#rrggbb'} of `colored`.
            sizes: Of the marks.
            without: Layers to leave out.
        """
        drawn = [mark for i, surface in enumerate(self.surfaces) for mark in surface_marks(i, surface, sizes)]
        drawn += com_marks(self.com, sizes, ground_under(self.com, self.contacts), self.gravity)
        drawn += support_marks(self.outline, sizes)
        drawn += [link_mark(name, ends, sizes) for name, ends in self.links.items()]
        drawn += [mark for drive in self.drives for mark in drive_marks(drive, sizes)]
        for force in self.forces:
            draw = force_marks if force.patch is None else contact_marks
            drawn += draw(force, force.color or colors[force.name], sizes)
        drawn += torque_marks(() if "joint torques" in without else self.torques, sizes)
        drawn += [mark for i, element in enumerate(self.elements) for mark in element_marks(i, element, sizes)]
        return [mark for mark in drawn if len(mark.points) and mark.layer not in without]

    @property
    def largest_moment(self) -> float:
        """Of contacts, loops, pushes and stops [N m]."""
        return max((float(np.linalg.norm(f.moment)) for f in self.forces), default=0.0)

    def left_out(self, sizes: Sizes) -> list[str]:
        """What the picture does not show, or not in full, in words."""
        cut = [f.name for f in self.forces if is_cut(f.force, sizes) or np.linalg.norm(f.moment) > sizes.full_moment]
        words = [*self.unshown, *not_supporting(self.contacts)]
        if cut:
            words.append(f"Double arrowhead: not drawn to full length ({', '.join(dict.fromkeys(cut))}).")
        return words


Entry = dict[str, str | list[str]]
"""A line of the legend: color, name, value, detail, and the layer with which it is shown and hidden."""
LEAST_LISTED = 0.01
"""Motors below this share of their limit are not listed."""
LISTED = 6
"""Of more loops or stops than this the largest are listed."""


def entry(color: str, name: str, value: str = "", detail: str | list[str] = "", layer: str = "") -> Entry:
    """One line of the legend."""
    return {"color": color, "name": name, "value": value, "detail": detail, "layer": layer}


def legend_data(
    title: str,
    picture: Picture,
    colors: Mapping[str, str],
    sizes: Sizes,
    statics: Sequence[Drawn] = (),
    poses: Sequence[Entry] = (),
    note: str = "",
    terrains: Sequence[ShownTerrain] = (),
    of: str = "",
) -> dict[str, object]:
    """The legend of a picture: {title, entries, notes}.

    Args:
        title: Headline.
        picture: What is shown.
        colors: {contact: '#rrggbb'}.
        sizes: Of the marks.
        statics: Regions and largest pushes in it.
        poses: Entries of other poses in it.
        note: About these poses.
        terrains: Those in it.
        of: Whose centre of mass is drawn, where there are several poses.
    """
    entries = [*poses, *_forces(picture, colors), *_drives(picture.drives)]
    entries += [*_elements(picture, sizes), *_torques(picture.torques)]
    entries += [entry(TERRAIN_COLOR, t.title, "", list(t.lines), "surfaces") for t in terrains] + _rest(picture, of)
    entries += [entry(color, name, layer="regions") for name, color in legend_of(statics)]
    lines = [note, *left_out_of(statics, sizes), *notes(picture, sizes), "Drag to turn, wheel to zoom, right button to shift."]
    return {"title": title, "entries": entries, "notes": [line for line in lines if line]}


def _forces(picture: Picture, colors: Mapping[str, str]) -> list[Entry]:
    """All forces; of kinds that may be many the largest, and how many more there are."""
    entries = []
    for kind in dict.fromkeys(f.many for f in picture.forces):
        own = [f for f in picture.forces if f.many == kind]
        if kind:
            own.sort(key=lambda f: -f.size)
        shown = own[: LISTED if kind else None]
        entries += [entry(f.color or colors[f.name], f.name, f.value, f.detail, f.layer) for f in shown]
        if kind and len(own) > LISTED:
            entries.append(entry(own[0].color, f"and {len(own) - LISTED} more {kind}", layer=own[0].layer))
    return entries


def _drives(drives: Sequence[ShownDrive]) -> list[Entry]:
    """The driven joints."""
    return [
        entry(DRIVE_COLOR, f"{one.joint} is driven", one.rate, [f"by {one.name}", one.lines[1]], "moments") for one in drives
    ]


def _elements(picture: Picture, sizes: Sizes) -> list[Entry]:
    """The force elements, those with the largest forces first."""
    found = sorted(picture.elements, key=lambda element: -abs(element.tension))
    entries = [entry(color_of(x, sizes), x.name, x.size, x.detail, ELEMENTS) for x in found[:LISTED]]
    if (more := len(found) - LISTED) > 0:
        entries.append(entry(RELAXED, f"and {more} more force elements", layer=ELEMENTS))
    return entries


def _torques(torques: Sequence[ShownTorque]) -> list[Entry]:
    """What the arcs of the motors mean, and the motors that are nearest to their limits."""
    if not torques:
        return []
    scale = f"{np.degrees(FULL_TURN):.0f} degrees of arc are a motor's limit; green 0 %, amber 50 %, red 100 %"
    entries = [entry(share_color(0.0), "joint torques", "", scale, "joint torques")]
    used = [(t.share, t) for t in torques if t.share is not None and t.share >= LEAST_LISTED]
    for share, t in sorted(used, key=lambda each: -each[0])[:3]:
        value = f"{number(t.value)} {t.unit}"
        entries.append(entry(share_color(share), t.name, value, f"{100.0 * share:.0f} % of its limit", "joint torques"))
    return entries


def _rest(picture: Picture, of: str) -> list[Entry]:
    points = [point for contact in picture.contacts for point in contact.points]
    share = "filled: share of the friction used" if any(used is not None for _, used in points) else ""
    modes = [mode for mode in MODE_COLORS if mode in {mode for mode, _ in points}]
    entries = [entry(MODE_COLORS[mode], f"point {mode}", "", share * (mode == modes[0]), "forces") for mode in modes]
    entries += [entry(color, name, speed, layer="surfaces") for name, color, speed in surface_entries(picture.surfaces)]
    drops = picture.gravity[2] < 0.0
    name = f"centre of mass{f' of {of}' if of else ''}{', drop line' if drops else ''}"
    entries.append(entry(COM_COLOR, name, layer="centre of mass"))
    if not is_standard(picture.gravity):
        size = float(np.linalg.norm(picture.gravity))
        words = numbers(picture.gravity) + " m/s2" if size else ""
        entries.append(entry(COM_COLOR, "gravity", f"{number(size)} m/s2", words, "centre of mass"))
    if len(picture.outline):
        entries.append(entry(SUPPORT_COLOR, "support polygon", layer="support polygon"))
    return entries


def notes(picture: Picture, sizes: Sizes) -> list[str]:
    """What is left out of a picture, and its scales, in words."""
    lines = picture.left_out(sizes)
    if any(f.force.any() or f.patch is not None for f in picture.forces):
        lines.append(scale_note(sizes.metres_per_newton, sizes.weight_N))
    if moment_angle(picture.largest_moment, sizes) >= SMALLEST_ARC:  # an arc of a moment is drawn
        lines.append(f"{np.degrees(FULL_TURN):.0f} degrees of arc are a moment of {number(sizes.full_moment)} N m.")
    return lines


def scale_note(metres_per_newton: float, weight_N: float) -> str:
    """The force of a metre of arrow, in newtons and in weights of the robot."""
    per_metre = 1.0 / metres_per_newton
    times = per_metre / weight_N if weight_N else 0.0
    share = ", the weight" if abs(times - 1.0) < 1e-9 else f", {times:.3g} times the weight"
    return f"1 m of arrow is {per_metre:.4g} N{share if times else ''}."
