"""Numbers, points, names and colours that a user of the builder gives, checked one by one."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from rbd.arrays import Array, as_float
from rbd.errors import InputError, nearest
from rbd.model.urdf import FARTHEST, LARGEST, LONGEST_NAME

Triple = tuple[float, float, float]

COLORS = {"grey": "0.35 0.37 0.40 1", "orange": "0.90 0.45 0.10 1", "blue": "0.16 0.42 0.66 1", "green": "0.24 0.58 0.36 1",
          "red": "0.75 0.22 0.20 1", "violet": "0.48 0.36 0.66 1", "steel": "0.75 0.77 0.80 1"}  # fmt: skip
"""Colours by name: red, green, blue and opacity, from 0 to 1."""


def checked_name(what: str, value: object) -> str:
    """A name.

    Raises:
        InputError: no string, an empty one, one that is too long or that no file can hold.
    """
    if not isinstance(value, str) or not value.strip():
        raise InputError(f"{what} is {value!r:.80}; expected a name.")
    if len(value) > LONGEST_NAME:
        raise InputError(f"{what} is {value[:40]!r}..., {len(value)} letters; expected {LONGEST_NAME} at most.")
    if not value.isprintable():
        raise InputError(f"{what} is {value!r:.80}; expected a name of printable characters.")
    return value


def checked_choice(what: str, value: object, known: Iterable[str]) -> str:
    """One of some words.

    Raises:
        InputError: with the nearest of them.
    """
    known = list(known)
    if not isinstance(value, str) or value not in known:
        raise InputError(f"{what} is {value!r:.80}; {nearest(value, known)}. Expected one of {', '.join(known)}.")
    return value


def checked_number(what: str, value: object, *, least: float = -LARGEST, most: float = LARGEST) -> float:
    """A finite number within bounds.

    Raises:
        InputError: with what came and what was expected.
    """
    number = as_float(value)
    if not least <= number <= most:
        bounds = f"a finite number from {least:g} to {most:g}" if least > -LARGEST else f"a finite number, at most {most:g}"
        raise InputError(f"{what} is {value!r:.80}; expected {bounds}.")
    return number + 0.0  # no negative zero in files


def checked_truth(what: str, value: object) -> bool:
    """True or False.

    Raises:
        InputError: any other value.
    """
    if not isinstance(value, bool | np.bool_):
        raise InputError(f"{what} is {value!r:.80}; expected True or False.")
    return bool(value)


def checked_triple(what: str, value: object, *, most: float = FARTHEST) -> Triple:
    """Three finite numbers.

    Raises:
        InputError: with what came and what was expected.
    """
    x, y, z = checked_numbers(what, value, (3,), most=most)
    return x, y, z


def checked_numbers(what: str, value: object, counts: Sequence[int], *, most: float = LARGEST) -> tuple[float, ...]:
    """So many finite numbers.

    Args:
        what: For messages.
        value: What the user gave.
        counts: Allowed numbers of entries.
        most: Largest magnitude.

    Raises:
        InputError: with what came and what was expected.
    """
    try:
        given = [as_float(x) for x in value]  # type: ignore[attr-defined]
    except TypeError:
        given = []
    if isinstance(value, str | bytes) or len(given) not in counts or not all(abs(x) <= most for x in given):
        expected = " or ".join(str(count) for count in counts)
        raise InputError(f"{what} is {value!r:.120}; expected {expected} finite numbers, at most {most:g}.")
    return tuple(x + 0.0 for x in given)


def checked_axis(what: str, value: object) -> Triple:
    """A direction, of length one.

    Raises:
        InputError: no three finite numbers, or an axis of length zero.
    """
    axis = np.array(checked_triple(what, value))
    length = float(np.linalg.norm(axis))
    if length < 1e-9:
        raise InputError(f"{what} is {value!r:.80}, of length {length:g}; expected a direction, e.g. (0, 0, 1).")
    if abs(length - 1.0) > 1e-15:
        axis = axis / length
    x, y, z = (float(each) + 0.0 for each in axis)
    return x, y, z


def checked_color(what: str, value: object) -> str:
    """The name of a colour, or "red green blue opacity" as a URDF has it.

    Raises:
        InputError: an unknown name, or no three or four numbers from 0 to 1.
    """
    if isinstance(value, str):
        return checked_choice(what, value, COLORS)
    rgba = checked_numbers(what, value, (3, 4), most=1.0)
    if min(rgba) < 0.0:
        raise InputError(f"{what} is {value!r:.80}; expected numbers from 0 to 1.")
    return spaced((*rgba, 1.0)[:4])


def written(value: float) -> str:
    """A number with all its digits, whole numbers without a point."""
    return f"{value:.0f}" if value == round(value) and abs(value) < 1e15 else repr(value)


def spaced(values: Iterable[float] | Array) -> str:
    """Numbers with all their digits, blanks between them."""
    return " ".join(written(float(x) + 0.0) for x in values)
