"""What a picture of one state shows: contacts, loops, torques, pushes, surfaces, support polygon; and what it leaves out."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from rbd.arrays import Array
from rbd.model.state import State
from rbd.visual.marks.arrows import SMALLEST_ARC, is_cut, moment_angle
from rbd.visual.marks.contacts import ShownForce, contact_marks, shown_forces
from rbd.visual.marks.external_forces import ShownPush, push_marks, pushes
from rbd.visual.marks.force_elements import ShownElement, element_marks, only_pushes, shown_elements
from rbd.visual.marks.joints import ShownTorque, constraint_torque_marks, motor_torques, torque_marks
from rbd.visual.marks.mark import Mark, Sizes
from rbd.visual.marks.others import LOOP_COLOR, Others, constraints_of, loop_marks, others_of, points_mark
from rbd.visual.marks.support import DOWN, com_marks, ground_under, not_supporting, support_marks, support_outline
from rbd.visual.marks.surfaces import ShownSurface, surface_marks, surfaces_of

if TYPE_CHECKING:
    from rbd.answers.solution import Solution
    from rbd.statics.actuation import Actuation


@dataclass(frozen=True, eq=False)
class Picture:
    """What a picture of one state shows.

    Attributes:
        com: Centre of mass in W, shape (3,) [m].
        contacts: Forces of the contacts.
        others: Of the constraints without a patch.
        torques: Of the motors.
        pushes: External forces.
        elements: Springs, dampers and other force elements.
        surfaces: Planes that the contacts touch, other than the floor.
        outline: Corners of the support polygon, each on the plane of its contact, shape (k, 3) [m].
        unshown: What of the external forces and constraints has no picture, in words.
        gravity: In W, shape (3,) [m/s2].
    """

    com: Array
    contacts: tuple[ShownForce, ...] = ()
    others: Others = field(default_factory=Others)
    torques: tuple[ShownTorque, ...] = ()
    pushes: tuple[ShownPush, ...] = ()
    surfaces: tuple[ShownSurface, ...] = ()
    outline: Array = field(default_factory=lambda: np.zeros((0, 3)))
    unshown: tuple[str, ...] = ()
    gravity: Array = field(default_factory=DOWN.copy)
    elements: tuple[ShownElement, ...] = ()

    @classmethod
    def of(cls, state: State, solution: Solution | Actuation | None, external: object) -> Picture:
        """The picture of a state, its solution, and the external forces that were given.

        Without these, the force elements are those that the solution was made with.

        Raises:
            InputError: if `external` is not what `rbd.solve` takes.
        """
        pushed, unshown = pushes(state, only_pushes(external))
        elements, words = shown_elements(state, known_external(solution) if external is None else external)
        unshown += words
        com, gravity = np.asarray(state.com, float), state.robot.gravity
        if solution is None:
            return cls(com, pushes=tuple(pushed), unshown=tuple(unshown), gravity=gravity, elements=tuple(elements))
        contacts = tuple(shown_forces(solution))
        given = constraints_of(solution)
        keeper: Any = getattr(solution, "problem", solution)
        others = others_of(state, keeper.rows, solution.forces, given)
        return cls(
            com,
            contacts,
            others,
            tuple(motor_torques(state, solution)),
            tuple(pushed),
            tuple(surfaces_of(contacts, given)),
            support_outline(contacts),
            (*unshown, *others.left_out),
            gravity,
            tuple(elements),
        )

    @property
    def colored(self) -> tuple[str, ...]:
        """Names of the constraints with a colour of their own."""
        return (*(c.name for c in self.contacts), *(p.name for p in self.others.points))

    def marks(self, colors: Mapping[str, str], sizes: Sizes, without: Collection[str] = ()) -> list[Mark]:
        """All marks, in the order in which they are drawn.

        Args:
            colors: {constraint: '#rrggbb'} of `colored`.
            sizes: Of the marks.
            without: Layers to leave out.
        """
        drawn: list[Mark] = []
        for i, surface in enumerate(self.surfaces):
            drawn += surface_marks(i, surface, sizes)
        drawn += com_marks(self.com, sizes, ground_under(self.com, self.contacts), self.gravity)
        drawn += support_marks(self.outline, sizes)
        for contact in self.contacts:
            drawn += contact_marks(contact, colors[contact.name], sizes)
        drawn += [points_mark(points, colors[points.name], sizes) for points in self.others.points]
        for loop in self.others.loops:
            drawn += loop_marks(loop, LOOP_COLOR, sizes)
        drawn += constraint_torque_marks(self.others.torques, sizes)
        drawn += torque_marks(() if "joint torques" in without else self.torques, sizes)
        for i, push in enumerate(self.pushes):
            drawn += push_marks(i, push, sizes)
        for i, element in enumerate(self.elements):
            drawn += element_marks(i, element, sizes)
        return [mark for mark in drawn if len(mark.mesh.faces) and mark.layer not in without]

    def has_moments(self, sizes: Sizes) -> bool:
        """Whether an arc of a moment is drawn."""
        return any(abs(moment_angle(size, sizes)) >= SMALLEST_ARC for _, size in self._moments())

    @property
    def largest_moment(self) -> float:
        """Of contacts, loops, pushes and stops [N m]."""
        return max((size for _, size in self._moments()), default=0.0)

    def left_out(self, sizes: Sizes) -> list[str]:
        """What the picture does not show, or not in full, in words."""
        forces = [(c.name, c.force) for c in self.contacts] + [(loop.name, loop.force) for loop in self.others.loops]
        forces += [(f"push on {push.name}", push.force) for push in self.pushes]
        cut = [name for name, force in forces if is_cut(force, sizes)]
        cut += [name for name, size in self._moments() if size > sizes.full_moment]
        words = [*self.unshown, *not_supporting(self.contacts)]
        if cut:
            words.append(f"Double arrowhead: not drawn to full length ({', '.join(dict.fromkeys(cut))}).")
        return words

    def _moments(self) -> list[tuple[str, float]]:
        """(name, size [N m]) of every moment."""
        given = [(c.name, c.moment) for c in self.contacts] + [(loop.name, loop.moment) for loop in self.others.loops]
        given += [(f"push on {push.name}", push.moment) for push in self.pushes]
        sizes = [(name, float(np.linalg.norm(moment))) for name, moment in given]
        return sizes + [(t.by, abs(t.value)) for t in self.others.torques if not t.slides]


def known_external(answer: object) -> Any:
    """The external forces that a solution or an actuation was made with; None where they are not known."""
    if hasattr(answer, "external"):
        return answer.external
    return getattr(getattr(getattr(answer, "problem", None), "origin", None), "external", None)
