"""What of MJCF is read and what changes nothing here; everything else is refused by its name.

"Changes nothing" means: not the tree, not M, not gravity, not the motors, not a joint's axis or limits. An element or an
attribute that is in neither list may do so, or may come to do so in a later version of MJCF.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree

from rbd.model.urdf import Complaints

Element = ElementTree.Element


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
"""Sections of a file; the second line changes nothing here."""

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
    """Refuse attributes that are not known to be read right or to change nothing."""
    for key in element.keys():
        if key not in KNOWN[element.tag]:
            remedy = f": {_WHY[key]}" if key in _WHY else ", and may change the robot. Take it out if it does not matter"
            wrong.stop(f"{what} has the attribute {key[:40]!r}, which is not read{remedy}.")
