"""MJCF files: what Pinocchio's reader would drop without a word, or crash on, is refused by name.

It reads the first body of the world alone, passes over bodies without a name and over <include>, <frame> and <replicate>,
counts negative masses as zero, and ends the process on a joint called `universe`.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path

from rbd.urdf_file import FARTHEST, LARGEST, LIGHTEST, LONGEST_NAME, Complaints

DROPPED = ("include", "attach", "replicate", "frame", "composite", "flexcomp")
NUMBERS: dict[str, int | None] = {
    "pos": 3,
    "quat": 4,
    "axis": 3,
    "euler": 3,
    "axisangle": 4,
    "xyaxes": 6,
    "zaxis": 3,
    "mass": 1,
    "density": 1,
    "diaginertia": 3,
    "fullinertia": 6,
    "range": 2,
    "armature": 1,
    "damping": 1,
    "frictionloss": 1,
    "ref": 1,
    "size": None,
    "fromto": 6,
}
"""How many numbers an attribute takes, where that is fixed."""
NOT_NEGATIVE = ("mass", "density", "armature", "damping", "frictionloss")


def check_mjcf(path: Path, root: ElementTree.Element) -> float:
    """The mass that the file gives to moving bodies by their <inertial> [kg]; bodies weighed by their shapes are not in it.

    Raises:
        ModelError: naming the first element that is wrong, and how many more are.
    """
    wrong = Complaints(path.name)
    for element in root.iter():
        if element.tag in DROPPED:
            wrong.stop(f"<{element.tag}> is not read by Pinocchio, and what it brings would be lost. Write it out.")
    _check_assets(wrong, path.parent, root)
    worlds = root.findall("worldbody")
    bodies = [body for world in worlds for body in world.findall("body")]
    if len(bodies) > 1:
        names = ", ".join(repr(body.get("name", "")) for body in bodies[:4])
        wrong.stop(f"its world holds {len(bodies)} bodies, {names}; Pinocchio reads the first alone. Give each its own file.")
    seen: dict[str, set[str]] = {"body": set(), "joint": set()}
    for owner, element in _below(worlds):
        _check_name(wrong, seen, owner, element)
        _check_numbers(wrong, owner, element)
    for default in root.findall("default"):
        for element in default.iter():
            _check_numbers(wrong, "the defaults", element)
    wrong.refuse()
    compiler = root.find("compiler")
    if compiler is not None and compiler.get("inertiafromgeom") == "true":
        return 0.0
    return sum(_moving_mass(body, moving=False) for body in bodies)


def _below(worlds: list[ElementTree.Element]) -> Iterator[tuple[str, ElementTree.Element]]:
    """(the body that carries it, element) of everything in the world."""
    stack = [("the world", world) for world in worlds]
    while stack:
        owner, element = stack.pop()
        for child in element:
            of = f"body {child.get('name', '')!r}" if child.tag == "body" else owner
            yield of, child
            stack.append((of, child))


def _check_name(wrong: Complaints, seen: dict[str, set[str]], owner: str, element: ElementTree.Element) -> None:
    if element.tag not in ("body", "joint", "freejoint"):
        return
    kind, name = element.tag.removeprefix("free"), element.get("name")
    if name is None or not name.strip():
        if kind == "body":
            wrong.add("a body has no name, and Pinocchio would lose it. Name every body.")
        return
    if len(name) > LONGEST_NAME:
        wrong.stop(f"{kind} {name[:40]!r}... has a name of {len(name)} letters; expected {LONGEST_NAME} at most.")
    if name in seen[kind]:
        wrong.add(f"{'bodies' if kind == 'body' else 'two joints'} are called {name!r}; expected different names.")
    if kind == "joint" and name == "universe":
        wrong.add(f"joint 'universe' of {owner} has the name of Pinocchio's world. Rename it.")
    seen[kind].add(name)


def _check_numbers(wrong: Complaints, owner: str, element: ElementTree.Element) -> None:
    what = f"joint {element.get('name')!r}" if element.tag == "joint" and element.get("name") else f"<{element.tag}> of {owner}"
    for key, count in NUMBERS.items():
        text = element.get(key)
        if text is None:
            continue
        far = FARTHEST if key in ("pos", "fromto", "size") else LARGEST
        values = wrong.numbers(what, element, key, count=count or len(text.split()), most=far)
        if key == "mass" and 0.0 < values[0] < LIGHTEST:
            wrong.add(f"{what} has a mass of {values[0]:g} kg; expected zero, or at least {LIGHTEST:g} kg.")
        if key in NOT_NEGATIVE and values[0] < 0.0:
            wrong.add(f"{what} has {key} {values[0]:g}; expected zero or more.")
        if key == "axis" and not any(values):
            wrong.add(f"the axis of {what} is zero.")
        if key == "quat" and sum(x * x for x in values) < 1e-12:
            wrong.add(f"the quaternion of {what} is zero.")
        if key == "range" and element.tag == "joint" and values[0] > values[1]:
            wrong.add(f"{what} has its limits swapped: lower is {values[0]:g}, upper is {values[1]:g}.")


def _check_assets(wrong: Complaints, folder: Path, root: ElementTree.Element) -> None:
    """Files that the model names lie in its own folder, after resolving links."""
    compiler = root.find("compiler")
    places = {"": folder}
    for key in ("meshdir", "texturedir", "assetdir"):
        places[key] = folder / (compiler.get(key, "") if compiler is not None else "")
    inside = folder.resolve()
    for element in root.iter():
        name = element.get("file")
        if name is None:
            continue
        for place in places.values():
            try:
                outside = not (place / name).resolve().is_relative_to(inside)
            except (OSError, ValueError, RuntimeError):
                outside = True
            if outside:
                wrong.stop(f"<{element.tag}> names the file {name!r:.200}, outside the folder of {wrong.file}. Copy it there.")


def _moving_mass(body: ElementTree.Element, *, moving: bool) -> float:
    total, stack = 0.0, [(body, moving)]
    while stack:
        body, moving = stack.pop()
        moving = moving or body.find("joint") is not None or body.find("freejoint") is not None
        mass = body.find("inertial")
        if moving and mass is not None:
            total += float(mass.get("mass", "0") or 0.0)
        stack.extend((child, moving) for child in body.findall("body"))
    return total
