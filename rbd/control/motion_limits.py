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
from dataclasses import dataclass, replace
from functools import cache
from types import ModuleType
from typing import NamedTuple

import numpy as np

from rbd.arrays import Array, as_float, check_flag, check_number
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.errors.inputs import check_kind
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State, checked

_LEAST, _MOST = 1e-6, 1e6


@cache
def step_kernel() -> ModuleType:
    """`rbd.control.step_kernel`, imported where it is used."""
    from rbd.control import step_kernel

    return step_kernel


class LimitedJoints(NamedTuple):
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

    def joints(self, robot: CheckedModel) -> LimitedJoints:
        """Joints of a robot whose positions or velocities are limited."""
        key = LimitedJoints, bool(self.position), bool(self.velocity)
        found: LimitedJoints | None = robot.kept.get(key)
        if found is None:
            inf = math.inf
            each = {
                name: j
                for name, j in robot.joints.items()
                if self.position and min(-j.lower, j.upper) < inf or self.velocity and j.speed < inf
            }
            numbers = [(j.q.start, j.v.start) for j in each.values()]
            bounds = np.array([(j.lower, j.upper, j.speed) for j in each.values()]).reshape(-1, 3)
            found = robot.kept[key] = LimitedJoints(
                tuple(each), *np.array(numbers, int).reshape(-1, 2).T.copy(), *bounds.T.copy()
            )
        return found

    def accelerations(self, state: State) -> tuple[Array, Array]:
        """(least, most) accelerations of all coordinates, shapes (nv,) [rad/s2, m/s2]; infinite where there is no limit."""
        robot = checked(state).robot
        joints = self.joints(robot)
        least, most = np.full(robot.nv, -np.inf), np.full(robot.nv, np.inf)
        step_kernel().acceleration_bounds(
            state.q, state.v, *joints[1:], float(self.braking), float(self.horizon), float(self.margin), bool(self.position),
            bool(self.velocity), least, most,
        )  # fmt: skip
        return least, most


def joints_at_bounds(limits: Limits, state: State, a: Array, within: float) -> dict[str, tuple[str, ...]]:
    """{"position", "velocity": joints whose acceleration is at the bound of that limit}; those without any left out."""
    out = dict[str, tuple[str, ...]]()
    for kind, other in (("position", "velocity"), ("velocity", "position")):
        alone = replace(limits, **{other: False})
        (least, most), joints = alone.accelerations(state), alone.joints(state.robot)
        held = ((a <= least + within) | (a >= most - within))[joints.at].tolist()
        out[kind] = tuple([name for name, at in zip(joints.names, held, strict=True) if at])
    return {kind: names for kind, names in out.items() if names}
