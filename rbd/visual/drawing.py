"""Shapes as messages for Meshcat's viewer, and what our page needs to know of them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence

import meshcat
from meshcat.geometry import MeshLambertMaterial, MeshPhongMaterial, TriangularMeshGeometry

from rbd.visual.marks.mark import Mark
from rbd.visual.robot_meshes import RobotPart
from rbd.visual.shapes import Mesh
from rbd.visual.style import rgb_number


def send_part(viewer: meshcat.Visualizer, path: str, part: RobotPart, *, nearer: int = 0) -> None:
    """Send a piece of a robot, in its own frame; of surfaces in one plane the one with the largest `nearer` is seen."""
    shine = MeshPhongMaterial(color=rgb_number(part.color), opacity=part.opacity)
    shine.properties.update(specular=0x222222, shininess=20)
    if part.opacity < 0.5:  # inner parts must be drawn, in any order
        shine.properties.update(depthWrite=False)
    if nearer:
        shine.properties.update(polygonOffset=True, polygonOffsetFactor=-nearer, polygonOffsetUnits=-nearer)
    _send_mesh(viewer, path, part.mesh, shine)


def send_mark(viewer: meshcat.Visualizer, mark: Mark) -> None:
    """Send a mark, and its ghost if it shines through what hides it."""
    glow = rgb_number(mark.color, share=0.15)
    solid = MeshLambertMaterial(color=rgb_number(mark.color), opacity=mark.opacity, emissive=glow)
    if mark.opacity < 1.0:
        solid.properties.update(depthWrite=False)
    _send_mesh(viewer, f"marks/{mark.path}", mark.mesh, solid)
    if mark.seen_through:
        ghost = MeshLambertMaterial(color=rgb_number(mark.color), opacity=0.6 * mark.opacity, emissive=glow)
        ghost.properties.update(depthTest=False, depthWrite=False)
        _send_mesh(viewer, f"marks/{mark.path}_seen_through", mark.mesh, ghost)


def described(marks: Sequence[Mark], layers: Mapping[str, bool]) -> str:
    """The layers, and of every mark its path, layer and label, as JSON for the page."""
    listed = []
    for mark in marks:
        one: dict[str, object] = {"path": mark.path, "layer": mark.layer}
        if mark.label is not None:
            at = [round(float(x), 5) for x in mark.label.at]
            one["label"] = {"title": mark.label.title, "lines": list(mark.label.lines), "at": at}
        listed.append(one)
    return json.dumps({"marks": {"layers": dict(layers), "listed": listed}})


def _send_mesh(viewer: meshcat.Visualizer, path: str, mesh: Mesh, material: MeshLambertMaterial | MeshPhongMaterial) -> None:
    geometry = TriangularMeshGeometry(mesh.vertices, mesh.faces)
    # Meshcat's names contain the network card's number and the clock: these make pages reproducible and private.
    geometry.uuid, material.uuid = f"{path}#geometry", f"{path}#material"
    node = meshcat.geometry.Mesh(geometry, material)
    node.uuid = f"{path}#mesh"
    viewer[path].set_object(node)
