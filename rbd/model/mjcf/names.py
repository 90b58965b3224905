"""Names in an MJCF file: those that would be lost, confused, or end the process."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree

from rbd.model.urdf import LONGEST_NAME, Complaints

_KINDS = {"body": "bodies", "joint": "two joints", "freejoint": "two joints", "site": "two sites"}


def check_names(wrong: Complaints, root: ElementTree.Element) -> None:
    """Complain of names that come twice, are too long, or are the world's own."""
    seen: set[tuple[str, str]] = set()
    for element in root.iterfind("worldbody//*"):
        name = element.get("name")
        if name is None or element.tag not in _KINDS:
            continue
        kind = element.tag.removeprefix("free")
        if len(name) > LONGEST_NAME:
            wrong.stop(f"{kind} {name[:40]!r}... has a name of {len(name)} letters; expected {LONGEST_NAME} at most.")
        if name.strip() and (kind, name) in seen:
            wrong.add(f"{_KINDS[element.tag]} are called {name!r}; expected different names.")
        if (kind, name) in (("joint", "universe"), ("body", "universe"), ("body", "world")):
            wrong.add(f"{kind} {name!r} has the name of the world. Rename it.")
        seen.add((kind, name))
