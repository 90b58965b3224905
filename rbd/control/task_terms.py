"""What a task of whole-body control is: rows at a state, what they are wanted to be, a cost of each; and references in time."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, TypeAlias

import numpy as np

from rbd.arrays import Array, as_array, check_finite, check_number, filled, lazy, zeros
from rbd.displayed import Displayed
from rbd.errors import InputError, RbdError
from rbd.errors.inputs import check_different, listed_items
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State

_MOST = 1e12
"""Largest gain, damping ratio, cost, and length of a target and of its rates."""


class Reference(NamedTuple):
    """What a task follows at one time: a value, its velocity and its acceleration.

    The last two are feed-forward: without them a moving target is followed with a delay. They are zero where they are None.

    Attributes:
        value: As the task's `target`.
        velocity: Its rate, in the units of the task per second.
        acceleration: The rate of that.

    Example:
        >>> sway = lambda t: rbd.control.Reference([0.02 * np.sin(t), 0.0, 0.2], velocity=[0.02 * np.cos(t), 0.0, 0.0])
        >>> task = rbd.control.ComTask(sway, gain=25.0)
        >>> state = rbd.load_robot("solo12").standing()
        >>> e = [0.0, 0.0, 0.2] - state.com
        >>> print(task.terms(state, 0.0).wanted - 25.0 * e)  # 2 sqrt(25) times a velocity of 0.02 m/s
        [0.2 0.  0. ]
    """

    value: Any
    velocity: Any = None
    acceleration: Any = None

    def _repr_html_(self) -> str:
        return Displayed._repr_html_(self)  # type: ignore[arg-type]  # a named tuple has no other base


Target: TypeAlias = Any | Reference | Callable[[float], Any]
"""A value, a `Reference`, or a function of time that gives one of them."""
Cost: TypeAlias = float | Sequence[float] | Array


@dataclass(frozen=True, eq=False)
class TaskTerms(Displayed):
    """A task at one state and time: m rows A, what they are wanted to be, and what missing them costs.

    The step of a whole-body controller minimises the sum over all tasks of::

        1/2 sum_i cost_i (A_i x - wanted_i)^2        x: the acceleration a; or the force of a contact

    Attributes:
        name: The task's name.
        A: Shape (m, nv), on accelerations; on the force of a contact, shape (m, 3), or on its wrench about the contact's
            point, shape (m, 6), on the robot and in world axes.
        wanted: Shape (m,); for accelerations with J_dot v and all feedback.
        cost: Shape (m,), of numbers from zero.
        contact: Name of the contact whose force it is about; empty for accelerations.

    Raises:
        InputError: sizes that do not fit, numbers that are not finite, a negative cost.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> trunk = solo.standing().frame("base_link")
        >>> terms = rbd.control.TaskTerms("trunk up", trunk.J[2:3], [0.5] - trunk.bias[2:3], [1.0])  # by 0.5 m/s2
        >>> terms.A.shape, terms.wanted
        ((1, 18), array([0.5]))
    """

    name: str
    A: Array
    wanted: Array
    cost: Array
    contact: str = ""

    @classmethod
    def unchecked(cls, name: str, A: Array, wanted: Array, cost: Array, contact: str = "") -> TaskTerms:
        """The same without rows of cost zero, and without the checks, a quarter of what a task costs: for arrays that fit."""
        rows = cost.nonzero()[0]
        if len(rows) < len(cost):
            A, wanted, cost = A.take(rows, axis=0), wanted.take(rows), cost.take(rows)
        return filled(cls, name=name, A=A, wanted=wanted, cost=cost, contact=contact)

    def __post_init__(self) -> None:
        if not (isinstance(self.name, str) and self.name and isinstance(self.contact, str)):
            raise InputError(f"terms are named {self.name!r:.80}, of contact {self.contact!r:.80}; expected two texts.")
        A, wanted, cost = self.A, self.wanted, self.cost
        if not (type(A) is type(wanted) is type(cost) is np.ndarray and A.dtype == wanted.dtype == cost.dtype == float):
            for what in ("A", "wanted", "cost"):
                object.__setattr__(self, what, as_array(f"{what} of task {self.name!r:.80}", getattr(self, what)))
            A, wanted, cost = self.A, self.wanted, self.cost
        if A.ndim != 2 or wanted.shape != A.shape[:1] or cost.shape != A.shape[:1]:
            raise InputError(
                f"the terms of task {self.name!r:.80} have shapes A {A.shape}, wanted {wanted.shape}, cost {cost.shape}; "
                "expected (m, nv), (m,) and (m,)."
            )
        if not math.isfinite(np.vdot(A, A) + wanted.dot(wanted) + cost.dot(cost)):
            for what in ("A", "wanted", "cost"):
                check_finite(f"{what} of task {self.name!r:.80}", getattr(self, what))
        if len(cost) and cost.min() < 0.0:
            raise InputError(f"cost of task {self.name!r:.80} is {cost.tolist()!r:.80}; expected numbers from 0.")


class Task(Protocol):
    """Protocol of a task: a name, and its terms at a state and a time; any object with both is one.

    A task may also have a method `check(robot)`, which refuses a robot without the names that it uses; a controller calls it
    at its construction.

    Example:
        >>> class Rise:
        ...     '''The trunk accelerates upwards.'''
        ...     name = "rise"
        ...     def terms(self, state, t):
        ...         trunk = state.frame("base_link")
        ...         return rbd.control.TaskTerms("rise", trunk.J[2:3], 0.5 - trunk.bias[2:3], [1.0])
        >>> Rise().terms(rbd.load_robot("solo12").standing(), 0.0).wanted
        array([0.5])
    """

    @property
    def name(self) -> str:
        """Its name, unique among the tasks that are given together."""

    def terms(self, state: State, t: float) -> TaskTerms:
        """Its rows at a state and a time [s]."""


class FollowingTask(Displayed):
    """What tasks with a target have in common: checked settings, and the reference at a time."""

    name: str
    target: Any
    gain: float
    damping_ratio = 0.0

    def _settle(self, name: str = "", **costs: int) -> None:
        """Check and store the name, costs, gains and a target that is no function.

        Args:
            name: Where the task has none.
            costs: {attribute: how many axes it has}.

        Raises:
            InputError: a name that is no text, costs or gains that are no numbers or of another length, a wrong target.
        """
        object.__setattr__(self, "name", checked_name(self.name, name))
        for what, m in costs.items():
            object.__setattr__(self, what, checked_costs(f"{what} of task {self.name!r:.80}", getattr(self, what), m))
        checked_law(self.name, self.gain, self.damping_ratio)
        if not callable(self.target):
            object.__setattr__(self, "target", self._reference(self.target, None))

    def _reference(self, target: Any, t: float | None) -> Reference:
        """The checked reference of a target; t: the time at which a function gave it."""
        raise NotImplementedError

    def _at(self, t: float) -> Reference:
        """The reference at a time [s].

        Raises:
            InputError: what a function gives as the target is none, or it fails, with its own error as the cause.
        """
        target = self.target
        return self._reference(reference_at(self.name, target, t), t) if callable(target) else target

    @lazy
    def _law(self) -> tuple[float, float]:
        return checked_law(self.name, self.gain, self.damping_ratio)


def checked_tasks(tasks: Sequence[Task], robot: CheckedModel | None = None) -> tuple[Task, ...]:
    """Tasks as a tuple.

    Args:
        tasks: A list of tasks.
        robot: Refuse tasks with names that this robot does not have.

    Raises:
        InputError: not a list, or an entry that is no task.
        DuplicateName: two of one name.
        UnknownName: a frame or a joint that the robot does not have, with the nearest names.
    """
    found = tuple(listed_items("tasks", tasks, "a list, e.g. [rbd.control.PostureTask(state)]"))
    for task in found:
        name, terms = (getattr(task, what, None) for what in ("name", "terms"))
        if isinstance(task, type) or not isinstance(name, str) or not callable(terms):
            raise InputError(f"{task!r:.80} is no task: it wants a name and terms(state, t), as rbd.control.ComTask has.")
        if robot is not None and callable(check := getattr(task, "check", None)):
            check(robot)
    check_different([task.name for task in found], "tasks")
    return found


def robot_of(tasks: Iterable[Task]) -> CheckedModel | None:
    """The robot that tasks know by a `State` that is the target of one of them; None if none is."""
    for task in tasks:
        target = getattr(task, "target", None)
        if isinstance(target, Reference) and isinstance(target.value, State):
            return target.value.robot
    return None


def checked_name(name: str, default: str = "") -> str:
    """The name of a task, or a default where it is empty.

    Raises:
        InputError: no text, or empty.
    """
    found = (name or default) if isinstance(name, str) else name
    if not isinstance(found, str) or not found:
        raise InputError(f"the name of a task is {found!r:.80}; expected a text, e.g. 'torso'.")
    return found


def checked_law(name: str, gain: float, damping_ratio: float = 0.0) -> tuple[float, float]:
    """(k, 2 zeta sqrt(k)) of a gain k and a damping ratio zeta.

    Raises:
        InputError: negative, not finite or no number.
    """
    for what, value in (("gain", gain), ("damping_ratio", damping_ratio)):
        check_number(f"{what} of task {name!r:.80}", value, 0.0, _MOST, expected=f"a number from 0, below {_MOST:g}")
    return float(gain), 2.0 * float(damping_ratio) * math.sqrt(gain)


def checked_costs(what: str, cost: Cost, m: int, per: str = "axis") -> Array:
    """One cost or m of them as an array, shape (m,).

    Args:
        what: What they are, for messages.
        cost: One of all, or one each.
        m: Their number.
        per: What each one belongs to.

    Raises:
        InputError: another number of them, negative, not finite.
    """
    found = as_array(what, cost)
    if found.ndim and found.shape != (m,):
        raise InputError(f"{what} has shape {found.shape}; expected one number, or ({m},), one of each {per}.")
    if not ((found >= 0.0) & (found < _MOST)).all():
        raise InputError(f"{what} is {cost!r:.80}; expected numbers from 0, below {_MOST:g}.")
    return np.full(m, found) if not found.ndim else found


def target_of(name: str, t: float | None) -> str:
    """What a target is called in messages; t: the time at which a function gave it."""
    return f"target of task {name!r:.80}" + ("" if t is None else f" at t = {t:.9g} s")


def reference_at(name: str, target: Callable[[float], Any], t: float) -> Reference:
    """What a function of time gives as the target of a task at a time [s].

    Raises:
        InputError: the function fails, with its own error as the cause.
    """
    try:
        return as_reference(target(t))
    except RbdError:
        raise
    except Exception as error:
        raise InputError(
            f"the function that is the {target_of(name, t)} raised {type(error).__name__}: {error!s:.200}"
        ) from error


def as_reference(target: Any) -> Reference:
    """A value, or a reference as it is."""
    return target if isinstance(target, Reference) else Reference(target)


def checked_vector(value: Any, m: int, what: str, t: float | None, name: str) -> Array:
    """So many finite numbers as an array; a copy, but for a fitting array that a function gave.

    Args:
        value: What was given.
        m: Their number.
        what: "", "velocity" or "acceleration".
        t: The time at which a function gave it, or None.
        name: Name of the task.

    Raises:
        InputError: other sizes, numbers that are not finite.
    """
    if t is not None and type(value) is np.ndarray and value.shape == (m,) and value.dtype == float and is_near(value):
        return value
    said = f"{what} of the {target_of(name, t)}" if what else target_of(name, t)
    found = as_array(said, value)
    if found.shape != (m,):
        raise InputError(f"{said} has shape {found.shape}; expected ({m},).")
    check_near(said, found)
    return found


def is_near(value: Array) -> bool:
    """Whether a vector is finite, and no longer than 1e12."""
    return bool(value.dot(value) < _MOST * _MOST)  # NaN is not


def check_near(what: str, value: Array) -> None:
    """Refuse a vector with NaN or infinity, or longer than 1e12.

    Raises:
        InputError: naming the first bad entry.
    """
    check_finite(what, value)
    if not is_near(value):
        raise InputError(f"{what} is {value.tolist()!r:.80}; expected a length below {_MOST:g}.")


def checked_rates(ref: Reference, m: int, t: float | None, name: str) -> tuple[Array, Array]:
    """(velocity, acceleration) of a reference, shapes (m,); zero where none is given.

    Raises:
        InputError: other sizes, numbers that are not finite.
    """
    velocity = zeros(m) if ref.velocity is None else checked_vector(ref.velocity, m, "velocity", t, name)
    acceleration = zeros(m) if ref.acceleration is None else checked_vector(ref.acceleration, m, "acceleration", t, name)
    return velocity, acceleration
