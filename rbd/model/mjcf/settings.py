"""Settings of an MJCF file that apply to all its elements: <compiler>, <option> and <flag>."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass

from rbd.model.mjcf.elements import check_attributes
from rbd.model.urdf import Complaints

Element = ElementTree.Element


@dataclass(frozen=True)
class Settings:
    """Of <compiler> and <option>; the defaults are MuJoCo's.

    Attributes:
        angle: What an angle in the file is multiplied by to be in radians.
        autolimits: Whether a range alone makes a limit.
        eulerseq: Axes of Euler angles, lower case where they turn with the body.
        inertiafromgeom: "auto", "true" or "false": whether shapes weigh where a body has an <inertial>.
        groups: Of the shapes that weigh, from and to.
        least_mass: Of every body [kg].
        least_moment: Lower bound of principal moments of inertia [kg m2].
        balance: Whether moments of inertia that are physically impossible are replaced by their mean.
        total_mass: What all masses are scaled to [kg]; None for none.
        fit_box: Whether shapes that are fitted to a mesh have the size of its box along the axes.
        mesh_folder: Where the files of meshes are.
        strip_path: Whether folders in the names of meshes are passed over.
        gravity: In W [m/s2].
        fluid: Whether the bodies move in a fluid.
        off: Flags that are switched off: "spring", "damper", "limit", ...
    """

    angle: float = math.pi / 180.0
    autolimits: bool = True
    eulerseq: str = "xyz"
    inertiafromgeom: str = "auto"
    groups: tuple[float, float] = (0.0, 5.0)
    least_mass: float = 0.0
    least_moment: float = 0.0
    balance: bool = False
    total_mass: float | None = None
    fit_box: bool = False
    mesh_folder: str = ""
    strip_path: bool = False
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)
    fluid: bool = False
    off: frozenset[str] = frozenset()


def read_settings(wrong: Complaints, root: Element) -> Settings:
    """The settings of a file; of repeated attributes the last one applies.

    Raises:
        ModelError: an attribute that is not read, or a value that is none.
    """
    compiler, option, flag = (_together(root, tag) for tag in ("compiler", "option", "option/flag"))
    for what, element in (("<compiler>", compiler), ("<option>", option), ("<flag>", flag)):
        check_attributes(wrong, what, element)
    words = {key: keyword(wrong, "<flag>", flag, key, "enable", ("enable", "disable")) for key in flag.keys()}
    off = frozenset(key for key, word in words.items() if word == "disable")
    angle = keyword(wrong, "<compiler>", compiler, "angle", "degree", ("degree", "radian"))
    sequence = compiler.get("eulerseq", "xyz")
    if len(sequence) != 3 or any(letter not in "xyzXYZ" for letter in sequence):
        wrong.stop(f"<compiler>: eulerseq is {sequence!r:.40}; expected three of the letters xyzXYZ.")
    if compiler.get("coordinate", "local") != "local":
        wrong.stop(f"<compiler>: coordinate is {compiler.get('coordinate')!r:.40}; only local coordinates are read.")
    if truth(wrong, "<compiler>", compiler, "alignfree"):
        wrong.stop("<compiler>: alignfree is true, which moves the frames of floating bodies; it is not read. Take it out.")
    total = numbers(wrong, "<compiler>", compiler, "settotalmass", 1, (-1.0,))[0]
    fused = truth(wrong, "<compiler>", compiler, "fusestatic")
    discards = truth(wrong, "<compiler>", compiler, "discardvisual")
    weighed_anew = compiler.get("inertiafromgeom") == "true"
    if fused and (weighed_anew or total > 0.0):
        other = "inertiafromgeom='true'" if weighed_anew else "settotalmass"
        wrong.stop(f"<compiler>: fusestatic with {other} weighs other bodies than it draws; not read. Take one out.")
    if discards and weighed_anew:
        wrong.stop("<compiler>: discardvisual with inertiafromgeom='true' may discard what weighs. Take one out.")
    if option.get("actuatorgroupdisable", "").strip():
        wrong.stop("<option>: actuatorgroupdisable switches motors off, and is not read. Take it out.")
    if "actuation" in off and root.find("actuator/*") is not None:
        wrong.stop("<flag>: actuation is disabled, so that no motor turns; it is not read. Take it or the <actuator> out.")
    groups = numbers(wrong, "<compiler>", compiler, "inertiagrouprange", 2, (0.0, 5.0))
    least = {key: numbers(wrong, "<compiler>", compiler, key, 1, (0.0,))[0] for key in ("boundmass", "boundinertia")}
    for key, value in least.items():
        if value < 0.0:
            wrong.stop(f"<compiler>: {key} is {value:g}; expected zero or more.")
    x, y, z = numbers(wrong, "<option>", option, "gravity", 3, Settings.gravity)
    fluid = [numbers(wrong, "<option>", option, key, 1, (0.0,))[0] for key in ("density", "viscosity")]
    return Settings(
        angle=1.0 if angle == "radian" else math.pi / 180.0,
        autolimits=truth(wrong, "<compiler>", compiler, "autolimits", True),
        eulerseq=sequence,
        inertiafromgeom=keyword(wrong, "<compiler>", compiler, "inertiafromgeom", "auto", ("auto", "true", "false")),
        groups=(groups[0], groups[1]),
        least_mass=least["boundmass"],
        least_moment=least["boundinertia"],
        balance=truth(wrong, "<compiler>", compiler, "balanceinertia"),
        total_mass=total if total > 0.0 else None,
        fit_box=truth(wrong, "<compiler>", compiler, "fitaabb"),
        mesh_folder=compiler.get("meshdir") or compiler.get("assetdir") or "",
        strip_path=truth(wrong, "<compiler>", compiler, "strippath"),
        gravity=(0.0, 0.0, 0.0) if "gravity" in off else (x, y, z),
        fluid=any(value != 0.0 for value in fluid),
        off=off | ({"limit", "frictionloss", "equality"} if "constraint" in off else set()),
    )


def _together(root: Element, path: str) -> Element:
    out = ElementTree.Element(path.split("/")[-1])
    for element in root.findall(path):
        out.attrib.update(element.attrib)
    return out


def keyword(wrong: Complaints, what: str, element: Element, key: str, default: str, known: tuple[str, ...]) -> str:
    """A value from a list.

    Raises:
        ModelError: another value.
    """
    word = element.get(key, default)
    if word not in known:
        wrong.stop(f"{what}: {key} is {word!r:.40}; expected one of {', '.join(known)}.")
    return word


def truth(wrong: Complaints, what: str, element: Element, key: str, default: bool = False) -> bool:
    """Whether an attribute is true.

    Raises:
        ModelError: neither true nor false.
    """
    return keyword(wrong, what, element, key, "true" if default else "false", ("true", "false")) == "true"


def numbers(
    wrong: Complaints, what: str, element: Element, key: str, count: int, default: tuple[float, ...], *, most: float = 1e12
) -> list[float]:
    """Finite numbers, so many of them.

    Raises:
        ModelError: other text.
    """
    if element.get(key) is None:
        return list(default)
    found = wrong.numbers(what, element, key, count=count, most=most)
    wrong.refuse()
    return found


def limited(
    wrong: Complaints, what: str, element: Element, settings: Settings, key: str, range_key: str
) -> tuple[float, float] | None:
    """The range of an active limit, as given in the file; None if there is none.

    Raises:
        ModelError: a range that is none.
    """
    low, high = numbers(wrong, what, element, range_key, 2, (0.0, 0.0), most=1e308)
    word = keyword(wrong, what, element, key, "auto", ("auto", "true", "false"))
    if low > high or (word == "true" and low == high):
        wrong.stop(f"{what} has its limits swapped, or none between them: {range_key} is {low:g} to {high:g}.")
    if word == "auto" and not settings.autolimits and element.get(range_key) is not None:
        wrong.stop(f"{what} has {range_key} but not {key}, and <compiler> has autolimits='false'; expected {key}.")
    return None if word == "false" or low == high else (low, high)
