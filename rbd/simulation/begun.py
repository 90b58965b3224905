"""A step that has begun: its first half, or a step that was taken, and what it says of points in another layout."""

from __future__ import annotations

from dataclasses import dataclass, replace

from rbd.arrays import Array
from rbd.simulation.contact_points import Carry, Layout, Snapshot
from rbd.simulation.velocity_problem import VelocityAnswer


@dataclass(frozen=True, eq=False)
class Begun:
    """The first half of a step, or a whole step, with what was solved in it.

    Attributes:
        at: The contact points where the step begins.
        active: Which of them are in contact.
        tau: Motor torques, where a controller was asked for them.
        answer: Velocity and impulses.
        h: Length of the step [s].
        u: The points' velocities at its beginning.
    """

    at: Snapshot
    active: Array
    tau: Array | None
    answer: VelocityAnswer
    h: float
    u: Array

    def seen_in(self, layout: Layout) -> Seen:
        """What is known of the points, in another layout."""
        if layout is self.at.layout:
            return Seen(self.active, self.u, self.at.error, self.answer)
        carry = Carry(self.at.layout, layout)
        answer = replace(self.answer, impulse=carry.rows(self.answer.impulse), velocity=carry.rows(self.answer.velocity))
        return Seen(carry.points(self.active, False), carry.rows(self.u), carry.rows(self.at.error), answer)


@dataclass(frozen=True, eq=False)
class Seen:
    """Points at a step's beginning: which act, how they move, how far they are off, what came of it."""

    active: Array
    velocity: Array
    error: Array
    answer: VelocityAnswer
