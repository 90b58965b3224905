"""What a controller with memory is told: that a motion starts, and each step that is taken, with what touches."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from rbd.arrays import Array, as_float, lazy
from rbd.displayed import Displayed
from rbd.errors import InputError, nearest
from rbd.model.checked_model import CheckedModel
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
    if not (robot is None or isinstance(robot, CheckedModel)):
        raise InputError(f"robot of {whose} is {robot!r:.80}; expected a robot, rbd.load_robot(...), or None.")


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
    if every is None:
        return None
    if not 2.0 * INSTANT < as_float(every) < math.inf:
        raise InputError(f"every of the controller {controller!r:.80} is {every!r:.80}; expected a time above 0 [s], or None.")
    return float(every)


def sample_at(t: float, every: float) -> int:
    """Number of the sample that holds at a time: 0 from t = 0 on, 1 from t = every on; times equal to rounding are the same."""
    return math.floor((t + INSTANT) / every)
