"""`SimulatedMotion`, what is simulated; `Sample`, the motion at one time; `Event`, what happens in between."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, Protocol, TypeAlias, cast

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, filled, lazy, zeros
from rbd.constraints.constraint import Constraint, is_timed, member
from rbd.constraints.stabilisation import Baumgarte
from rbd.constraints.terrain.terrain import Terrain, moving_planes_of, terrains_of
from rbd.control.schedules import (
    AcceptedStep,
    ContactTouch,
    Controller,
    ExternalAt,
    TouchesWhenRead,
    asked,
    hook,
    sample_period,
    told,
)
from rbd.displayed import Displayed
from rbd.errors import InputError, NoSolution
from rbd.mechanism.projection import Projection
from rbd.model.checked_model import CheckedModel
from rbd.model.external import External, ExternalForce, ForceElement, elements_of, generalised, has_pushes, is_element
from rbd.model.state import State, state_at
from rbd.problem.ground import Ground
from rbd.simulation.events import EventSearch, StateEvent

OPEN, STICKS, SLIPS, HOLDS, PUSHES = "open", "sticks", "slips", "holds", "pushes"
"""Modes of a constraint: no force; at rest; sliding; bilateral; a joint limit or a frictionless contact that pushes."""

Stabilisation: TypeAlias = Projection | Baumgarte | None
"""Stabilisation of bilateral constraints: by projection, by feedback, or not at all."""


Acting: TypeAlias = tuple[Array, Array, tuple[ForceElement, ...], Array | None]
"""What acts on a robot besides constraints: motor torques (nu,), S^T tau + tau_ext (nv,), the force elements in it, and its
part that is neither of motors nor of known elements (nv,), None if there is none. A plain tuple, which is made twice a step."""


@dataclass(frozen=True, eq=False)
class SimulatedMotion:
    """A robot with its constraints, controller, forces and contact law: the input of an integrator.

    Attributes:
        robot: The robot.
        constraints: In order, each with a different name.
        controller: Gives the motor torques; None for none.
        external: External forces: constant, or as a function of state and time.
        law: "coulomb" or "convex", of contacts that can slip.
        restitution: Newton's coefficient of each named constraint; 0 for the others.
        stabilisation: Stabilisation of bilateral constraints.
        record_every: A sample is recorded every so many times; the others need no forces.
        search: The search for events of the user; None without any.
        before: Number of the sample times that were before this part of the motion: it begins at an event; None for the first
            part, which begins at a sample time.
        plastic: Speed below which impacts at a switch are plastic [m/s, rad/s].
        inactive: Names of constraints that do not act in this part of the motion.
    """

    robot: CheckedModel
    constraints: tuple[Constraint, ...]
    controller: Controller | None = None
    external: External | ExternalAt = None
    law: str = "coulomb"
    restitution: Mapping[str, float] | None = None
    stabilisation: Stabilisation = None
    record_every: int = 1
    search: EventSearch | None = None
    before: int | None = None
    plastic: float = 0.0
    inactive: frozenset[str] = frozenset()
    _given: list[tuple[ForceElement, ...]] = field(default_factory=list)
    _pushes: list[bool] = field(default_factory=list)

    @property
    def elements(self) -> tuple[ForceElement, ...]:
        """The force elements that act; of a function of time those that it has given, if they were the same each time."""
        known = self._given[0] if len(self._given) == 1 else ()
        return known if callable(self.external) else elements_of(self.external)

    @property
    def terrains(self) -> tuple[Terrain, ...]:
        """The terrains that its contacts are on, and the planes that move."""
        return terrains_of(self.constraints) + moving_planes_of(self.constraints)

    @property
    def driven(self) -> dict[str, str]:
        """{constraint: the joint whose motion it gives as a function of time}."""
        return {c.name: str(joint) for c in self.constraints if is_timed(c) and (joint := member(c, "prescribes"))}

    @property
    def friction(self) -> dict[str, float]:
        """{contact: Coulomb's coefficient}, of those that have one."""
        given = {c.name: member(c, "friction") for c in self.constraints}
        return {name: float(mu) for name, mu in given.items() if isinstance(mu, int | float)}

    @property
    def planes(self) -> dict[str, Ground]:
        """{contact: the plane that it touches}, of those whose plane is known and stays where it is; its surface may run."""
        given = {c.name: member(c, "plane") for c in self.constraints}
        return {name: plane for name, plane in given.items() if isinstance(plane, Ground) and plane.stays}

    @property
    def pushed(self) -> bool:
        """Whether forces acted that are none of elements; of a function of time, whether it has given any."""
        return bool(self._pushes) if callable(self.external) else has_pushes(self.external)

    @lazy
    def _pushes_alone(self) -> External:
        """The constant external forces without force elements; None if there are none."""
        given = cast(External, self.external)  # it is constant where this is asked
        if not has_pushes(given):
            return None
        found = elements_of(given)
        return [each for each in cast(Sequence[ExternalForce], given) if not is_element(each)] if found else given

    @lazy
    def names(self) -> tuple[str, ...]:
        """Names of its constraints."""
        return tuple([c.name for c in self.constraints])

    @lazy
    def hook(self) -> Callable[[AcceptedStep], None] | None:
        """`accepted` of the controller; None if it has none."""
        return hook(self.controller, "accepted")

    @lazy
    def sample_period(self) -> float | None:
        """Times at multiples of which the controller computes torques [s]; None for any."""
        return sample_period(self.controller)

    @lazy
    def may_have_elements(self) -> bool:
        """Whether force elements act, or may: those of a function of time are not known before."""
        return callable(self.external) or bool(elements_of(self.external))

    def work(self, tau: Array, q: Array, q_end: Array) -> float:
        """Work of constant motor torques from one configuration to another, near it [J].

        Args:
            tau: Shape (nu,) [N, N m].
            q: Shape (nq,).
            q_end: Shape (nq,).
        """
        places = self._motor_places
        moved = (q_end - q)[places] if places is not None else pin.difference(self.robot.model, q, q_end)[self.robot.motors]
        return float(tau.dot(moved))

    @lazy
    def _motor_places(self) -> Array | None:
        """Places in q of the joints with motors, shape (nu,); None if one of them has several numbers."""
        model, robot = self.robot.model, self.robot
        place = {model.joints[j].idx_v: model.joints[j].idx_q for j in range(1, model.njoints) if model.nqs[j] == 1}
        motors = np.arange(robot.nv)[robot.motors].tolist()
        return np.array([place[i] for i in motors], int) if all(i in place for i in motors) else None

    @lazy
    def timed(self) -> tuple[Constraint, ...]:
        """Its constraints that depend on time."""
        return tuple([c for c in self.constraints if is_timed(c)])

    def refuse_jumps(self, since: float, t: float) -> None:
        """Refuse a step in which a prescribed motion jumps.

        Raises:
            InputError: one does, with its time.
        """
        for constraint in self.timed:
            if (at := member(constraint, "jump")(since, t)) is not None:
                raise InputError(
                    f"the motion of {constraint.name!r:.80} jumps at t = {at:.6g} s, in position or velocity: that is an "
                    "impact, and no finite force drives it. Give one whose velocity is continuous, e.g. a spline, or a ramp in "
                    "place of the jump."
                )

    def start(self) -> None:
        """Tell the controller that a motion starts."""
        reset = hook(self.controller, "reset")
        if reset is not None:
            told(self.controller, reset)

    def watch(self, state: State, t: float) -> None:
        """Begin the search for events of the user at a state and a time [s]; nothing without any."""
        if self.search:
            self.search.begin(state, t, self.names)

    def tell(self, state: State, t: float, h: float, touches: Callable[[], Mapping[str, ContactTouch]]) -> None:
        """Tell the controller that a step begins, if it wants to know.

        Args:
            state: The robot at the beginning of the step.
            t: Its time [s].
            h: Its length [s].
            touches: Gives what touches; called when the controller reads it.
        """
        if self.hook is not None:
            told(self.controller, self.hook, AcceptedStep(state, t, h, TouchesWhenRead(touches), self.inactive), t=t)

    def recorded(self, k: int, times: Sequence[float]) -> bool:
        """Whether the k-th sample is recorded: every so many, the last, and one at an event."""
        if self.before is not None:
            k, times = k + self.before - 1, [0.0] * (len(times) + self.before - 1)
        return k % self.record_every == 0 or k == len(times) - 1

    def reached(self, q: Array, v: Array, t: float) -> State:
        """The state at the end of a step.

        Raises:
            NoSolution: it is beyond the bounds of a `State`.
        """
        try:
            return state_at(self.robot, q, v, t)
        except InputError as error:
            raise NoSolution(
                f"the motion of {self.robot.name} has grown beyond bounds at t = {t:.6g} s: {error} Give a smaller step, and "
                "check what drives it."
            ) from error

    def acting(self, state: State, t: float) -> Acting:
        """Torques, forces and force elements at a state and a time; the controller and `external` are called once.

        Raises:
            InputError: torques or forces of the wrong size, or not finite.
        """
        robot, external = self.robot, self.external
        if callable(external):
            external = asked("external", external, state, t)
        applied = np.zeros(robot.nv) if external is None else generalised(state, external)[0]
        elements = () if external is None else elements_of(external)
        pushes = None
        if callable(self.external):  # the elements too: they may be others in each step
            pushes = applied.copy()
        elif self._pushes_alone is not None:
            pushes = generalised(state, self._pushes_alone)[0] if elements else applied.copy()
        if external is not self.external:
            if len(self._given) < 2:
                self._note(elements)
            if not self._pushes and has_pushes(external):
                self._pushes.append(True)
        if self.controller is None:
            return zeros(robot.nu), applied, elements, pushes
        given = asked("controller", self.controller, state, t)
        if given is None:
            raise InputError(f"the controller gave None at t = {t:.6g} s; expected torques, shape (nu,). Does it return them?")
        tau = robot.check_tau(given)
        applied[robot.motors] += tau
        return tau, applied, elements, pushes

    def _note(self, elements: tuple[ForceElement, ...]) -> None:
        """Keep the elements that a function of time gives, the first ones and the first that differ: the same or another."""
        known = self._given[0] if self._given else None
        if known is None or len(known) != len(elements) or any(a is not b for a, b in zip(known, elements, strict=True)):
            self._given.append(elements)


@dataclass(frozen=True, eq=False)
class ConstraintForce:
    """Force and mode of one constraint at one time.

    Attributes:
        force: Force (3,) of a point, wrench (6,) of a surface at its centre: on the robot, world axes [N, N m]. A constraint
            without a resultant (a function, a joint) gives its row forces (m,); zeros where it is inactive.
        mode: "open", "sticks", "slips", "holds" or "pushes"; for several points, that of one that slips, else of one
            that is closed.
        points: Contact points in W, shape (k, 3) [m]; None if it is not a contact.
        point_forces: The force at each point, on the robot, world axes, shape (k, 3) [N]; None if it is not a contact.
    """

    force: Array
    mode: str
    points: Array | None = None
    point_forces: Array | None = None


@dataclass(frozen=True)
class Event(Displayed):
    """An event of a simulated motion: a contact begins, ends, slips or sticks, or an event of yours happens.

    Attributes:
        t: Time [s].
        name: Name of the constraint, or of the `StateEvent`.
        kind: "touches" (with an impact, or softly), "leaves", "slips" or "sticks"; of a `StateEvent` "rises through zero" or
            "falls through zero".
        point: Index of its point, from 0; -1 where the event is of no single point.
        speed: For a touch, the approach speed [m/s, rad/s]; else zero.
        impulse: For a touch, normal impulse of the impact [N s, N m s]; else zero.
        piece: Name of the piece of terrain that the point is on; empty where it is not on terrain.

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> corner = rbd.PointContact("corner", "box", friction=0.6, on=0.0)
        >>> fall = rbd.simulate(rbd.State(box, [0, 0, 0.05, 0, 0, 0, 1]), [corner], duration=0.2, step=1e-2)
        >>> for event in fall.events:
        ...     print(event.name, event.kind, f"at {event.t:.3f} s with {event.speed:.2f} m/s, {event.impulse:.2f} N s")
        corner touches at 0.101 s with 0.99 m/s, 9.90 N s
    """

    t: float
    name: str
    kind: str
    point: int = 0
    speed: float = 0.0
    impulse: float = 0.0
    piece: str = ""

    def __str__(self) -> str:
        impact = f" at {self.speed:.3g} m/s, impulse {self.impulse:.3g} N s" if self.speed else ""
        where = f"{f'[{self.point}]' if self.point >= 0 else ''}{f' on {self.piece}' if self.piece else ''}"
        return f"{self.t:.6f} s: {self.name}{where} {self.kind}{impact}"


class AtEvents(NamedTuple):
    """What a sample at events of the user says of them.

    Attributes:
        interrupts: Those that end the motion or may change it; the sample is then the last of an integrator's run.
        recorded: Whether it is a sample of the trajectory; else another one is at this time.
    """

    interrupts: tuple[StateEvent, ...]
    recorded: bool


@dataclass(frozen=True, eq=False, repr=False)
class Sample(Displayed):
    """A motion at one time: yielded by integrators, and an entry of a `Trajectory`.

    Attributes:
        robot: The robot.
        t: Time [s].
        q: Configuration, shape (nq,).
        v: Velocity, shape (nv,) [m/s, rad/s].
        a: Acceleration, shape (nv,) [m/s2, rad/s2]: M a + h = S^T tau + tau_ext + J^T f, with f the constraints' forces.
        tau: Motor torques, shape (nu,) [N, N m].
        constraint_forces: Function that gives {constraint: its force}; expensive, so called only for recorded samples.
        law: Residual of the contact law, scaled.
        drift: Largest position error of the bilateral constraints [m, rad].
        drift_rate: Largest velocity error of the bilateral constraints [m/s, rad/s].
        penetration: Depth of the deepest contact [m, rad]; zero or more.
        events: Events since the sample before, in order of time.
        motor_work: Work of the motors since the start of the motion [J].
        elastic: Energy stored in force elements, e.g. springs [J].
        dissipated: Work that force elements, e.g. dampers, have taken out of the motion since its start [J].
        other_work: Work since the start of the motion of all that is neither motor nor known force element [J]: pushes,
            friction, impacts, moving ground, switches; the elements that a function of time gives. NaN: not known, as in the
            samples of a `Trajectory`.
        found: What it says of events of the user; None of a sample at a sample time.
    """

    robot: CheckedModel
    t: float
    q: Array
    v: Array
    a: Array
    tau: Array
    constraint_forces: Callable[[], Mapping[str, ConstraintForce]]
    law: float = 0.0
    drift: float = 0.0
    drift_rate: float = 0.0
    penetration: float = 0.0
    events: tuple[Event, ...] = ()
    motor_work: float = 0.0
    elastic: float = 0.0
    dissipated: float = 0.0
    other_work: float = math.nan
    found: AtEvents | None = None

    @classmethod
    def of(
        cls, t: float, state: State, a: Array, tau: Array, forces: Callable[[], Mapping[str, ConstraintForce]], **more: Any
    ) -> Sample:
        """The sample at a state; `forces` are the `constraint_forces`, and `more` the attributes after them."""
        return filled(
            cls, t=t, a=a, tau=tau, state=state, robot=state.robot, q=state.q, v=state.v, constraint_forces=forces, **more
        )

    def but(self, **changed: Any) -> Sample:
        """The same with other attributes, at the same state."""
        out = replace(self, **changed)
        out.__dict__["state"] = self.state
        return out

    def __repr__(self) -> str:
        return f"Sample({self.robot.name!r}, t={self.t:g})"

    @lazy
    def state(self) -> State:
        """The robot at (q, v) and t."""
        return State(self.robot, self.q, self.v, t=self.t)

    @property
    def forces(self) -> dict[str, Array]:
        """{constraint: force on the robot}, as `Trajectory.forces`."""
        return {name: x.force for name, x in self._acting.items()}

    @property
    def points(self) -> dict[str, Array]:
        """{contact: its present points, shape (k, 3)} in W [m]."""
        return {name: x.points for name, x in self._acting.items() if x.points is not None}

    @property
    def point_forces(self) -> dict[str, Array]:
        """{contact: force at each of these points, shape (k, 3)} in W [N]."""
        return {name: x.point_forces for name, x in self._acting.items() if x.point_forces is not None}

    @property
    def modes(self) -> dict[str, str]:
        """{constraint: "open", "sticks", "slips", "holds" or "pushes"}."""
        return {name: x.mode for name, x in self._acting.items()}

    @lazy
    def _acting(self) -> Mapping[str, ConstraintForce]:
        return self.constraint_forces()


def stored(elements: Sequence[ForceElement], state: State) -> float:
    """Energy stored in force elements at a state [J]."""
    return sum([element.energy(state) for element in elements])


def dissipation(elements: Sequence[ForceElement], state: State) -> float:
    """Power that force elements take out of the motion at a state [W]."""
    return sum([element.dissipation(state) for element in elements])


class Integrator(Protocol):
    """Protocol of the integrators; one that looks for events of the user has an attribute `finds_events`, True."""

    def reason_unsupported(self, motion: SimulatedMotion, state: State) -> str | None:
        """Message: why it cannot take this motion; None if it can."""

    def run(self, motion: SimulatedMotion, state: State, times: Sequence[float]) -> Iterator[Sample]:
        """One sample at each of the times, the first at `state`."""
