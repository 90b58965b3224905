"""What a controller with memory is told: the start of a motion, and of every step that is taken."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from rbd.arrays import Array
from rbd.model.state import State


@dataclass(frozen=True, eq=False)
class ContactTouch:
    """Which points of a constraint touch at the beginning of a step, and what they carried in the step before.

    Attributes:
        gaps: Distance of each point from contact, shape (k,) [m]; negative where it is below the surface.
        touches: Which of them are in contact, shape (k,), of truth values.
        forces: On the robot at each point in the step before, world axes, shape (k, 3) [N]; zero in the first.
    """

    gaps: Array
    touches: Array
    forces: Array


@dataclass(frozen=True, eq=False)
class AcceptedStep:
    """The beginning of a step that is taken: state, time, and what touches.

    Attributes:
        state: The robot at (q, v).
        t: Time [s].
        h: Length of the step [s].
        contacts: {contact: its points}: of all that was given to `rbd.simulate` and has points.
    """

    state: State
    t: float
    h: float
    contacts: Mapping[str, ContactTouch]


@runtime_checkable
class SteppedController(Protocol):
    """A controller with memory: `rbd.simulate` tells it the beginning of every step that is taken, once and in order of time.

    Trial steps that are rejected are not told. Torques are asked as of every controller, by calling it with a state and a time,
    as often as an integrator wants them: what is asked must not change what is remembered.
    """

    def reset(self) -> None:
        """Forget everything: a motion starts. A fresh controller and one that was used before then give the same bits."""

    def accepted(self, step: AcceptedStep) -> None:
        """A step begins: torques that are held are computed here."""

    def __call__(self, state: State, t: float) -> Array:
        """Torques at a state and a time, shape (nu,) [N, N m]."""
