"""Shapes as messages for the viewer of our pages, and triangles as few bytes that deflate well, for our page.

Coordinates are whole numbers of 65535ths of the mesh's box, each axis by itself: a point moves by less than
1/131070 of a side. Vertices are numbered in the order in which the triangles use them; then each coordinate is sent as its
difference from the one before, and each corner as how far its vertex lies below the next new one, 0 for a new one. All lowest
bytes come first, then the next ones, because equal bytes side by side deflate best.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array
from rbd.visual.marks.mark import Mark
from rbd.visual.pages.recorder import ViewerNode
from rbd.visual.robot_meshes import RobotPart
from rbd.visual.shapes import Mesh, joined

MARK = b"\xc1"
"""First byte of our messages: Meshcat's, which are msgpack, never begin with it."""
STEPS = 65535
"""Steps of a coordinate across the mesh's box."""
CORNER_BYTES = 3
MOST_VERTICES = 1 << (8 * CORNER_BYTES)


@dataclass(frozen=True, slots=True)
class PlacedShape:
    """A command that sets the object at a path of the viewer's tree, as Meshcat's set_object does.

    Attributes:
        path: In the viewer's tree, as "/meshcat/robot/3".
        told: How the page is to draw it, see `place` in web/meshes.js.
        mesh: Its triangles.
    """

    path: str
    told: Mapping[str, object]
    mesh: Mesh

    def lower(self) -> dict[str, object]:
        """Type and path, and the packed message."""
        return {"type": "set_object", "path": self.path, "packed": message({"path": self.path} | dict(self.told), self.mesh)}


def message(told: Mapping[str, object], mesh: Mesh) -> bytes:
    """A message for our page: our first byte, the length of the header, the header as JSON, the packed triangles.

    Args:
        told: What the header holds besides the counts and the box.
        mesh: Triangles, 16 million vertices at most.

    Raises:
        ValueError: more vertices than that.
    """
    mesh = in_order(mesh)
    if len(mesh.vertices) > MOST_VERTICES:
        raise ValueError(f"a mesh has {len(mesh.vertices)} vertices; expected at most {MOST_VERTICES}")
    low = mesh.vertices.min(axis=0) if len(mesh.vertices) else np.zeros(3)
    side = np.ptp(mesh.vertices, axis=0) if len(mesh.vertices) else np.zeros(3)
    # Nine digits: the page's numbers have 32 bits.
    low, side = (np.array([float(f"{x:.9g}") for x in each]) for each in (low, side))
    box = {"vertices": len(mesh.vertices), "faces": len(mesh.faces), "low": low.tolist(), "side": side.tolist()}
    text = json.dumps({**told, **box}, separators=(",", ":")).encode()
    return MARK + struct.pack("<I", len(text)) + text + _coordinates(mesh.vertices, low, side) + _corners(mesh.faces)


def split(data: bytes) -> tuple[str, bytes]:
    """The header, JSON, and the packed triangles of a message."""
    length = struct.unpack_from("<I", data, 1)[0]
    return data[5 : 5 + length].decode(), data[5 + length :]


def in_order(mesh: Mesh) -> Mesh:
    """The same triangles with the vertices numbered as the triangles first use them, and none that no triangle uses."""
    used, first, place = np.unique(mesh.faces.ravel(), return_index=True, return_inverse=True)
    order = np.argsort(first)
    number = np.empty(len(used), int)
    number[order] = np.arange(len(used))
    return Mesh(mesh.vertices[used[order]], number[place].reshape(-1, 3))


def _coordinates(vertices: Array, low: Array, side: Array) -> bytes:
    whole = np.rint((vertices - low) * (STEPS / np.where(side > 0.0, side, 1.0)))
    places = np.clip(whole, 0, STEPS).astype(np.int64)
    step = (np.diff(places, axis=0, prepend=0) + 32768) % (STEPS + 1) - 32768
    zigzag = ((step << 1) ^ (step >> 63)).T  # small steps of either sign are small numbers
    return np.stack([zigzag & 255, zigzag >> 8], axis=1).astype(np.uint8).tobytes()


def _corners(faces: Array) -> bytes:
    corners = faces.ravel()
    before = np.maximum.accumulate(np.concatenate([[-1], corners[:-1]])) if len(corners) else corners
    below = before + 1 - corners
    return np.stack([(below >> (8 * i)) & 255 for i in range(CORNER_BYTES)]).astype(np.uint8).tobytes()


def send_part(viewer: ViewerNode, path: str, part: RobotPart, *, nearer: int = 0) -> None:
    """Send a piece of a robot, in its own frame; of surfaces in one plane the one with the largest `nearer` is seen."""
    look = {"kind": "part", "color": part.color, "opacity": part.opacity}
    _send(viewer[path], part.mesh, {**look, "nearer": nearer} if nearer else look)


def send_mark(viewer: ViewerNode, mark: Mark) -> None:
    """Send a mark; the page also draws its ghost if it shines through what hides it, at the path and "_seen_through"."""
    kind = "part" if mark.scenery else "mark"
    told = {"kind": kind, "color": mark.color, "opacity": mark.opacity, "through": mark.seen_through}
    if isinstance(mark.shape, Mesh):
        _send(viewer[f"marks/{mark.path}"], mark.shape, told)
    else:
        drawn = [one.data() for one in mark.shape if not one.empty]
        _send(viewer[f"marks/{mark.path}"], joined([]), {**told, "primitives": drawn})


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


def _send(node: ViewerNode, mesh: Mesh, told: Mapping[str, object]) -> None:
    node.recorder.send(PlacedShape(node.path, told, mesh))
