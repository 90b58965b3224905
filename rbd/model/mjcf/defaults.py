"""Default classes of an MJCF file: what an element says together with what its class says for it."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree

from rbd.errors import nearest
from rbd.model.urdf import Complaints

Element = ElementTree.Element

MAIN = "main"
ACTUATORS = (
    "general",
    "motor",
    "position",
    "velocity",
    "intvelocity",
    "cylinder",
    "damper",
    "muscle",
    "adhesion",
    "pid",
    "dcmotor",
    "orientation",
    "plugin",
)
ORIENTATIONS = ("quat", "axisangle", "xyaxes", "zaxis", "euler")
_PARTIAL = ("size", "gear", "gainprm", "biasprm", "dynprm")
"""Lists of which an element may give the first few numbers; the others are the default's."""
_CLASSED = ("joint", "geom", "site", "mesh")


class Defaults:
    """The default classes of a file.

    Args:
        wrong: Where complaints go.
        root: The file's first element, includes carried out.
    """

    def __init__(self, wrong: Complaints, root: Element) -> None:
        self._wrong = wrong
        self._classes: dict[str, dict[str, dict[str, str]]] = {MAIN: {}}
        self._by: dict[tuple[str, str], str] = {}
        for top in root.findall("default"):
            if top.get("class", MAIN) != MAIN:
                wrong.stop(f"the outermost <default> is of class {top.get('class')!r:.80}; expected none, or 'main'.")
            self._read(top, MAIN)

    def _read(self, top: Element, name: str) -> None:
        stack = [(top, name)]
        while stack:
            element, name = stack.pop()
            mine = self._classes[name]
            for entry in element:
                if entry.tag != "default":
                    tag = "actuator" if entry.tag in ACTUATORS else entry.tag
                    if len(entry):
                        self._wrong.stop(f"<{entry[0].tag:.40}> in the defaults is not read. Write it where it is meant.")
                    mine[tag] = merged(mine.get(tag, {}), entry.attrib)
                    if tag == "actuator":
                        mine["kind"] = {**mine.get("kind", {}), **dict.fromkeys(entry.attrib, entry.tag)}
            for inner in reversed(element.findall("default")):
                name = inner.get("class", "")
                if not name or name in self._classes:
                    told = f"two default classes are called {name!r:.80}" if name else "a default class has no name"
                    self._wrong.stop(f"{told}; expected different names.")
                self._classes[name] = {tag: dict(given) for tag, given in mine.items()}
                stack.append((inner, name))

    def resolved(self, element: Element, childclass: str | None = None) -> Element:
        """A copy of an element, with the attributes that its class gives it.

        Args:
            element: A joint, geom, site, mesh or actuator.
            childclass: Of the bodies around it.
        """
        copy = ElementTree.Element(element.tag)
        copy.attrib.update(element.attrib)
        kind = "actuator" if element.tag in ACTUATORS else element.tag
        if kind in _CLASSED or kind == "actuator":
            copy.attrib.update(merged(self.given(element, childclass, kind), element.attrib))
        return copy

    def given(self, element: Element, childclass: str | None, kind: str) -> dict[str, str]:
        """What an element's class says for its kind."""
        name = element.get("class") or childclass or MAIN
        if name not in self._classes:
            self._wrong.stop(
                f"<{element.tag}> {element.get('name', '')!r:.80} is of the default class {name!r:.80}, which is "
                f"not in the file; {nearest(name, sorted(self._classes))}."
            )
        return self._classes[name].get(kind, {})


def merged(default: dict[str, str], own: dict[str, str]) -> dict[str, str]:
    """Attributes of one's own over those of a default."""
    out = {key: text for key, text in default.items() if key not in ORIENTATIONS or not any(o in own for o in ORIENTATIONS)}
    for key, text in own.items():
        words = text.split()
        rest = default.get(key, "").split()[len(words) :] if key in _PARTIAL else []
        out[key] = " ".join([*words, *rest]) if rest else text
    return out
