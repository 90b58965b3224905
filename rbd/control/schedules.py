"""Torques and forces over time: types of controllers and pushes, torque schedules, a zero-order hold, pushes."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from typing import Any, TypeAlias

import numpy as np

from rbd.arrays import Array, as_array, as_float, check_finite
from rbd.control.accepted_steps import INSTANT, AcceptedStep, hook, sample_at, told
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.model.external import External, ExternalForce
from rbd.model.state import State

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
        if not isinstance(self.held, bool):
            raise InputError(f"held of TorqueSchedule is {self.held!r:.80}; expected True or False.")
        times, torques = as_array("times of TorqueSchedule", self.times), as_array("torques of TorqueSchedule", self.torques)
        check_finite("times of TorqueSchedule", times)
        check_finite("torques of TorqueSchedule", torques)
        if times.ndim != 1 or not len(times) or (np.diff(times) <= 0.0).any():
            raise InputError(f"times of TorqueSchedule are {str(times.tolist()):.80}; expected one or more, increasing [s].")
        if torques.ndim != 2 or len(torques) != len(times):
            raise InputError(
                f"torques of TorqueSchedule have shape {torques.shape}; expected ({len(times)}, nu), one row per time."
            )
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
        if not 2.0 * INSTANT < as_float(self.period) < math.inf:
            raise InputError(f"period of ZeroOrderHold is {self.period!r:.80}; expected a time above 0 [s].")
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
        if not abs(as_float(self.start)) < 1e9:
            raise InputError(f"start of the push at {self.frame!r:.80} is {self.start!r:.80}; expected a time [s].")
        if not 0.0 < as_float(self.duration) < 1e9:
            raise InputError(f"duration of the push at {self.frame!r:.80} is {self.duration!r:.80}; expected more than 0 s.")
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
        given = self.pushes
        if isinstance(given, str | bytes) or not isinstance(given, Sequence):
            raise InputError(f"pushes is {given!r:.80}; expected a list of rbd.control.Push and rbd.ExternalForce.")
        for push in given:
            if not isinstance(push, Push | ExternalForce):
                raise InputError(f"pushes hold {push!r:.80}; expected rbd.control.Push or rbd.ExternalForce.")
        object.__setattr__(self, "pushes", tuple(given))

    def __call__(self, state: State, t: float) -> tuple[ExternalForce, ...]:
        """All forces that act at a time [s]."""
        out: list[ExternalForce] = []
        for push in self.pushes:
            out += (push,) if isinstance(push, ExternalForce) else push(state, t)
        return tuple(out)
