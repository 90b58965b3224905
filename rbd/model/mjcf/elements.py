"""Elements of MJCF: which of them and of their attributes are read or have no effect here, and their defaults.

All others are refused by name.

"No effect" means: none on the tree, M, gravity, not the motors, not a joint's axis or limits. An element or an
attribute that is in neither list may do so, or may come to do so in a later version of MJCF.
"""

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
"""Attributes of which an element may give only the first numbers; the others are defaults."""
_CLASSED = ("joint", "geom", "site", "mesh")


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


_POSE = "pos quat axisangle xyaxes zaxis euler"
_CONTACT = "solreflimit solimplimit solreffriction solimpfriction margin group user"
_MOTOR = """name class joint jointinparent gear ctrlrange ctrllimited forcerange forcelimited armature
    group user delay nsample interp lengthrange"""
_SERVO = f"{_MOTOR} damping kp kv dampratio timeconst inheritrange"

KNOWN: dict[str, frozenset[str]] = {
    "compiler": _words("""angle autolimits balanceinertia boundinertia boundmass coordinate eulerseq inertiafromgeom
        inertiagrouprange meshdir assetdir texturedir settotalmass strippath alignfree fitaabb discardvisual fusestatic
        usethread saveinertial savecanonical savecompiled"""),
    "option": _words("""gravity density viscosity wind actuatorgroupdisable ccd_iterations ccd_tolerance cone impratio
        integrator iterations jacobian ls_iterations ls_tolerance magnetic noslip_iterations noslip_tolerance o_friction
        o_margin o_solimp o_solref sdf_initpoints sdf_iterations sleep_tolerance solver timestep tolerance apirate collision
        mpr_iterations mpr_tolerance"""),
    "flag": _words("""gravity spring damper actuation constraint equality frictionloss limit clampctrl contact autoreset
        diagexact energy eulerdamp filterparent fwdinv invdiscrete island midphase multiccd nativeccd override refsafe sensor
        sleep speculative warmstart ipc passive"""),
    "worldbody": _words("name childclass"),
    "body": _words(f"name childclass mocap gravcomp user sleep {_POSE}"),
    "frame": _words(f"name childclass {_POSE}"),
    "inertial": _words(f"mass diaginertia fullinertia {_POSE}"),
    "freejoint": _words("name group align"),
    "joint": _words(f"""name class type pos axis range limited ref armature damping frictionloss stiffness springdamper
        actuatorfrcrange actuatorfrclimited actuatorgravcomp springref springyield {_CONTACT}"""),
    "geom": _words(f"""name class type size fromto mass density shellinertia mesh fitscale contype conaffinity group rgba
        hfield adhesion castshadow condim fluidcoef fluidshape friction gap margin material priority solimp solmix solref
        surfacevel user {_POSE}"""),
    "site": _words(f"name class fromto group material mesh rgba size type user {_POSE}"),
    "mesh": _words("""name class file vertex face inertia scale refpos refquat maxhullvert normal texcoord smoothnormal
        material"""),
    "key": _words("name qpos qvel act ctrl mpos mquat time plastic"),
    "motor": _words(_MOTOR),
    "general": _words(f"""{_MOTOR} damping gaintype gainprm biastype biasprm dyntype dynprm actdim actearly actlimited
        actrange inheritrange"""),
    "position": _words(_SERVO),
    "velocity": _words(_SERVO),
    "intvelocity": _words(f"{_SERVO} actrange actlimited"),
    "cylinder": _words(f"{_MOTOR} damping timeconst area diameter bias"),
}
"""The attributes of each element that is read."""

SECTIONS = _words("""compiler option default worldbody asset actuator equality tendon keyframe deformable
    size statistic visual custom sensor contact extension""")
"""Sections of a file; the second line has no effect here."""

_INSIDE = {
    "worldbody": _words("body geom site camera light frame"),
    "body": _words("body geom site camera light frame inertial joint freejoint"),
    "asset": _words("mesh hfield texture material skin"),
    "deformable": _words("skin"),
    "compiler": _words("lengthrange"),
    "option": _words("flag"),
}
_INSIDE["frame"] = _INSIDE["body"]
_LEAVES = _words("inertial joint freejoint geom mesh flag")

_WHY = {
    "replicate": "write its copies out",
    "attach": "write out what it attaches",
    "composite": "write its bodies out",
    "flexcomp": "bodies that bend are not rigid bodies",
    "flex": "bodies that bend are not rigid bodies",
    "plugin": "what a plugin does is not known",
    "model": "write out the model that it brings",
    "include": "write out what it includes",
    "content_type": "give the file the ending of its kind: .stl, .obj or .msh",
    "builtin": "give its vertices",
}


def check_elements(wrong: Complaints, root: Element) -> None:
    """Refuse elements that are not read where they may change the robot."""
    for section in root:
        if section.tag not in SECTIONS:
            _refuse(wrong, section.tag, "the file")
    stack = [(section, section.tag) for section in root if section.tag in _INSIDE]
    while stack:
        element, where = stack.pop()
        for child in element:
            allowed = frozenset[str]() if element.tag in _LEAVES else _INSIDE.get(element.tag)
            if allowed is not None and child.tag not in allowed:
                _refuse(wrong, child.tag, where)
            if child.tag in _INSIDE or child.tag in _LEAVES:
                stack.append((child, f"{child.tag} {child.get('name')!r:.80}" if child.get("name") else f"<{child.tag}>"))


def _refuse(wrong: Complaints, tag: str, where: str) -> None:
    remedy = f" {_WHY[tag][0].upper()}{_WHY[tag][1:]}." if tag in _WHY else " Take it out if it does not matter."
    wrong.stop(f"<{tag:.40}> is not read, and what it brings to {where} would be lost.{remedy}")


def check_attributes(wrong: Complaints, what: str, element: Element) -> None:
    """Refuse attributes that are neither read nor known to have no effect."""
    for key in element.keys():
        if key not in KNOWN[element.tag]:
            remedy = f": {_WHY[key]}" if key in _WHY else ", and may change the robot. Take it out if it does not matter"
            wrong.stop(f"{what} has the attribute {key[:40]!r}, which is not read{remedy}.")


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
        """The defaults of an element's class for its kind."""
        name = element.get("class") or childclass or MAIN
        if name not in self._classes:
            self._wrong.stop(
                f"<{element.tag}> {element.get('name', '')!r:.80} is of the default class {name!r:.80}, which is "
                f"not in the file; {nearest(name, sorted(self._classes))}."
            )
        return self._classes[name].get(kind, {})


def merged(default: dict[str, str], own: dict[str, str]) -> dict[str, str]:
    """Attributes of the element over those of a default."""
    out = {key: text for key, text in default.items() if key not in ORIENTATIONS or not any(o in own for o in ORIENTATIONS)}
    for key, text in own.items():
        words = text.split()
        rest = default.get(key, "").split()[len(words) :] if key in _PARTIAL else []
        out[key] = " ".join([*words, *rest]) if rest else text
    return out
