"""Triangles and colours of Collada files (.dae), read here because the usual readers lose some.

Meshcat drops parts of them silently, and Coal 3.0 joins the triangles of a part with several materials to the wrong
vertices (ANYmal's trunk looks torn). The file's unit is used, and its up axis too (iCub needs it), except of MeshLab:
that writes Y_UP whatever the axes are, as on Go1, Borinot and Hextilt.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rbd.arrays import Array
from rbd.visual.shapes import Mesh, joined

Element = ElementTree.Element
Rgba = tuple[float, float, float, float]


@dataclass(frozen=True, eq=False, slots=True)
class ColoredMesh:
    """Triangles of one colour; None where the file gives none, or a texture."""

    mesh: Mesh
    rgba: Rgba | None


def read_collada(path: str | Path) -> list[ColoredMesh]:
    """The pieces of a Collada file, z up [m], one a colour.

    Triangles, polygons without holes and lists of them are read, placed by the nodes' transforms. Skins, strips,
    library nodes, textures and transparency are not.

    Raises:
        ValueError, LookupError, StopIteration, RecursionError, OSError, ElementTree.ParseError: if the file is not what
            Collada says.
    """
    tree = ElementTree.parse(path).getroot()
    for element in tree.iter():
        element.tag = element.tag.rpartition("}")[2]
    named = {element.get("id", ""): element for element in tree.iter() if element.get("id")}
    by_color: dict[Rgba | None, list[Mesh]] = {}
    for scene in tree.iter("visual_scene"):
        for node in scene.findall("node"):
            for mesh, rgba in _of_node(node, _upright_metres(tree), named):
                by_color.setdefault(rgba, []).append(mesh)
    return [ColoredMesh(joined(meshes), rgba) for rgba, meshes in by_color.items()]


def _upright_metres(tree: Element) -> Array:
    """From the file's axes and unit to z up and metres, shape (4, 4)."""
    unit = tree.find("asset/unit")
    X = np.diag([1.0 if unit is None else float(unit.get("meter", 1.0))] * 3 + [1.0])
    by_meshlab = any("MeshLab" in (tool.text or "") for tool in tree.iter("authoring_tool"))
    if tree.findtext("asset/up_axis", "").strip() == "Y_UP" and not by_meshlab:
        X = np.array([[1.0, 0, 0, 0], [0, 0, -1.0, 0], [0, 1.0, 0, 0], [0, 0, 0, 1.0]]) @ X
    return X


def _of_node(node: Element, X: Array, named: dict[str, Element]) -> Iterator[tuple[Mesh, Rgba | None]]:
    for step in node:
        X = X @ _transform(step)
    for instance in node.findall("instance_geometry"):
        materials = {m.get("symbol"): m.get("target", "")[1:] for m in instance.iter("instance_material")}
        shape = named[instance.get("url", "")[1:]].find("mesh")
        for group in [] if shape is None else shape:
            if group.tag in ("triangles", "polylist", "polygons"):
                mesh = _triangles(group, named)
                placed = Mesh(mesh.vertices @ X[:3, :3].T + X[:3, 3], mesh.faces)
                yield placed, _color(materials.get(group.get("material")), named)
    for child in node.findall("node"):
        yield from _of_node(child, X, named)


def _transform(step: Element) -> Array:
    X = np.eye(4)
    if step.tag not in ("matrix", "translate", "rotate", "scale"):
        return X
    numbers = _numbers(step)
    if step.tag == "matrix":
        return numbers.reshape(4, 4)
    if step.tag == "translate":
        X[:3, 3] = numbers
    elif step.tag == "scale":
        X[:3, :3] = np.diag(numbers)
    else:
        x, y, z = numbers[:3] / max(float(np.linalg.norm(numbers[:3])), 1e-300)
        c, s = np.cos(np.radians(numbers[3])), np.sin(np.radians(numbers[3]))
        K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        X[:3, :3] = np.eye(3) + s * K + (1.0 - c) * K @ K
    return X


def _triangles(group: Element, named: dict[str, Element]) -> Mesh:
    inputs = [(i.get("semantic"), int(i.get("offset", 0)), i.get("source", "")[1:]) for i in group.findall("input")]
    stride = 1 + max(offset for _, offset, _ in inputs)
    at, source = next((offset, name) for semantic, offset, name in inputs if semantic == "VERTEX")
    position = next(i for i in named[source].findall("input") if i.get("semantic") == "POSITION")
    vertices = _numbers(_only(named[position.get("source", "")[1:]], "float_array")).reshape(-1, 3)
    runs = [_vertex_numbers(p, len(vertices), stride, at) for p in group.findall("p")]
    if group.tag == "triangles":
        faces = np.concatenate([np.zeros(0, int), *runs]).reshape(-1, 3)
        return Mesh(vertices, faces)
    if group.tag == "polylist":
        counts = _numbers(_only(group, "vcount")).astype(int)
        runs = np.split(np.concatenate([np.zeros(0, int), *runs]), np.cumsum(counts)[:-1])
    fans = [(run[0], run[i], run[i + 1]) for run in runs for i in range(1, len(run) - 1)]
    return Mesh(vertices, np.array(fans, int).reshape(-1, 3))


def _vertex_numbers(p: Element, count: int, stride: int, at: int) -> Array:
    numbers = _numbers(p).reshape(-1, stride)[:, at]
    if not ((numbers >= 0) & (numbers < count)).all():
        raise ValueError(f"a <p> of a Collada file names vertices that are not among its {count}")
    return numbers.astype(int)


def _color(material: str | None, named: dict[str, Element]) -> Rgba | None:
    if material is None or material not in named:
        return None
    effect = named[material].find("instance_effect")
    color = None if effect is None else named[effect.get("url", "")[1:]].find(".//diffuse/color")
    if color is None:
        return None
    red, green, blue = (float(c) for c in _numbers(color)[:3])
    return red, green, blue, 1.0


def _only(element: Element, tag: str) -> Element:
    found = element.find(tag)
    if found is None:
        raise ValueError(f"a <{element.tag}> of a Collada file has no <{tag}>")
    return found


def _numbers(element: Element) -> Array:
    return np.array((element.text or "").split(), float)
