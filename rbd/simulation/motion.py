"""What is simulated: a robot, its constraints, and what pushes it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeAlias

from rbd.arrays import Array, zeros
from rbd.constraints.constraint import Constraint
from rbd.constraints.stabilisation import Baumgarte
from rbd.control.schedules import Controller, ExternalAt, asked
from rbd.mechanism.projection import Projection
from rbd.model.checked_model import CheckedModel
from rbd.model.dynamics import free_force
from rbd.model.external_force import External
from rbd.model.state import State
from rbd.simulation.events import Sample

Stabilisation: TypeAlias = Projection | Baumgarte | None
"""How bilateral constraints are kept: by projection, by feedback, or not at all."""


@dataclass(frozen=True, eq=False)
class Motion:
    """A robot with all that makes it move.

    Attributes:
        robot: The robot.
        constraints: In order, each with its own name.
        controller: Gives the motor torques; None for none.
        external: Forces of the world: constant, or as a function of state and time.
        law: "coulomb" or "convex", of contacts that can slip.
        restitution: Newton's coefficient of each constraint that is named; 0 of the others.
        stabilisation: How bilateral constraints are kept.
        record_every: Every how many times a sample is recorded; of the others forces need not be known.
    """

    robot: CheckedModel
    constraints: tuple[Constraint, ...]
    controller: Controller | None = None
    external: External | ExternalAt = None
    law: str = "coulomb"
    restitution: Mapping[str, float] | None = None
    stabilisation: Stabilisation = None
    record_every: int = 1

    def recorded(self, k: int, times: Sequence[float]) -> bool:
        """Whether the k-th sample is recorded: every so many, and the last."""
        return k % self.record_every == 0 or k == len(times) - 1

    def forces(self, state: State, t: float) -> tuple[Array, Array]:
        """(tau (nu,), S^T tau + tau_ext - h (nv,)) at a state and a time.

        Raises:
            InputError: torques or forces of the wrong size, or not finite.
        """
        tau = zeros(self.robot.nu) if self.controller is None else asked("controller", self.controller, state, t)
        external = asked("external", self.external, state, t) if callable(self.external) else self.external
        tau = self.robot.check_tau(tau)
        return tau, free_force(state, tau, external)[0]


class Integrator(Protocol):
    """How a motion is carried from one time to the next."""

    def reason_unsupported(self, motion: Motion, state: State) -> str | None:
        """Why it cannot take this motion, in words; None where it can."""

    def run(self, motion: Motion, state: State, times: Sequence[float]) -> Iterator[Sample]:
        """One sample at each of the times, the first at `state`."""
