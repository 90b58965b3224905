"""Controllers, torque schedules and pushes: torques and forces over time, and what a controller with memory is told."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from typing import Any, Protocol, TypeAlias, runtime_checkable

import numpy as np

from rbd.arrays import ABOVE_ZERO, Array, as_array, as_finite, check_flag, check_number, lazy
from rbd.displayed import Displayed
from rbd.errors import InputError, nearest
from rbd.errors.inputs import check_kind, listed_items
from rbd.model.checked_model import CheckedModel
from rbd.model.external import External, ExternalForce
from rbd.model.state import State

INSTANT = 1e-9
"""Times nearer than this [s] are the same: sums of steps are off by rounding, and a step that begins where a push ends must be
free of it."""


@dataclass(frozen=True, eq=False)
class ContactTouch(Displayed):
    """Which points of a constraint are in contact at the beginning of a step, and what they carried in the step before.

    Attributes:
        gaps: Distance of each point from contact, shape (k,) [m]; negative where it is below the surface, -inf where the
            constraint is bilateral.
        touches: Which of them are in contact, shape (k,), of truth values; bilateral constraints always are.
        forces: On the robot at each point in the step before, world axes, shape (k, 3) [N]; zero in the first.
        names: What each point is called: that of a collision shape begins with its link. Empty where points are corners.

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> face = rbd.SurfaceContact("face", "box", half_lengths=(0.2, 0.2), friction=0.5, on=0.0)
        >>> class Seen:
        ...     def accepted(self, step):
        ...         self.last = step.contacts["face"]
        ...     def __call__(self, state, t):
        ...         return np.zeros(0)
        >>> seen = Seen()
        >>> motion = rbd.simulate(rbd.State(box, [0, 0, 0, 0, 0, 0, 1]), [face], duration=0.02, step=0.01, controller=seen)
        >>> seen.last.touches, seen.last.forces[:, 2].round(3)
        (array([ True,  True,  True,  True]), array([24.525, 24.525, 24.525, 24.525]))
    """

    gaps: Array
    touches: Array
    forces: Array
    names: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class AcceptedStep(Displayed):
    """The beginning of a step that is taken: state, time, and what touches.

    The end of a motion is told too, as if a step began there: its torques are recorded.

    Attributes:
        state: The robot at (q, v).
        t: Time [s].
        h: Length of the step [s]; of `DormandPrince8` the longest that it may have. At the end of a motion that of the last.
        contacts: {contact: its points}: of all constraints of the motion that have contact points; computed when it is read.
        inactive: Names of constraints of the motion that do not act now: switched off by an event, or not yet on.

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> class Clock:
        ...     def reset(self):
        ...         self.times = []
        ...     def accepted(self, step):
        ...         self.times.append(round(step.t, 9))
        ...     def __call__(self, state, t):
        ...         return np.zeros(0)
        >>> clock = Clock()
        >>> fall = rbd.simulate(rbd.State(box, [0, 0, 1, 0, 0, 0, 1]), duration=0.3, step=0.1, controller=clock)
        >>> clock.times  # once a step and at the end, however often torques are asked for
        [0.0, 0.1, 0.2, 0.3]
    """

    state: State
    t: float
    h: float
    contacts: Mapping[str, ContactTouch]
    inactive: frozenset[str] = frozenset()


@runtime_checkable
class SteppedController(Protocol):
    """A controller with memory: `rbd.simulate` tells it the start of a motion, and the beginning of every step that is taken.

    Each of the two methods may be left out. Steps are told once each and in order of time; trials that an integrator rejects,
    stages within a step and the parts into which impacts divide it are not told. Torques are asked for as of every controller,
    by calling it with a state and a time, as often as an integrator wants: a call must not change what is remembered.

    A controller that computes torques at times of its own may have an attribute `every` [s], or None: `DormandPrince8` then
    ends a step at each of its multiples. Steps of fixed length begin there if `every` is a multiple of the step.

    Example:
        >>> arm = rbd.load_robot("ur5", root="fixed")
        >>> held = rbd.control.ZeroOrderHold(rbd.control.HoldPosture(arm.at()), period=0.01)
        >>> isinstance(held, rbd.control.SteppedController), held.every
        (True, 0.01)
    """

    def reset(self) -> None:
        """Forget everything: a motion starts. A fresh controller and one that was used before then give the same bits."""

    def accepted(self, step: AcceptedStep) -> None:
        """A step begins: torques that are held are computed here."""

    def __call__(self, state: State, t: float) -> Array:
        """Torques at a state and a time, shape (nu,) [N, N m]."""


class TouchesWhenRead(Mapping[str, ContactTouch]):
    """{contact: its points}, computed when first read.

    Args:
        find: Gives them.
    """

    def __init__(self, find: Callable[[], Mapping[str, ContactTouch]]) -> None:
        self._find = find

    @lazy
    def _found(self) -> dict[str, ContactTouch]:
        return dict(self._find())

    def __getitem__(self, name: str) -> ContactTouch:
        try:
            return self._found[name]
        except KeyError:
            known = list(self._found)
            raise KeyError(f"no contact {name!r:.80} with points in this motion; {nearest(str(name), known)}.") from None

    def __iter__(self) -> Iterator[str]:
        return iter(self._found)

    def __len__(self) -> int:
        return len(self._found)

    def __reduce__(self) -> tuple[object, ...]:
        """Copies and pickles have what was computed."""
        return dict, (self._found,)


def hook(controller: object, name: str) -> Callable[..., None] | None:
    """A controller's method of this name: "reset" or "accepted"; None if it has none.

    Raises:
        InputError: it is not a method.
    """
    found = getattr(controller, name, None)
    if found is None or callable(found):
        return found
    raise InputError(
        f"{name} of the controller {controller!r:.80} is {found!r:.80}; expected a method, see rbd.control.SteppedController."
    )


def check_model(whose: str, robot: CheckedModel | None) -> None:
    """Refuse what is no robot as the model of a controller.

    Raises:
        InputError: naming the controller.
    """
    check_kind(f"robot of {whose}", robot, CheckedModel | None, "a robot, rbd.load_robot(...), or None")


def told(controller: object, method: Callable[..., None], *given: AcceptedStep, t: float = 0.0) -> None:
    """Call a hook of a user's controller: `accepted` with a step, or `reset`.

    Raises:
        InputError: if it cannot be called so.
    """
    try:
        method(*given)
    except TypeError as error:
        name, what = ("accepted", "an rbd.control.AcceptedStep") if given else ("reset", "no arguments")
        raise InputError(
            f"{name} of the controller {controller!r:.80} was called with {what} at t = {t:.6g} s, and failed: {error}."
        ) from error


def sample_period(controller: object) -> float | None:
    """The attribute `every` of a controller [s]; None if it has none.

    Raises:
        InputError: it is not a time above zero.
    """
    every = getattr(controller, "every", None)
    return None if every is None else checked_period(f"every of the controller {controller!r:.80}", every)


def checked_period(what: str, given: float) -> float:
    """A time between two samples [s].

    Raises:
        InputError: it is not a time above zero.
    """
    return check_number(what, given, 2.0 * INSTANT, expected="a time above 0 [s], or None")


def sample_at(t: float, every: float) -> int:
    """Number of the sample that holds at a time: 0 from t = 0 on, 1 from t = every on; times equal to rounding are the same."""
    return math.floor((t + INSTANT) / every)


Controller: TypeAlias = Callable[[State, float], Array]
"""Torques (nu,) of a state and a time [s]."""
ExternalAt: TypeAlias = Callable[[State, float], External]
"""External forces at a state and a time [s]."""


def asked(what: str, given: Callable[[State, float], Any], state: State, t: float) -> Any:
    """The result of a user's function of state and time.

    Raises:
        InputError: if it cannot be called so.
    """
    try:
        return given(state, t)
    except TypeError as error:
        raise InputError(f"{what} {given!r:.80} was called with (state, t) at t = {t:.6g} s, and failed: {error}.") from error


@dataclass(frozen=True, eq=False)
class TorqueSchedule(Displayed):
    """Controller that gives torques from a table over time, independent of the state.

    Attributes:
        times: Shape (n,) [s], increasing.
        torques: Shape (n, nu) [N, N m], one row a time.
        held: Each row applies from its time to the next; else rows are interpolated linearly. Before the first
            time the first row applies, after the last time the last.

    Raises:
        InputError: times that do not increase, sizes that do not fit, numbers that are not finite.

    Example:
        >>> arm = rbd.planar.to_robot(rbd.planar.Chain(1, lengths=[1.0]), masses=[1.0])
        >>> table = rbd.control.TorqueSchedule([0.0, 0.5, 1.0], [[0.0], [2.0], [0.0]])
        >>> [float(table(arm.at([0.0]), t)[0]) for t in (0.25, 0.5, 0.75, 2.0)]
        [1.0, 2.0, 1.0, 0.0]
    """

    times: Sequence[float] | Array
    torques: Sequence[Sequence[float]] | Array
    _: KW_ONLY
    held: bool = False

    def __post_init__(self) -> None:
        check_flag("held of TorqueSchedule", self.held)
        times = as_finite("times of TorqueSchedule", self.times, ("n",), meaning=": one or more, increasing [s]")
        if not len(times) or (np.diff(times) <= 0.0).any():
            raise InputError(f"times of TorqueSchedule are {str(times.tolist()):.80}; expected one or more, increasing [s].")
        torques = as_finite("torques of TorqueSchedule", self.torques, (len(times), "nu"), meaning=", one row per time")
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "torques", torques)

    def __call__(self, state: State, t: float) -> Array:
        """Torques at a time [s], shape (nu,) [N, N m].

        Raises:
            InputError: the table has not one column a motor.
        """
        times, torques = np.asarray(self.times), np.asarray(self.torques)
        if torques.shape[1] != state.robot.nu:
            raise InputError(
                f"torques of TorqueSchedule have {torques.shape[1]} columns; {state.robot.name} has {state.robot.nu} motors: "
                "one column each, in the order of robot.actuated_names."
            )
        i = int(np.searchsorted(times, t + INSTANT, side="right")) - 1
        if i < 0 or i + 1 == len(times) or self.held:
            return torques[max(i, 0)]
        part = max(0.0, (t - times[i]) / (times[i + 1] - times[i]))
        return (1.0 - part) * torques[i] + part * torques[i + 1]


@dataclass(frozen=True, eq=False)
class ZeroOrderHold(Displayed):
    """Controller evaluated once a period, its torques constant in between: a zero-order hold, as in a real robot.

    It is evaluated at the first step that begins in a period. So the period should be a whole number of steps, where these have
    one length; `DormandPrince8` ends a step at each period. A controller with memory is told these steps alone, each of
    the length of a period (`SteppedController`). Before the first step, as outside a simulation, nothing is held: a
    call evaluates the controller.

    Attributes:
        controller: The controller evaluated.
        period: [s], e.g. 1e-3.

    Raises:
        InputError: a controller that cannot be called, a period that is not above zero.

    Example:
        >>> arm = rbd.planar.to_robot(rbd.planar.Chain(1, lengths=[1.0]), masses=[1.0])
        >>> ramp = rbd.control.ZeroOrderHold(lambda state, t: np.array([10.0 * t]), period=0.2)
        >>> rbd.simulate(arm.at([0.0]), duration=0.4, step=0.1, controller=ramp).tau[:, 0].round(6)
        array([0., 0., 2., 2., 4.])
    """

    controller: Controller
    period: float
    _held: dict[str, tuple[int, Array]] = field(init=False, repr=False, default_factory=dict)

    def __post_init__(self) -> None:
        if isinstance(self.controller, type) or not callable(self.controller):
            raise InputError(f"controller is {self.controller!r:.80}; expected a function of (state, t), e.g. TorqueSchedule.")
        checked_period("period of ZeroOrderHold", self.period)
        for name in ("reset", "accepted"):
            hook(self.controller, name)  # which raises if it is not a method

    @property
    def every(self) -> float:
        """The period [s]."""
        return float(self.period)

    def reset(self) -> None:
        """Hold nothing: a motion starts."""
        self._held.clear()
        method = hook(self.controller, "reset")
        if method is not None:
            told(self.controller, method)

    def accepted(self, step: AcceptedStep) -> None:
        """A step begins: the first one of a period evaluates the controller.

        Raises:
            InputError: the controller cannot be called, or gives no numbers.
        """
        sample, known = sample_at(step.t, self.every), self._held.get("torques")
        if known is not None and known[0] == sample:
            return
        method = hook(self.controller, "accepted")
        if method is not None:
            told(self.controller, method, replace(step, h=self.every), t=step.t)
        self._held["torques"] = sample, self._evaluated(step.state, step.t)

    def __call__(self, state: State, t: float) -> Array:
        """Torques that are held, shape (nu,) [N, N m]; before the first step those of the controller here."""
        known = self._held.get("torques")
        return self._evaluated(state, t) if known is None else known[1]

    def _evaluated(self, state: State, t: float) -> Array:
        return as_array("torques of a sampled controller", asked("controller", self.controller, state, t)).copy()


@dataclass(frozen=True, eq=False)
class Push(Displayed):
    """A constant force from one time to another: give it to `rbd.simulate` as `external`.

    It acts at start <= t < start + duration. With both on the edges of steps its impulse is force * duration; else it is right
    to a step's worth.

    Attributes:
        frame: Frame of the robot.
        force: In world axes, shape (3,) [N].
        start: When it begins [s].
        duration: How long it lasts [s].
        moment: In world axes, in addition to the force's, shape (3,) [N m].
        offset: Where it acts, from the frame's origin in the frame's axes, shape (3,) [m].

    Raises:
        InputError: vectors that are not three finite numbers, a time that is not finite, a duration that is not above zero.

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> push = rbd.control.Push("box", (0.0, 20.0, 0.0), start=0.1, duration=0.2)
        >>> motion = rbd.simulate(rbd.State(box, [0, 0, 1, 0, 0, 0, 1]), duration=0.4, step=0.05, external=push)
        >>> push.impulse, motion.momentum[::2, 1].round(6)
        (array([0., 4., 0.]), array([0.      , 0.166667, 2.166667, 4.      , 4.      ]))
    """

    frame: str
    force: Sequence[float] | Array
    _: KW_ONLY
    start: float
    duration: float
    moment: Sequence[float] | Array = (0.0, 0.0, 0.0)
    offset: Sequence[float] | Array = (0.0, 0.0, 0.0)
    _force: ExternalForce = field(init=False, repr=False)

    def __post_init__(self) -> None:
        check_number(f"start of the push at {self.frame!r:.80}", self.start, -1e9, 1e9, expected="a time [s]")
        check_number(f"duration of the push at {self.frame!r:.80}", self.duration, ABOVE_ZERO, 1e9, expected="more than 0 s")
        given = ExternalForce(self.frame, self.force, self.moment, self.offset)
        for what in ("force", "moment", "offset"):
            object.__setattr__(self, what, getattr(given, what))
        object.__setattr__(self, "_force", given)

    @property
    def end(self) -> float:
        """When it ends [s]."""
        return float(self.start) + float(self.duration)

    @property
    def impulse(self) -> Array:
        """Force times duration, shape (3,) [N s]."""
        return np.asarray(self.force) * float(self.duration)

    def acts(self, t: float) -> bool:
        """Whether it acts at a time [s]."""
        return float(self.start) - INSTANT <= t < self.end - INSTANT

    def __call__(self, state: State, t: float) -> tuple[ExternalForce, ...]:
        """The forces at a time [s]: this one, or none."""
        return (self._force,) if self.acts(t) else ()

    def __str__(self) -> str:
        x, y, z = (float(x) for x in self.force)
        return f"({x:g}, {y:g}, {z:g}) N at {self.frame} from {float(self.start):g} to {self.end:g} s"


@dataclass(frozen=True, eq=False)
class Pushes(Displayed):
    """Several pushes, and loads that always act, as `external` of `rbd.simulate`: those that act at a time add up.

    Attributes:
        pushes: Objects `Push` and `ExternalForce`.

    Raises:
        InputError: an entry that is neither.

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> lift = rbd.ExternalForce("box", (0.0, 0.0, 98.1))  # always
        >>> both = rbd.control.Pushes([lift, rbd.control.Push("box", (20.0, 0.0, 0.0), start=0.1, duration=0.2)])
        >>> motion = rbd.simulate(rbd.State(box, [0, 0, 1, 0, 0, 0, 1]), duration=0.4, step=2e-3, external=both)
        >>> motion.momentum[-1, :3].round(6)  # 20 N for 0.2 s
        array([ 4.,  0., 0.])
    """

    pushes: Sequence[Push | ExternalForce]

    def __post_init__(self) -> None:
        given = listed_items("pushes", self.pushes, "a list of rbd.control.Push and rbd.ExternalForce")
        for push in given:
            check_kind("an entry of pushes", push, Push | ExternalForce, "rbd.control.Push or rbd.ExternalForce")
        object.__setattr__(self, "pushes", tuple(given))

    def __call__(self, state: State, t: float) -> tuple[ExternalForce, ...]:
        """All forces that act at a time [s]."""
        out: list[ExternalForce] = []
        for push in self.pushes:
            out += (push,) if isinstance(push, ExternalForce) else push(state, t)
        return tuple(out)
