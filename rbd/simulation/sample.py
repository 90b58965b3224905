"""A trajectory at one time, and the check of what a trajectory is made of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array, numbers
from rbd.errors import InputError
from rbd.model.checked_model import CheckedModel
from rbd.model.state import State


@dataclass(frozen=True, eq=False, repr=False)
class Sample:
    """A trajectory at one recorded time.

    Attributes:
        robot: The robot.
        t: Time [s].
        q: Configuration, shape (nq,).
        v: Velocity, shape (nv,) [m/s, rad/s].
        a: Acceleration, shape (nv,) [m/s2, rad/s2].
        tau: Motor torques, shape (nu,) [N, N m].
        forces: {constraint: force on the robot}, as `Trajectory.forces`.
        points: {contact: where it touches, shape (k, 3)} in W [m], those that are there at this time.
        point_forces: {contact: force at each of these, shape (k, 3)} in W [N].
        modes: {constraint: "open", "sticks", "slips", "holds" or "pushes"}.
    """

    robot: CheckedModel
    t: float
    q: Array
    v: Array
    a: Array
    tau: Array
    forces: Mapping[str, Array]
    points: Mapping[str, Array]
    point_forces: Mapping[str, Array]
    modes: Mapping[str, str]

    def __repr__(self) -> str:
        return f"Sample({self.robot.name!r}, t={self.t:g})"

    @property
    def state(self) -> State:
        """The robot at (q, v)."""
        return State(self.robot, self.q, self.v)


def kept(what: str, value: Array, shape: Sequence[int | None], *, holes: bool = False) -> Array:
    """A read-only float array of this shape: itself, if it is one.

    Args:
        what: Its name, for messages.
        value: The numbers.
        shape: Its sizes; None takes any.
        holes: Whether NaN stands for what is not there.

    Raises:
        InputError: another shape, or numbers that are not finite.
    """
    out = value
    if type(value) is not np.ndarray or value.dtype != float or value.flags.writeable:
        out = numbers(f"{what} of a trajectory", value)
        out.flags.writeable = False
    if len(out.shape) != len(shape) or any(k is not None and k != m for k, m in zip(shape, out.shape, strict=True)):
        told = ", ".join("any" if k is None else str(k) for k in shape)
        raise InputError(f"{what} of a trajectory has shape {out.shape}; expected ({told}).")
    bad = np.isinf(out) if holes else ~np.isfinite(out)
    if bad.any():
        raise InputError(f"{what} of a trajectory is not finite in sample {int(np.argwhere(bad)[0, 0])}.")
    return out


def kept_words(name: str, value: Array, n: int) -> Array:
    """A read-only array of n words.

    Raises:
        InputError: if they are not.
    """
    out = np.array(value) if not isinstance(value, np.ndarray) or value.flags.writeable else value
    if out.dtype.kind != "U" or out.shape != (n,):
        raise InputError(f"modes of {name!r:.80} are {out.dtype} of shape {out.shape}; expected {n} words.")
    out.flags.writeable = False
    return out
