"""A terrain by itself: a page to turn it on, for files, browsers and notebooks."""

from __future__ import annotations

import json
import tempfile
import webbrowser
from os import PathLike
from pathlib import Path

import numpy as np

from rbd.arrays import Array
from rbd.constraints.terrain.pieces import Heights
from rbd.constraints.terrain.terrain import Terrain
from rbd.errors.inputs import check_kind
from rbd.visual.marks.mark import Sizes
from rbd.visual.marks.picture import entry
from rbd.visual.marks.terrain import TERRAIN_COLOR, ShownTerrain, terrain_marks
from rbd.visual.packed_meshes import described, send_mark
from rbd.visual.pages.link import checked_layers
from rbd.visual.pages.page import offline_page, write_page
from rbd.visual.pages.recorder import Recorder, ViewerNode
from rbd.visual.robot_layers import FRONT_LEFT, camera_and_ground
from rbd.visual.style import a_page

LEAST, MOST = 0.2, 5.0
"""Smallest and largest size of what stands on it, by which lines and squares are drawn [m]."""
ENDLESS = 2.0
"""Half the side of what is shown of planes alone [m]."""


def terrain_page(terrain: Terrain) -> str:
    """A page of a terrain, which needs no network, as text: its solids, edges and squares, in a legend its pieces.

    Of planes 2 m around the bounded pieces are shown, or around the world's origin.

    Raises:
        InputError: no terrain.
    """
    check_kind("terrain", terrain, Terrain, "an rbd.Terrain: rbd.Terrain.stairs(0.1, 0.3, 3)")
    recorder = Recorder()
    viewer = ViewerNode(recorder)
    corners = corners_of(terrain)
    size = float(np.clip(0.25 * np.ptp(corners[:, :2], axis=0).max(), LEAST, MOST))
    sizes, layers = Sizes(size, 1.0), checked_layers(None)
    shown = ShownTerrain.about(terrain, corners)
    marks = [mark for mark in terrain_marks(0, shown, sizes) if len(mark.points)]
    for mark in marks:
        send_mark(viewer, mark)
    recorder.post("marks", described(marks, layers))
    tops = np.concatenate([mark.points for mark in marks[:1]] or [corners])
    x, y, z = (f"{low:.4g} to {high:.4g} m" for low, high in zip(corners.min(axis=0), corners.max(axis=0), strict=True))
    lines = [*shown.lines, f"x {x}", f"y {y}", f"z {z}"]
    entries = [entry(TERRAIN_COLOR, shown.title, "", lines, "surfaces")]
    notes = ["Drag to turn, wheel to zoom, right button to shift."]
    recorder.post("legend", json.dumps({"legend": {"title": "terrain", "entries": entries, "notes": notes}}))
    near = tops[((tops >= corners.min(axis=0) - ENDLESS) & (tops <= corners.max(axis=0) + ENDLESS)).all(axis=1)]
    seen = [near if len(near) else corners]
    view = camera_and_ground(seen, _seen_from(tops), [1.0, 0.0], opens="start", body=size, ground=False)
    return offline_page("terrain", [*recorder.messages()[0], view])


def _seen_from(tops: Array) -> list[float]:
    """From a terrain to the camera: from where it is lower along x and y."""
    off = tops - tops.mean(axis=0)
    rises = off[:, :2].T @ off[:, 2] > 1e-9
    return [-FRONT_LEFT[0] if rises[0] else FRONT_LEFT[0], -FRONT_LEFT[1] if rises[1] else FRONT_LEFT[1], FRONT_LEFT[2]]


def corners_of(terrain: Terrain) -> Array:
    """Corners of its bounded pieces and grids, shape (k, 3) [m]; of planes alone those of a square on the first."""
    found = list[Array]()
    for solid in terrain.solids:
        if isinstance(solid, Heights):
            ends = solid.origin + solid.spacing * (np.array(solid.z.shape) - 1)
            found.append(np.array([[*solid.origin, solid.z.min()], [*ends, solid.z.max()]]))
        elif len(solid.vertices):
            top = solid.vertices[:, 2].max()
            found.append(solid.vertices[solid.vertices[:, 2] > top - ENDLESS])
    if found:
        return np.concatenate(found)
    n, d = terrain.solids[0].faces[0, :3], terrain.solids[0].faces[0, 3]  # type: ignore[union-attr]
    square = ENDLESS * np.array([[1.0, 1.0, 0.0], [-1.0, 1.0, 0.0], [-1.0, -1.0, 0.0], [1.0, -1.0, 0.0]])
    return np.asarray(square - np.outer(square @ n - d, n))


def export_terrain(terrain: Terrain, path: str | PathLike[str]) -> Path:
    """Write a terrain as one page, which needs no network; returns its path.

    Raises:
        InputError: no terrain.
        PictureError: another ending than .html, or the file cannot be written.

    Example:
        >>> rbd.visual.export_terrain(rbd.Terrain.stairs(0.1, 0.3, 3), "stairs.html").name
        'stairs.html'
    """
    page = terrain_page(terrain)
    target = a_page(path)
    write_page(target, page)
    return target


def show_terrain(terrain: Terrain) -> Path:
    """Open a page of a terrain in the default browser; returns its path, in the folder of temporary files.

    Raises:
        InputError: no terrain.
        PictureError: the page cannot be written.
    """
    target = export_terrain(terrain, Path(tempfile.mkdtemp(prefix="rbd-terrain-")) / "terrain.html")
    webbrowser.open(target.as_uri(), new=2)
    return target
