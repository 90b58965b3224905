"""Tasks of a whole-body controller: accelerations and forces that are wanted, each with a cost.

A task is m rows A a (or A f, of a contact's force), what they are wanted to be, and a cost each:

    minimise 1/2 sum_i cost_i (A_i x - wanted_i)^2

A task of motion wants its error e to decay as a damped oscillator: e'' + 2 zeta sqrt(k) e' + k e = 0, with k its gain and zeta
its damping ratio. Momenta and forces are divided by the robot's mass, so that costs compare: of 1 m/s2, whatever it is of.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Any, NamedTuple, Protocol, TypeAlias

import numpy as np
import pinocchio as pin

from rbd.arrays import Array
from rbd.model.state import State


class Reference(NamedTuple):
    """What a task follows at one time: a value, its velocity and its acceleration; zero where they are not given."""

    value: Any
    velocity: Any = None
    acceleration: Any = None


Target: TypeAlias = Any | Reference | Callable[[float], Any]
"""A value, a `Reference`, or a function of time that gives one of them."""
Cost: TypeAlias = float | Sequence[float] | Array


@dataclass(frozen=True, eq=False)
class TaskTerms:
    """A task at one state and time.

    Attributes:
        name: Name of the task.
        A: Shape (m, nv), of accelerations; or of a contact's force, shape (m, 3), or wrench at its centre, shape (m, 6), in
            world axes.
        wanted: Shape (m,).
        cost: Shape (m,).
        contact: The contact whose force it is of; empty for accelerations.
    """

    name: str
    A: Array
    wanted: Array
    cost: Array
    contact: str = ""


class Task(Protocol):
    """What `step` and `WholeBodyController` take."""

    @property
    def name(self) -> str:
        """Its name, among the tasks that are given together."""

    def terms(self, state: State, t: float) -> TaskTerms:
        """Its rows at a state and a time [s]."""


def reference(target: Target, t: float) -> Reference:
    """A target at a time."""
    value = target(t) if callable(target) else target
    return value if isinstance(value, Reference) else Reference(value)


def _costs(cost: Cost, m: int) -> Array:
    return np.array(np.broadcast_to(np.asarray(cost, float), (m,)))


def _or_zero(given: Any, m: int) -> Array:
    return np.zeros(m) if given is None else np.asarray(given, float)


@dataclass(frozen=True, eq=False)
class ComTask:
    """The centre of mass follows a target, in world axes [m]."""

    target: Target
    _: KW_ONLY
    cost: Cost = 1.0
    gain: float = 100.0
    damping_ratio: float = 1.0
    name: str = "com"

    def terms(self, state: State, t: float) -> TaskTerms:
        """Three rows: the acceleration of the centre of mass."""
        ref = reference(self.target, t)
        Ag, bias, mass = state.centroidal()
        J = Ag[:3] / mass
        e, de = np.asarray(ref.value) - state.com, _or_zero(ref.velocity, 3) - J @ state.v
        wanted = _or_zero(ref.acceleration, 3) + self.gain * e + 2.0 * self.damping_ratio * np.sqrt(self.gain) * de
        return TaskTerms(self.name, J, wanted - bias[:3] / mass, _costs(self.cost, 3))


@dataclass(frozen=True, eq=False)
class FrameTask:
    """A frame of the robot follows a pose, pin.SE3, or a position (3,): its origin in W, and its orientation."""

    frame: str
    target: Target
    _: KW_ONLY
    position_cost: Cost = 1.0
    orientation_cost: Cost = 1.0
    gain: float = 100.0
    damping_ratio: float = 1.0
    name: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "name", self.name or self.frame)

    def terms(self, state: State, t: float) -> TaskTerms:
        """Six rows: the acceleration of the frame's origin, and its angular acceleration, in world axes."""
        ref = reference(self.target, t)
        seen = state.frame(self.frame)
        X = ref.value if isinstance(ref.value, pin.SE3) else pin.SE3(seen.X_WF.rotation, np.asarray(ref.value))
        e = np.concatenate([X.translation - seen.X_WF.translation, pin.log3(X.rotation @ seen.X_WF.rotation.T)])
        de = _or_zero(ref.velocity, 6) - seen.v
        wanted = _or_zero(ref.acceleration, 6) + self.gain * e + 2.0 * self.damping_ratio * np.sqrt(self.gain) * de
        cost = np.concatenate([_costs(self.position_cost, 3), _costs(self.orientation_cost, 3)])
        return TaskTerms(self.name, seen.J, wanted - seen.bias, cost)


@dataclass(frozen=True, eq=False)
class PostureTask:
    """The joints with motors follow a configuration q."""

    target: Target
    _: KW_ONLY
    cost: Cost | Mapping[str, float] = 1.0
    gain: float = 100.0
    damping_ratio: float = 1.0
    name: str = "posture"

    def terms(self, state: State, t: float) -> TaskTerms:
        """One row a motor: the acceleration of its joint."""
        robot = state.robot
        ref = reference(self.target, t)
        e = pin.difference(robot.model, state.q, np.asarray(ref.value))[robot.actuated]
        de = _or_zero(ref.velocity, robot.nv)[robot.actuated] - state.v[robot.actuated]
        a = _or_zero(ref.acceleration, robot.nv)[robot.actuated]
        wanted = a + self.gain * e + 2.0 * self.damping_ratio * np.sqrt(self.gain) * de
        if isinstance(self.cost, Mapping):
            cost = np.array([float(self.cost.get(name, 1.0)) for name in robot.actuated_names])
        else:
            cost = _costs(self.cost, robot.nu)
        return TaskTerms(self.name, np.eye(robot.nv)[robot.actuated], wanted, cost)


@dataclass(frozen=True, eq=False)
class MomentumTask:
    """The momentum about the centre of mass, linear then angular, follows a target [N s, N m s]."""

    target: Target = None
    _: KW_ONLY
    linear_cost: Cost = 0.0
    angular_cost: Cost = 1.0
    gain: float = 10.0
    name: str = "momentum"

    def terms(self, state: State, t: float) -> TaskTerms:
        """Six rows: the rate of momentum over the mass."""
        ref = reference(self.target, t)
        Ag, bias, mass = state.centroidal()
        wanted = _or_zero(ref.velocity, 6) + self.gain * (_or_zero(ref.value, 6) - Ag @ state.v)
        cost = np.concatenate([_costs(self.linear_cost, 3), _costs(self.angular_cost, 3)])
        return TaskTerms(self.name, Ag / mass, (wanted - bias) / mass, cost)


@dataclass(frozen=True, eq=False)
class ForceTask:
    """A contact's force (3,), or wrench (6,) at its centre, follows a target: on the robot, world axes [N, N m]."""

    contact: str
    target: Target
    _: KW_ONLY
    cost: Cost = 1.0
    name: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "name", self.name or f"force of {self.contact}")

    def terms(self, state: State, t: float) -> TaskTerms:
        """Three or six rows: the force, or wrench, over the mass."""
        wanted = np.asarray(reference(self.target, t).value, float)
        mass, m = state.robot.mass, len(wanted)
        return TaskTerms(self.name, np.eye(m) / mass, wanted / mass, _costs(self.cost, m), self.contact)
