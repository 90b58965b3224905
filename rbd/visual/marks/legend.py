"""The legend of a scene, as data for the page: names, forces, friction used, scales, and what is left out, in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from rbd.model.gravity import is_standard
from rbd.visual.marks.arrows import share_color
from rbd.visual.marks.force_elements import LAYER as ELEMENTS, RELAXED, color_of
from rbd.visual.marks.joints import ShownTorque
from rbd.visual.marks.mark import FULL_TURN, Sizes, number, numbers
from rbd.visual.marks.others import LOOP_COLOR
from rbd.visual.marks.statics import Drawn, left_out_of, legend_of
from rbd.visual.marks.surfaces import surface_entries
from rbd.visual.style import COM_COLOR, LIMITED_COLOR, PUSH_COLOR, SUPPORT_COLOR

if TYPE_CHECKING:
    from rbd.visual.marks.picture import Picture

Entry = dict[str, str | list[str]]
"""A line of the legend: color, name, value, detail, and the layer with which it is shown and hidden."""
LEAST_LISTED = 0.01
"""Motors below this share of their limit are not listed."""
LISTED = 6
"""Of more loops, stops or torques than this the largest are listed."""


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
    """
    regions = [entry(color, name, layer="regions") for name, color in legend_of(statics)]
    entries = [*poses, *_forces(picture, colors, sizes), *_rest(picture), *regions]
    lines = [note, *left_out_of(statics, sizes), *notes(picture, sizes), "Drag to turn, wheel to zoom, right button to shift."]
    return {"title": title, "entries": entries, "notes": [line for line in lines if line]}


def _forces(picture: Picture, colors: Mapping[str, str], sizes: Sizes) -> list[Entry]:
    entries = []
    for c in picture.contacts:
        words = [f"normal {number(c.pressure)} N", c.friction]
        if c.patch.against is not None:
            words.insert(0, f"against {c.patch.against}")
        entries.append(entry(colors[c.name], c.name, _size(c.force), ", ".join(filter(None, words)), "forces"))
    for points in picture.others.points:
        detail = f"sum of {len(points.points)} points"
        entries.append(entry(colors[points.name], points.name, _size(points.forces.sum(axis=0)), detail, "forces"))
    loops = sorted(picture.others.loops, key=lambda loop: -float(np.linalg.norm(loop.force)))
    for loop in loops[:LISTED]:
        detail = f"on {loop.on}" + (f", {loop.against} gets the opposite" if loop.against else "")
        entries.append(entry(LOOP_COLOR, loop.name, _size(loop.force), detail, "loop forces"))
    if len(loops) > LISTED:
        entries.append(entry(LOOP_COLOR, f"and {len(loops) - LISTED} more loops", layer="loop forces"))
    for t in _largest(picture.others.torques):
        layer = "forces" if t.slides else "moments"
        entries.append(entry(LIMITED_COLOR, t.by, f"{number(t.value)} {t.unit}", f"on joint {t.name}", layer))
    if (more := len(picture.others.torques) - LISTED) > 0:
        entries.append(entry(LIMITED_COLOR, f"and {more} more at joints", layer="moments"))
    for push in picture.pushes:
        words = [f"({numbers(push.force)[1:-1]}) N"]
        words += [f"moment {numbers(push.moment)} N m"] if push.moment.any() else []
        entries.append(entry(PUSH_COLOR, f"push on {push.name}", _size(push.force), ", ".join(words), "pushes"))
    return [*entries, *_elements(picture, sizes), *_torques(picture.torques)]


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
    for t in _largest([t for t in torques if t.share is not None and t.share >= LEAST_LISTED])[:3]:
        assert t.share is not None
        value = f"{number(t.value)} {t.unit}"
        entries.append(entry(share_color(t.share), t.name, value, f"{100.0 * t.share:.0f} % of its limit", "joint torques"))
    return entries


def _rest(picture: Picture) -> list[Entry]:
    entries = [entry(color, name, speed, layer="surfaces") for name, color, speed in surface_entries(picture.surfaces)]
    drops = picture.gravity[2] < 0.0
    entries.append(entry(COM_COLOR, f"centre of mass{', drop line' if drops else ''}", layer="centre of mass"))
    if not is_standard(picture.gravity):
        size = float(np.linalg.norm(picture.gravity))
        words = numbers(picture.gravity) + " m/s2" if size else ""
        entries.append(entry(COM_COLOR, "gravity", f"{number(size)} m/s2", words, "centre of mass"))
    if len(picture.outline):
        entries.append(entry(SUPPORT_COLOR, "support polygon", layer="support polygon"))
    return entries


def notes(picture: Picture, sizes: Sizes) -> list[str]:
    """What is left out of a picture, and its scales, in words."""
    lines = list(picture.left_out(sizes))
    if picture.contacts or picture.pushes or picture.others.loops:
        lines.append(scale_note(sizes.metres_per_newton, sizes.weight_N))
    if picture.has_moments(sizes):
        lines.append(f"{np.degrees(FULL_TURN):.0f} degrees of arc are a moment of {number(sizes.full_moment)} N m.")
    return lines


def scale_note(metres_per_newton: float, weight_N: float) -> str:
    """The force of a metre of arrow, in newtons and in weights of the robot."""
    per_metre = 1.0 / metres_per_newton
    times = per_metre / weight_N if weight_N else 0.0
    share = ", the weight" if abs(times - 1.0) < 1e-9 else f", {times:.3g} times the weight"
    return f"1 m of arrow is {per_metre:.4g} N{share if times else ''}."


def _size(force: np.ndarray) -> str:
    return f"|f| {number(float(np.linalg.norm(force)))} N"


def _largest(torques: Sequence[ShownTorque]) -> list[ShownTorque]:
    """The torques with the largest share of their limit, or the largest ones."""
    return sorted(torques, key=lambda t: -(abs(t.value) if t.share is None else t.share))[:LISTED]
