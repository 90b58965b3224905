"""`Motor`: the data of a motor at a joint; torque limits that depend on the joint's speed.

The torque limit of a motor with a torque-speed line, for a torque tau at a joint that moves at v:

    |tau| <= line(|v|)        while it drives the joint, tau v > 0; no torque at speeds beyond the line's end
    |tau| <= line(0)          while it brakes the joint, tau v < 0, and at rest
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, as_float
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.errors.inputs import check_kind
from rbd.model.joint_table import Joints

_MOST = 1e12


@dataclass(frozen=True, kw_only=True)
class Motor(Displayed):
    """The data of a motor, for `robot.with_motors`. All numbers are at the joint, behind the gear; only `rotor_inertia` is not.

    What is None is as in the robot's file: torque limit, speed limit, rotor inertia.

    Attributes:
        limit: Largest torque at the joint, either way [N m, N]; inf: no limit.
        gear: Turns of the rotor for a turn of the joint [1], for a metre of it where it slides [rad/m]. It is used for the
            rotor inertia alone; its sign does not count.
        speed_limit: Largest speed of the joint [rad/s, m/s]; inf: none.
        torque_speed: [(speed, torque), ...] at the joint: the largest torque with which it drives the joint at a speed
            [rad/s, m/s; N m, N], between the points in straight lines, below the first speed as there, and zero beyond the last
            speed. Speeds increase from zero or more, torques do not increase. The torque at rest limits braking, too. With
            `limit`, the smaller one counts.
        rotor_inertia: Inertia of the rotor about its own axis, in front of the gear [kg m2]. gear^2 times it is added to the
            joint's diagonal entry of M, in place of the file's rotor inertia; the rotor's gyroscopic torques are neglected.

    Raises:
        InputError: numbers that are none, negative limits, a gear of zero, a torque-speed line of another shape or that rises.

    Example:
        >>> knee = rbd.Motor(gear=9.0, rotor_inertia=1e-4, torque_speed=[(0.0, 25.0), (12.0, 25.0), (20.0, 0.0)])
        >>> solo = rbd.load_robot("solo12").with_motors({"FL_KFE": knee})
        >>> least, most = solo.torque_limits(16.0 * np.ones(solo.nv))  # of the third motor, at 16 rad/s
        >>> print(least[2], most[2])
        -25.0 12.5
    """

    limit: float | None = None
    gear: float = 1.0
    speed_limit: float | None = None
    torque_speed: Sequence[tuple[float, float]] | None = None
    rotor_inertia: float | None = None

    def __post_init__(self) -> None:
        put = object.__setattr__
        for what, meaning in (("limit", "a torque > 0 [N m, N]"), ("speed_limit", "a speed > 0 [rad/s, m/s]")):
            value = getattr(self, what)
            if value is None:
                continue
            if not (0.0 < as_float(value) < _MOST or as_float(value) == math.inf):
                remedy = " For a joint without a motor give None in place of the motor." if as_float(value) == 0.0 else ""
                raise InputError(f"{what} of a motor is {value!r:.80}; expected {meaning}, inf for no limit, or None.{remedy}")
            put(self, what, as_float(value))
        if not 0.0 < abs(as_float(self.gear)) < _MOST:
            raise InputError(f"gear of a motor is {self.gear!r:.80}; expected a ratio that is not 0: rotor turns a joint turn.")
        put(self, "gear", as_float(self.gear))
        if self.rotor_inertia is not None:
            if not 0.0 <= as_float(self.rotor_inertia) < _MOST:
                raise InputError(
                    f"rotor_inertia of a motor is {self.rotor_inertia!r:.80}; expected 0 or more [kg m2], or None."
                )
            put(self, "rotor_inertia", as_float(self.rotor_inertia))
        if self.torque_speed is not None:
            put(self, "torque_speed", _checked_line(self.torque_speed))

    @property
    def standstill(self) -> float | None:
        """Largest torque at rest, and in braking [N m, N]: the smaller of the limit and of the line's first torque."""
        given = [] if self.limit is None else [self.limit]
        given += [self.torque_speed[0][1]] if self.torque_speed else []
        return min(given, default=None)

    @property
    def inertia(self) -> float | None:
        """The rotor's inertia seen at the joint, rotor_inertia gear^2 [kg m2, kg]."""
        return None if self.rotor_inertia is None else self.rotor_inertia * self.gear * self.gear


def _checked_line(given: object) -> tuple[tuple[float, float], ...]:
    """The points of a torque-speed line.

    Raises:
        InputError: another shape, numbers that are none, speeds that do not increase, torques that do.
    """
    expected = "expected [(speed, torque), ...] at the joint, two points or more, e.g. [(0, 60), (8, 60), (12, 0)]"
    try:
        line = tuple(tuple(map(as_float, point)) for point in given)  # type: ignore[attr-defined]
    except TypeError:
        line = ()
    if len(line) < 2 or any(len(point) != 2 for point in line):
        raise InputError(f"torque_speed of a motor is {given!r:.120}; {expected}.")
    for speed, torque in line:
        if not (0.0 <= speed < _MOST and 0.0 <= torque < _MOST):
            raise InputError(
                f"torque_speed of a motor has the point ({speed:g}, {torque:g}); expected finite numbers of 0 or more."
            )
    for (slow, more), (fast, less) in zip(line, line[1:], strict=False):
        if not slow < fast:
            raise InputError(f"speeds of a motor's torque_speed do not increase: {fast:g} follows {slow:g}; {expected}.")
        if less > more:
            raise InputError(
                f"a motor's torque_speed rises from {more:g} at speed {slow:g} to {less:g} at {fast:g}; the torque that drives "
                "does not increase with the speed. Were the numbers given as (torque, speed)?"
            )
    if not line[0][1] > 0.0:
        raise InputError(f"a motor's torque_speed starts with the torque 0; {expected}.")
    return tuple((point[0], point[1]) for point in line)


Motors = Mapping[str, Motor | None]
"""{joint: its motor, or None where it has none}."""


def checked_motors(joints: Joints, given: Any, name: str) -> dict[str, Motor | None]:
    """{joint: its motor}, of joints that can have one.

    Args:
        joints: The robot's.
        given: What `with_motors` was given.
        name: The robot's, for messages.

    Raises:
        JointNotFound: with the nearest names.
        InputError: what is no mapping, no motor, or a motor at a joint with several degrees of freedom.
    """
    check_kind("motors", given, Mapping, "{joint: rbd.Motor(limit=...)}, None for a joint without one")
    out = {}
    for joint, motor in given.items():
        found = joints[joint]
        check_kind(f"the motor of {joint!r:.80}", motor, Motor | None, "rbd.Motor(limit=...), or None for no motor")
        if found.kind == "FreeFlyer" or (motor is not None and found.nv != 1):
            raise InputError(
                f"joint {joint!r:.80} of {name} has {found.nv} degrees of freedom ({found.words}); a motor is at a joint "
                "with one."
            )
        out[joint] = motor
    return out


def plain_motors(motors: Motors) -> dict[str, Any]:
    """Motors as plain data, for JSON, which has no infinity: that is a word."""
    plain = {name: None if motor is None else asdict(motor) for name, motor in motors.items()}
    return {name: data and {k: "inf" if x == math.inf else x for k, x in data.items()} for name, data in plain.items()}


def motors_of_plain(plain: object) -> dict[str, Motor | None]:
    """The motors of `plain_motors`; none for None.

    Raises:
        InputError: what is no such data.
    """
    try:
        given = dict(plain or {})  # type: ignore[call-overload]
        data = {name: motor and {k: math.inf if x == "inf" else x for k, x in motor.items()} for name, motor in given.items()}
        return {name: None if motor is None else Motor(**motor) for name, motor in data.items()}
    except (TypeError, ValueError, AttributeError):
        raise InputError(f"the motors in a file are {plain!r:.80}; expected {{joint: data of a motor}}.") from None


def put_motors(model: pin.Model, file: pin.Model, joints: Joints, motors: Motors) -> None:
    """Write what motors say into a model: torque and speed limits, and rotor inertias.

    Args:
        model: What is changed.
        file: The model as it was loaded: what motors do not say is as there.
        joints: The robot's.
        motors: {joint: motor}.
    """
    for what, sides in (
        ("standstill", {"upperEffortLimit": 1.0, "lowerEffortLimit": -1.0}),
        ("speed_limit", {"upperVelocityLimit": 1.0, "lowerVelocityLimit": -1.0}),
        ("inertia", {"armature": 1.0}),
    ):
        for attribute, sign in sides.items():
            numbers, stated = np.array(getattr(model, attribute)), np.array(getattr(file, attribute))
            for name, motor in motors.items():
                given = None if motor is None else getattr(motor, what)
                numbers[joints[name].v] = stated[joints[name].v] if given is None else sign * given
            setattr(model, attribute, numbers)


class TorqueLines:
    """The torque-speed lines of a robot's motors.

    Args:
        actuated: Indices in v of its motors, shape (nu,).
        names: Their joints.
        motors: {joint: motor}.
    """

    def __init__(self, actuated: Array, names: Sequence[str], motors: Motors) -> None:
        given = [(i, motors.get(name)) for i, name in enumerate(names)]
        self._lines = {i: np.array(motor.torque_speed).T for i, motor in given if motor and motor.torque_speed}
        self._actuated = actuated

    def __bool__(self) -> bool:
        """Whether any motor has a line."""
        return bool(self._lines)

    def has(self, motor: int) -> bool:
        """Whether the motor of this number has a line."""
        return motor in self._lines

    def limits(self, v: Array | None, limit: Array) -> tuple[Array, Array]:
        """(least, most) torques at velocities v (..., nv), at rest for None, shapes (..., nu) [N m, N].

        Args:
            v: The velocities.
            limit: Torque limits at rest, shape (nu,).
        """
        if v is None or (v.ndim == 1 and not self._lines):
            return -limit, limit
        least, most = (np.broadcast_to(each, (*v.shape[:-1], len(each))).copy() for each in (-limit, limit))
        for i, (speeds, torques) in self._lines.items():
            rate = v[..., self._actuated[i]]
            left = np.minimum(np.interp(np.abs(rate), speeds, torques, right=0.0), most[..., i])
            least[..., i] = np.where(rate < 0.0, -left, least[..., i])
            most[..., i] = np.where(rate > 0.0, left, most[..., i])
        return least, most


def torque_use(tau: Array, least: Array, most: Array) -> Array:
    """Torques over the limit in their direction: 1 at the limit, 0 where there is none; inf beyond a limit of zero."""
    limit = np.where(tau < 0.0, -least, most)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(tau == 0.0, 0.0, np.abs(tau) / limit))
