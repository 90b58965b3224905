"""Tasks of momentum, and of the force of a contact: over the robot's mass, so that their costs compare with others."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import Any

import numpy as np

from rbd.arrays import Array, as_array, identity, lazy
from rbd.control.task_terms import (
    Cost,
    FollowingTask,
    Reference,
    Target,
    TaskTerms,
    as_reference,
    checked_costs,
    checked_name,
    checked_rates,
    checked_vector,
    reference_at,
    target_of,
)
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.model.state import State, checked


@dataclass(frozen=True, eq=False)
class MomentumTask(FollowingTask):
    """The momentum about the centre of mass follows a target: its error e decays as e' + k e = 0.

    Linear and angular momentum, in world axes; a target of zero damps a robot's rotation. Its rows A = A_g / m are the
    centroidal momentum matrix [Orin2013] over the mass, for the rate of momentum A_g a + A_g_dot v.

    Attributes:
        target: Shape (6,) [N s, N m s], None for zero; a `Reference` with its rate as `velocity` [N, N m]; or a function of
            t [s].
        linear_cost: One of all axes, or one each, shape (3,), of (m/s2)^2: of forces over the mass.
        angular_cost: The same, of moments over the mass.
        gain: k [1/s].
        name: Its name among the tasks.

    Raises:
        InputError: a target of another shape, one with an acceleration, negative or infinite costs and gains.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> turning = solo.standing().with_velocity(0.1 * np.eye(solo.nv)[5])  # about the vertical, in the air
        >>> calm = rbd.control.MomentumTask(gain=10.0).terms(turning, 0.0)
        >>> A_g, bias, mass = turning.centroidal()
        >>> rate = mass * (calm.wanted + bias[3:] / mass)
        >>> print(np.abs(rate + 10.0 * (A_g @ turning.v)[3:]).max() < 1e-12)
        True
    """

    target: Target = None
    _: KW_ONLY
    linear_cost: Cost = 0.0
    angular_cost: Cost = 1.0
    gain: float = 10.0
    name: str = "momentum"

    def __post_init__(self) -> None:
        self._settle(linear_cost=3, angular_cost=3)

    def _reference(self, target: Any, t: float | None) -> Reference:
        ref = as_reference(target)
        if ref.acceleration is not None:
            raise InputError(f"{target_of(self.name, t)} has an acceleration; expected a momentum, and its rate as `velocity`.")
        value = np.zeros(6) if ref.value is None else checked_vector(ref.value, 6, "", t, self.name)
        return Reference(value, checked_rates(ref, 6, t, self.name)[0])

    @lazy
    def _cost(self) -> Array:
        return np.concatenate([np.asarray(self.linear_cost), np.asarray(self.angular_cost)])

    def terms(self, state: State, t: float) -> TaskTerms:
        """Six rows at a state and a time [s]: the rate of momentum over the mass; those of cost zero are left out.

        Raises:
            InputError: what a function gives as the target is none.
        """
        ref = self._at(t)
        A_g, bias, mass = checked(state).centroidal()
        wanted = ref.velocity + self.gain * (ref.value - A_g @ state.v) - bias
        return TaskTerms.unchecked(self.name, A_g / mass, wanted / mass, self._cost)


@dataclass(frozen=True, eq=False)
class ForceTask(Displayed):
    """The force of a contact, or its wrench, is as wanted where the contacts allow it.

    On the robot, in world axes, the moment about the contact's point. Its rows A = 1 / m make costs compare with those
    of accelerations: 1 m/s2 of the whole robot for m newtons.

    Attributes:
        contact: Name of the contact.
        target: A force, shape (3,) [N], or of a contact with an extent a wrench, shape (6,) [N, N m]; or a function of t [s].
        cost: One of all axes, or one each, shape (3,) or (6,), of (m/s2)^2.
        name: Its name among the tasks.

    Raises:
        InputError: a target of another shape, one with a velocity, negative or infinite costs.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> state, feet = solo.standing(), solo.feet(friction=0.7)
        >>> light = rbd.control.ForceTask("front_left", [0.0, 0.0, 2.0], cost=[0.0, 0.0, 1e4])
        >>> motors = rbd.control.step(state, [rbd.control.PostureTask(state), light], feet)
        >>> print(round(float(motors.forces["front_left"][2]), 2))
        2.0
    """

    contact: str
    target: Target
    _: KW_ONLY
    cost: Cost = 1.0
    name: str = ""

    def __post_init__(self) -> None:
        if not isinstance(self.contact, str) or not self.contact:
            raise InputError(f"contact of a force task is {self.contact!r:.80}; expected the name of a contact.")
        object.__setattr__(self, "name", checked_name(self.name, f"force of {self.contact}"))
        said = f"cost of task {self.name!r:.80}"
        if (found := as_array(said, self.cost)).shape not in ((), (3,), (6,)):
            raise InputError(f"{said} has shape {found.shape}; expected one number, (3,) for a force or (6,) for a wrench.")
        costs = checked_costs(said, found, found.size)
        object.__setattr__(self, "cost", costs if found.ndim else float(costs[0]))
        if not callable(self.target):
            wanted = self._wanted(self.target, None)
            checked_costs(said, self.cost, len(wanted))
            object.__setattr__(self, "target", wanted)

    def _wanted(self, target: Any, t: float | None) -> Array:
        ref = as_reference(target)
        if ref.velocity is not None or ref.acceleration is not None:
            raise InputError(f"{target_of(self.name, t)} has a velocity; a force or a wrench is wanted as it is.")
        found = as_array(target_of(self.name, t), ref.value)
        if found.shape not in ((3,), (6,)):
            raise InputError(f"{target_of(self.name, t)} has shape {found.shape}; expected a force (3,) or a wrench (6,).")
        return checked_vector(found, found.size, "", t, self.name)

    def terms(self, state: State, t: float) -> TaskTerms:
        """Three or six rows at a state and a time [s]: force, or wrench, over the mass; those of cost zero are left out.

        Raises:
            InputError: what a function gives as the target is none.
        """
        target: Any = self.target
        wanted = self._wanted(reference_at(self.name, target, t), t) if callable(target) else target
        m, mass = len(wanted), checked(state).robot.mass
        costs = checked_costs(f"cost of task {self.name!r:.80}", self.cost, m)
        return TaskTerms.unchecked(self.name, identity(m) / mass, wanted / mass, costs, self.contact)
