"""What would help where limits prevent a motion at an instant: the least factor of friction, of torques; in units."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Protocol

import numpy as np

from rbd.arrays import Array
from rbd.constraints.contact import Contact
from rbd.control.torques import inverse_dynamics
from rbd.errors import CannotMove, RbdWarning
from rbd.model.motors import Motor
from rbd.model.state import State
from rbd.planning.stays import coefficient_of
from rbd.robots.robot import Robot
from rbd.statics.equilibrium import hold

HELPS, HALVED = 16.0, 9
"""Factors up to this are tried; how often their range is halved."""


@dataclass(frozen=True, eq=False)
class Instant:
    """A motion that is wanted at one instant.

    Attributes:
        state: The robot, with the limits that count.
        a: The acceleration, shape (nv,); None: at rest.
        stands: The contacts that stand.
    """

    state: State
    a: Array | None
    stands: Sequence[Contact]

    def check(self) -> None:
        """Raise what prevents it.

        Raises:
            CannotMove: naming the limits.
        """
        if self.a is None:
            hold(self.state, self.stands, margin=0.0)
        else:
            inverse_dynamics(self.state, self.a, self.stands, margin=0.0)

    @property
    def refused(self) -> bool:
        """Whether something prevents it."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RbdWarning)
            try:
                self.check()
            except CannotMove:
                return True
        return False

    def rougher(self, factor: float) -> Instant:
        """The same, with all coefficients of friction larger by a factor."""
        return replace(self, stands=[c.with_friction(factor * coefficient_of(c)) for c in self.stands])

    def stronger(self, factor: float) -> Instant:
        """The same, with all torque limits larger by a factor."""
        robot = self.state.robot
        assert isinstance(robot, Robot)
        return replace(self, state=self.state.on(limited(robot, factor)))

    def helps(self, error: CannotMove) -> dict[str, float]:
        """{"friction" or "torque": least factor of all of these with which it is possible}, the smallest first.

        Args:
            error: What prevents it: what it does not name does not help.
        """
        kinds = {limit.kind for limit in error.limits}
        ways = {"friction": self.rougher} if "friction" in kinds else {}
        ways |= {"torque": self.stronger} if "motor" in kinds else {}
        return least_factors(ways, HELPS, HALVED)

    def said(self, error: CannotMove, helps: dict[str, float]) -> str:
        """That in units; empty where nothing helps."""
        robot, out = self.state.robot, list[str]()
        for name, factor in helps.items():
            if name == "friction":
                named = {limit.name for limit in error.limits if limit.kind == "friction"}
                used = {c.name: coefficient_of(c) for c in self.stands if c.name in named}
                each = [f"{factor * mu:.3g} instead of {mu:.3g} of {key!r:.40}" for key, mu in list(used.items())[:2]]
            else:
                limits = dict(zip(robot.actuated_names, robot.effort_limit, strict=True))
                named = {limit.name for limit in error.limits if limit.kind == "motor"}
                used = {key: x for key, x in limits.items() if key in named}
                each = [f"{factor * x:.3g} instead of {x:.3g} N m of {key!r:.40}" for key, x in list(used.items())[:2]]
            out.append(f"{name} {factor:.3g} times as large ({', '.join(each)})")
        return f" Least would do there: {'; or '.join(out)}." if out else ""


class Refusable(Protocol):
    """What may be impossible."""

    @property
    def refused(self) -> bool:
        """Whether it is."""


def least_factors(ways: Mapping[str, Callable[[float], Refusable]], most: float, times: int) -> dict[str, float]:
    """{way: least factor above one with which nothing is refused, rounded up to 0.1 %}, the smallest first.

    Args:
        ways: {way: what a factor makes of a task}.
        most: The largest factor; ways that are refused with it are left out.
        times: How often the range of logarithms is halved.
    """
    found = dict[str, float]()
    for name, way in ways.items():
        if not way(most).refused:
            high = halved(partial(_refused, way), 0.0, float(np.log(most)), times)[1]
            found[name] = float(np.ceil(1e3 * high) / 1e3)
    return dict(sorted(found.items(), key=lambda item: item[1]))


def _refused(way: Callable[[float], Refusable], factor: float) -> bool:
    return way(factor).refused


def halved(refused: Callable[[float], bool], low: float, high: float, times: int) -> tuple[float, float]:
    """(largest factor that is refused, least that is not), by bisection of its logarithm between low and high."""
    for _ in range(times):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if refused(float(np.exp(middle))) else (low, middle)
    return float(np.exp(low)), float(np.exp(high))


def limited(robot: Robot, limits: bool | float) -> Robot:
    """The robot with a share of its torque limits; without any where they do not count."""
    if limits is True:
        return robot
    share = float(limits) or np.inf
    data = robot.motor_data
    return robot.with_motors({
        name: replace(data.get(name) or Motor(), limit=share * limit, torque_speed=_scaled(data.get(name), share))
        for name, limit in zip(robot.actuated_names, robot.effort_limit, strict=True) if limit > 0.0
    })  # fmt: skip


def _scaled(motor: Motor | None, share: float) -> list[tuple[float, float]] | None:
    line = motor and motor.torque_speed
    return [(speed, share * torque) for speed, torque in line] if line and share < np.inf else None
