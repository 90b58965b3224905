"""Springs, dampers and external forces among the marks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from rbd.arrays import Array
from rbd.model.external import External, ExternalForce, ForceElement, acting, elements_of, generalised
from rbd.model.state import State
from rbd.records import joined
from rbd.visual import shapes
from rbd.visual.marks.mark import WEIGHTLESS_N, Label, Mark, Sizes, number, numbers
from rbd.visual.marks.shown_force import ShownForce
from rbd.visual.shapes import Mesh, axes_along
from rbd.visual.style import PUSH_COLOR, hexadecimal, rgb

PULLS, PUSHES, RELAXED = "#d55e00", "#0072b2", "#6b7280"
"""Colours of an element that pulls its ends together, of one that pushes them apart, and of a relaxed one."""
SPIRAL_TURNS = 3.0
STRAIGHT = 0.12
"""Share of a coil's length that is straight, at each end."""
LAYER = "force elements"
FULL = 0.5
"""Force, over the robot's weight, from which an element has its full colour."""
_SHAPES = {
    "spring": "coil",
    "damper": "cylinder",
    "torsion spring": "spiral",
    "torsion damper": "drum",
    "joint spring": "spiral",
    "joint damping": "drum",
    "bushing": "bushing",
}


@dataclass(frozen=True, eq=False, slots=True)
class ShownElement:
    """A force element at one state.

    Attributes:
        name: Its name.
        shape: "coil", "cylinder", "spiral", "drum" or "bushing".
        points: Its ends in W, shape (2, 3) [m].
        axis: Of a spiral or a drum, in W, shape (3,), of length one.
        value: Force [N] or moment [N m], positive where it pushes its ends apart or turns the second end forward; None if
            there are several.
        unit: "N" or "N m".
    """

    name: str
    shape: str
    points: Array
    axis: Array
    value: float | None
    unit: str

    @property
    def tension(self) -> float:
        """How much it pulls: minus the value; zero where there are several."""
        return 0.0 if self.value is None else -self.value

    @property
    def size(self) -> str:
        """Its force, in words."""
        return "" if self.value is None else f"{number(abs(self.value))} {self.unit}"

    @property
    def detail(self) -> str:
        """What it does, in words."""
        if self.value is None or abs(self.value) < 1e-9:
            return self.kind
        if self.unit == "N m":
            return f"{self.kind}, turns {'forward' if self.value > 0.0 else 'back'}"
        return f"{self.kind}, {'pushes' if self.value > 0.0 else 'pulls'}"

    @property
    def kind(self) -> str:
        """What it is, in a word."""
        return {"coil": "spring", "cylinder": "damper", "spiral": "torsional", "drum": "torsional damper"}.get(
            self.shape, self.shape
        )


def shown_elements(state: State, external: Any) -> tuple[list[ShownElement], list[str]]:
    """(the force elements that have a place in the picture, which have none, in words).

    Args:
        state: The robot.
        external: What `rbd.solve` takes.

    Raises:
        InputError: where an element has no force at this state, e.g. at zero length.
    """
    found = [(element.name, shown_element(state, element)) for element in elements_of(external)]
    unshown = [name for name, shown in found if shown is None]
    words = [f"Not drawn: force elements that act at no one place ({joined(unshown)})."] if unshown else []
    return [shown for _, shown in found if shown is not None], words


def shown_element(state: State, element: ForceElement) -> ShownElement | None:
    """A force element at a state; None if it has no method `picture`."""
    picture = getattr(element, "picture", None)
    given: Any = picture(state) if callable(picture) else None
    shape = _SHAPES.get(getattr(given, "kind", ""))
    if shape is None:
        return None
    joint = getattr(element, "joint", None)
    slides = joint is not None and given.axis is not None and state.robot.joints[joint].unit == "m"
    turns = shape in TURNED and not slides
    if slides:
        shape = "coil" if shape == "spiral" else "cylinder"
    axis = np.array([0.0, 0.0, float(turns)]) if given.axis is None else np.asarray(given.axis, float)
    unit = "N m" if turns else "N"
    return ShownElement(element.name, shape, np.asarray(given.points, float), axis, given.value, unit)


def color_of(element: ShownElement, sizes: Sizes) -> str:
    """Its colour, from grey to that of pulling or pushing."""
    share = min(1.0, abs(element.tension) / full_of(element.unit, sizes)) ** 0.5
    end = PULLS if element.tension > 0.0 else PUSHES
    return hexadecimal((1.0 - share) * a + share * b for a, b in zip(rgb(RELAXED), rgb(end), strict=True))


def full_of(unit: str, sizes: Sizes) -> float:
    """The force [N] or moment [N m] from which an element has its full colour."""
    force = FULL * (sizes.weight_N or WEIGHTLESS_N)
    return force if unit == "N" else 0.1 * sizes.body * force


def element_marks(place: int, element: ShownElement, sizes: Sizes) -> list[Mark]:
    """The marks of a force element at one place."""
    color, path = color_of(element, sizes), f"force_elements/{place}"
    start, end = ends_of(element, sizes)
    lines = (element.size, element.detail, f"from {numbers(start)} to {numbers(end)} m")
    label = Label(element.name, tuple(line for line in lines if line), 0.5 * (start + end), tag=False)
    along, marks = end - start, list[Mark]()
    origin, axes = (end, axes_along(element.axis)) if element.shape in TURNED else (start, axes_along(along))
    pieces = element_pieces(element.shape, float(np.linalg.norm(along)), sizes)
    for i, opacity in enumerate(dict.fromkeys(piece.opacity for piece in pieces)):
        own = [piece.placed(float(np.linalg.norm(along))) for piece in pieces if piece.opacity == opacity]
        mesh = shapes.joined(own).placed(axes, origin)
        marks.append(Mark(f"{path}/{i}", mesh, color, opacity, seen_through=opacity == 1.0, layer=LAYER, label=label))
    return marks


def ends_of(element: ShownElement, sizes: Sizes) -> Array:
    """The ends in W, shape (2, 3) [m]; of what is in a sliding joint, where both are one, a little apart."""
    start, end = element.points
    if element.shape in ("coil", "cylinder") and not np.linalg.norm(end - start) > 1e-9 and element.axis.any():
        half = 0.06 * sizes.body * element.axis
        start, end = start - half, end + half
    return np.array([start, end])


TURNED = ("spiral", "drum")
"""Shapes that lie about an axis at the second end; the others go from the first end to the second."""


@dataclass(frozen=True, eq=False, slots=True)
class ElementPiece:
    """A piece of a force element in the element's own axes, z from its first end to its second: scenes and motions place it.

    Attributes:
        mesh: Triangles [m]; of a piece that is stretched z goes from 0 to 1.
        start: Where along z it begins [m]; None: at the second end.
        stretched: Whether it reaches from there to the second end.
        opacity: 1 is solid.
    """

    mesh: Mesh
    start: float | None = 0.0
    stretched: bool = False
    opacity: float = 1.0

    def placed(self, length: float) -> Mesh:
        """The piece of an element of this length [m]."""
        low = length if self.start is None else self.start
        size = length - low if self.stretched else 1.0
        return Mesh(self.mesh.vertices * [1.0, 1.0, size] + [0.0, 0.0, low], self.mesh.faces)


def element_pieces(shape: str, length: float, sizes: Sizes) -> list[ElementPiece]:
    """The pieces of a force element whose ends are so far apart [m]: drawn once, for a state and for the frames of a motion."""
    wire, big = 0.0045 * sizes.body, 0.05 * sizes.body
    r = max(0.022 * sizes.body, 0.014 * min(length, 2.0 * sizes.body))
    rod = shapes.revolved([(0.0, 0.0), (wire, 0.0), (wire, 1.0), (0.0, 1.0)], segments=10)
    if shape == "coil":
        long = max(length, 1e-3 * sizes.body)
        mesh = shapes.tube(coil(long, min(r, 0.5 * long + wire), turns_of(long, r)), wire)
        return [ElementPiece(Mesh(mesh.vertices / [1.0, 1.0, long], mesh.faces), stretched=True)]
    if shape == "cylinder":
        body, thin = 0.4 * length, rod.scaled([1.0, 1.0, 0.15 * length])
        middle = 0.15 * length + 0.5 * body
        return [ElementPiece(shapes.cylinder(0.8 * r, body), middle), ElementPiece(thin), ElementPiece(rod, middle, True)]
    if shape == "bushing":
        ends = [ElementPiece(shapes.ball(1.3 * r), opacity=0.35), ElementPiece(shapes.ball(0.6 * r), None)]
        return [*ends, ElementPiece(rod, stretched=True)]
    mesh = shapes.cylinder(0.6 * big, 0.5 * big) if shape == "drum" else shapes.tube(spiral(big), wire)
    return [ElementPiece(mesh)]


def turns_of(length: float, radius: float) -> int:
    """How many turns a coil of this length and radius [m] has."""
    return int(np.clip(round(length / (3.5 * radius)), 5, 30))


def coil(length: float, radius: float, turns: int) -> Array:
    """Points of a coil along z from the origin, shape (n, 3) [m]: straight at both ends, on the axis there."""
    angle = np.linspace(0.0, 2.0 * np.pi * turns, 16 * turns + 1)
    z = length * np.linspace(STRAIGHT, 1.0 - STRAIGHT, len(angle))
    inner = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), z])
    ends = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, length * STRAIGHT]])
    return np.concatenate([ends, inner, [[0.0, 0.0, length * (1.0 - STRAIGHT)], [0.0, 0.0, length]]])


def spiral(radius: float) -> Array:
    """Points of a flat spiral about z, shape (n, 3) [m], from the centre outwards."""
    angle = np.linspace(0.0, 2.0 * np.pi * SPIRAL_TURNS, int(24 * SPIRAL_TURNS) + 1)
    r = radius * (0.12 + 0.88 * angle / angle[-1])
    return np.column_stack([r * np.cos(angle), r * np.sin(angle), np.zeros(len(angle))])


def pushes(state: State, external: External) -> tuple[list[ShownForce], list[str]]:
    """The external forces that have a place in the picture, and what is left out of it, in words.

    Args:
        state: The robot.
        external: What `rbd.solve` takes.

    Raises:
        InputError: it is something else.
    """
    force, given, _ = acting(external)
    shown, tau = [_shown(i, state, push) for i, push in enumerate(given)], generalised(state, cast(External, force))[0]
    if not tau.any():
        return shown, []
    most = int(np.abs(tau).argmax())
    where = state.robot.joints.velocities[most].name
    return shown, [
        "The generalised external force is not drawn: it has no point of application. "
        f"Its largest entry is {number(float(tau[most]))} at {where}."
    ]


def _shown(i: int, state: State, push: ExternalForce) -> ShownForce:
    point = np.array(state.frame(push.frame, push.offset).X_WF.translation)
    force, moment = np.asarray(push.force, float), np.asarray(push.moment, float)
    detail = f"{numbers(force)} N" + (f", moment {numbers(moment)} N m" if moment.any() else "")
    return ShownForce(f"pushes/{i}", f"push on {push.frame}", force, point, moment, detail, "pushes", PUSH_COLOR)
