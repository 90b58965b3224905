"""A model in the making, checked as a whole: one tree of bodies and joints, its URDF, and its loop file in YAML."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain
from xml.sax.saxutils import escape, quoteattr

import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.errors import ModelError, nearest
from rbd.model.urdf import PAIRS, grouped, hanging
from rbd.model.world import TURNS
from rbd.robots.building.parts import ENTRIES, FARTHEST_SLIDE, FARTHEST_TURN, SINGLE, URDF_TYPES, BuilderBody, BuilderJoint
from rbd.robots.building.solids import Solid
from rbd.robots.loop_file import NamedFrame
from rbd.robots.number_checks import COLORS, checked_color, spaced, written

_PLAIN = re.compile(r"(?!(?:null|true|false|~)$)[A-Za-z_][\w-]*", re.ASCII)

Entry = Mapping[str, str | float | Sequence[float]]


def urdf_text(
    name: str, about: str, bodies: Iterable[BuilderBody], joints: Iterable[BuilderJoint], frames: Iterable[NamedFrame]
) -> str:
    """The URDF of bodies, joints and frames, all numbers with all their digits."""
    bodies = list(bodies)
    used = dict.fromkeys(checked_color("color", solid.color) for body in bodies for solid in body.solids)
    own = {color: f"own_{i}" for i, color in enumerate(color for color in used if color not in COLORS)}
    told = about.replace("--", "- -")
    out = ['<?xml version="1.0"?>\n', f"<!-- {escape(told)} -->\n" if told else "", f"<robot name={quoteattr(name)}>\n"]
    colors = (*COLORS.items(), *((mark, rgba) for rgba, mark in own.items()))
    out += [f'  <material name="{color}"><color rgba="{rgba}"/></material>\n' for color, rgba in colors]
    out += [text for body in bodies for text in _body(body, own)]
    out += [text for joint in joints for text in _joint(joint)]
    return "".join([*out, *map(_frame, frames), "</robot>\n"])


def _body(body: BuilderBody, own: Mapping[str, str]) -> Iterator[str]:
    if body.inertial is None and not body.solids and not body.elements:
        yield f"  <link name={quoteattr(body.name)}/>\n"
        return
    yield f"  <link name={quoteattr(body.name)}>\n"
    if body.inertial is not None:
        yield _inertial(body.inertial)
    for solid in body.solids:
        yield from _shape(solid, own)
    yield f"{body.elements}  </link>\n"


def _inertial(of: pin.Inertia) -> str:
    entries = " ".join(f'{name}="{written(float(of.inertia[at]) + 0.0)}"' for name, at in zip(PAIRS, ENTRIES, strict=True))
    return (
        f'    <inertial>\n      <origin xyz="{spaced(of.lever)}"/>\n      <mass value="{written(of.mass)}"/>\n'
        f"      <inertia {entries}/>\n    </inertial>\n"
    )


def _shape(solid: Solid, own: Mapping[str, str]) -> Iterator[str]:
    size = " ".join(f'{key}="{spaced(values)}"' for key, values in solid.drawn_sizes().items())
    inner = f"{_origin(*solid.place())}<geometry><{solid.kind.lower()} {size}/></geometry>"
    color = checked_color("color", solid.color)
    if solid.draws:
        yield f'    <visual>{inner}<material name="{own.get(color, color)}"/></visual>\n'
    if solid.collides:
        yield f"    <collision>{inner}</collision>\n"


def _origin(at: Sequence[float] | Array, rpy: Sequence[float] | Array) -> str:
    turned = f' rpy="{spaced(rpy)}"' if np.any(rpy) else ""
    return f'<origin xyz="{spaced(at)}"{turned}/>'


def _joint(joint: BuilderJoint) -> Iterator[str]:
    child, rpy = joint.child, joint.rpy
    if joint.plane != "xy":  # a joint in the plane of turned axes, and these turned back
        child, T = f"{joint.name}_plane", TURNS[joint.plane]
        rpy = pin.rpy.matrixToRpy(pin.rpy.rpyToMatrix(np.array(rpy, float)) @ T)
        back = _origin((0.0, 0.0, 0.0), pin.rpy.matrixToRpy(T.T))
        yield f'  <link name={quoteattr(child)}/>\n  <joint name={quoteattr(f"{child}_joint")} type="fixed">{back}'
        yield f"<parent link={quoteattr(child)}/><child link={quoteattr(joint.child)}/></joint>\n"
    yield f'  <joint name={quoteattr(joint.name)} type="{URDF_TYPES[joint.kind]}">\n'
    yield f"    <parent link={quoteattr(joint.parent)}/>\n    <child link={quoteattr(child)}/>\n"
    yield f"    {_origin(joint.at, rpy)}\n"
    if joint.kind in SINGLE:
        yield f'    <axis xyz="{spaced(joint.axis)}"/>\n'
        far = FARTHEST_TURN if joint.kind == "revolute" else FARTHEST_SLIDE
        low, high = joint.limits or (-far, far)
        bounds = "" if joint.kind == "continuous" else f'lower="{written(low)}" upper="{written(high)}" '
        yield f'    <limit {bounds}effort="{written(joint.effort or 0.0)}" velocity="{written(joint.speed or 0.0)}"/>\n'
    elif joint.kind == "planar":
        yield '    <axis xyz="0 0 1"/>\n'
    dynamics = [(key, getattr(joint, key)) for key in ("damping", "friction", "armature")]
    if given := " ".join(f'{key}="{written(value)}"' for key, value in dynamics if value):
        yield f"    <dynamics {given}/>\n"
    yield "  </joint>\n"


def _frame(frame: NamedFrame) -> str:
    name, joint = quoteattr(frame.name), quoteattr(f"{frame.name}_joint")
    return (
        f'  <link name={name}/>\n  <joint name={joint} type="fixed"><parent link={quoteattr(frame.link)}/><child link={name}/>'
        f"{_origin(frame.xyz, frame.rpy)}</joint>\n"
    )


def yaml_text(
    root: str,
    plane: str | None,
    passive: Sequence[str],
    order: Sequence[str],
    lists: Mapping[str, Sequence[Entry]],
    postures: Mapping[str, Mapping[str, float | Sequence[float]]],
) -> str:
    """The loop file.

    Args:
        root: Kind of the root joint.
        plane: Of a planar root, if one was named.
        passive: Joints without a motor.
        order: Joints as declared, where Pinocchio would order them otherwise.
        lists: {"loops", "couplings", "drives", "wheels": entries}.
        postures: {name: {joint: value}}.
    """
    out = [f"root: {root}", *([f"plane: {plane}"] if plane else [])]
    if passive:
        out.append(f"passive: [{', '.join(map(_word, passive))}]")
    if order:
        out.append(f"order: [{', '.join(map(_word, order))}]")
    for part, entries in lists.items():
        if entries:
            out += [f"{part}:", *(f"  - {_mapping(entry)}" for entry in entries)]
    if postures:
        out += ["postures:", *(f"  {_word(name)}: {_mapping(values)}" for name, values in postures.items())]
    return "\n".join(out) + "\n"


def _mapping(entry: Entry) -> str:
    return "{" + ", ".join(f"{_word(key)}: {_value(value)}" for key, value in entry.items()) + "}"


def _value(value: str | float | Sequence[float]) -> str:
    if isinstance(value, str):
        return _word(value)
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, Sequence):
        return f"[{', '.join(written(float(x)) for x in value)}]"
    return written(float(value))


def _word(text: str) -> str:
    """A name as YAML reads it back."""
    return text if _PLAIN.fullmatch(text) else json.dumps(text, ensure_ascii=False)


def check_tree(
    name: str, root: str, bodies: Mapping[str, BuilderBody], joints: Sequence[BuilderJoint], frames: Iterable[NamedFrame]
) -> None:
    """Refuse what is no tree with one root, or moves without mass.

    Args:
        name: Of the robot, for messages.
        root: Kind of its root joint.
        bodies: Its bodies by name.
        joints: Its joints; no body has two.
        frames: Its frames.

    Raises:
        ModelError: naming the part, what it names and the nearest names.
    """
    if not bodies:
        raise ModelError(f"{name}: it has no bodies; give it some: .body(name, rbd.robots.Box(...)).")
    for joint in joints:
        for end, body in (("parent", joint.parent), ("child", joint.child)):
            if body not in bodies:
                raise ModelError(
                    f"{name}: the {end} of joint {joint.name!r:.80} is {body!r:.80}; {_missing(body, root, bodies)}"
                )
    names = [joint.name for joint in joints]
    for frame in frames:
        if frame.link not in bodies:
            raise ModelError(f"{name}: frame {frame.name!r:.80} is on {frame.link!r:.80}; {_missing(frame.link, root, bodies)}")
        if (own := f"{frame.name}_joint") in names:
            raise ModelError(f"{name}: joint {own!r:.80} is that of frame {frame.name!r:.80} in the file; rename one.")
    moved, below = {joint.child for joint in joints}, grouped((joint.parent, joint.child) for joint in joints)
    roots = [body for body in bodies if body not in moved]
    if len(roots) != 1:
        found = ", ".join(f"{body!r:.80}" for body in roots[:6]) or "none: the joints make a circle, close it with .loop"
        hint = ": .joint(name, 'ground', body, kind)" if root == "fixed" else ""
        raise ModelError(
            f"{name}: expected one body that hangs on no joint, found {len(roots)}: {found}."
            + (f" Join the others to it by a joint, of kind 'free' if they float{hint}." if roots else "")
        )
    reached = set(chain.from_iterable(hanging(roots, below)))
    if lost := [body for body in bodies if body not in reached]:
        raise ModelError(
            f"{name}: body {lost[0]!r:.80} does not hang on the root {roots[0]!r:.80}: its joints make a circle. Take one of "
            "them out, and close the circle with .loop."
        )
    for joint in joints:
        beyond = list(chain.from_iterable(hanging([joint.child], below)))
        if joint.kind != "fixed" and not any(bodies[body].mass > 0.0 for body in beyond):
            more = f", nor has {beyond[1]!r:.80} that hangs on it" if len(beyond) > 1 else ""
            raise ModelError(
                f"{name}: body {joint.child!r:.80} moves in joint {joint.name!r:.80} and has no mass{more}. Give it a mass and "
                "an inertia, or make the joint 'fixed'."
            )


def _missing(body: str, root: str, bodies: Iterable[str]) -> str:
    if body == "ground" and root != "fixed":
        return f"there is a ground where the root is fixed, RobotBuilder(name, root='fixed'), and here it is {root!r}."
    if body.lower() in ("world", "universe"):
        return "what is fixed is called 'ground', where RobotBuilder(name, root='fixed')."
    return f"{nearest(body, bodies)}. Declare it: .body({body!r:.80}, ...)."
