"""Shapes as messages for Meshcat's viewer, and what our page needs to know of them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence

import meshcat

from rbd.visual.marks.mark import Mark
from rbd.visual.packed_meshes import Placed
from rbd.visual.robot_meshes import RobotPart
from rbd.visual.shapes import Mesh


def send_part(viewer: meshcat.Visualizer, path: str, part: RobotPart, *, nearer: int = 0) -> None:
    """Send a piece of a robot, in its own frame; of surfaces in one plane the one with the largest `nearer` is seen."""
    look = {"kind": "part", "color": part.color, "opacity": part.opacity}
    _send(viewer[path], part.mesh, {**look, "nearer": nearer} if nearer else look)


def send_mark(viewer: meshcat.Visualizer, mark: Mark) -> None:
    """Send a mark; the page also draws its ghost if it shines through what hides it, at the path and "_seen_through"."""
    told = {"kind": "mark", "color": mark.color, "opacity": mark.opacity, "through": mark.seen_through}
    _send(viewer[f"marks/{mark.path}"], mark.mesh, told)


def described(marks: Sequence[Mark], layers: Mapping[str, bool]) -> str:
    """The layers, and of every mark its path, layer and label, as JSON for the page."""
    listed = []
    for mark in marks:
        one: dict[str, object] = {"path": mark.path, "layer": mark.layer}
        if mark.label is not None:
            at = [round(float(x), 5) for x in mark.label.at]
            one["label"] = {"title": mark.label.title, "lines": list(mark.label.lines), "at": at, "tag": mark.label.tag}
        listed.append(one)
    return json.dumps({"marks": {"layers": dict(layers), "listed": listed}})


def _send(node: meshcat.Visualizer, mesh: Mesh, told: Mapping[str, object]) -> None:
    node.window.send(Placed(node.path.lower(), told, mesh))
