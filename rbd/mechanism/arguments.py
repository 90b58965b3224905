"""Checks of the settings that functions of mechanisms take."""

from __future__ import annotations

import numpy as np

from rbd.arrays import as_float
from rbd.errors import InputError
from rbd.model.state import State


def check_state(state: State) -> State:
    """The state itself.

    Raises:
        InputError: it is none.
    """
    if not isinstance(state, State):
        raise InputError(f"a State of a robot was expected first, got {state!r:.80}. Make one: rbd.State(robot, q).")
    return state


def check_seed(seed: int) -> int:
    """A seed of draws.

    Raises:
        InputError: no whole number from 0.
    """
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or not 0 <= seed < 2**63:
        raise InputError(f"seed is {seed!r:.80}; expected a whole number from 0 to 2^63 - 1.")
    return int(seed)


def check_positive(what: str, value: float, most: float) -> float:
    """A number in (0, most].

    Raises:
        InputError: it is none.
    """
    found = as_float(value)
    if not 0.0 < found <= most:
        raise InputError(f"{what} is {value!r:.80}; expected a number above 0, at most {most:g}.")
    return found


def check_whole(what: str, value: int, most: int = 1_000_000) -> int:
    """A whole number from 1.

    Raises:
        InputError: it is none, or too large.
    """
    if isinstance(value, bool) or not isinstance(value, int) or not 0 < value <= most:
        raise InputError(f"{what} is {value!r:.80}; expected a whole number from 1 to {most}.")
    return value


def check_descent(tolerance: float, max_iterations: int, what: str = "max_iterations") -> None:
    """Refuse settings that are none.

    Raises:
        InputError: with what was expected.
    """
    if not 0.0 < as_float(tolerance) <= 1e-3:
        raise InputError(f"tolerance is {tolerance!r:.80}; expected a number > 0, at most 1e-3 [m, rad].")
    check_whole(what, max_iterations, 100_000)


def check_flag(what: str, value: bool) -> None:
    """Refuse what is neither True nor False.

    Raises:
        InputError: with what was expected.
    """
    if not isinstance(value, bool | np.bool_):
        raise InputError(f"{what} is {value!r:.80}; expected True or False.")
