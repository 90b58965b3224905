"""The meaning of the columns of a table: times, a base, joints; by the names in its header, or by their number."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rbd.arrays import Array
from rbd.errors import InputError, nearest
from rbd.model.checked_model import CheckedModel
from rbd.motion.joint_orders import checked_joints, formats, single_joints

BASE = 7
"""Columns of a floating base: x, y, z, and a quaternion."""
TIMES = "the first column increases and was taken for times [s]."
"""The note of a table without a header that has one column more than a format."""
_TIME = re.compile(r"(t|time|times|timestamp|seconds)([ _]?[\[(]?(s|sec)[\])]?)?$")
_COUNTED = re.compile(r"(frame|frames|index|frame_id|frame_index|#|)$")
_BASE = r"(?:(?:root|base|pelvis|floating_base|free_?flyer|root_joint|body)[ _./]?)?"
_PLACE = re.compile(_BASE + r"(?:pos|position|trans|translate|p|t)?[ _./]?([xyz])$")
_TURN = re.compile(_BASE + r"(?:q|quat|quaternion|rot|rotation|orientation)[ _./]?([xyzw])$")


@dataclass(frozen=True, eq=False)
class Columns:
    """What is where in a table.

    Attributes:
        time: The column of times; None without one.
        place: Columns of x, y, z of a floating base; empty of a robot without one.
        turn: Columns of its quaternion, in the order x, y, z, w if `named`, else in the order of the file.
        named: Whether the header names the parts of the quaternion.
        joints: {joint: its column}.
        notes: What was guessed, in words.
    """

    time: int | None
    place: tuple[int, ...]
    turn: tuple[int, ...]
    named: bool
    joints: dict[str, int]
    notes: tuple[str, ...]


def columns_of_header(robot: CheckedModel, names: Sequence[str], path: Path) -> Columns:
    """Columns by the names of a header: time, root x y z, quaternion, joints of the robot.

    Raises:
        InputError: a name that the robot lacks, one twice, a base without all its columns.
    """
    known, found = single_joints(robot), dict[str, int]()
    parts, notes, passed = dict[str, int](), [], []
    for k, name in enumerate(names):
        joint, word = _joint(name, known), name.lower().strip()
        place, turn = _PLACE.match(word), _TURN.match(word)
        if joint is not None:
            key = joint
        elif _TIME.match(word):
            key = "time"
        elif _COUNTED.match(word):
            passed.append(name or f"column {k + 1}")
            continue
        elif turn or place:
            key = f"q{turn[1]}" if turn else place[1] if place else ""
        else:
            wanted = [*known, "t", "root_x", "root_qw"]
            raise InputError(
                f"{path.name}: column {k + 1} is named {name!r:.80}, which {robot.name} has no joint for; "
                f"{nearest(name, wanted)}. Leave the column out, or give another robot."
            )
        where = found if joint is not None else parts
        if key in where:
            raise InputError(f"{path.name}: columns {where[key] + 1} and {k + 1} are both {key!r:.80}. Leave one out.")
        where[key] = k
    if passed:
        notes.append(f"columns that only count frames are not read: {', '.join(passed)}.")
    place_at: tuple[int, ...] = ()
    turn_at: tuple[int, ...] = ()
    if robot.floating:
        missing = [word for word in ("x", "y", "z", "qx", "qy", "qz", "qw") if word not in parts]
        if missing:
            raise InputError(
                f"{path.name}: its header has no column of the base for {', '.join(missing)}; expected root_x, root_y, "
                "root_z [m], root_qx, root_qy, root_qz, root_qw. Angles of Euler are not read."
            )
        place_at = tuple(parts[word] for word in "xyz")
        turn_at = tuple(parts[word] for word in ("qx", "qy", "qz", "qw"))
    elif set(parts) - {"time"}:
        notes.append(f"{robot.name} has no floating base; the columns of one are not read.")
    return Columns(parts.get("time"), place_at, turn_at, True, found, tuple(notes))


def columns_by_number(robot: CheckedModel, numbers: Array, joints: Sequence[str] | None, path: Path) -> Columns:
    """Columns of a table without a header: root x y z, quaternion, joints in the order of a format with as many.

    A column more, that increases, in front is one of times.

    Raises:
        InputError: no format has this number of columns; the message lists the formats.
    """
    width, base = numbers.shape[1], BASE if robot.floating else 0
    if (
        robot.bases
        and not robot.floating
        or any(robot.joints[n].nv > 1 for n in robot.joints if robot.joints[n].id not in robot.bases)
    ):
        raise InputError(
            f"{path.name}: {robot.name} has joints of several degrees of freedom; give arrays to Motion.of_arrays."
        )
    known = formats(robot) if joints is None else {"the joints that were given": checked_joints(robot, joints)}
    notes: list[str] = []
    for shift in (0, 1):
        for what, order in known.items():
            if width != shift + base + len(order):
                continue
            if shift and not (np.diff(numbers[:, 0]) > 0.0).all():
                raise InputError(
                    f"{path.name} has {width} columns, one more than {what} of {robot.name}: "
                    "were the first that of times, it would increase. "
                    f"{_all(known, base)}"
                )
            if shift:
                notes.append(TIMES)
            if joints is None:
                notes.append(f"{width} columns without a header: {'' if not base else 'base, then '}{what}, in that order.")
            at = shift + base
            places = tuple(range(shift, shift + 3)) if base else ()
            turn = tuple(range(shift + 3, shift + BASE)) if base else ()
            return Columns(0 if shift else None, places, turn, False, {n: at + i for i, n in enumerate(order)}, tuple(notes))
    raise InputError(f"{path.name} has {width} columns; {_all(known, base)}")


def _all(known: dict[str, tuple[str, ...]], base: int) -> str:
    told = "; ".join(f"{base + len(order)}: {what}" for what, order in known.items())
    more = "x, y, z and a quaternion of the base, then joints" if base else "joints"
    return (
        f"expected ({more}) {told}; or one more, times, in front. "
        "Name the joints in order, joints=[...], or write their names in a header."
    )


def _joint(name: str, known: Sequence[str]) -> str | None:
    """The joint that a column's name means: with or without `_joint`, with `_dof` or `_pos` behind."""
    word = re.sub(r"([_.](dof|pos|position|angle|q))$", "", name.strip())
    for each in (name, word, f"{word}_joint"):
        if each in known:
            return each
    return None
