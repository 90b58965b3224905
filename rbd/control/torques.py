"""Controllers: the protocol, torque schedules, and a zero-order hold of any controller."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, dataclass, field
from typing import Any, TypeAlias

import numpy as np

from rbd.arrays import Array, as_array, as_float, check_finite
from rbd.control.pushes import INSTANT
from rbd.errors import InputError
from rbd.model.state import State

Controller: TypeAlias = Callable[[State, float], Array]
"""Torques (nu,) of a state and a time [s]."""


def asked(what: str, given: Callable[[State, float], Any], state: State, t: float) -> Any:
    """What a user's function of state and time says.

    Raises:
        InputError: if it cannot be called so.
    """
    try:
        return given(state, t)
    except TypeError as error:
        raise InputError(f"{what} {given!r:.80} was called with (state, t) at t = {t:.6g} s, and failed: {error}.") from error


@dataclass(frozen=True, eq=False)
class TorqueSchedule:
    """Torques of a table of times, whatever the robot does.

    Attributes:
        times: Shape (n,) [s], increasing.
        torques: Shape (n, nu) [N, N m], one row a time.
        held: Each row stands until the next time, its own included; else straight lines go from row to row. Before the first
            time the first row stands, after the last the last.

    Raises:
        InputError: times that do not increase, sizes that do not fit, numbers that are not finite.

    >>> script = rbd.control.TorqueSchedule([0.0, 0.5, 1.0], [[0.0], [2.0], [0.0]])
    """

    times: Sequence[float] | Array
    torques: Sequence[Sequence[float]] | Array
    _: KW_ONLY
    held: bool = False

    def __post_init__(self) -> None:
        if not isinstance(self.held, bool):
            raise InputError(f"held of TorqueScript is {self.held!r:.80}; expected True or False.")
        times, torques = as_array("times of TorqueScript", self.times), as_array("torques of TorqueScript", self.torques)
        check_finite("times of TorqueScript", times)
        check_finite("torques of TorqueScript", torques)
        if times.ndim != 1 or not len(times) or (np.diff(times) <= 0.0).any():
            raise InputError(f"times of TorqueScript are {str(times.tolist()):.80}; expected one or more, increasing [s].")
        if torques.ndim != 2 or len(torques) != len(times):
            raise InputError(f"torques of TorqueScript have shape {torques.shape}; expected ({len(times)}, nu): a row a time.")
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "torques", torques)

    def __call__(self, state: State, t: float) -> Array:
        """Torques at a time [s], shape (nu,) [N, N m].

        Raises:
            InputError: the table has not one column a motor.
        """
        times, torques = np.asarray(self.times), np.asarray(self.torques)
        if torques.shape[1] != state.robot.nu:
            raise InputError(
                f"torques of TorqueScript have {torques.shape[1]} columns; {state.robot.name} has {state.robot.nu} motors: "
                "one column each, in the order of robot.actuated_names."
            )
        i = int(np.searchsorted(times, t + INSTANT, side="right")) - 1
        if i < 0 or i + 1 == len(times) or self.held:
            return torques[max(i, 0)]
        part = max(0.0, (t - times[i]) / (times[i + 1] - times[i]))
        return (1.0 - part) * torques[i] + part * torques[i + 1]


@dataclass(frozen=True, eq=False)
class ZeroOrderHold:
    """A controller that is asked once a period, its torques standing in between: a zero-order hold, as in a real robot.

    It answers with the torques of the first state that it sees in a period; so the period should be a whole number of steps of
    an integrator with steps of one length. Time that goes back, as at the start of another run, makes it ask anew, so runs
    are repeatable.

    Attributes:
        controller: What is asked.
        period: [s], e.g. 1e-3.

    Raises:
        InputError: a controller that cannot be called, a period that is not above zero.

    >>> slow = rbd.control.ZeroOrderHold(rbd.control.HoldPosture(state, robot.feet(0.7)), period=5e-3)
    """

    controller: Controller
    period: float
    _last: dict[str, tuple[int, float, Array]] = field(init=False, repr=False, default_factory=dict)

    def __post_init__(self) -> None:
        if isinstance(self.controller, type) or not callable(self.controller):
            raise InputError(f"controller is {self.controller!r:.80}; expected a function of (state, t), e.g. a TorqueScript.")
        if not 2.0 * INSTANT < as_float(self.period) < math.inf:
            raise InputError(f"period of Sampled is {self.period!r:.80}; expected a time above 0 [s].")

    def __call__(self, state: State, t: float) -> Array:
        """Torques that stand at a time [s], shape (nu,) [N, N m]."""
        sample = math.floor((t + INSTANT) / float(self.period))
        known = self._last.get("sample")
        # At its first time a sample is taken again: integrators guess the end of a step before they reach it.
        if known is None or known[0] != sample or t <= known[1] + INSTANT:
            known = (
                sample,
                t,
                as_array("torques of a sampled controller", asked("controller", self.controller, state, t)).copy(),
            )
            self._last["sample"] = known
        return known[2]
