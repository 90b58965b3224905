"""Sliders and choices of a live page, and what pages send of them: read with suspicion."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

from rbd.arrays import as_float
from rbd.displayed import Displayed
from rbd.errors import InputError

LARGEST_MESSAGE = 4000
"""Largest message of a page that is read, in characters."""
LARGEST_VALUE = 1e12
MOST_NAMES, LONGEST_NAME = 200, 80
_STEPS = 200


@dataclass(frozen=True, slots=True)
class Slider(Displayed):
    """A number that the page's visitor sets between two bounds.

    Attributes:
        name: Its name on the page, and in the values.
        low: Least value.
        high: Largest value.
        value: At first.
        unit: Written after the number.
        step: Distance of neighbouring values; by default the round number nearest to 1/200 of the range.

    Raises:
        InputError: no name, numbers that are not finite, low not below high, a value outside.

    Example:
        >>> rbd.visual.Slider("push", 0.0, 200.0, 50.0, unit="N").step
        1.0
    """

    name: str
    low: float
    high: float
    value: float
    unit: str = ""
    step: float | None = None

    def __post_init__(self) -> None:
        """Check, and fill in the step."""
        check_name(self.name)
        if not isinstance(self.unit, str) or len(self.unit) > LONGEST_NAME:
            raise InputError(f"the unit of {self.name!r} is {self.unit!r:.80}; expected a short text.")
        for what in ("low", "high", "value"):
            number = as_float(getattr(self, what))
            if not abs(number) <= LARGEST_VALUE:
                raise InputError(f"{what} of {self.name!r} is {getattr(self, what)!r:.80}; expected a finite number.")
            object.__setattr__(self, what, number)
        if not self.low < self.high or not self.low <= self.value <= self.high:
            raise InputError(
                f"{self.name!r} goes from {self.low:g} to {self.high:g} and starts at {self.value:g}; expected low < high and "
                "a value between them."
            )
        step = _round_step((self.high - self.low) / _STEPS) if self.step is None else as_float(self.step)
        if not 0.0 < step <= self.high - self.low:
            raise InputError(f"step of {self.name!r} is {self.step!r:.80}; expected a number above 0, within the range.")
        object.__setattr__(self, "step", step)

    def read(self, given: object) -> float | None:
        """A value from outside, cut at the bounds; None for what is no number."""
        if isinstance(given, bool) or not isinstance(given, int | float):
            return None
        try:
            number = float(given)
        except OverflowError:
            return None
        return None if math.isnan(number) else min(max(number, self.low), self.high)

    def data(self) -> dict[str, object]:
        """What the page needs, without the value."""
        return {"kind": "slider", "name": self.name, "low": self.low, "high": self.high, "unit": self.unit, "step": self.step}


@dataclass(frozen=True, slots=True)
class Choice(Displayed):
    """One of some names that the page's visitor picks.

    Attributes:
        name: Its name on the page, and in the values.
        options: What there is to pick.
        value: At first; by default the first option.

    Raises:
        InputError: no name, no options or two alike, a value that is none of them.

    Example:
        >>> rbd.visual.Choice("law", ("coulomb", "convex")).value
        'coulomb'
    """

    name: str
    options: tuple[str, ...]
    value: str = ""

    def __post_init__(self) -> None:
        """Check, and fill in the value."""
        check_name(self.name)
        given: Any = self.options
        options = () if isinstance(given, str) or not isinstance(given, Sequence) else tuple(given)
        if not 1 <= len(options) <= MOST_NAMES or not all(isinstance(o, str) and 0 < len(o) <= LONGEST_NAME for o in options):
            raise InputError(f"options of {self.name!r} are {given!r:.80}; expected 1 to {MOST_NAMES} short names in a list.")
        if len(set(options)) < len(options):
            raise InputError(f"options of {self.name!r} name one twice: {', '.join(options):.200}.")
        value = options[0] if isinstance(self.value, str) and not self.value else self.value
        if not isinstance(value, str) or value not in options:
            raise InputError(f"{self.name!r} starts at {value!r:.80}; expected one of {', '.join(options):.300}.")
        object.__setattr__(self, "options", options)
        object.__setattr__(self, "value", value)

    def read(self, given: object) -> str | None:
        """A value from outside, if it is an option; else None."""
        return given if isinstance(given, str) and given in self.options else None

    def data(self) -> dict[str, object]:
        """What the page needs, without the value."""
        return {"kind": "choice", "name": self.name, "options": list(self.options)}


Control: TypeAlias = Slider | Choice


@dataclass(frozen=True, slots=True)
class Request:
    """What a page asks for.

    Attributes:
        values: {control: its value}, of those that are to change; all within their bounds.
        asked: Which page asks, and its how many-th question this is: given back with the answer.
    """

    values: Mapping[str, float | str]
    asked: tuple[int, int]


def check_name(name: object) -> None:
    """Refuse what is no short name.

    Raises:
        InputError: it is none.
    """
    if not isinstance(name, str) or not 0 < len(name) <= LONGEST_NAME:
        raise InputError(f"a control's name is {name!r:.80}; expected a short text, as 'push'.")


def checked_controls(controls: object) -> dict[str, Control]:
    """{name: control}.

    Raises:
        InputError: what is no list of controls, or two of one name.
    """
    given: Any = [controls] if isinstance(controls, Slider | Choice) else controls
    if not isinstance(given, Sequence | Iterator) or isinstance(given, str):
        raise InputError(f"controls are {controls!r:.80}; expected a list of rbd.visual.Slider and rbd.visual.Choice.")
    out: dict[str, Control] = {}
    for control in given:
        if not isinstance(control, Slider | Choice):
            raise InputError(f"controls hold {control!r:.80}; expected rbd.visual.Slider or rbd.visual.Choice.")
        if control.name in out:
            raise InputError(f"two controls are named {control.name!r}; expected different names.")
        out[control.name] = control
    if not 1 <= len(out) <= MOST_NAMES:
        raise InputError(f"there are {len(out)} controls; expected 1 to {MOST_NAMES}.")
    return out


def read_request(message: str, controls: Mapping[str, Control]) -> Request | None:
    """What a message asks for; None if it asks for nothing that there is.

    Unknown names and values that are none are ignored, numbers are cut at their bounds. It raises nothing, for any text.

    Args:
        message: JSON, as {"set": {name: value}, "asked": [page, number]}.
        controls: {name: control} of what there is.
    """
    if len(message) > LARGEST_MESSAGE:
        return None
    try:
        told = json.loads(message)
    except (ValueError, RecursionError):
        return None
    if not isinstance(told, dict) or not isinstance(wanted := told.get("set"), dict):
        return None
    values = {}
    for name, given in wanted.items():
        if name in controls and (value := controls[name].read(given)) is not None:
            values[name] = value
    return Request(values, _asked(told.get("asked"))) if values else None


def _asked(given: Any) -> tuple[int, int]:
    if isinstance(given, list) and len(given) == 2 and all(type(n) is int and 0 <= n < 2**32 for n in given):
        return given[0], given[1]
    return 0, 0


def _round_step(step: float) -> float:
    """The nearest of 1, 2 and 5 times a power of ten, in ratio."""
    power = 10.0 ** math.floor(math.log10(step))
    return float(f"{min((power * m for m in (1.0, 2.0, 5.0, 10.0)), key=lambda s: abs(math.log(s / step))):.1g}")
