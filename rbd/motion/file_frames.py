"""`Frames`: what a file of a motion holds, before velocities are computed; its rate, units and joints checked."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array, as_float, check_finite
from rbd.errors import InputError, RbdError
from rbd.model.checked_model import CheckedModel
from rbd.motion.derivation import NEARLY_UNIT, Derivation, unit_blocks
from rbd.robots.robot import Robot

LEAST_RATE, MOST_RATE = 1.0, 10_000.0
"""Rates that a motion can have [Hz]."""
EXACT = 1e-12
"""Norms off by less are said to be one."""
MOST_FRAMES = 1e7
"""Frames of a motion that is made or resampled."""
UNIT_SPREAD = 3.0
"""A base is from a third of its height as it stands to three times that, where its unit is in question."""
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
        quaternion: "xyzw" where the order of quaternions is decided; None: it is still to be found.
        simulated: Whether q, v and a are those of a trajectory of `rbd`.
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
    quaternion: str | None = "xyzw"
    simulated: bool = False


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


def check_same_rate(rate: float | None, own: float, where: str) -> None:
    """Refuse a rate that is off by more than 1 % from that of a file.

    Raises:
        InputError: they differ.
    """
    if rate is not None and abs(rate / own - 1.0) > 0.01:
        raise InputError(f"rate is {rate:g}, but {where} {own:.6g} Hz. Leave out rate.")


def counts_frames(t: Array) -> bool:
    """Whether times are whole numbers that follow each other, 0, 1, 2, ...: those of frames, not seconds."""
    return len(t) > 2 and bool((t == np.round(t)).all()) and float(np.diff(t).min()) == 1.0


def check_base_height(robot: CheckedModel, q: Array, ground: float, source: str) -> None:
    """Refuse a base that is a hundred or a thousand times as high above the floor as that of the standing robot.

    Raises:
        InputError: with the unit that it probably has.
    """
    if not isinstance(robot, Robot) or not robot.floating:
        return
    try:
        stands = float(robot.standing().q[2])
    except RbdError:
        return
    height = float(np.median(q[:, 2])) - ground
    ratio = height / stands if stands > 0.0 else 0.0
    for unit, factor in (("centimetres", 100.0), ("millimetres", 1000.0)):
        if factor / UNIT_SPREAD < ratio < factor * UNIT_SPREAD:
            raise InputError(
                f"{source}: the base is {height:.4g} m above the floor in the median, that of {robot.name} as it stands "
                f"{stands:.3g} m. Is its position in {unit}? Expected metres: divide x, y and z by {factor:g}; or trust=True "
                "if it is so high."
            )


def times_of(start: float, end: float, rate: float) -> Array:
    """Even times from start to the last that is not after the end, shape (n,).

    Raises:
        InputError: more frames than fit into memory.
    """
    count = (end - start) * rate
    if not count < MOST_FRAMES:
        raise InputError(f"{end - start:.6g} s at {rate:g} Hz are {count:.3g} frames; at most {MOST_FRAMES:.0e} are made.")
    return np.asarray(np.minimum(start + np.arange(int(count * (1.0 + 1e-12) + 1e-9) + 1) / rate, end))


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


def check_shape(what: str, x: Array, shape: tuple[int, ...], most: float = np.inf) -> None:
    """Refuse arrays of another shape, and numbers that are not finite or larger than `most`, by frame and column."""
    if x.shape != shape:
        raise InputError(f"{what} has shape {x.shape}; expected {shape}: a row a time, a column a coordinate.")
    if not np.isfinite(x).all():
        row, column = np.argwhere(~np.isfinite(x))[0]
        raise InputError(f"{what} at frame {row}, column {column} is {x[row, column]}; expected a finite number.")
    check_finite(what, x)
    if x.size and np.abs(x).max() > most:
        row, column = np.argwhere(np.abs(x) > most)[0]
        raise InputError(f"{what} at frame {row}, column {column} is {x[row, column]:.6g}; at most {most:g} is taken [m, rad].")


def normalise(robot: CheckedModel, q: Array) -> list[str]:
    """Divide quaternions and unit circles by their norms, in place, and say so where it changes them."""
    said = []
    for block in unit_blocks(robot):
        norm = np.linalg.norm(q[:, block], axis=1)
        off = np.abs(norm - 1.0)
        worst = int(off.argmax())
        if not off[worst] <= NEARLY_UNIT:
            what = "quaternion (x, y, z, w)" if block.stop - block.start == 4 else "unit circle (cos, sin)"
            raise InputError(
                f"frame {worst}: the {what} in columns {block.start} to {block.stop - 1} has norm {norm[worst]:.6g}; "
                f"expected 1 to {NEARLY_UNIT:g}. Are these its columns?"
            )
        q[:, block] /= norm[:, None]
        if off[worst] > EXACT:
            said.append(f"unit vectors in q[:, {block.start}:{block.stop}] were normalised: off by up to {off[worst]:.1g}.")
    return said


def value_at(f: Callable[[float], Array], t: float) -> Array:
    """What a user's function of time gives.

    Raises:
        InputError: with its error and the time [s].
    """
    try:
        return f(t)
    except Exception as error:
        raise InputError(f"f raised {type(error).__name__} at t = {t:.9g} s: {str(error)[:200]}") from error
