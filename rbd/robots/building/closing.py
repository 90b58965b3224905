"""Entries of a loop file: loops, couplings, wheels and postures, each checked by itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rbd.constraints.loop import KINDS as CLOSURES
from rbd.errors import InputError
from rbd.robots import loop_file
from rbd.robots.building.numbers import (
    checked_axis,
    checked_choice,
    checked_name,
    checked_number,
    checked_numbers,
)

WHEELS = ("rolling_wheel", "rolling_disk", "rolling_ball", "knife_edge")
"""Kinds of wheels."""


def loop_direction(name: str, kind: object, axis: object) -> dict[str, Any]:
    """The axis of a loop of a checked kind; empty for kinds that have none.

    Raises:
        InputError: an unknown kind, an axis of zero length.
    """
    sort = checked_choice(f"kind of loop {name!r:.80}", kind, CLOSURES)
    direction = checked_axis(f"axis of loop {name!r:.80}", axis)
    return {"axis": direction} if sort in ("revolute", "planar") else {}


def coupling_entry(name: str, joint: object, to: object, ratio: object, offset: object) -> dict[str, Any]:
    """A coupling of two joints.

    Raises:
        InputError: names or numbers that are wrong.
    """
    ends = {"joint": checked_name(f"the joint of {name!r:.80}", joint), "to": checked_name(f"`to` of {name!r:.80}", to)}
    numbers = {key: checked_number(f"{key} of {name!r:.80}", x) for key, x in (("ratio", ratio), ("offset", offset))}
    return {"name": name, **ends, **numbers}


def wheel_entry(name: str, kind: object, frame: object, **given: object) -> dict[str, Any]:
    """A wheel, ball, disk or knife edge on the ground.

    Args:
        name: Of the wheel.
        kind: One of `WHEELS`.
        frame: At its centre.
        given: radius, axis, direction; None where not given.

    Raises:
        InputError: an unknown kind, a radius that is missing, numbers that are wrong or not of this kind.
    """
    what = f"wheel {name!r:.80}"
    word = checked_choice(f"kind of {what}", kind, WHEELS)
    entry: dict[str, Any] = {"name": name, "kind": word, "frame": checked_name(f"the frame of {what}", frame)}
    known = loop_file.KINDS[word]
    for key, value in given.items():
        if value is None and key in known.needed:
            raise InputError(f"{what} has no {key}; a {word} needs one.")
        if value is not None and key not in known.keys:
            raise InputError(f"{what} has {key}={value!r:.60}; a {word} has {', '.join(known.keys)}.")
        if value is not None:
            said = f"{key} of {what}"
            entry[key] = checked_number(said, value, least=1e-9) if key == "radius" else checked_axis(said, value)
    return entry


def user_entry(name: str, kind: object, keys: Mapping[str, object]) -> dict[str, Any]:
    """A user's kind of constraint, which was registered.

    Raises:
        InputError: a kind that is not registered; values that are no text, truth, number or numbers.
    """
    word = checked_choice(f"kind of {name!r:.80}", kind, [word for word, known in loop_file.KINDS.items() if not known.part])
    entry: dict[str, Any] = {"name": name, "kind": word}
    for key, value in keys.items():
        entry[key] = value if isinstance(value, str | bool) else _numbers(f"{key} of {name!r:.80}", value, range(1000))
    return entry


def posture_value(posture: str, joint: object, value: object) -> float | tuple[float, ...]:
    """A joint's value or values in a posture.

    Raises:
        InputError: no name, no numbers.
    """
    return _numbers(f"{checked_name('a joint of a posture', joint)!r:.80} of posture {posture!r:.80}", value, range(1, 8))


def _numbers(what: str, value: object, counts: Sequence[int]) -> float | tuple[float, ...]:
    several = isinstance(value, Sequence) or getattr(value, "shape", ()) != ()
    return checked_numbers(what, value, counts) if several else checked_number(what, value)
