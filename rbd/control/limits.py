"""Limits of a whole-body controller: torques, joint positions with a braking distance, joint velocities.

A joint at distance r from its limit, which it approaches at v, keeps it over a time d of constant acceleration a, and can brake
after it with A, if [DelPrete2018]

    (v + d a)^2 <= 2 A (r - d v - d^2 a / 2)     where it still approaches then (v + d a >= 0),
    a <= -v^2 / (2 r)                            where it must turn back before (d v / 2 > r);

of the first the larger root is a = (sqrt(A^2 d^2 + 8 A r - 4 A d v) - 2 v - A d) / (2 d). What keeps a limit over d keeps it
over any shorter time. A joint that is too fast to brake in time brakes with A; one beyond its limit comes back with at most A.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rbd.arrays import Array, as_float, check_flag, check_positive
from rbd.errors import InputError
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State

_MOST = 1e6
_RETURN = 0.1
"""A joint beyond its limit comes back by this share of what it is beyond in each time d."""


@dataclass(frozen=True)
class Limits:
    """Limits that a step of whole-body control keeps.

    Attributes:
        torque: Share of the file's effort limits that motors may use, in (0, 1]; None for no limit.
        position: Keep joints within their positions, so that they can brake in time.
        velocity: Keep joints within their velocities.
        braking: A: deceleration that the motors can bring at any posture [rad/s2, m/s2]. More lets joints come nearer to their
            limits at speed; more than the motors have lets them pass.
        horizon: d: time over which the accelerations of a step are held [s]: at least the time between two steps.

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

    def __post_init__(self) -> None:
        if self.torque is not None and not 0.0 < as_float(self.torque) <= 1.0:
            raise InputError(f"torque is {self.torque!r:.80}; expected a share of the effort limits in (0, 1], or None.")
        check_flag("position", self.position)
        check_flag("velocity", self.velocity)
        check_positive("braking", self.braking, _MOST)
        check_positive("horizon", self.horizon, _MOST)

    def torques(self, robot: CheckedModel) -> Array:
        """Largest torques, shape (nu,) [N, N m]; inf where there is no limit."""
        return np.full(robot.nu, np.inf) if self.torque is None else self.torque * robot.effort_limit

    def accelerations(self, state: State) -> tuple[Array, Array]:
        """(least, most) accelerations of all coordinates, shapes (nv,) [rad/s2, m/s2]; infinite where there is no limit."""
        least, most = np.full(state.robot.nv, -np.inf), np.full(state.robot.nv, np.inf)
        for bounds in self.bounds(state):
            at = bounds.at
            least[at], most[at] = np.maximum(least[at], bounds.least), np.minimum(most[at], bounds.most)
        crossed = least > most  # the room between two limits is too small for both
        least[crossed] = most[crossed] = 0.5 * (least[crossed] + most[crossed])
        return least, most

    def bounds(self, state: State) -> tuple[JointBounds, ...]:
        """Accelerations that positions, then velocities, of the joints with such limits allow."""
        out = []
        joints = _limited(state.robot)
        d, A = self.horizon, self.braking
        if self.position and len(joints.at):
            q, v = state.q[joints.q], state.v[joints.at]
            most = _towards(joints.highest - q, v, A, d)
            out.append(JointBounds("position", joints.at, -_towards(q - joints.lowest, -v, A, d), most))
        if self.velocity and len(joints.fast_at):
            v = state.v[joints.fast_at]
            least, most = (-joints.fastest - v) / d, (joints.fastest - v) / d
            out.append(JointBounds("velocity", joints.fast_at, np.minimum(least, A), np.maximum(most, -A)))
        return tuple(out)


class JointBounds(NamedTuple):
    """Bounds of some accelerations.

    Attributes:
        kind: "position" or "velocity".
        at: Their indices in v.
        least: Lower bounds.
        most: Upper bounds.
    """

    kind: str
    at: Array
    least: Array
    most: Array


class _Joints(NamedTuple):
    """The joints of a robot with limits: indices in q and v, lowest and highest positions; indices in v, and speeds."""

    q: Array
    at: Array
    lowest: Array
    highest: Array
    fast_at: Array
    fastest: Array


def _limited(robot: CheckedModel) -> _Joints:
    found = robot.kept.get(_Joints)
    if found is None:
        joints = [j for j in robot.joints.values() if min(-j.lower, j.upper) < math.inf]
        fast = [j for j in robot.joints.values() if j.speed < math.inf]
        found = robot.kept[_Joints] = _Joints(
            np.array([j.q.start for j in joints], int),
            np.array([j.v.start for j in joints], int),
            np.array([j.lower for j in joints]),
            np.array([j.upper for j in joints]),
            np.array([j.v.start for j in fast], int),
            np.array([j.speed for j in fast]),
        )
    return found


def _towards(room: Array, v: Array, A: float, d: float) -> Array:
    """The most acceleration towards a limit that is at a distance `room`, for a joint that approaches it at v."""
    inside = np.maximum(room, 0.0)
    root = np.sqrt(np.maximum(A * A * d * d + 8.0 * A * inside - 4.0 * A * d * v, 0.0))
    most = (root - 2.0 * v - A * d) / (2.0 * d)
    turns = 0.5 * d * v > inside
    if turns.any():
        most[turns] = -(v[turns] ** 2) / np.maximum(2.0 * inside[turns], 1e-300)
    beyond = room < 0.0
    if beyond.any():
        most[beyond] = (_RETURN * room[beyond] / d - v[beyond]) / d
    return np.maximum(most, -A)
