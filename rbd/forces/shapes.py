"""Where a force element is and how it is loaded, for drawings."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np

from rbd.arrays import Array
from rbd.displayed import Displayed

ElementKind: TypeAlias = Literal["spring", "damper", "torsion", "bushing"]
"""How an element is drawn: a coil, a cylinder with a rod, a spiral about an axis, or a sleeve."""


@dataclass(frozen=True, eq=False)
class ElementShape(Displayed):
    """A force element at one state, as drawings need it; `element.shapes(state)` gives a tuple of them.

    Attributes:
        kind: "spring", "damper", "torsion" or "bushing".
        start: One end in W, shape (3,) [m]; of a torsional element, and of a bushing, its centre.
        end: The other end in W, shape (3,) [m]; of a torsional element, its centre again.
        axis: Of a torsional element, its axis in W, shape (3,), of length one; else zero.
        tension: Force [N] or torque [N m] of the element, positive if it pulls its ends together, or turns against a positive
            angle about `axis`; zero for a relaxed one.
        angle: Of a torsional element, its angle from rest [rad].

    Example:
        >>> spring = rbd.forces.ElementShape("spring", np.zeros(3), np.array([0.0, 0.0, 0.5]), tension=12.0)
        >>> float(np.linalg.norm(spring.end - spring.start))
        0.5
    """

    kind: ElementKind
    start: Array
    end: Array
    axis: Array = field(default_factory=lambda: np.zeros(3))
    tension: float = 0.0
    angle: float = 0.0
