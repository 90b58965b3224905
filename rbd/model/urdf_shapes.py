"""The shapes of a URDF's links: sizes that no body has are refused by the link's name.

urdfdom takes them all: a sphere of radius -1 rests on the ground at z = -1, one of radius nan nowhere.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree

from rbd.model.urdf import FARTHEST, LARGEST, Complaints

SMALLEST = 1e-9
"""Smallest size of a shape [m], and smallest scale of a mesh either way."""
_SIZES = {"sphere": ("radius",), "cylinder": ("radius", "length"), "capsule": ("radius", "length"), "box": ("size",)}


def check_shapes(wrong: Complaints, robot: ElementTree.Element) -> None:
    """Complain of sizes that are missing, no numbers, negative, zero or nearly so, and of scales that flatten a mesh.

    A negative scale mirrors a mesh, and is taken.
    """
    for link in robot.findall("link"):
        for kind in ("collision", "visual"):
            for part in link.findall(kind):
                what = f"the {kind} shape of link {link.get('name', '')!r}"
                if (origin := part.find("origin")) is not None:
                    for key in ("xyz", "rpy"):
                        wrong.numbers(f"the origin of {what}", origin, key, count=3, default=0.0, most=FARTHEST)
                for shape in part.iterfind("geometry/*"):
                    _check(wrong, what, shape)


def _check(wrong: Complaints, what: str, shape: ElementTree.Element) -> None:
    found = len(wrong.found)
    if shape.tag == "mesh" and shape.get("scale") is not None:
        factors = wrong.numbers(f"the mesh in {what}", shape, "scale", count=3, most=LARGEST)
        if len(wrong.found) == found and not all(abs(factor) >= SMALLEST for factor in factors):
            told = f"the mesh in {what} has the scale {shape.get('scale')!r:.60}"
            wrong.add(f"{told}; expected factors of {SMALLEST:g} or more, negative ones for a mirror.")
    for key in _SIZES.get(shape.tag, ()):
        sizes = wrong.numbers(f"the {shape.tag} in {what}", shape, key, count=3 if key == "size" else 1, most=FARTHEST)
        if len(wrong.found) == found and not all(size >= SMALLEST for size in sizes):
            wrong.add(f"the {shape.tag} in {what} has {key} {shape.get(key)!r:.60}; expected {SMALLEST:g} m or more.")
