"""The texts of a model in the making: its URDF, and its loop file in YAML."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from xml.sax.saxutils import escape, quoteattr

from rbd.arrays import Array
from rbd.robots.building.numbers import COLORS, spaced, written
from rbd.robots.building.parts import FARTHEST_SLIDE, FARTHEST_TURN, SINGLE, URDF_TYPES, Body, Frame, Joint
from rbd.robots.building.solids import Drawn, MassProperties

_PLAIN = re.compile(r"(?!(?:null|true|false|~)$)[A-Za-z_][\w-]*", re.ASCII)
_ENTRIES = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}

Entry = Mapping[str, str | float | Sequence[float]]


def urdf_text(name: str, about: str, parts: Iterable[Body | Joint | Frame]) -> str:
    """The URDF of bodies, joints and frames, in this order, all numbers with all their digits."""
    parts = list(parts)
    used = dict.fromkeys(shape.color for part in parts if isinstance(part, Body) for shape in part.shapes)
    own = {color: f"own_{i}" for i, color in enumerate(color for color in used if color not in COLORS)}
    told = about.replace("--", "- -")
    out = ['<?xml version="1.0"?>\n', f"<!-- {escape(told)} -->\n" if told else "", f"<robot name={quoteattr(name)}>\n"]
    for color, rgba in (*COLORS.items(), *((mark, rgba) for rgba, mark in own.items())):
        out.append(f'  <material name="{color}"><color rgba="{rgba}"/></material>\n')
    for part in parts:
        if isinstance(part, Body):
            out.extend(_body(part, own))
        elif isinstance(part, Joint):
            out.extend(_joint(part))
        else:
            out.append(_frame(part))
    return "".join([*out, "</robot>\n"])


def _body(body: Body, own: Mapping[str, str]) -> Iterator[str]:
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


def _joint(joint: Joint) -> Iterator[str]:
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
