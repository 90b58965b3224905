"""Constraints as points: what each of a robot's constraints says of velocity at a state, one entry a point of contact.

A point has a set of impulses (a cone, a half-line, an interval, or all there are), rows J, the velocity of those rows, their
J_dot v, and a gap: how far it is from touching. What holds, and what rubs, has a gap of -infinity: it always acts. A sole is
its corners here, each with the ground's normal, so that it may tip.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from rbd.arrays import Array
from rbd.model.state import State
from rbd.problem.cones import Cone

ALWAYS = -np.inf
"""The gap of what always acts."""


@dataclass(frozen=True, eq=False)
class Structure:
    """The points of a source: what does not change with the state.

    Attributes:
        owners: Name of the constraint of each point.
        numbers: Number of each point among those of its constraint.
        cones: Set of each point's forces.
        widths: Number of rows of each point, shape (k,).
        normals: The row that has each point's normal, shape (k,); its last.
    """

    owners: tuple[str, ...]
    numbers: tuple[int, ...]
    cones: tuple[Cone, ...]
    widths: Array = field(init=False)
    normals: Array = field(init=False)

    def __post_init__(self) -> None:
        widths = np.array([c.dim for c in self.cones], int)
        object.__setattr__(self, "widths", widths)
        object.__setattr__(self, "normals", np.cumsum(widths) - 1)


@dataclass(frozen=True, eq=False)
class Measured:
    """A source at a state: k points with p rows in all.

    Attributes:
        structure: The points.
        J: Shape (p, nv).
        velocity: J v less the surface's velocity, shape (p,).
        bias: J_dot v less the surface's acceleration, shape (p,).
        gap: Shape (k,) [m, rad]; -inf of what always acts.
        error: Position errors of what holds, shape (p,); zero elsewhere.
        to_world: Takes the p row forces to the resultant on the robot in world axes, shape (r, p); None: row forces themselves,
            or the sum of the points' forces, with their moments where there are arms.
        arms: From its contact's centre to each point in W, shape (k, 3) [m]; None where the resultant is a force alone.
        points: Where the points are in W, shape (k, 3) [m]; None of what is no contact.
        axes: R_WC of the contact axes; (3, 3), or (k, 3, 3); None of what is no contact.
    """

    structure: Structure
    J: Array
    velocity: Array
    bias: Array
    gap: Array
    error: Array
    to_world: Array | None = None
    arms: Array | None = None
    points: Array | None = None
    axes: Array | None = None


class Source(Protocol):
    """What gives points at a state."""

    def at(self, state: State, t: float) -> Measured:
        """Its points at a state and a time [s]."""

    def gaps(self, state: State, t: float) -> Array:
        """How far they are from touching, shape (k,) [m, rad]: `at(state, t).gap` to rounding, and cheap where it can be."""
