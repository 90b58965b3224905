"""Numbers, points, names, colours and mappings of a builder or a loop file, checked one by one; and how files write numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from rbd.arrays import Array, as_float
from rbd.errors import InputError, ModelError, nearest
from rbd.errors.inputs import check_choice, check_kind, shown
from rbd.model.urdf import FARTHEST, LARGEST, LONGEST_NAME

Triple = tuple[float, float, float]
Check = Callable[[str, Any], Any]
"""What a value is, for messages, and the value: gives it checked, or refuses it."""

COLORS = {"grey": "0.35 0.37 0.40 1", "orange": "0.90 0.45 0.10 1", "blue": "0.16 0.42 0.66 1", "green": "0.24 0.58 0.36 1",
          "red": "0.75 0.22 0.20 1", "violet": "0.48 0.36 0.66 1", "steel": "0.75 0.77 0.80 1"}  # fmt: skip
"""Colours by name: red, green, blue and opacity, from 0 to 1."""


@contextmanager
def in_file(where: str) -> Iterator[None]:
    """What is refused inside is a fault of a file: the message begins with its name, and the place in it.

    Raises:
        ModelError: in place of an InputError.
    """
    try:
        yield
    except InputError as error:
        raise ModelError(f"{where}: {error}") from None


def checked_name(what: str, value: object) -> str:
    """A name.

    Raises:
        InputError: no string, an empty one, one that is too long or that no file can hold.
    """
    if not isinstance(value, str) or not value.strip():
        raise InputError(f"{what} is {shown(value)}; expected a name.")
    if len(value) > LONGEST_NAME:
        raise InputError(f"{what} is {value[:40]!r}..., {len(value)} letters; expected {LONGEST_NAME} at most.")
    if not value.isprintable():
        raise InputError(f"{what} is {value!r:.80}; expected a name of printable characters.")
    return value


def checked_names(what: str, value: Any) -> tuple[str, ...]:
    """A list of names.

    Raises:
        InputError: no list, or what `checked_name` refuses in it.
    """
    check_kind(what, value, list | tuple, "a list of names")
    return tuple(checked_name(f"{what}[{i}]", each) for i, each in enumerate(value))


def checked_mapping(what: str, value: Any) -> Mapping[str, Any]:
    """Values by their names.

    Raises:
        InputError: no mapping, or a key that is no name.
    """
    check_kind(what, value, Mapping, "`key: value` pairs")
    for key in value:
        checked_name(f"a key of {what}", key)
    return value


def checked_entry(
    what: str, value: object, checks: Mapping[str, Check], needed: Sequence[str] = (), of: str | None = None
) -> dict[str, Any]:
    """A mapping's values, each checked by its key.

    Args:
        what: What the mapping is, for messages.
        value: The mapping.
        checks: {key that is known: check of its value}.
        needed: Keys that must be there.
        of: What the values belong to, for messages about them: " of " and `what` by default.

    Raises:
        InputError: no mapping; an unknown key, with the nearest one; a key that is missing; what a check refuses.
    """
    entry = checked_mapping(what, value)
    for key in entry:
        if key not in checks:
            raise InputError(f"{what} has a key {key!r:.80}; {nearest(key, checks)}. Expected some of {', '.join(checks)}.")
    for key in needed:
        if key not in entry:
            raise InputError(f"{what} has no {key!r}; expected {', '.join(needed)}.")
    of = f" of {what}" if of is None else of
    return {key: checks[key](f"{key}{of}", each) for key, each in entry.items()}


def checked_number(what: str, value: object, *, least: float | None = None, most: float = LARGEST) -> float:
    """A finite number within bounds.

    Raises:
        InputError: no number, or one beyond these bounds.
    """
    number = as_float(value)
    if not (-most if least is None else least) <= number <= most:
        bounds = f"a finite number, at most {most:g}" if least is None else f"a finite number from {least:g} to {most:g}"
        raise InputError(f"{what} is {shown(value)}; expected {bounds}.")
    return number + 0.0  # no negative zero in files


def checked_numbers(
    what: str, value: object, counts: Sequence[int], *, least: float | None = None, most: float = LARGEST
) -> tuple[float, ...]:
    """Finite numbers, as many as one of `counts` says.

    Args:
        what: What they are, for messages.
        value: The numbers.
        counts: How many there may be.
        least: The smallest that is taken; by default minus `most`.
        most: The largest that is taken.

    Raises:
        InputError: another number of them, or what is no finite number within bounds.
    """
    try:
        given = [as_float(x) for x in value]  # type: ignore[attr-defined]
    except TypeError:
        given = []
    low = -most if least is None else least
    if isinstance(value, str | bytes) or len(given) not in counts or not all(low <= x <= most for x in given):
        expected = " or ".join(str(count) for count in counts) if len(counts) < 4 else f"{min(counts)} to {max(counts)}"
        bounds = f", at most {most:g}" if least is None else f" from {least:g} to {most:g}"
        raise InputError(f"{what} is {value!r:.120}; expected {expected} finite numbers{bounds}.")
    return tuple(x + 0.0 for x in given)


def checked_triple(what: str, value: object) -> Triple:
    """Three finite numbers, each of at most `FARTHEST`.

    Raises:
        InputError: as `checked_numbers`.
    """
    x, y, z = checked_numbers(what, value, (3,), most=FARTHEST)
    return x, y, z


def checked_values(what: str, value: object, counts: Sequence[int] = range(1, 8)) -> float | tuple[float, ...]:
    """A finite number, or several: an angle, or a joint's part of q.

    Raises:
        InputError: neither.
    """
    several = isinstance(value, list | tuple) or getattr(value, "shape", ()) != ()
    return checked_numbers(what, value, counts) if several else checked_number(what, value)


def checked_plain(what: str, value: object) -> str | bool | float | tuple[float, ...]:
    """A string, a truth value, a number, or a list of numbers.

    Raises:
        InputError: none of them.
    """
    if isinstance(value, bool):
        return value
    return checked_name(what, value) if isinstance(value, str) else checked_values(what, value, range(1000))


def checked_axis(what: str, value: object) -> Triple:
    """A direction, of length one.

    Raises:
        InputError: no vector of three numbers, or the zero vector.
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
        InputError: an unknown name, with the nearest; other numbers than three or four from 0 to 1.
    """
    if isinstance(value, str):
        return check_choice(what, value, COLORS)
    return spaced((*checked_numbers(what, value, (3, 4), least=0.0, most=1.0), 1.0)[:4])


def written(value: float) -> str:
    """A number with all its digits, whole numbers without a point."""
    return f"{value:.0f}" if value == round(value) and abs(value) < 1e15 else repr(value)


def spaced(values: Iterable[float] | Array) -> str:
    """Numbers with all their digits, blanks between them."""
    return " ".join(written(float(x) + 0.0) for x in values)
