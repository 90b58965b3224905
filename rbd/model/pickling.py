"""Robots in pickles: what a robot's pickle holds, and one robot in a process for all pickles of the same robot.

A robot's pickle is a recipe: a function, what it makes the robot of, and a digest of the robot. A process that unpickles
the digest a second time gets the robot that it has. So a thousand states that arrive one by one share one robot, and it is
built once. A robot that was changed since it arrived is not handed out again; the next pickle builds another one.

The recipe of a bare model is the model's numbers. `rbd.robots` has shorter ones. Whoever changes `robot.model` (masses,
gravity, limits) after the robot was made sends the changed model too, by its numbers.
"""

from __future__ import annotations

import hashlib
import weakref
import zlib
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Self

import pinocchio as pin

from rbd.errors import ModelError
from rbd.model.data_pool import RenewedLock

MOST_KEPT = 8
"""So many robots that arrived last are kept, also while no state of theirs exists."""
DIGITS = 9
"""Decimals of the numbers in `numbers_digest`: two machines' sines may differ in the last bit."""


@dataclass(frozen=True, eq=False)
class Recipe:
    """How another process makes a robot.

    Attributes:
        build: A function that a pickle can name; it makes the robot of `parts`.
        parts: What it is given; plain values.
    """

    build: Callable[..., Any]
    parts: tuple[Any, ...]


@dataclass(frozen=True, eq=False)
class Parcel:
    """What a robot's pickle holds, made once and used until the robot changes.

    Attributes:
        key: Digest of the robot.
        recipe: For the robot as it was made.
        model: Its model now, copied: a robot whose model differs needs another parcel.
        changed: That model in bytes, if it was changed since the robot was made.
        extras: What else was changed, see `Travelling._extras`.
    """

    key: str
    recipe: Recipe
    model: pin.Model
    changed: bytes | None
    extras: tuple[Any, ...]


class Travelling:
    """A robot that pickles as a recipe, and whose copies are independent of it.

    `copy.deepcopy` makes an independent robot, `copy.copy` another one with the same Pinocchio model. Unpickling gives a robot
    that the process may have already: to change one, make a deep copy of it first.
    """

    model: pin.Model
    _as_made: pin.Model
    _parcel: Parcel | None = None

    @property
    def digest(self) -> str:
        """A digest of the robot in hexadecimal digits: equal for robots with equal numbers, names, feet and postures."""
        return self._sent().key

    def __reduce__(self) -> tuple[object, ...]:
        """A recipe of a few hundred bytes for robots of the catalogue, a few kilobytes for others."""
        sent = self._sent()
        return arrived, (sent.key, sent.recipe.build, sent.recipe.parts, sent.changed, sent.extras, self._files())

    def __copy__(self) -> Self:
        out = self._with_model(self.model, None)
        out._as_made = self._as_made
        out._take_extras(self._extras())
        return out

    def __deepcopy__(self, memo: dict[int, object]) -> Self:
        out = self._with_model(self._as_made.copy(), memo)
        memo[id(self)] = out
        out._take_extras(self._extras())
        if not self._is_as_made():
            put_numbers(out.model, packed(self.model))
        return out

    def _sent(self) -> Parcel:
        """The parcel, made anew if the robot changed since the last one."""
        last, now, same = self._parcel, self._extras(), self._is_as_made()
        if last is None or last.extras != now or (last.changed is None) != same or not (same or last.model == self.model):
            changed = None if same else packed(self.model)
            recipe = self._recipe()
            key = hashlib.sha256(f"{self._content()}{now!r}".encode())
            key.update(self.model.saveToString().encode())
            self._parcel = last = Parcel(key.hexdigest()[:32], recipe, self.model.copy(), changed, now)
        return last

    def _is_as_made(self) -> bool:
        """Whether the model has the numbers that it had when the robot was made."""
        return bool(self.model == self._as_made)

    def _recipe(self) -> Recipe:
        """For the robot as it was made."""
        raise NotImplementedError

    def _with_model(self, model: pin.Model, memo: dict[int, object] | None) -> Self:
        """The same robot with another model, without extras; its parts copied with the memo of a deep copy, or shared."""
        raise NotImplementedError

    def _content(self) -> str:
        """What the digest covers besides the model's numbers."""
        raise NotImplementedError

    def _extras(self) -> tuple[Any, ...]:
        """What is put on again after the robot is made: whether its inertia is sound, what the user changed; comparable."""
        return ()

    def _take_extras(self, extras: tuple[Any, ...]) -> None:
        """Have what the user changed on the other side."""

    def _files(self) -> dict[str, bytes] | None:
        """Files that travel with the robot; None if there are none."""
        return None

    def _take_files(self, files: dict[str, bytes]) -> None:
        """Keep files that came with the robot."""


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


class _Arrivals:
    """The robots that arrived in this process, by digest; those in use, and the last few."""

    def __init__(self) -> None:
        self._all: weakref.WeakValueDictionary[str, Travelling] = weakref.WeakValueDictionary()
        self._last: OrderedDict[str, Travelling] = OrderedDict()
        self._lock = RenewedLock()

    def get(self, key: str) -> Travelling | None:
        """The robot of this digest, if it is here and was not changed since it arrived."""
        robot = self._all.get(key)
        return robot if robot is not None and robot.digest == key else None

    def keep(self, key: str, robot: Travelling) -> Travelling:
        """Keep a robot as the last; what is handed out, which is that of another thread if that was faster."""
        with self._lock:
            robot = self.get(key) or robot
            self._all[key] = self._last[key] = robot
            self._last.move_to_end(key)
            while len(self._last) > MOST_KEPT:
                self._last.popitem(last=False)
        return robot


_arrivals = _Arrivals()


def arrived(
    key: str,
    build: Callable[..., Any],
    parts: tuple[Any, ...],
    changed: bytes | None,
    extras: tuple[Any, ...],
    files: dict[str, bytes] | None,
) -> Any:
    """The robot of a pickle: that of the same digest, if this process has it unchanged, else a new one.

    Args:
        key: Its digest.
        build: Makes it as it was made first.
        parts: What `build` is given.
        changed: The model in bytes, if it was changed since.
        extras: What else was changed.
        files: Files that came with it.

    Raises:
        ModelError: it cannot be made here; the message says why.
    """
    robot = _arrivals.get(key)
    if robot is None:
        robot = build(*parts)
        assert isinstance(robot, Travelling)
        if changed is not None:
            put_numbers(robot.model, changed)  # tables that were made of the first model stay, as on the other side
        robot._take_extras(extras)
        robot._parcel = Parcel(key, Recipe(build, parts), robot.model.copy(), changed, extras)
    robot = _arrivals.keep(key, robot)
    if files is not None:
        robot._take_files(files)
    return robot
