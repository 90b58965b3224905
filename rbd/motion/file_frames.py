"""`Frames`: what a file of a motion holds, before velocities are computed; its times, units and joints checked."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, check_finite, check_flag, check_number
from rbd.constraints.terrain.terrain import Terrain
from rbd.errors import InputError, RbdError
from rbd.errors.inputs import check_choice
from rbd.model.checked_model import CheckedModel
from rbd.model.sampled_motion import flat_coordinates
from rbd.motion.contact_lanes import StoredContacts
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
ROUNDING = 1.0 / np.sqrt(12.0)
"""Standard deviation of rounding, over what the last digit is worth."""
_RATE = re.compile(r"(?<![\d.])(\d{1,4}(?:\.\d+)?)[ _-]?(?:hz|fps)", re.IGNORECASE)


@dataclass(frozen=True)
class ReadSettings:
    """What is said of a file beside it, as the arguments of `Motion.read`; None where the file is to tell.

    Attributes:
        rate: Frames a second [Hz].
        quaternion: "xyzw" or "wxyz".
        joints: Names of the joints of the columns, in order.
        units: "rad" or "deg".
        trust: Take times and lengths as they are.
        motion: Name of the motion, in a file of several.

    Raises:
        InputError: a value that is none of these.
    """

    rate: float | None = None
    quaternion: str | None = None
    joints: Sequence[str] | None = None
    units: str | None = None
    trust: bool = False
    motion: str | None = None

    def __post_init__(self) -> None:
        check_flag("trust", self.trust)
        check_quaternion(self.quaternion)
        if self.units is not None:
            check_choice("units", self.units, ("rad", "deg"))
        if self.rate is not None:
            object.__setattr__(self, "rate", check_rate(self.rate))


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
        ground: Height of the floor [m], or the terrain; None: the file does not say.
        contacts: Contacts and forces that are beside it; None without any.
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
    ground: float | Terrain | None = None
    contacts: StoredContacts | None = None
    quaternion: str | None = "xyzw"
    simulated: bool = False


def check_rate(rate: float, what: str = "rate") -> float:
    """A rate that a motion can have.

    Raises:
        InputError: it is none.
    """
    expected = f"{LEAST_RATE:g} to {MOST_RATE:g} frames a second; most files have 30 or 60"
    return check_number(what, rate, LEAST_RATE, MOST_RATE, expected=expected)


def check_quaternion(order: object) -> None:
    """Refuse what is no order of quaternions.

    Raises:
        InputError: it is neither None, "xyzw" nor "wxyz".
    """
    if order is not None:
        check_choice("quaternion", order, ("xyzw", "wxyz"))


def standing_q(robot: CheckedModel) -> Array:
    """The configuration of joints that a file does not give: of the standing posture, if one is known, else neutral."""
    return robot.posture(name) if isinstance(robot, Robot) and (name := robot.source.posture) else pin.neutral(robot.model)


class OtherRate(InputError):
    """The rate that was given is not that of the file."""


def check_same_rate(rate: float | None, own: float, where: str) -> None:
    """Refuse a rate that is off by more than 1 % from that of a file.

    Raises:
        OtherRate: they differ.
    """
    if rate is not None and abs(rate / own - 1.0) > 0.01:
        raise OtherRate(f"rate is {rate:g}, but {where} {own:.6g} Hz. Leave out rate.")


def counts_frames(t: Array) -> bool:
    """Whether times are whole numbers that follow each other, 0, 1, 2, ...: those of frames, not seconds."""
    return len(t) > 2 and bool((t == np.round(t)).all()) and float(np.diff(t).min()) == 1.0


def file_times(
    path: Path,
    n: int,
    given: ReadSettings,
    *,
    t: Array | None = None,
    column: str = "t",
    row: Callable[[int], str] = "frame {}".format,
    step: float = 0.0,
) -> tuple[Array, list[str]]:
    """(times [s], notes): those of a file, or of the rate that is given, or in the file's name.

    Args:
        path: The file.
        n: How many frames it has.
        given: Its rate, and whether it is trusted.
        t: Its times, or the frames that it counts, shape (n,); None without any.
        column: What it calls them.
        row: Names a frame in messages.
        step: What one of their last decimals is worth [s]: times that are even to it are taken for even.

    Raises:
        InputError: times that do not increase, or of another rate than given; no rate, or one that no motion has.
    """
    if t is not None and (given.trust or not counts_frames(t)):
        return _own_times(path, t, given, row, step)
    rate, notes = given.rate, []
    if rate is None:
        found = _RATE.search(path.stem)
        if found is None:
            counted = "" if t is None else f": {column} counts frames, {t[0]:g}, {t[1]:g}, {t[2]:g}, ..."
            raise InputError(
                f"{path.name} has no times{counted}; give rate=30 [Hz], or whatever it is: most such files have 30 or 60."
            )
        rate = check_rate(float(found[1]), f"the rate in the name of {path.name}")
        notes.append(f"the rate, {rate:g} Hz, was taken from the file's name.")
    if t is None:
        return np.arange(n) / rate, notes
    notes.append(f"{column} counts frames, from {t[0]:g} to {t[-1]:g}; times are those of the rate.")
    return (t - t[0]) / rate, notes


def _own_times(path: Path, t: Array, given: ReadSettings, row: Callable[[int], str], step: float) -> tuple[Array, list[str]]:
    bad = np.flatnonzero(~(np.diff(t) > 0.0))
    if len(bad):
        i = int(bad[0])
        raise InputError(
            f"{path.name}, {row(i + 1)}: time {t[i + 1]:.9g} s does not follow {t[i]:.9g} s. "
            "Sort the frames, leave out repeated ones."
        )
    if len(t) < 2:
        return t, []
    own = (len(t) - 1) / float(t[-1] - t[0])
    if not given.trust:
        check_rate(float(f"{own:.6g}"), f"the rate of the times in {path.name}, if they are seconds,")
    check_same_rate(given.rate, own, f"the times in {path.name} have")
    even = np.linspace(t[0], t[-1], len(t))
    if 0.0 < np.abs(t - even).max() <= 1.01 * step:
        return even, [f"times are even to their decimals, and were taken for even: {own:.6g} Hz."]
    return t, []


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


def configurations(robot: CheckedModel, base: tuple[Array, Array] | None, names: Sequence[str], x: Array) -> Array:
    """Configurations of columns, shape (n, nq); joints that these leave out stand as in `standing_q`.

    Args:
        robot: The robot.
        base: Its place, shape (n, 3) [m], and its quaternions x, y, z, w, shape (n, 4); None without a floating base.
        names: Joints with one degree of freedom.
        x: Their positions, shape (n, k) [rad, m].
    """
    q = np.tile(standing_q(robot), (len(x), 1))
    if base is not None:
        q[:, :3], q[:, 3:7] = base
    for k, name in enumerate(names):
        joint = robot.joints[name]
        q[:, joint.q] = np.stack([np.cos(x[:, k]), np.sin(x[:, k])], axis=1) if joint.is_continuous else x[:, k, None]
    return q


def rounding_noise(robot: CheckedModel, place: float, turn: float, names: Iterable[str], steps: float | Array) -> Array:
    """Standard deviation of q along each velocity that rounding leaves, shape (nv,) [m, rad].

    Args:
        robot: The robot.
        place: What the last digit is worth in the place of a floating base [m].
        turn: The same in its quaternion.
        names: Joints that are rounded.
        steps: The same in each of them, or in all [rad, m].
    """
    noise = np.zeros(robot.nv)
    names = list(names)
    for name, step in zip(names, np.broadcast_to(steps, len(names)), strict=True):
        noise[robot.joints[name].v] = ROUNDING * step
    if robot.floating:
        noise[:3], noise[3:6] = ROUNDING * place, 2.0 * ROUNDING * turn
    return noise


def single_step(x: Array) -> float:
    """What the last digit is worth of numbers of single precision; zero of double ones."""
    return float(np.spacing(np.float32(max(1.0, np.abs(x).max())))) if x.dtype == np.float32 and x.size else 0.0


def joint_values(robot: CheckedModel, q: Array, names: Sequence[str]) -> Array:
    """Positions of joints with one degree of freedom [rad, m], shape (n, k)."""
    return np.asarray(flat_coordinates(robot, q)[:, [robot.joints[name].v.start for name in names]])


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


def check_unit(x: Array, where: Callable[[int], str]) -> Array:
    """Norms of vectors, shape (n,), which are one to `NEARLY_UNIT`.

    Args:
        x: Shape (n, k).
        where: Names a vector in the message.

    Raises:
        InputError: one is of another length.
    """
    norm = np.linalg.norm(x, axis=1)
    bad = np.flatnonzero(~(np.abs(norm - 1.0) <= NEARLY_UNIT))
    if len(bad):
        i = int(bad[0])
        raise InputError(f"{where(i)} has norm {norm[i]:.6g}; expected 1 to {NEARLY_UNIT:g}. Are these its columns?")
    return np.asarray(norm)


def normalise(robot: CheckedModel, q: Array) -> list[str]:
    """Divide quaternions and unit circles by their norms, in place, and say so where it changes them."""
    said = []
    for block in unit_blocks(robot):
        what = "quaternion (x, y, z, w)" if block.stop - block.start == 4 else "unit circle (cos, sin)"
        place = f"the {what} in columns {block.start} to {block.stop - 1}"
        norm = check_unit(q[:, block], f"frame {{}}: {place}".format)
        q[:, block] /= norm[:, None]
        off = float(np.abs(norm - 1.0).max())
        if off > EXACT:
            said.append(f"unit vectors in q[:, {block.start}:{block.stop}] were normalised: off by up to {off:.1g}.")
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
