"""The loops of an MJCF file: its <equality> element, read and checked; Pinocchio's model of the file leaves them out.

<connect> and <weld> close loops, <joint> couples two joints or locks one. Others, inactive ones, and
polynomials above the first degree are reported, by name, as left out. Softness (solref, solimp) is not read: loops are rigid.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from typing import Literal

from rbd.errors import nearest
from rbd.model.urdf import FARTHEST, LARGEST, LONGEST_NAME, Complaints

WORLD = "world"
_NO_TURN = (0.0, 0.0, 0.0, 0.0)
_KINDS = ("connect", "weld", "joint")


@dataclass(frozen=True)
class Equality:
    """One equality constraint; bodies, sites and joints by name, as MuJoCo understands them.

    Attributes:
        name: Its name, or one made from its kind and ends.
        kind: "connect", "weld" or "joint".
        ends: The two bodies or sites; of a joint equality the joint that follows and, if any, the one it follows.
        sites: Whether the ends are sites.
        anchor: Of a connect in the first body, of a weld in the second [m].
        pose: Where a weld wants the anchor in the first body [m], and the second body's turn against the first, as a quaternion
            w, x, y, z; None for those of the bodies as the file draws them.
        polynomial: (constant, slope) of a joint equality, about the file's reference angles.
    """

    name: str
    kind: Literal["connect", "weld", "joint"]
    ends: tuple[str, ...]
    sites: bool = False
    anchor: tuple[float, ...] = (0.0, 0.0, 0.0)
    pose: tuple[float, ...] | None = None
    polynomial: tuple[float, float] = (0.0, 1.0)


def read_equalities(
    file: str, root: ElementTree.Element, *, off: bool = False
) -> tuple[tuple[Equality, ...], tuple[tuple[str, str, str], ...]]:
    """(equalities read, (kind, where, text) of those left out).

    Args:
        file: Its name, for messages.
        root: Its first element.
        off: Whether the file switches all of them off.

    Raises:
        ModelError: an equality between unknown objects, or with invalid numbers.
    """
    wrong = Complaints(file)
    names = {tag: {e.get("name", "") for e in root.iterfind(f"worldbody//{tag}")} - {""} for tag in ("body", "site", "joint")}
    names["body"].add(WORLD)
    inactive = _inactive(root)
    found: dict[str, Equality] = {}
    lost: list[tuple[str, str, str]] = []
    for element in root.findall("equality/*"):
        tag, name = element.tag, element.get("name") or _made_name(element)
        active = "false" if off else element.get("active", "false" if element.get("class", "") in inactive else "true")
        if reason := _left_out(wrong, name, element, active=active):
            lost.append(("equality", name, reason))
            continue
        while name in found and not element.get("name"):
            name += "'"
        if name in found:
            wrong.add(f"two equalities are called {name!r:.80}; expected different names.")
        if len(name) > LONGEST_NAME:
            wrong.stop(f"an equality has a name of {len(name)} letters; expected {LONGEST_NAME} at most.")
        found[name] = _joint(wrong, name, element, names) if tag == "joint" else _closure(wrong, name, element, names)
    wrong.refuse()
    return tuple(found.values()), tuple(lost)


def _left_out(wrong: Complaints, name: str, element: ElementTree.Element, *, active: str) -> str:
    """Why an equality is not read; empty if it is."""
    if element.tag not in _KINDS:
        return f"is a <{element.tag:.40}>; only {', '.join(f'<{kind}>' for kind in _KINDS)} are read"
    if active != "true":
        return "is not active in the file"
    if element.tag == "joint" and any(_polynomial(wrong, name, element)[2:]):
        return "has a polynomial above the first degree; give an rbd.FunctionConstraint"
    return ""


def _polynomial(wrong: Complaints, name: str, element: ElementTree.Element) -> list[float]:
    """Its coefficients, up to five; those that are not given are 0 and 1, then 0."""
    text = element.get("polycoef")
    if text is None:
        return [0.0, 1.0]
    count = min(max(len(text.split()), 1), 5)
    given = wrong.numbers(f"<joint> equality {name!r:.80}", element, "polycoef", count=count, most=LARGEST)
    wrong.refuse()
    return [*given, *(0.0, 1.0)[len(given) :]]


def _made_name(element: ElementTree.Element) -> str:
    ends = [element.get(f"{what}{i}") for what in ("body", "site", "joint") for i in (1, 2)]
    return "_".join([element.tag, *(end[:40] for end in ends if end)])


def _closure(wrong: Complaints, name: str, element: ElementTree.Element, names: dict[str, set[str]]) -> Equality:
    what = f"<{element.tag}> {name!r:.80}"
    tag = "site" if element.get("site1") is not None or element.get("site2") is not None else "body"
    one = _named(wrong, what, f"{tag}1", element.get(f"{tag}1"), names[tag])
    other = element.get(f"{tag}2") if tag == "site" else element.get("body2", WORLD)
    other = _named(wrong, what, f"{tag}2", other, names[tag])
    if one == other:
        wrong.add(f"{what} ties {one!r:.80} to itself; expected two {'bodies' if tag == 'body' else 'sites'}.")
    if tag == "site":
        return Equality(name, element.tag, (one, other), sites=True)  # type: ignore[arg-type]
    default = None if element.tag == "connect" else 0.0
    anchor = tuple(wrong.numbers(what, element, "anchor", count=3, default=default, most=FARTHEST))
    if element.tag == "connect":
        return Equality(name, "connect", (one, other), anchor=anchor)
    pose = (0.0, 1.0, *(0.0,) * 5)
    if element.get("relpose") is not None:
        pose = tuple(wrong.numbers(what, element, "relpose", count=7, most=FARTHEST))  # type: ignore[assignment]
    turned = pose[3:] != _NO_TURN
    if turned and sum(x * x for x in pose[3:]) < 1e-12:
        wrong.add(f"{what} has a relpose whose quaternion is {list(pose[3:])}; expected one that is not nearly zero.")
    return Equality(name, "weld", (one, other), anchor=anchor, pose=pose if turned else None)


def _joint(wrong: Complaints, name: str, element: ElementTree.Element, names: dict[str, set[str]]) -> Equality:
    what = f"<joint> equality {name!r:.80}"
    ends = [_named(wrong, what, "joint1", element.get("joint1"), names["joint"])]
    if (other := element.get("joint2")) is not None:
        ends.append(_named(wrong, what, "joint2", other, names["joint"]))
    if len(set(ends)) < len(ends):
        wrong.add(f"{what} ties {ends[0]!r:.80} to itself; expected two joints.")
    constant, slope = _polynomial(wrong, name, element)[:2]
    return Equality(name, "joint", tuple(ends), polynomial=(constant, slope))


def _named(wrong: Complaints, what: str, key: str, name: str | None, known: set[str]) -> str:
    if name is None:
        wrong.add(f"{what} has no {key}.")
    elif name not in known:
        wrong.add(f"{what} has {key} {name!r:.80}, which is not in the file; {nearest(name, sorted(known))}.")
    return name or ""


def _inactive(root: ElementTree.Element) -> set[str]:
    """Default classes whose equalities are inactive by default; "" for those without a class."""
    off: set[str] = set()
    for top in root.findall("default"):
        level = [(top, False, True)]
        while level:
            element, inherited, outermost = level.pop()
            own = [e.get("active") for e in element.findall("equality")]
            inactive = own[-1] != "true" if own and own[-1] is not None else inherited
            if inactive:
                off |= {element.get("class", "main")} | ({""} if outermost else set())
            level += [(child, inactive, False) for child in element.findall("default")]
    return off
