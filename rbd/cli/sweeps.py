"""What can be swept on the command line and in study files: names, their units, and values written as text."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from rbd.arrays import Array
from rbd.errors import InputError, nearest

Values: TypeAlias = Array | list[str]
"""Values of one quantity: numbers, or words."""
Drawn: TypeAlias = tuple[float, float] | list[str]
"""What is drawn at random: a number of a range, or a word."""
FORM = "FROM:TO:N (N values, both ends included) or A,B,C"
MOST_VALUES = 10_000_000
_WORDS, _NUMBERS, _WHOLE = "words", "numbers", "whole numbers"


@dataclass(frozen=True)
class Quantity:
    """What can differ from sample to sample, or is the same in all of them.

    Attributes:
        name: As users write it, "push.y".
        unit: "" where it has none.
        kind: Words, numbers or whole numbers.
        about: What it is.
        question: The only question to which it belongs; "" of both.
    """

    name: str
    unit: str
    kind: str
    about: str
    question: str = ""

    @property
    def argument(self) -> str:
        """The function's argument, and the dataset's dimension."""
        return argument_of(self.name)


QUANTITIES = {
    each.name: each
    for each in (
        Quantity("robot", "", _WORDS, "the robot"),
        Quantity("posture", "", _WORDS, "its posture"),
        Quantity("friction", "1", _NUMBERS, "Coulomb's coefficient at the feet"),
        Quantity("at", "", _WORDS, "the frame that is pushed"),
        Quantity("push", "N", _NUMBERS, "size of the push along --push X,Y,Z"),
        Quantity("push.angle", "deg", _NUMBERS, "direction of push in the level plane, from x towards y"),
        Quantity("push.x", "N", _NUMBERS, "the push along x"),
        Quantity("push.y", "N", _NUMBERS, "the push along y"),
        Quantity("push.z", "N", _NUMBERS, "the push along z"),
        Quantity("margin", "1", _NUMBERS, "share of friction that stays unused", "stand"),
        Quantity("facets", "1", _WHOLE, "facets of pyramids inside the friction cones, in place of the cones", "stand"),
        Quantity("law", "", _WORDS, "of contacts that slip: coulomb or convex", "solve"),
    )
}
"""{name: quantity} of the questions about a robot on its feet."""
COMPONENTS = ("push.x", "push.y", "push.z")
QUESTIONS = {
    "stand": "whether any motor torques withstand the push",
    "solve": "motion and forces under the torques that hold the robot without the push",
}
"""{question of a study: what it asks}."""


def argument_of(name: str) -> str:
    """The argument that a name stands for: push.y is push_y."""
    return name.replace(".", "_")


def quantity_of(name: str, question: str, what: str) -> Quantity:
    """The quantity of a name, "push.y" or "push_y".

    Args:
        name: As written.
        question: "stand" or "solve".
        what: Where it is written, for messages.

    Raises:
        InputError: an unknown name, with the nearest ones; a name of the other question.
    """
    ours = {each.argument: each for each in QUANTITIES.values()}
    found = ours.get(argument_of(name))
    if found is None:
        fit = [each.name for each in QUANTITIES.values() if each.question in ("", question)]
        raise InputError(f"{what}: {name!r:.80} cannot be swept; {nearest(name, fit)}.")
    if found.question not in ("", question):
        why = f"it has no effect on {QUESTIONS[question]}"
        raise InputError(
            f'{what}: {found.name} belongs to the question "{found.question}" and not to "{question}": {why}. '
            f'A study file with question = "{found.question}" takes it (rbd study --help).'
        )
    return found


def sweeps_of(options: Iterable[str], question: str) -> dict[str, Values]:
    """{name: values} of the options `--sweep NAME=VALUES`.

    Args:
        options: Their texts, "friction=0.1:1:19".
        question: What is studied.

    Raises:
        InputError: no equals sign, unknown names, a name twice, values that cannot be read.
    """
    found: dict[str, Values] = {}
    for text in options:
        name, equals, values = text.partition("=")
        if not equals or not name.strip():
            raise InputError(
                f"--sweep is {text!r:.80}; expected NAME=VALUES, e.g. friction=0.1:1:19 or at=base_link,torso_2_link."
            )
        quantity = quantity_of(name.strip(), question, "--sweep")
        if quantity.name in found:
            raise InputError(f"--sweep {quantity.name} came twice; give all of its values at once, {quantity.name}={FORM}.")
        found[quantity.name] = as_kind(quantity, values_of(values, f"--sweep {quantity.name}"), f"--sweep {quantity.name}")
    return found


def values_of(given: object, what: str) -> Values:
    """Values from text, "0.1:1:19" or "0.1,0.5" or "coulomb,convex", or from a list of numbers or of words.

    Args:
        given: Text or a list.
        what: Where it is written, for messages.

    Returns:
        Numbers, shape (n,), or words; each once.

    Raises:
        InputError: what cannot be read, numbers that are not finite, values that occur twice, none at all.
    """
    if isinstance(given, str):
        return _different(_from_text(given, what), what)
    if not isinstance(given, Sequence) or isinstance(given, str | bytes):
        raise InputError(f"{what} is {given!r:.80}; expected {FORM} as text, or a list of values.")
    values = list(given)
    if values and all(isinstance(value, str) for value in values):
        return _different([str(value) for value in values], what)
    if not values or not all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
        raise InputError(f"{what} is {given!r:.80}; expected a list of numbers, or a list of words.")
    return _different(_finite(np.array(values, float), given, what), what)


def as_kind(quantity: Quantity, values: Values, what: str) -> Values:
    """The values as those of a quantity: words, numbers, or whole numbers.

    Raises:
        InputError: words where numbers are expected.
    """
    if quantity.kind == _WORDS:
        if isinstance(values, list):
            return values
        raise InputError(f"{what} has numbers; expected words, {quantity.about}: {quantity.name}=A,B.")
    if isinstance(values, list):
        unit = f" in {quantity.unit}" if quantity.unit not in ("", "1") else ""
        raise InputError(f"{what} is {','.join(values)!r:.80}; expected numbers{unit}: {FORM}.")
    if quantity.kind == _WHOLE:
        if (values != np.round(values)).any():
            raise InputError(f"{what} has {values[values != np.round(values)][0]:g}; expected whole numbers.")
        return values.astype(np.int64)
    return values


def _from_text(text: str, what: str) -> Values:
    if ":" in text:
        return _spaced(text, what)
    words = [word.strip() for word in text.split(",")]
    if not all(words):
        raise InputError(f"{what} is {text!r:.80}; expected {FORM}.")
    numbers = [_number(word) for word in words]
    if all(x is None for x in numbers):
        return words
    if wrong := [word for word, x in zip(words, numbers, strict=True) if x is None]:
        raise InputError(f"{what} is {text!r:.80}, and {wrong[0]!r} is no number; expected {FORM}.")
    return _finite(np.array(numbers, float), text, what)


def _spaced(text: str, what: str) -> Array:
    """N values of "FROM:TO:N"."""
    parts = [_number(part) for part in text.split(":")]
    expected = f"expected {FORM}, e.g. 0.1:1:19"
    if len(parts) != 3 or any(x is None or not math.isfinite(x) for x in parts):
        raise InputError(f"{what} is {text!r:.80}; {expected}.")
    low, high, count = (float(x) for x in parts if x is not None)
    if count != round(count) or not 2 <= count <= MOST_VALUES:
        raise InputError(f"{what} is {text!r:.80}, of {count:g} values; expected a whole number from 2 to {MOST_VALUES:,}.")
    if low == high:
        raise InputError(f"{what} is {text!r:.80}: both ends are {low:g}; expected two different ones.")
    return np.linspace(low, high, int(count))


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def _finite(values: Array, given: object, what: str) -> Array:
    if not (np.abs(values) < 1e150).all():
        raise InputError(f"{what} is {given!r:.80}; expected finite numbers.")
    return values


def _different(values: Values, what: str) -> Values:
    seen, counts = np.unique(np.asarray(values), return_counts=True)
    if (counts > 1).any():
        twice = seen[counts > 1][0]
        raise InputError(f"{what} has {twice!s:.80} twice; give each value once.")
    return values


def ranges_of(given: Mapping[str, object], where: Mapping[str, str]) -> dict[str, Drawn]:
    """{name: (low, high)} of random draws, from "0.1:1" or [0.1, 1]; of words, those to choose from.

    Args:
        given: {name: text or list}.
        where: {name: where it is written}, for messages.

    Raises:
        InputError: what is no range.
    """
    found: dict[str, Drawn] = {}
    for name, value in given.items():
        ends = [_number(x) for x in value.split(":")] if isinstance(value, str) else value
        if isinstance(ends, list) and len(ends) > 1 and all(isinstance(x, str) for x in ends):
            found[name] = [str(x) for x in _different(ends, where[name])]
            continue
        numbers = isinstance(ends, list) and all(isinstance(x, int | float) and not isinstance(x, bool) for x in ends)
        if not isinstance(ends, list) or not numbers or len(ends) != 2 or not -1e150 < ends[0] < ends[1] < 1e150:
            raise InputError(f'{where[name]} is {value!r:.80}; expected a range, [LOW, HIGH] or "LOW:HIGH", LOW below HIGH.')
        found[name] = (float(ends[0]), float(ends[1]))
    return found
