"""Robots in pickles: what a robot's pickle holds, and one robot in a process for all pickles of the same robot.

A robot's pickle is a recipe: a function, what it makes the robot of, and a digest of the robot. A process that unpickles
the digest a second time gets the robot that it has. So a thousand states that arrive one by one share one robot, and it is
built once. A robot that was changed since it arrived is not handed out again; the next pickle builds another one. To change
one, make a deep copy of it first: `copy.deepcopy` makes an independent robot, `copy.copy` another one with the same model.

The recipe of a bare model is the model's numbers. `rbd.robots` has shorter ones. Whoever changes `robot.model` (masses,
gravity, limits) after the robot was made sends the changed model too, by its numbers.
"""

from __future__ import annotations

import hashlib
import weakref
import zlib
from collections import OrderedDict
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeAlias

import pinocchio as pin

from rbd.errors import ModelError
from rbd.model.data_pool import RenewedLock

Recipe: TypeAlias = partial[Any]
"""How another process makes a robot: a function that a pickle can name, with plain values."""
MOST_KEPT = 8
"""So many robots that arrived last are kept, also while no state of theirs exists."""
DIGITS = 9
"""Decimals of the numbers in `numbers_digest`: two machines' sines may differ in the last bit."""


@dataclass(frozen=True, eq=False)
class Parcel:
    """What a robot's pickle holds, made once and used until the robot changes.

    Attributes:
        key: Digest of the robot.
        recipe: Makes the robot as it was made: a function that a pickle can name, of plain values.
        model: Its model now, copied: a robot whose model differs needs another parcel.
        changed: That model in bytes, if it was changed since the robot was made.
        extras: What else was changed, see `CheckedModel._extras`.
    """

    key: str
    recipe: Recipe
    model: pin.Model
    changed: bytes | None
    extras: tuple[Any, ...]


def packed(model: pin.Model) -> bytes:
    """A model's names and numbers to the last bit, compressed: 6 kB for a humanoid."""
    return zlib.compress(model.saveToString().encode(), 6)


def unpacked(data: bytes, version: str) -> pin.Model:
    """The model of `packed`.

    Args:
        data: What `packed` gave.
        version: Of the Pinocchio that wrote it, for the message.

    Raises:
        ModelError: another version of Pinocchio that cannot read it.
    """
    model = pin.Model()
    try:
        put_numbers(model, data)
    except (ValueError, RuntimeError, zlib.error) as error:
        raise ModelError(
            f"a robot that was pickled with Pinocchio {version} cannot be read with {pin.__version__}: {error!s:.200}. Install "
            "the same version in both environments."
        ) from None
    return model


def put_numbers(model: pin.Model, data: bytes) -> None:
    """Give a model the numbers of another one, in bytes of `packed`."""
    model.loadFromString(zlib.decompress(data).decode())


def numbers_digest(model: pin.Model) -> str:
    """A digest of a model's names and numbers, these to `DIGITS` decimals, so that it is the same on all machines."""
    found = hashlib.sha256()
    for word in model.saveToString().split()[3:]:  # behind the header of the archive
        if "." in word or "e" in word:
            try:
                word = f"{round(float(word), DIGITS) + 0.0!r}"
            except ValueError:
                pass  # a name
        found.update(word.encode() + b" ")
    return found.hexdigest()[:32]


_here: weakref.WeakValueDictionary[str, Any] = weakref.WeakValueDictionary()
_last: OrderedDict[str, Any] = OrderedDict()
"""The robots that arrived in this process, by digest: those in use, and the last few."""
_lock = RenewedLock()


def _unchanged(key: str) -> Any:
    """The robot of this digest, if it is here and was not changed since it arrived; else None."""
    robot = _here.get(key)
    return robot if robot is not None and robot.digest == key else None


def arrived(key: str, recipe: Recipe, changed: bytes | None, extras: tuple[Any, ...], files: dict[str, bytes] | None) -> Any:
    """The robot of a pickle: that of the same digest, if this process has it unchanged, else a new one.

    Args:
        key: Its digest.
        recipe: Makes it as it was made first.
        changed: The model in bytes, if it was changed since.
        extras: What else was changed.
        files: Files that came with it.

    Raises:
        ModelError: it cannot be made here; the message says why.
    """
    robot = _unchanged(key)
    if robot is None:
        robot = recipe()
        if changed is not None:
            put_numbers(robot.model, changed)  # tables that were made of the first model stay, as on the other side
        robot._take_extras(extras)
        robot._parcel = Parcel(key, recipe, robot.model.copy(), changed, extras)
    with _lock:
        robot = _unchanged(key) or robot  # that of another thread, if that was faster
        _here[key] = _last[key] = robot
        _last.move_to_end(key)
        while len(_last) > MOST_KEPT:
            _last.popitem(last=False)
    if files is not None:
        robot._take_files(files)
    return robot
