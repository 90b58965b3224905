"""`Frames`: what a file of a motion holds, before velocities are computed; its rate, units and joints checked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array, as_float
from rbd.errors import InputError
from rbd.model.checked_model import CheckedModel
from rbd.motion.derivation import Derivation

LEAST_RATE, MOST_RATE = 1.0, 10_000.0
"""Rates that a motion can have [Hz]."""
MANY_TURNS = 4.0 * np.pi
"""Joint angles beyond this are degrees, where the units are not given [rad]."""


@dataclass(frozen=True, eq=False)
class Frames:
    """What a file holds: a robot, times, configurations, what else it gives, and what was guessed.

    Attributes:
        robot: The robot.
        t: Times, shape (n,) [s].
        q: Configurations, shape (n, nq).
        v: Velocities, or None.
        a: Accelerations, or None.
        derivation: How v and a came from q, where the file says so; else None.
        notes: What was guessed and changed, in words.
        noise: Standard deviation of q along each velocity that the file's decimals leave, shape (nv,) [m, rad].
        ground: Height of the floor [m].
    """

    robot: CheckedModel
    t: Array
    q: Array
    v: Array | None = None
    a: Array | None = None
    derivation: Derivation | None = None
    notes: tuple[str, ...] = ()
    noise: Array | float = 0.0
    ground: float = 0.0


def check_rate(rate: float, what: str = "rate") -> float:
    """A rate that a motion can have.

    Raises:
        InputError: it is none.
    """
    found = as_float(rate)
    if not LEAST_RATE <= found <= MOST_RATE:
        raise InputError(
            f"{what} is {rate!r:.80}; expected {LEAST_RATE:g} to {MOST_RATE:g} frames a second. Most files have 30 or 60."
        )
    return found


def unit_of(robot: CheckedModel, names: Sequence[str], x: Array, units: str | None, file: str) -> Array:
    """What each joint's numbers are multiplied by, for radians and metres, shape (k,).

    Raises:
        InputError: angles of many turns, where units are not given.
    """
    angular = np.array([robot.joints[name].is_angle for name in names], bool)
    if units == "deg":
        return np.where(angular, np.pi / 180.0, 1.0)
    largest = np.abs(x).max(axis=0, initial=0.0) * angular
    if units is None and len(names) and largest.max() > MANY_TURNS:
        k = int(largest.argmax())
        row = int(np.abs(x[:, k]).argmax())
        raise InputError(
            f"{file}: joint {names[k]!r:.80} is {x[row, k]:.6g} in frame {row}, "
            f"{abs(x[row, k]) / (2.0 * np.pi):.3g} turns in radians. "
            "Give units='deg' if the angles are in degrees, units='rad' if it turns so far."
        )
    return np.ones(len(names))


def joint_positions(robot: CheckedModel, q: Array, names: Sequence[str], x: Array) -> None:
    """Write positions [rad, m] of joints with one degree of freedom into configurations, in place."""
    for k, name in enumerate(names):
        joint = robot.joints[name]
        q[:, joint.q] = np.stack([np.cos(x[:, k]), np.sin(x[:, k])], axis=1) if joint.is_continuous else x[:, k, None]


def joint_values(robot: CheckedModel, q: Array, names: Sequence[str]) -> Array:
    """Positions of joints with one degree of freedom [rad, m], shape (n, k)."""
    out = np.empty((len(q), len(names)))
    for k, name in enumerate(names):
        joint = robot.joints[name]
        own = q[:, joint.q]
        out[:, k] = np.unwrap(np.arctan2(own[:, 1], own[:, 0])) if joint.is_continuous else own[:, 0]
    return out
