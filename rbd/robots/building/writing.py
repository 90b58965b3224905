"""A model in the making, checked as a whole: one tree of bodies and joints, its URDF, and its loop file in YAML."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any
from xml.sax.saxutils import escape, quoteattr

from rbd.arrays import Array
from rbd.constraints.loop import KINDS as CLOSURES
from rbd.errors import InputError, ModelError, nearest
from rbd.robots import loop_file
from rbd.robots.building.number_checks import (
    COLORS,
    checked_axis,
    checked_choice,
    checked_name,
    checked_number,
    checked_numbers,
    spaced,
    written,
)
from rbd.robots.building.parts import FARTHEST_SLIDE, FARTHEST_TURN, SINGLE, URDF_TYPES, BuilderBody, BuilderJoint, Frame
from rbd.robots.building.solids import Drawn, MassProperties

_PLAIN = re.compile(r"(?!(?:null|true|false|~)$)[A-Za-z_][\w-]*", re.ASCII)
_ENTRIES = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}

Entry = Mapping[str, str | float | Sequence[float]]


def urdf_text(name: str, about: str, parts: Iterable[BuilderBody | BuilderJoint | Frame]) -> str:
    """The URDF of bodies, joints and frames, in this order, all numbers with all their digits."""
    parts = list(parts)
    used = dict.fromkeys(shape.color for part in parts if isinstance(part, BuilderBody) for shape in part.shapes)
    own = {color: f"own_{i}" for i, color in enumerate(color for color in used if color not in COLORS)}
    told = about.replace("--", "- -")
    out = ['<?xml version="1.0"?>\n', f"<!-- {escape(told)} -->\n" if told else "", f"<robot name={quoteattr(name)}>\n"]
    for color, rgba in (*COLORS.items(), *((mark, rgba) for rgba, mark in own.items())):
        out.append(f'  <material name="{color}"><color rgba="{rgba}"/></material>\n')
    for part in parts:
        if isinstance(part, BuilderBody):
            out.extend(_body(part, own))
        elif isinstance(part, BuilderJoint):
            out.extend(_joint(part))
        else:
            out.append(_frame(part))
    return "".join([*out, "</robot>\n"])


def _body(body: BuilderBody, own: Mapping[str, str]) -> Iterator[str]:
    if body.inertial is None and not body.shapes and not body.elements:
        yield f"  <link name={quoteattr(body.name)}/>\n"
        return
    yield f"  <link name={quoteattr(body.name)}>\n"
    if body.inertial is not None:
        yield _inertial(body.inertial)
    for shape in body.shapes:
        yield from _shape(shape, own)
    yield f"{body.elements}  </link>\n"


def _inertial(of: MassProperties) -> str:
    entries = " ".join(f'{name}="{written(float(of.inertia[at]) + 0.0)}"' for name, at in _ENTRIES.items())
    return (
        f'    <inertial>\n      <origin xyz="{spaced(of.com)}"/>\n      <mass value="{written(of.mass)}"/>\n'
        f"      <inertia {entries}/>\n    </inertial>\n"
    )


def _shape(shape: Drawn, own: Mapping[str, str]) -> Iterator[str]:
    size = " ".join(f'{key}="{spaced(values)}"' for key, values in shape.size)
    inner = f"{_origin(shape.at, shape.rpy)}<geometry><{shape.geometry} {size}/></geometry>"
    if shape.draws:
        yield f'    <visual>{inner}<material name="{own.get(shape.color, shape.color)}"/></visual>\n'
    if shape.collides:
        yield f"    <collision>{inner}</collision>\n"


def _origin(at: Sequence[float] | Array, rpy: Sequence[float]) -> str:
    turned = f' rpy="{spaced(rpy)}"' if any(rpy) else ""
    return f'<origin xyz="{spaced(at)}"{turned}/>'


def _joint(joint: BuilderJoint) -> Iterator[str]:
    yield f'  <joint name={quoteattr(joint.name)} type="{URDF_TYPES[joint.kind]}">\n'
    yield f"    <parent link={quoteattr(joint.parent)}/>\n    <child link={quoteattr(joint.child)}/>\n"
    yield f"    {_origin(joint.at, joint.rpy)}\n"
    if joint.kind in SINGLE:
        yield f'    <axis xyz="{spaced(joint.axis)}"/>\n'
        far = FARTHEST_TURN if joint.kind == "revolute" else FARTHEST_SLIDE
        low, high = joint.limits or (-far, far)
        bounds = "" if joint.kind == "continuous" else f'lower="{written(low)}" upper="{written(high)}" '
        yield f'    <limit {bounds}effort="{written(joint.effort)}" velocity="{written(joint.speed)}"/>\n'
    elif joint.kind == "planar":
        yield '    <axis xyz="0 0 1"/>\n'
    dynamics = [(key, getattr(joint, key)) for key in ("damping", "friction", "armature")]
    if given := " ".join(f'{key}="{written(value)}"' for key, value in dynamics if value):
        yield f"    <dynamics {given}/>\n"
    yield "  </joint>\n"


def _frame(frame: Frame) -> str:
    name, joint = quoteattr(frame.name), quoteattr(f"{frame.name}_joint")
    return (
        f'  <link name={name}/>\n  <joint name={joint} type="fixed"><parent link={quoteattr(frame.body)}/><child link={name}/>'
        f"{_origin(frame.at, frame.rpy)}</joint>\n"
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
        lists: {"loops", "couplings", "wheels": entries}.
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


WHEELS = ("rolling_wheel", "rolling_disk", "rolling_ball", "knife_edge")
"""Kinds of wheels."""


def loop_direction(name: str, kind: object, axis: object) -> dict[str, Any]:
    """The axis of a loop of a checked kind; empty for kinds that have none.

    Raises:
        InputError: an unknown kind, an axis of zero length.
    """
    sort = checked_choice(f"kind of loop {name!r:.80}", kind, CLOSURES)
    direction = checked_axis(f"axis of loop {name!r:.80}", axis)
    return {"axis": direction} if sort in ("revolute", "planar") else {}


def coupling_entry(name: str, joint: object, to: object, ratio: object, offset: object) -> dict[str, Any]:
    """A coupling of two joints.

    Raises:
        InputError: names or numbers that are wrong.
    """
    ends = {"joint": checked_name(f"the joint of {name!r:.80}", joint), "to": checked_name(f"`to` of {name!r:.80}", to)}
    numbers = {key: checked_number(f"{key} of {name!r:.80}", x) for key, x in (("ratio", ratio), ("offset", offset))}
    return {"name": name, **ends, **numbers}


def wheel_entry(name: str, kind: object, frame: object, **given: object) -> dict[str, Any]:
    """A wheel, ball, disk or knife edge on the ground.

    Args:
        name: Of the wheel.
        kind: One of `WHEELS`.
        frame: At its centre.
        given: radius, axis, direction; None where not given.

    Raises:
        InputError: an unknown kind, a radius that is missing, numbers that are wrong or not of this kind.
    """
    what = f"wheel {name!r:.80}"
    word = checked_choice(f"kind of {what}", kind, WHEELS)
    entry: dict[str, Any] = {"name": name, "kind": word, "frame": checked_name(f"the frame of {what}", frame)}
    known = loop_file.KINDS[word]
    for key, value in given.items():
        if value is None and key in known.needed:
            raise InputError(f"{what} has no {key}; a {word} needs one.")
        if value is not None and key not in known.keys:
            raise InputError(f"{what} has {key}={value!r:.60}; a {word} has {', '.join(known.keys)}.")
        if value is not None:
            said = f"{key} of {what}"
            entry[key] = checked_number(said, value, least=1e-9) if key == "radius" else checked_axis(said, value)
    return entry


def user_entry(name: str, kind: object, keys: Mapping[str, object]) -> dict[str, Any]:
    """A user's kind of constraint, which was registered.

    Raises:
        InputError: a kind that is not registered; values that are no text, truth, number or numbers.
    """
    word = checked_choice(f"kind of {name!r:.80}", kind, [word for word, known in loop_file.KINDS.items() if not known.part])
    entry: dict[str, Any] = {"name": name, "kind": word}
    for key, value in keys.items():
        entry[key] = value if isinstance(value, str | bool) else _numbers(f"{key} of {name!r:.80}", value, range(1000))
    return entry


def posture_value(posture: str, joint: object, value: object) -> float | tuple[float, ...]:
    """A joint's value or values in a posture.

    Raises:
        InputError: no name, no numbers.
    """
    return _numbers(f"{checked_name('a joint of a posture', joint)!r:.80} of posture {posture!r:.80}", value, range(1, 8))


def _numbers(what: str, value: object, counts: Sequence[int]) -> float | tuple[float, ...]:
    several = isinstance(value, Sequence) or getattr(value, "shape", ()) != ()
    return checked_numbers(what, value, counts) if several else checked_number(what, value)


def check_tree(name: str, root: str, parts: Sequence[BuilderBody | BuilderJoint | Frame]) -> None:
    """Refuse what is no tree with one root, or moves without mass.

    Args:
        name: Of the robot, for messages.
        root: Kind of its root joint.
        parts: Its bodies, joints and frames; no body has two joints.

    Raises:
        ModelError: naming the part, what it names and the nearest names.
    """
    bodies = {part.name: part for part in parts if isinstance(part, BuilderBody)}
    joints = [part for part in parts if isinstance(part, BuilderJoint)]
    if not bodies:
        raise ModelError(f"{name}: it has no bodies; give it some: .body(name, rbd.robots.Box(...)).")
    for joint in joints:
        for end, body in (("parent", joint.parent), ("child", joint.child)):
            if body not in bodies:
                raise ModelError(
                    f"{name}: the {end} of joint {joint.name!r:.80} is {body!r:.80}; {_missing(body, root, bodies)}"
                )
    for part in parts:
        if isinstance(part, Frame) and part.body not in bodies:
            raise ModelError(f"{name}: frame {part.name!r:.80} is on {part.body!r:.80}; {_missing(part.body, root, bodies)}")
    made = [f"{part.name}_joint" for part in parts if isinstance(part, Frame)]
    if taken := [joint.name for joint in joints if joint.name in made]:
        frame = taken[0].removesuffix("_joint")
        raise ModelError(f"{name}: joint {taken[0]!r:.80} has the name of the file's joint of frame {frame!r:.80}; rename one.")
    moved = {joint.child: joint for joint in joints}
    roots = [body for body in bodies if body not in moved]
    if len(roots) != 1:
        found = ", ".join(f"{body!r:.80}" for body in roots[:6]) or "none: the joints make a circle, close it with .loop"
        hint = ": .joint(name, 'ground', body, kind)" if root == "fixed" else ""
        raise ModelError(
            f"{name}: expected one body that hangs on no joint, found {len(roots)}: {found}."
            + (f" Join the others to it by a joint, of kind 'free' if they float{hint}." if roots else "")
        )
    below = descendants(joints)
    reached = {roots[0], *below[roots[0]]} if roots[0] in below else {roots[0]}
    if lost := [body for body in bodies if body not in reached]:
        raise ModelError(
            f"{name}: body {lost[0]!r:.80} does not hang on the root {roots[0]!r:.80}: its joints make a circle. Take one of "
            "them out, and close the circle with .loop."
        )
    for joint in joints:
        beyond = (joint.child, *below.get(joint.child, ()))
        if joint.kind != "fixed" and not any(bodies[body].mass > 0.0 for body in beyond):
            more = f", nor has {beyond[1]!r:.80} that hangs on it" if len(beyond) > 1 else ""
            raise ModelError(
                f"{name}: body {joint.child!r:.80} moves in joint {joint.name!r:.80} and has no mass{more}. Give it a mass and "
                "an inertia, or make the joint 'fixed'."
            )


def descendants(joints: Iterable[BuilderJoint]) -> dict[str, list[str]]:
    """{body: all bodies that hang on it}; each body hangs on one joint at most. Bodies in a circle are not below the root."""
    children: dict[str, list[str]] = {}
    for joint in joints:
        children.setdefault(joint.parent, []).append(joint.child)
    out = {}
    for body in children:
        found: dict[str, None] = {}
        level = [body]
        while level:
            level = [child for each in level for child in children.get(each, ()) if child not in found]
            found.update(dict.fromkeys(level))
        out[body] = list(found)
    return out


def _missing(body: str, root: str, bodies: Iterable[str]) -> str:
    if body == "ground" and root != "fixed":
        return f"there is a ground where the root is fixed, RobotBuilder(name, root='fixed'), and here it is {root!r}."
    if body.lower() in ("world", "universe"):
        return "what is fixed is called 'ground', where RobotBuilder(name, root='fixed')."
    return f"{nearest(body, bodies)}. Declare it: .body({body!r:.80}, ...)."
