"""Limits of a whole-body controller: torques, joint positions with a braking distance, joint velocities.

A joint at distance r from its limit, which it approaches at v, keeps it over a time d of constant acceleration a, and can brake
after it with P, if [DelPrete2018]

    (v + d a)^2 <= 2 P (r - d v - d^2 a / 2)     where it still approaches then (v + d a >= 0),
    a <= -v^2 / (2 r)                            where it must turn back before (d v / 2 > r);

of the first the larger root is a = (sqrt(P^2 d^2 + 8 P r - 4 P d v) - 2 v - P d) / (2 d). What keeps a limit over d keeps it
over any shorter time. Braking is planned with P, three quarters of the A that motors have for it: the rest makes up for
accelerations that vary while torques are held. A joint that is too fast to brake in time brakes with A; one beyond its limit
comes back with at most A.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rbd.arrays import Array, as_float, check_flag, check_number
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.errors.inputs import check_kind
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State, checked

_LEAST, _MOST = 1e-6, 1e6
_PLANNED = 0.75
"""Share of A with which braking is planned."""
_RETURN = 0.5
"""A joint beyond its limit comes back by this share of what it is beyond in each time d."""


@dataclass(frozen=True)
class Limits(Displayed):
    """Limits that a step of whole-body control keeps.

    Attributes:
        torque: Share of the effort limits that motors may use, in (0, 1], and of what their torque-speed lines leave; None for
            no limit.
        position: Keep joints within their positions, so that they can brake in time.
        velocity: Keep joints within their velocities.
        braking: A: deceleration that the motors can bring at any posture [rad/s2, m/s2]. More lets joints come nearer to their
            limits at speed; more than the motors have lets them pass.
        horizon: d: time over which the accelerations of a step are held [s]: at least the time between two steps.
        margin: Distance from their limits at which joints stop [rad, m]. While torques are held accelerations drift, and
            positions pass their limits by about that drift times the square of the horizon (an arm at full speed, torques held
            for 1 ms, a horizon of 2 ms: 1e-5 rad), speeds by what one period changes.

    Raises:
        InputError: numbers that are none, or out of range.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> half = rbd.control.Limits(torque=0.5)
        >>> float((half.torques(solo) / solo.effort_limit).max())
        0.5
    """

    torque: float | None = 1.0
    position: bool = True
    velocity: bool = True
    braking: float = 50.0
    horizon: float = 0.01
    margin: float = 0.0

    def __post_init__(self) -> None:
        if self.torque is not None and not _LEAST <= as_float(self.torque) <= 1.0:
            raise InputError(f"torque is {self.torque!r:.80}; expected a share of the effort limits in (0, 1], or None.")
        check_flag("position", self.position)
        check_flag("velocity", self.velocity)
        for what, value in (("braking", self.braking), ("horizon", self.horizon)):
            if not _LEAST <= as_float(value) <= _MOST:
                raise InputError(f"{what} is {value!r:.80}; expected a number from {_LEAST:g} to {_MOST:g}.")
        check_number("margin", self.margin, 0.0, _MOST, expected="a distance of 0 or more [rad, m]")

    def torques(self, robot: CheckedModel) -> Array:
        """Largest torques at rest, shape (nu,) [N, N m]; inf where there is no limit."""
        check_kind("robot", robot, CheckedModel, "a robot: rbd.load_robot(name)")
        return np.full(robot.nu, np.inf) if self.torque is None else self.torque * robot.effort_limit

    def torque_bounds(self, state: State) -> tuple[Array, Array]:
        """(least, most) torques at a state, shapes (nu,) [N, N m]: `robot.torque_limits` at its velocity, times the share."""
        robot = checked(state).robot
        if self.torque is None:
            return np.full(robot.nu, -np.inf), np.full(robot.nu, np.inf)
        least, most = robot.limits_at(state.v)
        return self.torque * least, self.torque * most

    def accelerations(self, state: State) -> tuple[Array, Array]:
        """(least, most) accelerations of all coordinates, shapes (nv,) [rad/s2, m/s2]; infinite where there is no limit."""
        least, most = np.full(checked(state).robot.nv, -np.inf), np.full(state.robot.nv, np.inf)
        joints = _limited(state.robot)
        v = state.v[joints.at]
        if not len(v):
            return least, most
        both = np.full((2, len(v)), np.inf)  # upper, and minus lower bounds
        if self.position:
            both = self._of_positions(state.q[joints.q], v, joints)
        if self.velocity:
            both = np.minimum(both, self._of_velocities(v, joints))
        upper, lower = both[0], -both[1]
        if (lower > upper).any():  # the room between two limits is too small for both
            middle = 0.5 * (lower + upper)
            lower, upper = np.where(lower > upper, middle, lower), np.where(lower > upper, middle, upper)
        least[joints.at], most[joints.at] = lower, upper
        return least, most

    def _of_positions(self, q: Array, v: Array, joints: _LimitedJoints) -> Array:
        """Upper and minus lower bounds of accelerations, shape (2, n)."""
        room = np.array([joints.highest - q, q - joints.lowest]) - self.margin
        return _towards(room, np.array([v, -v]), self.braking, self.horizon)

    def _of_velocities(self, v: Array, joints: _LimitedJoints) -> Array:
        """The same of speeds."""
        return np.maximum((joints.fastest - np.array([v, -v])) / self.horizon, -self.braking)


def joints_at_bounds(limits: Limits, state: State, a: Array, within: float) -> dict[str, tuple[str, ...]]:
    """{"position", "velocity": joints whose acceleration is at the bound of that limit}; those without any left out."""
    joints, out = _limited(state.robot), dict[str, tuple[str, ...]]()
    v = state.v[joints.at]
    bounds = {
        "position": limits._of_positions(state.q[joints.q], v, joints) if limits.position else None,
        "velocity": limits._of_velocities(v, joints) if limits.velocity else None,
    }
    toward = np.array([a[joints.at], -a[joints.at]])
    for kind, most in bounds.items():
        if most is None:
            continue
        held = np.flatnonzero((toward >= most - within).any(axis=0))
        if len(held):
            out[kind] = tuple(joints.names[i] for i in held)
    return out


class _LimitedJoints(NamedTuple):
    """The joints of a robot with limits, of one degree of freedom.

    Attributes:
        names: Their names.
        q: Indices in q.
        at: Indices in v.
        lowest: Lowest positions, or -inf.
        highest: Highest positions, or inf.
        fastest: Speeds, or inf.
    """

    names: tuple[str, ...]
    q: Array
    at: Array
    lowest: Array
    highest: Array
    fastest: Array


def _limited(robot: CheckedModel) -> _LimitedJoints:
    found: _LimitedJoints | None = robot.kept.get(_LimitedJoints)
    if found is None:
        joints = {name: j for name, j in robot.joints.items() if min(-j.lower, j.upper, j.speed) < math.inf}
        each = list(joints.values())
        found = robot.kept[_LimitedJoints] = _LimitedJoints(
            tuple(joints),
            np.array([j.q.start for j in each], int),
            np.array([j.v.start for j in each], int),
            np.array([j.lower for j in each]),
            np.array([j.upper for j in each]),
            np.array([j.speed for j in each]),
        )
    return found


def _towards(room: Array, v: Array, A: float, d: float) -> Array:
    """The most acceleration towards limits that are at a distance `room`, of joints that approach them at v."""
    P = _PLANNED * A
    near, turns = P * d * d + 8.0 * room - 4.0 * d * v, 0.5 * d * v > room
    if not turns.any():
        return np.maximum((np.sqrt(P * near) - P * d - 2.0 * v) / (2.0 * d), -A)
    most = (np.sqrt(P * np.maximum(near, 0.0)) - P * d - 2.0 * v) / (2.0 * d)
    inside, beyond = turns & (room > 0.0), turns & (room <= 0.0)
    most[inside] = v[inside] ** 2 / (-2.0 * room[inside])
    most[beyond] = (_RETURN * room[beyond] / d - v[beyond]) / d
    return np.maximum(most, -A)
