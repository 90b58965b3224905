"""`WholeBodyController`: tasks, and contacts that come and go."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np

from rbd.arrays import Array, as_float, check_number
from rbd.constraints.constraint import Constraint, listed, made, member, with_loops
from rbd.control.contact_schedule import ContactSchedule, ContactWatch, SeenContacts, frames_of, lifts
from rbd.control.control_log import ControlLog, ControlStep
from rbd.control.motion_limits import Limits
from rbd.control.schedules import INSTANT, AcceptedStep, ExternalAt, asked, check_model, checked_period, sample_at
from rbd.control.step_problem import TaskActuation
from rbd.control.task_terms import Task, checked_tasks, robot_of
from rbd.control.tasks import FrameTask
from rbd.control.whole_body_step import DAMPING, complaints, silent_step
from rbd.displayed import Displayed
from rbd.errors import InputError, NoSolution
from rbd.errors.inputs import check_different, check_kind, check_known
from rbd.errors.warned import stacklevel_of_user
from rbd.model.checked_model import CheckedModel
from rbd.model.external import External
from rbd.model.state import State
from rbd.problem.ground import Body
from rbd.problem.rows import Rows

SLIPS = 1e-2
"""A contact that moves faster than this [m/s, rad/s] slips. One that sticks has the speed of a step's error."""
FULL = 12.0
"""Normal force that a contact may carry at the end of its fade, over the robot's mass [m/s2]: more than its weight."""


@dataclass(frozen=True, eq=False)
class Levelled:
    """A sole that does not touch with all its corners: the rows of its contact bring it onto its plane, critically damped.

    Attributes:
        contact: The contact.
        rate: At which velocities decay [1/s]; tilt and height by half of it, twice.
    """

    contact: Constraint
    rate: float

    @property
    def name(self) -> str:
        """The contact's."""
        return self.contact.name

    def rows(self, state: State) -> Rows:
        """Those of the contact, with feedback; as they are where they have their own, or do not fix an orientation."""
        rows = self.contact.rows(state)
        if rows.stabilised or len(rows) < 5 or rows.patch is None or rows.patch.on is None:
            return rows
        normal, axes, stiffness = np.asarray(rows.patch.on.normal, float), rows.patch.axes, (0.5 * self.rate) ** 2
        feedback = self.rate * rows.velocity
        feedback[3:-1] += stiffness * (axes.T @ np.cross(normal, axes[:, 2]))[6 - len(rows) : 2]  # an edge turns about its x
        feedback[:3] += stiffness * (axes.T @ normal) * rows.patch.on.distances(rows.patch.corners_W).mean()
        return replace(rows, feedback=feedback)


@lru_cache(maxsize=128)
def at_corners(contact: Any, corners: tuple[int, ...]) -> Constraint:
    """`Contact.of_corners`, the same contact each time: terms are kept by it."""
    found: Constraint = contact.of_corners(corners)
    return found


class _Memory:
    """What a controller remembers of one motion."""

    def __init__(self, controller: WholeBodyController) -> None:
        contacts = controller.contacts
        self.watch = ContactWatch(contacts, controller.schedule, float(controller.early))
        self.log = ControlLog([task.name for task in controller.tasks], [c.name for c in contacts])
        self.robot: CheckedModel | None = None
        self.sample: int | None = None
        self.actuation: TaskActuation | None = None
        self.tau: Array | None = None
        self.carried: dict[str, float] = {}
        self.said: set[type[Warning]] = set()


@dataclass(frozen=True, eq=False)
class WholeBodyController(Displayed):
    """Controller of `rbd.simulate` that meets tasks as well as limits allow, with the contacts that a schedule wants.

    At the beginning of a step it looks at what touches, and computes torques by `rbd.control.step`; they are held until the
    next. A contact is counted on from when it is wanted and touches, until it is not wanted or all are more
    than 0.5 mm away; late in a swing also before it is wanted, where a foot lands early. Its normal force rises from zero
    after it touches, and falls to zero before it is lifted (`ContactSchedule`), as far as others can carry the robot. A
    `FrameTask` of a frame whose contact is counted on is left out, but for the orientation of one that stands on a part of
    its corners, and a `ForceTask` of a contact that is not: so a foot's swing task can always be given, and one that lands
    late goes on with it; the foot that carries the robot alone until then is not lifted. A foot without such a task, that a
    push lifts off the ground, follows its posture until it touches.

    Where contacts, or limits of joints, cannot be kept, a step violates them least; that is counted in the log, and said once a
    motion. Torques and friction are always within their limits. Answers are certified for the contacts that are counted on;
    where others touch, or these slip, the log counts it, and a printed controller tells it.

    The controller remembers the contacts, the torques and the log of one motion; `rbd.simulate` resets it, so that a fresh one
    and one that was used give the same bits. Without `rbd.simulate`, tell it the beginning of each step: `accepted`.

    Attributes:
        tasks: What is wanted, each with its own name.
        contacts: Contacts, loops and other constraints, as given to `rbd.simulate`, which tells by their names what touches.
            What it is not told of, it measures: a contact touches with gaps of at most 0.1 mm, or where collision shapes of its
            body touch.
        schedule: When contacts are wanted; None: always.
        limits: Limits of torques, joint positions and velocities.
        every: Time between two steps of control [s]; None: every step of the simulation is one. Where a contact lands between
            two, one is taken at once: held torques that slow a foot down in the air would lift it again.
        contact_damping: k: velocities of contacts decay at this rate [1/s]; well below 1 over the time between two steps.
        early: After this share of a swing, a contact that touches has landed.
        robot: The model with which it computes, of the same joints; None: the robot that is simulated. With a nominal model a
            heavier robot, or one with other inertias, shows what the controller makes of its error.
        external: Forces that the torques take into account, as of `rbd.simulate`: springs and dampers, known pushes;
            or a function of state and time that gives them. None: the controller knows of none.
        loops: Whether the robot's own loops hold; one that is given counts once.

    Raises:
        InputError: no tasks, or what is no task; no list of constraints; a schedule that lifts all contacts at once without
            `flight=True`, or a contact that cannot be lifted; numbers out of range.
        DuplicateName: two tasks, or two contacts, of one name.
        UnknownName: a schedule, or a task, of a contact that is not there; a task of a frame or joint that is not there, if
            another task has a `State` as its target, else in the first step.

    Example:
        >>> talos = rbd.load_robot("talos")
        >>> stand, soles = talos.standing(), talos.soles(friction=0.7)
        >>> lower = rbd.control.ComTask(stand.com - [0.0, 0.0, 0.01], cost=100.0)
        >>> crouch = rbd.control.WholeBodyController([lower, rbd.control.PostureTask(stand.q)], soles)
        >>> crouch.accepted(rbd.control.AcceptedStep(stand, 0.0, 1e-3, {}))
        >>> motion = rbd.solve(stand, crouch(stand, 0.0), soles)  # what these torques do
        >>> bool(motion.a[2] < -0.1), bool(np.abs(motion.a - crouch.actuation.a).max() < 1e-9)
        (True, True)
    """

    tasks: Sequence[Task]
    contacts: Sequence[Constraint] = ()
    _: KW_ONLY
    schedule: ContactSchedule = None  # type: ignore[assignment]  # an empty one in its place
    limits: Limits = Limits()  # noqa: RUF009  a frozen record of settings
    every: float | None = None
    contact_damping: float = DAMPING
    early: float = 0.5
    external: External | ExternalAt = None
    robot: CheckedModel | None = None
    loops: bool = True
    _memory: list[_Memory] = field(init=False, repr=False, default_factory=list)

    def __post_init__(self) -> None:
        self.__dict__.update(
            tasks=checked_tasks(self.tasks),
            contacts=tuple(made(each) for each in listed(self.contacts)),
            schedule=ContactSchedule({}) if self.schedule is None else self.schedule,
        )
        checked_tasks(self.tasks, robot_of(self.tasks))
        if not self.tasks:
            raise InputError("tasks are empty: a controller without tasks wants nothing; give a PostureTask, at least.")
        _check_contacts(self.contacts, self.schedule, self.tasks)
        check_kind("limits", self.limits, Limits, "rbd.control.Limits(...)")
        if self.every is not None:
            object.__setattr__(self, "every", checked_period("every of WholeBodyController", self.every))
            self._check_horizon(self.every)
        check_number("contact_damping", self.contact_damping, 0.0, expected="a rate >= 0 [1/s]")
        if not 0.0 < as_float(self.early) <= 1.0:
            raise InputError(f"early is {self.early!r:.80}; expected a share of a swing, in (0, 1].")
        check_model("WholeBodyController", self.robot)
        self.reset()

    def reset(self) -> None:
        """Forget the motion until now, its log too."""
        self._memory[:] = [_Memory(self)]

    @property
    def log(self) -> ControlLog:
        """What it did since the start of the motion."""
        return self._memory[0].log

    @property
    def planned(self) -> ContactSchedule:
        """The schedule, or what `reschedule` put in its place."""
        return self._memory[0].watch.schedule

    def reschedule(self, schedule: ContactSchedule) -> None:
        """From the next step of control on, until a reset, contacts are wanted at other times.

        Raises:
            InputError: as of the class.
            UnknownName: as of the class.
        """
        _check_contacts(self.contacts, schedule, self.tasks)
        self._memory[0].watch.schedule = schedule

    @property
    def actuation(self) -> TaskActuation:
        """The last step of control: torques, forces, what each task missed.

        Raises:
            InputError: there was none yet.
        """
        found = self._memory[0].actuation
        if found is None:
            raise InputError("WholeBodyController has done no step yet; give it to rbd.simulate, or call `accepted`.")
        return found

    def accepted(self, step: AcceptedStep) -> None:
        """A step begins: compute the torques that are held, if a new step of control is due.

        Raises:
            InputError: a state of another robot than before.
            NoSolution: no torques were found, not even those that violate contacts and joint limits least.
        """
        check_kind("what WholeBodyController was told", step, AcceptedStep, "rbd.control.AcceptedStep(state, t, h, contacts)")
        memory, robot = self._memory[0], step.state.robot
        self._check_robot(step.state)
        if self.robot is not None:
            step = replace(step, state=step.state.on(self.robot))
        if self.every is not None:
            sample = sample_at(step.t, self.every)
            if sample == memory.sample and not memory.watch.lands(step):
                return
            memory.sample = sample
        self._check_horizon(step.h)
        memory.robot = robot
        seen = memory.watch.see(step)
        actuation = self._step(step, seen)
        least, most = self.limits.torque_bounds(step.state)
        memory.actuation, memory.tau = actuation, np.minimum(np.maximum(actuation.tau, least), most)  # beyond by rounding
        tips = {name for name, kind in seen.different if kind == "partial"}
        memory.log.motors = robot.actuated_names
        memory.log.add(
            ControlStep(
                step.t,
                actuation.certificate.worst,
                0.0 if actuation.violation is None else actuation.violation.worst,
                memory.tau,
                robot.torque_use(memory.tau, step.state.v),
                {name: math.sqrt(float(missed @ missed)) for name, missed in actuation.missed.items()},
                seen.planned,
                seen.touching,
                tuple(seen.since),
                seen.different + [(name, "slips") for name, v in actuation.moving.items() if v > SLIPS and name not in tips],
            )
        )

    def __call__(self, state: State, t: float) -> Array:
        """The torques that are held, shape (nu,) [N, N m].

        Raises:
            InputError: a state of another robot; or it was not told of a step.
        """
        tau = self._memory[0].tau
        if tau is None:
            raise InputError(
                "WholeBodyController was asked for torques before it was told of a step: give it to rbd.simulate, or call "
                "`accepted` at the beginning of each step."
            )
        self._check_robot(state)
        return tau

    def __str__(self) -> str:
        return f"WholeBodyController of {len(self.tasks)} tasks and {len(self.contacts)} contacts: {self.log}"

    def _check_robot(self, state: State) -> None:
        known = self._memory[0].robot
        check_kind("what WholeBodyController got", state, State, "a State")
        if known is not None and not known.is_like(state.robot):
            raise InputError(
                f"WholeBodyController was told of another robot, and got a state of {state.robot.name}; reset() it."
            )

    def _check_horizon(self, held: float) -> None:
        """Refuse torques that are held for longer than joint limits look ahead."""
        limits = self.limits
        if (limits.position or limits.velocity) and held > limits.horizon + INSTANT:
            raise InputError(
                f"torques are held for {held:g} s, longer than the horizon of limits, {limits.horizon:g} s: joints could pass "
                "their limits. Give every=, shorter steps, or limits=rbd.control.Limits(horizon=...)."
            )

    def _step(self, told: AcceptedStep, seen: SeenContacts) -> TaskActuation:
        """Torques for the contacts that are counted on."""
        own = with_loops(told.state.robot, self.contacts, self.loops)[len(self.contacts) :]
        whole: list[Any] = [c for c in self.contacts if c.name in seen.since]
        parts = {c.name: which for c in whole if (which := self.planned.part(c.name, told.t)) is not None}
        acting = [at_corners(c, parts[c.name]) if c.name in parts else c for c in whole]
        acting += [c for c in own if c.name not in told.inactive]
        frames, turning = frames_of(acting, seen.since), frames_of(acting, parts)
        tips = {name for name, kind in seen.different if kind == "partial"}
        acting = [Levelled(c, float(self.contact_damping)) if c.name in tips else c for c in acting]
        tasks = list[Task]()
        for task in self.tasks:
            if isinstance(task, FrameTask) and task.frame in turning:
                tasks.append(replace(task, position_cost=0.0))
            elif getattr(task, "frame", None) not in frames and getattr(task, "contact", "") in ("", *seen.since):
                tasks.append(task)
        full = FULL * told.state.robot.mass
        given = self.external
        known = asked("external of WholeBodyController", given, told.state, told.t) if callable(given) else given
        bounds = self._memory[0].watch.bounds(told, full, self._carried(told.t, seen))
        try:
            found = silent_step(
                told.state,
                tasks,
                acting,
                t=told.t,
                limits=self.limits,
                normal_force=bounds,
                contact_damping=float(self.contact_damping),
                external=known,
                loops=False,
            )
        except NoSolution as error:
            error.add_note(f"at t = {told.t:.6g} s, on {', '.join(seen.since) or 'no contact'}")
            raise
        said = self._memory[0].said
        for category, text in complaints(found):
            if category not in said:
                said.add(category)
                text += f" (At t = {told.t:.6g} s. Said once in a motion: `controller.log` has all steps.)"
                warnings.warn(text, category, stacklevel_of_user())
        return found

    def _carried(self, t: float, seen: SeenContacts) -> dict[str, float]:
        """{contact: its normal force when its fade out began [N]}, of those whose force falls."""
        memory, schedule = self._memory[0], self.planned
        falls = [name for name in seen.since if schedule.fade_out(name, t) < 1.0]
        before = memory.actuation
        for name in falls:
            if name not in memory.carried and before is not None and name in before.contacts:
                memory.carried[name] = max(0.0, before.contacts[name].normal)
        memory.carried = {name: force for name, force in memory.carried.items() if name in falls}
        return memory.carried


def _check_contacts(contacts: Sequence[Constraint], schedule: ContactSchedule, tasks: Sequence[Task]) -> None:
    """Refuse contacts of one name, names that are no contact, and a schedule that lifts what it cannot, or everything."""
    names = [contact.name for contact in contacts]
    check_different(names, "contacts")
    expected = "rbd.control.ContactSchedule({contact: [(start, end), ...]})"
    check_kind("schedule", schedule, ContactSchedule, expected)
    for name in schedule.intervals:
        check_known("the schedule names what is no contact of the controller,", name, names)
    for task in tasks:
        if force_of := getattr(task, "contact", ""):
            check_known(f"task {task.name!r:.80} is of a contact that is not there,", force_of, names)
    for contact in contacts:
        if contact.name in schedule.intervals and not lifts(contact):
            raise InputError(
                f"the schedule lifts {contact.name!r:.80}, which is bilateral and holds for ever; give the contact a "
                "coefficient of friction, or leave it out of the schedule."
            )
    feet = [c.name for c in contacts if hasattr(c, "friction") and not isinstance(member(c, "on"), Body)]
    lifted = None if schedule.flight else schedule.in_flight(feet)
    if lifted is not None:
        start, end = lifted
        raise InputError(
            f"the schedule lifts all contacts at once, from {start:g} to {end:g} s: {', '.join(feet)}. Expected one at least "
            "that is wanted at any time (the last intervals end with math.inf); a robot that jumps, or is held otherwise, has "
            "ContactSchedule(..., flight=True)."
        )
